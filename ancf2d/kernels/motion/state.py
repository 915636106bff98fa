"""The state that time stepping carries from step to step, its signals, and what a step answers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ...case import jets
from ...elements.point_laws import angle_near
from ..lowlevel.jit import addressed, inner, kernel

# numbers that go from step to step; LIMIT: of adaptive steps since Newton's method failed at a longer one, 0 for none
TIME, STEP_SIZE, CONTRACTION, SIZE, OLD_ERROR, OLD_STEP, WORK, LOST, COUNT, GRID, REJECTED, TRIES, LIMIT = range(13)
# of a tangent that serves several steps: its time, their length (0: none), how many, what it and they cost
HELD_TIME, HELD_STEP, HELD_STEPS, HELD_COST = range(13, 17)
# energy that fixed steps have made so far; work that obstacles which move do in the impact at the end of a step, inf
# where it is not known
GAINED, GIVEN = 17, 18
# whether the next step is the first from accelerations that are consistent; energy that contacts without a law took in
# a step by friction
FRESH, RUBBED = 19, 20
# whether a step is made by the backward Euler method, as a contact without a law opens in it
BACKWARD = 21
# of methods that switch to it (``switching``): length of such a step to come, 0 for none; of one that meets the
# tolerance, 0 where that is not known; of the last one, 0 behind longer steps of the other kind; of these before they
# were cut; and how many such steps there were
NEXT, EULER, LAST, UNCUT, SWITCHED = range(22, 27)
# what materials with memory take of the strain energy in a step, where contacts without a law ask for it
TAKEN = 27
# length of the step to come, behind one that ends where a stop begins to act, 0 behind others; whether errors count as
# those of rates: a stop acts that has begun to, or a viscous body has been hit; the largest rate so far
SOFT_STEP, STRUCK, FASTEST = range(28, 31)
# of the impact at the end of a step: 1 + the item with the largest impulse, 0 for none; how many have one; their sum
# [N s]; and the energy that it takes
HIT_AT, HIT_POINTS, IMPULSE, HIT_LOST = range(31, 35)
NUMBERS = 35

_angle_near = inner(angle_near)
# increments of Newton's method that are kept for messages
HISTORY = 64
# what a step answers; SWITCHES: that it has to be made anew, shorter or by another method, as NEXT tells;
# INTO_SUPPORTS: that a point whose gap supports and other points hold would be in what it touches
DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR, SWITCHES, UNBOUNDED, INTO_SUPPORTS = range(7)


class Motion(NamedTuple):
    """z, v, a : (n,) unknowns (multipliers included), their rates and second rates at the time numbers[TIME].

    extra : (k, n) what a method keeps of earlier steps; numbers : step sizes, error and work so far (see above);
    turned : (2, sections) rotations, counted through full turns, and their rates, of ``Turning``; remembered : internal
    strains of materials that relax at the state that a tangent which serves several steps is of.
    """

    z: Any
    v: Any
    a: Any
    extra: Any
    numbers: Any
    turned: Any
    remembered: Any


class Scratch(NamedTuple):
    """Arrays that evaluations write into: d, v, Q, other (n_full,), R, x, y (n,), A a matrix, amps (signals, 3).

    history : sizes [m] of the increments of the last Newton iteration, 0 beyond its end. counts (3,) : work so far.
    """

    d: Any
    v: Any
    Q: Any
    other: Any
    R: Any
    x: Any
    y: Any
    A: Any
    amps: Any
    history: Any
    counts: Any


class Step(NamedTuple):
    """Where a step ends: z, v, a (n,), dense (k, n): what the interpolation over the step is made of."""

    z: Any
    v: Any
    a: Any
    dense: Any


class Method(NamedTuple):
    """What stepping knows of an integrator: its order in h, the polynomials of a step, and where one ends.

    basis : (k, degree + 1) of the rows of ``end.dense``; own : address of the integrator's own record; calls : table
    of its functions (``kernels.calls``); exact : whether it knows the work of a step itself; impulse : by which
    share of its length a force at the end of a step changes rates there; switches : whether contacts without a law open
    and close in backward Euler steps alone.
    """

    order: int
    basis: Any
    end: Step
    own: int
    calls: Any
    exact: bool
    impulse: float
    switches: bool


def method_of(order: int, basis: Any, n: int) -> Method:
    """Return a method whose own record and functions are yet to come, of n unknowns."""
    end = Step(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((len(basis), n)))
    return Method(order, basis, end, 0, np.zeros(0, dtype=np.int64), False, 0.0, False)


def scratch(n: int, n_full: int, entries: int, signals: int) -> Scratch:
    """Return arrays for n unknowns, n_full full coordinates, a matrix of so many entries and so many signals."""
    d, v, Q, other = (np.zeros(n_full) for _ in range(4))
    R, x, y = (np.zeros(n) for _ in range(3))
    return Scratch(d, v, Q, other, R, x, y, np.zeros(entries), np.zeros((signals, 3)), np.zeros(HISTORY),
                   np.zeros(3, dtype=np.int64))


def motion(n: int, kept: int, sections: int, remembered: int = 0) -> Motion:
    """Return a motion of n unknowns at rest, with ``kept`` rows for the method and sections whose turns count.

    ``remembered`` : how many internal strains go with the method's tangent.
    """
    out = Motion(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((kept, n)), np.zeros(NUMBERS),
                 np.zeros((2, sections)), np.zeros(remembered))
    # how fast Newton converges is not known yet
    out.numbers[CONTRACTION] = 1.0
    return out


for _function in (jets.compare, jets.power_jet, jets.function_jet, jets.table_jet, jets.time_jet, jets.binary_jet,
                  jets.combine, jets.steer):
    register_jitable(_function)

_run = kernel(jets.run)
evaluate_with_gradient = kernel(jets.run_with_gradient)


@kernel
def evaluate(programs, t, out):  # type: ignore[no-untyped-def]
    """Fill out (n, 3) with every function of ``case.programs.programs`` at t and its two derivatives by t.

    At a corner or jump the values are those to its right, but never those of a time outside the programs' window.
    Where there is no finite value the entry is nan; the Python signal says why.
    """
    t = min(max(t, programs.window[0]), programs.window[1])
    for k in range(len(programs.first) - 1):
        _run(programs, k, t, out, k)


@kernel
def evaluate_constants(programs, t, out):  # type: ignore[no-untyped-def]
    """Do as ``evaluate`` where nothing depends on the time (``case.programs.are_constant``), which compiles sooner."""
    out[:] = 0.0
    for k in range(len(programs.first) - 1):
        value = 0.0
        for i in range(programs.first[k], programs.first[k + 1]):
            at = programs.arg[i]
            if programs.code[i] == jets.NUMBER:
                value = programs.data[at]
            else:
                value = programs.data[at + 1] + programs.data[at] * value
        out[k, 0] = value


@kernel
def fill_full(p, z, amps, order, out):  # type: ignore[no-untyped-def]
    """Fill full coordinates (order 0), their rates (1) or second rates (2) from those of the unknowns."""
    out[:] = 0.0
    for i in range(len(z)):
        out[p.full[i]] = z[i]
    for k in range(len(p.dependents)):
        s = 0.0
        for m in range(p.indptr[k], p.indptr[k + 1]):
            s += p.value[m] * z[p.index[m]]
        out[p.dependents[k]] = s
    for m in range(len(p.motion_coord)):
        out[p.motion_coord[m]] += p.motion_factor[m] * amps[p.motion_signal[m], order]


class Turning(NamedTuple):
    """Section directions whose rotations are counted through full turns.

    Direction i has the components ``along`` and ``across`` (weights of d[dofs], from begin[i] to begin[i + 1]) in the
    frame of its reference, (length[i], 0) there.
    """

    begin: Any
    dofs: Any
    along: Any
    across: Any
    length: Any


@kernel
def turn_on(turning, d, v, h, angle, rate):  # type: ignore[no-untyped-def]
    """Take angles with their rates (n,) over a time h to d with rates v (n_full,), by more than half a turn too."""
    for i in range(len(angle)):
        ux, uy, vx, vy = 0.0, 0.0, 0.0, 0.0
        for k in range(turning.begin[i], turning.begin[i + 1]):
            c = turning.dofs[k]
            ux += turning.along[k] * d[c]
            uy += turning.across[k] * d[c]
            vx += turning.along[k] * v[c]
            vy += turning.across[k] * v[c]
        x = turning.length[i] + ux
        new = (x * vy - uy * vx) / (x * x + uy * uy)
        angle[i] = _angle_near(turning.length[i], ux, uy, angle[i] + 0.5 * h * (rate[i] + new))
        rate[i] = new


@addressed
def keep_all(s, m):  # type: ignore[no-untyped-def]
    """Keep what a method m knows of earlier steps, behind an impact or a stop: it does no harm."""
