"""Element kernels, generic in the element type and the formulation.

With u = B d (d: the element's displacements in its own frame), eps = eps(u), sigma = D eps:
U = eps.sigma/2, Q_e = B^T J^T sigma, K = B^T (J^T D J + sigma . d2eps/du2) B, J = d eps/du.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .jit import inlined, kernel
from .laws import geometric, strain
from .matrix import scatter_patches

# entries of the batch of element matrices that stays in the first-level cache
BATCH = 4096


class Group(NamedTuple):
    """Elements of one type and formulation, as the kernels see them.

    law : sampled law; cls : (ne,) class of each element; turn : (ne, 2) or (1, 2) cosine and sine of the
    element frame; dofs : (ne, n_dof) coordinates.
    """

    law: Any
    cls: Any
    turn: Any
    dofs: Any
    components: int


@inlined
def sizes(group):  # type: ignore[no-untyped-def]
    """Return (n_dof, fields, strains).

    Known at run time only: sizes known to the compiler gain nothing measurable, and each would compile anew.
    """
    return group.law.B.shape[3], group.law.B.shape[2], group.law.D.shape[2]


@inlined
def gather(group, ie, d, out):  # type: ignore[no-untyped-def]
    """Copy the displacements of element ie, turned into its frame."""
    nc = group.components
    t = ie if len(group.turn) > 1 else 0
    c, s = group.turn[t, 0], group.turn[t, 1]
    for k in range(0, group.dofs.shape[1], nc):
        x, y = d[group.dofs[ie, k]], d[group.dofs[ie, k + 1]]
        out[k] = c * x + s * y
        out[k + 1] = c * y - s * x
        for m in range(2, nc):
            out[k + m] = d[group.dofs[ie, k + m]]


@kernel
def turn_rows(A, nc, c, s):  # type: ignore[no-untyped-def]
    for k in range(0, len(A), nc):
        for b in range(A.shape[1]):
            x, y = A[k, b], A[k + 1, b]
            A[k, b] = c * x - s * y
            A[k + 1, b] = c * y + s * x


@inlined
def turn_vector(v, nc, c, s):  # type: ignore[no-untyped-def]
    for k in range(0, len(v), nc):
        x, y = v[k], v[k + 1]
        v[k] = c * x - s * y
        v[k + 1] = c * y + s * x


@kernel
def turn_columns(A, nc, c, s):  # type: ignore[no-untyped-def]
    for a in range(len(A)):
        for k in range(0, A.shape[1], nc):
            x, y = A[a, k], A[a, k + 1]
            A[a, k] = c * x - s * y
            A[a, k + 1] = c * y + s * x


@inlined
def station(group, c, s, de, u, eps, sigma, J):  # type: ignore[no-untyped-def]
    """Fill u, eps, sigma and J of one station; return its energy."""
    n, nu, ns = sizes(group)
    law = group.law
    for i in range(nu):
        v = 0.0
        for a in range(n):
            v += law.B[c, s, i, a] * de[a]
        u[i] = v
    strain(law, c, s, u, eps, J)
    energy = 0.0
    for i in range(ns):
        v = 0.0
        for j in range(ns):
            v += law.D[c, s, i, j] * eps[j]
        sigma[i] = v
        energy += 0.5 * v * eps[i]
    return energy


@inlined
def _element_force(group, c, de, u, eps, sigma, J, g, Qe):  # type: ignore[no-untyped-def]
    """Fill Q_e in the element frame; return the strain energy."""
    law = group.law
    n, nu, ns = sizes(group)
    Qe[:] = 0.0
    energy = 0.0
    for s in range(law.B.shape[1]):
        energy += station(group, c, s, de, u, eps, sigma, J)
        for i in range(nu):
            v = 0.0
            for j in range(ns):
                v += J[j, i] * sigma[j]
            g[i] = v
            for a in range(n):
                Qe[a] += v * law.B[c, s, i, a]
    return energy


@inlined
def _element_tangent(group, c, de, u, eps, sigma, J, g, H, HB, Qe, Ke):  # type: ignore[no-untyped-def]
    """Fill Q_e and K in the element frame; return the strain energy."""
    law = group.law
    n, nu, ns = sizes(group)
    Qe[:] = 0.0
    Ke[:] = 0.0
    energy = 0.0
    for s in range(law.B.shape[1]):
        energy += station(group, c, s, de, u, eps, sigma, J)
        for i in range(nu):
            g[i] = 0.0
            for j in range(nu):
                H[i, j] = 0.0
        for p in range(ns):
            for q in range(ns):
                dpq = law.D[c, s, p, q]
                if dpq != 0.0:
                    for i in range(nu):
                        v = dpq * J[p, i]
                        if v != 0.0:
                            for j in range(nu):
                                H[i, j] += v * J[q, j]
            for i in range(nu):
                g[i] += J[p, i] * sigma[p]
        geometric(law, c, s, u, sigma, H)
        for i in range(nu):
            for a in range(n):
                Qe[a] += g[i] * law.B[c, s, i, a]
                HB[i, a] = 0.0
            for j in range(nu):
                h = H[i, j]
                if h != 0.0:
                    for a in range(n):
                        HB[i, a] += h * law.B[c, s, j, a]
        for i in range(nu):
            for a in range(n):
                b = law.B[c, s, i, a]
                if b != 0.0:
                    for k in range(n):
                        Ke[a, k] += b * HB[i, k]
    return energy


@kernel
def force(group, d, Q):  # type: ignore[no-untyped-def]
    """Add the elastic forces Q_e of all elements to Q; return the strain energy."""
    nc = group.components
    n, nu, ns = sizes(group)
    de, u, g, Qe = np.zeros(n), np.zeros(nu), np.zeros(nu), np.zeros(n)
    eps, sigma, J = np.zeros(ns), np.zeros(ns), np.zeros((ns, nu))
    energy = 0.0
    for ie in range(len(group.dofs)):
        gather(group, ie, d, de)
        energy += _element_force(group, group.cls[ie], de, u, eps, sigma, J, g, Qe)
        it = ie if len(group.turn) > 1 else 0
        tc, ts = group.turn[it, 0], group.turn[it, 1]
        turn_vector(Qe, nc, tc, ts)
        for a in range(n):
            Q[group.dofs[ie, a]] += Qe[a]
    return energy


@kernel
def element_matrices(group, d, first, Q, K):  # type: ignore[no-untyped-def]
    """Fill Q (m, n) and K (m, n, n) of elements first, first + 1, ... in global components; return their energy."""
    nc = group.components
    n, nu, ns = sizes(group)
    de, u, g, Qe = np.zeros(n), np.zeros(nu), np.zeros(nu), np.zeros(n)
    eps, sigma, J = np.zeros(ns), np.zeros(ns), np.zeros((ns, nu))
    H, HB = np.zeros((nu, nu)), np.zeros((nu, n))
    energy = 0.0
    for m in range(len(Q)):
        ie = first + m
        gather(group, ie, d, de)
        energy += _element_tangent(group, group.cls[ie], de, u, eps, sigma, J, g, H, HB, Qe, K[m])
        it = ie if len(group.turn) > 1 else 0
        tc, ts = group.turn[it, 0], group.turn[it, 1]
        if ts != 0.0 or tc != 1.0:
            turn_vector(Qe, nc, tc, ts)
            turn_rows(K[m], nc, tc, ts)
            turn_columns(K[m], nc, tc, ts)
        for a in range(n):
            Q[m, a] = Qe[a]
    return energy


@kernel
def scaled_force_tangent(group, d, scale, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add Q_e to Q and ``scale`` K to the matrix of the unknowns; return the strain energy.

    Element matrices are made a cache-sized batch at a time: the law's code is compiled once for every use.
    """
    n = group.law.B.shape[3]
    batch = max(1, min(BATCH // (n * n), len(group.dofs)))
    Qe, Ke = np.zeros((batch, n)), np.zeros((batch, n, n))
    energy = 0.0
    for first in range(0, len(group.dofs), batch):
        count = min(batch, len(group.dofs) - first)
        energy += element_matrices(group, d, first, Qe[:count], Ke[:count])
        if scale != 1.0:
            Ke[:count] *= scale
        scatter_patches(matrix, Ke, group.dofs, first, count, place, indptr, index, value)
        for m in range(count):
            for a in range(n):
                Q[group.dofs[first + m, a]] += Qe[m, a]
    return energy


@kernel
def force_tangent(group, d, Q, matrix, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add Q_e to Q and K to the matrix of the unknowns; return the strain energy."""
    return scaled_force_tangent(group, d, 1.0, Q, matrix, place, indptr, index, value)


@kernel
def tangent_action(group, d, v, out):  # type: ignore[no-untyped-def]
    """Add K(d) v, summed over elements in full coordinates, to ``out``."""
    n = group.law.B.shape[3]
    batch = max(1, BATCH // (n * n))
    Qe, Ke = np.zeros((batch, n)), np.zeros((batch, n, n))
    for first in range(0, len(group.dofs), batch):
        count = min(batch, len(group.dofs) - first)
        element_matrices(group, d, first, Qe[:count], Ke[:count])
        for m in range(count):
            for a in range(n):
                s = 0.0
                for b in range(n):
                    s += Ke[m, a, b] * v[group.dofs[first + m, b]]
                out[group.dofs[first + m, a]] += s


@kernel
def force_noise(group, d, out):  # type: ignore[no-untyped-def]
    """Add what a unit relative error of every product of Q_e = B^T J^T D eps(B d) can sum up to.

    Times the unit round-off this bounds the error of the forces, cancellation inside the element included.
    """
    law = group.law
    n, nu, ns = sizes(group)
    de, u, J = np.zeros(n), np.zeros(nu), np.zeros((ns, nu))
    eps, sigma, ub, sb = np.zeros(ns), np.zeros(ns), np.zeros(nu), np.zeros(ns)
    for ie in range(len(group.dofs)):
        gather(group, ie, d, de)
        c = group.cls[ie]
        for s in range(law.B.shape[1]):
            station(group, c, s, de, u, eps, sigma, J)
            B, D = law.B[c, s], law.D[c, s]
            for i in range(nu):
                ub[i] = 0.0
                for a in range(n):
                    ub[i] += abs(B[i, a] * de[a])
            for p in range(ns):
                sb[p] = 0.0
                for i in range(nu):
                    sb[p] += abs(J[p, i]) * ub[i]
            for i in range(nu):
                g = 0.0
                for p in range(ns):
                    t = 0.0
                    for q in range(ns):
                        t += abs(D[p, q]) * sb[q]
                    g += abs(J[p, i]) * t
                for a in range(n):
                    out[group.dofs[ie, a]] += abs(B[i, a]) * g


@kernel
def stations(group, d, eps_out, sigma_out):  # type: ignore[no-untyped-def]
    """Fill the strains and D eps at every station: (ne, stations, n_eps) each."""
    law = group.law
    n, nu, ns = sizes(group)
    de, u, J = np.zeros(n), np.zeros(nu), np.zeros((ns, nu))
    for ie in range(len(group.dofs)):
        gather(group, ie, d, de)
        for s in range(law.B.shape[1]):
            station(group, group.cls[ie], s, de, u, eps_out[ie, s], sigma_out[ie, s], J)
