"""The table of what is checked of a scene: each check says for which solvers, and returns how far off it is."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from . import rearrange
from .answer import KINDS, Answer, answer, kind_of_message
from .balance import Resultant, with_acting_points
from .roundoff import uncertainty
from .shapes import Data, at, extent, has_mass, is_rigid, length, mass_per_length, stiffness
from .similar import Similarity, UnfitError

LINEAR = ("linear_static",)
STATIC = ("linear_static", "static", "path")
MODES = ("eigen", "buckling")
ALL = (*STATIC, *MODES, "dynamic")
# Newton's method ends where displacements are known to 1e-9 of themselves and forces balance to 1e-8 of the largest
NEWTON = {"static": 1e-8, "path": 1e-8, "eigen": 1e-8, "dynamic": 1e-8}
# answers that round-off leaves fewer digits than these are not compared
BLUNT = 1e-4
# what a warning must speak of to explain that two answers differ
ANNOUNCED = ("round-off", "unstable", "critical point", "negative pivots", "jumps", "not known")


@dataclass(frozen=True)
class Check:
    """A check: its name, the solvers that it is for, and what does it."""

    name: str
    solvers: tuple[str, ...]
    find: Callable[[Scene], Finding]


class Scene:
    """A case with its answer, found once, and how far round-off may carry it."""

    def __init__(self, case: Data, seed: object = 0) -> None:
        self.case = with_acting_points(case)
        self.seed = seed
        self.rng = random.Random()

    def find(self, check: Check) -> Finding:
        """Return what a check finds; the same whatever else is checked."""
        self.rng.seed(f"{check.name} {self.seed}")
        return check.find(self)

    @property
    def solver(self) -> str:
        """Return the solver as the table names it."""
        solver = self.case["solver"]
        return "path" if solver.get("method") == "arc_length" else str(solver["type"])

    @cached_property
    def base(self) -> Answer:
        """Return the answer to the case as it is."""
        return answer(self.case)

    @property
    def moved(self) -> bool:
        """Return whether displacements are large, and so positions are what is rounded."""
        state = self.base.state
        return state is not None and not state.linear

    @cached_property
    def known(self) -> float:
        """Return how far round-off, and Newton's method, may carry answers, relative to their size."""
        base, newton = self.base, NEWTON.get(self.solver, 0.0)
        assert base.model is not None
        assert base.state is not None
        d = base.state.d if self.moved else np.zeros_like(base.state.d)
        return uncertainty(base.model, d, base.state.t, self.inertia()) + newton

    def inertia(self) -> Any:
        """Return what is added to the stiffness of a scene that may move freely, None where it may not."""
        return None

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Return what each kind of quantity is measured by."""
        base, L = self.base, extent(self.case)
        U = L if self.moved else base.largest("displacement")
        turn = max(base.largest("rotation"), U / L)
        energy = base.largest("energy")
        F = max(base.largest("force"), largest_load(self.case), energy / U if U else 0.0)
        M = max(base.largest("moment"), F * L)
        return {"displacement": U, "rotation": turn, "force": F, "moment": M, "energy": max(energy, F * U),
                "N": max(F, base.largest("N")), "Q": max(F, base.largest("Q")), "M": max(M, base.largest("M"))}

    def allowed(self, kind: str, value: Any) -> Any:
        """Return how far values of a kind may be off."""
        if kind == "omega^2":
            positive = value[value > 0]
            return self.known * (np.abs(value) + (positive.min() if positive.size else 0.0))
        if kind == "factor":
            # 1/factor are eigenvalues: what is known of them is a share of the largest, of either sign
            least = bending_load(self.case) / (largest_load(self.case) or 1.0)
            return self.known * value**2 / value.min(initial=least)
        return self.known * self.sizes[kind]


def bending_load(case: Data) -> float:
    """Return the least EI/L^2 of a scene."""
    flexible = [b for b in case["bodies"].values() if not is_rigid(b)]
    return min((stiffness(b)[1] / extent(case) ** 2 for b in flexible), default=math.inf)


def largest_load(case: Data) -> float:
    """Return the largest force among the loads."""
    L, out = extent(case), 0.0
    weight = sum(mass_per_length(b) * length(b["geometry"]) for b in case["bodies"].values() if has_mass(b))
    for load in case.get("loads", ()):
        size = float(np.max(np.abs(load["value"])))
        out = max(out, size * {"moment": 1.0 / L, "distributed": L, "gravity": weight}.get(load["type"], 1.0))
    return out


@dataclass
class Finding:
    """How far a check is off, in multiples of what is allowed; what is off; or why nothing can be said."""

    ratio: float = 0.0
    what: str = ""
    refusal: str = ""
    announced: str = ""

    @property
    def violated(self) -> bool:
        """Return whether something is wrong that nothing explains."""
        return not self.ratio <= 1.0 and not self.announced


def announced(*answers: Answer) -> str:
    """Return the first warning that explains why answers may differ."""
    return next((w for a in answers for w in a.warnings if any(word in w for word in ANNOUNCED)), "")


def agree(scene: Scene, got: Answer, to: Similarity | None = None, shift: float = 0.0,
          exempt: Callable[[str, str], bool] = lambda kind, name: False) -> Finding:
    """Compare an answer with that of the scene seen by a similarity; ``shift`` is how many sizes away it is."""
    base, to = scene.base, to or Similarity()
    if base.refusal or got.refusal:
        return refusals(base, got)
    if scene.known * (1.0 + shift) > BLUNT:
        return Finding(refusal="ill-conditioned: round-off leaves fewer than four digits")
    worst = Finding(announced=announced(base, got))
    held_twice = any("held twice" in w for w in (*base.warnings, *got.warnings))
    for (kind, name), value in base.seen(to).items():
        if exempt(kind, name) or (held_twice and kind in ("force", "moment")) or (kind, name) not in got.values:
            continue
        other = got.values[kind, name]
        if other.shape != value.shape:
            return Finding(math.inf, f"{kind} {name}: {len(other)} values in place of {len(value)}",
                           announced=worst.announced)
        room = scene.allowed(kind, base.values[kind, name]) * to.unit(KINDS[kind][0]) * (1.0 + shift)
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.where(value == other, 0.0, np.abs(value - other) / room)
        if off.size and not np.max(off) <= worst.ratio:
            worst.ratio = float(np.max(off))
            worst.what = f"{kind} {name}: {other} in place of {value}, allowed {np.max(room):.2g}"
    return worst


def refusals(base: Answer, got: Answer) -> Finding:
    """Compare two answers of which one at least is none."""
    for found in (base, got):
        if found.crash:
            return Finding(math.inf, found.refusal)
    if bool(base.refusal) != bool(got.refusal):
        return Finding(math.inf, f"refused in one form alone: {base.refusal or got.refusal}",
                       announced=announced(base, got))
    return Finding(refusal=kind_of_message(base.refusal))


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


# ---------------------------------------------------------------------- in other words


def reordered(scene: Scene) -> Finding:
    """List bodies, joints, supports, springs and loads in another order."""
    return agree(scene, answer(rearrange.reordered(scene.case, scene.rng)))


def reversed_body(scene: Scene) -> Finding:
    """Write a body from its other end."""
    name = scene.rng.choice(list(scene.case["bodies"]))
    return agree(scene, answer(rearrange.reversed_body(scene.case, name)), exempt=section_forces_of(scene, name))


def split(scene: Scene) -> Finding:
    """Cut a body at a node, or a rigid one anywhere, and weld it again."""
    ways = [(name, *way) for name in scene.case["bodies"] for way in rearrange.splits(scene.case, name)]
    if not ways:
        raise UnfitError("no body can be cut without another mesh")
    way = scene.rng.choice(ways)
    return agree(scene, answer(rearrange.split_body(scene.case, *way)), exempt=section_forces_of(scene, way[0]))


def section_forces_of(scene: Scene, body: str) -> Callable[[str, str], bool]:
    """Return what tells the section forces of a body: at nodes they jump, and which side is told is a choice."""
    def own(kind: str, probe: str) -> bool:
        p = scene.case["output"]["probes"].get(probe, "@0")
        return kind in ("N", "Q", "M") and (p if isinstance(p, str) else p["at"]).split("@")[0] == body

    return own


# ---------------------------------------------------------------------- balances


def balanced(scene: Scene) -> Finding:
    """Loads, springs from the ground and reactions add up to nothing, with their moments."""
    base = scene.base
    if base.refusal:
        return refusals(base, base)
    if scene.known > BLUNT:
        return Finding(refusal="ill-conditioned: round-off leaves fewer than four digits")
    found = Resultant(base)
    left, size = np.abs(found.left()).max(), max(found.size, scene.sizes["force"])
    if left == 0.0:
        return Finding()
    return Finding(float(left / (scene.known * size)), f"{left:.3g} is left of forces of {size:.3g}",
                   announced=announced(base))


def superposed(scene: Scene) -> Finding:
    """Linear: two parts of the loads, each with what prescribes, add up: u(A + B) = u(A) + u(B) - u(0)."""
    case = scene.case
    cut = scene.rng.randrange(len(case["loads"]) + 1)
    parts = [answer({**case, "loads": loads}) for loads in (case["loads"][:cut], case["loads"][cut:], [])]
    base = scene.base
    for part in parts:
        if base.refusal or part.refusal:
            return refusals(base, part)
    total = copy.copy(base)
    total.values = {key: parts[0].values[key] + parts[1].values[key] - parts[2].values[key]
                    for key in base.values if key[0] != "energy"}
    return agree(scene, total)


def reciprocal(scene: Scene) -> Finding:
    """Linear: what a force at one end does at another, that does as much at the first (Maxwell, Betti)."""
    base, rng, case = scene.base, scene.rng, scene.case
    if base.refusal:
        return refusals(base, base)
    L, places = extent(case), [at(name, s) for name in case["bodies"] for s in (0.0, 1.0)]
    size = largest_load(case) or 1.0
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
    room = scene.known * size * max(a.largest("displacement") + L * a.largest("rotation") for a in (first, second))
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
    """Return the work of a load on what a probe does."""
    kind = "rotation" if load["type"] == "moment" else "displacement"
    return float(np.sum(np.array(load["value"]) * found.values[kind, probe]))


def other_steps(scene: Scene) -> Finding:
    """Raise the load in other steps."""
    steps = scene.rng.choice([n for n in (1, 3, 7, 20, 40) if n != scene.case["solver"].get("steps", 10)])
    return agree(scene, answer({**scene.case, "solver": {**scene.case["solver"], "steps": steps}}))


CHECKS = (
    Check("turned by any angle", ALL, turned),
    Check("turned by quarter turns", ALL, quarter),
    Check("mirrored", ALL, mirrored),
    Check("shifted by 1000 sizes", ALL, shifted),
    Check("in other units", ALL, other_units),
    Check("in another order", ALL, reordered),
    Check("a body reversed", ALL, reversed_body),
    Check("a body split and welded", ALL, split),
    Check("forces and moments balance", STATIC, balanced),
    Check("superposed", LINEAR, superposed),
    Check("reciprocal", LINEAR, reciprocal),
    Check("other load steps", ("static",), other_steps),
)


def checks_for(scene: Scene) -> list[Check]:
    """Return the checks that a scene is fit for by its solver."""
    return [c for c in CHECKS if scene.solver in c.solvers]
