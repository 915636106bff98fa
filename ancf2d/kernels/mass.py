"""Constant matrices of elements into the storage of the tangent, products with it, and stiffness without forming it."""

from __future__ import annotations

import numpy as np

from .elements import gather, sizes, station, turn_vector
from .jit import kernel
from .laws import geometric
from .matrix import scatter


@kernel
def scatter_classes(matrix, Ms, cls, dofs, place, indptr, index, value):  # type: ignore[no-untyped-def]
    """Add Ms[cls[m]] (classes, n, n) of every element m with coordinates dofs (ne, n) to the matrix of the unknowns."""
    for m in range(len(dofs)):
        scatter(matrix, Ms[cls[m]], dofs, m, place, indptr, index, value)


@kernel
def band_product(A, x, y):  # type: ignore[no-untyped-def]
    """Fill y = K x of a symmetric band (kernels.band's storage)."""
    n, w = A.shape
    bw = w - 1
    y[:] = 0.0
    for i in range(n):
        xi, s = x[i], A[i, bw] * x[i]
        for j in range(max(0, i - bw), i):
            a = A[i, bw + j - i]
            s += a * x[j]
            y[j] += a * xi
        y[i] += s


@kernel
def strain_action(group, d, v, out):  # type: ignore[no-untyped-def]
    """Add K(d) v to ``out`` (full coordinates) by way of the strains that v makes.

    The entries of K of fine meshes are large and cancel; strains are small differences taken once, so that this
    keeps digits which the formed matrix has lost.
    """
    law, nc = group.law, group.components
    n, nu, ns = sizes(group)
    de, ve, Qe, u, g = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(nu), np.zeros(nu)
    du, eps, sigma, J, H = np.zeros(nu), np.zeros(ns), np.zeros(ns), np.zeros((ns, nu)), np.zeros((nu, nu))
    deps = np.zeros(ns)
    for ie in range(len(group.dofs)):
        gather(group, ie, d, de)
        gather(group, ie, v, ve)
        c = group.cls[ie]
        Qe[:] = 0.0
        for s in range(law.B.shape[1]):
            station(group, c, s, de, u, eps, sigma, J)
            H[:] = 0.0
            geometric(law, c, s, u, sigma, H)
            for i in range(nu):
                t = 0.0
                for a in range(n):
                    t += law.B[c, s, i, a] * ve[a]
                du[i] = t
            for p in range(ns):
                t = 0.0
                for i in range(nu):
                    t += J[p, i] * du[i]
                deps[p] = t
            for i in range(nu):
                t = 0.0
                for j in range(nu):
                    t += H[i, j] * du[j]
                g[i] = t
            for p in range(ns):
                t = 0.0
                for q in range(ns):
                    t += law.D[c, s, p, q] * deps[q]
                for i in range(nu):
                    g[i] += J[p, i] * t
            for i in range(nu):
                for a in range(n):
                    Qe[a] += g[i] * law.B[c, s, i, a]
        it = ie if len(group.turn) > 1 else 0
        turn_vector(Qe, nc, group.turn[it, 0], group.turn[it, 1])
        for a in range(n):
            out[group.dofs[ie, a]] += Qe[a]
