"""Element forces that keep energy and angular momentum over a step: mean stress on the discrete Jacobian.

With J (u1 - u0) = eps1 - eps0 and sigma = D (eps0 + eps1)/2 the forces B^T J^T sigma do the work U(d1) - U(d0) along
d1 - d0, and no moment about the mid-configuration. Kelvin-Voigt stress adds D tau (eps1 - eps0)/h.
"""

from __future__ import annotations

from .elements import BATCH, gather, sizes, turn_columns, turn_rows, turn_vector
from .jit import inlined, kernel
from .laws import geometric, mean, strain
from .matrix import scatter_patches
from .stack import array, matrices, vector


@inlined
def _mean_station(group, c, s, tau_over_h, de0, de1, u0, u1, eps0, eps1, deps, sigma, J, J1):  # type: ignore[no-untyped-def]
    """Fill sigma, the discrete J and J1 = d eps1/du1 of one station; return its energy at the end and its loss.

    The strain increment under tau is J (u1 - u0), which keeps digits that the difference of the strains has lost.
    """
    law = group.law
    n, nu, ns = sizes(group)
    for i in range(nu):
        v, w = 0.0, 0.0
        for a in range(n):
            v += law.B[c, s, i, a] * de0[a]
            w += law.B[c, s, i, a] * de1[a]
        u0[i], u1[i] = v, w
    strain(law, c, s, u0, eps0, J)
    strain(law, c, s, u1, eps1, J1)
    mean(law, c, s, u0, u1, eps0, eps1, J)
    for p in range(ns):
        v = 0.0
        for i in range(nu):
            v += J[p, i] * (u1[i] - u0[i])
        deps[p] = v
    energy, lost = 0.0, 0.0
    for p in range(ns):
        v, w, e = 0.0, 0.0, 0.0
        for q in range(ns):
            v += law.D[c, s, p, q] * 0.5 * (eps0[q] + eps1[q])
            w += law.D[c, s, p, q] * deps[q]
            e += law.D[c, s, p, q] * eps1[q]
        sigma[p] = v + tau_over_h * w
        energy += 0.5 * e * eps1[p]
        lost += tau_over_h * w * deps[p]
    return energy, lost


@kernel
def mean_force(group, tau_over_h, d0, d1, Q):  # type: ignore[no-untyped-def]
    """Add B^T J^T D ((eps0 + eps1)/2 + tau/h (eps1 - eps0)) of all elements to Q.

    Returns (strain energy at d1, energy dissipated in the step).
    """
    law, nc = group.law, group.components
    n, nu, ns = sizes(group)
    de0, de1, u0, u1, Qe = vector(n), vector(n), vector(nu), vector(nu), vector(n)
    eps0, eps1, deps, sigma = vector(ns), vector(ns), vector(ns), vector(ns)
    J, J1 = array(ns, nu), array(ns, nu)
    energy, lost = 0.0, 0.0
    for ie in range(len(group.dofs)):
        gather(group, ie, d0, de0)
        gather(group, ie, d1, de1)
        c = group.cls[ie]
        Qe[:] = 0.0
        for s in range(law.B.shape[1]):
            U, W = _mean_station(group, c, s, tau_over_h, de0, de1, u0, u1, eps0, eps1, deps, sigma, J, J1)
            energy += U
            lost += W
            for i in range(nu):
                v = 0.0
                for p in range(ns):
                    v += J[p, i] * sigma[p]
                for a in range(n):
                    Qe[a] += v * law.B[c, s, i, a]
        it = ie if len(group.turn) > 1 else 0
        turn_vector(Qe, nc, group.turn[it, 0], group.turn[it, 1])
        for a in range(n):
            Q[group.dofs[ie, a]] += Qe[a]
    return energy, lost


@inlined
def _mean_hessian(group, c, s, factor, mid, sigma, J, H):  # type: ignore[no-untyped-def]
    """Fill H = factor J^T D J + sigma . d2eps/du2/2, the symmetric part that matters of d(J^T sigma)/du1."""
    law = group.law
    _, nu, ns = sizes(group)
    H[:] = 0.0
    geometric(law, c, s, mid, sigma, H)
    for i in range(nu):
        for j in range(nu):
            H[i, j] *= 0.5
    for p in range(ns):
        for q in range(ns):
            dpq = factor * law.D[c, s, p, q]
            if dpq != 0.0:
                for i in range(nu):
                    v = dpq * J[p, i]
                    if v != 0.0:
                        for j in range(nu):
                            H[i, j] += v * J[q, j]


