"""Signals evaluated in compiled code: values and two time derivatives."""

from __future__ import annotations

from numba.extending import register_jitable

from ..case import jets
from .lowlevel.jit import kernel

for _function in (jets.compare, jets.power_jet, jets.function_jet, jets.table_jet, jets.time_jet, jets.binary_jet):
    register_jitable(_function)

_run = kernel(jets.run)


@kernel
def evaluate(programs, t, out):  # type: ignore[no-untyped-def]
    """Fill out (n, 3) with every function of ``case.programs.programs`` at t and its two derivatives by t.

    At a corner or jump the values are those to its right, but never those of a time outside the programs' window.
    Where there is no finite value the entry is nan; the Python signal says why.
    """
    t = min(max(t, programs.window[0]), programs.window[1])
    for k in range(len(programs.first) - 1):
        _run(programs, k, t, out, k)
