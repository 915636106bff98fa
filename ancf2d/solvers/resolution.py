"""Check that the mesh is fine enough: section forces by equilibrium, compared with the stored energy of elements.

Section forces in balance with the loads (and with inertia) have the complementary energy U* = int N^2/EA + Q^2/kGA +
M^2/EI ds/2 of a body; its elements store U. On a fine mesh both are equal. Their difference is the energy of the error
(Prager and Synge 1947): where supports leave the section forces determinate, it is the relative error of the deflection
under the loads, and of the square of a frequency. Natural strains eps* displace bodies without stress, like loads with
the work int eps*^T D eps*: the difference is then relative to half of this.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..case import Eigen
from ..elements.shape import Array, gauss
from ..errors import percent
from ..interactions.forces import LoadSet
from ..kernels.elements import natural_power, natural_slope, viscous_force
from ..model.element_limits import thickness_excess
from ..model.mesh import BodyMesh, Index
from ..model.model import Model
from .energy import internal_energy
from .section_forces import SectionForces, has_section_forces, natural_rates, nodal_forces
from .state import State
from .system import System

# Gauss points along an element: M is quadratic in x under a line load, its square quartic
STATIONS = 3
# relative error of a deflection or frequency that gives a warning; a thick continuum differs from a beam by up to 0.03
WARN_ABOVE = 0.08
# the same for a load factor; elements with a straight axis show half of its error
WARN_ABOVE_BUCKLING = 0.04
# the same for the mean unresolved energy of a motion, relative to its largest energy; positions then err by 1 % or more
UNFOLLOWED = 1e-3
# number of states of a motion that are checked
LOOKS = 10
# largest number of elements that are checked, as a sample, and the least number for each body
MOST, LEAST = 5_000, 100
# models with more bodies and more elements than these are not checked, which would take seconds
BODIES, MANY = 100, 20_000
# largest number of bodies that are checked, as a sample, since each takes about 10 ms
LOOKED = 50
# length in heights below which end effects disturb the whole body: for sections that bend, for straight ones that
# change their height, and for rigid ones
SHORT = {"bending": 2.0, "straight": 0.5, "rigid": 0.0}
# displacement, relative to the extent of the model, for differentiating small motions
SMALL = 1e-4
# largest share of a frequency or load factor that is reported as lost
WHOLE = 0.99
# times the strain: relative difference of the energies of Green-Lagrange and linear strains, of an equilibrium and of a
# small motion about one; the tangent modulus of a neo-Hookean bar falls with 1 - 2 e, the energy of its strains rises
LARGE_STRAIN, LARGE_STRAIN_OF_MOTION = 3.0, 6.0
# strain that is round-off, for a body as long as high
FAINT = 1e-13
# kinds of modes of beams; largest number of inaccurate modes in a message
KINDS, SHOWN = ("bending", "axial", "shear"), 3
# share of an eigenvalue above which its imaginary part is the frequency of a vibration
VIBRATES = 0.1
ADVICE = "Use more elements, or --accuracy with a goal; ancf2d convergence shows the error"


@dataclass
class CheckedBody:
    """One body: its section forces at Gauss points, and the compliances for their energy.

    ``stands_for``: number of bodies that it represents as a sample.
    """

    model: Model
    mesh: BodyMesh
    stands_for: float = 1.0
    some: Index = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.mesh.dofs)
        looked = min(count, max(LEAST, count * MOST // self.model.n_elements))
        self.some = ((np.arange(looked) + 0.5) * count / looked).astype(np.int64)
        x, w = gauss(STATIONS)
        section, length, at = self.mesh.plan.section, self.mesh.plan.length, self.mesh.sections(x)
        self.forces = SectionForces(self.model, self.mesh, x)
        self.weight = self.stands_for * count / looked
        self.lengths = self.mesh.lengths[self.some, None]
        self.ds = self.weight * self.lengths * w
        slides = 0.0 if self.mesh.plan.element.section_kind == "tangent" else 1.0 / at.kGA
        bends = 1.0 / (at.EI * (1.0 + thickness_excess(self.mesh)))
        compliance = np.stack(np.broadcast_arrays(1.0 / at.EA, slides, bends), axis=-1)
        self.compliance = np.broadcast_to(compliance, (count, STATIONS, 3))[self.some]
        slender = length / math.sqrt(12.0 * section.EI / section.EA)
        self.faint = section.EA * length * (FAINT * slender) ** 2

    def without(self, which: Index) -> CheckedBody:
        """Return the body without some of its elements (k,)."""
        out, keep = copy(self), ~np.isin(self.some, which)
        out.some, out.lengths = self.some[keep], self.lengths[keep]
        out.ds, out.compliance = self.ds[keep], self.compliance[keep]
        return out

    def energies(self, state: State) -> tuple[float, float]:
        """Return U and the part of the energy that the mesh does not resolve, |U* - U|; both 0 if they are round-off.

        Elements that lie on an obstacle are left out: forces at their ends represent the pressure along them.
        """
        if not self.model.contacts:
            return self._energies(state)
        from .contact_fields import touching_at_both_ends

        lies = touching_at_both_ends(self.model, self.mesh, state)
        return self.without(np.flatnonzero(lies))._energies(state) if lies.any() else self._energies(state)

    def _energies(self, state: State) -> tuple[float, float]:
        if not len(self.some):
            return 0.0, 0.0
        forces = self.forces(state, self.some)
        asked, stored = self._equilibrium_energy(forces), self._stored(state, self.forces.energy)
        size = float(np.abs(self.model.weights * state.d[:self.model.n_q]).max()) / self.model.extent
        floor = self.faint * (size if state.linear else max(1.0, size)) ** 2
        if max(asked, stored) <= floor:
            return 0.0, 0.0
        larger = max(asked, stored)
        allowed = 0.0 if state.linear else self._large_strain_error(larger) * larger
        return stored, max(abs(asked - stored) - allowed, 0.0) * self._tension_share(forces[..., 0], forces[..., 2])

    def natural(self, state: State) -> float:
        """Return eps*^T D eps*/2, the energy of a state's natural strains if nothing moved."""
        if not any(load.mesh is self.mesh for load in self.model.loads.natural):
            return 0.0
        alone = nodal_forces(self.model, self.mesh, state, self.some, self.forces.uncoupled(self.some))[2]
        zero, Q = (np.zeros(alone.dofs.size) for _ in range(2))
        self.model.set_natural(None, natural_rates(self.model, state))
        energy = natural_slope(alone, zero, Q)
        self.model.set_natural(None)
        return self.weight * energy

    def motion(self, state: State, shape: Array, forces: Array, N: Array) -> tuple[float, float]:
        """Return the same as ``energies`` for a small motion (n_q,) about a state.

        ``forces`` (m, k, 3) are the section forces that the motion adds, N (m, k) those of the state. U is the energy
        of the strains of the motion, without the work of the state's forces in it.
        """
        dofs = self.mesh.dofs[self.some]
        _, energy, alone = nodal_forces(self.model, self.mesh, state, self.some, self.forces.uncoupled(self.some))
        self.model.set_natural(None)
        d, v = state.d[:self.model.n_q][dofs].ravel(), shape[dofs].ravel()
        asked = self._equilibrium_energy(forces)
        stored = 0.5 * self.weight * viscous_force(alone, 1.0, d, v, np.zeros_like(d))
        size = float(np.abs(self.model.weights * shape).max()) / self.model.extent
        if max(asked, stored) <= self.faint * size**2:
            return 0.0, 0.0
        allowed = self._large_strain_error(max(self.weight * energy, 0.0), LARGE_STRAIN_OF_MOTION) * max(asked, stored)
        return stored, max(abs(asked - stored) - allowed, 0.0) * self._tension_share(N, forces[..., 2])

    def added(self, state: State, motion: Array, Q: Array, a: Array | None) -> Array:
        """Return the section forces (m, k, 3) that a small motion (n_full,) adds, with its forces Q and rates a."""
        if not state.d.any() and not state.Q.any():
            # about a reference without forces, the linear theory is exact
            return self.forces(replace(state, d=motion, Q=Q, linear=True, a=a), self.some)
        size = float(np.abs(self.model.weights * motion[:self.model.n_q]).max()) / self.model.extent
        h = SMALL / size if size > 0.0 else 1.0
        ends = [self.forces(replace(state, d=state.d + s * motion, Q=state.Q + s * Q, linear=False, about=state.d,
                                    a=None if a is None else s * a), self.some) for s in (h, -h)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * h))

    def tension(self, state: State) -> Array:
        """Return N (m, k) of a state."""
        return self.forces(state, self.some)[..., 0]

    def _equilibrium_energy(self, forces: Array) -> float:
        """Return U* of section forces."""
        return float(np.einsum("ek,ekc->", self.ds, 0.5 * forces**2 * self.compliance))

    def _large_strain_error(self, energy: float, factor: float = LARGE_STRAIN) -> float:
        """Return the relative error of the larger of U and U* due to large Green-Lagrange strains, by the mean strain.

        A stretched neo-Hookean bar stores much less than N^2/EA ds/2.
        """
        if not self.mesh.plan.formulation.green:
            return 0.0
        rigidity = self.stands_for * self.mesh.plan.section.EA * self.mesh.plan.length
        return factor * math.sqrt(2.0 * energy / rigidity)

    def _tension_share(self, N: Array, M: Array) -> float:
        """Return the share of a deflection within elements that remains under tension.

        A beam of length l that bends by M in a half wave deflects by M l^2/pi^2/(EI + N l^2/pi^2).
        """
        pulled = np.maximum(N, 0.0) * (self.lengths / math.pi) ** 2 * self.compliance[..., 2]
        weight = self.ds * M**2
        total = float(weight.sum())
        return float((weight / (1.0 + pulled)).sum()) / total if total > 0.0 else 1.0

    def _stored(self, state: State, energy: float) -> float:
        """Return the strain energy of the body, given that of the checked elements.

        With a viscous stress it is that of the strains eps + tau d eps/dt.
        """
        mesh, n_q, tau = self.mesh, self.model.n_q, self.forces.tau
        if state.linear or state.v is None or not tau:
            return self.weight * energy
        Q, _, alone = nodal_forces(self.model, mesh, state, self.some, self.forces.uncoupled(self.some))
        d, v = (x[:n_q][mesh.dofs[self.some]].ravel() for x in (state.d, state.v))
        power = float(Q.ravel() @ v) + (natural_power(alone, 0.0, d, v) if self.model.loads.natural else 0.0)
        return self.weight * (energy + tau * power + 0.5 * tau * viscous_force(alone, tau, d, v, np.zeros_like(d)))


