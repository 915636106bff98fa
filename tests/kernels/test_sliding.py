"""Prismatic joints: distance from a deformed axis, its derivatives, crossing elements, workless forces."""

import helpers
import numpy as np
import pytest

from ancf2d.interactions.prismatic import OnAxis, foot_point, sliding_table
from ancf2d.kernels.lowlevel.jit import kernel
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import Csr
from ancf2d.kernels.sliding import (
    sliding_accept,
    sliding_check,
    sliding_constraint_rates,
    sliding_forces,
    sliding_mean_forces,
    sliding_noise,
    sliding_tangent,
    sliding_violation,
)
from ancf2d.model.point_tables import Interactions
from ancf2d.model.points import point_ref


@kernel
def tangent(table, d, v, amps, c, Q, matrix, places):
    """Call ``sliding_tangent``, which only kernels can call."""
    sliding_tangent(table, d, v, amps, c, Q, matrix, places)


TYPES = ["2d2n", "cable", "vallejo", "kerkkanen", "reissner3", "ancf[3,2]"]
AMPS = np.zeros((0, 3))
L = 2.0


class Scene:
    """A body ``rail`` along x and a short body ``bead`` that starts on it; the last entry of d is a multiplier."""

    def __init__(self, name="2d2n", count=5, s=0.43, geometry=None):
        rail = helpers.body(geometry or helpers.line(L), helpers.element(name, count))
        x, y = self.at(rail["geometry"], s)
        bead = helpers.body(helpers.line(0.3, 1.1, (x, y)), helpers.element("reissner2", 1))
        self.model = helpers.build({"rail": rail, "bead": bead}, {"type": "eigen", "modes": 1})
        self.mesh, self.point = self.model.meshes["rail"], point_ref(self.model.meshes["bead"], 0.0)
        self.joint = OnAxis(self.point, self.mesh, foot_point(self.mesh.plan, np.array([x, y]))[0], "sleeve")
        self.n_q = self.model.n_q
        self.joint.multiplier = self.n_q
        self.table = Record(sliding_table([None, self.joint], self.model.e0))

    @staticmethod
    def at(geometry, s):
        if geometry["type"] == "line":
            a, b = np.array(geometry["start"]), np.array(geometry["end"])
            return a + s * (b - a)
        turn = geometry["from"] + s * (geometry["to"] - geometry["from"])
        return np.array(geometry["center"]) + geometry["radius"] * np.array([np.cos(turn), np.sin(turn)])

    def state(self, size=0.05, seed=0, multiplier=1.7):
        return np.append(helpers.random_state(self.model, size, seed)[: self.n_q], multiplier)

    def forces(self, d):
        Q = np.zeros(self.n_q + 1)
        sliding_forces(self.table, d, d, AMPS, Q)
        return Q

    def g(self, d):
        return self.forces(d)[-1]

    def tangent(self, d):
        n = self.n_q + 1
        A = np.zeros(n * n)
        matrix = Csr(A, np.arange(n + 1) * n, np.tile(np.arange(n), n))
        none = np.zeros(0, dtype=np.int64)
        Q = np.zeros(n)
        places = Places(np.arange(n), np.zeros(1, np.int64), none, np.zeros(0))
        tangent(self.table, d, d, AMPS, 0.0, Q, matrix, places)
        return Q, A.reshape(n, n)

    def mean(self, d0, d1):
        Q = np.zeros(self.n_q + 1)
        sliding_mean_forces(self.table, d0, d1, np.zeros(len(d0)), Q)
        return Q

    def put(self, d, x, y):
        """Move the point to (x, y)."""
        for (coords, weights), value in zip(self.point.position(), (x, y), strict=True):
            assert len(coords) == 1
            d[coords[0]] = value / weights[0] - self.model.e0[coords[0]]

    def axis(self, d, s):
        """Return the point of the deformed axis at fraction s."""
        return np.array([w @ (self.model.e0 + d[: self.n_q])[c] for c, w in point_ref(self.mesh, s).position()])

    def resultants(self, Q, d):
        """Return force and moment about the origin of forces Q on the coordinates e0 + d."""
        e = self.model.e0 + d[: self.n_q]
        force, moment = np.zeros(2), 0.0
        for mesh in self.model.meshes.values():
            for k, kind in enumerate(mesh.kinds.tolist()):
                i = mesh.first_dof + k
                if kind in (0, 3):
                    moment += e[i] * Q[i + 1] - e[i + 1] * Q[i]
                    if kind == 0:
                        force += Q[i : i + 2]
                elif kind == 2:
                    moment += Q[i]
        return force, moment


