"""Strain energies compared with their definitions, written with deformation gradients."""

import helpers
import numpy as np
import pytest

from ancf2d.elements.shape import gauss, lobatto
from ancf2d.kernels.elements import force


class Body:
    """One element in its reference and a random configuration, in global axes."""

    def __init__(self, name: str, formulation: str, geometry: str) -> None:
        spec = helpers.element(name, 1, formulation)
        self.model = helpers.build(
            {"b": helpers.body(helpers.GEOMETRIES[geometry], spec)}, bc=[{"type": "clamp", "at": "b@0"}]
        )
        mesh = self.model.meshes["b"]
        self.plan, self.shape = mesh.plan, mesh.classes[0].shape
        nc = self.plan.element.components
        self.d = helpers.random_state(self.model, 0.1 * self.plan.section.height)[: self.model.n_q]
        self.e0 = self.model.e0[mesh.dofs[0]].reshape(-1, nc)
        self.e = self.e0 + self.d[mesh.dofs[0]].reshape(-1, nc)

    def r(self, e, xi: float, eta: float, i: int, j: int):
        return self.shape(np.array([xi]), np.array([eta]), i, j)[0] @ e

    def energy(self) -> float:
        return force(self.model.groups[0], self.d, np.zeros(self.model.n_q))


def green(b: Body, xi: float, eta: float):
    """Return (eps_tt, eps_nn, gamma_tn) and dV/(weights l h b)."""
    J0 = np.stack([b.r(b.e0, xi, eta, 1, 0), b.r(b.e0, xi, eta, 0, 1)], axis=1)
    J = np.stack([b.r(b.e, xi, eta, 1, 0), b.r(b.e, xi, eta, 0, 1)], axis=1)
    F = J @ np.linalg.inv(J0)
    E = 0.5 * (F.T @ F - np.eye(2))
    t = J0[:, 0] / np.linalg.norm(J0[:, 0])
    n = np.array([-t[1], t[0]])
    return np.array([t @ E @ t, n @ E @ n, 2 * t @ E @ n]), np.linalg.det(J0)


def points(rule):
    (x, wx), (y, wy) = gauss(rule[0]), gauss(rule[1])
    return [(a, 2 * c - 1, u * v) for a, u in zip(x, wx, strict=True) for c, v in zip(y, wy, strict=True)]


def matrices(b: Body):
    s = b.plan.section
    c, shear = s.E / (1 - s.nu**2), s.k_s * s.E / (2 * (1 + s.nu))
    return np.array([[c, s.nu * c, 0], [s.nu * c, c, 0], [0, 0, shear]]), np.diag([s.E, s.E, shear])


def volume(b: Body) -> float:
    return b.shape.l * b.plan.section.height * b.plan.section.width


def continuum(b: Body) -> float:
    D, _ = matrices(b)
    total = 0.0
    for xi, eta, w in points(b.plan.rule.normal):
        eps, det = green(b, xi, eta)
        total += 0.5 * w * det * eps @ D @ eps
    return total * volume(b)


def enhanced(b: Body) -> float:
    D, D0 = matrices(b)
    total = 0.0
    for rule, part in ((b.plan.rule.normal, D0), ((b.plan.rule.normal[0], 1), D - D0)):
        for xi, eta, w in points(rule):
            eps, det = green(b, xi, eta)
            total += 0.5 * w * det * eps @ part @ eps
    return total * volume(b)


def strain_split(b: Body) -> float:
    D, D0 = matrices(b)
    total = 0.0
    for xi, eta, w in points(b.plan.rule.normal):
        eps, det = green(b, xi, eta)
        axis, _ = green(b, xi, 0.0)
        rest = eps - axis
        total += 0.5 * w * det * (axis @ D @ axis + axis @ (D + D0) @ rest + rest @ D0 @ rest)
    return total * volume(b)


def cross(a, c) -> float:
    return a[0] * c[1] - a[1] * c[0]


def on_axis(b: Body, xw, strains, stiffness) -> float:
    """Integrate sum of stiffness (strain - reference strain)^2/2 over the axis."""
    total = 0.0
    for xi, w in zip(*xw, strict=True):
        j0 = np.linalg.norm(b.r(b.e0, xi, 0.0, 1, 0)[:2])
        eps = np.array(strains(b.e, xi, j0)) - np.array(strains(b.e0, xi, j0))
        total += 0.5 * w * j0 * b.shape.l * np.array(stiffness) @ eps**2
    return total


def structural(b: Body) -> float:
    s = b.plan.section

    def strains(e, xi, j0):
        r_s, r_y, r_ys = b.r(e, xi, 0, 1, 0) / j0, b.r(e, xi, 0, 0, 1), b.r(e, xi, 0, 1, 1) / j0
        L = np.linalg.norm(r_y)
        return cross(r_s, r_y) / L, r_s @ r_y / L, cross(r_y, r_ys) / L**2

    def stretch(e, xi, j0):
        r_y = b.r(e, xi, 0, 0, 1)
        return (0.5 * r_y @ r_y,)

    terms = 1 + max(t.i for p in b.plan.element.polynomials for t in p.terms if t.j > 0)
    return on_axis(b, gauss(b.plan.rule.normal[0]), strains, (s.EA, s.kGA, s.EI)) + on_axis(
        b, lobatto(terms), stretch, (s.EA,)
    )


