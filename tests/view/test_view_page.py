"""The interactive page: its data are the states, it is self-contained and small, and a browser runs it."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from synthetic import HEADER, bent_beam, coordinates, mechanism, table_file, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.plot import modes
from ancf2d.results import ResultWriter, open_results
from ancf2d.results.export import export
from ancf2d.results.symbols import symbols_of, tendons_of, tracks_of
from ancf2d.study.run import load, run_case
from ancf2d.view import make_page

CASES = Path(__file__).parents[2] / "cases"


def embedded(html: str) -> dict[str, Any]:
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', html, re.S)
    return json.loads(text)


def decoded(data: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return the reference (points, 2) and displacements (frames, points, 2) of a page's data."""
    reference = np.frombuffer(base64.b64decode(data["reference"]), "<f4").reshape(-1, 2)
    moves = np.frombuffer(base64.b64decode(data["moves"]), "<i2").reshape(len(data["t"]), -1, 2)
    return reference, moves * data["step"]


RIDE = {
    "bodies": {"road": {"geometry": {"type": "line", "start": [0, 0], "end": [4, 0]}, "element": {"type": "rigid"},
                        "section": {"EA": 1, "kGA": 1, "EI": 1, "rhoA": 2, "rhoI": 0}}},
    "boundary_conditions": [{"type": "pin", "at": "road@0"}],
    "loads": [{"type": "gravity", "value": [0, 3]},
              {"type": "force", "at": {"on": "road", "s": {"type": "expression", "value": "1.5*t - 0.2"}},
               "value": [0, -2]}],
    "springs": [{"type": "translational", "stiffness": 1,
                 "between": [[0, 3], {"on": "road", "s": {"type": "ramp", "t1": 1}}]}],
    "solver": {"type": "dynamic", "t_end": 1, "tolerance": 1e-4, "estimate": False}, "output": {"interval": 0.1}}


def test_a_file_of_buckling_without_modes_shows_its_state(tmp_path: Path) -> None:
    """A transverse load has no critical factor; figures do not offer modes."""
    text = """
bodies: {beam: {geometry: {type: line, start: [0, 0], end: [2, 0]}, section: {height: 0.1, width: 0.1},
                material: {E: 2e11, nu: 0.3}, element: {type: reissner3, count: 4}}}
boundary_conditions: [{type: clamp, at: beam@0}]
loads: [{type: force, at: beam@1, value: [0, -1]}]
solver: {type: buckling}
"""
    (tmp_path / "bent.yaml").write_text(text)
    run_case(load(tmp_path / "bent.yaml"), str(tmp_path / "bent.h5"))
    with open_results(tmp_path / "bent.h5") as results:
        assert embedded(make_page(results).html)["kind"] == "load"
        assert modes.MODES.missing(results) == "it holds no modes (solver eigen or buckling)"


def test_moving_loads_are_drawn_in_position(tmp_path: Path) -> None:
    """In figures and on pages, with magnified displacements, and not at all off the body."""
    (tmp_path / "ride.yaml").write_text(json.dumps(RIDE))
    run_case(load(tmp_path / "ride.yaml"), str(tmp_path / "ride.h5"))
    with open_results(tmp_path / "ride.h5") as results:
        assert tracks_of(results) == {"loads.1.at": pytest.approx(1.5 * results.t - 0.2),
                                      "springs.0.between.1": pytest.approx(results.t)}
        for k, t in enumerate(results.t):
            drawn = {s.kind: s for s in symbols_of(results, k, 3.0)}
            for kind, s in (("force", 1.5 * t - 0.2), ("spring", t)):
                assert (kind in drawn) == (-1e-9 <= s <= 1 + 1e-9)
                if kind in drawn:
                    at = np.array([min(s, 1.0)])
                    wanted = results.reference("road", at) + 3.0 * results.displacement("road", at, k)
                    np.testing.assert_allclose(drawn[kind].points[-1], wanted[0], atol=1e-9)
        data = embedded(make_page(results).html)
        reference, moves = decoded(data)
        ways = {w["point"]: np.frombuffer(base64.b64decode(w["way"]), "<f4").reshape(-1, 2) for w in data["ways"]}
        spring, force = (s["first"] for s in data["symbols"] if s["kind"] in ("spring", "force"))
        for point, s in ((spring + 1, results.t), (force, 1.5 * results.t - 0.2)):
            on = (s >= -1e-9) & (s <= 1 + 1e-9)
            assert (np.isfinite(ways[point][:, 0]) == on).all()
            for k in np.flatnonzero(on).tolist():
                at = np.clip(s[k:k + 1], 0, 1)
                place, move = results.reference("road", at)[0], results.displacement("road", at, k)[0]
                np.testing.assert_allclose(reference[point] + ways[point][k], place, atol=1e-5)
                np.testing.assert_allclose(moves[k, point], move, atol=data["step"])


