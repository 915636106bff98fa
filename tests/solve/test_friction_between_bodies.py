"""Friction between bodies, and of a body on itself, compared with closed forms and balances."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from helpers import section_forces
from motions import ride
from test_collisions_of_bodies import block
from test_contact_of_bodies import check_balance

from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.fields import FieldReader

HEIGHT, WIDTH, E, G = 0.02, 0.05, 2e11, 9.81
BENDING = E * WIDTH * HEIGHT**3 / 12
PRESS, PUSH, MU = 5e3, 200.0, 0.4
ON = {"name": "touch", "between": ["upper", "lower"]}


LAYER = {"stiffness": 1e10}


def leaves(name: str, count: int, mu: float, law: Any = LAYER) -> Any:
    """Return two cantilevers that are pressed together all along, then bent by equal forces, and released."""
    def leaf(y):
        section, material = {"height": HEIGHT, "width": WIDTH}, {"E": E, "nu": 0.3}
        return helpers.body(helpers.line(1.0, start=(0.0, y)), helpers.element(name, count), section, material)

    press = {"type": "table", "t": [0, 0.2, 1], "value": [0, 1, 1]}
    bend = {"type": "table", "t": [0, 0.2, 0.6, 1], "value": [0, 0, 1, 0]}
    loads = [{"type": "distributed", "on": body, "value": [0, sign * PRESS], "amplitude": press}
             for body, sign in (("upper", -1), ("lower", 1))]
    loads += [{"type": "force", "at": f"{body}@1", "value": [0, -0.5 * PUSH], "amplitude": bend}
              for body in ("upper", "lower")]
    return helpers.Solution(helpers.build(
        {"upper": leaf(HEIGHT), "lower": leaf(0.0)}, {"type": "static", "steps": 5}, loads=loads,
        bc=[{"name": body, "type": "clamp", "at": f"{body}@0"} for body in ("upper", "lower")],
        contacts=[{**ON, "friction": mu} | ({"law": law} if law else {})]))


def test_leaves_that_rub_without_a_law_behave_as_with_a_stiff_layer():
    """All points slide, and go back: deflections as with the layer, up to its compliance."""
    hard, mu = leaves("reissner3", 4, MU, None), MU * PRESS * HEIGHT / (6 * BENDING)
    k = next(k for k, s in enumerate(hard.states) if s.t == pytest.approx(0.6))
    assert hard.u("lower@1", k)[1] == pytest.approx(-PUSH / (6 * BENDING) + mu, rel=5e-3)
    assert hard.u("lower@1")[1] == pytest.approx(-mu, rel=0.02)
    check_balance(hard)


def test_leaves_that_rub_are_stiffer_and_keep_some_of_their_deflection():
    """The shear mu n of the faces bends each leaf by mu n h/2 per length, so w = (P -+ mu n h) L^3/(6 EI)."""
    solution, smooth = leaves("cable", 4, MU), leaves("cable", 4, 0.0)
    at = [next(k for k, s in enumerate(one.states) if s.t == pytest.approx(0.6)) for one in (solution, smooth)]
    less = MU * PRESS * HEIGHT / (6 * BENDING)
    loaded, free = (one.u("lower@1", k)[1] for one, k in zip((solution, smooth), at, strict=True))
    # but for how far friction gives before it slides
    assert free == pytest.approx(-PUSH / (6 * BENDING), rel=5e-3)
    assert loaded - free == pytest.approx(less, rel=0.015)
    assert solution.u("lower@1")[1] == pytest.approx(-less, rel=0.015)
    # what the layer gives is all that is left
    assert smooth.u("lower@1")[1] == pytest.approx(0.5 * PRESS / 1e10, rel=0.05)
    check_balance(solution)
    # all along the upper face of the lower one friction is at its limit, against the way back
    fields = FieldReader(solution.model, ("pressure", "traction")).read(solution.state)
    pressure, traction = (fields["lower", name][..., 1, 0] for name in ("pressure", "traction"))
    np.testing.assert_allclose(traction, MU * pressure, rtol=0.01)
    # the lower leaf bears that as tension, between its nodes, too, where as many points bear as there is length
    for s in (0.625, 0.859375):
        N = section_forces(solution.model, solution.state, solution.point(f"lower@{s}"))[0]
        assert pytest.approx(MU * PRESS * (1 - s), rel=0.02) == N
    (report,) = contact_report(solution.model, solution.state)
    assert abs(report["force"][0]) == pytest.approx(MU * report["force"][1], rel=0.02)


def tip_loaded(order: Any, mu: float, name: str = "reissner3", count: int = 2) -> Any:
    """Return two cantilevers on each other, the upper one with a force at its end that is halved at last."""
    def leaf(y):
        section = {"height": HEIGHT, "width": WIDTH}
        return helpers.body(helpers.line(1.0, start=(0.0, y)), helpers.element(name, count), section, {"E": E, "nu": 0})

    force = {"type": "force", "at": "upper@1", "value": [0, -PUSH],
             "amplitude": {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0.5]}}
    return helpers.Solution(helpers.build(
        {"upper": leaf(HEIGHT), "lower": leaf(0.0)}, {"type": "static", "steps": 4}, loads=[force],
        bc=[{"name": body, "type": "clamp", "at": f"{body}@0"} for body in ("upper", "lower")],
        contacts=[{**ON, "between": list(order), "friction": mu}]))


@pytest.mark.parametrize("order", [("upper", "lower"), pytest.param(("lower", "upper"), marks=pytest.mark.slow)])
@pytest.mark.parametrize("mu", [0.3, pytest.param(0.0, marks=pytest.mark.slow)])
def test_leaves_without_a_law_press_and_rub_at_their_ends(order, mu):
    """Equal leaves share the force P at their ends: friction mu P/2 at h/2 from the axes bends them by mu P h/4.

    w = P L^3/(6 EI) (1 -+ 3/4 mu h/L), less where the force grows, more where it falls, and P L/(2 kGA)
    by shear. The ends slide off one another at once: the corner that stays on a face bears the force.
    """
    solution = tip_loaded(order, mu)
    t = np.array([state.t for state in solution.states])
    # steps are cut where the ends slide off, so that states are beside the turning point
    for k, way in ((int(np.flatnonzero(t <= 0.5)[-1]), 1.0), (len(t) - 1, -1.0)):
        share = np.interp(t[k], [0, 0.5, 1], [0, 1, 0.5])
        shear = 0.5 * share * PUSH / (5 / 6 * 0.5 * E * HEIGHT * WIDTH)
        w = share * PUSH / (6 * BENDING) * (1 - way * 0.75 * mu * HEIGHT) + shear
        assert solution.u("lower@1", k)[1] == pytest.approx(-w, rel=1.5e-4)
    check_balance(solution)
    (report,) = contact_report(solution.model, solution.state)
    force = np.array(report["force"])
    theta = 0.25 * PUSH / (2 * BENDING)
    along, across = force @ [np.cos(theta), -np.sin(theta)], force @ [np.sin(theta), np.cos(theta)]
    assert abs(along) == pytest.approx(mu * abs(across), abs=3e-4 * abs(across))


def test_points_that_close_while_moving_along_a_body_rub_from_there():
    """A block that moves down and along through its gap in one load step slides: its friction is at the limit."""
    rail = helpers.body(helpers.line(1.0), helpers.element("reissner3", 4), {"height": HEIGHT, "width": WIDTH},
                        {"E": 2e9, "nu": 0})
    box = {"geometry": helpers.line(0.2, start=(0.35, 0.035)), "section": {"height": 0.04, "width": WIDTH},
           "element": {"type": "rigid", "mass": 1, "inertia": 0.01}}
    held = {"type": "prescribed", "at": "box@0.5", "ux": {"type": "ramp", "scale": 0.02},
            "uy": {"type": "ramp", "scale": -0.006}, "angle": 0}
    solution = helpers.Solution(helpers.build(
        {"rail": rail, "box": box}, {"type": "static", "steps": 1}, loads=[],
        bc=[{"name": f"end{s}", "type": "clamp", "at": f"rail@{s}"} for s in (0, 1)] + [held],
        contacts=[{"name": "touch", "between": ["box", "rail"], "friction": MU}]))
    (report,) = contact_report(solution.model, solution.state)
    # the rail is bent by little: the force is across it but for its slope
    assert report["force"][1] > 10.0
    assert -report["force"][0] == pytest.approx(MU * report["force"][1], rel=0.05)


def inclined(angle: float, mu: float, t_end: float = 0.5, k: float = 1e7, order: Any = ("box", "rail"),
             **solver: Any) -> Any:
    """Return a block of 2 kg on a rail, at its static depth; without a law if k is inf."""
    c, s = np.cos(angle), np.sin(angle)
    along = np.array([c, s])
    start = 0.5 * along + (0.1 - 2 * G * c / k) * np.array([-s, c])
    law = {"law": {"stiffness": k, "damping": 2e3}} if np.isfinite(k) else {}
    return ride({"bodies": {"box": block(start, start + along), "rail": block([-3 * c, -3 * s], [3 * c, 3 * s])},
                 "bc": [{"type": "clamp", "at": "rail@0"}], "loads": [{"type": "gravity", "value": [0, -G]}],
                 "contacts": [{"between": list(order), "friction": mu, **law}]}, t_end, **solver)


@pytest.mark.parametrize(("k", "solver"), [
    pytest.param(1e7, {"tolerance": 1e-4, "method": "radau5"}, marks=pytest.mark.slow),
    pytest.param(1e7, {"tolerance": 1e-4}, marks=pytest.mark.slow),
    pytest.param(1e7, {"dt": 1e-3, "method": "newmark"}, marks=pytest.mark.slow),
    (np.inf, {"dt": 2e-3}), pytest.param(np.inf, {"dt": 2e-3, "method": "hht"}, marks=pytest.mark.slow)], ids=str)
def test_a_block_slides_down_a_rail_or_rests_on_it(k, solver):
    angle = 0.3
    along = np.array([np.cos(angle), np.sin(angle)])
    # where steps do not damp, the layer vibrates on
    long = 2.0 if solver.get("method") == "newmark" else 1.0
    for mu, t_end in ((0.2, 0.25 * long), (0.4, 0.05 * long)):
        found = inclined(angle, mu, t_end, k, every=1, **solver)
        way = -float((found.place("box@0") - found.place("box@0", 0)) @ along)
        slope = G * (np.sin(angle) - mu * np.cos(angle))
        # tan 0.3 = 0.31; a spring of the stiffness of the layer gives before it slides, and without one nothing does
        share = 0.01 if np.isfinite(k) else 1e-9
        assert way == pytest.approx(max(0.5 * slope * t_end**2, 0.0), rel=share, abs=1e-3 * share)
        total, _ = found.totals()
        lost = np.array([row.lost for row in found.rows])
        np.testing.assert_allclose(total + lost, total[0], atol=0.1 * share * max(abs(total[0] - total[-1]), 1e-2))
        assert lost[-1] == pytest.approx(mu * 2 * G * np.cos(angle) * way, rel=share, abs=0.01 * share)


@pytest.mark.parametrize("k", helpers.chosen([1e7, np.inf], [np.inf]))
def test_the_order_of_the_bodies_does_not_matter(k):
    one, two = (inclined(0.3, 0.2, 0.1, k, order=order, dt=1e-3, method="generalized_alpha")
                for order in (("box", "rail"), ("rail", "box")))
    n = one.model.n_q
    np.testing.assert_allclose(one.full()[0][:n], two.full()[0][:n], atol=1e-12)


@pytest.mark.parametrize(("touch", "solver"), [
    pytest.param({"law": {"stiffness": 1e6}}, {"tolerance": 1e-6}, marks=pytest.mark.slow),
    pytest.param({"law": {"stiffness": 1e6}}, {"tolerance": 1e-6, "method": "RK45"}, marks=pytest.mark.slow),
    ({"restitution": 0.5}, {"dt": 1e-3}), ({}, {"dt": 1e-3}), ({}, {"tolerance": 1e-4})], ids=str)
def test_momentum_is_conserved_if_one_body_drags_another(touch, solver):
    """Two bars that meet at an angle in free space: friction rotates and drags both, in balance."""
    bodies = {"one": block([0, 0.12], [1, 0.12]), "two": block([-0.3, 0], [1.2, 0.01])}
    found = ride({"bodies": bodies, "initial": {"bodies": {"one": {"velocity": [1.0, -0.5]}}},
                  "contacts": [{"between": ["one", "two"], "friction": 0.5, **touch}]}, 0.1, every=1, **solver)
    total, momenta = found.totals()
    lost = np.array([row.lost for row in found.rows])
    # without a law, the step in which a point closes moves bodies to where they touch, by dt times their velocity at
    # most, which changes the angular momentum; adaptive steps end at the impact
    moved = 1e-9 if "law" in touch else 1e-3 if "dt" in solver else 1e-5
    np.testing.assert_allclose(momenta, momenta[0] * np.ones_like(momenta), atol=moved)
    np.testing.assert_allclose(momenta[:, :2], momenta[0, :2] * np.ones((len(lost), 2)), atol=1e-9)
    assert lost[-1] > 0.02 * total[0]
    np.testing.assert_allclose(total + lost, total[0], rtol=1e-3 if "law" in touch else 1e-8)
    assert "law" in touch or np.diff(total).max() < 1e-9 * total[0]


V0 = 2.0


def on_plank(t_end: float, law: Any = None, flexible: bool = False, push: float = 0.0, v: float = V0,
             order: Any = ("box", "plank"), **solver: Any) -> Any:
    """Return a block of 1 kg that slides with v on a plank of 6 kg, which is free to slide between its guides.

    It is as deep in a layer as its weight presses it.
    """
    def body(start, end, count):
        if not flexible:
            return block(start, end)
        return helpers.body(helpers.line(end[0] - start[0], start=tuple(start)), helpers.element("reissner3", count),
                            {"height": 0.1, "width": 0.1}, {"E": 1e9, "nu": 0.3, "rho": 200.0})

    contact = {"between": list(order), "friction": 0.3} | ({"law": law} if law else {})
    y = 0.1 - (G / 0.5 / law["stiffness"] if law else 0.0)
    return ride({"bodies": {"box": body([0.3, y], [0.8, y], 2), "plank": body([0.0, 0.0], [3.0, 0.0], 6)},
                 "bc": [{"type": "prescribed", "at": f"plank@{s}", "uy": 0} for s in ((0, 1) if flexible else (0.5,))]
                 + ([] if flexible else [{"type": "prescribed", "at": "plank@0.5", "angle": 0}]),
                 "loads": [{"type": "gravity", "value": [0, -G]},
                           {"type": "force", "at": "plank@0.5", "value": [push, 0]}],
                 "initial": {"bodies": {"box": {"velocity": [v, 0]}}}, "contacts": [contact]}, t_end, every=1, **solver)


def test_a_block_and_a_plank_rub_until_they_move_together():
    """Without a law: the block slows down by mu g until both have V0/7, and the energy lost is m M/(m + M) V0^2/2."""
    found = on_plank(0.65, dt=2.5e-3)
    meet = 6 / 7 * V0 / (0.3 * G)
    way = np.array([(found.place("box@0", k) - found.place("plank@0", k))[0] for k in range(len(found.rows))])
    t = np.minimum([row.t for row in found.rows], meet)
    # the relative rate V0 - mu g (1 + m/M) t; the step in which they meet is no shorter
    np.testing.assert_allclose(way - way[0], V0 * t - 0.5 * 0.3 * G * 7 / 6 * t**2, atol=1e-5)
    total, momenta = found.totals()
    lost = np.array([row.lost for row in found.rows])
    np.testing.assert_allclose(momenta[:, 0], V0, rtol=1e-12)
    assert lost[-1] == pytest.approx(0.5 * 6 / 7 * V0**2, rel=1e-4)
    np.testing.assert_allclose(total + lost, total[0], atol=1e-4)
    # springs that hold what sticks give back what they took
    assert np.diff(total).max() < 1e-6


@pytest.mark.parametrize(("push", "rate"), [(10.0, 10.0 / 7), (50.0, 0.3 * G)])
def test_a_block_rides_on_a_pushed_plank(push, rate):
    """It sticks up to a push of (m + M) mu g = 20.6 N, and is left behind above it."""
    found = on_plank(0.2, push=push, v=0.0, dt=1e-3)
    way = float((found.place("box@0") - found.place("box@0", 0))[0])
    assert way == pytest.approx(0.5 * rate * 0.2**2, rel=1e-6)


@pytest.mark.slow
def test_friction_without_a_law_is_the_limit_of_stiff_layers():
    """The sliding distance differs by the rocking on the layer, about 1/k."""
    def way(**how):
        found = on_plank(0.2, **how)
        return float((found.place("box@0") - found.place("plank@0"))[0])

    hard = way(dt=1e-3)
    off = [abs(way(law={"stiffness": k, "damping": 0.1 * k**0.5}, tolerance=1e-6) - hard) for k in (1e4, 1e5, 1e6)]
    assert np.all(np.diff(off) < 0.0)
    assert off[-1] < 1e-4


@pytest.mark.slow
def test_short_steps_after_a_point_engages_converge_to_round_off():
    """If errors count as errors of rates, Newton's tolerance is relative to the step, but not below round-off."""
    for k in 1e4 * (1.0 + 1e-3 * np.arange(7)):
        assert on_plank(0.2, law={"stiffness": k, "damping": 0.1 * k**0.5}, tolerance=1e-6).rows[-1].t == 0.2


