"""Signals in compiled code are the amplitudes of the case, with exact time derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case import Amplitude, Constant, Expression, Ramp, Sine, Table, jets
from ancf2d.case.programs import are_constant
from ancf2d.case.programs import programs as programs_of
from ancf2d.errors import ComputationError
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.kernels.motion.state import evaluate, evaluate_constants
from ancf2d.model.timing import Signal

TIMES, VALUES = (-0.5, 0.25, 1.0, 1.5, 4.0), (1.0, 2.0, 2.5, -1.0, 0.5)
AMPLITUDES: list[Amplitude | None] = [
    None,
    Constant(scale=-3.0),
    Ramp(t0=0.25, t1=1.5, scale=2.0),
    Table(t=TIMES, value_=VALUES, scale=-1.5),
    Table(t=TIMES, value_=VALUES, smooth=True, scale=3.0),
    Table(t=(1.0,), value_=(2.0,)),
    Sine(frequency=1.7, phase=0.4, scale=2.0),
    *(Expression(value_=text, scale=1.25) for text in (
        "t", "pi", "-t + 2 - 3*t/(1 + t^2)", "sin(2*pi*t)^3", "exp(-t)*cos(3*t)", "sqrt(2 + sin(t))", "abs(t - 0.7)^3",
        "t^1.5", "(1 + t)^t", "(t - 5)^3", "2^(-t)", "2 if t < 1 else t^2 + 1", "0.2 < t <= 1.4 < 3", "t >= 1",
        "t != 1", "(3*t if t < 1 else 3) if t > 0.5 else 1.5 if t == 0.25 else -t",
        "t*(0.3 < t < 0.9) - (t > 1 > 0)*t^2", "1 - (0 < t < 2 < t + 1.9) - 2*(t <= 0.6)",
    )),
]
INSIDE = (0.1, 0.35, 0.55, 0.8, 1.2, 1.45, 2.2, 3.7)
CORNERS = (-0.5, 0.0, 0.25, 1.0, 1.5, 4.0, 5.0)


def programs(signals: list[Signal]) -> Record:
    """Return programs in the form for kernels of motion."""
    return Record(programs_of((s.amplitude, s.factor, s.offset) for s in signals))


def compiled(signals: list[Signal], t: float) -> np.ndarray:
    """Return value, rate and second derivative (n, 3) of the signals."""
    out = np.zeros((len(signals), 3))
    evaluate(programs(signals), t, out)
    return out


def expected(signal: Signal, t: float) -> tuple[float, float]:
    """Return value and rate of the case's own amplitude, nan where it has none."""
    try:
        value = signal(t)
    except ComputationError:
        return math.nan, math.nan
    try:
        return value, signal.rate(t)
    except ComputationError:
        return value, math.nan


