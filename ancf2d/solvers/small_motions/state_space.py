"""Small motions as a linear model x' = A x + B u, y = C x + D u, for the design of controllers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...case import StateSpace
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..iterative_refinement import refined
from ..state import State
from .eigen import mode_warnings, pair_warnings, pairs_of
from .factors import Factors
from .inputs_and_outputs import Input, Inputs, warnings_of
from .inputs_and_outputs import outputs as probe_outputs
from .linearised import Linearised, small_motions
from .lowest_modes import find_shift, lowest, map_rows
from .projected import Complex, Quadratic
from .relaxing import Projected

# largest number of iterations of a solve with a shifted stiffness, and the relative correction that ends them
ROUNDS, SETTLED = 200, 1e-13
# relative shift of a matrix from an eigenvalue, so that it can be factored
SHIFT = 1e-10
# a response is added as a vector if more than this share of it is independent of modes and other responses
INDEPENDENT_SHARE = 1e-4
UNITS = "consistent units; u = 1 is the load or motion of the case"


@dataclass
class LinearModel:
    """x' = A x + B u, y = C x + D u: A (n, n), B (n, inputs), C (outputs, n), D (outputs, inputs), names of x (n,).

    ``rate_feedthrough`` (outputs, inputs) is the coefficient of u' in outputs that are rates, which D cannot contain.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: list[str]
    rate_feedthrough: Array


def solve_state_space(model: Model, spec: StateSpace) -> Iterator[State]:
    """Yield the state about which the model moves, with the linear model of small motions about it.

    A prescribed motion is an input as a displacement. If outputs depend directly on its rate, that is an additional
    input.
    """
    small = small_motions(model, spec.about, "state_space")
    base = small.base
    inputs, outputs = Inputs(small)(spec.inputs), _Outputs(small, spec.outputs)
    form = _relaxing if small.relaxing else _symmetric if base.model.symmetric else _unsymmetric
    found, warnings = form(small, spec, inputs, outputs)
    names = _with_rates(found, list(spec.inputs), [k for k, one in enumerate(inputs) if one.name not in model.inputs])
    state = base.state
    entries = poles(found.A)
    state.report = {"state_space": {"inputs": names, "outputs": list(spec.outputs),
                                    "states": found.states, "poles": entries}}
    state.arrays = {f"state_space/{name}": (data, UNITS, text) for name, data, text in (
        ("A", found.A, "x' = A x + B u: rows and columns are the states x"),
        ("B", found.B, "x' = A x + B u: rows are the states x, columns the inputs u"),
        ("C", found.C, "y = C x + D u: rows are the outputs y, columns the states x"),
        ("D", found.D, "y = C x + D u: rows are the outputs y, columns the inputs u"))}
    state.tables = {"inputs": {"input": names}, "outputs": {"output": list(spec.outputs)},
                    "states": {"state": found.states},
                    "poles": {k: [p[k] for p in entries] for k in ("omega", "hz", "growth", "damping")}}
    state.warnings = [*state.warnings, *warnings, *warnings_of(small, inputs=inputs)]
    yield state


def _with_rates(found: LinearModel, names: list[str], motions: list[int]) -> list[str]:
    """Add the rates of motions to the inputs if outputs depend on them directly; return all names."""
    if not found.rate_feedthrough[:, motions].any():
        return names
    found.B = np.hstack([found.B, np.zeros((len(found.B), len(motions)))])
    found.D = np.hstack([found.D, found.rate_feedthrough[:, motions]])
    return [*names, *(f"{names[k]}.rate" for k in motions)]


def poles(A: Array) -> list[dict[str, float]]:
    """Return the eigenvalues of A, one of each pair, lowest abs(s) first, as omega, hz, growth and damping."""
    s = np.linalg.eigvals(A)
    s = s[s.imag >= 0.0]
    out = []
    for one in s[np.argsort(np.abs(s), kind="stable")].tolist():
        out.append({"omega": one.imag, "hz": one.imag / (2 * math.pi), "growth": one.real or 0.0,
                    "damping": -one.real / abs(one) if one.real else 0.0})
    return out


