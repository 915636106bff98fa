"""The kernels of point laws: tables agree with the laws one by one, in motion and over a step."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import helpers
import numpy as np
import pytest

from ancf2d.kernels.curves import point_accept, point_forces, point_tangent
from ancf2d.kernels.lowlevel.jit import kernel
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import SymBand
from ancf2d.kernels.patches import point_noise, point_violation
from ancf2d.kernels.points import point_constraint_rates, point_mean_forces
from ancf2d.model.point_tables import point_table


@kernel
def tangent(points, d, v, amps, c, Q, matrix, places):
    """Call ``point_tangent``, which only kernels can call."""
    return point_tangent(points, d, v, amps, c, Q, matrix, places)


WAVE = {"type": "sine", "frequency": 0.5}
SPRINGS = [
    {"type": "translational", "between": ["a@0.37", [2.0, 0.3]], "stiffness": 3.0, "damping": 0.4, "length": 0.2},
    {"type": "translational", "between": ["b@1", "c@0.8"], "stiffness": 2.0, "damping": 0.3},
    {"type": "rotational", "between": ["a@1", "b@0.6"], "stiffness": 3.0, "damping": 0.7, "angle": 0.2},
    {"type": "rotational", "between": ["c@1", [0, 0]], "stiffness": 1.0, "damping": 0.2},
]
LOADS = [
    {"type": "follower_force", "at": "a@0.8", "value": [0.3, -0.7], "amplitude": WAVE},
    {"type": "follower_force", "at": "c@0.3", "value": [0.3, -0.7]},
    {"type": "distributed", "on": "b", "value": [0.2, -0.4], "follower": True, "amplitude": {**WAVE, "phase": 1.0}},
    {"type": "moment", "at": "b@1", "value": 0.6, "amplitude": WAVE},
    {"type": "moment", "at": "c@1", "value": 0.6},
]
DYNAMIC = {"type": "dynamic", "t_end": 1.0, "dt": 0.1}


def bodies():
    start = (1.0, 0.0)
    return {
        "a": helpers.body(helpers.line(1.0), helpers.element("vallejo", 2)),
        "b": helpers.body(helpers.line(1.2, 0.7, start), helpers.element("cable", 2)),
        "c": helpers.body(helpers.line(0.8, -0.4, start), helpers.element("reissner3", 2)),
        "d": {"geometry": helpers.line(0.5, 2.0, start), "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}},
    }


@cache
def scene():
    """Return a model with every kind of law, its point laws, and their table with its signals."""
    model = helpers.build(
        bodies(), DYNAMIC, springs=SPRINGS, loads=LOADS,
        bc=[{"type": "pin", "at": "a@0"}, {"type": "prescribed", "at": "a@0", "angle": WAVE}],
        joints=[{"type": "weld", "between": ["a@1", "b@0"]}, {"type": "weld", "between": ["a@1", "c@0"]},
                {"type": "pin", "between": ["a@1", "d@0"]}],
    )
    signals = []
    points = model.interactions.points
    table = Record(point_table(points, signals, steps=True))
    return model, [one for p in points for one in singles(p.items())], table, signals


def singles(items):
    """Return the items of a law one by one."""
    return [SimpleNamespace(law=items.law, coordinates=items.dofs[k], rows=items.G[k], p0=items.p0[k], par=items.par[k],
                            mem=items.mem[k], signal=items.signal, fed=items.fed) for k in range(len(items.p0))]


def motion(seed, size=0.1):
    """Return full coordinates with multipliers of order one."""
    model, *_ = scene()
    d, rng = helpers.random_state(model, size, seed), np.random.default_rng(seed)
    d[model.n_q:] = rng.uniform(-1, 1, len(d) - model.n_q)
    return d


def random_amplitudes(seed):
    return np.random.default_rng(seed).uniform(0.2, 1.0, (len(scene()[3]), 3))


def one_by_one(d, v, amps):
    """Return energy, dissipated power, Q and dQ/dd, dQ/dv from the laws themselves."""
    _, patches, table, _ = scene()
    Q, K, D = np.zeros(len(d)), np.zeros((len(d), len(d))), np.zeros((len(d), len(d)))
    energy = power = 0.0
    for i, p in enumerate(patches):
        u, w = p.rows @ d[p.coordinates], p.rows @ v[p.coordinates]
        a = np.array([1.0, 0.0, 0.0]) if p.signal is None else amps[table.signal[i, 0]]
        if p.fed >= 0:
            u[p.fed], w[p.fed] = a[:2]
        m = len(u)
        f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
        U, lost = p.law.forces(p.p0, u, w, p.par, a, p.mem, f, H, C)
        energy, power = energy + U, power + lost
        Q[p.coordinates] += p.rows.T @ f
        K[np.ix_(p.coordinates, p.coordinates)] += p.rows.T @ H @ p.rows
        D[np.ix_(p.coordinates, p.coordinates)] += p.rows.T @ C @ p.rows
    return energy, power, Q, K, D


def test_the_scene_has_every_law():
    _, patches, table, signals = scene()
    assert {p.law.name for p in patches} == {"translational", "rotational", "follower", "moment", "at_angle", "aligned",
                                             "fixed_length"}
    assert sum(p.law.name == "follower" for p in patches) > 3
    # what follows one load's amplitude is one signal, however many points the load has
    assert len(signals) == len({id(p.signal) for p in patches if p.signal is not None})
    assert (table.signal >= 0).sum() == sum(p.signal is not None for p in patches)


def test_forces_and_tangent_are_those_of_the_laws():
    model, _, table, _ = scene()
    d, v, amps, n = motion(1), motion(2), random_amplitudes(3), len(motion(1))
    energy, power, Q, K, D = one_by_one(d, v, amps)
    out = np.ones(n)
    assert point_forces(table, d, v, amps, out) == pytest.approx((energy, power), rel=1e-12)
    np.testing.assert_allclose(out, Q + 1, atol=1e-12)
    plain = Places(np.arange(n), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    A, out, c = np.zeros((n, n)), np.zeros(n), 2.5
    assert tangent(table, d, v, amps, c, out, SymBand(A), plain) == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(out, Q, atol=1e-12)
    full = K + c * D
    np.testing.assert_allclose(helpers.dense(SymBand(A), n), 0.5 * (full + full.T), atol=1e-11)
    assert np.abs(full - full.T).max() > 0.1
    # and into the unknowns: T^T K T
    num = model.numbering
    A, T = np.zeros((num.n_unknowns, num.n_unknowns)), np.zeros((n, num.n_unknowns))
    for k in range(num.n_unknowns):
        num.expand(np.eye(num.n_unknowns)[k], T[:, k])
    tangent(table, d, v, amps, c, out, SymBand(A), num.places)
    np.testing.assert_allclose(helpers.dense(SymBand(A), len(A)), 0.5 * T.T @ (full + full.T) @ T, atol=1e-11)


def test_statics_have_the_same_forces_and_tangents():
    """Item by item: f, H with its unsymmetric part, and C, of springs, loads and constraints."""
    model, _, _, signals = scene()
    d, t = motion(4), 0.3
    amps = np.array([[s(t), 0.0, 0.0] for s in signals])
    energy, _, Q, K, D = one_by_one(d, np.zeros(len(d)), amps)
    found, P, A, C = 0.0, np.zeros_like(Q), np.zeros_like(K), np.zeros_like(D)
    for batch in [*model.interactions.springs, *model.interactions.loads, *model.interactions.point_constraints]:
        one, forces, stiffness, damping = batch.matrices(d, t)
        found += one
        for dofs, q, k, c in zip(batch.dofs, forces, stiffness, damping, strict=True):
            P[dofs] += q
            A[np.ix_(dofs, dofs)] += k
            C[np.ix_(dofs, dofs)] += c
    assert found == pytest.approx(energy, rel=1e-12)
    for ours, theirs in ((P, Q), (A, K), (C, D)):
        np.testing.assert_allclose(ours, theirs, atol=1e-11)
    assert np.abs(A - A.T).max() > 0.1


def test_forces_of_a_step_are_those_of_the_laws():
    _, patches, table, _ = scene()
    d0, d1, v, amps0, amps1 = motion(5), motion(6), motion(7), random_amplitudes(8), random_amplitudes(9)
    Q, expected, energy, power = np.ones(len(d0)), np.ones(len(d0)), 0.0, 0.0
    found = point_mean_forces(table, d0, d1, v, amps0, amps1, Q)
    for i, p in enumerate(patches):
        u0, u1, w = p.rows @ d0[p.coordinates], p.rows @ d1[p.coordinates], p.rows @ v[p.coordinates]
        a0, a1 = (np.array([1.0, 0, 0]) if p.signal is None else x[table.signal[i, 0]] for x in (amps0, amps1))
        if p.fed >= 0:
            u0[p.fed], u1[p.fed] = a0[0], a1[0]
        f = np.zeros(len(u0))
        U, lost = p.law.mean(p.p0, u0, u1, w, p.par, a0, a1, p.mem, f)
        energy, power = energy + U, power + lost
        expected[p.coordinates] += p.rows.T @ f
    assert found == pytest.approx((energy, power), rel=1e-12)
    np.testing.assert_allclose(Q, expected, atol=1e-12)


def test_constraint_rates_are_the_time_derivatives_of_the_constraints():
    """Along d + v s with signals of given rates, dg/dt = g_q v + g_t and its derivative is the second rate."""
    model, _, table, _ = scene()
    d, v, amps, h = motion(10), motion(11), random_amplitudes(12), 1e-3
    v[model.n_q:] = 0.0
    still = np.zeros(len(d))

    def g(s, moved=1.0):
        now = amps.copy()
        now[:, 0] += moved * (amps[:, 1] * s + 0.5 * amps[:, 2] * s**2)
        Q = np.zeros(len(d))
        point_forces(table, d + s * v, still, now, Q)
        return Q[model.n_q:]

    def by_time(moved):
        near, far = g(h, moved) - g(-h, moved), g(2 * h, moved) - g(-2 * h, moved)
        return (8 * near - far) / (12 * h)

    velocity, acceleration = np.full(len(d), 7.0), np.full(len(d), 7.0)
    point_constraint_rates(table, d, v, amps, velocity, acceleration)
    np.testing.assert_allclose(velocity[model.n_q:], by_time(1.0) - by_time(0.0), atol=1e-9)
    second = (16 * (g(h) + g(-h)) - (g(2 * h) + g(-2 * h)) - 30 * g(0)) / (12 * h**2)
    np.testing.assert_allclose(acceleration[model.n_q:], second, atol=1e-7)
    assert np.abs(velocity[model.n_q:]).max() > 0.1
    assert (np.abs(acceleration[model.n_q:]) > 1e-3).all()
    assert (velocity[:model.n_q] == 7.0).all()


def test_violation_is_the_largest_relative_to_the_size_of_its_terms():
    model, _, table, signals = scene()
    still = np.array([[s(0.0), 0.0, 0.0] for s in signals])
    d = np.zeros(len(motion(1)))
    assert point_violation(table, d, still) < 1e-15
    (rod,) = (c for c in model.constraints if c.holds == "length")
    along = np.array([np.cos(2.0), np.sin(2.0)])
    d[rod.dofs[2:]] = 0.01 * 0.5 * along
    # g = (|p|^2 - L^2)/(2 L), beside L
    assert point_violation(table, d, still) == pytest.approx(0.01005, rel=1e-12)
    d[:] = 0.0
    turned = still.copy()
    turned[:, 0] += 0.02
    assert point_violation(table, d, turned) == pytest.approx(np.sin(0.02), rel=1e-12)
    d[0] = np.nan
    assert not point_violation(table, d + np.nan, still) < 1.0


def test_turns_of_torsion_springs_are_counted_from_accepted_states():
    model = helpers.build({"a": bodies()["a"]}, DYNAMIC, bc=[{"type": "pin", "at": "a@0"}],
                          springs=[{"type": "rotational", "between": ["a@1", [0, 0]], "stiffness": 3.0}])
    table, no_amps = Record(point_table(model.interactions.points)), np.zeros((0, 3))
    for angle in np.linspace(0, 15, 9):
        d = helpers.rotate(np.zeros(model.n_q), model, angle)
        for _ in range(2):
            # asking changes nothing
            assert point_forces(table, d, 0 * d, no_amps, np.zeros(len(d)))[0] == pytest.approx(1.5 * angle**2)
        point_accept(table, d, no_amps)
    np.testing.assert_allclose(table.mem, [[15.0, 0.0]])


def test_noise_bounds_the_effect_of_round_off_in_coordinates_on_forces():
    _, _, table, _ = scene()
    d, rest, amps = motion(13), np.zeros(len(motion(13))), np.ones((len(scene()[3]), 3))
    bound, Q = np.zeros(len(d)), np.zeros(len(d))
    point_noise(table, d, bound)
    point_forces(table, d, rest, amps, Q)
    rng, eps = np.random.default_rng(0), 1e-7
    reached = np.zeros(len(d))
    for _ in range(20):
        other = np.zeros(len(d))
        point_forces(table, d * (1 + eps * rng.choice([-1.0, 1.0], len(d))), rest, amps, other)
        reached = np.maximum(reached, np.abs(other - Q) / eps)
    touched = bound > 0
    assert (reached <= 1.001 * bound + 1e-6).all()
    assert (bound >= np.abs(Q)).all()
    assert bound[touched].max() < 1e3 * np.abs(Q).max()


def test_empty_tables_have_no_effect():
    table, d, no_amps = Record(point_table([])), np.ones(4), np.zeros((0, 3))
    Q, A = np.zeros(4), np.zeros((4, 2))
    plain = Places(np.arange(4), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    assert point_forces(table, d, d, no_amps, Q) == (0.0, 0.0)
    assert tangent(table, d, d, no_amps, 1.0, Q, SymBand(A), plain) == 0.0
    assert point_mean_forces(table, d, d, d, no_amps, no_amps, Q) == (0.0, 0.0)
    point_constraint_rates(table, d, d, no_amps, Q, Q)
    assert point_violation(table, d, no_amps) == 0.0
    point_accept(table, d, no_amps)
    point_noise(table, d, Q)
    assert not Q.any()
    assert not A.any()
