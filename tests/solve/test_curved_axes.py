"""Splines, curves, paths and closed axes, compared with integrals along the axis without elements."""

from __future__ import annotations

import itertools
from typing import Any

import helpers
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from ancf2d.errors import CaseError

E, NU, H, B = 1e7, 0.3, 0.1, 0.1
A, I = H * B, B * H**3 / 12
POINTS = [[0, 0], [0.5, 0.2], [0.9, 0.1], [1.5, 0.6], [2, 0.3]]
RACETRACK = {"type": "path", "start": [0, 0], "closed": True,
             "pieces": [{"line": 1}, {"arc": 0.5, "angle": np.pi}, {"line": 1}, {"arc": 0.5, "angle": np.pi}]}
ELLIPSE = {"type": "curve", "x": "2*cos(2*pi*s)", "y": "sin(2*pi*s)", "closed": True}
RING = {"type": "path", "start": [1, 0], "heading": np.pi / 2, "pieces": [{"arc": 1, "angle": 2 * np.pi}],
        "closed": True}


def body(geometry: dict[str, Any], kind: str, count: int, **more: Any) -> dict[str, Any]:
    return {"geometry": geometry, "section": {"height": H, "width": B}, "material": {"E": E, "nu": NU, "rho": 1000.0},
            "element": {"type": kind, "count": count, **more}}


class Axis:
    """A curve z(u) by Gauss points between edges, with the compliance of a linear beam along it."""

    def __init__(self, z: Any, rate: Any, edges: Any, kGA: float | None) -> None:
        x, w = np.polynomial.legendre.leggauss(40)
        self.u = np.concatenate([(a + b + (b - a) * x) / 2 for a, b in itertools.pairwise(edges)])
        v = rate(self.u)
        self.ds = np.concatenate([(b - a) / 2 * w for a, b in itertools.pairwise(edges)]) * abs(v)
        self.z, self.t, self.r, self.kGA = z, v / abs(v), z(self.u), kGA

    def energy(self, one: Any, other: Any) -> float:
        """Twice the complementary energy of forces (complex) and moments along the axis."""
        (f, m), (g, n) = one, other
        p, q = f * self.t.conj(), g * self.t.conj()
        shear = 0.0 if self.kGA is None else p.imag * q.imag / self.kGA
        return float(self.ds @ (p.real * q.real / (E * A) + shear + m * n / (E * I)))

    def hanging(self, force: complex, end: float) -> list[float]:
        """Displacement of the end of a cantilever under a force there."""
        def of(f: complex) -> Any:
            return np.full(len(self.r), f), ((self.z(end) - self.r).conj() * f).imag
        return [self.energy(of(force), of(unit)) for unit in (1.0, 1j)]

    def closed(self, loads: list[tuple[float, complex]]) -> float:
        """Work of loads (u, force) in equilibrium on a closed axis: twice the least complementary energy."""
        z0 = self.z(0.0)
        parts = [(np.full(len(self.r), f), ((z0 - self.r).conj() * f).imag) for f in (1.0, 1j)]
        parts.append((np.zeros(len(self.r)), np.ones(len(self.r))))
        force, moment = np.zeros(len(self.r), dtype=complex), np.zeros(len(self.r))
        for u, f in loads:
            behind = self.u > u
            force, moment = force - behind * f, moment - behind * ((self.z(u) - self.r).conj() * f).imag
        K = np.array([[self.energy(a, b) for b in parts] for a in parts])
        k = np.array([self.energy(a, (force, moment)) for a in parts])
        return self.energy((force, moment), (force, moment)) - float(k @ np.linalg.solve(K, k))


def shear_stiffness(kind: str) -> float | None:
    return None if kind == "cable" else 10 * (1 + NU) / (12 + 11 * NU) * E / (2 * (1 + NU)) * A


def quarter(kGA: float | None) -> Axis:
    return Axis(lambda u: 2 * np.sin(np.pi * u / 2) + 1j * np.cos(np.pi * u / 2),
                lambda u: np.pi * np.cos(np.pi * u / 2) - 0.5j * np.pi * np.sin(np.pi * u / 2),
                np.linspace(0, 1, 5), kGA)


def through_points(kGA: float | None) -> Axis:
    chords = np.hypot(*np.diff(POINTS, axis=0).T)
    curve = CubicSpline(np.concatenate([[0], np.cumsum(chords)]) / chords.sum(), np.array(POINTS) @ [1, 1j])
    return Axis(curve, curve.derivative(), curve.x, kGA)


