"""The constants of a point law, and checks of the force function from which a plugin makes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ..elements.point_laws import MAX_CONSTANTS
from ..elements.shape import Array
from ..errors import PluginError

# arguments at which the derivatives of plugins are checked, steps of differences relative to them, and the smallest
# relative error that is not one of differences
TRIALS = [(x, y) for x in (-2.9, -0.37, -0.041, 0.0053, 0.047, 0.41, 3.1) for y in (0.0, -0.61 * x)]
DIFFERENCE, WRONG = 1e-4, 0.02


class Slope(NamedTuple):
    """A value of a force function that is the derivative of another value by an argument; of energies, at rest."""

    of: int
    by: int
    at_rest: bool = False


def constants_of(item: Any, force: Callable[..., Any], returns: Mapping[str, Slope | None]) -> list[float]:
    """Return the constants of a record's law, after a trial call of its ``force``, which ``returns`` these quantities.

    Raises PluginError if there are too many constants, if they are not numbers, if the force takes or returns
    something else, or if a derivative that a plugin returns is wrong.
    """
    name, given = type(item).__name__, item.constants()
    try:
        found = [float(x) for x in given]
    except (TypeError, ValueError):
        raise PluginError(f"{name}.constants() returns {given!r}; expected a list of numbers") from None
    if len(found) > MAX_CONSTANTS:
        raise PluginError(f"{name}.constants() returns {len(found)} numbers; expected at most {MAX_CONSTANTS}")
    # the force may have no value at 0
    with np.errstate(all="ignore"), suppress(ArithmeticError):
        try:
            out = force(0.0, 0.0, np.array(found))
        except TypeError as error:
            if error.__traceback__ is not None and error.__traceback__.tb_next is None:
                raise PluginError(f"the force of {name}: {error}") from None
            raise
        if not isinstance(out, tuple) or len(out) != len(returns):
            what = f"{len(out)} values" if isinstance(out, tuple) else str(out)
            raise PluginError(f"the force of {name} returns {what}; expected {len(returns)}: {', '.join(returns)}")
    if not force.__module__.startswith("ancf2d."):
        for point in TRIALS:
            _check_slopes(name, force, np.array(point), np.array(found), returns)
    return found


def _check_slopes(name: str, force: Callable[..., Any], point: Array, par: Array,
                  returns: Mapping[str, Slope | None]) -> None:
    """Compare the derivatives that a force returns with differences, unless it has a kink or no value nearby."""
    keys = list(returns)
    for k, (key, slope) in enumerate(returns.items()):
        if slope is None or (slope.at_rest and point[1]) or not point[slope.by]:
            continue
        h = DIFFERENCE * abs(point[slope.by]) * np.eye(2)[slope.by]
        with np.errstate(all="ignore"), suppress(ArithmeticError, ValueError):
            there = force(*point, par)
            low, middle, high = (float(out[slope.of]) for out in (force(*(point - h), par), there,
                                                                  force(*(point + h), par)))
            behind, ahead, given = (middle - low) / h.sum(), (high - middle) / h.sum(), float(there[k])
            most, error = max(abs(behind), abs(ahead)), 1e-12 * abs(middle) / h.sum()
            if np.isfinite([given, most]).all() and abs(ahead - behind) <= 0.5 * WRONG * most + error:
                found = 0.5 * (behind + ahead)
                if abs(given - found) > WRONG * max(abs(given), most) + error:
                    arguments = ", ".join(f"{x:g}" for x in point)
                    raise PluginError(f"the force of {name} returns {key} = {given:.6g} at ({arguments}), but "
                                      f"{keys[slope.of]} changes there by {found:.6g}")