class _Outputs:
    """Quantities of probes, linearised in the changes of the coordinates; ``rates`` (outputs,): whether velocities."""

    def __init__(self, small: Linearised, names: tuple[str, ...]) -> None:
        known = {f"{one.probe}.{one.quantity}": one for one in probe_outputs(small)}
        self.num, self.items = small.model.numbering, [known[name] for name in names]
        self.rates = np.array([one.order > 0 for one in self.items])

    def __call__(self, X: Array) -> Array:
        """Return the outputs (outputs, k) of changes X (k, n) of the unknowns, or of their rates."""
        return self._of(np.array([self.num.expanded(x) for x in X]).reshape(len(X), len(self.num.place)))

    def _of(self, d: Array) -> Array:
        return np.array([d[:, one.coords] @ one.weights[one.order] for one in self.items])

    def static(self, inputs: list[Input], X: Array) -> Array:
        """Return the outputs (outputs, inputs) of responses X (inputs, n) and the motion of the inputs themselves.

        Rates are those of responses to u' = 1.
        """
        return self(X) + self._of(np.array([i.p for i in inputs]))


def _symmetric(small: Linearised, spec: StateSpace, inputs: list[Input], outputs: _Outputs
               ) -> tuple[LinearModel, list[str]]:
    """Return the model in modal coordinates q of the undamped problem, with the static residual psi u of other modes.

    z = psi u + q Phi leads to q'' + C_r q' + K_r q = f0 u + (f1 - Phi C psi) u' + f2 u''. With x = [q - f2 u, q' - f2
    u' - b u], b = f1 - Phi C psi - C_r f2, no derivatives of u are left. For loads, f1 = f2 = 0.
    """
    modes = lowest(small.pencil_with_mass(), spec.modes)
    free = np.abs(modes.values) <= modes.floor
    Phi, m, damping = modes.vectors, len(modes.values), small.C
    values = np.where(free, 0.0, modes.values)
    K, C = np.diag(values), Phi @ (damping @ Phi.T)
    f0, f1, f2 = (np.array([i.f for i in inputs]) @ Phi.T).transpose(1, 2, 0)
    psi = _residual_responses(small, Phi, inputs) if free.any() else _static(small, inputs) - (f0.T / values) @ Phi
    b = f1 - Phi @ (damping @ psi.T) - C @ f2
    y, rates = outputs(Phi), outputs.rates[:, None]
    rest = outputs.static(inputs, psi) + y @ f2
    found = LinearModel(np.block([[np.zeros((m, m)), np.eye(m)], [-K, -C]]), np.vstack([b, f0 - C @ b - K @ f2]),
                        np.hstack([np.where(rates, 0.0, y), np.where(rates, y, 0.0)]),
                        np.where(rates, y @ b, rest),
                        [f"q{k}{rate}" for rate in ("", "'") for k in range(1, m + 1)], np.where(rates, rest, 0.0))
    return found, mode_warnings(spec.modes, modes)