@pytest.mark.slow
def test_a_flexible_block_that_chatters_on_a_flexible_plank_slows_down_by_mu_g():
    """Friction acts on the total pressure of a step in which points close, also if waves open them again.

    Of the block alone, the impulse along is mu times that across, but for the slope of the plank.
    """
    found = on_plank(0.05, flexible=True, dt=2.5e-4)
    z, weights = np.polynomial.legendre.leggauss(6)
    mean = sum(0.5 * g * np.array([helpers.dot(c, found.full()[1]) for c in helpers.point_ref(
        found.model.meshes["box"], 0.5 + 0.5 * x).position()]) for x, g in zip(z, weights, strict=True))
    assert V0 - mean[0] == pytest.approx(0.3 * (G * 0.05 + mean[1]), rel=0.03)
    total, momenta = found.totals()
    np.testing.assert_allclose(momenta[:, 0], V0, rtol=1e-12)
    assert np.diff(total).max() < 1e-4 * total[0]


def lying(mu: float, **more: Any) -> dict[str, Any]:
    """Return two cantilevers that lie on each other from their clamps on, the shorter one below."""
    def leaf(y, length):
        return helpers.body(helpers.line(length, start=(0.0, y)), helpers.element("cable", 2),
                            {"height": HEIGHT, "width": WIDTH}, {"E": E, "nu": 0.0, "rho": 7800.0})

    return {"bodies": {"upper": leaf(HEIGHT, 1.0), "lower": leaf(0.0, 0.8)},
            "bc": [{"type": "clamp", "at": f"{name}@0"} for name in ("upper", "lower")],
            "loads": [{"type": "force", "at": "upper@1", "value": [0, -PUSH]}],
            "contacts": [{"between": ["upper", "lower"], "friction": mu}], **more}


