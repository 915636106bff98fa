"""Overhead of a solution: rows of a sweep against solving each case alone, stored states and estimates against steps.

All are processor times of one process, with kernels in the cache. The sweeps are run by the command line; they vary the
height of the section of a beam with 16 elements `vallejo` in ten load steps, the same in linear statics, and of a
falling bar with 8 elements `reissner3`. The motions are pendulum (1), `reissner3`, with 150 stored states or the end
alone.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

from . import start
from .apart import apart, seconds
from .motion import ALONE, CASE, INTERVAL
from .scenes import PENDULUMS, STATIC, T_END, Bar

# rows of each sweep, and those of the least one, which tells what starting costs; variants that are solved alone
ROWS = {"statics in ten load steps": 2000, "linear statics": 2000, "motion by the default way": 50}
LEAST, ALONE_TOO = 2, 100
# what 2000 rows of statics may take: so many times their solves, and seconds beside
TIMES, BESIDE = 1.5, 2.0
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


def sweep(name: str) -> dict[str, float]:
    """Return the time of a sweep, of the least one, and the median of the solves of its variants alone [s]."""
    from ancf2d.case.axes import combinations, read_axes
    from ancf2d.study.run import load, prepare

    height = PENDULUMS[1].height if "motion" in name else STATIC.height
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "case.yaml")
        file.write_text(sweeps()[name], encoding="utf-8")

        def over(number: int) -> str:
            return f"bodies.rod.section.height={height}:{2 * height}:{number}"

        def whole(number: int) -> float:
            command = ["sweep", str(file), "--over", over(number), "--jobs", "1", "--force", "-o", f"of{number}"]
            return start.seconds([*start.ANCF2D, *command], folder)[0]

        def alone() -> list[float]:
            axes = read_axes([over(ALONE_TOO)])
            return [_solve_seconds(prepare(load(file, [axes[0].override(value)]))) for (value,) in combinations(axes)]

        whole(LEAST)
        least = statistics.median(whole(LEAST) for _ in range(3))
        # before the sweep and behind it: other programs slow down both
        solves = alone()
        taken = whole(ROWS[name])
        solves += alone()
    return {"rows": ROWS[name], "whole": taken, "start": least, "solve": statistics.median(solves)}


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
    return {"sweeps": {name: apart("many.sweep", name) for name in sweeps()},
            "ways": apart("many.default_way", 3 * repeat)}


def _row(name: str, rows: int, whole: float, start: float, solve: float) -> list[Any]:
    """Return the line of a sweep."""
    one = (whole - start) / (rows - LEAST)
    return [name, rows, f"{whole:.1f} s", f"{start:.1f} s", f"{1e3 * one:.1f} ms", f"{1e3 * solve:.1f} ms",
            f"{one / solve:.2f}", f"{rows * solve:.1f} s"]


def text(found: dict[str, Any]) -> str:
    """Return the section of the page."""
    from scripts.pages import table

    rows = [_row(name, **one) for name, one in found["sweeps"].items()]
    ways = found["ways"]
    first = next(iter(ways.values()))
    steps = [[name, f"{1e3 * taken:.0f} ms", f"{taken / first:.1f}"] for name, taken in ways.items()]
    return f"""## Overhead of a solution

A sweep reads its case once. Each variant reuses the parts that it has in common with the previous one: records, meshes,
sampled laws, positions in the matrix, and the checks of bodies and supports. The rest is checked, built, solved and
assessed as in a separate run, with a bitwise identical result. The table gives the processor time of whole sweeps from
the command line, on one core without compilation. The start is that of a sweep of {LEAST} rows; the solution time is
the median of a variant solved alone:

{table(["sweep of", "rows", "in all", "of it the start", "a row", "the solve", "ratio", "the solves"], rows)}

Pendulum (1) to 1e-4 m. Stored states are at multiples of 0.01 s; the error estimate comes from two coarser motions,
the second of which ends early, because its steps are no longer.

{table(["way", "time", "of the first"], steps)}"""


if __name__ == "__main__":
    print(text(measure(5)))
