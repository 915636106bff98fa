"""Classification of modes by the shares of section motions in the kinetic energy, and by the strain energy."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...elements.definition import derivative_order
from ...elements.shape import Array
from ...interactions.inertia import mass_terms
from ...model.determinacy import rigid_motion
from ...model.mesh import BodyMesh
from ...model.model import Model
from ...model.points import dot
from .section_motions import MOTIONS, ClassMotions, Energies, class_motions, element_velocities, energies

KINDS = {"rotation": "shear", "stretch": "thickness"}
# stations in an element at which strains are sampled, from 0 to 1
STATIONS = np.array([0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)])
# if the largest share is smaller, the mode is mixed
MIXED = 0.6
# share of the kinetic energy in gaps between neighbouring elements above which a mode is an artefact of the mesh
GAPS = 0.1
# functions per wave length below which the mesh cannot represent a wave (2 is the most rapid change of sign)
RESOLVED = 3.0
# strain of the axis that is round-off
TAUT = 1e-12
# number of elements times modes that are classified together, which bounds the memory for them
TOGETHER = 100_000
# share of a body's kinetic energy that its rigid motions may leave out; share of the total that is round-off
RIGID, STILL = 1e-6, 1e-12


@dataclass(frozen=True)
class Verdict:
    """Kind of a mode, shares of its kinetic energy by section motion (the remainder is ``higher``), share in gaps.

    ``functions``: shape functions per wave length of the dominant motion; ``strain``: shares of the bodies' strain
    energy in stretch, bending and shear of the axis, empty if there is none.
    """

    kind: str
    shares: dict[str, float]
    gaps: float
    functions: float
    strain: dict[str, float]


def functions_per_element(mesh: BodyMesh) -> Array:
    """Return the number of independent functions of x per element for each section motion (4,)."""
    names = [name for node in mesh.plan.element.nodes[:-1] for name in node.coordinates]
    orders = [derivative_order(name)[1] for name in names if name != "theta"]
    on_axis = sum(j == 0 for j in orders)
    across = sum(name == "theta" for name in names) or sum(j == 1 for j in orders) or on_axis
    return np.array([on_axis, on_axis, across, across])


def _turned(mesh: BodyMesh, e: Array) -> BodyMesh:
    """Return a mesh whose element frames are rotated with their chords to nodal coordinates e (n_q,)."""
    x = mesh.dofs[:, mesh.kinds[mesh.dofs[0] - mesh.first_dof] == 0][:, [0, -1]]
    if np.any(x[:, 0] == x[:, 1]):
        return mesh
    here, there = (values[x[:, 1]] - values[x[:, 0]] + 1j * (values[x[:, 1] + 1] - values[x[:, 0] + 1])
                   for values in (e, _reference(mesh, len(e))))
    turn = (mesh.turn[:, 0] + 1j * mesh.turn[:, 1]) * np.exp(1j * np.angle(here / there))
    out = copy(mesh)
    out.turn = np.ascontiguousarray(np.stack([turn.real, turn.imag], axis=1))
    return out


def _reference(mesh: BodyMesh, n_q: int) -> Array:
    """Return reference coordinates (n_q,), those of other bodies zero."""
    out = np.zeros(n_q)
    out[mesh.first_dof:mesh.first_dof + mesh.n_dofs] = mesh.e0
    return out


class AxisStrains:
    """Strain energies of small displacements about coordinates e (n_q,), those of a beam with this axis and sections.

    They are sampled at two stations of each element. The work against the tension of a stretched axis, which turns,
    counts as bending: taut strings have little else. With ``natural`` strains, the stretch does not show the tension.
    """

    def __init__(self, mesh: BodyMesh, e: Array, natural: bool) -> None:
        self.mesh, self.natural = mesh, natural
        self.section = mesh.sections(STATIONS)
        self.tables: dict[tuple[int, int], Array] = {}
        self.rx = self._vector(e, 1, 0)
        self.length = np.hypot(*self.rx)
        self.ry = self._vector(e, 0, 1) if mesh.plan.element.section_kind == "interpolated" else None

    def _along(self, q: Array, i: int, j: int, c: int) -> Array:
        """Return component c of the (i, j) derivative (..., ne, stations) on the axis of coordinates q (..., n_q)."""
        mesh, zero = self.mesh, np.zeros(len(STATIONS))
        if (i, j) not in self.tables:
            self.tables[i, j] = np.array([cls.shape(STATIONS, zero, i, j) for cls in mesh.classes])
        local = q[..., mesh.dofs[:, c::mesh.plan.element.components]]
        return np.asarray((self.tables[i, j][mesh.cls] @ local[..., None])[..., 0])

    def _vector(self, q: Array, i: int, j: int) -> Array:
        return np.array([self._along(q, i, j, c) for c in (0, 1)])

    def energies(self, V: Array) -> Array:
        """Return twice the energy (m, 3) of displacements V (m, n_q) in stretch, bending and shear."""
        mesh, section, rx, length = self.mesh, self.section, self.rx, self.length
        dx = self._vector(V, 1, 0)
        stretch = (rx[:, None] * dx).sum(axis=0) / length
        turn = (rx[0] * dx[1] - rx[1] * dx[0]) / length**2
        if mesh.plan.element.has_theta:
            theta = self._along(V, 0, 0, 2)
        elif self.ry is not None:
            dy = self._vector(V, 0, 1)
            theta = (self.ry[0] * dy[1] - self.ry[1] * dy[0]) / (self.ry**2).sum(axis=0)
        else:
            theta = turn
        bent = (theta[..., 1] - theta[..., 0]) / ((STATIONS[1] - STATIONS[0]) * mesh.lengths)
        weights = 0.5 * mesh.lengths[:, None]
        terms = (section.EA, stretch), (section.EI, bent[..., None]), (section.kGA, turn - theta)
        out = np.stack([(weights * k * strain**2).sum(axis=(1, 2)) for k, strain in terms], axis=1)
        if not self.natural:
            out[:, 1] += (weights * section.EA * np.maximum(length - 1.0 - TAUT, 0.0) * turn**2).sum(axis=(1, 2))
        return out


class Classifier:
    """Names the modes of one model; ``d`` is the state about which it vibrates."""

    def __init__(self, model: Model, d: Array) -> None:
        self.model, self._d = model, d[:model.n_q]
        # axial and transverse refer to the state, which may hang down although the reference is horizontal
        self.meshes = {name: _turned(mesh, model.e0 + d[:model.n_q]) if d.any() else mesh
                       for name, mesh in model.meshes.items()}
        self.classes: dict[str, list[ClassMotions]] = {
            name: [class_motions(c.sampler) for c in mesh.classes] for name, mesh in model.meshes.items()
            if mesh.plan.section.rhoA or not mesh.plan.rigid}

    def __call__(self, V: Array, zero: NDArray[np.bool_]) -> list[Verdict]:
        """Classify velocity fields V (m, n_q); ``zero`` (m,): their strain energy is round-off."""
        some = max(1, TOGETHER // max(self.model.n_elements, 1))
        return [verdict for first in range(0, len(V), some)
                for verdict in self._verdicts(V[first:first + some], zero[first:first + some])]

    def _verdicts(self, V: Array, zero: NDArray[np.bool_]) -> list[Verdict]:
        parts = {name: energies(self.meshes[name], classes, V) for name, classes in self.classes.items()}
        extra = self._point_masses(V)
        motions = sum((e.motions for e in parts.values()), extra)
        total = sum(e.total for e in parts.values()) + extra.sum(axis=1)
        gaps, strains = sum(e.gaps for e in parts.values()) / total, self._strains(V)
        out = []
        for k, v in enumerate(V):
            shares = dict(zip(MOTIONS, (motions[k] / total[k]).tolist(), strict=True))
            shares = {name: shares[name] for name in ("transverse", "axial", "rotation", "stretch")}
            shares["higher"] = max(0.0, 1.0 - sum(shares.values()))
            verdict = Verdict("", shares, float(gaps[k]), self._resolution(parts, k), strains[k])
            out.append(replace(verdict, kind=self._kind(verdict, bool(zero[k]), v)))
        return out

    def _kind(self, verdict: Verdict, zero: bool, v: Array) -> str:
        if zero or all(mesh.plan.rigid for mesh in self.model.meshes.values()):
            # deformation without resistance is not a motion of a beam
            return "rigid" if self.is_rigid(v) else "spurious"
        if verdict.gaps > GAPS or verdict.functions < RESOLVED:
            return "spurious"
        kind, by_motion = (self.shape_kind(verdict.shares, strain) for strain in (verdict.strain, {}))
        # on soft springs, the strains of stiff bodies may be round-off
        return by_motion if kind != by_motion and self.is_rigid(v) else kind

    @staticmethod
    def shape_kind(shares: dict[str, float], strain: dict[str, float]) -> str:
        """Return the kind that follows from the shares alone.

        If the axis moves, strain energy decides between bending and axial: the beam of a portal that sways moves along
        its axis, but the columns bend. Without strain energy, the direction of the motion decides.
        """
        largest = max(shares, key=lambda k: shares[k])
        if largest in KINDS:
            return KINDS[largest] if shares[largest] >= MIXED else "mixed"
        if not strain:
            strain = {"axial": shares["axial"], "bending": shares["transverse"], "shear": 0.0}
        elif shares["transverse"] + shares["axial"] < MIXED:
            return "mixed"
        if strain["axial"] >= MIXED:
            return "axial"
        return "bending" if strain["bending"] + strain["shear"] >= MIXED else "mixed"

    def _strains(self, V: Array) -> list[dict[str, float]]:
        """Return the shares of the strain energy of displacements V (m, n_q) in stretch, bending and shear."""
        natural, e = {strain.mesh.plan.name for strain in self.model.loads.natural}, self.model.e0 + self._d
        every = sum((AxisStrains(mesh, e, name in natural).energies(V) for name, mesh in self.model.meshes.items()
                     if not mesh.plan.rigid), np.zeros((len(V), 3)))
        return [dict(zip(("axial", "bending", "shear"), (one / one.sum()).tolist(), strict=True))
                if one.sum() > 0.0 else {} for one in every]

    def _resolution(self, parts: dict[str, Energies], number: int) -> float:
        """Return the functions per wave length for the dominant motion of the body with most kinetic energy."""
        deform = [name for name in parts if not self.model.meshes[name].plan.rigid]
        if not deform:
            return np.inf
        name = max(deform, key=lambda k: float(parts[k].total[number]))
        motions, gradient, mesh = parts[name].motions[number], parts[name].gradient[number], self.model.meshes[name]
        k = int(np.argmax(motions))
        if gradient[k] <= 0:
            return np.inf
        wave = 2 * np.pi * np.sqrt(motions[k] / gradient[k])
        return float(wave * functions_per_element(mesh)[k] * mesh.plan.count / mesh.plan.length)

    def _point_masses(self, V: Array) -> Array:
        """Return twice the kinetic energy (m, 4) of the point masses by section motion."""
        out, e = np.zeros((len(V), 4)), self.model.e0 + self._d
        for item in self.model.case.resting_masses:
            point = self.model.point(item.at)
            for term in mass_terms(item, point):
                rate = np.array([V[:, coords] @ by for coords, by in term.columns])
                if len(rate) == 1:
                    out[:, 2] += term.inertia * rate[0] ** 2
                    continue
                along = np.array([np.cos(point.angle), np.sin(point.angle)])
                if not term.place:
                    along = np.array([dot(c, e) for c in term.columns])
                    along /= np.hypot(*along)
                # a position moves along and across the beam, a direction stretches and rotates
                first, second = (0, 1) if term.place else (3, 2)
                out[:, first] += term.inertia * (along @ rate) ** 2
                out[:, second] += term.inertia * (along[0] * rate[1] - along[1] * rate[0]) ** 2
        return out

    def is_rigid(self, v: Array) -> bool:
        """Return whether every body moves rigidly: its three rigid motions contain all but RIGID of its kinetic energy.

        Bodies that hardly move compared with the others are ignored.
        """
        left, total = [], []
        for name in self.classes:
            mesh = self.model.meshes[name]
            coords = mesh.first_dof + np.arange(mesh.n_dofs)
            e = self.model.e0 + self._d
            fields = np.zeros((4, self.model.n_q))
            fields[:3, coords] = rigid_motion(mesh, coords, e, np.asarray(mesh.plan.position(0.5)[0])).T
            fields[3] = v
            G = self._products(name, mesh, fields)
            left.append(max(0.0, G[3, 3] - G[:3, 3] @ np.linalg.solve(G[:3, :3], G[:3, 3])))
            total.append(G[3, 3])
        return bool(np.all(np.array(left) <= RIGID * np.array(total) + STILL * sum(total)))

    def _products(self, name: str, mesh: BodyMesh, fields: Array) -> Array:
        local = element_velocities(mesh, fields)
        G = np.zeros((len(fields), len(fields)))
        for k, c in enumerate(self.classes[name]):
            here = local[:, mesh.cls == k]
            G += np.einsum("iea,jea->ij", here @ c.mass, here, optimize=True)
        return G
