"""The static tables of the seed paper, to its printed digits, with its own choices (preset: paper)."""

import helpers
import numpy as np
import pytest

SQUARE = {"height": 0.1, "width": 0.1}
COUNTS = (2, 4, 8, 16, 32, 64, 128)
TABLE_1 = {
    "2d2n": (-0.073625, -0.089577, -0.096061, -0.097443, -0.097760, -0.097841, -0.097864),
    "2d3n": (-0.071246, -0.069729, -0.076859, -0.087866, -0.094651, -0.097006, -0.097653),
    # printed without their minus signs, and the first as 0.067056
    "omar": (-0.067059, -0.083610, -0.087768, -0.088817, -0.089084, -0.089153, -0.089171),
}


def midspan(spec: dict) -> float:
    """Return the deflection in mm: all positions of the first node held, the vertical one of the last."""
    out = helpers.solved(
        {"b": helpers.body(helpers.line(2.0), spec, SQUARE, helpers.STEEL)},
        "linear_static",
        bc=[{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}],
        loads=[{"type": "force", "at": "b@0.5", "value": [0, -1000]}],
    )
    return 1e3 * out.u("b@0.5")[1]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", TABLE_1)
def test_table_1(name, count):
    more = {"quadrature": [4, 2]} if name == "omar" else {}
    value = midspan(helpers.element(name, count, preset="paper", **more))
    assert f"{value:.6f}" == f"{TABLE_1[name][COUNTS.index(count)]:.6f}"


def test_table_1_analytic_values():
    """BEAM3 is Euler-Bernoulli; BEAM188's limit is Timoshenko with k = 10(1 + nu)/(12 + 11 nu)."""
    assert midspan(helpers.element("cable", 2)) == pytest.approx(-0.096618, abs=6e-7)
    assert midspan(helpers.element("reissner3", 8)) == pytest.approx(-0.0973575, abs=6e-8)
    assert midspan(helpers.element("reissner3", 8, shear_factor=5 / 6)) == pytest.approx(-0.0973720, abs=6e-8)


def tip(spec: dict, reverse: bool = False) -> np.ndarray:
    a, b = ((2.0, 0.0), (0.0, 0.0)) if reverse else ((0.0, 0.0), (2.0, 0.0))
    geometry = {"type": "line", "start": list(a), "end": list(b)}
    clamp, load = ("b@1", "b@0") if reverse else ("b@0", "b@1")
    out = helpers.solved(
        {"b": helpers.body(geometry, spec, SQUARE, helpers.STEEL)},
        bc=[{"type": "clamp", "at": clamp, "hold": "all"}],
        loads=[{"type": "force", "at": load, "value": [0, -500e3]}],
    )
    return out.u(load)


# 2d2n as described gives another value than the printed (-0.14594, -0.68367)
@pytest.mark.parametrize(
    ("name", "expected"),
    [("omar", ("-0.12435", "-0.63275")), ("2d3n", ("-0.14479", "-0.68070")), ("2d2n", ("-0.14531", "-0.68185"))],
)
def test_table_2(name, expected):
    value = tip(helpers.element(name, 128, preset="paper"))
    assert tuple(f"{v:.5f}" for v in value) == expected


def test_2d2n_depends_on_the_direction_of_numbering():
    forward = tip(helpers.element("2d2n", 32, preset="paper"))[1]
    backward = tip(helpers.element("2d2n", 32, preset="paper"), reverse=True)[1]
    assert sorted(f"{v:.5f}" for v in (forward, backward)) == ["-0.68115", "-0.68168"]
    same = [tip(helpers.element("2d3n", 8, preset="paper"), reverse=r)[1] for r in (False, True)]
    assert same[0] == pytest.approx(same[1], rel=1e-9)


def test_the_papers_shear_is_half_of_the_right_one():
    """Its preset is the shear factor 0.5: the number itself gives the same, the right factor another value."""
    paper = midspan(helpers.element("2d3n", 16, preset="paper"))
    assert midspan(helpers.element("2d3n", 16, "continuum", quadrature=[2, 2], shear_factor=0.5)) == pytest.approx(
        paper, rel=1e-12
    )
    right = midspan(helpers.element("2d3n", 16, preset="paper", shear_factor=5 / 6))
    assert abs(right) < abs(paper) * 0.999


def test_the_poisson_consistent_coefficient_is_far_closer_on_table_1():
    exact = midspan(helpers.element("reissner3", 16))
    errors = {
        n: abs(midspan(helpers.element(n, 16, "continuum", quadrature=[2, 2])) / exact - 1) for n in ("2d3n", "2d3n-nu")
    }
    assert errors["2d3n-nu"] < 0.05 * errors["2d3n"]
