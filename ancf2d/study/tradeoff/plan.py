"""Plan of a study of work and precision: the meshes of every setting, coarse to fine, and the references of errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

from ...case import Body, Dynamic, LoadedCase, Stiffness
from ...case.emit import flow
from ...elements.registry import FAMILY
from ...errors import CaseError
from ...solvers.motion.integrators import DEFAULT
from ..convergence import limit_of, meshes_of
from ..forecast import predicted_cost
from ..goal import GoalValue, goal_of, sequence
from ..order import ROUND_OFF, estimate
from ..pool import Workers
from ..variants import Variant, check_flexible, count_of, divided, flexible, parse_variants, stretches_of
from .measure import Measured, Setting, Task

STUDIED = "reissner3,cable,vallejo,ancf[3,1],2d2n,2d3n"  # in addition to the case's own type
ACCURACIES = (1e-2, 1e-3, 1e-4)
BUDGET = 60.0
REPEAT = 3
SHARE = 0.02  # of the budget: longest time for repeating one measurement
LEAST_ELEMENTS, USUAL_ELEMENTS, USUAL_OF_MOTION = 2, 64, 16
BEYOND = 3  # doublings of the finest mesh allowed for a reference
STATES = 100  # stored states of a motion that gives no interval
FINER = 1e-2  # tolerance of a reference relative to the finest one studied
FINEST_TOLERANCE, REFERENCE_TOLERANCE = 1e-12, 1e-9
# solver keys that define the steps, with factors applied to the case's own value
LEVELS = {"tolerance": (1e4, 1e2, 1.0), "dt": (4.0, 2.0, 1.0)}
LOOSEST_TOLERANCE = 1e-2


@dataclass(frozen=True)
class Choice:
    """The settings to study. Empty or None stands for the defaults of ``Planner``; ``meshes`` count all elements."""

    variants: tuple[Variant, ...] = ()
    meshes: tuple[int, ...] = ()
    quadratures: tuple[Any, ...] = (None,)
    methods: tuple[str | None, ...] = (None,)
    key: str = ""
    steps: tuple[float, ...] = ()
    repeat: int = REPEAT
    budget: float = BUDGET
    accuracies: tuple[float, ...] = ACCURACIES
    reference: float | None = None
    continuum: bool = False  # errors are relative to the continuum instead of each type's own limit


@dataclass
class Chain:
    """Meshes of one setting, coarse to fine; those from ``judged`` on only serve the reference.

    ``settles``: the chain may end when the answer no longer changes.
    """

    tasks: list[Task]
    judged: int
    settles: bool = False
    done: list[Measured] = field(default_factory=list)
    ended: bool = False

    @property
    def next(self) -> Task | None:
        """The next task to solve, or None at the end."""
        return None if self.ended or len(self.done) == len(self.tasks) else self.tasks[len(self.done)]

    def record(self, found: Measured) -> None:
        """Store the result of the next task."""
        self.done.append(found)
        self.ended |= found.status == "refused" or (self.settles and self._settled())

    def _settled(self) -> bool:
        a, b = (m.answer for m in self.done[-2:]) if len(self.done) > 1 else (None, None)
        return a is not None and b is not None and a.distance(b) <= ROUND_OFF * b.size

    def drop(self) -> list[Task]:
        """End the chain; return the tasks not solved."""
        left = [] if self.ended else self.tasks[len(self.done):]
        self.ended = True
        return left

    def cost(self) -> float | None:
        """Return the predicted time [s] of the next task, from those solved; None if there are none."""
        task, runs = self.next, [m for m in self.done if m.status == "converged"]
        if task is None or not runs:
            return None
        single = [m.elapsed / (m.runs + 1) for m in runs]
        once = predicted_cost([float(m.elements) for m in runs], single, float(task.elements))
        return None if once is None else task.cost(once)


@dataclass
class Series:
    """All chains of one element type, formulation and quadrature, which share one limit.

    ``reference`` is the chain that gives the limit. For a motion it is a separate one with a tight tolerance, and
    ``steps`` one with a looser tolerance that shows the error of its steps; otherwise it is the chain of the rows.
    """

    setting: Setting
    rows: list[Chain]
    reference: Chain
    steps: Chain | None = None

    @property
    def chains(self) -> list[Chain]:
        """All chains, each once."""
        more = [c for c in (self.reference, self.steps) if c is not None and c not in self.rows]
        return [*self.rows, *more]

    def cost(self, chain: Chain) -> float:
        """Return the predicted time [s] of a chain's next task; 0 if nothing similar was solved yet."""
        own = chain.cost()
        if own is not None or chain.next is None:
            return own or 0.0
        alike = [m.elapsed for c in self.chains for m in c.done if m.elements == chain.next.elements]
        return max(alike, default=0.0)


