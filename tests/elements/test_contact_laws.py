"""Laws of contact: forces and stiffness as derivatives of gap and energy, for every section, pose and obstacle."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import pairwise

from ancf2d.elements import contact_geometry as geometry
from ancf2d.elements import contact_sliding as sliding
from ancf2d.elements.contact import COMPLIANT, HARD
from ancf2d.elements.point_laws import APART

# what describes each obstacle, as its shape() gives it
SHAPES = {"half plane": [geometry.HALF_PLANE, 0.0, 0.3, np.sin(0.2), np.cos(0.2)],
          "circle": [geometry.CIRCLE, 0.1, -0.6, 1.0], "pipe": [geometry.CIRCLE, 0.0, 0.0, -0.3],
          "polyline": [geometry.POLYLINE, 3, -1.0, 0.25, 0.0, 0.0, 0.2, 0.4, 0.4, 1.0, 0.3, 1.2]}
SECTIONS = {"curve": (geometry.CURVE, 4), "theta": (geometry.OF_THETA, 3), "tangent": (geometry.OF_TANGENT, 4)}
SECTIONS |= {"tapered theta": SECTIONS["theta"], "tapered tangent": SECTIONS["tangent"]}
# distance from the axis as a polynomial of z, 0.1 at the home of the point
OFFSETS = {name: (0.0988, 0.01, -0.02) if "tapered" in name else (0.1, 0.0, 0.0) for name in SECTIONS}
POSES = {"still": (geometry.STILL, 0), "angle": (geometry.BY_ANGLE, 3), "direction": (geometry.BY_DIRECTION, 4)}
LENGTH = 1.3


class Point:
    """A contact point of a bent curve, an obstacle somewhere on the curve, and the call of the law there."""

    def __init__(self, law, section, pose, shape, friction=0.0, free=False, damping=0.0, bends=0.0):
        rng = np.random.default_rng(3)
        kind, terms = SECTIONS[section]
        how, entries = POSES[pose]
        self.law = law
        self.par = np.array([kind, terms, *OFFSETS[section], 0.3, 0.7, 100.0, damping, friction, 50.0, 1e-12, how, 0.1,
                             -0.05, LENGTH, 0.0, 0.7, bends, 0.0, *SHAPES[shape]])
        curve = 0.02 * rng.standard_normal((3 if kind == geometry.OF_THETA else 2, terms))
        curve[0, :2] += [0.1, 0.5]
        curve[1, 0] += 0.12
        # free points stand where the gap is least: the curve bends towards the solid
        curve[1, 2] = -0.2 if shape == "pipe" else 0.2
        moved = [0.1, -0.05, *([0.0] if entries == 3 else [LENGTH, 0.0])] if entries else []
        self.p0 = np.concatenate([curve.ravel(), np.array(moved) + 0.02 * rng.standard_normal(entries)])
        if law is HARD:
            self.p0 = np.append(self.p0, 0.0)
        self.u = np.zeros(len(self.p0))
        self.w = np.zeros(len(self.p0))
        if law is HARD:
            self.u[-1] = -3.0
        elif damping:
            self.w[:] = 0.3 * rng.standard_normal(len(self.w))
        self.mem = np.zeros(geometry.MEMORY)
        self.mem[geometry.PLACEMENT] = float(free)
        self.mem[geometry.PLACE], self.mem[geometry.START_GAP] = 0.1, geometry.OUTSIDE
        self.mem[geometry.STATUS] = geometry.BY_FORCE
        # the corner of the polyline
        self.mem[geometry.FEATURE] = 3.0 if shape == "polyline" else 0.0

    def __call__(self, u, w):
        m = len(u)
        f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
        energy, self.power = self.law.forces(self.p0, u, w, self.par, np.zeros(3), self.mem, f, H, C)
        return energy, f, H, C


def differences(function, x, h=1e-5, linear=False):
    """Return d function/dx (..., n) by central differences of fourth order, or second order if that suffices."""
    out = []
    for e in h * np.eye(len(x)):
        near = function(x + e) - function(x - e)
        far = 2 * near if linear else function(x + 2 * e) - function(x - 2 * e)
        out.append((8 * near - far) / (12 * h))
    return np.stack(out, axis=-1)


# law, friction, damping (half the interval without a law), whether it is free along the body, how it yields
CONTACTS = {"compliant": (COMPLIANT, 0.0, 0.0, 0), "compliant, slips": (COMPLIANT, 0.3, 0.4, 0),
            "compliant, sticks": (COMPLIANT, 100.0, 0.4, 0), "hard": (HARD, 0.0, 0.0, 0),
            "hard, slips": (HARD, 0.3, 0.0, 0), "hard, sticks": (HARD, 100.0, 0.0, 0),
            "hard, slides": (HARD, 0.0, 0.0, 1), "hard, slides and yields": (HARD, 0.0, 1.1, 1, 3.0),
            "hard, stands and yields": (HARD, 0.3, 1.1, 2, 3.0)}


@pairwise(contact=CONTACTS, section=SECTIONS, pose=POSES, shape=SHAPES)
def test_stiffness_and_damping_are_the_derivatives_of_the_forces(contact, section, pose, shape):
    law, friction, damping, free, *bends = CONTACTS[contact]
    point = Point(law, section, pose, shape, friction, free, damping, *bends)
    if law is HARD:
        point.mem[geometry.STATUS] = geometry.CLOSED
    _, f, H, C = point(point.u, point.w)
    size = 1.0 + np.abs(H).max()
    # a layer in a pipe may be apart from it
    assert f[0] != 0.0 or (law is COMPLIANT and shape == "pipe")
    np.testing.assert_allclose(H, differences(lambda u: point(u, point.w)[1], point.u), atol=1e-8 * size)
    np.testing.assert_allclose(C, differences(lambda w: point(point.u, w)[1], point.w), atol=1e-8 * size)
    if law is COMPLIANT and not friction:
        slope = differences(lambda u: np.array(point(u, point.w)[0]), point.u)
        np.testing.assert_allclose(f, slope, atol=1e-8 * size)


@pytest.mark.parametrize("force", [0.0, 3.0])
@pytest.mark.parametrize("shape", ["circle", "polyline"])
def test_a_point_moves_to_the_least_gap_within_the_flexibility_of_the_beam(shape, force):
    point = Point(HARD, "curve", "still", shape, free=1, damping=1.1, bends=0.1)
    work = np.zeros(geometry.WORK)
    z = sliding.sliding_place(point.par, point.p0, point.u, point.mem, force, work)

    def least(z):
        geometry.position_at(point.par, point.p0, point.u, z, work)
        to, radius = ((0.1, -0.6), 1.0) if shape == "circle" else ((0.2, 0.4), 0.0)
        gap = np.hypot(work[geometry.RHO] - to[0], work[geometry.RHO + 1] - to[1]) - radius
        if shape == "polyline" and work[geometry.RHO + 1] < 0.4:
            gap = -gap
        return gap + 0.5 * force * sliding.compliance(point.par, z)[0]

    assert abs(z) < 1.0
    slopes = [least(z + h) - least(z - h) for h in (1e-4, 1e-3)]
    np.testing.assert_allclose(slopes, 0.0, atol=1e-9)


def test_a_point_on_a_corner_presses_normal_to_the_curve():
    """Its place is the corner; the forces there are the limit of those next to it."""
    point = Point(HARD, "curve", "still", "polyline", free=1)
    work = np.zeros(geometry.WORK)
    # a straight curve from the left to the right through (0.2, 0.4), where z is 0.5
    point.p0[:4], point.p0[4:8] = [0.0, 0.4, 0.0, 0.0], [0.4, 0.0, 0.0, 0.0]
    point.mem[geometry.PLACE] = -0.6
    assert sliding.sliding_place(point.par, point.p0, point.u, point.mem, 3.0, work) == pytest.approx(0.5, abs=1e-12)
    found = []
    for up in (0.0, 1e-9):
        point.p0[4] = 0.4 + up
        found.append(point(point.u, point.w)[1:3])
    for on, beside in zip(*found, strict=True):
        np.testing.assert_allclose(on, beside, atol=1e-6)
    # (0, 1) at z = 0.5, in powers of z
    np.testing.assert_allclose(found[0][0][4:8], -3.0 * 0.5**np.arange(4), rtol=1e-9)


def test_the_flexibility_between_two_places_is_that_of_a_clamped_beam():
    """Deflection of a clamped beam at b under a force at a (Roark's formulas, table 8.1, 1d)."""
    point = Point(HARD, "curve", "still", "circle", damping=0.5, bends=2.0 / 3.0)
    home, EI, length = point.par[geometry.HOME], 0.5, 1.0

    def deflection(x, a):
        if x > a:
            x, a = length - x, length - a
        b = length - a
        return b * b * x * x * (3.0 * a * length - 3.0 * a * x - b * x) / (6.0 * EI * length**3)

    for x, a in ((0.2, 0.7), (0.5, 0.5), (0.9, 0.3), (0.35, 0.35)):
        found = sliding.compliance_between(point.par, home + x - 0.5, home + a - 0.5)
        assert found == pytest.approx(deflection(x, a), rel=1e-12)
    assert sliding.compliance(point.par, home + 0.15)[0] == pytest.approx(deflection(0.65, 0.65), rel=1e-12)


def test_open_points_have_no_force_and_closed_ones_never_pull():
    point = Point(HARD, "curve", "still", "half plane")
    away, pulled = point.u.copy(), point.u.copy()
    away[4], away[-1] = 10.0, 0.0
    pulled[-1] = 1e4
    for u in (away, pulled):
        _, f, H, _ = point(u, point.w)
        assert not f[:-1].any()
        assert f[-1] == -u[-1] / 100.0
        assert H[-1, -1] == -0.01


def test_the_back_of_a_body_does_not_touch():
    point = Point(COMPLIANT, "curve", "still", "circle")
    assert point(point.u, point.w)[1].any()
    for side, touches in ((1.0, False), (-1.0, True)):
        point.par[geometry.FACE] = side
        assert point(point.u, point.w)[1].any() == touches


def gap_of(point):
    """Return the gap of a point where it is."""
    work = np.zeros(geometry.WORK)
    geometry.position_at(point.par, point.p0, point.u, point.par[geometry.HOME], work)
    return geometry.gap_at(point.par, work[geometry.RHO], work[geometry.RHO + 1], -1.0)[0]


@pytest.mark.parametrize("law", [COMPLIANT, HARD], ids=["layer", "hard"])
def test_a_back_inside_an_obstacle_presses_from_the_gap_at_which_it_turns(law):
    """The energy of the layer and its forces are 0 there, so nothing jumps; outside the obstacle nothing changes."""
    point = Point(law, "curve", "still", "circle")
    if law is HARD:
        point.u[-1] = 0.0
    deep = point.u.copy()

    def accept():
        law.accept(point.p0, point.u, point.par, point.mem)
        return point.mem[geometry.START_GAP]

    def touches():
        energy, f, _, _ = point(point.u, point.w)
        return energy > 0.0 or f[:-1].any() if law is COMPLIANT else f[-1] != -point.u[-1] / 100.0

    point.par[geometry.FACE] = 1.0
    first = gap_of(point)
    assert first < 0.0
    assert not touches()
    assert accept() == geometry.UNTOUCHED
    point.par[geometry.FACE] = -1.0
    assert not touches()
    assert accept() == pytest.approx(first, abs=2e-12)
    assert not (touches() and law is COMPLIANT)
    point.u[4] -= 0.01
    energy, f, _, _ = point(point.u, point.w)
    if law is COMPLIANT:
        # 1/2 w k g^2 of what it is deeper
        assert energy == pytest.approx(0.5 * 0.7 * 100.0 * (gap_of(point) - first)**2, rel=1e-12)
    else:
        assert f[-1] == pytest.approx(gap_of(point) - first, rel=1e-9)
    point.u[4] += 10.0
    assert accept() == geometry.OUTSIDE
    point.u[:] = deep
    assert touches()


@pytest.mark.parametrize("law", [COMPLIANT, HARD], ids=["layer", "hard"])
def test_a_pressing_point_keeps_pressing_when_its_face_turns_away(law):
    point = Point(law, "curve", "still", "circle")
    point.par[geometry.FACE] = -1.0
    law.accept(point.p0, point.u, point.par, point.mem)
    assert point.mem[geometry.START_GAP] == 0.0
    before = point(point.u, point.w)
    point.par[geometry.FACE] = 1.0
    for one, other in zip(before, point(point.u, point.w), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("law", [COMPLIANT, HARD], ids=["layer", "hard"])
@pytest.mark.parametrize("pose", ["still", "angle"])
def test_a_face_has_the_direction_of_its_section_even_if_the_axis_is_sheared(law, pose):
    """Two elements share the section at a node, but not the slope of the axis. The disc is below."""
    point = Point(law, "theta", pose, "circle")
    point.p0[6:9] = 0.0
    point.par[[geometry.FACE, geometry.OFFSET]] = 1.0, 1e-3
    # radius 1 about (0.1, -0.6): the axis goes up steeply there
    point.p0[:3], point.p0[3:6] = [0.1, 0.2, 0.0], [0.0, 0.9, 0.0]
    found = []
    for theta in (0.0, np.pi):
        point.p0[6] = theta
        found.append(bool(point(point.u, point.w)[1][:-1].any()))
    # the upper face of a section that stands upright looks away from the disc, and is opposite to it upside down
    assert found == [False, True]


@pytest.mark.slow_rows("tangent-angle-pipe--0.86")
@pairwise(section=SECTIONS, pose=POSES, shape=SHAPES, home=[-0.86, 0.3])
def test_points_of_a_curve_together_are_the_sum_of_single_points(section, pose, shape, home):
    """The first one decides whether the curve is apart from the obstacle; then the others have no force."""
    point, rng = Point(COMPLIANT, section, pose, shape, 0.3, damping=0.4), np.random.default_rng(7)
    terms = SECTIONS[section][1]
    if shape == "polyline":
        # closed
        point.par[geometry.OPPOSITE + 1] = 3.0
    places = [home, *np.linspace(-1.0, 1.0, 9)]
    par, mem = np.tile(point.par, (len(places), 1)), np.tile(point.mem, (len(places), 1))
    par[:, geometry.HOME] = places
    apart, touching, m = 0, 0, len(point.u)
    for _ in range(60):
        u = 0.1 * rng.standard_normal(m)
        # to all sides, further than the curve is long and nearer
        u[[0, terms]] += rng.uniform(-0.3, 0.3, 2) if shape == "pipe" else rng.uniform(-4.0, 4.0, 2)
        f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
        energy, power = COMPLIANT.forces_of_run(point.p0, u, point.w, par, np.zeros(3), mem, f, H, C)
        alone = []
        for z in places:
            point.par[geometry.HOME] = z
            alone.append((*point(u, point.w), point.power))
        # where nothing acts, energy and power are a distance and a mark
        found = (0.0, f, H, C, 0.0) if power == APART else (energy, f, H, C, power)
        for total, parts in zip(found, zip(*alone, strict=True), strict=True):
            np.testing.assert_allclose(total, sum(parts), rtol=1e-12, atol=1e-12 * np.abs(H).max())
        apart, touching = apart + (power == APART), touching + (energy > 0.0)
    assert touching > 0
    # a curve that is longer than the pipe is wide is never apart from it
    assert apart > 3 or shape == "pipe"


def test_a_point_beyond_an_open_polyline_has_no_force_and_no_bound():
    point = Point(COMPLIANT, "curve", "still", "polyline")
    point.u[4] = 50.0
    assert point(point.u, point.w)[0] == 0.0
    assert geometry.bound_on_distance(point.par, point.p0, point.u, 0.3) == np.inf


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_hard_point_cannot_touch_before_its_fields_change_by_its_distance(section, pose, shape):
    """The sum of their changes is a bound, also if sections and obstacles rotate."""
    point, rng, said = Point(HARD, section, pose, shape), np.random.default_rng(11), 0
    if shape == "polyline":
        # closed
        point.par[geometry.OPPOSITE + 1] = 3.0
    point.u[-1] = 0.0
    terms, start = SECTIONS[section][1], point.u.copy()
    for _ in range(60):
        point.u[:] = start
        point.u[[0, terms]] += rng.uniform(-0.3, 0.3, 2) if shape == "pipe" else rng.uniform(-2.0, 2.0, 2)
        there = point.u.copy()
        far = point.law.forces(point.p0, there, point.w, point.par, np.zeros(3), point.mem, np.zeros(len(there)),
                               np.zeros((len(there),) * 2), np.zeros((len(there),) * 2))
        if far[1] != APART or far[0] == 0.0:
            continue
        said += 1
        for _ in range(8):
            change = rng.standard_normal(len(there) - 1) * rng.integers(0, 2, len(there) - 1)
            point.u[:-1] = there[:-1] + 0.999 * far[0] * change / max(np.abs(change).sum(), 1e-300)
            assert gap_of(point) > 0.0
    # a pipe is hardly wider than the section is high
    assert said > (0 if shape == "pipe" else 3)
