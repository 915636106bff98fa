"""Error estimate of a solved mesh from its neighbours: elements half as long and, if need be, elements twice as long.

In statics both start from the known state, so each costs a model and a few iterations. The finer one shows the error:
f(h/2) - f(h) = -e (1 - 2^-p), which depends little on the order p. With the coarser one, three meshes show the order.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

from ...case import Buckling, Case, Eigen, LoadedCase, refined
from ...errors import Ancf2dError
from ...model.build import build_model
from ...model.model import Model
from ...solvers.registry import solve
from ..goal import GoalValue, Solved, error_scale, goal_kind
from ..order import ROUND_OFF, Estimate
from ..run import Outcome, quantity
from .setting import Level

# safety factor of an estimate, and that for values that oscillate about their limit
SAFETY, SWINGING = 1.25, 2.0
# order assumed if there is no coarser mesh
UNSHOWN = 1.0
# smallest order accepted, and how far an order may exceed that of the type before it counts as accidental
LEAST, BEYOND = 0.75, 2.0
# shares of the goal: larger differences from the coarser mesh make oscillating values, or any values, useless
SWING, FAR = 0.02, 0.5
# modes that neighbours find beyond that of the goal
SPARE = 1
# safety factor of the finer mesh's own error, and the largest order used for its estimate
DOUBTFUL, UNCONFIRMED = 2.0, 3.0


@dataclass
class Neighbour:
    """A neighbour of a solved mesh: its case, model and states; with load steps only the last one.

    ``whole``: it has all the states and modes of the case that is solved to an accuracy.
    """

    loaded: LoadedCase
    model: Model
    states: list[Any]
    whole: bool

    @property
    def state(self) -> Any:
        """The last state."""
        return self.states[-1]

    def solved(self, level: Level) -> Solved:
        """Return it as the solution of a level."""
        assert level.answer is not None
        return Solved(level.answer, Outcome({}, self.model), self.state)


@dataclass
class Verdict:
    """The result of two or three meshes: the estimate, and the relative errors of the middle mesh and of the finest."""

    estimate: Estimate
    error: float
    finer_error: float


def coarsened(loaded: LoadedCase) -> LoadedCase:
    """Return the case with half as many elements in every body, whose counts are even."""
    bodies = {}
    for name, body in loaded.case.bodies.items():
        spec = body.element
        if spec.number is not None:
            spec = (replace(spec, refine=spec.refine // 2) if spec.refine and spec.refine % 2 == 0 else
                    replace(spec, count=spec.number // 2))
        bodies[name] = replace(body, element=spec)
    return replace(loaded, case=replace(loaded.case, bodies=bodies))


def solve_neighbour(level: Level, known: Neighbour, finer: bool) -> tuple[Level, Neighbour | None]:
    """Solve the mesh twice as fine as a solved one, or half as fine; return its level and its state.

    If it cannot be solved, the level has no answer and the second value is None.
    """
    setting, size, loaded = level.setting, 2.0 if finer else 0.5, known.loaded
    other = Level(replace(setting, counts={name: round(n * size) for name, n in setting.counts.items()}),
                  "twice as fine, to verify" if finer else "half as fine, to verify", kinks=level.kinks)
    began = time.perf_counter()
    try:
        case = refined(loaded) if finer else coarsened(loaded)
        # with an accuracy set, the solver does not check whether the mesh is fine enough
        few = _with_few_modes(case.case, known.state)
        case = replace(case, case=replace(few, accuracy=few.accuracy or 1.0))
        model = build_model(case)
        states = _solved(model, known.solved(level))
        value = quantity(loaded.case.goal, _summary(loaded, model, states[-1])) if states else None
    except (Ancf2dError, MemoryError) as error:
        other.reason = str(error)
        return other, None
    other.wall_s, other.dofs = time.perf_counter() - began, model.n_q
    if value is None or level.answer is None:
        return other, None
    other.iterations = sum(int(state.history.get("iterations", 1)) for state in states)
    smallest = level.answer.smallest
    other.answer = GoalValue(value, error_scale(value, smallest), None, smallest, period=level.answer.period)
    return other, Neighbour(case, model, states, known.whole and few.solver == loaded.case.solver)


def _with_few_modes(case: Case, state: Any) -> Case:
    """Return a case that finds hardly more modes or load factors than the goal's, whose number a state shows."""
    goal, solver = case.goal, case.solver
    if not isinstance(solver, Eigen | Buckling) or goal is None:
        return case
    wanted = [k for k, f in enumerate(state.report.get("frequencies", ()), 1)
              if (f["kind"], f["number"]) == (goal.kind, goal.number)]
    number = goal.load_factor or (wanted[0] if wanted else solver.modes)
    return replace(case, solver=replace(solver, modes=min(solver.modes, number + SPARE)))