CANTILEVERS = {"curve": ({"type": "curve", "x": "2*sin(pi*s/2)", "y": "cos(pi*s/2)"}, quarter),
               "spline": ({"type": "spline", "points": POINTS}, through_points)}


@pytest.mark.slow_rows("curve-cable-4")
@pytest.mark.parametrize(("kind", "order"), [("reissner2", 2), ("reissner3", 4), ("cable", 4)])
@pytest.mark.parametrize("geometry", CANTILEVERS)
def test_elements_keep_their_order_on_curved_axes(geometry: str, kind: str, order: int) -> None:
    """The curvature changes along the axis; that of a spline has kinks at its points, where elements end."""
    data, axis = CANTILEVERS[geometry]
    exact = np.array(axis(shear_stiffness(kind)).hanging(1 + 2j, 1.0))
    errors = []
    for count in (32, 64):
        found = helpers.solved({"a": body(data, kind, count)}, "linear_static",
                               bc=[{"type": "clamp", "at": "a@0"}],
                               loads=[{"type": "force", "at": "a@1", "value": [1, 2]}]).u("a@1")
        errors.append(float(np.linalg.norm(found - exact) / np.linalg.norm(exact)))
    assert np.log2(errors[0] / errors[1]) > order - 0.1
    assert errors[1] < (6e-4 if order == 2 else 3e-6)


def closed_axis(name: str, kGA: float | None) -> tuple[dict[str, Any], Axis, float, list[float]]:
    """Return geometry, axis, and u of a point and S of two opposite points, at 0 and there."""
    if name == "ring":
        return RING, Axis(lambda u: np.exp(2j * np.pi * u), lambda u: 2j * np.pi * np.exp(2j * np.pi * u),
                          np.linspace(0, 1, 9), kGA), 0.5, [0.0, 0.5]
    if name == "ellipse":
        return ELLIPSE, Axis(lambda u: 2 * np.cos(2 * np.pi * u) + 1j * np.sin(2 * np.pi * u),
                             lambda u: 2 * np.pi * (-2 * np.sin(2 * np.pi * u) + 1j * np.cos(2 * np.pi * u)),
                             np.linspace(0, 1, 17), kGA), 0.5, [0.0, 0.5]
    a = np.pi / 2

    def z(s: Any) -> Any:
        s = np.asarray(s, dtype=float)
        return np.select([s <= 1, s <= 1 + a, s <= 2 + a],
                         [s + 0j, 1 + 0.5j - 0.5j * np.exp(2j * (s - 1)), 1 - (s - 1 - a) + 1j],
                         0.5j + 0.5j * np.exp(2j * (s - 2 - a)))

    def rate(s: Any) -> Any:
        return np.select([s <= 1, s <= 1 + a, s <= 2 + a], [1 + 0j * s, np.exp(2j * (s - 1)), -1 + 0j * s],
                         -np.exp(2j * (s - 2 - a)))

    return RACETRACK, Axis(z, rate, [0, 1, 1 + a, 2 + a, 2 + 2 * a], kGA), 1 + a, [0.0, 0.5]


@pytest.mark.slow_rows("ellipse-cable")
@pytest.mark.parametrize("kind", ["reissner3", "cable"])
@pytest.mark.parametrize("name", ["ring", "ellipse", "racetrack"])
def test_closed_axes_under_two_opposite_forces(name: str, kind: str) -> None:
    geometry, axis, u, (s0, s1) = closed_axis(name, shear_stiffness(kind))
    pull = axis.z(0.0) - axis.z(u)
    pull /= abs(pull)
    exact = axis.closed([(0.0, pull), (u, -pull)])
    errors = []
    for count in (32, 64):
        found = helpers.solved(
            {"a": body(geometry, kind, count)}, "linear_static",
            bc=[{"type": "clamp", "at": "a@0.25", "hold": "section"}],
            loads=[{"type": "force", "at": f"a@{s}", "value": [f * pull.real, f * pull.imag]}
                   for s, f in ((s0, 1), (s1, -1))])
        apart = found.u(f"a@{s0}") - found.u(f"a@{s1}")
        np.testing.assert_allclose(found.u("a@0"), found.u("a@1"), atol=1e-18)
        errors.append(abs(float(apart @ [pull.real, pull.imag]) / exact - 1))
    assert errors[1] < 2e-4
    assert np.log2(errors[0] / errors[1]) > 3.2


