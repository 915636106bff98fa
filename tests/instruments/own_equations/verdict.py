"""What is said of a computation beside the own equations: how far it is off, and how far its discretisation allows.

Of two runs with meshes h and h/2 of elements whose order p is known, the finer one is off by their difference over
2^p - 1 once meshes are fine enough (Richardson; Roache 1994). It is allowed three times that, and the round-off of
systems as large as these. Of more runs each difference counts as what it would fall to, so that one which happens to
be small is not believed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from .points import Array

SAFETY, FLOOR = 3.0, 1e-7


@dataclass(frozen=True)
class Kind:
    """Elements that bodies may have, the order at which they are known to converge, and whether as a continuum.

    ``sections``: mass lies in sections of some height; ``slopes``: neighbours share r_x (li: r_xy too), so that strains
    cannot jump where something acts inside a body, and converge to first order there.
    """

    elements: tuple[dict[str, Any], ...]
    order: int
    continuum: bool = False
    sections: bool = False
    slopes: bool = False

    @property
    def name(self) -> str:
        """Return types and formulations."""
        return ", ".join(" ".join(map(str, element.values())) for element in self.elements)


@dataclass
class Verdict:
    """A computation: its number, elements and subject; how far it is off, how far it may be, and in what."""

    number: int
    kind: str
    subject: str
    case: dict[str, Any] = field(repr=False)
    deviation: float = 0.0
    allowed: float = FLOOR
    what: str = ""

    @property
    def holds(self) -> bool:
        """Return whether the deviation is allowed."""
        return self.deviation <= self.allowed

    def failed(self, error: Exception) -> None:
        """Say that there is no answer."""
        self.deviation, self.what = np.inf, " ".join(str(error).split())[:300]


def judge(verdict: Verdict, true: dict[str, Array], runs: list[dict[str, Array]], order: int, extent: float,
          model: float = 0.0, rough: dict[str, Array] | None = None) -> None:
    """Fill in a verdict by the group of values that is worst, relative to the largest of its kind.

    Groups of one kind end alike ("section forces", "reaction forces"); forces are measured by moments over the
    scene's ``extent`` too, where these are larger. ``model``: by how much models differ; ``rough``: what is true, less
    accurately.
    """
    kinds: dict[str, float] = {}
    for what, values in true.items():
        kind = what.split()[-1]
        kinds[kind] = max(kinds.get(kind, 0.0), float(np.max(np.abs(values), initial=0.0)))
    if "moments" in kinds:
        kinds["forces"] = max(kinds["forces"], kinds["moments"] / extent)
    for what, values in true.items():
        size = kinds[what.split()[-1]] or 1.0
        deviation = _apart(runs[-1][what], values) / size
        between = max(_apart(a[what], b[what]) / 2**(order * k) for k, (b, a) in enumerate(pairwise(runs[::-1]))) / size
        unsure = 0.0 if rough is None else _apart(rough[what], values) / size
        allowed = SAFETY * between / (2**order - 1) + unsure + model + FLOOR
        if deviation / allowed > verdict.deviation / verdict.allowed:
            verdict.deviation, verdict.allowed, verdict.what = deviation, allowed, what


def _apart(a: Array, b: Array) -> float:
    return float(np.max(np.abs(a - b), initial=0.0))
