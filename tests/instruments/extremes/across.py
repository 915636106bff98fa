"""Transverse tension: bodies shorter than their height that rotate about their middle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

from .cell import Cell, Found
from .scenes import BY_LABEL, SUBJECTS, Beam, apart, solve

SHORT = 0.01  # length over height
# what stress along does to strain across is (L/h)^2 of it, which types of uneven sections may put elsewhere
LIMIT = 2.0 * SHORT**2


def spun(label: str, nu: float, strain: float, count: int) -> Found:
    """Compare the stretch of the section with Hooke's law in Green-Lagrange strain.

    Balance with displacements in proportion to x and y asks for the mean stresses rho omega^2 (h^2, L^2)/12 across and
    along, in the reference: ``strain`` is the first one over E.
    """
    subject, beam = BY_LABEL[label], Beam(L=SHORT, h=1.0, nu=nu)
    omega = math.sqrt(12.0 * strain * beam.E / (beam.rho * beam.h**2))
    body = beam.body(subject, count)
    # one element that is held in its middle stays one
    body["element"] = {**body["element"], "nodes": "regular"}
    case = {"bodies": {"beam": body},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0.5", "hold": "breathe"}],
            "steady_rotation": {"omega": omega, "about": [beam.L / 2, 0.0]}, "solver": {"type": "static"},
            "output": {"probes": {"face": {"at": "beam@0.5", "y": beam.h / 2}}}}
    run = solve(case)
    expected = math.sqrt(1.0 + 2.0 * strain * (1.0 - nu * SHORT**2)) - 1.0
    return Found(apart(run.probes["face"]["uy"] / (beam.h / 2), expected), run.warnings)


def rows() -> Iterator[Cell]:
    """Yield transverse tension over Poisson's ratio, and up to strains of 0.4."""
    measure = "tension across, L/h = 0.01, {} element{}, beside Hooke"
    for s in SUBJECTS:
        if not s.thins:
            continue
        for count in (1, 2):
            text = measure.format(count, "s" * (count > 1))
            for nu in (-0.9, 0.0, 0.3, 0.499):
                yield Cell("loaded across: Poisson's ratio", f"{nu:g}", s.label, text, LIMIT,
                           partial(spun, s.label, nu, 1e-6, count), quick=nu == 0.3)
            for strain in (1e-12, 1e-3, 0.1, 0.5):
                # beyond small strains, sections with y^3 are stretched unevenly by as much as the strain
                if s.type.degree_y <= 2 or strain < LIMIT:
                    yield Cell("loaded across: stress over E", f"{strain:g}", s.label, text, LIMIT,
                               partial(spun, s.label, 0.3, strain, count))
