"""Compare ancf2d with a separate program: random frames and mechanisms, solved by ``own_equations`` too.

    python -m scripts.independent frames [--count 200] [--first 0] [--jobs 2] [--minutes 60] [--keep FOLDER] [--page]
    python -m scripts.independent mechanisms [--count 100] ...

Prints each deviation beyond what the discretisation allows, and a table by elements and subject; exits with 1 where
there is any. What is compared is kept in a log, of which the table is, and a run that is stopped goes on from there.
``--keep`` writes the cases of deviations, ``--page`` the table into docs/robustness.md; ``--minutes`` ends it early.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

from scripts.pages import DOCS, one_thread, stamp, table, write

# before NumPy is imported, here and in the processes that are spawned
one_thread()

from scripts.own_equations.frames import frames  # noqa: E402
from scripts.own_equations.mechanisms import mechanisms  # noqa: E402
from scripts.own_equations.verdict import Verdict  # noqa: E402

KINDS = {"frames": (frames, 200), "mechanisms": (mechanisms, 100)}


def of(job: tuple[str, int]) -> list[Verdict]:
    """Compare one of a kind, in a process of its own."""
    kind, number = job
    return list(KINDS[kind][0]([number]))


def compared(verdicts: list[Verdict]) -> str:
    """Return the table of deviations by elements and subject."""
    rows = []
    for kind, subject in sorted({(v.kind, v.subject) for v in verdicts}):
        of = [v for v in verdicts if (v.kind, v.subject) == (kind, subject)]
        off = [v.deviation for v in of]
        rows.append([kind, subject, len(of), f"{statistics.median(off):.1e}", f"{max(off):.1e}",
                     f"{max(v.deviation / v.allowed for v in of):.2f}", sum(not v.holds for v in of)])
    return table(["elements", "subject", "computed", "median deviation", "largest", "largest share of allowed",
                  "beyond"], rows)


def kept(log: Path) -> list[Verdict]:
    """Return the verdicts of a log."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    return [Verdict(**item, case={}) for line in lines if line.endswith("]") for item in json.loads(line)]


def keep(log: Path, found: list[Verdict]) -> None:
    """Add the verdicts on one frame or mechanism to a log."""
    with log.open("a", encoding="utf-8") as file:
        file.write(json.dumps([{k: v for k, v in asdict(one).items() if k != "case"} for one in found]) + "\n")


def tell(v: Verdict, folder: Path | None) -> None:
    """Print a deviation that is not allowed, and keep its case."""
    print(f"{v.number}, {v.kind}, {v.subject}: {v.what}, {v.deviation:.1e}, allowed {v.allowed:.1e}", flush=True)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{v.number}-{v.subject}.yaml".replace(" ", "-")
        file.write_text(json.dumps(v.case, indent=1), encoding="utf-8")


def main() -> None:
    """Compare what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=KINDS)
    parser.add_argument("--count", type=int, help="how many, 200 frames or 100 mechanisms unless given")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--jobs", type=int, default=2, help="processes at once")
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which no further one is tried")
    parser.add_argument("--log", type=Path, help="of what is compared (default: independent-frames.jsonl, ...)")
    parser.add_argument("--keep", type=Path, help="folder for the cases that deviate")
    parser.add_argument("--page", action="store_true", help="write the table into docs/robustness.md")
    args = parser.parse_args()
    usual = KINDS[args.what][1]
    log = args.log or Path(f"independent-{args.what}.jsonl")
    verdicts = kept(log)
    done = {v.number for v in verdicts}
    numbers = [n for n in range(args.first, args.first + (usual if args.count is None else args.count))
               if n not in done]
    began = time.monotonic()
    with get_context("spawn").Pool(args.jobs) as pool:
        for found in pool.imap_unordered(of, ((args.what, n) for n in numbers)):
            verdicts += found
            keep(log, found)
            for v in found:
                if not v.holds:
                    tell(v, args.keep)
            if time.monotonic() - began > 60 * args.minutes:
                break
    print(compared(verdicts))
    if args.page:
        made = stamp(f"independent {args.what} --page")
        write(DOCS / "robustness.md", args.what,
              f"{compared(verdicts)}\n\n{len({v.number for v in verdicts})} {args.what}.\n\n{made}")
    sys.exit(any(not v.holds for v in verdicts))


if __name__ == "__main__":
    main()
