"""Laws of contact of two curves: derivatives, balance and invariance, for every section on both sides."""

from __future__ import annotations

import helpers
import numpy as np
import pytest
from test_contact_laws import OFFSETS, SECTIONS, differences

from ancf2d.elements import contact_bodies as laws
from ancf2d.elements import contact_gaps as gaps
from ancf2d.elements import contact_geometry as geometry

# sections of the body that has the point, and of the other one
ONE, TWO = ("curve", "theta", "tapered tangent"), ("curve", "tapered theta", "tangent")
# what the point is opposite to: the inside of an element, an end of it at a kink, the end of a body
PLACES = {"within": gaps.WITHIN, "kink": gaps.AT_LAST, "end": gaps.WITHIN}
# distance from the end of the other surface, and inclination, of points whose pressure fades
FADING = {"beside an end": (0.2, 0.0), "aslant": (0.4, 1.205), "aslant beside an end": (0.2, 1.205)}
KINDS = {"compliant": (laws.COMPLIANT_BODIES, 0.0), "damped": (laws.COMPLIANT_BODIES, 0.4),
         "hard": (laws.HARD_BODIES, 0.0)}
ROUGH = {"layer": laws.COMPLIANT_BODIES, "hard": laws.ROUGH_BODIES}


class Point:
    """A contact point of one bent curve within another, and the call of the law there."""

    def __init__(self, law, one, two, place, damping=0.0, depth=0.03, after=1.0, angle=0.0):
        rng = np.random.default_rng(5)
        (kind, terms), (other, others) = SECTIONS[one], SECTIONS[two]
        self.law, self.hard = law, law.constraint
        curve = np.zeros(gaps.BODY_SIZE)
        curve[[geometry.SECTION, geometry.TERMS]] = other, others
        curve[[geometry.OFFSET, geometry.SLOPE, geometry.BULGE]] = 0.7 * np.array(OFFSETS[two])
        curve[[gaps.SIGN, gaps.SPAN, gaps.BEFORE, gaps.AFTER, gaps.HALF, gaps.FADE]] = 1.0, 1.0, 1.0, after, 0.5, 0.3
        curve[gaps.DEEPEST] = 0.5
        face = -1.0
        if place == "end" and two != "curve":
            curve[[gaps.END, gaps.END_MIDDLE, gaps.END_HALF, gaps.SIGN, gaps.CORNER]] = 1.0, 0.01, 0.08, -1.0, -1.0
            curve[[geometry.SLOPE, geometry.BULGE]] = face = 0.0
        self.par = np.array([kind, terms, *OFFSETS[one], 0.3, 0.7, 100.0, damping, 0.0, 1.0, 1e-12, geometry.STILL, 0.0,
                             0.0, 1.0, face, 0.0, 0.0, 0.0, 0.0, *curve])

        def bent(section, count, angle=0.0):
            fields = 0.02 * rng.standard_normal((3 if "theta" in section else 2, count))
            fields[0, :2] += [0.1, 0.5]
            c, s = np.cos(angle), np.sin(angle)
            fields[:2] = np.array([[c, -s], [s, c]]) @ fields[:2]
            fields[2:, 0] += angle
            return fields

        self.sizes = [(3 if "theta" in one else 2) * terms, (3 if "theta" in two else 2) * others]
        self.p0 = np.concatenate([bent(one, terms, angle).ravel(), bent(two, others).ravel(), [0.0] * self.hard])
        self.u, self.w = np.zeros(len(self.p0)), np.zeros(len(self.p0))
        self.mem = np.zeros(gaps.BODY_MEMORY)
        self.mem[geometry.STATUS], self.mem[gaps.FOOT_KIND] = -1.0, PLACES[place]
        self.mem[gaps.FOOT] = 1.0 if place == "kink" else 0.2
        self.mem[gaps.SIDE] = curve[gaps.SIGN]
        self._move_to_depth(depth)
        if self.hard:
            self.u[-1] = -3.0
        elif damping:
            self.w[:] = 0.1 * rng.standard_normal(len(self.w))

    def _move_to_depth(self, depth):
        """Move the point to a given depth below the opposite place."""
        own, work, across = (np.zeros(geometry.WORK) for _ in range(3))
        m = self.sizes[0]
        other = self.par[geometry.OPPOSITE:]
        tx, ty, _, _ = gaps.curve_at(other, self.p0[m:], self.u[m:], self.mem[gaps.FOOT], work, across)
        geometry.position_at(self.par, self.p0, self.u, 0.3, own)
        n = other[gaps.SIGN] * np.array([-ty, tx]) / np.hypot(tx, ty)
        # beside a kink the straight way to it is not normal to the curve
        aside = 0.3 * depth * np.array([tx, ty]) / np.hypot(tx, ty) * (self.mem[gaps.FOOT_KIND] == gaps.AT_LAST)
        step = work[[geometry.RHO, geometry.RHO + 1]] - depth * n + aside - own[[geometry.RHO, geometry.RHO + 1]]
        terms = int(self.par[geometry.TERMS])
        self.p0[0] += step[0]
        self.p0[terms] += step[1]

    def __call__(self, u, w):
        m = len(u)
        f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
        energy, power = self.law.forces(self.p0, u, w, self.par, np.zeros(3), self.mem, f, H, C)
        return energy, f, H, C, power


