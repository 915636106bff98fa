"""The equations of motion M z'' + T^T (Q(d, d') - F(t)) = 0; z includes the multipliers of the constraints."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..bodies import elastic, elastic_noise, elastic_tangent, set_natural, viscous
from ..lowlevel.arrays import rank, ranked
from ..lowlevel.jit import addressed, inner, kernel, seldom
from ..lowlevel.records import array_at
from ..moving import moving_inertia, place_moving
from ..patches import add_patch_tangent, patch_forces, patch_noise, violation
from .state import evaluate, evaluate_constants, fill_full

# a constraint counts as satisfied if its violation is at most this share of its scale
SATISFIED = 1e-13
# counters of a motion: evaluations of forces alone, of forces with tangent, factorisations
FORCES, TANGENTS, FACTORS = range(3)


class Problem(NamedTuple):
    """A model in motion, as kernels take it: n unknowns (multipliers included), n_full full coordinates.

    groups : addresses of the element groups; states : history variables of all laws with memory, group after group,
    with the time since the accepted state at entries ``clocks``; prescribed, slopes : of relaxing laws
    (``model.groups.with_prescribed``); driven : (groups,) whether prescribed motion drives coordinates of the group;
    calls : addresses (``kernels.calls``); tau : (groups,) Kelvin-Voigt times [s]. points, sliding, moving, facing :
    tables of point laws, prismatic joints, points that move along bodies and points that touch bodies; patched :
    whether there are laws or joints; stops : (k, 3) first and last + 1 item of each unilateral or gapped law, and the
    item that acted last; touches, sided : whether there are contacts, and hard ones (a multiplier instead of a law);
    turning : section directions whose turns are counted; winds : whether forces depend on the turns; programs :
    signals. place, indptr, index, value, full, dependents : numbering; row_place, row_index : place and index by rows
    of matrices instead of unknowns, equal to them in bands; fronts : of matrices, empty for bands of
    ``width`` entries a row; mass : T^T M T in this storage; mass_offsets (k,), mass_diagonals (k, n) : its nonzero
    diagonals d as a band, entries (j + d, j); load_*, motion_* : dead loads, entries of P and (signals, n) T^T M P;
    alpha : mass damping [1/s]. pairs : (m, 2) unknowns x and y of one vector; turns : (m, 4) full coordinates that give
    its rotation: theta, x and y of a gradient, or those of two points; e0 : (n_q,) reference; weights, straining : (n,)
    [m] as in ``Model``, and coordinate : (n,) 1, all three 0 for multipliers; extent : of the scene [m]. feedback :
    signals and controllers that depend on the motion; inner : number of unknowns without controllers' states, which
    come last; rank : of the feedback's part of tangents; least_iterations : 2 where feedback switches (increments do
    not show it), else 1.
    """

    groups: Any
    states: Any
    clocks: Any
    prescribed: Any
    slopes: Any
    driven: Any
    calls: Any
    tau: Any
    points: Any
    sliding: Any
    moving: Any
    facing: Any
    stops: Any
    patched: bool
    touches: bool
    sided: bool
    turning: Any
    winds: bool
    programs: Any
    place: Any
    indptr: Any
    index: Any
    value: Any
    full: Any
    dependents: Any
    row_place: Any
    row_index: Any
    fronts: Any
    width: int
    mass: Any
    mass_offsets: Any
    mass_diagonals: Any
    load_coord: Any
    load_value: Any
    load_signal: Any
    load_varies: Any
    motion_coord: Any
    motion_factor: Any
    motion_signal: Any
    motion_mass: Any
    motion_mass_signal: Any
    motion_mutual: Any
    alpha: float
    pairs: Any
    turns: Any
    e0: Any
    weights: Any
    straining: Any
    coordinate: Any
    extent: float
    feedback: Any
    inner: int
    rank: int
    least_iterations: int


@kernel
def signals_at(p, t, out):  # type: ignore[no-untyped-def]
    """Fill out (signals, 3) with the signals of a model and their first two derivatives at t (``state.evaluate``)."""
    calls.signals(p.calls, (p.programs, t, out))


@inner
def to_full(p, z, amps, order, out):  # type: ignore[no-untyped-def]
    """Fill the full coordinates, their rates or second rates (``order``) from the unknowns (``state.fill_full``)."""
    calls.full(p.calls, (p, z, amps, order, out))


@inner
def to_unknowns(p, full, out, sizes):  # type: ignore[no-untyped-def]
    """Fill out (n,) with T^T full; with ``sizes`` with |T|^T full, so that terms of opposite sign do not cancel."""
    for i in range(len(out)):
        out[i] = full[p.full[i]]
    for k in range(len(p.dependents)):
        f = full[p.dependents[k]]
        for m in range(p.indptr[k], p.indptr[k + 1]):
            out[p.index[m]] += (abs(p.value[m]) if sizes else p.value[m]) * f


@inner
def record_increment(w, iteration, size):  # type: ignore[no-untyped-def]
    """Record the size of a Newton increment in w.history, which iteration 0 clears."""
    if iteration == 0:
        w.history[:] = 0.0
    if iteration < len(w.history):
        w.history[iteration] = size


@inner
def has_converged(step, rate, wanted, p, w, z, amps):  # type: ignore[no-untyped-def]
    """Return whether Newton's method has converged: the error left after increment ``step`` is below ``wanted``.

    The contraction ``rate`` predicts that error. Constraints must also hold to round-off at z and signals ``amps``.
    """
    if not (step == 0.0 or (rate < 1.0 and step * rate <= wanted * (1.0 - rate))):
        return False
    if not p.patched:
        return True
    to_full(p, z, amps, 0, w.d)
    return violation(p, w.d, amps) <= SATISFIED


@inner
def directions(p, d, x, y):  # type: ignore[no-untyped-def]
    """Fill x and y (m,) with the direction that each pair rotates with at d (n_full,), or with theta and 0."""
    for k in range(len(p.turns)):
        i, j, a, b = p.turns[k, 0], p.turns[k, 1], p.turns[k, 2], p.turns[k, 3]
        if j < 0:
            x[k], y[k] = d[i], 0.0
            continue
        x[k], y[k] = p.e0[i] + d[i], p.e0[j] + d[j]
        if a >= 0:
            x[k], y[k] = p.e0[a] + d[a] - x[k], p.e0[b] + d[b] - y[k]


@inner
def rotation(theta, x, y, x0, y0):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the rotation from (x0, y0) to (x, y), both as filled by ``directions``.

    ``theta`` : whether x and x0 are angles.
    """
    if theta:
        angle = x - x0
        if abs(angle) > 0.5:
            return np.cos(angle), np.sin(angle)
        q = angle * angle  # power series, to 1e-11
        cosine = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0 - q * (1.0 / 40320.0 - q * (1.0 / 3628800.0)))))
        sine = 1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0 - q * (1.0 / 362880.0))))
        return cosine, angle * sine
    size = np.sqrt((x * x + y * y) * (x0 * x0 + y0 * y0))
    return ((x * x0 + y * y0) / size, (y * x0 - x * y0) / size) if size > 0.0 else (1.0, 0.0)


