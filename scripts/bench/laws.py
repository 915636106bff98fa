"""What laws of materials cost beside a linear one: a Newton iteration of statics, and a motion of twenty steps.

Of a cantilever of 2000 elements, which a force bends beyond its yield stress: an iteration of statics is forces,
tangent, factors and solution. Linear material and law take turns in one process; the table has medians of the ratios of
processor time.

    python -m scripts.bench.laws           prints the table
    python -m scripts.bench.laws --page    writes it into docs/materials.md
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import ancf2d
from ancf2d.model.build import build_model
from ancf2d.model.model import Model
from ancf2d.solvers.registry import solve
from ancf2d.solvers.system import System
from ancf2d.study.warmup import warm_up
from scripts.pages import DOCS, one_thread, stamp, table, write

PAGE, COUNT = DOCS / "materials.md", 2000
TYPES = [("reissner3", None), ("cable", None), ("vallejo", "structural"), ("2d3n", "continuum")]
LINEAR = {"E": 2e11, "nu": 0.3, "rho": 7850}
CURVE = {"strain": [0.00125, 0.0025, 0.02], "stress": [2.5e8, 2.75e8, 3.2e8], "unloading": "curve"}
LAWS: dict[str, dict[str, Any]] = {
    "yield, 16 fibres": {"yield": 2.5e8, "hardening": {"kinematic": 1e10}},
    "curve, 16 fibres": {"stress_strain": CURVE},
    "one Maxwell term": {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]},
    "five Maxwell terms": {"viscoelastic": [{"modulus": 0.2, "time": 10.0**k} for k in range(-3, 2)]},
    "neo-Hooke": {"law": "neo_hooke"}}
# what is timed, how often, and the solver
TIMED: dict[str, tuple[int, dict[str, Any]]] = {
    "statics": (25, {"type": "static", "steps": 4}),
    **{method: (5, {"type": "dynamic", "t_end": 2e-3, "dt": 1e-4, "method": method, "estimate": False})
       for method in ("generalized_alpha", "radau5")}}


def model_of(kind: tuple[str, str | None], law: dict[str, Any], solver: dict[str, Any]) -> Model:
    """Return a cantilever of a material with a law."""
    element = {"type": kind[0], "count": COUNT} | ({} if kind[1] is None else {"formulation": kind[1]})
    model = build_model(ancf2d.load({
        "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": element,
                            "section": {"height": 0.02, "width": 0.02}, "material": {**LINEAR, **law}}},
        "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": solver,
        "output": {"interval": 2e-3} if solver["type"] == "dynamic" else {},
        "loads": [{"type": "force", "at": "beam@1", "value": [0, -460]}]}))
    warm_up(model)
    return model


def timed(model: Model) -> Callable[[], float]:
    """Return what takes the processor's time [s] of a motion, or in statics of an iteration about the last state."""
    *_, last = list(solve(model))
    system = System(model)

    def iterate() -> None:
        R = system.assemble(last.d, 1.0).R
        system.factor({})
        system.matrix.solve(R)

    def seconds() -> float:
        began = time.process_time()
        list(solve(model)) if model.case.solver.moves else iterate()
        return time.process_time() - began
    return seconds


def ratio(kind: tuple[str, str | None], what: str, law: dict[str, Any]) -> float:
    """Return the time that a law takes beside that of the linear material, the median of pairs."""
    repeat, solver = TIMED[what]
    plain, other = timed(model_of(kind, {}, solver)), timed(model_of(kind, law, solver))
    return statistics.median(other() / plain() for _ in range(repeat))


def main() -> None:
    """Print the table, or write it."""
    one_thread()
    rows = []
    for kind in TYPES:
        for name, law in LAWS.items():
            if not (kind[1] == "continuum" and "fibres" in name) and not (kind[1] != "continuum" and "Hooke" in name):
                rows.append([f"`{kind[0]}`", name, *(f"{ratio(kind, what, law):.1f}" for what in TIMED
                                                     if what == "statics" or "Hooke" not in name)])
                print(*rows[-1], flush=True)
    rows = [[*row, *[""] * (2 + len(TIMED) - len(row))] for row in rows]
    found = table(["element", "law", *(x if x == "statics" else f"`{x}`" for x in TIMED)], rows)
    if "--page" in sys.argv:
        write(PAGE, "laws", f"{found}\n\n{stamp('scripts.bench.laws --page')}")


if __name__ == "__main__":
    main()
