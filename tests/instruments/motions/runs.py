"""Motions of cases with measurements on the way, and tables of the results."""

from __future__ import annotations

import tempfile
from contextlib import chdir
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.elements.shape import Array
from ancf2d.model.model import Model
from ancf2d.solvers.energy import Energies
from ancf2d.solvers.state import State
from ancf2d.solvers.state_results import Observer
from ancf2d.study.record import Progress
from ancf2d.study.run import Outcome, run_case, vocabulary


@dataclass
class Motion:
    """A followed motion: times (n,), positions of probes (n, 2), energies and momenta at stored states.

    ``violation`` : the largest of all steps; ``outcome`` : what ``ancf2d run`` makes of it.
    """

    outcome: Outcome
    t: Array
    probes: dict[str, list[dict[str, float]]]
    energies: list[dict[str, float]]
    momenta: Array
    violation: float

    @property
    def summary(self) -> dict[str, Any]:
        """The ``--json`` object of the run."""
        return self.outcome.summary

    def place(self, probe: str) -> Array:
        """Return the positions of a probe (n, 2)."""
        return np.array([[p["x"], p["y"]] for p in self.probes[probe]])

    def column(self, probe: str, quantity: str) -> Array:
        """Return a quantity of a probe over time (n,)."""
        return np.array([p[quantity] for p in self.probes[probe]])

    def at(self, probe: str, t: float) -> Array:
        """Return the position of a probe at a stored time (2,)."""
        k = int(np.argmin(np.abs(self.t - t)))
        if abs(self.t[k] - t) > 1e-9 * max(1.0, self.t[-1]):
            raise ValueError(f"no state is stored at t = {t:g}")
        return self.place(probe)[k]

    def extent(self, probe: str) -> float:
        """Return the largest displacement of a probe."""
        return float(np.hypot(self.column(probe, "ux"), self.column(probe, "uy")).max())


@dataclass
class _Watch:
    """Records quantities of the states as they come."""

    momentum: bool
    t: list[float] = field(default_factory=list)
    probes: list[dict[str, dict[str, float]]] = field(default_factory=list)
    energies: list[dict[str, float]] = field(default_factory=list)
    momenta: list[tuple[float, float, float]] = field(default_factory=list)
    violation: float = 0.0

    def built(self, model: Model) -> None:
        self.observer = Observer(model)
        self.model = Energies(model)

    def state(self, state: State) -> None:
        self.t.append(state.t)
        self.probes.append(self.observer.observe(state))
        self.energies.append(dict(state.history))
        if self.momentum and state.v is not None:
            self.momenta.append(self.model.momentum(state.d, state.v))
        self.violation = max(self.violation, float(np.max(state.blocks.get("violation", 0.0), initial=0.0)))


def follow(loaded: LoadedCase, momentum: bool = False) -> Motion:
    """Return the motion of a dynamic case; a failed one has the states that were reached. Raises CaseError."""
    watch = _Watch(momentum)
    outcome = run_case(loaded, progress=Progress(built=watch.built, state=watch.state))
    names = watch.probes[0] if watch.probes else {}
    return Motion(outcome, np.array(watch.t), {n: [p[n] for p in watch.probes] for n in names}, watch.energies,
                  np.array(watch.momenta), watch.violation)


def case(text: str, directory: str = "") -> LoadedCase:
    """Return the case of a text."""
    return load_case_text(text, vocabulary=vocabulary(), directory=directory)


def follow_from(static: str, text: str) -> Motion:
    """Return the motion of a case that starts ``from: start.h5``, the result of a static case, with momenta."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        outcome = run_case(case(static), "start.h5")
        if outcome.failure is not None:
            raise outcome.failure
        return follow(case(text, folder), momentum=True)


def distance(a: Array, b: Array) -> float:
    """Return the largest distance of two curves (n, 2)."""
    return float(np.hypot(*(a - b).T).max())
