"""One motion stepped through time in compiled chunks, from break to break, with its stored states."""

from __future__ import annotations

import time
from functools import cached_property

import numpy as np

from ...case import Dynamic
from ...elements.shape import Array
from ...errors import ComputationError
from ...kernels.lowlevel.records import Record
from ...kernels.motion import advance as kernels
from ...kernels.motion.consistent import consistent
from ...kernels.motion.dynamics import signals_at
from ...kernels.motion.impact import consistent_start
from ...kernels.motion.many_states import AS_IS, FORCES_ALONE, POSITIONS, RATES
from ...kernels.motion.state import (
    LOST,
    SIZE,
    STEP_SIZE,
    TIME,
    WORK,
    Motion,
    count_turns,
    fill_full,
    motion,
    scratch,
)
from ...model.breakpoints import MotionPiece, motion_pieces, piece_at
from ...model.model import Model
from ...model.point_patch import PointConstraint
from ...model.timing import Signal
from ..least_motion import least_size
from ..state import MEMORIES, Row, with_rows
from .breaks import MovingPoints, first_step, impulse_of_dependents, pass_break
from .events import Events
from .failures import check_signals, cut_off, failure, fastest
from .feedback import MotionFeedback
from .impacts import COLUMNS, Impacts
from .initial import continues_from_file
from .integrators import INTEGRATORS, default_method
from .near_elements import Layout, read, repeated
from .own_integrators import MAKERS, Method, newton_tolerance
from .problem import driving_signals, tracks_work, with_own_tables

# approximate duration of a call of the kernels [s], for progress bars and interrupts
CHUNK_SECONDS = 0.2
LOG_ROWS = 4096
STATE_BYTES = 16 << 20
LOG = ("step", "t", "dt", "iterations", "rejected", "error", "violation")


