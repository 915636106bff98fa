"""The solver of each case; a new solver is one entry here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..case import SWITCHED, Case
from ..case.binder import dotted
from ..case.part_checks import materials_of
from ..case.records import tag_of
from ..case.schema.solvers import (
    Buckling,
    Dynamic,
    Eigen,
    FrequencyResponse,
    LinearStatic,
    LoadFactor,
    QuasiStatic,
    StateSpace,
    Static,
)
from ..elements.shape import Array
from ..interactions.moving import off_body_warnings
from ..model.model import Model
from .state import State

if TYPE_CHECKING:
    from .statics.newton import Start

Checkpoint = dict[str, Array]


def _linear(model: Model, spec: LinearStatic) -> Iterator[State]:
    from .statics.linear_static import solve_linear

    # the matrix is gone when the state is processed
    yield solve_linear(model)


def _static(model: Model, spec: Static, start: Start | None = None) -> Iterator[State]:
    if spec.method != "newton":
        from .statics.path import solve_path

        return solve_path(model, spec)
    from .statics.static import solve_static

    # newton ends only at a load factor: the schema refuses everything else
    end = spec.until.value if isinstance(spec.until, LoadFactor) else 1.0
    return solve_static(model, spec.steps, spec.tolerance, spec.max_iterations, end, start, spec.factors or ())


def _quasi_static(model: Model, spec: QuasiStatic, kept: Checkpoint | None = None) -> Iterator[State]:
    from .statics.quasi_static import solve_quasi_static

    return solve_quasi_static(model, spec, kept)


def _eigen(model: Model, spec: Eigen) -> Iterator[State]:
    from .small_motions.eigen import solve_eigen

    return solve_eigen(model, spec)


def _frequency_response(model: Model, spec: FrequencyResponse) -> Iterator[State]:
    from .small_motions.frequency_response import solve_frequency_response

    return solve_frequency_response(model, spec)


def _state_space(model: Model, spec: StateSpace) -> Iterator[State]:
    from .small_motions.state_space import solve_state_space

    return solve_state_space(model, spec)


def _buckling(model: Model, spec: Buckling) -> Iterator[State]:
    from .statics.buckling import solve_buckling

    return solve_buckling(model, spec)


def _dynamic(model: Model, spec: Dynamic, kept: Checkpoint | None = None) -> Iterator[State]:
    from .motion.dynamic import solve_dynamic

    return solve_dynamic(model, spec, kept)


# optional third argument: a checkpoint to continue from (over time), or an initial guess (statics)
SOLVERS: dict[type, Callable[..., Iterator[State]]] = {
    LinearStatic: _linear, Static: _static, QuasiStatic: _quasi_static, Eigen: _eigen,
    FrequencyResponse: _frequency_response, StateSpace: _state_space, Buckling: _buckling, Dynamic: _dynamic,
}


def left_out(case: Case) -> list[str]:
    """Return messages about parts of a case that its solver leaves out."""
    bounces = [] if case.solver.moves else [f"contacts.{i}.restitution" for i, contact in enumerate(case.contacts)
                                            if contact.restitution is not None]
    return [*_left_out(case), *(f"{what}: solver {tag_of(type(case.solver))} computes no impacts, so it has no effect"
                                for what in bounces)]


def _left_out(case: Case) -> list[str]:
    if isinstance(case.solver, FrequencyResponse | StateSpace):
        out = _idle(case, case.solver.about, "motions", " other than inputs")
        fields = [name for name in case.output.fields if name not in ("N", "Q", "M")]
        if isinstance(case.solver, FrequencyResponse) and fields:
            out.append(f"the response is that of probes; {', '.join(fields)} are those of the state about which the "
                       "model oscillates")
        return out
    if case.solver.moves:
        late = [(f"{section}.{k}", item.active.from_) for section in SWITCHED for k, item in enumerate(
            getattr(case, section)) if getattr(item, "active", None) is not None and item.active.from_ is not None]
        return [*off_body_warnings(case), *(
            f"{what}: it begins at t = {begin:g}, but the motion ends at {case.solver.end:g}"
            for what, begin in late if begin >= case.solver.end)]
    if not isinstance(case.solver, Eigen):
        return []
    dampers = [f"{dotted(path)}.{what}" for what in ("damping", "viscoelastic")
               for path, material in materials_of(case) if material is not None and getattr(material, what)]
    dampers += [f"springs.{i}.damping" if hasattr(spring, "damping") else f"springs.{i}"
                for i, spring in enumerate(case.springs) if spring.damped]
    dampers += ["damping"] if case.damping is not None else []
    loaded = case.solver.about == "static" or case.steady_rotation is not None
    dampers += [f"the damping of loads.{i}" for i, load in enumerate(case.loads)
                if loaded and getattr(load, "damped", False)]
    out = []
    if dampers and not case.solver.damped:
        out.append(f"these modes are undamped (damped: false), so {', '.join(dampers)} "
                   f"{'has' if len(dampers) == 1 else 'have'} no effect")
    return [*out, *_idle(case, case.solver.about, "modes", "")]


def _idle(case: Case, about: str, what: str, but: str) -> list[str]:
    """Return a message if motions (``what``) about the reference make loads, ``but`` not inputs, ineffective."""
    if about != "reference" or case.steady_rotation is not None:
        return []
    loads = any(load.name not in case.inputs for load in case.loads)
    moved = any(one.motions and one.name not in case.inputs for one in case.boundary_conditions)
    idle = ["loads"] * loads + ["prescribed motions"] * moved
    held = ", except that prescribed points are held" if moved else ""
    return [f"these {what} are about the reference, so {' and '.join(idle)}{but} have no effect{held}. Use about: "
            "static to include them"] if idle else []


def initial_state(model: Model) -> State:
    """Return the reference state, from which static paths start."""
    zero = np.zeros(len(model.numbering.place))
    with model.timing.preload():
        d = model.displacements(zero[:model.numbering.n_unknowns], 0.0)
    return State(0.0, d, zero, zero, 0.0)


def solve(model: Model, kept: Checkpoint | Start | None = None) -> Iterator[State]:
    """Yield the states of a model's solver, from a checkpoint (over time) or an initial guess (statics) if given.

    Raises ComputationError if the computation fails.
    """
    start = () if kept is None else (kept,)
    states = SOLVERS[type(model.case.solver)](model, model.case.solver, *start)
    return _with_memory(model, states) if model.remembers else states


def _with_memory(model: Model, states: Iterator[State]) -> Iterator[State]:
    """Yield states with the history variables of elements, which later evaluations need."""
    for state in states:
        state.memory = model.states.copy()
        yield state


