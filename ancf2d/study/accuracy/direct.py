"""Direct choice of a mesh: by the order of its element types, then by the error of each of its elements.

The first mesh is predicted from the order of the types. It is solved once, with all load steps, and judged with the
help of its neighbours. If its error is too large, the elements of the next mesh are distributed by their contributions:
the sum of contributions w h^p (p + 1 in the length of an element) is smallest if all elements contribute equally.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...elements import registry
from ...elements.definition import ElementType
from ...elements.shape import Array
from ...errors import many
from ...model.curve import stretches
from ..order import Estimate
from ..run import Solve
from ..variants import Variant, described
from .estimates import relative_distance
from .mesh import influence_by_body
from .neighbours import Neighbour, Verdict, solve_neighbour, verdict_of, verdict_of_two
from .pursuit import MOST_ELEMENTS, MOST_WORK, EstimateOf, Pursuit
from .setting import AS_GIVEN, Level, Setting, bodies_with_meshes, meshed

if TYPE_CHECKING:
    from .weighted import Weighted

# most elements of a body in the first mesh, and number of corrections
FIRST, CORRECTIONS = 128, 3
# finer neighbours of a mesh that shows no order, each twice as fine; of the wanted error: load steps that lead further
# away end in another state
CLIMBED, STRAYED = 4, 0.1
# times the elements predicted from the order: a correction costs more than a few extra elements
MORE = 1.25
# of the wanted error: target of a predicted mesh; and the largest refinement at once
AIM, LEAP = 0.6, 16.0
# unequal elements are used if their number is below this share of the equal ones
PAYS = 0.75
# assumed order of contributions before one is observed
UNSEEN = 2.0
# least contributions, relative to those of neighbours and to the mean: signs change between elements
BESIDE, SLIGHT = 0.25, 1e-3
# shortest element, relative to the body
SHORTEST = 4e-5
MOST_ORDER = 6.0


def order_of(element: ElementType) -> float:
    """Return the order of goals expected of an element type: twice that of its strains.

    Axes and section rotations are complete polynomials up to degree k, bending strains up to k - 1: errors of strains
    fall with h^k, and those of goals with their square (Strang & Fix 1973, section 3.4).
    """
    terms = {(t.i, t.j) for p in element.polynomials if len(p.terms) == 1 for t in p.terms}

    def complete(j: int) -> int:
        return next(k for k in range(len(terms) + 1) if (k, j) not in terms) - 1

    degree = complete(0) - (1 if element.section_kind == "tangent" else 0)
    if element.section_kind == "interpolated":
        degree = min(degree, complete(1))
    return float(min(max(2 * degree, 1), MOST_ORDER))


@dataclass
class Direct:
    """Search over meshes of a case with some element types, each judged with the help of its neighbours."""

    pursuit: Pursuit
    types: dict[str, Variant]
    wanted: float
    verdict: Verdict | None = None
    middle: tuple[Level, Neighbour] | None = None
    finer: tuple[Level, Neighbour] | None = None
    orders: dict[str, float] = field(init=False)

    def __post_init__(self) -> None:
        self.orders = {name: self._order(name) for name in meshed(self.pursuit.loaded.case, self.types)}

    def reach(self) -> tuple[Level, float, Estimate] | None:
        """Return a level whose estimated error is below the wanted one, its error, and the estimate.

        None if no mesh can be judged in this way; a ladder of meshes may still succeed.
        """
        if not self.applies():
            return None
        setting, why = self.first(), "predicted from the order of the element type"
        for _ in range(1 + 2 * CORRECTIONS):
            if 2 * setting.elements > MOST_ELEMENTS:
                return None
            level = self.pursuit.solve_as_result(setting, why, self._estimate_of)
            verdict, middle, finer = self.verdict, self.middle, self.finer
            if level.answer is None or middle is None or finer is None:
                return None
            if verdict is None:
                found = self._refined_locally()
            elif verdict.error <= self.wanted:
                return self._as_result(middle, verdict, verdict.error)
            elif verdict.finer_error <= self.wanted:
                return self._as_result(finer, verdict, verdict.finer_error)
            else:
                hopeless = verdict.estimate.order is None or 4 * level.work > MOST_WORK
                found = None if hopeless else self._next(verdict)
            if found is None:
                return None
            setting, why = found
        return None

    def _as_result(self, found: tuple[Level, Neighbour], verdict: Verdict, error: float
                   ) -> tuple[Level, float, Estimate] | None:
        """Return a level as the result, written; None if its load steps lead elsewhere."""
        (level, solved), pursuit = found, self.pursuit
        if pursuit.written is not level:
            before = replace(level)
            pursuit.tell(f"{many(level.setting.elements, 'element')}: the result")
            known: Solve | None = (lambda model: iter(solved.states)) if solved.whole else None
            pursuit.resolve_as_result(level, _always(verdict.estimate, error), known)
            level.iterations = before.iterations if known else level.iterations
            if level.answer is None or relative_distance(before, level) > STRAYED * self.wanted:
                return None
        return level, error, verdict.estimate

    def _refined_locally(self) -> tuple[Setting, str] | None:
        """Return a mesh with far shorter elements where a mesh that shows no order yet has the largest errors.

        None if there is no adjoint, or if all elements would be shorter: layers may be thinner than all elements.
        """
        found = self._parts()
        if found is None or self.middle is None:
            return None
        nodes = self._graded(found, (0.5 * LEAP) ** UNSEEN, UNSEEN)
        fewer = {name: 2 * (len(given) - 1) for name, given in nodes.items()}
        if sum(fewer.values()) > 0.25 * LEAP * self.middle[0].setting.elements:
            return None
        return Setting(fewer, self.types, None, nodes), "elements refined by their errors"

    def applies(self) -> bool:
        """Return whether meshes can be judged by neighbours: values are numbers, and no kink moves through elements."""
        case = self.pursuit.loaded.case
        bodies = bodies_with_meshes(case, self.types)
        if case.goal is None or not bodies or not case.solver.shows_order:
            return False
        return not case.contacts and not self.pursuit.slides(Setting({}, self.types)) and not any(
            material.non_hookean for body in case.bodies.values() for material in body.materials)

    def _order(self, name: str) -> float:
        own, variant = self.pursuit.loaded.case.bodies[name].element, self.types.get(name, AS_GIVEN)
        if variant.definition is not None:
            return order_of(described(variant.definition)[0])
        kind, order = (own.type, own.order) if variant.type is None else (variant.type, variant.order)
        return 2.0 if kind == "user" else order_of(registry.element_type(kind, order))

    def first(self) -> Setting:
        """Return the mesh whose error is about the wanted one if the goal's error constant is one."""
        counts, case = {}, self.pursuit.loaded.case
        # the k-th mode shape has k half waves
        waves = max(1.0, 0.5 * ((case.goal and (case.goal.number or case.goal.load_factor)) or 1))
        lengths = {name: sum(stretches(case.bodies[name].geometry, ())) for name in self.orders}
        for name, mesh in meshed(case, self.types).items():
            # arcs need more elements, in proportion to the right angles that they turn through
            n = waves * MORE * max(1.0, 0.5 * mesh.least / mesh.stretches) * self.wanted ** (-1.0 / self.orders[name])
            n = min(n, FIRST) * math.sqrt(lengths[name] / max(lengths.values()))
            if mesh.stretches > 1:
                counts[name] = 2 * mesh.least * max(1, math.ceil(0.5 * n / mesh.least))
            else:
                counts[name] = 2 * max(mesh.least, math.ceil(0.5 * n))
        return Setting(counts, self.types)

    def _estimate_of(self, level: Level) -> tuple[Estimate, float]:
        """Judge the level solved last with the help of its neighbours, or the first of finer ones that can be."""
        pursuit, order = self.pursuit, max(self.orders.values())
        assert pursuit.last is not None
        assert pursuit.case is not None
        self.verdict = self.finer = None
        whole = not pursuit.case.case.solver.takes_guess
        self.middle = level, Neighbour(pursuit.case, pursuit.last[1].model, [pursuit.last[1].state], whole)
        fine = self._neighbour(True)
        verdict = verdict_of_two(level, fine)
        if verdict is not None and verdict.error > self.wanted:
            verdict = verdict_of(self._known_coarser(level) or self._neighbour(False), level, fine, order)
        for _ in range(CLIMBED):
            # perhaps too coarse
            if verdict is not None or self.finer is None or 4 * fine.setting.elements > MOST_ELEMENTS:
                break
            coarse, self.middle = self.middle[0], self.finer
            fine = self._neighbour(True)
            verdict = verdict_of_two(self.middle[0], fine)
            if verdict is None or verdict.error > self.wanted:
                verdict = verdict_of(coarse, self.middle[0], fine, order)
        self.verdict = verdict
        if verdict is None:
            return Estimate(None, None, None, False, "its neighbours show no order"), math.inf
        self.middle[0].estimate, fine.estimate = verdict.error, verdict.finer_error
        if len(level.setting.counts) > 1:
            self._find_weights()
        if self.middle[0] is not level:
            return Estimate(None, None, None, False, "finer meshes give other values"), math.inf
        return verdict.estimate, verdict.error

    def _neighbour(self, finer: bool) -> Level:
        """Solve a neighbour of the mesh to be judged; return its level."""
        assert self.middle is not None
        level, found = self.pursuit.add_neighbour(solve_neighbour(*self.middle, finer))
        if finer:
            self.finer = None if found is None else (level, found)
        return level

    def _find_weights(self) -> None:
        """Find the influence of each body's mesh on the goal, by the adjoint if there is one, else by refining it."""
        pursuit, found = self.pursuit, self._parts()
        assert self.middle is not None
        if found is not None:
            pursuit.weights, pursuit.by_adjoint = found.bodies, True
        elif not pursuit.weights:
            level = self.middle[0]
            pursuit.weights = influence_by_body(pursuit, (self._known_coarser(level) or level).setting) or {}

    def _parts(self) -> Weighted | None:
        """Return the contributions of elements to the error of the judged mesh, or None without an adjoint."""
        from .weighted import weighted

        if self.finer is None or self.middle is None:
            return None
        level, solved = self.middle
        return weighted(solved.loaded, solved.solved(level), self.finer[1])

    def _known_coarser(self, level: Level) -> Level | None:
        """Return the level of the mesh half as fine if it is solved already."""
        counts = {name: n // 2 for name, n in level.setting.counts.items()}
        found = self.pursuit.known.get(replace(level.setting, counts=counts).name)
        return None if found is None or found.answer is None else found

    def _next(self, verdict: Verdict) -> tuple[Setting, str]:
        """Return the mesh predicted to suffice, with unequal elements if these save enough, and why it is tried."""
        assert verdict.estimate.order is not None
        assert self.middle is not None
        level = self.middle[0]
        p = min(max(verdict.estimate.order, 1.0), max(self.orders.values()))
        excess = min(verdict.error / (AIM * self.wanted), LEAP**p)
        factor, counts = excess ** (1.0 / p), {}
        for name, mesh in meshed(self.pursuit.loaded.case, self.types).items():
            unit = mesh.least if mesh.stretches > 1 else 1
            unit = len(level.setting.nodes[name]) - 1 if name in level.setting.nodes else unit
            counts[name] = 2 * unit * math.ceil(0.5 * factor * level.setting.counts[name] / unit)
        even = replace(level.setting, counts=counts)
        found = self._parts()
        if found is not None:
            nodes = self._graded(found, excess, p)
            fewer = {name: 2 * (len(given) - 1) for name, given in nodes.items()}
            if sum(fewer.values()) < PAYS * even.elements:
                return Setting(fewer, self.types, None, nodes), "elements refined by their errors"
        return even, "predicted from the observed order"

    def _graded(self, found: Weighted, excess: float, p: float) -> dict[str, tuple[float, ...]]:
        """Return every second node of a mesh with equal contributions, whose error is smaller by ``excess``.

        Pairs of elements are halved repeatedly: this gives few different lengths, so that models are built quickly.
        """
        assert self.middle is not None
        level, meshes = self.middle[0], self.middle[1].model.meshes
        parts = {name: _smooth(abs(w.reshape(-1, 2).sum(axis=1))) for name, w in found.elements.items()
                 if name in level.setting.counts}
        whole = sum(float(w.sum()) for w in parts.values())
        if whole == 0.0:
            parts, whole = {name: np.ones_like(w) for name, w in parts.items()}, float(sum(map(len, parts.values())))
        least = SLIGHT * whole / sum(map(len, parts.values()))
        shares = {name: np.maximum(w, least) / whole for name, w in parts.items()}
        scale = (excess * sum(float((w ** (1.0 / (p + 1.0))).sum()) for w in shares.values())) ** (1.0 / p)
        nodes = {}
        for name, w in shares.items():
            ends = np.append(meshes[name].starts / meshes[name].plan.length, 1.0)[::2]
            halved = np.clip(np.round(np.log2(scale * w ** (1.0 / (p + 1.0))) + 0.2), 0, math.log2(LEAP)).astype(int)
            places = [np.linspace(a, b, _parts_of(b - a, int(k)), endpoint=False).tolist()
                      for (a, b), k in zip(pairwise(ends.tolist()), _gentle(halved), strict=True)]
            nodes[name] = (*(s for some in places for s in some), 1.0)
        return nodes


def _always(found: Estimate, error: float) -> EstimateOf:
    """Return a function that gives any level this estimate and error."""
    return lambda level: (found, error)


def _smooth(w: Array) -> Array:
    """Return contributions (n,) that are not far below those of both neighbours."""
    padded = np.pad(w, 1)
    return np.maximum(w, BESIDE * np.maximum(padded[:-2], padded[2:]))


def _gentle(halved: Array) -> Array:
    """Return how often to halve elements, with numbers of neighbours that differ by two at most."""
    out = halved.copy()
    for way in (slice(None), slice(None, None, -1)):
        view = out[way]
        for k in range(1, len(view)):
            view[k] = max(view[k], view[k - 1] - 2)
    return out


def _parts_of(length: float, halved: int) -> int:
    """Return the number of elements in a stretch, none shorter than allowed."""
    while halved > 0 and length < SHORTEST * 2**halved:
        halved -= 1
    return int(2**halved)
