"""Small motions about a state: sparse matrices, damped pairs, flutter."""

from __future__ import annotations

import json
import math
from itertools import product
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import yaml
from helpers import chosen

import ancf2d
from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solvers.linear import full_mass, unknowns_to_coordinates
from ancf2d.solvers.small_motions.linearised import Linearised, RateForces, base_state
from ancf2d.solvers.small_motions.projected import Quadratic
from ancf2d.solvers.small_motions.quadratic import MAX_VECTORS, STRIDE, _motions, _settled
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
        assert math.isclose(f["damping"], -s.real / abs(s) if s else 0.0, abs_tol=1e-15)
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
    """Roots of the characteristic equation; the Krylov space is complete: none is missed by the argument principle."""
    s = eigenvalues(found(DASHPOT.format(c=1), element=element))
    assert len(s) == 4
    np.testing.assert_allclose(s, [dashpot_root(one, 1.0) for one in s], rtol=1e-4)
    assert np.all(np.diff(s.imag) > 0)


@pytest.mark.parametrize("count", [10, 16])
def test_a_very_short_element_costs_no_pair(count: int) -> None:
    """Its stiffness in a large space leaves round-off of one per cent in low pairs, or large residuals."""
    case = yaml.safe_load(DASHPOT.format(c=1))
    case["springs"] += [{"type": "translational", "between": [f"beam@{s}", [0.6, -1]], "stiffness": 1e-9}
                        for s in (0.6, 0.600015)]
    summary = found(yaml.safe_dump(case), element=f"cable, count: {count}", modes=2)
    s = eigenvalues(summary)
    np.testing.assert_allclose(s, [dashpot_root(one, 1.0) for one in (-2.08 + 2.92j, -1.97 + 21.6j)], rtol=1e-4)
    assert not summary["warnings"]


def test_overdamped_motions_have_real_eigenvalues_in_addition_to_pairs() -> None:
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
    assert any("damping has no effect" in w for w in undamped["warnings"])


def test_kelvin_voigt_damping_is_exact_with_constraints_inside_bodies() -> None:
    """A mass divides a cable, whose halves keep one direction by a constraint: its multiplier belongs to no motion."""
    mass = "masses: [{at: beam@0.5, mass: 0.1}]"
    omega, tau = eigenvalues(found(mass)).imag, 2e-3
    summary = found(mass, more=f"material: {{damping: {{kelvin_voigt: {tau}}}}}")
    s = eigenvalues(summary)
    np.testing.assert_allclose(s**2 + omega**2 * (1 + tau * s), 0.0, atol=1e-9 * omega[-1] ** 2)
    assert not summary["warnings"]


@pytest.mark.parametrize(("count", "tau", "c", "modes"), [(12, 0.03, 0.5, 2), (12, 0.01, 10, 2), (24, 0.01, 10, 3)])
def test_the_many_eigenvalues_just_beyond_the_circle_are_not_counted(count, tau, c, modes) -> None:
    """One of each overdamped motion gathers at -1/tau."""
    summary = found(DASHPOT.format(c=c), modes, f"cable, count: {count}",
                    f"material: {{damping: {{kelvin_voigt: {tau}}}}}")
    assert np.abs(eigenvalues(summary)).max() < 1 / tau
    assert not summary["warnings"]


def test_the_many_eigenvalues_within_the_circle_are_counted() -> None:
    """Three of 49 motions vibrate, with omega < 2/tau; the others have one eigenvalue each near -1/tau."""
    summary = found(DASHPOT.format(c=1), 3, "cable, count: 12", "material: {damping: {kelvin_voigt: 0.03}}")
    s = eigenvalues(summary)
    assert np.abs(s).max() > 1 / 0.03
    more = 49 - 3 - int((s.imag == 0.0).sum())
    assert any(w.startswith(f"{more} more eigenvalues lie among those listed") for w in summary["warnings"])


def test_fewer_pairs_than_requested_if_the_rest_is_overdamped() -> None:
    """Kelvin-Voigt: pairs have omega < 2/tau, all others are real."""
    tau = 0.04
    omega = eigenvalues(found()).imag
    summary = found(more=f"material: {{damping: {{kelvin_voigt: {tau}}}}}")
    s = eigenvalues(summary)
    pairs = s[s.imag > 0]
    assert len(pairs) == (omega < 2 / tau).sum() == 2
    np.testing.assert_allclose(pairs**2 + omega[:2] ** 2 * (1 + tau * pairs), 0.0, atol=1e-8 * omega[1] ** 2)
    assert any("2 pairs vibrate instead of 4" in w for w in summary["warnings"])


def test_equal_bodies_have_every_pair_twice() -> None:
    """One random vector has the same part of both: only the count shows that the second one is missing."""
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


