"""Convergence studies as Python prints them and notebooks show them."""

from __future__ import annotations

from html import escape

from ..results.shown import html_table
from ..study.convergence import Convergence as Study


class Convergence(Study):
    """A finished convergence study: ``rows`` of all types, ``series`` with the limit of each."""

    def __repr__(self) -> str:
        title = f" {self.title!r}" if self.title else ""
        found = [f"{s.element} {s.estimate.value:.8g}" for s in self.series if s.estimate.value is not None]
        limits = f", limit of {', '.join(found)}" if found else ""
        return f"<Convergence{title}: {self.goal}, {len(self.rows)} rows{limits}>"

    def __str__(self) -> str:
        """Return what ``ancf2d convergence`` prints."""
        from ..cli.convergence import report

        return report(self)

    def _repr_html_(self) -> str:
        """Return the table of the study, and a line on the limit of each type."""
        from ..cli.convergence import limits, row_cells

        head, *rows = row_cells(self)
        return f"<b>{escape(self.title)}</b>" * bool(self.title) + html_table(rows, head) + "".join(
            f"<p>{escape(line)}</p>" for line in limits(self))
