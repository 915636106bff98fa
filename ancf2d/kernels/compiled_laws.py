"""Strain laws and point laws, each compiled on its own and called by address, so that other kernels compile only once.

A strain law works on the rows of one point in a work buffer (``lanes.PointRows``); a number selects its operation. Laws
with memory get the numbers of reference values and state variables of a point as arguments, so that one compiled law
serves any number of fibres or Maxwell terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from types import CellType, CodeType, FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..case import jets
from ..elements import point_laws
from ..elements.formulations.base import StrainLaw
from ..elements.point_laws import PointLaw
from .lanes import point_rows
from .lowlevel.arrays import array, vector
from .lowlevel.jit import addressed, inlined, inner, merged, seldom
from .lowlevel.records import address_of, at, caller, rows, table, type_of
from .motion.state import evaluate_with_gradient

# operations of a law; each reads and writes rows of one point (``lanes.PointRows``)
STRAIN, GEOMETRIC, MEAN, STRESS, PUSH, PULL, D_J, J_D_J, SUBTRACT_INTERNAL, ELASTIC_JACOBIAN, SUBTRACT_SLOPE = range(11)


def _no_mean(ref, u0, u1, eps0, eps1, J, lanes):  # type: ignore[no-untyped-def]
    # mark as not available; other zero entries of J must stay zero for later operations
    for l in range(lanes):
        J[0, 0, l] = np.nan


@merged
def _matrix_vector(A, x, out, m, n, lanes):  # type: ignore[no-untyped-def]
    for l in range(lanes):
        for i in range(m):
            v = 0.0
            for j in range(n):
                v += A[i, j, l] * x[j, l]
            out[i, l] = v


@merged
def _transposed_vector(A, x, out, m, n, lanes):  # type: ignore[no-untyped-def]
    for l in range(lanes):
        for j in range(n):
            v = 0.0
            for i in range(m):
                v += A[i, j, l] * x[i, l]
            out[j, l] = v


@merged
def _matrix_matrix(A, B, out, m, n, k, lanes):  # type: ignore[no-untyped-def]
    for i in range(m):
        for l in range(lanes):
            for j in range(k):
                v = 0.0
                for r in range(n):
                    v += A[i, r, l] * B[r, j, l]
                out[i, j, l] = v


@merged
def _transposed_matrix(A, B, out, m, n, k, lanes):  # type: ignore[no-untyped-def]
    for i in range(n):
        for l in range(lanes):
            for j in range(k):
                v = 0.0
                for r in range(m):
                    v += A[r, i, l] * B[r, j, l]
                out[i, j, l] = v


@merged
def _subtract(x, y, m, lanes):  # type: ignore[no-untyped-def]
    for i in range(m):
        for l in range(lanes):
            x[i, l] -= y[i, l]


@merged
def _subtract_from(A, B, m, n, lanes):  # type: ignore[no-untyped-def]
    for i in range(m):
        for j in range(n):
            for l in range(lanes):
                B[i, j, l] = A[i, j, l] - B[i, j, l]


def _any_size(law: StrainLaw) -> StrainLaw:
    """Return a law with memory in the form in which it is compiled for any number of state variables."""
    return replace(law, references=0, state=1, extra_energy=None) if law.state and not law.elastic else law


def _operations_of(law: StrainLaw) -> Any:
    NU, NS, NR, NM = law.fields, law.strains, law.references, law.state
    grows = bool(law.state) and not law.elastic
    # internal strains, of laws with memory
    NI = NS if law.state else 0
    # inlined, so that LLVM sees that rows are a constant distance apart
    strain, geometric, mean = (_seen_whole(f) for f in (law.strain, law.geometric, law.mean or _no_mean))

    def operate(what, work, base, references, state, lanes):  # type: ignore[no-untyped-def]
        R, S = (references, state) if grows else (NR, NM)
        at = point_rows(NU, NS, R, S)
        ref, u, u0 = rows(work, base + at.ref, R), rows(work, base + at.u, NU), rows(work, base + at.u0, NU)
        eps, eps0 = rows(work, base + at.eps, NS), rows(work, base + at.eps0, NS)
        t, sigma, g = rows(work, base + at.t, NS), rows(work, base + at.sigma, NS), rows(work, base + at.g, NU)
        J, DJ = table(work, base + at.J, NS, NU), table(work, base + at.DJ, NS, NU)
        D, H = table(work, base + at.D, NS, NS), table(work, base + at.H, NU, NU)
        JE, slope = table(work, base + at.JE, NS, NU), table(work, base + at.slope, NI, NI)
        if what == STRAIN:
            strain(ref, u, eps, J, lanes)
        elif what == GEOMETRIC:
            geometric(ref, u, sigma, J, H, lanes)
        elif what == MEAN:
            mean(ref, u0, u, eps0, eps, J, lanes)
        elif what == STRESS:
            _matrix_vector(D, eps, t, NS, NS, lanes)
        elif what == PUSH:
            _matrix_vector(J, u0, eps0, NS, NU, lanes)
        elif what == PULL:
            _transposed_vector(J, sigma, g, NS, NU, lanes)
        elif what == D_J:
            _matrix_matrix(D, JE, DJ, NS, NS, NU, lanes)
        elif what == J_D_J:
            _transposed_matrix(J, DJ, H, NS, NU, NU, lanes)
        elif what == SUBTRACT_INTERNAL:
            # ``evaluate_internal`` has filled state and slope
            _subtract(eps, rows(work, base + at.new, NI), NI, lanes)
        elif what == ELASTIC_JACOBIAN:
            _matrix_matrix(slope, J, JE, NI, NI, NU, lanes)
            _subtract_from(J, JE, NI, NU, lanes)
        else:
            _matrix_vector(slope, eps, t, NI, NI, lanes)
            _subtract(eps, t, NI, lanes)

    # the name in the cache
    operate.__qualname__ = f"operate_{law.strain.__module__.rpartition('.')[2]}_{law.strain.__name__}"
    return addressed(operate)


SIGNATURE = types.void(types.int64, types.float64[::1], types.int64, types.int64, types.int64, types.int64)
operate = caller(SIGNATURE)


@cache
def _compiled(law: StrainLaw) -> tuple[Any, int]:
    function = _operations_of(law)
    return function, address_of(function, SIGNATURE)


def law_address(law: StrainLaw) -> int:
    """Return the address of a law's operations, compiled on first use."""
    return _compiled(_any_size(law))[1]


