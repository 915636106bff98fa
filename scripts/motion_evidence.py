"""Measure how well motions are computed, print the tables and write them, stamped, into docs/motion.md and moving.md.

Cases beside their references, what is kept over a million steps and a thousand turns, steps that are too long, joints,
orders, runs that are killed, and what crosses a beam; about a quarter of an hour.

    python -m scripts.motion_evidence [--tables cases,joints] [--steps 1000000] [--turns 1000] [--kills 50]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from scripts.evidence import cases, conservation, crossings, joints, kills, orders, traps
from scripts.pages import DOCS, stamp, write

PAGE = DOCS / "motion.md"
# tables on other pages
ELSEWHERE = {"crossings": DOCS / "moving.md"}


def tables(steps: int, turns: float, count: int) -> dict[str, Callable[[], str]]:
    """Return what measures each table, by the name of its place on the page."""
    return {
        "cases": cases.exact, "given": cases.given, "paper": cases.paper, "apart": cases.apart,
        "drift": lambda: conservation.drifts(steps), "steady": lambda: conservation.steadies(turns),
        "turned": conservation.turned, "traps": traps.report, "tolerances": traps.tolerances, "joints": joints.report,
        "orders": orders.report, "kills": lambda: kills.report(count),
        "crossings": crossings.report,
    }


def main() -> None:
    """Measure the parts that are asked for, and write each as it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", default=",".join(tables(0, 0.0, 0)), help="some of %(default)s")
    parser.add_argument("--steps", type=int, default=1_000_000, help="of the freely flying rod")
    parser.add_argument("--turns", type=float, default=1000.0, help="of the rods in steady rotation")
    parser.add_argument("--kills", type=int, default=50, help="of running cases")
    args = parser.parse_args()
    known = tables(args.steps, args.turns, args.kills)
    wanted = args.tables.split(",")
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"no table {', '.join(unknown)}; there are {', '.join(known)}")
    for name in wanted:
        began = time.perf_counter()
        found = known[name]()
        if name in ELSEWHERE:
            write(ELSEWHERE[name], name, f"{found}\n\n{stamp(f'motion_evidence --tables {name}')}")
        else:
            write(PAGE, name, found)
        print(f"{name} ({time.perf_counter() - began:.0f} s)\n\n{found}\n", flush=True)
    if not ELSEWHERE.keys() >= set(wanted):
        write(PAGE, "stamp", stamp("motion_evidence"))


if __name__ == "__main__":
    main()
