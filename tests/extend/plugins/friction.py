"""Axial friction: a part of the axial stiffness slips beyond a limit strain; the rest is elastic."""

from dataclasses import replace

from ancf2d.extend import FORMULATIONS, StrainLaw, formulation

SHARE, LIMIT = 0.6, 1e-3  # share of the stiffness that can slip, and its largest elastic strain


def internal(ref, eps, old, new, slope, lanes):
    """Fill internal strains (axial, shear, curvature), the slip, and the slope, from the axial strain."""
    for l in range(lanes):
        slip = old[3, l]
        over = abs(eps[0, l] - slip) - LIMIT
        # at the limit it sticks
        slips = over > 1e-9 * LIMIT
        if slips:
            slip = eps[0, l] - LIMIT if eps[0, l] > slip else eps[0, l] + LIMIT
        new[0, l], new[1, l], new[2, l], new[3, l] = SHARE * slip, 0.0, 0.0, slip
        slope[0, 0, l] = SHARE if slips else 0.0


def stored(ref, D, eps, state):
    """Return the energy that slip stores in the stress-free body: both parts are then strained against each other."""
    return SHARE * (1.0 - SHARE) * D[:, 0, 0] * state[:, :, 0, 3] ** 2 / 2.0


exact = FORMULATIONS["geometrically_exact"]
law = StrainLaw(4, 3, 4, exact.law.strain, exact.law.geometric, state=4, internal=internal, extra_energy=stored)
formulation(replace(exact, name="friction", law=law, source="Iwan 1967", doc="axial stiffness with friction"))
