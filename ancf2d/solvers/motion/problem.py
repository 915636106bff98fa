"""A model as the kernels of motion take it: one tuple of arrays, and the functions to be compiled for it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numba
import numpy as np
from numba import types

from ...case import Dynamic, Expression
from ...case.programs import are_constant, programs, switches
from ...elements.shape import Array
from ...interactions.body_contact import facing_table
from ...interactions.moving import MovingPatch, moving_table
from ...interactions.prismatic import OnAxis, sliding_table
from ...kernels import calls
from ...kernels.batch import no_group
from ...kernels.bodies import addresses, element_functions
from ...kernels.calls import table
from ...kernels.compiled_laws import internal_address, law_address
from ...kernels.forces import batch_address
from ...kernels.lowlevel.records import Record, type_of
from ...kernels.matrices.layout import no_fronts
from ...kernels.matrices.symmetric import matrix_functions
from ...kernels.motion import ode
from ...kernels.motion.advance import Rows, StepPlan, advance
from ...kernels.motion.consistent import consistent, constraint_functions, kinetic
from ...kernels.motion.dynamics import Problem, dynamic_functions, signals_at
from ...kernels.motion.events import check_conditions, event_functions
from ...kernels.motion.feedback import Feedback, feedback_accept, feedback_functions, no_feedback, tail_size
from ...kernels.motion.impact import consistent_start, impact_functions
from ...kernels.motion.many_states import read_states
from ...kernels.motion.ode import ode_functions
from ...kernels.motion.state import Turning, count_turns, fill_full, method_of, motion, scratch
from ...kernels.motion.stops import acting, stop_functions
from ...kernels.moving import moving_functions
from ...kernels.patches import patch_functions
from ...kernels.sliding import sliding_check
from ...kernels.tangents import fill_products
from ...model.feedback import POSITION, RATE
from ...model.groups import with_own_arrays, with_prescribed, with_states
from ...model.model import Model
from ...model.numbering import Numbering
from ...model.point_tables import point_table, turning_table
from ...model.timing import Signal
from ..energy import is_constant
from ..linear import full_mass, unknowns_to_coordinates
from .integrators import INTEGRATORS, Integrator, default_method
from .own_integrators import MAKERS, Method
from .tables import (
    Signals,
    assembled_laws,
    dead_loads,
    mass_tables,
    motions,
    natural_signals,
    stops_of,
    vectors,
    with_own,
)

# share of the whole time: controllers' states that start at zero are scaled by their value after this time
SOON = 1e-2


def _method(model: Model) -> Integrator:
    """Return the integrator of the motion."""
    return INTEGRATORS[getattr(model.case.solver, "method", None) or default_method(model)]


def called_functions(model: Model, constant: bool) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that the kernels of a model's motion call by address (``kernels.calls``).

    ``constant``: whether no signal depends on time.
    """
    method, layout = _method(model), empty_problem().layout
    fronts, viscous = model.numbering.nested, any(pool.tau for pool in model.pools)
    slides, acts = any(isinstance(c, OnAxis) for c in model.constraints), bool(model.interactions.points)
    faces = any(pair.on_bodies for pair in model.contacts)
    moving = [p for p in model.interactions.points if isinstance(p, MovingPatch)]
    feedback = feedback_functions(fronts, layout) if model.feedback.rank else {}
    # in the order of compilation: feedback first, because its tangent uses the same parts
    return {**feedback, **dynamic_functions(constant, layout), **matrix_functions(fronts, layout),
            **element_functions(fronts, viscous, method.conserves, bool(model.loads.natural), bool(model.remembers),
                                layout),
            **patch_functions(fronts, acts, slides, faces, method.conserves, layout),
            **(moving_functions(fronts, any(p.mass for p in moving), layout) if moving else {}),
            **impact_functions(model.contacts, model.sided, layout),
            **(constraint_functions(layout) if acts or slides else {}),
            **({calls.consistent: (consistent, layout)} if method.conserves else {}),
            **(ode_functions(layout) if method.scipy is not None else {}),
            **(event_functions(layout, (feedback_accept, layout)) if model.feedback.conditions else {}),
            **(stop_functions(layout) if len(stops_of(model)) and method.scipy is None else {}), **feedback}


