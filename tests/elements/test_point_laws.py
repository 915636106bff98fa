"""Point laws: forces, stiffness and damping as derivatives, and rotations of the whole scene."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case.syntax import Names, syntax
from ancf2d.elements.point_laws import DIRECTION, GROUND, MAX_MEM, THETA, half_sine
from ancf2d.interactions.flow import FLOW, TURNING
from ancf2d.interactions.forces import FOLLOWER, MOMENT, position_law
from ancf2d.interactions.formulas import ALONG_BODY, LOCAL
from ancf2d.interactions.spring_laws import count_turns, over_sine, spring_law
from ancf2d.interactions.springs import RotationalSpring, TranslationalSpring
from ancf2d.model.constraints import ALIGNED, AT_ANGLE, FIXED_LENGTH
from ancf2d.model.point_patch import formula_record
from ancf2d.model.switched import HELD, HELD_ALIGNED, HELD_ANGLE


def hardening(s, rate, par):
    """Return energy, N, dN/ds and dN/dr of a hardening spring with a damper that is quadratic in the rate."""
    k, c = par[0], par[1]
    return k * (s**2 / 2 + s**4), k * (s + 4 * s**3) + c * rate * abs(rate), k * (1 + 12 * s * s), 2 * c * abs(rate)


LAWS = {**{law.name: law for law in (FOLLOWER, MOMENT, AT_ANGLE, ALIGNED, FIXED_LENGTH, HELD, HELD_ALIGNED,
                                        HELD_ANGLE)},
        "translational": TranslationalSpring.law, "rotational": RotationalSpring.law,
        "hardening": spring_law("hardening", False, hardening),
        "hardening angle": spring_law("hardening angle", True, hardening)}
TURNS = [(a, b) for a in (GROUND, THETA, DIRECTION) for b in (GROUND, THETA, DIRECTION) if (a, b) != (GROUND, GROUND)]
RAW = {THETA: [0.0], DIRECTION: [1.3, 0.0], GROUND: []}


class Item(NamedTuple):
    """A law with constants and reference.

    ``vectors`` are the first fields of pairs that turn with the scene, ``angles`` the fields that then grow.
    """

    name: str
    p0: np.ndarray
    par: np.ndarray
    vectors: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()


def _item(name, p0, par, vectors=(), angles=()):
    return Item(name, np.array(p0, dtype=float), np.array(par, dtype=float), vectors, angles)


def _rotational(a, b, name="rotational", acts=(0.0, 0.0)):
    at_b = len(RAW[a])
    vectors = ([0] if a == DIRECTION else []) + ([at_b] if b == DIRECTION else [])
    angles = ([0] if a == THETA else []) + ([at_b] if b == THETA else [])
    return _item(name, [*RAW[a], *RAW[b]], [0.3, a, b, 2.0, 0.7, *acts], tuple(vectors), tuple(angles))


ITEMS = {
    "spring": _item("translational", [0.6, -0.8], [0.7, 1.0, 3.0, 0.4, 0.0, 0.0], (0,)),
    "relaxed spring": _item("translational", [0.6, -0.8], [1.0, 1.0, 3.0, 0.4, 0.0, 0.0], (0,)),
    "spring without length": _item("translational", [0.0, 0.0], [0.0, 0.0, 3.0, 0.4, 0.0, 0.0], (0,)),
    "stop": _item("translational", [0.6, -0.8], [0.7, 1.0, 3.0, 0.4, -0.03, 0.03], (0,)),
    "cable": _item("translational", [0.6, -0.8], [0.3, 1.0, 3.0, 0.4, -np.inf, 0.0], (0,)),
    "stop of an angle": _rotational(DIRECTION, DIRECTION, acts=(-0.02, 0.02)),
    **{f"torsion {a}{b}": _rotational(a, b) for a, b in TURNS},
    "hardening spring": _item("hardening", [0.6, -0.8], [0.7, 1.0, 3.0, 0.4], (0,)),
    "hardening torsion": _rotational(DIRECTION, DIRECTION, "hardening angle"),
    "follower of theta": _item("follower", [0.0, 0.0, 0.0], [0.3, -0.7, THETA], (0,), (2,)),
    "follower of a direction": _item("follower", [0.0, 0.0, 1.3, 0.0], [0.3, -0.7, DIRECTION], (0, 2)),
    "moment on theta": _item("moment", [0.0], [0.6, THETA], (), (0,)),
    "moment on a direction": _item("moment", [1.3, 0.0], [0.6, DIRECTION], (0,)),
    "direction at an angle": _item("at_angle", [1.3, 0.0, 0.0, 0.0], [], (0,), (2,)),
    "directions aligned": _item("aligned", [1.3, 0.0, 0.8, 0.0, 0.0], [], (0, 2)),
    "fixed length": _item("fixed_length", [1.2, -1.6, 0.0], [2.0], (0,)),
    "held": _item("held", [0.0, 0.0, 0.0], []),
    "direction held": _item("held_angle", [1.3, 0.0, 0.0], [], (0,)),
    "directions held": _item("held_aligned", [1.3, 0.0, 0.8, 0.0, 0.0], [], (0, 2)),
}
ELASTIC = [n for n, i in ITEMS.items() if i.name in ("translational", "rotational", "hardening", "hardening angle")]
CONSTRAINTS = [n for n, i in ITEMS.items() if LAWS[i.name].constraint]
STEP = st.lists(st.floats(-0.8, 0.8, allow_nan=False), min_size=6, max_size=6)
A = np.array([1.7, 0.4, -0.2])


def evaluate(item, u, w=None, mem=None, a=A):
    m = len(item.p0)
    w, mem = np.zeros(m) if w is None else w, np.zeros(MAX_MEM) if mem is None else mem
    f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
    energy, _ = LAWS[item.name].forces(item.p0, u, w, item.par, a, mem, f, H, C)
    return energy, f, H, C


def motion(item, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.4, 0.4, len(item.p0)), rng.uniform(-1, 1, len(item.p0))


def differences(function, x, h=1e-5):
    """Return d function/dx (..., n) by central differences of fourth order."""
    columns = []
    for k in range(len(x)):
        e = np.zeros(len(x))
        e[k] = h
        near, far = function(x + e) - function(x - e), function(x + 2 * e) - function(x - 2 * e)
        columns.append((8 * near - far) / (12 * h))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("name", ITEMS)
def test_stiffness_and_damping_are_the_derivatives_of_the_forces(name):
    item = ITEMS[name]
    u, w = motion(item, 1)
    _, _, H, C = evaluate(item, u, w)
    np.testing.assert_allclose(H, differences(lambda x: evaluate(item, x, w)[1], u), atol=1e-9)
    np.testing.assert_allclose(C, differences(lambda x: evaluate(item, u, x)[1], w), atol=1e-9)
    assert np.abs(H).max() > 0.1 or name == "moment on theta"
    if LAWS[item.name].symmetric:
        H = evaluate(item, u)[2]
        np.testing.assert_allclose(H, H.T, atol=1e-14)
    else:
        assert np.abs(H - H.T).max() > 0.1


@pytest.mark.parametrize("name", ELASTIC)
def test_forces_of_springs_are_the_gradient_of_their_energy(name):
    u, _ = motion(ITEMS[name], 2)
    _, f, _, _ = evaluate(ITEMS[name], u)
    slope = differences(lambda x: np.array(evaluate(ITEMS[name], x)[0]), u)
    np.testing.assert_allclose(f, slope, atol=1e-9)
    assert np.abs(f).max() > 0.01


@pytest.mark.parametrize("name", ELASTIC)
def test_the_dissipation_of_dampers_is_the_power_of_their_forces(name):
    item = ITEMS[name]
    u, w = motion(item, 3)
    f, zero, square = np.zeros(len(u)), np.zeros(MAX_MEM), np.zeros((len(u), len(u)))
    _, power = LAWS[item.name].forces(item.p0, u, w, item.par, A, zero, f, square, square.copy())
    assert power == pytest.approx((f - evaluate(item, u)[1]) @ w, rel=1e-12)
    assert power > 0.0


@pytest.mark.parametrize("name", [n for n in ELASTIC if "hardening" not in n])
def test_dampers_resist_the_rate_of_length_or_angle(name):
    """f . w = c (rate)^2 plus the power of the spring, with the rate from the change of the spring's energy."""
    item = ITEMS[name]
    u, w = motion(item, 3)
    _, still, _, _ = evaluate(item, u)
    _, f, _, C = evaluate(item, u, w)
    h, k, c, rest = 1e-5, *item.par[-4:-2], item.par[0]
    sign = np.sign(np.sqrt(2 * evaluate(item, u)[0] / k)) if item.name == "translational" else 1.0

    def measure(x):
        if item.name == "translational":
            return np.hypot(*(item.p0 + x)) - rest
        # the moment is k times the twist, along a gradient that is the same for every stiffness
        return np.sqrt(2 * evaluate(item, x)[0] / k)

    rate = sign * (measure(u + h * w) - measure(u - h * w)) / (2 * h)
    assert (f - still) @ w == pytest.approx(c * rate**2, rel=1e-6)
    assert w @ C @ w == pytest.approx(c * rate**2, rel=1e-6)


