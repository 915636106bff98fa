"""Formulas of a case as laws take them: programs of local quantities, known by their address."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..case import jets
from ..case.programs import state_programs
from ..case.syntax import Tree
from ..elements.point_laws import FORMULAS, RUN
from ..elements.shape import Array
from ..errors import ComputationError

# each record by its address, with the formulas as the case has them and the names of the quantities
_TOLD: dict[float, tuple[Any, Sequence[str], Sequence[str]]] = {}


def formula_record(trees: Sequence[Tree], names: Sequence[str], texts: Sequence[str]) -> Any:
    """Return functions of local quantities as a record, which laws know by its ``address`` from now on.

    ``texts`` are the functions as messages tell them.
    """
    from ..kernels.compiled_laws import formula
    from ..kernels.lowlevel.records import Record

    meaning = {name: k for k, name in enumerate(names)}
    record = Record(formula(state_programs([(tree, 1.0) for tree in trees], meaning, len(names)), len(names)))
    FORMULAS[record.address] = record.values
    _TOLD[float(record.address)] = record, texts, names
    RUN[:] = [jets.run_with_gradient]
    return record


def check_formulas(patches: Iterable[Any], d: Array, v: Array, t: float) -> None:
    """Raise the ComputationError of a formula without a value among point laws, at d with rates v (n_full,)."""
    for items in (patch.items() for patch in patches):
        for k, par in enumerate(items.par):
            found = [x for x in par.tolist() if x in _TOLD]
            if not found:
                continue
            m = len(items.p0[k])
            f, H, C = np.zeros(m), np.zeros((m, m)), np.zeros((m, m))
            with np.errstate(all="ignore"):
                items.law.forces(items.p0[k], items.G[k] @ d[items.dofs[k]], items.G[k] @ v[items.dofs[k]], par,
                                 np.array([1.0, t, 0.0]), items.mem[k].copy(), f, H, C)
            if not np.isfinite(f).all():
                raise _without_value(found[0], f, t)


def _without_value(address: float, f: Array, t: float) -> ComputationError:
    record, texts, names = _TOLD[address]
    told = {name: float(f"{x:.6g}") for name, x in zip(names, record.values.values, strict=True)}
    text = texts[min(int(np.flatnonzero(~np.isfinite(f))[0]), len(texts) - 1)]
    return ComputationError(f"the formula '{text}' has no value: it divides by zero, or a square root or a power is "
                            "not real", at={"t": t, **{k: x for k, x in told.items() if k != "t"}},
                            advice="guard the formula with 'a if c else b'")