@pytest.mark.parametrize("t", INSIDE + CORNERS)
def test_compiled_signals_are_the_amplitudes_of_the_case(t: float) -> None:
    signals = [Signal(a, 1.5, -0.25) for a in AMPLITUDES]
    reference = np.array([expected(s, t) for s in signals])
    np.testing.assert_allclose(compiled(signals, t)[:, :2], reference, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("t", INSIDE)
def test_second_derivatives_are_those_of_the_rates(t: float) -> None:
    signals = [Signal(a, 1.5, -0.25) for a in AMPLITUDES]
    h = 1e-5
    difference = (compiled(signals, t + h)[:, 1] - compiled(signals, t - h)[:, 1]) / (2 * h)
    np.testing.assert_allclose(compiled(signals, t)[:, 2], difference, rtol=1e-7, atol=1e-7)


def test_smooth_motion_has_second_derivatives_up_to_its_ends() -> None:
    table = Signal(Table(t=(0.0, 2.0), value_=(0.0, 1.0), smooth=True))
    for t, second in ((0.0, 1.5), (1.0, 0.0), (math.nextafter(2.0, 0), -1.5), (2.0, 0.0)):
        assert compiled([table], t)[0, 2] == pytest.approx(second, abs=1e-12)


@pytest.mark.parametrize(("text", "t", "jet"), [
    ("t^2", 0, (0, 0, 2)), ("t^1", 0, (0, 1, 0)), ("t^1.5", 0, (0, 0, None)), ("t^0.5", 0, (0, None, None)),
    ("sqrt(t)", 0, (0, None, None)), ("sqrt(0*t)", 1, (0, 0, 0)), ("sqrt(t)", -1, (None, None, None)),
    ("t^2.5", -1, (None, None, None)), ("0^t", 0, (1, None, None)), ("(t - 1)^-1", 1, (None, None, None)),
    ("1/(t - 1)", 1, (None, None, None)), ("exp(1000*t)", 1, (None, None, None)), ("1/exp(1000*t)", 1, (None,) * 3),
    ("1 if 1/t > 2 else 3", 0, (None, None, None)), ("2 < 1 < 1/t", 0, (0, 0, 0)), ("1 < 2 < 1/t", 0, (None,) * 3),
    ("(1/t)^0", 0, (None, None, None)), ("5 if t >= 0 else 1/t", 0, (5, 0, 0)), ("5 if t > 0 else 1/t", 0, (None,) * 3),
    ("abs(t)", 0, (0, 1, 0)), ("abs(-3*t)", 0, (0, 3, 0)), ("abs(-t^2)", 0, (0, 0, 2)), ("t^(t^2)", 1, (1, 1, 4)),
])
def test_missing_values_and_derivatives_are_nan(
        text: str, t: float, jet: tuple[float | None, ...]) -> None:
    signal = Signal(Expression(value_=text))
    want = [math.nan if v is None else v for v in jet]
    np.testing.assert_allclose(compiled([signal], t)[0], want, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(expected(signal, t), want[:2], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("amplitude", "t", "value", "rate"), [
    (Sine(frequency=1e308), 10.0, math.nan, math.nan),
    (Expression(value_="(0 - 2)^(1e200*1e200*t)"), 1.0, math.nan, math.nan),
    (Expression(value_="t^-1"), 1e-200, 1e200, math.nan),
    (Expression(value_="sin(t)^t"), 1e-241, 1.0, 1.0 + math.log(1e-241)),
    (Table(t=(0.0, 2e-170), value_=(0.0, 1e-170), smooth=True), 1e-170, 0.5e-170, 0.75),
    (Table(t=(0.0, 1e-300, 3e-300), value_=(0.0, 1e100, 2e100), smooth=True), 2e-300, math.nan, math.nan),
], ids=["sine", "whole part", "slope of a power", "curvature of a power", "short table", "steep table"])
def test_numbers_at_the_limits_of_floating_point_are_the_same_in_compiled_code(
        amplitude: Amplitude, t: float, value: float, rate: float) -> None:
    signal = Signal(amplitude)
    assert expected(signal, t) == pytest.approx((value, rate), rel=1e-12, nan_ok=True)
    assert tuple(compiled([signal], t)[0, :2]) == pytest.approx((value, rate), rel=1e-12, nan_ok=True)


def test_a_missing_value_does_not_affect_other_signals() -> None:
    signals = [Signal(Expression(value_="1 + (2 if 1/t > 2 else 3)")), Signal(Sine(frequency=1.0)), Signal()]
    table = programs(signals)
    out = np.zeros((3, 3))
    for t in (0.0, 0.25):
        evaluate(table, t, out)
        assert np.isnan(out[0]).all() == (t == 0)
        np.testing.assert_allclose(out[1:, 0], [math.sin(2 * math.pi * t), 1.0], atol=1e-15)
        np.testing.assert_array_equal(out[2], (1, 0, 0))


def test_no_signals_are_evaluated_without_error() -> None:
    assert compiled([], 0.5).shape == (0, 3)


OPERANDS = st.sampled_from(["t", "pi", "0.5", "2", "3", "t^2"])
FORMULAS = st.recursive(OPERANDS, lambda inner: st.one_of(
    st.tuples(inner, st.sampled_from("+-*/^<>"), inner).map(lambda p: f"(({p[0]}) {p[1]} ({p[2]}))"),
    st.tuples(st.sampled_from(["sin", "cos", "exp", "sqrt", "abs", "-"]), inner).map(lambda p: f"{p[0]}({p[1]})"),
    st.tuples(inner, inner, inner, inner).map(lambda p: f"({p[0]} if {p[1]} < {p[2]} else {p[3]})"),
    st.tuples(inner, inner, inner).map(lambda p: f"({p[0]} <= {p[1]} != {p[2]})")), max_leaves=12)


def test_roots_of_the_smallest_numbers_have_a_rate() -> None:
    """The product of such a number and its root is zero, so neither may divide by it."""
    t = 2.2250738585e-313
    signal = Signal(Expression(value_="sqrt(t)"))
    value, rate = expected(signal, t)
    assert (value, rate) == pytest.approx((math.sqrt(t), 0.5 / math.sqrt(t)), rel=1e-14)
    np.testing.assert_allclose(compiled([signal], t)[0, :2], (value, rate), rtol=1e-14)


@settings(max_examples=150, deadline=None)
@given(FORMULAS, st.floats(-2, 3))
def test_any_formula_is_the_same_in_compiled_code(text: str, t: float) -> None:
    """If its value is far from the largest numbers, where intermediate results may overflow in one of them."""
    signal = Signal(Expression(value_=text))
    value, rate = expected(signal, t)
    found = compiled([signal], t)[0]
    if abs(value) < 1e100:
        assert found[0] == pytest.approx(value, rel=1e-11, abs=1e-12)
    if abs(rate) < 1e100 and abs(value) < 1e100:
        assert found[1] == pytest.approx(rate, rel=1e-9, abs=1e-12)
    if math.isnan(value):
        assert np.isnan(found).all()


@pytest.mark.parametrize("t", INSIDE + CORNERS)
def test_the_machine_gives_the_same_without_compilation(t: float) -> None:
    signals = [Signal(a) for a in AMPLITUDES]
    table, out = programs(signals), np.zeros((len(signals), 3))
    for k in range(len(signals)):
        jets.run(table, k, t, out, k)
    np.testing.assert_allclose(out, compiled(signals, t), rtol=1e-13, atol=1e-13)


def test_constants_need_only_their_numbers() -> None:
    """Scaled and shifted numbers are constant, and the same in both kernels; time-dependent signals are not."""
    signals = [Signal(None), Signal(None, -2.0, 0.5), Signal(Constant(scale=-3.0), 4.0, 1.0)]
    found = np.full((3, 3), np.nan)
    assert are_constant(programs(signals).values)
    evaluate_constants(programs(signals), 0.7, found)
    np.testing.assert_array_equal(found, compiled(signals, 0.7))
    np.testing.assert_array_equal(found[:, 0], [1.0, -1.5, -11.0])
    for amplitude in AMPLITUDES[2:]:
        constant = isinstance(amplitude, Expression) and amplitude.value_ == "pi"
        assert are_constant(programs([signals[0], Signal(amplitude)]).values) == constant
