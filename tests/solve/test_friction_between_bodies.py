"""Friction between bodies, and of a body on itself, against closed forms and balances."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from motions import ride
from test_contact_of_bodies import block, check_balance

from ancf2d.solvers.contact import contact_report
from ancf2d.solvers.fields import FieldReader
from ancf2d.solvers.section_forces import section_forces

HEIGHT, WIDTH, E, G = 0.02, 0.05, 2e11, 9.81
BENDING = E * WIDTH * HEIGHT**3 / 12
PRESS, PUSH, MU = 5e3, 200.0, 0.4
ON = {"name": "touch", "between": ["upper", "lower"]}


LAYER = {"stiffness": 1e10}


def leaves(name: str, count: int, mu: float, law: Any = LAYER) -> Any:
    """Return two cantilevers that are pressed together all along, then bent by equal forces, and let go."""
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


def test_leaves_that_rub_without_a_law_are_those_of_a_stiff_layer():
    """Points all along slide, and go back: deflections as with the layer, but for what it gives."""
    hard, mu = leaves("reissner3", 4, MU, None), MU * PRESS * HEIGHT / (6 * BENDING)
    k = next(k for k, s in enumerate(hard.states) if s.t == pytest.approx(0.6))
    assert hard.u("lower@1", k)[1] == pytest.approx(-PUSH / (6 * BENDING) + mu, rel=5e-3)
    assert hard.u("lower@1")[1] == pytest.approx(-mu, rel=0.02)
    check_balance(hard)


@pytest.mark.parametrize("name", helpers.chosen(["cable", "vallejo"], ["cable"]))
def test_leaves_that_rub_are_stiffer_and_keep_some_of_their_deflection(name):
    """The shear mu n of the faces bends each leaf by mu n h/2 per length, so that w = (P -+ mu n h) L^3/(6 EI)."""
    solution, smooth = leaves(name, 4, MU), leaves(name, 4, 0.0)
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
    # the lower leaf bears that as tension, between its nodes, too
    for s in (0.625, 0.875):
        N = section_forces(solution.model, solution.state, solution.point(f"lower@{s}"))[0]
        assert pytest.approx(MU * PRESS * (1 - s), rel=0.02) == N
    (report,) = contact_report(solution.model, solution.state)
    assert abs(report["force"][0]) == pytest.approx(MU * report["force"][1], rel=0.02)


def tip_loaded(order: Any, mu: float, name: str = "reissner3", count: int = 2) -> Any:
    """Return two cantilevers on each other, of which the upper one bears a force at its end, half of it at last."""
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


def test_what_closes_on_its_way_along_a_body_rubs_from_where_it_was():
    """A block that is moved down and along through its gap in one load step slides: its friction is at the limit."""
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
    """Return a block of 2 kg on a rail, as deep in it as its weight presses it."""
    c, s = np.cos(angle), np.sin(angle)
    along = np.array([c, s])
    start = 0.5 * along + (0.1 - 2 * G * c / k) * np.array([-s, c])
    return ride({"bodies": {"box": block(start, start + along), "rail": block([-3 * c, -3 * s], [3 * c, 3 * s])},
                 "bc": [{"type": "clamp", "at": "rail@0"}], "loads": [{"type": "gravity", "value": [0, -G]}],
                 "contacts": [{"between": list(order), "friction": mu, "law": {"stiffness": k, "damping": 2e3}}]},
                t_end, **solver)


@pytest.mark.parametrize("solver", [
    {"tolerance": 1e-4, "method": "radau5"}, pytest.param({"tolerance": 1e-4}, marks=pytest.mark.slow),
    pytest.param({"dt": 1e-3, "method": "newmark"}, marks=pytest.mark.slow)], ids=str)
def test_a_block_slides_down_a_rail_or_rests_on_it(solver):
    angle = 0.3
    along = np.array([np.cos(angle), np.sin(angle)])
    for mu, t_end in ((0.2, 0.5), (0.4, 0.1)):
        found = inclined(angle, mu, t_end, every=1, **solver)
        way = -float((found.place("box@0") - found.place("box@0", 0)) @ along)
        slope = G * (np.sin(angle) - mu * np.cos(angle))
        # tan 0.3 = 0.31; a spring of the stiffness of the layer gives before it slides
        assert way == pytest.approx(max(0.5 * slope * t_end**2, 0.0), rel=0.01, abs=1e-5)
        total, _ = found.totals()
        lost = np.array([row.lost for row in found.rows])
        np.testing.assert_allclose(total + lost, total[0], atol=1e-3 * max(abs(total[0] - total[-1]), 1e-2))
        assert lost[-1] == pytest.approx(mu * 2 * G * np.cos(angle) * way, rel=0.01, abs=1e-4)


def test_the_order_of_the_bodies_does_not_matter():
    one, two = (inclined(0.3, 0.2, 0.1, order=order, dt=1e-3, method="generalized_alpha")
                for order in (("box", "rail"), ("rail", "box")))
    np.testing.assert_allclose(one.full()[0], two.full()[0], atol=1e-12)


@pytest.mark.parametrize("method", [None, pytest.param("RK45", marks=pytest.mark.slow)])
def test_momentum_is_kept_where_one_body_drags_another(method):
    """Two bars that meet aslant in free space: friction turns and drags both, in balance."""
    bodies = {"one": block([0, 0.12], [1, 0.12]), "two": block([-0.3, 0], [1.2, 0.01])}
    found = ride({"bodies": bodies, "initial": {"bodies": {"one": {"velocity": [1.0, -0.5]}}},
                  "contacts": [{"between": ["one", "two"], "friction": 0.5, "law": {"stiffness": 1e6}}]},
                 0.1, every=1, tolerance=1e-6, **({} if method is None else {"method": method}))
    total, momenta = found.totals()
    lost = np.array([row.lost for row in found.rows])
    np.testing.assert_allclose(momenta, momenta[0] * np.ones_like(momenta), atol=1e-9)
    assert lost[-1] > 0.02 * total[0]
    np.testing.assert_allclose(total + lost, total[0], rtol=1e-3)


@pytest.mark.parametrize("steps", [10, pytest.param(40, marks=pytest.mark.slow)])
def test_bodies_that_begin_to_touch_do_not_pass_through_one_another_in_a_load_step(steps):
    """Loads that would push leaves through one another, which touch with no gap, cut the step."""
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
