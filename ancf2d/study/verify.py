"""Verification of modes on a mesh twice as fine, and of load steps by steps half as long.

A mode without a counterpart on the finer mesh is an artefact of the mesh, not a motion of the beam.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np

from ..case import Eigen, LoadedCase, Static, refined
from ..elements.shape import Array
from ..errors import ComputationError
from ..model.build import build_model
from ..model.model import Model
from ..model.points import dot
from ..model.rotation import CoordinateKinds
from ..solvers.registry import solve
from ..solvers.small_motions.classify import GAPS, Classifier
from ..solvers.small_motions.eigen import renumber, solve_eigen
from ..solvers.small_motions.section_motions import class_motions, interpolation
from ..solvers.state import State

# a counterpart has a frequency within this share of the mode's own ...
NEAR = 0.15
# ... and all counterparts together contain at least this share of its kinetic energy
ALIKE = 0.8
# modes computed on the finer mesh, beyond twice the number on the first
MORE = 20


class ModeVectors:
    """Modes of a model as vectors whose scalar product is that of the kinetic energy: scaled velocities at many points.

    The points are the integration points of a ``fine`` model of the same bodies and element types.
    """

    def __init__(self, model: Model, fine: Model) -> None:
        self.model, self.fine = model, fine
        self.classes, self.finer = (
            {name: [class_motions(c.sampler) for c in mesh.classes] for name, mesh in m.meshes.items()}
            for m in (model, fine))
        self.within = {name: self._places(name) for name in fine.meshes}

    def _places(self, name: str) -> list[tuple[Array, int, Array]]:
        """Return groups of fine elements that lie alike: (fine and coarse elements, coarse class, interpolation)."""
        coarse, fine = self.model.meshes[name], self.fine.meshes[name]
        x = self.finer[name][0].xi
        found: dict[tuple[int, float, float], list[tuple[int, int]]] = {}
        for ie in range(fine.plan.count):
            l = float(fine.lengths[ie])
            ic, xi, _ = coarse.element_at((float(fine.starts[ie]) + 0.5 * l) / fine.plan.length)
            c = int(coarse.cls[ic])
            ratio = l / coarse.classes[c].shape.l
            found.setdefault((c, round(xi, 9), round(ratio, 9)), []).append((ie, ic))
        return [(np.array(pairs), c, interpolation(self.classes[name][c].xi, xi + (x - 0.5) * ratio))
                for (c, xi, ratio), pairs in found.items()]

    def __call__(self, v: Array) -> Array:
        """Return the vector of a mode (n_q,)."""
        out = [np.sqrt(item.mass) * np.array([dot(c, v) for c in self.model.point(item.at).position()])
               for item in self.model.case.resting_masses]
        for name, mesh in self.model.meshes.items():
            nc, finer = mesh.plan.element.components, self.finer[name]
            field = np.zeros((self.fine.meshes[name].plan.count, *finer[0].dm.shape, nc))
            for pairs, c, table in self.within[name]:
                e = v[mesh.dofs[pairs[:, 1]]].reshape(len(pairs), -1, nc)
                u = np.einsum("ix,xyk,ekc->eiyc", table, self.classes[name][c].field, e, optimize=True)
                fine = finer[int(self.fine.meshes[name].cls[pairs[0, 0]])]
                u[..., :2] *= np.sqrt(fine.dm)[:, :, None]
                u[..., 2:] *= np.sqrt(fine.inertia[2])[:, None, None]
                field[pairs[:, 0]] = u
            out.append(field.ravel())
        return np.concatenate(out)


def verified(loaded: LoadedCase, model: Model, states: Iterator[State]) -> Iterator[State]:
    """Yield the states of a solver, with the results of verifying their modes or load steps."""
    return (_modes if loaded.case.solver.vibrates else _load_steps)(loaded, model, states)


def _load_steps(loaded: LoadedCase, model: Model, states: Iterator[State]) -> Iterator[State]:
    """Yield the states; the report of the last one contains the estimated error of displacements due to load steps.

    The estimate is twice the difference from a run with steps half as long (errors of first order), relative to the
    largest displacement.
    """
    spec = cast(Static, loaded.case.solver)
    steps = spec.with_steps(2.0)["steps"]
    x = CoordinateKinds(model.meshes.values()).positions
    for state in states:
        if state.t == spec.end:
            finer = replace(loaded, case=replace(loaded.case, solver=replace(spec, steps=steps, verify=False)))
            try:
                *_, other = solve(build_model(finer))
            except ComputationError as error:
                state.warnings.append(f"load steps are not verified, as {steps} steps fail: {error}")
            else:
                off, size = (float(np.hypot(d[x], d[x + 1]).max(initial=0.0)) for d in (state.d - other.d, state.d))
                state.report["accuracy"] = {"estimate": 2.0 * off / size if size else 0.0, "order": None,
                                            "of": "load steps", "steps": steps}
        yield state


def _modes(loaded: LoadedCase, model: Model, states: Iterator[State]) -> Iterator[State]:
    """Yield the states with ``verified`` for each mode, and its kind and number updated accordingly."""
    for state in states:
        entries: list[dict[str, Any]] = state.report["frequencies"]
        fine = build_model(refined(loaded))
        found = list(solve_eigen(fine, replace(cast(Eigen, loaded.case.solver), modes=2 * len(entries) + MORE)))[-1]
        ours, theirs = ModeVectors(model, fine), ModeVectors(fine, fine)
        others = np.array([theirs(v) for v in found.arrays["modes/shapes"][0]])
        omegas = np.array([f["omega"] for f in found.report["frequencies"]])
        # a branch that lives in the gaps between elements is dense enough to imitate any mode
        shared = np.array([f["gaps"] <= GAPS for f in found.report["frequencies"]])
        for entry, shape in zip(entries, state.arrays["modes/shapes"][0], strict=True):
            near = shared & (np.abs(omegas - entry["omega"]) <= NEAR * entry["omega"])
            entry["verified"] = bool(((others[near] @ ours(shape)) ** 2).sum() >= ALIKE)
            if entry["kind"] != "rigid":
                kind = Classifier.shape_kind(entry["shares"], entry["strain"])
                entry["kind"] = kind if entry["verified"] else "spurious"
        renumber(entries)
        state.tables["modes"].update({k: [e[k] for e in entries] for k in ("kind", "number")})
        state.tables["modes"]["verified"] = [int(e["verified"]) for e in entries]
        yield state
