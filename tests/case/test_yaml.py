"""YAML is read into plain data only, with the position of every value."""

import pytest

from ancf2d.case import load_case, load_case_text
from ancf2d.case.compose import MAX_BYTES, compose
from ancf2d.case.nodes import Origin, plain_data
from ancf2d.errors import CaseError

CASE = """\
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section:
      height: 0.1
      width: 0.1
    material: {E: 2.07e11, nu: 0.3}
    element: {type: cable, count: 2}
solver: {type: linear_static}
boundary_conditions:
  - type: pin
    at: beam@0
  - {type: roller, at: beam@1, fixed: y}
"""


def read(text):
    return compose(text, Origin("f", text.split("\n")))


def test_plain_data():
    text = "a: [1, 1e3, x, 'y', \"1\", null, true]\nb: {c: }\n"
    assert plain_data(read(text)) == {
        "a": [1, 1000.0, "x", "y", "1", None, True], "b": {"c": None}}


@pytest.mark.parametrize(("path", "place"), [
    (("bodies", "beam", "section", "height"), (5, 15)),
    (("bodies", "beam", "section"), (4, 5)),
    (("bodies", "beam", "geometry", "end", 0), (3, 49)),
    (("boundary_conditions", 1, "fixed"), (13, 39)),
    (("boundary_conditions", 0), (11, 5)),
    (("bodies", "beam", "section", "absent", "below"), (4, 5)),
    (("boundary_conditions", 7), (11, 3)),
    (("nothing",), (1, 1)),
    ((), (1, 1))])
def test_position_of_a_value_or_its_parent(path, place):
    source = load_case_text(CASE, "c.yaml").source
    problem = source.problem(path, "message", "this", "that")
    assert (problem.line, problem.column) == place
    assert (problem.file, problem.path, problem.expected, problem.near) == (
        "c.yaml", path, "this", "that")
    assert problem.source_line == CASE.split("\n")[place[0] - 1]


def test_position_of_a_key():
    source = load_case_text(CASE).source
    assert source.key_mark(("solver", "type"))[1:] == (9, 10)
    assert source.key_mark(("boundary_conditions", 1))[1:] == (13, 5)


@pytest.mark.parametrize("line_break", ["\n", "\r\n", "\r", "\x85", "\u2028"])
def test_line_breaks_of_every_system(line_break):
    loaded = load_case_text(CASE.replace("\n", line_break))
    assert loaded.case == load_case_text(CASE).case
    mark = loaded.source.mark(("bodies", "beam", "element"))
    assert mark.line == 8
    assert mark.problem("").source_line == "    element: {type: cable, count: 2}"


def test_byte_order_mark(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(CASE, encoding="utf-8-sig")
    assert load_case(path).case == load_case_text("\ufeff" + CASE).case == load_case_text(CASE).case


def test_names_in_any_script():
    text = CASE.replace("beam", "балка 梁 😀").replace("section", "section")
    assert list(load_case_text(text).case.bodies) == ["балка 梁 😀"]


@pytest.mark.parametrize("text", [
    "a: &x [1]\nb: *x", "a: *undefined", "a: &b 1", "<<: {a: 1}", "a: !t 1", "a: !!python/none",
    "a: !!str 1", "!!map {a: 1}", "? {a: 1}\n: 2", "? [a]\n: 2", "a: 1\na: 2", "{a: 1, a: 1}"])
def test_refused_constructs(text):
    problems = []
    compose(text, Origin("f", text.split("\n")), problems=problems)
    assert len(problems) >= 1
    assert all(problem.line for problem in problems)


def test_an_alias_bomb_costs_nothing():
    levels = "\n".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]" for i in range(1, 30))
    with pytest.raises(CaseError, match="not supported"):
        load_case_text(f"l0: &l0 [x]\n{levels}\n")


@pytest.mark.parametrize("text", ["[" * 100000, "{a: " * 50000, "- " * 100000, "a: " + "[" * 41])
def test_depth_is_limited(text):
    with pytest.raises(CaseError):
        load_case_text(text)


def test_size_is_limited(tmp_path):
    path = tmp_path / "big.yaml"
    path.write_bytes(b"# " + b"x" * MAX_BYTES)
    with pytest.raises(CaseError, match="larger than 16 MB"):
        load_case(path)


def test_very_long_digits_are_no_number():
    with pytest.raises(CaseError, match="finite"):
        load_case_text(CASE.replace("2.07e11", "9" * 10000))


@pytest.mark.parametrize("name", ["missing.yaml", ".", "missing/below.yaml", "nul\0.yaml"])
def test_files_that_cannot_be_read(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CaseError, match="cannot read the file"):
        load_case(name)


def test_lone_surrogate():
    with pytest.raises(CaseError, match=r"U\+D800"):
        load_case_text("title: \ud800")
