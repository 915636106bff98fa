"""The impacts of a motion: when and where bodies meet without a law, with which impulse, and what that takes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...elements.shape import Array
from ...interactions.contact import ContactPoint
from ...model.model import Model

# what the log of a step has of an impact behind what it has of every step: 1 + the item with the largest impulse,
# how many have one, their sum, and the energy that it takes
COLUMNS = 4


class Impacts:
    """Impacts (k, 5) up to the time reached: when, the item, points, impulse, energy lost."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.found: list[Array] = []

    def take(self, log: Array) -> Array:
        """Take what the log of steps (n, columns) tells of impacts; return the rest of it."""
        hit = log[:, -COLUMNS] > 0.0
        if hit.any():
            self.found.append(np.column_stack([log[hit, 1], log[hit, -COLUMNS] - 1.0, log[hit, 1 - COLUMNS:]]))
        return log[:, :-COLUMNS]

    def kept(self) -> dict[str, Array]:
        """Return what is kept in checkpoints."""
        return {"impacts": np.concatenate([np.zeros((0, 1 + COLUMNS)), *self.found])}

    def resume(self, kept: dict[str, Array]) -> None:
        """Take up what was kept."""
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
        """Tell of all impacts with the last state of a motion."""
        if not self.found or not len(self.kept()["impacts"]):
            return
        columns = state.tables["impacts"] = self.table()
        strongest = int(np.argmax(columns["impulse"]))
        state.report["impacts"] = {"count": len(columns["t"]), "lost": float(sum(columns["lost"])), **{
            name: {key: values[k] for key, values in columns.items()}
            for name, k in (("first", 0), ("strongest", strongest))}}