class Stepper:
    """A motion in progress. ``dt`` 0: adaptive steps under ``tolerance``; ``wanted``: times of states."""

    looks_ahead = True  # whether adaptive steps start with the size of the motion given to ``set_size``
    keeps_checks = True  # whether states between the wanted ones are stored for the energy balance
    reads_forces = True  # whether forces and energies of stored states are computed at once, or displacements alone

    def __init__(self, model: Model, problem: Record, signals: list[Signal], spec: Dynamic, dt: float,
                 wanted: Array, every: int = 0, follows: bool = False) -> None:
        """``follows``: the entries of matrices change when bodies come near each other."""
        self.model, self.signals, self.spec = model, signals, spec
        self.problem, self.p = problem, with_own_tables(problem, model)
        n = len(problem.coordinate)
        self.w = Record(scratch(n, len(problem.place), len(problem.mass), len(signals)))
        self.method = INTEGRATORS[spec.method or default_method(model)]
        self.tolerance = spec.tolerance or 0.0
        # in steps with contact without a law, where rates jump, interpolated states have more energy than both ends
        self.tracks_work, self.ends_at_states = tracks_work(model), bool(self.p.sided)
        self.m: Method | None = None  # None for SciPy's methods
        self.newton_tolerance = newton_tolerance(self.method, self.tolerance)
        if self.method.name in MAKERS:
            self.tighten(self.newton_tolerance)
        remembered = 0 if self.m is None else self.m.remembered
        self.s = Record(motion(n, self.method.rows, len(self.p.turning.length), remembered))
        self.s.numbers[STEP_SIZE] = self.dt = dt
        self.wanted, self.every, self.next_wanted = wanted, every, 0
        self.layout = Layout(self) if follows and model.numbering.couplings is not None else None
        self.moving, self.feedback, feedback = MovingPoints(model, spec.t_end), MotionFeedback(self), model.feedback
        self.events, self.impacts = Events(self), Impacts(model)
        ends = self.events.breaks(spec.t_end)
        self.moving.times -= {b.t for b in ends}
        self.pieces = motion_pieces([*signals, *feedback.switches], spec.t_end,
                                    [*self.moving.crossings, *ends, *feedback.instants(spec.t_end)])
        self.enter(0)
        self.pending: Array = np.zeros((0, len(LOG)))
        self.rows = self._rows(n)
        self.steps = 64
        self.failed: ComputationError | None = None
        self._plan: Record | None = None
        self._at = Record(motion(n, 0, len(self.p.turning.length)))
        # projection of states inside and at the ends of steps; rates of conserving methods are not projected
        free = bool(self.p.coordinate.all())
        self.projection_inside, self.projection_at_ends = AS_IS if free else POSITIONS, AS_IS if free else RATES
        if self.method.conserves:
            self.projection_at_ends = FORCES_ALONE
        self.driving = np.array(driving_signals(problem), dtype=np.int64)
        self.facing = [c for c in model.constraints if isinstance(c, PointConstraint) and c.facing is not None]

    @cached_property
    def evaluation_problem(self) -> Record:
        """The problem with which stored states are evaluated: one of its own if these differ in more than z, v, a."""
        feedback = self.model.feedback
        differ = len(self.pieces) > 1 or self.p.patched or len(self.p.states) or feedback.rank or feedback.conditions
        return with_own_tables(self.problem, self.model) if differ else self.p

    def tighten(self, tolerance: float) -> None:
        """Set the tolerance of Newton's increments, relative to the size of the motion."""
        self.newton_tolerance = tolerance
        self.m = Method(self.method.name, self.spec, self.p, tolerance, self.model.relaxing, self.tracks_work)

    def use_problem(self, p: Record) -> None:
        """Go on with a problem whose matrices have other entries."""
        self.p, self.w = p, self.w.replaced(A=np.zeros(len(p.mass)))
        if self.m is not None:
            self.tighten(self.newton_tolerance)

    def _rows(self, n: int) -> Record:
        m = int(min(max(STATE_BYTES // (24 * max(n, 1)), 2), max(len(self.wanted), 2) if not self.every else LOG_ROWS))
        number, kind = np.zeros(m, dtype=np.int64), np.zeros(m, dtype=np.int64)
        z, v, a = (np.zeros((m, n)) for _ in range(3))
        turns, feet, states = (np.zeros((m, *x.shape)) for x in self._memory())
        turned = np.zeros((m, len(self.p.turning.length)))
        return Record(kernels.Rows(self.wanted, self.every, np.zeros(m), number, kind, z, v, a, np.zeros((m, 2)), turns,
                                   feet, states, turned, np.zeros((LOG_ROWS, len(LOG) + COLUMNS))))

    def _memory(self) -> tuple[Array, Array, Array]:
        """Return the history variables of point laws, prismatic joints and elements at the last accepted state."""
        return self.p.points.mem, self.p.sliding.memory, self.p.states

    @property
    def t(self) -> float:
        """The time reached."""
        return float(self.s.numbers[TIME])

    @property
    def done(self) -> bool:
        """Return whether the end has been reached without a failure."""
        return self.t >= self.spec.t_end and self.failed is None

    def start(self, d: Array, v: Array, turned: Array) -> None:
        """Start at full coordinates d with rates v, projected onto the motions that supports and joints allow.

        ``turned`` (bodies,) is that of ``model.rotation.Turns``.
        """
        self._begin_from(d, v, turned)
        self.s.numbers[SIZE] = least_size(self.model, self.tolerance if self.dt == 0.0 else 0.0)
        self.feedback.set_weights()
        if self.dt == 0.0:
            self.s.numbers[STEP_SIZE] = first_step(self)

    def _begin_from(self, d: Array, v: Array, turned: Array) -> None:
        self._place(d, v, turned)
        if self.layout is not None:
            self.layout.follow()
        given = self.s.v.copy()
        self.events.hold_engaged(self.events.acting())
        self.consistent(0.0, impulse_of_dependents(self, v))
        self.feedback.begin()
        self.events.begin()
        if self.method.conserves and continues_from_file(self.model):
            # rates that conserve the energy satisfy constraints only in the mean of steps
            self.s.v[:] = given * self.p.coordinate

    def _place(self, d: Array, v: Array, turned: Array) -> None:
        model, n_q = self.model, self.model.n_q
        inner = self.p.inner
        self.s.z[:inner], self.s.v[:inner] = d[self.p.full[:inner]], v[self.p.full[:inner]]
        self.feedback.count_angles(self.p, d, turned)
        self.p.states[:] = model.states
        self.s.turned[0] = turned[model.turns.counted]
        model.turns.set_spring_angles(model.springs, model.e0 + d[:n_q], d[:n_q], turned)
        model.interactions.set_friction_anchors(d, 0.0)
        for rows, mem in model.interactions.memory:
            self.p.points.mem[rows, :mem.shape[1]] = mem

    def consistent(self, t: float, impulse: Array) -> None:
        make = consistent_start if self.p.sided else consistent
        if not repeated(self, lambda: make(self.p, self.w, self.s.z, self.s.v, self.s.a, t, impulse)):
            raise ComputationError(
                "the mass matrix is singular, or joints hold the same motion twice", at={"t": t},
                advice="give every body a density (rhoI too if the section is given by stiffnesses); remove joints "
                "that hold the same motion twice")
        if not (np.isfinite(self.s.a).all() and np.isfinite(self.s.z).all()):
            check_signals(self, t)
            raise ComputationError("the accelerations are not finite", at={"t": t},
                                   advice="check loads, masses and stiffnesses for extreme values")
        self.s.turned[:] = self.turns_on(t, 0.0, self.s.z, self.s.v)
        self._restart()

    def turns_on(self, t: float, h: float, z: Array, v: Array) -> Array:
        """Return counted rotations and rates (2, sections) at z, v and t, a time h after the current state."""
        out, d, rates = self.s.turned.copy(), np.zeros(len(self.p.place)), np.zeros(len(self.p.place))
        signals_at(self.p, t, self.w.amps)
        fill_full(self.p, z, self.w.amps, 0, d)
        fill_full(self.p, v, self.w.amps, 1, rates)
        count_turns(self.p.turning, d, rates, h, *out)
        return out

    def longest_step(self) -> float:
        """Return the longest step allowed."""
        return self.spec.t_end / (50.0 if len(self.pieces) > 1 or self.tracks_work else 10.0)

    def _restart(self) -> None:
        """Restart the method from the current state."""
        if self.m is not None:
            self.m.restart(self.s)

    def set_size(self, size: float) -> None:
        """Set the displacement [m] that local errors of adaptive steps are relative to, at least."""
        self.s.numbers[SIZE] = max(size, least_size(self.model, self.tolerance))
        self.feedback.set_weights()
        self.s.numbers[STEP_SIZE] = first_step(self)

    @property
    def size(self) -> float:
        """The displacement [m] that local errors are relative to."""
        return float(self.s.numbers[SIZE])

    @property
    def largest_displacement(self) -> float:
        """The displacement [m] at the time reached, the largest of all coordinates."""
        inner = self.p.inner
        return float(np.max(self.p.weights[:inner] * np.abs(self.s.z[:inner]), initial=0.0))

    def run(self, most: float = np.inf) -> list[Row]:
        """Step for about a fifth of a second, at most so many steps; return the states stored meanwhile.

        Raises ComputationError if the motion cannot go on, once the states before have been returned.
        """
        if self.failed is not None:
            raise self.failed
        found: list[Row] = []
        try:
            self._go(found, most)
        except ComputationError as error:
            self.failed = error
        cut_off(self, found)
        if self.failed is not None and not found:
            raise self.failed
        return found

    def _go(self, found: list[Row], most: float) -> None:
        """Make the steps of ``run`` and append the states."""
        started = time.perf_counter()
        while not self.done and most > 0:
            began = time.perf_counter()
            why, logged = self.advance(found, int(min(self.steps, most)))
            most -= logged
            if logged > 0:  # adapt the duration of the next call; results do not depend on it
                steps = CHUNK_SECONDS * logged / max(time.perf_counter() - began, 1e-6)
                self.steps = int(min(max(steps, 1), 4 * self.steps, LOG_ROWS))
            if why == kernels.MISSED and self.layout is not None:
                self.layout.follow()
            elif why == kernels.EVENT:
                following = self.events.switch_marked(found)
                if not self.done:
                    pass_break(self, following)
            elif self.at_break(why):
                pass_break(self, self.piece + 1)
            if found and time.perf_counter() - started > CHUNK_SECONDS:
                break

    def advance(self, found: list[Row], steps: int) -> tuple[int, int]:
        """Make at most so many steps and append the states; return why the kernel stopped, and the number of steps.

        Raises ComputationError if a step fails.
        """
        assert self.m is not None
        stop, end = self.pieces[self.piece].stop, self.spec.t_end
        plan = kernels.StepPlan(0.0, stop, self.dt, self.tolerance, 1e-13 * end, self.longest_step(), fastest(self),
                            self.tracks_work, self.ends_at_states, self.keeps_checks)
        self._plan = self._plan if self._plan is not None and self._plan.values == plan else Record(plan)
        why, stored, logged, outcome, _ = kernels.advance(
            self.m.record, self.p, self.w, self.s, self._at, self._plan, self.rows, self.next_wanted, steps)
        self._collect(found, stored, logged)
        if why == kernels.FAILED:
            raise failure(self, outcome)
        return why, logged

    def at_break(self, why: int) -> bool:
        """Return whether the motion has reached the end of a piece that is not the last."""
        return why == kernels.REACHED and self.pieces[self.piece].stop < self.spec.t_end

    def _collect(self, found: list[Row], stored: int, logged: int) -> None:
        """Append the states of a call, each with the log of the steps up to it."""
        log, first, rows, piece = self.impacts.take(self.rows.log[:logged]), 0, [], self.pieces[self.piece]
        log = with_rows(self.pending, log)
        t, number, kind, z, v, a, work, *memory = (x[:stored].copy() for x in self.rows.values[2:-1])
        side = np.clip(t, piece.first, piece.last)
        for k, end in enumerate((len(self.pending) + number + 1).tolist()):
            last = first if kind[k] == kernels.CHECK else max(min(end, len(log)), first)
            rows.append(Row(float(t[k]), float(side[k]), int(kind[k]), z[k], v[k], a[k], *work[k].tolist(),
                            *(x[k] for x in memory), log[first:last].copy()))  # type: ignore[call-arg]
            first = last
        if rows and not self.feedback.counts_angles:
            self._switch_items(self.evaluation_problem, piece)
            self._read(self.reads_forces, rows, side, kind, z, v, a, *memory[:3])
        found += rows
        self.pending = log[first:].copy() if first else log
        self.next_wanted += 0 if self.every else int(np.count_nonzero(kind != kernels.CHECK))

    def _read(self, every: bool, rows: list[Row], side: Array, kind: Array, *columns: Array) -> None:
        """Add full coordinates to stored states, with forces and energies if ``every``, else displacements alone.

        Columns are z, v, a and history variables. Projected states keep the z, v and a of their step, which derivatives
        need.
        """
        energy, full = np.zeros((len(rows), 2)), np.zeros((4 if every else 1, len(rows), len(self.p.place)))
        onto = np.where(kind == kernels.INSIDE, self.projection_inside, self.projection_at_ends)
        if onto.any():
            columns = *(x.copy() for x in columns[:3]), *columns[3:]
        read(self, every, side, onto, columns, (*(full if every else [full[0]] * 4), energy))
        for row, one, *found in zip(rows, energy, *full[..., :len(self.model.numbering.place)], strict=True):
            row.full, row.energy = tuple(found), (float(one[0]), float(one[1]))

    def enter(self, piece: int) -> None:
        """Switch signals and active items to a piece of the motion."""
        self.piece = piece
        self.p.programs.window[:] = self.pieces[piece][:2]
        self._switch_items(self.p, self.pieces[piece])

    def _switch_items(self, p: Record, piece: MotionPiece) -> None:
        """Switch on the items that act in a piece of the motion, and place moving points."""
        self.events.enter(p, piece)
        self.moving.enter(p, piece, self.events.acts)

    def _row(self, t: float, kind: int, z: Array, v: Array, a: Array, work: Array, turned: Array, log: Array) -> Row:
        """Return a state in the current piece of the motion, with the present history variables."""
        first, last, _ = self.pieces[self.piece]
        turns, feet, states = self._memory()
        return Row(t, min(max(t, first), last), kind, z.copy(), v.copy(), a.copy(), float(work[0]), float(work[1]),
                   turns.copy(), feet.copy(), states.copy(), turned.copy(), log)

    def current_row(self) -> Row:
        """Return the state at the time reached."""
        s = self.s
        return self._row(self.t, kernels.END, s.z, s.v, s.a, s.numbers[[WORK, LOST]], s.turned[0], self.pending)

    def last(self) -> Row:
        """Return the state at the time reached, with the rest of the log."""
        row, self.pending = self.current_row(), self.pending[:0].copy()
        return row

    def full(self, row: Row, orders: int = 3) -> list[Array]:
        """Return d, v, a (n_full,) of a stored state, or only the first ``orders``, projected onto the constraints."""
        return list((row if len(row.full) >= orders else self.completed(row)).full[:orders])

    def forces(self, row: Row) -> Array:
        """Return Q - F (n_full,) of a stored state: all forces, damping and multipliers included, less dead loads."""
        return self.completed(row).full[3]

    def completed(self, row: Row) -> Row:
        """Return a stored state with its full coordinates, forces and energies filled in."""
        if len(row.full) < 4:
            self.problem_at(row)
            self._read(True, [row], np.array([row.side]), np.array([row.kind]),
                       *(x[None] for x in (row.z, row.v, row.a, row.turns, row.feet, row.states)))
        return row

    def problem_at(self, row: Row) -> Record:
        """Return the problem with the history variables of a stored state."""
        self.evaluation_problem.points.mem[:] = row.turns
        self.evaluation_problem.sliding.memory[:] = row.feet
        self.evaluation_problem.states[:] = row.states
        if self.moving or self.events:
            self._switch_items(self.evaluation_problem, piece_at(self.pieces, row.side))
        self.feedback.recall_angles(self.evaluation_problem, row)
        return self.evaluation_problem

    # ------------------------------------------------------------------ checkpoints

    def checkpoint(self) -> dict[str, Array] | None:
        """Return everything that the motion needs to go on."""
        out = {name: np.array(value) for name, value in zip(Motion._fields, self.s.values, strict=True)}
        out |= {"log": np.array(self.pending), "places": np.array([self.next_wanted, self.piece, self.every]),
                "dt": np.array([self.dt, self.tolerance])}
        out |= {"sizes": self.p.feedback.scale.copy(), **self.events.checkpoint(), **self.impacts.kept()}
        out["layout"] = np.zeros(0) if self.layout is None else self.layout.checkpoint()
        return out | dict(zip(MEMORIES, (x.copy() for x in self._memory()), strict=True))

    def resume(self, checkpoint: dict[str, Array]) -> None:
        """Restore the motion from a checkpoint."""
        for name, value in zip(Motion._fields, self.s.values, strict=True):
            value[:] = checkpoint[name]
        if self.layout is not None:
            self.layout.resume(checkpoint["layout"])
        self.pending = checkpoint["log"].reshape(-1, len(LOG)).copy()
        self.next_wanted = int(checkpoint["places"][0])
        self.events.resume(checkpoint)
        self.impacts.resume(checkpoint)
        self.enter(int(checkpoint["places"][1]))
        for values, name in zip(self._memory(), MEMORIES, strict=True):
            values[:] = checkpoint[name]
        self.feedback.resume(checkpoint["sizes"])