@pytest.fixture
def scene(request):
    return Scene(request.param)


EVERY = pytest.mark.parametrize("scene", helpers.chosen(TYPES, ["2d2n", "cable", "reissner3"]), indirect=True)


@EVERY
def test_the_distance_is_that_of_the_nearest_point(scene):
    d = scene.state()
    r = np.array([scene.axis(d, s) for s in np.linspace(0.47, 0.53, 601)])
    for off in (-0.03, 0.03):
        p = scene.axis(d, 0.5) + off * np.array([0.2, 1.0])
        scene.put(d, *p)
        nearest = np.hypot(*(r - p).T).min()
        assert 0.02 < nearest < 0.031
        assert scene.g(d) == pytest.approx(np.copysign(nearest, off), rel=1e-5)


@EVERY
def test_forces_are_the_gradient_and_the_tangent_their_derivative(scene):
    d, h = scene.state(), 1e-6
    Q, K = scene.tangent(d)
    np.testing.assert_allclose(Q, scene.forces(d), atol=1e-15)
    np.testing.assert_allclose(K, K.T, atol=1e-13)
    np.testing.assert_allclose(Q[:-1], 1.7 * K[-1, :-1], atol=1e-15)
    for k in np.flatnonzero(np.abs(K).sum(axis=0)):
        step = np.zeros_like(d)
        step[k] = h
        slope = (scene.forces(d + step) - scene.forces(d - step)) / (2 * h)
        np.testing.assert_allclose(K[:, k], slope, atol=2e-8)
    # the Hessian is there: with the multiplier's share alone the test above would pass for straight bodies
    assert np.abs(K[:-1, :-1]).max() > 0.1


@EVERY
def test_statics_have_the_same_forces_and_tangent(scene):
    d = scene.state(seed=3)
    Q, K = scene.tangent(d)
    found = Interactions([], [], [scene.joint], scene.model.e0)
    ((energy, q, k, (dofs,)),) = found.constraints(d, 0.0)
    assert energy == 0.0
    assert dofs[-1] == scene.joint.multiplier
    np.testing.assert_allclose(q[0], Q[dofs], atol=1e-14)
    np.testing.assert_allclose(k[0], K[np.ix_(dofs, dofs)], atol=1e-13)
    assert np.abs(K).sum() == pytest.approx(np.abs(k).sum(), rel=1e-12)


@pytest.mark.slow
@EVERY
def test_rates_are_time_derivatives_along_a_motion(scene):
    d, v, h = scene.state(), scene.state(1.0, 5, 0.0), 1e-4
    velocity, acceleration = np.full(len(d), 9.0), np.full(len(d), 9.0)
    sliding_constraint_rates(scene.table, d, v, AMPS, velocity, acceleration)
    g = [scene.g(d + k * h * v) for k in (-2, -1, 0, 1, 2)]
    second = (-g[0] + 16 * g[1] - 30 * g[2] + 16 * g[3] - g[4]) / (12 * h * h)
    assert velocity[-1] == 0.0
    assert acceleration[-1] == pytest.approx(second, rel=1e-5)
    assert (velocity[:-1] == 9.0).all()
    assert (acceleration[:-1] == 9.0).all()


