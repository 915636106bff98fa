"""A formulation for small displacements, with the linear part of the Green-Lagrange strain."""

from dataclasses import replace

from ancf2d.extend import FORMULATIONS, StrainLaw, formulation


def strain(ref, u, eps, J, lanes):
    """Strain (eps_tt, eps_nn, 2 eps_tn) of the displacement gradient, and its constant derivative."""
    for l in range(lanes):
        tx, ty, nx, ny = ref[0, l], ref[1, l], ref[2, l], ref[3, l]
        eps[0, l] = tx * u[0, l] + ty * u[1, l]
        eps[1, l] = nx * u[2, l] + ny * u[3, l]
        eps[2, l] = tx * u[2, l] + ty * u[3, l] + nx * u[0, l] + ny * u[1, l]
        J[0, 0, l], J[0, 1, l] = tx, ty
        J[1, 2, l], J[1, 3, l] = nx, ny
        J[2, 0, l], J[2, 1, l] = nx, ny
        J[2, 2, l], J[2, 3, l] = tx, ty


def geometric(ref, u, sigma, J, H, lanes):
    """Add nothing, because the strain is linear."""


formulation(replace(FORMULATIONS["continuum"], name="small_strain", law=StrainLaw(4, 3, 4, strain, geometric),
                    stress=None, green=False, source="textbooks",
                    doc="strain of small displacements, plane stress"))
