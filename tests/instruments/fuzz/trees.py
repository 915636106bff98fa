"""Changes of nested plain data as in YAML and JSON: values, keys, positions, sizes, numbers."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterator, Sequence
from typing import Any

Place = tuple[Any, ...]

NUMBERS = [0, -0.0, 1, -1, 2, 3, 0.5, 1e-3, 1e3, 1e6, -1e6, 10**9, 10**9 + 1, 2**31, 2**63, 2**64, 10**30, 10**400,
           1e16, 1e-16, 1e100, -1e100, 1e-100, 1e154, 1e155, 1e300, 1e-300, 1e308, -1e308, 1.7976931348623157e308,
           5e-324, 2.2e-308, math.nan, math.inf, -math.inf, 0.1 + 0.2, 1 / 3, 0.9999999999999999, 1.0000000000000002]
TEXTS = ["", " ", "abc", "beam@0.5", "beam@1", "beam@", "@", "beam@nan", "beam@1e-320", "x@0", "true", "null", "~",
         "no", "1e3", "1_000", "0x10", "0o7", "1:30", "2001-01-01", "=", "<<",
         "rest", "static", "auto", "user", "rigid", "none",
         "all",
         "\u0000", "\ufeff", "\u2028", "😀", "e\u0301" * 40, "\u202eabc", "a" * 10_000,
         "../../../etc/passwd", "/dev/zero", "/dev/stdin", "/proc/self/mem", "%s%n{0}", "$(id)", "__import__('os')",
         "t**9**9", "9^9^9^9",
         "(" * 70 + "t" + ")" * 70, "exp(exp(exp(t+9)))", "1/t", "sqrt(-1-t)", "1 if t<0.5 else 1/0", "-" * 2500 + "t",
         "Infinity", "+.inf", "1e999", "0.1e-999", "- 1", "[1", "{a", "\x1b[31m", "\t", "a\nb", "a\r\nb"]
OTHERS: list[Any] = [None, True, False, [], {}, [None], [[]], [{}], {"": None}, {"type": None}, {"a": {"b": {"c": 1}}},
                     [0, 0], [1, 0], [0.0, math.nan], [1e308, 1e308], [[0, 0], [1, 0]], [1] * 100, [[1, 2]] * 300]


def places(data: Any, path: Place = ()) -> Iterator[Place]:
    """Yield the position of every value inside plain data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def value_at(data: Any, path: Place) -> Any:
    """Return the value at a position."""
    for part in path:
        data = data[part]
    return data


def changed(data: Any, rng: random.Random, strangers: Sequence[Any] = ()) -> Any:
    """Return plain data with one change; parts may come from the data ``strangers``."""
    data = copy.deepcopy(data)
    found = list(places(data))
    if not found:
        return rng.choice(OTHERS)
    act = rng.choices(list(ACTS), weights=list(ACTS.values()))[0]
    if act is _number:
        found = [p for p in found if _is_number(value_at(data, p))] or found
    path = rng.choice(found)
    act(value_at(data, path[:-1]), path[-1], rng, [data, *strangers])
    return data


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(parent: Any, key: Any, rng: random.Random, _: Sequence[Any]) -> None:
    """Change a number as a number; replace other values by one."""
    value = parent[key]
    if not _is_number(value) or not math.isfinite(value) or abs(value) > 1e300:
        parent[key] = rng.choice(NUMBERS)
        return
    changes: list[Callable[[], Any]] = [
        lambda: rng.choice(NUMBERS), lambda: -value, lambda: float(value) * 10.0 ** rng.uniform(-12, 12),
        lambda: value * rng.uniform(0.5, 2), lambda: value + rng.choice([-1, 1]), lambda: str(value),
        lambda: value * (1 + 2.0 ** -rng.randrange(20, 53)), lambda: int(value) * 10 ** rng.randrange(1, 9)]
    parent[key] = rng.choice(changes)()


def _odd(parent: Any, key: Any, rng: random.Random, _: Sequence[Any]) -> None:
    parent[key] = copy.deepcopy(rng.choice(rng.choice([NUMBERS, TEXTS, OTHERS])))


def _delete(parent: Any, key: Any, rng: random.Random, _: Sequence[Any]) -> None:
    del parent[key]


def _rename(parent: Any, key: Any, rng: random.Random, data: Sequence[Any]) -> None:
    if isinstance(parent, dict):
        keys = [p[-1] for p in places(rng.choice(data)) if isinstance(p[-1], str)] or ["q"]
        name = rng.choice([str(key)[:-1], str(key) + rng.choice("sx_ "), str(key).upper(), rng.choice(keys),
                           rng.choice(TEXTS)])
        parent[name] = parent.pop(key)
    else:
        rng.shuffle(parent)


def _splice(parent: Any, key: Any, rng: random.Random, data: Sequence[Any]) -> None:
    """Insert a part of this or other data in place of a value, or beside it under its own key."""
    source = rng.choice(data)
    found = list(places(source))
    if not found:
        return
    other = rng.choice(found)
    part = copy.deepcopy(value_at(source, other))
    if isinstance(parent, dict) and isinstance(other[-1], str) and rng.random() < 0.5:
        parent[other[-1]] = part
    else:
        parent[key] = part


def _akin(parent: Any, key: Any, rng: random.Random, data: Sequence[Any]) -> None:
    """Replace a value by one that has the same key elsewhere: such mutants are often valid."""
    found = [(d, p) for d in data for p in places(d) if p[-1] == key]
    source, path = rng.choice(found)
    parent[key] = copy.deepcopy(value_at(source, path))


def _repeat(parent: Any, key: Any, rng: random.Random, _: Sequence[Any]) -> None:
    """Repeat the items of a list, or the values of a mapping, many times."""
    count = rng.choice([2, 3, 20, 200])
    if isinstance(parent, list):
        parent[key:key] = [copy.deepcopy(parent[key]) for _ in range(count)]
    else:
        for i in range(count):
            parent[f"{key}{i}"] = copy.deepcopy(parent[key])


def _nest(parent: Any, key: Any, rng: random.Random, _: Sequence[Any]) -> None:
    for _ in range(rng.choice([1, 2, 30, 60])):
        parent[key] = [parent[key]] if rng.random() < 0.5 else {"a": parent[key]}


ACTS: dict[Callable[[Any, Any, random.Random, Sequence[Any]], None], int] = {
    _number: 30, _odd: 12, _delete: 10, _rename: 8, _splice: 12, _akin: 20, _repeat: 5, _nest: 3}
