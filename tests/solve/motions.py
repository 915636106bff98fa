"""Shared by the tests of time integration: small scenes, and their motions stepped to the end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import helpers as h
import numpy as np
import pytest

from ancf2d.case import load_case_text
from ancf2d.kernels.motion.advance import CHECK, INSIDE
from ancf2d.model.build import build_model
from ancf2d.solvers.energy import Energies
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Balance, solve_dynamic
from ancf2d.solvers.motion.initial import initial_motion
from ancf2d.solvers.motion.integrators import SCIPY_METHODS
from ancf2d.solvers.motion.ode import OdeStepper
from ancf2d.solvers.motion.own_integrators import Method
from ancf2d.solvers.motion.problem import make_problem
from ancf2d.solvers.motion.stepping import LOG, Stepper

THIN = {"height": 0.02, "width": 0.05}
RUBBER = {"E": 2e7, "nu": 0.3, "rho": 1000.0}
STEEL = {"E": 2.07e11, "nu": 0.3, "rho": 7850.0}
GRAVITY = [{"type": "gravity", "value": [0, -9.81]}]
OWN = ("newmark", "hht", "generalized_alpha", "energy_momentum", "radau5", "radau9")


def rigid(start: Any, end: Any, mass: float, inertia: float) -> dict[str, Any]:
    """Return a rigid body."""
    return {"geometry": {"type": "line", "start": list(start), "end": list(end)},
            "element": {"type": "rigid", "mass": mass, "inertia": inertia}}


def rod(name: str = "cable", count: int = 2, start: Any = (0, 0), end: Any = (1, 0),
        **material: Any) -> dict[str, Any]:
    """Return a soft straight rod."""
    geometry = {"type": "line", "start": list(start), "end": list(end)}
    return h.body(geometry, h.element(name, count), THIN, {**RUBBER, **material})


class Ride:
    """A scene in motion. ``rows`` are its stored states, ``log`` (steps, 7) is the log of all steps."""

    def __init__(self, scene: dict[str, Any], t_end: float, states: int = 1, every: int = 0, chunk: int = 0,
                 tight: float = 0.0, **solver: Any) -> None:
        bodies = scene["bodies"]
        more = {k: v for k, v in scene.items() if k != "bodies"}
        self.model = h.build(bodies, {"type": "dynamic", "t_end": t_end, **solver}, **more)
        wanted = t_end * np.arange(1, states + 1) / states
        spec, num = self.model.case.solver, self.model.numbering
        kind = OdeStepper if spec.method in SCIPY_METHODS else Stepper
        problem, signals = make_problem(self.model, num.in_reference if kind is Stepper else num.complete)
        self.stepper = kind(self.model, problem, signals, spec, solver.get("dt", 0.0),
                            np.zeros(0) if every else wanted[:-1], every, follows=kind is Stepper)
        if tight:
            stepper = self.stepper
            stepper.m = Method(stepper.method.name, self.model.case.solver, stepper.p, tight,
                               self.model.relaxing, stepper.tracks_work)
        self.chunk, self.rows = chunk, []

    def start(self) -> Ride:
        """Start at the beginning of the case."""
        self.stepper.start(*initial_motion(self.model))
        self.rows.append(self.stepper.last())
        return self

    def on(self) -> Ride:
        """Continue to the end, optionally in chunks of so many steps."""
        while not self.stepper.done:
            self.rows += [row for row in self.stepper.run(self.chunk or np.inf) if row.kind != CHECK]
        self.rows.append(self.stepper.last())
        return self

    @property
    def log(self) -> np.ndarray:
        """Return the log of all steps."""
        return np.concatenate([row.log for row in self.rows])

    def column(self, name: str) -> np.ndarray:
        """Return a column of the log."""
        return self.log[:, LOG.index(name)]

    def full(self, k: int = -1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return d, v, a (n_full,) of a stored state."""
        return self.stepper.full(self.rows[k])

    def end(self) -> np.ndarray:
        """Return displacements and rates at the end, on the constraints (2, n_q), each as a displacement [m]."""
        row = self.rows[-1]
        d, v, _ = self.stepper.full(replace(row, z=row.z.copy(), v=row.v.copy(), kind=INSIDE, full=()))
        return np.array([d[:self.model.n_q], v[:self.model.n_q]]) * self.model.weights

    def place(self, at: str, k: int = -1) -> np.ndarray:
        """Return the position (2,) of BODY@S."""
        name, s = at.split("@")
        e = self.model.e0 + self.full(k)[0][:self.model.n_q]
        return np.array([h.dot(c, e) for c in h.point_ref(self.model.meshes[name], float(s)).position()])

    def totals(self) -> tuple[np.ndarray, np.ndarray]:
        """Return total energy (states,) and the momenta px, py, h (states, 3)."""
        energies, balance, total, momenta = Energies(self.model), Balance(self.model, self.stepper), [], []
        for k, row in enumerate(self.rows):
            d, v, _ = self.full(k)
            total.append(sum(balance.evaluate(row)[name] for name in ("kinetic", "strain", "potential")))
            momenta.append(energies.momentum(d, v))
        return np.array(total), np.array(momenta)


def ride(scene: dict[str, Any], t_end: float, **how: Any) -> Ride:
    """Return a scene moved to ``t_end``."""
    return Ride(scene, t_end, **how).start().on()


def resumed_behind_events(case: str, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Check that a motion resumes bit for bit from checkpoints after each event; return its states."""
    # every state ends a chunk, from which a run can go on
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    monkeypatch.setattr(stepping, "LOG_ROWS", 7)

    def states(kept: Any = None) -> list[Any]:
        model = build_model(load_case_text(case))
        return list(solve_dynamic(model, model.case.solver, kept))

    whole = states()
    for event in whole[-1].report["events"]:
        behind = next(k for k, s in enumerate(whole) if s.t > event["t"] and s.checkpoint is not None)
        for k in (behind - 1, behind):
            if whole[k].checkpoint is None:
                continue
            rest = states(whole[k].checkpoint)
            assert [s.t for s in rest] == [s.t for s in whole[k + 1:]]
            assert all(a.d.tobytes() == b.d.tobytes() for a, b in zip(rest, whole[k + 1:], strict=True))
            assert [s.history for s in rest] == [s.history for s in whole[k + 1:]]
            for name in ("events", "energy_drift", "accuracy"):
                assert rest[-1].report.get(name) == whole[-1].report.get(name)
    return whole


def orders(errors: list[float]) -> np.ndarray:
    """Return the observed orders of errors at halved steps."""
    return np.log2(np.divide(errors[:-1], np.maximum(errors[1:], 1e-300)))
