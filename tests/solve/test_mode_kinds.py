"""Kinds of modes: shares of the section motions, gaps, resolution, exact modes, the finer mesh."""

import math
from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.case import refined
from ancf2d.elements.section import timoshenko
from ancf2d.model.determinacy import rigid_motion
from ancf2d.solvers.small_motions.classify import Classifier
from ancf2d.solvers.small_motions.eigen import solve_eigen
from ancf2d.study.run import prepare, run_case
from scripts.timoshenko import exact_mode, overlap

THICK = {"height": 0.4, "width": 0.4}
SOFT = {"E": 1e9, "nu": 0.3, "rho": 7850}
PINNED = [{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}]


def scene(name: str, count: int, angle: float = 0.0, modes: int = 10, **more: Any) -> Any:
    bc = PINNED if angle == 0.0 else [{"type": "pin", "at": "b@0"},
                                      {"type": "roller", "at": "b@1", "normal": [-math.sin(angle), math.cos(angle)]}]
    solver = {"type": "eigen", "modes": modes, **more.pop("solver", {})}
    body = h.body(h.line(2.0, angle), h.element(name, count, **more), THICK, SOFT)
    return h.load({"b": body}, solver, bc=bc)


def found(*args: Any, **more: Any) -> list[dict[str, Any]]:
    return run_case(scene(*args, **more)).summary["frequencies"]


def field(model: Any, motion: str) -> np.ndarray:
    """Return the nodal coordinates of a pure section motion of a straight body along x, uniform along it."""
    mesh = model.meshes["b"]
    v, names = np.zeros(model.n_q), [c for node in mesh.coordinate_names for c in node]
    wanted = {"axial": ("x",), "transverse": ("y",), "stretch": ("ry_y",), "rotation": ("ry_x", "theta")}[motion]
    for local, name in enumerate(names):
        if name in wanted:
            v[mesh.dofs[:, local]] = -1.0 if name == "ry_x" else 1.0
    return v


@pytest.mark.parametrize("motion", ["axial", "transverse", "rotation", "stretch"])
@h.every_small_type
def test_a_pure_section_motion_has_all_the_energy(name, motion):
    model = prepare(scene(name, 3))
    v = field(model, motion)
    if not v.any():
        pytest.skip("the section of this type cannot do that")
    verdict, = Classifier(model, np.zeros(len(model.numbering.place)))(v[None], np.array([False]))
    assert verdict.shares[motion] == pytest.approx(1.0, abs=1e-12)
    kinds = {"axial": "axial", "transverse": "bending", "rotation": "shear", "stretch": "thickness"}
    assert verdict.kind == kinds[motion]
    assert verdict.gaps == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("geometry", h.GEOMETRIES)
