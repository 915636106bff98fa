"""Cantilevers of the element, linear and large, and what they should do."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.section import Section
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ...model.points import dot, point_ref
from .fields import beam
from .subject import NU, Subject

# a load under which the linear beam moves by a small share of its length
SMALL = 1e-6
# F L^2/(EI) that bends a cantilever through about half its length, and how such states are found
FAR, LARGE = 2.0, {"type": "static", "steps": 2}


def last_state(model: Model) -> Array:
    """Return the displacements (n_q,) in the last state of a model's solver. Raises ComputationError."""
    from ...solvers.registry import solve

    state = list(solve(model))[-1]
    return state.d[:model.n_q]


def tip_force(s: Subject, F: float, at: str) -> dict[str, Any]:
    """Return a force across at an end, spread over the section as shear stress is, where the section can tell."""
    spread = {"spread": "parabolic"} if s.element.section_kind == "interpolated" else {}
    return {"type": "force", "at": at, "value": [0.0, F], **spread}


def deflected(s: Subject, length: float, count: int, F: float, solver: Any = "linear_static", *, nu: float = NU,
              angle: float = 0.0, wall: int = 0, tip: int = 1) -> tuple[Model, Array]:
    """Return model and displacements of a cantilever under a force at its tip.

    The wall lets its section contract; where hidden modes make that singular, it holds every coordinate. Raises
    ComputationError.
    """
    walls = [{**s.wall, "at": f"beam@{wall}"}, {"type": "clamp", "at": f"beam@{wall}", "hold": "all"}]
    load = tip_force(s, F, f"beam@{tip}")
    if angle:
        load["value"] = [-F * np.sin(angle), F * np.cos(angle)]
    for k, held in enumerate(walls):
        model = s.model(length, count, solver, nu=nu, angle=angle, boundary_conditions=[held], loads=[load])
        try:
            return model, last_state(model)
        except ComputationError:
            if k == len(walls) - 1:
                raise
    raise AssertionError("one of the walls is the last")


def deflection(model: Model, d: Array, wall: int = 0, tip: int = 1, angle: float = 0.0) -> float:
    """Return how far the tip moves across the beam, from where the wall's axis is."""
    mesh = beam(model)
    ends = [np.array([dot(c, d) for c in point_ref(mesh, float(at)).position()]) for at in (wall, tip)]
    return float((ends[1] - ends[0]) @ np.array([-np.sin(angle), np.cos(angle)]))


def tip_deflection(s: Subject, length: float, count: int, *, nu: float = NU, angle: float = 0.0, wall: int = 0,
                   tip: int = 1) -> float:
    """Return the linear deflection of a cantilever under a unit force at its tip. Raises ComputationError."""
    model, d = deflected(s, length, count, SMALL, nu=nu, angle=angle, wall=wall, tip=tip)
    return deflection(model, d, wall, tip, angle) / SMALL


def timoshenko_deflection(section: Section, length: float, kGA: float) -> float:
    """Return the deflection of Timoshenko's cantilever under a unit force at its tip: L^3/(3 EI) + L/(k GA)."""
    return length**3 / (3.0 * section.EI) + length / kGA
