"""The linearised equations of the steps of a motion: factors, forward (tangent) and backward (adjoint) solution.

The matrix of a step of s stages is a band, in which the stages of an unknown are adjacent.
"""

from __future__ import annotations

from ..lowlevel.arrays import copy_rows
from ..lowlevel.jit import inner, kernel


@inner
def _fill(step, K, C, mass, rows, columns, free, rates, bw, LU):  # type: ignore[no-untyped-def]
    """Fill LU (n s, 3 bw + 1), row by row with the diagonal at bw, with the matrix of a step."""
    s = rates.shape[2]
    for r in range(LU.shape[0]):
        for c in range(LU.shape[1]):
            LU[r, c] = 0.0
    for e in range(len(mass)):
        for i in range(s):
            r = rows[e] * s + i
            for j in range(s):
                x = rates[step, 0, i, j] * C[step * s + i, e] + rates[step, 1, i, j] * mass[e]
                LU[r, columns[e] * s + j - r + bw] = free[columns[e]] * x
            LU[r, columns[e] * s + i - r + bw] += K[step * s + i, e]


@inner
def _eliminate(bw, LU, pivots):  # type: ignore[no-untyped-def]
    """Factor a band with row exchanges; return whether it is regular.

    ``pivots`` (2, n) are the rows exchanged, and the last column of each row afterwards.
    """
    n, end = LU.shape[0], 0
    for k in range(n):
        last, best = min(n - 1, k + bw), k
        for r in range(k + 1, last + 1):
            if abs(LU[r, k - r + bw]) > abs(LU[best, k - best + bw]):
                best = r
        end = max(end, min(n - 1, best + bw))
        pivots[0, k], pivots[1, k] = best, end
        if not abs(LU[best, k - best + bw]) > 0.0:
            return False
        if best != k:
            for c in range(k, end + 1):
                x = LU[k, c - k + bw]
                LU[k, c - k + bw] = LU[best, c - best + bw]
                LU[best, c - best + bw] = x
        for r in range(k + 1, last + 1):
            f = LU[r, k - r + bw] / LU[k, bw]
            LU[r, k - r + bw] = f
            if f != 0.0:
                first = k - r + bw
                for c in range(1, end - k + 1):
                    LU[r, first + c] -= f * LU[k, bw + c]
    return True


@inner
def _swap(b, k, p):  # type: ignore[no-untyped-def]
    """Exchange two rows of b (n s, k)."""
    if p != k:
        for q in range(b.shape[1]):
            x = b[k, q]
            b[k, q] = b[p, q]
            b[p, q] = x


@inner
def _solve(bw, LU, pivots, b):  # type: ignore[no-untyped-def]
    """Solve with the factors of a band; the solution overwrites the right-hand sides b (n s, k)."""
    n, m = b.shape
    for k in range(n):
        _swap(b, k, pivots[0, k])
        for r in range(k + 1, min(n, k + bw + 1)):
            f = LU[r, k - r + bw]
            if f != 0.0:
                for q in range(m):
                    b[r, q] -= f * b[k, q]
    for k in range(n - 1, -1, -1):
        for c in range(k + 1, pivots[1, k] + 1):
            f = LU[k, c - k + bw]
            if f != 0.0:
                for q in range(m):
                    b[k, q] -= f * b[c, q]
        f = 1.0 / LU[k, bw]
        for q in range(m):
            b[k, q] *= f


@inner
def _solve_transposed(bw, LU, pivots, b):  # type: ignore[no-untyped-def]
    """Solve with the transpose of a factored band; the solution overwrites the right-hand sides b (n s, k)."""
    n, m = b.shape
    for k in range(n):
        f = 1.0 / LU[k, bw]
        for q in range(m):
            b[k, q] *= f
        for c in range(k + 1, pivots[1, k] + 1):
            f = LU[k, c - k + bw]
            if f != 0.0:
                for q in range(m):
                    b[c, q] -= f * b[k, q]
    for k in range(n - 1, -1, -1):
        for r in range(k + 1, min(n, k + bw + 1)):
            f = LU[r, k - r + bw]
            if f != 0.0:
                for q in range(m):
                    b[k, q] -= f * b[r, q]
        _swap(b, k, pivots[0, k])


@kernel
def factor(K, C, mass, rows, columns, free, rates, bw, LU, pivots):  # type: ignore[no-untyped-def]
    """Fill LU (steps, n s, 3 bw + 1) and pivots (steps, 2, n s) with the factors of all steps.

    K, C (steps s, entries), mass (entries,) are the matrices of the stages, at rows and columns; rates
    (steps, 2, s, s) give v and a of the stages from z. Returns the first step whose matrix is singular, or the number
    of steps.
    """
    for step in range(LU.shape[0]):
        _fill(step, K, C, mass, rows, columns, free, rates, bw, LU[step])
        if not _eliminate(bw, LU[step], pivots[step]):
            return step
    return LU.shape[0]


@inner
def _begin(step, start, free, begins, v, a):  # type: ignore[no-untyped-def]
    """Fill v and a (stages, n, k) of a step with the contribution of the change of its start (4, n, k)."""
    s = begins.shape[2]
    for i in range(s):
        for r in range(v.shape[1]):
            for q in range(v.shape[2]):
                one, two = 0.0, 0.0
                for j in range(4):
                    one += begins[step, 0, i, j] * start[j, r, q]
                    two += begins[step, 1, i, j] * start[j, r, q]
                v[step * s + i, r, q], a[step * s + i, r, q] = free[r] * one, free[r] * two


