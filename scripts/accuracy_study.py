"""Solve cases to wanted accuracies beside their limits, print the tables and write them into docs/accuracy-control.md.

True errors against meshes and steps so fine that their own error is far below, estimates, and the work of all solves
over that of the cheapest setting that would have done; about twenty minutes, a few where references are kept.

    python -m scripts.accuracy_study [--only NAME] [--keep FOLDER]
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from scripts.pages import DOCS, stamp, table, write
from scripts.pursuits.cases import OPEN, STUDIES, Study
from scripts.pursuits.measure import ROUND_OFF, Row, effectivities, measure
from scripts.pursuits.more import MORE

PAGE = DOCS / "accuracy-control.md"
HEAD = ("case", "wanted", "true error", "estimate", "estimate/true", "elements", "cheapest", "solves", "work", "time")
# times the least number of elements: meshes whose error the adjoint tells
COARSE = (2, 8)


def cells(row: Row) -> list[str]:
    """Return a row of the table."""
    bad = "" if row.reached else " **missed**"
    return [row.name, f"{row.wanted:.0e}", f"{row.truth:.1e}{bad}", f"{row.estimate:.1e}",
            f"{row.ratio:.2g}" if row.covered else f"**{row.ratio:.2g}**", str(row.elements), str(row.cheapest),
            str(row.solves), f"{row.work:.1f}", f"{row.time:.1f}"]


def shares(values: list[float]) -> str:
    """Return median, nine in ten, and largest."""
    if not values:
        return "none"
    low, high, most = np.nanquantile(values, [0.5, 0.9, 1.0])
    return f"median {low:.1f}, nine of ten at most {high:.1f}, all at most {most:.1f}"


def summary(rows: list[Row]) -> str:
    """Return what the rows come to."""
    n = len(rows)
    stepped = [row.time for row in rows if row.guesses]
    others = [row.time for row in rows if not row.guesses]
    sharp = sum(row.limit_error <= 0.1 * row.truth for row in rows)
    close = sum(row.truth < ROUND_OFF or 1.0 <= row.ratio <= 5.0 for row in rows)
    return "\n".join([
        f"* {sum(row.reached for row in rows)} of {n} runs are within the wanted error.",
        f"* {close} of {n} estimates are between one and five times the true error; "
        f"{sum(row.truth >= ROUND_OFF and row.ratio < 1.0 for row in rows)} are below it.",
        f"* Processor time relative to the cheapest setting: {shares([row.time for row in rows])}; at most 2 in "
        f"{sum(row.time <= 2.0 for row in rows)} of {n}, at most 3 in {sum(row.time <= 3.0 for row in rows)}.",
        f"* Nonlinear statics: {shares(stepped)}.",
        f"* Linear statics, modes, buckling, paths and motions: {shares(others)}.",
        f"* In {sharp} of {n} runs the error of the limit itself is below a tenth of the measured error.",
    ])


def study(studies: tuple[Study, ...], only: str, keep: Path | None) -> list[Row]:
    """Return the rows of all studies whose name holds ``only``, printed one by one."""
    rows: list[Row] = []
    for one in studies:
        if only in one.name:
            began = time.perf_counter()
            found = measure(one, keep)
            rows += found
            print(*(" ".join(cells(row)) + (f" ({row.note})" if row.note else "") for row in found), sep="\n")
            print(f"  limit known to {found[0].limit_error:.0e}, {time.perf_counter() - began:.0f} s", flush=True)
    return rows


def adjoints() -> list[list[str]]:
    """Return the rows of what the adjoint tells, of cases of statics in which it can be had."""
    found = [(one.name, effectivities(one, COARSE)) for one in STUDIES]
    return [[name, *("none" if v is None else f"{v:.2f}" for v in values)] for name, values in found
            if values is not None and any(values)]


def main() -> None:
    """Measure, print, and write the page where everything was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="cases whose name holds this; the page is left alone")
    parser.add_argument("--keep", type=Path, metavar="FOLDER",
                        help="where solves of references are kept, to go on with")
    args = parser.parse_args()
    given, left_open = study(STUDIES + MORE, args.only, args.keep), study(OPEN, args.only, args.keep)
    if given:
        print("\n" + summary(given))
    if args.only:
        return
    write(PAGE, "given", table(HEAD, list(map(cells, given))))
    write(PAGE, "given-summary", summary(given))
    write(PAGE, "open", table(HEAD, list(map(cells, left_open))))
    write(PAGE, "adjoint", table(("case", *(f"{n} times" for n in COARSE)), adjoints()))
    write(PAGE, "stamp", stamp("scripts.accuracy_study"))


if __name__ == "__main__":
    main()
