"""The stages of Radau's method: where they are, and what materials that relax are there.

A Maxwell term h' + h/tau = eps' is solved at the stages as displacements are: with W the inverse of the coefficients
and x the step over tau, H = G (E - eps_0 + h_0) for the values H (s,) of h and E of the strain, G = (W + x)^-1 W. So
nothing but displacements is unknown. An eigenvector of W with the eigenvalue mu is one of G too, with mu/(mu + x):
Newton's systems have the complex modulus of the material at mu/h.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import calls
from ..bodies import group_at, set_natural
from ..lowlevel.arrays import copy, copy_rows
from ..lowlevel.jit import addressed, inner
from .dynamics import to_full

# a share of the springs that is none, and yet tells that it is a share
NO_SHARE = 1e-300


class Relaxing(NamedTuple):
    """What materials that relax remember at the stages of a step.

    runs (r, 7) : group, first number, points, numbers of a point, strains, first term and terms, of each group that
    relaxes; terms (m, 2) : modulus and time; weights (s,) of the stages; G (m, s, s); states (n,) : those of the
    problem; stages (s + 1, n) : the same at the start of the step and at each stage, empty where nothing relaxes;
    calls : table of what is called where something does (``kernels.calls``).
    """

    runs: Any
    terms: Any
    weights: Any
    G: Any
    states: Any
    stages: Any
    calls: Any


def relaxing(runs: Any, terms: Any, weights: Any, states: Any) -> Relaxing:
    """Return the arrays for a method whose stages have these weights (s,)."""
    s = len(weights)
    return Relaxing(runs, terms, weights, np.zeros((len(terms), s, s)), states,
                    np.zeros((s + 1, len(states)) if len(runs) else (0, 0)), calls.table({}))


@inner
def place(m, p, w, s, i):  # type: ignore[no-untyped-def]
    """Fill m.y with the unknowns at stage i, and the signals there."""
    for k in range(len(m.y)):
        m.y[k] = s.z[k] * p.coordinate[k] + m.X[i, k]
    copy_rows(m.amps[i], w.amps)


@addressed
def begin_stages(m, h):  # type: ignore[no-untyped-def]
    """Keep what is remembered at the start of a step h, and fill G."""
    q, s = m.relaxing, len(m.c)
    for r in range(len(q.runs)):
        first, size = q.runs[r, 1], q.runs[r, 3]
        for point in range(q.runs[r, 2]):
            # no time has passed there
            q.states[first + point * size + size - 1] = 0.0
    for i in range(len(q.stages)):
        copy(q.states, q.stages[i])
    for k in range(len(q.terms)):
        x = h / q.terms[k, 1]
        for j in range(s):
            y = -m.apart[0, j] * m.mu / (m.mu + x)
            for i in range(s):
                q.G[k, i, j] = m.together[i, 0] * y
            for n in range(len(m.mus)):
                u = -complex(m.apart[1 + 2 * n, j], m.apart[2 + 2 * n, j]) * m.mus[n] / (m.mus[n] + x)
                for i in range(s):
                    q.G[k, i, j] += m.together[i, 1 + 2 * n] * u.real + m.together[i, 2 + 2 * n] * u.imag


@inner
def as_at_start(q):  # type: ignore[no-untyped-def]
    """Let elements remember what they did at the start of the step."""
    if len(q.stages) > 0:
        copy(q.stages[0], q.states)


@inner
def as_at_stage(q, i):  # type: ignore[no-untyped-def]
    """Let elements have at stage i what they remember there."""
    if len(q.stages) > 0:
        copy(q.stages[1 + i], q.states)


@inner
def _strain(m, p, w, s, i):  # type: ignore[no-untyped-def]
    """Fill the strains that are remembered of stage i."""
    q = m.relaxing
    place(m, p, w, s, i)
    to_full(p, m.y, w.amps, 0, w.d)
    set_natural(p, w.amps, w.amps)
    for r in range(len(q.runs)):
        number = (1 + q.runs[r, 6]) * q.runs[r, 4]
        calls.take_strains(p.calls, (group_at(p.groups[q.runs[r, 0]]), w.d, q.runs[r, 1], number, q.stages[1 + i]))


@inner
def _fill(q, r):  # type: ignore[no-untyped-def]
    """Fill the terms of a group at all stages from its strains there."""
    first, points, size, n = q.runs[r, 1], q.runs[r, 2], q.runs[r, 3], q.runs[r, 4]
    term, terms, s = q.runs[r, 5], q.runs[r, 6], len(q.weights)
    for point in range(points):
        at = first + point * size
        for i in range(s):
            for c in range(n):
                q.stages[1 + i, at + c] = 0.0
            q.stages[1 + i, at + size - 1] = 0.0
        for k in range(terms):
            G, g = q.G[term + k], q.terms[term + k, 0]
            for c in range(n):
                h, e = at + (1 + k) * n + c, at + (1 + terms) * n + c
                start = q.stages[0, h] - q.stages[0, e]
                for i in range(s):
                    value = 0.0
                    for j in range(s):
                        value += G[i, j] * (q.stages[1 + j, e] + start)
                    q.stages[1 + i, h] = value
                    q.stages[1 + i, at + c] -= g * value


@addressed
def relax(p, w, s, m):  # type: ignore[no-untyped-def]
    """Fill what is remembered at the stages, from the displacements there; elements remember the start again."""
    q = m.relaxing
    for i in range(len(m.c)):
        _strain(m, p, w, s, i)
    for r in range(len(q.runs)):
        _fill(q, r)
    copy(q.stages[0], q.states)


@inner
def stiffen(q, mu, h, turned):  # type: ignore[no-untyped-def]
    """Let tangents be those of the modulus at mu/h: of its real part, or real and imaginary part where ``turned``."""
    for r in range(len(q.runs)):
        first, size, term, total, part = q.runs[r, 1], q.runs[r, 3], q.runs[r, 5], 0.0, 0.0
        for k in range(term, term + q.runs[r, 6]):
            total += q.terms[k, 0]
            share = mu / (mu + h / q.terms[k, 1])
            part += q.terms[k, 0] * (share.real + (share.imag if turned else 0.0))
        for point in range(q.runs[r, 2]):
            q.states[first + point * size + size - 1] = -max(part / total, NO_SHARE)


@inner
def let_relax(m, p, w, s):  # type: ignore[no-untyped-def]
    """Do as ``relax``, where something does."""
    if len(m.relaxing.runs) > 0:
        calls.relax(m.relaxing.calls, (p, w, s, m))


@addressed
def as_elastic(m, h):  # type: ignore[no-untyped-def]
    """Let tangents be those of a step in which nothing relaxes."""
    stiffen(m.relaxing, complex(0.0, 0.0), h, False)


@addressed
def lost_in_relaxing(p, w, s, m):  # type: ignore[no-untyped-def]
    """Return the energy that the internal strains of a step take, by the quadrature of the stages."""
    q, lost, stages = m.relaxing, 0.0, len(m.c)
    for i in range(stages):
        copy(q.stages[1 + i], q.states)
        place(m, p, w, s, i)
        to_full(p, m.y, w.amps, 0, w.d)
        set_natural(p, w.amps, w.amps)
        for r in range(len(q.runs)):
            first, size, n = q.runs[r, 1], q.runs[r, 3], q.runs[r, 4]
            for point in range(q.runs[r, 2]):
                for at in range(first + point * size, first + point * size + n):
                    # commit returns the stress times what is new beside the old internal strain: rate times weight
                    for j in range(stages):
                        q.states[at] -= q.weights[i] * m.W[i, j] * (q.stages[1 + j, at] - q.stages[0, at])
            lost += calls.commit(p.calls, (group_at(p.groups[q.runs[r, 0]]), w.d))
    copy(q.stages[0], q.states)
    return lost


@addressed
def radau_inside(p, m, h, x):  # type: ignore[no-untyped-def]
    """Let elements remember what they do at the fraction x of the step, by the polynomial through start and stages."""
    q, s = m.relaxing, len(m.c)
    if x == 0.0 or x == 1.0:
        copy(q.stages[s if x == 1.0 else 0], q.states)
        return
    copy(q.stages[0], q.states)
    for r in range(len(q.runs)):
        first, size, points = q.runs[r, 1], q.runs[r, 3], q.runs[r, 2]
        for k in range(first, first + points * size):
            q.states[k] = 0.0
        for j in range(s + 1):
            f, own = 1.0, 0.0 if j == 0 else m.c[j - 1]
            for i in range(s + 1):
                if i != j:
                    other = 0.0 if i == 0 else m.c[i - 1]
                    f *= (x - other) / (own - other)
            for point in range(points):
                at = first + point * size
                for k in range(at, at + size - 1):
                    q.states[k] += f * q.stages[j, k]


@addressed
def radau_taken(p, w, m, x):  # type: ignore[no-untyped-def]
    """Return the energy that internal strains take at the fraction x of a step, where w has d, in the time of the step.

    It is their rate by the polynomial through start and stages under the stress there; what is remembered is lost.
    """
    q, s, lost = m.relaxing, len(m.c), 0.0
    for r in range(len(q.runs)):
        first, size, points, n = q.runs[r, 1], q.runs[r, 3], q.runs[r, 2], q.runs[r, 4]
        for point in range(points):
            at = first + point * size
            for k in range(at, at + size - 1):
                q.states[k] = 0.0
            # the strains are those that are remembered
            q.states[at + size - 1] = -NO_SHARE
        for j in range(s + 1):
            f, rate, own = 1.0, 0.0, 0.0 if j == 0 else m.c[j - 1]
            for i in range(s + 1):
                if i != j:
                    other = 0.0 if i == 0 else m.c[i - 1]
                    rate = (rate * (x - other) + f) / (own - other)
                    f *= (x - other) / (own - other)
            for point in range(points):
                at = first + point * size
                for k in range(at, at + size - 1):
                    # commit returns the stress times what is new beside the old internal strain
                    q.states[k] += (f - rate if k < at + n else f) * q.stages[j, k]
        lost += calls.commit(p.calls, (group_at(p.groups[q.runs[r, 0]]), w.d))
    return lost
