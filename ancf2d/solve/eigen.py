"""Natural frequencies and modes, each named by its shape."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..case import Eigen
from ..elements.shape import Array
from ..model.model import Model
from .classify import Classifier, Verdict
from .linearised import base_state
from .lowest_modes import Modes, lowest
from .state import State

# relative uncertainty of an eigenvalue that is worth a word
POOR = 1e-6


def solve_eigen(model: Model, spec: Eigen) -> Iterator[State]:
    """Yield the one state that vibrates, with its lowest modes: K phi = omega^2 M phi.

    About the reference, loads do not act; about the static equilibrium they have been followed to their full size
    and K is the tangent there, their own stiffness included.
    """
    base = base_state(model, spec.about)
    model, state = base.model, base.state
    pencil = base.pencil()
    pencil.with_mass(model.e0 + state.d[:model.n_q])
    modes = lowest(pencil, spec.modes)
    shapes = full_shapes(model, modes.vectors)
    classifier = Classifier(model, state.d)
    verdicts = [classifier(v, abs(value) <= modes.floor) for v, value in zip(shapes, modes.values, strict=True)]
    state.report = {"frequencies": frequencies(modes, verdicts)}
    state.arrays = {"modes/shapes": (shapes, "1", "mode shapes: rows of nodal coordinates, unit modal mass")}
    state.tables = {"modes": table(state.report["frequencies"], verdicts)}
    state.warnings = [*state.warnings, *_warnings(spec, modes)]
    if spec.about == "reference" and np.any(pencil.balance.R):
        state.warnings.append("the reference is not an equilibrium because springs are loaded in it (about: static "
                              "finds the equilibrium)")
    yield state


def full_shapes(model: Model, vectors: Array) -> Array:
    """Return shapes (m, n_q) in nodal coordinates of vectors (m, n_unknowns), their largest displacement positive."""
    out = np.zeros((len(vectors), model.n_q))
    for row, z in zip(out, vectors, strict=True):
        full = np.zeros(len(model.numbering.place))
        model.numbering.expand(z, full)
        row[:] = full[:model.n_q]
        moved = model.weights * row
        row *= math.copysign(1.0, moved[int(np.argmax(np.abs(moved) > 0.999 * np.abs(moved).max()))])
    return out


def frequencies(modes: Modes, verdicts: list[Verdict]) -> list[dict[str, Any]]:
    """Return the entries of ``frequencies``: omega [rad/s], hz, kind, number within the kind, shares, gaps.

    omega is 0 where the eigenvalue cannot be told from zero, and for unstable modes, which have a growth rate [1/s].
    """
    out = []
    for value, verdict in zip(modes.values, verdicts, strict=True):
        omega = math.sqrt(value) if value > modes.floor else 0.0
        entry: dict[str, Any] = {"omega": omega, "hz": omega / (2 * math.pi), "kind": verdict.kind,
                                 "number": 0, "shares": verdict.shares, "gaps": verdict.gaps}
        if value < -modes.floor:
            entry["growth"] = math.sqrt(-value)
        out.append(entry)
    renumber(out)
    return out


def renumber(entries: list[dict[str, Any]]) -> None:
    """Number the modes within their kinds, from the lowest on."""
    numbers: Counter[str] = Counter()
    for entry in entries:
        numbers[entry["kind"]] += 1
        entry["number"] = numbers[entry["kind"]]


def table(entries: list[dict[str, Any]], verdicts: list[Verdict]) -> dict[str, list[Any]]:
    """Return the modes as the columns of a table."""
    out: dict[str, list[Any]] = {k: [e[k] for e in entries] for k in ("omega", "hz", "kind", "number")}
    out["growth"] = [e.get("growth", 0.0) for e in entries]
    for share in entries[0]["shares"] if entries else ():
        out[share] = [e["shares"][share] for e in entries]
    out["gaps"] = [v.gaps for v in verdicts]
    out["functions_per_wave"] = [v.functions for v in verdicts]
    return out


def _warnings(spec: Eigen, modes: Modes) -> list[str]:
    out = []
    if len(modes.values) < spec.modes:
        out.append(f"the model has {len(modes.values)} modes, not {spec.modes}")
    if modes.counted is False:
        out.append("the inertia of the shifted stiffness differs from the number of modes found: some modes may be "
                   "missing")
    unstable = int((modes.values < -modes.floor).sum())
    if unstable:
        out.append(f"{unstable} of the modes grow: this equilibrium is unstable")
    worst = float(modes.error.max(initial=0.0))
    if worst > POOR:
        out.append(f"round-off limits the frequencies to about {0.5 * worst:.1g} of their values. Fewer or longer "
                   "elements give more digits")
    return out
