"""The kernels of contact points: sums over curves, skipped points, friction between bodies."""

from __future__ import annotations

import helpers
import numpy as np
import pytest
from scipy.sparse import csr_matrix, identity
from test_points import DYNAMIC, tangent

from ancf2d.elements import contact_geometry as geometry
from ancf2d.elements.contact_gaps import FOOT_KIND, WITHIN
from ancf2d.interactions.body_contact import facing_table
from ancf2d.interactions.contact import ContactPoint
from ancf2d.interactions.obstacles import PolylineObstacle
from ancf2d.kernels.contact import _convex
from ancf2d.kernels.curves import add_skew, point_accept, point_forces
from ancf2d.kernels.facing import EVERY, IN_RANGE, face
from ancf2d.kernels.lowlevel.jit import kernel
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import SymBand
from ancf2d.model.point_tables import point_table
from ancf2d.model.rotation import CoordinateKinds
from ancf2d.solvers.motion.tables import with_assembly


@kernel
def skew(points, x, y, places):
    """Call ``add_skew``, which only kernels can call."""
    return add_skew(points, x, y, places)


def test_contact_points_on_one_curve_are_summed_and_skipped_if_it_is_far():
    """Sums over items that share fields agree with single items; points far behind the first are skipped.

    Tables that know the places of their entries in the matrix add the same to it. With what friction makes
    unsymmetric, a product with the matrix is the derivative of the forces.
    """
    touch = {"between": ["rope", "wheel"], "friction": 0.4, "law": {"stiffness": 1e3, "damping": 2.0}, "side": "axis"}
    model = helpers.build(
        {"rope": helpers.body({"type": "path", "start": [-2.0, 0.49], "pieces": [{"line": 4.0}]},
                              helpers.element("cable", 8)),
         "hub": {"geometry": helpers.line(0.2), "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}}},
        DYNAMIC, contacts=[touch],
        obstacles={"wheel": {"type": "circle", "center": [0, 0], "radius": 0.5, "on": "hub"}})
    points, rng, none = Record(point_table(model.interactions.points)), np.random.default_rng(5), np.zeros((0, 3))
    alone = points.replaced(run=np.ones_like(points.run))
    n = model.n_q + len(model.constraints)
    d, v = 1e-3 * rng.standard_normal(n), 1e-2 * rng.standard_normal(n)
    # some points slide from where they held to
    point_accept(points, d + 1e-2 * rng.standard_normal(n), none)
    far = np.zeros(len(points.forces), dtype=bool)
    gaps = model.contacts[0].gaps(d, 0.0)
    for i in np.flatnonzero(points.run == 4):
        far[i + 1:i + 4] = gaps[i:i + 4].min() > 0.6
    assert far.sum() >= 9
    assert (gaps < 0.0).sum() >= 2
    sewn = Record(with_assembly(points.values, identity(n, format="csr"), lambda i, j: i * n + n - 1 + j - i))
    found = []
    for table in (alone, points, sewn):
        if table is points:
            points.par[far, geometry.HOME] = np.nan
        Q, P = np.zeros(n), np.zeros(n)
        K = SymBand(np.zeros((n, n)))
        plain = Places(np.arange(n), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        both = point_forces(table, d, v, none, Q)
        energy = tangent(table, d, v, none, 0.3, P, K, plain)
        found.append((np.array([*both, energy]), Q, P, K.values))
    for one, *others in zip(*found, strict=True):
        assert np.abs(one).max() > 0.0
        for other in others:
            np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-13 * np.abs(one).max())
    lower = np.array([[K.values[i, n - 1 + j - i] if j <= i else 0.0 for j in range(n)] for i in range(n)])
    x, h, ends = rng.standard_normal(n), 1e-7, np.zeros((2, n))
    y = (lower + np.tril(lower, -1).T) @ x
    symmetric = y.copy()
    assert skew(sewn, x, y, plain)
    for end, s in zip(ends, (h, -h), strict=True):
        point_forces(table, d + s * x, v + 0.3 * s * x, none, end)
    slope = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(y, slope, atol=1e-5 * np.abs(slope).max())
    assert np.abs(symmetric - slope).max() > 1e-3 * np.abs(slope).max()


def test_the_unsymmetric_part_of_friction_between_bodies_for_any_opposite_element() -> None:
    """A product with the matrix is the derivative of the forces of the unknowns, some coordinates being combinations.

    A bar on a rail, moved from the element that its points begin on to others, with an end that slides aslant.
    """
    model = helpers.build(
        {"rail": helpers.body(helpers.line(3.0), helpers.element("cable", 3)),
         "bar": helpers.body(helpers.line(0.4, start=(0.2, 0.3)), helpers.element("cable", 2))},
        DYNAMIC, contacts=[{"between": ["bar", "rail"], "friction": 0.4}],
        bc=[{"type": "clamp", "at": "rail@0"}, {"type": "roller", "at": "rail@1", "normal": [1, 2]}])
    num, rng, none = model.numbering, np.random.default_rng(5), np.zeros((0, 3))
    model_T = np.zeros((len(num.place), num.n_unknowns))
    for c, k in enumerate(num.place):
        if k >= 0:
            model_T[c, k] = 1.0
        elif k < -1:
            some = slice(num.indptr[-2 - k], num.indptr[-1 - k])
            model_T[c, num.index[some]] = num.value[some]
    assert (num.place < -1).any()
    touching = [c for c in model.constraints if isinstance(c, ContactPoint)]
    points = Record(with_assembly(point_table(touching), csr_matrix(model_T), lambda i, j: i))
    table = Record(facing_table(touching))
    n, z = num.n_unknowns, 1e-5 * rng.standard_normal(num.n_unknowns)
    CoordinateKinds(model.meshes.values()).translation(moved := np.zeros(len(num.place)), 1.3, -1e-5)
    bar = model.meshes["bar"].dofs.ravel()
    z[num.place[bar]] += moved[bar]
    z[num.place[points.multiplier]] = -5.0
    points.mem[:, geometry.SLIP_STATUS] = rng.choice([-1.0, 1.0], len(points.mem))
    points.mem[:, geometry.STATUS] = geometry.CLOSED
    K, Q, ends = SymBand(np.zeros((n, n))), np.zeros(len(num.place)), np.zeros((2, n))
    maps = num.places
    v, x, h = np.zeros(len(num.place)), rng.standard_normal(n), 1e-6
    face(table, points, model_T @ z, np.inf, EVERY)
    tangent(points, model_T @ z, v, none, 0.0, Q, K, maps)
    assert (points.mem[:, FOOT_KIND] == WITHIN).sum() > 3
    lower = np.array([[K.values[i, n - 1 + j - i] if j <= i else 0.0 for j in range(n)] for i in range(n)])
    y = (lower + np.tril(lower, -1).T) @ x
    symmetric = y.copy()
    assert skew(points, x, y, maps)
    for k, s in enumerate((h, -h)):
        Q[:] = 0.0
        point_forces(points, model_T @ (z + s * x), v, none, Q)
        ends[k] = model_T.T @ Q
    slope = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(y, slope, atol=1e-5 * np.abs(slope).max())
    assert np.abs(symmetric - slope).max() > 1e-3 * np.abs(slope).max()


@pytest.mark.parametrize("pushed", [-1e-5, -1e6])
@pytest.mark.parametrize("law", [{}, {"law": {"stiffness": 1e6, "damping": 10.0}}])
def test_skipped_points_have_no_force(law, pushed) -> None:
    """A bar turned about a point on a rail: forces on bodies are those of all points, for any multipliers.

    A force that pushes hard closes gaps of any width, so that no point is left out then.
    """
    section, middle = {"height": 0.1, "width": 0.1}, np.array([1.5, 0.11])
    model = helpers.build(
        {"rail": helpers.body(helpers.line(3.0), helpers.element("reissner2", 6), section),
         "bar": helpers.body(helpers.line(2.0, start=(0.5, 0.11)), helpers.element("cable", 5), section)},
        DYNAMIC, contacts=[{"between": ["bar", "rail"], **law}])
    touching = [p for p in (*model.springs, *model.constraints) if getattr(p, "pair", None) is not None]
    rng, none, size = np.random.default_rng(2), np.zeros((0, 3)), len(model.numbering.place)
    bar, left = np.unique(model.meshes["bar"].dofs), []
    for angle in (0.0, 0.05, -0.3):
        points, table = Record(point_table(touching)), Record(facing_table(touching))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        d = 1e-4 * rng.standard_normal(size)
        d[bar] += helpers.rotate(np.zeros(model.n_q), model, angle, middle - turn @ middle - [0.0, 0.012])[bar]
        closed = points.multiplier[points.multiplier >= 0]
        d[closed] = pushed
        found = []
        for within in (np.inf, IN_RANGE):
            Q = np.zeros(size)
            face(table, points, d, within, EVERY)
            found.append((point_forces(points, d, 1e-2 * np.sin(np.arange(size)), none, Q), Q))
        (before, every), (after, some) = found
        left.append(int((points.apart > 0.0).sum()))
        moves = np.setdiff1d(np.arange(size), closed)
        assert before == after
        np.testing.assert_array_equal(some[moves], every[moves])
        assert np.abs(every[moves]).max() > 0.0
        # where a point acts its gap has to vanish, else its multiplier
        np.testing.assert_array_equal(some[closed] == 0.0, every[closed] == 0.0)
    assert max(left) == 0 if closed.size and pushed < -1.0 else max(left) > 5


def test_layer_friction_starts_at_the_last_accepted_position_of_open_points() -> None:
    """A bar far above a floor moves along it by 0.3 m: where it lands, it has slipped from there alone."""
    model = helpers.build({"bar": helpers.body(helpers.line(1.0), helpers.element("cable", 2))},
                          obstacles={"floor": {"type": "half_plane", "through": [0, -10], "normal": [0, 1]}},
                          contacts=[{"between": ["bar", "floor"], "side": "axis", "friction": 0.3,
                                     "law": {"stiffness": 1e6}}])
    (batch,) = model.interactions.springs
    d = np.zeros(len(model.numbering.place))
    model.interactions.set_friction_anchors(d, 0.0)
    first = batch.table.mem[:, geometry.ANCHOR].copy()
    # which finds that no point can touch
    point_forces(batch.table, d, d, batch.amplitudes(0.0), np.zeros_like(d))
    assert (batch.table.apart > 0.0).any()
    CoordinateKinds(model.meshes.values()).translation(d, 0.3, 0.0)
    batch.accept(d, 0.0)
    np.testing.assert_allclose(np.abs(batch.table.mem[:, geometry.ANCHOR] - first), 0.3, rtol=1e-12)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("place", [(0.0, 0.0), (3.0, -5.0), (-70.0, 40.0)])
def test_convex_corners_do_not_depend_on_position(place, turn):
    """All corners of an L but one are convex; those of an open line are convex if it turns right there."""
    corners = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    for closed in (True, False):
        shape = PolylineObstacle(tuple((x + place[0], y + place[1]) for x, y in corners[::turn]), closed).shape()
        par = np.array([0.0] * geometry.OPPOSITE + shape[1:])
        points = np.array(shape[3:]).reshape(-1, 3)[:, :2] - place
        found = {tuple(points[v].tolist()) for v in range(6) if _convex.py_func(par, v, 6)}
        ends = set() if closed else {corners[0], corners[-1]}
        inside, outside = {(1, 1)}, set(corners) - {(1, 1)} - ends
        assert found == (outside if closed or turn < 0 else inside)
