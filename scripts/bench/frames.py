"""One Newton iteration of frames that are no chain, beside a chain of as many elements; their factors in three ways.

A ring, a tree whose members fork in two at each end, and square lattices, all welded. Fronts are what the program takes
where they cost less than a band; the band is that of reverse Cuthill-McKee, and SuperLU general sparse factors.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

TYPES = ["reissner2", "vallejo"]
SECTION, STEEL = {"height": 0.05, "width": 0.05}, {"E": 2.07e11, "nu": 0.3, "rho": 7850}
Place = tuple[float, float]
Scene = dict[str, Any]


def scene(members: list[tuple[Place, Place]], count: int, element: str, held: Place, loaded: Place) -> Scene:
    """Return a frame of straight members, welded where they meet, clamped at one place and loaded at another."""
    bodies: Scene = {}
    meeting: dict[Place, list[str]] = {}
    for k, ends in enumerate(members):
        bodies[f"m{k}"] = {"geometry": {"type": "line", "start": list(ends[0]), "end": list(ends[1])},
                           "section": SECTION, "material": STEEL, "element": {"type": element, "count": count}}
        for s, place in enumerate(ends):
            meeting.setdefault((round(place[0], 9), round(place[1], 9)), []).append(f"m{k}@{s}")
    at = {place: found[0] for place, found in meeting.items()}
    return {"bodies": bodies, "joints": [{"type": "weld", "between": f} for f in meeting.values() if len(f) > 1],
            "boundary_conditions": [{"type": "clamp", "at": at[held]}],
            "loads": [{"type": "force", "at": at[loaded], "value": [0.0, -100.0]}], "solver": {"type": "static"}}


def chain(count: int, element: str) -> Scene:
    """Return one straight beam."""
    return scene([((0.0, 0.0), (10.0, 0.0))], count, element, (0.0, 0.0), (10.0, 0.0))


def ring(sides: int, count: int, element: str) -> Scene:
    """Return a polygon."""
    places = [(round(math.cos(a), 9), round(math.sin(a), 9)) for a in 2 * math.pi * np.arange(sides) / sides]
    return scene(list(zip(places, places[1:] + places[:1], strict=True)), count, element, places[0],
                 places[sides // 2])


def tree(levels: int, count: int, element: str) -> Scene:
    """Return a tree, each member of which but the last ones forks in two."""
    members: list[tuple[Place, Place]] = []

    def grow(x: float, y: float, angle: float, length: float, level: int) -> None:
        end = round(x + length * math.cos(angle), 9), round(y + length * math.sin(angle), 9)
        members.append(((x, y), end))
        for side in (-0.5, 0.5) if level < levels else ():
            grow(*end, angle + side / level, 0.8 * length, level + 1)

    grow(0.0, 0.0, math.pi / 2, 1.0, 1)
    return scene(members, count, element, (0.0, 0.0), members[-1][1])


def lattice(side: int, count: int, element: str) -> Scene:
    """Return a square lattice with so many nodes along a side."""
    n = range(side)
    members = [((float(i), float(j)), (i + 1.0, float(j))) for i in n[:-1] for j in n]
    members += [((float(i), float(j)), (float(i), j + 1.0)) for i in n for j in n[:-1]]
    return scene(members, count, element, (0.0, 0.0), (side - 1.0, side - 1.0))


# what is measured, by name: a scene from an element
SCENES: dict[str, Callable[[str], Scene]] = {
    "chain": lambda e: chain(800, e), "ring of 8 members": lambda e: ring(8, 100, e),
    "tree of 31 members": lambda e: tree(5, 26, e), "lattice of 4 x 4 nodes": lambda e: lattice(4, 33, e),
    "lattice of 10 x 10 nodes": lambda e: lattice(10, 5, e), "lattice of 20 x 20 nodes": lambda e: lattice(20, 5, e)}


def build(data: Scene, fronts: bool) -> Any:
    """Return a model, numbered for fronts where they cost less, or for a band in any case."""
    from ancf2d.case import load_case_text
    from ancf2d.model import numbering
    from ancf2d.model.build import build_model
    from ancf2d.study.run import vocabulary

    loose = numbering.LOOSE
    try:
        numbering.LOOSE = loose if fronts else math.inf
        return build_model(load_case_text(json.dumps(data), vocabulary=vocabulary()))
    finally:
        numbering.LOOSE = loose


def times(system: Any, repeat: int) -> dict[str, float]:
    """Return medians [s] of the parts of an iteration."""
    d = np.zeros(len(system.model.numbering.place))
    parts: dict[str, list[float]] = {"assembly": [], "factor": [], "solve": []}
    for _ in range(repeat + 1):
        stamps = [time.process_time()]
        R = system.assemble(d, 1.0).R
        stamps.append(time.process_time())
        system.factor({})
        stamps.append(time.process_time())
        system.matrix.solve(R)
        stamps.append(time.process_time())
        for found, a, b in zip(parts.values(), stamps, stamps[1:], strict=False):
            found.append(b - a)
    return {name: statistics.median(found[1:]) for name, found in parts.items()}


def measure_one(name: str, element: str, repeat: int) -> dict[str, Any]:
    """Return microseconds per element of an iteration, and of factors and solution with a band and with SuperLU."""
    from ancf2d.solvers.linear import GeneralSparse, make_matrix, pattern
    from ancf2d.solvers.system import System

    data = SCENES[name](element)
    model, other = build(data, True), build(data, False)
    num, count = model.numbering, model.n_elements
    row = {"frame": name, "element": element, "elements": count, "unknowns": num.n_unknowns,
           "fronts": len(num.fronts.parent) if num.fronts else 0, "largest": num.fronts.largest if num.fronts else 0,
           "half_bandwidth": other.numbering.half_bandwidth}
    found = times(System(model), repeat)
    row |= {part: 1e6 * s / count for part, s in found.items()}
    # multipliers of welds have no diagonal entry, so SuperLU must exchange rows there
    general = GeneralSparse(other.numbering.n_unknowns, *pattern(other), exchange=bool(other.constraints))
    for kind, matrix in (("band", make_matrix(other)), ("superlu", general)):
        system = System(other)
        system.matrix = matrix
        found = times(system, repeat)
        row[kind] = 1e6 * (found["factor"] + found["solve"]) / count
    return row


def measure(repeat: int) -> list[dict[str, Any]]:
    """Return the rows of all frames and types."""
    return [measure_one(name, element, repeat) for element in TYPES for name in SCENES]
