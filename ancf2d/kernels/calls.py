"""What the kernels of motion call by address: each is compiled once, whatever calls it and whatever else a model has.

Tables hold the addresses, 0 for what is not needed: ``Problem.calls`` those of a model, ``Method.calls`` those of an
integrator. Whether matrices are bands or fronts shows in the addresses alone.
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
# the function of each call, and the types of those of its arguments that differ
Functions = Mapping[Any, tuple[Any, ...]]
# types of the result and of the arguments; None for records: of a model, its point laws and joints, an integrator's own
_SIGNATURES: list[tuple[Any, tuple[Any, ...]]] = []
_NUMBERS: dict[Any, int] = {}
# by call, function and types: what is found once need not be looked for again; types and functions are kept alive
_ADDRESSES: dict[tuple[Any, ...], tuple[int, list[Any]]] = {}


def _call(result: Any, *declared: Any) -> Callable[..., Any]:
    """Return what kernels call by ``call(table, (argument, ...))``."""
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
    """Return the addresses of calls, from the function of each with the types of those arguments that differ."""
    out = np.zeros(len(_SIGNATURES), dtype=np.int64)
    for call, (function, *others) in functions.items():
        number = _NUMBERS[call]
        key = number, function, *map(id, others)
        if key not in _ADDRESSES:
            _ADDRESSES[key] = address_of(function, _signature(number, others)), others
        out[number] = _ADDRESSES[key][0]
    return out


def compilations(functions: Functions) -> list[Callable[[], object]]:
    """Return what compiles the functions of a table, one by one."""
    return [partial(table, {call: function}) for call, function in functions.items()]


# elements of a group, and those with a matrix: (p, number of the group, ...)
force = _call(_f, GROUP, _x, _x)
noise = _call(_nothing, GROUP, _x, _x)
commit, take_strains = _call(_f, GROUP, _x), _call(_nothing, GROUP, _x, _i, _x)
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
point_sides = _call(_nothing, None, _x, _x, _xx, _x)
# of points that touch bodies: (table, point laws, d, whether those that are near are enough)
face = _call(_nothing, None, None, _x, _b)
bodies_cross = _call(_b, None, None, _x, _x)
point_mean, sliding_mean = _call(_pair, None, _x, _x, _x, _xx, _xx, _b, _x), _call(_nothing, None, _x, _x, _x, _x)
# matrices: kernels.matrices.symmetric
factor, factor_complex = _call(_b, None, _x, _x), _call(_b, None, _z, _x)
solve, solve_complex = _call(_nothing, None, _x, _x), _call(_nothing, None, _z, _z)
product, mass_product = _call(_nothing, None, _x, _x, _x), _call(_nothing, None, _x, _x)
# (p, factor, matrix) of masses that move
moving_mass = _call(_nothing, None, _f, _x)
add_sizes, keep_between = _call(_nothing, None, _x, _x, _x), _call(_nothing, None, _x, _x)
# points that move along bodies, and masses there: kernels.moving
place_moving, moving_inertia = _call(_nothing, None, _x, _xx), _call(_nothing, None, _xx, _x, _x)
moving_product = _call(_nothing, None, _x, _x)
# signals and full coordinates: kernels.motion.state
signals, full = _call(_nothing, None, _f, _xx), _call(_nothing, None, _x, _xx, _i, _x)
# the equations of motion: kernels.motion.dynamics
forces = _call(_pair, None, _SCRATCH, _x, _x)
forces_tangent = _call(_f, None, _SCRATCH, _x, _x, _f)
at_floor = _call(_b, None, _SCRATCH, _x, _x)
# what answers the motion: kernels.motion.feedback
feedback, feedback_accept = (_call(_nothing, None, _SCRATCH) for _ in range(2))
feedback_tangent = _call(_nothing, None, _SCRATCH, _f)
# conditions that something waits for: kernels.motion.events
holding = _call(_i, None, _SCRATCH, _x, _x, _f)
crossing = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f)
# what acts on one side alone: kernels.motion.stops
stop_crossing = _call(types.Tuple((_f, _i)), None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f, _f)
# states that belong to constraints: kernels.motion.consistent
consistent = _call(_b, None, _SCRATCH, _x, _x, _x, _f, _x)
by_motion = _call(_nothing, None, _SCRATCH, _i, _x)
onto_constraints = _call(_nothing, None, _SCRATCH, _x, _x, _x, _f, _b)
# for SciPy's integrators: kernels.motion.ode
accelerations = _call(_b, None, _SCRATCH, _x, _MOTION, _f)
# impacts: kernels.motion.impact
behind = _call(_b, None, _SCRATCH, _x, _x, _x, _f, _x, _x, _x, _b)
tunnels = _call(_b, None, _SCRATCH, _MOTION, _METHOD, _f, _f)
impact = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _f, _f, _f)
make_consistent = _call(_b, None, _SCRATCH, _MOTION, _f)
lost_in_impact = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _f, _f, _b)
taken_in_step = _call(_f, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f)
# points of contacts without a law over a step, and their friction: kernels.motion.contact_steps
leave_supported, leave_dependent = _call(_nothing, None, _SCRATCH, _x), _call(_b, None, _SCRATCH)
into_supports = _call(_b, None, _SCRATCH, _x)
friction_forces = _call(_nothing, None, _SCRATCH, _x, _x, _f, _xx)
# friction there: kernels.motion.friction
point_slip = _call(_f, None, _i, _x, _x, _xx, _x)
rub = _call(_nothing, None, _SCRATCH, _x, _x, _x, _x, _x)
drag = _call(_nothing, None, _SCRATCH, _x, _x, _x, _x)
point_friction = _call(_nothing, None, _i, _x, _x, _xx, _b, _x)
take_hold = _call(_nothing, None, _x, _xx)
# integrators: the last but times is the integrator's own record, of which callers know the address alone
# those named after a method are of one that makes steps of two methods: kernels.motion.switching
step, radau_step, euler_step = (_call(types.Tuple((_i, _i, _f, _f)), None, _SCRATCH, _MOTION, None, _f, _f)
                                for _ in range(3))
accept, radau_accept, restart = (_call(_nothing, _MOTION, None) for _ in range(3))
# (p, own, length of the step, fraction of it): what materials that relax remember there
inside, radau_inside = (_call(_nothing, None, None, _f, _f) for _ in range(2))
# (p, w, own, fraction of the step): the energy that internal strains take there, in the time of the step
taken, radau_taken = (_call(_f, None, _SCRATCH, None, _f) for _ in range(2))
# what materials that relax are at the stages: kernels.motion.stages and reused_tangent
begin_stages = _call(_nothing, None, _f)
relax, lost_in_relaxing = (_call(result, None, _SCRATCH, _MOTION, None) for result in (_nothing, _f))
add_moduli = _call(_nothing, None, _SCRATCH, _x, _x, None, _f)
work = _call(_pair, None, _SCRATCH, _MOTION, _METHOD, _MOTION, _f, _f, _f)
work_of_step = _call(_pair, None, _SCRATCH, _MOTION, None, _f, _f)
