"""Random frames compared with the independent equations: linear statics, modes, large displacements."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

import ancf2d

from .bodies import RIGID, SHEARLESS
from .points import Array
from .random_frames import frame
from .statics import CriticalError, State, large, linear, modes
from .verdict import Kind, Verdict, judge

MESHES = (8, 16, 32)
MODES = 4
# large displacements are drawn with fewer and known with more polynomials and steps of the load
FINER = {"degree": 10, "steps": 16}
SOLVERS = ("linear_static", "eigen", "static")


def _element(name: str, formulation: str = "") -> dict[str, Any]:
    return {"type": name, **({"formulation": formulation} if formulation else {})}


KINDS = [Kind((_element("reissner2"),), 2), Kind((_element("reissner3"),), 4),
         Kind((_element("cable"),), 4, slopes=True),
         *(Kind((_element(name, "structural"),), order, sections=True, slopes=name == "li") for name, order in (
             ("kerkkanen", 2), ("vallejo", 4), ("omar", 2), ("li", 2))),
         *(Kind((_element(name, "enhanced"),), 2, continuum=True) for name in ("vallejo", "omar", "li")),
         Kind((_element("reissner3"), _element("vallejo", "structural")), 4, sections=True),
         Kind((_element("reissner3"), RIGID), 4)]


def frames(numbers: Iterable[int], solvers: tuple[str, ...] = SOLVERS) -> Iterator[Verdict]:
    """Yield a verdict for each frame and solver."""
    for number in numbers:
        kind = KINDS[number % len(KINDS)]
        case, small, far = frame(number, kind.elements)
        order = 1 if kind.slopes and acts_inside(case) else kind.order
        for solver in solvers:
            if solver == "eigen" and RIGID in kind.elements:
                continue  # ancf2d has no modes of rigid bodies
            settings = {"type": solver, **({"modes": MODES} if solver == "eigen" else {})}
            runs = [meshed(case, settings, n) for n in MESHES]
            verdict = Verdict(number, kind.name, solver, runs[-1])
            # on arcs, the outer side of a section has more mass than the inner one
            model, rough = strain(small) ** 2 if kind.sections else 0.0, None
            if kind.continuum:
                model = max(strain(far if solver == "static" else small), contraction(case, small))
            try:
                if solver == "eigen":
                    true = _frequencies(case)
                elif solver == "linear_static":
                    true = _exact(case, small, linear)
                else:
                    rough, true = _exact(case, far, large), _exact(case, large(case, **FINER), partial(large, **FINER))
                judge(verdict, true, [_computed(run) for run in runs], order, small.scene.extent, model, rough)
            except CriticalError:
                continue  # finer steps see that the path is critical after all
            except ancf2d.Ancf2dError as error:
                verdict.failed(error)
            yield verdict


def meshed(case: dict[str, Any], solver: dict[str, Any], count: int) -> dict[str, Any]:
    """Return a case with its solver, and so many elements on every piece."""
    case = {**copy.deepcopy(case), "solver": solver}
    for body in case["bodies"].values():
        if body["element"] != RIGID:
            body["element"]["count"] = count * (len(body["geometry"].get("points", [0, 0])) - 1)
    if solver["type"] == "eigen":
        del case["output"]["fields"]
    return case


def _groups(case: dict[str, Any], found: dict[str, dict[str, float]],
            reactions: dict[str, dict[str, float]]) -> dict[str, Array]:
    """Return the values to compare."""
    ends = [n for n, at in case["output"]["probes"].items() if at.endswith(("@0", "@1")) and "N" in found[n]]
    return {"displacements": np.array([[found[n]["ux"], found[n]["uy"]] for n in found]),
            "rotations": np.array([found[n]["theta"] for n in found]),
            "section forces": np.array([[found[n]["N"], found[n]["Q"]] for n in ends]),
            "section moments": np.array([found[n]["M"] for n in ends]),
            "reaction forces": np.array([[r["fx"], r["fy"]] for r in reactions.values()]),
            "reaction moments": np.array([r["m"] for r in reactions.values()])}


def _exact(case: dict[str, Any], own: State, solve: Callable[..., State]) -> dict[str, Array]:
    """Return the values of a state."""
    def read(state: State) -> dict[str, Array]:
        return _groups(case, {n: state.probe(at) for n, at in case["output"]["probes"].items()},
                       state.scene.reactions(state.multipliers))

    return _limit(case, read(own), lambda stiffness: read(solve(case, shearless=stiffness)))


def _frequencies(case: dict[str, Any]) -> dict[str, Array]:
    return _limit(case, {"frequencies": modes(case, MODES)},
                  lambda stiffness: {"frequencies": modes(case, MODES, shearless=stiffness)})


def _limit(case: dict[str, Any], own: dict[str, Array],
           again: Callable[[float], dict[str, Array]]) -> dict[str, Array]:
    """Return the values; for elements without shear, the limit of three shear stiffnesses."""
    if all(body["element"]["type"] != SHEARLESS for body in case["bodies"].values()):
        return own
    b, c = again(40.0), again(80.0)
    return {what: (own[what] - 6 * b[what] + 8 * c[what]) / 3 for what in own}


def acts_inside(case: dict[str, Any]) -> bool:
    """Return whether a load or constraint acts on a body between its ends."""
    keys = ("boundary_conditions", "loads", "masses")
    found: list[Any] = [item.get("at") for key in keys for item in case.get(key, ())]
    found += [p for key in ("joints", "springs") for item in case.get(key, ()) for p in item.get("between", ())]
    return any(0.0 < float(p.split("@")[1]) < 1.0 for p in found if isinstance(p, str))


def contraction(case: dict[str, Any], own: State) -> float:
    """Return the model difference of a continuum with varying normal force: (nu h/l)^2.

    Its sections contract by nu times the axial strain, and shear where that varies (Love 1927, art. 278).
    """
    most, scene = 0.0, own.scene
    for name, body in scene.bodies.items():
        nu = case["bodies"][name].get("material", {}).get("nu", 0.5)
        for _, _, k in body.pieces:
            section = scene.bars[k][0].section
            shortest = min(leg.length for leg in body.legs)
            most = max(most, nu**2 * 12 * section.EI / section.EA / shortest**2)
    return float(most)


def strain(own: State) -> float:
    """Return the model difference of a continuum: the largest strain on the faces of beams.

    Where the reference is an arc, sections at its outer face are longer: stretch and bending are coupled by EI/R, which
    beside sqrt(EA EI) is as much as the strain of bending the beam so far (Timoshenko, Strength of Materials II, 74).
    """
    most = 0.0
    for bar, first in own.scene.bars:
        half = 0.5 * np.sqrt(12 * bar.section.EI / bar.section.EA)
        found = half * abs(bar.curvature)
        if not own.linear:
            _, _, e, g, kappa = bar.strains(own.x[first:first + 3 * bar.n])
            found += float(np.max(np.abs(e - 1) + np.abs(g) + half * np.abs(kappa)))
        most = max(most, found)
    return most


def _computed(case: dict[str, Any]) -> dict[str, Array]:
    found = ancf2d.solve(case, states=False)
    if case["solver"]["type"] == "eigen":
        return {"frequencies": np.array([f["omega"] for f in found.summary["frequencies"]])}
    return _groups(case, found.probes, found.reactions)
