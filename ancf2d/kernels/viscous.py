"""Viscous forces of elements: Kelvin-Voigt stress D tau d eps/dt, free of rigid motion."""

from __future__ import annotations

from .elements import gather, sizes, turn_vector
from .jit import kernel
from .laws import strain
from .stack import array, vector


@kernel
def viscous_force(group, tau, d, v, Q):  # type: ignore[no-untyped-def]
    """Add B^T J^T D tau J B v of all elements to Q; return the power that they take out, eps'^T D tau eps'."""
    law, nc = group.law, group.components
    n, nu, ns = sizes(group)
    de, ve, u, w, Qe = vector(n), vector(n), vector(nu), vector(nu), vector(n)
    eps, rate, sigma, J = vector(ns), vector(ns), vector(ns), array(ns, nu)
    power = 0.0
    for ie in range(len(group.dofs)):
        gather(group, ie, d, de)
        gather(group, ie, v, ve)
        c = group.cls[ie]
        Qe[:] = 0.0
        for s in range(law.B.shape[1]):
            for i in range(nu):
                x, y = 0.0, 0.0
                for a in range(n):
                    x += law.B[c, s, i, a] * de[a]
                    y += law.B[c, s, i, a] * ve[a]
                u[i], w[i] = x, y
            strain(law, c, s, u, eps, J)
            for p in range(ns):
                x = 0.0
                for i in range(nu):
                    x += J[p, i] * w[i]
                rate[p] = x
            for p in range(ns):
                x = 0.0
                for q in range(ns):
                    x += law.D[c, s, p, q] * rate[q]
                sigma[p] = tau * x
                power += tau * x * rate[p]
            for i in range(nu):
                x = 0.0
                for p in range(ns):
                    x += J[p, i] * sigma[p]
                for a in range(n):
                    Qe[a] += x * law.B[c, s, i, a]
        it = ie if len(group.turn) > 1 else 0
        turn_vector(Qe, nc, group.turn[it, 0], group.turn[it, 1])
        for a in range(n):
            Q[group.dofs[ie, a]] += Qe[a]
    return power