@inner
def add_loads(p, amps, sign, Q):  # type: ignore[no-untyped-def]
    """Add the dead loads times ``sign`` to Q (n_full,)."""
    for m in range(len(p.load_coord)):
        Q[p.load_coord[m]] += sign * p.load_value[m] * amps[p.load_signal[m], 0]


@inner
def add_inertia(p, w, v, a, R):  # type: ignore[no-untyped-def]
    """Add M (a + alpha v) of unknowns and of prescribed motion to R (n,); w.amps hold the signals."""
    for i in range(len(R)):
        w.x[i] = p.coordinate[i] * (a[i] + p.alpha * v[i])
    calls.mass_product(p.calls, (p, w.x, w.y))
    for i in range(len(R)):
        R[i] += w.y[i]
    for k in range(len(p.motion_mass_signal)):
        s = p.motion_mass_signal[k]
        f = w.amps[s, 2] + p.alpha * w.amps[s, 1]
        if f != 0.0:
            for i in range(len(R)):
                R[i] += f * p.motion_mass[k, i]


@inner
def apply_feedback(p, w):  # type: ignore[no-untyped-def]
    """Evaluate the feedback at w.d, w.v: set its signals in w.amps, and add z' - g of controllers' states to w.Q."""
    if p.rank > 0:
        calls.feedback(p.calls, (p, w))
        for j in range(p.feedback.states):
            k = p.full[p.inner + j]
            w.Q[k] += w.v[k] - p.feedback.rates[j]


