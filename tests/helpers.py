"""Shared by the mathematical tests: every element type and formulation of the registry, and scenes as plain data."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.elements.definition import ElementType
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS, FAMILY, ancf
from ancf2d.kernels.matrices.layout import entries, stored_entries
from ancf2d.model.build import build_model
from ancf2d.model.model import Model
from ancf2d.model.point_tables import Batch, batches
from ancf2d.model.points import PointRef, dot, point_ref
from ancf2d.model.rotation import Rotation
from ancf2d.solvers.section_forces import SectionForces
from ancf2d.solvers.state import State
from ancf2d.study.run import vocabulary

ORDERS = ((1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 3), (8, 5))
# the largest members cost too much where every element of a scene is solved again and again
SMALL_ORDERS = ORDERS[:-1]
TYPES: dict[str, ElementType] = {**ELEMENTS, **{t.name: t for t in (ancf(*o) for o in ORDERS)}}
SMALL_TYPES = [n for n in TYPES if n != "ancf[8,5]"]
VARIANTS = [(name, f.name) for name, t in TYPES.items() for f in FORMULATIONS.values() if f.refuse(t) is None]
SMALL_VARIANTS = [v for v in VARIANTS if v[0] in SMALL_TYPES]
# where a formulation is indifferent, each type once with its own default
DEFAULTS = [(name, TYPES[name].formulation) for name in SMALL_TYPES]
KINDS = {"interpolated": "vallejo", "tangent": "cable", "theta": "reissner3"}
# what the quick tests take of products over all of them: every formulation, degree across and kind of section, once
FEW_VARIANTS = [("vallejo", "continuum"), ("2d3n-nu", "continuum"), ("kerkkanen", "enhanced"), ("li", "strain_split"),
                ("omar", "structural"), ("cable", "cable"), ("cable", "green"), ("reissner2", "geometrically_exact"),
                ("ancf[2,2]", "continuum")]
FEW_TYPES = ["vallejo", "2d3n-nu", "omar", "cable", "reissner3", "ancf[2,2]"]

LINE = {"type": "line", "start": [0.3, -0.2], "end": [1.4, 0.5]}
ARC = {"type": "arc", "center": [0.1, -0.3], "radius": 1.2, "from": 0.3, "to": 1.5}
GEOMETRIES = {"line": LINE, "arc": ARC}
SECTION = {"height": 0.3, "width": 0.2}
MATERIAL = {"E": 5.0, "nu": 0.3, "rho": 1.3}
STEEL = {"E": 2.07e11, "nu": 0.3, "rho": 7850}


def chosen(values: Any, few: Any) -> list[Any]:
    """Return all of ``values`` for ``parametrize``, as slow tests except those that begin as one of ``few``."""
    rows = [value if isinstance(value, tuple) else (value,) for value in values]
    starts = [value if isinstance(value, tuple) else (value,) for value in few]
    return [pytest.param(*row, id="-".join(map(str, row)),
                         marks=() if any(row[:len(start)] == start for start in starts) else pytest.mark.slow)
            for row in rows]


def covering(few: Mapping[str, Sequence[Any]] | None = None, **axes: Collection[Any]) -> pytest.MarkDecorator:
    """Return ``parametrize`` over a sample of a product of axes.

    The quick tests hold every value of an axis, or every one of ``few`` where it has such, each time with the partners
    that it has met least; with the slow ones, any two values of different axes meet. The axis ``variant`` stands for
    name and formulation.
    """
    rows = list(product(*axes.values()))
    parts = [frozenset((axis, repr(v)) for axis, v in zip(axes, row, strict=True)) for row in rows]
    wanted = {(axis, repr(v)) for axis, values in axes.items() for v in (few or {}).get(axis, values)}
    quick = _sample([p for p in parts if p <= wanted])
    names = [n for axis in axes for n in (("name", "formulation") if axis == "variant" else (axis,))]
    flat = [tuple(v for axis, value in zip(axes, row, strict=True)
                  for v in (value if axis == "variant" else (value,))) for row in rows]
    taken = _pairs(flat, [k for k, own in enumerate(parts) if own in quick])
    return pytest.mark.parametrize(names, [
        pytest.param(*flat[k], id="-".join("-".join(map(str, v)) if isinstance(v, tuple) else str(v) for v in rows[k]),
                     marks=() if parts[k] in quick else pytest.mark.slow)
        for k in sorted(taken)])


def pairwise(**axes: Collection[Any]) -> pytest.MarkDecorator:
    """Return ``parametrize`` over as many rows of a product as it takes to pair any two values of different axes."""
    rows = list(product(*axes.values()))
    return pytest.mark.parametrize(tuple(axes), [pytest.param(*rows[k], id="-".join(map(str, rows[k])))
                                                 for k in sorted(_pairs(rows, []))])


def _pairs(rows: list[tuple[Any, ...]], begun: list[int]) -> list[int]:
    """Return rows that contain every pair found in any row: the given rows and few more."""
    numbers: dict[Any, int] = {}
    masks = []
    for row in rows:
        found = combinations(((k, repr(v)) for k, v in enumerate(row)), 2)
        masks.append(sum(1 << numbers.setdefault(pair, len(numbers)) for pair in found))
    taken, missing = list(begun), (1 << len(numbers)) - 1
    for k in begun:
        missing &= ~masks[k]
    while missing:
        best = max(range(len(rows)), key=lambda k: (masks[k] & missing).bit_count())
        taken.append(best)
        missing &= ~masks[best]
    return taken


def _sample(rows: list[frozenset[tuple[str, str]]]) -> set[frozenset[tuple[str, str]]]:
    """Return rows that contain every value of any row; pairs are repeated as little as possible."""
    missing = set[tuple[str, str]]().union(*rows)
    met: Counter[Any] = Counter()
    found = set()

    def gain(row: frozenset[tuple[str, str]]) -> tuple[int, int, int]:
        return (len(missing & row), -sum(met[pair] for pair in combinations(sorted(row), 2)),
                -sum(met[part] for part in row))

    while missing:
        best = max(rows, key=gain)
        met.update([*best, *combinations(sorted(best), 2)])
        missing -= best
        found.add(best)
    return found


every_variant = pytest.mark.parametrize(("name", "formulation"), chosen(VARIANTS, FEW_VARIANTS))
every_small_type = pytest.mark.parametrize("name", chosen(SMALL_TYPES, FEW_TYPES))
every_small_variant = pytest.mark.parametrize(("name", "formulation"), chosen(SMALL_VARIANTS, FEW_VARIANTS))


def element(name: str, count: int, formulation: str | None = None, **more: Any) -> dict[str, Any]:
    """Return the ``element`` of a body, of equal elements, between whose nodes a scene may act.

    Family members are named ancf[p,q].
    """
    out: dict[str, Any] = {"type": name, "count": count, "nodes": "regular"}
    if name.startswith(FAMILY + "["):
        p, q = name[len(FAMILY) + 1 : -1].split(",")
        out.update(type=FAMILY, order=[int(p), int(q)])
    if formulation is not None:
        out["formulation"] = formulation
    return {**out, **more}


def line(length: float, angle: float = 0.0, start: tuple[float, float] = (0.0, 0.0)) -> dict[str, Any]:
    """Return a straight geometry."""
    end = [start[0] + length * np.cos(angle), start[1] + length * np.sin(angle)]
    return {"type": "line", "start": list(start), "end": [float(v) for v in end]}


def body(
    geometry: dict[str, Any],
    spec: dict[str, Any],
    section: dict[str, Any] | None = None,
    material: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Return a body; the section may be stiffnesses, which have no material."""
    out = {"geometry": geometry, "element": spec, "section": section or SECTION}
    if "EA" not in out["section"]:
        out["material"] = material or MATERIAL
    return out


