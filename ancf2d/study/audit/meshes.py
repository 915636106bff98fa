"""Checks over meshes: orders of convergence, limits, spurious modes, damping of modes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...elements.shape import Array
from ...errors import percent
from ...model.model import Model
from ..order import Estimate, estimate
from .fields import beam, rigidly_moved, stiffness, timoshenko_deflection, tip_deflection
from .locking import REFERENCE
from .subject import FAIL, NOTE, PASS, ROUND_OFF, Finding, Subject, subject

MESHES = (2, 4, 8, 16, 32)
# relative distance of the limit from beam theory beyond which it is wrong
WRONG = 0.02
# least order expected of a beam element
LEAST = 1.8
# length of a simply supported beam, elements, and modes among which a spurious branch is sought
SPAN, BRANCH, MODES = 5.0, (16, 32, 64), 40
# a frequency falls if it is below this share of itself on the next coarser mesh
FALLS = 0.9


def _judge(f: list[float], meshes: list[float], exact: float, what: str) -> Finding:
    """Return the finding for a quantity over meshes: its order, and the distance of its limit from beam theory."""
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
    """Return omega of the lowest spurious mode, its share of energy in gaps, and omega of the first bending mode.

    The first is None if no spurious mode is among the lowest modes.
    """
    held = [{"type": "pin", "at": "beam@0"}, {"type": "roller", "at": "beam@1", "fixed": "y"}]
    modes = _modes(s.model(SPAN, count, {"type": "eigen", "modes": MODES}, boundary_conditions=held))
    bending = next((m["omega"] for m in modes if m["kind"] == "bending"), math.nan)
    wrong = [m for m in modes if m["kind"] == "spurious"]
    return (wrong[0]["omega"], wrong[0]["gaps"], bending) if wrong else (None, 0.0, bending)


def spurious_branch(s: Subject) -> Finding:
    """Examine whether spurious modes fall among the lowest modes of a beam as the mesh is refined."""
    counts = sorted({s.affordable(n, 2000) for n in BRANCH})
    found = [lowest_spurious(s, n) for n in counts]
    last, gaps, bending = found[-1]
    if last is None:
        return Finding(None, PASS, f"the lowest {MODES} modes are those of the beam ({counts[-1]} elements, length "
                       "5 h)")
    value = last / bending
    if last == 0.0:
        return Finding(0.0, FAIL, "modes that deform without strain energy are among the lowest on every mesh")
    before = found[-2][0]
    if before is not None and last >= FALLS * before:
        return Finding(value, PASS, "spurious modes lie above those of the beam and rise under refinement")
    power = "" if before is None else f", like n^{math.log(last / before) / math.log(counts[-1] / counts[-2]):.2f}"
    why = f", with {percent(gaps)} of their energy in gaps between elements" if gaps > 0.0 else ""
    return Finding(value, FAIL, f"spurious modes fall under refinement{power}{why}; the lowest frequency is "
                   f"{value:.3g} times the first bending frequency with {counts[-1]} elements")


# Rayleigh's alpha [1/s] and beta [s], and the retardation time tau [s]: damping ratios of some percent
ALPHA, BETA, TAU = 1e-3, 0.04, 0.06
PAIRS = 4
# relative error of a damping ratio due to round-off of the eigenvalues
EXACT = 1e-7
ANGLES = (0.0, 0.9, -2.4)


def damping(s: Subject) -> Finding:
    """Examine whether damping ratios are alpha/(2 omega) + (beta + tau) omega/2, and viscous forces of rigid motion."""
    off, resists = _ratios_off(s), _resists_spinning(s)
    if not off <= EXACT:
        return Finding(off, FAIL, "damping ratios differ from alpha/(2 omega) + (beta + tau) omega/2, so the damping "
                       "matrix is not alpha M + (beta + tau) K")
    if not resists <= ROUND_OFF:
        return Finding(resists, FAIL, "Kelvin-Voigt damping resists rigid motion (force per viscosity and velocity)")
    return Finding(max(off, resists), PASS, "damping ratios are alpha/(2 omega) + (beta + tau) omega/2; rigid motion "
                   "is not resisted")


def _ratios_off(s: Subject) -> float:
    """Return the largest relative error of the damping ratios of the lowest pairs, and of the assembled matrix C.

    Pairs are computed through the strains; factorisations and reduced models use the assembled matrix.
    """
    from ...solvers.small_motions.eigen import pairs_of
    from ...solvers.small_motions.linearised import small_motions

    model = s.model(10.0, 2, {"type": "eigen", "modes": PAIRS}, tau=TAU,
                    boundary_conditions=[{"type": "clamp", "at": "beam@0", "hold": "all"}],
                    damping={"rayleigh": {"alpha": ALPHA, "beta": BETA}})
    small = small_motions(model, "reference", "eigen")
    plain, damped = (pairs_of(small, PAIRS, acts)[1].s for acts in (False, True))
    omega = np.sort(np.abs(plain[plain.imag > 0.0]))
    damped = damped[np.argsort(np.abs(damped))]
    if len(omega) != len(damped) or not len(omega):
        return float("inf")
    ratio = ALPHA / (2 * omega) + (BETA + TAU) * omega / 2
    moved, w = model.numbering.free < model.n_q, model.weights[model.numbering.free]
    C, due = (A.toarray()[np.ix_(moved, moved)] / np.outer(w[moved], w[moved])
              for A in (small.C, ALPHA * small.M + (BETA + TAU) * small.K))
    return max(float(np.abs(-damped.real / np.abs(damped) / ratio - 1).max()),
               float(np.abs(C - due).max() / np.abs(due).max()))


def _resists_spinning(s: Subject) -> float:
    """Return the largest viscous force of rigid velocities of a deformed, rotated body, relative to strain rates."""
    from ...solvers.small_motions.linearised import RateForces

    model = s.model(3.0, 2, {"type": "eigen", "modes": 1}, tau=TAU)
    rates, w = RateForces(model), model.weights
    scale = TAU * float(np.abs(stiffness(model) / np.outer(w, w)).max())
    bent = 0.1 * np.random.default_rng(1).uniform(-1, 1, model.n_q) / w
    worst = 0.0
    for angle in ANGLES:
        d = rigidly_moved(model, bent, angle)
        for v in _rigid_velocities(model, d):
            Q = rates.viscous_forces(d, v)[:model.n_q]
            worst = max(worst, float(np.abs(Q / w).max() / (scale * np.abs(w * v).max())))
    return worst


def _rigid_velocities(model: Model, d: Array) -> Array:
    """Return the coordinate rates (3, n_q) of two translations and a rotation about the origin, at d (n_q,)."""
    kinds, e, still = beam(model).kinds, model.e0 + d, np.zeros(model.n_q)
    first = np.flatnonzero((kinds == 0) | (kinds == 3))
    spin = np.where(kinds == 2, 1.0, 0.0)
    spin[first], spin[first + 1] = -e[first + 1], e[first]
    return np.stack([rigidly_moved(model, still, 0.0, (1.0, 0.0)), rigidly_moved(model, still, 0.0, (0.0, 1.0)), spin])
