"""Table 2's cantilever with many elements in 10 load steps: time and peak memory, ancf2d beside others.

Each run is a process of its own; the tools alternate, and medians and ratios are printed. Time is the processor's, of
the solve alone, after imports, mesh and (for ancf2d) compiled kernels; memory is the process's peak less what it had
after its imports. Exudyn uses its geometrically exact beam, the like of reissner2; OpenSees its corotational beams, by
forces and with a line search, without which it does not solve fine meshes. PyElastica has no static solver. The peers:
``pip install .[peers]``.

    python scripts/bench/static_cantilever.py --elements 10000 --repeat 3 --json out.json
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import time

from scenes import STATIC

STEPS = 10
EXUDYN_TOLERANCE = 1e-6
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: 0.1, width: 0.1}}
    material: {{E: 2.07e11, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: {count}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, -500e3]}}]
solver: {{type: static, steps: 10}}
output: {{probes: {{tip: beam@1}}}}
"""


def peak_mb() -> float:
    """Return the peak resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run_ancf2d(element: str, count: int) -> dict:
    """Solve with ancf2d; return tip, seconds and memory."""
    from ancf2d.case import load_case_text
    from ancf2d.model.build import build_model
    from ancf2d.solvers.post import Observer
    from ancf2d.solvers.static import solve_static
    from ancf2d.study.warmup import warm_up

    warm_up(build_model(load_case_text(CASE.format(element=element, count=2))))
    base, start = peak_mb(), time.process_time()
    model = build_model(load_case_text(CASE.format(element=element, count=count)))
    built = time.process_time()
    state, iterations, began = None, 0, time.perf_counter()
    for state in solve_static(model, STEPS):
        iterations += int(state.history["iterations"])
    seconds, wall = time.process_time() - built, time.perf_counter() - began
    tip = Observer(model).observe(state)["tip"]
    return {"u": [tip["ux"], tip["uy"]], "build_s": built - start, "solve_s": seconds, "wall_s": wall,
            "iterations": iterations, "memory_mb": peak_mb() - base, "peak_mb": peak_mb()}


def run_exudyn(element: str, count: int) -> dict:
    """Solve with Exudyn's planar geometrically exact beam; return tip, seconds and memory."""
    import exudyn as exu
    from exudyn.itemInterface import (
        Beam2D,
        CoordinateConstraint,
        Force,
        MarkerNodeCoordinate,
        MarkerNodePosition,
        NodePointGround,
        NodeRigidBody2D,
    )

    base, start = peak_mb(), time.process_time()
    bar = STATIC
    A, I, L = bar.area, bar.inertia, bar.length
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    nodes = [mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[L * i / count, 0, 0])) for i in range(count + 1)]
    for i in range(count):
        mbs.AddObject(Beam2D(nodeNumbers=[nodes[i], nodes[i + 1]], physicsLength=L / count,
                             physicsMassPerLength=bar.rho * A, physicsCrossSectionInertia=bar.rho * I,
                             physicsBendingStiffness=bar.E * I, physicsAxialStiffness=bar.E * A,
                             physicsShearStiffness=bar.shear_stiffness))
    ground = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    for k in range(3):
        held = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[ground, held]))
    tip = mbs.AddMarker(MarkerNodePosition(nodeNumber=nodes[-1]))
    mbs.AddLoad(Force(markerNumber=tip, loadVector=[0, -bar.load, 0]))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = STEPS
    # the tightest tolerance that it meets with this mesh: 1e-8, its default, lies below round-off here
    settings.staticSolver.newton.relativeTolerance = EXUDYN_TOLERANCE
    settings.solutionSettings.writeSolutionToFile = False
    settings.staticSolver.verboseMode = 0
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    built = time.process_time()
    mbs.SolveStatic(settings)
    seconds = time.process_time() - built
    u = mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Displacement)
    return {"u": [float(u[0]), float(u[1])], "build_s": built - start, "solve_s": seconds, "iterations": None,
            "memory_mb": peak_mb() - base}


