"""Whether the mesh follows what a solver has found: section forces by equilibrium beside what the elements store.

Section forces in balance with the loads (and with inertia) have the complementary energy
U* = int N^2/EA + Q^2/kGA + M^2/EI ds/2 of a body; its elements store U. On a fine mesh both are the same. Their
difference is the energy of what separates the two (Prager and Synge 1947): where supports leave the section forces
determinate, it is the error of the deflection under the loads, and of the square of a frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..case import Buckling, Dynamic, Eigen
from ..elements.shape import Array, gauss
from ..kernels.elements import natural_power, viscous_force
from ..model.locking import thickness_excess
from ..model.mesh import BodyMesh
from ..model.model import Model
from .section_forces import SectionForces, has_section_forces, nodal_forces
from .state import State
from .system import System

# Gauss points along an element: M is of second degree in x under a line load, its square of fourth
STATIONS = 3
# of a deflection or frequency: what is told. A thick continuum differs from a beam by up to 0.03
TOLD = 0.08
# of the largest energy of a motion, in the mean over time: what is told. Positions are then off by 1 % or more
UNFOLLOWED = 1e-3
# states of a motion that are looked at
LOOKS = 20
# elements of models that are looked at: of more, it would take seconds
MOST = 20_000
# a body shorter than so many heights is no beam
SHORT = 2.0
# times the strain: share by which the energy of a law of Green-Lagrange strains differs from that of a linear one
LARGE_STRAIN = 3.0
# strain that is round-off, of a body as long as it is high
FAINT = 1e-13
# the kinds of modes that beams have; of those that are off, so many are named
KINDS, SHOWN = ("bending", "axial", "shear"), 3
ADVICE = "Use more elements, or --accuracy with a goal, which chooses them; ancf2d convergence shows the error"


@dataclass
class _Body:
    """One body: its section forces at Gauss points, and the compliances that make energies of them."""

    model: Model
    mesh: BodyMesh

    def __post_init__(self) -> None:
        x, w = gauss(STATIONS)
        section, length, at = self.mesh.plan.section, self.mesh.plan.length, self.mesh.sections(x)
        self.forces = SectionForces(self.model, self.mesh, x)
        self.ds = self.mesh.lengths[:, None] * w
        slides = 0.0 if self.mesh.plan.element.section_kind == "tangent" else 1.0 / at.kGA
        bends = 1.0 / (at.EI * (1.0 + thickness_excess(self.mesh)))
        self.compliance = np.stack(np.broadcast_arrays(1.0 / at.EA, slides, bends), axis=-1)
        slender = length / math.sqrt(12.0 * section.EI / section.EA)
        self.faint = section.EA * length * (FAINT * slender) ** 2

    def energies(self, state: State) -> tuple[float, float]:
        """Return U, and by how much the mesh fails to follow U*; both 0 where they are round-off."""
        forces = self.forces(state)
        density = 0.5 * forces**2 * self.compliance
        asked, stored = float(np.einsum("ek,ekc->", self.ds, density)), self._stored(state)
        size = float(np.abs(self.model.weights * state.d[:self.model.n_q]).max()) / self.model.extent
        floor = self.faint * (size if state.linear else max(1.0, size)) ** 2
        if max(asked, stored) <= floor:
            return 0.0, 0.0
        # the strain that makes this energy, in the mean over the body
        strain = math.sqrt(2.0 * stored / (self.mesh.plan.section.EA * self.mesh.plan.length))
        linear = state.linear or self.mesh.plan.formulation.stress is None
        allowed = 0.0 if linear else LARGE_STRAIN * strain * stored
        return stored, max(abs(asked - stored) - allowed, 0.0) * self._held(forces)

    def _held(self, forces: Array) -> float:
        """Return the share of a deflection within elements that is left where tension pulls it straight.

        A beam on the length l that bends by M in a half wave deflects by M l^2/pi^2/(EI + N l^2/pi^2).
        """
        N, M = forces[..., 0], forces[..., 2]
        pulled = np.maximum(N, 0.0) * (self.mesh.lengths[:, None] / math.pi) ** 2 * self.compliance[..., 2]
        weight = self.ds * M**2
        total = float(weight.sum())
        return float((weight / (1.0 + pulled)).sum()) / total if total > 0.0 else 1.0

    def _stored(self, state: State) -> float:
        """Return the strain energy, of the strains eps + tau d eps/dt where a viscous stress is among the forces."""
        mesh, n_q, tau = self.mesh, self.model.n_q, self.forces.tau
        Q, energy, alone = nodal_forces(self.model, mesh, state, np.arange(len(mesh.dofs)))
        if state.linear or state.v is None or not tau:
            return energy
        d, v = (x[:n_q][mesh.dofs].ravel() for x in (state.d, state.v))
        power = float(Q.ravel() @ v) + (natural_power(alone, 0.0, d, v) if self.model.loads.natural else 0.0)
        return energy + tau * power + 0.5 * tau * viscous_force(alone, tau, d, v, np.zeros_like(d))


def _bodies(model: Model) -> dict[str, _Body]:
    # layers that strain each other store energy without section forces
    return {name: _Body(model, mesh) for name, mesh in model.meshes.items()
            if has_section_forces(mesh) and not mesh.plan.section.layers
            and mesh.plan.length > SHORT * mesh.plan.section.height}


class Resolution:
    """Looks at the states of a model, and tells where its mesh does not follow them."""

    def __init__(self, model: Model) -> None:
        self.model, self.solver = model, model.case.solver
        # what solves to an accuracy judges its meshes itself
        self.looks = model.n_elements <= MOST and model.case.accuracy is None
        # of a motion: energy that the mesh does not follow, summed over looks; the largest energy; when to look again
        self.lost: dict[str, float] = {}
        self.energy, self.count, self.next = 0.0, 0, 0.0

    @cached_property
    def _bodies(self) -> dict[str, _Body]:
        return _bodies(self.model)

    def take(self, state: State) -> None:
        """Look at a state of a motion, unless the last look was a short time ago."""
        if not self.looks or state.v is None or state.t <= self.next:
            return
        assert isinstance(self.solver, Dynamic)
        self.next = state.t + 0.999 * self.solver.t_end / LOOKS
        self.count += 1
        known = state.history
        self.energy = max(self.energy, known["kinetic"] + known["strain"], 0.5 * abs(known.get("work", 0.0)))
        for name, body in self._bodies.items():
            self.lost[name] = self.lost.get(name, 0.0) + body.energies(state)[1]

    def kept(self) -> dict[str, Any]:
        """Return what goes into a checkpoint."""
        return {"lost": dict(self.lost), "energy": self.energy, "count": self.count, "next": self.next}

    def go_on(self, kept: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.lost, self.energy, self.count, self.next = (kept[k] for k in ("lost", "energy", "count", "next"))

    def warnings(self, state: State) -> list[str]:
        """Return what to say of the last state, of its modes, or of the motion that it ends."""
        if not self.looks or isinstance(self.solver, Buckling):
            return []
        if isinstance(self.solver, Dynamic):
            return self._of_motion()
        if isinstance(self.solver, Eigen) and self.solver.about == "reference":
            return [] if self.model.case.steady_rotation else self._of_modes(state)
        return self._of_statics(state)

    def _of_motion(self) -> list[str]:
        share = sum(self.lost.values()) / (self.count * self.energy) if self.energy else 0.0
        if share <= UNFOLLOWED:
            return []
        return [f"the mesh is too coarse for this motion: it does not follow waves and bends that have "
                f"{100 * share:.2g} % of the energy{self._where(self.lost)}. The error of the time steps does not "
                f"contain this. {ADVICE}"]

    def _of_statics(self, state: State) -> list[str]:
        found = {name: body.energies(state) for name, body in self._bodies.items()}
        lost = {name: gap for name, (_, gap) in found.items()}
        n_q = self.model.n_q
        stored = max(sum(stored for stored, _ in found.values()), 0.5 * abs(float(state.F[:n_q] @ state.d[:n_q])))
        off = _share(sum(lost.values()), stored)
        if off <= TOLD:
            return []
        return [f"the mesh is too coarse: displacements are off by about {_percent(off)} %{self._where(lost)}. "
                f"{ADVICE}"]

    def _of_modes(self, state: State) -> list[str]:
        alone = replace(self.model, case=replace(self.model.case, loads=()))
        bodies, system, zero = _bodies(alone), System(alone), np.zeros_like(state.d)
        off: dict[str, float] = {}
        told: dict[str, float] = {}
        for mode, shape in zip(state.report["frequencies"], state.arrays["modes/shapes"][0], strict=True):
            if mode["kind"] not in KINDS or mode["omega"] == 0.0:
                continue
            d = np.append(shape, np.zeros(len(zero) - len(shape)))
            Q = system.action(zero, d, 0.0, linear=True)
            # omega^2 of the undamped mode, where damping has the same share in all of it
            squared = mode["omega"]**2 + mode.get("growth", 0.0)**2
            moving = State(0.0, d, Q, zero, 0.0, linear=True, a=-squared * d)
            found = {name: body.energies(moving) for name, body in bodies.items()}
            share = _share(sum(gap for _, gap in found.values()), sum(stored for stored, _ in found.values()))
            if (error := 1.0 / math.sqrt(1.0 - share) - 1.0) > TOLD:
                off[f"{mode['kind']} {mode['number']}"] = error
                for name, (_, gap) in found.items():
                    told[name] = told.get(name, 0.0) + gap / mode["omega"]**2
        if not off:
            return []
        worst = ", ".join(f"{name} by about {_percent(error)} %" for name, error in list(off.items())[:SHOWN])
        more = f", and {len(off) - SHOWN} more" if len(off) > SHOWN else ""
        return [f"the mesh is too coarse for some of the modes: the frequency is off for {worst}{more}"
                f"{self._where(told)}. {ADVICE}"]

    def _where(self, lost: dict[str, float]) -> str:
        """Return ' (body rod, 4 elements)' for the body that the mesh follows least, where there are several."""
        name = max(lost, key=lambda k: lost[k])
        return f" (most in bodies.{name}, {self.model.meshes[name].plan.count} elements)" if len(lost) > 1 else ""


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share >= 0.1 else f"{100 * share:.2g}"


def _share(gap: float, stored: float) -> float:
    return gap / (gap + stored) if gap > 0.0 else 0.0