def test_a_damper_of_zero_length_resists_any_rate():
    w = np.array([0.3, -0.2])
    _, f, _, C = evaluate(ITEMS["spring without length"], np.zeros(2), w)
    np.testing.assert_allclose(f, 0.4 * w)
    np.testing.assert_allclose(C, 0.4 * np.eye(2))


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraint_forces_are_the_gradient_of_multiplier_times_violation(name):
    item = ITEMS[name]
    u, _ = motion(item, 4)

    def product(x):
        f = evaluate(item, x)[1]
        return x[-1] * f[-1]

    np.testing.assert_allclose(evaluate(item, u)[1], differences(lambda x: np.array(product(x)), u), atol=1e-9)
    assert evaluate(item, np.zeros(len(u)))[1][-1] == 0.0


def force_of_state(law, p0, par, u, w, a=A):
    """Return f, H and C of a law at a state."""
    f, H, C = np.zeros(len(p0)), *np.zeros((2, len(p0), len(p0)))
    assert law.forces(p0, u, w, par, a, np.zeros(MAX_MEM), f, H, C) == (0.0, 0.0)
    return f, H, C


def check_derivatives_and_middle(law, p0, par, u, w):
    """Check that H and C are derivatives of the forces, and that the force of a step is that of its mid-point."""
    f, H, C = force_of_state(law, p0, par, u, w)
    np.testing.assert_allclose(H, differences(lambda u: force_of_state(law, p0, par, u, w)[0], u), atol=1e-9)
    np.testing.assert_allclose(C, differences(lambda w: force_of_state(law, p0, par, u, w)[0], w), atol=1e-9)
    u1, later, middle = u + 0.1 * w, np.array([0.3, 0.8, 0.0]), np.zeros(len(p0))
    assert law.mean(p0, u, u1, w, par, A, later, np.zeros(MAX_MEM), middle) == (0.0, 0.0)
    expected = force_of_state(law, p0, par, 0.5 * (u + u1), w, 0.5 * (A + later))[0]
    np.testing.assert_allclose(middle, expected, atol=1e-14)
    return f


