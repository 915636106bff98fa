"""What errors are against: the limit of each series, how well it is known, and the continuum behind all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from ...case import Body, LoadedCase, Stiffness
from ...case.emit import flow
from ...elements.registry import FAMILY
from ..convergence import limit_of
from ..goal import Answer, sequence
from ..order import estimate
from ..variants import Variant, divided, flexible
from .measure import Setting
from .plan import Planner, Series

RESOLVED = 10.0  # an error is told where it is so many times that of its reference
ALONG = 3  # order along the axis of the elements that approach the continuum
ACROSS, ACROSS_IN_MOTION = (1, 2, 3, 4), (1, 2, 3)
CONTINUUM_ELEMENTS, CONTINUUM_MESHES = 4, 3
SPREADABLE = ("boundary_conditions", "loads")


@dataclass
class Limit:
    """What a series tends to: an answer, known to ``bar`` (relative; infinite where that is not known).

    Without an answer, ``note`` says why there is none.
    """

    answer: Answer | None = None
    bar: float = math.inf
    note: str = ""

    def error(self, answer: Answer) -> float:
        """Return the relative error of an answer; infinite where the limit is not known."""
        return math.inf if self.answer is None else answer.distance(self.answer) / self.answer.size

    @property
    def known(self) -> bool:
        """Whether there is an answer, and how well it is known."""
        return self.answer is not None and math.isfinite(self.bar)

    def resolves(self, error: float) -> bool:
        """Whether an error is so large that the limit's own does not matter."""
        return self.known and error >= RESOLVED * self.bar


def limit(series: Series, reference: float | None = None) -> Limit:
    """Return what a series tends to, from what was solved of it."""
    good = [(m, m.answer) for m in series.reference.done if m.answer is not None]
    if not good:
        return Limit(note="nothing was solved that could show the limit")
    answers = [a for _, a in good]
    f = sequence(answers)
    found = estimate([float(m.elements) for m, _ in good], f, answers[-1].size)
    answer = limit_of(answers, found, reference)
    if answer is None:
        return Limit(note=found.note)
    if reference is not None:
        return Limit(answer, 0.0)
    gaps = [abs(b - a) for a, b in pairwise(f)]
    # the finest meshes moved the answer more than coarser ones had: nothing tells where that will end
    wanders = not found.asymptotic and len(gaps) > 1 and gaps[-1] > min(gaps)
    bar = math.inf if found.error_bar is None or wanders else found.error_bar / answer.size
    return Limit(answer, bar + _of_steps(series, answer), found.note)


def _of_steps(series: Series, limit: Answer) -> float:
    """Return how far off a motion's reference is by its steps: less than with a ten times looser tolerance."""
    if series.steps is None:
        return 0.0
    for loose in series.steps.done:
        for tight in series.reference.done:
            if loose.elements == tight.elements and loose.answer is not None and tight.answer is not None:
                return tight.answer.distance(loose.answer) / limit.size
    return math.inf


def smallest_error(series: Series, found: Limit) -> float:
    """Return the smallest error of the rows that were solved."""
    done = [m for chain in series.rows for m in chain.done[:chain.judged]]
    return min((found.error(m.answer) for m in done if m.answer is not None), default=math.inf)


def suffices(series: Series, found: Limit) -> bool:
    """Whether the reference of a series is good enough for all its rows."""
    return found.resolves(smallest_error(series, found))


# ---------------------------------------------------------------------------- the continuum

def continuum_series(planner: Planner) -> dict[int, Series]:
    """Return the series of ``ancf[3, q]`` by q; none where sections are given as stiffnesses, without a continuum.

    Supports and forces act on the mean of a section: at a point, a continuum gives way without limit.
    """
    loaded = planner.loaded
    if any(isinstance(b.section, Stiffness) for b in flexible(loaded.case).values()):
        return {}
    meshes = planner.at_least(CONTINUUM_ELEMENTS, CONTINUUM_MESHES)
    out = {}
    for q in ACROSS if planner.motion is None else ACROSS_IN_MOTION:
        setting = Plain(Variant(FAMILY, (ALONG, q)), **_of(planner))
        chain = planner.chain(setting, meshes, 0, more=_spread(loaded))
        out[q] = Series(setting, [], chain)
    return out


def _of(planner: Planner) -> dict[str, Any]:
    chosen = planner.precise(Variant())
    return {"method": chosen.method, "key": chosen.key, "step": chosen.step}


class Plain(Setting):
    """A setting whose elements have all defaults of their type, and nothing of the case's."""

    def element(self, body: Body, count: int, base: int) -> dict[str, Any]:
        """Return the ``element`` of a body."""
        variant = self.variant
        return {"type": variant.type, "order": list(variant.order or ()), **divided(count, base)}


def _spread(loaded: LoadedCase) -> list[str]:
    """Return overrides that let supports and forces at points of the axis act on the section's mean."""
    out = []
    for name in SPREADABLE:
        for i, item in enumerate(getattr(loaded.case, name)):
            if getattr(item, "spread", "") is None:
                out.append(f"{name}.{i}.spread={flow('uniform')}")
    return out


def continuum(found: dict[int, Limit]) -> Limit:
    """Return the limit over the order across; known as well as the last two orders agree, and their meshes tell."""
    good = [found[q] for q in sorted(found) if found[q].known]
    if len(good) < 2 or good[-2].answer is None:
        return Limit(note="the budget did not allow it, or it has no limit" if found else "sections are given as "
                     "stiffnesses")
    return replace(good[-1], bar=good[-1].bar + good[-1].error(good[-2].answer))


def distance(a: Limit, b: Limit) -> tuple[float, float]:
    """Return how far the limit ``a`` is from ``b``, relative to ``b``, and how well that is known."""
    return (math.inf if a.answer is None else b.error(a.answer)), a.bar + b.bar

