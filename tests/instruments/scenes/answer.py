"""The answer of ancf2d to a scene, as quantities with known transformations."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import ancf2d
from ancf2d.model.model import Model
from ancf2d.solvers.state import State
from ancf2d.study.record import Progress
from ancf2d.study.run import run_case

from .shapes import Array, Data
from .similar import Similarity

# what a quantity is: powers of length, force, time; a vector, or how it changes under mirrors (1, or -1)
KINDS: dict[str, tuple[tuple[int, int, int], int | None]] = {
    "displacement": ((1, 0, 0), None), "rotation": ((0, 0, 0), -1), "velocity": ((1, 0, -1), None),
    "rate": ((0, 0, -1), -1), "force": ((0, 1, 0), None), "moment": ((1, 1, 0), -1), "energy": ((1, 1, 0), 1),
    "factor": ((0, 0, 0), 1), "omega^2": ((0, 0, -2), 1), "N": ((0, 1, 0), 1), "Q": ((0, 1, 0), -1),
    "M": ((1, 1, 0), -1), "momentum": ((0, 1, 1), None)}
ENERGIES = ("strain", "kinetic", "potential", "dissipated", "work")


@dataclass
class Answer:
    """The quantities (kind, name) of a solved scene, its warnings, or why it was refused."""

    case: Data
    values: dict[tuple[str, str], Array] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    refusal: str = ""
    crash: bool = False
    model: Model | None = None
    state: State | None = None
    summary: Data = field(default_factory=dict)

    def of(self, kind: str) -> dict[str, Array]:
        """Return all quantities of a kind by name."""
        return {name: v for (k, name), v in self.values.items() if k == kind}

    def largest(self, kind: str) -> float:
        """Return the size of the largest quantity of a kind, 0 where there is none."""
        return max((float(np.linalg.norm(v, np.inf)) for v in self.of(kind).values() if v.size), default=0.0)

    def seen(self, by: Similarity) -> dict[tuple[str, str], Array]:
        """Return the quantities of the same scene elsewhere."""
        out = {}
        for (kind, name), value in self.values.items():
            dimension, parity = KINDS[kind]
            if parity is None:
                out[kind, name] = np.array(by.vector(value, dimension))
            else:
                out[kind, name] = value * by.unit(dimension) * (by.sense if parity < 0 else 1.0)
        return out


def answer(case: Data, out: str | None = None, watch: Callable[[State], None] = lambda state: None,
           **how: Any) -> Answer:
    """Return the answer to a case.

    ``out`` names a result file to write, ``watch`` is called with each state, ``how`` goes to ``run_case``.
    """
    states: deque[State] = deque(maxlen=1)

    def seen(state: State) -> None:
        states.append(state)
        watch(state)

    try:
        outcome = run_case(ancf2d.load(case), out, progress=Progress(state=seen), **how)
    except ancf2d.CaseError as error:
        return Answer(case, refusal=error.problems[0].message)
    except ancf2d.ComputationError as error:
        return Answer(case, refusal=error.failure.reason)
    except Exception as error:  # a crash is what is looked for
        return Answer(case, refusal=f"{type(error).__name__}: {error}", crash=True)
    summary = outcome.summary
    refusal = "" if outcome.failure is None else outcome.failure.failure.reason
    return Answer(case, quantities(summary), list(summary["warnings"]), refusal, model=outcome.model,
                  state=states[0] if states else None, summary=summary)


def kind_of_message(text: str) -> str:
    """Return a message without the names and numbers of its scene."""
    text = re.sub(r"[-+]?\b\d[\d.]*(e[-+]?\d+)?\b", "#", text)
    text = re.sub(r"\b(joint|support|p)#|\b(joints|loads|springs|masses|boundary_conditions)\.#", "...", text)
    text = re.sub(r"(?<![\w'])'?[abcd]'?(?=[ ,.:@]|$)(?! (mechanism|support|section|state|case|point|body|step|weld|"
                  r"joint|rigid|follower|sum|mesh|warning|load|shift|tangent|motion|quarter))", "BODY", text)
    return re.sub(r"(BODY|\.\.\.)(, (BODY|\.\.\.))+", "...", text)[:150]


def quantities(summary: Data) -> dict[tuple[str, str], Array]:
    """Return the values of a summary as quantities."""
    out: dict[tuple[str, str], Array] = {}
    modes = "frequencies" in summary or "load_factors" in summary
    if "frequencies" in summary:
        found = sorted(math.copysign(f["omega"] ** 2 + f.get("growth", 0.0) ** 2, -1 if f.get("growth") else 1)
                       for f in summary["frequencies"])
        out["omega^2", "modes"] = np.array(found)
    if "load_factors" in summary:
        out["factor", "buckling"] = np.array(summary["load_factors"])
    for name, p in summary["probes"].items():
        out["displacement", name] = np.array([p["ux"], p["uy"]])
        out["rotation", name] = np.array([p["theta"]])
        if "vx" in p:
            out["velocity", name] = np.array([p["vx"], p["vy"]])
            out["rate", name] = np.array([p["omega"]])
        for force in ("N", "Q", "M"):
            if force in p:
                out[force, name] = np.array([p[force]])
    for name, r in summary.get("reactions", {}).items():
        out["force", name] = np.array([r["fx"], r["fy"]])
        out["moment", name] = np.array([r["m"]])
    if not modes:
        for name in ENERGIES:
            if name in summary.get("energy", {}):
                out["energy", name] = np.array([float(summary["energy"][name])])
    if "momentum" in summary:
        out["momentum", "all"] = np.array(summary["momentum"]["linear"])
    return out


