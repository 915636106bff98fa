"""Figures of fields and section forces show the computed values."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from synthetic import bent_beam, mechanism

from ancf2d.case import load_case_text
from ancf2d.errors import ResultsError
from ancf2d.plot import draw
from ancf2d.plot.contact import Zone, Zones
from ancf2d.plot.kinds import build
from ancf2d.results import Results, open_results
from ancf2d.study.fields_of_states import StatesWithFields
from ancf2d.study.run import load_case, run_case, vocabulary

L, H, B, F = 2.0, 0.4, 0.1, -1000.0
I, A = B * H**3 / 12, B * H
CASE = """
title: Cantilever
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.4, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 4}
boundary_conditions: [{name: wall, type: clamp, at: beam@0, hold: section}]
loads: [{type: force, at: beam@1, value: [0, -1000]}]
solver: {type: linear_static}
output: {fields: [energy, stress, N, Q, M]}
"""


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Results]:
    folder = tmp_path_factory.mktemp("fields")
    (folder / "a.yaml").write_text(CASE)
    run_case(load_case(folder / "a.yaml", (), vocabulary()), str(folder / "a.h5"))
    with open_results(folder / "a.h5") as results:
        yield results



def test_supports_and_loads_are_drawn_where_they_act(bent: Results) -> None:
    """The clamp at the start of the beam, the force at its moved tip, pointing down."""
    clamp, force = build(bent, "shape", scale=100).symbols
    tip = bent.displacement("beam", np.array([1.0]))[0]
    assert (clamp.kind, force.kind) == ("clamp", "force")
    np.testing.assert_allclose(clamp.points, [[0, 0]], atol=1e-12)
    np.testing.assert_allclose(force.points, [[2, 0] + 100 * tip], atol=1e-12)
    assert (clamp.angle, force.angle) == pytest.approx((0, -np.pi / 2), abs=0.2)
    assert build(bent, "shape", symbols=False).symbols == []
    marks = [line for line in draw(bent, "shape", scale=100).axes[0].lines if line.get_clip_on() is False]
    assert len(marks) == 2


# ---------------------------------------------------------------------- fields


def test_colours_are_the_bending_stress_at_each_point(bent: Results) -> None:
    picture = build(bent, "fields", scale=1, unrolled=False)
    (surface,) = picture.surfaces
    x, y = surface.s[..., None], np.linspace(-H / 2, H / 2, 9)
    np.testing.assert_allclose(surface.values, -F * (L - x) * y / I, atol=1e-6 * abs(F) * L * H / I)
    np.testing.assert_allclose(surface.points[..., 0], np.broadcast_to(x, surface.values.shape), atol=1e-5)
    np.testing.assert_allclose(surface.points[..., 1], np.broadcast_to(y, surface.values.shape), atol=1e-4)
    top = abs(F) * L * H / 2 / I
    np.testing.assert_allclose(picture.range(), (-top, top), rtol=1e-6)


def test_signed_fields_are_white_at_zero_and_others_are_not(bent: Results) -> None:
    signed, positive = (draw(bent, "fields", **options).axes[0].collections[0]
                        for options in ({"component": "xx"}, {"component": "mises"}))
    assert signed.norm(0.0) == pytest.approx(0.5)
    np.testing.assert_allclose(signed.cmap(0.5)[:3], 1.0, atol=0.04)
    ends = np.array(signed.cmap([0.1, 0.9]))
    assert ends[0, 2] > ends[0, 0]  # blue
    assert ends[1, 0] > ends[1, 2]  # red
    assert positive.cmap.name == "cividis"


def test_the_parabola_of_shear_is_drawn_between_its_stations(bent: Results) -> None:
    (surface,) = build(bent, "fields", component="xy").surfaces
    expected = 1.5 * F / A * (1 - np.linspace(-1, 1, 9) ** 2)
    np.testing.assert_allclose(surface.values[2, 7], expected, atol=1e-6 * abs(F) / A)


def test_von_mises_stress_on_the_axis_is_that_of_shear(bent: Results) -> None:
    (surface,) = build(bent, "fields", component="mises").surfaces
    np.testing.assert_allclose(surface.values[..., 4], np.sqrt(3) * 1.5 * abs(F) / A, rtol=1e-5)


@pytest.mark.parametrize(("options", "y_label"), [({"unrolled": True}, "y, across [m]"), ({}, "y [m]")])
def test_a_field_is_labelled_with_its_units(bent: Results, options: dict[str, bool], y_label: str) -> None:
    figure = draw(bent, "fields", **options)
    axes, bar = figure.axes
    assert bar.get_xlabel() == "stress along the axis, σ_xx [Pa]"
    assert axes.get_ylabel() == y_label
    (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
    assert mesh.get_array().shape == (4 * 21, 9)


def test_rows_are_the_drawn_values(bent: Results) -> None:
    picture = build(bent, "fields", scale=1)
    rows = list(picture.rows())
    assert len(rows) == 4 * 21 * 9
    assert picture.header() == ["body", "element", "s [m]", "x [m]", "y [m]", "stress along the axis, σ_xx [N/m^2]"]
    assert rows[-1][2] == pytest.approx(L)


@pytest.mark.parametrize(("options", "words"), [
    ({"field": "strain"}, "no field 'strain' .it has energy, stress; name those to store under output"),
    ({"field": "M"}, "along the axis only; draw it as section_forces"),
    ({"component": "zz"}, "no component 'zz' .it has xx, yy, xy, mises"), ({"state": 5}, "no state 5: it holds")])
def test_unknown_fields_are_explained(bent: Results, options: dict[str, object], words: str) -> None:
    with pytest.raises(ResultsError, match=words):
        build(bent, "fields", **options)


def test_a_file_without_fields_says_how_to_store_them(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as results:
        for kind, what in (("fields", "fields: .stress."), ("section_forces", "fields: .N, Q, M.")):
            with pytest.raises(ResultsError, match=what):
                build(results, kind)


@pytest.mark.slow_rows("static")
@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_fields_are_computed_from_states_if_not_stored(tmp_path: Path, solver: str) -> None:
    """They are the fields that the run would have stored, in every state."""
    stored = CASE.replace("linear_static", solver)
    for name, text in (("stored", stored), ("bare", stored.replace("output: {fields: [energy, stress, N, Q, M]}", ""))):
        (tmp_path / f"{name}.yaml").write_text(text)
        run_case(load_case(tmp_path / f"{name}.yaml", (), vocabulary()), str(tmp_path / f"{name}.h5"))
    with open_results(tmp_path / "stored.h5") as a, StatesWithFields(tmp_path / "bare.h5") as b:
        assert not open_results(tmp_path / "bare.h5").fields
        assert set(b.fields["beam"]) == {*a.fields["beam"], "strain"}
        for name, record in a.fields["beam"].items():
            assert b.fields["beam"][name].units == record.units
            top = max(np.abs(a.field("beam", name, i)).max() for i in range(a.nt))
            for i in range(a.nt):
                np.testing.assert_allclose(b.field("beam", name, i), a.field("beam", name, i), rtol=0, atol=1e-9 * top)
        assert draw(b, "fields").axes[-1].get_xlabel() == "stress along the axis, σ_xx [Pa]"
        assert len(build(b, "section_forces").panels) == 3


HINGED = """
bodies:
  a: {geometry: {type: line, start: [0, 0], end: [1, 0.2]}, section: {height: 0.02, width: 0.02},
      material: {E: 2e9, nu: 0.3, rho: 1000, damping: {kelvin_voigt: 1e-4}},
      element: {type: vallejo, count: 3, nodes: regular}}
  b: {geometry: {type: line, start: [1, 0.2], end: [1.6, -0.1]}, section: {height: 0.02, width: 0.02},
      material: {E: 2e9, nu: 0.3, rho: 1000}, element: {type: reissner3, count: 2}}
