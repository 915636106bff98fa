"""The functions that kernels of motion call by address: each is compiled once, whatever its callers and the model.

A table holds one address per call, 0 where a function is not needed: ``Problem.calls`` is the table of a model,
``Method.calls`` that of an integrator. Band and front matrices differ only in the addresses in the table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from .forces import GROUP
from .lowlevel.records import address_of, call_entry, type_of
from .motion.state import method_of, motion, scratch

_f, _i, _b = types.float64, types.int64, types.boolean
_x, _xx, _z = types.float64[::1], types.float64[:, ::1], types.complex128[::1]
_pair, _nothing = types.UniTuple(_f, 2), types.none
_MOTION, _SCRATCH = type_of(motion(0, 0, 0)), type_of(scratch(0, 0, 0, 0))
_METHOD = type_of(method_of(0, np.zeros((1, 1)), 0))
# by call: its function, then the types of the arguments that are declared as None
Functions = Mapping[Any, tuple[Any, ...]]
# result type and argument types of each call; None stands for a record whose type is given later (model, point laws,
# joints, an integrator's own record)
_SIGNATURES: list[tuple[Any, tuple[Any, ...]]] = []
_NUMBERS: dict[Any, int] = {}
# addresses found before, by call, function and types; the entries also keep types and functions alive
_ADDRESSES: dict[tuple[Any, ...], tuple[int, list[Any]]] = {}


def _call(result: Any, *declared: Any) -> Callable[..., Any]:
    """Declare a call with these types; return the intrinsic that kernels use as ``call(table, (argument, ...))``."""
    number = len(_SIGNATURES)
    _SIGNATURES.append((result, declared))

    @intrinsic
    def call(_: Any, table: Any, arguments: Any) -> Any:
        signature = _signature(number, [a for a, d in zip(arguments, declared, strict=True) if d is None])

        def generate(context: Any, builder: Any, own: Any, args: Any) -> Any:
            return call_entry(context, builder, signature, own, number, args)

        return result(table, types.Tuple(signature.args)), generate

    _NUMBERS[call] = number
    return call  # type: ignore[no-any-return]


def _signature(number: int, others: Any) -> Any:
    result, declared = _SIGNATURES[number]
    rest = iter(others)
    return result(*(next(rest) if d is None else d for d in declared))


def table(functions: Functions) -> Any:
    """Return the table of addresses (int64, 0 where unused) for the given calls, compiling functions where needed."""
    out = np.zeros(len(_SIGNATURES), dtype=np.int64)
    for call, (function, *others) in functions.items():
        number = _NUMBERS[call]
        key = number, function, *map(id, others)
        if key not in _ADDRESSES:
            _ADDRESSES[key] = address_of(function, _signature(number, others)), others
        out[number] = _ADDRESSES[key][0]
    return out


def compilations(functions: Functions) -> list[Callable[[], object]]:
    """Return one callable per function of a table; calling it compiles that function."""
    return [partial(table, {call: function}) for call, function in functions.items()]


# elements of a group; those that fill a matrix take (p, number of the group, ...) instead of the group
force = _call(_f, GROUP, _x, _x)
noise = _call(_nothing, GROUP, _x, _x)
commit, total_strains = _call(_f, GROUP, _x), _call(_nothing, GROUP, _x, _i, _x)
viscous = _call(_f, GROUP, _f, _x, _x, _x)
mean = _call(_pair, GROUP, _f, _x, _x, _x)
natural_power = _call(_f, GROUP, _f, _x, _x)
natural_work = _call(_f, GROUP, _f, _x, _x)
tangent = _call(_f, None, _i, _f, _x, _x, _x)
mean_tangent = _call(_f, None, _i, _f, _x, _x, _x, _x)
# point laws, and prismatic joints
point_forces, sliding_forces = _call(_pair, None, _x, _x, _xx, _x), _call(_nothing, None, _x, _x, _xx, _x)
point_tangent, sliding_tangent = (_call(_nothing, None, _x, _x, _xx, _f, _x, _x) for _ in range(2))
point_skew = _call(_b, None, _x, _x)
point_noise, sliding_noise = (_call(_nothing, None, _x, _x) for _ in range(2))
point_violation, sliding_violation = (_call(_f, None, _x, _xx) for _ in range(2))
point_rates, sliding_rates = (_call(_nothing, None, _x, _x, _xx, _x, _x) for _ in range(2))
point_accept, sliding_accept = _call(_nothing, None, _x, _xx), _call(_nothing, None, _x)
mark_closed_points = _call(_nothing, None, _x, _x, _xx, _x)
# contact points that touch bodies: (table, point laws, d, within which distance, which point)
face = _call(_nothing, None, None, _x, _f, _i)
bodies_cross = _call(_b, None, None, _x, _x)
point_mean, sliding_mean = _call(_pair, None, _x, _x, _x, _xx, _xx, _x), _call(_nothing, None, _x, _x, _x, _x)
# matrices: kernels.matrices.symmetric
factor, factor_complex = _call(_b, None, _x, _x), _call(_b, None, _z, _x)
solve, solve_complex = _call(_nothing, None, _x, _x), _call(_nothing, None, _z, _z)
product, mass_product = _call(_nothing, None, _x, _x, _x), _call(_nothing, None, _x, _x)
# (p, factor, matrix): mass matrix of moving masses
moving_mass = _call(_nothing, None, _f, _x)
add_sizes, clear_same_kind = _call(_nothing, None, _x, _x, _x), _call(_nothing, None, _x, _x)
# points that move along bodies, and their masses: kernels.moving
place_moving, moving_inertia = _call(_nothing, None, _x, _xx), _call(_nothing, None, _xx, _x, _x)
moving_product = _call(_nothing, None, _x, _x)
# signals and full coordinates: kernels.motion.state
signals, full = _call(_nothing, None, _f, _xx), _call(_nothing, None, _x, _xx, _i, _x)
# the equations of motion: kernels.motion.dynamics
forces = _call(_pair, None, _SCRATCH, _x, _x)
forces_tangent = _call(_f, None, _SCRATCH, _x, _x, _f)
at_floor = _call(_b, None, _SCRATCH, _x, _x)
# feedback (signals and controllers that depend on the motion): kernels.motion.feedback
feedback, feedback_accept = (_call(_nothing, None, _SCRATCH) for _ in range(2))
feedback_tangent = _call(_nothing, None, _SCRATCH, _f)
# conditions that end a step (events): kernels.motion.events
check_conditions = _call(_i, None, _SCRATCH, _x, _x, _f)
event_crossing = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f)
# engagement and release of unilateral springs, tendons and compliant contacts: kernels.motion.stops
stop_crossing = _call(types.Tuple((_f, _i)), None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f, _f)
# states consistent with the constraints: kernels.motion.consistent
consistent = _call(_b, None, _SCRATCH, _x, _x, _x, _f, _x)
by_motion = _call(_nothing, None, _SCRATCH, _i, _x)
onto_constraints = _call(_nothing, None, _SCRATCH, _x, _x, _x, _f, _b)
# for SciPy's integrators: kernels.motion.ode
accelerations = _call(_b, None, _SCRATCH, _x, _MOTION, _f)
# impacts: kernels.motion.impact
after_impact = _call(_b, None, _SCRATCH, _x, _x, _x, _f, _x, _x, _x, _b)
tunnels = _call(_b, None, _SCRATCH, _MOTION, _METHOD, _f, _f)
impact = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _f, _f, _f)
make_consistent = _call(_b, None, _SCRATCH, _MOTION, _f)
lost_in_impact = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _f, _f, _b)
inelastic_work_of_step = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f)
# hard contact points over a step, and their friction: kernels.motion.contact_steps
deactivate_supported, deactivate_dependent = _call(_nothing, None, _SCRATCH, _x), _call(_b, None, _SCRATCH)
deactivated_penetrates = _call(_b, None, _SCRATCH, _x)
friction_forces = _call(_nothing, None, _SCRATCH, _x, _x, _f, _xx)
# friction of hard contact points: kernels.motion.friction
point_slip = _call(_f, None, _i, _x, _x, _xx, _x)
apply_friction_impulses = _call(_nothing, None, _SCRATCH, _x, _x, _x, _x, _x)
add_friction_forces = _call(_nothing, None, _SCRATCH, _x, _x, _x, _x)
point_friction = _call(_nothing, None, _i, _x, _x, _xx, _b, _x)
start_friction = _call(_nothing, None, _x, _xx)
# integrators: the argument before the times is the integrator's own record, which callers pass by address
# radau_* and euler_step belong to the method that switches between the two: kernels.motion.switching
step, radau_step, euler_step = (_call(types.Tuple((_i, _i, _f, _f)), None, _SCRATCH, _MOTION, None, _f, _f)
                                for _ in range(3))
accept, radau_accept, restart = (_call(_nothing, _MOTION, None) for _ in range(3))
# (p, own, step size, fraction of the step): set the history variables of relaxing materials to that instant
inside, radau_inside = (_call(_nothing, None, None, _f, _f) for _ in range(2))
# (p, w, own, fraction of the step): rate of the energy taken by internal strains there, per step
taken, radau_taken = (_call(_f, None, _SCRATCH, None, _f) for _ in range(2))
# relaxing materials at the stages of Radau's method: kernels.motion.stages and reused_tangent
begin_stages = _call(_nothing, None, _f)
relax, lost_in_relaxing = (_call(result, None, _SCRATCH, _MOTION, None) for result in (_nothing, _f))
add_moduli = _call(_nothing, None, _SCRATCH, _x, _x, None, _f)
work = _call(_pair, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f)
work_of_step = _call(_pair, None, _SCRATCH, _MOTION, None, _f, _f)
