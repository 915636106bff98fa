"""Point laws over a step of energy_momentum: discrete gradients, work and dissipation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from test_point_laws import CONSTRAINTS, ELASTIC, ITEMS, LAWS, STEP, A, evaluate, motion

from ancf2d.elements.point_laws import MAX_MEM

# a torsion spring between theta and a direction: no discrete gradient keeps both its energy and angular momentum
# what is held by the ground has a moment on it
BALANCED = [n for n, i in ITEMS.items()
            if n not in ("torsion 12", "torsion 21", "direction at an angle", "direction held")]


def mean(item, u0, u1, w=None, a0=A, a1=A, mem=None):
    f = np.zeros(len(item.p0))
    w, mem = np.zeros(len(f)) if w is None else w, np.zeros(MAX_MEM) if mem is None else mem
    energy, power = LAWS[item.name].mean(item.p0, u0, u1, w, item.par, a0, a1, mem, f)
    return energy, power, f


@given(first=STEP, second=STEP)
# a step so short that the force is that of its middle
@example(first=[0.0, 0.015625, 0.0, -0.5, 0.0, 0.0], second=[0.0078125, 0.015625, 0.0, -0.5, 0.0, 0.0])
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("name", ELASTIC)
def test_the_work_of_the_force_of_a_step_is_the_difference_of_energy(name, first, second):
    item = ITEMS[name]
    u0, u1 = np.array(first[:len(item.p0)]), np.array(second[:len(item.p0)])
    before, after = evaluate(item, u0)[0], evaluate(item, u1)[0]
    energy, power, f = mean(item, u0, u1)
    assert f @ (u1 - u0) == pytest.approx(after - before, abs=1e-13 * (1 + np.abs(f * (u1 - u0)).sum()))
    assert energy == pytest.approx(after, abs=1e-14)
    assert power == 0.0


@given(first=STEP, second=STEP)
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("name", ELASTIC)
def test_dampers_dissipate_their_stated_power_over_a_step(name, first, second):
    """For the mean rate of a step of length h, f . (u1 - u0) = U1 - U0 + h * power, with power >= 0."""
    item, h = ITEMS[name], 0.3
    u0, u1 = np.array(first[:len(item.p0)]), np.array(second[:len(item.p0)])
    _, power, f = mean(item, u0, u1, (u1 - u0) / h)
    work = evaluate(item, u1)[0] - evaluate(item, u0)[0] + h * power
    assert f @ (u1 - u0) == pytest.approx(work, abs=1e-12 * (1 + np.abs(f * (u1 - u0)).sum()))
    assert power >= 0.0


@given(first=STEP, second=STEP)
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraints_are_met_at_the_end_and_do_the_work_of_their_change(name, first, second):
    item = ITEMS[name]
    u0, u1 = np.array(first[:len(item.p0)]), np.array(second[:len(item.p0)])
    lam = u1[-1]
    g0, g1 = (evaluate(item, u)[1][-1] for u in (u0, u1))
    _, _, f = mean(item, u0, u1)
    assert f[-1] == pytest.approx(g1, abs=1e-15)
    assert f[:-1] @ (u1 - u0)[:-1] == pytest.approx(lam * (g1 - g0), abs=1e-14)


@pytest.mark.parametrize("name", ITEMS)
def test_the_forces_of_short_steps_are_those_of_the_state(name):
    item = ITEMS[name]
    u, w = motion(item, 5)
    step = 1e-5 * w
    inner = slice(None)
    if LAWS[item.name].constraint:
        # the constraint itself is that of the end of the step
        step[-1], inner = 0.0, slice(-1)
    _, f, _, _ = evaluate(item, u, w)
    np.testing.assert_allclose(mean(item, u - step, u + step, w)[2][inner], f[inner], atol=1e-8)
    np.testing.assert_allclose(mean(item, u, u, w)[2], f, atol=1e-12)


def test_loads_take_the_mean_amplitude_of_a_step():
    for name in ("follower of theta", "follower of a direction", "moment on theta", "moment on a direction"):
        item = ITEMS[name]
        u, _ = motion(item, 6)
        f = mean(item, u, u, a0=np.array([1.0, 0, 0]), a1=np.array([2.0, 0, 0]))[2]
        np.testing.assert_allclose(f, evaluate(item, u, a=np.array([1.5, 0, 0]))[1], atol=1e-14)


@given(first=STEP, second=STEP)
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("name", [n for n in BALANCED if n[-2:] not in ("01", "02", "10", "20")])
def test_the_forces_of_a_step_have_no_moment_about_its_mid_point(name, first, second):
    """Angular momentum: internal forces have no moment on the mean of both states; a moment load has its own."""
    item = ITEMS[name]
    u0, u1 = 0.6 * np.array(first[:len(item.p0)]), 0.6 * np.array(second[:len(item.p0)])
    p, f = item.p0 + 0.5 * (u0 + u1), mean(item, u0, u1, u1 - u0)[2]
    # a force has its moment about the origin by what it acts on, not by the direction that it follows
    outer = item.vectors if item.name != "follower" else ()
    moment = sum(p[k] * f[k + 1] - p[k + 1] * f[k] for k in outer) + sum(f[k] for k in item.angles)
    own = -0.6 * A[0] if item.name == "moment" else 0.0
    assert moment == pytest.approx(own, abs=1e-12)


def test_the_force_of_a_step_is_that_of_the_mean_direction():
    item = ITEMS["follower of a direction"]
    (u0, _), (u1, _) = motion(item, 7), motion(item, 8)
    f = mean(item, u0, u1)[2]
    np.testing.assert_allclose(f, evaluate(item, 0.5 * (u0 + u1))[1], atol=1e-14)
    assert not f[2:].any()


def test_a_step_across_the_branch_cut_of_the_angle_keeps_its_energy():
    """From just below pi to just above: the angle continues beyond the range of the arc tangent."""
    item = ITEMS["torsion 02"]
    states = [np.array([1.3 * (np.cos(x) - 1), 1.3 * np.sin(x)]) for x in (3.0, 3.4)]
    energy, _, f = mean(item, *states, mem=np.array([0.0, 3.0]))
    assert energy == pytest.approx((3.4 - 0.3) ** 2)
    assert f @ (states[1] - states[0]) == pytest.approx(3.1**2 - 2.7**2)
