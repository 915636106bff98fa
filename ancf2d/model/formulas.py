"""Formulas of a case as laws take them: programs of local quantities, known by their address."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..case import jets
from ..case.programs import state_programs
from ..case.syntax import Tree
from ..elements.point_laws import FORMULAS, RUN


def formula_record(trees: Sequence[Tree], names: Sequence[str]) -> Any:
    """Return functions of local quantities as a record, which laws know by its ``address`` from now on."""
    from ..kernels.compiled_laws import formula
    from ..kernels.lowlevel.records import Record

    meaning = {name: k for k, name in enumerate(names)}
    record = Record(formula(state_programs([(tree, 1.0) for tree in trees], meaning, len(names)), len(names)))
    FORMULAS[record.address] = record
    RUN[:] = [jets.run_with_gradient]
    return record