@pytest.mark.slow_rows("compliant-curve-curve-within", "compliant-tapered tangent-tangent-end",
                       "compliant-theta-tapered theta-kink", "damped-curve-tapered theta-end")
@helpers.pairwise(kind=KINDS, one=ONE, two=TWO, place=PLACES)
def test_stiffness_and_damping_are_the_derivatives_of_the_forces(kind, one, two, place):
    law, damping = KINDS[kind]
    point = Point(law, one, two, place, damping)
    # whichever side is touched, nothing fades
    point.par[geometry.OPPOSITE + gaps.BOTH_SIDES] = 1.0
    _, f, H, C, power = point(point.u, point.w)
    assert np.abs(f).max() > 0.1
    size = 1.0 + np.abs(H).max()
    slope, *stiff = differences(lambda u: np.append(*point(u, point.w)[:2]), point.u)
    np.testing.assert_allclose(H, stiff, atol=1e-8 * size)
    np.testing.assert_allclose(C, differences(lambda w: point(point.u, w)[1], point.w), atol=1e-8 * size)
    if law is laws.COMPLIANT_BODIES and not damping:
        np.testing.assert_allclose(f, slope, atol=1e-8 * size)
    if damping:
        # what the forces do beside the potential is lost
        still = point(point.u, 0.0 * point.w)[1]
        assert power == pytest.approx((f - still) @ point.w, rel=1e-10)
    else:
        np.testing.assert_allclose(H, H.T, atol=1e-12 * size)


@helpers.pairwise(one=ONE, two=TWO, place=["within", "end"], fading=FADING, damping=[0.0, 0.4])
def test_pressure_that_fades_near_ends_has_a_potential(one, two, place, fading, damping):
    """Its stiffness is the derivative of its forces, up to terms of a higher order in the depth."""
    (away, angle), errors = FADING[fading], []
    for depth in (1e-2, 1e-3):
        # its foot point is 0.4 from the end of the curve
        point = Point(laws.COMPLIANT_BODIES, one, two, place, damping, depth, away - 0.4, angle)
        energy, f = point(point.u, 0.0 * point.w)[:2]
        whole = 0.5 * point.par[geometry.WEIGHT] * point.par[geometry.STIFFNESS] * depth**2
        assert 0.1 * whole < energy < 0.95 * whole
        # the energy does not depend on the velocity, so both derivatives come from the same calls
        slope, *stiff = differences(lambda u, p=point: np.append(*p(u, p.w)[:2]), point.u, h=1e-3 * depth)
        np.testing.assert_allclose(f, slope, atol=1e-7 * np.abs(f).max())
        check_balance(point, (one, two))
        _, moving, H, C, power = point(point.u, point.w)
        assert power == pytest.approx((moving - f) @ point.w, rel=1e-9, abs=1e-15)
        lossy = differences(lambda w, p=point: p(p.u, w)[1], point.w, linear=True)
        np.testing.assert_allclose(C, lossy, atol=1e-7 * np.abs(C).max())
        errors.append(np.abs(H - stiff).max() / np.abs(H).max())
    # at least of second order, beside an element of the length 1
    assert errors[0] < 2e-3
    assert errors[1] < 0.02 * errors[0]


