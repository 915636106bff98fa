"""Contact of bodies with one another and with themselves, compared with closed forms, symmetry and obstacles."""

from __future__ import annotations

from itertools import product
from typing import Any

import helpers
import numpy as np
import pytest
from motions import rigid

import ancf2d
from ancf2d.errors import CaseError, ComputationError
from ancf2d.model.determinacy import rigid_motion
from ancf2d.solvers.contact import contact_report, touches
from ancf2d.solvers.fields import FieldReader
from ancf2d.solvers.motion.integrators import method_problems

SECTION = {"height": 0.02, "width": 0.05}
STEEL = {"E": 2e11, "nu": 0.3, "rho": 7800.0}
# EI of SECTION
BENDING = 2e11 * 0.05 * 0.02**3 / 12
ON = {"between": ["upper", "lower"], "name": "touch"}
LAWS = {"law": {"law": {"stiffness": 1e9}}, "none": {}}


def beam(start: Any, end: Any, name: str = "cable", count: int = 4) -> dict[str, Any]:
    """Return a straight beam."""
    geometry = {"type": "line", "start": list(start), "end": list(end)}
    return helpers.body(geometry, helpers.element(name, count), SECTION, STEEL)


def clamps(*points: str) -> list[dict[str, Any]]:
    return [{"name": f"wall {k}", "type": "clamp", "at": point} for k, point in enumerate(points)]


def push(at: str, fx: float, fy: float) -> dict[str, Any]:
    return {"type": "force", "at": at, "value": [fx, fy]}


def check_balance(solution: Any) -> None:
    """Check that contact forces between bodies have no resultant force and moment."""
    model, d = solution.model, solution.state.d
    e = model.e0 + d[:model.n_q]
    for pair, table in zip(model.contacts, model.contact_tables, strict=True):
        points, _ = table.updated(d, 1.0)
        from ancf2d.kernels.points import point_matrices

        m = len(points.forces)
        dofs = points.dofs.reshape(m, -1)
        n = dofs.shape[1]
        Q = np.zeros((m, n))
        point_matrices(points, d, np.zeros_like(d), np.zeros((0, 3)), False, np.zeros(m), Q, np.zeros((m, n, n)),
                       np.zeros((m, n, n)))
        own, other = pair.mesh.plan.element.n_dof, pair.against.plan.element.n_dof
        total = 0.0
        for mesh, part in ((pair.mesh, slice(0, own)), (pair.against, slice(own, own + other))):
            moves = rigid_motion(mesh, dofs[:, part].ravel(), e, np.zeros(2)).reshape(m, -1, 3)
            total = total + np.einsum("mn,mnk->mk", Q[:, part], moves)
        assert np.abs(total).max() < 1e-8 * max(np.abs(Q).max(), 1.0)


def shared_force(solution: Any, distance: float, above: float = 1.0) -> float:
    """Return the force between two cantilevers that touch at x = 1, the first of which bears a force of 10.

    At first, their axes are at a ``distance`` there. What they come nearer, the layer yields.
    """
    upper, lower = 3.0 * BENDING, 3.0 * BENDING / 0.6**3
    nearer = distance - above * (solution.r("upper@1") - solution.r("lower@0.25"))[1]
    return float((10.0 - upper * nearer) / (1.0 + upper / lower))


@pytest.mark.slow_rows("cable-none")
@pytest.mark.parametrize(("name", "law"), helpers.chosen(product(("cable", "reissner2", "vallejo"), LAWS),
                                                           [("cable", "none"), ("vallejo", "law")]))
