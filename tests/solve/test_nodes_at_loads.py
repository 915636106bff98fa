"""Nodes at loads and constraints, as elements cannot have a kink inside."""

from __future__ import annotations

import json
from typing import Any

import helpers
import numpy as np
import pytest

from ancf2d.model.build import build_model
from ancf2d.model.points import dot, point_ref
from ancf2d.model.transfer import transferred
from ancf2d.solvers.motion.initial import initial_motion
from ancf2d.solvers.small_motions.section_motions import class_motions, energies
from ancf2d.solvers.system import System

L, A_AT = 2.0, 0.3
SECTION = {"EA": 1e6, "kGA": 2e5, "EI": 800.0, "rhoA": 3.0}
EXACT = ["vallejo", "reissner3", "cable"]


def acting(name: str, count: int) -> dict[str, Any]:
    """Return an element of a body with nodes at loads and constraints."""
    return helpers.element(name, count, nodes="acting", **({"formulation": "structural"} if name == "vallejo" else {}))


def simply_supported(name: str, count: int, angle: float = 0.0) -> helpers.Solution:
    """Solve a simply supported beam of length L with a transverse unit force at S = A_AT."""
    c, s = np.cos(angle), np.sin(angle)
    bc = [{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "normal": [-s, c]}]
    return helpers.solved({"b": helpers.body(helpers.line(L, angle), acting(name, count), SECTION)}, "linear_static",
                          bc=bc, loads=[{"type": "force", "at": f"b@{A_AT}", "value": [-s, c]}])


@pytest.mark.parametrize("count", [1, 3, 8])
@pytest.mark.parametrize("name", EXACT)
def test_a_force_anywhere_bends_a_beam_as_in_beam_theory(name: str, count: int) -> None:
    out = simply_supported(name, count, 0.7)
    a, b = A_AT * L, (1 - A_AT) * L
    shear = 0.0 if name == "cable" else a * b / (L * SECTION["kGA"])
    normal = np.array([-np.sin(0.7), np.cos(0.7)])
    assert out.u(f"b@{A_AT}") @ normal == pytest.approx(a**2 * b**2 / (3 * SECTION["EI"] * L) + shear, rel=1e-8)


ACTS: dict[str, dict[str, Any]] = {
    "support": {"bc": [{"type": "clamp", "at": "b@0"}, {"type": "roller", "at": "b@0.3", "fixed": "y"}]},
    "joint": {"joints": [{"type": "pin", "between": ["b@0.3", "c@0"]}]},
    "slider": {"joints": [{"type": "slider", "at": "b@0.3", "through": [0.6, 0], "along": [1, 0]}]},
    "spring": {"springs": [{"type": "translational", "between": ["b@0.3", [0, 1]], "stiffness": 1.0}]},
    "mass": {"masses": [{"at": "b@0.3", "mass": 1.0}]},
    "force": {"loads": [{"type": "force", "at": "b@0.3", "value": [0, 1]}]},
    "moment": {"loads": [{"type": "moment", "at": "b@0.3", "value": 1}]},
    "line load": {"loads": [{"type": "distributed", "on": "b", "from": 0.3, "value": [0, 1]}]},
}


def scene(count: int = 4, **what: Any) -> Any:
    """Return the case of a clamped beam ``b`` and a free one ``c`` that begins at its S = 0.3."""
    bodies = {"b": helpers.body(helpers.line(L), acting("reissner3", count)),
              "c": helpers.body(helpers.line(1.0, 1.0, (0.6, 0.0)), acting("reissner3", 2))}
    what.setdefault("bc", [{"type": "clamp", "at": "b@0"}])
    return helpers.load(bodies, {"type": "eigen", "modes": 2}, **what)


@pytest.mark.parametrize("kind", ACTS)
def test_every_load_and_constraint_has_a_node(kind: str) -> None:
    plan = build_model(scene(**ACTS[kind])).meshes["b"].plan
    assert plan.split == pytest.approx([0.3])
    assert plan.count == 4


def test_probes_and_sliding_points_need_no_node() -> None:
    slide = [{"type": "prismatic", "point": "c@0", "on": "b"}]
    model = build_model(scene(joints=slide, output={"probes": {"p": "b@0.37"}}))
    assert model.meshes["b"].plan.split == []


