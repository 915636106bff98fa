"""Probes as CSV: a line per stored value or frequency, a column per quantity, at full precision."""

from __future__ import annotations

import csv
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results.export import Done
from ancf2d.results.reader import Results

BLOCK = 4096  # lines between two reports of progress


def time_name(results: Results) -> str:
    """Return what states are counted by: ``t``, or ``factor`` where it is the load factor."""
    return "t" if results.over_time else "factor"


def write(results: Results, path: Path, done: Done) -> None:
    """Write ``t`` or ``factor``, then ``NAME.x``, ``NAME.y``, ... of each probe. Raises ResultsError without probes.

    Of a frequency response: ``hz``, then ``INPUT.NAME.x.re``, ``INPUT.NAME.x.im``, ...
    """
    columns = {time_name(results): results.probe_t, **{
        f"{name}.{q}": values for name, table in results.probes.items() for q, values in table.items()}}
    columns = results.tables.get("response", columns)
    if len(columns) < 2:
        raise ResultsError(f"'{results.path}' holds no values of probes; name points under output.probes in the case "
                           "and run it again")
    count = len(next(iter(columns.values())))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(list(columns))
        for start in range(0, count, BLOCK):
            part = slice(start, start + BLOCK)
            writer.writerows(zip(*(c[part].tolist() for c in columns.values()), strict=True))
            done(min(start + BLOCK, count) / count)