def bent(scene, size=1.2):
    """Return displacements that bend the rail into an arc of ``size`` radians."""
    d = np.zeros(scene.n_q + 1)
    mesh, e0 = scene.mesh, scene.model.e0
    rate = size / L
    for k, kind in enumerate(mesh.kinds.tolist()):
        i = mesh.first_dof + k
        if kind == 0:
            a = rate * e0[i]
            d[i], d[i + 1] = np.sin(a) / rate - e0[i], (1 - np.cos(a)) / rate
        elif kind == 2:
            d[i] = rate * e0[i - 2]
        elif kind == 3:
            node = max(j for j in range(k) if mesh.kinds[j] == 0)
            a = rate * e0[mesh.first_dof + node]
            gx, gy = e0[i], e0[i + 1]
            d[i], d[i + 1] = np.cos(a) * gx - np.sin(a) * gy - gx, np.sin(a) * gx + np.cos(a) * gy - gy
    return d


@EVERY
def test_the_foot_point_crosses_elements_within_one_evaluation(scene):
    d, a = bent(scene), np.linspace(0.02, 1.18, 59)
    radius = L / 1.2
    # straight elements lie inside the arc
    sag = 0.0121 if scene.mesh.plan.element.name == "kerkkanen" else 2e-4
    for start in (0.02, 0.43 * 1.2, 1.18):
        scene.put(d, radius * np.sin(start), radius * (1 - np.cos(start)))
        sliding_accept(scene.table, d)
        for turn in a:
            scene.put(d, (radius - 0.01) * np.sin(turn), radius - (radius - 0.01) * np.cos(turn))
            Q = scene.forces(d)
            assert Q[-1] == pytest.approx(0.01, abs=sag)
    assert sliding_check(scene.table, d) == -1


@EVERY
def test_only_accepted_states_change_the_memory(scene):
    d = bent(scene)
    before = scene.table.memory.copy()
    scene.put(d, *scene.axis(d, 0.9))
    scene.forces(d)
    scene.tangent(d)
    np.testing.assert_array_equal(scene.table.memory, before)
    sliding_accept(scene.table, d)
    assert scene.table.memory[0, 0] == 4
    scene.put(d, *scene.axis(d, 0.05))
    sliding_accept(scene.table, d)
    assert scene.table.memory[0, 0] == 0


@EVERY
def test_the_normal_keeps_its_sign_over_full_turns_of_the_body(scene):
    d = bent(scene)
    scene.put(d, *(scene.axis(d, 0.3) + np.array([0.0, 0.05])))
    reference = scene.g(d)
    assert reference > 0.01
    for turn in np.arange(0.0, 14.0, 0.7):
        moved = np.append(helpers.rotate(d[:-1], scene.model, turn, (3.0, -1.0)), 0.0)
        sliding_accept(scene.table, moved)
        assert scene.g(moved) == pytest.approx(reference, abs=1e-13)


@pytest.mark.parametrize("corner", [0.9, -0.9])
def test_a_kink_has_one_side_and_no_jump_of_the_distance(corner):
    scene = Scene("kerkkanen", 2, 0.4)
    d = np.zeros(scene.n_q + 1)
    end = scene.mesh.node_dofs(1, 1)
    d[end[:2]] = np.cos(corner) - 1, np.sin(corner)
    bisector = np.array([-np.sin(corner / 2), np.cos(corner / 2)])
    for side in (-0.03, 0.03):
        vertex = np.array([1.0, 0.0]) + side * bisector
        found = []
        for x in (-1e-9, 1e-9):
            for start in (0.2, 0.8):
                scene.put(d, *scene.axis(d, start))
                sliding_accept(scene.table, d)
                scene.put(d, *(vertex + x * np.array([np.cos(corner / 2), np.sin(corner / 2)])))
                found.append(scene.forces(d + np.eye(len(d))[-1]))
        for before, after in zip(found[::2], found[1::2], strict=True):
            np.testing.assert_allclose(before, after, atol=1e-14)
        assert found[0][-1] == pytest.approx(side * np.cos(corner / 2), abs=1e-8)
        assert found[0][-1] == pytest.approx(found[2][-1], abs=1e-8)
        # the force stands on the element that the point has gone to
        np.testing.assert_array_equal(found[0][end], 0.0)
        assert found[2][end].any()


