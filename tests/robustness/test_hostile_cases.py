"""Hostile case files: refused with an explanation, in bounded time and memory."""

from __future__ import annotations

import json
import re
import resource
import time
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from ancf2d.case import compose
from ancf2d.case.compose import MAX_BYTES
from ancf2d.errors import CaseError
from ancf2d.model.plan import MAX_BODIES, MAX_COORDINATES
from ancf2d.study.accuracy.control import check
from ancf2d.study.run import load

pytestmark = pytest.mark.slow

BEAM: dict[str, Any] = {
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                        "section": {"height": 0.5, "width": 0.1}, "material": {"E": 1e9, "nu": 0.3},
                        "element": {"type": "2d2n", "count": 2}}},
    "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": {"type": "linear_static"}}


def problems(folder: Path, content: bytes | str) -> list[str]:
    """Return the message about a case file, which must end in little memory."""
    path = folder / "case.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    memory, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        check(load(path))
    except CaseError as error:
        found = [p.message for p in error.problems]
    else:
        found = []
    assert time.process_time() - began < 60  # it ends; how fast is not for a test
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 500_000  # kB
    return found


def changed(path: str, value: Any) -> str:
    """Return the beam with one value changed."""
    data = json.loads(json.dumps(BEAM))
    *parents, last = path.split(".")
    place = data
    for name in parents:
        place = place[name]
    place[last] = value
    return json.dumps(data)