@inner
def _load(step, s, C, mass, rows, columns, rubs, dR, v, a, b):  # type: ignore[no-untyped-def]
    """Fill b (n s, k) with -(dR + C v + M a) of the stages of a step."""
    n, m = dR.shape[1], dR.shape[2]
    for i in range(s):
        g = step * s + i
        for r in range(n):
            for q in range(m):
                b[r * s + i, q] = -dR[g, r, q]
        for e in range(len(mass)):
            r, c = rows[e] * s + i, columns[e]
            f, h = mass[e], C[g, e] if rubs else 0.0
            for q in range(m):
                b[r, q] -= f * a[g, c, q] + h * v[g, c, q]


@kernel
def forward(LU, pivots, bw, C, mass, rows, columns, free, rubs, rates, begins, kept,  # type: ignore[no-untyped-def]
           dR, b, z, v, a, ends):
    """Fill z, v, a (steps s, n, k) with the changes of all stages, and ends (steps + 1, 4, n, k) from ends[0] on.

    dR (steps s, n, k) are the changes of the residuals; begins (steps, 2, s, 4) give rates and second rates of the
    stages from the change (z, v, a, the method's stored values) of a start; kept (steps, 5) gives the method's stored
    values at the end from z there and from the change of the start; b (n s, k) is work space.
    """
    s = rates.shape[2]
    for step in range(LU.shape[0]):
        start, end, last = ends[step], ends[step + 1], step * s + s - 1
        _begin(step, start, free, begins, v, a)
        _load(step, s, C, mass, rows, columns, rubs, dR, v, a, b)
        _solve(bw, LU[step], pivots[step], b)
        for r in range(z.shape[1]):
            for q in range(z.shape[2]):
                for i in range(s):
                    g = step * s + i
                    one, two = 0.0, 0.0
                    for j in range(s):
                        one += rates[step, 0, i, j] * b[r * s + j, q]
                        two += rates[step, 1, i, j] * b[r * s + j, q]
                    z[g, r, q] = b[r * s + i, q]
                    v[g, r, q] += free[r] * one
                    a[g, r, q] += free[r] * two
                end[0, r, q], end[1, r, q], end[2, r, q] = z[last, r, q], v[last, r, q], a[last, r, q]
                x = kept[step, 0] * z[last, r, q]
                for j in range(4):
                    x += kept[step, j + 1] * start[j, r, q]
                end[3, r, q] = x


@inner
def _goals(step, s, free, rates, zb, vb, ab, b):  # type: ignore[no-untyped-def]
    """Fill b (n s, k) with the derivatives of the goals by positions at the stages of a step, on which v and a depend.

    zb, vb, ab (stages, n, k) are the partial derivatives by positions, rates and second rates there.
    """
    for j in range(s):
        for r in range(zb.shape[1]):
            for q in range(zb.shape[2]):
                x = 0.0
                for i in range(s):
                    g = step * s + i
                    x += rates[step, 0, i, j] * vb[g, r, q] + rates[step, 1, i, j] * ab[g, r, q]
                b[r * s + j, q] = zb[step * s + j, r, q] + free[r] * x


@kernel
def backward(LU, pivots, bw, C, mass, rows, columns, free, rubs, rates, begins, kept,  # type: ignore[no-untyped-def]
         zb, vb, ab, b, lam, starts, end):
    """Fill lam (steps s, n, k), the adjoint variables: goals change by -lam dR for changes dR of the stages' residuals.

    end (4, n, k) are the derivatives of the goals by the last end; it becomes those by the first start. starts
    (steps, 4, n, k) and zb, vb, ab (steps s, n, k) are the direct derivatives by starts and stages; they are
    overwritten. All else is as in ``forward``.
    """
    s, n, m = rates.shape[2], zb.shape[1], zb.shape[2]
    for step in range(LU.shape[0] - 1, -1, -1):
        last = step * s + s - 1
        for r in range(n):
            for q in range(m):
                zb[last, r, q] += end[0, r, q] + kept[step, 0] * end[3, r, q]
                vb[last, r, q] += end[1, r, q]
                ab[last, r, q] += end[2, r, q]
        _goals(step, s, free, rates, zb, vb, ab, b)
        _solve_transposed(bw, LU[step], pivots[step], b)
        for i in range(s):
            g = step * s + i
            for r in range(n):
                for q in range(m):
                    lam[g, r, q] = b[r * s + i, q]
            # C and M are symmetric
            for e in range(len(mass)):
                r, c, f, h = rows[e], columns[e], mass[e], C[g, e] if rubs else 0.0
                for q in range(m):
                    ab[g, r, q] -= f * lam[g, c, q]
                    vb[g, r, q] -= h * lam[g, c, q]
        for j in range(4):
            for r in range(n):
                for q in range(m):
                    x = 0.0
                    for i in range(s):
                        g = step * s + i
                        x += begins[step, 0, i, j] * vb[g, r, q] + begins[step, 1, i, j] * ab[g, r, q]
                    starts[step, j, r, q] += free[r] * x + kept[step, j + 1] * end[3, r, q]
        for j in range(4):
            copy_rows(starts[step, j], end[j])
