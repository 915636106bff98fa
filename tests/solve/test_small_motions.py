"""Small motions about a state: sparse matrices, damped pairs, flutter."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

import ancf2d
from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solve.linearised import Linearised, base_state

# a follower load, a torsion spring between sections, Kelvin-Voigt damping, a point mass
SCENE: dict[str, Any] = {
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": {"type": "vallejo",
                                                                                                 "count": 2},
                        "section": {"height": 0.05, "width": 0.02},
                        "material": {"E": 2e7, "nu": 0.3, "rho": 1000, "damping": {"kelvin_voigt": 0.01}}}},
    "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
    "loads": [{"type": "follower_force", "at": "beam@1", "value": [1, -3]}],
    "masses": [{"at": "beam@1", "mass": 0.3}],
    "springs": [{"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 8, "damping": 0.3,
                 "length": 0.3}],
    "solver": {"type": "static"}}


def test_matrices_about_a_static_state_are_derivatives_of_the_residual() -> None:
    system = ancf2d.system(SCENE)
    found = Linearised(base_state(build_model(load_case_text(json.dumps(SCENE))), "static"))
    order = np.argsort(found.model.numbering.free)
    z = found.base.state.d[found.model.numbering.free][order]
    K, C, M = (A.toarray()[np.ix_(order, order)] for A in (found.K, found.C, found.M))
    assert np.abs(system.residual(z)).max() < 1e-9
    assert np.abs(K - K.T).max() > 1.0
    h = 1e-6
    for k, unit in enumerate(np.eye(system.n)):
        np.testing.assert_allclose(K[:, k], (system.residual(z + h * unit) - system.residual(z - h * unit)) / (2 * h),
                                   atol=1e-7 * np.abs(K).max())
        np.testing.assert_allclose(C[:, k], system.residual(z, unit) - system.residual(z), atol=1e-9 * np.abs(C).max())
    np.testing.assert_allclose(M, system.mass.toarray(), atol=1e-15)