@pytest.mark.parametrize("name", ["vallejo", "2d3n", "reissner3"])
def test_equal_elements_stay_the_same_to_the_last_bit_if_their_nodes_suffice(name: str) -> None:
    models = []
    for nodes in ("acting", "regular"):
        body = helpers.body(helpers.ARC, helpers.element(name, 6, nodes=nodes))
        loads = [{"type": "force", "at": f"b@{s!r}", "value": [1, 2]} for s in (1 / 3, 0.5)]
        models.append(helpers.build({"b": body}, bc=[{"type": "clamp", "at": "b@0"}], loads=loads))
    assert np.array_equal(models[0].e0, models[1].e0)
    assert models[0].warnings == models[1].warnings


def test_a_mid_node_is_inside_an_element() -> None:
    load = [{"type": "force", "at": "b@0.5", "value": [0, 1]}]
    models = {nodes: helpers.build({"b": helpers.body(helpers.line(L), helpers.element("reissner3", 1, nodes=nodes))},
                                   bc=[{"type": "clamp", "at": "b@0"}], loads=load) for nodes in ("acting", "regular")}
    assert models["acting"].n_elements == 2
    assert any("element.count 1 is less than" in w for w in models["acting"].warnings)
    assert models["regular"].n_elements == 1
    assert any("inside an element (S = 0.5)" in w for w in models["regular"].warnings)


@helpers.every_small_type
def test_a_state_is_the_same_on_a_nested_mesh_with_other_elements(name: str) -> None:
    """On a mesh with all elements divided: displacements are polynomials that the finer one contains, too."""
    bodies = [{"b": helpers.body(helpers.line(L, 0.4), helpers.element(name, n, nodes="acting"))} for n in (3, 12)]
    bc = [{"type": "clamp", "at": "b@0"}]
    loads = [[{"type": "force", "at": f"b@{s}", "value": [0, 1]} for s in places]
             for places in ((0.3, 0.5), (0.15, 0.3, 0.5, 0.875))]
    coarse, fine = (helpers.build(b, bc=bc, loads=f) for b, f in zip(bodies, loads, strict=True))
    d = helpers.random_state(coarse, 0.1)
    moved = transferred(d, coarse, fine)
    assert moved is not None
    for s in (0.1, 0.3, 0.4, 0.7, 1.0):
        before, after = ([dot(c, q) for c in point_ref(model.meshes["b"], s).position()]
                         for model, q in ((coarse, d), (fine, moved)))
        np.testing.assert_allclose(after, before, atol=1e-12)


@pytest.mark.parametrize("name", ["2d2n", "2d3n"])
def test_neighbours_of_unequal_length_have_no_gap_in_a_rigid_motion(name: str) -> None:
    load = [{"type": "force", "at": "b@0.3", "value": [0, 1]}]
    model = helpers.build({"b": helpers.body(helpers.line(L), helpers.element(name, 5, nodes="acting"))},
                          bc=[{"type": "clamp", "at": "b@0"}], loads=load)
    mesh = model.meshes["b"]
    assert len(mesh.classes) == 2
    spin = helpers.rotate(np.zeros(model.n_q), model, 1e-8) / 1e-8
    found = energies(mesh, [class_motions(c.sampler) for c in mesh.classes], spin[None])
    assert found.gaps[0] < 1e-12 * found.total[0]
    assert found.motions.sum() == pytest.approx(found.total[0], rel=1e-9)


# types whose neighbours share r_x, and with it the axial strain
SHARING = ["cable", "omar", "li", "2d2n", "2d2n-nu"]
BAR = {"height": 0.02, "width": 0.02}
STIFF = {"E": 2.1e11, "nu": 0.0, "rho": 1000.0}
EA = STIFF["E"] * BAR["height"] * BAR["width"]


def bar(name: str, count: int, nodes: str = "acting", length: float = 1.0, start: float = 0.0) -> dict[str, Any]:
    """Return a straight bar along 0.6 rad."""
    way = (start * np.cos(0.6), start * np.sin(0.6))
    return helpers.body(helpers.line(length, 0.6, way), helpers.element(name, count, nodes=nodes), BAR, STIFF)


