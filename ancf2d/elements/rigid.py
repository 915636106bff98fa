"""The rigid bar in natural coordinates: the positions of its two ends, whose distance a constraint keeps.

Garcia de Jalon & Bayo 1994. Its mass matrix is constant, and it has no strain: no law, no kernel group.
"""

from __future__ import annotations

from typing import Any

from .definition import ElementType, NodeSpec
from .formulations.base import Formulation, PointLaw

RIGID_TYPE = ElementType("rigid", ("1", "x"), (NodeSpec(0.0, ("r",)), NodeSpec(1.0, ("r",))), formulation="rigid",
                         source="natural coordinates of Garcia de Jalon & Bayo 1994")


def _no_law(*_: Any) -> Any:
    raise NotImplementedError("a rigid body has no strain")


RIGID = Formulation("rigid", PointLaw(0, 0, 0, _no_law, _no_law),
                    lambda e: None if e is RIGID_TYPE else f"{e.name} deforms", lambda e: (1, 1), lambda e: (1, 1),
                    _no_law, RIGID_TYPE.source, "no strain: the length is kept")
