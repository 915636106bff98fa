"""Reference curves and meshes: arc length, tangents, derivatives, distribution of elements, shared nodes."""

import itertools

import helpers
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ellipe

from ancf2d.case import Arc, ArcPiece, CurveGeometry, Line, LinePiece, PathGeometry, Polyline, Spline
from ancf2d.elements.definition import derivative_order
from ancf2d.model.curve import knots, pieces_of, share_count


@given(
    R=st.floats(0.1, 100),
    a=st.floats(-7, 7),
    sweep=st.floats(-6.2, 6.2).filter(lambda x: abs(x) > 0.01),
    s=st.floats(0, 1),
)
def test_an_arc_lies_on_its_circle_and_is_parametrised_by_arc_length(R, a, sweep, s):
    (piece,) = pieces_of(Arc(center=(1.0, -2.0), radius=R, from_=a, to=a + sweep), 4)
    assert piece.length == pytest.approx(R * abs(sweep))
    r, theta = piece.position(s * piece.length)
    angle = a + s * sweep
    np.testing.assert_allclose(r, [1 + R * np.cos(angle), -2 + R * np.sin(angle)], atol=1e-11 * R)
    sense = np.sign(sweep)
    np.testing.assert_allclose(
        [np.cos(theta), np.sin(theta)], [-sense * np.sin(angle), sense * np.cos(angle)], atol=1e-12
    )


@pytest.mark.parametrize("kappa_sign", [1, -1])
def test_derivatives_of_the_reference_are_those_of_the_curve(kappa_sign):
    (piece,) = pieces_of(Arc(center=(0.0, 0.0), radius=0.8, from_=0.2, to=0.2 + kappa_sign), 1)
    s, h = 0.3, 1e-3

    def r(x, y):
        p, theta = piece.position(x)
        return p + y * np.array([-np.sin(theta), np.cos(theta)])

    difference = {
        (1, 0): (r(s + h, 0) - r(s - h, 0)) / (2 * h),
        (0, 1): r(s, 1) - r(s, 0),
        (2, 0): (r(s + h, 0) - 2 * r(s, 0) + r(s - h, 0)) / h**2,
        (1, 1): (r(s + h, 1) - r(s - h, 1) - r(s + h, 0) + r(s - h, 0)) / (2 * h),
        (0, 2): np.zeros(2),
    }
    for order, value in difference.items():
        np.testing.assert_allclose(piece.derivative(s, *order), value, atol=2e-6)


@given(st.lists(st.floats(0.01, 100), min_size=1, max_size=8), st.integers(0, 60))
def test_elements_are_distributed_in_proportion_with_at_least_one_per_piece(lengths, extra):
    count = len(lengths) + extra
    shares = share_count(lengths, count)
    assert sum(shares) == count
    assert min(shares) >= 1
    for n, length in zip(shares, lengths, strict=True):
        assert n <= max(1, np.ceil(count * length / sum(lengths)))


@pytest.mark.parametrize(("lengths", "count", "shares"), [
    ([1, 1, 1], 4, [1, 2, 1]), ([1, 1, 1], 5, [2, 1, 2]), ([1, 1, 1, 1], 6, [1, 2, 2, 1]), ([1, 1], 3, [2, 1]),
    ([2, 1, 1, 2], 8, [3, 1, 1, 3]), ([1, 2, 1], 5, [1, 3, 1]), ([1, 1e-3, 1], 4, [2, 1, 1])])
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1 / 3, 0.7])
def test_pieces_equal_to_round_off_divide_an_odd_count_from_the_middle(lengths, count, shares, unit):
    rng = np.random.default_rng(1)
    for _ in range(5):
        noisy = [unit * length * (1 + 1e-15 * rng.integers(-3, 4)) for length in lengths]
        assert share_count(noisy, count) == shares


def test_the_counts_of_a_polyline_do_not_depend_on_its_direction():
    corners = np.array([[0, 0], [1, 0], [1, 1], [2, 1], [2, 2]])
    counts = set()
    for angle in np.linspace(0, 6, 25):
        R = 0.1 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = tuple(tuple(r) for r in (corners @ R.T + [0.3, -0.7]).tolist())
        counts.add(tuple(p.count for p in pieces_of(Polyline(points=points), 7)))
    assert counts == {(2, 2, 2, 1)}


SPLIT = {"line": Line(start=(0.0, 1.0), end=(3.0, 5.0)), "arc": Arc(center=(1.0, 2.0), radius=2.0, from_=0.5, to=3.0),
         "polyline": Polyline(points=((0.0, 0.0), (1.0, 0.0), (1.0, 3.0)))}


