"""All cells of the map in the order of the page, and the tables of their verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from scripts.pages import table

from . import across, modes, motions, scaling, statics, traps
from .cell import VERDICTS, Cell, Verdict

ROOMS = (scaling, statics, across, modes, motions, traps)


def all_rows() -> Iterator[Cell]:
    """Yield every cell, in the order of the page."""
    for room in ROOMS:
        yield from room.rows()


def counts(rows: Iterable[dict[str, Any]]) -> str:
    """Return how many cells of each axis have which verdict (verdicts as data), as a Markdown table."""
    by_axis: dict[str, Counter[str]] = {}
    for v in (Verdict(**row) for row in rows):
        by_axis.setdefault(v.axis, Counter())[v.verdict] += 1
    total = sum(by_axis.values(), Counter())
    return table(["axis", "cells", *VERDICTS], [[axis, found.total(), *(found[w] for w in VERDICTS)]
                                                for axis, found in [*by_axis.items(), ("all", total)]])


def _mark(v: Verdict, notes: dict[str, int]) -> str:
    """Return the text of a cell: its error, or its verdict with the number of the message."""
    error = "lost" if v.error is None else "exact" if v.error < 1e-15 else f"{v.error:.0e}"
    if v.verdict == "holds":
        return error
    number = notes.setdefault(" ".join(v.message.split()), len(notes) + 1)
    return {"degrades": f"*{error}* [{number}]", "refused": f"refused [{number}]", "slow": f"slow [{number}]",
            "wrong": f"**wrong** {error} [{number}]"}[v.verdict]


def grids(rows: Iterable[dict[str, Any]]) -> str:
    """Return one table for each axis and measure: subjects down, values across, messages below."""
    groups: dict[tuple[str, str], list[Verdict]] = {}
    for v in (Verdict(**row) for row in rows):
        groups.setdefault((v.axis, v.measure), []).append(v)
    out = []
    for (axis, measure), found in groups.items():
        values = list(dict.fromkeys(v.value for v in found))
        notes: dict[str, int] = {}
        place = {(v.subject, v.value): v for v in found}
        limits = sorted({v.limit for v in found})
        ends = " to ".join(f"{x:.2g}" for x in dict.fromkeys((limits[0], limits[-1])))
        cells = table(["", *values], [[subject, *(_mark(place[subject, x], notes) if (subject, x) in place else ""
                                                  for x in values)]
                                      for subject in dict.fromkeys(v.subject for v in found)])
        texts = "\n".join(f"{number}. {text}" for text, number in notes.items())
        out.append(f"**{axis}**: {measure}. Limit {ends}.\n\n{cells}\n\n{texts}".rstrip())
    return "\n\n".join(out)