_INTERNAL = types.void(*[types.float64[:, ::1]] * 4, types.float64[:, :, ::1], types.int64)
_internal = caller(_INTERNAL)


@cache
def _compiled_internal(internal: Any) -> tuple[Any, int]:
    copy = _copied(internal)
    _connect(copy)
    compiled = addressed(copy)
    return compiled, address_of(compiled, _INTERNAL)


def internal_address(law: StrainLaw) -> int:
    """Return the address of a law's function of internal strains, compiled once for all laws that share it, or 0."""
    return 0 if law.internal is None else _compiled_internal(law.internal)[1]


@inner
def evaluate_internal(law, at, work, base, lanes):  # type: ignore[no-untyped-def]
    """Compute the new state and the slope of one point of a law with memory from its strains; ``at``: its ``Slots``."""
    _internal(law.internal, (
        rows(work, base + at.ref, law.references), rows(work, base + at.eps, law.strains),
        rows(work, base + at.old, law.state), rows(work, base + at.new, law.state),
        table(work, base + at.slope, law.strains, law.strains), lanes))


class Formula(NamedTuple):
    """Functions of n quantities in a record that laws take by address: arguments, results of ``evaluate_formula``."""

    programs: Any
    values: Any
    out: Any


def formula(programs: Any, n: int) -> Formula:
    """Return the record of functions of n quantities, with room for arguments and results."""
    return Formula(programs, np.zeros(n), np.zeros(1 + n))


_no_numbers = np.zeros(0, dtype=np.int64)
_FORMULA = type_of(formula(jets.Programs(_no_numbers, _no_numbers, _no_numbers, np.zeros(0), np.zeros(2),
                                         _no_numbers, _no_numbers, np.zeros((0, 0))), 0))
_formula_record = at(_FORMULA)


@inlined
def _formula_at(address):  # type: ignore[no-untyped-def]
    return _formula_record(int(address))


@inlined
def _evaluate_formula(formula, k, s):  # type: ignore[no-untyped-def]
    evaluate_with_gradient(formula.programs, k, s, formula.values, formula.out)


# compiled versions of the functions that laws may call
_PARTS: dict[Any, Any] = {
    point_laws.formula_at: _formula_at, point_laws.evaluate_formula: _evaluate_formula,
    point_laws.work_vector: vector, point_laws.work_matrix: array}
# numba compiles functions of these packages itself
_KNOWN = ("numba", "numpy", "scipy", "math")