boundary_conditions:
  - {name: hand, type: prescribed, at: a@0, x: 0, y: 0, angle: {type: expression, value: "0.3*sin(4*t)"}}
  - {type: roller, at: a@0.7, normal: [1, 2]}
joints: [{type: weld, between: [a@1, b@0]}, {type: slider, at: b@1, through: [1.6, -0.1], along: [1, 0.1]}]
springs: [{type: rotational, between: [b@1, [0, 0]], stiffness: 3, damping: 0.1}]
masses: [{at: b@0.7, mass: 0.1, inertia: 0.001}]
loads: [{type: gravity, value: [0, -9.81]},
        {type: force, at: a@0.5, value: [0, 3], amplitude: {type: table, t: [0, 0.05, 1], value: [0, 1, 1]}}]
"""
MOVING = "solver: {type: dynamic, t_end: 0.04, tolerance: 1e-9, estimate: false}\noutput: {interval: 0.02}"
FALLING = HINGED.replace("  - {type: roller, at: a@0.7, normal: [1, 2]}\n", "")


@pytest.mark.slow
@pytest.mark.parametrize(("text", "rtol"), [
    (HINGED + "solver: {type: static, steps: 4}", 1e-7), (HINGED + "solver: {type: linear_static}", 1e-9),
    (FALLING + MOVING, 1e-5)], ids=["static", "linear_static", "dynamic"])
def test_section_forces_of_motions_and_with_multipliers_are_computed_from_the_states(
        tmp_path: Path, text: str, rtol: float) -> None:
    """The necessary accelerations and multipliers follow from displacements and rates."""
    stored = text.replace("output: {", "output: {fields: [N, Q, M], ") if "output" in text else (
        text + "\noutput: {fields: [N, Q, M]}")
    for name, case in (("stored", stored), ("bare", text)):
        outcome = run_case(load_case_text(case, vocabulary=vocabulary()), str(tmp_path / f"{name}.h5"))
        assert outcome.failure is None
    assert outcome.model.constraints
    with open_results(tmp_path / "stored.h5") as a, StatesWithFields(tmp_path / "bare.h5") as b:
        for body, fields in a.fields.items():
            for name in fields:
                top = max(np.abs(a.field(body, name, i)).max() for i in range(a.nt))
                for i in range(a.nt):
                    np.testing.assert_allclose(b.field(body, name, i), a.field(body, name, i), rtol=0, atol=rtol * top)
        draw(b, "section_forces")


def test_fields_that_states_do_not_determine_are_not_offered(tmp_path: Path) -> None:
    with StatesWithFields(mechanism(tmp_path / "a.h5")) as results:
        assert results.fields == {}  # its case cannot be read


# ---------------------------------------------------------------------- section forces


def test_section_forces_of_a_cantilever_and_no_noise(bent: Results) -> None:
    N, Q, M = build(bent, "section_forces").panels
    s = M.curves[0].x
    assert s[-1] == pytest.approx(L)
    np.testing.assert_allclose(M.curves[0].y, F * (L - s), atol=1e-6 * abs(F))
    np.testing.assert_allclose(Q.curves[0].y, F, rtol=1e-6)
    assert not N.curves[0].y.any()
    assert (M.y, N.y) == (("bending moment M", "N*m"), ("axial force N", "N"))
    assert [p.y[0] for p in build(bent, "section_forces", quantity="M").panels] == ["bending moment M"]
    with pytest.raises(ResultsError, match="draws N, Q, M, not 'T'"):
        build(bent, "section_forces", quantity="T")


BRACKET = """
title: Bracket
bodies:
  column: {geometry: {type: line, start: [0, 0], end: [0, 2]}, section: {height: 0.1, width: 0.1},
           material: {E: 2.07e11, nu: 0.3}, element: {type: reissner3, count: 2}}
  arm: {geometry: {type: line, start: [0, 2], end: [1, 2]}, section: {height: 0.1, width: 0.1},
        material: {E: 2.07e11, nu: 0.3}, element: {type: reissner3, count: 2}}
