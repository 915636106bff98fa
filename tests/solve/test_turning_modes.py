"""Vibrations in a turning frame: published frequencies, the skew Coriolis matrix, exact pairs of a rotating mass."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ancf2d.case import load_case_text
from ancf2d.errors import ResultsError
from ancf2d.model.build import build_model
from ancf2d.model.model import Model
from ancf2d.plot.kinds import build
from ancf2d.results import open_results
from ancf2d.solvers.linear import coriolis_matrix
from ancf2d.solvers.small_motions import quadratic
from ancf2d.solvers.small_motions.linearised import Linearised, RateForces, base_state
from ancf2d.study.run import run_case

BEAM = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{EA: 1.2e7, kGA: 5e6, EI: 1, rhoA: 1}}
    element: {{type: {element}}}
boundary_conditions: [{{name: hub, type: clamp, at: beam@0, hold: section}}]
masses: {masses}
steady_rotation: {{omega: {omega}, about: {about}}}
solver: {{type: eigen, modes: 3}}
"""


def case(element: str, omega: float, masses: str = "[]", about: str = "[0, 0]") -> str:
    return BEAM.format(element=element, omega=omega, masses=masses, about=about)


def omegas(text: str) -> list[float]:
    return [f["omega"] for f in run_case(load_case_text(text)).summary["frequencies"]]


@pytest.mark.parametrize("element", ["cable, count: 24", "vallejo, count: 16", "reissner3, count: 24"])
@pytest.mark.parametrize(("omega", "first"), [(2, 3.621797), (5, 4.073896), (10, 5.048975)])
def test_first_frequency_of_a_rotating_cantilever(element: str, omega: float, first: float) -> None:
    """Euler-Bernoulli, no stretch, zero hub radius, in-plane, in units of sqrt(EI/(rhoA L^4))."""
    assert math.isclose(omegas(case(element, omega))[0], first, rel_tol=2e-5)


def test_both_directions_of_rotation() -> None:
    np.testing.assert_allclose(omegas(case("vallejo, count: 4", 5)), omegas(case("vallejo, count: 4", -5)), rtol=1e-9)


def test_damping_has_no_effect_on_undamped_modes_in_a_turning_frame() -> None:
    text = case("reissner3, count: 8", 5)
    damped = text.replace("eigen,", "eigen, damped: false,") + "damping: {rayleigh: {beta: 0.01}}\n"
    found = run_case(load_case_text(damped)).summary["frequencies"]
    assert [f["growth"] for f in found] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose([f["omega"] for f in found], omegas(text), rtol=1e-9)


ARM = """
  arm:
    geometry: {type: line, start: [0.12, 0.16], end: [0.72, 0.96]}
    element: {type: rigid, mass: 1, inertia: 0.1}
springs: [{type: rotational, between: [[0.12, 0.16], arm@0], stiffness: 10}]
boundary_conditions:
- {name: pivot, type: pin, at: arm@0}
- """


@pytest.mark.parametrize("count", [3, 8], ids=["all pairs at once", "Arnoldi"])
def test_a_rigid_arm_next_to_a_beam_adds_its_own_pair(count: int) -> None:
    """It swings with J s^2 + k + m Omega^2 R c = 0 about a pivot at R, and does not change the pairs of the beam."""
    text = case(f"reissner3, count: {count}", 3)
    both = text.replace("\nboundary_conditions: [", ARM).replace("hold: section}]", "hold: section}")
    alone, found = (omegas(one.replace("modes: 3", f"modes: {modes}")) for one, modes in ((text, 5), (both, 6)))
    arm = math.sqrt((10 + 9 * 0.2 * 0.5) / (0.1 + 0.25))
    np.testing.assert_allclose(found, sorted([*alone, arm]), rtol=1e-7)


def test_arnoldi_agrees_with_a_dense_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    text = case("vallejo, count: 12", 7)
    found = omegas(text)
    monkeypatch.setattr(quadratic, "DENSE", 200)
    np.testing.assert_allclose(omegas(text), found, rtol=1e-8)


@pytest.mark.parametrize("element", ["2d2n, count: 3", "reissner3, count: 3", "cable, count: 3"])
def test_coriolis_forces_do_no_work_and_are_linear_in_omega(element: str) -> None:
    model: Model = build_model(load_case_text(case(element, 3, "[{at: beam@0.4, mass: 2}]")))
    found = coriolis_matrix(model, 3.0).toarray()
    assert np.abs(found).max() > 0
    np.testing.assert_allclose(found, -found.T, atol=1e-14 * np.abs(found).max())
    np.testing.assert_allclose(2 * found, coriolis_matrix(model, 6.0).toarray(), atol=1e-14)
    turning = Linearised(base_state(model, "static"))
    np.testing.assert_allclose(turning.C.toarray(), RateForces(model).coriolis(0.0).toarray())
    assert abs(turning.C - turning.coriolis).max() == 0.0


def test_coriolis_force_of_a_translation_is_twice_omega_times_the_momentum() -> None:
    """Every mass m that moves along y with v has the force -2 m omega v along x."""
    model = build_model(load_case_text(case("vallejo, count: 3", 3, "[{at: beam@0.4, mass: 2}]")))
    v = (model.meshes["beam"].kinds == 1).astype(float)
    force = coriolis_matrix(model, 3.0) @ v
    rigid = (model.meshes["beam"].kinds == 0).astype(float)
    assert math.isclose(rigid @ force, -2 * 3.0 * (1 + 2), rel_tol=1e-12)
    assert abs(v @ force) < 1e-12


def test_a_beam_pressed_towards_its_hub_grows_beyond_the_critical_speed() -> None:
    """An unstable motion is reported with its growth rate, never as a frequency."""
    found = run_case(load_case_text(case("cable, count: 8", 12, about="[1.5, 0]"))).summary
    grown = [f for f in found["frequencies"] if f["growth"] > 0.0]
    assert grown
    assert all(f["omega"] == 0.0 for f in grown)
    assert any("unstable" in w for w in found["warnings"])


def test_campbells_diagram_has_a_line_for_each_mode_over_the_speeds(tmp_path: Path) -> None:
    files = []
    for omega in (4, 0.5, 2):
        files.append(str(tmp_path / f"{omega}.h5"))
        run_case(load_case_text(case("cable, count: 8", omega)), files[-1])
    panel, = build([open_results(f) for f in files], "campbell").panels
    first = panel.curves[0]
    assert (first.name, first.x.tolist()) == ("bending 1", [0.5, 2.0, 4.0])
    assert first.y[1] == pytest.approx(3.621797, rel=1e-4)
    once = next(c for c in panel.curves if c.name == "1 per turn")
    assert once.y.tolist() == once.x.tolist() == [0.0, 4.0]
    assert len({c.look["linestyle"] for c in panel.curves if "per turn" in c.name}) == 3
    still = str(tmp_path / "still.h5")
    text = case("cable, count: 8", 1).replace("steady_rotation: {omega: 1, about: [0, 0]}\n", "")
    run_case(load_case_text(text), still)
    with pytest.raises(ResultsError, match="no steady_rotation"):
        build(open_results(still), "campbell")
