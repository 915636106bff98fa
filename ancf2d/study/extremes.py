"""Expressions of largest and smallest values, and what they would be with other values in the place of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..case.series import series
from ..case.syntax import Chain, Constant, Time, Tree, named_in, renamed
from ..elements.shape import Array

# groups of neighbours that the values which an extreme is of are divided into, at most
MOST = 500
# of the way from the least to the largest of an expression: those above are near enough to be seen in its derivative
NEAR = 0.5


@dataclass(frozen=True)
class Extreme:
    """The largest or smallest of an expression over all states, or of a field over all bodies of the last one."""

    largest: bool
    tree: Tree | None
    field: str = ""

    def at(self, values: Array) -> int:
        """Return which of some values (m,) is the extreme."""
        return int(values.argmax() if self.largest else values.argmin())


@dataclass(frozen=True)
class Measure:
    """One expression: its text, its tree, and the extremes that stand in the tree under names of their own."""

    text: str
    tree: Tree
    extremes: dict[str, Extreme]


@dataclass(frozen=True)
class Part:
    """An extreme in the expression ``number`` of several, whose values are divided into ``groups`` of neighbours."""

    number: int
    name: str
    groups: int


@dataclass(frozen=True)
class Met:
    """An expression at the states of a run: what its names mean, and the values (m,) that its extremes are of."""

    measure: Measure
    meaning: dict[str, float]
    places: dict[str, Array]

    def value(self) -> float:
        """Return the value of the expression."""
        return value_of(self.measure.tree, self.meaning)

    def along(self, name: str, values: Array) -> Array:
        """Return the expression (m,) as it were if an extreme had other values (m,)."""
        meant: dict[str, Tree] = {own: Constant(value) for own, value in self.meaning.items()}
        return series(renamed(self.measure.tree, meant | {name: Time()}), values, 0)[0]

    def chosen(self, name: str, groups: int) -> Array:
        """Return which value of an extreme (groups,) stands for each group of neighbours.

        It is the extreme of the group. Where the expression were larger with that than it is, it is the extreme of all,
        so that the largest expression is always the one itself: also where it falls with its largest values.
        """
        extreme, values = self.measure.extremes[name], self.places[name]
        m = len(values)
        first = np.arange(groups) * m // groups
        behind = np.maximum(np.arange(1, groups + 1) * m // groups, first + 1)
        found = first if groups == m else np.array(
            [a + extreme.at(values[a:b]) for a, b in zip(first.tolist(), behind.tolist(), strict=True)])
        return np.where(self.along(name, values[found]) > self.value(), extreme.at(values), found)

    def rows(self, part: Part) -> Array:
        """Return the expression (groups,) as it were with what stands for each group."""
        return self.along(part.name, self.places[part.name][self.chosen(part.name, part.groups)])

    def parts(self, number: int, most: int) -> list[Part]:
        """Return the extremes in the expression that others of their values come near to, in ``most`` groups."""
        found = [Part(number, name, min(len(values), most)) for name, values in self.places.items()]
        return [part for part in found
                if part.groups > 1 and np.ptp(self.chosen(part.name, part.groups)) > 0]


def near(rows: Array) -> Array:
    """Return which of the expressions (m,) that stand for an extreme come near the largest (m,)."""
    return rows >= rows.max() - (1.0 - NEAR) * np.ptp(rows)


def names_of(measure: Measure) -> set[str]:
    """Return the names in an expression, and in its extremes."""
    trees = measure.tree, *(extreme.tree for extreme in measure.extremes.values() if extreme.tree)
    return {name for tree in trees for name in named_in(tree)} - set(measure.extremes)


def slopes_of(tree: Tree, meaning: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the names in a tree with the derivative of its value by each."""
    meant: dict[str, Tree] = {name: Constant(value) for name, value in meaning.items()}
    moved = ((name, Chain(Constant(meaning[name]), (("+", Time()),))) for name in dict.fromkeys(named_in(tree)))
    return [(name, float(series(renamed(tree, meant | {name: by}), np.zeros(1), 1)[1, 0])) for name, by in moved]


def value_of(tree: Tree, meaning: Mapping[str, float]) -> float:
    """Return the value of a tree."""
    meant: dict[str, Tree] = {name: Constant(value) for name, value in meaning.items()}
    return float(series(renamed(tree, meant), np.zeros(1), 0)[0, 0])
