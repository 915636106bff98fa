"""The paper's pendulums over time: error against wall time, the cost of a step, and the paper's own integrator.

Pendulum (1) to 1.5 s with ladders of meshes and steps: the error is the largest distance of the tip, at multiples of
0.01 s, from the fine solution of the same element of the same tool. Pendulum (2) with 8 elements and dt = 1e-4: the
cost of one implicit step. RK45 with 2d2n, 8 elements: measured over a short time, extrapolated to 1.5 s. Every tool
runs in a process of its own, in turn; time is that of the solve call alone. Exudyn: ``pip install .[peers]``.

    python scripts/bench/dynamics.py --repeat 3 --json out.json
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

T_END, INTERVAL = 1.5, 0.01
CASE = """
bodies:
  rod:
    geometry: {{type: line, start: [0, 0], end: [{length}, 0]}}
    section: {{height: {height}, width: {width}}}
    material: {{E: {E}, nu: 0.3, rho: {rho}}}
    element: {{type: {element}, count: {count}{more}}}
boundary_conditions: [{{type: pin, at: rod@0}}]
loads: [{{type: gravity, value: [0, -9.81]}}]
solver: {{type: dynamic, t_end: {t_end}, {solver}}}
output: {{interval: {interval}, probes: {{tip: rod@1}}}}
"""
PENDULUM = {1: {"length": 1.8, "height": 0.008, "width": 0.03125, "E": 2.07e11, "rho": 2766.67},
            2: {"length": 1.2, "height": 0.253, "width": 0.006335, "E": 7e5, "rho": 5540}}
SHEAR = {"reissner2": ", shear_factor: 0.8333333333333334", "reissner3": ", shear_factor: 0.8333333333333334"}
# no runs with coarser steps beside, for an error estimate
ALONE = "estimate: false"
# (elements, what the solver is told); the last of a ladder is the fine solution that errors are taken against
LADDERS: dict[tuple[str, str], list[tuple[int, str]]] = {
    ("ancf2d", "reissner3"): [(4, f"dt: 0.01, {ALONE}"), (6, f"dt: 0.01, {ALONE}"), (8, "tolerance: 1e-4"),
                              (12, f"dt: 0.0025, {ALONE}"), (16, f"dt: 0.0025, {ALONE}"), (32, "tolerance: 1e-9")],
    ("ancf2d", "cable"): [(4, f"dt: 0.01, {ALONE}"), (4, f"dt: 0.005, {ALONE}"), (6, f"dt: 0.005, {ALONE}"),
                          (8, f"dt: 0.0025, {ALONE}"), (12, f"dt: 0.00125, {ALONE}"), (32, "tolerance: 1e-9")],
    ("ancf2d", "2d2n"): [(8, f"dt: 0.01, {ALONE}"), (32, f"dt: 0.01, {ALONE}"), (128, "tolerance: 1e-7")],
    ("exudyn", "geometrically_exact"): [(16, "2.5e-3"), (24, "1.25e-3"), (32, "1.25e-3"), (64, "6.25e-4"),
                                        (96, "3.125e-4"), (128, "1.5625e-4")],
    ("exudyn", "cable"): [(4, "2.5e-3"), (4, "1.25e-3"), (4, "6.25e-4"), (8, "3.125e-4"), (8, "1.5625e-4"),
                          (16, "7.8125e-5")],
}
STEP, STEPS = 1e-4, 2000
STEP_TYPES = {"ancf2d": ("reissner2", "reissner3", "cable", "2d2n", "omar"), "exudyn": ("geometrically_exact", "cable")}


def run_ancf2d(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict:
    """Solve with ancf2d; return the tip over time, seconds of the solve alone and steps."""
    from ancf2d.case import load_case_text
    from ancf2d.model.build import build_model
    from ancf2d.solve.post import Observer
    from ancf2d.solve.registry import solve
    from ancf2d.study.run import vocabulary
    from ancf2d.study.warmup import warm_up

    text = CASE.format(**PENDULUM[number], element=element, count=count, more=SHEAR.get(element, ""), solver=solver,
                       t_end=t_end, interval=interval)
    model = build_model(load_case_text(text, vocabulary=vocabulary()))
    warm_up(model)
    states, seconds, t, tip, steps = solve(model), 0.0, [], [], 0
    observer = Observer(model)
    while True:
        started = time.perf_counter()
        state = next(states, None)
        seconds += time.perf_counter() - started
        if state is None:
            break
        at = observer.observe(state)["tip"]
        t.append(state.t)
        tip.append([at["x"], at["y"]])
        steps = state.report.get("steps", steps)
    return {"t": t, "tip": tip, "solve_s": seconds, "steps": steps}


def run_exudyn(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict:
    """Solve with Exudyn; ``solver`` is the step, with ``full`` behind it for full Newton."""
    import exudyn_pendulum

    dt, *full = solver.split()
    return exudyn_pendulum.solve(number, element, count, t_end, float(dt), interval, modified=not full,
                                 tolerance=1e-5)


TOOLS: dict[str, Callable[..., dict]] = {"ancf2d": run_ancf2d, "exudyn": run_exudyn}


def child(jobs: list[list]) -> None:
    """Run jobs [tool, arguments...] one after another and print what each reports, or why it failed, as a JSON line."""
    for tool, *arguments in jobs:
        try:
            found = TOOLS[tool](*arguments)
        except Exception as error:
            found = {"error": str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__}
        print("\n" + json.dumps(found), flush=True)


def measure(jobs: list[list], seconds: float = 600) -> list[dict]:
    """Run jobs in a process of their own."""
    done = subprocess.run([sys.executable, __file__, "--child", json.dumps(jobs)], capture_output=True, text=True,
                          check=False, timeout=seconds)
    found = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return found + [{"error": done.stderr.strip()[-200:]}] * (len(jobs) - len(found))


def tools() -> list[str]:
    """Return the tools that are installed."""
    if importlib.util.find_spec("exudyn"):
        return ["ancf2d", "exudyn"]
    print("exudyn is not installed (pip install exudyn): ancf2d alone", file=sys.stderr)
    return ["ancf2d"]


def distance(found: dict, fine: dict) -> float:
    """Return the largest distance of two tips at the times that both know; infinite where one ended early."""
    a, b = ({round(t / INTERVAL): p for t, p in zip(r["t"], r["tip"], strict=True)} for r in (found, fine))
    if found["t"][-1] < T_END - INTERVAL / 2:
        return float("inf")
    return max(float(np.hypot(*np.subtract(a[k], b[k]))) for k in a.keys() & b.keys())


def ladder(repeat: int) -> list[dict]:
    """Return error and median time of every rung of every tool; ``fine`` marks what errors are taken against."""
    rows = []
    runs = {key: [[key[0], 1, key[1], n, s, T_END, INTERVAL] for n, s in rungs] for key, rungs in LADDERS.items()
            if key[0] in tools()}
    times: dict = {key: [[] for _ in jobs] for key, jobs in runs.items()}
    last: dict = {}
    for turn in range(repeat):
        for key, jobs in runs.items():
            # the first run of a process pays for loading; the fine solution is needed once
            found = measure([jobs[0], *jobs] if turn == 0 else [jobs[0], *jobs[:-1]])[1:]
            last[key] = last.get(key, found)
            for k, result in enumerate(found):
                times[key][k].append(result.get("solve_s"))
    for key, found in last.items():
        for (n, s), result, seconds in zip(LADDERS[key], found, times[key], strict=True):
            row = {"tool": key[0], "element": key[1], "elements": n, "solver": s, "fine": result is found[-1]}
            rows.append(row | result if "error" in result or "error" in found[-1] else
                        row | {"error_m": distance(result, found[-1]), "solve_s": statistics.median(seconds),
                               "steps": result["steps"]})
    return rows


def at_error(rows: list[dict], tool: str, element: str, wanted: float) -> float | None:
    """Return the least time of a rung whose error is below ``wanted`` [s]."""
    good = [r["solve_s"] for r in rows if (r["tool"], r["element"]) == (tool, element) and "solve_s" in r
            and not r["fine"] and r["error_m"] < wanted]
    return min(good, default=None)


def step_cost(repeat: int) -> Iterator[dict]:
    """Yield microseconds per implicit step of pendulum (2), 8 elements."""
    for tool in tools():
        for element in STEP_TYPES[tool]:
            own = [f"dt: {STEP}, method: generalized_alpha, newton: full, {ALONE}"]
            ways = own if tool == "ancf2d" else [f"{STEP} full", f"{STEP}"]
            for way in ways:
                job = [tool, 2, element, 8, way, STEP * STEPS, STEP * STEPS]
                found = measure([job] * (repeat + 1))[1:]
                good = [1e6 * r["solve_s"] / r["steps"] for r in found if "solve_s" in r]
                newton = "full" if tool == "ancf2d" or "full" in way else "modified"
                yield {"tool": tool, "element": element, "newton": newton,
                       **({"step_us": statistics.median(good)} if good else {"error": found[0]["error"]})}


def explicit(t_end: float = 2e-4) -> dict:
    """Return what RK45 needs for pendulum (1) with 8 elements 2d2n, extrapolated to 1.5 s from a short time."""
    job = ["ancf2d", 1, "2d2n", 8, "method: RK45, tolerance: 1e-3", t_end, t_end]
    found = measure([job, job])[-1]
    if "error" in found:
        return found
    return {"measured_s": found["solve_s"], "measured_to": t_end, "extrapolated_s": found["solve_s"] * T_END / t_end,
            "steps": found["steps"]}


def collect(repeat: int) -> dict:
    """Return all measurements."""
    return {"repeat": repeat, "ladder": ladder(repeat), "steps": list(step_cost(repeat)), "RK45": explicit()}


def report(found: dict) -> list[str]:
    """Return the measurements as Markdown."""
    lines = ["| tool | type | elements | step | steps | solve | largest tip error |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for r in found["ladder"]:
        head = f"| {r['tool']} | {r['element']} | {r['elements']} | {r['solver']}"
        if "error" in r:
            lines.append(f"{head} | | failed: {r['error']} | |")
        elif not r["fine"]:
            lines.append(f"{head} | {r['steps']} | {1e3 * r['solve_s']:.1f} ms | {r['error_m']:.1e} m |")
    lines += ["", "| largest tip error below | " + " | ".join(f"{t} {e}" for t, e in LADDERS) + " |",
              "| --- |" + " --- |" * len(LADDERS)]
    for wanted in (1e-3, 1e-4, 1e-5):
        times = (at_error(found["ladder"], *key, wanted) for key in LADDERS)
        cells = ("-" if t is None else f"{1e3 * t:.1f} ms" for t in times)
        lines.append(f"| {wanted:.0e} m | " + " | ".join(cells) + " |")
    lines += ["", "| tool | type | Newton | a step |", "| --- | --- | --- | --- |"]
    for r in found["steps"]:
        cost = f"{r['step_us']:.1f} us" if "step_us" in r else f"failed: {r['error']}"
        lines.append(f"| {r['tool']} | {r['element']} | {r['newton']} | {cost} |")
    rk = found["RK45"]
    lines += ["", f"RK45 failed: {rk['error']}" if "error" in rk else
              f"RK45, 2d2n, 8 elements: {rk['steps']} steps, {rk['measured_s']:.2f} s for {rk['measured_to']:g} s of "
              f"motion; for 1.5 s, extrapolated, {rk['extrapolated_s']:.0f} s."]
    return lines


def main() -> None:
    """Print the tables, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", help="file to write the measurements to")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        child(json.loads(args.child))
        return
    found = collect(args.repeat)
    print("\n".join(report(found)))
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump(found, file, indent=1)


if __name__ == "__main__":
    main()
