"""Breaks of signals: all of them, of the right order, at the exact float at which the new piece begins."""

from __future__ import annotations

import math

import helpers
import numpy as np
import pytest

from ancf2d.case import Amplitude, Constant, Expression, Ramp, Sine, Table
from ancf2d.model.breakpoints import TURNS, MotionPiece, breakpoints, case_stops, jumps, motion_pieces
from ancf2d.model.timing import Signal

THIRD = 1 / 3


def formula(text: str, factor: float = 1.0) -> Signal:
    """Return an expression as a signal."""
    return Signal(Expression(value_=text), factor)


def found(signal: Signal, t1: float = 3.0) -> list[tuple[float, int]]:
    """Return time and order of each break in (0, t1]."""
    return [(b.t, b.order) for b in breakpoints(signal, 0.0, t1)]


@pytest.mark.parametrize(("amplitude", "breaks"), [
    (None, []),
    (Constant(scale=2.0), []),
    (Sine(frequency=2.0), []),
    (Ramp(t0=0.1, t1=0.5, scale=-2.0), [(0.1, 1), (0.5, 1)]),
    (Ramp(t0=-1.0, t1=5.0), []),
    (Ramp(t0=0.0, t1=3.0), [(3.0, 1)]),
    (Table(t=(1.0, 2.0), value_=(0.0, 1.0)), [(1.0, 1), (2.0, 1)]),
    (Table(t=(0.0, 1.0, 2.0, 2.5), value_=(0.0, 1.0, 2.0, 2.0)), [(2.0, 1)]),
    (Table(t=(0.5, 1.0, 2.0), value_=(0.0, 1.0, 0.5), smooth=True), [(0.5, 2), (1.0, 2), (2.0, 2)]),
    (Table(t=(0.5,), value_=(7.0,)), []),
])
def test_ramps_and_tables_break_at_their_points(amplitude: Amplitude, breaks: list[tuple[float, int]]) -> None:
    assert found(Signal(amplitude, 0.5, 10.0)) == breaks


@pytest.mark.parametrize(("text", "breaks"), [
    ("sin(t)^2/(1 + t)", []),
    ("1 if t < 0.5 else 0", [(0.5, 0)]),
    ("1 if t <= 0.5 else 0", [(math.nextafter(0.5, 1), 0)]),
    ("t >= 3", [(3.0, 0)]),
    ("t < 4", []),
    ("1 if 0.5 < t < 0.5000001 else 0", [(math.nextafter(0.5, 1), 0), (0.5000001, 0)]),
    ("1 if t == 0.5 else 0", []),
    ("(t >= 1) - (t > 1)", []),
    ("1 if abs(t - 2) < 0.25 else 0", [(math.nextafter(1.75, 2), 0), (2.25, 0)]),
    ("abs(t - 1/3)", [(THIRD, 1)]),
    ("2*t if t < 1 else 2", [(1.0, 1)]),
    ("10*t if t < 0.5 else t + 4.5", [(0.5, 1)]),
    ("t^2*(3 - 2*t) if t < 1 else 1", [(1.0, 2)]),
    ("t^3 if t < 1 else 1 + 3*(t - 1) + 3*(t - 1)^2", []),
    ("sqrt(t - 1) if t >= 1 else 0", [(1.0, 1)]),
    ("t if t < 1 else (2 if t < 2 else 3*t)", [(1.0, 0), (2.0, 0)]),
    ("0*(t < 1) + (5 if t < 9 else abs(t - 2))", []),
])
def test_switches_of_expressions_are_found_to_the_last_digit(text: str, breaks: list[tuple[float, int]]) -> None:
    assert found(formula(text)) == breaks


def test_every_zero_of_a_rectified_sine_is_a_corner() -> None:
    breaks = found(formula("abs(sin(2*pi*t))"), 2.75)
    np.testing.assert_allclose([t for t, _ in breaks], [0.5, 1.0, 1.5, 2.0, 2.5], rtol=1e-15)
    assert {order for _, order in breaks} == {1}


def test_windows_shorter_than_the_samples_are_found() -> None:
    for text, window in (("1 if 0.5 < 10*t < 0.5000001 else 0", (0.05, 0.05000001)),
                         ("(t - 3.01234)^2 < 1e-12", (3.012339, 3.012341)),
                         ("1 if 0.123456 < t else 0 if t < 0.123457 else 2", (0.123456,))):
        np.testing.assert_allclose([t for t, _ in found(formula(text), 1000.0)], window, rtol=1e-12)


