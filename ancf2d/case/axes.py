"""Values over which a case is varied: ``--over PATH=a,b,c`` with ranges, ``--sample "PATH~normal(mean, sd)"``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeVar

from ..errors import CaseError, Problem, raise_any
from .compose import compose
from .emit import flow
from .nodes import ListNode, Mark, Node, Origin, Scalar, plain_data, quoted, resolve

OPTION = "--over "
SAMPLE = "--sample "
MAX_COMBINATIONS = 100_000
T = TypeVar("T", "Axis", "Distribution", "Bounds")
RANGE = "FROM:TO:NUMBER or log:FROM:TO:NUMBER"
# significant digits of the values of a range; the last digit of a double would only show round-off
DIGITS = 15
# a range, valid or not: no other value without quotes begins with a number and a colon
_RANGE = re.compile(r"log:.*|[-+]?\.?\d[^:\s]*:.*")


@dataclass(frozen=True)
class Axis:
    """A path of the case and the values to give it, as plain data.

    ``text`` is the option as given; ``option`` is its name on the command line.
    """

    path: str
    values: tuple[Any, ...]
    text: str
    option: str = OPTION

    def override(self, value: Any) -> str:
        """Return one of the values as a ``PATH=VALUE`` override."""
        return f"{self.path}={flow(value)}"


@dataclass(frozen=True)
class Distribution:
    """The distribution of a sampled path: ``normal`` (mean, sd), ``uniform`` (a, b), ``lognormal`` (mean, sd of ln)."""

    path: str
    kind: str
    numbers: tuple[float, float]
    text: str


def read_axes(options: Sequence[str], pair: bool = False) -> list[Axis]:
    """Return the axes of ``PATH=a,b,c`` options: values in YAML notation, separated by commas outside of brackets.

    ``0.1:0.5:20`` stands for 20 values from 0.1 to 0.5; the prefix ``log:`` spaces them by equal ratios. With ``pair``
    the k-th values of all lists are combined, so the lists must have equal lengths. Raises CaseError with all problems.
    """
    axes, problems = _each(options, lambda text: _axis(text, distinct=not pair), OPTION, "varied")
    count = 1
    for axis in [] if pair else axes:
        count *= max(len(axis.values), 1)
    if count > MAX_COMBINATIONS:
        problems.append(Problem(f"these are {count} combinations", expected=f"at most {MAX_COMBINATIONS}",
                                file=OPTION.strip()))
    if pair:
        problems += _unpaired(axes)
    raise_any(problems)
    return axes


def _each(options: Sequence[str], read: Callable[[str], T], option: str, done: str) -> tuple[list[T], list[Problem]]:
    """Return the options as read by ``read``, and all problems; a path given twice is one ("... is ``done`` twice")."""
    found: list[T] = []
    problems: list[Problem] = []
    for text in options:
        try:
            one = read(text)
        except CaseError as error:
            problems += error.problems
            continue
        if any(one.path == other.path for other in found):
            problems.append(_start(text, option).problem(f"{quoted(one.path)} is {done} twice"))
        found.append(one)
    return found, problems


def _unpaired(axes: Sequence[Axis]) -> list[Problem]:
    """Return a problem for every list that is not as long as the first one."""
    return [_start(axis.text).problem(f"{quoted(axis.path)} has a list of {len(axis.values)}, {quoted(axes[0].path)} "
                                      f"a list of {len(axes[0].values)}", expected="lists of one length with --pair")
            for axis in axes[1:] if len(axis.values) != len(axes[0].values)]


def _start(text: str, option: str = OPTION) -> Mark:
    shown = option + text
    return Mark(Origin(shown, shown.split("\n"), numbered=False), 1, len(option) + 1)


def _axis(text: str, distinct: bool) -> Axis:
    path, equals, values = text.partition("=")
    start = _start(text)
    if not equals or not path.strip():
        raise CaseError(start.problem("not PATH=VALUE,VALUE", expected="for example bodies.beam.element.count=4,8,16"))
    unfinished = [part for part in map(str.strip, values.split(",")) if _RANGE.fullmatch(part) and part.endswith(":")]
    if unfinished:
        # YAML would read the last colon as the end of a key
        raise CaseError(start.problem(f"{quoted(unfinished[0])} is not a range", expected=RANGE))
    # read as the inside of a YAML list, whose bracket replaces the equals sign to keep the columns
    refused: list[Problem] = []
    node = compose(f"[{values}]", start.origin, len(OPTION) + len(path) + 1, refused)
    raise_any(refused)
    items = node.items if isinstance(node, ListNode) else []
    if not items:
        raise CaseError(start.problem("there is no value", expected="values separated by commas"))
    listed = [value for item in items for value in _values(item)]
    # 1000 and 1e3 are the same value
    return Axis(path.strip(), tuple({flow(value): value for value in listed}.values() if distinct else listed), text)


def _values(item: Node) -> list[Any]:
    """Return the values of one item of a list: those of a range, or the item itself."""
    if not (isinstance(item, Scalar) and item.plain and _RANGE.fullmatch(item.text)):
        return [plain_data(item)]
    *scale, start, stop, number = item.text.split(":") if item.text.count(":") > 1 else ("", "", "")
    ends = [resolve(start), resolve(stop)]
    if not all(isinstance(v, int | float) for v in ends) or scale not in ([], ["log"]):
        raise CaseError(item.mark.problem(f"{quoted(item.text)} is not a range", expected=RANGE))
    if not number.isdigit() or not 2 <= int(number) <= MAX_COMBINATIONS:
        raise CaseError(item.mark.problem(f"the number of values of {quoted(item.text)} is {number or 'missing'}",
                                          expected=f"a whole number from 2 to {MAX_COMBINATIONS}"))
    a, b = map(float, ends)
    if scale and not (a > 0.0 and b > 0.0):
        raise CaseError(item.mark.problem(f"{quoted(item.text)} has an end that is not > 0",
                                          expected="positive ends after log:"))
    return _spaced(a, b, int(number), bool(scale), whole=all(isinstance(v, int) for v in ends))


def _spaced(a: float, b: float, n: int, log: bool, whole: bool) -> list[float | int]:
    """Return ``n`` numbers from a to b, with whole ends and a whole step as whole numbers."""
    if whole and not log and (b - a) % (n - 1) == 0:
        return [round(a + (b - a) * k / (n - 1)) for k in range(n)]
    shares = [k / (n - 1) for k in range(n)]
    between = [math.exp((1 - s) * math.log(a) + s * math.log(b)) if log else (1 - s) * a + s * b for s in shares]
    # between ends of both signs, 0 is met only but for round-off
    least = 0.0 if log else 10.0**-DIGITS * max(abs(a), abs(b))
    return [a, *(float(f"{v:.{DIGITS}g}") if abs(v) > least else 0.0 for v in between[1:-1]), b]


def combinations(axes: Sequence[Axis], pair: bool = False) -> Iterator[tuple[Any, ...]]:
    """Yield all combinations of the values, the last axis changing fastest; with ``pair`` the k-th values together."""
    lists = [axis.values for axis in axes]
    return zip(*lists, strict=True) if pair else product(*lists)


# ---------------------------------------------------------------------------- distributions

_SAMPLE = re.compile(r"([^~]*)~\s*([A-Za-z_]*)\s*\((.*)\)\s*")
# of each kind: the names of its two numbers, and which numbers are valid
_KINDS = {"normal": ("mean, sd", "a standard deviation > 0"), "uniform": ("a, b", "a < b"),
          "lognormal": ("mu, sigma", "mean and standard deviation sigma > 0 of the natural logarithm")}
# number of sigmas within which a lognormal value must be finite, and the largest logarithm of a double
_TAIL, _LARGEST = 10.0, 700.0


def read_distributions(options: Sequence[str]) -> list[Distribution]:
    """Return the distributions of ``PATH~normal(mean, sd)`` options. Raises CaseError with all problems."""
    found, problems = _each(options, _distribution, SAMPLE, "sampled")
    raise_any(problems)
    return found


def _distribution(text: str) -> Distribution:
    start, match = _start(text, SAMPLE), _SAMPLE.fullmatch(text)
    if match is None or not match[1].strip():
        raise CaseError(start.problem("not PATH~DISTRIBUTION(...)",
                                      expected='for example "bodies.beam.material.E~normal(2e11, 1e10)"'))
    path, kind = match[1].strip(), match[2]
    if kind not in _KINDS:
        raise CaseError(start.problem(f"{quoted(kind)} is not a distribution",
                                      expected="normal(mean, sd), uniform(a, b) or lognormal(mu, sigma)"))
    names, right = _KINDS[kind]
    values = [resolve(v.strip()) for v in match[3].split(",")]
    if len(values) != 2 or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        raise CaseError(start.problem(f"{kind}({match[3]}) needs two numbers", expected=f"{kind}({names})"))
    a, b = (float(v) for v in values)
    wrong = b <= a if kind == "uniform" else b <= 0.0
    if kind == "lognormal":
        # catches the mean and deviation of the values themselves, given instead of those of their logarithms
        wrong |= abs(a) + _TAIL * b > _LARGEST
        if a > _LARGEST and math.isfinite(a):
            right += f"; that of {a:g} is {math.log(a):.4g}"
    if not (math.isfinite(a) and math.isfinite(b)) or wrong:
        raise CaseError(start.problem(f"{kind}({match[3].strip()}) is not valid", expected=right))
    return Distribution(path, kind, (a, b), text)


# ---------------------------------------------------------------------------- bounds

VARY = "--vary "


@dataclass(frozen=True)
class Bounds:
    """A path whose number is searched between ``low`` and ``high``; ``text`` is the option as given."""

    path: str
    low: float
    high: float
    text: str


def read_bounds(options: Sequence[str]) -> list[Bounds]:
    """Return the bounds of ``PATH=low:high`` options. Raises CaseError with all problems."""
    found, problems = bounds_and_problems(options)
    raise_any(problems)
    return found


def bounds_and_problems(options: Sequence[str]) -> tuple[list[Bounds], list[Problem]]:
    """Return the bounds of those ``PATH=low:high`` options that can be read, and the problems of the others."""
    return _each(options, _bounds, VARY, "varied")


def _bounds(text: str) -> Bounds:
    start, (path, _, ends) = _start(text, VARY), text.partition("=")
    values = [resolve(v.strip()) for v in ends.split(":")]
    right = len(values) == 2 and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not (path.strip() and right):
        raise CaseError(start.problem("not PATH=LOW:HIGH", expected="for example bodies.beam.material.E=1e9:1e11"))
    low, high = map(float, values)
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise CaseError(start.problem(f"{ends} is not a range", expected="two numbers, the lower first"))
    return Bounds(path.strip(), low, high, text)
