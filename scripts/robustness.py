"""Try files and processes hard, print what was tried and survived, and write it into docs/robustness.md, stamped.

Mutants of case files and of result files, a thousand runs in one process, other numbers of threads, processes at once,
commands stopped at random moments, disks that take nothing more, very many events; about an hour. Exits with 1 where a
promise of the page was broken, and names the mutants that did it.

    python -m scripts.robustness [--tables cases,results] [--cases 10000] [--results 1000] [--minutes 60] [--runs 1000]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from scripts.endurance import events, repeats, stops
from scripts.fuzz import case_trial, result_mutants, result_trial
from scripts.pages import DOCS, one_thread, stamp, table, write

PAGE = DOCS / "robustness.md"
BROKEN: list[str] = []


def cases(seed: int, count: int, minutes: float) -> str:
    """Try mutants of case files; return what came of them."""
    ends: Counter[tuple[int, int | None]] = Counter()
    most, slowest, began = 0, 0.0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for trial, ended in case_trial.trials(Path(folder), seed, range(count)):
            ends[trial.validated, trial.ran] += 1
            most, slowest = max(most, ended.memory), max(slowest, trial.seconds)
            broken("case", trial.number, trial.faults)
            if time.monotonic() - began > 60 * minutes:
                break
    count = sum(ends.values())
    ran = Counter({code: 0 for code in (0, 1, 2, 130)})
    for (_, code), n in ends.items():
        ran[code] += n if code is not None else 0
    checked = Counter({code: sum(n for (first, _), n in ends.items() if first == code) for code in (0, 1, 2)})
    rows = [["validated", count, *(checked[code] for code in (0, 1, 2)), ""],
            ["run", sum(ran.values()), ran[0], ran[1], ran[2], ran[130]]]
    found = table(["", "mutants", "exit 0", "exit 1", "exit 2", "interrupted after 2 s: exit 130"], rows)
    return (f"{found}\n\nSeed {seed}; {time.monotonic() - began:.0f} s in all, {slowest:.1f} s for the slowest "
            f"validation, at most {most / 1e6:.0f} MB for one mutant. {told('case')}")


def results(seed: int, count: int, minutes: float) -> str:
    """Try mutants of result files; return what came of them."""
    codes: Counter[tuple[str, int]] = Counter()
    read, most, began = 0, 0, time.monotonic()
    with tempfile.TemporaryDirectory() as sound, tempfile.TemporaryDirectory() as folder:
        bases = result_mutants.make_bases(Path(sound))
        for trial, ended in result_trial.trials(Path(folder), bases, seed, range(count)):
            codes += trial.codes
            read, most = read + trial.read, max(most, ended.memory)
            broken("result", trial.number, trial.faults)
            if time.monotonic() - began > 60 * minutes:
                break
    count = trial.number + 1
    names = list(dict.fromkeys(name for name, _ in codes))
    rows = [[name, sum(n for (k, _), n in codes.items() if k == name), *(codes[name, code] for code in (0, 1, 2))]
            for name in names]
    found = table(["command", "calls", "exit 0", "exit 1", "exit 2"], rows)
    return (f"{found}\n\nSeed {seed}; {count} mutants, of which {read} were read as results; "
            f"{time.monotonic() - began:.0f} s in all, at most {most / 1e6:.0f} MB for one mutant. {told('result')}")


def broken(kind: str, number: int, faults: list[str]) -> None:
    """Print and keep what broke a promise."""
    for fault in faults:
        BROKEN.append(f"{kind} {number}: {fault}")
        print(BROKEN[-1], file=sys.stderr, flush=True)


def told(kind: str) -> str:
    """Return how many mutants of a kind broke a promise."""
    numbers = {text.split(":")[0] for text in BROKEN if text.startswith(kind)}
    return f"Mutants with another exit code, a traceback, a damaged file or no bound: {len(numbers)}."


def tables(args: argparse.Namespace) -> dict[str, Callable[[], str]]:
    """Return what measures each table, by the name of its place on the page."""
    return {
        "cases": lambda: cases(args.seed, args.cases, args.minutes),
        "results": lambda: results(args.seed, args.results, args.minutes),
        "growth": lambda: repeats.growth_report(args.runs), "threads": repeats.thread_report,
        "crowds": repeats.crowds_report, "stops": lambda: stops.stops_report(args.stops), "places": stops.places_report,
        "events": lambda: events.report(args.events),
    }


def main() -> None:
    """Measure the parts that are asked for, and write each as it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = ("cases", "results", "growth", "threads", "crowds", "stops", "places", "events")
    parser.add_argument("--tables", default=",".join(known), help="some of %(default)s")
    for name, value, what in (("cases", 10_000, "mutants of case files"), ("results", 1000, "mutants of result files"),
                              ("runs", 1000, "runs in one process"), ("stops", 10, "of each command by each signal"),
                              ("events", 100_000, "in one motion"), ("seed", 1, "of all that is random")):
        parser.add_argument(f"--{name}", type=int, default=value, help=what)
    parser.add_argument("--minutes", type=float, default=60.0, help="after which no further mutants are tried")
    args = parser.parse_args()
    if unknown := [name for name in args.tables.split(",") if name not in known]:
        parser.error(f"unknown: {', '.join(unknown)}")
    # of this process; processes for other numbers of threads are told theirs
    one_thread()
    measured = tables(args)
    for name in args.tables.split(","):
        found = measured[name]()
        print(f"{name}\n{found}\n", flush=True)
        write(PAGE, name, f"{found}\n\n{stamp(f'robustness --tables {name}', 'h5py')}")
    sys.exit(1 if BROKEN else 0)


if __name__ == "__main__":
    main()
