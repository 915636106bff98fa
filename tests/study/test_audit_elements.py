"""Sound elements pass the audit, broken ones are detected, and every listed one completes it."""

import audits
import pytest
from helpers import chosen

from ancf2d.errors import CaseError
from ancf2d.study.audit import patches
from ancf2d.study.audit.examine import CHECKS, audit
from ancf2d.study.audit.subject import subject

CUBIC = ["1", "x", "y", "x*y", "x^2", "x^3"]
BASES_LOCK = {"poisson_locking_of_basis": "fail"}


@pytest.mark.slow_rows("reissner2-others1", "vallejo-others0")
@pytest.mark.parametrize(("name", "others"), [
    ("vallejo", {"slope_continuity": "note", **BASES_LOCK}),
    ("reissner2", dict.fromkeys(("patch_transverse", "slope_continuity", "poisson_locking_of_basis"), "note")),
    pytest.param("reissner3", dict.fromkeys(("patch_transverse", "slope_continuity", "poisson_locking_of_basis"),
                                            "note"), marks=pytest.mark.slow),
    ("cable", dict.fromkeys(("patch_transverse", "patch_shear", "shear_factor", "shear_in_bending",
                             "poisson_locking_of_basis"), "note")),
    pytest.param("ancf[2,2]", {"slope_continuity": "note"}, marks=pytest.mark.slow)])
def test_sound_elements_pass_apart_from_missing_features(name, others):
    found = audits.verdicts(subject(name))
    assert {k: v for k, v in found.items() if v != "pass"} == others


@pytest.mark.slow
def test_an_element_of_twelve_coordinates_described_in_a_file(tmp_path):
    """vallejo's basis with the nodes elsewhere: the same element."""
    file = audits.written(tmp_path, ["1", "x", "y", "x*y", "x^2", "x^2*y"], "r", "r_y", places=(0.0, 0.4, 1.0),
                          formulation="enhanced")
    found = audits.find(file)
    assert {k: f.verdict for k, f in found.items() if f.verdict != "pass"} == {"slope_continuity": "note", **BASES_LOCK}
    assert found["order_eigen"].value == pytest.approx(4.0, abs=0.05)


# all others go through for the tables of docs/audit.md: tests/scripts/test_audit_table.py
@pytest.mark.parametrize("name", chosen(("omar", "cable", "reissner3", "ancf[3,1]"), ("omar",)))
def test_every_listed_type_completes_the_audit(name):
    done = []
    found = audit(subject(name), done=lambda share, check: done.append((share, check)))
    assert [a.check for a in found.results] == list(CHECKS)
    assert done[0] == (0.0, CHECKS[0].name)
    assert done[-1] == (1.0, "")
    for answer in found.results:
        assert answer.finding.verdict in ("pass", "fail", "note")
        assert "\n" not in answer.finding.meaning
        assert "cannot be computed" not in answer.finding.meaning


def test_dependent_coordinates_are_detected(tmp_path):
    file = audits.written(tmp_path, ["1", "x", "y", "x*y", "x^2*y^2", "x^3"], "r", "r_x", "r_y")
    found = audits.find(file)
    assert found["solvability"].verdict == "fail"
    assert found["solvability"].value >= 1e13
    assert "rank 5 of 6" in found["solvability"].meaning
    assert {f.verdict for k, f in found.items() if k != "solvability"} == {"note"}


def test_a_basis_that_is_singular_at_one_nu_is_detected(tmp_path):
    found = audits.find(audits.written(tmp_path, [*CUBIC[:4], "nu*x^2", "x^3"], "r", "r_x", "r_y"),
                        "solvability")["solvability"]
    assert found.verdict == "fail"
    assert "nu = 0" in found.meaning


def test_a_missing_xy_is_detected(tmp_path):
    """Sections that rotate like x^2 inside an element have 4/3 of the bending energy, on any mesh."""
    file = audits.written(tmp_path, ["1", "x", "y", "x^2*y", "x^2", "x^3"], "r", "r_x", "r_y")
    found = audits.find(file, "patch_bending", "reversal_symmetry", "order_static", "patch_axial")
    assert {k: f.verdict for k, f in found.items()} == {
        "patch_bending": "fail", "reversal_symmetry": "fail", "order_static": "fail", "patch_axial": "pass"}
    assert "wrong limit" in found["order_static"].meaning


def test_reduced_quadrature_with_hourglass_modes_is_detected(tmp_path):
    file = audits.written(tmp_path, CUBIC, "r", "r_x", "r_y", quadrature=[2, 2])
    found = audits.find(file, "zero_energy_modes", "spurious_branch", "thickness_locking", "order_static")
    assert found["zero_energy_modes"].value == 2
    assert (found["spurious_branch"].value, found["spurious_branch"].verdict) == (0.0, "fail")
    full = audits.find(file, "zero_energy_modes", quadrature=[3, 2])
    assert full["zero_energy_modes"].verdict == "pass"


def test_an_element_without_a_linear_field_is_detected(tmp_path):
    file = audits.written(tmp_path, ["1", "x + x^2", "y", "x*y"], "r", "r_y")
    assert audits.find(file, "completeness")["completeness"].verdict == "fail"


def test_an_element_that_differs_upside_down_is_detected(tmp_path):
    file = audits.written(tmp_path, ["1", "x", "y", "x*y", "x^2 + x^2*y", "x^3"], "r", "r_x", "r_y")
    assert audits.find(file, "mirror_symmetry")["mirror_symmetry"].verdict == "fail"


def test_all_problems_of_a_file_are_reported_with_their_lines(tmp_path):
    file = audits.written(tmp_path, ["1", "x^^2", "y", "sin(x)"], "r", "r_y")
    with pytest.raises(CaseError) as caught:
        subject(file)
    assert [(p.file, p.path, p.line) for p in caught.value.problems] == [
        (file, ("basis", 1), 1), (file, ("basis", 3), 1)]


@pytest.mark.parametrize(("name", "options", "words"), [
    ("rigid", {}, "rigid has no strain"), ("2d2m", {}, "did you mean '2d2n'"), ("ancf", {}, "orders along and across"),
    ("vallejo", {"preset": "paper"}, "--preset: error: the paper does not use vallejo"),
    ("2d2n", {"formulation": "enhanced"}, "--formulation: error: 2d2n has no formulation enhanced"),
    ("cable", {"quadrature": "exact"}, "--quadrature: error: no finite quadrature"),
    ("missing.yaml", {}, "cannot read the file")])
def test_elements_that_cannot_be_audited_are_refused_with_options_of_the_command_line(name, options, words):
    with pytest.raises(CaseError, match=words):
        subject(name, **options)


def test_direction_dependent_forces_are_detected(monkeypatch):
    """A spring in x next to the element: rigid motion is resisted, and rotation changes the energy."""
    sound = patches.elastic

    def held(model, d):
        energy, Q = sound(model, d)
        Q[0] += 1e-3 * d[0]
        return energy + 0.5e-3 * d[0] ** 2, Q

    monkeypatch.setattr(patches, "elastic", held)
    assert audits.verdicts(subject("vallejo"), "rigid_motion", "objectivity") == dict.fromkeys(
        ("rigid_motion", "objectivity"), "fail")


def test_a_response_that_depends_on_the_direction_of_the_beam_is_detected(monkeypatch):
    sound = patches.tip_deflection
    monkeypatch.setattr(patches, "tip_deflection",
                        lambda s, *a, angle=0.0, **k: sound(s, *a, angle=angle, **k) * (1 + 1e-6 * angle))
    assert audits.verdicts(subject("vallejo"), "isotropy") == {"isotropy": "fail"}
