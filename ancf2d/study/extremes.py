"""Expressions with max and min, and their values if another value were the extreme."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..case.series import series
from ..case.syntax import Chain, Constant, Tree, Variable, named_in, renamed
from ..elements.shape import Array

# largest number of groups of neighbours into which the values under an extreme are divided
MOST = 500
# fraction of the range of the rows: rows above it are close enough to the largest to count in derivatives
NEAR = 0.5


@dataclass(frozen=True)
class Extreme:
    """The largest or smallest value of an expression over all states, or over all bodies at the end if it has a field.
    """

    largest: bool
    tree: Tree
    field: str = ""

    def at(self, values: Array) -> int:
        """Return the index of the extreme among values (m,)."""
        return int(values.argmax() if self.largest else values.argmin())

    def of_field(self, values: Array) -> Array:
        """Return the expression (m,) at values (m,) of its field."""
        return series(renamed(self.tree, {self.field: Variable()}), values, 0)[0]


@dataclass(frozen=True)
class Measure:
    """One expression: its text, its tree, and its extremes, which the tree contains under placeholder names."""

    text: str
    tree: Tree
    extremes: dict[str, Extreme]


@dataclass(frozen=True)
class Part:
    """An extreme in the expression ``number``, whose values are divided into ``groups`` of neighbours."""

    number: int
    name: str
    groups: int


@dataclass(frozen=True)
class Evaluated:
    """An expression evaluated on a run: values of its names, and the values (m,) over which its extremes are taken."""

    measure: Measure
    meaning: dict[str, float]
    samples: dict[str, Array]

    def value(self) -> float:
        """Return the value of the expression."""
        return value_of(self.measure.tree, self.meaning)

    def along(self, name: str, values: Array) -> Array:
        """Return the expression (m,) evaluated with each of some values (m,) instead of an extreme."""
        meant: dict[str, Tree] = {own: Constant(value) for own, value in self.meaning.items()}
        return series(renamed(self.measure.tree, meant | {name: Variable()}), values, 0)[0]

    def chosen(self, name: str, groups: int) -> Array:
        """Return the indices (groups,) of the values that represent each group of neighbours.

        Each is the extreme of its group. If that would make the expression larger than its actual value (it decreases
        with its max, say), the overall extreme is used instead, so the largest row is always the expression itself.
        """
        extreme, values = self.measure.extremes[name], self.samples[name]
        m = len(values)
        first = np.arange(groups) * m // groups
        behind = np.maximum(np.arange(1, groups + 1) * m // groups, first + 1)
        found = first if groups == m else np.array(
            [a + extreme.at(values[a:b]) for a, b in zip(first.tolist(), behind.tolist(), strict=True)])
        return np.where(self.along(name, values[found]) > self.value(), extreme.at(values), found)

    def rows(self, part: Part) -> Array:
        """Return the expression (groups,) evaluated with the representative of each group."""
        return self.along(part.name, self.samples[part.name][self.chosen(part.name, part.groups)])

    def parts(self, number: int, most: int) -> list[Part]:
        """Return the extremes in the expression with more than one representative, in ``most`` groups at most."""
        found = [Part(number, name, min(len(values), most)) for name, values in self.samples.items()]
        return [part for part in found
                if part.groups > 1 and np.ptp(self.chosen(part.name, part.groups)) > 0]


def near(rows: Array) -> Array:
    """Return which of the rows (m,) of an extreme are close to the largest (m,)."""
    return rows >= rows.max() - (1.0 - NEAR) * np.ptp(rows)


def names_of(measure: Measure) -> set[str]:
    """Return the names in an expression and in its extremes."""
    trees = measure.tree, *(extreme.tree for extreme in measure.extremes.values() if not extreme.field)
    return {name for tree in trees for name in named_in(tree)} - set(measure.extremes)


def slopes_of(tree: Tree, meaning: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the names in a tree, each with the derivative of the tree's value by it."""
    meant: dict[str, Tree] = {name: Constant(value) for name, value in meaning.items()}
    moved = ((name, Chain(Constant(meaning[name]), (("+", Variable()),))) for name in dict.fromkeys(named_in(tree)))
    return [(name, float(series(renamed(tree, meant | {name: by}), np.zeros(1), 1)[1, 0])) for name, by in moved]


def value_of(tree: Tree, meaning: Mapping[str, float]) -> float:
    """Return the value of a tree."""
    meant: dict[str, Tree] = {name: Constant(value) for name, value in meaning.items()}
    return float(series(renamed(tree, meant), np.zeros(1), 0)[0, 0])
