"""Checks of motions only: momentum, energy, and interruptions without effect."""

from __future__ import annotations

import copy
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ancf2d.solvers.motion.integrators import DEFAULT, INTEGRATORS
from ancf2d.solvers.state import State
from ancf2d.solvers.state_results import Observer

from .answer import Answer, answer, quantities
from .compare import ILL, Finding, Scene, agree, announced, refusals
from .shapes import (
    Array,
    Data,
    extent,
    has_laws,
    has_mass,
    is_rigid,
    is_straight,
    length,
    mass_per_length,
    pieces,
    point,
    position,
    stiffness,
    varies,
)
from .similar import UnfitError

# energy_momentum ends Newton's method at this share of a motion's size
EXACT = 1e-9
# methods that keep accelerations from step to step, which no file of states holds
WITH_MEMORY = ("generalized_alpha", "hht", "BDF", "LSODA")


def method(case: Data) -> str:
    """Return the integrator of a case."""
    return str(case["solver"].get("method", DEFAULT))


def is_free(case: Data) -> bool:
    """Return whether a scene has no support, ground spring, slider or mass damping."""
    ground = any(not isinstance(p, str) for s in case.get("springs", ()) for p in s["between"])
    slides = any(j["type"] == "slider" for j in case.get("joints", ()))
    damped = "alpha" in case.get("damping", {}).get("rayleigh", {})
    return not (case.get("boundary_conditions") or ground or slides or damped)


def starts(case: Data) -> Any:
    """Yield each body and its initial motion."""
    start = case.get("initial", {})
    for name in case["bodies"]:
        yield name, start.get("bodies", {}).get(name, start)


def velocity(start: Data, place: Array) -> Array:
    """Return the velocity of a position in a rigid initial motion."""
    out = np.array(start.get("velocity", (0.0, 0.0)), dtype=float)
    if "rotation_rate" in start:
        rate = start["rotation_rate"]
        arm = place - np.array(rate.get("about", (0.0, 0.0)))
        out = out + rate["omega"] * np.array([-arm[1], arm[0]])
    return out


def momentum(scene: Scene) -> Finding:
    """A free scene moves by its loads alone: p(t) = p(0) + the impulse of the loads."""
    case, base = scene.case, scene.base
    if base.refusal:
        return refusals(base, base)
    if not is_free(case) or any({"amplitude", "active"} & set(x) for x in case.get("loads", ())):
        raise UnfitError("something else than known loads acts on it")
    if any(x["type"] == "follower_force" or x.get("follower") for x in case.get("loads", ())):
        raise UnfitError("loads turn")
    if not all(is_straight(b) and not varies(b) and "layers" not in b.get("section", {})
               for b in case["bodies"].values()):
        raise UnfitError("the mass of a curved axis is that of its mesh, that of others not even")
    p, force, mass = np.zeros(2), np.zeros(2), 0.0
    for name, start in starts(case):
        body = case["bodies"][name]
        geometry = body["geometry"]
        mass += mass_per_length(body) * length(geometry)
        for a, b in straight_parts(geometry):
            middle = 0.5 * (position(geometry, a) + position(geometry, b))
            p = p + mass_per_length(body) * length(geometry) * (b - a) * velocity(start, middle)
    own = dict(starts(case))
    for item in case.get("masses", ()):
        mass += item["mass"]
        p = p + item["mass"] * velocity(own[item["at"].split("@")[0]], point(case, item["at"]))
    for load in case.get("loads", ()):
        given = np.array(load.get("value", 0.0))
        if load["type"] == "force":
            force = force + given
        elif load["type"] == "distributed":
            l = length(case["bodies"][load["on"]]["geometry"])
            force = force + given * l * (load.get("to", 1.0) - load.get("from", 0.0))
        elif load["type"] == "gravity":
            force = force + mass * given
    wanted = p + force * case["solver"]["t_end"]
    found = base.values["momentum", "all"]
    off, room = float(np.abs(found - wanted).max()), scene.allowed("momentum", found)
    return Finding(off / room, f"momentum {found} in place of {wanted}, allowed {room:.2g}", announced=announced(base))


def straight_parts(geometry: Data) -> list[tuple[float, float]]:
    """Return S of the ends of the straight parts of an axis."""
    if pieces(geometry) == 1:
        return [(0.0, 1.0)]
    points = np.array(geometry["points"])
    ends = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    return [(float(a), float(b)) for a, b in zip(ends[:-1] / ends[-1], ends[1:] / ends[-1], strict=True)]


def conserved(scene: Scene) -> Finding:
    """energy_momentum conserves energy, and the angular momentum of free, unloaded scenes."""
    case, base = scene.case, scene.base
    if not INTEGRATORS[method(case)].conserves:
        raise UnfitError("the method does not conserve")
    if base.refusal:
        return refusals(base, base)
    room = scene.known + EXACT
    out = Finding(announced=announced(base))
    if not varies_in_time(case):
        drift = base.summary["energy_drift"]
        out = Finding(drift / room, f"energy drifts by {drift:.2g} of itself", announced=announced(base))
    if is_free(case) and not case.get("loads"):
        first = answer({**case, "solver": {**case["solver"], "t_end": case["solver"]["dt"]}})
        h = [a.summary["momentum"]["angular"] for a in (first, base)]
        size = scene.sizes["momentum"] * extent(case)
        if abs(h[1] - h[0]) > room * size * max(out.ratio, 1.0):
            return Finding(abs(h[1] - h[0]) / (room * size), f"angular momentum {h[1]} in place of {h[0]}",
                           announced=announced(base))
    return out


