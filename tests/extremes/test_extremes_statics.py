"""Linear statics at the limit of round-off, and sections that cannot contract: no silent wrong answer."""

from __future__ import annotations

import re
from contextlib import nullcontext, suppress

import numpy as np
import pytest
from helpers import chosen
from instruments.extremes import statics
from instruments.extremes.scenes import BY_LABEL, SUBJECTS, Beam, cantilever

import ancf2d
from ancf2d.solvers.iterative_refinement import refined
from ancf2d.solvers.statics import linear_static


def known(warnings: list[str]) -> float:
    """Return the accuracy of displacements that a run states."""
    found = [float(m[1]) for w in warnings if (m := re.search(r"accurate to about ([\d.e+-]+) of", w))]
    return found[0] if found else 0.0


@pytest.mark.parametrize("label", ["vallejo", "reissner3", "ancf[2,2]", "vallejo:structural"])
@pytest.mark.parametrize("ratio", [1e3, 1e5, 1e6])
def test_a_linear_solution_states_its_accuracy_within_round_off(label: str, ratio: float) -> None:
    """EA L^2/EI = 12e12: soft bending and stiff shear differ by small differences of displacements."""
    found = statics.linear_tip(label, statics.slender(ratio), 16)
    assert found.error < 4.0 * known(found.warnings) + 1e-4
    assert known(found.warnings) < 1e-9 * (ratio / 1e3) ** 2 * 1e3 + 1e-7


@pytest.mark.parametrize("label", ["vallejo", "cable", "reissner3"])
def test_an_ordinary_linear_solution_gives_no_warning(label: str) -> None:
    assert not statics.linear_tip(label, statics.slender(20), 100).warnings


@pytest.mark.parametrize(("left", "said"), [(1e-3, True), (2e-6, True), (5e-7, False)])
def test_the_residual_of_refinement_is_reported_from_a_millionth_on(monkeypatch: pytest.MonkeyPatch, left: float,
                                                                    said: bool) -> None:
    monkeypatch.setattr(linear_static, "refined", lambda *arguments: (refined(*arguments)[0], left))
    warnings = statics.linear_tip("cable", statics.slender(20), 4).warnings
    assert known(warnings) == (left if said else 0.0)


@pytest.mark.parametrize(("left", "refused"), [(0.4, False), (0.6, True)])
def test_displacements_with_errors_above_half_are_refused(monkeypatch: pytest.MonkeyPatch, left: float,
                                                          refused: bool) -> None:
    monkeypatch.setattr(linear_static, "refined", lambda *arguments: (refined(*arguments)[0], left))
    failure = pytest.raises(ancf2d.ComputationError, match="no digit of the displacements is significant")
    with failure if refused else nullcontext():
        assert known(statics.linear_tip("cable", statics.slender(20), 4).warnings) == left


def _thin_elements(count: int, height: float = 0.05) -> ancf2d.LoadedCase:
    return ancf2d.load(f"""
bodies:
  b:
    geometry: {{type: line, start: [0, 0], end: [0.955336489125606, 0.29552020666134]}}
    section: {{height: {height}, width: 0.05}}
    material: {{E: 1e7, nu: 0.3, rho: 1000}}
    element: {{type: 2d3n, count: {count}}}
boundary_conditions: [{{type: clamp, at: b@0}}]
loads: [{{type: force, at: b@1, value: [0, -1]}}]
solver: {{type: linear_static}}
output: {{probes: {{tip: b@1}}}}
""")


@pytest.mark.slow
def test_ill_conditioned_stiffness_is_refused() -> None:
    """The aspect ratio of elements counts: 30 000 elements of this height can still be solved."""
    with pytest.raises(ancf2d.ComputationError, match="no digit of the displacements is significant"):
        ancf2d.solve(_thin_elements(90_000, height=0.5), states=False)


