"""Bounds of curves from their chords, and the search for the element opposite to a point, compared with samples."""

import numpy as np
import pytest

from ancf2d.elements import contact_gaps as gaps
from ancf2d.elements import contact_geometry as geometry
from ancf2d.interactions.body_contact import facing_table
from ancf2d.kernels.facing import EVERY, IN_RANGE, face
from ancf2d.kernels.lowlevel.records import Record
from ancf2d.model.point_tables import point_table
from tests import helpers

Z = np.linspace(-1.0, 1.0, 41)
TAPER = "0.12 - 0.06*s*s"


class Scene:
    """A bent body whose faces touch another bent body, with samples of all curves: position, tangent, normal."""

    def __init__(self, element: str, height: float | str) -> None:
        section = {"height": height, "width": 0.1}
        model = helpers.build(
            {"rail": helpers.body(helpers.line(3.0), helpers.element(element, 4), section),
             "bar": helpers.body(helpers.line(2.0, start=(0.5, 0.16)), helpers.element(element, 5), section)},
            # in a motion, a layer in a corner is also searched by direction
            "static", bc=[{"type": "clamp", "at": f"{name}@0"} for name in ("rail", "bar")],
            contacts=[{"between": ["bar", "rail"], "law": {"stiffness": 1e6}}])
        touching = [p for p in model.springs if getattr(p, "pair", None) is not None]
        self.points, self.table = Record(point_table(touching)), Record(facing_table(touching))
        self.d = 0.05 * np.random.default_rng(3).standard_normal(len(model.numbering.place))
        face(self.table, self.points, self.d, np.inf, EVERY)

    def samples(self, c: int) -> np.ndarray:
        """Return (z, 6) numbers of ``trace_at`` on curve c."""
        fields = self.table.now[self.table.at[c, 2]:]
        return np.array([gaps.trace_at(self.table.curve[c], fields, np.zeros(len(fields)), z) for z in Z])

    def distances(self, table: Record) -> np.ndarray:
        """Return the distance of each point from the opposite place on the curves of a table, inf if none."""
        points, out = self.points, np.full(len(self.points.mem), np.inf)
        face(table, points, self.d, np.inf, EVERY)
        for i, (fields, _coords) in zip(table.item, table.own, strict=True):
            if points.mem[i, gaps.FOOT_KIND] == gaps.NOWHERE:
                continue
            b, e, c, f = points.field[i], points.field[i + 1], points.dof[i], points.dof[i + 1]
            G = points.G[points.entry[i]:points.entry[i + 1]].reshape(f - c, e - b)
            p, par, none = points.p0[b:e] + self.d[points.dofs[c:f]] @ G, points.par[i], np.zeros(e - b)
            x, y, *_ = gaps.line_at(par, p, none, par[geometry.HOME])
            fx, fy, *_ = gaps.trace_at(par[geometry.OPPOSITE:], p[fields:], none, points.mem[i, gaps.FOOT])
            out[i] = np.hypot(x - fx, y - fy)
        return out


@pytest.fixture(params=[("cable", 0.1), ("reissner2", 0.1), ("reissner3", 0.1), ("vallejo", 0.1), ("2d2n", 0.1),
                        ("cable", TAPER), ("reissner3", TAPER), ("vallejo", TAPER)],
                ids=lambda given: " ".join(map(str, given)))
def scene(request):
    return Scene(*request.param)


def test_positions_along_a_curve_agree_with_derivatives_by_its_fields(scene) -> None:
    for c in range(len(scene.table.curve)):
        fields, work, across = scene.table.now[scene.table.at[c, 2]:], *np.zeros((2, geometry.WORK))
        for z, found in zip(Z[::10], scene.samples(c)[::10], strict=True):
            par = scene.table.curve[c].copy()
            slopes = gaps.curve_at(par, fields, np.zeros(len(fields)), z, work, across)
            np.testing.assert_allclose(found, [work[geometry.RHO], work[geometry.RHO + 1], *slopes], rtol=1e-10,
                                       atol=1e-12)


def test_the_bound_holds_for_every_point_of_a_curve(scene) -> None:
    for c, (x, y, dx, dy, off) in enumerate(scene.table.chords):
        r = scene.samples(c)[:, :2]
        assert (np.hypot(*(r - np.outer(Z, [dx, dy]) - [x, y]).T) <= off).all()


def test_normals_of_a_curve_differ_from_that_of_its_chord_by_less_than_assumed(scene) -> None:
    """The search skips curves whose chord is turned away by more than three times the bound."""
    for c, (_, _, dx, dy, off) in enumerate(scene.table.chords):
        size, tangents = np.hypot(dx, dy), scene.samples(c)[:, 2:4]
        units = tangents / np.hypot(*tangents.T)[:, None]
        differs = np.hypot(*(units - np.array([dx, dy]) / size).T)
        assert 2.0 * off >= size or (differs <= 3.0 * off / size).all()


def test_the_bounds_of_a_box_hold_for_all_curves_in_it(scene) -> None:
    """Their points, normals, and distances along the normal of the box."""
    table = scene.table
    for arm, root in enumerate(table.tree[:-1]):
        first, n = table.first[arm], table.first[arm + 1] - table.first[arm]
        for c in range(n):
            samples, k = scene.samples(first + c), n - 1 + c
            normals = table.curve[first + c, gaps.SIGN] * samples[:, [3, 2]] * [-1.0, 1.0]
            normals /= np.hypot(*normals.T)[:, None]
            while True:
                low, high, normal, off, least = np.split(table.boxes[root + k], [2, 4, 6, 7])
                assert ((samples[:, :2] >= low) & (samples[:, :2] <= high)).all()
                assert (np.hypot(*(normals - normal).T) <= off + 1e-12).all()
                assert (samples[:, :2] @ normal >= least - 1e-12).all()
                if k == 0:
                    break
                k = (k - 1) // 2


def test_a_search_among_all_curves_finds_the_nearest_of_the_single_searches(scene) -> None:
    """Also within the range of forces, beyond which points are opposite to nothing."""
    points, table = scene.points, scene.table
    among_all, foot = scene.distances(table), points.mem[:, [gaps.FOOT, gaps.FOOT_KIND]].copy()
    alone, whole = np.full(len(points.mem), np.inf), table.values
    one = np.array([0, 1])
    for c in range(len(table.curve)):
        mine = table.way == np.searchsorted(table.first, c, side="right") - 1
        alone = np.minimum(alone, scene.distances(Record(whole._replace(
            item=table.item[mine], way=np.zeros(mine.sum(), dtype=np.int64), own=table.own[mine],
            arms=one, first=one, tree=one,
            curve=table.curve[c:c + 1], sizes=table.sizes[c:c + 1], at=table.at[c:c + 1],
            chords=np.zeros((1, 5)), boxes=np.zeros((1, 8))))))
    np.testing.assert_array_equal(among_all, alone)
    assert np.isfinite(alone).sum() > 30
    face(table, points, scene.d, IN_RANGE, EVERY)
    far = alone >= points.par[:, geometry.OPPOSITE + gaps.DEEPEST]
    assert far.any()
    assert not far.all()
    np.testing.assert_array_equal(points.apart == np.inf, far)
    assert (points.mem[far, gaps.FOOT_KIND] == gaps.NOWHERE).all()
    np.testing.assert_array_equal(points.mem[~far][:, [gaps.FOOT, gaps.FOOT_KIND]], foot[~far])
