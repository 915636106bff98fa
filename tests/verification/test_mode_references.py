"""The references of ``cases/modes`` and ``cases/buckling`` follow from their equations, digit by digit."""

from pathlib import Path

import pytest
from instruments.references import modes as exact

from ancf2d.study.run import load

CASES = Path(__file__).parents[2] / "cases"
E, RHO = 2.07e11, 7850.0


def expected(case: str) -> list[float]:
    return [e.value for e in load(CASES / f"{case}.yaml").case.expected]


def test_free_free_beam():
    h = 0.002
    assert expected("modes/free_free")[1:] == pytest.approx(exact.free_free(2.0, E * h**4 / 12, RHO * h * h), rel=1e-9)


def test_beam_under_tension():
    h = 0.002
    known = [exact.stretched(2.0, E * h**4 / 12, RHO * h * h, 50.0, m) for m in (1, 2, 3)]
    assert expected("modes/stretched_beam") == pytest.approx(known, rel=1e-9)


def test_portal_frame():
    h = 0.01
    known = exact.frame([(0, 0), (0, 2), (3, 2), (3, 0)], [(0, 1), (1, 2), (2, 3)], [0, 3], E * h * h, E * h**4 / 12,
                        RHO * h * h, 3.0, 160.0, 5)
    assert expected("modes/portal_frame") == pytest.approx(known, rel=1e-9)


@pytest.mark.parametrize("ends", ["pinned", "cantilever", "propped", "clamped"])
def test_euler_columns(ends):
    assert expected(f"buckling/euler_{ends}") == pytest.approx([exact.euler(2e11 / 12, 1000.0, ends) / 1000], rel=1e-9)


def test_dynamic_stiffness_is_the_static_one_at_rest():
    K = exact.dynamic_stiffness(2.0, 3.0, 5.0, 7.0, 1e-3)
    assert [K[0, 0], K[1, 1], K[1, 2], K[2, 2], K[2, 5]] == pytest.approx(
        [3 / 2, 12 * 5 / 8, 6 * 5 / 4, 4 * 5 / 2, 2 * 5 / 2], rel=1e-5)
