"""What a motion has to have compiled, piece by piece, so that several pieces can be compiled at once.

Statics has few kernels, which ``study.warmup`` goes through one by one. Whatever is left out here is compiled all the
same, when a motion comes to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np
from numba import types

from ..case import Dynamic
from ..kernels import calls, ode
from ..kernels.advance import Plan, Rows, advance
from ..kernels.amplitudes import evaluate
from ..kernels.batch import no_group
from ..kernels.compiled_laws import law_address
from ..kernels.consistent import consistent, kinetic, onto_constraints
from ..kernels.dynamics import to_full
from ..kernels.forces import batch_address
from ..kernels.lowlevel.records import type_of
from ..kernels.motion import method_of, motion, scratch
from ..kernels.points import turn_on
from ..kernels.sliding import sliding_check
from ..kernels.tangents import fill_products
from ..model.model import Model
from .methods import MAKERS, Method
from .problem import functions, nothing
from .schemes import DEFAULT

Compilation = Callable[[], object]
_f, _i = types.float64, types.int64
_x, _n, _xx = types.float64[::1], types.int64[::1], types.float64[:, ::1]


def of_elements(model: Model) -> list[Compilation]:
    """Return what compiles the forces of a model's elements, from matrices aside."""
    laws = {m.plan.formulation.law: None for m in model.meshes.values() if not m.plan.rigid}
    if not laws:
        return []
    products = (types.float64[:, :, :, ::1], _i, numba.typeof(no_group().plan), _x)
    return [batch_address, *(partial(law_address, law) for law in laws), partial(fill_products.compile, products)]


def of_motion(model: Model, spec: Dynamic) -> list[Compilation]:
    """Return what compiles everything for a motion, what takes longest first."""
    name, p = spec.method or DEFAULT, nothing()
    own = calls.compilations(Method(name, spec, p, 0.0).functions) if name in MAKERS else []
    called = functions(model)
    slides = calls.sliding_forces in called
    patched = slides or calls.point_forces in called
    return [*of_elements(model), *own, *_called_from_python(p.layout, name in MAKERS, patched, slides),
            *calls.compilations(called)]


def _called_from_python(P: Any, own: bool, patched: bool, slides: bool) -> list[Compilation]:
    """Return what compiles the kernels that ``Stepper`` calls, or ``OdeStepper`` for SciPy's integrators."""
    M, W = type_of(motion(0, 0, 0)), type_of(scratch(0, 0, 0, 0))
    signatures: dict[Any, tuple[Any, ...]] = {
        consistent: (P, W, M, _f, _x), kinetic: (P, W, M, _f), to_full: (P, _x, _xx, _i, _x),
        evaluate: (P.place["programs"][1], _f, _xx), turn_on: (P.place["turning"][1], _x, _x, _f, _x, _x)}
    if patched:
        signatures[onto_constraints] = P, W, _x, _x, _f
    if slides:
        signatures[sliding_check] = P.place["sliding"][1].whole(), _x
    if own:
        rows, method = type_of(_no_rows()), type_of(method_of(0, np.zeros((0, 0)), 0))
        plan = type_of(Plan(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False))
        signatures[advance] = method, P, W, M, M, plan, rows, _i, _i
    else:
        signatures |= {
            ode.mass_factors: (P, W, _x), ode.accelerations: (P, W, _x, M, _f), ode.place: (M, _n, _x),
            ode.rates: (P, W, _x, M, _n, _f, _x, _x), ode.powers: (P, W, _x, M, _n, _f, _x),
            ode.settle: (P, W, M, _f), ode.tangents: (P, W, M, _f, _x, _x, _x)}
    return [partial(kernel.compile, signature) for kernel, signature in signatures.items()]


def _no_rows() -> Rows:
    x, n, table = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, 0))
    turns = np.zeros((0, 0, 0))
    return Rows(x, 0, x, n, n, table, table, table, table, turns, turns, table, table, table)
