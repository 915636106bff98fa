"""Cost against size: Table 2's cantilever in 10 load steps from 8 to a million elements, time and memory.

Every run is a process of its own, on one core (the processor's time) and with all cores (the wall's) in turn. Up to
100 000 elements medians of some repeats; a million once each. The exponent is that of a power law fitted to the
processor's times on one core from 1000 elements on.

    python scripts/bench/scaling.py --types reissner2,vallejo --largest 1000000
"""

from __future__ import annotations

import argparse
import json
import os
import statistics

import numpy as np
from static_cantilever import measure

SIZES = [8, 100, 1000, 10_000, 100_000, 1_000_000]
TYPES = ["reissner2", "vallejo"]
FROM, ONCE = 1000, 1_000_000


def run(element: str, count: int, cores: str, repeat: int) -> list[dict]:
    """Return what some runs report."""
    return [measure("ancf2d", element, count, threads=cores) for _ in range(1 if count >= ONCE else repeat)]


def exponent(rows: list[dict]) -> float | None:
    """Return the power of the number of elements that the processor's time grows with from 1000 on."""
    good = {r["elements"]: r["solve_s"] for r in rows if "solve_s" in r and r["cores"] == "1"}
    points = [(n, t) for n, t in good.items() if n >= FROM]
    if len(points) < 2:
        return None
    n, t = np.log(np.array(points, dtype=float)).T
    return float(np.polyfit(n, t, 1)[0])


def collect(types: list[str], largest: int, repeat: int = 3) -> dict:
    """Return rows by type, size and cores, and exponents."""
    rows = []
    ways = {"1": "1"} if os.cpu_count() == 1 else {"1": "1", "all": str(os.cpu_count())}
    for element in types:
        for count in (n for n in SIZES if n <= largest):
            for cores, threads in ways.items():
                found = run(element, count, threads, repeat)
                good = [r for r in found if "error" not in r]
                row = {"element": element, "elements": count, "cores": cores}
                if not good:
                    rows.append(row | {"error": found[0]["error"]})
                    continue
                rows.append(row | {k: statistics.median(r[k] for r in good)
                                   for k in ("build_s", "solve_s", "wall_s", "iterations", "memory_mb", "peak_mb")})
    return {"cores": os.cpu_count(), "rows": rows,
            "exponents": [{"element": e, "exponent": exponent([r for r in rows if r["element"] == e])} for e in types]}


def main() -> None:
    """Print what was measured as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--types", default=",".join(TYPES))
    parser.add_argument("--largest", type=int, default=SIZES[-1])
    parser.add_argument("--repeat", type=int, default=3)
    args = parser.parse_args()
    print(json.dumps(collect(args.types.split(","), args.largest, args.repeat), indent=1))


if __name__ == "__main__":
    main()
