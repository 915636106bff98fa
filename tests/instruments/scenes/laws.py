"""Materials with memory for random scenes: fibres with plasticity or curves, Maxwell terms, and dissipation."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

import numpy as np

from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.results import open_results

from .answer import answer
from .bodies import type_of
from .compare import Finding, Scene, announced, refusals
from .shapes import Data, has_laws, is_rigid, length, number
from .similar import UnfitError

# the methods that step them
METHODS = (None, "radau5", "radau9", "generalized_alpha", "hht", "newmark")
# by which dissipation may fall in a motion beside the drift of its balance, over its largest energy
LOST = 1e-9


def give_laws(case: Data, rng: random.Random, period: float) -> None:
    """Give bodies of a scene laws, turn half of its load steps into time, and choose an integrator for them.

    Fibres yield about where the scene's loads bend them to; they harden, so that nothing flows without a bound.
    """
    solver = case["solver"]
    moves = solver["type"] == "dynamic"
    if solver["type"] == "static" and "method" not in solver and rng.random() < 0.5:
        solver = case["solver"] = {"type": "quasi_static", "t_end": 1.0, "tolerance": 10 ** rng.uniform(-6, -4)}
    if moves and solver.get("method") not in METHODS:
        del solver["method"]
    if moves and solver.get("method") in METHODS[3:] and "dt" not in solver:
        solver["dt"] = solver["t_end"] / 40
        solver.pop("tolerance", None)
    for body in case["bodies"].values():
        if is_rigid(body) or "EA" in body["section"] or rng.random() < 0.2:
            continue
        parts = [layer["material"] for layer in body["section"].get("layers", ())] or [body["material"]]
        formulation = FORMULATIONS[body["element"].get("formulation", type_of(body["element"]).formulation)]
        listed = isinstance(body["element"].get("quadrature", []), list)
        fits = formulation.fibres is not None and "A" not in body["section"] and listed
        if fits and "damping" not in parts[0] and solver["type"] not in ("linear_static", "buckling") and (
                rng.random() < 0.6):
            for part in parts:
                part.update(_fibres(body, part, rng))
        else:
            scale = period if moves else 1.0
            terms = [{"modulus": 10 ** rng.uniform(-1.0, 0.5), "time": scale * 10 ** rng.uniform(-2.0, 1.0)}
                     for _ in range(rng.choice((1, 1, 2, 5)))]
            for part in parts:
                part["viscoelastic"] = [dict(term) for term in terms]


def _fibres(body: Data, material: Data, rng: random.Random) -> Data:
    """Return a law of fibres that exceed their elastic range by a random share."""
    section, E = body["section"], material["E"]
    height = sum(x["height"] for x in section["layers"]) if "layers" in section else number(section["height"])
    strain = height / length(body["geometry"]) * 10 ** rng.uniform(-2.5, 0.0)
    slope = E * 10 ** rng.uniform(-2.0, -0.3)
    kind = rng.choice(("isotropic", "kinematic", "both", "metal", "elastic"))
    if kind in ("metal", "elastic"):
        points = [strain * k for k in (1.0, 2.0, 5.0)]
        stress = [E * strain, E * strain + slope * strain, E * strain + slope * strain * 2.5]
        return {"stress_strain": {"strain": points, "stress": stress,
                                  "unloading": "curve" if kind == "elastic" else "elastic"}}
    shares = {"isotropic": ("isotropic",), "kinematic": ("kinematic",), "both": ("isotropic", "kinematic")}[kind]
    return {"yield": E * strain, "hardening": dict.fromkeys(shares, slope)}


def without_laws(case: Data) -> None:
    """Raise UnfitError if a check does not apply to materials with memory."""
    if has_laws(case):
        raise UnfitError("the way to a state counts")


def lost(scene: Scene) -> Finding:
    """Dissipation of materials and dampers never falls."""
    case, base = scene.case, scene.base
    if base.refusal:
        return refusals(base, base)
    if not has_laws(case):
        raise UnfitError("no material remembers")
    # within steps, what is lost is integrated no better than the motion is interpolated
    case = {**case, "output": {**case["output"], "every": 1}}
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder, "motion.h5"))
        found = answer(case, file)
        if found.refusal:
            return refusals(base, found)
        with open_results(file) as results:
            energies = {name: np.array(results.energies[name]) for name in ("dissipated", "strain", "kinetic", "work")}
    size = max(float(np.max(np.abs(v))) for v in energies.values())
    fall = float(np.max(-np.diff(energies["dissipated"]), initial=0.0))
    room = size * (LOST + scene.known + 2.0 * found.summary["energy_drift"])
    return Finding(fall / room if room else 0.0, f"{fall:.3g} of {size:.3g} comes back, allowed {room:.2g}",
                   announced=announced(found))