def _unsymmetric(small: Linearised, spec: StateSpace, inputs: list[Input], outputs: _Outputs
                 ) -> tuple[LinearModel, list[str]]:
    """Return the model in modal coordinates p of the pairs s, x and left vectors y: p' = s p + y^T f(s) u.

    With y^T (C + 2 s M) x = 1, the response is the sum of p x over all s, and the states are [Re p, Im p] of each pair.
    f(s) = f0 + s f1 + s^2 f2: its difference from f(s') at another s' consists of powers of s' that cancel in the sum
    over all modes.
    """
    problem, pairs = pairs_of(small, spec.modes)
    if pairs.rigid.any():
        raise ComputationError("free rigid motions cannot be separated from the other motions under follower loads",
                               at={"solver": "state_space"}, advice="a support, joint or spring")
    force, blocks, states = np.array([i.f for i in inputs]), [], []
    rows: list[tuple[Array, Array]] = []
    for k, (s, x) in enumerate(zip(pairs.s.tolist(), pairs.vectors, strict=True), start=1):
        push = (force[:, 0] + s * force[:, 1] + s * s * force[:, 2]) @ _left_vector(problem, s, x)
        X = np.array([x, s * x])
        if s.imag:
            blocks.append(np.array([[s.real, -s.imag], [s.imag, s.real]]))
            rows.append((np.array([push.real, push.imag]), 2 * np.array([X.real, -X.imag])))
            states += [f"Re p{k}", f"Im p{k}"]
        else:
            blocks.append(np.array([[s.real]]))
            rows.append((push.real[None], X.real[None]))
            states.append(f"p{k}")
    from scipy.linalg import block_diag

    B = np.vstack([one for one, _ in rows])
    places, velocities = (np.vstack([X[:, k] for _, X in rows]) for k in (0, 1))
    rates = outputs.rates[:, None]
    A, C, C_rates = block_diag(*blocks), outputs(places), outputs(velocities)
    gains = np.linalg.solve(A, B)
    rest = outputs.static(inputs, _static(small, inputs)) + C @ gains
    # rates vanish in a static response
    found = LinearModel(A, B, np.where(rates, C_rates, C), np.where(rates, C_rates @ gains, rest), states,
                        np.where(rates, rest, 0.0))
    return found, pair_warnings(spec.modes, pairs, pairs.s)


def _relaxing(small: Linearised, spec: StateSpace, inputs: list[Input], outputs: _Outputs
              ) -> tuple[LinearModel, list[str]]:
    """Return the model in the space of the modes at the long-time modulus and of the responses to the inputs.

    These are the static ones and those at the relaxation times. z = lift u + q W leads to q'' + C q' + K q + relaxing
    terms = f0 u + f1 u' + f2 u'' + relaxing part of f0. The lift is the static response to inputs that move
    constraints, 0 for others. With q = p + f2 u and q' = v + b u + f2 u', b = f1 - C f2, no derivatives of u are left
    among the states p, v and dashpots.
    """
    problem, (shapes, warnings) = Quadratic(small, relaxes=True), _shapes(small, spec)
    moved = [bool(i.f[0][~problem.is_coordinate].any()) for i in inputs]
    free = small.model.symmetric and not _is_held(small)
    rest = _residual_responses(small, shapes, inputs) if free else _static(small, inputs)
    lifts = [np.where(m & problem.is_coordinate, x, 0.0) for m, x in zip(moved, rest, strict=True)]
    lifted = [_lifted(problem, i, x) for i, x in zip(inputs, lifts, strict=True)]
    beside = [x for x, m in zip(rest, moved, strict=True) if not m]
    beside += _relaxation_responses(problem, lifted)
    space = Projected(problem, [*shapes, *beside], INDEPENDENT_SHARE)
    m, n, W = len(space.W), len(space.A), space.W
    f0, f1, f2 = (np.array([i.f for i in lifted]) @ W.T).transpose(1, 2, 0)
    delayed = np.array([i.relaxing for i in lifted]) @ W.T
    b, states = f1 - space.C @ f2, list(space.states)
    A, B = space.A, np.zeros((n, len(inputs)))
    # K and the dashpots act on f2 u through the columns of q in A
    B[m:] = A[m:, :m] @ f2
    B[:m], B[m:2 * m] = b, B[m:2 * m] + f0 - space.C @ b
    for t, term in enumerate(space.terms, start=1):
        for k, one in enumerate(inputs):
            push = term.modulus * delayed[k, term.material]
            if push.any():
                A = np.block([[A, np.zeros((len(A), 1))], [np.zeros((1, len(A))), np.array([[-1.0 / term.time]])]])
                A[m:2 * m, -1] = -push
                B = np.vstack([B, np.eye(len(inputs))[k] / term.time])
                B[m:2 * m, k] += push
                states.append(f"d{t}.{one.name}")
    y, rates = outputs(W), outputs.rates[:, None]
    through = outputs.static(inputs, np.array(lifts)) + y @ f2
    C = np.zeros((len(rates), len(A)))
    C[:, :m], C[:, m:2 * m] = np.where(rates, 0.0, y), np.where(rates, y, 0.0)
    return LinearModel(A, B, C, np.where(rates, y @ b, through), states, np.where(rates, through, 0.0)), warnings


