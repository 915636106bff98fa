"""Problems as the terminal shows them."""

import unicodedata

import pytest

from ancf2d.errors import CaseError, ItemName, Problem, listing


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


def of_joint(k, message="joints.{}.type must be pin, got 'pni'", line=None):
    return Problem(message.format(k), "f", 10 + k if line is None else line, 1, ("joints", k, "type"))


def test_many_problems_alike_are_listed_by_their_lines():
    texts = listing([of_joint(k) for k in (*range(10), *range(12, 15), 20)])
    assert texts == [*(str(of_joint(k)) for k in range(3)), "and 11 more like it, at lines 13-19, 22-24, 30"]


def test_four_problems_alike_are_all_shown():
    assert len(listing([of_joint(k) for k in range(4)])) == 4


def test_problems_alike_do_not_hide_others():
    others = [Problem("joints.7.type must be pin, got 'pim'", "f", 17, 1, ("joints", 7, "type")),
              Problem("loads.3.type must be pin, got 'pni'", "f", 90, 1, ("loads", 3, "type")),
              Problem("solver.steps must be > 0", "f", 91, 1, ("solver", "steps")),
              Problem("solver.tolerance must be > 0", "f", 92, 1, ("solver", "tolerance"))]
    texts = str(CaseError([*(of_joint(k) for k in range(50)), *others])).split("\n")
    assert len(texts) == 3 + 1 + len(others)
    assert [str(other) in texts for other in others] == [True] * len(others)


def test_bodies_are_alike_by_their_names_and_places_on_one_line_are_named_once():
    texts = listing([Problem(f"bodies.{name}.section is missing", "f", 5, 3 * k, ("bodies", ItemName(name), "section"))
                     for k, name in enumerate("abcdef")])
    assert texts[3:] == ["and 3 more like it, at line 5"]


def test_problems_alike_without_lines_are_listed_by_their_paths():
    assert listing([of_joint(k, line=0) for k in range(6)])[-1] == (
        "and 3 more like it, at joints.3.type, joints.4.type, joints.5.type")
    assert listing([of_joint(k, line=0) for k in range(60)])[-1].endswith(
        "joints.7.type, joints.8.type, ..., joints.59.type")
