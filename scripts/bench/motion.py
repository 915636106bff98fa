"""The paper's pendulums over time: error against time beside other tools, and the cost of a step.

Pendulum (1) to 1.5 s and pendulum (2) to 1.1 s, ladders of meshes and steps. The error is the largest distance of the
tip, at multiples of 0.01 s, from a fine solution of the same element of the same tool; Exudyn's geometrically exact
beam and ``quartic`` (quartic.yaml, an element in a file) are judged by the finest ``reissner3``, whose limit they
share. Times are of runs of the same settings that store the end alone: the processor's time of the solve call, after
imports, mesh and compiling. Every tool runs in a process of its own, in turn.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from . import peers
from .apart import apart
from .peers import tools
from .scenes import PENDULUMS, T_END

HERE = Path(__file__).resolve().parent
INTERVAL = 0.01
WANTED = (1e-3, 1e-4, 1e-5, 1e-6)
CASE = """
bodies:
  rod:
    geometry: {{type: line, start: [0, 0], end: [{length}, 0]}}
    section: {{height: {height}, width: {width}}}
    material: {{E: {E}, nu: {nu}, rho: {rho}}}
    element: {{type: {element}, count: {count}{more}}}
boundary_conditions: [{{type: pin, at: rod@0}}]
loads: [{{type: gravity, value: [0, -9.81]}}]
solver: {{type: dynamic, t_end: {t_end}, {solver}}}
output: {{interval: {interval}, probes: {{tip: rod@1}}}}
"""
# no runs with coarser steps beside, for an error estimate
ALONE = "estimate: false"
Rungs = list[tuple[int, str]]


def own(*rungs: tuple[int, str]) -> Rungs:
    """Return rungs of ancf2d without error estimates."""
    return [(n, f"{how}, {ALONE}") for n, how in rungs]


GEOMETRICALLY_EXACT, REISSNER, QUARTIC = (
    ("exudyn", "geometrically exact"), ("ancf2d", "reissner3"), ("ancf2d", "quartic"))
FORCES, ROD = ("opensees", "force-based"), ("pyelastica", "Cosserat rod")
# (elements, what the solver is told); the last of a ladder is the fine solution that errors are taken against
LADDERS: dict[int, dict[tuple[str, str], Rungs]] = {
    1: {REISSNER: own((5, "dt: 0.00125, method: generalized_alpha"), (6, "dt: 0.01"), (8, "dt: 0.015"),
                      (12, "dt: 0.0025"), (16, "dt: 0.0025"), (32, "dt: 0.00125, method: radau9"), (32, "dt: 0.000625"),
                      (64, "tolerance: 1e-10")),
        ("ancf2d", "cable"): own((4, "dt: 0.01"), (6, "dt: 0.005"), (8, "dt: 0.0025"), (12, "dt: 0.00125"),
                                 (32, "tolerance: 1e-9")),
        ("ancf2d", "2d2n"): own((8, "dt: 0.01"), (32, "dt: 0.01"), (128, "tolerance: 1e-7")),
        GEOMETRICALLY_EXACT: [(16, "2.5e-3"), (24, "1.25e-3"), (32, "1.25e-3"), (64, "6.25e-4"), (128, "3.125e-4")],
        ("exudyn", "cable"): [(4, "1.25e-3"), (4, "6.25e-4"), (8, "3.125e-4"), (8, "1.5625e-4"), (16, "7.8125e-5")],
        FORCES: [(16, "2.5e-3"), (32, "1.25e-3"), (64, "1e-3"), (128, "5e-4")],
        ("opensees", "elastic"): [(16, "2.5e-3"), (32, "1.25e-3"), (64, "1e-3"), (128, "5e-4"), (256, "2.5e-4")]},
    2: {REISSNER: own((8, "dt: 0.02"), (16, "dt: 0.02"), (16, "tolerance: 1e-5"), (64, "dt: 0.005, method: radau9"),
                      (256, "dt: 0.00333333333333333333, method: radau9"), (1024, "dt: 0.001, method: radau9")),
        QUARTIC: own((8, "dt: 0.02"), (16, "dt: 0.01"), (24, "dt: 0.005, method: radau9"),
                     (44, "dt: 0.00333333333333333333, method: radau9")),
        ("ancf2d", "vallejo"): own((16, "dt: 0.01"), (32, "dt: 0.01"), (64, "dt: 0.005"), (128, "tolerance: 1e-7")),
        GEOMETRICALLY_EXACT: [(32, "2.5e-3"), (64, "1.25e-3"), (96, "1.25e-3"), (128, "1.25e-3"), (256, "6.25e-4"),
                              (512, "3.125e-4"), (1024, "1.5625e-4")],
        FORCES: [(16, "2.5e-3"), (32, "1.25e-3"), (64, "1.25e-3"), (128, "6.25e-4"), (256, "6.25e-4")],
        ROD: [(16, "2e-3"), (32, "2e-3"), (64, "1e-3"), (128, "5e-4"), (256, "2.5e-4"), (512, "1e-4")]}}
# what is judged by the fine solution of another
SHARES = {GEOMETRICALLY_EXACT: REISSNER, QUARTIC: REISSNER}
STEP, STEPS = 1e-4, 2000
STEP_TYPES = {"ancf2d": ("reissner2", "reissner3", "cable", "vallejo", "2d2n", "omar"),
              "exudyn": ("geometrically exact", "cable")}
SECONDS = 900


def ancf2d(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict[str, Any]:
    """Solve with ancf2d; return the tip over time, seconds of the solve alone and steps."""
    from ancf2d.case import load_case_text
    from ancf2d.model.build import build_model
    from ancf2d.solvers.registry import solve
    from ancf2d.solvers.state_results import Observer
    from ancf2d.study.run import vocabulary
    from ancf2d.study.warmup import warm_up

    bar, own_file = PENDULUMS[number], (HERE / f"{element}.yaml").exists()
    more = f", shear_factor: {bar.shear}" if own_file or element.startswith("reissner") else ""
    text = CASE.format(length=bar.length, height=bar.height, width=bar.width, E=bar.E, nu=bar.nu, rho=bar.rho,
                       element=element, count=count, more=more, solver=solver, t_end=t_end, interval=interval)
    if own_file:
        text = text.replace(f"type: {element}", f"definition: {element}.yaml")
    model = build_model(load_case_text(text, vocabulary=vocabulary(), directory=str(HERE)))
    warm_up(model)
    states, seconds, t, tip, steps = solve(model), 0.0, [], [], 0
    observer = Observer(model)
    while True:
        started = time.process_time()
        state = next(states, None)
        seconds += time.process_time() - started
        if state is None:
            break
        at = observer.observe(state)["tip"]
        t.append(state.t)
        tip.append([at["x"], at["y"]])
        steps = state.report.get("steps", steps)
    return {"t": t, "tip": tip, "solve_s": seconds, "steps": steps}


def run(jobs: list[list[Any]]) -> list[dict[str, Any]]:
    """Run jobs [tool, arguments...] one after another; return what each reports, or why it failed."""
    found = []
    for tool, *arguments in jobs:
        try:
            found.append(ancf2d(*arguments) if tool == "ancf2d" else getattr(peers, tool)(*arguments))
        except Exception as error:
            text = str(error).strip()
            found.append({"error": text.splitlines()[-1] if text else type(error).__name__})
    return found


def measure(jobs: list[list[Any]]) -> list[dict[str, Any]]:
    """Run jobs in a process of their own; where it ends by itself, all of them have failed."""
    found = apart("motion.run", jobs, seconds=SECONDS)
    return [found] * len(jobs) if isinstance(found, dict) else found


def distance(found: dict[str, Any], fine: dict[str, Any], t_end: float) -> float:
    """Return the largest distance of two tips at the times that both know; infinite where one ended early."""
    a, b = ({round(t / INTERVAL): p for t, p in zip(r["t"], r["tip"], strict=True)} for r in (found, fine))
    if found["t"][-1] < t_end - INTERVAL / 2:
        return float("inf")
    return max(math.dist(a[k], b[k]) for k in a.keys() & b.keys())


def ladder(number: int, repeat: int) -> list[dict[str, Any]]:
    """Return error and median time of every rung of every tool; ``fine`` marks what errors are taken against."""
    t_end, installed = T_END[number], tools()
    ladders = {key: rungs for key, rungs in LADDERS[number].items() if key[0] in installed}
    stored = {key: measure([[key[0], number, key[1], n, how, t_end, INTERVAL] for n, how in rungs])
              for key, rungs in ladders.items()}
    times: dict[tuple[str, str], list[list[float | None]]] = {
        key: [[] for _ in rungs] for key, rungs in ladders.items()}
    for _ in range(repeat):
        for key, rungs in ladders.items():
            timed = rungs if key in SHARES else rungs[:-1]
            # the first run of a process pays for loading
            jobs = [[key[0], number, key[1], n, how, t_end, t_end] for n, how in [timed[0], *timed]]
            for k, result in enumerate(measure(jobs)[1:]):
                times[key][k].append(result.get("solve_s"))
    rows = []
    for key, found in stored.items():
        fine = stored[SHARES.get(key, key)][-1]
        for (n, how), result, seconds in zip(ladders[key], found, times[key], strict=True):
            row = {"tool": key[0], "element": key[1], "elements": n, "solver": how, "fine": result is fine}
            if "error" in result or "error" in fine:
                rows.append(row | {"error": result.get("error", "no fine solution")})
                continue
            good = [s for s in seconds if s is not None]
            rows.append(row | {"error_m": distance(result, fine, t_end), "steps": result["steps"],
                               "solve_s": statistics.median(good) if good else None})
    return rows


def at_error(rows: list[dict[str, Any]], tool: str, element: str, wanted: float) -> tuple[float, bool] | None:
    """Return the time [s] that an error takes: of the fastest rung below it, else extrapolated, which the flag tells.

    Beyond the ladder cost grows with the error's power as it did up to the best rung from the last one with at least
    twice its error.
    """
    good = [r for r in rows if (r["tool"], r["element"]) == (tool, element) and r.get("solve_s") and not r["fine"]]
    met = [r["solve_s"] for r in good if r["error_m"] < wanted]
    if met:
        return min(met), False
    good.sort(key=lambda r: r["error_m"])
    other = next((r for r in good if r["error_m"] >= 2 * good[0]["error_m"]), None)
    if other is None or good[0]["solve_s"] <= other["solve_s"]:
        return None
    best = good[0]
    power = math.log(best["solve_s"] / other["solve_s"]) / math.log(other["error_m"] / best["error_m"])
    return best["solve_s"] * (best["error_m"] / wanted) ** power, True


def step_cost(repeat: int) -> Iterator[dict[str, Any]]:
    """Yield microseconds per implicit step of pendulum (2), 8 elements."""
    for tool in set(tools()) & STEP_TYPES.keys():
        for element in STEP_TYPES[tool]:
            told = [f"dt: {STEP}, method: generalized_alpha, newton: full, {ALONE}"]
            for way in told if tool == "ancf2d" else [f"{STEP} full", f"{STEP}"]:
                job = [tool, 2, element, 8, way, STEP * STEPS, STEP * STEPS]
                found = measure([job] * (repeat + 1))[1:]
                good = [1e6 * r["solve_s"] / r["steps"] for r in found if "solve_s" in r]
                newton = "full" if tool == "ancf2d" or "full" in way else "modified"
                yield {"tool": tool, "element": element, "newton": newton,
                       **({"step_us": statistics.median(good)} if good else {"error": found[0]["error"]})}


def explicit() -> dict[str, Any]:
    """Return what explicit integration of pendulum (1) takes, extrapolated to 1.5 s from a short time.

    The paper's way, RK45 with 8 elements 2d2n, and PyElastica with 32 elements at the longest step that is stable.
    """
    jobs = {"RK45": ["ancf2d", 1, "2d2n", 8, f"method: RK45, tolerance: 1e-3, {ALONE}", 2e-4, 2e-4],
            "pyelastica": ["pyelastica", 1, "Cosserat rod", 32, "1e-6", 2e-2, 2e-2]}
    out = {}
    for name, job in jobs.items():
        if job[0] in tools():
            found = measure([job, job])[-1]
            out[name] = found if "error" in found else {
                "measured_s": found["solve_s"], "measured_to": job[5], "steps": found["steps"],
                "extrapolated_s": found["solve_s"] * T_END[1] / job[5]}
    return out


def collect(repeat: int) -> dict[str, Any]:
    """Return all measurements."""
    return {"repeat": repeat, "ladders": {number: ladder(number, repeat) for number in LADDERS},
            "steps": list(step_cost(max(repeat, 5))), "explicit": explicit()}