@pytest.mark.parametrize("geometry", SPLIT)
def test_pieces_are_split_at_required_nodes_and_stay_on_the_curve(geometry):
    (whole, *_), pieces = pieces_of(SPLIT[geometry], 7), pieces_of(SPLIT[geometry], 7, (0.0, 0.3, 0.77, 1.0))
    length = pieces[-1].s0 + pieces[-1].length
    starts = [p.s0 / length for p in pieces]
    np.testing.assert_allclose([s for s, p in zip(starts, pieces, strict=True) if p.continues], [0.3, 0.77])
    assert sum(p.count for p in pieces) == 7
    assert whole.s0 == 0.0
    for a, b in itertools.pairwise(pieces):
        end, angle = a.position(a.length)
        np.testing.assert_allclose(end, b.start, atol=1e-14)
        assert not b.continues or angle == pytest.approx(b.angle, abs=1e-14)


def test_existing_nodes_split_nothing_and_close_ones_are_merged():
    line = SPLIT["line"]
    assert pieces_of(line, 8, (0.0, 0.25, 0.625, 1 - 1e-7)) == pieces_of(line, 8)
    assert [p.count for p in pieces_of(line, 8, (0.3, 0.300001, 0.3 + 1e-13))] == [2, 6]
    assert [p.count for p in pieces_of(line, 2, (0.1, 0.2, 0.9))] == [1, 1, 1, 1]


def test_a_polyline_keeps_its_turns_continuous():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0)]
    angles = [p.angle for p in pieces_of(Polyline(points=tuple(points)), 5)]
    np.testing.assert_allclose(np.diff(angles), np.pi / 2)


def test_a_line_is_one_straight_piece():
    (piece,) = pieces_of(Line(start=(1.0, 1.0), end=(4.0, 5.0)), 10)
    assert (piece.length, piece.l, piece.kappa) == (5.0, 0.5, 0.0)


@pytest.mark.parametrize("geometry", helpers.GEOMETRIES)
@pytest.mark.parametrize("name", helpers.TYPES)
def test_reference_coordinates_are_derivatives_of_the_curve_at_the_nodes(name, geometry):
    model = helpers.build(
        {"b": helpers.body(helpers.GEOMETRIES[geometry], helpers.element(name, 3))}, bc=[{"type": "clamp", "at": "b@0"}]
    )
    mesh, element = model.meshes["b"], helpers.TYPES[name]
    piece, nc = mesh.plan.pieces[0], element.components
    for ie, dofs in enumerate(mesh.dofs):
        for k, (node, coordinate) in enumerate(element.functionals):
            r, theta = piece.position(piece.l * (ie + element.nodes[node].at))
            order = derivative_order(coordinate)
            expected = r if order == (0, 0) else piece.derivative(piece.l * (ie + element.nodes[node].at), *order)
            np.testing.assert_allclose(model.e0[dofs[nc * k : nc * k + 2]], expected, atol=1e-13)
            if nc == 3:
                assert model.e0[dofs[nc * k + 2]] == pytest.approx(theta, abs=1e-13)
    shared = len(mesh.node_dofs(0, 0))
    assert mesh.n_dofs == 3 * (element.n_dof - shared) + shared
    np.testing.assert_array_equal(mesh.node_dofs(0, len(element.nodes) - 1), mesh.node_dofs(1, 0))


