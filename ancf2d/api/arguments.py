"""Conversion of Python arguments to those of the commands, with errors for wrong ones."""

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
# YAML 1.1 reads a number with an exponent as text, unless it has a point and the exponent has a sign
_NUMBER_OF_1_2 = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def raise_type_error(what: str, expected: str, given: Any) -> NoReturn:
    """Raise the TypeError for a wrong argument."""
    raise TypeError(f"{what}: expected {expected}, got {given!r}"[:300])


def options_of(overrides: Overrides) -> tuple[str, ...]:
    """Return overrides as command-line texts. Raises TypeError if they are neither a mapping nor texts."""
    if overrides is None:
        return ()
    if isinstance(overrides, Mapping):
        plain = json.loads(json.dumps(_as_yaml_1_2(overrides), default=plain_value))
        return tuple(Axis(path, (value,), "").override(value) for path, value in plain.items())
    return texts_of(overrides, "overrides", "a mapping {path: value} or a list of 'path=value' strings", single=False)


def texts_of(given: Any, what: str, expected: str, single: bool = True) -> tuple[str, ...]:
    """Return a tuple of texts, empty for None; ``single`` allows one plain string. Raises TypeError for others."""
    if given is None:
        return ()
    if isinstance(given, str) and single:
        return (given,)
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise_type_error(what, expected, given)
    found = tuple(given)
    if not all(isinstance(text, str) for text in found):
        raise_type_error(what, expected, given)
    return found


def bounds_of(vary: Mapping[str, tuple[float, float]]) -> list[Bounds]:
    """Return the bounds of numbers by path. Raises TypeError if they are not pairs, CaseError for wrong ranges."""
    expected = "bounds by path, such as {'bodies.beam.material.E': (1e9, 1e11)}"
    if not (isinstance(vary, Mapping) and vary):
        raise_type_error("vary", expected, vary)
    options = []
    for path, pair in vary.items():
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise_type_error("vary", expected, {path: pair})
        options.append(f"{path}={low!r}:{high!r}")
    return read_bounds(options)


def numbers_of(given: Any, what: str, expected: str, right: Callable[[float], bool]) -> list[float]:
    """Return a list of numbers, empty for None. Raises TypeError if they are not, CaseError if one is not ``right``."""
    if given is None:
        return []
    if not isinstance(given, Iterable):
        raise_type_error(what, expected, given)
    found = list(given)
    if not all(isinstance(x, Real) for x in found):
        raise_type_error(what, expected, given)
    for x in map(float, found):
        if not (math.isfinite(x) and right(x)):
            raise CaseError(f"{what}: expected {expected}, got {x:g}")
    return [float(x) for x in found]


def as_text(case: Mapping[str, Any]) -> str:
    """Return a case given as a mapping, possibly from ``yaml.safe_load``, as text."""
    # JSON is YAML; one value per line, so that messages give the line
    return json.dumps(_as_yaml_1_2(case), default=plain_value, indent=1, ensure_ascii=False)


def _as_yaml_1_2(value: Any) -> Any:
    """Return a value with the misreadings of YAML 1.1 undone: the key ``on`` as true, numbers such as 1e6 as text."""
    if isinstance(value, Mapping):
        return {"on" if key is True else key: _as_yaml_1_2(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_as_yaml_1_2(one) for one in value]
    return float(value) if isinstance(value, str) and _NUMBER_OF_1_2.fullmatch(value) else value


def plain_value(value: Any) -> Any:
    """Return a value that JSON can write, for arrays and numbers of NumPy, paths and other mappings."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a case holds numbers, strings, lists and mappings, not {type(value).__name__}")