def bar(**more: Any) -> dict[str, Any]:
    return {"bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                               "element": {"type": "rigid", "mass": 3, "inertia": 1}}},
            "solver": {"type": "eigen", "modes": 3}, **more}


def test_one_overdamped_mode_has_two_real_eigenvalues() -> None:
    """A pinned bar of inertia I = 1 + 3 with a spring k = 3 and a dashpot c = 8: I s^2 + c s + k = 0."""
    case = bar(boundary_conditions=[{"type": "pin", "at": "bar@0"}],
               springs=[{"type": "rotational", "between": ["bar@0", [0, 0]], "stiffness": 3, "damping": 8}])
    case["solver"]["modes"] = 1
    s = eigenvalues(ancf2d.solve(case, states=False).summary)
    np.testing.assert_allclose(np.sort(s), np.sort(np.roots([4.0, 8.0, 3.0])), rtol=1e-12)


@pytest.mark.parametrize("mixed", [[1, 2], [1j, 2], [1 + 1j, 1 - 1j], [1 + 2j, 3 - 1j]])
def test_motions_with_zero_eigenvalues_are_found_in_any_combination(mixed: list[complex]) -> None:
    """Round-off decides which combinations of two motions with s = 0 the eigenvectors are, and repeats them."""
    small = Linearised(base_state(build_model(load_case_text(json.dumps(SCENE))), "reference"))
    problem = Quadratic(small)
    a, b = np.random.default_rng(1).standard_normal((2, problem.n))
    x, y = a + mixed[0] * b, a + mixed[1] * b
    motions = _motions(problem, [x, y, x.conj(), 1j * x])
    assert len(motions) == 2
    assert np.linalg.matrix_rank(np.array([*motions, a, b]), tol=1e-9) == 2


def test_rigid_bodies_and_springs_alone_vibrate() -> None:
    """A bar on two springs: sqrt(2 k/m), and sqrt(2 k (L/2)^2/J) about its centre; free along x."""
    springs = [{"type": "translational", "between": [f"bar@{end}", [2 * end, -1]], "stiffness": 100}
               for end in (0, 1)]
    summary = ancf2d.solve(bar(springs=springs), states=False).summary
    assert [f["omega"] for f in summary["frequencies"]] == pytest.approx([0, math.sqrt(200 / 3), math.sqrt(200)])
    assert {f["kind"] for f in summary["frequencies"]} == {"rigid"}
    # both dampers alike: s^2 m + 2 c s + 2 k = 0
    damped = [{**s, "damping": 0.5} for s in springs]
    s = eigenvalues(ancf2d.solve(bar(springs=damped, solver={"type": "eigen", "modes": 2}), states=False).summary)
    exact = [0, *(complex(np.roots([m, 1, 200])[0]) for m in (3, 1))]
    np.testing.assert_allclose(np.sort_complex(s), np.sort_complex([complex(x.real, abs(x.imag)) for x in exact]),
                               rtol=1e-9, atol=1e-9)


def test_gravity_alone_holds_a_pendulum() -> None:
    case = bar(boundary_conditions=[{"type": "pin", "at": "bar@0"}], loads=[{"type": "gravity", "value": [0, -9.81]}],
               solver={"type": "eigen", "modes": 1, "about": "static"})
    (mode,) = ancf2d.solve(case, states=False).summary["frequencies"]
    assert mode["omega"] == pytest.approx(math.sqrt(3 * 9.81 * 1 / (1 + 3 * 1**2)), rel=1e-9)


@pytest.mark.parametrize("solver", [
    {"type": "eigen", "modes": 1}, {"type": "frequency_response", "frequencies": [1], "inputs": ["push"]},
    {"type": "state_space", "inputs": ["push"], "outputs": ["end.uy"]}], ids=lambda s: s["type"])
def test_fully_fixed_models_do_not_vibrate(solver: dict[str, Any]) -> None:
    push = {"name": "push", "type": "force", "at": "bar@1", "value": [0, 1]}
    with pytest.raises(ancf2d.ComputationError, match="nothing can vibrate"):
        ancf2d.solve(bar(boundary_conditions=[{"type": "clamp", "at": "bar@0"}], loads=[push], solver=solver,
                         output={"probes": {"end": "bar@1"}}), states=False)