def curve(b: Body, xi: float, e):
    """Return r_s and r_ss of the curve in the reference arclength."""
    p, q = b.r(b.e0, xi, 0, 1, 0), b.r(b.e0, xi, 0, 2, 0)
    j0 = np.linalg.norm(p)
    x, xx = b.r(e, xi, 0, 1, 0), b.r(e, xi, 0, 2, 0)
    return x / j0, (xx - x * (p @ q) / j0**2) / j0**2


def stretch_and_curvature(b: Body, strains) -> float:
    """Return the energy with the stretch at Lobatto points, and the curvature at as many Gauss points."""
    n, section = b.plan.rule.normal[0], b.plan.section
    return on_axis(b, lobatto(n), strains, (section.EA, 0.0)) + on_axis(b, gauss(n), strains, (0.0, section.EI))


def cable(b: Body) -> float:
    def strains(e, xi, j0):
        r_s, r_ss = curve(b, xi, e)
        return np.linalg.norm(r_s), cross(r_s, r_ss) / (r_s @ r_s)

    return stretch_and_curvature(b, strains)


def green_cable(b: Body) -> float:
    def strains(e, xi, j0):
        r_s, r_ss = curve(b, xi, e)
        return 0.5 * r_s @ r_s, cross(r_s, r_ss) / np.linalg.norm(r_s) ** 3

    return stretch_and_curvature(b, strains)


def geometrically_exact(b: Body) -> float:
    s = b.plan.section

    def strains(e, xi, j0):
        r_s, theta, slope = b.r(e, xi, 0, 1, 0) / j0, b.r(e, xi, 0, 0, 0)[2], b.r(e, xi, 0, 1, 0)[2] / j0
        c, si = np.cos(theta), np.sin(theta)
        return c * r_s[0] + si * r_s[1], -si * r_s[0] + c * r_s[1], slope

    return on_axis(b, gauss(b.plan.rule.normal[0]), strains, (s.EA, s.kGA, s.EI))


DEFINITIONS = {
    "continuum": continuum,
    "enhanced": enhanced,
    "strain_split": strain_split,
    "structural": structural,
    "cable": cable,
    "green": green_cable,
    "geometrically_exact": geometrically_exact,
}


@helpers.covering({"variant": helpers.FEW_VARIANTS}, variant=helpers.SMALL_VARIANTS, geometry=helpers.GEOMETRIES)
def test_strain_energy_is_its_definition(name, formulation, geometry):
    if formulation not in DEFINITIONS:
        pytest.fail(f"write down what {formulation} is")
    b = Body(name, formulation, geometry)
    assert b.energy() == pytest.approx(DEFINITIONS[formulation](b), rel=1e-11)


@pytest.mark.parametrize("formulation", ["continuum", "enhanced"])
def test_selective_rules_share_the_energy_between_normal_and_shear_points(formulation):
    def energy(quadrature):
        spec = helpers.element("vallejo", 1, formulation, quadrature=quadrature)
        model = helpers.build({"b": helpers.body(helpers.ARC, spec)}, bc=[{"type": "clamp", "at": "b@0"}])
        return force(model.groups[0], helpers.random_state(model, 0.02), np.zeros(model.n_q))

    rules = {(a, b): energy({"normal": list(a), "shear": list(b)}) for a in ((2, 2), (3, 3)) for b in ((2, 2), (3, 3))}
    assert rules[(2, 2), (2, 2)] == pytest.approx(energy([2, 2]), rel=1e-13)
    assert rules[(2, 2), (3, 3)] + rules[(3, 3), (2, 2)] == pytest.approx(energy([2, 2]) + energy([3, 3]), rel=1e-13)
    assert rules[(2, 2), (3, 3)] != pytest.approx(energy([2, 2]), rel=1e-6)


@pytest.mark.parametrize("name", [n for n in helpers.SMALL_TYPES if helpers.TYPES[n].degree_y > 0])
def test_the_exact_rule_integrates_a_straight_element_exactly(name):
    """A rule with more points than the exact one must change nothing; one with fewer points must change the energy."""

    def energy(quadrature):
        spec = helpers.element(name, 1, "continuum", quadrature=quadrature)
        model = helpers.build({"b": helpers.body(helpers.LINE, spec)}, bc=[{"type": "clamp", "at": "b@0"}])
        return force(model.groups[0], helpers.random_state(model, 0.1), np.zeros(model.n_q)), model

    exact, model = energy("exact")
    nx, ny = model.meshes["b"].plan.rule.normal
    assert energy([nx + 2, ny + 2])[0] == pytest.approx(exact, rel=1e-12)
    for fewer in ([nx - 1, ny], [nx, ny - 1]):
        assert energy(fewer)[0] != pytest.approx(exact, rel=1e-12)
