"""The initial state of a motion: displacements and velocities at t = 0."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ...case import Active, Case, Constant, Initial, LoadedCase, MovingPoint, Ramp, Static, amplitude_of
from ...elements.contact_geometry import STIFFNESS, WEIGHT
from ...elements.shape import Array
from ...errors import CaseError, ComputationError, Problem, ResultsError
from ...interactions.contact import ContactPoint
from ...model.build import build_model
from ...model.model import Model
from ...model.point_patch import PointConstraint
from ...model.rotation import CoordinateKinds
from ...model.transfer import renumbered
from ..contact import layer_memory, layer_name

# relative to the size of the scene: tolerance for equal reference geometry, and for states that supports hold
SAME, HELD = 1e-9, 1e-6
# share of its energy by which a layer may differ from the whole
WHOLE = 1e-6


def initial_motion(model: Model) -> tuple[Array, Array, Array]:
    """Return displacements and rates (n_full,) at t = 0 as the case gives them, and the bodies' turns (bodies,).

    Multipliers and their rates are 0. The displacements satisfy all supports and joints. The rates are those that were
    asked for; the motion starts with their projection in the metric of the mass. The turns are those of
    ``model.rotation.Turns``. Raises CaseError for a state that is not possible, ComputationError if the static
    equilibrium is not found.
    """
    initial = model.case.initial or Initial()
    n_q = model.n_q
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
    v, turned = np.zeros(len(d)), None
    model.states.fill(0.0)
    if initial.from_ == "static":
        d[:n_q], turned = _static(model)
    elif initial.from_ != "rest":
        d[:n_q], v[:n_q], turned = _from_file(model, initial.from_)
        if _has_layer_memory(model, initial.from_):
            from ..statics.stored_equilibria import equilibrium_with_motion_layers

            # if there is no such equilibrium, a warning says that the motion starts with a kick
            with suppress(CaseError, ComputationError):
                d[:n_q] = equilibrium_with_motion_layers(model, replace(_loaded(model), case=static_case(model.case)),
                                                         d[:n_q], turned)
    e = model.e0 + d[:n_q]
    v[:n_q] = _rates(model, initial, e, v[:n_q])
    return d, v, model.turns.from_reference(d) if turned is None else turned


def _rates(model: Model, initial: Initial, e: Array, stored: Array) -> Array:
    """Return the rates (n_q,) at nodal coordinates e: given for a body, else for all bodies, else stored."""
    kinds = CoordinateKinds(model.meshes.values())
    out = stored.copy()
    for name, mesh in model.meshes.items():
        said = initial.bodies.get(name, initial)
        if said.velocity is None and said.rotation_rate is None:
            continue
        v = np.zeros(model.n_q)
        if said.velocity is not None:
            kinds.translation(v, *said.velocity)
        if said.rotation_rate is not None:
            kinds.rotation(v, e, said.rotation_rate.omega, said.rotation_rate.about)
        coords = slice(mesh.first_dof, mesh.first_dof + mesh.n_dofs)
        out[coords] = v[coords]
    return out


def asked_rates(model: Model) -> Array:
    """Return the rates (n_q,) asked for at t = 0 of a motion from rest, whether or not supports allow them."""
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)[:model.n_q]
    return _rates(model, model.case.initial or Initial(), model.e0 + d, np.zeros(model.n_q))


def initial_rates(model: Model) -> Array:
    """Return the rates (n_unknowns,) at t = 0 of a motion from rest without multipliers and prescribed motion.

    They are the projection of the rates V asked for in the metric of the mass M: T^T M (T v - V) = 0.
    """
    # imported here because checking a case must not import kernels
    from ..linear import full_mass, unknowns_to_coordinates

    asked = asked_rates(model)
    v = np.asarray(asked[model.numbering.free])
    T = unknowns_to_coordinates(model)
    missing = asked - T @ v
    if missing.any():
        from scipy.sparse.linalg import spsolve

        M = full_mass(model)
        v = v + spsolve((T.T @ M @ T).tocsc(), T.T @ (M @ missing))
    return v


def static_case(case: Case) -> Case:
    """Return the static case for the equilibrium at t = 0, with loads and prescribed motion as they are then."""
    def scaled(load: Any) -> Any:
        amplitude = amplitude_of(load)
        if amplitude is None:
            return load
        windowed = {} if getattr(load, "active", None) is None or getattr(load, "switches", False) else {"active": None}
        return replace(load, amplitude=Ramp(scale=float(amplitude.value(0.0))), **windowed)

    def held(support: Any) -> Any:
        changes = {k: float(s.value(0.0)) for k, s in support.motions.items() if hasattr(s, "value")}
        return replace(support, **changes)

    def acts(item: Any) -> bool:
        return item.active is None or bool(item.active.at(0.0))

    def at_start(item: Any) -> Any:
        """Return an item with its moving points fixed where they are at t = 0."""
        def at(point: Any) -> Any:
            return replace(point, s=Constant(float(point.s.value(0.0)))) if isinstance(point, MovingPoint) else point

        active = getattr(item, "active", None)
        if active is not None:
            # an item that does not act at t = 0 never acts in the static case
            item = replace(item, active=None if active.at(0.0) else Active(math.inf))
        if hasattr(item, "between"):
            return replace(item, between=tuple(map(at, item.between)))
        return replace(item, at=at(item.at)) if hasattr(item, "at") else item

    return replace(case, loads=tuple(at_start(scaled(load)) for load in case.loads), initial=None, damping=None,
                   masses=tuple(map(at_start, case.masses)), springs=tuple(map(at_start, case.springs)),
                   boundary_conditions=tuple(map(at_start, map(held, filter(acts, case.boundary_conditions)))),
                   joints=tuple(map(at_start, filter(acts, case.joints))), solver=Static())


def _static(model: Model) -> tuple[Array, Array | None]:
    """Return the displacements (n_q,) of the static equilibrium at t = 0, and the bodies' turns."""
    from ..statics.static import solve_static

    loaded = _loaded(model)
    try:
        # on the motion's own meshes: the equilibrium of other meshes would not stay at rest
        static = build_model(replace(loaded, case=static_case(model.case)), moving=True)
    except CaseError as error:
        raise CaseError([replace(p, message=f"initial.from static: {p.message}") for p in error.problems]) from error
    try:
        *_, state = solve_static(static)
    except ComputationError as error:
        f = error.failure
        raise ComputationError(f"no equilibrium to start the motion from: {f.reason}", at=f.at, history=f.history,
                               advice=f.advice) from error
    model.states[:] = static.states
    for pair, settled in zip(model.contacts, static.contacts, strict=False):
        if not pair.hard and (pair.body, pair.other, pair.spots) == (settled.body, settled.other, settled.spots):
            # friction holds the points of layers where it held them in the equilibrium
            pair.mem[:] = settled.mem
    model.set_step(0.0)
    return state.d[:model.n_q], state.turned


