"""Arguments of the Python functions as the commands have them, and what is said of those that are none."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, NoReturn, TypeAlias

from ..case import LoadedCase
from ..case.axes import Axis, Bounds, read_bounds
from ..errors import CaseError

CaseLike: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any] | LoadedCase"
Overrides: TypeAlias = "Mapping[str, Any] | Sequence[str] | None"
# for YAML 1.1 a number with an exponent has a point and the sign of the exponent
_NUMBER_OF_1_2 = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def wrong(what: str, expected: str, given: Any) -> NoReturn:
    """Raise the TypeError of an argument."""
    raise TypeError(f"{what}: expected {expected}, got {given!r}"[:300])


def options_of(overrides: Overrides) -> tuple[str, ...]:
    """Return overrides as the command line has them; TypeError where they are neither a mapping nor texts."""
    if overrides is None:
        return ()
    if isinstance(overrides, Mapping):
        plain = json.loads(json.dumps(_as_yaml_1_2(overrides), default=plain_value))
        return tuple(Axis(path, (value,), "").override(value) for path, value in plain.items())
    return texts_of(overrides, "overrides", "a mapping {path: value} or a list of 'path=value' strings", single=False)


def texts_of(given: Any, what: str, expected: str, single: bool = True) -> tuple[str, ...]:
    """Return texts, of which a ``single`` one may stand alone; none for None. TypeError for anything else."""
    if given is None:
        return ()
    if isinstance(given, str) and single:
        return (given,)
    if isinstance(given, str) or not isinstance(given, Iterable):
        wrong(what, expected, given)
    found = tuple(given)
    if not all(isinstance(text, str) for text in found):
        wrong(what, expected, given)
    return found


def bounds_of(vary: Mapping[str, tuple[float, float]]) -> list[Bounds]:
    """Return the bounds of numbers by their paths. TypeError where they are no pairs, CaseError for wrong ranges."""
    expected = "bounds by path, such as {'bodies.beam.material.E': (1e9, 1e11)}"
    if not (isinstance(vary, Mapping) and vary):
        wrong("vary", expected, vary)
    options = []
    for path, pair in vary.items():
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            wrong("vary", expected, {path: pair})
        options.append(f"{path}={low!r}:{high!r}")
    return read_bounds(options)


def numbers_of(given: Any, what: str, expected: str, right: Callable[[float], bool]) -> list[float]:
    """Return numbers, none for None. TypeError where they are none, CaseError where one is not ``right``."""
    if given is None:
        return []
    if not isinstance(given, Iterable):
        wrong(what, expected, given)
    found = list(given)
    if not all(isinstance(x, Real) for x in found):
        wrong(what, expected, given)
    for x in map(float, found):
        if not (math.isfinite(x) and right(x)):
            raise CaseError(f"{what}: expected {expected}, got {x:g}")
    return [float(x) for x in found]


def as_text(case: Mapping[str, Any]) -> str:
    """Return a case that is a mapping as a text; it may be what ``yaml.safe_load`` made of a case file."""
    # JSON is YAML; a line for each value, so that problems name the place
    return json.dumps(_as_yaml_1_2(case), default=plain_value, indent=1, ensure_ascii=False)


def _as_yaml_1_2(value: Any) -> Any:
    """Return a value with what YAML 1.1 reads differently: the key ``on`` as true, numbers such as 1e6 as text."""
    if isinstance(value, Mapping):
        return {"on" if key is True else key: _as_yaml_1_2(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_as_yaml_1_2(one) for one in value]
    return float(value) if isinstance(value, str) and _NUMBER_OF_1_2.fullmatch(value) else value


def plain_value(value: Any) -> Any:
    """Return what arrays and numbers of NumPy, paths and other mappings hold as JSON has it."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a case holds numbers, strings, lists and mappings, not {type(value).__name__}")