@pytest.mark.slow
@EVERY
@pytest.mark.parametrize(("one", "two"), [(0.3, 0.34), (0.35, 0.45), (0.15, 0.85), (0.5, 0.5)])
def test_mean_forces_do_no_work_and_have_no_resultant(scene, one, two):
    """From one point of the axis to another while the body deforms, rotates and moves."""
    d0 = scene.state(0.02, 1, 0.0)
    d1 = np.append(helpers.rotate(scene.state(0.02, 2)[:-1], scene.model, 0.4, (0.2, 0.1)), 1.0)
    for d, s in ((d0, one), (d1, two)):
        scene.put(d, *scene.axis(d, s))
    Q = scene.mean(d0, d1)
    force, moment = scene.resultants(Q, 0.5 * (d0 + d1))
    size = np.abs(Q[:-1]).max()
    assert size > 0.1
    # where the point stays, what moves it beside the body is round-off, and no correction is attempted
    still = one == two
    assert Q[:-1] @ (d1 - d0)[:-1] == pytest.approx(0, abs=1e-14 if not still else 1e-13)
    assert Q[-1] == pytest.approx(0, abs=1e-14)
    np.testing.assert_allclose(force, 0, atol=1e-14)
    assert moment == pytest.approx(0, abs=1e-14)


@pytest.mark.slow
@EVERY
def test_mean_forces_take_the_difference_of_distances(scene):
    d0, d1 = scene.state(0.04, 1), scene.state(0.04, 2, 1.0)
    Q = scene.mean(d0, d1)
    assert Q[:-1] @ (d1 - d0)[:-1] == pytest.approx(scene.g(d1) - scene.g(d0), abs=1e-14)
    assert abs(scene.g(d1) - scene.g(d0)) > 1e-3
    assert Q[-1] == scene.g(d1)
    mid = 0.5 * (d0 + d1)
    mid[-1] = 1.0
    # the gradient at the mean state alone would not do
    assert abs(scene.forces(mid)[:-1] @ (d1 - d0)[:-1] - (scene.g(d1) - scene.g(d0))) > 1e-8


@pytest.mark.slow
@EVERY
def test_mean_forces_are_the_gradient_where_a_step_is_small(scene):
    d = scene.state(multiplier=1.0)
    change = scene.state(1e-5, 7, 0.0)
    np.testing.assert_allclose(scene.mean(d - change, d + change)[:-1], scene.forces(d)[:-1], atol=1e-8)
    np.testing.assert_array_equal(scene.mean(d, d), scene.forces(d))


@EVERY
@pytest.mark.parametrize("end", [0, 1])
def test_leaving_the_end_of_the_axis_is_reported(scene, end):
    d = np.zeros(scene.n_q + 1)
    for beyond, index in ((-1e-3, -1), (0.0, -1), (1e-3, 0), (0.5, 0)):
        scene.put(d, (L + beyond) if end else -beyond, 0.0)
        assert sliding_check(scene.table, d) == index
    # a little beyond, Newton's method can still come back; far beyond there is no axis
    scene.put(d, L + 1e-3 if end else -1e-3, 0.0)
    assert scene.g(d) == pytest.approx(0, abs=1e-14)
    scene.put(d, L + 0.5 if end else -0.5, 0.0)
    assert np.isnan(scene.g(d))
    assert np.isnan(sliding_violation(scene.table, d, AMPS))
    before = scene.table.memory.copy()
    sliding_accept(scene.table, d)
    np.testing.assert_array_equal(scene.table.memory, before)


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_joints_on_arcs_start_at_the_point(name):
    arc = {"type": "arc", "center": [1.0, 2.0], "radius": 1.5, "from": 2.9, "to": 0.2}
    scene = Scene(name, 3, 0.61, arc)
    assert scene.g(np.zeros(scene.n_q + 1)) == pytest.approx(0, abs=1e-15)
    assert scene.table.memory[0, 0] == 1
    assert 0.5 * (scene.table.memory[0, 1] + 1) == pytest.approx(3 * 0.61 - 1, abs=1e-12)


