"""Checks over meshes: orders of convergence, limits, and modes that belong to the mesh."""

from __future__ import annotations

import math
from typing import Any

from ..order import Estimate, estimate
from .deflections import timoshenko_deflection, tip_deflection
from .finding import FAIL, NOTE, PASS, Finding, percent
from .locking import REFERENCE
from .subject import Subject, subject

MESHES = (2, 4, 8, 16, 32)
# distance of the limit from beam theory beyond which it is a wrong one
WRONG = 0.02
# orders from here on are what a beam element should have at least
LEAST = 1.8
# simply supported beam, elements and modes among which a spurious branch is sought
SPAN, BRANCH, MODES = 5.0, (16, 32, 64), 40
# a frequency falls where a mesh twice as fine has less than this of it
FALLS = 0.9


def _judge(f: list[float], meshes: list[float], exact: float, what: str) -> Finding:
    """Return the finding of a quantity over meshes: order, and distance of its limit from the beam's."""
    e: Estimate = estimate(meshes, f, abs(f[-1]))
    limit = f[-1] if e.value is None else e.value
    off = limit / exact - 1
    where = f"limit {percent(off)} {'above' if off > 0 else 'below'} Timoshenko's {what}"
    if abs(off) > WRONG:
        return Finding(e.order, FAIL, f"converges to a wrong limit: {where}")
    if e.order is None:
        return Finding(None, PASS if e.asymptotic else NOTE, f"{e.note}; {where}")
    if not e.asymptotic:
        return Finding(e.order, NOTE, f"{e.note.partition(';')[0]}; {where}")
    if e.order < LEAST:
        return Finding(e.order, FAIL, f"converges slowly, with order {e.order:.2f}; {where}")
    return Finding(e.order, PASS, f"converges with order {e.order:.2f}; {where}")


def order_static(s: Subject) -> Finding:
    """Examine the tip deflection of a cantilever, L/h = 10, over meshes."""
    section = s.chosen.section
    counts = sorted({s.affordable(n, 6000) for n in MESHES})
    f = [tip_deflection(s, 10.0, n) for n in counts]
    exact = timoshenko_deflection(section, 10.0, section.kGA)
    return _judge(f, [float(n) for n in counts], exact, "deflection")


def _lowest_bending(s: Subject, count: int) -> float:
    model = s.model(10.0, count, {"type": "eigen", "modes": 6}, boundary_conditions=[s.wall])
    return next(m["omega"] for m in _modes(model) if m["kind"] == "bending")


def _modes(model: Any) -> list[dict[str, Any]]:
    from ...solvers.registry import solve

    found: list[dict[str, Any]] = list(solve(model))[-1].report["frequencies"]
    return found


def order_eigen(s: Subject) -> Finding:
    """Examine the first bending frequency of a cantilever, L/h = 10, over meshes."""
    exact = _lowest_bending(subject(REFERENCE), 64)
    counts = sorted({s.affordable(n, 3000) for n in MESHES})
    try:
        f = [_lowest_bending(s, n) for n in counts]
    except StopIteration:
        return Finding(None, FAIL, "no bending mode among the lowest six: modes without strain energy take their place")
    return _judge(f, [float(n) for n in counts], exact, "frequency")


def lowest_spurious(s: Subject, count: int) -> tuple[float | None, float, float]:
    """Return omega of the lowest mode that belongs to the mesh, its share in gaps, and omega of the first bending mode.

    None where the lowest modes have no such.
    """
    held = [{"type": "pin", "at": "beam@0"}, {"type": "roller", "at": "beam@1", "fixed": "y"}]
    modes = _modes(s.model(SPAN, count, {"type": "eigen", "modes": MODES}, boundary_conditions=held))
    bending = next((m["omega"] for m in modes if m["kind"] == "bending"), math.nan)
    wrong = [m for m in modes if m["kind"] == "spurious"]
    return (wrong[0]["omega"], wrong[0]["gaps"], bending) if wrong else (None, 0.0, bending)


def spurious_branch(s: Subject) -> Finding:
    """Examine the lowest modes of a beam over meshes for such as belong to the mesh and come down with it."""
    counts = sorted({s.affordable(n, 2000) for n in BRANCH})
    found = [lowest_spurious(s, n) for n in counts]
    last, gaps, bending = found[-1]
    if last is None:
        return Finding(None, PASS, f"the lowest {MODES} modes are the beam's on {counts[-1]} elements of a beam of 5 h")
    value = last / bending
    if last == 0.0:
        return Finding(0.0, FAIL, "modes that deform without strain energy are among the lowest on every mesh")
    before = found[-2][0]
    if before is not None and last >= FALLS * before:
        return Finding(value, PASS, "modes of the mesh lie above those of the beam, and rise as it is refined")
    power = "" if before is None else f", like n^{math.log(last / before) / math.log(counts[-1] / counts[-2]):.2f}"
    why = f", {percent(gaps)} of their energy in gaps" if gaps > 0.0 else ""
    return Finding(value, FAIL, f"modes of the mesh fall with refinement{power}{why}; the lowest is {value:.3g} times "
                   "the "
                   f"first bending mode on {counts[-1]} elements")
