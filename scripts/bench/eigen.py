"""The 20 lowest modes of a simply supported beam with many elements: time, peak memory, digits.

Each size is a process of its own; frequencies are compared with those of 1000 elements and with Timoshenko's exact
first one.

    python scripts/bench/eigen.py --elements 100000
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from static_cantilever import THREADS

CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: 0.4, width: 0.4}}
    material: {{E: 1e9, nu: 0.3, rho: 7850}}
    element: {{type: {element}, count: {count}}}
boundary_conditions: [{{type: pin, at: beam@0}}, {{type: roller, at: beam@1, fixed: y}}]
solver: {{type: eigen, modes: 20}}
"""
EXACT = 95.63398088


def run(element: str, count: int) -> dict:
    """Return frequencies [rad/s], the wall's seconds of the solve, the processor's of all, and peak memory [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "beam.yaml"
        path.write_text(CASE.format(element=element, count=count), encoding="utf-8")
        code = ("import resource, sys; from ancf2d.cli import main\n"
                "try: main(['run', 'beam.yaml', '--json'])\n"
                "except SystemExit: pass\n"
                "used = resource.getrusage(resource.RUSAGE_SELF)\n"
                "print(used.ru_maxrss / 1024, used.ru_utime + used.ru_stime, file=sys.stderr)")
        done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True,
                              env={**os.environ, **dict.fromkeys(THREADS, "1")})
    memory, seconds = (float(x) for x in done.stderr.split()[-2:])
    found = json.loads(done.stdout)
    return {"omega": [f["omega"] for f in found["frequencies"]], "solve_s": found["wall_s"], "process_s": seconds,
            "memory_mb": memory}


def compare(types: list[str], elements: int) -> list[dict]:
    """Return what each type needs and reaches with 1000 and with many elements."""
    rows = []
    for element in types:
        coarse = None
        for count in (1000, elements):
            row = run(element, count)
            coarse = coarse or row["omega"]
            apart = max(abs(a / b - 1) for a, b in zip(row["omega"], coarse, strict=True))
            rows.append({"element": element, "elements": count, **row, "to_exact": abs(row["omega"][0] / EXACT - 1),
                         "to_coarse": apart})
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--elements", type=int, default=100_000)
    parser.add_argument("--types", default="reissner2,vallejo")
    args = parser.parse_args()
    rows = compare(args.types.split(","), args.elements)
    print(f"{'element':10s} {'elements':>8s} {'solve s':>8s} {'process s':>9s} {'peak MB':>8s} {'to exact':>9s} "
          f"{'to 1000':>9s}")
    for row in rows:
        print(f"{row['element']:10s} {row['elements']:8d} {row['solve_s']:8.2f} {row['process_s']:9.2f} "
              f"{row['memory_mb']:8.0f} {row['to_exact']:9.1e} {row['to_coarse']:9.1e}")


if __name__ == "__main__":
    main()