boundary_conditions: [{type: clamp, at: column@0}]
joints: [{type: weld, between: [column@1, arm@0]}]
loads: [{type: force, at: arm@1, value: [0, -1000]}]
solver: {type: linear_static}
output: {fields: [N, Q, M]}
"""


def test_section_forces_are_drawn_on_the_bodies(tmp_path: Path) -> None:
    """A bracket with a force down at its tip: the arm is in tension above, the column on its left."""
    (tmp_path / "a.yaml").write_text(BRACKET)
    run_case(load_case(tmp_path / "a.yaml", (), vocabulary()), str(tmp_path / "a.h5"))
    with open_results(tmp_path / "a.h5") as results:
        picture = build(results, "section_forces")
        unrolled = build(results, "section_forces", unrolled=True).panels[2]
        figure = draw(results, "section_forces")
    column, arm = picture.found["M", "N*m"]
    np.testing.assert_allclose(column.values, -1000.0, rtol=1e-6)
    np.testing.assert_allclose(arm.values, -1000.0 * (1.0 - arm.s), atol=1e-3)
    np.testing.assert_allclose(arm.axis, np.column_stack([arm.s, 2.0 + 0 * arm.s]), atol=1e-12)
    side = -1.0  # of M, which is drawn where the tension is
    assert (arm.line(1e-4 * side)[:-1, 1] > 2.0).all()
    np.testing.assert_allclose(column.line(1e-4 * side)[:, 0], -0.1, rtol=1e-6)
    texts = {t.get_text() for axes in figure.axes for t in axes.texts}
    assert {"-1000"} <= texts
    # the second body begins where the first has ended
    first, second = unrolled.curves
    assert (first.x.min(), first.x.max(), second.x.min(), second.x.max()) == pytest.approx((0, 2, 2, 3))
    assert unrolled.bars == pytest.approx([2.0])


def test_an_energy_density_is_never_drawn_negative(bent: Results) -> None:
    picture = build(bent, "fields", field="energy")
    stored = bent.field("beam", "energy")
    assert picture.range() == pytest.approx((stored.min(), stored.max()))
    assert stored.min() >= 0.0


@pytest.mark.parametrize(("sides", "names"), [
    (["axis"], ["axis, from below"]), (["surface"], ["lower face"]), (["axis", "surface"], ["lower face and axis"])])
def test_a_map_of_pressure_names_the_bodies_in_contact(sides: list[str], names: list[str], tmp_path: Path) -> None:
    case = {"format": 1, "bodies": {"b": {
                "geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                "section": {"height": 0.02, "width": 0.05}, "material": {"E": 1e7, "nu": 0.3, "rho": 1000},
                "element": {"type": "reissner2", "count": 2}}},
            "boundary_conditions": [{"type": "clamp", "at": "b@0"}],
            "loads": [{"type": "gravity", "value": [0, -9.81]}],
            "obstacles": {side: {"type": "half_plane", "through": [0, -0.01 * len(sides) if side == "surface" else 0],
                                 "normal": [0, 1]} for side in sides},
            "contacts": [{"between": ["b", side], "side": side} for side in sides],
            "solver": {"type": "static", "steps": 2}, "output": {"fields": ["pressure"]}}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(case))
    run_case(load_case(tmp_path / "a.yaml", (), vocabulary()), str(tmp_path / "a.h5"))
    with open_results(tmp_path / "a.h5") as results:
        zones = build(results, "contact").zones
    assert [zone.name for zone in zones] == [f"b, {name}" for name in names]


def test_a_map_of_pressure_says_so_without_contact() -> None:
    t, s = np.array([0.0, 1.0]), np.array([0.0, 1.0, 2.0])
    for pressure, note in ((0.0, "no contact in any stored state"), (1.0, "")):
        figure = Figure()
        face = Zone("beam, lower face", s, np.full((2, 3), pressure))
        Zones("Beam", ("t", "s"), "m", "N/m", t, [face]).render(figure)
        assert figure.axes[0].get_title().removeprefix("Beam").strip() == note


@pytest.mark.slow
def test_fields_that_a_material_lacks_are_not_advised(tmp_path: Path) -> None:
    """A case refuses stress and strain of a relaxing material, so only section forces are advised."""
    text = """\
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.02, width: 0.02}
    material: {E: 2.0e6, nu: 0.3%s}
    element: {type: cable, count: 2}
