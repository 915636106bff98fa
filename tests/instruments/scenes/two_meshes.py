"""Random beams and rings in statics: error estimates from a finer mesh, compared with far finer meshes."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import ancf2d
from ancf2d.case import LoadedCase
from ancf2d.errors import Ancf2dError
from ancf2d.solvers.registry import solve
from ancf2d.study.accuracy.direct import Direct
from ancf2d.study.accuracy.neighbours import verdict_of, verdict_of_two
from ancf2d.study.accuracy.pursuit import Pursuit
from ancf2d.study.accuracy.setting import Level, Setting, with_setting
from ancf2d.study.goal import GoalValue, Solved, solve_for_goal
from ancf2d.study.record import Progress

E = 2.07e11
TYPES: list[dict[str, Any]] = [
    *({"type": name} for name in ("reissner2", "reissner3", "cable", "kerkkanen", "vallejo", "li", "patel", "2d2n",
                                  "2d3n", "2d2n-nu", "2d3n-nu")),
    *({"type": "omar", "formulation": name} for name in ("enhanced", "structural")),
    {"type": "ancf", "order": [3, 2]}, {"type": "ancf", "order": [3, 3]}]
WALL = {"name": "wall", "type": "clamp", "at": "beam@0"}
SUPPORTS: list[list[dict[str, Any]]] = [
    [WALL], [WALL, {"name": "right", "type": "pin", "at": "beam@1"}],
    [{**WALL, "type": "pin"}, {"name": "right", "type": "roller", "at": "beam@1", "fixed": "y"}],
    [WALL, {"name": "right", "type": "clamp", "at": "beam@1"}]]
GOALS: list[dict[str, Any]] = [
    *({"probe": name, "quantity": q} for name, q in (("tip", "uy"), ("tip", "ux"), ("mid", "uy"), ("mid", "ux"),
                                                     ("tip", "theta"), ("root", "M"), ("mid", "M"))),
    {"quantity": "strain_energy"}, *({"reaction": "wall", "quantity": q} for q in ("fx", "fy", "m"))]
WANTED = (0.2, 1e-1, 3e-2, 1e-2, 1e-3, 1e-4)
# meshes relative to the first one; the last two show the limit
SIZES = (1.0, 2.0, 0.5, 4.0, 8.0)
# errors below this are round-off, and the share of an error to which the limit must be known
ROUND_OFF, KNOWN = 1e-9, 0.1


@dataclass
class Judged:
    """Relative errors of a mesh: wanted, true, and estimated by two and by three meshes (None: no estimate)."""

    wanted: float
    truth: float
    two: float | None
    three: float | None

    def accepts_too_much(self, estimate: float | None) -> bool:
        """Whether an estimate accepts an error above the wanted one."""
        return estimate is not None and estimate <= self.wanted < self.truth


def scene(rng: random.Random) -> dict[str, Any]:
    """Return a case of a beam of 2 m or a half ring under one or two loads, with a goal."""
    height = rng.choice([0.02, 0.05, 0.1, 0.2, 0.4])
    size, angle = E * 0.1 * height**3 / 48.0 * 10.0 ** rng.uniform(-2.0, 1.0), rng.uniform(-math.pi, math.pi)
    value, place, first = [size * math.cos(angle), size * math.sin(angle)], rng.uniform(0.1, 0.9), rng.uniform(0.0, 0.6)
    line = {"type": "distributed", "on": "beam", "value": [0.5 * x for x in value]}
    inner, turn = {"type": "force", "at": f"beam@{place:.2f}", "value": value}, {"type": "moment", "at": "beam@1"}
    loads: list[dict[str, Any]] = rng.choice([
        [{"type": "force", "at": "beam@1", "value": value}], [line],
        [{**line, "from": round(first, 2), "to": round(first + rng.uniform(0.05, 0.4), 2)}], [{**turn, "value": size}],
        [inner], [{**line, "value": [0, 0.25 * size], "follower": True}], [inner, {**turn, "value": size / 3.0}]])
    linear = rng.random() < 0.33 and "follower" not in loads[0]
    ring = {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": math.pi}
    return {"bodies": {"beam": {
        "geometry": ring if rng.random() < 0.25 else {"type": "line", "start": [0, 0], "end": [2, 0]},
        "section": {"height": height, "width": 0.1}, "material": {"E": E, "nu": 0.3},
        "element": {**rng.choice(TYPES), "count": 2}}},
        "boundary_conditions": rng.choice(SUPPORTS), "loads": loads, "goal": rng.choice(GOALS),
        "solver": {"type": "linear_static" if linear else "static"},
        "output": {"probes": {"tip": "beam@1", "mid": "beam@0.5", "root": "beam@0"}}}


def judged(seed: int, number: int) -> Judged | None:
    """Return the verdict on the first mesh of a scene, or None without a solution or a known limit."""
    rng = random.Random(f"{seed} {number}")
    case, wanted = ancf2d.load(scene(rng)), rng.choice(WANTED)
    direct = Direct(Pursuit(case, wanted, Progress()), {}, wanted)
    setting, order = direct.first(), max(direct.orders.values())
    try:
        answers = _answers(case, setting)
    except Ancf2dError:
        return None
    middle, fine, coarse = (Level(setting, "", answer) for answer in answers[:3])
    size, (f2, f4, f8) = answers[0].size, (answers[k].value for k in (1, 3, 4))
    first, last = f4 - f2, f8 - f4
    falls = first * last > 0.0 and abs(first) > 1.5 * abs(last)
    left = last / (first / last - 1.0) if falls else last
    truth = abs(answers[0].value - (f8 + left if falls else f8)) / size
    if abs(left) > KNOWN * size * max(truth, wanted):
        return None
    two, three = verdict_of_two(middle, fine), verdict_of(coarse, middle, fine, order)
    return Judged(wanted, truth, two and two.error, three and three.error)


def _answers(case: LoadedCase, setting: Setting) -> list[GoalValue]:
    """Return the goal on the meshes of SIZES; in nonlinear statics the others start from the state of the first."""
    out: list[GoalValue] = []
    first: Solved | None = None
    for size in SIZES:
        counts = {name: round(size * n) for name, n in setting.counts.items()}
        mesh, start = with_setting(case, replace(setting, counts=counts)), first
        if start is None or not case.case.solver.takes_guess:
            found = solve_for_goal(mesh)
        else:
            found = solve_for_goal(mesh, solve=lambda model, start=start: solve(model, start.start_on(model)))
        first = first or found
        out.append(found.answer)
    return out


def report(rows: Iterable[dict[str, Any]]) -> str:
    """Return the outcome of scenes (``Judged`` as data) in words."""
    found, out = [Judged(**row) for row in rows], []
    for name in ("two", "three"):
        given = [(v, getattr(v, name)) for v in found]
        accepted = [(v, e) for v, e in given if e is not None and e <= v.wanted]
        below = sum(e < v.truth and v.truth > ROUND_OFF for v, e in accepted)
        far = sum(e > 5.0 * v.truth > 5.0 * ROUND_OFF for v, e in accepted)
        out.append(f"{name} meshes: {len(accepted)} of {len(found)} accepted, "
                   f"{sum(v.accepts_too_much(e) for v, e in given)} of them above the wanted error; estimates: "
                   f"{below} below the true error, {far} above five times it")
    return "\n".join(out)
