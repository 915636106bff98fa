"""Element forces that keep energy and angular momentum over a step: mean stress on the discrete Jacobian.

With J (u1 - u0) = eps1 - eps0 and sigma = D (eps0 + eps1)/2 the forces B^T J^T sigma do the work U(d1) - U(d0) along
d1 - d0, and no moment about the mid-configuration. Kelvin-Voigt stress adds D tau (eps1 - eps0)/h. Natural strains are
taken off both strains; where they change, they do the work -sigma . (eps*1 - eps*0).
"""

from __future__ import annotations

from .batch import add_forces, batch_length
from .forces import STEP, STEP_TANGENT, WORK, call_batch, results
from .lowlevel.jit import kernel
from .matrices.matrix import scatter_packed


@kernel
def mean_force(group, tau_over_h, d0, d1, Q):  # type: ignore[no-untyped-def]
    """Add B^T J^T D ((eps0 + eps1)/2 + tau/h (eps1 - eps0)) of all elements to Q, J the discrete Jacobian.

    Returns (strain energy at d1, energy dissipated in the step).
    """
    energy, lost, first, last = 0.0, 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        U, W = call_batch(group.plan.forces, (STEP, group, d0, d1, first, count, 0, tau_over_h))
        energy += U
        lost += W
        Qe, _ = results(group, count)
        add_forces(group, Qe, first, count, Q)
        first += count
    return energy, lost


@kernel
def mean_force_tangent(group, tau_over_h, d0, d1, Q, matrix, place, indptr, index,
                       value):  # type: ignore[no-untyped-def]
    """As ``mean_force``, and add the symmetric tangent by d1 to the matrix of the unknowns."""
    energy, lost, first, last = 0.0, 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        U, W = call_batch(group.plan.forces, (STEP_TANGENT, group, d0, d1, first, count, 0, tau_over_h))
        energy += U
        lost += W
        Qe, Ke = results(group, count)
        add_forces(group, Qe, first, count, Q)
        scatter_packed(matrix, Ke, 1.0, group.plan.entries, group.dofs, first, place, indptr, index, value)
        first += count
    return energy, lost


@kernel
def natural_work(group, tau_over_h, d0, d1):  # type: ignore[no-untyped-def]
    """Return the work of changing natural strains in a step, by the stresses of ``mean_force``."""
    work, first, last = 0.0, 0, len(group.dofs)
    while first < last:
        count = batch_length(group, first, last)
        work += call_batch(group.plan.forces, (WORK, group, d0, d1, first, count, 0, tau_over_h))[1]
        first += count
    return work