@pytest.mark.parametrize("mu", [0.3, pytest.param(0.0, marks=pytest.mark.slow)])
def test_leaves_that_touch_at_their_clamps_move_in_balance(mu):
    """Points that supports fix on both bodies have no force; the energy never exceeds its initial value."""
    found = ride(lying(mu), 0.02, every=1, dt=2.5e-4)
    assert len(found.log) < 100
    total, _ = found.totals()
    fall = np.array([found.place("upper@1", k)[1] for k in range(len(found.rows))])
    total += PUSH * (fall - fall[0])
    lost = np.array([row.lost for row in found.rows])
    assert fall[0] - fall[-1] > 3e-3
    assert total.max() < 1e-5 * PUSH * (fall[0] - fall[-1])
    np.testing.assert_allclose(total + lost, 0.0, atol=5e-3 * PUSH * (fall[0] - fall[-1]))


@pytest.mark.slow
def test_leaves_in_equilibrium_stay_there():
    still = ride(lying(0.0, initial={"from": "static"}), 0.02, dt=5e-4)
    np.testing.assert_allclose(still.place("upper@1"), still.place("upper@1", 0), atol=1e-9)


@pytest.mark.parametrize("steps", [10, pytest.param(40, marks=pytest.mark.slow)])
def test_bodies_that_begin_to_touch_do_not_pass_through_one_another_in_a_load_step(steps):
    """The step is cut if loads would push leaves, which touch with zero gap, through one another."""
    def leaf(y):
        return helpers.body(helpers.line(1.0, start=(0.0, y)), helpers.element("cable", 4),
                            {"height": HEIGHT, "width": WIDTH}, {"E": E, "nu": 0.3})

    loads = [{"type": "distributed", "on": body, "value": [0, value]}
             for body, value in (("upper", -5e4), ("lower", 5e4))]
    found = helpers.Solution(helpers.build(
        {"upper": leaf(HEIGHT), "lower": leaf(0.0)}, {"type": "static", "steps": steps}, loads=loads,
        bc=[{"name": body, "type": "clamp", "at": f"{body}@0"} for body in ("upper", "lower")],
        contacts=[{**ON, "law": {"stiffness": 1e9}}]))
    # each leaf is held by the other: what the layer gives
    np.testing.assert_allclose(found.u("upper@1")[1], -0.5 * 5e4 / 1e9, rtol=0.05)


