"""Element forces that keep energy and angular momentum over a step: mean stress on the discrete Jacobian.

With J (u1 - u0) = eps1 - eps0 and sigma = D (eps0 + eps1)/2 the forces B^T J^T sigma do the work U(d1) - U(d0) along
d1 - d0, and no moment about the mid-configuration. Kelvin-Voigt stress adds D tau (eps1 - eps0)/h.
"""

from __future__ import annotations

import numpy as np

from .elements import gather, sizes, turn_vector
from .jit import inlined, kernel
from .laws import mean, strain


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
    de0, de1, u0, u1, Qe = np.zeros(n), np.zeros(n), np.zeros(nu), np.zeros(nu), np.zeros(n)
    eps0, eps1, deps, sigma = np.zeros(ns), np.zeros(ns), np.zeros(ns), np.zeros(ns)
    J, J1 = np.zeros((ns, nu)), np.zeros((ns, nu))
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