def frame(load: str, table: str) -> dict[str, Any]:
    """A portal with a dashpot and a branch, with a rigid or flexible beam, under a dead or a follower load."""
    def member(start: list[float], end: list[float], element: str = "vallejo") -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": start, "end": end},
                "element": {"type": element} | ({} if element == "rigid" else {"count": 6}),
                "section": {"height": 0.05, "width": 0.02}, "material": {"E": 2e8, "nu": 0.3, "rho": 1000}}
    return {"bodies": {"left": member([0, 0], [0, 1]), "right": member([2, 0], [2, 1]),
                       "beam": member([0, 1], [2, 1], table), "branch": member([2, 1], [3, 1.5])},
            "boundary_conditions": [{"type": "clamp", "at": f"{name}@0"} for name in ("left", "right")],
            "joints": [{"type": "weld", "between": ["left@1", "beam@0"]},
                       {"type": "weld", "between": ["right@1", "beam@1", "branch@0"]}],
            "springs": [{"type": "translational", "between": ["beam@0", [-1, 1]], "stiffness": 1, "damping": 3},
                        {"type": "rotational", "between": ["branch@1", [0, 0]], "stiffness": 0, "damping": 0.05}],
            "loads": [{"type": load, "at": "branch@1", "value": [0.3, -1.0]}],
            "solver": {"type": "eigen", "modes": 6, "about": "static"}}


@pytest.mark.slow_rows("force-vallejo")
@pytest.mark.parametrize(("load", "table"), chosen(product(("force", "follower_force"), ("vallejo", "rigid")),
                                                   [("force", "vallejo"), ("follower_force", "rigid")]))
def test_pairs_of_frames_are_those_of_all_eigenvalues_at_once(load: str, table: str) -> None:
    """[0, 1; -K, -C] y = s [1, 0; 0, M] y by QZ, constraints included."""
    case = frame(load, table)
    s = eigenvalues(ancf2d.solve(case, states=False).summary)
    system = Linearised(base_state(build_model(load_case_text(json.dumps(case))), "static"))
    K, C, M = (A.toarray() for A in (system.K, system.C, system.M))
    n, one = len(K), np.eye(len(K))
    every = scipy.linalg.eigvals(np.block([[0 * K, one], [-K, -C]]), scipy.linalg.block_diag(one, M))
    assert n > 100
    for value in s:
        assert np.abs(every - value).min() < 1e-6 * abs(value)
    slow = every[np.isfinite(every) & (np.abs(every) < 1.0001 * np.abs(s).max()) & (every.imag >= 0)]
    assert len(slow) == len(s)


@pytest.mark.parametrize(("noise", "vectors"), [(0.0, 80), (1e-4, 240), (0.1, MAX_VECTORS + STRIDE)])
def test_a_search_ends_when_round_off_keeps_moving_eigenvalues(noise: float, vectors: int) -> None:
    """Eigenvalues that gain a digit with every vector, except for noise: a larger space has no more digits."""
    random, exact = np.random.default_rng(1), 1j * np.arange(1.0, 11.0)

    class Space:
        count = 44

    class Search:
        space, problem, rest_limit = Space(), type("Problem", (), {"n": 10**6}), 0.0

        def extend(self, steps: int, seed: int) -> None:
            assert steps == STRIDE
            self.space.count += steps

        def ritz(self) -> tuple[Any, Any]:
            off = 10.0 ** (40 - self.space.count) + noise * random.standard_normal(len(exact))
            return exact * (1 + off), np.eye(10)

    search: Any = Search()
    s, _ = _settled(search, 10, 0)
    assert search.space.count <= vectors
    assert (search.space.count >= MAX_VECTORS) == (vectors > MAX_VECTORS)
    assert np.abs(s / exact - 1).max() < max(5 * noise, 1e-7)


def test_rayleighs_alpha_brakes_a_body_by_alpha_times_its_momentum() -> None:
    """Rate forces in translation, of 3 kg along 2 m and 0.5 kg at a point: alpha m v, on any mesh."""
    alpha, v = 0.7, np.array([0.3, -1.1])
    case = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                                "element": {"type": "vallejo", "count": 2}, "section": {"height": 0.05, "width": 0.02},
                                "material": {"E": 2e7, "nu": 0.3, "rho": 1500}}},
            "masses": [{"at": "beam@1", "mass": 0.5}], "damping": {"rayleigh": {"alpha": alpha, "beta": 0.0}},
            "solver": {"type": "dynamic", "t_end": 1, "dt": 0.1}}
    model = build_model(load_case_text(json.dumps(case)))
    rates, M, T = RateForces(model), full_mass(model), unknowns_to_coordinates(model)
    moves = np.zeros((2, len(model.numbering.place)))
    for k in (0, 1):
        # along the two components of each position; slopes stay
        moves[k, k:model.n_q:4] = 1.0
    d = np.zeros(len(moves[0]))
    force = moves @ rates(d, v @ moves, 0.0, lambda: M)
    assert force == pytest.approx(alpha * 3.5 * v, rel=1e-12)
    C, q = rates.external_damping(d, 0.0, T.T @ M @ T), moves[:, model.numbering.free]
    assert q @ (C @ (v @ q)) == pytest.approx(alpha * 3.5 * v, rel=1e-12)