@pytest.mark.parametrize("raw", RAW.values(), ids=["theta", "a direction", "no angle"])
def test_a_load_by_formula_has_its_derivatives_and_the_mid_point_force_in_a_step(raw):
    """F = weight A (x y - 2 vx + s t, y^2 - x vy), with theta added to both if the section turns."""
    kind, s, weight = next(k for k, v in RAW.items() if v is raw), 0.3, 0.7
    turns = 0.0 if kind == GROUND else 1.0
    texts = [f"x*y - 2*vx + s*t + {turns}*x*theta", f"y^2 - x*vy - {turns}*theta^2"]
    formula = formula_record([syntax(text, Names("s", {}, LOCAL)) for text in texts], LOCAL, texts)
    p0, par = np.array([0.5, -0.4, *raw]), np.array([weight, s, formula.address, kind])
    rng = np.random.default_rng(9)
    u, w = rng.uniform(-0.4, 0.4, len(p0)), rng.uniform(-1, 1, len(p0))
    f = check_derivatives_and_middle(ALONG_BODY, p0, par, u, w)
    x, y = p0[:2] + u[:2]
    theta = {GROUND: 0.0, THETA: u[-1], DIRECTION: np.arctan2(u[-1], 1.3 + u[-2])}[kind]
    force = [x * y - 2 * w[0] + s * A[1] + x * theta, y**2 - x * w[1] - theta**2]
    np.testing.assert_allclose(f[:2], -weight * A[0] * np.array(force), atol=1e-14)
    assert not f[2:].any()


def test_a_force_by_position_has_its_derivatives_and_the_mid_point_force_in_a_step():
    """F = A k (x y, y^2 - x), which has no potential."""
    law = position_law("swirl", lambda x, y, par: (par[0] * x * y, par[0] * (y * y - x), par[0] * y, par[0] * x,
                                                   -par[0], 2 * par[0] * y), False)
    p0, k, u, w = np.array([0.5, -0.4]), 0.7, np.array([0.2, 0.3]), np.array([0.6, -0.9])
    f = check_derivatives_and_middle(law, p0, np.array([k]), u, w)
    x, y = p0 + u
    np.testing.assert_allclose(f, -A[0] * k * np.array([x * y, y * y - x]), atol=1e-14)


