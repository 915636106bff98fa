"""The state carried from step to step, work arrays, signals, and the outcomes of a step."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ...case import jets
from ...elements.point_laws import angle_near
from ..lowlevel.jit import addressed, inner, kernel

# numbers carried from step to step. LIMIT: largest adaptive step size since Newton's method failed, 0 for none
TIME, STEP_SIZE, CONTRACTION, SIZE, OLD_ERROR, OLD_STEP, WORK, LOST, COUNT, GRID, REJECTED, TRIES, LIMIT = range(13)
# a tangent shared by several steps: its time, their size (0: no tangent), their number, cost in iterations so far
TANGENT_TIME, TANGENT_STEP, TANGENT_STEPS, TANGENT_COST = range(13, 17)
# energy created by fixed steps so far; work of moving obstacles in the impact at the end of a step, inf if unknown
CREATED_ENERGY, OBSTACLE_WORK = 17, 18
# whether the next step starts from consistent accelerations; energy lost in a step by friction of hard contacts
STARTS_CONSISTENT, FRICTION_LOSS = 19, 20
# whether a step uses the backward Euler method (a hard contact opens in it, or NEXT_EULER > 0)
BACKWARD = 21
# backward Euler steps between Radau steps (``switching``): size of the next one, 0 for none; size that meets the
# tolerance, 0 if unknown; size of the last one, 0 after longer Radau steps; size of Radau steps before they were cut;
# number of backward Euler steps so far
NEXT_EULER, GOOD_EULER, LAST_EULER, UNCUT_RADAU, SWITCHED = range(22, 27)
# work of the stresses on internal strains in a step; set only with hard contacts
INELASTIC_WORK = 27
# size of the next step after one that ends where a stop engages, else 0; whether errors are measured as errors of rates
# (a stop has engaged or a viscous body was hit); the largest rate so far
ENGAGED_STEP, RATE_ERRORS, FASTEST = range(28, 31)
# impact at the end of a step: 1 + the item with the largest impulse (0: no impact); number of impulses; their sum
# [N s]; energy lost
IMPACT_ITEM, IMPACT_POINTS, IMPULSE, IMPACT_LOSS = range(31, 35)
# how Newton's method starts in this step and the next (``prediction``); negative: for how many steps it starts at z
PREDICTION, NEXT_PREDICTION = 35, 36
# for how many failures of Newton's method Radau's methods do not try to start at z, because that failed, too
START_WAIT = 37
NUMBERS = 38

_angle_near = inner(angle_near)
# number of Newton increments kept for messages
HISTORY = 64
# outcomes of a step. SWITCHES: repeat it, shorter or (NEXT_EULER > 0) by backward Euler; INTO_SUPPORTS: a contact point
# whose gap supports and other points determine would penetrate
DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR, SWITCHES, UNBOUNDED, INTO_SUPPORTS = range(7)


class Motion(NamedTuple):
    """State of a motion.

    z, v, a : (n,) unknowns (multipliers included), their rates and second rates at the time numbers[TIME]; extra :
    (k, n) data that a method keeps from earlier steps; numbers : step sizes, error, work etc. (see above); turned :
    (2, sections) rotations with full turns, and their rates (``Turning``); remembered : internal strains of relaxing
    materials at the state of the shared tangent.
    """

    z: Any
    v: Any
    a: Any
    extra: Any
    numbers: Any
    turned: Any
    remembered: Any


class Scratch(NamedTuple):
    """Work arrays of evaluations: d, v, Q, other (n_full,), R, x, y (n,), A a matrix, amps (signals, 3).

    history : sizes [m] of the increments of the last Newton iteration, then 0. counts (3,) : evaluations so far.
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
    """End of a step: z, v, a (n,), and the coefficients dense (k, n) of the interpolation over the step."""

    z: Any
    v: Any
    a: Any
    dense: Any


class Method(NamedTuple):
    """An integrator as the step control sees it.

    order : of the local error in h; basis : (k, degree + 1) polynomials of the rows of ``end.dense``; end : of the
    current step; own : address of the integrator's own record; calls : table of its functions (``kernels.calls``);
    exact : whether it computes the work of a step exactly itself; impulse : factor c such that a force at the end of a
    step of size h changes the momentum there by c h times the force; switches : whether hard contacts open and close
    in backward Euler steps only.
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
    """Return a method for n unknowns without its own record and functions, which are set later."""
    end = Step(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((len(basis), n)))
    return Method(order, basis, end, 0, np.zeros(0, dtype=np.int64), False, 0.0, False)


def scratch(n: int, n_full: int, entries: int, signals: int) -> Scratch:
    """Return work arrays for n unknowns, n_full full coordinates, a matrix of ``entries`` numbers, and ``signals``."""
    d, v, Q, other = (np.zeros(n_full) for _ in range(4))
    R, x, y = (np.zeros(n) for _ in range(3))
    return Scratch(d, v, Q, other, R, x, y, np.zeros(entries), np.zeros((signals, 3)), np.zeros(HISTORY),
                   np.zeros(3, dtype=np.int64))


def motion(n: int, kept: int, sections: int, remembered: int = 0) -> Motion:
    """Return a motion of n unknowns at rest, with ``kept`` rows for the method and ``sections`` with counted turns.

    ``remembered`` : number of internal strains stored with the method's tangent.
    """
    out = Motion(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((kept, n)), np.zeros(NUMBERS),
                 np.zeros((2, sections)), np.zeros(remembered))
    # the contraction of Newton's method is not known yet
    out.numbers[CONTRACTION] = 1.0
    return out


for _function in (jets.compare, jets.power_jet, jets.function_jet, jets.table_jet, jets.time_jet, jets.binary_jet,
                  jets.combine, jets.steer):
    register_jitable(_function)

_run = kernel(jets.run)
evaluate_with_gradient = kernel(jets.run_with_gradient)


@kernel
def evaluate(programs, t, out):  # type: ignore[no-untyped-def]
    """Fill out (n, 3) with every function of ``case.programs.programs`` at t and its first two derivatives by t.

    At a corner or jump the values are right-hand limits; times outside the programs' window are moved to its ends.
    Where there is no finite value the entry is nan; the Python signal reports why.
    """
    t = min(max(t, programs.window[0]), programs.window[1])
    for k in range(len(programs.first) - 1):
        _run(programs, k, t, out, k)


@kernel
def evaluate_constants(programs, t, out):  # type: ignore[no-untyped-def]
    """Same as ``evaluate`` for functions that are all constant (``case.programs.are_constant``); compiles faster."""
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
    """Fill out (n_full,) with full coordinates (order 0), rates (1) or second rates (2) from those of the unknowns."""
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

    In the frame of its reference, direction i is (length[i], 0) plus d[dofs] times the weights ``along`` and
    ``across``, from begin[i] to begin[i + 1].
    """

    begin: Any
    dofs: Any
    along: Any
    across: Any
    length: Any


@kernel
def count_turns(turning, d, v, h, angle, rate):  # type: ignore[no-untyped-def]
    """Update counted angles and their rates (n,) after a time h, to d with rates v (n_full,).

    The mean of old and new rate selects the turn, so steps of more than half a turn are allowed.
    """
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
def no_restart(s, m):  # type: ignore[no-untyped-def]
    """Do nothing: method m may keep its data of earlier steps after an impact or a stop."""
