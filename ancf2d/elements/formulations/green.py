"""Continuum formulations in Green-Lagrange strain: full, enhanced and strain split.

They share one strain function and differ in the constant matrix between the sampled strains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..definition import ElementType
from ..section import Section, shear_flow
from ..shape import Array, gauss
from .base import Formulation, Free, Rule, Sampler, StrainLaw, cross, join, of_section, rule_points

# points per layer that integrate the square of its shear stress exactly
POINTS = 6


def strain(ref, u, eps, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the Green-Lagrange strain (eps_tt, eps_nn, 2 eps_tn) from the displacement gradient.

    With a = u_,t and b = u_,n: eps_tt = t.a + a.a/2 and so on. Formulas in displacements keep the digits of the small
    strains of stiff beams.
    """
    for l in range(lanes):
        ax, ay, bx, by = u[0, l], u[1, l], u[2, l], u[3, l]
        tx, ty, nx, ny = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        eps[0, l] = tx * ax + ty * ay + 0.5 * (ax * ax + ay * ay)
        eps[1, l] = nx * bx + ny * by + 0.5 * (bx * bx + by * by)
        eps[2, l] = tx * bx + ty * by + nx * ax + ny * ay + (ax * bx + ay * by)
        fx, fy, gx, gy = tx + ax, ty + ay, nx + bx, ny + by
        J[0, 0, l], J[0, 1, l] = fx, fy
        J[1, 2, l], J[1, 3, l] = gx, gy
        J[2, 0, l], J[2, 1, l] = gx, gy
        J[2, 2, l], J[2, 3, l] = fx, fy


def geometric(ref, u, sigma, J, H, lanes):  # type: ignore[no-untyped-def]
    """Add sigma : d2 eps/du2, constant for Green-Lagrange strain."""
    for l in range(lanes):
        for q in range(2):
            H[q, q, l] += sigma[0, l]
            H[2 + q, 2 + q, l] += sigma[1, l]
            H[q, 2 + q, l] += sigma[2, l]


def mean(ref, u0, u1, eps0, eps1, J, lanes):  # type: ignore[no-untyped-def]
    """Fill the discrete Jacobian between two states: that of mid-configuration, for a quadratic strain (Simo 1992)."""
    for l in range(lanes):
        fx, fy = ref[0, l] + 0.5 * (u0[0, l] + u1[0, l]), ref[1, l] + 0.5 * (u0[1, l] + u1[1, l])
        gx, gy = ref[2, l] + 0.5 * (u0[2, l] + u1[2, l]), ref[3, l] + 0.5 * (u0[3, l] + u1[3, l])
        J[0, 0, l], J[0, 1, l] = fx, fy
        J[1, 2, l], J[1, 3, l] = gx, gy
        J[2, 0, l], J[2, 1, l] = gx, gy
        J[2, 2, l], J[2, 3, l] = fx, fy


def elasticity(section: Section) -> tuple[Array, Array]:
    """Return plane-stress D and D0 = diag(E, E, k_s mu) (..., 3, 3) for (eps_tt, eps_nn, 2 eps_tn).

    physics: lambda = E nu/(1 - nu^2); the shear energy is 2 mu k_s eps_xy^2 = k_s mu gamma^2/2.
    """
    E, nu, G = np.broadcast_arrays(section.E, section.nu, section.mu_k)
    c = E / (1.0 - nu * nu)
    D, D0 = np.zeros((2, *E.shape, 3, 3))
    D[..., 0, 0] = D[..., 1, 1] = c
    D[..., 0, 1] = D[..., 1, 0] = nu * c
    D0[..., 0, 0] = D0[..., 1, 1] = E
    D[..., 2, 2] = D0[..., 2, 2] = G
    return D, D0


def _points(sampler: Sampler, xi: Array, eta: Array) -> tuple[Array, Array, Array]:
    """Return B (points, 4, n_dof), ref (points, 4) and det J0 (points,) at points of an element."""
    Sx, Sy = sampler.derivative(xi, eta, 1, 0), sampler.derivative(xi, eta, 0, 1)
    rx, ry = Sx @ sampler.e0, Sy @ sampler.e0
    det = cross(rx, ry)
    t = rx / np.hypot(rx[:, 0], rx[:, 1])[:, None]
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    # grad s = J0^-T (s_x, s_y); its components along t and n
    st = (Sx * cross(t, ry)[:, None] + Sy * cross(rx, t)[:, None]) / det[:, None]
    sn = (Sx * cross(n, ry)[:, None] + Sy * cross(rx, n)[:, None]) / det[:, None]
    return sampler.vectors(st, sn), np.hstack([t, n]), det


