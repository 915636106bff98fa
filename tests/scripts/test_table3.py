"""The script of Table 3 finds the printed modes and says if a name does not fit the mode's shape."""


import pytest

from scripts import table3

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("element", ["2d2n", "2d3n"])
def test_printed_frequencies_are_computed_ones(element):
    found = table3.rows(table3.CASE.with_name(f"table3_{element}.yaml"), (), 16, table3.PRINTED[element, 16].split())
    assert [r.same for r in found] == [True] * 8
    assert [r.kind for r in found[:6]] == [r.name for r in found[:6]]
    assert all(r.overlap > 0.98 for r in found[:6])
    assert all(r.remark for r in found[6:] if r.overlap < 0.5)


def test_a_wrong_digit_is_detected():
    printed = table3.PRINTED["2d2n", 16].replace("93.40", "93.41").split()
    assert not table3.rows(table3.CASE, (), 16, printed)[0].same


def test_the_second_axial_of_the_finer_mesh_is_called_spurious():
    found = table3.rows(table3.CASE, (), 32, table3.PRINTED["2d2n", 32].split())
    assert found[3].same
    assert found[3].overlap == pytest.approx(0.395, abs=0.001)
    assert "spurious" in found[3].remark


def test_the_analytic_row():
    assert {name: f"{omega:.2f}" for name, text, omega in table3.analytic() if f"{omega:.2f}" != text} == table3.SLIPS


def test_other_elements_have_the_exact_modes():
    found = {r.name: r for r in table3.rows(table3.CASE, table3.overrides_of("vallejo:structural"), 16)}
    assert found["bending 2"].omega == pytest.approx(332.2345, rel=1e-4)
    assert found["thickness 1"].omega == pytest.approx(3090.98, rel=1e-5)
    assert min(r.overlap for r in found.values()) > 0.99


def test_the_branch_falls_like_the_inverse_of_the_number_of_elements():
    points = table3.spurious((32, 64))
    assert set(points) == {"2d2n", "2d3n", "2d2n-nu", "2d3n-nu"}
    assert table3._slope(points["2d2n"]) == pytest.approx(-1.0, abs=0.1)