def along(out: helpers.Solution, at: str) -> float:
    """Return the displacement of a point along the bar."""
    return float(out.u(at) @ [np.cos(0.6), np.sin(0.6)])


CLAMP, ALONG = {"type": "clamp", "at": "b@0"}, [100 * np.cos(0.6), 100 * np.sin(0.6)]
# each with what stretches the bar by F L/(E A) up to S = 0.5 alone
PULLS: dict[str, dict[str, Any]] = {
    "force": {"loads": [{"type": "force", "at": "b@0.5", "value": ALONG}]},
    "weight": {"masses": [{"at": "b@0.5", "mass": 100.0}], "gravity": [np.cos(0.6), np.sin(0.6)]},
    "member": {"joints": [{"type": "pin", "between": ["b@0.5", "c@0"]}],
               "loads": [{"type": "force", "at": "c@1", "value": ALONG}]},
}


@helpers.covering(name=SHARING, pull=PULLS, count=[2, 3])
def test_the_axial_strain_jumps_where_a_force_acts_along_a_bar(name: str, pull: str, count: int) -> None:
    what = {**PULLS[pull]}
    bodies = {"b": bar(name, count)}
    if "joints" in what:
        bodies["c"] = helpers.body(helpers.line(0.5, 0.6, (0.5 * np.cos(0.6), 0.5 * np.sin(0.6))),
                                   helpers.element("rigid", 1), {"height": 0.01, "width": 0.01}, {"rho": 1.0})
        del bodies["c"]["element"]["nodes"], bodies["c"]["element"]["count"]
        # held across, as the pin lets it turn
        what["bc"] = [CLAMP, {"type": "roller", "at": "c@1", "normal": [-np.sin(0.6), np.cos(0.6)]}]
    gravity = what.pop("gravity", None)
    own = 0.0
    if gravity is not None:
        what["loads"] = [{"type": "gravity", "value": gravity}]
        # the bar's own weight per length
        q = STIFF["rho"] * BAR["height"] * BAR["width"]
        own = q * (0.5 - 0.125) / EA
    out = helpers.solved(bodies, "linear_static", **{"bc": [CLAMP], **what})
    assert along(out, "b@0.5") == pytest.approx(100 * 0.5 / EA + own, rel=1e-9)


@pytest.mark.parametrize("name", SHARING)
def test_two_halves_with_a_force_at_their_weld_are_one_bar(name: str) -> None:
    loads = [{"type": "force", "at": "b@1", "value": ALONG}]
    halves = helpers.solved({"b": bar(name, 2, length=0.5), "c": bar(name, 2, length=0.5, start=0.5)}, "linear_static",
                            bc=[CLAMP], joints=[{"type": "weld", "between": ["b@1", "c@0"]}], loads=loads)
    assert along(halves, "b@1") == pytest.approx(100 * 0.5 / EA, rel=1e-9)
    assert along(halves, "c@1") == pytest.approx(100 * 0.5 / EA, rel=1e-9)