def test_the_ring_of_timoshenko() -> None:
    """Inextensible: the diameter grows by (pi/4 - 2/pi) P R^3/EI along the forces (Timoshenko)."""
    slender = body(RING, "cable", 64) | {"section": {"height": 1e-3, "width": B}}
    found = helpers.solved({"a": slender}, "linear_static", bc=[{"type": "clamp", "at": "a@0.25", "hold": "section"}],
                           loads=[{"type": "force", "at": "a@0", "value": [1e-6, 0]},
                                  {"type": "force", "at": "a@0.5", "value": [-1e-6, 0]}])
    EI = E * B * 1e-9 / 12
    opened = (found.u("a@0") - found.u("a@0.5"))[0]
    assert opened == pytest.approx((np.pi / 4 - 2 / np.pi) * 1e-6 / EI, rel=1e-5)
    closed = (found.u("a@0.25") - found.u("a@0.75"))[1]
    assert closed == pytest.approx(-(2 / np.pi - 0.5) * 1e-6 / EI, rel=1e-5)


def test_modes_of_a_ring_come_in_pairs() -> None:
    """Love 1927, inextensible: omega^2 = EI/(rho A R^4) n^2 (n^2 - 1)^2/(n^2 + 1), n = 2, 3, after three rigid ones."""
    slender = body(RING, "cable", 48) | {"section": {"height": 1e-3, "width": B}}
    found = helpers.solved({"a": slender}, {"type": "eigen", "modes": 7}).state.report["frequencies"]
    unit = np.sqrt(E * 1e-6 / 12 / 1000.0)
    exact = [0.0] * 3 + [unit * n * (n * n - 1) / np.sqrt(n * n + 1) for n in (2, 2, 3, 3)]
    assert [f["omega"] for f in found] == pytest.approx(exact, rel=1e-5)


PATH = {"type": "path", "start": [0, 0], "heading": 0.3, "pieces": [{"line": 1}, {"arc": 0.5, "angle": -1.2}]}


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3", "li"])
def test_a_path_equals_its_welded_pieces(name: str) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    line = {"type": "line", "start": [0, 0], "end": [c, s]}
    arc = {"type": "arc", "center": [c + 0.5 * s, s - 0.5 * c], "radius": 0.5, "from": 0.3 + np.pi / 2,
           "to": 0.3 + np.pi / 2 - 1.2}
    scene = {"bc": [{"type": "clamp", "at": "a@0"}]}
    whole = helpers.solved({"a": body(PATH, name, 8)}, "static", **scene,
                           loads=[{"type": "force", "at": "a@1", "value": [3, 5]}])
    counts = [p.count for p in whole.model.meshes["a"].plan.pieces]
    halves = helpers.solved({"a": body(line, name, counts[0]), "b": body(arc, name, counts[1])}, "static", **scene,
                            joints=[{"type": "weld", "between": ["a@1", "b@0"]}],
                            loads=[{"type": "force", "at": "b@1", "value": [3, 5]}])
    np.testing.assert_allclose(whole.u("a@1"), halves.u("b@1"), rtol=1e-10)
    assert whole.theta("a@1") == pytest.approx(halves.theta("b@1"), rel=1e-10)


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3", "ancf[3,3]"])
def test_the_weight_of_a_curved_body(name: str) -> None:
    """Reactions under gravity: the weight of the arc length, and its moment about the support."""
    ell = CANTILEVERS["curve"][0]
    axis = quarter(None)
    spec = helpers.element(name, 16)
    found = helpers.solved({"a": body(ell, name, 16) | {"element": spec}}, "linear_static",
                           bc=[{"name": "wall", "type": "clamp", "at": "a@0"}],
                           loads=[{"type": "gravity", "value": [0, -10]}]).reactions()["wall"]
    weight = 1000.0 * A * 10
    # off the axis by the curvature: |r_x x r_y| = 1 - kappa y
    assert found["fy"] == pytest.approx(weight * axis.ds.sum(), rel=1e-5)
    assert found["m"] == pytest.approx(weight * float(axis.ds @ axis.r.real), rel=2e-3)