@pytest.mark.parametrize("name", ["vallejo", "2d2n", "cable", "reissner3", "ancf[2,2]"])
def test_shares_add_up_and_rigid_motions_are_rigid(name, geometry):
    model = h.build({"b": h.body(h.GEOMETRIES[geometry], h.element(name, 6))}, "eigen")
    classifier = Classifier(model, np.zeros(len(model.numbering.place)))
    rigid = rigid_motion(model.meshes["b"], np.arange(model.n_q), model.e0, np.zeros(2)) @ [0.3, -0.2, 0.7]
    # no exact rigid motion: the same field with one node moved
    bent = rigid.copy()
    bent[:2] += 0.1
    zero = np.array([True, True])
    assert [found.kind for found in classifier(np.array([rigid, bent]), zero)] == ["rigid", "spurious"]
    some = np.array([rigid, np.random.default_rng(3).standard_normal(model.n_q)])
    for verdict in classifier(some, ~zero):
        assert sum(verdict.shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert min(verdict.shares.values()) >= 0.0


@pytest.mark.parametrize("name", ["2d3n", "omar", "vallejo", "cable", "reissner3"])
def test_kinds_and_shares_do_not_depend_on_the_direction(name):
    straight, inclined = found(name, 6), found(name, 6, angle=0.7)
    assert [(f["kind"], f["number"]) for f in inclined] == [(f["kind"], f["number"]) for f in straight]
    for a, b in zip(straight, inclined, strict=True):
        assert b["omega"] == pytest.approx(a["omega"], rel=1e-9)
        assert b["shares"] == pytest.approx(a["shares"], abs=1e-7)


@pytest.mark.parametrize("name", ["omar", "kerkkanen", "vallejo", "li", "reissner2", "reissner3"])
def test_lowest_modes_have_the_kinds_of_timoshenkos_beam(name):
    """For L/h = 5, the order is b a b b a b (b) ... with the first shear mode at 1766.99."""
    kinds = [(f["kind"], f["number"]) for f in found(name, 16, modes=12)]
    assert kinds[:5] == [("bending", 1), ("axial", 1), ("bending", 2), ("bending", 3), ("axial", 2)]
    assert ("shear", 1) in kinds


def test_waves_beyond_the_mesh_are_spurious():
    entries = found("reissner2", 8, modes=26)
    assert [f["kind"] for f in entries[:4]] == ["bending", "axial", "bending", "bending"]
    axial = [f for f in entries if f["shares"]["axial"] > 0.6]
    # a wave of 4 L/(2 m - 1) has three functions or more for m <= 5 of 8
    assert [f["kind"] for f in axial] == ["axial"] * 5 + ["spurious"] * 3


def test_the_spurious_branch_is_recognised_by_its_gaps_and_falls_with_the_mesh():
    lowest = {}
    for n in (16, 32):
        entries = found("2d2n", n, modes=12 if n == 32 else 20, preset="paper", quadrature="exact")
        branch = [f for f in entries if f["kind"] == "spurious"]
        assert all(f["gaps"] > 0.1 for f in branch)
        assert all(f["gaps"] < 0.1 for f in entries if f not in branch)
        lowest[n] = branch[0]["omega"]
    assert lowest[16] == pytest.approx(1222.07, abs=0.01)
    assert lowest[32] == pytest.approx(725.85, abs=0.01)


def test_conforming_elements_have_no_gaps():
    for name in ("omar", "vallejo", "li", "patel", "ancf[3,3]"):
        assert max(f["gaps"] for f in found(name, 4, modes=20)) < 1e-20


@pytest.mark.parametrize("kind", ["bending", "axial", "shear"])
@pytest.mark.parametrize("name", ["reissner3", "vallejo"])
def test_exact_modes_are_orthogonal_and_computed_ones_are_them(name, kind):
    formulation = {"formulation": "structural"} if name == "vallejo" else {}
    loaded = scene(name, 32, modes=40, **formulation)
    model = prepare(loaded)
    state = list(solve_eigen(model, loaded.case.solver))[-1]
    mesh, shapes = model.meshes["b"], state.arrays["modes/shapes"][0]
    for number in (1, 2):
        mode = exact_mode(mesh.plan.section, 2.0, kind, number)
        shares = overlap(mesh, shapes, mode)
        best = int(np.argmax(shares))
        entry = state.report["frequencies"][best]
        assert shares[best] == pytest.approx(1.0, abs=1e-6)
        assert np.delete(shares, best).max() < 1e-6
        assert (entry["kind"], entry["number"]) == (kind, number)
        assert entry["omega"] == pytest.approx(mode.omega, rel=1e-5)


def test_exact_frequencies_of_the_simply_supported_beam():
    section = prepare(scene("reissner3", 1)).meshes["b"].plan.section
    assert section.kGA == pytest.approx(timoshenko(0.3) * 1e9 / 2.6 * 0.16, rel=1e-12)
    known = {("bending", 1): 95.63398088, ("bending", 2): 332.2345136, ("bending", 4): 965.7354669,
             ("shear", 1): 1766.994062, ("axial", 1): 280.320625, ("axial", 2): 840.961875}
    for (kind, number), omega in known.items():
        assert exact_mode(section, 2.0, kind, number).omega == pytest.approx(omega, rel=1e-9)
    stretch = math.sqrt(12 * 1e9 / 7850) / 0.4
    assert exact_mode(section, 2.0, "thickness", 1).omega == pytest.approx(stretch, rel=1e-12)


def test_the_finer_mesh_confirms_bending_and_rejects_the_branch():
    entries = found("2d2n", 16, modes=20, preset="paper", quadrature="exact", solver={"verify": True})
    assert all(f["verified"] for f in entries if f["shares"]["transverse"] > 0.9)
    assert not any(f["verified"] for f in entries if f["gaps"] > 0.4)
    assert {f["kind"] for f in entries if not f["verified"]} == {"spurious"}


def test_the_finer_mesh_confirms_every_resolved_mode_of_a_conforming_element():
    entries = found("reissner3", 12, modes=10, solver={"verify": True})
    assert all(f["verified"] for f in entries)
    plain = found("reissner3", 12, modes=10)
    assert [(f["kind"], f["number"]) for f in entries] == [(f["kind"], f["number"]) for f in plain]


def test_refined_halves_every_element():
    loaded = scene("vallejo", 5)
    nodes = [prepare(case).meshes["b"].starts for case in (loaded, refined(loaded), refined(refined(loaded)))]
    for factor, found in zip((1, 2, 4), nodes, strict=True):
        np.testing.assert_allclose(found, np.linspace(0.0, 2.0, 5 * factor + 1)[:-1], atol=1e-12)


@pytest.mark.parametrize("table", ["reissner3", "rigid"])
def test_the_sway_of_a_stage_on_leaf_springs_is_its_first_bending_mode(table: str) -> None:
    """Stiffness method: omega^2 = 2 (12 EI/L^3)/m; the table moves along its axis, but only the blades are strained."""
    L, E, b, t = 0.1, 2e11, 0.02, 0.0005
    blade = {"section": {"height": t, "width": b}, "material": {"E": E, "nu": 0.3, "rho": 1.0},
             "element": {"type": "cable", "count": 8}}
    stiff = {"section": {"height": 0.05, "width": b}, "material": {"E": E, "nu": 0.3, "rho": 7800.0},
             "element": {"type": table} | ({} if table == "rigid" else {"count": 4})}

    def line(start: list[float], end: list[float]) -> dict[str, object]:
        return {"geometry": {"type": "line", "start": start, "end": end}}
    case = {"bodies": {"left": {**line([0, 0], [0, L]), **blade}, "right": {**line([L, 0], [L, L]), **blade},
                       "table": {**line([0, L], [L, L]), **stiff}},
            "boundary_conditions": [{"type": "clamp", "at": "left@0"}, {"type": "clamp", "at": "right@0"}],
            "joints": [{"type": "weld", "between": ["left@1", "table@0"]},
                       {"type": "weld", "between": ["right@1", "table@1"]}],
            "goal": {"kind": "bending", "number": 1}, "solver": {"type": "eigen", "modes": 2}}
    solution = ancf2d.solve(case, states=False)
    first = solution.summary["frequencies"][0]
    assert (first["kind"], first["number"]) == ("bending", 1)
    assert first["shares"]["axial"] > 0.99
    assert first["strain"]["bending"] > 0.99
    wanted = math.sqrt(2 * E * b * t**3 / L**3 / (7800 * 0.05 * b * L))
    assert first["omega"] == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize("name", ["reissner3", "vallejo", "cable"])
def test_shares_are_along_and_across_the_vibrating_state(name):
    """A cantilever whose clamp has turned by a right angle moves as before, along other axes."""
    body = h.body(h.line(2.0), h.element(name, 6), THICK, SOFT)

    def modes(angle: float) -> list[dict[str, float]]:
        clamp = {"type": "prescribed", "at": "b@0", "ux": 0, "uy": 0, "angle": angle}
        case = h.load({"b": body}, {"type": "eigen", "modes": 3, "about": "static"}, bc=[clamp])
        return [mode["shares"] for mode in run_case(case).summary["frequencies"]]
    for still, turned in zip(modes(0.0), modes(0.5 * math.pi), strict=True):
        assert turned == pytest.approx(still, abs=1e-6)


def test_a_rope_under_tension_vibrates_in_bending() -> None:
    """A load hangs from a rope on an inclined arm with a stay. As a string, the rope has omega = n pi/L sqrt(N/rhoA).

    The vertical motion of the load stretches the rope a little in all modes, which would outweigh its bending.
    """
    length, mass, weight = 1.5, 50.0, 0.4
    bodies = {"arm": {**h.body(h.line(1.0), h.element("reissner3", 6), {"height": 0.12, "width": 0.08},
                               {"E": 7e10, "nu": 0.33, "rho": 2700}),
                      "geometry": {"type": "line", "start": [0, 0], "end": [3, 2]}},
              "rope": {"geometry": {"type": "line", "start": [3, 2], "end": [3, 2 - length]},
                       "section": {"EA": 2e5, "EI": 0.5, "rhoA": weight}, "element": {"type": "cable", "count": 8}}}
    modes = h.solved(bodies, {"type": "eigen", "modes": 6, "about": "static"}, bc=[{"type": "pin", "at": "arm@0"}],
                     joints=[{"type": "pin", "between": ["arm@1", "rope@0"]}],
                     masses=[{"at": "rope@1", "mass": mass}], loads=[{"type": "gravity", "value": [0, -9.81]}],
                     springs=[{"type": "translational", "between": [[0, 3], "arm@0.8"], "stiffness": 2e5}]
                     ).state.report["frequencies"]
    for n in (1, 2):
        string = n * math.pi / length * math.sqrt((mass + weight * length / 2) * 9.81 / weight)
        near = min(modes, key=lambda mode: abs(mode["omega"] - string))
        assert near["omega"] == pytest.approx(string, rel=0.03)
        assert near["shares"]["transverse"] > 0.99
        assert near["kind"] == "bending"