def load(bodies: dict[str, Any] | None = None, solver: str | dict[str, Any] = "static", **scene: Any) -> LoadedCase:
    """Return the validated case of a scene; keyword arguments are the case's top-level keys (``bc`` for short)."""
    if "bc" in scene:
        scene["boundary_conditions"] = scene.pop("bc")
    data = {"bodies": bodies, "solver": {"type": solver} if isinstance(solver, str) else solver, **scene}
    return load_case_text(json.dumps(_plain(data)), vocabulary=vocabulary())


def _plain(x: Any) -> Any:
    if isinstance(x, dict):
        return {k: _plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple | np.ndarray):
        return [_plain(v) for v in x]
    return x.item() if isinstance(x, np.generic) else x


def build(*args: Any, **scene: Any) -> Model:
    """Return the model of a scene."""
    return build_model(load(*args, **scene))


class Solution:
    """All states of a solved scene, evaluated at points."""

    def __init__(self, model: Model) -> None:
        from ancf2d.solvers.registry import solve

        self.model = model
        self.states = list(solve(model))
        self.state = self.states[-1]
        self.d = self.state.d

    def u(self, at: str, state: int = -1) -> np.ndarray:
        """Return the displacement (2,) of BODY@S."""
        d = self.states[state].d
        return np.array([dot(c, d) for c in self.point(at).position()])

    def r(self, at: str) -> np.ndarray:
        """Return the position (2,) of BODY@S."""
        e = self.model.e0 + self.d[: self.model.n_q]
        return np.array([dot(c, e) for c in self.point(at).position()])

    def theta(self, at: str) -> float:
        """Return the rotation of the section at BODY@S."""
        rotation, d = Rotation(self.point(at)), self.d[: self.model.n_q]
        if self.state.linear:
            return rotation.linear(self.model.e0, d)
        return rotation.value(self.model.e0 + d, d)

    def point(self, at: str) -> Any:
        """Return the reference to BODY@S."""
        name, s = at.split("@")
        return point_ref(self.model.meshes[name], float(s))

    def reactions(self) -> dict[str, dict[str, float]]:
        """Return the reactions of every support."""
        from ancf2d.solvers.state_results import reactions

        return reactions(self.model, self.state)

    @property
    def iterations(self) -> int:
        """Newton iterations of all steps."""
        return sum(int(s.history["iterations"]) for s in self.states)