def test_mass_flowing_past_a_point_has_its_derivatives_and_the_mid_point_force_in_a_step():
    """m (2 v r_x' + v' r_x) on r, -m v^2 r_x on r_x, and v^2 r_x of the mass that leaves at an end."""
    m, end, (v, rate, _) = 0.7, 0.3, A
    for law, n in ((FLOW, 2), (TURNING, 1)):
        rng, par = np.random.default_rng(3), np.array([m, end])
        p0, u, w = rng.uniform(-1, 1, (3, 2 * n))
        f = check_derivatives_and_middle(law, p0, par, u, w)
        slope = p0[n:] + u[n:]
        np.testing.assert_allclose(f[:n], m * (2 * v * w[n:] + rate * slope) + end * v**2 * slope, atol=1e-14)
        np.testing.assert_allclose(f[n:], -m * v**2 * slope, atol=1e-14)


def turned(item, u, angle):
    """Return the displacements of the fields after a rotation of the whole scene."""
    p = item.p0 + u
    c, s = np.cos(angle), np.sin(angle)
    for k in item.vectors:
        p[k], p[k + 1] = c * p[k] - s * p[k + 1], s * p[k] + c * p[k + 1]
    for k in item.angles:
        p[k] += angle
    return p - item.p0


@given(angle=st.floats(-40.0, 40.0), size=STEP)
@settings(max_examples=20, deadline=None)
@pytest.mark.parametrize("name", [n for n in ITEMS if n[-2:] not in ("01", "02", "10", "20") and n != "held"])
def test_turning_the_scene_turns_the_forces_and_keeps_the_energy(name, angle, size):
    """Directions in the frame of their own reference turn like vectors of the plane."""
    item = ITEMS[name]
    u = 0.4 * np.array(size[:len(item.p0)])
    mem = np.zeros(MAX_MEM)
    # what remembers an angle from the frame that turns keeps it, what remembers one in the plane turns with the scene
    after = mem if item.name in ("at_angle", "held_aligned") else np.full(MAX_MEM, angle)
    energy, f, _, _ = evaluate(item, u, mem=mem)
    again, F, _, _ = evaluate(item, turned(item, u, angle), mem=after)
    assert again == pytest.approx(energy, abs=1e-12 * (1 + energy))
    expected = f.copy()
    c, s = np.cos(angle), np.sin(angle)
    for k in item.vectors:
        expected[k], expected[k + 1] = c * f[k] - s * f[k + 1], s * f[k] + c * f[k + 1]
    np.testing.assert_allclose(F, expected, atol=1e-12)


@pytest.mark.parametrize(("a", "b"), [t for t in TURNS if DIRECTION in t])
def test_turns_are_counted_from_one_accepted_state_to_the_next(a, b):
    item = _rotational(a, b)
    moving, mem = item.vectors[-1], np.zeros(MAX_MEM)
    for angle in np.linspace(0.0, 9 * np.pi, 20):
        u = np.zeros(len(item.p0))
        u[moving] = 1.3 * (np.cos(angle) - 1)
        u[moving + 1] = 1.3 * np.sin(angle)
        twist = (angle if b == DIRECTION else -angle) - 0.3
        assert evaluate(item, u, mem=mem)[0] == pytest.approx(twist**2, abs=1e-10)
        count_turns(item.p0, u, item.par, mem)


def test_elongations_of_springs_keep_the_digits_of_small_displacements():
    item = _item("translational", [1e3, 0.0], [1e3, 1e3, 1.0, 0.0, 0.0, 0.0])
    _, f, _, _ = evaluate(item, np.array([1e-12, 0.0]))
    assert f[0] == pytest.approx(1e-12, rel=1e-12, abs=0)


def test_series_for_small_angles_agree_with_sines():
    for x in (1e-8, 3e-5, 0.999e-3, 1.001e-3, 0.3):
        for angle in (x, -x):
            assert half_sine(angle) == pytest.approx(np.sin(0.5 * angle) / (0.5 * angle), rel=1e-14)
            assert over_sine(angle) == pytest.approx(angle / np.sin(angle), rel=1e-14)