@kernel
def forces(p, w, z, v):  # type: ignore[no-untyped-def]
    """Fill w.d, w.v and w.Q = Q - F (n_full,) at unknowns z with rates v; return (energy, dissipated power)."""
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.Q[:] = 0.0
    apply_feedback(p, w)
    w.counts[FORCES] += 1
    set_natural(p, w.amps, w.amps)
    place_moving(p, w.d, w.amps)
    energy = elastic(p, w.d, w.Q)
    power = viscous(p, w.d, w.v, w.Q)
    more, lost = patch_forces(p, w.d, w.v, w.amps, w.Q)
    add_loads(p, w.amps, -1.0, w.Q)
    return energy + more, power + lost


@addressed
def forces_tangent(p, w, z, v, c):  # type: ignore[no-untyped-def]
    """Same as ``forces``, and fill w.A = dQ/dz + c dQ/dz' without inertia; return the strain energy.

    The tangent takes the damping of elements as tau times their stiffness, which is only approximately the derivative.
    """
    to_full(p, z, w.amps, 0, w.d)
    to_full(p, v, w.amps, 1, w.v)
    w.Q[:] = 0.0
    w.A[:] = 0.0
    apply_feedback(p, w)
    if p.rank > 0:
        calls.feedback_tangent(p.calls, (p, w, c))
    w.counts[TANGENTS] += 1
    set_natural(p, w.amps, w.amps)
    place_moving(p, w.d, w.amps)
    energy = elastic_tangent(p, c, w.d, w.Q, w.A)
    viscous(p, w.d, w.v, w.Q)
    add_patch_tangent(p, w.d, w.v, w.amps, c, w.Q, w.A)
    add_loads(p, w.amps, -1.0, w.Q)
    return energy


@inner
def patches_tangent(p, w, c):  # type: ignore[no-untyped-def]
    """Add the tangent of point laws and joints at w.d, w.v to w.A, and set w.other (n_full,) to their forces."""
    w.other[:] = 0.0
    place_moving(p, w.d, w.amps)
    add_patch_tangent(p, w.d, w.v, w.amps, c, w.other, w.A)


@inner
def residual(p, w, v, a):  # type: ignore[no-untyped-def]
    """Fill w.R = M (a + alpha v) + T^T (Q - F) from w.Q = Q - F, after adding the inertia of moving masses to w.Q.

    Mass damping does not act on moving masses.
    """
    moving_inertia(p, w.amps, a, w.Q)
    to_unknowns(p, w.Q, w.R, False)
    add_inertia(p, w, v, a, w.R)


@inner
def add_mass(p, factor, A):  # type: ignore[no-untyped-def]
    """Add ``factor`` times M to A, with moving masses where they were placed last."""
    for i in range(len(A)):
        A[i] += factor * p.mass[i]
    if len(p.moving.fixed) > 0:
        calls.moving_mass(p.calls, (p, factor, A))