def _bodies(model: Model) -> dict[str, CheckedBody]:
    # layers can strain each other, which stores energy without section forces
    found = [(name, mesh) for name, mesh in model.meshes.items()
             if has_section_forces(mesh) and not mesh.plan.section.layers
             and mesh.plan.length > _shortest(mesh) * mesh.plan.section.height]
    looked = min(len(found), LOOKED)
    chosen = [found[(2 * k + 1) * len(found) // (2 * looked)] for k in range(looked)]
    return {name: CheckedBody(model, mesh, len(found) / looked) for name, mesh in chosen}


def _shortest(mesh: BodyMesh) -> float:
    """Return the length in heights above which a body can be judged as a beam."""
    element = mesh.plan.element
    if element.section_kind != "interpolated":
        return SHORT["rigid"]
    return SHORT["straight" if element.degree_y == 1 else "bending"]


class Resolution:
    """Check the states of a model, and report where its mesh does not resolve them."""

    def __init__(self, model: Model) -> None:
        self.model, self.solver = model, model.case.solver
        # runs with a prescribed accuracy judge their meshes themselves
        few = len(model.meshes) <= BODIES or model.n_elements <= MANY
        self.looks = few and model.case.accuracy is None
        # of a motion: unresolved energy of each body, summed over checks; largest energy; number of checks; time of the
        # next
        self.lost: dict[str, float] = {}
        self.energy, self.count, self.next = 0.0, 0, 0.0

    @cached_property
    def _bodies(self) -> dict[str, CheckedBody]:
        return _bodies(self.model)

    def check(self, state: State) -> None:
        """Check a state of a motion, unless the last check was shortly before."""
        if not self.looks or state.v is None or state.t <= self.next:
            return
        self.next = state.t + 0.999 * self.solver.end / LOOKS
        self.count += 1
        known = state.history
        natural = sum(body.natural(state) for body in self._bodies.values())
        self.energy = max(self.energy, known["kinetic"] + known["strain"], 0.5 * abs(known.get("work", 0.0)), natural)
        for name, body in self._bodies.items():
            self.lost[name] = self.lost.get(name, 0.0) + body.energies(state)[1]

    def checkpoint_data(self) -> dict[str, Any]:
        """Return the values for a checkpoint."""
        return {"lost": dict(self.lost), "energy": self.energy, "count": self.count, "next": self.next}

    def restore(self, kept: dict[str, Any]) -> None:
        """Restore the values of a checkpoint."""
        self.lost, self.energy, self.count, self.next = (kept[k] for k in ("lost", "energy", "count", "next"))

    def warnings(self, state: State) -> list[str]:
        """Return the warnings about the last state, its modes, or the motion that it ends."""
        if not self.looks or self.solver.scales:
            return []
        if self.solver.moves:
            return self._of_motion()
        if isinstance(self.solver, Eigen):
            if self.model.case.steady_rotation is not None:
                return self._of_statics(state)
            at_rest = self.solver.about == "reference"
            return self._of_modes(state) if at_rest else [*self._of_statics(state), *self._of_modes(state)]
        return self._of_statics(state)

    def _of_motion(self) -> list[str]:
        share = sum(self.lost.values()) / (self.count * self.energy) if self.energy else 0.0
        if share <= UNFOLLOWED:
            return []
        return [f"the mesh is too coarse for this motion: it does not resolve waves and bending with {100 * share:.2g} "
                f"% of the energy{self._where(self.lost)}. The error estimate of the time steps does not include this. "
                f"{ADVICE}"]

    def _of_statics(self, state: State) -> list[str]:
        found = {name: body.energies(state) for name, body in self._bodies.items()}
        lost = {name: gap for name, (_, gap) in found.items()}
        n_q = self.model.n_q
        within = sum(max(stored, self._bodies[name].natural(state)) for name, (stored, _) in found.items())
        # plastic and creep strains displace bodies that bear no load
        stored = max(within, 0.5 * abs(float(state.F[:n_q] @ state.d[:n_q])), internal_energy(self.model))
        off = _share(sum(lost.values()), stored)
        if off <= WARN_ABOVE:
            return []
        return [f"the mesh is too coarse: displacements have an error of about {percent(off)}{self._where(lost)}. "
                f"{ADVICE}"]

    def _of_modes(self, state: State) -> list[str]:
        solver, model = self.solver, self.model
        assert isinstance(solver, Eigen)
        if solver.about == "reference":
            model = replace(model, case=replace(model.case, loads=()), loads=LoadSet())
        shapes = _Shapes(model, state)
        off, by_body = {}, dict.fromkeys(shapes.bodies, 0.0)
        for mode, shape in zip(state.report["frequencies"], state.arrays["modes/shapes"][0], strict=True):
            # omega^2 of the undamped mode, if damping affects all of it equally
            squared = mode["omega"]**2 + mode.get("growth", 0.0)**2
            if mode["kind"] not in KINDS or mode["omega"] <= VIBRATES * math.sqrt(squared):
                continue
            share, gaps = shapes.lost(shape, squared)
            if (error := 1.0 / math.sqrt(1.0 - share) - 1.0) > WARN_ABOVE:
                off[f"{mode['kind']} {mode['number']}"] = error
                for name, gap in gaps.items():
                    by_body[name] += gap
        return self._off("modes: frequencies have errors:", off, by_body)

    def of_buckling(self, start: State, u: Array, h: float, factors: Array, shapes: Array) -> list[str]:
        """Return warnings about load factors and their shapes (m, n_q), which have none for loads without a potential.

        ``start``: the state without the loads that the factor scales; u (n_full,) the linear response to them; h the
        factor with which their effect on the motion is differentiated.
        """
        if not self.looks:
            return []
        at = _Shapes(self.model, start, u, h)
        off, by_body = {}, dict.fromkeys(at.bodies, 0.0)
        for k, (factor, shape) in enumerate(zip(factors.tolist(), shapes, strict=True)):
            share, gaps = at.lost(shape, None, factor)
            if (error := 1.0 / (1.0 - share) - 1.0) > WARN_ABOVE_BUCKLING:
                off[f"number {k + 1} ({factor:.6g})"] = error
                for name, gap in gaps.items():
                    by_body[name] += gap
        return self._off("load factors, which are too large:", off, by_body)

    def _off(self, what: str, off: dict[str, float], by_body: dict[str, float]) -> list[str]:
        """Return the warning about inaccurate modes or load factors, with the body that contributes most."""
        if not off:
            return []
        worst = ", ".join(f"{name} by about {percent(error)}" for name, error in list(off.items())[:SHOWN])
        more = f", and {len(off) - SHOWN} more" if len(off) > SHOWN else ""
        return [f"the mesh is too coarse for some of the {what} {worst}{more}{self._where(by_body)}. {ADVICE}"]

    def _where(self, lost: dict[str, float]) -> str:
        """Return ' (most in bodies.rod, 4 elements)' for the body with the largest error, if there are several."""
        name = max(lost, key=lambda k: lost[k])
        return f" (most in bodies.{name}, {self.model.meshes[name].plan.count} elements)" if len(lost) > 1 else ""


class _Shapes:
    """Small motions about a state, or about its linear continuation by the response u to a load factor."""

    def __init__(self, model: Model, state: State, u: Array | None = None, h: float = 0.0) -> None:
        self.model, self.h, self.bodies, self.system = model, h, _bodies(model), System(model)
        turned = model.turns.from_reference(state.d) if state.turned is None else state.turned
        self.system.count_from((state.d, turned))
        base = replace(state, v=None, a=None)
        self.states = [base] if u is None else [
            base, *(replace(base, t=base.t + s, side=base.t + s, d=base.d + s * u) for s in (h, -h))]
        # N (m, k) of each body in these states
        self.tensions = {name: [body.tension(s) for s in self.states] for name, body in self.bodies.items()}

    def lost(self, shape: Array, squared: float | None, factor: float = 0.0) -> tuple[float, dict[str, float]]:
        """Return the share by which the mesh overestimates omega^2 or the load factor, and each body's part of it.

        ``shape`` (n_q,); ``squared`` is omega^2, None if nothing vibrates.
        """
        base, motion = self.states[0], np.zeros(len(self.states[0].d))
        motion[:len(shape)] = shape
        forces = [self.system.action(s.d, motion, s.t, loads=True) for s in self.states]
        a = None if squared is None else -squared * motion
        found = {}
        for name, body in self.bodies.items():
            added = self._followed([body.added(s, motion, Q, a) for s, Q in zip(self.states, forces, strict=True)],
                                   factor)
            N = self._followed(self.tensions[name], factor)
            found[name] = body.motion(base, shape, added, N)
        stored, gap = (sum(pair[k] for pair in found.values()) for k in (0, 1))
        whole = 0.5 * float(motion @ forces[0])
        share = stored * _share(gap, stored) / whole if whole > 0.0 else 0.0
        return min(share, WHOLE), {name: lost / whole for name, (_, lost) in found.items()} if whole > 0.0 else {}

    def _followed(self, values: list[Array], factor: float) -> Array:
        """Return values at a load factor, to first order, from those at the states."""
        return values[0] if len(values) == 1 else values[0] + factor / (2.0 * self.h) * (values[1] - values[2])


def _share(gap: float, stored: float) -> float:
    return gap / (gap + stored) if gap > 0.0 else 0.0
