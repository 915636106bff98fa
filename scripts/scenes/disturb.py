"""Scenes whose stiffnesses, masses and loads are a little off: what their motion makes of small errors."""

from __future__ import annotations

import copy
import random
from typing import Any

from .shapes import Data

NUMBERS = ("E", "rho", "EA", "kGA", "EI", "rhoA", "rhoI", "mass", "inertia", "stiffness", "damping", "value",
           "velocity", "omega", "tension", "axial", "curvature", "gradient")


def disturbed(case: Data, by: float, rng: random.Random) -> Data:
    """Return a case whose forces, masses and rates are off by a random share of themselves, up to ``by``."""
    def off(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            return {k: v if k == "amplitude" else off(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [off(v, key) for v in value]
        return value * (1.0 + by * rng.uniform(-1, 1)) if key in NUMBERS and isinstance(value, float) else value

    return {key: copy.deepcopy(value) if key in ("output", "solver", "boundary_conditions") else off(value, key)
            for key, value in case.items()}