@inlined
def _add_sandwich(group, c, s, J, sigma, H, HB, Qe, Ke):  # type: ignore[no-untyped-def]
    """Add B^T J^T sigma and B^T H B."""
    law = group.law
    n, nu, ns = sizes(group)
    for i in range(nu):
        g = 0.0
        for p in range(ns):
            g += J[p, i] * sigma[p]
        for a in range(n):
            Qe[a] += g * law.B[c, s, i, a]
            HB[i, a] = 0.0
        for j in range(nu):
            h = H[i, j]
            if h != 0.0:
                for a in range(n):
                    HB[i, a] += h * law.B[c, s, j, a]
        for a in range(n):
            b = law.B[c, s, i, a]
            if b != 0.0:
                for k in range(n):
                    Ke[a, k] += b * HB[i, k]


@kernel
def mean_matrices(group, tau_over_h, d0, d1, first, Q, K):  # type: ignore[no-untyped-def]
    """Fill forces (m, n) as ``mean_force`` and symmetric tangents by d1 (m, n, n) of elements first, first + 1, ...

    K = B^T ((1/2 + tau/h) J^T D J + sigma . d2eps/du2/2) B with the mean stress at the mid-configuration: there the
    strain of the mid-configuration itself is no guide, as a turn by w shortens what lies between two states by w^2/8.
    The derivative itself has J1 for the second J. Returns (strain energy at d1, energy dissipated).
    """
    law, nc = group.law, group.components
    n, nu, ns = sizes(group)
    de0, de1, u0, u1 = vector(n), vector(n), vector(nu), vector(nu)
    eps0, eps1, deps, sigma = vector(ns), vector(ns), vector(ns), vector(ns)
    J, J1, H, HB = array(ns, nu), array(ns, nu), array(nu, nu), array(nu, n)
    energy, lost = 0.0, 0.0
    for m in range(len(Q)):
        ie = first + m
        gather(group, ie, d0, de0)
        gather(group, ie, d1, de1)
        c = group.cls[ie]
        Q[m] = 0.0
        K[m] = 0.0
        for s in range(law.B.shape[1]):
            U, W = _mean_station(group, c, s, tau_over_h, de0, de1, u0, u1, eps0, eps1, deps, sigma, J, J1)
            energy += U
            lost += W
            for i in range(nu):
                u1[i] = 0.5 * (u0[i] + u1[i])
            _mean_hessian(group, c, s, 0.5 + tau_over_h, u1, sigma, J, H)
            _add_sandwich(group, c, s, J, sigma, H, HB, Q[m], K[m])
        it = ie if len(group.turn) > 1 else 0
        tc, ts = group.turn[it, 0], group.turn[it, 1]
        if ts != 0.0 or tc != 1.0:
            turn_vector(Q[m], nc, tc, ts)
            turn_rows(K[m], nc, tc, ts)
            turn_columns(K[m], nc, tc, ts)
    return energy, lost


@kernel
def mean_force_tangent(group, tau_over_h, d0, d1, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """As ``mean_force``, and add the symmetric tangent by d1 to the matrix of the unknowns."""
    n = group.law.B.shape[3]
    batch = max(1, min(BATCH // (n * n), len(group.dofs)))
    Qe, Ke = array(batch, n), matrices(batch, n, n)
    energy, lost = 0.0, 0.0
    for first in range(0, len(group.dofs), batch):
        count = min(batch, len(group.dofs) - first)
        U, W = mean_matrices(group, tau_over_h, d0, d1, first, Qe[:count], Ke[:count])
        energy += U
        lost += W
        scatter_patches(matrix, Ke, group.dofs, first, count, place, indptr, index, value)
        for m in range(count):
            for a in range(n):
                Q[group.dofs[first + m, a]] += Qe[m, a]
    return energy, lost
