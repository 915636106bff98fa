"""Classification of modes by the shares of section motions in the kinetic energy, and by the strain energy."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

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


def axis_energies(mesh: BodyMesh, e: Array, v: Array, natural: bool) -> Array:
    """Return twice the strain energy (3,) of a small displacement v (n_q,) about coordinates e (n_q,).

    Stretch, bending and shear of a beam with this axis and these sections, sampled at two stations of each element. The
    work against the tension of a stretched axis, which turns, counts as bending: taut strings have little else. With
    ``natural`` strains, the stretch does not show the tension.
    """
    element, section = mesh.plan.element, mesh.sections(STATIONS)
    nc, zero = element.components, np.zeros(len(STATIONS))

    def along(q: Array, i: int, j: int, c: int) -> Array:
        rows = np.array([cls.shape(STATIONS, zero, i, j) for cls in mesh.classes])
        return np.einsum("esk,ek->es", rows[mesh.cls], q[mesh.dofs][:, c::nc])

    rx, dx = (np.array([along(q, 1, 0, c) for c in (0, 1)]) for q in (e, v))
    length = np.hypot(*rx)
    stretch = (rx * dx).sum(axis=0) / length
    turn = (rx[0] * dx[1] - rx[1] * dx[0]) / length**2
    if element.has_theta:
        theta = along(v, 0, 0, 2)
    elif element.section_kind == "interpolated":
        ry, dy = (np.array([along(q, 0, 1, c) for c in (0, 1)]) for q in (e, v))
        theta = (ry[0] * dy[1] - ry[1] * dy[0]) / (ry**2).sum(axis=0)
    else:
        theta = turn
    bent = (theta[:, 1] - theta[:, 0]) / ((STATIONS[1] - STATIONS[0]) * mesh.lengths)
    weights = 0.5 * mesh.lengths[:, None]
    terms = (section.EA, stretch), (section.EI, bent[:, None]), (section.kGA, turn - theta)
    out = np.array([float((weights * k * strain**2).sum()) for k, strain in terms])
    if not natural:
        out[1] += float((weights * section.EA * np.maximum(length - 1.0 - TAUT, 0.0) * turn**2).sum())
    return out


class Classifier:
    """Names the modes of one model; ``d`` is the state about which it vibrates."""

    def __init__(self, model: Model, d: Array) -> None:
        self.model, self.d = model, d
        # axial and transverse refer to the state, which may hang down although the reference is horizontal
        self.meshes = {name: _turned(mesh, model.e0 + d[:model.n_q]) if d.any() else mesh
                       for name, mesh in model.meshes.items()}
        self.classes: dict[str, list[ClassMotions]] = {
            name: [class_motions(c.sampler) for c in mesh.classes] for name, mesh in model.meshes.items()
            if mesh.plan.section.rhoA or not mesh.plan.rigid}

    def __call__(self, v: Array, zero: bool) -> Verdict:
        """Classify the velocity field v (n_q,); ``zero``: its strain energy is round-off."""
        parts = {name: energies(self.meshes[name], classes, v) for name, classes in self.classes.items()}
        extra = self._point_masses(v)
        motions = sum((e.motions for e in parts.values()), extra)
        total = sum(e.total for e in parts.values()) + float(extra.sum())
        shares = dict(zip(MOTIONS, (float(m) for m in motions / total), strict=True))
        shares = {k: shares[k] for k in ("transverse", "axial", "rotation", "stretch")}
        shares["higher"] = max(0.0, 1.0 - sum(shares.values()))
        gaps = sum(e.gaps for e in parts.values()) / total
        functions = self._resolution(parts)
        strain = self._strain(v)
        verdict = Verdict("", shares, gaps, functions, strain)
        return replace(verdict, kind=self._kind(verdict, zero, v))

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

    def _strain(self, v: Array) -> dict[str, float]:
        """Return the shares of the strain energy of a displacement v (n_q,) in stretch, bending and shear."""
        natural = {strain.mesh.plan.name for strain in self.model.loads.natural}
        every = np.array([axis_energies(mesh, self.model.e0 + self.d[:self.model.n_q], v, name in natural)
                          for name, mesh in self.model.meshes.items() if not mesh.plan.rigid]
                         ).reshape(-1, 3).sum(axis=0)
        total = float(every.sum())
        if not total > 0.0:
            return {}
        return dict(zip(("axial", "bending", "shear"), (every / total).tolist(), strict=True))

    def _resolution(self, parts: dict[str, Energies]) -> float:
        """Return the functions per wave length for the dominant motion of the body with most kinetic energy."""
        deform = [name for name in parts if not self.model.meshes[name].plan.rigid]
        if not deform:
            return np.inf
        name = max(deform, key=lambda k: parts[k].total)
        e, mesh = parts[name], self.model.meshes[name]
        k = int(np.argmax(e.motions))
        if e.gradient[k] <= 0:
            return np.inf
        wave = 2 * np.pi * np.sqrt(e.motions[k] / e.gradient[k])
        return float(wave * functions_per_element(mesh)[k] * mesh.plan.count / mesh.plan.length)

    def _point_masses(self, v: Array) -> Array:
        """Return twice the kinetic energy of the point masses by section motion (4,)."""
        out = np.zeros(4)
        e = self.model.e0 + self.d[:self.model.n_q]
        for item in self.model.case.resting_masses:
            point = self.model.point(item.at)
            for term in mass_terms(item, point):
                rate = np.array([dot(c, v) for c in term.columns])
                if len(rate) == 1:
                    out[2] += term.inertia * rate[0] ** 2
                    continue
                along = np.array([np.cos(point.angle), np.sin(point.angle)])
                if not term.place:
                    along = np.array([dot(c, e) for c in term.columns])
                    along /= np.hypot(*along)
                # a position moves along and across the beam, a direction stretches and rotates
                first, second = (0, 1) if term.place else (3, 2)
                out[first] += term.inertia * (along @ rate) ** 2
                out[second] += term.inertia * (along[0] * rate[1] - along[1] * rate[0]) ** 2
        return out

    def is_rigid(self, v: Array) -> bool:
        """Return whether every body moves rigidly: its three rigid motions contain all but RIGID of its kinetic energy.

        Bodies that hardly move compared with the others are ignored.
        """
        left, total = [], []
        for name in self.classes:
            mesh = self.model.meshes[name]
            coords = mesh.first_dof + np.arange(mesh.n_dofs)
            e = self.model.e0 + self.d[:self.model.n_q]
            fields = np.zeros((4, self.model.n_q))
            fields[:3, coords] = rigid_motion(mesh, coords, e, np.asarray(mesh.plan.position(0.5)[0])).T
            fields[3] = v
            G = self._products(name, mesh, fields)
            left.append(max(0.0, G[3, 3] - G[:3, 3] @ np.linalg.solve(G[:3, :3], G[:3, 3])))
            total.append(G[3, 3])
        return bool(np.all(np.array(left) <= RIGID * np.array(total) + STILL * sum(total)))

    def _products(self, name: str, mesh: BodyMesh, fields: Array) -> Array:
        local = [element_velocities(mesh, f) for f in fields]
        G = np.zeros((len(fields), len(fields)))
        for k, c in enumerate(self.classes[name]):
            here = np.array([x[mesh.cls == k] for x in local])
            G += np.einsum("iea,jea->ij", here @ c.mass, here, optimize=True)
        return G
