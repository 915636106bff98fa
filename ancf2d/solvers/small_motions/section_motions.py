"""Motions of cross-sections in a velocity field: mean motion along and across the beam, rotation, stretch, the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...elements.definition import ElementType
from ...elements.formulations import Sampler
from ...elements.formulations.base import cross
from ...elements.section import Section
from ...elements.shape import Array, gauss
from ...model.classes import mass_matrix
from ...model.mesh import BodyMesh

# the motions of a straight section, in the order of all arrays here
MOTIONS = ("axial", "transverse", "rotation", "stretch")
BLOCK = 8192


@dataclass(frozen=True)
class ClassMotions:
    """Section motions of the elements of one class, at Gauss stations along the element.

    ``rows`` (4, nx, n_dof): mean velocity along the reference tangent and along its normal, angular velocity and rate
    of stretch, for a velocity in the element's frame; ``inertia`` (4, nx): the corresponding mass or moment of inertia,
    quadrature weight included, so that the kinetic energy of the section motions is sum inertia (rows v)^2/2; ``field``
    (nx, ny, n_shape): shape functions over the sections, ``dm`` (nx, ny): the corresponding mass. ``mass`` (n_dof,
    n_dof): the full mass matrix. ``ends`` (2, ny, n_shape): shape functions over the first and the last section,
    ``end_weight`` (ny,): mass per length of the last; ``conforming``: whether neighbours share these sections.
    """

    xi: Array
    rows: Array
    inertia: Array
    field: Array
    dm: Array
    mass: Array
    ends: Array
    end_weight: Array
    conforming: bool


def class_motions(sampler: Sampler) -> ClassMotions:
    """Return the section motions of an element class.

    Least squares of the velocity over each section, weighted with rho dV: v_t ~ a - omega (y - y_0), v_n ~ w + s (y -
    y_0) with y_0 the centre of mass, so that the four are orthogonal; the remainder is the rest.
    """
    if not sampler.section.rhoA:
        # buckling shapes of bodies without density are classified by volume
        light = sampler
        sampler = replace(light, section=_of_unit_density(light.section),
                          profile=light.profile and (lambda xi: _of_unit_density(light.at(xi))))
    element = sampler.shape.element
    x, wx = gauss(element.degree_x + 2)
    ny = element.degree_y + 2
    y, wy = gauss(ny) if element.degree_y else (np.array([0.5]), np.ones(1))
    xi, eta = np.repeat(x, len(y)), np.tile(2 * y - 1, len(x))
    axis = sampler.derivative(x, np.zeros_like(x), 1, 0) @ sampler.e0[:, :2]
    j0 = np.hypot(axis[:, 0], axis[:, 1])
    t = axis / j0[:, None]
    n = np.stack([-t[:, 1], t[:, 0]], axis=1)
    S = sampler.derivative(xi, eta, 0, 0)
    if element.degree_y:
        rx, ry = (sampler.derivative(xi, eta, i, j) @ sampler.e0 for i, j in ((1, 0), (0, 1)))
        density = cross(rx, ry)
    else:
        density = j0
    section = sampler.at(x)
    dm = sampler.shape.l * (np.outer(wx * section.rhoA, wy) * density.reshape(len(x), -1))
    height = 0.5 * np.multiply.outer(np.broadcast_to(section.height, len(x)), 2 * y - 1)
    S = S.reshape(len(x), len(y), -1)
    m = dm.sum(axis=1)
    arm = height - ((dm * height).sum(axis=1) / m)[:, None]
    rows = np.zeros((4, len(x), element.n_dof))
    inertia = np.array([m, m, np.zeros_like(m), np.zeros_like(m)])
    mean = np.einsum("ij,ijk->ik", dm / m[:, None], S)
    nc = element.components
    for c in (0, 1):
        rows[0, :, c::nc], rows[1, :, c::nc] = mean * t[:, c, None], mean * n[:, c, None]
    if element.degree_y:
        I = np.einsum("ij,ij->i", dm, arm**2)
        slope = np.einsum("ij,ijk->ik", dm * arm / I[:, None], S)
        inertia[2:] = I
        for c in (0, 1):
            rows[2, :, c::nc], rows[3, :, c::nc] = -slope * t[:, c, None], slope * n[:, c, None]
    elif element.has_theta:
        inertia[2] = section.rhoI / section.rhoA * m
        rows[2, :, 2::nc] = mean
    ends = np.array([sampler.derivative(np.full(len(y), s), 2 * y - 1, 0, 0) for s in (0.0, 1.0)])
    return ClassMotions(x, rows, inertia, S, dm, mass_matrix(sampler), ends, sampler.at(np.ones(1)).rhoA * wy,
                        _conforms(ends, element))


def _of_unit_density(section: Section) -> Section:
    area = section.height * section.width
    return replace(section, rhoA=area, rhoI=area * section.EI / section.EA)


def _conforms(ends: Array, element: ElementType) -> bool:
    """Return whether the coordinates of the shared node alone determine the end section, equally from both sides."""
    names = [k for k, (node, _) in enumerate(element.functionals) if node == 0]
    first, last = ends[0][:, names], ends[1][:, -len(names):]
    foreign = [np.delete(ends[0], names, axis=1), ends[1][:, :-len(names)]]
    size = 1e-9 * np.abs(ends).max()
    alone = all(np.abs(f).max(initial=0.0) <= size for f in foreign)
    return bool(alone and np.allclose(first, last, rtol=0, atol=size))


def element_velocities(mesh: BodyMesh, v: Array, elements: slice = slice(None)) -> Array:
    """Return the coordinates (..., ne, n_dof) of velocities (..., n_q) of each element, in the element's frame."""
    out = v[..., mesh.dofs[elements]]
    turn = mesh.turn[elements] if len(mesh.turn) > 1 else mesh.turn
    c, s = turn[:, :1], turn[:, 1:]
    nc = mesh.plan.element.components
    x, y = out[..., 0::nc].copy(), out[..., 1::nc].copy()
    out[..., 0::nc], out[..., 1::nc] = c * x + s * y, c * y - s * x
    return out


