"""Random pairs of beams of which one is pressed onto the other, and the invariants of their equilibria."""

from __future__ import annotations

import json
import random
from typing import Any

import numpy as np

import ancf2d
from ancf2d.errors import Ancf2dError

Data = dict[str, Any]
TYPES = ("cable", "reissner2", "reissner3", "vallejo")
WIDTH, E = 0.05, 1e8
# forces left beside the largest; depth of points of one body in the other, without a law, beside the smaller height
BALANCE, DEPTH = 1e-6, 1e-3
# least distance between the ends of both bodies, relative to the length of the lower one
NEAR_END = 0.15


def scene(seed: int, number: int) -> Data:
    """Return a cantilever that is pressed onto another one, or onto a beam between two supports, as a case."""
    rng = random.Random(f"bodies {seed} {number}")
    thin = rng.choice((0.004, 0.01))
    low, high = (thin * rng.choice((1.0, 2.5)) for _ in range(2))
    L, length = rng.uniform(0.5, 1.0), rng.uniform(0.5, 1.0)
    start = rng.uniform(0.0, 0.3) * L
    if abs(start + length - L) < NEAR_END * L:
        # ends beside each other may slip off: there is no equilibrium next to that
        length = (1.0 + NEAR_END) * L - start
    y = 0.5 * (low + high) + rng.choice((0.0, 0.0, 1e-4, 0.3 * min(low, high)))

    def beam(x: float, y: float, length: float, height: float) -> Data:
        return {"geometry": {"type": "line", "start": [x, y], "end": [x + length, y]},
                "section": {"height": height, "width": WIDTH}, "material": {"E": E, "nu": 0.3, "rho": 1000},
                "element": {"type": rng.choice(TYPES), "count": rng.choice((2, 5, 12, 30))}}

    force = E * WIDTH * high**3 / (4.0 * length**2) * rng.uniform(0.1, 0.7)
    loads: list[Data] = [{"type": "force", "at": "upper@1", "value": [force * rng.uniform(-0.2, 0.2), -force]}]
    if rng.random() < 0.5:
        loads.append({"type": "distributed", "on": "upper", "value": [0, -force / length]})
    holds = rng.choice(([{"type": "clamp", "at": "lower@0"}],
                        [{"type": "pin", "at": "lower@0"}, {"type": "roller", "at": "lower@1", "fixed": "y"}]))
    law = rng.choice((None, 1e7, 1e9))
    contact: Data = {"between": ["upper", "lower"], "friction": rng.choice((0.0, 0.0, 0.1, 0.4))}
    if law:
        contact["law"] = {"stiffness": law}
    made: Data = json.loads(json.dumps({
        "bodies": {"lower": beam(0.0, 0.0, L, low), "upper": beam(start, y, length, high)},
        "boundary_conditions": [*holds, {"type": "clamp", "at": "upper@0"}], "loads": loads, "contacts": [contact],
        "solver": {"type": "static"}}))
    return made


def pressed(seed: int, number: int, **solver: Any) -> list[str]:
    """Return the violations of the equilibrium of two bodies; ``solver`` are further keys of solver."""
    case = scene(seed, number)
    case["solver"] |= solver
    try:
        solution = ancf2d.solve(case)
    except Ancf2dError as error:
        return [" ".join(str(error).split())]
    upper = case["bodies"]["upper"]["geometry"]
    length = upper["end"][0] - upper["start"][0]
    load = sum(np.array(item["value"]) * (length if "on" in item else 1.0) for item in case["loads"])
    held = np.array([[each["fx"], each["fy"]] for each in solution.reactions.values()])
    out = [] if np.abs(held.sum(axis=0) + load).max() <= BALANCE * np.abs(held).max() else ["forces are not in balance"]
    if "law" not in case["contacts"][0]:
        height = min(body["section"]["height"] for body in case["bodies"].values())
        depth = max(pair.overlap(solution.d[-1])[0] for pair in solution.model.contacts)
        out += [f"{depth / height:.1e} heights deep"] if depth > DEPTH * height else []
    return out