@pytest.mark.parametrize("text", ["1 if t < 0.7 else -1", "abs(t - 0.7)", "t^2 if t <= 0.7 else 1.4*t - 0.49"])
def test_both_sides_of_a_break_are_separate_pieces(text: str) -> None:
    signal = formula(text)
    (b,) = breakpoints(signal, 0.0, 1.0)
    h = 1e-6
    assert b.before == math.nextafter(b.t, 0)
    assert signal.rate(b.before) == pytest.approx(signal.rate(b.before - h), abs=1e-5)
    assert signal.rate(b.t) == pytest.approx(signal.rate(b.t + h), abs=1e-5)
    assert signal(b.before) == pytest.approx(signal(b.before - h), abs=1e-5)
    assert signal(b.t) == pytest.approx(signal(b.t + h), abs=1e-5)


def test_a_switch_at_the_start_is_a_jump_but_not_a_stop() -> None:
    for number in (0.0, 1e-13):
        first = math.nextafter(number, 1.0)
        assert motion_pieces([formula(f"1 if t > {number} else 0")], 1.0) == [MotionPiece(first, math.inf, 1.0)]
    assert jumps(formula("1 if t > 0 else 0"), 0.0, 1.0) == [math.nextafter(0.0, 1.0)]


def test_signals_end_before_a_switch_at_the_end() -> None:
    first = math.nextafter(0.0, 1.0)
    for text in ("1 if t < 2 else 0", "1 if t >= 2 else 0"):
        assert motion_pieces([formula(text)], 2.0) == [MotionPiece(first, math.nextafter(2.0, 0), 2.0)]
    assert motion_pieces([formula("1 if t <= 2 else 0")], 2.0) == [MotionPiece(first, math.inf, 2.0)]


@pytest.mark.parametrize("switches", [1000, pytest.param(10000, marks=pytest.mark.slow)])
def test_all_of_many_switches_are_found(switches: int) -> None:
    found = breakpoints(formula(f"1 if cos({switches}*pi*t) > 0 else 0"), 0.0, 1.0)
    np.testing.assert_allclose([b.t for b in found], (np.arange(switches) + 0.5) / switches, atol=1e-12)


def test_breaks_are_those_of_the_window() -> None:
    signal = formula("(t > 1) + (t > 2) + (t > 3)")
    assert [round(b.t, 9) for b in breakpoints(signal, 1.5, 2.5)] == [2.0]


def test_signals_scaled_to_zero_have_no_breaks() -> None:
    assert found(formula("t > 1", factor=0.0)) == found(Signal(Ramp(scale=0.0))) == []


def test_breaks_of_several_signals_that_coincide_are_one() -> None:
    signals = [Signal(Ramp(t0=0.5, t1=0.7)), formula("t <= 0.5"), formula("t < 0.5"), formula("abs(t - 0.9)")]
    low, high = math.nextafter(0.5, 0), math.nextafter(0.5, 1)
    assert motion_pieces([*signals, *signals], 1.0) == [
        MotionPiece(math.nextafter(0.0, 1.0), low, high), MotionPiece(high, math.nextafter(0.7, 0), 0.7),
        MotionPiece(0.7, math.nextafter(0.9, 0), 0.9), MotionPiece(0.9, math.inf, 1.0)]


@pytest.mark.parametrize("end", [1.7e308, 1e160, 1e-160, 5e-324])
def test_times_of_any_size_have_breaks(end: float) -> None:
    assert found(formula(f"1 if t < {end!r} else 2"), end) == [(end, 0)]
    assert found(formula(f"1 if t < {end!r} else 1"), end) == []


@pytest.mark.parametrize(("text", "stops"), [
    ("t if t < 1 else 1", [1.0]), ("0.5 if t < 1 else 0.2", [1.0]), ("(t - 1)^2", [1.0]),
    ("(t - 0.99999)^2", [0.99999]), ("2", []),
    ("(t - 0.5)*(1 - t)*(t > 0.5)*(t < 1)", [0.5, 0.75, 1.0])])
def test_steps_of_statics_end_at_turning_points_of_amplitudes(text: str, stops: list[float]) -> None:
    """A constant stretch has a stop at either end, up to the spacing of the samples."""
    bodies = {"b": helpers.body(helpers.line(1.0), helpers.element("cable", 1))}
    case = helpers.load(bodies, bc=[{"type": "clamp", "at": "b@0"}], loads=[
        {"type": "force", "at": "b@1", "value": [0, 1], "amplitude": {"type": "expression", "value": text}}]).case
    found = [b.t for b in case_stops(case, 0.0, 2.0)]
    near = 2.0 / (TURNS - 1)
    assert all(min(abs(t - stop) for stop in stops) <= near * (1 + 1e-9) for t in found)
    assert all(min(abs(t - stop) for t in found) < 1e-9 for stop in stops)
    assert len(found) <= 3 * len(stops)
