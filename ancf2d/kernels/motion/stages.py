"""The stages of Radau's method: their unknowns, and the history variables of relaxing materials there.

A Maxwell term h' + h/tau = eps' is integrated by the same stages as the displacements: with W the inverse of the
coefficients and x the step size over tau, H = G (E - eps_0 + h_0) for the values H (s,) of h and E of the strain,
G = (W + x)^-1 W. So only displacements are unknown. An eigenvector of W with eigenvalue mu is one of G too, with
mu/(mu + x): Newton's systems contain the complex modulus of the material at mu/h.

Forces need only the sums -sum g H over all terms. Elements take them as given internal strains (``kernels.forces``):
-sum g G times the strains, plus a part that follows from the terms at the start. The terms themselves are computed only
when a step ends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..bodies import group_at, set_natural
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import addressed, inner
from ..lowlevel.records import array_at
from ..stress_free import COMPUTED
from .dynamics import to_full

# slopes of given internal strains: fixed ones, and ones that double the stiffness
FIXED, DOUBLING = 0.0, -1.0
# numbers processed at a time, so that they stay in the cache
TILE = 128


class Relaxing(NamedTuple):
    """Relaxing materials at the stages of a step.

    runs (r, 8) : of each relaxing group its number, its first entry in states, number of points, entries per point,
    strains per point, first term, number of terms, and first strain (groups with the same material share terms);
    terms (m, 2) : modulus and relaxation time; weights (s,) of the stages; G (m, s, s), carried (m, s) its row sums;
    share (r, s, s) : -sum g G of a group; states, given, slopes : those of the problem; start : the states at the start
    of the step; strains, inner, left (s, k) : strains, internal strains, and the part of these that does not depend on
    the strains, at each stage; begun (k,) : internal strains at the start; at_x (1 + m, 1 + s), rates (1 + s,) :
    weights of start and stages for an instant inside the step (``_weigh``); calls : table of the functions for relaxing
    materials (``kernels.calls``).
    """

    runs: Any
    terms: Any
    weights: Any
    G: Any
    carried: Any
    share: Any
    states: Any
    given: Any
    slopes: Any
    start: Any
    strains: Any
    inner: Any
    left: Any
    begun: Any
    at_x: Any
    rates: Any
    calls: Any


def relaxing(runs: Any, terms: Any, weights: Any, p: Any) -> Relaxing:
    """Return the arrays for a method with these weights (s,) of its stages, and problem p."""
    s, k = len(weights), p.prescribed.shape[1] if len(runs) else 0
    strains, internal, left = (np.zeros((s, k)) for _ in range(3))
    return Relaxing(runs, terms, weights, np.zeros((len(terms), s, s)), np.zeros((len(terms), s)),
                    np.zeros((len(runs), s, s)), p.states, p.prescribed, p.slopes,
                    np.zeros(len(p.states) if len(runs) else 0), strains, internal, left, np.zeros(k),
                    np.zeros((1 + len(terms), 1 + s)), np.zeros(1 + s), calls.table({}))


@inner
def combine(F, i, X, first, out, to, count):  # type: ignore[no-untyped-def]
    """Fill ``count`` numbers of ``out`` from entry ``to`` on with the sum of F[i, j] X[j, first:first + count] over j.
    """
    s, n = X.shape
    total, a, b, c = (array_at(out, to, (count,)), array_at(X, first, (count,)), array_at(X, n + first, (count,)),
                      array_at(X, 2 * n + first, (count,)))
    f, g, h = F[i, 0], F[i, 1], F[i, 2]
    for k in range(count):
        total[k] = f * a[k] + g * b[k] + h * c[k]
    for j in range(3, s, 2):
        a, b = array_at(X, j * n + first, (count,)), array_at(X, (j + 1) * n + first, (count,))
        f, g = F[i, j], F[i, j + 1]
        for k in range(count):
            total[k] += f * a[k] + g * b[k]


@inner
def place(m, p, w, s, i):  # type: ignore[no-untyped-def]
    """Fill m.y with the unknowns at stage i, and w.amps with the signals there."""
    for k in range(len(m.y)):
        m.y[k] = s.z[k] * p.coordinate[k] + m.X[i, k]
    copy_rows(m.amps[i], w.amps)


@inner
def _set_coefficients(m, h):  # type: ignore[no-untyped-def]
    """Fill G, its row sums and ``share`` for a step of size h."""
    q, s = m.relaxing, len(m.c)
    for k in range(len(q.terms)):
        x = h / q.terms[k, 1]
        q.carried[k] = 0.0
        for j in range(s):
            y = -m.apart[0, j] * m.mu / (m.mu + x)
            for i in range(s):
                q.G[k, i, j] = m.together[i, 0] * y
            for n in range(len(m.mus)):
                u = -complex(m.apart[1 + 2 * n, j], m.apart[2 + 2 * n, j]) * m.mus[n] / (m.mus[n] + x)
                for i in range(s):
                    q.G[k, i, j] += m.together[i, 1 + 2 * n] * u.real + m.together[i, 2 + 2 * n] * u.imag
            for i in range(s):
                q.carried[k, i] += q.G[k, i, j]
    for r in range(len(q.runs)):
        q.share[r] = 0.0
        for k in range(q.runs[r, 5], q.runs[r, 5] + q.runs[r, 6]):
            for i in range(s):
                for j in range(s):
                    q.share[r, i, j] -= q.terms[k, 0] * q.G[k, i, j]


@addressed
def begin_stages(m, h):  # type: ignore[no-untyped-def]
    """Save the history variables at the start of a step of size h, and prepare the internal strains of its stages."""
    q, s = m.relaxing, len(m.c)
    _set_coefficients(m, h)
    for r in range(len(q.runs)):
        size, n, term, terms, share = q.runs[r, 3], q.runs[r, 4], q.runs[r, 5], q.runs[r, 6], q.share[r]
        for point in range(q.runs[r, 2]):
            first = q.runs[r, 1] + point * size
            # the clock of the point
            q.states[first + size - 1] = 0.0
            for c in range(n):
                x, at = q.runs[r, 7] + point * n + c, first + c
                eps = q.states[at + (1 + terms) * n]
                q.begun[x] = q.states[at]
                for i in range(s):
                    value = 0.0
                    for j in range(s):
                        value -= share[i, j] * eps
                    for k in range(terms):
                        value -= q.terms[term + k, 0] * q.carried[term + k, i] * q.states[at + (1 + k) * n]
                    q.left[i, x] = value
    copy(q.states, q.start)


@inner
def ungive(q):  # type: ignore[no-untyped-def]
    """Make laws compute their internal strains themselves again."""
    for r in range(len(q.runs)):
        q.slopes[q.runs[r, 0]] = COMPUTED


@inner
def give(q, internal):  # type: ignore[no-untyped-def]
    """Prescribe fixed internal strains (k,) for the relaxing laws."""
    if len(q.runs) > 0:
        copy(internal, q.given[0])
        for r in range(len(q.runs)):
            q.slopes[q.runs[r, 0]] = FIXED


@inner
def _strain(m, p, w, s, i):  # type: ignore[no-untyped-def]
    """Fill q.strains[i] with the strains of relaxing groups at stage i."""
    q = m.relaxing
    place(m, p, w, s, i)
    to_full(p, m.y, w.amps, 0, w.d)
    set_natural(p, w.amps, w.amps)
    for r in range(len(q.runs)):
        calls.total_strains(p.calls, (group_at(p.groups[q.runs[r, 0]]), w.d, q.runs[r, 7], q.strains[i]))


@addressed
def relax(p, w, s, m):  # type: ignore[no-untyped-def]
    """Compute the internal strains at all stages from the displacements there."""
    q, k = m.relaxing, len(m.relaxing.begun)
    for i in range(len(m.c)):
        _strain(m, p, w, s, i)
    for r in range(len(q.runs)):
        first, end = q.runs[r, 7], q.runs[r, 7] + q.runs[r, 2] * q.runs[r, 4]
        while first < end:
            count = min(TILE, end - first)
            for i in range(len(m.c)):
                combine(q.share[r], i, q.strains, first, q.inner, i * k + first, count)
                total, left = array_at(q.inner, i * k + first, (count,)), array_at(q.left, i * k + first, (count,))
                for x in range(count):
                    total[x] += left[x]
            first += count


@inner
def let_relax(m, p, w, s):  # type: ignore[no-untyped-def]
    """Call ``relax`` if the model has relaxing materials."""
    if len(m.relaxing.runs) > 0:
        calls.relax(m.relaxing.calls, (p, w, s, m))


@inner
def modulus(q, r, mu, h):  # type: ignore[no-untyped-def]
    """Return the terms' part of a group's complex modulus at mu/h, relative to the long-time modulus."""
    total = complex(0.0, 0.0)
    for k in range(q.runs[r, 5], q.runs[r, 5] + q.runs[r, 6]):
        total += q.terms[k, 0] * mu / (mu + h / q.terms[k, 1])
    return total


@inner
def is_first(q, r):  # type: ignore[no-untyped-def]
    """Return whether group r is the first with its terms."""
    first = True
    for k in range(r):
        first &= q.runs[k, 5] != q.runs[r, 5]
    return first


@inner
def double(q, r):  # type: ignore[no-untyped-def]
    """Double the long-time stiffness of group r, and of those with the same terms, in tangents."""
    for k in range(len(q.runs)):
        q.slopes[q.runs[k, 0]] = DOUBLING if q.runs[k, 5] == q.runs[r, 5] else FIXED


@addressed
def lost_in_relaxing(p, w, s, m):  # type: ignore[no-untyped-def]
    """Return the energy that internal strains dissipate in a step, by the quadrature of the stages."""
    q, lost, stages = m.relaxing, 0.0, len(m.c)
    for i in range(stages):
        give(q, q.inner[i])
        taken = q.given[1]
        for x in range(len(taken)):
            taken[x] = 0.0
        for j in range(stages):
            f, inner = q.weights[i] * m.W[i, j], q.inner[j]
            for x in range(len(taken)):
                taken[x] += f * (inner[x] - q.begun[x])
        place(m, p, w, s, i)
        to_full(p, m.y, w.amps, 0, w.d)
        lost += _taken(p, w, q)
    return lost


@inner
def _taken(p, w, q):  # type: ignore[no-untyped-def]
    """Return the work of the stresses at w.d on q.given[1], with internal strains q.given[0]; then call ``ungive``."""
    lost = 0.0
    set_natural(p, w.amps, w.amps)
    for r in range(len(q.runs)):
        lost += calls.commit(p.calls, (group_at(p.groups[q.runs[r, 0]]), w.d))
    ungive(q)
    return lost


@inner
def _through(m, x, j):  # type: ignore[no-untyped-def]
    """Return Lagrange polynomial j on start and stages at x, and its derivative."""
    f, rate, own = 1.0, 0.0, 0.0 if j == 0 else m.c[j - 1]
    for i in range(len(m.c) + 1):
        if i != j:
            other = 0.0 if i == 0 else m.c[i - 1]
            rate = (rate * (x - other) + f) / (own - other)
            f *= (x - other) / (own - other)
    return f, rate


@inner
def _weigh(m, x):  # type: ignore[no-untyped-def]
    """Fill the weights of start and stages at the fraction x of the step: for strains (row 0), each term, and rates.

    A term is a combination of its own value at the start and of the strains at the stages less those at the start.
    """
    q, s = m.relaxing, len(m.c)
    for j in range(s + 1):
        q.at_x[0, j], q.rates[j] = _through(m, x, j)
    for k in range(len(q.terms)):
        own = q.at_x[1 + k]
        own[0] = q.at_x[0, 0]
        for j in range(s):
            own[1 + j] = 0.0
            for i in range(s):
                own[1 + j] += q.at_x[0, 1 + i] * q.G[k, i, j]
            own[0] += own[1 + j]


@addressed
def radau_inside(p, m, h, x):  # type: ignore[no-untyped-def]
    """Set the history variables to those at the fraction x of the step, by the polynomial through start and stages."""
    q, s = m.relaxing, len(m.c)
    copy(q.start, q.states)
    if x == 0.0:
        return
    _weigh(m, x)
    for r in range(len(q.runs)):
        size, n, term, terms = q.runs[r, 3], q.runs[r, 4], q.runs[r, 5], q.runs[r, 6]
        for point in range(q.runs[r, 2]):
            for c in range(n):
                k, at = q.runs[r, 7] + point * n + c, q.runs[r, 1] + point * size + c
                begun = q.start[at + (1 + terms) * n]
                internal, eps = q.at_x[0, 0] * q.start[at], q.at_x[0, 0] * begun
                for j in range(s):
                    internal += q.at_x[0, 1 + j] * q.inner[j, k]
                    eps += q.at_x[0, 1 + j] * q.strains[j, k]
                q.states[at], q.states[at + (1 + terms) * n] = internal, eps
                for own in range(terms):
                    value = q.at_x[1 + term + own, 0] * q.start[at + (1 + own) * n]
                    for j in range(s):
                        value += q.at_x[1 + term + own, 1 + j] * (q.strains[j, k] - begun)
                    q.states[at + (1 + own) * n] = value


@addressed
def radau_taken(p, w, m, x):  # type: ignore[no-untyped-def]
    """Return the power that internal strains take at the fraction x of a step, times the step size; w.d is set there.

    It is the stress there times the rate of the polynomial through start and stages.
    """
    q = m.relaxing
    _weigh(m, x)
    give(q, q.begun)
    internal, taken = q.given[0], q.given[1]
    for k in range(len(taken)):
        internal[k], taken[k] = q.at_x[0, 0] * q.begun[k], q.rates[0] * q.begun[k]
    for j in range(len(m.c)):
        f, rate, inner = q.at_x[0, 1 + j], q.rates[1 + j], q.inner[j]
        for k in range(len(taken)):
            internal[k] += f * inner[k]
            taken[k] += rate * inner[k]
    return _taken(p, w, q)