def test_two_cantilevers_share_a_force_by_their_stiffness(name, law):
    found = []
    for order in (["upper", "lower"], ["lower", "upper"]):
        bodies = {"upper": beam([0, 0.02], [1, 0.02], name), "lower": beam([0.8, 0], [1.6, 0], name, 5)}
        found.append(helpers.Solution(helpers.build(
            bodies, bc=clamps("upper@0", "lower@1"), loads=[push("upper@1", 0, -10.0)],
            contacts=[{"name": "touch", "between": order, **LAWS[law]}])))
    solution, other = found
    (report,), (turned,) = (contact_report(s.model, s.state) for s in found)
    assert report["force"][1] == pytest.approx(shared_force(solution, 0.02), rel=2e-3)
    # where it touches, or one stretch between points of a law there
    assert 0.95 <= report["from"] <= 1.0 == pytest.approx(report["to"], abs=0.02)
    check_balance(solution)
    # both bear the same, on the faces that look at one another
    pressed = FieldReader(solution.model, ("pressure",)).read(solution.state)
    for body, (low, high) in {"upper": (1.0, 0.0), "lower": (0.0, 1.0)}.items():
        values = pressed[body, "pressure"][..., 0]
        total = np.trapezoid(values, np.linspace(0, 1, 5), axis=1).T @ solution.model.meshes[body].lengths
        np.testing.assert_allclose(total, np.hypot(*report["force"]) * np.array([low, high]), rtol=2e-3, atol=1e-9)
    # whichever is named first
    np.testing.assert_allclose(other.state.d[:solution.model.n_q], solution.state.d[:solution.model.n_q], atol=1e-10)
    np.testing.assert_allclose(turned["force"], -np.array(report["force"]), rtol=1e-7, atol=1e-9)
    assert turned["moment"] == pytest.approx(-report["moment"], rel=1e-7)
    # to the distance of the points that bear
    assert turned["to"] == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("above", [1, -1])
@pytest.mark.parametrize("law", LAWS)
def test_axes_that_touch_stay_on_their_sides(law, above):
    """They share a force as above: each pushes the other to the same position, above it or below."""
    bodies = {"upper": beam([0, above * 1e-6], [1, above * 1e-6]), "lower": beam([0.8, 0], [1.6, 0], count=5)}
    solution = helpers.Solution(helpers.build(
        bodies, bc=clamps("upper@0", "lower@1"), loads=[push("upper@1", 0, -10.0 * above)],
        contacts=[{**ON, "side": "axis", **LAWS[law]}]))
    (report,) = contact_report(solution.model, solution.state)
    assert report["force"][1] == pytest.approx(above * shared_force(solution, 1e-6, above), rel=2e-3)
    # with a law, a point stands for a length of its element
    assert report["to"] == pytest.approx(1.0, abs=0.02)
    assert 0.0 <= report["to"] - report["from"] < 0.05
    check_balance(solution)


@pytest.mark.parametrize("count", [4, pytest.param(10, marks=pytest.mark.slow)])
def test_a_leaf_that_ends_below_another_bears_it_at_its_end(count: int) -> None:
    """A stiff layer and contact without a law agree: both have a contact point at the end of a body."""
    def tip(**contact: Any) -> float:
        bodies = {"upper": beam([0, 0.02], [1, 0.02], "reissner3", count),
                  "lower": beam([0, 0], [0.6, 0], "reissner3", count)}
        found = helpers.Solution(helpers.build(
            bodies, bc=clamps("upper@0", "lower@0"), loads=[push("upper@1", 0, -400.0)], contacts=[{**ON, **contact}]))
        return float(found.u("upper@1")[1])

    assert tip(law={"stiffness": 1e13}) == pytest.approx(tip(), rel=1e-5)


@pytest.mark.slow
def test_load_steps_go_on_where_an_extrapolated_leaf_would_lift_off() -> None:
    """Newton's method starts again at the last equilibrium, rather than that the step is divided."""
    def leaf(y: float, length: float) -> dict[str, Any]:
        return helpers.body(helpers.line(length, start=(0.0, y)), helpers.element("reissner3", 40),
                            {"height": 0.01, "width": 0.05}, {"E": 1e8, "nu": 0.3})

    found = helpers.Solution(helpers.build(
        {"upper": leaf(0.01, 1.0), "lower": leaf(0.0, 0.6)}, {"type": "static", "steps": 5},
        bc=clamps("upper@0", "lower@0"), loads=[push("upper@1", 0, -0.5)],
        contacts=[{**ON, "law": {"stiffness": 1e8}}]))
    assert [state.history["cutbacks"] for state in found.states] == [0] * 5


