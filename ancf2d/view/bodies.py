"""The bodies of a page as points, and numbers as text."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ancf2d.results import BodyRecord
from ancf2d.results.geometry import body_faces, body_nodes

WANTED_POINTS = 600  # along each face of a body
STRIDES = (1, 2, 4, 5, 10, 20)  # of the 21 samples of an element
MAX_NODES = 100  # of a body whose nodes are shown: more would merge into a line


@dataclass(frozen=True)
class Drawn:
    """How one body is sampled: some elements, every so manyeth sample along them."""

    record: BodyRecord
    elements: np.ndarray
    stride: int

    def points(self, e: np.ndarray) -> np.ndarray:
        """Return the points (n, 2): bottom and top of the elements one after the other, then the nodes."""
        faces = body_faces(self.record, e, self.elements)
        sides = [faces[k][:, ::self.stride] for k in ("bottom", "top")]
        nodes = body_nodes(self.record, e) if self.has_nodes else np.empty((0, 2))
        return np.concatenate([*(s.reshape(-1, 2) for s in sides), nodes])

    @property
    def has_nodes(self) -> bool:
        """Whether nodes are shown."""
        return len(self.record.dofs) <= MAX_NODES

    @property
    def samples(self) -> int:
        """Points along a face of one element."""
        return len(self.record.sample_xi[::self.stride])


def drawn_body(body: BodyRecord) -> Drawn:
    """Choose the elements and samples of a body that are drawn."""
    ne, ns = len(body.dofs), len(body.sample_xi)
    some = np.unique(np.linspace(0, ne - 1, min(ne, WANTED_POINTS // 2)).astype(int))
    fits = [s for s in STRIDES if (ns - 1) % s == 0 and len(some) * ((ns - 1) // s + 1) <= WANTED_POINTS]
    return Drawn(body, some, fits[0] if fits else ns - 1)


def listed(drawn: Iterable[Drawn]) -> tuple[list[dict[str, Any]], int]:
    """Return the bodies as the page takes them, and the number of their points."""
    out, first = [], 0
    for d in drawn:
        elements = len(d.elements)
        nodes = len(np.unique(d.record.nodes)) if d.has_nodes else 0
        out.append({"name": d.record.name, "element": d.record.element_type, "count": len(d.record.dofs),
                    "first": first, "elements": elements, "samples": d.samples, "nodes": nodes,
                    "pieces": len(d.elements) == len(d.record.dofs)})
        first += 2 * elements * d.samples + nodes
    return out, first


def packed(values: np.ndarray, kind: str) -> str:
    """Return numbers as base 64 of little-endian ``kind`` (f4, f8, i2, u1)."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")