@cache
def empty_problem() -> Record:
    """Return an empty problem; all problems have its type."""
    x, n, table2 = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 0))
    turning = Turning(n, n, x, x, x)
    return Record(Problem(
        groups=n, states=x, clocks=n, prescribed=table2, slopes=x, driven=np.zeros(0, dtype=bool), calls=n, tau=x,
        points=point_table([]), sliding=sliding_table([], x), moving=moving_table([], int, x), facing=facing_table([]),
        stops=n.reshape(0, 3), patched=False, touches=False, sided=False, turning=turning, winds=False,
        programs=programs([]), place=n, indptr=n, index=n, value=x, full=n, dependents=n, row_place=n,
        row_index=n, fronts=no_fronts(), width=1,
        mass=x, mass_offsets=n, mass_diagonals=table2, load_coord=n, load_value=x, load_signal=n,
        load_varies=np.zeros(0, dtype=bool), motion_coord=n, motion_factor=x, motion_signal=n, motion_mass=table2,
        motion_mass_signal=n, motion_mutual=table2, alpha=0.0, pairs=n.reshape(0, 2), turns=n.reshape(0, 4), e0=x,
        weights=x, straining=x, coordinate=x, extent=0.0, feedback=no_feedback(programs([])), inner=0, rank=0,
        least_iterations=1))


def make_problem(model: Model, num: Numbering | None = None) -> tuple[Record, list[Signal]]:
    """Return the record (``Problem``) for the kernels of motion, and its signals.

    ``num`` is the numbering of the model, by default for all elements of bodies that may touch each other.
    """
    num, signals = model.numbering.complete if num is None else num, Signals()
    T, M = unknowns_to_coordinates(model), full_mass(model)
    pairs, turns = vectors(model)
    tau = np.array([pool.tau for pool in model.pools])
    natural_signals(model, signals)
    damping = model.case.damping
    data: dict[str, Any] = {
        "groups": addresses(model.groups), "states": model.states, "clocks": model.clocks, "tau": tau,
        "prescribed": np.zeros((2, 0)), "slopes": np.zeros(0),
        "points": assembled_laws(model, num, T, signals, _method(model).conserves),
        "turning": turning_table(model.turns), "winds": model.winds,
        "facing": facing_table(model.interactions.points), "stops": stops_of(model),
        "sliding": sliding_table(model.constraints, model.e0), "place": num.place,
        "indptr": num.indptr, "index": num.index, "value": num.value, "full": num.free, "dependents": num.dependent,
        "row_place": num.rows.place, "row_index": num.rows.unknown,
        **mass_tables((T.T @ M @ T).tocsr(), num), "alpha": float(damping.rayleigh.alpha) if damping else 0.0,
        "pairs": pairs, "turns": turns, "e0": model.e0, "weights": num.of_unknowns(model.weights),
        "straining": num.of_unknowns(model.straining), "coordinate": num.of_unknowns(np.ones(num.n_q)),
        "extent": float(model.extent), **dead_loads(model, signals), **motions(model, M, T, signals)}
    data["moving"] = moving_table(model.interactions.points, signals.row, data["mass"])
    patched = len(data["points"].mem) > 0 or len(data["sliding"].multiplier) > 0
    data |= _feedback(model, data, signals)
    found = signals.programs()
    p = Record(Problem(programs=found, calls=table(called_functions(model, are_constant(found))), patched=patched,
                       touches=bool(model.contacts), sided=model.sided, **data))
    if p.layout != empty_problem().layout:
        raise TypeError(f"a problem of another type: {p.layout}")
    return p, signals.all


def _feedback(model: Model, data: dict[str, Any], signals: Signals) -> dict[str, Any]:
    """Return the feedback, and the arrays of a problem with the controllers' states appended to the unknowns."""
    found, num = model.feedback, model.numbering
    n, n_full, m = num.n_unknowns, len(num.place), len(found.states)
    if found.rank == 0 and not found.conditions:
        return {"feedback": no_feedback(programs([])), "inner": n, "rank": 0, "least_iterations": 1}
    clock = signals.row(Signal(Expression("t")))
    rows = np.array([signals.row(a) for a in found.signals], dtype=np.int64)
    columns = np.zeros((len(rows), n + m))
    items = [np.flatnonzero(data["points"].signal[:, 0] == row) for row in rows]
    for column, row in zip(columns, rows, strict=True):
        full, mine = np.zeros(n_full), data["load_signal"] == row
        np.add.at(full, data["load_coord"][mine], data["load_value"][mine])
        column[:n] = -num.reduce(full)
    names, waited = len(found.names), len(found.conditions)
    feedback = Feedback(
        **_quantities(model), last_angle=np.zeros(names), row=rows, columns=columns,
        first=np.cumsum([0, *map(len, items)]), items=np.concatenate([np.zeros(0, dtype=np.int64), *items]),
        programs=found.programs(), watched=np.zeros(waited, dtype=np.int64), clock=clock, states=m,
        time_scale=SOON * getattr(model.case.solver, "t_end", 0.0), scale=np.zeros(m), bounded=bool(found.bounded),
        values=np.zeros(names), slopes=np.zeros(1 + names + 3 * waited), rates=np.zeros(m), full=np.zeros(n_full + m),
        column=np.zeros(n + m))

    def longer(x: Array, value: float = 0.0) -> Array:
        return np.ascontiguousarray(np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, m)], constant_values=value))
    tail, own = tail_size(n + m, found.rank, m), len(found.signals) + m
    moving = data["moving"]
    # if nothing is free to move, the mass matrix is empty, too
    mass, fixed = (np.concatenate([x, np.zeros(k)])
                   for x, k in ((data["mass"], tail), (moving.fixed, tail if len(moving.fixed) else 0)))
    return {"feedback": feedback, "moving": moving._replace(fixed=fixed), "mass": mass, "inner": n,
            "rank": found.rank, "least_iterations": 2 if switches(feedback.programs, own) else 1,
            **{key: np.concatenate([data[key], n + np.arange(m)]) for key in ("place", "row_place")},
            "full": np.concatenate([num.free, n_full + np.arange(m)]),
            "coordinate": longer(data["coordinate"], 1.0),
            **{key: longer(data[key]) for key in ("weights", "straining", "mass_diagonals", "motion_mass")}}


