"""A scene with its answer, and comparison with the answer to an equivalent scene."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from .answer import KINDS, Answer, answer, kind_of_message
from .balance import with_acting_points
from .roundoff import roundings, uncertainty
from .shapes import Data, extent, has_mass, is_rigid, length, mass_per_length, number, stiffness
from .similar import INNER, Similarity

# Newton's method ends where displacements are known to 1e-9 of themselves and forces balance to 1e-8 of the largest
NEWTON = 1e-8
# modes are found by iterations that end at this residual; and of factors, what is known of the state before buckling,
# of the stiffness, of the geometric stiffness and of the shapes adds up
LANCZOS, PARTS = 1e-8, 4.0
# what is left of Newton's increments in each step of a motion, relative to the scene's size
STEP = 1e-10
# answers that round-off leaves fewer digits than these are not compared
BLUNT = 1e-4
ILL = "ill-conditioned: round-off leaves fewer than four digits"
# errors of motions are at most twice what is estimated (docs/motion.md, "Steps that are too long"), those of two runs
# add up
ESTIMATED = 4.0
# how much the numbers of a scene are disturbed to see what its motion makes of it
DISTURBED = 1e-7
DISTURBABLE = ("E", "rho", "EA", "kGA", "EI", "rhoA", "rhoI", "mass", "inertia", "stiffness", "damping", "value",
           "velocity", "omega", "tension", "axial", "curvature", "gradient")
# what a warning must speak of to explain that two answers differ
ANNOUNCED = ("round-off", "unstable", "critical point", "negative pivots", "jumps", "not known",
             "were not found")


# what a nonlinear computation that fails says: it warns of no answer by giving none
FAILED = ("no equilibrium was found", "did not converge", "its element is inverted")


def disturbed(case: Data, by: float, rng: random.Random) -> Data:
    """Return a case whose forces, masses and rates have random relative errors up to ``by``."""
    def off(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            return {k: v if k == "amplitude" else off(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [off(v, key) for v in value]
        return value * (1.0 + by * rng.uniform(-1, 1)) if key in DISTURBABLE and isinstance(value, float) else value

    return {key: copy.deepcopy(value) if key in ("output", "solver", "boundary_conditions") else off(value, key)
            for key, value in case.items()}


class Check(Protocol):
    """The interface of a check of a scene."""

    @property
    def name(self) -> str:
        """Return its name in the table."""
        ...

    @property
    def find(self) -> Callable[[Scene], Finding]:
        """Return the function of the check."""
        ...


class Scene:
    """A case with its answer, found once, and the possible effect of round-off."""

    def __init__(self, case: Data, seed: object = 0) -> None:
        self.case = with_acting_points(case)
        self.seed = seed
        self.rng = random.Random()

    def find(self, check: Check) -> Finding:
        """Return the finding of a check, which does not depend on other checks."""
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

    @property
    def steps(self) -> int:
        """Return the number of steps of a motion."""
        return int(self.base.summary.get("steps", 0))

    @cached_property
    def known(self) -> float:
        """Return the error of answers due to round-off and Newton's method, relative to their size."""
        base, solver = self.base, self.case["solver"]
        if self.solver == "dynamic":
            return self.steps * STEP + solver.get("tolerance", 0.0 if "dt" in solver else 1e-6)
        assert base.model is not None
        assert base.state is not None
        d = base.state.d if self.moved else np.zeros_like(base.state.d)
        follows = self.moved and (self.solver != "eigen" or solver.get("about") == "static")
        over_time = solver.get("tolerance", NEWTON) if self.solver == "quasi_static" else 0.0
        return uncertainty(base.model, d, base.state.t) + (NEWTON if follows else 0.0) + over_time

    @cached_property
    def growth(self) -> dict[str, float]:
        """Return the change of each kind of quantity of a motion per relative disturbance of the scene."""
        if self.solver != "dynamic":
            return {}
        other = answer(disturbed(self.case, DISTURBED, random.Random(f"disturb {self.seed}")))
        out: dict[str, float] = {}
        for (kind, name), value in self.base.values.items():
            if (kind, name) in other.values:
                change = float(np.max(np.abs(other.values[kind, name] - value)))
                out[kind] = max(out.get(kind, 0.0), change / DISTURBED)
        return out

    @cached_property
    def estimate(self) -> Answer:
        """Return the answer of a motion by fixed steps with its error estimate, which is the default of cases."""
        return answer({**self.case, "solver": {k: v for k, v in self.case["solver"].items() if k != "estimate"}})

    @property
    def blunt(self) -> bool:
        """Return whether too few digits are known to compare answers."""
        grown = self.growth.get("displacement", 0.0) / extent(self.case)
        return self.known * (1.0 + grown) > BLUNT

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Return the scale of each kind of quantity."""
        base, L = self.base, extent(self.case)
        EA = max((stiffness(b)[0] for b in self.case["bodies"].values() if not is_rigid(b)), default=0.0)
        # where loads act on what is held, displacements are round-off of what they would do to the stiffest beam or,
        # where there are rigid bodies alone, spring
        stiffest = EA / L or max((s["stiffness"] for s in self.case.get("springs", ())), default=math.inf)
        U = L if self.moved else max(base.largest("displacement"), total_load(self.case) / stiffest)
        turn = max(base.largest("rotation"), U / L)
        energy = base.largest("energy")
        # where nothing is strained, forces are what is left of products of stiffness and displacement
        rounded = EA * U / L * roundings(base.model) / self.known if base.model is not None else 0.0
        F = max(base.largest("force"), total_load(self.case), energy / U if U else 0.0, rounded)
        M = max(base.largest("moment"), F * L)
        out = {"displacement": U, "rotation": turn, "force": F, "moment": M, "energy": max(energy, F * U),
               "N": max(F, base.largest("N")), "Q": max(F, base.largest("Q")), "M": max(M, base.largest("M"))}
        if self.solver == "dynamic":
            # forces that hold follow from displacements by the stiffest way there is
            F += EA
            # a tolerance is one of displacements: what changes within a step is known by as much over its length
            V = L / self.case["solver"]["t_end"] * (1 if "dt" in self.case["solver"] else self.steps)
            V = max(V, base.largest("velocity"))
            # Newton's method leaves a share of displacements, those of faces too, by which directions across turn
            across = min((math.sqrt(3.0 * EI / EA) for EA, EI in (
                stiffness(b) for b in self.case["bodies"].values() if not is_rigid(b))), default=L)
            mass = sum(mass_per_length(b) * length(b["geometry"]) for b in self.case["bodies"].values())
            arm = min(L, across)
            out |= {"force": F, "moment": F * L, "velocity": V, "rate": max(V / arm, base.largest("rate")),
                    "rotation": max(turn, L / arm), "momentum": mass * V}
            if "dt" not in self.case["solver"] and base.model is not None:
                # the size of steps depends on how axes lie: they agree within the tolerance, elements being stiffer
                shortest = min((float(np.min(m.lengths)) for m in base.model.meshes.values()), default=L)
                out["force"] += EA * L / shortest
        return out

    def allowed(self, kind: str, value: Any) -> Any:
        """Return the allowed deviation of values of a kind."""
        if kind == "omega^2":
            positive = value[value > 0]
            return (self.known + LANCZOS) * (np.abs(value) + (positive.min() if positive.size else 0.0))
        if kind == "factor":
            # 1/factor are eigenvalues: what is known of them is a share of the largest, of either sign
            least = bending_load(self.case) / (total_load(self.case) or 1.0)
            return (PARTS * self.known + LANCZOS) * value**2 / value.min(initial=least)
        return self.known * (self.sizes[kind] + self.growth.get(kind, 0.0))


def bending_load(case: Data) -> float:
    """Return the least EI/L^2 of a scene."""
    flexible = [b for b in case["bodies"].values() if not is_rigid(b)]
    return min((stiffness(b)[1] / extent(case) ** 2 for b in flexible), default=math.inf)


def total_load(case: Data) -> float:
    """Return the forces of all loads: reactions are sums of them."""
    L, out = extent(case), 0.0
    weight = sum(mass_per_length(b) * length(b["geometry"]) for b in case["bodies"].values() if has_mass(b))
    for load in case.get("loads", ()):
        if load["type"] in INNER:
            out += inner_force(case["bodies"].get(load.get("on"), {}), load)
            continue
        size = float(np.max(np.abs(load["value"])))
        arm = min(_arm(case, p) for p in load.get("between", [load.get("at")]) if isinstance(p, str)) if (
            load["type"] in ("moment", "torque")) else L
        out += size * {"moment": 1.0 / arm, "torque": 1.0 / arm, "distributed": L, "gravity": weight}.get(
            load["type"], 1.0)
    return out


def inner_force(body: Data, load: Data) -> float:
    """Return the force of a load within a body if the body were fixed at both ends."""
    if load["type"] == "tendon":
        # an elastic one about as tight as it is wound up, over a length of what it runs along
        stretch = abs(load.get("slack", 0.0)) / (length(body["geometry"]) if body else 1.0)
        return float(load["tension"] if "tension" in load else load["stiffness"] * stretch)
    alpha, (EA, EI) = 1.0, stiffness(body)
    if load["type"] == "temperature":
        parts = [layer["material"] for layer in body["section"].get("layers", ())] or [body["material"]]
        alpha = max(material["alpha"] for material in parts)
    axial, curvature = (abs(number(load.get(k[load["type"] == "temperature"], 0.0))) for k in (
        ("axial", "value"), ("curvature", "gradient")))
    return alpha * (EA * axial + EI * curvature / length(body["geometry"]))


def _arm(case: Data, at: str) -> float:
    """Return the lever arm of a moment: on a rigid body, that of a couple at the ends of a piece."""
    body = case["bodies"][at.split("@")[0]]
    if not is_rigid(body) or body["geometry"]["type"] != "polyline":
        return extent(case)
    return min(math.dist(a, b) for a, b in pairwise(body["geometry"]["points"]))


@dataclass
class Finding:
    """A deviation in multiples of the allowed one, and of what; or why there is none."""

    ratio: float = 0.0
    what: str = ""
    refusal: str = ""
    announced: str = ""

    @property
    def violated(self) -> bool:
        """Return whether there is an unexplained deviation."""
        return not self.ratio <= 1.0 and not self.announced


def announced(*answers: Answer) -> str:
    """Return the first warning that explains why answers may differ."""
    return next((w for a in answers for w in a.warnings if any(word in w for word in ANNOUNCED)), "")


def agree(scene: Scene, got: Answer, to: Similarity | None = None, shift: float = 0.0,
          exempt: Callable[[str, str], bool] = lambda kind, name: False) -> Finding:
    """Compare an answer with that of the transformed scene; ``shift`` is the distance in sizes of the scene."""
    base, to = scene.base, to or Similarity()
    if base.refusal or got.refusal:
        return refusals(base, got)
    if scene.blunt or scene.known * (1.0 + shift) > BLUNT:
        return Finding(refusal=ILL)
    if "dt" in scene.case["solver"] and max(a.summary.get("rejected", 0) for a in (base, got)):
        return within_estimate(scene, got, to)
    worst = Finding(announced=announced(base, got))
    held_twice = any("redundant" in w for w in (*base.warnings, *got.warnings))
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


def within_estimate(scene: Scene, got: Answer, to: Similarity) -> Finding:
    """Compare motions with cut steps: round-off decides where, and they agree within the estimate.

    The estimate is of displacements; nothing is told of velocities and forces.
    """
    found = scene.estimate
    accuracy = found.summary.get("accuracy") or {}
    if found.refusal or accuracy.get("estimate") is None:
        return Finding(math.inf, "no estimate, and no word of it", announced=next(iter(found.warnings), ""))
    size = scene.base.largest("displacement")
    room = ESTIMATED * accuracy["estimate"] * size + scene.allowed("displacement", None)
    seen = scene.base.seen(to)
    off = max(float(np.max(np.abs(seen[key] - value))) for key, value in got.values.items() if key[0] == "displacement")
    return Finding(off / (room * to.length), f"displacements off by {off / (size * to.length):.2g} of the largest, "
                   f"estimated {accuracy['estimate']:.2g}", announced=announced(found))


def refusals(base: Answer, got: Answer) -> Finding:
    """Compare two answers of which at least one is a refusal."""
    for found in (base, got):
        if found.crash:
            return Finding(math.inf, found.refusal)
    if bool(base.refusal) != bool(got.refusal):
        refusal = base.refusal or got.refusal
        said = refusal if any(words in refusal for words in FAILED) else announced(base, got)
        return Finding(math.inf, f"refused in one form alone: {refusal}", announced=said)
    return Finding(refusal=kind_of_message(base.refusal))