def solved(*args: Any, **scene: Any) -> Solution:
    """Build and solve a scene."""
    return Solution(build(*args, **scene))


def cantilever(
    spec: dict[str, Any],
    loads: list[dict[str, Any]],
    *,
    length: float = 2.0,
    angle: float = 0.0,
    section: dict[str, Any] | None = None,
    material: dict[str, Any] | None = None,
    solver: str | dict[str, Any] = "static",
    **clamp: Any,
) -> Solution:
    """Solve a straight cantilever ``beam`` along ``angle``, clamped at its start."""
    beam = body(line(length, angle), spec, section or {"height": 0.1, "width": 0.1}, material or STEEL)
    return solved({"beam": beam}, solver, bc=[{"name": "wall", "type": "clamp", "at": "beam@0", **clamp}], loads=loads)


def tip(fx: float, fy: float, **more: Any) -> list[dict[str, Any]]:
    """Return a force at the end of ``beam``."""
    return [{"type": "force", "at": "beam@1", "value": [fx, fy], **more}]


def rotate(d: np.ndarray, model: Model, angle: float, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Return the displacements that rotate every nodal coordinate e0 + d about the origin and shift it."""
    e, out = model.e0 + d, np.empty_like(d)
    c, s = np.cos(angle), np.sin(angle)
    for mesh in model.meshes.values():
        for k, kind in enumerate(mesh.kinds.tolist()):
            i = mesh.first_dof + k
            if kind in (0, 3):
                move = shift if kind == 0 else (0.0, 0.0)
                out[i] = c * e[i] - s * e[i + 1] + move[0]
                out[i + 1] = s * e[i] + c * e[i + 1] + move[1]
            elif kind == 2:
                out[i] = e[i] + angle
    return out - model.e0


def random_state(model: Model, size: float, seed: int = 0) -> np.ndarray:
    """Return random displacements (n_full,), each about ``size`` times the unit displacement of its coordinate."""
    rng = np.random.default_rng(seed)
    d = np.zeros(len(model.numbering.place))
    d[: model.n_q] = size * rng.uniform(-1, 1, model.n_q) / model.weights
    return d


def patch_at(model: Model, patch: Any, d: np.ndarray, t: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return energy, forces (m, n), stiffness (m, n, n) and coordinates (m, n) of a spring or a load at d (n_q,)."""
    (one,) = batches([patch])
    full = np.zeros(len(model.numbering.place))
    full[:len(d)] = d
    return (*one.evaluate(model.e0 + d[:model.n_q], full, t), one.dofs)


def constraint_at(constraint: Any, d: np.ndarray, t: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Return g, its gradient (n,) and Hessian (n, n) along the coordinates of a point constraint at d (n_q,)."""
    coords = constraint.coordinates
    full = np.append(d, np.zeros(max(int(coords.max()) + 1 - len(d), 1)))
    full[coords[-1]] = 1.0
    _, Q, K, _ = Batch([constraint]).matrices(full, t)
    return float(Q[0, -1]), Q[0, :-1], K[0, :-1, :-1]


def dense(target: Any, n: int) -> np.ndarray:
    """Return a matrix filled by kernels as a full array (n, n)."""
    kind, A = type(target).__name__, target.values
    out = np.zeros((n, n))
    if kind == "SymBand":
        bw = A.shape[1] - 1
        for i in range(n):
            for j in range(max(0, i - bw), i + 1):
                out[i, j] = out[j, i] = A[i, bw + j - i]
    elif kind == "Nested":
        i, j = stored_entries(target.fronts)
        out[i, j] = out[j, i] = A[entries(target.fronts, i, j)]
    elif kind == "Band":
        bw = (A.shape[1] - 1) // 3
        for j in range(n):
            for i in range(max(0, j - bw), min(n, j + bw + 1)):
                out[i, j] = A[j, 2 * bw + i - j]
    else:
        for i in range(n):
            row = slice(target.indptr[i], target.indptr[i + 1])
            out[i, target.indices[row]] = A[row]
    return out


def dense_tangent(model: Model, d: np.ndarray) -> np.ndarray:
    """Return the tangent (n_q, n_q) of the elements of a model with one group."""
    from ancf2d.kernels.elements import element_matrices

    group = model.groups[0]
    ne, n = group.dofs.shape
    Q, K = np.zeros((ne, n)), np.zeros((ne, n, n))
    element_matrices(group, d, Q, K)
    out = np.zeros((model.n_q, model.n_q))
    for dofs, Ke in zip(group.dofs, K, strict=True):
        out[np.ix_(dofs, dofs)] += Ke
    return out


def section_forces(model: Model, state: State, point: PointRef) -> tuple[float, float, float]:
    """Return N, Q, M at a point."""
    N, Q, M = SectionForces(model, point.mesh, np.array([point.xi]))(state, np.array([point.ie]))[0, 0].tolist()
    return N, Q, M


def path(until: dict[str, Any], method: str = "arc_length", **more: Any) -> dict[str, Any]:
    """Return the solver that follows a path."""
    return {"type": "static", "method": method, "until": until, **more}


def reaches(probe: str, quantity: str, value: float) -> dict[str, Any]:
    """Return the end of a path: a quantity of a probe."""
    return {"probe": probe, "quantity": quantity, "reaches": value}
