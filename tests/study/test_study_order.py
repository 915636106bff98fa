"""Observed orders and limits of sequences with known mathematics."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ancf2d.study.order import estimate, observed_order, order_from_errors, round_off_level

counts = st.lists(st.integers(1, 400), min_size=3, max_size=3, unique=True).map(sorted)


def sequence(n: list[int], limit: float, c: float, p: float) -> list[float]:
    """f(n) = limit + c n^-p."""
    return [limit + c * k**-p for k in n]


@given(n=counts, p=st.floats(0.3, 8), c=st.sampled_from([-3.0, 0.7, 1e5]))
def test_order_is_recovered_for_any_refinement_ratios(n: list[int], p: float, c: float) -> None:
    f = sequence(n, 0.0, c, p)
    assume(abs(f[1] - f[2]) > 1e-9 * abs(f[1]))
    found = observed_order(n, f)
    assert found == pytest.approx(p, rel=1e-5)


@given(n=counts, p=st.floats(0.1, 3))
def test_growing_differences_have_a_negative_order(n: list[int], p: float) -> None:
    f = [float(k) ** p for k in n]
    assert observed_order(n, f) == pytest.approx(-p, rel=1e-4)


@pytest.mark.parametrize("f", [[1.0, 2.0, 1.5], [1.0, 1.0, 2.0], [1.0, 2.0, 2.0], [1.0, 1.0, 1.0],
                               [1.0, math.inf, 2.0]])
def test_no_order_where_differences_change_sign_or_vanish(f: list[float]) -> None:
    assert observed_order([2, 4, 8], f) is None


@pytest.mark.parametrize("n", [[4, 8, 16, 32], [3, 5, 8, 20], [10, 11, 12, 13]])
@pytest.mark.parametrize("p", [1.0, 2.0, 4.0])
def test_limit_of_a_pure_power_is_exact_and_within_its_bar(n: list[int], p: float) -> None:
    f = sequence(n, 5.0, -3.0, p)
    found = estimate(n, f, 5.0)
    assert found.value == pytest.approx(5.0, rel=1e-9)
    assert found.order == pytest.approx(p, rel=1e-4)
    assert found.asymptotic
    assert found.note == ""
    # the grid convergence index: 1.25 times the error of the finest mesh
    assert found.error_bar == pytest.approx(1.25 * abs(f[-1] - 5.0), rel=1e-4)


def test_limit_of_two_powers_is_within_the_bar() -> None:
    n = [4, 8, 16, 32, 64]
    f = [2.0 + 1.0 * k**-2.0 + 3.0 * k**-3.0 for k in n]
    found = estimate(n, f, 2.0)
    assert found.asymptotic
    assert found.value is not None
    assert found.error_bar is not None
    assert abs(found.value - 2.0) < found.error_bar < 1e-3


def test_a_changing_order_is_not_asymptotic_and_has_the_larger_bar() -> None:
    n = [1, 2, 4, 8]
    f = [2.0 + 1.0 / k - 1.2 / k**3 for k in n]
    found = estimate(n, f, 2.0)
    assert not found.asymptotic
    assert "not asymptotic" in found.note
    assert found.value is not None
    assert found.error_bar is not None
    assert abs(found.value - 2.0) < found.error_bar


def test_oscillation_is_reported_and_bounded() -> None:
    found = estimate([2, 4, 8], [1.0, 1.2, 1.1], 1.0)
    assert (found.value, found.order, found.asymptotic) == (1.1, None, False)
    assert found.error_bar == pytest.approx(3 * 0.2)
    assert "one side" in found.note


def test_divergence_has_no_limit() -> None:
    found = estimate([2, 4, 8], [1.0, 2.0, 4.0], 1.0)
    assert (found.value, found.error_bar, found.asymptotic) == (None, None, False)
    assert found.order == pytest.approx(-1.0)
    assert "differences grow" in found.note


def test_two_meshes_assume_second_order_with_a_factor_of_three() -> None:
    found = estimate([4, 8], [1.0, 1.3], 1.0)
    assert found.value == pytest.approx(1.4)
    assert found.error_bar == pytest.approx(0.3)
    assert not found.asymptotic


def test_one_mesh_and_none_have_no_estimate() -> None:
    assert estimate([4], [1.0], 1.0).error_bar is None
    assert estimate([], [], 1.0).value is None


@pytest.mark.parametrize("noise", [0.0, 1e-15, -3e-13])
def test_values_equal_to_round_off_are_converged(noise: float) -> None:
    found = estimate([2, 4, 8], [7.0, 7.0 * (1 + noise), 7.0], 7.0)
    assert found.value == pytest.approx(7.0, rel=1e-12)
    assert found.order is None
    assert found.asymptotic
    assert found.note == "converged to round-off: order undefined"
    assert found.error_bar is not None
    assert 7.0 * 2.0**-52 <= found.error_bar <= 7.0 * 1e-12


def test_sequence_that_reaches_round_off_keeps_its_order() -> None:
    n = [2, 4, 8, 16, 32, 64, 128]
    f = [v + e for v, e in zip(sequence(n, 1.0, 1e-3, 8.0), [0, 0, 0, 0, 0, 2e-14, -1e-13], strict=True)]
    found = estimate(n, f, 1.0)
    assert found.order == pytest.approx(8.0, abs=0.1)
    assert found.asymptotic
    assert found.note == "converged to round-off"
    assert found.value == pytest.approx(1.0, abs=1e-11)


def test_round_off_is_detected_when_small_differences_stop_falling() -> None:
    assert round_off_level([1.0, 1.0 + 1e-5, 1.0 + 1e-5 + 1e-9, 1.0 + 1e-5 - 1e-9], 1.0) == 2
    assert round_off_level([1.0, 1.1, 1.11], 1.0) is None


def test_order_between_two_known_errors() -> None:
    assert order_from_errors([3, 6], [8.0, 1.0]) == pytest.approx(3.0)
    assert order_from_errors([3, 6], [8.0, 0.0]) is None
