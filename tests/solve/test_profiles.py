"""Sections, materials and line loads that vary along a body, compared with quadrature, accurate solutions and welds."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest
from helpers import section_forces
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import Legendre
from scipy.linalg import eigh

from ancf2d.case import ProfileTable
from ancf2d.elements.section import timoshenko
from ancf2d.results.geometry import body_faces
from ancf2d.solvers.linear import full_mass
from ancf2d.solvers.section_forces import SectionForces
from ancf2d.solvers.stress import stress_of
from ancf2d.study.run import body_record

L, H, B = 2.0, 0.1, 0.1
E, NU, RHO = 2.07e11, 0.3, 7850.0
CLAMP = [{"name": "wall", "type": "clamp", "at": "b@0"}]
BEAMS = [({"type": "reissner3"}, True), ({"type": "cable"}, False), ({"type": "vallejo"}, True)]
TYPES = [{"type": "reissner2"}, {"type": "reissner3"}, {"type": "cable"}, {"type": "vallejo"}, {"type": "2d2n"},
         {"type": "ancf", "order": [3, 3], "formulation": "continuum"},
         {"type": "patel", "formulation": "strain_split"}]
SHAPES = [(c, both) for c in (0.8, 0.6, 0.3) for both in (False, True)]


def taper(c: float, both: bool) -> dict[str, Any]:
    """Return a section whose height, or height and width, tapers to c times that of the root."""
    return {"height": f"{H}*(1 - {1 - c}*s)", "width": f"{B}*(1 - {1 - c}*s)" if both else B}


def constants(c: float, both: bool) -> Any:
    """Return EI, GA k_s, rhoA and rhoI as functions of s."""
    def of(s: np.ndarray) -> tuple[np.ndarray, ...]:
        h, b = H * (1 - (1 - c) * s), B * (1 - (1 - c) * s) if both else B + 0 * s
        G = E / (2 * (1 + NU))
        return E * b * h**3 / 12, timoshenko(NU) * G * b * h, RHO * b * h, RHO * b * h**3 / 12
    return of


def beam(section: dict[str, Any], spec: dict[str, Any], count: int, **scene: Any) -> Any:
    body = {"geometry": helpers.line(L), "section": section, "material": {"E": E, "nu": NU, "rho": RHO},
            "element": {**spec, "count": count}}
    return helpers.solved({"b": body}, bc=CLAMP, **scene)


def gauss(n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(n)
    return (1 + x) / 2, w / 2 * L


def ritz(c: float, both: bool, shears: bool, n: int = 14) -> np.ndarray:
    """Return the frequencies of the cantilever [rad/s] by polynomials of degree n, more accurate than necessary."""
    s, w = gauss()
    EI, kGA, rhoA, rhoI = constants(c, both)(s)
    p = [(Polynomial([0, 1]) if shears else Polynomial([0, 0, 1])) * Legendre.basis(k)(Polynomial([-1, 2]))
         for k in range(n)]
    f, f1, f2 = (np.array([q.deriv(k)(s) / L**k if k else q(s) for q in p]) for k in (0, 1, 2))
    if not shears:
        return np.sqrt(eigh((f2 * w * EI) @ f2.T, (f * w * rhoA) @ f.T, eigvals_only=True))
    O = np.zeros_like(f)
    bent, slid = np.vstack([O, f1]), np.vstack([f1, -f])
    moved, turned = np.vstack([f, O]), np.vstack([O, f])
    return np.sqrt(eigh((bent * w * EI) @ bent.T + (slid * w * kGA) @ slid.T,
                        (moved * w * rhoA) @ moved.T + (turned * w * rhoI) @ turned.T, eigvals_only=True))


@pytest.mark.parametrize(("c", "both"), SHAPES)
@pytest.mark.parametrize(("spec", "shears"), BEAMS)
def test_a_tapered_cantilever_bends_as_in_beam_theory(spec, shears, c, both):
    found = beam(taper(c, both), spec, 16, solver="linear_static",
                 loads=[{"type": "force", "at": "b@1", "value": [0, -100.0]}])
    s, w = gauss()
    EI, kGA, *_ = constants(c, both)(s)
    exact = -100.0 * (w @ ((L * (1 - s)) ** 2 / EI) + (w @ (1 / kGA) if shears else 0.0))
    assert found.u("b@1")[1] == pytest.approx(exact, rel=1e-4)


def test_the_error_of_a_taper_falls_with_the_fourth_power_of_the_mesh():
    """Gauss points of the default rules suffice: the order is that of a constant section."""
    s, w = gauss()
    exact = -100.0 * (w @ ((L * (1 - s)) ** 2 / constants(0.3, False)(s)[0]))
    errors = [abs(beam(taper(0.3, False), {"type": "cable"}, n, solver="linear_static", loads=[
        {"type": "force", "at": "b@1", "value": [0, -100.0]}]).u("b@1")[1] / exact - 1) for n in (8, 16, 32)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(4.0, abs=0.3)


@pytest.mark.parametrize(("c", "both"), helpers.chosen(SHAPES, [(0.6, False), (0.3, True)]))
@pytest.mark.parametrize(("spec", "shears"), BEAMS)
def test_a_tapered_cantilever_vibrates_as_in_beam_theory(spec, shears, c, both):
    found = beam(taper(c, both), spec, 20, solver={"type": "eigen", "modes": 3})
    omega = [f["omega"] for f in found.state.report["frequencies"] if f["kind"] == "bending"]
    np.testing.assert_allclose(omega, ritz(c, both, shears)[:3], rtol=1e-4)


def welded(spec: dict[str, Any], at: float, thin: float, solver: Any, **scene: Any) -> tuple[Any, Any]:
    """Return a cantilever with a step of its height at S = ``at``, as one body and as two welded bodies."""
    material = {"E": E, "nu": NU, "rho": RHO}
    step = {"height": {"s": [0, at, at, 1], "value": [H, H, thin, thin]}, "width": B}
    one = {"b": {"geometry": helpers.line(L), "section": step, "material": material, "element": {**spec, "count": 5}}}
    two = {"b": {"geometry": helpers.line(at * L), "section": {"height": H, "width": B}, "material": material,
                 "element": {**spec, "count": 2}},
           "c": {"geometry": helpers.line(L - at * L, start=(at * L, 0.0)), "section": {"height": thin, "width": B},
                 "material": material, "element": {**spec, "count": 3}}}
    found = [helpers.solved(bodies, solver, bc=CLAMP, **more, **{
        key: [{**item, "at": item["at"].replace("TIP", tip)} if "at" in item else item for item in items]
        for key, items in scene.items()})
        for bodies, tip, more in ((one, "b@1", {}), (two, "c@1", {"joints": [{"type": "weld", "between": [
            "b@1", "c@0"]}]}))]
    return found[0], found[1]


@pytest.mark.parametrize("spec", TYPES)
def test_a_step_between_nodes_is_two_welded_bodies(spec):
    one, two = welded(spec, 0.37, 0.06, {"type": "static", "steps": 2, "tolerance": 1e-11},
                      loads=[{"type": "force", "at": "TIP", "value": [1e4, -3e4]}, {"type": "gravity",
                                                                                  "value": [0, -9.81]}])
    assert one.model.meshes["b"].plan.count == 5
    np.testing.assert_allclose(one.u("b@1"), two.u("c@1"), rtol=1e-10)
    assert one.theta("b@1") == pytest.approx(two.theta("c@1"), rel=1e-10)


def test_a_step_is_no_hinge_of_sections_that_warp():
    """Free to warp at the step, sections of third degree would make the beam 11 % too soft."""
    step = {"height": {"s": [0, 0.37, 0.37, 1], "value": [H, H, H / 2, H / 2]}, "width": B}
    load = {"type": "force", "at": "b@1", "value": [0, -1000.0]}
    exact = beam(step, {"type": "reissner3"}, 10, solver="linear_static", loads=[load]).u("b@1")[1]
    found = beam(step, {"type": "ancf", "order": [3, 3], "formulation": "continuum"}, 10, solver="linear_static",
                 loads=[{**load, "spread": "uniform"}]).u("b@1")[1]
    assert found == pytest.approx(exact, rel=0.02)


def test_uniform_stretches_of_a_stepped_body_have_one_class_each():
    body = {"geometry": helpers.line(L), "section": {"height": {"s": [0, 0.5, 0.5, 1], "value": [H, H, 0.05, 0.05]},
                                                     "width": B}, "material": {"E": E, "nu": NU},
            "element": {"type": "reissner3", "count": 20}}
    assert len(helpers.build({"b": body}, bc=CLAMP).meshes["b"].classes) == 2
    body["section"] = {"height": H, "width": B}
    assert len(helpers.build({"b": body}, bc=CLAMP).meshes["b"].classes) == 1


@pytest.mark.parametrize("refine", [1, 2, 3])
def test_kinks_and_jumps_are_nodes_of_every_mesh(refine):
    body = {"geometry": helpers.line(L), "section": {"height": {"s": [0, 0.31, 1], "value": [H, 0.05, H]},
                                                     "width": "0.1 if s < 0.77 else 0.05"},
            "material": {"E": E, "nu": NU}, "element": {"type": "reissner3", "count": 4, "refine": refine}}
    mesh = helpers.build({"b": body}, bc=CLAMP, loads=[
        {"type": "distributed", "on": "b", "value": [0, {"s": [0.2, 0.5, 0.9], "value": [0, 1, 0]}]}]).meshes["b"]
    starts = mesh.starts / L
    for s in (0.2, 0.31, 0.5, 0.77, 0.9):
        assert np.abs(starts - s).min() < 1e-12


# of the tip of a column that is clamped below, P l^2/(E I_below), by I_above/I_below: Timoshenko & Gere, Theory of
# Elastic Stability, 1961, table 2-10 (of Dinnik): I grows with the square and the fourth power of the distance
COLUMNS = [(2, 0.1, 1.350), (2, 0.4, 1.904), (2, 0.8, 2.311), (4, 0.1, 1.202), (4, 0.4, 1.870), (4, 0.8, 2.308)]


@pytest.mark.parametrize(("power", "ratio", "published"), COLUMNS)
def test_a_tapered_column_buckles_at_the_published_load(power, ratio, published):
    c = ratio ** (1 / power)
    section = {"EA": 1e9, "EI": f"(1 - {1 - c}*s)^{power}"}
    found = helpers.solved({"b": {"geometry": helpers.line(1.0), "section": section,
                                  "element": {"type": "cable", "count": 16}}}, {"type": "buckling", "modes": 1},
                           bc=CLAMP, loads=[{"type": "force", "at": "b@1", "value": [-1, 0]}])
    factor = found.state.report["load_factors"][0]
    s, w = gauss()
    w = w / L
    p = [Polynomial([0, 0, 1]) * Legendre.basis(k)(Polynomial([-1, 2])) for k in range(12)]
    f1, f2 = (np.array([q.deriv(k)(s) for q in p]) for k in (1, 2))
    own = eigh((f2 * w * (1 - (1 - c) * s) ** power) @ f2.T, (f1 * w) @ f1.T, eigvals_only=True)[0]
    assert factor == pytest.approx(own, rel=1e-4)
    assert factor == pytest.approx(published, abs=1.5e-3)


def test_a_varying_line_load_bends_by_its_integral():
    """A triangle from the root, and a load with a jump like two constant ones."""
    EI = E * B * H**3 / 12
    found = beam({"height": H, "width": B}, {"type": "cable"}, 8, solver="linear_static", loads=[
        {"type": "distributed", "on": "b", "value": [0, "-100*(1 - s)"]}])
    assert found.u("b@1")[1] == pytest.approx(-100 * L**4 / (30 * EI), rel=1e-12)
    _, Q, M = section_forces(found.model, found.state, found.point("b@0.55"))
    assert pytest.approx((-100 * 0.45**2 * L / 2, -100 * 0.45**3 * L**2 / 6), rel=1e-9) == (Q, M)
    jump = {"s": [0, 0.3, 0.3, 1], "value": [-10, -10, 20, 20]}
    one, two = (beam({"height": H, "width": B}, {"type": "reissner3"}, 8, solver="linear_static", loads=loads)
                for loads in ([{"type": "distributed", "on": "b", "value": [0, jump]}],
                              [{"type": "distributed", "on": "b", "value": [0, -10], "to": 0.3},
                               {"type": "distributed", "on": "b", "value": [0, 20], "from": 0.3}]))
    np.testing.assert_allclose(one.u("b@1"), two.u("b@1"), rtol=1e-12)


@pytest.mark.parametrize("spec", [{"type": "reissner3"}, {"type": "vallejo"}, {"type": "ancf", "order": [3, 2]}])
def test_weight_centre_and_stress_follow_the_section(spec):
    """Reactions to gravity are the mass and its moment; stress at the upper face is M/W of that section."""
    g = 9.81
    found = beam(taper(0.5, True), spec, 12, solver="linear_static", loads=[{"type": "gravity", "value": [0, -g]}])
    s, w = gauss()
    rhoA = constants(0.5, True)(s)[2]
    wall = found.reactions()["wall"]
    assert wall["fy"] == pytest.approx(w @ rhoA * g, rel=1e-9)
    assert wall["m"] == pytest.approx((w * rhoA) @ (s * L) * g, rel=1e-9)
    xi, eta = np.linspace(0.0, 1.0, 5), np.linspace(-1.0, 1.0, 5)
    mesh = found.model.meshes["b"]
    ie, x = 6, 6.5 / 12
    t, v = x + (1 - x) * s, w * (1 - x)
    M = -g * (v * constants(0.5, True)(t)[2]) @ ((t - x) * L)
    h = H * (1 - 0.5 * x)
    expected = -M * h / 2 / (constants(0.5, True)(np.array([x]))[0][0] / E)
    stress = stress_of(found.model, mesh, xi, eta)(found.state).stress
    assert stress[ie, 2, -1, 0] == pytest.approx(expected, rel=2e-3)
    assert stress[ie, 2, 0, 0] == pytest.approx(-expected, rel=2e-3)


@pytest.mark.parametrize("spec", [{"type": "reissner3"}, {"type": "cable"}, {"type": "2d2n"}])
def test_pictures_show_the_true_outline(spec):
    body = {"geometry": helpers.line(L), "section": {"height": {"s": [0, 0.4, 0.4, 1], "value": [0.2, 0.1, 0.05, 0.1]},
                                                     "width": B},
            "material": {"E": E, "nu": NU}, "element": {**spec, "count": 5}}
    model = helpers.build({"b": body}, bc=CLAMP)
    record = body_record(model.meshes["b"])
    record.check(model.n_q)
    faces = body_faces(record, model.e0)
    x = faces["axis"][..., 0] / L
    first = np.arange(len(x))[:, None] < 2
    exact = np.where(first, 0.2 - 0.25 * x, 0.05 + 0.05 * (x - 0.4) / 0.6)
    np.testing.assert_allclose(faces["top"][..., 1], exact / 2, atol=1e-9)
    np.testing.assert_allclose(faces["bottom"][..., 1], -exact / 2, atol=1e-9)


def test_section_forces_of_a_body_that_varies_in_part_balance_its_weight():
    """Its mass is integrated with more points where it varies."""
    body = {"geometry": helpers.line(L), "material": {"E": E, "nu": NU, "rho": 1000.0},
            "section": {"height": {"s": [0, 0.5, 1], "value": [H, H, 0.5 * H]}, "width": B},
            "element": {"type": "reissner3", "count": 4}}
    found = helpers.solved({"b": body}, "linear_static", bc=CLAMP, loads=[{"type": "gravity", "value": [0, -9.81]}])
    Q = SectionForces(found.model, found.model.meshes["b"], np.array([0.0, 0.5]))(found.state)[:, :, 1].ravel()
    s = np.arange(8) / 8
    behind = np.where(s < 0.5, 0.5 - s + 0.375, (1 - s) * (1 - 0.5 * s))
    np.testing.assert_allclose(Q, -1000.0 * 9.81 * B * H * L * behind, rtol=1e-9)


# 2d2n itself is not symmetric under reversal
@pytest.mark.parametrize("spec", [t for t in TYPES if t["type"] != "2d2n"])
def test_a_reversed_tapered_body_is_the_same(spec):
    """Reversed, and cut into two welded halves."""
    material, loads = {"E": "2e11*(1 + s)", "nu": NU}, [{"type": "force", "at": "b@1", "value": [1e4, -2e4]}]
    body = {"geometry": helpers.line(L), "section": taper(0.5, True), "material": material,
            "element": {**spec, "count": 4}}
    solver = {"type": "static", "steps": 1, "tolerance": 1e-11}
    found = helpers.solved({"b": body}, solver, bc=CLAMP, loads=loads)
    back = {"geometry": {"type": "line", "start": [L, 0], "end": [0, 0]}, "material": {"E": "2e11*(2 - s)", "nu": NU},
            "section": {"height": f"{H}*(0.5 + 0.5*s)", "width": f"{B}*(0.5 + 0.5*s)"}, "element": body["element"]}
    turned = helpers.solved({"b": back}, solver, bc=[{"type": "clamp", "at": "b@1"}],
                            loads=[{**loads[0], "at": "b@0"}])
    np.testing.assert_allclose(turned.u("b@0"), found.u("b@1"), rtol=1e-9)
    halves = {}
    for name, k in (("b", 0), ("c", 1)):
        t = f"({k}+s)/2"
        halves[name] = {"geometry": helpers.line(L / 2, start=(k * L / 2, 0.0)), "element": {**spec, "count": 2},
                        "section": {"height": f"{H}*(1 - 0.5*{t})", "width": f"{B}*(1 - 0.5*{t})"},
                        "material": {"E": f"2e11*(1 + {t})", "nu": NU}}
    both = helpers.solved(halves, solver, bc=CLAMP, loads=[{**loads[0], "at": "c@1"}],
                          joints=[{"type": "weld", "between": ["b@1", "c@0"]}])
    np.testing.assert_allclose(both.u("c@1"), found.u("b@1"), rtol=1e-9)


def test_smooth_tables_are_monotone_and_follow_straight_data():
    straight = ProfileTable((0.0, 0.3, 1.0), (1.0, 0.7, 0.0), True)
    assert [straight.value(s) for s in (0.1, 0.5, 0.9)] == pytest.approx([0.9, 0.5, 0.1])
    steps = ProfileTable((0.0, 0.4, 0.4, 0.7, 1.0), (1.0, 2.0, 5.0, 5.0, 6.0), True)
    assert steps.value(0.4) == 5.0
    assert steps.value(0.4 - 1e-12) == pytest.approx(2.0)
    values = [steps.value(s) for s in np.linspace(0.4, 1.0, 101)]
    assert np.all(np.diff(values) >= -1e-15)


def test_a_rigid_body_has_the_mass_centre_and_inertia_of_its_shape():
    """A wedge with a step: kinetic energies of translations and of a rotation about its end."""
    section = {"height": {"s": [0, 0.3, 0.3, 1], "value": [0.3, 0.2, 0.1, 0.05]}, "width": "0.1*(1 + s^2)"}
    model = helpers.build({"b": {"geometry": helpers.line(L), "section": section, "material": {"rho": RHO},
                                 "element": {"type": "rigid"}}}, {"type": "dynamic", "t_end": 1.0, "dt": 0.1})
    mass = rotary = moment = 0.0
    for a, b in ((0.0, 0.3), (0.3, 1.0)):
        s, w = gauss()
        s, w = a + (b - a) * s, (b - a) * w
        h = 0.3 - s / 3 if b < 1 else 0.1 - 0.05 * (s - 0.3) / 0.7
        width = 0.1 * (1 + s**2)
        mass += w @ (RHO * h * width)
        moment += (w * RHO * h * width) @ (s * L)
        rotary += (w * RHO * h * width) @ ((s * L) ** 2 + h**2 / 12)
    M = full_mass(model)
    moving, turning = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.0, L])
    assert moving @ M @ moving == pytest.approx(mass, rel=1e-12)
    assert moving @ M @ turning == pytest.approx(moment, rel=1e-12)
    assert turning @ M @ turning == pytest.approx(rotary, rel=1e-12)
