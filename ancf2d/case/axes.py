"""``--over PATH=a,b,c``: values over which a case is varied."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from ..errors import CaseError, Problem
from .compose import compose
from .emit import flow
from .nodes import ListNode, Mark, Origin, plain_data, quoted

OPTION = "--over "
MAX_COMBINATIONS = 100_000


@dataclass(frozen=True)
class Axis:
    """A path of the case with the values that it takes, as plain data; ``text`` is the option as given."""

    path: str
    values: tuple[Any, ...]
    text: str

    def override(self, value: Any) -> str:
        """Return one of the values as a ``PATH=VALUE`` override."""
        return f"{self.path}={flow(value)}"


def read_axes(options: Sequence[str]) -> list[Axis]:
    """Return the axes of ``PATH=a,b,c`` options: values as YAML has them, separated by commas outside of brackets.

    Raises CaseError with all problems.
    """
    problems: list[Problem] = []
    axes: list[Axis] = []
    for text in options:
        try:
            axis = _axis(text)
        except CaseError as error:
            problems.extend(error.problems)
            continue
        if any(axis.path == other.path for other in axes):
            problems.append(_start(text).problem(f"{quoted(axis.path)} is varied twice"))
        axes.append(axis)
    count = 1
    for axis in axes:
        count *= max(len(axis.values), 1)
    if count > MAX_COMBINATIONS:
        problems.append(Problem(f"these are {count} combinations", expected=f"at most {MAX_COMBINATIONS}",
                                file=OPTION.strip()))
    if problems:
        raise CaseError(problems)
    return axes


def _start(text: str) -> Mark:
    shown = OPTION + text
    return Mark(Origin(shown, shown.split("\n"), numbered=False), 1, len(OPTION) + 1)


def _axis(text: str) -> Axis:
    path, equals, values = text.partition("=")
    start = _start(text)
    if not equals or not path.strip():
        raise CaseError(start.problem("not PATH=VALUE,VALUE", expected="for example bodies.beam.element.count=4,8,16"))
    # as the inside of a YAML list; its bracket stands in the place of the equals sign
    refused: list[Problem] = []
    node = compose(f"[{values}]", start.origin, 1, len(OPTION) + len(path) + 1, refused)
    if refused:
        raise CaseError(refused)
    items = node.items if isinstance(node, ListNode) else []
    if not items:
        raise CaseError(start.problem("there is no value", expected="values separated by commas"))
    # 1000 and 1e3 are one value
    found = {flow(value): value for value in map(plain_data, items)}
    return Axis(path.strip(), tuple(found.values()), text)


def combinations(axes: Sequence[Axis]) -> Iterator[tuple[Any, ...]]:
    """Yield every combination of the values, those of the last axis changing fastest."""
    return product(*(axis.values for axis in axes))