def _shapes(small: Linearised, spec: StateSpace) -> tuple[Array, list[str]]:
    """Return the shapes (k, n) of the modes at the long-time modulus: real and imaginary parts of pairs."""
    if small.model.symmetric and not small.rates.gyrates:
        modes = lowest(small.pencil_with_mass(), spec.modes)
        return modes.vectors, mode_warnings(spec.modes, modes)
    _, pairs = pairs_of(small, spec.modes)
    return np.concatenate([pairs.vectors.real, pairs.vectors.imag]), pair_warnings(spec.modes, pairs, pairs.s)


def _is_held(small: Linearised) -> bool:
    """Return whether there are no free rigid motions, so that the tangent stiffness can be factored."""
    modes = lowest(small.pencil_with_mass(), 1)
    return not (np.abs(modes.values) <= modes.floor).any()


def _relaxation_responses(problem: Quadratic, inputs: list[Input]) -> list[Array]:
    """Return the responses (n,) at s = 1/tau of each term, where other combinations of modes respond."""
    out: list[Array] = []
    for s in sorted({1.0 / tau for material in problem.relaxing for _, tau in material.terms}):
        factors = Factors(problem.matrix(s))
        out += [] if factors.singular else [factors.solve(problem.force(one, s).real) for one in inputs]
    return out


def _lifted(problem: Quadratic, one: Input, lift: Array) -> Input:
    """Return the effect of an input on motions relative to its lift (n,)."""
    if not lift.any():
        return one
    f = one.f - np.array([problem.stiffness(lift), problem.damping(lift), problem.mass(lift)])
    more = np.array([r.stiffness(lift) for r in problem.relaxing])
    # the lift satisfies the constraints
    f[:, ~problem.is_coordinate] = 0.0
    return replace(one, f=f, relaxing=one.relaxing - more)


def _left_vector(problem: Quadratic, s: complex, x: Complex) -> Complex:
    """Return y (n,) with y^T (K + s C + s^2 M) = 0 and y^T (C + 2 s M) x = 1, by inverse iteration."""
    at = s * (1.0 + SHIFT)
    factors = Factors(problem.matrix(at if s.imag else at.real).T.tocsc())
    y = np.asarray(problem.M @ (x.conj() if s.imag else x.real))
    for _ in range(3):
        y = factors.solve(y)
        y = y / problem.size(y)
    return np.asarray(y / (y @ (problem.C @ x + 2 * s * (problem.M @ x))))


def _static(small: Linearised, inputs: list[Input]) -> Array:
    """Return the static responses (inputs, n). Raises ComputationError if the model is not held."""
    return _solved(small, [i.f[0] for i in inputs])


def _solved(small: Linearised, forces: Sequence[Array]) -> Array:
    """Return the static responses to forces (k, n). Raises ComputationError if the model is not held."""
    pencil = small.pencil
    if pencil.factor(0.0).bad >= 0:
        raise ComputationError("the tangent stiffness is singular", at={"solver": "state_space"},
                               advice="a support, joint or spring, or a state that is not critical")
    return np.array([refined(pencil.stiffness, pencil.solve, pencil.system.norm, f, 0.0)[0] for f in forces
                     ]).reshape(-1, small.n)


def _residual_responses(small: Linearised, Phi: Array, inputs: list[Input]) -> Array:
    """Return the part (inputs, n) of the static responses that no mode of Phi (m, n) contains.

    Rigid motions are among the modes, so that the remaining forces are in balance.
    """
    pencil = small.pencil
    find_shift(pencil)
    MPhi, out = map_rows(pencil.apply_B, Phi), []
    for i in inputs:
        force = i.f[0] - (Phi @ i.f[0]) @ MPhi
        x = np.zeros(small.n)
        for _ in range(ROUNDS):
            change = pencil.solve(force - pencil.stiffness(x))
            change -= (MPhi @ change) @ Phi
            x += change
            if pencil.system.norm(change) <= SETTLED * pencil.system.norm(x):
                break
        out.append(x)
    return np.array(out)