def part(function: Callable[..., Any]) -> Any:
    """Return the compiled version of a function used by laws; it and those that it calls are compiled only once."""
    if function not in _PARTS:
        copy = _copied(function)
        _PARTS[function] = inner(copy)
        _connect(copy)
    return _PARTS[function]


@cache
def _seen_whole(function: Callable[..., Any]) -> Any:
    """Return a version of a law's function for inlining into a kernel; the functions it calls are ``part``s."""
    copy = _copied(function)
    _connect(copy)
    return merged(copy)


def _copied(function: Any) -> Any:
    """Return a copy of a function with its own globals and closure."""
    cells = tuple(CellType(c.cell_contents) for c in function.__closure__ or ())
    copy = FunctionType(function.__code__, dict(function.__globals__), function.__name__, function.__defaults__, cells)
    copy.__qualname__ = function.__qualname__
    return copy


def _connect(copy: Any) -> None:
    """Replace the plain functions that a copied function calls by their compiled versions (``part``)."""
    known = copy.__globals__
    for name in _names(copy.__code__):
        if _is_plain(known.get(name)):
            known[name] = part(known[name])
    for cell in copy.__closure__ or ():
        if _is_plain(cell.cell_contents):
            cell.cell_contents = part(cell.cell_contents)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _is_plain(value: Any) -> bool:
    return isinstance(value, FunctionType) and value.__module__.partition(".")[0] not in _KNOWN


_v, _m = types.float64[::1], types.float64[:, ::1]
_FORCES = types.UniTuple(types.float64, 2)(_v, _v, _v, _v, _v, _v, _v, _m, _m)
_MEAN = types.UniTuple(types.float64, 2)(_v, _v, _v, _v, _v, _v, _v, _v, _v)
_ACCEPT = types.void(_v, _v, _v, _v)
# for many items together: a row of constants and of history for each
_FORCES_OF_RUN = types.UniTuple(types.float64, 2)(_v, _v, _v, _m, _v, _m, _v, _m, _m)
_ACCEPT_RUN = types.void(_v, _v, _m, _m)
call_forces, call_mean, call_accept = caller(_FORCES), caller(_MEAN), caller(_ACCEPT)
call_forces_of_run, call_accept_run = caller(_FORCES_OF_RUN), caller(_ACCEPT_RUN)


@cache
def _compiled_point_law(law: PointLaw, what: str) -> tuple[Any, int]:
    """Return one compiled function of a law with its address, which is valid as long as the function lives."""
    law_of = part(getattr(law, what))

    def forces(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
        energy, power = law_of(p0, u, w, par, a, mem, f, H, C)
        return float(energy), float(power)

    def mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
        energy, power = law_of(p0, u0, u1, w, par, a0, a1, mem, f)
        return float(energy), float(power)

    def accept(p0, u, par, mem):  # type: ignore[no-untyped-def]
        law_of(p0, u, par, mem)

    function: Any
    function, signature = {"forces": (forces, _FORCES), "mean": (mean, _MEAN), "accept": (accept, _ACCEPT),
                           "forces_of_run": (forces, _FORCES_OF_RUN), "accept_run": (accept, _ACCEPT_RUN)}[what]
    # the name in the cache
    function.__qualname__ = f"{what}_{law.name}"
    compiled = addressed(seldom(function) if what.startswith("accept") else function)
    return compiled, address_of(compiled, signature)


def _wanted(law: PointLaw, steps: bool) -> list[str]:
    """Return the names of the functions of a law that are needed; ``steps``: forces of conserving steps too."""
    return ["forces", *(["mean"] if steps else []),
            *(name for name in ("accept", "forces_of_run", "accept_run") if getattr(law, name) is not None)]


def point_law_compilations(law: PointLaw, steps: bool) -> list[Callable[[], object]]:
    """Return one callable per function of a law, which compiles it; ``steps``: forces of conserving steps too."""
    return [partial(_compiled_point_law, law, what) for what in _wanted(law, steps)]


def point_law_addresses(law: PointLaw, steps: bool) -> list[int]:
    """Return the addresses of forces, mean, accept, forces_of_run and accept_run of a law, 0 for those it lacks.

    mean, the forces of a conserving step, is 0 without ``steps``.
    """
    found = {what: _compiled_point_law(law, what)[1] for what in _wanted(law, steps)}
    return [found.get(what, 0) for what in ("forces", "mean", "accept", "forces_of_run", "accept_run")]
