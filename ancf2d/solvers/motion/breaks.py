"""Starts of a motion: at t = 0 and after breaks of signals, or where moving points pass on to other elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...elements.sliding import OFF
from ...interactions.moving import MovingPatch
from ...kernels.lowlevel.records import Record
from ...kernels.motion.advance import NEAR
from ...kernels.motion.consistent import kinetic, onto_constraints, place_moving_at
from ...kernels.motion.dynamics import forces, signals_at
from ...kernels.motion.state import GRID, LOST, STEP_SIZE, WORK, fill_full
from ...model.breakpoints import Break, MotionPiece, breakpoints
from ...model.model import Model
from ...model.timing import Signal
from ..linear import full_mass, unknowns_to_coordinates

# for each moving point: whether it acts, and its velocity relative to the body
Rates = list[tuple[bool, Array]]


class MovingPoints:
    """The points of a model that move along bodies, in the order of their table.

    ``crossings`` are the times at which a point passes from one element to the next, or onto a body.
    """

    def __init__(self, model: Model, t_end: float) -> None:
        self.model = model
        self.patches = [p for p in model.interactions.points if isinstance(p, MovingPatch)]
        self.crossings = self._crossings(t_end)
        self.times = {b.t for b in self.crossings}

    def __bool__(self) -> bool:
        """Return whether the model has moving points."""
        return bool(self.patches)

    def _crossings(self, t_end: float) -> list[Break]:
        found: dict[Any, list[float]] = {}
        for patch in self.patches:
            course = patch.course
            if isinstance(course, Signal) and (patch.mesh.plan.name, course) not in found:
                ends = [0.0, *(b.t for b in breakpoints(course, 0.0, t_end)), t_end]
                found[patch.mesh.plan.name, course] = patch.crossings(ends)
        return [Break(t, 2, float(np.nextafter(t, -np.inf))) for times in found.values() for t in times]

    def enter(self, p: Record, piece: MotionPiece, acts: Callable[[Any, float], bool]) -> None:
        """Assign each point the element that it is on during a piece of the motion, or OFF.

        ``acts(window, t)`` returns whether a point with this window of activity acts at time t.
        """
        t = 0.5 * (piece.first + piece.stop)
        for j, patch in enumerate(self.patches):
            p.moving.element[j] = m = patch.under(t) if acts(patch.active, t) else OFF
            p.points.on[p.moving.item[j]] = m != OFF

    def rates(self, p: Record, w: Record, s: Record, t: float) -> Rates:
        """Return for each point whether it acts in the motion s at t, and its velocity relative to the body."""
        if not self.patches:
            return []
        place_moving_at(p, w, s.z, s.v, t)
        points = p.points
        return [(bool(points.on[i]), points.drift[points.field[i]:points.field[i] + 2].copy())
                for i in p.moving.item.tolist()]

    def kink_impulse(self, p: Record, w: Record, s: Record, t: float, before: Rates) -> Array:
        """Return the impulse (n,) of masses whose velocities along a body differ from ``before``.

        They differ where the axis has a kink. A mass that comes onto a body moves with it, without an impulse.
        """
        full, points = np.zeros(len(p.place)), p.points
        now = self.rates(p, w, s, t)
        for (acted, old), (acts, new), i, patch in zip(before, now, p.moving.item.tolist(), self.patches, strict=True):
            if acted and acts and patch.mass:
                first, last = points.dof[i], points.dof[i + 1]
                G = points.G[points.entry[i]:points.entry[i + 1]].reshape(last - first, -1)
                np.add.at(full, points.dofs[first:last], patch.mass * (G[:, :2] @ (old - new)))
        out = np.zeros(len(s.z))
        out[:p.inner] = self.model.numbering.reduce(full[:len(self.model.numbering.place)])
        return out


def impulse_of_dependents(motion: Any, v: Array) -> Array:
    """Return T^T M (v - v') on the unknowns of a motion (``stepping.Stepper``) at its initial rates.

    v' (n_full,) are the rates that follow from those of the unknowns: where eliminated coordinates were given other
    rates v, the missing momentum acts on the coordinates that they depend on.
    """
    own, out = np.zeros(len(motion.p.place)), np.zeros(len(motion.s.z))
    signals_at(motion.p, 0.0, motion.w.amps)
    fill_full(motion.p, motion.s.v, motion.w.amps, 1, own)
    missing = (v - own[:len(v)])[:motion.model.n_q]
    if missing.any():
        out[:motion.p.inner] = unknowns_to_coordinates(motion.model).T @ (full_mass(motion.model) @ missing)
    return out


def first_step(motion: Any) -> float:
    """Return a first step in which little changes, by rates, accelerations and damping losses at the start."""
    weights = motion.p.weights
    size = max(float(np.max(weights * np.abs(motion.s.z), initial=0.0)), 1e-3 * motion.p.extent)
    speed, pull = (float(np.max(weights * np.abs(x), initial=0.0)) for x in (motion.s.v, motion.s.a))
    times = [motion.longest_step()]
    times += [size / speed] if speed > 0.0 else []
    times += [(2.0 * size / pull) ** 0.5] if pull > 0.0 else []
    energy = kinetic(motion.p, motion.w, motion.s, motion.t)
    lost = forces(motion.p, motion.w, motion.s.z, motion.s.v)[1]
    times += [energy / lost] if energy > 0.0 and lost > 0.0 else []
    order = motion.method.order if motion.m is None else motion.m.order
    return min(times) * 0.1 * motion.tolerance ** (1.0 / order)


def pass_break(motion: Any, piece: int) -> None:
    """Restart a motion (``stepping.Stepper``) after a break, in the given piece.

    Prescribed rates may jump; the impulse acts on all free coordinates. Its work, the impulse times the mean of the
    rates before and after, equals the gain of kinetic energy.
    """
    p, w, s = motion.p, motion.w, motion.s
    t, given = motion.t, s.v.copy()
    before, after = np.zeros((len(motion.signals), 3)), np.zeros((len(motion.signals), 3))
    signals_at(p, t, before)
    if p.patched:
        onto_constraints(p, w, s.z, s.v, s.a, t, True)
    carried = motion.moving.rates(p, w, s, t)
    # a conserving method keeps the part of its rates that violates the constraints, as between any two steps
    off = given - s.v if motion.method.conserves else np.zeros_like(given)
    s.v[:] += off
    energy = kinetic(p, w, s, t)
    s.v[:] -= off
    acted, before_impact = motion.events.acting(), s.v.copy()
    motion.enter(piece)
    begun = motion.events.hold_engaged(acted)
    signals_at(p, t, after)
    jump = after[:, 1] - before[:, 1]
    impulse = -jump[p.motion_mass_signal] @ p.motion_mass
    kinks = motion.moving.kink_impulse(p, w, s, t, carried)
    sampled = motion.feedback.sample(t)
    motion.consistent(t, impulse + kinks)
    lost = motion.events.record_impulses(begun, before_impact) if begun else 0.0
    s.v[:] += off
    if begun and not len(motion.driving):
        # supports and joints that engage on a moving body cause a plastic impact
        s.numbers[LOST] += energy - kinetic(p, w, s, t)
    elif begun:
        # prescribed motion supplies some of the energy
        s.numbers[LOST] += lost
        s.numbers[WORK] += kinetic(p, w, s, t) - energy + lost
    elif jump[motion.driving].any() or kinks.any():
        s.numbers[WORK] += kinetic(p, w, s, t) - energy
    if motion.dt > 0.0:
        s.numbers[GRID] = np.floor(t / motion.dt + NEAR)
    elif kinks.any() or not (sampled or t in motion.moving.times):
        s.numbers[STEP_SIZE] = min(s.numbers[STEP_SIZE], (1.0 if begun else 10.0) * first_step(motion))
