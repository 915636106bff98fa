"""How few sampling points keep each element type's accuracy: its default quadrature beside fewer and more points.

Two cantilevers under large loads, slender (Table 2's) and four times as long as high, 8 elements of each type with its
default formulation: the tip's deflection beside that of 32 elements of the type with its own quadrature; motions of
one free element beyond the rigid ones that strain no point; the time of forces and tangent per element.

    python scripts/bench/sampling.py --types vallejo,omar
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from typing import Any

import numpy as np
from arithmetic import seconds
from static_cantilever import THREADS

CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: {height}, width: 0.1}}
    material: {{E: 2.07e11, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: {count}{rule}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, {load}]}}]
solver: {{type: static}}
output: {{probes: {{tip: beam@1}}}}
"""
BEAMS = {"slender": (0.1, -500e3), "thick": (0.5, -62.5e6)}
TYPES = ["reissner2", "reissner3", "cable", "kerkkanen", "vallejo", "omar", "li", "patel", "2d2n", "2d3n"]
COUNT, FINE, TIMED = 8, 32, 256
# strain energy of a unit motion below this share of the largest is none
NOTHING = 1e-10


def model_of(element: str, rule: list[int] | None, count: int, beam: str) -> Any:
    """Return a model; without a rule it has the type's own points, which need not be Gauss points alone."""
    from ancf2d.case import load_case_text
    from ancf2d.model.build import build_model

    height, load = BEAMS[beam]
    return build_model(load_case_text(CASE.format(height=height, load=load, element=element, count=count,
                                                   rule="" if rule is None else f", quadrature: {rule}")))


def default_rule(element: str) -> list[int]:
    """Return the points along and across that a type has by itself."""
    (mesh,) = model_of(element, None, 1, "slender").meshes.values()
    return list(mesh.plan.rule.normal)


def deflection(element: str, rule: list[int] | None, beam: str, count: int = COUNT) -> float | None:
    """Return how far the tip goes, or None where no solution is found."""
    from ancf2d.errors import ComputationError
    from ancf2d.solvers.post import Observer
    from ancf2d.solvers.static import solve_static

    model = model_of(element, rule, count, beam)
    try:
        *_, state = solve_static(model, 10)
    except ComputationError:
        return None
    return Observer(model).observe(state)["tip"]["uy"]


def zero_energy(element: str, rule: list[int] | None) -> int:
    """Return the motions of one free element beyond the three rigid ones that strain no sampling point."""
    from ancf2d.kernels.elements import element_matrices

    model = model_of(element, rule, 1, "thick")
    group, weights = model.groups[0], model.weights
    n = group.dofs.shape[1]
    Q, K = np.zeros((1, n)), np.zeros((1, n, n))
    element_matrices(group, np.zeros(len(model.numbering.place)), 0, Q, K)
    # coordinates as displacements
    scale = 1 / weights[group.dofs[0]]
    values = np.linalg.eigvalsh(K[0] * np.outer(scale, scale))
    return int((values < NOTHING * values[-1]).sum()) - 3


def cost(element: str, rule: list[int] | None, repeat: int = 15) -> float:
    """Return the time of forces and tangent of an element [s]."""
    from ancf2d.kernels.elements import element_matrices

    model = model_of(element, rule, TIMED, "slender")
    group, d = model.groups[0], np.zeros(len(model.numbering.place))
    n = group.dofs.shape[1]
    Q, K = np.zeros((TIMED, n)), np.zeros((TIMED, n, n))
    element_matrices(group, d, 0, Q, K)
    return statistics.median(seconds(lambda: element_matrices(group, d, 0, Q, K), repeat)) / TIMED


def neighbours(rule: list[int]) -> list[list[int]]:
    """Return a rule with those of one point fewer and more along and, where it has any across, across."""
    nx, ny = rule
    found = [[nx - 1, ny], [nx, ny - 1], [nx, ny], [nx + 1, ny]] + ([[nx, ny + 1]] if ny > 1 else [])
    return [r for r in found if min(r) > 0]


def collect(types: list[str]) -> list[dict]:
    """Return a row for each type and rule."""
    rows = []
    for element in types:
        own = default_rule(element)
        fine = {beam: deflection(element, None, beam, FINE) for beam in BEAMS}
        for points in neighbours(own):
            rule = None if points == own else points
            row: dict = {"element": element, "rule": points, "default": rule is None,
                         "zero_energy": zero_energy(element, rule), "cost_ns": 1e9 * cost(element, rule)}
            for beam, reference in fine.items():
                found = deflection(element, rule, beam)
                row[beam] = None if found is None or reference is None else abs(found / reference - 1)
            rows.append(row)
    return rows


def measure() -> list[dict]:
    """Return what ``collect`` does of all types, from a process of its own with one thread."""
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=True,
                          env={**os.environ, **dict.fromkeys(THREADS, "1")})
    return json.loads(done.stdout)


def main() -> None:
    """Print what was measured as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--types", default=",".join(TYPES))
    print(json.dumps(collect(parser.parse_args().types.split(",")), indent=1))


if __name__ == "__main__":
    main()
