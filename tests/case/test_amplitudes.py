"""Amplitudes: values and exact rates."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case import Constant, Expression, Ramp, Sine, Table

AMPLITUDES = [
    Constant(), Constant(-2.0), Ramp(), Ramp(0.2, 0.8, 3.0), Sine(2.0, 0.3, 1.5),
    Table((0.0, 0.5, 1.0), (0.0, 2.0, 1.0)), Table((0.0, 0.5, 1.0), (0.0, 2.0, 1.0), True, -2.0),
    Table((0.0, 0.1, 0.7, 1.0), (0.0, 1.0, 1.5, 4.0), True), Table((0.3,), (7.0,), True),
    Expression("t^2*sin(3*t)", 2.0)]


@pytest.mark.parametrize(("amplitude", "t", "value"), [
    (Constant(), 5, 1), (Ramp(), -1, 0), (Ramp(), 0.25, 0.25), (Ramp(), 1, 1), (Ramp(), 9, 1),
    (Ramp(1, 3), 2, 0.5), (Ramp(0, 2, scale=4), 1, 2), (Sine(0.25), 1, 1),
    (Sine(2, math.pi / 2), 0, 1), (Sine(2), 0.125, 1),
    (Table((0.0, 2.0), (1.0, 3.0)), 1, 2), (Table((0.0, 2.0), (1.0, 3.0)), -1, 1),
    (Table((0.0, 2.0), (1.0, 3.0)), 9, 3), (Table((0.0, 2.0), (1.0, 3.0)), 2, 3),
    (Table((1.0,), (4.0,)), 0, 4),
    # one smooth piece with level ends is the cubic 3 x^2 - 2 x^3
    (Table((0.0, 2.0), (0.0, 8.0), True), 0.5, 8 * (3 / 16 - 2 / 64))])
def test_value(amplitude, t, value):
    assert amplitude.value(t) == pytest.approx(value, abs=1e-15)


@pytest.mark.parametrize("amplitude", AMPLITUDES, ids=repr)
@pytest.mark.parametrize("t", [-0.5, 0.05, 0.33, 0.61, 0.95, 1.4])
def test_rate_is_the_derivative_of_value(amplitude, t):
    h = 1e-6
    difference = (amplitude.value(t + h) - amplitude.value(t - h)) / (2 * h)
    assert amplitude.rate(t) == pytest.approx(difference, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("t", [0.0, 0.1, 0.7, 1.0])
def test_smooth_table_has_continuous_rate(t):
    table = AMPLITUDES[7]
    assert table.rate(t - 1e-9) == pytest.approx(table.rate(t + 1e-9), abs=1e-6)
    assert table.value(t) == pytest.approx(dict(zip(table.t, table.value_, strict=True))[t])


@given(st.lists(st.tuples(st.floats(0.01, 10), st.floats(-1e3, 1e3)), min_size=2, max_size=8),
       st.floats(0, 1))
@settings(derandomize=True, deadline=None, max_examples=200)
@pytest.mark.slow
def test_smooth_table_stays_between_its_values(steps, x):
    times = [sum(dt for dt, _ in steps[:i]) for i in range(len(steps))]
    values = [v for _, v in steps]
    table = Table(tuple(times), tuple(values), True)
    for i in range(len(times) - 1):
        value = table.value(times[i] + x * (times[i + 1] - times[i]))
        low, high = sorted(values[i: i + 2])
        assert low - 1e-9 * (1 + abs(low)) <= value <= high + 1e-9 * (1 + abs(high))