boundary_conditions:
  - {type: clamp, at: beam@0}
loads:
  - {type: force, at: beam@1, value: [0, -0.01]}
solver: {type: static}
"""
    # fields of a linear material are computed from the states unless the file alone is read
    for name, law, advised, opened in (
            ("relaxing", ", viscoelastic: [{modulus: 0.5, time: 0.1}]", "[N, Q, M]", StatesWithFields),
            ("elastic", "", "[strain, M]", open_results)):
        run_case(load_case_text(text % law, name, vocabulary=vocabulary()), str(tmp_path / f"{name}.h5"))
        with opened(tmp_path / f"{name}.h5") as results, pytest.raises(ResultsError) as told:
            build(results, "moment_curvature")
        assert f"output: fields: {advised}" in str(told.value)


@pytest.mark.parametrize(("law", "words"), [
    ("viscoelastic: [{modulus: 0.5, time: 1}]", "stress is not available for a material that relaxes"),
    ("yield: 1e5", "output: fields: .stress. in the case stores it")])
def test_advice_on_fields_agrees_with_the_refusals_of_cases(tmp_path: Path, law: str, words: str) -> None:
    """Wherever the material is: here in a layer."""
    text = f"""
bodies:
  beam: {{geometry: {{type: line, start: [0, 0], end: [1, 0]}}, element: {{type: reissner3, count: 2}},
    section: {{width: 0.02, layers: [{{height: 0.02, material: {{E: 2e6, nu: 0.3, {law}}}}}]}}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, -0.01]}}]
solver: {{type: static}}
"""
    run_case(load_case_text(text, "a.yaml", (), vocabulary()), str(tmp_path / "a.h5"))
    with StatesWithFields(tmp_path / "a.h5") as results, pytest.raises(ResultsError, match=words):
        build(results, "fields")