def _from_file(model: Model, name: str) -> tuple[Array, Array, Array | None]:
    """Return the last displacements and rates (n_q,) in a result file of the same meshes, and the turns.

    The turns are None if the file does not contain them. Raises CaseError if the file does not fit.
    """
    from ...results import open_results

    fail = _error_maker(model)
    path = _path(model, name)
    try:
        with open_results(path) as results:
            if results.nt == 0:
                raise fail(f"'{path}' holds no state", "a result file with states")
            if model.remembers:
                raise fail(f"'{path}' does not contain what the material of {', '.join(model.remembers)} remembers",
                           "rest or static")
            _check_mesh(model, results, path, fail)
            dofs = [body.dofs for body in results.bodies.values()]
            d = renumbered(results.d(-1), dofs, model)
            v = renumbered(results.v(-1), dofs, model) if results.holds("v") else np.zeros(model.n_q)
            _check_held(model, d, path, fail)
            for name, rows in _stored_memory(model, results).items():
                layer_memory(model)[name][:] = rows
            return d, v, results.turned(-1)
    except ResultsError as error:
        raise fail(str(error), "the result file of another run, relative to the case") from error


def _stored_memory(model: Model, results: Any) -> dict[str, Array]:
    """Return the history variables of the points of layers that a result file has, by their names in it."""
    found = {name: results.array(name) for name in layer_memory(model) if name in results.arrays}
    return {name: rows for name, rows in found.items() if rows.shape == layer_memory(model)[name].shape}


