"""Natural frequencies and modes, each named by its shape."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...case import Eigen
from ...elements.shape import Array
from ...model.model import Model
from ..state import State
from .classify import Classifier, Verdict
from .inputs_and_outputs import warnings_of
from .linearised import Linearised, small_motions
from .lowest_modes import Modes, characteristic, first_shift, lowest
from .projected import Complex, Quadratic
from .quadratic import AT_REST, Pairs, lowest_pairs, shift_of
from .relaxing import relaxing_pairs

# relative uncertainty of an eigenvalue that causes a warning
POOR = 1e-6
# the same, relative to elastic ones, of an eigenvalue that is zero
SURELY_ZERO = 1e-3
# real part, relative, that is round-off without damping
IMAGINARY = 1e-7


def solve_eigen(model: Model, spec: Eigen) -> Iterator[State]:
    """Yield the state about which the model vibrates, with its lowest modes: (K + s C + s^2 M) phi = 0.

    About the reference, loads do not act; about the static equilibrium they act at full size, and K is the tangent
    there, including load stiffness. In a rotating frame, the state is the equilibrium in it. Without C and with a
    symmetric K, s^2 = -omega^2 is real. Relaxing materials add a function of s to K.
    """
    turns = model.case.steady_rotation is not None
    small = small_motions(model, spec.about, "eigen")
    base = small.base
    real = base.model.symmetric and not turns and not (spec.damped and small.rates.damps)
    if spec.damped and small.relaxing:
        found = _relaxing(small, spec, real)
    else:
        found = (_real if real else _complex)(small, spec)
    model, state = base.model, base.state
    shapes = full_shapes(model, found.vectors)
    verdicts = Classifier(model, state.d)(shapes, found.zero)
    entries = frequencies(found, verdicts)
    state.report = {"frequencies": entries}
    state.arrays = {"modes/shapes": (shapes, "1", "mode shapes: rows of nodal coordinates, unit modal mass")}
    if found.quarter is not None:
        signs = np.array([largest_sign(model, v) for v in full_shapes(model, found.vectors, np.ones(len(shapes)))])
        state.arrays["modes/quarter"] = (full_shapes(model, found.quarter, signs), "1",
                                         "mode shapes a quarter of a period later")
    state.tables = {"modes": table(entries, verdicts)}
    state.warnings = [*state.warnings, *found.warnings, *warnings_of(small, spec.damped)]
    yield state


@dataclass
class Found:
    """Modes in the order of the report.

    ``s`` (m,): eigenvalues [1/s] with Im s >= 0; ``vectors`` (m, n_unknowns): real shapes of unit modal mass, at the
    phase of largest kinetic energy; ``quarter``: those a quarter of a period later, None if all points move in phase;
    ``zero`` (m,): whether the eigenvalue is zero to round-off; ``residual`` (m,).
    """

    s: Complex
    vectors: Array
    quarter: Array | None
    zero: NDArray[np.bool_]
    residual: Array
    warnings: list[str]


def _real(small: Linearised, spec: Eigen) -> Found:
    """Return undamped modes of a symmetric K: s = i omega, or a growth rate if K is indefinite."""
    modes = lowest(small.pencil_with_mass(), spec.modes)
    zero = np.abs(modes.values) <= modes.floor
    values = np.where(zero, 0.0, modes.values)
    s = np.where(values < 0.0, np.sqrt(np.abs(values)), 1j * np.sqrt(np.abs(values)))
    return Found(s, modes.vectors, None, zero, modes.error, mode_warnings(spec.modes, modes))


def _relaxing(small: Linearised, spec: Eigen, real: bool) -> Found:
    """Return pairs and real eigenvalues of relaxing materials, starting from the modes of the long-time modulus."""
    start, problem = (_real if real else _complex)(small, spec), Quadratic(small, relaxes=True)
    at_rest, moves = np.flatnonzero(start.zero), ~start.zero
    known = [*start.vectors[moves], *(() if start.quarter is None else start.quarter[moves])]
    pairs = relaxing_pairs(problem, known, int(moves.sum()) if real else spec.modes)
    s = np.concatenate([np.zeros(len(at_rest)), pairs.s])
    X = np.concatenate([start.vectors[at_rest].astype(complex), pairs.vectors])
    order = np.lexsort((np.abs(s), s.imag))
    phases = [problem.phases(x) for x in X[order]]
    vectors, quarter = (np.array([p[k] for p in phases]).reshape(len(order), small.n) for k in (0, 1))
    warnings = start.warnings if real else []
    if pairs.lost:
        warnings = [*warnings, f"{pairs.lost} eigenvalue{'s' * (pairs.lost > 1)} of viscoelastic materials "
                    f"{'were' if pairs.lost > 1 else 'was'} not found. Increase solver.modes"]
    return Found(s[order], vectors, quarter, (np.arange(len(s)) < len(at_rest))[order],
                 np.concatenate([start.residual[at_rest], pairs.gaps])[order], warnings)


def _complex(small: Linearised, spec: Eigen) -> Found:
    """Return the pairs that are complex because of damping, rotation or loads without a potential."""
    problem, pairs = pairs_of(small, spec.modes, spec.damped)
    s, X, zero, residual = pairs.s, pairs.vectors, pairs.rigid, pairs.residual
    if not (spec.damped and small.rates.damps):
        # without dissipation, small real parts are round-off; loads without a potential cause larger ones
        s = np.where(np.abs(s.real) <= IMAGINARY * np.abs(s), 1j * s.imag, s)
    order = np.lexsort((np.abs(s), s.imag))
    s, X, zero, residual = s[order], X[order], zero[order], residual[order]
    phases = [problem.phases(x) for x in X]
    vectors = np.array([one for one, _ in phases]).reshape(len(X), small.n)
    quarter = np.array([other for _, other in phases]).reshape(len(X), small.n)
    return Found(s, vectors, quarter, zero, residual, pair_warnings(spec.modes, pairs, s))


def pairs_of(small: Linearised, modes: int, damped: bool = True) -> tuple[Quadratic, Pairs]:
    """Return the quadratic problem of small motions and its lowest pairs."""
    problem = Quadratic(small, damped)
    pencil = small.pencil_with_mass()
    rest_limit = AT_REST * math.sqrt(characteristic(pencil))
    return problem, lowest_pairs(problem, modes, shift_of(problem, math.sqrt(first_shift(pencil))), rest_limit)


def full_shapes(model: Model, vectors: Array, signs: Array | None = None) -> Array:
    """Return shapes (m, n_q) in nodal coordinates of vectors (m, n_unknowns).

    Their largest displacement is positive, unless ``signs`` (m,) are given.
    """
    out = np.zeros((len(vectors), model.n_q))
    for k, (row, z) in enumerate(zip(out, vectors, strict=True)):
        row[:] = model.numbering.expanded(z)[:model.n_q]
        row *= largest_sign(model, row) if signs is None else signs[k]
    return out


def largest_sign(model: Model, shape: Array) -> float:
    """Return the sign of the largest displacement of a shape (n_q,)."""
    moved = model.weights * shape
    return math.copysign(1.0, moved[int(np.argmax(np.abs(moved) > 0.999 * np.abs(moved).max()))])


def frequencies(found: Found, verdicts: list[Verdict]) -> list[dict[str, Any]]:
    """Return the entries of ``frequencies``, lowest omega first.

    omega [rad/s] and growth [1/s] are the imaginary and the real part of the eigenvalue, hz = omega/(2 pi), damping =
    -Re s/|s|; kind, number within the kind, shares, gaps; residual, relative; strain: shares of the strain energy.
    """
    out = []
    for s, residual, verdict in zip(found.s.tolist(), found.residual.tolist(), verdicts, strict=True):
        damping = -s.real / abs(s) if s.real else 0.0
        out.append({"omega": s.imag, "hz": s.imag / (2 * math.pi), "growth": s.real or 0.0, "damping": damping,
                    "kind": verdict.kind, "number": 0, "shares": verdict.shares, "gaps": verdict.gaps,
                    "residual": residual, "strain": verdict.strain})
    renumber(out)
    return out


def renumber(entries: list[dict[str, Any]]) -> None:
    """Number the modes within their kinds, the lowest first and non-oscillating ones last."""
    numbers: Counter[str] = Counter()
    for entry in sorted(entries, key=lambda e: not e["omega"] and bool(e["growth"])):
        numbers[entry["kind"]] += 1
        entry["number"] = numbers[entry["kind"]]


def table(entries: list[dict[str, Any]], verdicts: list[Verdict]) -> dict[str, list[Any]]:
    """Return the modes as the columns of a table."""
    out: dict[str, list[Any]] = {k: [e[k] for e in entries]
                                 for k in ("omega", "hz", "growth", "damping", "kind", "number", "residual")}
    for share in entries[0]["shares"] if entries else ():
        out[share] = [e["shares"][share] for e in entries]
    out["gaps"] = [v.gaps for v in verdicts]
    out["functions_per_wave"] = [v.functions for v in verdicts]
    return out


def mode_warnings(wanted: int, modes: Modes) -> list[str]:
    """Return the warnings about real modes."""
    out = []
    if len(modes.values) < wanted:
        out.append(f"the model has {len(modes.values)} modes, not {wanted}")
    if modes.counted is False:
        out.append("the number of modes found differs from the count of eigenvalues: some modes may be missing")
    out += _unstable(int((modes.values < -modes.floor).sum()))
    # what is zero has no relative error, as long as it is small beside the other frequencies
    elastic = (np.abs(modes.values) > modes.floor) | (modes.error > SURELY_ZERO)
    worst = float(modes.error[elastic].max(initial=0.0))
    if worst > POOR:
        out.append(f"round-off limits the accuracy of the frequencies to about {0.5 * worst:.1g} of their values. "
                   "Fewer or longer elements give more digits")
    return out


def _unstable(growing: int) -> list[str]:
    return [f"{growing} of the modes grow: this state is unstable"] if growing else []


def pair_warnings(wanted: int, pairs: Pairs, s: Complex) -> list[str]:
    """Return the warnings about pairs; s (m,) are the reported eigenvalues."""
    out = []
    vibrating = int((s.imag > 0).sum())
    if vibrating < wanted and pairs.skipped:
        out.append(f"{vibrating} pairs converged instead of {wanted}. Reduce solver.modes, or use fewer or longer "
                   "elements")
    elif pairs.skipped:
        out.append(f"{pairs.skipped} pairs that lie among those listed did not converge and are left out. Use fewer or "
                   "longer elements")
    elif vibrating < wanted:
        out.append(f"{vibrating} pairs vibrate instead of {wanted}; all other motions decay or grow without "
                   "oscillating")
    if pairs.missing is None:
        out.append("the pairs could not be counted: some may be missing")
    elif pairs.missing > 0:
        out.append(f"{pairs.missing} more eigenvalues lie among those listed: further real ones, or missing pairs")
    if pairs.hidden:
        out.append("round-off of the stiffness hides the lowest pairs, which may be wrong. Fewer or longer elements "
                   "give more digits; if damping is all that acts, damped: false gives the frequencies without it")
    out += _unstable(int((s.real > IMAGINARY * np.abs(s)).sum()))
    worst = float(pairs.residual.max(initial=0.0))
    if worst > POOR:
        out.append(f"the residual of the eigenvalues is up to {worst:.1g}. Fewer or longer elements give more digits")
    return out
