"""Predictions of a step, from which Newton's method starts, and the choice among them.

0: z, the start of the step; 1: z + h v; 2: the method's own, which extrapolates more. Where steps do not resolve stiff
vibrations, extrapolation amplifies these, so that fibres are predicted to yield or elements to be inverted. The number
PREDICTION of a motion is the one for a step: the longest, unless a shorter one was better in the step before.
"""

from __future__ import annotations

import numpy as np

from ..lowlevel.jit import inner
from ..lowlevel.records import array_at
from .dynamics import norm
from .stages import TILE, combine
from .state import OLD_STEP

# a shorter prediction is better than a longer one if its error is below this fraction of that one's
BETTER = 0.5


@inner
def best_prediction(p, w, s, h, change, longest):  # type: ignore[no-untyped-def]
    """Return the prediction that would have been best for a step with the increments ``change`` (n,).

    ``longest`` (n,) is prediction 2 of these. Contacts and controllers that switch always need it: if they are wrong at
    the first iterate, Newton's method may alternate.
    """
    if p.sided or p.least_iterations > 1:
        return 2.0
    best, found = np.inf, 2.0
    for k in range(2, -1, -1):
        for i in range(len(change)):
            predicted = longest[i] if k == 2 else h * s.v[i] if k == 1 else 0.0
            w.R[i] = p.coordinate[i] * (change[i] - predicted)
        error = norm(p, w.R)
        if error < BETTER * best:
            best, found = error, float(k)
    return found


@inner
def _combine_all(F, X, out):  # type: ignore[no-untyped-def]
    """Fill out (s, n) with F X."""
    s, n = X.shape
    for first in range(0, n, TILE):
        for i in range(s):
            combine(F, i, X, first, out, i * n + first, min(TILE, n - first))


@inner
def _extrapolate(c, x, out):  # type: ignore[no-untyped-def]
    """Fill out (stages,) with the Lagrange polynomials on 0 and the nodes c, without that of 0, at x."""
    for j in range(len(c)):
        f = x / c[j]
        for q in range(len(c)):
            if q != j:
                f *= (x - c[q]) / (c[j] - c[q])
        out[j] = f


@inner
def predict_stages(m, p, s, h, prediction):  # type: ignore[no-untyped-def]
    """Fill m.X with a prediction of Radau's stages; the longest one extrapolates the last step's polynomials.

    After a restart, that is the series in h up to h^2. Without extrapolation, multipliers keep their values.
    """
    stages, n = m.X.shape
    old = s.numbers[OLD_STEP]
    if old <= 0.0 or prediction < 2.0:
        for i in range(stages):
            ch = m.c[i] * h
            first, second = ch * min(prediction, 1.0), 0.5 * ch * ch * max(prediction - 1.0, 0.0)
            for k in range(n):
                m.X[i, k] = first * s.v[k] + second * s.a[k] if p.coordinate[k] != 0.0 else s.z[k]
        return
    for i in range(stages):
        _extrapolate(m.c, 1.0 + m.c[i] * h / old, m.F[i])
    _combine_all(m.F, array_at(s.extra, 0, (stages, n)), m.X)
    for i in range(stages):
        x = 1.0 + m.c[i] * h / old
        for k in range(n):
            m.X[i, k] -= s.extra[stages - 1, k]
        for k in m.multipliers:
            # on the nodes alone
            m.X[i, k] = 0.0
            for j in range(stages):
                m.X[i, k] += m.F[i, j] * m.c[j] / x * s.extra[j, k]


@inner
def best_prediction_of_stages(m, p, w, s, h):  # type: ignore[no-untyped-def]
    """Return the prediction that would have been best at the end of a step whose stages are in m.X."""
    stages, n = m.X.shape
    last, old, F = stages - 1, s.numbers[OLD_STEP], m.F[0]
    if old > 0.0:
        _extrapolate(m.c, 1.0 + h / old, F)
        for first in range(0, n, TILE):
            combine(m.F, 0, array_at(s.extra, 0, (stages, n)), first, w.x, first, min(TILE, n - first))
    for i in range(n):
        w.x[i] = w.x[i] - s.extra[last, i] if old > 0.0 else h * (s.v[i] + 0.5 * h * s.a[i])
    return best_prediction(p, w, s, h, m.X[last], w.x)
