"""The verdict on a comparison with the independent equations: the deviation, and the allowed discretisation error.

Of two runs with meshes h and h/2 of elements whose order p is known, the finer one is off by their difference over
2^p - 1 once meshes are fine enough (Richardson; Roache 1994). It is allowed three times that, and the round-off of
systems as large as these. Of more runs each difference counts as what it would fall to, so that one which happens to
be small is not believed.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from scripts.pages import table

from .points import Array

SAFETY, FLOOR = 3.0, 1e-7


@dataclass(frozen=True)
class Kind:
    """Possible elements of bodies, their known order of convergence, and whether they are a continuum.

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
    """A comparison: its number, elements and subject; the deviation, the allowed one, and the group of values."""

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

    def as_row(self) -> dict[str, Any]:
        """Return the verdict as data, without its case."""
        return {"number": self.number, "kind": self.kind, "subject": self.subject, "what": self.what,
                "deviation": float(self.deviation), "allowed": float(self.allowed)}

    def failed(self, error: Exception) -> None:
        """Record that there is no solution."""
        self.deviation, self.what = np.inf, " ".join(str(error).split())[:300]


def judge(verdict: Verdict, true: dict[str, Array], runs: list[dict[str, Array]], order: int, extent: float,
          model: float = 0.0, rough: dict[str, Array] | None = None) -> None:
    """Set the verdict by the worst group of values, relative to the largest of its kind.

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


def report(rows: list[dict[str, Any]]) -> str:
    """Return the table of deviations by elements and subject."""
    verdicts, out = [Verdict(**row, case={}) for row in rows], []
    for kind, subject in sorted({(v.kind, v.subject) for v in verdicts}):
        of = [v for v in verdicts if (v.kind, v.subject) == (kind, subject)]
        off = [v.deviation for v in of]
        out.append([kind, subject, len(of), f"{statistics.median(off):.1e}", f"{max(off):.1e}",
                    f"{max(v.deviation / v.allowed for v in of):.2f}", sum(not v.holds for v in of)])
    head = ["elements", "subject", "computed", "median deviation", "largest", "largest share of allowed", "beyond"]
    return f"{table(head, out)}\n\n{len({v.number for v in verdicts})} in all."