# ---------------------------------------------------------------------- stops


def varies_in_time(case: Data) -> bool:
    """Return whether a load or constraint depends on time."""
    return any({"amplitude", "active"} & set(x) for x in (*case.get("loads", ()), *case.get("springs", ()))) or any(
        s["type"] == "prescribed" for s in case.get("boundary_conditions", ()))


def from_file(scene: Scene) -> Finding:
    """A motion that starts from the file of its first part ends as the whole."""
    case, base, solver = scene.case, scene.base, scene.case["solver"]
    if base.refusal:
        return refusals(base, base)
    if has_laws(case) or varies_in_time(case) or method(case) in WITH_MEMORY or (
            "dt" not in solver and solver.get("method") in INTEGRATORS and INTEGRATORS[method(case)].scipy):
        raise UnfitError("the rest depends on more than the state in between")
    cut = solver["t_end"] / 2 if "dt" not in solver else solver["dt"] * (round(solver["t_end"] / solver["dt"]) // 2)
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder, "first.h5"))
        first = answer({**case, "solver": {**solver, "t_end": cut}}, file)
        if first.refusal:
            return refusals(base, first)
        rest = {**case, "solver": {**solver, "t_end": solver["t_end"] - cut}, "initial": {"from": file}}
        found = answer(rest)
    return agree(scene, found, exempt=lambda kind, name: name in ("dissipated", "work"))


class Stopped(KeyboardInterrupt):
    """A run that is stopped."""


def resumed(scene: Scene) -> Finding:
    """A run that is stopped and resumed ends bit for bit as the whole."""
    case, base = scene.case, scene.base
    if base.refusal:
        return refusals(base, base)
    case = {**case, "output": {**case["output"], "every": 2}}
    seen: list[Any] = []

    def stop(state: Any) -> None:
        seen.append(state)
        if len(seen) == 4:
            raise Stopped

    with tempfile.TemporaryDirectory() as folder:
        whole = answer(case, str(Path(folder, "whole.h5")))
        file = str(Path(folder, "parts.h5"))
        try:
            answer(case, file, watch=stop)
            raise UnfitError("it ends before it is stopped")
        except Stopped:
            pass
        rest = answer(case, file, resume=True)
    if whole.refusal or rest.refusal:
        return refusals(whole, rest)
    wrong = [key for key, value in whole.values.items() if not np.array_equal(rest.values[key], value)]
    return Finding(float("inf"), f"{wrong[0]} differ: {rest.values[wrong[0]]} in place of {whole.values[wrong[0]]}"
                   ) if wrong else Finding()


# ---------------------------------------------------------------------- statics in motion


def stays(scene: Scene) -> Finding:
    """A motion that starts from a static equilibrium under the same loads stays there."""
    case, base = copy.deepcopy(scene.case), scene.base
    if base.refusal:
        return refusals(base, base)
    if scene.blunt:
        return Finding(refusal=ILL)
    if has_laws(case) or varies_in_time(case) or "steady_rotation" in case or not all(
            has_mass(b) for b in case["bodies"].values()):
        raise UnfitError("its loads vary, or something has no mass")
    if base.summary.get("energy", {}).get("strain", 0.0) == 0.0:
        raise UnfitError("nothing is strained")
    T = period(case)
    case["initial"] = {"from": "static"}
    case["solver"] = {"type": "dynamic", "t_end": 0.2 * T, "dt": 0.02 * T, "estimate": False}
    case["output"].pop("fields", None)
    states: list[State] = []
    found = answer(case, watch=states.append)
    if found.refusal:
        return refusals(base, found)
    return agree(_begun(scene, found, states[0]), found,
                 exempt=lambda kind, name: kind not in ("displacement", "rotation"))


def _begun(scene: Scene, motion: Answer, start: State) -> Scene:
    """Return a scene with the start of a motion, if that has its own mesh and equilibrium."""
    # a cable in motion has one r_x where something acts
    if motion.model is None or scene.base.model is None or motion.model.n_q == scene.base.model.n_q:
        return scene
    values = quantities({"probes": Observer(motion.model, forces=False).observe(start)})
    begun, measures = copy.copy(scene), (scene.known, scene.sizes)
    begun.__dict__.update(base=replace(scene.base, values=values), known=measures[0], sizes=measures[1])
    return begun


def period(case: Data) -> float:
    """Return a time in which an unbalanced scene would move visibly."""
    squares = [mass_per_length(b) * length(b["geometry"]) ** 4 / stiffness(b)[1]
               for b in case["bodies"].values() if not is_rigid(b)]
    return float(max(squares, default=1.0) ** 0.5)