@inner
def factor(p, w, A):  # type: ignore[no-untyped-def]
    """Factor matrix A in place; return whether it is regular. Overwrites w.y."""
    w.counts[FACTORS] += 1
    return calls.factor(p.calls, (p, A, w.y))


@inner
def solve_with(p, A, x):  # type: ignore[no-untyped-def]
    """Solve A x = b in place with the factors in A; x holds b on entry."""
    calls.solve(p.calls, (p, A, x))


@inner
def weighted_norm(weights, x):  # type: ignore[no-untyped-def]
    """Return the largest |weights * x|; nan if x contains nan."""
    # compare bit patterns as integers, which vectorises
    largest = rank(0.0)
    for i in range(len(x)):
        largest = max(largest, rank(abs(weights[i] * x[i])))
    return ranked(largest)


@inner
def norm(p, x):  # type: ignore[no-untyped-def]
    """Return the largest displacement [m] that a change x of the unknowns causes; nan if x contains nan."""
    return weighted_norm(p.weights, x)


@addressed
@seldom
def at_floor(p, w, v, a):  # type: ignore[no-untyped-def]
    """Return whether all residuals in w.R are within the round-off of their terms at w.d."""
    w.other[:] = 0.0
    if p.rank > 0:
        to_full(p, v, w.amps, 1, w.v)
        calls.feedback(p.calls, (p, w))
        for j in range(p.feedback.states):
            k = p.full[p.inner + j]
            w.other[k] = abs(w.v[k]) + abs(p.feedback.rates[j])
    set_natural(p, w.amps, w.amps)
    place_moving(p, w.d, w.amps)
    elastic_noise(p, w.d, w.other)
    patch_noise(p, w.d, w.other)
    for m in range(len(p.load_coord)):
        w.other[p.load_coord[m]] += abs(p.load_value[m] * w.amps[p.load_signal[m], 0])
    to_unknowns(p, w.other, w.y, True)
    n = len(w.y)
    rates = array_at(w.other, 0, (n,))
    for i in range(n):
        rates[i] = (abs(a[i]) + p.alpha * abs(v[i])) * p.coordinate[i]
    calls.add_sizes(p.calls, (p, p.mass, rates, w.y))
    met = True
    for i in range(n):
        met &= abs(w.R[i]) <= 8.0 * 1.2e-16 * w.y[i]
    return met


@inner
def twice_kinetic(p, w, v):  # type: ignore[no-untyped-def]
    """Return twice the kinetic energy, v^T M v, of the unknowns' rates v (n,) and of prescribed motion in w.amps."""
    total = 0.0
    for i in range(len(v)):
        w.x[i] = p.coordinate[i] * v[i]
    calls.mass_product(p.calls, (p, w.x, w.y))
    for i in range(len(v)):
        total += w.x[i] * w.y[i]
    for k in range(len(p.motion_mass_signal)):
        rate = w.amps[p.motion_mass_signal[k], 1]
        for i in range(len(v)):
            total += 2.0 * rate * p.motion_mass[k, i] * w.x[i]
        for m in range(len(p.motion_mass_signal)):
            total += rate * p.motion_mutual[k, m] * w.amps[p.motion_mass_signal[m], 1]
    return total


@inner
def lost_to_mass_damping(p, w, v):  # type: ignore[no-untyped-def]
    """Return the power alpha v^T M v, prescribed motion included."""
    return p.alpha * twice_kinetic(p, w, v) if p.alpha != 0.0 else 0.0


def dynamic_functions(constant: bool, problem: Any) -> dict[Any, tuple[Any, ...]]:
    """Return this module's part of a model's table (``calls.table``); ``constant`` : whether all signals are constant.
    """
    return {calls.signals: (evaluate_constants if constant else evaluate, problem.place["programs"][1]),
            calls.full: (fill_full, problem), calls.forces: (forces, problem),
            calls.forces_tangent: (forces_tangent, problem), calls.at_floor: (at_floor, problem)}