def test_the_data_are_the_states_of_the_file(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        data = embedded(make_page(results).html)
        reference, moves = decoded(data)
        assert data["t"] == pytest.approx(results.t)
        assert [b["name"] for b in data["bodies"]] == ["crank", "rod"]
        largest = np.abs(moves).max()
        for body in data["bodies"]:
            half = body["elements"] * body["samples"]
            for i in (0, 17, 40):
                faces = results.faces(body["name"], i)
                where = [faces["bottom"].reshape(-1, 2), faces["top"].reshape(-1, 2), results.nodes(body["name"], i)]
                wanted = np.concatenate(where)
                found = (reference + moves[i])[body["first"]:body["first"] + 2 * half + body["nodes"]]
                np.testing.assert_allclose(found, wanted, atol=largest / 32767 + 1e-6)


def test_probes_come_with_the_row_of_each_state(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        data = embedded(make_page(results).html)
    found = next(p for p in data["probes"] if (p["probe"], p["quantity"]) == ("end", "uy"))
    values = np.frombuffer(base64.b64decode(found["values"]), "<f8")
    series = data["series"][found["series"]]
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(series["rows"]), "<f4"), np.arange(41))
    with open_results(tmp_path / "a.h5") as results:
        np.testing.assert_array_equal(values, results.probes["end"]["uy"])
        assert found["units"] == "m"


