"""The impacts of a motion: when and where bodies meet without a contact law, with which impulse and energy loss."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.shape import Array
from ...interactions.contact import ContactPoint
from ...model.model import Model

# last columns of the log of a step with an impact: 1 + the item with the largest impulse, the number of items with an
# impulse, the sum of impulses, and the lost energy
COLUMNS = 4


class Impacts:
    """Impacts (k, 5) so far: time, item with the largest impulse, points, impulse, lost energy."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.found: list[Array] = []

    def take(self, log: Array) -> Array:
        """Store the impacts in a log of steps (n, columns); return the log without their columns."""
        hit = log[:, -COLUMNS] > 0.0
        if hit.any():
            self.found.append(np.column_stack([log[hit, 1], log[hit, -COLUMNS] - 1.0, log[hit, 1 - COLUMNS:]]))
        return log[:, :-COLUMNS]

    def kept(self) -> dict[str, Array]:
        """Return the arrays for a checkpoint."""
        return {"impacts": np.concatenate([np.zeros((0, 1 + COLUMNS)), *self.found])}

    def resume(self, kept: dict[str, Array]) -> None:
        """Restore the impacts from a checkpoint."""
        self.found = [kept["impacts"].reshape(-1, 1 + COLUMNS).copy()]

    def table(self) -> dict[str, list[Any]]:
        """Return the impacts as columns of a table."""
        laws = self.model.interactions
        points = {at.start: patch for patch, at in zip(laws.points, laws.rows, strict=True)
                  if isinstance(patch, ContactPoint)}
        t, items, count, impulse, lost = self.kept()["impacts"].T
        struck = [points[int(item)] for item in items]
        return {"t": t.tolist(), "contact": [p.pair.name for p in struck], "body": [p.pair.body for p in struck],
                "touched": [p.pair.other for p in struck], "S": [float(p.pair.s[p.number]) for p in struck],
                "points": count.astype(int).tolist(), "impulse": impulse.tolist(), "lost": lost.tolist()}

    def tell(self, state: Any) -> None:
        """Add the impacts to tables and report of the last state of a motion."""
        if not self.found or not len(self.kept()["impacts"]):
            return
        columns = state.tables["impacts"] = self.table()
        strongest = int(np.argmax(columns["impulse"]))
        state.report["impacts"] = {"count": len(columns["t"]), "lost": float(sum(columns["lost"])), **{
            name: {key: values[k] for key, values in columns.items()}
            for name, k in (("first", 0), ("strongest", strongest))}}
