"""A fibre with friction: beside an elastic part of the axial stiffness, one that slips beyond a strain."""

from dataclasses import replace

from ancf2d.extend import FORMULATIONS, StrainLaw, formulation

SHARE, LIMIT = 0.6, 1e-3  # of the stiffness that can slip; its largest elastic strain


def internal(ref, eps, old, new, slope, lanes):
    """Fill internal strains (axial, shear, curvature), the slip and what follows them, from axial strain."""
    for l in range(lanes):
        slip = old[3, l]
        over = abs(eps[0, l] - slip) - LIMIT
        # a fibre on the verge sticks
        slips = over > 1e-9 * LIMIT
        if slips:
            slip = eps[0, l] - LIMIT if eps[0, l] > slip else eps[0, l] + LIMIT
        new[0, l], new[1, l], new[2, l], new[3, l] = SHARE * slip, 0.0, 0.0, slip
        slope[0, 0, l] = SHARE if slips else 0.0


exact = FORMULATIONS["geometrically_exact"]
law = StrainLaw(4, 3, 4, exact.law.strain, exact.law.geometric, state=4, internal=internal)
formulation(replace(exact, name="friction", law=law, source="Iwan 1967", doc="axial stiffness with friction"))