def test_a_case_of_100_mb_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "case.yaml").open("wb") as stream:
        stream.write(json.dumps(BEAM).encode() + b"\n#")
        stream.truncate(100_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(CaseError, match=f"the file is larger than {MAX_BYTES >> 20} MB"):
            load(tmp_path / "case.yaml")
        assert tracemalloc.get_traced_memory()[1] < 2 * MAX_BYTES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("content", ["1,", "{a: 1},"], ids=["scalars", "mappings"])
def test_a_file_of_very_many_values_is_read_to_the_limit(tmp_path: Path, content: str,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    assert 2 * compose.MAX_VALUES < MAX_BYTES, "a file could not be large enough"
    monkeypatch.setattr(compose, "MAX_VALUES", 20_000)
    found = problems(tmp_path, "loads: [" + content * 1_000_000)
    assert found == ["the file holds more than 20000 keys and values"]


@pytest.mark.parametrize("content", ["a: 1\n" * 100_000, "a: *b\n" * 100_000, "a: [" + "&x 1, " * 100_000 + "]",
                                     "".join(f"[{i}]: 1\n" for i in range(100_000))],
                         ids=["duplicate keys", "aliases", "anchors", "lists as keys"])
def test_reading_ends_after_many_refusals(tmp_path: Path, content: str) -> None:
    found = problems(tmp_path, content)
    refusals = [text for text in found if "unknown key" not in text and " is missing" not in text]
    assert len(refusals) == 101
    assert refusals[-1] == "too many problems; the rest of the file was not read"


def test_very_many_unknown_names_get_no_suggestions(tmp_path: Path) -> None:
    found = problems(tmp_path, json.dumps({**BEAM, **{f"lods{i}": 1 for i in range(20_000)}}))
    assert len(found) == 101
    assert "19900 more problems, not shown after the first 100" in found


def test_ten_thousand_references_to_ten_thousand_bodies(tmp_path: Path) -> None:
    data = {**BEAM, "bodies": {f"b{i}": 1 for i in range(10_000)}, "loads": [
        {"type": "force", "at": f"b{i}@1", "value": [0, 1]} for i in range(10_000)]}
    assert len(problems(tmp_path, json.dumps(data))) == 1001


def test_many_supports_of_one_point(tmp_path: Path) -> None:
    supports = [{"type": "clamp", "at": "beam@0"} for _ in range(2000)]
    assert problems(tmp_path, json.dumps({**BEAM, "boundary_conditions": supports})) == []


def chain(count: int) -> dict[str, Any]:
    """Return a static case of so many bodies in a row without supports."""
    body = BEAM["bodies"]["beam"]
    bodies = {f"b{i}": {**body, "geometry": {"type": "line", "start": [i, 0], "end": [i + 1, 0]}} for i in range(count)}
    return {"bodies": bodies, "solver": {"type": "static"}}


def test_three_hundred_unconstrained_motions(tmp_path: Path) -> None:
    found = problems(tmp_path, json.dumps(chain(100)))
    assert len(found) == 300
    assert all(text.startswith("'b") and " is free to " in text for text in found)


def test_more_bodies_than_can_be_checked(tmp_path: Path) -> None:
    assert problems(tmp_path, json.dumps(chain(MAX_BODIES + 1))) == [f"there are {MAX_BODIES + 1} bodies"]


def test_a_goal_beyond_unreadable_modes_among_many_problems(tmp_path: Path) -> None:
    data = {**BEAM, "loads": [1] * 200, "solver": {"type": "eigen", "modes": []},
            "goal": {"kind": "bending", "number": 3}}
    found = problems(tmp_path, json.dumps(data))
    assert sum(text.startswith("loads.") for text in found) == 200
    assert "solver.modes must be a whole number >= 1, got an empty list" in found


def test_an_alias_bomb_is_refused_where_it_begins(tmp_path: Path) -> None:
    rows = ["a0: &a0 [1, 1]", *(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60))]
    found = [text for text in problems(tmp_path, "\n".join(rows)) if "unknown key" not in text]
    assert found[0].startswith("the anchor &a0 is not supported")


@pytest.mark.parametrize(("path", "value", "said"), [
    ("bodies.beam.element.count", 10**9, "6000000000 nodal coordinates"),
    ("bodies.beam.element.count", MAX_COORDINATES // 6 + 1, "32000004 nodal coordinates"),
    ("bodies.beam.geometry.end", [1.7e308, 1.7e308], "too large or too small"),
    ("bodies.beam.geometry.end", [5e-324, 0], "too large or too small"),
    ("bodies.beam.geometry.end", [1e154, 0], "too large or too small"),
    ("bodies.beam.geometry.end", [1e-150, 0], "too large or too small"),
    ("bodies.beam.section.height", 1e200, "too large or too small"),
    ("bodies.beam.section", {"A": 1e300, "I": 1e-300, "height": 1}, "too large or too small"),
    ("bodies.beam.geometry.end", [1e-9, 0], "cannot be computed in floating-point numbers"),
    ("bodies.beam.geometry", {"type": "polyline", "points": [[-1e308, 0], [0, 0], [1e308, 0]]},
     "too large or too small"),
    ("bodies.beam.geometry", {"type": "arc", "center": [0, 0], "radius": 5e-324, "from": 0, "to": 1},
     "too large or too small")])
def test_sizes_beyond_floating_point(tmp_path: Path, path: str, value: Any, said: str) -> None:
    found = problems(tmp_path, changed(path, value))
    assert len(found) == 1
    assert said in found[0]


def test_a_rigid_body_whose_mass_overflows(tmp_path: Path) -> None:
    rigid = {**BEAM["bodies"]["beam"], "element": {"type": "rigid"}, "section": {"height": 1e3, "width": 1e3},
             "material": {"E": 1e9, "nu": 0.3, "rho": 1e305}}
    found = problems(tmp_path, json.dumps({
        "bodies": {"beam": rigid}, "boundary_conditions": [{"type": "pin", "at": "beam@0"}],
        "solver": {"type": "dynamic", "t_end": 1, "tolerance": 1e-3}}))
    assert len(found) == 1
    assert "too large or too small" in found[0]


@pytest.mark.parametrize(("encoding", "said"), [
    ("utf-16", "the file is not UTF-8 text but UTF-16"), ("utf-32", "the file is not UTF-8 text but UTF-16"),
    ("utf-16-le", "not valid YAML: the control character U+0000 is not allowed"),
    ("cp037", "the file is not UTF-8 text"), ("utf-8-sig", None), ("utf-8", None)])
def test_encodings(tmp_path: Path, encoding: str, said: str | None) -> None:
    found = problems(tmp_path, json.dumps({"title": "Balken", **BEAM}).encode(encoding))
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


ODD_VALUES = {"!eight 8": "the tag '!eight'", "*eight": "the alias *eight", "&a 8": "the anchor &a",
              "[!x 1, 2]": "the tag '!x'", "{a: *b}": "the alias *b", "{<<: {a: 1}}": "the merge key <<"}
# much that is checked between values: mass for gravity and motion, goals and what they name, joints and their bodies
SCENES = [json.dumps({
    **BEAM, "loads": [{"type": "gravity", "value": [0, -1]}, {"type": "force", "at": "beam@1", "value": [0, 1]}],
    "solver": solver, "goal": goal, "output": {"probes": {"tip": "beam@1"}}, "accuracy": 1e-3}) for solver, goal in (
    ({"type": "dynamic", "t_end": 1.0, "dt": 0.1}, {"probe": "tip", "quantity": "uy"}),
    ({"type": "eigen", "modes": 3}, {"kind": "bending", "number": 4}),
    ({"type": "static", "method": "arc_length", "until": {"limit_points": 2}}, {"limit_point": 3}))]


@pytest.mark.parametrize("odd", ODD_VALUES)
@pytest.mark.parametrize("scene", SCENES, ids=["motion", "modes", "path"])
def test_a_value_of_an_unknown_kind_is_reported_anywhere(tmp_path: Path, scene: str, odd: str) -> None:
    for place in re.finditer(r'(?<=": )("[^"]*"|[-\d.e]+|\[[^][]*\])', scene):
        found = problems(tmp_path, scene[:place.start()] + odd + scene[place.end():])
        assert any(text.startswith(ODD_VALUES[odd]) for text in found), place


@pytest.mark.parametrize(("key", "value", "said"), [
    ("solver.t_end", 5e-324, "solver.t_end is too small"), ("solver.t_end", 1e308, "solver.t_end is too large"),
    ("solver.dt", 1e-300, "solver.dt is 1e-300"), ("solver.dt", 1e-16, "solver.dt is 1e-16"),
    ("output.interval", 1e-300, "output.interval is too small"),
    ("output.interval", 1e-9, "output.interval is too small"),
    ("output.interval", 1e300, "output.interval is too large")])
def test_times_beyond_floating_point(tmp_path: Path, key: str, value: float, said: str) -> None:
    motion = json.loads(json.dumps({**BEAM, "solver": {"type": "dynamic", "t_end": 1.0, "dt": 0.1}, "output": {}}))
    motion["bodies"]["beam"]["material"]["rho"] = 1.0
    part, _, name = key.partition(".")
    motion[part][name] = value
    found = problems(tmp_path, json.dumps(motion))
    assert found[0].startswith(said), found
