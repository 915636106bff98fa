"""Problems as the terminal shows them."""

import unicodedata

import pytest

from ancf2d.errors import CaseError, Problem


def lines(source_line, column, line=12):
    return str(Problem("m", "f", line, column, source_line=source_line)).split("\n")


def test_a_complete_problem():
    assert str(Problem("m", "f", 12, 4, (), "e", "n", "a: b")) == (
        "f:12:4: error: m; expected e; did you mean 'n'?\n   12 | a: b\n      |    ^")


def test_without_a_position():
    assert str(Problem("m", "f")) == "f: error: m"
    assert str(Problem("m")) == "error: m"
    assert lines("   ", 2) == ["f:12:2: error: m"]


@pytest.mark.parametrize("before", ["a", "\ta\t", "日本", "😀 é", "\x1b[31m", "x" * 300, "\t" * 80])
def test_caret_stands_below_its_character(before):
    _, shown, caret = lines(before + "!" + "y" * 300, len(before) + 1)
    width = sum(2 if unicodedata.east_asian_width(c) in "WF" else 1
                for c in shown[: shown.index("!")])
    assert caret == " " * 6 + "|" + " " * (width - 7) + "^"


@pytest.mark.parametrize("column", [1, 50, 150, 299, 300, 301])
def test_long_lines_are_trimmed_around_the_caret(column):
    _, shown, caret = lines("x" * 300, column)
    assert len(shown) < 110
    assert len(caret) <= len(shown) + 1


def test_no_control_character_reaches_the_terminal():
    assert all(c.isprintable() for line in lines("a\x1b]0;x\x07\u202e\r", 3) for c in line)


def test_case_error_is_in_file_order():
    a, b, c = Problem("a", "f", 3, 1), Problem("b", "f", 2, 9), Problem("c", "f", 2, 1)
    assert CaseError([a, b, c]).problems == [c, b, a]
    assert str(CaseError("m")) == "error: m"
    assert CaseError(a).problems == [a]