def _solved(model: Model, solved: Solved) -> list[Any]:
    """Return the states of a model, starting from the state of another mesh if the solver accepts a start."""
    if not model.case.solver.takes_guess:
        return list(solve(model))
    start = solved.start_on(model)
    return [] if start is None else list(solve(model, start))


def _summary(loaded: LoadedCase, model: Model, state: Any) -> dict[str, Any]:
    goal = loaded.case.goal
    assert goal is not None
    from ..expressions import last_summary

    return last_summary(model, [state], goal.reaction is not None, goal_kind(goal) in ("force", "moment"),
                        probes=[goal.probe] if goal.probe else [],
                        energy=bool(goal.quantity) and goal.probe is None and goal.reaction is None)


def verdict_of_two(middle: Level, fine: Level, finer: float = 2.0) -> Verdict | None:
    """Return the verdict of a mesh and one ``finer`` by a factor, whatever the order from 1 on.

    None if they show no error.
    """
    if middle.answer is None or fine.answer is None or middle.kinks:
        return None
    size, left = middle.answer.size, 1.0 - finer**-UNSHOWN
    error = SAFETY * fine.answer.distance(middle.answer) / left
    return Verdict(Estimate(fine.answer.value, error, None, True, ""), error / size, (1.0 - left) * error / size)


def verdict_of(coarse: Level, middle: Level, fine: Level, order: float) -> Verdict | None:
    """Return the verdict of three meshes, given the order of the element type, or None if they show no error.

    An order much higher than the type's is an accident of two meshes: then the difference from the coarser mesh counts
    too.
    """
    if coarse.answer is None or middle.answer is None or fine.answer is None or middle.kinks:
        return None
    size = middle.answer.size
    first, second = (b.gap(a) for a, b in ((coarse.answer, middle.answer), (middle.answer, fine.answer)))
    gaps = abs(first), abs(second)
    if max(gaps) <= ROUND_OFF * size:
        found = Estimate(fine.answer.value, max(gaps), None, True, "converged to round-off: order undefined")
        return Verdict(found, max(gaps) / size, max(gaps) / size)
    swings = first * second < 0.0
    if gaps[0] > (SWING if swings else FAR) * size or gaps[1] * 2.0**LEAST > gaps[0]:
        return None
    shown = math.log2(gaps[0] / max(gaps[1], ROUND_OFF * size))
    gap, trusted = max(gaps[1], gaps[0] * 2.0 ** -(order + BEYOND)), min(shown, order)
    step = math.copysign(gap / math.expm1(trusted * math.log(2.0)), second)
    error = (SWINGING if swings else SAFETY) * gap / -math.expm1(-trusted * math.log(2.0))
    finer = DOUBTFUL * gap / math.expm1(min(trusted, UNCONFIRMED) * math.log(2.0))
    found = Estimate(fine.answer.value + (0.0 if swings else step), error, None if swings else shown, True, "")
    return Verdict(found, error / size, finer / size)
