"""What loads strain a body by that is free, along its axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..case import Profile
from ..elements.shape import Array
from .mesh import BodyMesh, Index
from .profiles import SIDE, values

AlongBody = float | Profile
# places beside S that count as the same
SAME = 1e-12


@dataclass
class NaturalStrain:
    """What one load strains a free body by, from S = ``first`` to ``last``, times its amplitude.

    ``values`` are axial strain, curvature [1/m], temperature [K] and its gradient [K/m] along the body. ``amount`` (3,)
    and ``signal`` (1,) are its rows of ``kernels.natural.Natural``.
    """

    mesh: BodyMesh
    first: float
    last: float
    values: tuple[AlongBody, AlongBody, AlongBody, AlongBody]
    amplitude: Callable[[float], float]
    amount: Array = field(default_factory=lambda: np.zeros(3))
    signal: Index = field(default_factory=lambda: np.zeros(1, dtype=np.int64))

    def places(self) -> Index:
        """Return for each element 0 where it is not strained, 1 where as all others are, and 2 + its number else."""
        start, whole = self.mesh.starts, self.mesh.plan.length
        a, b = start / whole, (start + self.mesh.lengths) / whole
        number = np.arange(len(a))
        out = np.where((a >= self.first - SAME) & (b <= self.last + SAME), 1, 2 + number)
        if not all(isinstance(v, float) for v in self.values):
            out = 2 + number
        out[(b <= self.first + SAME) | (a >= self.last - SAME)] = 0
        return out

    def along(self, element: int, xi: Array) -> Array:
        """Return the values (4, n) at stations xi (n,) of an element, zero beyond the ends.

        Where a profile jumps at an end of the element, they are those within.
        """
        mesh = self.mesh
        whole, start = mesh.plan.length, mesh.starts[element]
        s = np.clip((start + xi * mesh.lengths[element]) / whole, start / whole + SIDE,
                    (start + mesh.lengths[element]) / whole - SIDE)
        inside = (s >= self.first - SAME) & (s <= self.last + SAME)
        return np.where(inside, np.array([values(v, s) for v in self.values]), 0.0)