def _quantities(model: Model) -> dict[str, Array]:
    """Return the quantities that feedback depends on, then the states of controllers, as kernels take them."""
    found, n_full = model.feedback, len(model.numbering.place)
    kind, coords, along, across, start = [], [], [], [], []
    for q in found.quantities:
        second = q.along if q.across is None else q.across
        used = np.unique(np.concatenate([q.along.coords, second.coords]))
        one, two = np.zeros(len(used)), np.zeros(len(used))
        np.add.at(one, np.searchsorted(used, q.along.coords), q.along.weights)
        if q.across is not None:
            np.add.at(two, np.searchsorted(used, q.across.coords), q.across.weights)
        kind.append(q.kind)
        coords.append(used)
        along.append(one)
        across.append(two)
        start.append(q.along.p0)
    m, bounded = len(found.states), found.bounded
    more = m + len(bounded)
    none, one, pull = np.zeros(0), np.ones(more), [0.0] if bounded else []
    return {"kind": np.array([*kind, *[POSITION] * m, *[RATE] * len(bounded), *[POSITION] * len(pull)], dtype=np.int64),
            "begin": np.cumsum([0, *map(len, coords), *[1] * more, *[0] * len(pull)]),
            "coords": np.concatenate([none, *coords, n_full + np.array([*range(m), *bounded])]).astype(np.int64),
            "along": np.concatenate([none, *along, one]), "across": np.concatenate([none, *across, 0.0 * one]),
            "start": np.array([*start, *[0.0] * more, *pull])}


def with_own_tables(problem: Record, model: Model) -> Record:
    """Return a problem with its own copies of the tables that store history variables or intermediate results."""
    p: Problem = problem.values
    groups, states = with_states([with_own_arrays(group) for group in model.groups])
    groups, prescribed, slopes = with_prescribed(groups)
    points, changes = p.points, dict[str, Any]()
    if len(p.moving.item):
        # moving points write their current element
        points = with_own(points, "dofs", "G", "p0", "par", "drift")
        changes["moving"] = with_own(p.moving, "element")
        changes["mass"] = p.mass.copy() if len(p.moving.fixed) else p.mass
    if len(p.facing.item):
        # contact points write the element that they are opposite to
        points = with_own(points, "dofs", "G", "p0", "par")
        changes["facing"] = with_own(p.facing, "now", "chords", "boxes")
    feedback = with_own(p.feedback, "start", "last_angle", "scale", "values", "slopes", "rates", "full", "column",
                        "watched")
    return problem.replaced(
        groups, **changes, groups=addresses(groups), states=states, prescribed=prescribed, slopes=slopes,
        straining=p.straining.copy(), weights=p.weights.copy(), stops=p.stops.copy(),
        sliding=with_own(p.sliding, "memory", "on", "gap"),
        points=with_own(points, "mem", "on", "apart", "there")._replace(
            assembly=with_own(points.assembly, "skew", "has_skew")),
        feedback=feedback._replace(programs=with_own(p.feedback.programs, "data", "stack")),
        programs=with_own(p.programs, "window", "data", "stack"))


def driving_signals(p: Record) -> list[int]:
    """Return the signals that positions or angles follow."""
    fed = p.points.signal[p.points.fed >= 0].tolist()
    return sorted({*p.motion_signal.tolist(), *fed})