@pytest.mark.parametrize("sweep", [(2.9, 0.2), (0.2, 2.9), (-3.0, 3.0), (3.0, -2.9)])
def test_the_foot_point_in_the_reference_is_the_nearest_point(sweep):
    arc = {"type": "arc", "center": [1.0, 2.0], "radius": 1.5, "from": sweep[0], "to": sweep[1]}
    plan = Scene("reissner2", 3, 0.5, arc).mesh.plan
    rng = np.random.default_rng(1)
    for r in np.array([1.0, 2.0]) + rng.uniform(-2.5, 2.5, (20, 2)):
        s, distance = foot_point(plan, r)
        points = np.concatenate([p.position(np.linspace(0, p.length, 20001))[0] for p in plan.pieces])
        assert distance == pytest.approx(np.hypot(*(points - r).T).min(), rel=1e-4)
        assert np.hypot(*(plan.position(s)[0] - r)) == pytest.approx(distance, rel=1e-12)


@pytest.mark.slow
@EVERY
def test_violation_is_relative_and_noise_bounds_round_off(scene):
    d = bent(scene)
    d[-1] = 2.0
    scene.put(d, *scene.axis(d, 0.37))
    assert sliding_violation(scene.table, d, AMPS) < 1e-15
    scene.put(d, *(scene.axis(d, 0.37) + np.array([0.0, 0.1])))
    assert sliding_violation(scene.table, d, AMPS) == pytest.approx(abs(scene.g(d)) / scene.table.scale[0], rel=1e-12)
    noise, exact = np.zeros(len(d)), scene.forces(d)
    sliding_noise(scene.table, d, noise)
    rng = np.random.default_rng(0)
    for _ in range(20):
        changed = d * (1 + 1e-9 * rng.choice([-1, 1], len(d)))
        assert (np.abs(scene.forces(changed) - exact) <= 1e-9 * noise + 1e-15).all()


@pytest.mark.slow
def test_empty_tables_of_joints_have_no_effect():
    scene = Scene()
    table = Record(sliding_table([], scene.model.e0))
    d, Q = scene.state(), np.zeros(scene.n_q + 1)
    sliding_forces(table, d, d, AMPS, Q)
    sliding_mean_forces(table, d, d, np.zeros(len(d)), Q)
    sliding_constraint_rates(table, d, d, AMPS, Q, Q)
    sliding_accept(table, d)
    sliding_noise(table, d, Q)
    assert not Q.any()
    assert sliding_violation(table, d, AMPS) == 0.0
    assert sliding_check(table, d) == -1


def test_two_joints_on_bodies_of_different_types_are_independent():
    one, two = Scene("2d2n", 3), Scene("reissner3", 4)
    bodies = {
        "a": helpers.body(helpers.line(L), helpers.element("reissner3", 4)),
        "b": helpers.body(helpers.line(L, 0.0, (0.0, 1.0)), helpers.element("2d2n", 3)),
        "bead": helpers.body(helpers.line(1.0, np.pi / 2, (0.86, 0.0)), helpers.element("cable", 2)),
    }
    model = helpers.build(bodies, {"type": "eigen", "modes": 1})
    joints = [OnAxis(point_ref(model.meshes["bead"], s), model.meshes[on], 0.43, on)
              for s, on in ((0.0, "a"), (1.0, "b"))]
    for k, joint in enumerate(joints):
        joint.multiplier = model.n_q + k
    d = np.append(helpers.random_state(model, 0.05)[: model.n_q], [1.0, 2.0])
    both, table = np.zeros(len(d)), Record(sliding_table(joints, model.e0))
    sliding_forces(table, d, d, AMPS, both)
    alone = np.zeros(len(d))
    for joint in joints:
        sliding_forces(Record(sliding_table([joint], model.e0)), d, d, AMPS, alone)
    np.testing.assert_array_equal(both, alone)
    assert both[-1] != 0.0
    assert both[-2] != 0.0
    assert {int(one.table.shapes[0]), int(two.table.shapes[0])} == set(table.shapes.tolist())
