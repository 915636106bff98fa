"""What surrounds a solve: variants of a sweep beside their solves alone, stored states and estimates beside the steps.

All are processor times of one process, with kernels in the cache. The sweeps vary the height of the section of a beam
with 16 elements `vallejo` in ten load steps, the same in linear statics, and of a falling bar with 8 elements
`reissner3`. The motions are pendulum (1), `reissner3`, with 150 stored states or the end alone.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

from .apart import apart, seconds
from .motion import ALONE, CASE, INTERVAL
from .scenes import PENDULUMS, STATIC, T_END, Bar

VARIANTS = 100
BEAM = """
bodies:
  rod:
    geometry: {{type: line, start: [0, 0], end: [{length}, 0]}}
    section: {{height: {height}, width: {width}}}
    material: {{E: {E}, nu: {nu}}}
    element: {{type: vallejo, count: 16}}
boundary_conditions: [{{type: clamp, at: rod@0}}]
loads: [{{type: force, at: rod@1, value: [0, {load}]}}]
solver: {{type: {solver}}}
goal: {{probe: tip, quantity: uy}}
output: {{probes: {{tip: rod@1}}}}
"""
# elements and solver of pendulum (1) that stay below 1e-4 m: the best fixed step, and what is taken by default
BEST, DEFAULT = (6, "dt: 0.01"), (8, "tolerance: 1e-4")


def _beam(solver: str) -> str:
    return BEAM.format(**vars(STATIC) | {"load": -STATIC.load}, solver=solver)


def _pendulum(count: int, solver: str, interval: float = INTERVAL, bar: Bar = PENDULUMS[1]) -> str:
    return CASE.format(**vars(bar), element="reissner3", count=count, more="", t_end=T_END[1], solver=solver,
                       interval=interval)


def sweeps() -> dict[str, str]:
    """Return the case that each sweep varies."""
    return {"statics in ten load steps": _beam("static"), "linear statics": _beam("linear_static"),
            "motion by the default way": _pendulum(*DEFAULT)}


def sweep(name: str, variants: int) -> dict[str, float]:
    """Return the time of a sweep, and of the solves of its variants alone [s], per variant."""
    from ancf2d.case.axes import combinations, read_axes
    from ancf2d.study.pool import ALONE as WORKERS
    from ancf2d.study.run import load, prepare
    from ancf2d.study.sweep import plan, run_sweep

    height = PENDULUMS[1].height if "motion" in name else STATIC.height
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "case.yaml")
        file.write_text(sweeps()[name], encoding="utf-8")

        def whole(number: int) -> None:
            axes = read_axes([f"bodies.rod.section.height={height}:{2 * height}:{number}"])
            run_sweep(plan(str(file), axes, [], Path(folder, f"sweep{number}"), WORKERS), WORKERS)

        whole(2)
        (taken,) = seconds(lambda: whole(variants), 1)
        axes = read_axes([f"bodies.rod.section.height={height}:{2 * height}:{variants}"])
        options = [axes[0].override(value) for (value,) in combinations(axes)]
        solves = sum(_solve_seconds(prepare(load(file, [option]))) for option in options)
    return {"whole": taken / variants, "solve": solves / variants}


def _solve_seconds(model: Any) -> float:
    from ancf2d.solvers.registry import solve

    return seconds(lambda: list(solve(model)), 1)[0]


def default_way(repeat: int) -> dict[str, float]:
    """Return the median time of pendulum (1) in various ways [s]."""
    from ancf2d.case import load_case_text
    from ancf2d.study.run import prepare, vocabulary
    from ancf2d.study.warmup import warm_up

    best, default = BEST, DEFAULT
    ways = {"best fixed step, the end alone": _pendulum(best[0], f"{best[1]}, {ALONE}", T_END[1]),
            "the same with stored states": _pendulum(best[0], f"{best[1]}, {ALONE}"),
            "tolerance, the end alone": _pendulum(default[0], f"{default[1]}, {ALONE}", T_END[1]),
            "tolerance with stored states": _pendulum(default[0], f"{default[1]}, {ALONE}"),
            "tolerance with stored states and error estimate": _pendulum(*default)}
    found: dict[str, list[float]] = {name: [] for name in ways}
    for k in range(repeat + 1):
        for name, text in ways.items():
            model = prepare(load_case_text(text, vocabulary=vocabulary()))
            warm_up(model)
            taken = _solve_seconds(model)
            if k:
                found[name].append(taken)
    return {name: statistics.median(times) for name, times in found.items()}


def measure(repeat: int) -> dict[str, Any]:
    """Return the times of sweeps and of the ways of a motion, each kind in a process of its own."""
    return {"sweeps": {name: apart("many.sweep", name, VARIANTS) for name in sweeps()},
            "ways": apart("many.default_way", 3 * repeat)}


def text(found: dict[str, Any]) -> str:
    """Return the section of the page."""
    from scripts.pages import table

    rows = [[name, f"{1e3 * one['solve']:.1f} ms", f"{1e3 * one['whole']:.1f} ms", f"{one['whole'] / one['solve']:.2f}"]
            for name, one in found["sweeps"].items()]
    ways = found["ways"]
    first = next(iter(ways.values()))
    steps = [[name, f"{1e3 * taken:.0f} ms", f"{taken / first:.1f}"] for name, taken in ways.items()]
    return f"""## What surrounds a solve

A sweep reads its case once. Each variant takes what it has in common with the variant before: records, meshes, sampled
laws, places in the matrix, and what was found of bodies and supports. The rest is checked, built, solved and judged as
in a run of its own, with the same result bit for bit. Processor time of a variant, in sweeps of {VARIANTS} on one core
without compiling:

{table(["sweep of", "the solve", "in all", "ratio"], rows)}

Pendulum (1) to 1e-4 m. Stored states are at multiples of 0.01 s; the error estimate comes from two coarser motions.

{table(["way", "time", "of the first"], steps)}"""


if __name__ == "__main__":
    print(text(measure(5)))