@pytest.mark.parametrize("law", helpers.chosen(LAWS, ["law"]))
def test_two_mirrored_beams_behave_like_one_on_their_plane_of_symmetry(law):
    gap, force, n = 0.01, 40000.0, 6
    upper, lower = beam([0, 0.01 + gap], [1, 0.01 + gap], count=n), beam([0, -0.01 - gap], [1, -0.01 - gap], count=n)
    two = helpers.Solution(helpers.build(
        {"upper": upper, "lower": lower}, bc=clamps("upper@0", "upper@1", "lower@0", "lower@1"),
        loads=[push("upper@0.5", 0, -force), push("lower@0.5", 0, force)], contacts=[{**ON, **LAWS[law]}]))
    # each body meets the middle half way: a layer between them as stiff as two behind one another
    half = {"law": {"stiffness": 2e9}} if law == "law" else {}
    one = helpers.Solution(helpers.build(
        {"upper": upper}, bc=clamps("upper@0", "upper@1"), loads=[push("upper@0.5", 0, -force)],
        obstacles={"plane": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        contacts=[{"name": "touch", "between": ["upper", "plane"], **half}]))
    for s in (0.25, 0.4, 0.5):
        np.testing.assert_allclose(two.r(f"upper@{s}"), one.r(f"upper@{s}"), atol=2e-6)
        np.testing.assert_allclose(two.r(f"lower@{s}"), two.r(f"upper@{s}") * [1, -1], atol=1e-9)
    (report,), (alone,) = contact_report(two.model, two.state), contact_report(one.model, one.state)
    assert report["force"][1] == pytest.approx(alone["force"][1], rel=1e-4)
    assert report["force"][1] > 100.0
    check_balance(two)
    for touch in touches(two.model, two.state):
        assert np.nanmin(touch.gap) > (-1e-8 if law == "none" else -1e-3)


@pytest.mark.parametrize("law", helpers.chosen(LAWS, ["law"]))
def test_a_hairpin_touches_itself_like_half_of_it_its_plane_of_symmetry(law):
    def pin(*pieces):
        # a bump above the plane, and a bend around to the other arm
        start = [0.15 * np.sin(0.6), 0.165 - 0.15 * np.cos(0.6)]
        geometry = {"type": "path", "start": start, "heading": np.pi + 0.6, "pieces": list(pieces)}
        section = {"height": 0.01, "width": 0.05}
        return helpers.body(geometry, helpers.element("cable", 12 * len(pieces)), section, STEEL)

    bump = {"arc": 0.15, "angle": -1.0}
    # without a law, where points are placed depends a little on the way
    how = {"type": "static", "steps": 4} if law == "law" else "static"
    radius = (0.165 - 0.15 * np.cos(0.4)) / np.cos(0.4)
    whole = helpers.Solution(helpers.build(
        {"pin": pin(bump, {"arc": radius, "angle": np.pi + 0.8}, bump)}, how, bc=clamps("pin@0.5"),
        loads=[push("pin@0", 0, -20000.0), push("pin@1", 0, 20000.0)],
        contacts=[{"name": "touch", "self": "pin", **LAWS[law]}]))
    half = {"law": {"stiffness": 2e9}} if law == "law" else {}
    alone = helpers.Solution(helpers.build(
        {"pin": pin(bump, {"arc": radius, "angle": 0.5 * np.pi + 0.4})}, how, bc=clamps("pin@1"),
        loads=[push("pin@0", 0, -20000.0)],
        obstacles={"plane": {"type": "polyline", "points": [[-0.05, 0], [0.2, 0]]}},
        contacts=[{"name": "touch", "between": ["pin", "plane"], **half}]))
    assert any(touch.closed.any() for touch in touches(alone.model, alone.state))
    for s in (0.0, 0.2, 0.35):
        # to a thousandth of what the tip moves: where a point is placed differs
        np.testing.assert_allclose(whole.r(f"pin@{s}"), alone.r(f"pin@{2 * s}"), atol=2.5e-5)
        # without a law, one of the two sides has the points
        np.testing.assert_allclose(whole.r(f"pin@{1 - s}"), whole.r(f"pin@{s}") * [1, -1],
                                   atol=1e-8 if law == "law" else 2.5e-5)
    (report,), (other,) = contact_report(whole.model, whole.state), contact_report(alone.model, alone.state)
    # a body has no force on itself, but presses with the force on the plane
    assert report["force"] == [0.0, 0.0]
    assert report["normal"] == pytest.approx(other["force"][1], rel=2e-3)
    assert other["normal"] == pytest.approx(other["force"][1], rel=1e-9)
    assert 0.0 < report["from"] < 0.35
    assert law == "none" or 0.65 < report["to"] < 1.0
    check_balance(whole)


def test_open_contacts_do_not_change_vibrations():
    """A beam with self-contact has more contact points than coordinates, and all of them are open."""
    scene = {"bodies": {"hook": beam([0, 0], [1, 0], "reissner3")}, "boundary_conditions": clamps("hook@0"),
             "solver": {"type": "eigen", "modes": 3}}
    alone, may = (ancf2d.solve({**scene, **more}).summary for more in ({}, {"contacts": [{"self": "hook"}]}))
    for one, other in zip(alone["frequencies"], may["frequencies"], strict=True):
        assert one["omega"] == pytest.approx(other["omega"], rel=1e-8)


def test_energy_momentum_is_refused():
    bodies = {"upper": beam([0, 0.02], [1, 0.02]), "lower": beam([0.8, 0], [1.6, 0])}
    solver = {"type": "dynamic", "t_end": 1, "dt": 0.1, "method": "energy_momentum"}
    model = helpers.build(bodies, solver, contacts=[{**ON, **LAWS["law"]}])
    assert any("contact between bodies (touch)" in p.message for p in method_problems(model))


def test_overlapping_bodies_are_reported_with_depth_and_position():
    bodies = {"upper": beam([0, 0.015], [1, 0.015]), "lower": beam([0.8, 0], [1.6, 0], count=5)}
    with pytest.raises(CaseError, match=r"contacts\.0: \w+ is 0\.005 deep in \w+ in the reference, at S = "):
        helpers.build(bodies, bc=clamps("upper@0", "lower@1"), contacts=[ON])
    # a layer that yields starts compressed
    helpers.build(bodies, bc=clamps("upper@0", "lower@1"), contacts=[{**ON, **LAWS["law"]}])


def test_a_curved_body_is_deepest_where_it_is_parallel_to_the_other():
    """An arc whose lowest point is 0.30/0.52 along it, 10 mm in a straight beam: neither a node nor a mid-point."""
    arc = {"type": "arc", "center": [0.5, 2.05], "radius": 2.0, "from": -np.pi / 2 - 0.30, "to": -np.pi / 2 + 0.22}
    bodies = {"upper": helpers.body(arc, helpers.element("cable", 4), SECTION, STEEL),
              "lower": beam([-0.5, 0], [1.5, 0], count=3)}
    model = helpers.build(bodies, "static", bc=clamps("upper@0", "lower@0"), contacts=[ON])
    d, (table, _) = np.zeros(len(model.numbering.place)), model.contact_tables
    d[model.meshes["upper"].dofs[:, [1, 5]]] = -0.04
    depth, place, _ = table.deepest(d, 1.0)
    (k,) = np.flatnonzero(depth)
    spot = table.pair.spots[k]
    assert spot.ie + 0.5 * (1.0 + place[k]) == pytest.approx(4 * 0.30 / 0.52, abs=5e-4)
    assert depth[k] == pytest.approx(0.01, rel=2e-4)


def test_a_body_that_crosses_itself_is_reported_with_depth_and_position():
    loop = [{"line": 0.3}, {"arc": 0.1, "angle": 1.5 * np.pi}, {"line": 0.3}]
    path = {"type": "path", "start": [0, 0], "pieces": loop}
    noose = helpers.body(path, helpers.element("cable", 30), SECTION, STEEL)
    with pytest.raises(CaseError, match=r"contacts\.0: noose is 0\.0[12]\d* deep in itself in the ref.* S = "):
        helpers.build({"noose": noose}, bc=clamps("noose@0"), contacts=[{"self": "noose"}])


def test_a_layer_too_soft_to_stop_a_body_is_reported():
    bodies = {"upper": beam([0, 0.021], [1, 0.021], "cable", 2), "lower": beam([0.8, 0], [1.6, 0], "cable", 2)}
    model = helpers.build(bodies, bc=clamps("upper@0", "lower@1"), loads=[push("upper@1", 0, -1000.0)],
                          contacts=[{**ON, "law": {"stiffness": 1e4}}])
    with pytest.raises(ComputationError, match=r"touch: \w+ is pressed 0\.0\d+ into \w+ at S = .* contact may no"):
        helpers.Solution(model)


def test_impossible_contacts_are_reported():
    solid = {"type": "half_plane", "through": [0, -9], "normal": [0, 1]}
    model = helpers.build({"upper": beam([0, 0], [1, 0])}, bc=clamps("upper@0"),
                          contacts=[{"between": ["upper", "far"]}], obstacles={"far": solid, "idle": solid})
    assert [w.split(",")[0] for w in model.warnings] == [
        "obstacles.idle: no contact names this obstacle", "contacts.0: upper is held 8.99 from far"]
    with pytest.raises(CaseError, match="supports hold all of block"):
        helpers.build({"block": rigid([0, 0], [1, 0], 1.0, 1.0)}, bc=clamps("block@0"), obstacles={"far": solid},
                      contacts=[{"between": ["block", "far"], "side": "axis"}])


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_rotated_and_shifted_bodies_behave_the_same(law):
    angle, shift = 0.731, np.array([13.37, -4.21])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def solved(there):
        ends = {"upper": ([0, 0.021], [1, 0.021], 4), "lower": ([0.8, 0], [1.6, 0], 5)}
        bodies = {name: beam(there(a), there(b), count=n) for name, (a, b, n) in ends.items()}
        load = push("upper@1", *(there(np.array([0, -1000.0])) - there(np.zeros(2))))
        return helpers.Solution(helpers.build(bodies, bc=clamps("upper@0", "lower@1"), loads=[load],
                                              contacts=[{**ON, **LAWS[law]}]))

    as_is = solved(lambda x: np.asarray(x, dtype=float))
    moved = solved(lambda x: turn @ np.asarray(x, dtype=float) + shift)
    for at in ("upper@0.5", "upper@1", "lower@0"):
        # the tips move by a millimetre
        np.testing.assert_allclose(moved.u(at), turn @ as_is.u(at), atol=1e-9)
    (one,), (two,) = (contact_report(s.model, s.state) for s in (as_is, moved))
    np.testing.assert_allclose(two["force"], turn @ one["force"], atol=1e-4)


@pytest.mark.parametrize("law", LAWS)
def test_points_beyond_the_end_of_a_body_touch_none_of_its_elements(law):
    """Neither its last element nor the ends of those before it, even if these are shorter than the body is high."""
    model = helpers.build({"upper": beam([0.0, 0.02], [0.808, 0.02], "reissner2", 200),
                           "lower": beam([0.0, 0.0], [0.8, 0.0], "reissner2", 160)},
                          bc=clamps("upper@0", "lower@0"), contacts=[{**ON, **LAWS[law]}])
    table = next(t for t in model.contact_tables if t.pair.body == "upper")
    pair, d = table.pair, np.zeros(len(model.numbering.place))
    own = np.unique(pair.mesh.dofs)
    d[own] = -1e-6 * rigid_motion(pair.mesh, own, model.e0, np.zeros(2))[:, 1]
    gaps, places = table.gaps(d, 1.0)[0], pair.places(d)[:, 0]
    beyond = places > 0.8
    assert beyond.any()
    assert not (gaps[beyond] < 0.0).any()
    if law == "law":
        lower_face = np.array([p.eta == -1.0 and abs(p.z) < 1.0 for p in pair.spots])
        assert gaps[lower_face & ~beyond] == pytest.approx(-1e-6, rel=1e-6)


def test_points_share_the_coordinates_of_the_body_that_they_may_reach() -> None:
    """A copy for each point would grow with the cube of the elements: 12 GB with 200."""
    model = helpers.build({"upper": beam([0, 0.021], [1, 0.021]), "lower": beam([0, 0], [1, 0])}, "static",
                          bc=clamps("upper@0", "lower@0"), contacts=[ON])
    first, second = model.constraints[:2]
    assert first.dofs.base is second.dofs.base