@pytest.mark.parametrize(("geometry", "said"), [
    ({"type": "spline", "points": [[-1e30, 2], [1, 3], [2, 2]]}, "points 1 and 2 are as good as one"),
    ({"type": "spline", "points": [[1e308, 0], [-1e308, 3]]}, "longer than floating-point numbers can tell"),
    ({"type": "curve", "x": "abs(s - 0.5)", "y": "s"}, "jumps, has a corner or has zero velocity near s = 0.5"),
    ({"type": "curve", "x": "(s - 0.25)^2", "y": "(s - 0.25)^3"}, "zero velocity near s = 0.25"),
    ({"type": "curve", "x": "0 if s < 0.4 else 1", "y": "s"}, "jumps, has a corner or has zero velocity near s = 0.4"),
    ({"type": "curve", "x": "1", "y": "2"}, "the curve has no length"),
    ({"type": "curve", "x": "sqrt(s - 0.1)", "y": "s"}, "no position or no direction at s = 0"),
    ({"type": "curve", "x": "s", "y": "s", "closed": True}, "ends at (1, 1), 1.41 away from its start (0, 0)"),
    ({"type": "curve", "x": "s*(1-s)", "y": "s^2*(1-s)", "closed": True}, "points -2.36 rad away from the direction"),
    ({**RACETRACK, "pieces": RACETRACK["pieces"][:3]}, "1 away from its start"),
    ({"type": "path", "start": [0, 0], "pieces": [{"arc": 1, "angle": 1}], "closed": True}, "closed, but")])
def test_axes_that_are_not_smooth_are_refused(geometry: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError) as caught:
        helpers.build({"a": body(geometry, "cable", 8)}, bc=[{"type": "clamp", "at": "a@0"}])
    assert said in str(caught.value)
    assert "bodies.a.geometry" in str(caught.value)


def scene(turn: complex = 1.0, shift: complex = 0.0, size: float = 1.0, mirror: bool = False) -> dict[str, Any]:
    """A clamped spline in another position, size or handedness.

    It has a tendon along it, one to the ground, a force, and a line load and a natural curvature that vary along it.
    Lengths grow with ``size``, stresses stay.
    """
    def at(x: float, y: float) -> complex:
        return complex(turn * size * complex(x, -y if mirror else y) + shift)

    side, (fx, fy) = -1.0 if mirror else 1.0, (2.0, -1.0)
    force = turn * size**2 * complex(fx, -fy if mirror else fy)
    line = [{"s": [0, 0.4, 1], "value": [q / size, 3.0 * q / size, 0.0]} for q in (force.real, force.imag)]
    bend = {"s": [0, 0.7, 1], "value": [side * k / size for k in (0.0, 0.2, 0.1)]}
    ground = at(1.0, 1.5)
    points = [[p.real, p.imag] for p in (at(*p) for p in POINTS)]
    return {"bodies": {"a": {**body({"type": "spline", "points": points}, "reissner3", 12),
                             "section": {"height": H * size, "width": B * size}}},
            "bc": [{"type": "clamp", "at": "a@0"}],
            "loads": [{"type": "force", "at": "a@1", "value": [force.real, force.imag]},
                      {"type": "distributed", "on": "a", "value": line},
                      {"type": "eigenstrain", "on": "a", "curvature": bend},
                      {"type": "tendon", "on": "a", "y": 0.03 * side * size, "to": 0.8, "tension": 900.0 * size**2},
                      {"type": "tendon", "through": [{"at": "a@0.6", "y": -0.04 * side * size}, "a@1",
                                                     [ground.real, ground.imag]],
                       "stiffness": 4e3 * size**2, "slack": -0.3 * size}]}


@pytest.mark.slow_rows("change0")
@pytest.mark.parametrize("change", [
    {"size": 1e-3}, {"turn": np.exp(-1j), "shift": 2 + 1j, "size": 10.0, "mirror": True},
    *(pytest.param(one, marks=pytest.mark.slow) for one in (
        {"turn": np.exp(2.1j)}, {"shift": 30 - 7j}, {"mirror": True}))])
def test_a_spline_with_varying_properties_is_invariant(change: dict[str, Any]) -> None:
    """Turned, shifted, scaled, mirrored."""
    def found(**change: Any) -> complex:
        data = scene(**change)
        u = helpers.solved(data.pop("bodies"), "static", **data).u("a@1")
        return complex(*u) / complex(change.get("turn", 1.0)) / change.get("size", 1.0)

    expected = found()
    assert abs(expected) > 0.1
    there = found(**change)
    assert (there.conjugate() if change.get("mirror") else there) == pytest.approx(expected, rel=1e-8)


