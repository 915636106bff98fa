"""Measure start-up, statics, modes and motion and write docs/speed.md, stamped with versions and machine.

    python scripts/bench/report.py
"""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path

import dynamics
import eigen
import startup
import static_cantilever
from stamp import machine, versions

PAGE = Path(__file__).resolve().parents[2] / "docs" / "speed.md"
TYPES = ["reissner2", "reissner3", "kerkkanen", "vallejo"]
SIZES = [1000, 10_000]


def start_table() -> list[str]:
    """Return the start-up table as Markdown."""
    found = startup.measure(3)
    base = found["the imports alone"]
    rows = [f"| {name} | {t:.2f} s | {t / base:.1f} |" for name, t in found.items()]
    return ["| what | median | of the imports alone |", "| --- | --- | --- |", *rows]


def static_table(elements: int) -> list[str]:
    """Return the comparison at one size as Markdown rows."""
    rows = []
    for row in static_cantilever.compare(elements, TYPES, 3):
        if "error" in row:
            rows.append(f"| {elements} | {row['tool']} | {row['element']} | failed: {row['error']} | | | |")
            continue
        ratio = f"{row['ratio']:.2f}" if row["ratio"] else ""
        iterations = row["iterations"] or ""
        rows.append(f"| {elements} | {row['tool']} | {row['element']} | {row['solve_s']:.3f} s | {ratio} | "
                    f"{iterations} | {row['memory_mb']:.0f} MB |")
    return rows


def eigen_table() -> list[str]:
    """Return the modes of long meshes as Markdown rows."""
    return [f"| {r['elements']} | {r['element']} | {r['solve_s']:.2f} s | {r['memory_mb']:.0f} MB | "
            f"{r['to_exact']:.0e} | {r['to_coarse']:.0e} |" for r in eigen.compare(["reissner2", "vallejo"], 100_000)]


def main() -> None:
    """Write the page."""
    tools = versions("exudyn")
    text = f"""# Speed

Measured by `python scripts/bench/report.py` on {date.today()}: {machine()}; {tools}. Medians of runs made in turn
on a shared machine: trust the ratios more than the seconds.

## Start

`--help` and `validate` import no compiler. The first run of a formulation compiles its kernels; they are kept in the
user's cache folder under a name that changes with the sources, so that they are never stale.

{os.linesep.join(start_table())}

## Large deflection of a cantilever

Table 2's beam, 500 kN at the tip in 10 load steps, one core, the solve alone. Exudyn runs its geometrically exact beam,
the like of `reissner2`, at the tightest tolerance that it meets (relative 1e-6). Memory is the peak of the process less
what it had after its imports.

| elements | tool | type | solve | to Exudyn | iterations | memory |
| --- | --- | --- | --- | --- | --- | --- |
{os.linesep.join(line for n in SIZES for line in static_table(n))}

## Modes of many elements

The 20 lowest modes of Table 3's beam (its Timoshenko solution: 95.63398088 rad/s for the first). Memory is the whole
process.

| elements | type | solve | memory | first, off the exact one by | all, off 1000 elements by |
| --- | --- | --- | --- | --- | --- |
{os.linesep.join(eigen_table())}

## Motion

Pendulum (1) of the paper's Sec. 5.4 to 1.5 s, one core, the solve alone. The error is the largest distance of the tip,
at multiples of 0.01 s, from a fine solution of the same model. Exudyn steps by generalized alpha with modified Newton,
at a tolerance of 1e-5 (its default lies below round-off here). Then one implicit step of pendulum (2) with 8 elements,
dt = 1e-4, and the paper's own way: Runge-Kutta with 2d2n.

{os.linesep.join(dynamics.report(dynamics.collect(3)))}
"""
    PAGE.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
