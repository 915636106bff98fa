"""Contact with a law in every solver and integrator: two mirrored bodies behave like one on their symmetry plane.

The layer between two bodies is as stiff as two behind one another: the plane has twice the stiffness.
"""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from motions import ride

from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.registry import solve

GAP, LAYER = 0.01, 1e8
# what faces inclined by phi are nearer to one another than across their plane of symmetry, about phi^2 of it
NEAR = 1e-4 * GAP
STEEL = {"E": 2e11, "nu": 0.3, "rho": 7800.0}
RELAXING = {**STEEL, "viscoelastic": [{"modulus": 0.5, "time": 0.3}]}


def scene(mirrored: bool, force: float, material: dict[str, Any] = STEEL, damping: float = 0.0) -> dict[str, Any]:
    """Return a beam clamped at both ends and pushed at its middle, above a plane or above its mirror image."""
    def beam(sign: float) -> dict[str, Any]:
        y = sign * (0.01 + GAP)
        return helpers.body(helpers.line(1.0, start=(0.0, y)), helpers.element("cable", 4),
                            {"height": 0.02, "width": 0.05}, material)

    signs = {"upper": 1.0, "lower": -1.0} if mirrored else {"upper": 1.0}
    plane = {"plane": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}
    share = 1.0 if mirrored else 2.0
    return {"bodies": {name: beam(sign) for name, sign in signs.items()},
            "bc": [{"type": "clamp", "at": f"{name}@{s}"} for name in signs for s in (0, 1)],
            "loads": [{"type": "force", "at": f"{name}@0.5", "value": [0, -sign * force]}
                      for name, sign in signs.items()],
            "obstacles": {} if mirrored else plane,
            "contacts": [{"name": "touch", "between": ["upper", "lower" if mirrored else "plane"],
                          "law": {"stiffness": share * LAYER, "damping": share * damping}}]}


def model_of(mirrored: bool, solver: Any, **more: Any) -> Any:
    parts = scene(mirrored, 40000.0, **more)
    return helpers.build(parts.pop("bodies"), solver, **parts)


def heights(model: Any, d: Any, name: str = "upper") -> np.ndarray:
    """Return y at places of a beam."""
    mesh, e = model.meshes[name], model.e0 + d[:model.n_q]
    return np.array([helpers.dot(helpers.point_ref(mesh, s).position()[1], e) for s in (0.2, 0.4, 0.5)])


@pytest.mark.parametrize("solver", [
    {"type": "static", "method": "arc_length", "until": {"load_factor": 1.0}},
    pytest.param({"type": "quasi_static", "t_end": 0.3, "tolerance": 1e-3}, marks=pytest.mark.slow),
], ids=lambda solver: solver.get("method", solver["type"]))
def test_equilibria_are_those_on_the_plane(solver):
    material = RELAXING if solver["type"] == "quasi_static" else STEEL
    two, one = (model_of(mirrored, solver, material=material) for mirrored in (True, False))
    ends = [list(solve(model))[-1] for model in (two, one)]
    pair, alone = heights(two, ends[0].d), heights(one, ends[1].d)
    np.testing.assert_allclose(pair, alone, atol=NEAR)
    np.testing.assert_allclose(heights(two, ends[0].d, "lower"), -pair, atol=1e-9)
    (report,), (beside,) = contact_report(two, ends[0]), contact_report(one, ends[1])
    assert report["force"][1] == pytest.approx(beside["force"][1], rel=1e-3)
    assert report["force"][1] > 100.0


def test_modes_in_contact_contain_those_on_the_plane():
    found = []
    for mirrored, count in ((True, 8), (False, 4)):
        model = model_of(mirrored, {"type": "eigen", "about": "static", "modes": count})
        found.append(np.array([f["hz"] for f in list(solve(model))[-1].report["frequencies"]]))
    pair, alone = found
    nearest = pair[np.abs(pair[:, None] - alone[:3]).argmin(axis=0)]
    np.testing.assert_allclose(nearest, alone[:3], rtol=1e-3)


@pytest.mark.parametrize("method", [
    "hht", *(pytest.param(name, marks=pytest.mark.slow) for name in ("generalized_alpha", "radau5", "DOP853"))])
def test_motions_are_those_on_the_plane(method):
    # SciPy chooses its steps, and takes many where bodies touch
    t_end, how = (2.2e-3, {"tolerance": 1e-4}) if method == "DOP853" else (6e-3, {"dt": 2e-4})
    two, one = (ride(scene(mirrored, 20000.0, damping=1e3), t_end, method=method, **how) for mirrored in (True, False))
    found, beside = heights(two.model, two.full()[0]), heights(one.model, one.full()[0])
    np.testing.assert_allclose(found, beside, atol=NEAR)
    np.testing.assert_allclose(heights(two.model, two.full()[0], "lower"), -found, atol=1e-9 * GAP)
    # half the height of a beam is 0.01: nothing in its way, the middle would be at 0.0034 or less
    assert found[-1] > 0.006
