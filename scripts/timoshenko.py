"""Exact modes of the simply supported Timoshenko beam, and how much of a computed mode they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ancf2d.elements.section import Section
from ancf2d.elements.shape import Array
from ancf2d.model.mesh import BodyMesh
from ancf2d.solvers.small_motions.section_motions import ClassMotions, class_motions, element_velocities


@dataclass(frozen=True)
class ExactMode:
    """A mode of a simply supported beam (left end pinned, right end free along x): omega [rad/s] and its sections.

    ``wave`` is the wave number k; the motions are axial sin kx, transverse sin kx, rotation cos kx, stretch cos kx
    times ``amplitudes`` in that order.
    """

    kind: str
    number: int
    omega: float
    wave: float
    amplitudes: tuple[float, float, float, float]

    def motions(self, x: Array) -> Array:
        """Return the section motions (4, ...) at x."""
        s, c = np.sin(self.wave * x), np.cos(self.wave * x)
        return np.array([a * f for a, f in zip(self.amplitudes, (s, s, c, c), strict=True)])


def section_motions(mesh: BodyMesh, classes: list[ClassMotions], v: np.ndarray) -> np.ndarray:
    """Return the section motions (4, ne, nx) of a velocity (n_q,) at the stations of the elements."""
    local, cls = element_velocities(mesh, v, slice(None)), mesh.cls
    out = np.empty((4, len(local), classes[0].rows.shape[1]))
    for k, c in enumerate(classes):
        out[:, cls == k] = np.einsum("pxa,ea->pex", c.rows, local[cls == k])
    return out


def _bending_and_shear(section: Section, k: float) -> list[tuple[float, float, float]]:
    """Return (omega, W, Psi) of both branches of w = W sin kx, psi = Psi cos kx, the lower first.

    kGA (w'' - psi') + rhoA omega^2 w = 0, EI psi'' + kGA (w' - psi) + rhoI omega^2 psi = 0 (Timoshenko 1921).
    """
    A = np.array([[section.kGA * k * k, -section.kGA * k], [-section.kGA * k, section.EI * k * k + section.kGA]])
    m = np.sqrt([section.rhoA, section.rhoI])
    values, vectors = np.linalg.eigh(A / np.outer(m, m))
    return [(math.sqrt(max(v, 0.0)), *(vectors[:, i] / m)) for i, v in enumerate(values)]


def exact_mode(section: Section, length: float, kind: str, number: int) -> ExactMode:
    """Return bending m (k = m pi/L), shear m (k = (m - 1) pi/L), axial m (k = (2 m - 1) pi/(2 L)) or thickness m.

    Thickness: every stretch cos kx of a section that is not coupled to its neighbours has sqrt(EA/rhoI), which is
    sqrt(12 E/rho)/h for a rectangle; k = (m - 1) pi/L.
    """
    if kind == "axial":
        k = (2 * number - 1) * math.pi / (2 * length)
        return ExactMode(kind, number, k * math.sqrt(section.EA / section.rhoA), k, (1.0, 0.0, 0.0, 0.0))
    if kind == "thickness":
        k = (number - 1) * math.pi / length
        return ExactMode(kind, number, math.sqrt(section.EA / section.rhoI), k, (0.0, 0.0, 0.0, 1.0))
    k = (number if kind == "bending" else number - 1) * math.pi / length
    omega, W, Psi = _bending_and_shear(section, k)[0 if kind == "bending" else 1]
    return ExactMode(kind, number, omega, k, (0.0, W, Psi, 0.0))


def overlap(mesh: BodyMesh, shapes: Array, mode: ExactMode) -> Array:
    """Return the square of the cosine between each shape (m, n_q) of a straight body and an exact mode (m,).

    The scalar product is that of kinetic energy: 1 for the same mode, 0 for another of the exact ones, and for what
    a type has no inertia for (rotation of the cable, stretch of sections that are rigid).
    """
    classes = [class_motions(c.sampler) for c in mesh.classes]
    exact = mode.motions(mesh.starts[:, None] + mesh.lengths[:, None] * classes[0].xi)
    inertia = np.array([c.inertia for c in classes])[mesh.cls].transpose(1, 0, 2)
    masses = np.array([c.mass for c in classes])[mesh.cls]
    size = float((inertia * exact**2).sum())
    out = []
    for shape in shapes:
        e = shape[mesh.dofs]
        total = float(np.einsum("ea,eab,eb->", e, masses, e, optimize=True))
        product = float((inertia * exact * section_motions(mesh, classes, shape)).sum())
        out.append(product**2 / (size * total) if size > 0 else 0.0)
    return np.array(out)
