"""The beams that an element is tried on: straight, of height, width, E and density 1."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from ...case import LoadedCase, load_case_text
from ..run import vocabulary

# every number of the examination is one of the element, not of a unit
HEIGHT = 1.0
NU = 0.3


def beam_case(name: str, element: dict[str, Any], length: float, solver: Any, *, nu: float = NU, angle: float = 0.0,
              breaks: Sequence[float] = (0.0, 1.0), **scene: Any) -> LoadedCase:
    """Return the case of a body ``beam`` from the origin; ``scene`` holds other top-level keys of the case.

    ``breaks`` are shares of the length that end pieces of unequal elements. Raises CaseError.
    """
    points = [[length * s * math.cos(angle), length * s * math.sin(angle)] for s in breaks]
    geometry = ({"type": "line", "start": points[0], "end": points[1]} if len(points) == 2
                else {"type": "polyline", "points": points})
    beam = {"geometry": geometry, "section": {"height": HEIGHT, "width": 1.0},
            "material": {"E": 1.0, "nu": nu, "rho": 1.0}, "element": element}
    case = {"bodies": {"beam": beam}, "solver": {"type": solver} if isinstance(solver, str) else solver, **scene}
    return load_case_text(json.dumps(case), name, vocabulary=vocabulary())
