"""Small motions about a state: sparse matrices, damped pairs, flutter."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
import yaml

import ancf2d
from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solve.linearised import Linearised, base_state
from ancf2d.study.run import run_case

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


# EI = rhoA = L = 1, slender
CANTILEVER = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{EA: 1.0e+7, kGA: 1.0e+7, EI: 1, rhoA: 1, rhoI: 1.0e-7}}
    element: {{type: {element}}}
    {more}
boundary_conditions: [{{name: wall, type: clamp, at: beam@0}}]
{scene}
solver: {{type: eigen, modes: {modes}, {solver}}}
"""
DASHPOT = "springs: [{{type: translational, between: [beam@1, [1, 1.0e+6]], stiffness: 0, damping: {c}}}]"


def found(scene: str = "", modes: int = 4, element: str = "cable, count: 24", more: str = "", solver: str = ""
          ) -> dict[str, Any]:
    text = CANTILEVER.format(element=element, more=more, scene=scene, modes=modes, solver=solver)
    return run_case(load_case_text(text)).summary


def eigenvalues(summary: dict[str, Any]) -> np.ndarray:
    for f in summary["frequencies"]:
        s = complex(f["growth"], f["omega"])
        assert math.isclose(f["damping"], -s.real / abs(s), abs_tol=1e-15)
        assert math.isclose(f["hz"], s.imag / (2 * math.pi))
    return np.array([complex(f["growth"], f["omega"]) for f in summary["frequencies"]])


def dashpot_root(s: complex, c: float) -> complex:
    """The root near s of the cantilever with a dashpot at its tip: w'''' = -s^2 w, w''(1) = 0, w'''(1) = c s w(1)."""
    def g(s: complex) -> complex:
        b = (-s * s) ** 0.25
        ch, sh, co, si = np.cosh(b), np.sinh(b), np.cos(b), np.sin(b)
        return complex((ch + co) * (b**3 * (ch + co) - c * s * (sh - si))
                       - (sh + si) * (b**3 * (sh - si) - c * s * (ch - co)))
    for _ in range(50):
        h = 1e-6 * abs(s)
        step = g(s) / ((g(s + h) - g(s - h)) / (2 * h))
        s -= step
        if abs(step) < 1e-10 * abs(s):
            return s
    raise AssertionError("Newton's iteration has not converged")


@pytest.mark.parametrize("element", ["cable, count: 24", "reissner3, count: 64"])
def test_cantilever_with_a_dashpot_at_its_tip(element: str) -> None:
    """Roots of the characteristic equation; Krylov's space is complete: the argument principle misses nothing."""
    s = eigenvalues(found(DASHPOT.format(c=1), element=element))
    assert len(s) == 4
    np.testing.assert_allclose(s, [dashpot_root(one, 1.0) for one in s], rtol=1e-4)
    assert np.all(np.diff(s.imag) > 0)


def test_what_is_overdamped_has_real_eigenvalues_beside_the_pairs() -> None:
    summary = found(DASHPOT.format(c=10), modes=3)
    s = eigenvalues(summary)
    real = s[s.imag == 0]
    assert (len(s), len(real)) == (4, 1)
    np.testing.assert_allclose(s, [dashpot_root(one, 10.0) for one in s], rtol=1e-4)
    # numbers are those of what vibrates first
    assert [(f["kind"], f["number"]) for f in summary["frequencies"]][1] == ("bending", 1)
    assert not summary["warnings"]


def test_kelvin_voigt_and_rayleigh_damping_are_exact_functions_of_undamped_frequencies() -> None:
    """s^2 + omega^2 (1 + tau s) = 0, and damping ratios alpha/(2 omega) + beta omega/2."""
    omega = eigenvalues(found()).imag
    tau, alpha, beta = 2e-3, 0.5, 1e-3
    s = eigenvalues(found(more=f"material: {{damping: {{kelvin_voigt: {tau}}}}}"))
    np.testing.assert_allclose(s**2 + omega**2 * (1 + tau * s), 0.0, atol=1e-9 * omega[-1] ** 2)
    summary = found(f"damping: {{rayleigh: {{alpha: {alpha}, beta: {beta}}}}}")
    ratios = [f["damping"] for f in summary["frequencies"]]
    np.testing.assert_allclose(ratios, alpha / (2 * omega) + beta * omega / 2, rtol=1e-8)
    np.testing.assert_allclose(np.abs(eigenvalues(summary)), omega, rtol=1e-8)
    undamped = found(f"damping: {{rayleigh: {{alpha: {alpha}, beta: {beta}}}}}", solver="damped: false")
    np.testing.assert_allclose(eigenvalues(undamped), 1j * omega, rtol=1e-12)
    assert any("damping have no effect" in w for w in undamped["warnings"])


def test_fewer_pairs_than_asked_for_where_the_rest_is_overdamped() -> None:
    """Kelvin-Voigt: pairs have omega < 2/tau, everything else is real."""
    tau = 0.04
    omega = eigenvalues(found()).imag
    summary = found(more=f"material: {{damping: {{kelvin_voigt: {tau}}}}}")
    s = eigenvalues(summary)
    pairs = s[s.imag > 0]
    assert len(pairs) == (omega < 2 / tau).sum() == 2
    np.testing.assert_allclose(pairs**2 + omega[:2] ** 2 * (1 + tau * pairs), 0.0, atol=1e-8 * omega[1] ** 2)
    assert any("2 pairs vibrate, not 4" in w for w in summary["warnings"])


def test_equal_bodies_have_every_pair_twice() -> None:
    """One random vector has the same part of both: only the count tells that the second one is missing."""
    text = CANTILEVER.format(element="cable, count: 24", more="", scene=DASHPOT.format(c=1), modes=8, solver="")
    data = yaml.safe_load(text)
    data["bodies"]["other"] = data["bodies"]["beam"]
    data["boundary_conditions"].append({"type": "clamp", "at": "other@0"})
    data["springs"].append({**data["springs"][0], "between": ["other@1", [1, 1e6]]})
    both = eigenvalues(run_case(load_case_text(json.dumps(data))).summary)
    np.testing.assert_allclose(both, np.repeat(eigenvalues(found(DASHPOT.format(c=1))), 2), rtol=1e-7)


def test_a_free_beam_keeps_its_rigid_motions() -> None:
    text = CANTILEVER.format(element="cable, count: 24", more="material: {damping: {kelvin_voigt: 1e-4}}", scene="",
                             modes=2, solver="").replace("boundary_conditions", "#")
    summary = run_case(load_case_text(text)).summary
    assert [f["kind"] for f in summary["frequencies"]] == ["rigid"] * 3 + ["bending"] * 2
    assert [f["omega"] for f in summary["frequencies"][:3]] == [0.0] * 3
    np.testing.assert_allclose([f["omega"] for f in summary["frequencies"][3:]], [22.3733, 61.6728], rtol=1e-4)