def tracks_work(model: Model) -> bool:
    """Return whether any force lacks a potential: varying loads, motion, damping, friction, turning loads."""
    dampers = any(spring.damped or spring.signal is not None or spring.active is not None for spring in model.springs)
    fed = any(np.max(point.items().fed) >= 0 for point in model.interactions.points)
    natural = any(not is_constant(load.amplitude) for load in model.loads.natural)
    natural = natural or bool(model.loads.flows)
    rubs = any(contact.item.friction for contact in model.contacts)
    varies = any(not is_constant(load.amplitude) for load in model.loads.dead)
    damping = model.case.damping
    viscous = any(pool.tau for pool in model.pools) or bool(damping and damping.rayleigh.alpha)
    return bool(natural or rubs or varies or model.moves or viscous or dampers or fed or model.loads.patches)


Compilation = Callable[[], object]
_f, _i = types.float64, types.int64
_x, _n, _xx = types.float64[::1], types.int64[::1], types.float64[:, ::1]


def element_compilations(model: Model) -> list[Compilation]:
    """Return functions that compile the forces of a model's elements, without matrices."""
    laws = {m.plan.formulation.law: None for m in model.meshes.values() if not m.plan.rigid}
    if not laws:
        return []
    products = (types.float64[:, :, :, ::1], _i, numba.typeof(no_group().plan), _x)
    return [batch_address, *(partial(law_address, law) for law in laws),
            *(partial(internal_address, law) for law in laws if law.internal is not None),
            partial(fill_products.compile, products)]


def motion_compilations(model: Model, spec: Dynamic) -> list[Compilation]:
    """Return functions that compile everything for a motion, the slowest first."""
    name, p = spec.method or default_method(model), empty_problem()
    works = tracks_work(model)
    own = calls.compilations(Method(name, spec, p, 0.0, model.relaxing, works).functions) if name in MAKERS else []
    # if this guess is wrong, missing functions are compiled when the problem is made
    called = called_functions(model, not (works or model.feedback.rank))
    slides = calls.sliding_forces in called
    return [*element_compilations(model), *own, *_called_from_python(p.layout, name in MAKERS, slides, model.sided),
            *([partial(check_conditions.compile, _condition_types(p.layout))] if model.feedback.conditions else []),
            *([partial(acting.compile, (*_condition_types(p.layout), _x))]
              if len(stops_of(model)) and name not in MAKERS else []),
            *calls.compilations(called)]


def _called_from_python(P: Any, own: bool, slides: bool, sided: bool) -> list[Compilation]:
    """Return functions that compile the kernels called by ``Stepper`` (``OdeStepper`` for SciPy's integrators)."""
    M, W = type_of(motion(0, 0, 0)), type_of(scratch(0, 0, 0, 0))
    signatures: dict[Any, tuple[Any, ...]] = {
        consistent: (P, W, _x, _x, _x, _f, _x), kinetic: (P, W, M, _f), fill_full: (P, _x, _xx, _i, _x),
        signals_at: (P, _f, _xx), count_turns: (P.place["turning"][1], _x, _x, _f, _x, _x),
        read_states: (P, W, types.boolean, _x, _n, *[_xx] * 3, *[types.float64[:, :, ::1]] * 2, *[_xx] * 6)}
    if sided:
        signatures[consistent_start] = signatures[consistent]
    if slides:
        signatures[sliding_check] = P.place["sliding"][1], _x
    if own:
        rows, method = type_of(_no_rows()), type_of(method_of(0, np.zeros((0, 0)), 0))
        plan = type_of(StepPlan(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, False))
        signatures[advance] = method, P, W, M, M, plan, rows, _i, _i
    else:
        signatures |= {
            ode.mass_factors: (P, W, _x), ode.accelerations: (P, W, _x, M, _f), ode.place: (M, _n, _x),
            ode.rates: (P, W, _x, M, _n, _f, _x, _x), ode.powers: (P, W, _x, M, _n, _f, _x),
            ode.accept_step: (P, W, M, _f), ode.tangents: (P, W, M, _f, _x, _x, _x)}
    return [partial(kernel.compile, signature) for kernel, signature in signatures.items()]


def _condition_types(P: Any) -> tuple[Any, ...]:
    """Return the argument types of ``check_conditions``, which evaluates the conditions of a motion."""
    return P, type_of(scratch(0, 0, 0, 0)), _x, _x, _f


def _no_rows() -> Rows:
    x, n, table = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 0))
    turns = np.zeros((0, 0, 0))
    return Rows(x, 0, x, n, n, table, table, table, table, turns, turns, table, table, table)