@pytest.mark.slow
def test_a_stiffness_on_the_verge_gives_the_solution_or_is_refused() -> None:
    """Round-off decides which; the mesh of 10 000 elements has six digits of the limit."""
    known = ancf2d.solve(_thin_elements(10_000), states=False).probes["tip"]["uy"]
    with suppress(ancf2d.ComputationError):
        assert ancf2d.solve(_thin_elements(100_000), states=False).probes["tip"]["uy"] == pytest.approx(known, rel=2e-6)


def test_conjugate_directions_converge_with_wrong_factors() -> None:
    """Three of fifty motions are a hundred times too soft in the factors: plain refinement would diverge."""
    rng = np.random.default_rng(1)
    Q = np.linalg.qr(rng.standard_normal((50, 50)))[0]
    stiff = np.logspace(0, 3, 50)
    wrong = np.where(np.arange(50) < 3, stiff / 100, stiff)
    b = rng.standard_normal(50)
    z, left = refined(lambda x: Q @ (stiff * (Q.T @ x)), lambda r: Q @ ((Q.T @ r) / wrong),
                      lambda x: float(np.abs(x).max()), b, 0.0)
    np.testing.assert_allclose(z, Q @ ((Q.T @ b) / stiff), atol=1e-12)
    assert left < 1e-12


def test_multipliers_keep_the_result_of_a_round_of_refinement() -> None:
    """A multiplier prevents one motion: round-off in it would mislead conjugate directions."""
    A, once = np.array([[0.5, -0.45], [-0.45, 0.0]]), [1e-15]

    def factors(r: np.ndarray) -> np.ndarray:
        return np.linalg.solve(A, r) + np.array([once.pop() if once else 0.0, 0.0])

    z, left = refined(lambda x: A @ x, factors, lambda x: abs(float(x[0])), np.array([27.0, 0.0]), 0.0)
    np.testing.assert_allclose(z, [0.0, -60.0], rtol=1e-12, atol=1e-14)
    assert left == 0.0


@pytest.mark.parametrize("nu", [-0.9, pytest.param(0.3, marks=pytest.mark.slow), 0.499])
@pytest.mark.parametrize("label", [s.label for s in SUBJECTS])
def test_bending_is_right_for_every_poissons_ratio_or_reported_too_stiff(label: str, nu: float) -> None:
    beam = Beam(nu=nu)
    found = statics.linear_tip(label, beam, 16)
    said = [float(m[1]) / 100 for w in found.warnings if (m := re.search(r"too stiff by ([\d.]+) %", w))]
    bound = any("too stiff in bending with elements as slender as these" in w for w in found.warnings)
    if said:
        assert found.error == pytest.approx(said[0] / (1 + said[0]), rel=0.03)
    elif not bound:
        assert found.error < 0.02


def test_a_small_excess_of_stiffness_gives_no_warning() -> None:
    case = cantilever(BY_LABEL["omar:continuum"], Beam(nu=0.1), 4, [])
    assert not ancf2d.solve(case, states=False).warnings


@pytest.mark.slow_rows("128-0.11-omar")
@pytest.mark.parametrize("label", chosen(["omar", "patel"], ["omar"]))
@pytest.mark.parametrize(("count", "error"), [(64, 0.58), (128, 0.11)])
def test_elements_that_lock_in_large_bending_give_a_warning(label: str, count: int, error: float) -> None:
    """A load of 1000 times the buckling load bends the first elements by half a radian each, over many heights."""
    found = statics.pushed(label, 1e3, count)
    assert found.error == pytest.approx(error, rel=0.05)
    assert any("too stiff for elements bent as far as this" in w for w in found.warnings)


@pytest.mark.slow_rows("patel")
@pytest.mark.parametrize("label", chosen(["omar", "patel", "li", "vallejo", "reissner3"], ["patel", "reissner3"]))
def test_elements_that_can_bend_far_give_no_warning(label: str) -> None:
    found = statics.pushed(label, 1e3, 256)
    assert found.error < 0.02
    assert not found.warnings