# distance from the end, and depth: both less than the length of fading; only one; near the deepest penetration
CORNERS = [(0.1, 0.08), (0.1, 0.25), (0.1, 0.4), (0.4, 0.28), (0.4, 0.4), (1.0, 0.45)]


@helpers.pairwise(one=ONE, two=TWO, place=["within", "end"], corner=CORNERS)
def test_forces_in_corners_have_a_potential(one, two, place, corner):
    point = Point(laws.COMPLIANT_BODIES, one, two, place, 0.0, corner[1], corner[0] - 0.4, 0.9)
    f = point(point.u, point.w)[1]
    slope = differences(lambda u: np.array(point(u, point.w)[0]), point.u, h=1e-6)
    np.testing.assert_allclose(f, slope, atol=1e-6 * np.abs(f).max())
    check_balance(point, (one, two))


@pytest.mark.parametrize("corner", CORNERS)
def test_shares_have_their_derivatives_and_are_the_same_for_both_surfaces_of_a_corner(corner):
    point = Point(laws.COMPLIANT_BODIES, "curve", "theta", "within", after=0.0)
    own, h = np.zeros(geometry.WORK), 1e-6
    geometry.position_at(point.par, point.p0, point.u, 0.3, own)

    def shares(distance, depth):
        # the end of the other surface is at z = 1, half of it is 0.5 long
        return np.array(gaps.shares_at(point.par, point.mem, 0.0, 1.0, -depth, 1.0 - distance / 0.5, own))

    share, z, zz, g, gg, zg = shares(*corner)[:6]
    by_z = (shares(corner[0] - 0.5 * h, corner[1]) - shares(corner[0] + 0.5 * h, corner[1])) / (2.0 * h)
    by_g = (shares(corner[0], corner[1] - h) - shares(corner[0], corner[1] + h)) / (2.0 * h)
    size = 1e-7 * max(1.0, abs(np.array([z, zz, g, gg, zg])).max())
    np.testing.assert_allclose([z, zz, zg], by_z[[0, 1, 3]], atol=size)
    np.testing.assert_allclose([g, zg, gg], by_g[[0, 1, 3]], atol=size)
    if max(corner) < 0.33:
        assert shares(*corner[::-1])[0] * corner[0]**2 == pytest.approx(share * corner[1]**2, rel=1e-12)


def rubbing(one, two, place, slides, depth, law=laws.COMPLIANT_BODIES):
    """Return a point that sticks or slides by friction; without a law, in the state that the solver gives."""
    point = Point(law, one, two, place, 0.4, depth)
    other, m = point.par[geometry.OPPOSITE:], point.sizes[0]
    own, work, across = (np.zeros(geometry.WORK) for _ in range(3))
    z = gaps.gap_between(point.par, point.p0, point.u, point.mem, own, work, across)[3]
    tx, ty, _, _ = gaps.curve_at(other, point.p0[m:], point.u[m:], z, work, across)
    spot, unit = gaps.place_on(other, z, tx, ty)
    point.mem[[gaps.SURFACE, geometry.ANCHOR]] = other[gaps.NUMBER], spot - (0.5 if slides else 0.005) / unit
    point.par[[geometry.FRICTION, geometry.STICK, geometry.STIFFNESS]] = 0.3, 20.0, 1.0 / depth
    if law.constraint:
        point.mem[[geometry.STATUS, geometry.SLIP_STATUS]] = geometry.CLOSED, -1.0 if slides else geometry.STICKS
        point.u[-1] = -0.7
    return point


