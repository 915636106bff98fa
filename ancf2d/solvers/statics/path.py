"""Equilibrium paths through limit points: arc length and displacement control."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from ...case import Static
from ...case.schema.solvers import LARGEST_STEP
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..active_set import check_supports, overlap
from ..contact import check_crossed, check_pressed_through, memory, restore_memory
from ..state import State
from ..system import System
from .continuation import Curve, Found, PathPoint
from .newton import MAX_ITERATIONS, POOR, TOLERANCE, inexact, too_deep
from .one_sided import one_sided, share_without_switching
from .path_events import (
    PathLog,
    ProbeGoal,
    corner_between,
    goal_between,
    goal_of,
    hides_limit_points,
    limit_between,
    others_act,
)
from .path_steps import ArcSteps, ProbeSteps, Steps, leave
from .static import unscaled

MOST_STEPS = 1000
# number of iterations that a step should take
WANTED = 6
# the path may turn by 45 degrees in a step, in the metric of the path, unless other points press or other springs act:
# there it may have a kink, and the inertia shows which way the load factor goes after it
LARGEST_TURN = np.cos(np.pi / 4)
# and by 120 degrees at a corner; if it turns more, it goes back
AT_CORNER = -0.5
# a change of inertia is bracketed to this share of the path before it counts as a bifurcation
CORNERED = 1e-4
# share of the way to a corner after which a step ends
UP_TO = 0.999
# possible pairs of limit points within a step are searched for down to this share of it
CLOSEST_PAIR = 2.0**-8
# limits at which the path is given up: cuts of one step, and its length as a share of the path
MOST_CUTS = 40
SMALLEST = 1e-9

Event = tuple[PathPoint, Literal["step", "limit", "end"]]


class Follower:
    """Follows a path from point to point and reports limit points, bifurcations and its end."""

    def __init__(self, model: Model, spec: Static) -> None:
        self.model, self.spec = model, spec
        self.curve = Curve(System(model, fixed=True), spec.tolerance or TOLERANCE,
                           spec.max_iterations or MAX_ITERATIONS)
        self.goal = goal_of(model, spec.until)
        self.count = getattr(spec.until, "count", None)
        self.controlled = spec.method == "displacement"
        shorter = max(LARGEST_STEP / (spec.largest_step or LARGEST_STEP), 1.0)
        # equal steps may be divided, so more are allowed than asked for
        self.most = MOST_STEPS + (spec.steps or 0) if self.controlled else spec.steps or math.ceil(shorter * MOST_STEPS)
        # whether fibres yield or follow a curve
        self.bends = any(material.fibres for body in model.case.bodies.values() for material in body.materials)
        self.log = PathLog(model)
        self.steps: Steps
        self.number = self.cuts = 0
        # whether the path has not yet left on the wanted branch
        self.branches = spec.branch is not None
        # where (s) a change of inertia was seen, and the step to go on with after it
        self.suspect, self.resume = 0.0, 0.0

    def states(self) -> Iterator[State]:
        """Yield the states of the path, including limit points; the last one is the end of the path."""
        begin, before = self._begin()
        if before is not None:
            yield before
        if self.goal is not None and self.goal.distance(begin.d, begin.t) == 0.0:
            if before is None:
                yield self._state(self._resting(begin), "end", [])
            return
        if self.controlled and isinstance(self.goal, ProbeGoal):
            self.steps = ProbeSteps(self.curve, self.goal, begin, self.spec.steps)
        else:
            self.steps = ArcSteps(self.curve, self.goal, begin, self.spec.largest_step)
        a, h = self.steps.start, self.steps.first()
        while True:
            if self.number >= self.most:
                raise self._too_long(a)
            b, events, warnings = self._next(a, h)
            if self.branches and self._at_branch(a, b):
                b, events, warnings = self._leave(a, b)
            for point, kind in events:
                state = self._state(point, kind, warnings)
                yield state
                if state.last:
                    return
                warnings = []
            h = self._after(b, b.s - a.s, self._inertia_differs(a, b)) * self.steps.renew(b)
            h = min(h, self.steps.largest(b))
            self._settle(b.d, b.t)
            # with the anchors of friction there
            a = replace(b, touching=memory(self.model))

    def _begin(self) -> tuple[Found, State | None]:
        """Return the equilibrium at factor 0, and its state if constant loads move the model from the reference."""
        model = self.model
        try:
            states = list(unscaled(model, self.spec.tolerance, self.spec.max_iterations))
        except ComputationError as error:
            f = error.failure
            raise ComputationError(f"under the constant loads alone {f.reason}", at=f.at, history=f.history,
                                   advice=f.advice) from error
        if not states:
            d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
            self.curve.system.accept(d, 0.0)
            return Found(d, 0.0, 0, 0.0, 0.0), None
        state = states[-1]
        state.t = 0.0
        state.history.update(step=0, factor=0.0)
        state.report = self.log.report()
        self.log.observe(state, False)
        self._settle(state.d, 0.0, state.turned)
        if self.goal is not None:
            state.last = self.goal.distance(state.d, 0.0) == 0.0
        return Found(state.d, 0.0, 0, 0.0, 0.0), state

    def _settle(self, d: Array, t: float, turned: Array | None = None) -> None:
        """Accept an equilibrium: update history variables and count turns from it."""
        check_pressed_through(self.model, d, {"factor": float(f"{t:.6g}")})
        self.curve.system.accept(d, t)
        turned = self.curve.system.count(d, t) if turned is None else turned
        self.curve.turns = d, turned
        if self.goal is not None:
            self.goal.settle(d, turned)

    def _resting(self, begin: Found) -> PathPoint:
        """Return the start of a path that ends there."""
        balance = self.curve.system.forces(begin.d, begin.t)
        return PathPoint(begin.d, begin.t, 0.0, np.zeros(self.model.numbering.n_unknowns), 0.0, 0, balance, 0, 0.0, 0.0,
                         memory(self.model), [])

    def _next(self, a: PathPoint, h: float) -> tuple[PathPoint, list[Event], list[str]]:
        """Return the next point, the events up to it in order, and warnings. Failed or doubtful steps are cut."""
        self.cuts, longest = 0, h
        while True:
            try:
                b = self._advance(a, h)
                if before := self._leg(a, b):
                    b = self._advance(a, before)
                if not self._doubtful(a, b, longest):
                    events = self._events(a, b)
                    differs = self._inertia_differs(a, b)
                    return b, events, [self.log.branch(a, b, self._plain(a))] if differs else []
                trouble = ComputationError("the path cannot be resolved by any step length",
                                           at={"factor": float(f"{b.t:.6g}")})
            except ComputationError as error:
                trouble = error
            h, self.cuts = 0.5 * h, self.cuts + 1
            if self.cuts > MOST_CUTS or h < SMALLEST * a.s:
                raise self._stuck(trouble, a) from trouble

    def _advance(self, a: PathPoint, h: float, guess: tuple[Array, float] | None = None) -> PathPoint:
        """Return the path's point a step of h from a. Raises ComputationError if the path is lost."""
        if guess is None:
            t = a.t + h * a.rate
            guess = self.model.displacements(a.d[self.model.numbering.free] + h * a.z, t), t
        try:
            return self._reached(a, h, guess)
        except ComputationError:
            x = 1.0 if self.controlled else share_without_switching(self.model, (a.d, a.t), guess)
            if x == 1.0:
                raise
            # where a stiff spring begins to act while the load factor falls, the factor turns back
            corner, back = a.t + x * (guess[1] - a.t), a.t + (2.0 * x - 1.0) * (guess[1] - a.t)
            d = self.model.displacements((a.d + x * (guess[0] - a.d))[self.model.numbering.free], corner)
            return self._reached(a, h, (d, back))

    def _reached(self, a: PathPoint, h: float, guess: tuple[Array, float]) -> PathPoint:
        """Return the point a step of h from a to which a guess leads. Raises ComputationError if it is not the next."""
        curve, free = self.curve, self.model.numbering.free
        restore_memory(self.model, a.touching)
        found = curve.correct(self.steps.control(a, h), *guess)
        check_crossed(self.model, found.d, (a.d, a.t), found.t)
        check_supports(curve.system, found.d, found.t)
        went = (found.d[free] - a.d[free], found.t - a.t)
        b = curve.point(found, a.s + h, self.steps.scale(a))
        kink = others_act(a, b)
        back = a.rate * b.rate * (-1.0) ** (b.negative - a.negative) < 0.0
        if kink and back and curve.knows_inertia and not self.controlled:
            b.z, b.rate = -b.z, -b.rate
        # where all of a bar starts to yield, the path has a corner at any step length
        corner = self.bends and h <= CORNERED * a.s
        least = 0.0 if kink else AT_CORNER if corner else LARGEST_TURN
        for direction in (went,) if kink else (went, b.tangent):
            size = curve.metric.norm(direction) * curve.metric.norm(a.tangent)
            # where a body meets an obstacle or a stop below its load, the load factor turns back at an acute corner
            if curve.metric.dot(direction, a.tangent) < least * size and (
                    not kink or corner_between(curve, a, b) is None):
                raise ComputationError("the path turns too sharply", at={"factor": float(f"{found.t:.6g}")})
        return b

    def _leg(self, a: PathPoint, b: PathPoint) -> float:
        """Return most of the arc from a to a corner before b, where a one-sided spring begins or ceases to act, or 0.

        A limit point may be hidden before the corner.
        """
        if self.controlled or not one_sided(self.model) or not others_act(a, b):
            return 0.0
        if (corner := corner_between(self.curve, a, b)) is None:
            return 0.0
        leg = self.curve.metric.norm((corner[0] - a.d[self.model.numbering.free], corner[1] - a.t))
        return UP_TO * leg if leg > CORNERED * b.s else 0.0

    def _inertia_differs(self, a: PathPoint, b: PathPoint) -> bool:
        """Return whether the inertia changes other than by the one eigenvalue of a limit point."""
        expected = 1 if a.rate * b.rate < 0 else 0
        return self.curve.knows_inertia and abs(b.negative - a.negative) != expected

    def _doubtful(self, a: PathPoint, b: PathPoint, longest: float) -> bool:
        """Return whether a shorter step may show something between two points."""
        h = b.s - a.s
        # with history variables, the tangents may be those of unloading, which do not show the path between
        if not self.model.remembers and hides_limit_points(a, b) and h > CLOSEST_PAIR * longest:
            return True
        if not self._inertia_differs(a, b) or h <= CORNERED * a.s * (1 + 1e-9):
            return False
        if self.suspect <= a.s:
            self.resume = longest
        self.suspect = b.s
        return True

    def _events(self, a: PathPoint, b: PathPoint) -> list[Event]:
        """Return the limit point between a and b, if any, then b; or the end of the path if it comes before."""
        legs: list[Event] = [(b, "end" if self.steps.ends(b) else "step")]
        if a.rate * b.rate < 0:
            limit = limit_between(self.curve, a, b, lambda s, guess: self._advance(a, s - a.s, guess))
            last = len(self.log.limit_points) + 1 == self.count
            legs.insert(0, (limit, "limit"))
            legs = legs[:1] if last else legs
        out: list[Event] = []
        start = a
        for end, kind in legs:
            if self.goal is not None and not self.controlled:
                final = goal_between(self.curve, self.goal, start, end, self.steps.scale(start))
                if final is not None:
                    return [*out, (final, "end")]
            out.append((end, kind))
            start = end
        return out

    def _at_branch(self, a: PathPoint, b: PathPoint) -> bool:
        """Return whether the bifurcation between two points is the one at which to leave the path."""
        assert self.spec.branch is not None
        return self._inertia_differs(a, b) and len(self.log.bifurcations) == self.spec.branch.at

    def _leave(self, a: PathPoint, b: PathPoint) -> tuple[PathPoint, list[Event], list[str]]:
        """Return the first point of the branch between two points, as ``_next`` does."""
        assert self.spec.branch is not None
        assert isinstance(self.steps, ArcSteps)
        branch = leave(self.curve, a, b, float(self.spec.branch.direction), self.steps.scale)
        self.branches, self.suspect = False, 0.0
        goal, first = self.goal, branch.point
        passed = goal is not None and goal.distance(a.d, a.t) * goal.distance(first.d, first.t) < 0
        if passed:
            raise ComputationError(f"{goal} lies between the bifurcation at load factor {branch.factor:.6g} and the "
                                   "first point of the branch", at={"factor": float(f"{branch.factor:.6g}")},
                                   advice="an end of the path farther along the branch")
        warning = self.log.left(branch.factor, self.spec.branch.direction, first.negative, self.curve.knows_inertia)
        return first, [(first, "step")], [warning]

    def _after(self, b: PathPoint, h: float, crossed: bool) -> float:
        """Return the next step after one of h: towards a suspected bifurcation, or according to the iterations.

        Full length resumes only behind a bifurcation: elsewhere, long steps could pass over a turn of the path. With
        history variables it always does: there, the inertia changes where fibres unload.
        """
        rest, near = self.suspect - b.s, CORNERED * b.s
        grow = float(np.clip(np.sqrt(WANTED / max(b.iterations, 1)), 0.5, 2.0))
        usual = h * (min(grow, 1.0) if self.cuts else grow)
        remembers = self.model.remembers
        if rest > 0.1 * near and not crossed:
            return min(rest, max(0.5 * rest if remembers else min(0.5 * rest, usual), near))
        resumes, self.suspect = self.suspect > 0 and (crossed or remembers), 0.0
        return self.resume if resumes else usual

    def _state(self, point: PathPoint, kind: str, warnings: list[str]) -> State:
        """Return the state to be yielded for a point."""
        self.number += kind != "limit"
        residual = float(np.max(np.abs(point.balance.R), initial=0.0))
        history = {"step": self.number, "factor": point.t, "iterations": point.iterations, "residual": residual,
                   "increment": point.increment, "cutbacks": self.cuts, "energy": point.balance.energy,
                   "negative_pivots": point.negative}
        size = self.curve.system.norm(point.d[self.model.numbering.free])
        if point.uncertainty > POOR * size:
            warnings = [*warnings, inexact(f"factor {point.t:.6g}", point.uncertainty / size)]
        restore_memory(self.model, point.touching)
        depth = overlap(self.model, point.d, point.t)
        warnings = warnings + too_deep(self.model, f"factor {point.t:.6g}", depth)
        state = self._plain(point)
        state.history, state.warnings = history, warnings
        self.log.observe(state, kind == "limit")
        if kind == "end" and self.branches:
            state.warnings = [*state.warnings, self._unbranched()]
        state.last = kind == "end" or (kind == "limit" and len(self.log.limit_points) == self.count)
        state.report = self.log.report()
        if state.last:
            state.tables = self.log.tables()
        return state

    def _plain(self, point: PathPoint) -> State:
        """Return the state at a point, without history and warnings."""
        turned = self.curve.system.count(point.d, point.t)
        return State(point.t, point.d, point.balance.Q, point.balance.F, point.balance.energy, turned)

    def _unbranched(self) -> str:
        """Return the warning that the path ended before the bifurcation at which it was to be left."""
        assert self.spec.branch is not None
        return (f"solver.branch: the path ends before its bifurcation {self.spec.branch.at} (it met "
                f"{len(self.log.bifurcations)}), so no branch was followed")

    def _too_long(self, a: PathPoint) -> ComputationError:
        aim = str(self.goal or f"limit point {self.count}")
        return ComputationError(f"{aim} was not reached within {self.most} steps", advice="more steps, if the path "
                                "reaches this at all", at={"step": self.number, "factor": float(f"{a.t:.6g}")})

    def _stuck(self, error: ComputationError, a: PathPoint) -> ComputationError:
        f = error.failure
        advice = ("method: arc_length if the path snaps back, else another quantity"
                  if self.controlled else "more iterations, or a finer mesh")
        if self.model.contacts:
            advice = f"method: newton, whose load steps open and close contacts; {advice}"
        if self.model.hinges:
            advice = ("plastic hinges have no stiffness and must not rotate far within one element: hardening of 1e-4 "
                      f"E, more elements, or an earlier end of the path; {advice}")
        return ComputationError(f"the path cannot be followed beyond load factor {a.t:.6g}: {f.reason}",
                                at={"step": self.number + 1, **f.at}, history=f.history, advice=advice)


def solve_path(model: Model, spec: Static) -> Iterator[State]:
    """Yield the states of the equilibrium path from load factor 0 by ``arc_length`` or ``displacement``.

    The load factor scales loads and motion that have no amplitude; the rest is constant. Each state's ``report`` holds
    the limit points and bifurcations passed so far. Raises ComputationError if the path cannot be followed or does not
    reach its end in the allowed number of steps.
    """
    return Follower(model, spec).states()