def _has_layer_memory(model: Model, name: str) -> bool:
    """Return whether a result file has the history variables of equilibria with layers."""
    from ...results import open_results

    with open_results(_path(model, name)) as results:
        return bool(_stored_memory(model, results))


def continues_from_file(model: Model) -> bool:
    """Return whether a motion continues one in a result file, with the same method, supports and joints."""
    from ...results import open_results

    case, initial = model.case, model.case.initial
    moved = any(s.motions for s in case.boundary_conditions)
    if initial is None or initial.from_ in ("rest", "static") or initial.velocity or initial.rotation_rate or (
            initial.bodies or moved):
        return False
    with open_results(_path(model, initial.from_)) as results:
        before, here = _supports_and_joints(results.case_completed), _supports_and_joints(_loaded(model).completed)
        return before == here and results.summary.get("method") == getattr(case.solver, "method", None)


def _supports_and_joints(completed: str) -> list[str]:
    """Return the texts of the supports and joints of a completed case."""
    return [part for part in re.split(r"^(?=\S)", completed, flags=re.MULTILINE)
            if part.startswith(("boundary_conditions:", "joints:"))]


def layers_warnings(model: Model, d: Array) -> list[str]:
    """Return warnings if layers do not press as in the result file that a motion starts from, at its state d (n_full,).

    A file of a motion, or of an earlier version, has no memory of friction, and in statics layers press with their
    whole pressure up to ends of bodies, unless ``equilibrium_with_motion_layers`` has found that of the motion.
    """
    from ...results import open_results

    initial, out = model.case.initial, list[str]()
    if initial is None or initial.from_ in ("rest", "static") or all(pair.hard for pair in model.contacts):
        return out
    with open_results(_path(model, initial.from_)) as results:
        at_rest, kept = not results.holds("v"), _stored_memory(model, results)
        free = model.numbering.free[model.numbering.free < model.n_q]
        stored = renumbered(results.d(-1), [body.dofs for body in results.bodies.values()], model)
        settled = not np.array_equal(stored[free], d[free])
    for k, one in enumerate(model.contact_tables):
        pair, better = one.pair, "initial: {from: static} starts in equilibrium"
        energy, gap = np.zeros(0), np.zeros(0)
        if not pair.hard:
            energy, gap = one.nodal_forces(d, np.zeros_like(d), 0.0, False)[2], one.gaps(d, 0.0)[0]
        if pair.item.friction > 0.0 and energy.any() and layer_name(k, pair) not in kept:
            out.append(f"{pair.name}: friction starts from zero, because '{initial.from_}' does not contain the points "
                       f"at which it sticks. {better}")
        if pair.on_bodies and at_rest and not settled and (gap < 0.0).any():
            whole = 0.5 * pair.par[:, WEIGHT] * pair.par[:, STIFFNESS] * np.minimum(gap, 0.0)**2
            if (energy < (1.0 - WHOLE) * whole).any():
                out.append(f"{pair.name}: in motion, layers press less near ends of bodies than in the equilibrium in "
                           f"'{initial.from_}'. {better}")
    return list(dict.fromkeys(out))


