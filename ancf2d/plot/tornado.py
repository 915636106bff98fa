"""How much each number of a case moves the goal: bars, the longest above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot.picture import Kind, Source, common_title
from ancf2d.results import Results

NEEDED = {"path", "value", "derivative", "influence"}
# of its size: the change of each number that the bars show
CHANGE = 0.01


@dataclass
class Tornado:
    """The picture: for each number its path, its value and the change of the goal (n,) where it grows by 1 %."""

    title: str
    goal: str
    units: str
    paths: list[str]
    values: np.ndarray
    changes: np.ndarray
    left_out: int

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches."""
        return 7.0, 1.3 + 0.27 * len(self.paths)

    def render(self, figure: Figure) -> None:
        """Draw a bar for each number, the longest above."""
        axes = figure.add_subplot()
        places = np.arange(len(self.paths))
        colours = np.where(self.changes < 0, "#c1503a", "#1f5fa8")
        axes.barh(places, self.changes, color=colours.tolist(), height=0.7)
        axes.axvline(0.0, color="0.3", linewidth=0.8)
        axes.set_yticks(places, [f"{p} = {v:.6g}" for p, v in zip(self.paths, self.values.tolist(), strict=True)])
        axes.set_ylim(len(self.paths) - 0.4, -0.6)
        axes.grid(axis="y", visible=False)
        unit = "" if self.units in ("1", "") else f" [{self.units}]"
        # the power of ten of the ticks stands to the right
        axes.set_xlabel(f"change of {self.goal}{unit} by +{CHANGE:.0%} of a number", loc="left")
        note = f"{self.left_out} less influential numbers are left out" if self.left_out else ""
        axes.set_title("\n".join(t for t in (self.title, note) if t))

    def header(self) -> list[str]:
        """Return the names of the data's columns."""
        return ["path", "value", f"change of {self.goal} [{self.units}]"]

    def rows(self) -> Iterator[Sequence[Any]]:
        """Yield the rows of the data that are drawn."""
        yield from zip(self.paths, self.values.tolist(), self.changes.tolist(), strict=True)


def tornado(sources: Sequence[Source], *, count: int = 20) -> Tornado:
    """Build the bars of the ``count`` most influential numbers of one file."""
    if len(sources) > 1:
        raise ResultsError("a figure of sensitivities is of one file")
    table = sources[0].results.tables["sensitivity"]
    influence = np.asarray(table["influence"], float)
    slope, moving = np.asarray(table["derivative"], float), int((influence > 0).sum())
    order = np.argsort(-influence, kind="stable")[:max(1, min(count, moving))]
    changes = CHANGE * np.sign(slope) * influence
    return Tornado(common_title(sources), str(table.attrs.get("goal", "the goal")), table.units.get("influence", "1"),
                   [str(table["path"][k]) for k in order], np.asarray(table["value"], float)[order], changes[order],
                   max(0, moving - len(order)))


def _missing(results: Results) -> str:
    table = results.tables.get("sensitivity")
    if table is None or not set(table) >= NEEDED or not table.rows:
        return "it holds no table of sensitivities ('ancf2d sensitivity CASE -o FILE.h5' writes one)"
    return ""


TORNADO = Kind("tornado", "how much the goal changes with each number of the case, the most influential ones first",
               _missing, tornado)