@pytest.mark.parametrize("name", ["cable", "omar", "2d2n"])
def test_sections_are_continuous_where_strains_jump(name: str) -> None:
    """A bar in large bending by forces along and across at its middle: the direction of the section is unique."""
    loads = [{"type": "force", "at": f"b@{s}", "value": value} for s, value in ((0.5, [2e3, -3e3]), (1, [0, 900.0]))]
    out = helpers.solved({"b": bar(name, 8)}, "static", bc=[CLAMP], loads=loads)
    here = out.point("b@0.5")
    before = here.before()
    e = out.model.e0 + out.d[:out.model.n_q]
    a, b = ([dot(c, e) for c in side.director()[0]] for side in (before, here))
    assert a[0] * b[1] - a[1] * b[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose([dot(c, e) for c in before.position()], out.r("b@0.5"), atol=1e-12)


def test_strains_jump_only_at_points() -> None:
    """At the start of line loads, and in moving cables, the axial strain is continuous."""
    line_load = [{"type": "distributed", "on": "b", "from": 0.5, "value": [1, 0]}]
    force = [{"type": "force", "at": "b@0.5", "value": [1, 0]}]
    moving = {"type": "dynamic", "t_end": 1.0, "dt": 0.1, "method": "newmark"}
    scenes = {"line": ("omar", line_load, "linear_static"), "rest": ("omar", [], "linear_static"),
              "point": ("omar", force, "linear_static"), "moving": ("omar", force, moving),
              "cable": ("cable", force, "linear_static"), "moving cable": ("cable", force, moving),
              "resting": ("cable", [], moving)}
    sizes = {key: helpers.build({"b": bar(name, 4)}, solver, bc=[CLAMP], loads=loads).n_q
             for key, (name, loads, solver) in scenes.items()}
    assert sizes["line"] == sizes["rest"] == sizes["point"] - 6 == sizes["moving"] - 6
    assert sizes["resting"] == sizes["moving cable"] == sizes["cable"] - 4


@pytest.mark.parametrize("held", [{"type": "clamp", "hold": "all"},
                                  {"type": "fix", "coordinates": ["x", "rx_x", "rx_y"]}])
def test_a_support_of_nodal_coordinates_fixes_both_sides(held: dict[str, Any]) -> None:
    model = helpers.build({"b": bar("omar", 4)}, "eigen", bc=[{"at": "b@0.5", **held}])
    here = model.meshes["b"].dofs
    d = model.displacements(np.ones(model.numbering.n_unknowns), 0.0)[:model.n_q]
    # r_x of the last node of the second element, and of the first node of the third one
    np.testing.assert_array_equal(d[[here[1, 8], here[1, 9], here[2, 2], here[2, 3]]], 0.0)


@pytest.mark.parametrize("name", ["cable", "omar"])
def test_a_motion_starts_from_the_static_state_of_a_beam_with_more_loads(name: str, tmp_path: Any) -> None:
    """A plucked string: the force that bent it is gone, and with it the second side of its node."""
    from ancf2d.study.run import load as load_file
    from ancf2d.study.run import run_case

    ends = [{"type": "pin", "at": "b@0"}, {"type": "pin", "at": "b@1"}]
    pluck = {"format": 1, "bodies": {"b": bar(name, 4)}, "boundary_conditions": ends, "solver": {"type": "static"},
             "loads": [{"type": "force", "at": "b@0.5", "value": [-200.0, 300.0]}],
             "output": {"probes": {"mid": "b@0.5"}}}
    release = {**pluck, "loads": [], "initial": {"from": "pluck.h5"},
               "solver": {"type": "dynamic", "t_end": 1e-5, "dt": 1e-5, "method": "newmark"}}
    for title, case in (("pluck", pluck), ("release", release)):
        (tmp_path / f"{title}.yaml").write_text(json.dumps(case))
    before = run_case(load_file(tmp_path / "pluck.yaml"), str(tmp_path / "pluck.h5")).summary["probes"]["mid"]
    model = build_model(load_file(tmp_path / "release.yaml"))
    d, _, _ = initial_motion(model)
    here = point_ref(model.meshes["b"], 0.5)
    assert here.before() is None
    after = [dot(c, d[:model.n_q]) for c in here.position()]
    np.testing.assert_allclose(after, [before["ux"], before["uy"]], rtol=1e-12)


@pytest.mark.parametrize("name", ["cable", "omar", "reissner3"])
def test_a_motion_starts_from_the_equilibrium_of_its_own_mesh(name: str) -> None:
    """Cables in motion have one r_x at a load: the equilibrium of a mesh with two would not be at rest."""
    model = helpers.build({"b": bar(name, 4)}, {"type": "dynamic", "t_end": 1.0, "dt": 0.1},
                          bc=[{"type": "clamp", "at": "b@0"}], initial={"from": "static"},
                          loads=[{"type": "force", "at": "b@0.6", "value": [200.0, 300.0]}])
    d, _, _ = initial_motion(model)
    balance = System(model).forces(d, 0.0)
    assert np.abs(balance.R).max() < 1e-7 * np.abs(balance.F).max()