class Planner:
    """Builds the series of a case."""

    def __init__(self, loaded: LoadedCase, choice: Choice, workers: Workers) -> None:
        self.loaded, self.choice, self.workers = loaded, choice, workers
        solver = loaded.case.solver
        self.motion = solver if isinstance(solver, Dynamic) else None
        self._check()
        check_flexible(loaded, "of a motion: ancf2d convergence with --dt or --tolerance")
        self.key, self.steps = self._steps()
        self.totals = tuple(sorted(set(choice.meshes))) or self._default_meshes()
        self.counts, self.warnings = meshes_of(loaded, self.totals)

    def _check(self) -> None:
        choice, source = self.choice, self.loaded.source
        goal_of(self.loaded)
        if self.motion is None and (choice.key or choice.methods != (None,)):
            raise CaseError(source.problem(("solver", "type"), "there are no time steps and no integrator to choose",
                                           expected="solver: {type: dynamic}, or no --method, --dt, --tolerance"))

    def _steps(self) -> tuple[str, tuple[float | None, ...]]:
        if self.motion is None:
            return "", (None,)
        key, steps = self.choice.key, self.choice.steps
        if not key:
            key, own = ("tolerance", self.motion.local_error) if self.motion.dt is None else ("dt", self.motion.dt)
            steps = tuple(own * factor for factor in LEVELS[key])
        if key == "tolerance":
            steps = tuple(min(x, LOOSEST_TOLERANCE) for x in steps)
        return key, tuple(sorted({float(f"{x:.12g}") for x in steps}, reverse=True))

    def _coarsest(self) -> int:
        """Return the fewest elements, at least two, in the proportions of the case."""
        bodies = flexible(self.loaded.case)
        counts = {name: count_of(b) for name, b in bodies.items()}
        divisor = math.gcd(*counts.values())
        base = {name: n // divisor for name, n in counts.items()}
        times = max(-(-len(stretches_of(self.loaded.case)[name]) // base[name]) for name in bodies)
        total = sum(base.values())
        return total * max(times, -(-LEAST_ELEMENTS // total))

    def _default_meshes(self) -> tuple[int, ...]:
        own = sum(count_of(b) for b in flexible(self.loaded.case).values())
        most = max(own, USUAL_ELEMENTS if self.motion is None else USUAL_OF_MOTION)
        out = [self._coarsest()]
        while 2 * out[-1] <= most:
            out.append(2 * out[-1])
        return tuple(out)

    @property
    def _variants(self) -> list[Variant]:
        return list(self.choice.variants) or [Variant(), *parse_variants(STUDIED)]

    def series(self) -> list[Series]:
        """Return the series of all variants and quadratures, without duplicates."""
        out, seen = [], set()
        for variant in self._variants:
            for quadrature in self.choice.quadratures:
                setting = Setting(variant, quadrature)
                known = setting.overrides(self.loaded, self.counts[0])
                if known not in seen:
                    seen.add(known)
                    out.append(self._series(setting))
        return out

    def _series(self, setting: Setting) -> Series:
        finer = self._finer(self.counts[-1], BEYOND) if self.choice.reference is None else []
        if self.motion is None:
            rows = self.chain(setting, [*self.counts, *finer], len(self.counts), settles=not self.choice.meshes)
            return Series(setting, [rows], rows)
        chains = [self.chain(self._timed(setting, method, self.key, step), self.counts, len(self.counts))
                  for method in self.choice.methods for step in self.steps]
        if self.choice.reference is not None:
            return Series(setting, chains, chains[-1])
        middle = self.counts[len(self.counts) // 2:][:1]
        return Series(setting, chains, self.chain(self._precise(setting), [*self.counts, *finer], 0),
                      self.chain(self._precise(setting, 10.0), middle, 0))

    def _finer(self, counts: dict[str, int], levels: int) -> list[dict[str, int]]:
        return [{name: n * 2**k for name, n in counts.items()} for k in range(1, levels + 1)]

    def _timed(self, setting: Setting, method: str | None, key: str, step: float | None) -> Setting:
        return Setting(setting.variant, setting.quadrature, method, key, step)

    def _precise(self, setting: Setting, looser: float = 1.0) -> Setting:
        """Return a setting with the steps of a reference."""
        finest = self.steps[-1] if self.key == "tolerance" else None
        tolerance = REFERENCE_TOLERANCE if finest is None else max(FINER * finest, FINEST_TOLERANCE)
        return self._timed(setting, DEFAULT, "tolerance", tolerance * looser)

    def chain(self, setting: Setting, counts: Sequence[dict[str, int]], judged: int, settles: bool = False,
              more: Sequence[str] = ()) -> Chain:
        """Return the chain of a setting over meshes; ``more`` are further overrides of the case."""
        tasks = [self._task((*setting.overrides(self.loaded, c), *more), setting, sum(c.values()), k < judged)
                 for k, c in enumerate(counts)]
        return Chain(tasks, judged, settles)

    def _task(self, chosen: tuple[str, ...], setting: Setting, elements: int, row: bool) -> Task:
        interval = None if self.motion is None else self.motion.t_end / STATES
        own = [b.element.type for b in flexible(self.loaded.case).values()]
        element = "+".join(dict.fromkeys(own)) if setting.variant.type is None else setting.variant.element
        return Task(self.loaded.text, self.workers.file(self.loaded.source.file), tuple(self.loaded.overrides), setting,
                    chosen, element, elements, self.choice.repeat if row else 0, SHARE * self.choice.budget, interval)

    # ------------------------------------------------------------------ the continuum

    def at_least(self, elements: int, levels: int) -> list[dict[str, int]]:
        """Return the elements of each body for meshes that double, the first with at least ``elements``."""
        first = self._coarsest()
        while first < elements:
            first *= 2
        return [meshes_of(self.loaded, [first * 2**k])[0][0] for k in range(levels)]

    def precise(self, variant: Variant) -> Setting:
        """Return a setting of a type with the steps of a reference."""
        plain = Setting(variant)
        return plain if self.motion is None else self._precise(plain)


RESOLVED = 10.0  # an error is shown if it is this many times that of its reference
ALONG = 3  # order along the axis of the elements that approach the continuum
ACROSS, ACROSS_IN_MOTION = (1, 2, 3, 4), (1, 2, 3)
CONTINUUM_ELEMENTS, CONTINUUM_MESHES = 4, 3
SPREADABLE = ("boundary_conditions", "loads")


@dataclass
class Limit:
    """Limit of a series: an answer, with its relative error ``bar`` (infinite if unknown).

    Without an answer, ``note`` gives the reason.
    """

    answer: GoalValue | None = None
    bar: float = math.inf
    note: str = ""

    def error(self, answer: GoalValue) -> float:
        """Return the relative error of an answer; infinite if the limit is unknown."""
        return math.inf if self.answer is None else answer.distance(self.answer) / self.answer.size

    @property
    def known(self) -> bool:
        """Return whether there is an answer with a known error."""
        return self.answer is not None and math.isfinite(self.bar)

    def resolves(self, error: float) -> bool:
        """Return whether an error is so large that the limit's own does not matter."""
        return self.known and error >= RESOLVED * self.bar


def limit(series: Series, reference: float | None = None) -> Limit:
    """Return the limit of a series, estimated from its solved tasks."""
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
    # the finest meshes changed the answer more than coarser ones did, so the limit is not visible
    wanders = not found.asymptotic and len(gaps) > 1 and gaps[-1] > min(gaps)
    bar = math.inf if found.error_bar is None or wanders else found.error_bar / answer.size
    return Limit(answer, bar + _of_steps(series, answer), found.note)


def _of_steps(series: Series, limit: GoalValue) -> float:
    """Return the error of a motion's reference due to its steps: less than the change with ten times the tolerance."""
    if series.steps is None:
        return 0.0
    for loose in series.steps.done:
        for tight in series.reference.done:
            if loose.elements == tight.elements and loose.answer is not None and tight.answer is not None:
                return tight.answer.distance(loose.answer) / limit.size
    return math.inf


def smallest_error(series: Series, found: Limit) -> float:
    """Return the smallest error of the solved rows."""
    done = [m for chain in series.rows for m in chain.done[:chain.judged]]
    return min((found.error(m.answer) for m in done if m.answer is not None), default=math.inf)


def suffices(series: Series, found: Limit) -> bool:
    """Return whether the reference of a series is accurate enough for all its rows."""
    return found.resolves(smallest_error(series, found))


# ---------------------------------------------------------------------------- the continuum

def continuum_series(planner: Planner) -> dict[int, Series]:
    """Return the series of ``ancf[3, q]`` by q; none if sections are given as stiffnesses, without a continuum.

    Supports and forces act on the mean of a section, because a continuum deforms without limit at a point force.
    """
    loaded = planner.loaded
    if any(isinstance(b.section, Stiffness) for b in flexible(loaded.case).values()):
        return {}
    meshes = planner.at_least(CONTINUUM_ELEMENTS, CONTINUUM_MESHES)
    out = {}
    for q in ACROSS if planner.motion is None else ACROSS_IN_MOTION:
        setting = DefaultSetting(Variant(FAMILY, (ALONG, q)), **_precise_steps(planner))
        chain = planner.chain(setting, meshes, 0, more=_spread(loaded))
        out[q] = Series(setting, [], chain)
    return out


def _precise_steps(planner: Planner) -> dict[str, Any]:
    chosen = planner.precise(Variant())
    return {"method": chosen.method, "key": chosen.key, "step": chosen.step}


class DefaultSetting(Setting):
    """A setting with all defaults of its element type, independent of the case's element."""

    def element(self, body: Body, count: int, base: int) -> dict[str, Any]:
        """Return the ``element`` of a body in case format."""
        variant = self.variant
        return {"type": variant.type, "order": list(variant.order or ()), **divided(count, base)}


def _spread(loaded: LoadedCase) -> list[str]:
    """Return overrides that make supports and forces at points of the axis act on the section's mean."""
    out = []
    for name in SPREADABLE:
        for i, item in enumerate(getattr(loaded.case, name)):
            if getattr(item, "spread", "") is None:
                out.append(f"{name}.{i}.spread={flow('uniform')}")
    return out


def continuum(found: dict[int, Limit]) -> Limit:
    """Return the limit over the order across; its error includes the difference between the last two orders."""
    good = [found[q] for q in sorted(found) if found[q].known]
    if len(good) < 2 or good[-2].answer is None:
        return Limit(note="the budget did not allow it, or it has no limit" if found else "sections are given as "
                     "stiffnesses")
    return replace(good[-1], bar=good[-1].bar + good[-1].error(good[-2].answer))


def distance(a: Limit, b: Limit) -> tuple[float, float]:
    """Return the distance of the limit ``a`` from ``b``, relative to ``b``, and its uncertainty."""
    return (math.inf if a.answer is None else b.error(a.answer)), a.bar + b.bar
