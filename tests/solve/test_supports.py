"""Supports fix exactly their coordinates, at nodes and between, on inclined bodies and arcs, linear and nonlinear."""

import helpers
import numpy as np
import pytest

from ancf2d.errors import CaseError

EI = 5.0 * 0.2 * 0.3**3 / 12
NAMES = [*helpers.KINDS.values(), "omar", "2d3n", "ancf[2,2]"]
SOLVERS = ("linear_static", "static")
GEOMETRIES = {"inclined": helpers.line(1.2, 0.6), "arc": helpers.ARC}
PUSH = [{"type": "force", "at": "b@1", "value": [0.3 * EI, -0.4 * EI]}]


def scene(name: str, geometry: str, solver: str, bc: list, loads=PUSH, count: int = 4):
    return helpers.solved(
        {"b": helpers.body(GEOMETRIES[geometry], helpers.element(name, count))}, solver, bc=bc, loads=loads
    )


@helpers.covering(name=NAMES, geometry=GEOMETRIES, solver=SOLVERS, s=[0.0, 0.25, 0.37])
def test_a_clamp_fixes_position_and_section(name, geometry, solver, s):
    holds = ["all", "section"] + (["breathe"] if helpers.TYPES[name].section_kind == "interpolated" else [])
    for hold in holds:
        out = scene(name, geometry, solver, [{"name": "c", "type": "clamp", "at": f"b@{s}", "hold": hold}])
        spread = "uniform" if hold == "breathe" else None
        mean = [sum(w * out.d[c]) for c, w in out.point(f"b@{s}").position(spread)]
        np.testing.assert_allclose(mean if hold == "breathe" else out.u(f"b@{s}"), 0, atol=1e-12)
        assert out.theta(f"b@{s}") == pytest.approx(0, abs=1e-12)
        r = out.reactions()["c"]
        np.testing.assert_allclose([r["fx"], r["fy"]], [-0.3 * EI, 0.4 * EI], rtol=1e-7)
        assert np.hypot(*out.u("b@1")) > 0.01


@pytest.mark.parametrize("name", ["vallejo", "omar", "li", "2d3n"])
def test_a_full_clamp_fixes_every_coordinate_and_section_leaves_the_stretch_free(name):
    load = [{"type": "force", "at": "b@1", "value": [0.05, 0.1]}]
    for hold, free in (("all", False), ("section", True)):
        out = scene(name, "inclined", "static", [{"type": "clamp", "at": "b@0", "hold": hold}], load)
        d = out.d[out.point("b@0").dofs()]
        assert (np.abs(d).max() > 1e-6) == free


@helpers.covering(name=NAMES, geometry=GEOMETRIES, solver=SOLVERS, s=[0.25, 0.37])
def test_pins_and_rollers_fix_only_their_directions(name, geometry, solver, s):
    bc = [
        {"name": "p", "type": "pin", "at": "b@0"},
        {"name": "n", "type": "roller", "at": f"b@{s}", "normal": [2, -1]},
        {"name": "x", "type": "roller", "at": "b@1", "fixed": "x"},
    ]
    out = scene(name, geometry, solver, bc)
    np.testing.assert_allclose(out.u("b@0"), 0, atol=1e-13)
    u = out.u(f"b@{s}")
    assert 2 * u[0] - u[1] == pytest.approx(0, abs=1e-13)
    assert abs(u[0] + 2 * u[1]) > 1e-6
    u = out.u("b@1")
    assert u[0] == pytest.approx(0, abs=1e-13)
    assert abs(u[1]) > 1e-3
    r = out.reactions()
    assert r["n"]["fx"] == pytest.approx(-2 * r["n"]["fy"], rel=1e-9)
    assert r["x"]["fy"] == pytest.approx(0, abs=1e-13)
    assert [r[k]["m"] for k in "pnx"] == pytest.approx([0, 0, 0], abs=1e-9 * EI)
    np.testing.assert_allclose([sum(v[k] for v in r.values()) for k in ("fx", "fy")], [-0.3 * EI, 0.4 * EI], rtol=1e-7)


def test_fix_fixes_the_named_coordinates():
    bc = [{"type": "fix", "at": "b@0", "coordinates": ["x", "y", "ry_x"]}]
    out = scene("vallejo", "inclined", "static", bc)
    d = out.d[out.point("b@0").dofs()]
    np.testing.assert_allclose(d[:3], 0, atol=0)
    assert abs(d[3]) > 1e-6
    with pytest.raises(CaseError, match="no coordinate 'rx_x'"):
        scene("vallejo", "inclined", "static", [{"type": "fix", "at": "b@0", "coordinates": ["rx_x"]}])
    with pytest.raises(CaseError, match="there is no node at"):
        scene("vallejo", "inclined", "static", [{"type": "fix", "at": "b@0.3", "coordinates": ["x"]}])