@pytest.mark.slow_rows("curve-curve-within-False-layer", "curve-tapered theta-end-True-hard",
                       "tapered tangent-curve-within-True-hard", "tapered tangent-tangent-end-True-layer",
                       "tapered tangent-tapered theta-within-False-layer", "theta-tapered theta-within-False-layer")
@helpers.pairwise(one=ONE, two=TWO, place=["within", "end"], slides=[False, True],
                  kind=ROUGH)
def test_friction_has_its_derivatives_except_by_depth_and_dissipates_its_power(one, two, place, slides, kind):
    depth = 1e-3
    point, plain = (rubbing(one, two, place, slides, depth, ROUGH[kind]) for _ in range(2))
    plain.par[geometry.FRICTION] = 0.0

    def friction(u, w):
        return [a - b for a, b in zip(point(u, w), plain(u, w), strict=True)]

    _, f, H, C, power = friction(point.u, point.w)
    size = np.abs(f).max()
    assert size > 0.05
    # what is left out is of the size of the depth, beside an element of the length 1 or an end of the height 0.16
    left_out = depth / (0.16 if place == "end" else 1.0)
    np.testing.assert_allclose(H, differences(lambda u: friction(u, point.w)[1], point.u, linear=True),
                               atol=10 * left_out * size)
    np.testing.assert_allclose(C, differences(lambda w: friction(point.u, w)[1], point.w, linear=True),
                               atol=1e-7 * size)
    assert power == pytest.approx(f @ point.w, rel=1e-10)
    # at its limit where it slides, along the curve
    pushes = np.hypot(*_resultant(plain, (one, two)))
    drags = np.hypot(*_resultant(point, (one, two)))
    assert np.sqrt(drags**2 - pushes**2) / pushes == pytest.approx(0.3, rel=1e-2) if slides else drags > pushes


def _resultant(point, sections):
    sets = 3 if "theta" in sections[0] else 2
    return point(point.u, point.w)[1][:point.sizes[0]].reshape(sets, -1)[:2, 0]


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("two", TWO)
@pytest.mark.parametrize("one", ONE)
def test_the_two_bodies_are_in_balance(one, two, place, friction):
    check_balance(rubbing(one, two, place, True, 0.03) if friction else Point(laws.COMPLIANT_BODIES, one, two, place),
                  (one, two))


def check_balance(point, sections):
    """Force and moment of both bodies vanish together."""
    f, start = point(point.u, point.w)[1], 0
    total = np.zeros(3)
    for section, size in zip(sections, point.sizes, strict=True):
        sets = 3 if "theta" in section else 2
        own, fields = f[start:start + size].reshape(sets, -1), point.p0[start:start + size].reshape(sets, -1)
        total[:2] += own[:2, 0]
        # a turn by a unit of all that turns
        total[2] += fields[0] @ own[1] - fields[1] @ own[0] + (own[2, 0] if sets == 3 else 0.0)
        start += size
    np.testing.assert_allclose(total, 0.0, atol=1e-12 * np.abs(f).max())


def test_no_force_where_bodies_are_apart_or_nothing_is_opposite():
    for law in (laws.COMPLIANT_BODIES, laws.HARD_BODIES):
        point = Point(law, "curve", "theta", "within")
        point.u[-1] = 0.0
        apart = point.u.copy()
        apart[4] += 0.1
        assert not point(apart, point.w)[1][:8].any()
        assert point(point.u, point.w)[1].any()
        point.mem[gaps.FOOT_KIND] = gaps.NOWHERE
        assert not point(point.u, point.w)[1].any()
