"""Loads on elements other than at their ends: multipliers of supports and joints, and forces between nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..case import Point
from ..case.schema.points import named_points
from ..elements.shape import Array
from ..elements.sliding import OFF
from ..interactions.body_loads import FormulaLine
from ..interactions.forces import LoadContext, LoadSet
from ..interactions.moving import MovingPatch
from ..interactions.prismatic import OnAxis
from ..model.mesh import BodyMesh, Index
from ..model.model import Model
from ..model.point_patch import PointPatch
from ..model.points import PointRef
from .contact import nodal_forces_of_points
from .linear import full_mass, inertia_rates
from .state import State

# distance from an end of the element, relative to its length, within which a force acts at the end
NODE = 1e-9


class Inside(NamedTuple):
    """A force on the coordinates (n_dof,) of element ``ie`` that acts at ``xi``, between the element's ends or, if it
    acts on other coordinates than those of the node there, at one of them.
    """

    ie: int
    xi: float
    force: Array


def is_inside(point: PointRef, mesh: BodyMesh, spread: bool = False) -> bool:
    """Return whether a force at a point of this body may act on other coordinates than those of a node there.

    It does between the ends of an element and, in types with a common coefficient of x^2 and y^2, beside the axis and
    if it is ``spread`` over the section.
    """
    if point.mesh is not mesh or 0.0 < point.xi < 1.0:
        return point.mesh is mesh
    return point.eta != 0.0 or (spread and _reaches_beyond(point))


def _reaches_beyond(point: PointRef) -> bool:
    """Return whether the mean of the section at an end of an element depends on coordinates of other nodes."""
    row, ends = point.shape_row(spread="uniform"), point.mesh.plan.element.functionals
    return any(weight != 0.0 for weight, (node, _) in zip(row.tolist(), ends, strict=True) if node != point.node)


def equilibrium_rows(model: Model, state: State) -> tuple[Array, Array]:
    """Return the multipliers of the linear rows and the residual (n_q,) that they balance."""
    R = (state.Q - state.F)[:model.n_q]
    moves = inertia_rates(model, state)
    if moves is not None:
        R = R + full_mass(model) @ moves
    rows = model.rows
    if not rows:
        return np.zeros(0), R
    held = np.concatenate([r.coords for r in rows])
    coords, index = np.unique(held, return_inverse=True)
    owner = np.repeat(np.arange(len(rows)), [len(r.coords) for r in rows])
    # coordinates have different units: compare forces as acting on displacements
    data = np.concatenate([r.coefs for r in rows]) / model.weights[held]
    sizes = np.sqrt(np.bincount(owner, data**2, len(rows)))
    data /= sizes[owner]
    b = R[coords] / model.weights[coords]
    if len(coords) == len(held):
        # no two rows share a coordinate: they are orthogonal
        lam = np.asarray(np.bincount(owner, data * b[index], len(rows)), dtype=float)
    elif len(rows) * len(coords) <= 4_000_000:
        A = np.zeros((len(coords), len(rows)))
        A[index, owner] = data
        lam = np.linalg.lstsq(A, b, rcond=None)[0]
    else:
        lam = _sparse_least_squares(data, index, owner, (len(coords), len(rows)), b)
    return lam / sizes, R


def _sparse_least_squares(data: Array, index: Index, owner: NDArray[np.integer], shape: tuple[int, int],
                          b: Array) -> Array:
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import lsmr

    return lsmr(csr_matrix((data, (index, owner)), shape=shape), b, atol=1e-14, btol=1e-14)[0]


def constraint_forces(model: Model, state: State) -> list[tuple[Index, Array]]:
    """Return the coordinates of each constraint and the forces that it exerts along them."""
    if not model.constraints:
        return []
    d, out = state.d.copy(), {}
    if state.linear:
        d[:model.n_q] = 0.0
    for _, Q, _, dofs in model.interactions.constraints(d, state.side, state.linear):
        for q, coords in zip(Q, dofs, strict=True):
            out[int(coords[-1]) - model.n_q] = coords[:-1], -q[:-1]
    return [out[k] for k in range(len(model.constraints))]


def acting_inside(model: Model, mesh: BodyMesh, state: State) -> list[Inside]:
    """Return the forces of loads, springs, supports, joints and contacts on a body between the ends of its elements."""
    return [*_loads(model, mesh, state), *_springs(model, mesh, state), *_held(model, mesh, state),
            *_moving(model, mesh, state), *_by_formula(model, mesh, state), *_touching(model, mesh, state)]


def influencing_coordinates(model: Model, mesh: BodyMesh, ie: int, state: State) -> Index | None:
    """Return all coordinates and multipliers on which element ``ie`` and the forces inside it depend.

    None if supports or joints without multipliers hold it there: their forces depend on the whole model.
    """
    coords, owners = [mesh.dofs[ie]], {owner for owner, k, _ in _places(model, mesh, state) if k == ie}
    for patch in [*model.springs, *(p for p in model.loads.patches if isinstance(p, PointPatch))]:
        if any(is_inside(end, mesh) and end.ie == ie for end, _ in patch.ends):
            coords.append(patch.coordinates)
    coords += [guide.depends for guide in model.loads.guides if guide.mesh is mesh]
    if any(row.owner in owners for row in model.rows):
        return None
    for _, _, _, dofs in model.interactions.constraints(state.d, state.side):
        coords += [one for one in dofs if model.constraints[int(one[-1]) - model.n_q].owner in owners]
    return np.unique(np.concatenate(coords))


def _loads(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    d = _displacements(model, state)
    for load in model.case.loads:
        # body first: finding a place along it is slow
        named = [model.point(p) for p in named_points(load) if p.body == mesh.plan.name]
        beside = getattr(load, "spread", None) is not None or any(getattr(p, "y", 0.0) for p in getattr(
            load, "through", ()))
        if not any(is_inside(point, mesh, beside) for point in named):
            continue
        out, full = LoadSet(), np.zeros(model.n_q)
        load.add(LoadContext(model.meshes, model.point, model.timing.factor(load)), out)
        with_ends = [patch for patch in out.patches if isinstance(patch, PointPatch) and patch.ends]
        for patch in with_ends:
            yield from _at_ends(patch, mesh, d, None, state)
        if not isinstance(getattr(load, "at", None), Point):
            continue
        for dead in out.dead:
            full[dead.dofs] += dead.amplitude(state.side) * dead.values
        if rest := [patch for patch in out.patches if patch not in with_ends]:
            from ..model.point_tables import batches

            for batch in batches(rest):
                np.subtract.at(full, batch.dofs, batch.evaluate(model.e0 + d, d, state.side)[1])
        yield _at(named[0], full)


def _springs(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    d, v = state.d[:model.n_q], None if state.v is None else state.v[:model.n_q]
    if state.turned is not None:
        model.turns.set_spring_angles(model.springs, model.e0 + d, d, state.turned)
    for spring in (one for one in model.springs if one.ends):
        yield from _at_ends(spring, mesh, d, v, state, state.linear)


def _at_ends(patch: PointPatch, mesh: BodyMesh, d: Array, v: Array | None, state: State, linear: bool = False
             ) -> Iterator[Inside]:
    for point, full in patch.at_ends(lambda end: is_inside(end, mesh), d, v, state.side, linear):
        yield _at(point, full)


def _moving(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    """Yield the forces of loads and masses that move along the body."""
    if state.v is None or state.a is None:
        return
    for patch in model.loads.patches:
        if isinstance(patch, MovingPatch) and patch.mesh is mesh and (m := patch.element(state.side)) != OFF:
            yield Inside(m, *patch.acting(m, state.side, state.d, state.v, state.a))


def _by_formula(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    """Yield the forces of line loads given by formulas, one for each quadrature point."""
    lines = [p for p in model.loads.patches if isinstance(p, FormulaLine) and p.mesh is mesh]
    if not lines:
        return
    from ..model.point_tables import batches  # imports the kernels of point laws

    for patch in lines:
        [batch] = batches([patch])
        Q = batch.matrices(state.d, state.side, v=state.v)[1]
        places = [(ie, x) for elements, xi, _ in patch.cover for ie in elements.tolist() for x in np.ravel(xi).tolist()]
        yield from (Inside(ie, x, -q) for (ie, x), q in zip(places, Q, strict=True))


def _touching(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    """Yield the contact forces at the body's own points, and those of other bodies' points on it."""
    if not model.contacts:
        return
    element = {int(first): ie for ie, first in enumerate(mesh.dofs[:, 0])}
    # faces of sections that deform
    wide = mesh.plan.element.section_kind == "interpolated"
    for one in model.contact_tables:
        pair = one.pair
        if mesh is not pair.mesh and not (pair.on_bodies and mesh is pair.against):
            continue
        coords, Q = nodal_forces_of_points(one, state)
        own = pair.mesh.plan.element.n_dof
        parts = [(pair.mesh, one.s_on_own_body(pair.mesh), 0)]
        parts += [(pair.against, one.s_on_other_body(), own)] if pair.on_bodies else []
        for body, s, first in parts:
            here = slice(first, first + body.plan.element.n_dof)
            for k in np.flatnonzero(Q[:, here].any(axis=1)) if body is mesh else ():
                ie = element[int(coords[k, first])]
                xi = float((s[k] * mesh.plan.length - mesh.starts[ie]) / mesh.lengths[ie])
                if wide or NODE < xi < 1.0 - NODE:
                    yield Inside(ie, float(np.clip(xi, 0.0, 1.0)), -Q[k, here])


def _places(model: Model, mesh: BodyMesh, state: State) -> list[tuple[str, int, float]]:
    """Return owner, element and xi of the supports and joints that hold a body between the ends of its elements."""
    places = [(owner, point.ie, point.xi)
              for (owner, point), item in zip(model.supports, model.case.boundary_conditions, strict=True)
              if is_inside(point, mesh, getattr(item, "spread", None) is not None
                           or getattr(item, "hold", None) == "breathe")]
    for i, joint in enumerate(model.case.joints):
        for p in named_points(joint):
            if p.body == mesh.plan.name and is_inside(point := model.point(p), mesh):
                places.append((joint.name or f"joints.{i}", point.ie, point.xi))
    d = _displacements(model, state)
    return places + [(c.owner, *c.foot(d)) for c in model.constraints
                     if isinstance(c, OnAxis) and c.body == mesh.plan.name
                     and (c.active is None or c.active.at(state.side))]


def _held(model: Model, mesh: BodyMesh, state: State) -> Iterator[Inside]:
    """Yield the forces of supports and joints."""
    places = _places(model, mesh, state)
    if not places:
        return
    lam, _ = equilibrium_rows(model, state)
    held = constraint_forces(model, state)
    for owner, ie, xi in places:
        full = np.zeros(model.n_q)
        for row, value in zip(model.rows, lam, strict=True):
            if row.owner == owner:
                np.add.at(full, row.coords, value * row.coefs)
        for constraint, (dofs, forces) in zip(model.constraints, held, strict=True):
            if constraint.owner == owner:
                np.add.at(full, dofs, forces)
        yield Inside(ie, xi, full[mesh.dofs[ie]])


def _displacements(model: Model, state: State) -> Array:
    """Return the displacements (n_q,) at which a state's forces are evaluated: 0 for linear states."""
    return np.zeros(model.n_q) if state.linear else state.d[:model.n_q]


def _at(point: PointRef, full: Array) -> Inside:
    return Inside(point.ie, point.xi, full[point.mesh.dofs[point.ie]])