def run_opensees(element: str, count: int) -> dict:
    """Solve with OpenSees' corotational beam; return tip, seconds and memory."""
    import opensees_beam

    # what loading its library takes
    import openseespy.opensees

    openseespy.opensees.wipe()
    base = peak_mb()
    found = opensees_beam.solve_static(element, count, STEPS)
    return found | {"memory_mb": peak_mb() - base}


TOOLS = {"ancf2d": run_ancf2d, "exudyn": run_exudyn, "opensees": run_opensees}
PEERS = {("exudyn", "geometrically exact"): "exudyn", ("opensees", "force-based"): "openseespy"}


def measure(tool: str, element: str, count: int, threads: str = "1") -> dict:
    """Run one tool in a process of its own, with so many threads, and return what it reports."""
    done = subprocess.run([sys.executable, __file__, "--child", tool, element, str(count)], capture_output=True,
                          text=True, check=False, env={**os.environ, **dict.fromkeys(THREADS, threads)})
    if done.returncode != 0:
        # OpenSees says goodbye behind its failure
        lines = [x for x in (done.stderr or done.stdout).splitlines() if x.strip() and not x.startswith("Process ")]
        return {"error": lines[-1] if lines else f"exit code {done.returncode}"}
    return json.loads(done.stdout.strip().splitlines()[-1])


def main() -> None:
    """Print the table, and write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", type=int, default=10000)
    parser.add_argument("--types", default="reissner2,reissner3,vallejo,kerkkanen")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", help="file to write the measurements to")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        tool, element, count = args.child
        print(json.dumps(TOOLS[tool](element, int(count))))
        return
    rows = compare(args.elements, args.types.split(","), args.repeat)
    report(rows, args)


def compare(elements: int, types: list[str], repeat: int) -> list[dict]:
    """Return the medians of each tool and type, measured in turn; ``ratio`` is to Exudyn's solve where it ran."""
    runs = [peer for peer, module in PEERS.items() if importlib.util.find_spec(module)]
    for tool, _ in PEERS.keys() - set(runs):
        print(f"{tool} is not installed (pip install .[peers]): left out", file=sys.stderr)
    runs += [("ancf2d", t) for t in types]
    found = {run: [] for run in runs}
    for _ in range(repeat):
        for run in runs:
            found[run].append(measure(*run, elements))
    rows, peer = [], None
    for (tool, element), results in found.items():
        good = [r for r in results if "error" not in r]
        if not good:
            rows.append({"tool": tool, "element": element, "error": results[0]["error"]})
            continue
        row = {k: statistics.median(r[k] for r in good) for k in ("build_s", "solve_s", "memory_mb")}
        peer = row["solve_s"] if tool == "exudyn" else peer
        rows.append({"tool": tool, "element": element, **row, "ratio": row["solve_s"] / peer if peer else None,
                     "u": good[0]["u"], "iterations": good[0]["iterations"]})
    return rows


def report(rows: list[dict], args: argparse.Namespace) -> None:
    """Print medians and the ratio to Exudyn's time."""
    print(f"{args.elements} elements, {STEPS} load steps, median of {args.repeat}, {platform.processor() or 'cpu'}")
    print(f"{'tool':8s} {'element':20s} {'build s':>8s} {'solve s':>8s} {'ratio':>6s} {'memory MB':>10s}  tip")
    for row in rows:
        if "error" in row:
            print(f"{row['tool']:8s} {row['element']:20s} failed: {row['error']}")
            continue
        ratio = f"{row['ratio']:6.2f}" if row["ratio"] else "     -"
        print(f"{row['tool']:8s} {row['element']:20s} {row['build_s']:8.3f} {row['solve_s']:8.3f} {ratio} "
              f"{row['memory_mb']:10.1f}  {row['u'][0]:.7f} {row['u'][1]:.7f}")
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump({"elements": args.elements, "steps": STEPS, "repeat": args.repeat, "rows": rows}, file, indent=1)


if __name__ == "__main__":
    main()