# selects the entries of D without shear
_NORMAL = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])


def _across(section: Section, points: int) -> tuple[Array, Array]:
    """Return eta of Gauss points across a section (this number in each of its layers) and their weights (sum 1)."""
    y, w = gauss(points)
    if not section.layers:
        return 2 * y - 1, w
    thick = [layer.top - layer.bottom for layer in section.layers]
    heights = [layer.bottom + t * y for layer, t in zip(section.layers, thick, strict=True)]
    return np.concatenate(heights) * (2.0 / section.height), np.concatenate([t * w for t in thick]) / section.height


def _rule_points(sampler: Sampler, rule: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return xi, eta and weights (sum 1) of a rule, x slowest; with layers, it has rule[1] points in each of them."""
    if not sampler.section.layers:
        return rule_points(rule)
    (x, wx), (eta, wy) = gauss(rule[0]), _across(sampler.section, rule[1])
    return np.repeat(x, len(eta)), np.tile(eta, len(x)), np.outer(wx, wy).ravel()


def _elasticity_at(sampler: Sampler, xi: Array, eta: Array) -> tuple[Array, Array]:
    """Return D and D0 at points. Layers use nu of the section, because they share one stretch across."""
    section = sampler.at(xi)
    if not section.layers:
        return elasticity(section)
    y = 0.5 * section.height * eta
    k = _shear_share(sampler, apart=False)
    E, G = (section.of_layer(y, value, 0.0) for value in (lambda l: l.E, lambda l: k * l.G))
    return elasticity(replace(section, E=E, kGA=G * section.height * section.width, layers=()))


def _stations(sampler: Sampler, rule: tuple[int, int], choose: Callable[[Array, Array], Array],
              ) -> tuple[Array, Array, Array]:
    """Return (B, ref, D) at the points of a rule, with the stiffness that ``choose`` forms from D and D0."""
    xi, eta, w = _rule_points(sampler, rule)
    B, ref, det = _points(sampler, xi, eta)
    section = sampler.at(xi)
    volume = w * det * sampler.shape.l * section.height * section.width
    return B, ref, volume[:, None, None] * choose(*_elasticity_at(sampler, xi, eta))


def _centroid(section: Section) -> float:
    """Return eta of the centroid of stiffness: 0, or off the axis for layers."""
    return 2.0 * section.ES / (section.EA * section.height) if section.layers else 0.0


def sample_continuum(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample U = 1/2 int eps^T D eps dV; with a selective rule the shear entry has its own points."""
    if sampler.section.layers:
        return sample_layers(sampler, rule)
    if rule.uniform:
        return _stations(sampler, rule.normal, lambda D, D0: D)
    return join(_stations(sampler, rule.normal, lambda D, D0: D * _NORMAL),
                _stations(sampler, rule.shear, lambda D, D0: D - D * _NORMAL))


def sample_enhanced(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample the enhanced form: D0 over the volume, D - D0 on the axis only (with layers, on the line of centroids)."""
    x, w = gauss(rule.normal[0])
    B, ref, det = _points(sampler, x, np.full(len(x), _centroid(sampler.section)))
    section = sampler.at(x)
    D, D0 = elasticity(section)
    axis = B, ref, (w * det * sampler.shape.l * section.height * section.width)[:, None, None] * (D - D0)
    if rule.uniform:
        return join(_stations(sampler, rule.normal, lambda D, D0: D0), axis)
    return join(_stations(sampler, rule.normal, lambda D, D0: D0 * _NORMAL),
                _stations(sampler, rule.shear, lambda D, D0: D0 - D0 * _NORMAL), axis)


def _split_points(sampler: Sampler, rule: Rule) -> tuple[Array, Array]:
    """Return xi and eta of the points at each x; the first of them is on the axis, or at the centroid of layers."""
    x, (eta, _) = gauss(rule.normal[0])[0], _across(sampler.section, rule.normal[1])
    return np.repeat(x, len(eta) + 1), np.tile(np.concatenate([[_centroid(sampler.section)], eta]), len(x))


def sample_strain_split(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample the strain split: U = 1/2 int (e^T D0 e + e_c^T (D - D0) e) dV, e_c the strain on the axis.

    This energy gives the symmetric part of Patel & Shabana's stress. The points at one x form one station.
    """
    nx, wx, wy = rule.normal[0], gauss(rule.normal[0])[1], _across(sampler.section, rule.normal[1])[1]
    ny = len(wy)
    xi, eta = _split_points(sampler, rule)
    B, ref, det = _points(sampler, xi, eta)
    section = sampler.at(xi)
    D, D0 = (np.broadcast_to(m, (len(xi), 3, 3)).reshape(nx, ny + 1, 3, 3) for m in _elasticity_at(sampler, xi, eta))
    volume = np.outer(wx, np.concatenate([[0.0], wy])).ravel() * det
    volume = (volume * sampler.shape.l * section.height * section.width).reshape(nx, ny + 1)
    n_dof = B.shape[-1]
    DD = np.zeros((nx, 3 * (ny + 1), 3 * (ny + 1)))
    for i in range(nx):
        for p in range(1, ny + 1):
            block = slice(3 * p, 3 * p + 3)
            DD[i, block, block] = volume[i, p] * D0[i, p]
            DD[i, :3, block] = DD[i, block, :3] = 0.5 * volume[i, p] * (D - D0)[i, p]
    return B.reshape(nx, 4 * (ny + 1), n_dof), ref.reshape(nx, 4 * (ny + 1)), DD


def natural_at(sampler: Sampler, free: Free, xi: Array, eta: Array, even: bool = False) -> Array:
    """Return the natural strains (n, 3) along and across, without shear, of points of an element without stress.

    Fibres on the inner side of a curved reference are shorter, so the same curvature strains them more. Temperature
    causes the same strain in all directions as far as the section allows: its gradient needs an independent y^2, and
    sections with y^2 coupled to x^2 stretch across as they bend. With ``even``, all layers have the same strain across.
    """
    axial, curvature, value, gradient = free(xi)
    section, element = sampler.at(xi), sampler.shape.element
    y = 0.5 * section.height * eta
    alpha = section.of_layer(y, lambda layer: layer.alpha, section.alpha)
    along = (axial - curvature * y) * _fibres(sampler, xi, eta) + alpha * (value + gradient * y)
    alpha = section.alpha if even or element.common_coefficients else alpha
    across = alpha * value
    if element.common_coefficients:
        across = across + _tied(sampler) * section.free(axial, curvature, value, gradient)[1] * y
    elif element.degree_y > 1:
        across = across + alpha * gradient * y
    return np.stack([along, across, np.zeros_like(along)], axis=1)


def _fibres(sampler: Sampler, xi: Array, eta: Array) -> Array:
    """Return the length of the axis divided by that of the fibre at points of a curved reference (n,)."""
    length, axis = (np.linalg.norm(sampler.derivative(xi, at, 1, 0) @ sampler.e0[:, :2], axis=1)
                    for at in (eta, 0.0 * eta))
    shares: Array = axis / length
    return shares


def natural_on_axis(sampler: Sampler, free: Free, xi: Array) -> Array:
    """Return the natural strains (n, 3) on the axis; with layers, on the line of centroids, with the free strain of the
    whole section."""
    eta = np.full(len(xi), _centroid(sampler.section))
    out = natural_at(sampler, free, xi, eta, even=True)
    if sampler.section.layers:
        axial, curvature, _ = of_section(sampler, free, xi)
        out[:, 0] = (axial - 0.5 * sampler.section.height * eta * curvature) * _fibres(sampler, xi, eta)
    return out


def _tied(sampler: Sampler) -> float:
    """Return the factor of y^2 relative to that of x^2 in the basis function that has both, or 0 if there is none."""
    for p in sampler.shape.element.polynomials:
        factors = {(t.i, t.j): t.coefficient * sampler.section.nu**t.nu for t in p.terms}
        if {(2, 0), (0, 2)} <= set(factors):
            return factors[0, 2] / factors[2, 0]
    return 0.0


def _jumps(sampler: Sampler, eta: Array, w: Array) -> Array:
    """Return strain modes (points, m) that jump between layers and that no section of the type can follow.

    In each layer they are polynomials of the same degree as the type's strain across, less polynomials over the whole
    section. Adjacent layers with the same stiffness and expansion count as one layer.
    """
    layers, degree = sampler.section.layers, sampler.shape.element.degree_y - 1
    kinds = np.cumsum([k > 0 and (l.E, l.nu, l.alpha) != (m.E, m.nu, m.alpha)
                       for k, (l, m) in enumerate(zip(layers, (layers[0], *layers), strict=False))])
    own = np.repeat(kinds, len(eta) // len(layers))
    powers = np.stack([eta**k for k in range(degree + 1)], axis=1)
    parts = np.concatenate([powers * (own == kind)[:, None] for kind in range(own.max() + 1)], axis=1)
    root = np.sqrt(w)[:, None]
    whole, _ = np.linalg.qr(root * powers)
    left = root * parts
    left = left - whole @ (whole.T @ left)
    return np.linalg.svd(left, full_matrices=False)[0][:, :own.max() * (degree + 1)] / root


def _shear_share(sampler: Sampler, apart: bool) -> float:
    """Return the factor k for which layers with shear moduli k G have the stiffness kGA in a section of the type.

    Equilibrium requires tau(y). The section's shear strain is the polynomial in y that does the same work; if layers
    strain independently (``apart``), the shear stress is this polynomial.
    """
    section, degree = sampler.section, sampler.shape.element.degree_y
    eta, w = _across(section, POINTS)
    y, w = 0.5 * section.height * eta, w * section.height * section.width
    tau = shear_flow(section.layers, (section.EA, section.ES, section.EI), y)
    G = section.of_layer(y, lambda l: l.G, 0.0)
    powers = eta[:, None] ** np.arange(degree)
    weight = w if apart else w * G
    share = powers @ np.linalg.solve(powers.T @ (weight[:, None] * powers), powers.T @ (w * tau))
    return section.kGA * float(w @ (share**2 / G if apart else share**2 * G))


def sample_layers(sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
    """Sample a section of layers; all points at one x form one station.

    Across the section, each layer stretches and shears according to its own stiffness, which polynomials over the whole
    section cannot: strain modes that jump at the interfaces (``_jumps``) are added and eliminated by their own
    equilibrium (enhanced assumed strains; Simo & Rifai 1990). Their mean over the section is zero.
    """
    nx, section = rule.normal[0], sampler.section
    xi, eta, w = _rule_points(sampler, rule.normal)
    B, ref, det = _points(sampler, xi, eta)
    P, y = len(xi) // nx, 0.5 * section.height * eta
    E, nu, G = (section.of_layer(y, value, 0.0) for value in (lambda l: l.E, lambda l: l.nu, lambda l: l.G))
    volume = (w * det * sampler.shape.l * section.height * sampler.at(xi).width).reshape(nx, P)
    D = np.zeros((len(xi), 3, 3))
    D[:, 0, 0] = D[:, 1, 1] = E / (1.0 - nu**2)
    D[:, 0, 1] = D[:, 1, 0] = nu * D[:, 0, 0]
    D[:, 2, 2] = _shear_share(sampler, apart=True) * G
    stiffness = (volume.reshape(-1, 1, 1) * D).reshape(nx, P, 3, 3)
    out = np.zeros((nx, 3 * P, 3 * P))
    modes = _jumps(sampler, eta[:P], w[:P])
    for i in range(nx):
        for p in range(P):
            out[i, 3 * p:3 * p + 3, 3 * p:3 * p + 3] = stiffness[i, p]
        free = np.zeros((3 * P, 2 * modes.shape[1]))
        free[1::3, :modes.shape[1]] = free[2::3, modes.shape[1]:] = modes
        K = out[i] @ free
        out[i] -= K @ np.linalg.solve(free.T @ K, K.T) if modes.shape[1] else 0.0
    return B.reshape(nx, 4 * P, -1), ref.reshape(nx, 4 * P), 0.5 * (out + out.transpose(0, 2, 1))


def natural_continuum(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural strains at the points of the rule, or of both rules if it is selective."""
    found = _natural_over(sampler, rule, free, even=False)
    # all layers at one x form one station
    return found.reshape(rule.normal[0], -1) if sampler.section.layers else found


def _natural_over(sampler: Sampler, rule: Rule, free: Free, even: bool) -> Array:
    rules = (rule.normal,) if rule.uniform else (rule.normal, rule.shear)
    return np.concatenate([natural_at(sampler, free, *_rule_points(sampler, r)[:2], even) for r in rules])


def natural_enhanced(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural strains of the points in the volume, then of those on the axis."""
    axis = natural_on_axis(sampler, free, gauss(rule.normal[0])[0])
    return np.concatenate([_natural_over(sampler, rule, free, even=True), axis])


def natural_strain_split(sampler: Sampler, rule: Rule, free: Free) -> Array:
    """Return the natural strains at each x, the point on the axis first."""
    xi, eta = _split_points(sampler, rule)
    nx = rule.normal[0]
    found = natural_at(sampler, free, xi, eta, even=True).reshape(nx, -1, 3)
    found[:, 0] = natural_on_axis(sampler, free, xi.reshape(nx, -1)[:, 0])
    return found.reshape(nx, -1)


def _stress(strain: Array, axis: Array, D: Array, D0: Array) -> tuple[Array, Array]:
    stress = strain @ D
    return stress, 0.5 * np.sum(strain * stress, axis=-1)


def _enhanced_stress(strain: Array, axis: Array, D: Array, D0: Array) -> tuple[Array, Array]:
    fibre, coupling = strain @ D0, axis @ (D - D0)
    return fibre + coupling, 0.5 * (np.sum(strain * fibre, axis=-1) + np.sum(axis * coupling, axis=-1))


def _split_stress(strain: Array, axis: Array, D: Array, D0: Array) -> tuple[Array, Array]:
    stress = strain @ D0 + axis @ (D - D0)
    return stress, 0.5 * np.sum(strain * stress, axis=-1)


def _needs_body(element: ElementType) -> str | None:
    if element.has_theta or element.degree_y == 0:
        return f"{element.name} is a curve, without a section to integrate stresses over"
    return None


def _refuse_split(element: ElementType) -> str | None:
    if element.common_coefficients:
        return (f"the y^2 of {element.name} is coupled to x^2: without Poisson coupling over the section it would add "
                "the bending stiffness twice")
    if element.degree_y > 2:
        return (f"the section of {element.name} stretches unevenly (y^3): Poisson coupling with the strain of the axis "
                "alone would give wrong results in simple tension")
    return _needs_body(element)


def _default_rule(element: ElementType) -> tuple[int, int]:
    """Return one point along per power of x: the fewest without hidden zero-energy modes.

    Among linear elements, only one with straight sections can use a single point.
    """
    along = 2 if element.degree_x == 1 and element.degree_y > 1 else element.degree_x
    return along, element.degree_y + 1


def _exact(element: ElementType) -> tuple[int, int]:
    """Return the rule that integrates the quartic energy of a straight element exactly."""
    terms = [t for p in element.polynomials for t in p.terms]
    dx = max([t.i - 1 for t in terms if t.i > 0] + [t.i for t in terms if t.j > 0])
    dy = max([t.j for t in terms if t.i > 0] + [t.j - 1 for t in terms if t.j > 0])
    return 2 * dx + 1, 2 * dy + 1


# fields: u_,t and u_,n, x and y each; reference values: t and n
GREEN = StrainLaw(4, 3, 4, strain, geometric, mean, (0, 1))

FORMULATIONS = tuple(
    Formulation(name, GREEN, refuse, _default_rule, _exact, sample, source, doc,
                selective=name != "strain_split", stress=stress, natural=natural, points=sample is sample_continuum,
                green=True)
    for name, refuse, sample, natural, stress, source, doc in (
        ("continuum", _needs_body, sample_continuum, natural_continuum, _stress, "Omar & Shabana 2001",
         "Green-Lagrange strain, plane stress over the whole section"),
        ("enhanced", _refuse_split, sample_enhanced, natural_enhanced, _enhanced_stress,
         "Sopanen & Mikkola 2003; Gerstmayr, Matikainen & Mikkola 2008",
         "D0 = diag(E, E, k_s mu) over the volume, the Poisson coupling on the axis only"),
        ("strain_split", _refuse_split, sample_strain_split, natural_strain_split, _split_stress,
         "Patel & Shabana 2018",
         "Poisson coupling with the axis strain only; symmetric part of the split stress"),
    ))