@dataclass
class Energies:
    """Twice the kinetic energies of m velocity fields of a body, by their parts.

    ``motions`` (m, 4) as in MOTIONS; ``total`` (m,) of the body; ``gaps`` (m,): energy of the gaps between neighbours;
    ``gradient`` (m, 4): sum of inertia times the square of each motion's derivative along the axis.
    """

    motions: Array
    total: Array
    gaps: Array
    gradient: Array


def _gaps(mesh: BodyMesh, classes: list[ClassMotions], V: Array) -> Array:
    """Return int rho |half the jump|^2 dA l (m,), summed over the places where elements share a node."""
    element, total = mesh.plan.element, np.zeros(len(V))
    if classes[0].conforming:
        return total
    local = V[:, mesh.dofs].reshape(len(V), len(mesh.dofs), element.n_shape, -1)
    second = np.flatnonzero(mesh.shares_start)
    meeting = np.stack([mesh.cls[second - 1], mesh.cls[second]], axis=1)
    for i, k in np.unique(meeting, axis=0).tolist():
        here = second[np.all(meeting == [i, k], axis=1)]
        a, b = classes[i], classes[k]
        l = 0.5 * (mesh.classes[i].shape.l + mesh.classes[k].shape.l)
        jump = a.ends[1] @ local[:, here - 1] - b.ends[0] @ local[:, here]
        total += l * 0.25 * np.einsum("meyc,y->m", jump**2, a.end_weight)
    return total


def energies(mesh: BodyMesh, classes: list[ClassMotions], V: Array) -> Energies:
    """Return the kinetic energies of velocities V (m, n_q) of one body."""
    m, n_dof = len(V), mesh.dofs.shape[1]
    parts, gradient, total = np.zeros((m, 4)), np.zeros((m, 4)), np.zeros(m)
    rows, inertia, mass = (np.array([getattr(c, name) for c in classes]) for name in ("rows", "inertia", "mass"))
    by_length = differentiation(classes[0].xi) / np.array([c.shape.l for c in mesh.classes])[:, None, None, None]
    size = max(1, BLOCK // max(m, 1))
    for first in range(0, mesh.plan.count, size):
        block = slice(first, first + size)
        cls = mesh.cls[block]
        local = element_velocities(mesh, V, block).transpose(1, 2, 0)
        a = (rows.reshape(len(rows), -1, n_dof)[cls] @ local).reshape(len(cls), *rows.shape[1:3], m)
        slopes = by_length[cls] @ a
        parts += np.einsum("epxm,epx->mp", a**2, inertia[cls])
        gradient += np.einsum("epxm,epx->mp", slopes**2, inertia[cls])
        total += np.einsum("eam,eam->m", local, mass[cls] @ local)
    return Energies(parts, np.maximum(total, parts.sum(axis=1)), _gaps(mesh, classes, V), gradient)


def differentiation(x: Array) -> Array:
    """Return the matrix (n, n) that differentiates the polynomial through values at x (n,)."""
    powers = np.arange(len(x))
    D = np.where(powers > 0, powers * x[:, None] ** np.maximum(powers - 1, 0), 0.0)
    return D @ np.linalg.inv(x[:, None] ** powers)


def interpolation(x: Array, at: Array) -> Array:
    """Return the matrix (m, n) that evaluates at ``at`` (m,) the polynomial through values at x (n,)."""
    powers = np.arange(len(x))
    return (at[:, None] ** powers) @ np.linalg.inv(x[:, None] ** powers)
