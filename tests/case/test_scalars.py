"""Plain scalars as in YAML 1.2, and numbers as physicists write them."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case.emit import number_text
from ancf2d.case.nodes import resolve


@pytest.mark.parametrize(("text", "value"), [
    ("1e3", 1000.0), ("1.0e3", 1000.0), ("2.07e11", 2.07e11), ("1e-3", 1e-3), ("+1.5e3", 1500.0),
    ("1E+3", 1000.0), ("1.", 1.0), (".5", 0.5), ("-.5e1", -5.0), ("-0.0", -0.0), ("6.", 6.0)])
def test_floats(text, value):
    assert isinstance(resolve(text), float)
    assert resolve(text) == value


@pytest.mark.parametrize(("text", "value"), [
    ("1000", 1000), ("-7", -7), ("+7", 7), ("0123", 123), ("00", 0)])
def test_whole_numbers_are_decimal(text, value):
    assert isinstance(resolve(text), int)
    assert resolve(text) == value


@pytest.mark.parametrize("text", [
    "on", "off", "yes", "no", "y", "n", "True1", "12:30:45", "1:30", "2026-11-20", "1_000", "0x1F",
    "0o17", "0b1", "1e", "e3", "1.5.2", "1,5", "1e3.5", "nan", "inf", "+", "-", ".", "--1",
    "1e3 Pa", "½", "٣", "１"])
def test_other_scalars_are_text(text):
    assert resolve(text) == text


@pytest.mark.parametrize(("text", "value"), [
    ("true", True), ("True", True), ("FALSE", False), ("false", False), ("null", None),
    ("~", None), ("", None), ("Null", None)])
def test_constants(text, value):
    assert resolve(text) is value


@pytest.mark.parametrize("text", [".inf", "-.Inf", "+.INF", "1e999", "-1e999", "9" * 5000])
def test_beyond_the_range_of_doubles(text):
    assert math.isinf(resolve(text))


def test_not_a_number():
    assert math.isnan(resolve(".nan"))


@given(st.floats(allow_nan=False, allow_infinity=False))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_numbers_written_read_back_to_the_last_bit(value):
    back = float(resolve(number_text(value)))
    assert back == value
    assert math.copysign(1, back) == math.copysign(1, value)


@pytest.mark.parametrize(("value", "text"), [
    (2.07e11, "2.07e11"), (8.0, "8"), (0.1, "0.1"), (-9.6061e-5, "-9.6061e-5"), (1e6, "1e6"),
    (123456.0, "123456")])
def test_numbers_are_written_as_people_write_them(value, text):
    assert number_text(value) == text
