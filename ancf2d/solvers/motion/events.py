"""Events of a motion: items that start or stop acting at given times or when conditions become true."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from ...case import SWITCHED, Gated, Latch
from ...elements.shape import Array
from ...errors import ComputationError
from ...interactions.moving import MovingPatch
from ...kernels.lowlevel.records import Record
from ...kernels.motion.events import HOLDS, NO_VALUE, NONE, PASSED, WAITING, check_conditions
from ...model.breakpoints import Break, MotionPiece
from ...model.constraints import MOTIONS
from ...model.determinacy import rigid_motion
from ...model.point_patch import PointConstraint, PointPatch
from ...model.points import dot
from ...model.switched import CLOSED, is_off, store_held_values
from ...results.records import EVENT_WORDS
from ..state import Row
from .dense import dense

# a constraint repeats others if less than this share of its gradient is independent of theirs
SAME = 1e-7


class Events:
    """The items that start or stop acting in a motion (``stepping.Stepper``), and the conditions that they wait for.

    Each motion has its own latches. Those of the model, with which Python evaluates loads and springs, are copies
    of the latches of one motion (``copy_latches_to_model``).
    """

    def __init__(self, motion: Any) -> None:
        self.motion, self.model = motion, motion.model
        model, signals = motion.model, motion.signals
        self.conditions = model.feedback.conditions
        self.latches = [copy(latch) for latch in model.latches]
        self._own = {id(latch): own for latch, own in zip(model.latches, self.latches, strict=True)}
        joints = [(-1 - i, c) for i, c in enumerate(model.interactions.joints) if c.active is not None]
        self.timed = [*_timed(model.interactions.points), *((k, c.active) for k, c in joints)]
        self.gates = [("signals", k, s.amplitude.latch) for k, s in enumerate(signals)
                      if isinstance(s.amplitude, Gated) and not s.feedback]
        self.gates += [("feedback", k, a.amplitude.latch) for k, a in enumerate(model.feedback.signals)
                       if isinstance(a.amplitude, Gated)]
        self.cuts: list[float] = []
        self.switched = [(k, c) for k, c in _numbered(model.interactions.points)
                         if isinstance(c, PointConstraint) and c.active is not None]
        # prismatic joints have their own table, and negative numbers here
        self.switched += joints
        # by start of a piece: constraints that repeat others; by name: impulses of supports that engaged
        self.redundant: dict[float, list[int]] = {}
        self.impulses: dict[str, dict[str, float]] = {}
        # prescribed motions that engage later: distance from the prescribed value there, by support and key
        self.offsets: dict[str, dict[str, float]] = {}
        # foot point and distance of prismatic joints that have engaged
        self.feet: dict[int, list[float]] = {}

    def __bool__(self) -> bool:
        """Return whether anything starts or stops acting."""
        return bool(self.timed or self.gates)

    def acts(self, window: Any, t: float) -> bool:
        """Return whether an item with this window acts at t in this motion; a ``window`` of None always acts."""
        own = self._own.get(id(window), window)
        return own is None or bool(own.at(t))

    def breaks(self, t_end: float) -> list[Break]:
        """Return the times in (0, t_end], known in advance, at which something starts or stops acting."""
        patches = (p for p in self.model.interactions.points if isinstance(p, MovingPatch))
        windows = [*(window for _, window in self.timed), *(p.active for p in patches), *self.latches]
        times = {t for window in windows if window is not None for t in window.times if 0.0 < t <= t_end}
        return [Break(t, 0, math.nextafter(t, -math.inf)) for t in times]

    def enter(self, p: Record, piece: MotionPiece) -> None:
        """Switch on the items that act in a piece of the motion, and watch the conditions that may come true in it."""
        t = 0.5 * (piece.first + piece.stop)
        repeated = self.redundant.get(piece.first, [])
        for k, window in self.timed:
            on, i = (p.points.on, k) if k >= 0 else (p.sliding.on, -1 - k)
            on[i] = self.acts(window, t) and k not in repeated
        for i, (*_, gap) in self.feet.items():
            p.sliding.gap[i] = gap
        for which, k, latch in self.gates:
            programs = p.programs if which == "signals" else p.feedback.programs
            programs.data[programs.arg[programs.first[k]]] = float(self.acts(latch, t))
        for k, waiting in enumerate(self.conditions):
            own = self._own.get(id(waiting.latch))
            begun = own is None or waiting.which == "after" or own.begin <= t
            asked = begun and (own is None or own.waiting() == waiting.which)
            p.feedback.watched[k] = WAITING if asked else PASSED

    def copy_latches_to_model(self) -> None:
        """Copy the latches of this motion to the model."""
        for latch, own in zip(self.model.latches, self.latches, strict=True) if self.latches else ():
            latch.begin, latch.end = own.begin, own.end

    # ------------------------------------------------------------------ conditions that become true

    def mark_conditions(self) -> bool:
        """Mark the conditions that hold at the current state, and return whether there are any."""
        if not self.conditions:
            return False
        motion = self.motion
        found = check_conditions(motion.p, motion.w, motion.s.z, motion.s.v, motion.t)
        if found == NO_VALUE:
            motion.feedback.check(0.0)
        return bool(found != NONE)

    def begin(self) -> None:
        """Start and stop the items whose conditions already hold at t = 0.

        Raises ComputationError if ``solver.until`` is one of these.
        """
        while self.mark_conditions():
            self.switch_marked()
            if self.motion.done:
                raise ComputationError("solver.until is already true at t = 0", at={"t": 0.0},
                                       advice="a condition solver.until that is false at t = 0")
            acted = self.acting()
            self.motion.enter(0)
            self.hold_engaged(acted)
            self.motion.consistent(0.0, np.zeros(len(self.motion.s.z)))

    def switch_marked(self, found: Sequence[Row] = ()) -> int:
        """Start and stop at once the items whose conditions are marked; return the piece of the motion that follows.

        States ``found`` until now belong to the piece that ends here, also those whose time is this one to round-off.
        """
        motion, t = self.motion, self.motion.t
        for row in takewhile(lambda row: row.side >= t, reversed(found)):
            row.side = math.nextafter(t, -math.inf)
        marked = [c for k, c in enumerate(self.conditions) if motion.p.feedback.watched[k] == HOLDS]
        for waiting in marked:
            own = self._own.get(id(waiting.latch))
            if own is None:
                motion.spec = replace(motion.spec, t_end=t)
            elif waiting.which == "after":
                own.begin = t
            else:
                own.end = t
        i, pieces = motion.piece, motion.pieces
        if motion.done:
            pieces[i:] = [pieces[i]._replace(stop=t)]
            return i
        if t >= pieces[i].stop:
            return i + 1
        return i + 1 if self.cut(i, t) else i

    def cut(self, i: int, t: float) -> bool:
        """Cut a piece of the motion in two at t, unless it begins there; return whether it was cut."""
        piece, pieces = self.motion.pieces[i], self.motion.pieces
        if t <= piece.first:
            return False
        pieces[i:i + 1] = [MotionPiece(piece.first, math.nextafter(t, -math.inf), t),
                           MotionPiece(t, piece.last, piece.stop)]
        self.cuts.append(t)
        return True

    # ------------------------------------------------------------------ supports and joints

    def acting(self) -> set[int]:
        """Return the numbers of the switched supports and joints that act."""
        return {k for k, _ in self.switched if self._is_on(k)}

    def _is_on(self, k: int) -> bool:
        p = self.motion.p
        return bool(p.points.on[k] if k >= 0 else p.sliding.on[-1 - k])

    def hold_engaged(self, acted: set[int]) -> list[PointConstraint]:
        """Let supports and joints that engage (not in ``acted``) hold the current positions; return their constraints.

        Raises ComputationError for a joint that engages while its points are apart.
        """
        if not self.switched:
            return []
        motion = self.motion
        d = motion.full(motion.current_row())[0]
        found = [(k, c) for k, c in self.switched if k not in acted and self._is_on(k)]
        supports = {name for name, _ in self.model.supports}
        for k, c in found:
            foot, gap = self.model.interactions.joints[-1 - k].nearest_foot(d) if k < 0 else (None, 0.0)
            off = abs(gap) / self.model.extent if k < 0 else 0.0 if c.owner in supports else is_off(c, d)
            if off > CLOSED:
                apart = f"{c.holds} is violated by {off:.3g}" if off < math.inf else "one is beyond the end of its axis"
                raise ComputationError(f"{c.owner} begins while its points are apart: {apart}", at={"t": motion.t},
                                       advice="a condition that becomes true where the points meet, or a "
                                       "spring instead")
            if k < 0:
                self._set_foot(-1 - k, foot, gap)
                continue
            store_held_values(c, d, motion.t)
            motion.p.points.mem[k, :len(c.mem)] = c.mem
            self._note_offset(c)
        self._switch_off_redundant(d)
        return [c for k, c in found if self._is_on(k)]

    def _set_foot(self, i: int, foot: Any, gap: float) -> None:
        """Set the foot point and the distance from the axis at which a prismatic joint holds its point."""
        for table in (self.motion.p.sliding, self.model.interactions.sliding):
            table.memory[i], table.gap[i] = foot, gap
        self.feet[i] = [*map(float, foot), gap]

    def _note_offset(self, c: PointConstraint) -> None:
        """Store the distance of a newly engaged prescribed motion from its prescribed value."""
        if c.signal is not None:
            self.offsets.setdefault(c.owner, {})[MOTIONS[c.holds]] = float(c.mem[0])

    def _switch_off_redundant(self, d: Array) -> None:
        """Switch off constraints that others already imply at d (n_full,): their multipliers would be indeterminate.

        Of those that imply each other, the one with the largest gradient stays: a support along a rigid bar that turns
        would need huge forces.
        """
        motion = self.motion
        piece = motion.pieces[motion.piece]
        self.redundant.pop(piece.first, None)
        motion.enter(motion.piece)
        own = {c.multiplier: k for k, c in self.switched}
        rows = self._rows(d, {c.multiplier for k, c in self.switched if not self._is_on(k)})
        least = {m: SAME * max(float(np.linalg.norm(row)), np.finfo(float).tiny) for m, row in rows.items()}
        repeated: list[int] = []
        while rows:
            rest = {m: float(np.linalg.norm(row)) for m, row in rows.items()}
            best = max(rows, key=lambda m: (m not in own, rest[m] > least[m], rest[m]))
            row = rows.pop(best)
            if rest[best] > least[best]:
                row = row / rest[best]
                rows = {m: other - (row @ other) * row for m, other in rows.items()}
            elif best in own:
                repeated.append(own[best])
        if repeated:
            self.redundant[piece.first] = sorted(repeated)
            motion.enter(motion.piece)

    def _rows(self, d: Array, off: set[int]) -> dict[int, Array]:
        """Return the gradients (n,) at d (n_full,) by displacements of the unknowns, for multipliers not ``off``."""
        motion, model = self.motion, self.model
        weights = motion.p.weights[:motion.p.inner]
        one = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0.0)
        found = {}
        for multiplier, (coords, slopes) in self._gradients(d).items():
            if multiplier not in off:
                full = np.zeros(len(model.numbering.place))
                np.add.at(full, coords, slopes)
                found[multiplier] = model.numbering.reduce(full) * one
        return found

    def _gradients(self, d: Array) -> dict[int, tuple[Any, Array]]:
        """Return coordinates and gradient at d (n_full,) of each constraint, by its multiplier."""
        self.update_model(self.motion.p.points.mem)
        t, out = max(self.motion.t, self.motion.pieces[self.motion.piece].first), {}
        d = d.copy()
        d[self.model.n_q:] = 1.0
        for _, Q, _, dofs in self.model.interactions.constraints(d, t):
            for q, coords in zip(Q, dofs, strict=True):
                out[int(coords[-1])] = coords[:-1], q[:-1]
        return out

    def update_model(self, mem: Array) -> None:
        """Copy the latches of this motion and the values that its supports hold to the model."""
        self.copy_latches_to_model()
        for k, c in self.switched:
            if k >= 0:
                c.mem[:] = mem[k, :len(c.mem)]

    def record_impulses(self, begun: list[PointConstraint], before: Array) -> float:
        """Store the impulses of supports that engaged, from the rates ``before`` (n,) and those of the motion now.

        Return the lost energy, the kinetic energy of the change of rates, also if the engaged support moves.
        """
        motion, model = self.motion, self.model
        p, s, A = motion.p, motion.s, dense(motion.w.A, motion.p)
        free, held = (np.flatnonzero(p.coordinate[:p.inner] == x) for x in (1.0, 0.0))
        impulse = np.zeros(len(p.coordinate))
        jump = (s.v - before)[free]
        momentum = A[np.ix_(free, free)] @ jump
        impulse[held] = np.linalg.lstsq(A[np.ix_(held, free)].T, momentum)[0]
        d = motion.full(motion.current_row())[0]
        e, gradients = model.e0 + d[:model.n_q], self._gradients(d)
        points = dict(model.supports)
        for name in dict.fromkeys(c.owner for c in begun if c.owner in points):
            centre = np.array([dot(c, e) for c in points[name].position()])
            total = np.zeros(3)
            for c in (c for c in begun if c.owner == name):
                coords, slopes = gradients[c.multiplier]
                total += impulse[model.numbering.place[c.multiplier]] * slopes @ rigid_motion(
                    points[name].mesh, coords, e, centre)
            self.impulses[name] = dict(zip(("fx", "fy", "m"), total.tolist(), strict=True))
        return 0.5 * float(jump @ momentum)

    # ------------------------------------------------------------------ report and checkpoint

    def report(self) -> list[dict[str, Any]] | None:
        """Return the events in order of time, by the names of the items in the case; None if the case asks for none."""
        out: list[dict[str, Any]] = []
        names = [name for name, _ in self.model.supports]
        case, t_end = self.model.case, self.motion.spec.t_end
        items = (item for section in SWITCHED for item in getattr(case, section))
        if case.solver.until is None and all(getattr(item, "active", None) is None for item in items):
            return None
        for section in SWITCHED:
            for k, item in enumerate(getattr(case, section)):
                active = getattr(item, "active", None)
                window = self._own.get(id(self.model.timing.window(active)), active)
                begin, end = (math.inf, math.inf) if window is None else window.times
                happened = [begin, end] if begin < min(end, t_end) or begin == end else []
                for t, what in zip(happened, EVENT_WORDS, strict=False):
                    if (t > 0.0 or (t == 0.0 and isinstance(window, Latch))) and t <= t_end:
                        out.append({"t": t, "what": f"{item.name or f'{section}.{k}'} {what}"})
                        if section == SWITCHED[0] and what == EVENT_WORDS[0] and names[k] in self.impulses:
                            out[-1]["impulse"] = self.impulses[names[k]]
                        if section == SWITCHED[0] and what == EVENT_WORDS[0] and names[k] in self.offsets:
                            out[-1]["offset"] = self.offsets[names[k]]
        out.sort(key=lambda event: event["t"])
        if t_end < case.solver.t_end:
            out.append({"t": t_end, "what": f"the motion ends: {case.solver.until}"})
        return out

    def checkpoint(self) -> dict[str, Array]:
        """Return the arrays for a checkpoint."""
        saved = [self.impulses, self.offsets, [*self.feet.items()],
                [[first, *places] for first, places in self.redundant.items()]]
        return {"latched": np.array([latch.times for latch in self.latches]).reshape(-1, 2),
                "cuts": np.array(self.cuts), "held": np.frombuffer(json.dumps(saved).encode(), dtype=np.uint8)}

    def resume(self, checkpoint: dict[str, Array]) -> None:
        """Restore the events from a checkpoint."""
        for latch, (begin, end) in zip(self.latches, checkpoint["latched"].reshape(-1, 2).tolist(), strict=True):
            latch.begin, latch.end = begin, end
        self.impulses, self.offsets, feet, repeated = json.loads(checkpoint["held"].tobytes())
        for i, (ie, z, gap) in feet:
            self._set_foot(i, np.array([ie, z]), gap)
        self.redundant = {first: places for first, *places in repeated}
        pieces = self.motion.pieces
        for t in checkpoint["cuts"].tolist():
            self.cut(next(i for i, piece in enumerate(pieces) if t < piece.stop), t)


def _timed(patches: Iterable[Any]) -> list[tuple[int, Any]]:
    """Return the places among the point laws of the patches that start or stop acting, and their windows."""
    return [(k, patch.active) for k, patch in _numbered(patches)
            if isinstance(patch, PointPatch) and patch.active is not None]


def _numbered(patches: Iterable[Any]) -> list[tuple[int, Any]]:
    """Return the place of each patch among the point laws, and the patch."""
    out, at = [], 0
    for patch in patches:
        out.append((at, patch))
        at += len(patch.items().p0)
    return out