@pytest.mark.parametrize("name", helpers.TYPES)
def test_points_lie_on_the_reference_at_nodes_and_between(name):
    for geometry in (helpers.LINE, helpers.ARC, {"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 2]]}):
        model = helpers.build(
            {"b": helpers.body(geometry, helpers.element(name, 40))}, bc=[{"type": "clamp", "at": "b@0"}]
        )
        from ancf2d.model.points import dot, point_ref

        for s in (0.0, 0.025, 0.31, 0.5, 0.77, 1.0):
            point = point_ref(model.meshes["b"], s)
            r = [dot(c, model.e0) for c in point.position()]
            np.testing.assert_allclose(r, model.meshes["b"].plan.position(s)[0], atol=2e-4)


TURN = 2 * np.pi
SMOOTH = {
    # length, area within (or under, to the origin), curvature by x and y
    "ellipse": (CurveGeometry(x="2*cos(2*pi*s)", y="sin(2*pi*s)", closed=True), 8 * ellipe(0.75), TURN,
                lambda x, y: 2 / (4 * y**2 + x**2 / 4) ** 1.5),
    "spiral": (CurveGeometry(x="exp(0.8*pi*s)*cos(4*pi*s)", y="exp(0.8*pi*s)*sin(4*pi*s)"),
               np.sqrt(1.04) / 0.2 * (np.exp(0.8 * np.pi) - 1), (np.exp(1.6 * np.pi) - 1) / 0.8,
               lambda x, y: 1 / np.sqrt(1.04 * (x**2 + y**2))),
    "circle by thirds of s": (CurveGeometry(x="cos(2*pi*s^3 + s)", y="sin(2*pi*s^3 + s)"), TURN + 1, (TURN + 1) / 2,
                              lambda x, y: np.ones_like(x)),
    "racetrack": (PathGeometry(start=(3.0, 1.0), heading=0.0, pieces=(
        LinePiece(line=1.0), ArcPiece(arc=0.5, angle=np.pi), LinePiece(line=1.0), ArcPiece(arc=0.5, angle=np.pi)),
        closed=True), 2 + np.pi, 1 + np.pi / 4, None),
}


@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.parametrize("count", [1, 7])
def test_length_curvature_and_area_of_smooth_axes_are_exact(name, count):
    geometry, length, area, bent = SMOOTH[name]
    pieces = pieces_of(geometry, max(count, geometry.least))
    assert pieces[-1].s0 + pieces[-1].length == pytest.approx(length, rel=1e-13)
    x, w = np.polynomial.legendre.leggauss(300)
    found = 0.0
    for piece in pieces:
        s = piece.length * (1 + x) / 2
        r, theta = piece.position(s)
        t = piece.derivative(s, 1, 0)
        np.testing.assert_allclose(t, np.stack([np.cos(theta), np.sin(theta)], axis=-1), atol=1e-13)
        found += piece.length / 4 * float(w @ (r[:, 0] * t[:, 1] - r[:, 1] * t[:, 0]))
        if bent is not None:
            np.testing.assert_allclose(piece.curvature(s), bent(*r.T), rtol=1e-11)
    assert found == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("shift", [0.0, 1e6])
def test_smooth_axes_do_not_depend_on_position(shift):
    near = pieces_of(CurveGeometry(x="s", y="s^2"), 4)[0]
    far = pieces_of(CurveGeometry(x=f"{shift} + s", y="s^2"), 4)[0]
    assert far.length == pytest.approx(near.length, rel=1e-13)


def test_derivatives_of_smooth_axes_by_arclength():
    (piece,) = pieces_of(SMOOTH["ellipse"][0], 3)
    s, h = np.array([0.4, 2.0, 5.1]), 1e-4
    for i, j in ((2, 0), (3, 0), (4, 0), (1, 1), (2, 1)):
        lower = [piece.derivative(s + k * h, i - 1, j) for k in (-1, 1)]
        np.testing.assert_allclose(piece.derivative(s, i, j), (lower[1] - lower[0]) / (2 * h), atol=2e-6)


def test_a_spline_passes_its_points_with_continuous_curvature_and_ends_elements_there():
    points = ((0.0, 0.0), (0.5, 0.2), (0.9, 0.1), (1.5, 0.6), (2.0, 0.3))
    spline = Spline(points=points)
    at = [0.0, *knots(spline), 1.0]
    (whole,) = pieces_of(spline, 9)
    np.testing.assert_allclose(whole.position(np.array(at) * whole.length)[0], points, atol=1e-14)
    for s in at[1:-1]:
        before, behind = (float(whole.curvature(s * whole.length + h)) for h in (-1e-9, 1e-9))
        assert before == pytest.approx(behind, abs=1e-6)
    pieces = pieces_of(spline, 9, at)
    np.testing.assert_allclose([p.s0 / whole.length for p in pieces], at[:-1], atol=1e-14)
    assert all(p.shared for p in pieces[1:])


def test_a_closed_spline_through_points_of_a_circle_is_nearly_one():
    n = 64
    a = TURN * np.arange(n) / n
    (ring,) = pieces_of(Spline(points=tuple(zip(np.cos(a).tolist(), np.sin(a).tolist(), strict=True)), closed=True), 8)
    assert ring.length == pytest.approx(TURN, rel=1e-6)
    np.testing.assert_allclose(ring.curvature(np.linspace(0, ring.length, 50)), 1.0, rtol=1e-3)
    assert ring.position(ring.length)[1] - ring.angle == pytest.approx(TURN)


def test_the_nearest_point_of_a_smooth_axis():
    (piece,) = pieces_of(SMOOTH["spiral"][0], 3)
    for s in (0.0, 1.3, 30.0, piece.length):
        r, theta = piece.position(s)
        off = r + 0.05 * np.array([-np.sin(theta), np.cos(theta)])
        assert piece.nearest(off) == pytest.approx(s, abs=1e-10)