def folded(whole: bool, law: Any) -> Any:
    """Return a hairpin, in one piece or of two welded at its bend, whose end is pressed down and dragged."""
    arm, bend, start = {"line": 0.15}, 0.05, [0.15, 0.0]
    radius = 2 * bend / np.pi

    def bent(start, heading, pieces, count):
        geometry = {"type": "path", "start": start, "heading": heading, "pieces": pieces}
        return helpers.body(geometry, helpers.element("cable", count), {"height": 0.01, "width": WIDTH},
                            {"E": E, "nu": 0.3})

    half, turn = {"arc": radius, "angle": -0.5 * np.pi}, {"arc": radius, "angle": -np.pi}
    if whole:
        bodies = {"pin": bent(start, np.pi, [arm, turn, arm], 8)}
    else:
        bodies = {"lower": bent(start, np.pi, [arm, half], 4),
                  "upper": bent([-radius, radius], 0.5 * np.pi, [half, arm], 4)}
    clamped, end, contact = ("pin@0", "pin@1", {"self": "pin"}) if whole else (
        "lower@0", "upper@1", {"between": ["upper", "lower"]})
    load = {"type": "force", "at": end, "value": [0, -3e4], "amplitude": {"type": "ramp", "t0": 0, "t1": 0.5}}
    drag = {**load, "value": [1e4, 0], "amplitude": {"type": "table", "t": [0, 0.5, 0.75, 1], "value": [0, 0, 1, 0]}}
    return helpers.Solution(helpers.build(
        bodies, {"type": "static", "steps": 4}, loads=[load, drag],
        joints=[] if whole else [{"type": "weld", "between": ["lower@1", "upper@0"]}],
        bc=[{"name": "wall", "type": "clamp", "at": clamped}],
        contacts=[{"name": "touch", "friction": MU, **contact, **({"law": law} if law else {})}]))


@pytest.mark.slow
@pytest.mark.parametrize("law", [{"stiffness": 1e9}, None])
def test_a_hairpin_rubs_on_itself_like_two_welded_halves(law):
    pin, halves = folded(True, law), folded(False, law)
    for s in (0.0, 0.3, 0.7, 1.0):
        np.testing.assert_allclose(pin.r(f"pin@{0.5 + 0.5 * s}"), halves.r(f"upper@{s}"), rtol=0, atol=1e-9)
    (report,) = contact_report(halves.model, halves.state)
    assert report["force"][1] > 1e3
    # held by friction where it was dragged to
    assert abs(report["force"][0]) > 0.1 * report["force"][1]
    check_balance(pin)
