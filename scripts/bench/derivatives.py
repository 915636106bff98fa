"""What derivatives of a motion cost beside its run: a cantilever with a spring, a damper and a mass, and 40 numbers.

Processor times of runs and of derivatives in turn, in one process; the ratio of each pair, and its median. A run is
checked, built, solved and its goal read, without files.

    python -m scripts.bench.derivatives           prints the tables
    python -m scripts.bench.derivatives --page    writes them into docs/derivatives.md
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import ancf2d
from ancf2d.case.numbers import numbers_at
from ancf2d.study.expressions import GoalValues
from ancf2d.study.gradient import derivatives
from ancf2d.study.run import run_case
from scripts.pages import DOCS, stamp, table, write

PAGE, REPEAT = DOCS / "derivatives.md", 3
# integrator, elements, steps
MOTIONS = (("generalized_alpha", 4, 40), ("generalized_alpha", 4, 2000), ("generalized_alpha", 64, 500))
COUNTS, HEIGHTS = (1, 5, 10, 40), 20
NUMBERS = ["bodies.arm.material.E", "springs.stay.stiffness", "springs.stay.damping", "masses.lump.mass",
           "loads.push.value.1", "bodies.arm.material.rho", "bodies.arm.geometry.end.0",
           "loads.push.amplitude.frequency", "bodies.arm.material.damping.kelvin_voigt", "initial.rotation_rate.omega",
           "damping.rayleigh.alpha", "bodies.arm.section.width", "springs.stay.between.1.0",
           "springs.stay.between.1.1", "springs.stay.length", "loads.weight.value.1", "masses.lump.inertia",
           "loads.push.value.0", "bodies.arm.geometry.end.1", "bodies.arm.material.nu",
           *(f"bodies.arm.section.height.value.{k}" for k in range(HEIGHTS))]


def case(method: str, elements: int, steps: int) -> dict[str, Any]:
    """Return the motion of a cantilever as a case."""
    s = [k / (HEIGHTS - 1) for k in range(HEIGHTS)]
    return {
        "bodies": {"arm": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                           "section": {"height": {"s": s, "value": [0.02 - 0.01 * x for x in s]}, "width": 0.03},
                           "material": {"E": 7e10, "nu": 0.33, "rho": 2700, "damping": {"kelvin_voigt": 1e-5}},
                           "element": {"type": "reissner3", "count": elements, "nodes": "regular"}}},
        "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "arm@0"}],
        "springs": [{"name": "stay", "type": "translational", "between": ["arm@1", [1.2, 0.5]], "stiffness": 200,
                     "length": 0.5, "damping": 2}],
        "masses": [{"name": "lump", "at": "arm@1", "mass": 0.1, "inertia": 1e-4}],
        "loads": [{"name": "weight", "type": "gravity", "value": [0, -9.81]},
                  {"name": "push", "type": "force", "at": "arm@1", "value": [2, -30],
                   "amplitude": {"type": "sine", "frequency": 5}}],
        "damping": {"rayleigh": {"alpha": 0.1, "beta": 0}},
        "initial": {"rotation_rate": {"omega": 0.1, "about": [0, 0]}},
        "solver": {"type": "dynamic", "method": method, "t_end": 2e-3 * steps, "dt": 2e-3, "estimate": False},
        "goal": {"probe": "tip", "quantity": "uy"},
        "output": {"probes": {"tip": "arm@1"}, "interval": 2e-3 * steps}}


class Forwards:
    """The same goal as a function of states, which the direct method differentiates."""

    all_states = False

    def __init__(self, read: GoalValues) -> None:
        self.read = read

    def __call__(self, model: Any, states: Any) -> Any:
        """Return the value."""
        return self.read(model, states)


def timed(do: Callable[[], Any]) -> float:
    """Return the processor time [s] of a call."""
    began = time.process_time()
    do()
    return time.process_time() - began


def measure(motion: tuple[str, int, int], repeat: int) -> dict[str, Any]:
    """Return the time of a run, and the medians of the ratios of derivatives to it, by number and way."""
    loaded = ancf2d.load(case(*motion))
    assert loaded.case.goal is not None
    read = GoalValues((loaded.case.goal,))
    ways: dict[str, Callable[[Any, Any], Any]] = {"adjoint": read, "direct": Forwards(read)}
    runs, ratios = list[float](), dict[tuple[str, int], list[float]]()
    for watch in ways.values():
        # compiled on first use
        derivatives(loaded, watch, numbers_at(loaded, NUMBERS[:10]))
    for _ in range(repeat):
        for name, watch in ways.items():
            for count in COUNTS:
                variables = numbers_at(loaded, NUMBERS[:count] if count < 40 else NUMBERS)
                run = timed(lambda: run_case(loaded))
                took = timed(lambda w=watch, v=variables: derivatives(loaded, w, v))  # type: ignore[misc]
                runs.append(run)
                ratios.setdefault((name, count), []).append(took / run)
    return {"motion": motion, "run_s": statistics.median(runs),
            "ratios": {key: statistics.median(found) for key, found in ratios.items()}}


def text(rows: list[dict[str, Any]]) -> str:
    """Return the table."""
    return table(["motion", "one run", "way", *(f"{n} number{'s' if n > 1 else ''}" for n in COUNTS)], [
        [f"`{r['motion'][0]}`, {r['motion'][1]} elements, {r['motion'][2]} steps", f"{r['run_s']:.2g} s", way,
         *(f"{r['ratios'][way, n]:.2g}" for n in COUNTS)] for r in rows for way in ("adjoint", "direct")])


if __name__ == "__main__":
    found = text([measure(motion, REPEAT) for motion in MOTIONS])
    print(found)
    if "--page" in sys.argv:
        write(PAGE, "motions", f"{found}\n\n{stamp('scripts.bench.derivatives --page')}")