def test_rigid_sections_cannot_breathe():
    for name in ("cable", "reissner3"):
        with pytest.raises(CaseError, match="cannot breathe"):
            scene(name, "inclined", "static", [{"type": "clamp", "at": "b@0", "hold": "breathe"}])


@pytest.mark.parametrize("spread", ["uniform", "parabolic"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_spread_supports_fix_the_weighted_mean_of_the_section(solver, spread):
    bc = [
        {"type": "pin", "at": "b@0", "spread": spread},
        {"type": "roller", "at": "b@1", "fixed": "y", "spread": spread},
    ]
    gravity = [{"type": "gravity", "value": [0, -0.5]}]
    out = scene("ancf[3,3]", "inclined", solver, bc, gravity)
    for c, w in [*out.point("b@0").position(spread), out.point("b@1").position(spread)[1]]:
        assert w @ out.d[c] == pytest.approx(0, abs=1e-14)
    assert np.abs(out.u("b@0")).max() > 1e-7


@helpers.covering(name=NAMES, geometry=GEOMETRIES, solver=SOLVERS, s=[1.0, 0.87])
def test_prescribed_displacements_are_reached(name, geometry, solver, s):
    bc = [{"type": "clamp", "at": "b@0"}, {"name": "m", "type": "prescribed", "at": f"b@{s}", "ux": 0.05, "uy": -0.1}]
    out = scene(name, geometry, solver, bc, [])
    np.testing.assert_allclose(out.u(f"b@{s}"), [0.05, -0.1], atol=1e-12)
    r = out.reactions()
    names = [k for k in r if k != "m"]
    np.testing.assert_allclose([r["m"]["fx"], r["m"]["fy"]], [-r[names[0]]["fx"], -r[names[0]]["fy"]], rtol=1e-6)
    bc[1] = {"name": "m", "type": "prescribed", "at": f"b@{s}", "uy": -0.1}
    out = scene(name, geometry, solver, bc, [])
    assert out.u(f"b@{s}")[1] == pytest.approx(-0.1, abs=1e-12)
    assert out.reactions()["m"]["fx"] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_prescribed_positions_are_not_displacements(name):
    x, y = 1.2 * np.cos(0.6), 1.2 * np.sin(0.6)
    bc = [{"type": "clamp", "at": "b@0"}, {"type": "prescribed", "at": "b@1", "x": x - 0.05, "y": y + 0.1}]
    for solver in SOLVERS:
        out = scene(name, "inclined", solver, bc, [])
        np.testing.assert_allclose(out.u("b@1"), [-0.05, 0.1], atol=1e-12)


@helpers.covering(name=NAMES, geometry=GEOMETRIES, s=[1.0, 0.87])
def test_prescribed_angles_are_reached_and_resisted_by_a_moment(name, geometry, s):
    bc = [
        {"name": "c", "type": "clamp", "at": "b@0"},
        {"name": "m", "type": "prescribed", "at": f"b@{s}", "angle": 0.4},
    ]
    out = scene(name, geometry, "static", bc, [])
    assert out.theta(f"b@{s}") == pytest.approx(0.4, abs=1e-9)
    r = out.reactions()
    assert r["m"]["m"] == pytest.approx(-r["c"]["m"], rel=1e-6)
    assert r["m"]["m"] > 0
    small = [
        {"name": "c", "type": "clamp", "at": "b@0"},
        {"name": "m", "type": "prescribed", "at": f"b@{s}", "angle": 4e-7},
    ]
    linear = scene(name, geometry, "linear_static", small, [])
    assert linear.theta(f"b@{s}") == pytest.approx(4e-7, rel=1e-6)
    nonlinear = scene(name, geometry, "static", small, [])
    assert linear.reactions()["m"]["m"] == pytest.approx(nonlinear.reactions()["m"]["m"], rel=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_a_prescribed_angle_of_linear_theory_is_the_linear_rotation(name):
    """It is met at any size, with a proportional reaction."""
    resisted = []
    for angle in (1e-3, 0.5, 1.6, -3.0):
        bc = [{"type": "clamp", "at": "b@0"}, {"name": "m", "type": "prescribed", "at": "b@1", "angle": angle}]
        out = scene(name, "inclined", "linear_static", bc, loads=[])
        assert out.theta("b@1") == pytest.approx(angle, rel=1e-9)
        resisted.append(out.reactions()["m"]["m"] / angle)
    np.testing.assert_allclose(resisted, resisted[0], rtol=1e-8)
    # 2d3n is too stiff on so coarse a mesh
    assert resisted[0] == pytest.approx(EI / 1.2, rel=0.2)


@pytest.mark.parametrize("name", NAMES)
def test_a_body_turned_by_its_support_moves_rigidly(name):
    """Half a turn about a pin by a prescribed angle: every point moves rigidly, without stress."""
    bc = [{"name": "p", "type": "pin", "at": "b@0"}, {"name": "m", "type": "prescribed", "at": "b@0", "angle": 3.0}]
    out = scene(name, "inclined", "static", bc, [])
    for s in (0.3, 1.0):
        start = 1.2 * s * np.array([np.cos(0.6), np.sin(0.6)])
        end = 1.2 * s * np.array([np.cos(3.6), np.sin(3.6)])
        np.testing.assert_allclose(out.u(f"b@{s}"), end - start, atol=1e-9)
    assert out.state.energy < 1e-18


@pytest.mark.parametrize("name", NAMES)
def test_small_prescribed_motion_is_the_same_in_both_theories(name):
    size = 1e-7
    bc = [
        {"name": "c", "type": "clamp", "at": "b@0"},
        {"name": "m", "type": "prescribed", "at": "b@0.87", "ux": size, "uy": -2 * size},
    ]
    linear, nonlinear = (scene(name, "arc", solver, bc, []) for solver in SOLVERS)
    np.testing.assert_allclose(linear.u("b@0.4"), nonlinear.u("b@0.4"), atol=1e-5 * size)
    for k in ("fx", "fy"):
        assert linear.reactions()["m"][k] == pytest.approx(nonlinear.reactions()["m"][k], rel=1e-5)


def test_a_motion_that_starts_elsewhere_is_refused():
    bc = [
        {"type": "clamp", "at": "b@0"},
        {"name": "far", "type": "prescribed", "at": "b@1", "x": {"type": "constant", "scale": 5.0}},
    ]
    with pytest.raises(CaseError, match=r"prescribed x is 5 at t = 0, but the point is at x = "):
        scene("vallejo", "inclined", "static", bc, [])


def test_amplitudes_drive_prescribed_motion():
    amplitude = {"type": "expression", "value": "0.1*t^2"}
    bc = [{"type": "clamp", "at": "b@0"}, {"type": "prescribed", "at": "b@1", "uy": amplitude}]
    out = helpers.solved(
        {"b": helpers.body(GEOMETRIES["arc"], helpers.element("vallejo", 4))}, {"type": "static", "steps": 4}, bc=bc
    )
    assert [out.u("b@1", k)[1] for k in range(4)] == pytest.approx(
        [0.1 * (t / 4) ** 2 for t in (1, 2, 3, 4)], abs=1e-12
    )


@helpers.every_small_type
def test_the_default_clamp_leaves_the_strains_of_a_clamped_beam_free(name):
    """With a curvature fixed at the wall, errors have the order of an element's share of the length."""
    section, material, L = {"height": 0.2, "width": 0.1}, {"E": 1e9, "nu": 0.3, "rho": 1.0}, 2.0
    across = np.array([-np.sin(0.4), np.cos(0.4)])
    errors = []
    for count in (10, 20):
        out = helpers.solved({"b": helpers.body(helpers.line(L, 0.4), helpers.element(name, count), section, material)},
                             "linear_static", bc=[{"type": "clamp", "at": "b@0"}],
                             loads=[{"type": "force", "at": "b@1", "value": across}])
        s = out.model.meshes["b"].plan.section
        shear = 0.0 if name == "cable" else L / s.kGA
        errors.append(abs(out.u("b@1") @ across / (L**3 / (3 * s.EI) + shear) - 1))
    # what sections that swell or warp differ from Timoshenko's by, whatever the mesh
    model = {0: 0.0, 1: 0.0, 2: 1e-3, 3: 2e-3}[helpers.TYPES[name].degree_y]
    assert errors[1] <= 0.35 * errors[0] + model + 1e-9


def test_the_preset_of_the_paper_fixes_every_coordinate():
    for more, free in (({"preset": "paper"}, False), ({}, True)):
        bodies = {"b": helpers.body(GEOMETRIES["inclined"], helpers.element("omar", 4, **more))}
        out = helpers.solved(bodies, "static", bc=[{"type": "clamp", "at": "b@0"}], loads=PUSH)
        assert (np.abs(out.d[out.point("b@0").dofs()]).max() > 1e-6) == free