def _check_mesh(model: Model, results: Any, path: str, fail: Callable[..., CaseError]) -> None:
    """Raise CaseError if a result file has other bodies or another mesh."""
    here = {name: (mesh.plan.element.name, mesh.plan.count) for name, mesh in model.meshes.items()}
    there = {name: (body.element_type, len(body.dofs)) for name, body in results.bodies.items()}
    numbers = {name: body.dofs for name, body in results.bodies.items()}
    if list(here) != list(there):
        raise fail(f"'{path}' has the bodies {', '.join(there)}, the case has {', '.join(here)}",
                   "a result of the same bodies, in the same order")
    for name in here:
        if here[name] != there[name]:
            raise fail(f"'{path}' has {there[name][1]} elements of type {there[name][0]} in {name}, "
                       f"the case has {here[name][1]} of type {here[name][0]}", "a result of the same mesh")
        if numbers[name].shape != model.meshes[name].dofs.shape:
            raise fail(f"the elements of {name} in '{path}' have {numbers[name].shape[1]} nodal coordinates, not "
                       f"{model.meshes[name].dofs.shape[1]}", "a result of the same mesh")
    e0 = renumbered(results.e0, numbers.values(), model)
    gap = float(np.max(np.abs(e0 - model.e0) * model.weights, initial=0.0))
    if gap > SAME * model.extent:
        raise fail(f"the reference geometry in '{path}' is different: nodes or directions differ by {gap:.3g}",
                   "a result of the same reference geometry, with nodes at the same places; unless element.nodes is "
                   "regular, every support, joint, spring, mass and load has a node")


def _check_held(model: Model, d: Array, path: str, fail: Callable[..., CaseError]) -> None:
    """Raise CaseError if a state d (n_q,) violates supports or joints, which would tear the model at the start."""
    full = np.zeros(len(model.numbering.place))
    full[:model.n_q] = d
    gaps = model.weights * np.abs(model.displacements(full[model.numbering.free], 0.0)[:model.n_q] - d)
    worst = int(np.argmax(gaps))
    expected = "a result whose last state satisfies the supports and joints of this case"
    if gaps[worst] > HELD * model.extent:
        raise fail(f"supports or joints hold {model.describe_coordinate(worst)} at another place than the last state "
                   f"of '{path}', by {gaps[worst]:.3g}", expected)
    found = model.interactions.gradients(full, 0.0) if model.constraints else []
    for constraint, (gap, _, _) in zip(model.constraints, found, strict=True):
        g = gap / constraint.scale
        if not isinstance(constraint, PointConstraint) or isinstance(constraint, ContactPoint) or not (
                constraint.active is None or constraint.active.at(0.0)):
            continue
        if abs(g) > HELD:
            raise fail(f"{constraint.owner}: the {constraint.holds} differs in the last state of '{path}', by "
                       f"{abs(g):.3g} of its size", expected)
    for pair in model.contacts:
        depth = pair.overlap(full)[0] if pair.hard else 0.0
        if depth > HELD * model.extent:
            raise fail(f"{pair.body} and {pair.other} overlap in the last state of '{path}', by up to {depth:.3g}",
                       "a result in which they do not, or a law")


def _loaded(model: Model) -> LoadedCase:
    if model.loaded is None:
        raise ValueError("the model was not built from a case that was read")
    return model.loaded


def _path(model: Model, name: str) -> str:
    """Return the path of a file that the case names."""
    return os.path.join(os.path.dirname(_loaded(model).source.file), name)


def _error_maker(model: Model) -> Callable[..., CaseError]:
    """Return a function that makes a CaseError about the result file that a motion starts from."""
    def fail(message: str, expected: str = "") -> CaseError:
        path = "initial", "from"
        return CaseError(_loaded(model).source.problem(path, f"initial.from: {message}", expected or None))
    return fail


def initial_problems(model: Model) -> list[Problem]:
    """Return the problems of the initial state that can be found without solving."""
    initial = model.case.initial
    if initial is None or initial.from_ == "rest":
        return []
    try:
        if initial.from_ == "static":
            build_model(replace(_loaded(model), case=static_case(model.case)), moving=True)
        else:
            _from_file(model, initial.from_)
    except CaseError as error:
        return error.problems
    return []
