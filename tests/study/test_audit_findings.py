"""Known properties that the audit must find by itself: of listed types, and of their bases under a neutral name."""

import audits
import helpers
import numpy as np
import pytest

from ancf2d.elements.registry import ELEMENTS
from ancf2d.solvers.small_motions.linearised import RateForces
from ancf2d.study.audit.subject import subject


@pytest.fixture(params=["listed", "described"])
def named(request, tmp_path):
    """Return the file or name under which a listed type is audited; a file does not reveal its name."""
    def name(kind: str) -> str:
        if request.param == "listed":
            return kind
        known = ELEMENTS[kind]
        places = tuple(n.at for n in known.nodes)
        return audits.written(tmp_path, list(known.basis), *known.nodes[0].coordinates, places=places,
                              formulation="continuum", quadrature=[2, 2])
    return name


def test_2d2n_is_not_symmetric_under_reversal(named):
    found = audits.find(named("2d2n"), "reversal_symmetry", "mirror_symmetry")
    assert found["reversal_symmetry"].verdict == "fail"
    assert found["reversal_symmetry"].value > 0.1
    assert found["mirror_symmetry"].verdict == "pass"


@pytest.mark.parametrize("kind", ["2d3n", "omar", "vallejo", "patel", "reissner3", "cable"])
def test_others_are_symmetric_under_reversal(kind):
    assert audits.find(kind, "reversal_symmetry")["reversal_symmetry"].verdict == "pass"


@pytest.mark.slow_rows("described-2d2n", "described-2d3n", "listed-2d2n")
@pytest.mark.parametrize("kind", ["2d2n", "2d3n"])
def test_common_coefficients_are_nonconforming_with_a_spurious_branch(named, kind):
    found = audits.find(named(kind), "position_continuity", "spurious_branch", "patch_axial")
    assert {f.verdict for f in found.values()} == {"fail"}
    # the y^2 coefficient: 6/l^2 of a node's displacement at y = h/2 = l/2, or 4/l^2
    assert found["position_continuity"].value == pytest.approx({"2d2n": 1.5, "2d3n": 1.0}[kind])
    assert "n^-0.9" in found["spurious_branch"].meaning


@pytest.mark.parametrize("kind", helpers.chosen(
    ["omar", "kerkkanen", "vallejo", "li", "patel", "cable", "reissner2", "reissner3", "ancf[2,2]"],
    ["kerkkanen", "patel", "cable", "reissner3"]))
def test_others_conform_and_have_no_spurious_branch(kind):
    found = audits.find(kind, "position_continuity", "spurious_branch", "patch_axial")
    assert {f.verdict for f in found.values()} == {"pass"}


def test_omar_locks_by_nu(named):
    """By 1/(1 - nu^2) of plane stress without contraction: 9 % at nu = 0.3, 25 % at -0.5."""
    found = audits.findings(subject(named("omar"), formulation="continuum"), "poisson_locking")["poisson_locking"]
    assert found.verdict == "fail"
    assert found.value == pytest.approx(0.25, rel=1e-6)
    assert "9 % at 0.3" in found.meaning


def test_the_basis_of_omar_locks_where_its_formulation_does_not():
    found = audits.find("omar", "poisson_locking", "poisson_locking_of_basis")
    assert found["poisson_locking"].verdict == "pass"
    assert found["poisson_locking_of_basis"].verdict == "fail"
    assert found["poisson_locking_of_basis"].value == pytest.approx(0.25, rel=1e-6)


@pytest.mark.parametrize("kind", ["2d2n", "2d3n", "omar"])
def test_the_shear_factor_of_the_paper_is_one_half(kind):
    found = audits.find(kind, "shear_factor", preset="paper")["shear_factor"]
    assert found.value == pytest.approx(0.5, rel=1e-9)
    assert found.verdict == "fail"


def test_a_shear_factor_is_found_under_any_name(tmp_path):
    file = audits.written(tmp_path, ["1", "x", "y", "x*y", "x^2", "x^3"], "r", "r_x", "r_y", shear_factor=0.7)
    assert audits.find(file, "shear_factor")["shear_factor"].value == pytest.approx(0.7, rel=1e-9)