FRAME = {
    "title": "A beam under its weight and a force",
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                        "section": {"height": 0.2, "width": 0.1}, "material": {"E": 2e9, "nu": 0.3, "rho": 8000},
                        "element": {"type": "reissner3", "count": 4}}},
    "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
    "springs": [{"type": "translational", "between": ["beam@1", [2, -1]], "stiffness": 1e4}],
    "loads": [{"type": "gravity", "value": [0, -9.81]}, {"type": "follower_force", "at": "beam@1", "value": [0, -2e4]}],
    "solver": {"type": "static", "steps": 3},
    "goal": {"probe": "tip", "quantity": "theta"},
    "output": {"probes": {"middle": "beam@0.5", "tip": "beam@1"}, "fields": ["stress", "M"]},
}


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the result file of FRAME."""
    folder = tmp_path_factory.mktemp("frame")
    (folder / "frame.yaml").write_text(json.dumps(FRAME))
    run_case(load(folder / "frame.yaml"), str(folder / "frame.h5"))
    return folder / "frame.h5"



GUIDED: dict[str, Any] = {
    "bodies": {"a": {"geometry": {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": 1.5},
                     "section": {"height": 0.2, "width": 0.05}, "material": {"E": 1e7, "nu": 0.3},
                     "element": {"type": "reissner3", "count": 8}}},
    "boundary_conditions": [{"type": "clamp", "at": "a@0"}],
    "loads": [{"type": "tendon", "on": "a", "y": "0.08*cos(6*s)", "from": 0.1, "tension": 60},
              {"type": "tendon", "on": "a", "tension": 100,
               "y": {"s": [0, 0.5, 0.5, 1], "value": [-0.09, -0.09, -0.03, -0.03]}},
              {"type": "tendon", "through": [{"at": "a@0.1", "y": -0.14}, "a@1", [0.2, 0.5]], "tension": 10}],
    "solver": {"type": "linear_static"}}


def test_tendons_are_drawn_where_they_run(tmp_path: Path) -> None:
    """Guides by expression and with a jump too, in figures, pages and ParaView: y on an arc is a smaller radius."""
    (tmp_path / "a.yaml").write_text(json.dumps(GUIDED))
    run_case(load(tmp_path / "a.yaml"), str(tmp_path / "a.h5"))
    with open_results(tmp_path / "a.h5") as results:
        wavy, stepped, laced = tendons_of(results, None)
        s = np.arctan2(wavy[:, 1], wavy[:, 0]) / 1.5
        assert s[[0, -1]] == pytest.approx([0.1, 1.0], abs=1e-3)
        # the direction of the axis at its ends is that of a chord
        np.testing.assert_allclose(np.hypot(*wavy.T), 1 - 0.08 * np.cos(6 * s), atol=1e-3)
        radii = np.hypot(*stepped.T)
        np.testing.assert_allclose(np.sort(radii), [1.03] * (len(radii) // 2) + [1.09] * (len(radii) // 2), atol=1e-3)
        np.testing.assert_allclose(laced, [[1.14 * np.cos(0.15), 1.14 * np.sin(0.15)], [np.cos(1.5), np.sin(1.5)],
                                           [0.2, 0.5]], atol=1e-3)
        data = embedded(make_page(results).html)
        reference, moves = decoded(data)
        firsts = [symbol["first"] for symbol in data["symbols"] if symbol["kind"] == "tendon"]
        for state, shown in ((None, reference), (-1, reference + moves[-1])):
            drawn = [symbol.points for symbol in symbols_of(results, state, 1.0) if symbol.kind == "tendon"]
            np.testing.assert_allclose([shown[k:k + 2] for k in firsts], drawn, atol=1e-5)
        export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
        last = tendons_of(results, -1)
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        grid = file["VTKHDF"]
        written, whose = grid["Points"][:], grid["PointData/body"][:]
    np.testing.assert_allclose(written[-len(whose):][whose == -2, :2], np.vstack(last))

def test_symbols_move_and_turn_with_their_bodies(frame: Path) -> None:
    with open_results(frame) as results:
        data = embedded(make_page(results).html)
        tip = results.reference("beam", np.array([1.0])) + results.displacement("beam", np.array([1.0]), -1)
        theta = results.probes["tip"]["theta"][-1]
    reference, moves = decoded(data)
    last, tolerance = reference + moves[-1], 1e-4
    symbols = {s["kind"]: s for s in data["symbols"]}
    assert list(symbols) == ["clamp", "spring", "gravity", "force"]
    np.testing.assert_allclose(last[symbols["clamp"]["first"]], [0, 0], atol=tolerance)
    spring = symbols["spring"]["first"]
    np.testing.assert_allclose(last[spring:spring + 2], [*tip, [2, -1]], atol=tolerance)
    force = symbols["force"]
    turned = [np.arctan2(*(p[force["arm"]] - p[force["first"]])[::-1]) for p in (reference, last)]
    # the axis turns like the section but for shear
    assert turned[1] - turned[0] == pytest.approx(theta, abs=0.02)
    assert symbols["gravity"]["angle"] == pytest.approx(-np.pi / 2)
    assert set(data["outlines"]) == {"clamp", "gravity", "force"}


def test_fields_are_those_of_the_file(frame: Path) -> None:
    """The stress at the lower face, the axis and the upper face of the first station, as stored there."""
    with open_results(frame) as results:
        data = embedded(make_page(results).html)
        stress, M = results.field("beam", "stress", -1), results.field("beam", "M", -1)
    names = [f["name"] for f in data["fields"]]
    assert names == ["stress along the axis, σ_xx", "stress across the axis, σ_yy", "shear stress, σ_xy",
                     "von Mises stress", "bending moment M"]
    for k, wanted in ((0, stress[0, 0, [0, 2, 4], 0]), (4, M[0, 0, :, 0])):
        field = data["fields"][k]
        codes = np.frombuffer(base64.b64decode(field["values"]), "u1").reshape(len(field["frames"]), -1)
        values = field["low"] + (codes - 1) / 254 * (field["high"] - field["low"])
        np.testing.assert_allclose(values[-1, :len(wanted)], wanted, atol=field["high"] / 200)
        assert field["frames"] == [0, 1, 2, 3]
        assert field["low"] == -field["high"]


def test_the_curve_is_that_of_the_goal_and_traces_are_those_of_probes(frame: Path) -> None:
    with open_results(frame) as results:
        data = embedded(make_page(results).html)
        uy = results.probes["tip"]["uy"]
    chosen = data["probes"][data["goal"]]
    assert (chosen["probe"], chosen["quantity"]) == ("tip", "theta")
    assert {p["probe"] for p in data["probes"]} == {"middle", "tip", "energy"}
    way = next(w for w in data["traces"] if w["probe"] == "tip")
    assert way["start"] == pytest.approx([2, 0])
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(way["uy"]), "<f4"), uy, rtol=1e-6)


@pytest.mark.parametrize("taken", ["tip", "beside"])
def test_the_curve_of_a_reaction_is_its_history(tmp_path: Path, taken: str) -> None:
    """It starts at zero, ends at the printed reaction, and has its own name next to a probe of the same."""
    case = {**FRAME, "boundary_conditions": [{"name": "tip", "type": "clamp", "at": "beam@0"}],
            "goal": {"reaction": "tip", "quantity": "fy"}, "output": {"probes": {taken: "beam@1"}}}
    (tmp_path / "a.yaml").write_text(json.dumps(case))
    summary = run_case(load(tmp_path / "a.yaml"), str(tmp_path / "a.h5")).summary
    with open_results(tmp_path / "a.h5") as results:
        data = embedded(make_page(results).html)
    chosen = data["probes"][data["goal"]]
    assert (chosen["probe"], chosen["quantity"], chosen["units"]) == (
        "reaction tip" if taken == "tip" else "tip", "fy", "N")
    values = np.frombuffer(base64.b64decode(chosen["values"]), "<f8")
    assert (len(values), values[0]) == (4, pytest.approx(0.0, abs=1e-6))
    assert values[-1] == pytest.approx(summary["reactions"]["tip"]["fy"], rel=1e-12)


@pytest.mark.slow
def test_many_long_probes_do_not_exceed_the_size_of_a_page(tmp_path: Path) -> None:
    x = np.array([0.0, 2.0])
    e0 = coordinates("tangent", x, 0.0)
    with ResultWriter(tmp_path / "a.h5", {**HEADER, "solver": "dynamic"}, [tangent_body("b", 1, 2.0, 0.1)], e0) as w:
        for k in range(2000):
            probes = {f"p{i}": {q: np.sin(k / 100 + i) for q in ("x", "y", "ux", "uy", "vx", "vy")} for i in range(30)}
            w.append(k / 100, coordinates("tangent", x, k / 2000) - e0, None, probes)
        w.finish({})
    with open_results(tmp_path / "a.h5") as results:
        html = make_page(results).html
    assert len(html) < 5e6
    data = embedded(html)
    found = data["probes"][7]
    series = data["series"][found["series"]]
    rows = np.frombuffer(base64.b64decode(series["rows"]), "<f4")
    values = np.frombuffer(base64.b64decode(found["values"]), "<f8")
    shown = np.interp(rows, np.arange(len(values)), values)
    np.testing.assert_allclose(shown, np.sin(np.array(data["t"]) + 1), atol=1e-3)


def test_a_displacement_too_small_to_see_is_magnified_by_a_power_of_ten(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5", angle=1e-5)) as results:
        data = embedded(make_page(results).html)
    assert data["magnify"] == 1e4
    _, moves = decoded(data)
    assert np.abs(moves[-1]).max() == pytest.approx(1e-5, rel=1e-3)  # what is stored is not magnified


def test_modes_are_animated_with_names(tmp_path: Path) -> None:
    run_case(load(CASES / "paper" / "table3_2d2n.yaml", ["solver.modes=3"]), str(tmp_path / "m.h5"))
    with open_results(tmp_path / "m.h5") as results:
        data = embedded(make_page(results).html)
    assert data["kind"] == "modes"
    assert data["modes"][0] == "bending 1: 93.4003 rad/s (14.865 Hz)"
    _, moves = decoded(data)
    np.testing.assert_allclose(np.linalg.norm(moves, axis=-1).max(axis=1), 0.12 * data["extent"], rtol=1e-3)


DAMPED = {
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                        "section": {"EA": 1e5, "kGA": 1e5, "EI": 1.0, "rhoA": 1.0},
                        "element": {"type": "cable", "count": 4}}},
    "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
    "springs": [{"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 1, "damping": 0.3}],
    "solver": {"type": "eigen", "modes": 2},
}


def test_damped_modes_are_animated_with_both_phases(tmp_path: Path) -> None:
    (tmp_path / "d.yaml").write_text(json.dumps(DAMPED))
    run_case(load(tmp_path / "d.yaml"), str(tmp_path / "d.h5"))
    with open_results(tmp_path / "d.h5") as results:
        data = embedded(make_page(results).html)
        parts = np.array([results.array("modes/shapes"), results.array("modes/quarter")])
    tip = np.abs(parts[:, :, -3])  # y of the last node
    assert data["turning"]
    assert "decays with" in data["modes"][0]
    moves = np.frombuffer(base64.b64decode(data["moves"]), "<i2").reshape(2, 2, -1, 2) * data["step"]
    body = data["bodies"][0]
    last = body["elements"] * body["samples"] - 1  # the lower corner of the tip
    shares = moves[1, :, last, 1] / moves[0, :, last, 1]
    np.testing.assert_allclose(np.abs(shares), tip[1] / tip[0], atol=1e-3)
    assert np.linalg.norm(moves, axis=-1).max() == pytest.approx(0.12 * data["extent"], rel=1e-3)


def test_a_linear_solution_grows_from_rest(tmp_path: Path) -> None:
    run_case(load(CASES / "paper" / "table1_2d2n.yaml"), str(tmp_path / "l.h5"))
    with open_results(tmp_path / "l.h5") as results:
        data = embedded(make_page(results).html)
        assert data["t"] == [0.0, 1.0]
        _, moves = decoded(data)
        assert not moves[0].any()
        largest = np.abs(results.faces(data["bodies"][0]["name"])["top"] - results.faces(
            data["bodies"][0]["name"], None)["top"]).max()
        assert np.abs(moves[1]).max() == pytest.approx(largest, rel=1e-2)


def test_a_page_of_one_state_says_so(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        w.append(0.0, 0 * e0, {})
        w.finish()
    with open_results(tmp_path / "a.h5") as results:
        assert make_page(results).remark.startswith("its only state, ")


def test_nothing_is_loaded_from_elsewhere_and_names_are_text(tmp_path: Path) -> None:
    header = {"title": "</script><script>alert(1)</script> & more"}
    with open_results(bent_beam(tmp_path / "a.h5", header=header)) as results:
        html = make_page(results).html
    assert not re.search(r"(src|href)=[\"'](?!data:)|@import|https?://", html)
    assert html.count("</script>") == 2
    assert "default-src 'none'" in html
    assert embedded(html)["title"] == header["title"]
    assert "{{" not in html.split('id="data"')[0]


@pytest.mark.parametrize("title", ["{{DATA}}", "{{SCRIPT}}", "{{TITLE}} {{STYLE}} \\1"])
def test_a_title_that_looks_like_a_placeholder_is_shown_unchanged(tmp_path: Path, title: str) -> None:
    with open_results(bent_beam(tmp_path / "a.h5", header={"title": title})) as results:
        html = make_page(results).html
    assert f"<title>{title}</title>" in html
    assert embedded(html)["title"] == title
    assert html.count("</script>") == 2


def long_run(path: Path, states: int, ne: int) -> Path:
    x = np.linspace(0, 2, ne + 1)
    e0 = coordinates("tangent", x, 0.0)
    with ResultWriter(path, {**HEADER, "solver": "dynamic"}, [tangent_body("beam", ne, 2.0, 0.1)], e0) as w:
        for k in range(states):
            w.append(k / states, coordinates("tangent", x, k / states) - e0, None, {"tip": {"uy": k / states}})
        return w.finish({})


@pytest.mark.slow
@pytest.mark.parametrize(("states", "ne"), [(3000, 40), (40, 20_000)])
def test_a_page_stays_below_five_megabytes_and_names_omitted_data(tmp_path: Path, states: int, ne: int) -> None:
    with open_results(long_run(tmp_path / "a.h5", states, ne)) as results:
        page = make_page(results)
    assert len(page.html) < 5e6
    data = embedded(page.html)
    _, moves = decoded(data)
    assert data["t"][-1] == pytest.approx(1 - 1 / states)
    assert len(moves) == len(data["t"]) >= 40
    shown = len(data["t"])
    assert page.remark.startswith(f"{shown} of {states} states" if shown < states else f"all {states} states")


def test_a_file_without_anything_to_show_is_refused(tmp_path: Path) -> None:
    said = pytest.raises(ResultsError, match="holds no states to show")
    with open_results(table_file(tmp_path / "a.h5", {"2d2n": 2})) as results, said:
        make_page(results)
