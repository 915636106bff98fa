"""References of beams in contact, checked against each other, their limits and published numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from instruments.references import contacts as c
from instruments.references.statics import Beam, cantilever, march, shoot
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import beta

SLIM = Beam(math.inf, math.inf, 1.0)


def test_a_strip_lies_on_the_drum_beyond_the_limit_of_point_contact() -> None:
    R = 2.0
    # just as it begins to lie on the drum it is a cantilever whose moment at the clamp is EI/R
    force = brentq(lambda f: f * (1 + cantilever(SLIM, 1.0, [0, -f])[0]) - 1 / R, 0.5, 0.6)
    with pytest.raises(ValueError, match="does not touch"):
        c.strip_on_drum(1.0, 1.0, R, force * (1 - 1e-6))
    tip = np.array([1.0, 0.0]) + cantilever(SLIM, 1.0, [0, -force])[:2]
    np.testing.assert_allclose(c.strip_on_drum(1.0, 1.0, R, force * (1 + 1e-7)).tip, tip, rtol=1e-6)
    wrapped = c.strip_on_drum(1.0, 1.0, R, 0.9)
    # marched from the lift-off with the moment EI/R, the moment at the tip vanishes
    a = wrapped.angle
    start = [R * math.sin(a), -R * (1 - math.cos(a)), -a, -1 / R]
    end = march(SLIM, start, np.array([0, -0.9]), 1.0 - R * a)
    np.testing.assert_allclose(end[:2], wrapped.tip, rtol=1e-10)
    assert abs(end[3]) < 1e-10
    # what the drum does, all of it along its normals, holds the force without a shear force at the clamp
    up = wrapped.pressure * R * math.sin(a) + wrapped.point * math.cos(a)
    assert up == pytest.approx(0.9, rel=1e-12)


def test_a_strip_touches_a_drum_at_a_point_before_it_lies_on_it() -> None:
    # a stiff, short drum under the middle: Castigliano's propped cantilever, its prop in the middle, at small loads
    force, drop = 1e-4, 1e-9
    tip, s, p = c.strip_at_drum(SLIM, 1.0, (0.5, -drop - 1e-3), 1e-3, force, (-1e-5, 0.5, 2.5))
    # w(1/2) = 0: force 5/48 = p/24
    assert s == pytest.approx(0.5, abs=1e-4)
    assert p == pytest.approx(2.5 * force, rel=1e-3)
    assert tip[1] == pytest.approx(-force * (1 / 3 - 2.5 * 5 / 48), rel=1e-3)


def test_a_ring_flattens_where_the_curvature_at_the_plates_vanishes() -> None:
    assert pytest.approx(0.5 * beta(0.25, 0.5), rel=1e-14) == c.QUARTER_LENGTH
    assert pytest.approx(0.5 * beta(0.75, 0.5), rel=1e-14) == c.QUARTER_HEIGHT
    P = c.ring_flattens(1.0, 1.0)
    assert pytest.approx(2.7864, rel=1e-4) == P
    below, above = c.ring_between_plates(1.0, 1.0, P * (1 - 1e-7)), c.ring_between_plates(1.0, 1.0, P * (1 + 1e-7))
    assert below[0] == pytest.approx(above[0], rel=1e-5)
    assert below[1] == 0.0 < above[1] < 1e-6
    # small forces: P R^3/EI (pi/4 - 2/pi) (Timoshenko)
    small = 2.0 - c.ring_between_plates(1.0, 1.0, 1e-4)[0]
    assert small == pytest.approx(1e-4 * (math.pi / 4 - 2 / math.pi), rel=1e-3)


def test_the_work_of_the_plates_is_the_energy_of_the_ring() -> None:
    # beyond flattening: 4 quarters with kappa = sqrt(P sin theta), and a flat part that was curved
    P = 2.0 * c.ring_flattens(1.0, 1.0)
    height, flat = c.ring_between_plates(1.0, 1.0, P)
    # int (kappa - 1)^2/2 ds = int (kappa/2 - 1 + 1/(2 kappa)) dtheta, kappa = sqrt(P sin theta)
    bent = quad(lambda t: 0.5 * math.sqrt(P * math.sin(t)) - 1.0, 0.0, math.pi / 2)[0]
    energy = 4.0 * (bent + 0.5 * c.QUARTER_LENGTH / math.sqrt(P)) + 2.0 * 0.5 * flat
    # work = int P d(2R - height) = P (2 - height) - int (2 - height) dP
    complementary = quad(lambda f: 2.0 - c.ring_between_plates(1.0, 1.0, f)[0], 1e-9, P, limit=200,
                         points=[c.ring_flattens(1.0, 1.0)], epsabs=1e-8)[0]
    assert P * (2.0 - height) - complementary == pytest.approx(energy, rel=1e-6)


def test_a_flat_beam_on_knife_edges_is_simply_supported() -> None:
    force, sag = c.on_knife_edges(1.0, 0.5, 1e-4)
    assert sag == pytest.approx(force / 48, rel=1e-6)
    most, _ = c.most_on_knife_edges(1.0, 0.5)
    assert all(c.on_knife_edges(1.0, 0.5, a)[0] <= most for a in np.linspace(0.1, 1.5, 50))
    # the same by marching from the middle to supports that push along the normal of the beam, with nothing beyond them
    force, sag = c.on_knife_edges(1.0, 0.5, 0.8, radius=0.1)

    def end(q: np.ndarray) -> np.ndarray:
        return march(SLIM, [0, -sag, 0, q[0]], 0.5 * force * np.array([-math.tan(0.8), 1.0]), q[1])

    q = shoot(lambda q: end(q)[2:] - [0.8, 0.0], [1.5, 0.6])
    support = np.array([0.5, -0.1]) + 0.1 * np.array([-math.sin(0.8), math.cos(0.8)])
    np.testing.assert_allclose(end(q)[:2], support, atol=1e-10)


def test_a_heavy_beam_lifts_off_the_floor_as_for_small_rotations() -> None:
    length, force = c.lifted_from_floor(1.0, 1e-3, 1e-4)
    far, end = c.lifted_far(1.0, 1e-3, force)
    assert far == pytest.approx(length, rel=1e-5)
    assert end[1] == pytest.approx(1e-4, rel=1e-5)


def test_stages_between_walls_follow_one_another() -> None:
    # published: 4, 16 and 36 pi^2 EI/L^2 (Domokos, Holmes & Royce 1997)
    P = math.pi**2
    stages = [c.between_walls(1.0, 1.0, 0.01, x * P)[0] for x in (3.9, 4.1, 15.9, 16.1, 35.9, 36.1)]
    assert stages == ["straight", "point", "point", "line", "line", "buckled again"]
    # one full wave has the shortening (pi gap/2)^2/L, and nothing jumps between point and line
    assert c.between_walls(1.0, 1.0, 0.01, 4 * P * (1 + 1e-9))[1] == pytest.approx((0.005 * math.pi) ** 2, rel=1e-6)
    before, after = (c.between_walls(1.0, 1.0, 0.01, 16 * P * (1 + x))[1] for x in (-1e-9, 1e-9))
    assert before == pytest.approx(after, rel=1e-6)


def test_rolling_discs_agree_with_the_end_of_bowled_ones() -> None:
    t, v = c.bowled(3.0, 0.2, 9.81, 0.5)
    assert v == pytest.approx(2.0)
    assert t == pytest.approx(1.0 / (0.2 * 9.81))
    steep = math.atan(0.2 * 3.0)
    for a in (steep - 1e-9, steep + 1e-9):
        s, turned = c.rolls_down(a, 0.2, 9.81, 1.0, 0.5)
        assert s == pytest.approx(turned, rel=1e-6)


def test_impacts_satisfy_their_conservation_laws() -> None:
    duration, force, after = c.bar_against_wall(4.0, 1.0, 3.0, 0.1)
    # a stiff layer is a wall
    pressed, impulse = c.bar_against_layer(4.0, 1.0, 3.0, 0.1, 1e5, 0.5 * duration)
    assert (pressed, impulse) == pytest.approx((force, 0.5 * duration * force), rel=1e-4)
    assert c.bar_against_layer(4.0, 1.0, 3.0, 0.1, 1e5, 2.0 * duration) == pytest.approx((0.0, 3.0 * 0.2), rel=1e-4)
    # of a soft one the impulse is the integral of the force
    soft = [c.bar_against_layer(4.0, 1.0, 3.0, 0.1, 9.0, t) for t in np.linspace(0.0, 4.0, 4001)]
    assert np.trapezoid([p for p, _ in soft], dx=1e-3) == pytest.approx(soft[-1][1], rel=1e-5)
    # impulse
    assert duration * force == pytest.approx(1.0 * 3.0 * (0.1 - after))
    assert c.far_end_of_bar(4.0, 1.0, 3.0, 0.1, duration) == pytest.approx(0.0)
    v, omega, p = c.struck_rod(2.0, 0.3, 0.4, 1.5, 1.0)
    assert 0.5 * 2.0 * v**2 + 0.5 * 0.3 * omega**2 == pytest.approx(0.5 * 2.0 * 1.5**2)
    assert v + 0.4 * omega == pytest.approx(1.5)
    assert p > 0
    times, heights = c.bounces(1.0, 0.5, 9.81, 2)
    assert heights == pytest.approx([0.25, 0.0625])
    assert times[1] - times[0] == pytest.approx(times[0])