@pytest.mark.slow_rows("ancf[3,3]")
@pytest.mark.parametrize("order", ["ancf[3,3]", "ancf[2,4]"])
def test_sections_that_warp_have_five_sixths_in_bending(order):
    found = audits.find(order, "shear_factor", "shear_in_bending")
    assert found["shear_factor"].value == pytest.approx(1.0, rel=1e-9)
    assert found["shear_in_bending"].value == pytest.approx(5 / 6, rel=1e-4)
    assert {f.verdict for f in found.values()} == {"pass"}


@pytest.mark.parametrize(("kind", "hidden"), [("omar", 2), ("patel", 2), ("li", 3), ("vallejo", 0)])
def test_two_by_two_points_leave_hidden_motions(kind, hidden):
    found = audits.find(kind, "zero_energy_modes", formulation="continuum", quadrature=[2, 2])["zero_energy_modes"]
    assert (found.value, found.verdict) == (hidden, "fail" if hidden else "pass")


@pytest.mark.parametrize(("kind", "cause"), [("omar", "thickness"), ("2d2n", "thickness"), ("li", "axial strain")])
def test_slender_beams_bent_far_lose_deflection(kind, cause):
    found = audits.find(kind, "thickness_locking")["thickness_locking"]
    assert found.value > 0.01
    assert cause in found.meaning
    assert found.verdict == ("fail" if cause == "thickness" else "note")


def test_linear_elements_with_full_quadrature_lock_in_shear():
    found = audits.find("kerkkanen", "shear_locking", formulation="continuum", quadrature="exact")["shear_locking"]
    assert found.verdict == "fail"
    assert found.value > 0.99
    assert "shear" in found.meaning


@pytest.mark.parametrize("kind", ["reissner2", "kerkkanen"])
def test_shear_locking_is_not_attributed_to_nu(kind):
    """Locking in shear depends on nu through G, but vanishes with the mesh."""
    formulation = {"reissner2": None, "kerkkanen": "structural"}[kind]
    found = audits.find(kind, "shear_locking", "poisson_locking", formulation=formulation, quadrature=[2, 1])
    assert {k: f.verdict for k, f in found.items()} == {"shear_locking": "fail", "poisson_locking": "note"}
    assert found["shear_locking"].meaning.endswith("to shear strain")


def test_the_locking_strain_is_named():
    """Full integration of quadratic elements: the axis in large bending cannot keep its length."""
    found = audits.find("reissner3", "shear_locking", "thickness_locking", quadrature=[5, 1])
    assert found["shear_locking"].meaning.endswith("to shear strain")
    assert found["thickness_locking"].meaning.endswith("to axial strain")
    assert found["thickness_locking"].verdict == "note"


@pytest.mark.parametrize("kind", ["vallejo", "2d2n", "cable", "reissner3"])
def test_damping_is_proportional_to_stiffness_and_zero_for_rigid_motion(kind):
    found = audits.find(kind, "damping")["damping"]
    assert found.verdict == "pass"
    assert found.value < 1e-9


def test_a_damping_matrix_not_proportional_to_stiffness_is_detected(monkeypatch):
    """One entry of its diagonal is 1 % too large."""
    sound = RateForces.viscous_matrix

    def broken(self, d):
        C = sound(self, d).tolil()
        C[-1, -1] *= 1.01
        return C.tocsc()

    monkeypatch.setattr(RateForces, "viscous_matrix", broken)
    found = audits.find("vallejo", "damping")["damping"]
    assert found.verdict == "fail"
    assert "damping ratios differ" in found.meaning


def test_viscous_forces_that_do_not_turn_with_the_body_are_detected(monkeypatch):
    """Forces of the reference damp small motions correctly, but resist a spinning body once it has rotated."""
    sound = RateForces.viscous_forces
    monkeypatch.setattr(RateForces, "viscous_forces", lambda self, d, v: sound(self, np.zeros_like(d), v))
    found = audits.find("vallejo", "damping")["damping"]
    assert found.verdict == "fail"
    assert "rigid motion" in found.meaning