def test_a_spline_with_a_tendon_is_the_same_from_its_other_end() -> None:
    """Reversed: the section's y axis points the other way."""
    def tip(points: list[list[float]], y: float, root: int) -> Any:
        return helpers.solved({"a": body({"type": "spline", "points": points}, "reissner3", 12)}, "static",
                              bc=[{"type": "clamp", "at": f"a@{root}"}],
                              loads=[{"type": "tendon", "on": "a", "y": y, "tension": 900.0}]).u(f"a@{1 - root}")

    forth = tip(POINTS, 0.03, 0)
    assert np.linalg.norm(forth) > 0.1
    np.testing.assert_allclose(tip(POINTS[::-1], -0.03, 1), forth, rtol=1e-8)


def test_a_tendon_along_welded_halves_equals_one_along_the_whole() -> None:
    whole = helpers.solved({"a": body(PATH, "reissner3", 8)}, "static", bc=[{"type": "clamp", "at": "a@0"}],
                           loads=[{"type": "tendon", "on": "a", "y": 0.03, "tension": 900.0}])
    counts = [p.count for p in whole.model.meshes["a"].plan.pieces]
    c, s = np.cos(0.3), np.sin(0.3)
    line = {"type": "line", "start": [0, 0], "end": [c, s]}
    arc = {"type": "path", "start": [c, s], "heading": 0.3, "pieces": [{"arc": 0.5, "angle": -1.2}]}
    halves = helpers.solved({"a": body(line, "reissner3", counts[0]), "b": body(arc, "reissner3", counts[1])}, "static",
                            bc=[{"type": "clamp", "at": "a@0"}], joints=[{"type": "weld", "between": ["a@1", "b@0"]}],
                            loads=[{"type": "tendon", "on": n, "y": 0.03, "tension": 900.0} for n in "ab"])
    np.testing.assert_allclose(whole.u("a@1"), halves.u("b@1"), rtol=1e-10)


KINKED = {"type": "curve", "x": "2*s if s < 0.5 else 1 + sin(2*s - 1)", "y": "0 if s < 0.5 else 1 - cos(2*s - 1)"}


@pytest.mark.parametrize("kind", ["reissner3", "cable", "li"])
def test_elements_end_where_the_curvature_of_a_curve_jumps(kind: str) -> None:
    """A line and an arc as one curve with a condition are the path of a line and an arc."""
    path = {"type": "path", "start": [0, 0], "pieces": [{"line": 1}, {"arc": 1, "angle": 1}]}
    clamp = [{"type": "clamp", "at": "b@0"}]
    loads = [{"type": "force", "at": "b@1", "value": [0.3, -1.0]}]
    one, other = (helpers.solved({"b": body(geometry, kind, 5)}, "linear_static", bc=clamp, loads=loads).u("b@1")
                  for geometry in (KINKED, path))
    np.testing.assert_allclose(one, other, rtol=1e-9)


@pytest.mark.parametrize(("x", "y", "pieces"), [
    ("s", "abs(s - 0.3)^3", 2),          # the third derivative jumps
    ("s", "abs(s + 1)*s", 1),            # switches nowhere
    ("s if s < 0.4 else s", "s^2", 1),   # switches to the same
    ("s", "0.1*abs(s - 0.5)*(s - 0.5)", 2),
])
def test_a_curve_is_divided_only_where_its_derivatives_jump(x: str, y: str, pieces: int) -> None:
    model = helpers.build({"b": body({"type": "curve", "x": x, "y": y}, "reissner3", 4)}, "linear_static",
                          bc=[{"type": "clamp", "at": "b@0"}])
    assert len(model.meshes["b"].plan.pieces) == pieces


@pytest.mark.parametrize("y", ["abs(s - 0.3)", "0 if s < 0.3 else 1"])
def test_a_curve_with_a_corner_or_a_jump_is_refused(y: str) -> None:
    with pytest.raises(CaseError, match=r"corner.*near s = 0\.3"):
        helpers.build({"b": body({"type": "curve", "x": "s", "y": y}, "reissner3", 4)}, "linear_static",
                      bc=[{"type": "clamp", "at": "b@0"}])
