"""The table of checks of a scene: each names its solvers and returns its deviation."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import laws, motions, rearrange
from .answer import Answer, answer
from .balance import Resultant
from .compare import ILL, Finding, Scene, agree, announced, refusals, total_load
from .shapes import Array, Data, at, extent, has_laws
from .similar import INNER, Similarity, UnfitError

LINEAR = ("linear_static",)
STATIC = ("linear_static", "static", "path", "quasi_static")
MODES = ("eigen", "buckling")
MOTION = ("dynamic",)
ALL = (*STATIC, *MODES, *MOTION)


# ---------------------------------------------------------------------- elsewhere


def similar(scene: Scene, to: Similarity, shift: float = 0.0) -> Finding:
    """Compare a scene with itself elsewhere."""
    return agree(scene, answer(to.case(scene.case)), to, shift)


def turned(scene: Scene) -> Finding:
    """Turn by any angle."""
    return similar(scene, Similarity(angle=scene.rng.uniform(-math.pi, math.pi)))


def quarter(scene: Scene) -> Finding:
    """Turn by quarter turns."""
    return similar(scene, Similarity(angle=scene.rng.choice((0.5, 1.0, 1.5)) * math.pi))


def mirrored(scene: Scene) -> Finding:
    """Mirror at the x axis."""
    return similar(scene, Similarity(mirrored=True))


def shifted(scene: Scene) -> Finding:
    """Shift by a thousand sizes of the scene; coordinates are then rounded to as many times more."""
    angle, L = scene.rng.uniform(-math.pi, math.pi), 1e3 * extent(scene.case)
    return similar(scene, Similarity(shift=(L * math.cos(angle), L * math.sin(angle))), 1e3)


def other_units(scene: Scene) -> Finding:
    """Write everything in units of other sizes."""
    length, force, time = (10 ** scene.rng.uniform(-3, 3) for _ in range(3))
    return similar(scene, Similarity(length=length, force=force, time=time))


def elsewhere(scene: Scene) -> Finding:
    """Turn by any angle, mirror at random, and write it in other units and another order, all at once."""
    rng = scene.rng
    length, force, time = (10 ** rng.uniform(-3, 3) for _ in range(3))
    to = Similarity(angle=rng.uniform(-math.pi, math.pi), mirrored=rng.random() < 0.5,
                    length=length, force=force, time=time)
    return agree(scene, answer(rearrange.reordered(to.case(scene.case), rng)), to)


# ---------------------------------------------------------------------- in other words


def reordered(scene: Scene) -> Finding:
    """List bodies, joints, supports, springs and loads in another order."""
    return agree(scene, answer(rearrange.reordered(scene.case, scene.rng)))


def reversed_body(scene: Scene) -> Finding:
    """Write a body from its other end."""
    name = scene.rng.choice(list(scene.case["bodies"]))
    found = answer(rearrange.reversed_body(scene.case, name))
    before, after = nodes(scene.base, name), nodes(found, name)
    if before is not None and after is not None and not np.allclose(before, 1.0 - after[::-1], atol=1e-9):
        raise UnfitError("the nodes that points ask for stand elsewhere when seen from the other end")
    return agree(scene, found, exempt=section_forces_of(scene, name))


def nodes(found: Answer, name: str) -> Array | None:
    """Return S of the ends of the elements of a body, None where there is no model."""
    if found.model is None:
        return None
    plan = found.model.meshes[name].plan
    ends = [p.s0 + p.l * np.arange(p.count + 1) for p in plan.pieces]
    return np.unique(np.round(np.concatenate(ends) / plan.length, 12))


def split(scene: Scene) -> Finding:
    """Cut a body at a node, or a rigid one anywhere, and weld it again."""
    if has_laws(scene.case, fibres=True):
        raise UnfitError("fibres are sampled at the ends of bodies")
    ways = [(name, *way) for name in scene.case["bodies"] for way in rearrange.splits(scene.case, name)]
    if not ways:
        raise UnfitError("no body can be cut without another mesh")
    way = scene.rng.choice(ways)
    return agree(scene, answer(rearrange.split_body(scene.case, *way)), exempt=section_forces_of(scene, way[0]))


def section_forces_of(scene: Scene, body: str) -> Callable[[str, str], bool]:
    """Return the names of section forces of a body: at nodes they jump, and the side is arbitrary."""
    def own(kind: str, probe: str) -> bool:
        p = scene.case["output"]["probes"].get(probe, "@0")
        return kind in ("N", "Q", "M") and (p if isinstance(p, str) else p["at"]).split("@")[0] == body

    return own


# ---------------------------------------------------------------------- balances


def balanced(scene: Scene) -> Finding:
    """Loads, springs from the ground and reactions add up to zero, with their moments."""
    base = scene.base
    if base.refusal:
        return refusals(base, base)
    if scene.blunt:
        return Finding(refusal=ILL)
    found = Resultant(base)
    left, size = np.abs(found.left()).max(), max(found.size, scene.sizes["force"])
    if left == 0.0:
        return Finding()
    return Finding(float(left / (scene.known * size)), f"{left:.3g} is left of forces of {size:.3g}",
                   announced=announced(base))


def superposed(scene: Scene) -> Finding:
    """Linear: two parts of the loads, each with the prescribed values, add up: u(A + B) = u(A) + u(B) - u(0)."""
    case = scene.case
    if any("slack" in load for load in case["loads"]):
        raise UnfitError("an elastic tendon is stiff, too")
    cut = scene.rng.randrange(len(case["loads"]) + 1)
    first, last = case["loads"][:cut], case["loads"][cut:]
    # a load of no size keeps the node that it asks for
    parts = [answer({**case, "loads": loads}) for loads in
             ([*first, *without_size(last)], [*without_size(first), *last], without_size(case["loads"]))]
    base = scene.base
    for part in parts:
        if base.refusal or part.refusal:
            return refusals(base, part)
    total = copy.copy(base)
    total.values = {key: parts[0].values[key] + parts[1].values[key] - parts[2].values[key]
                    for key in base.values if key[0] != "energy"}
    return agree(scene, total)


def without_size(loads: list[Data]) -> list[Data]:
    """Return the loads with value zero."""
    off = {"amplitude": {"type": "constant", "scale": 0.0}}
    none = {"moment": 0.0, "torque": 0.0}
    return [{**x, **(off if x["type"] in INNER else {"value": none.get(x["type"], [0.0, 0.0])})} for x in loads]


def reciprocal(scene: Scene) -> Finding:
    """Linear: the work of one unit load on the displacements of another is symmetric (Maxwell, Betti)."""
    base, rng, case = scene.base, scene.rng, scene.case
    if base.refusal:
        return refusals(base, base)
    L, places = extent(case), [at(name, s) for name in case["bodies"] for s in (0.0, 1.0)]
    size = total_load(case) or 1.0
    sites = [(p, unit_load(rng, p, size, L)) for p in rng.choices(places, k=2)]
    probes = {"one": sites[0][0], "other": sites[1][0]}
    plain = {**case, "output": {"probes": probes}}
    nothing, first, second = (answer({**plain, "loads": loads}) for loads in
                              ([], [sites[0][1]], [sites[1][1]]))
    for part in (nothing, first, second):
        if part.refusal:
            return refusals(base, part)
    work = [along(sites[1][1], first, "other") - along(sites[1][1], nothing, "other"),
            along(sites[0][1], second, "one") - along(sites[0][1], nothing, "one")]
    room = scene.known * size * max(scene.sizes["displacement"], *(
        a.largest("displacement") + L * a.largest("rotation") for a in (first, second)))
    if work[0] == work[1]:
        return Finding()
    return Finding(abs(work[0] - work[1]) / room, f"works {work}, allowed {room:.2g}",
                   announced=announced(nothing, first, second))


def unit_load(rng: random.Random, p: str, size: float, L: float) -> Data:
    """Return a force or moment at a point."""
    angle = rng.uniform(-math.pi, math.pi)
    if rng.random() < 0.4:
        return {"type": "moment", "at": p, "value": size * L}
    return {"type": "force", "at": p, "value": [size * math.cos(angle), size * math.sin(angle)]}


def along(load: Data, found: Answer, probe: str) -> float:
    """Return the work of a load on the displacements of a probe."""
    kind = "rotation" if load["type"] == "moment" else "displacement"
    return float(np.sum(np.array(load["value"]) * found.values[kind, probe]))


def other_steps(scene: Scene) -> Finding:
    """Apply the load in other steps."""
    laws.without_laws(scene.case)
    steps = scene.rng.choice([n for n in (1, 3, 7, 20, 40) if n != scene.case["solver"].get("steps", 10)])
    return agree(scene, answer({**scene.case, "solver": {**scene.case["solver"], "steps": steps}}))


@dataclass(frozen=True)
class Check:
    """A check: its name, its solvers, its function, and its weight when checks are drawn at random.

    One without a weight needs no further solution, and is always tried.
    """

    name: str
    solvers: tuple[str, ...]
    find: Callable[[Scene], Finding]
    weight: int = 1


CHECKS = (
    Check("all transformations at once", ALL, elsewhere, weight=8),
    Check("rotated by any angle", ALL, turned),
    Check("rotated by quarter turns", ALL, quarter),
    Check("mirrored", ALL, mirrored),
    Check("shifted by 1000 sizes", ALL, shifted),
    Check("in other units", ALL, other_units),
    Check("in another order", ALL, reordered),
    Check("a body reversed", ALL, reversed_body, weight=3),
    Check("a body split and welded", ALL, split, weight=3),
    Check("forces and moments balance", STATIC, balanced, weight=0),
    Check("superposed", LINEAR, superposed),
    Check("reciprocal", LINEAR, reciprocal),
    Check("other load steps", ("static",), other_steps, weight=3),
    Check("an equilibrium stays at rest", ("static",), motions.stays),
    Check("momentum of free bodies", MOTION, motions.momentum, weight=0),
    Check("energy and angular momentum", MOTION, motions.conserved, weight=0),
    Check("restarted from a file", MOTION, motions.from_file, weight=3),
    Check("stopped and resumed", (*MOTION, "quasi_static"), motions.resumed, weight=3),
    Check("dissipated energy stays lost", MOTION, laws.lost, weight=2),
)


def checks_for(scene: Scene) -> list[Check]:
    """Return the checks that suit the solver of a scene."""
    return [c for c in CHECKS if scene.solver in c.solvers]


def drawn_by_lot(scene: Scene, rng: random.Random, number: int) -> list[Check]:
    """Return the checks of a scene that need no further solution, and so many others by their weights."""
    fit = checks_for(scene)
    weights = [c.weight for c in fit]
    drawn = rng.sample(fit, min(number, sum(weights)), counts=weights)
    return [c for c in fit if c.weight == 0 or c in drawn]
