"""Linear buckling: load factors at which the tangent, extrapolated along the linear response, becomes singular."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...case import Buckling
from ...elements.shape import Array
from ...errors import ComputationError
from ...model.model import Model
from ..resolution import Resolution
from ..small_motions.changes import about_without_flow, load_change, set_speed, speed_change
from ..small_motions.classify import Classifier
from ..small_motions.eigen import POOR, full_shapes
from ..small_motions.flutter import Stability, critical_factors
from ..small_motions.linearised import Base, Linearised, base_state, to_sparse
from ..small_motions.lowest_modes import Pencil, map_rows, ritz
from ..small_motions.projected import Quadratic
from ..state import State
from .load_rates import SMALL, residual_rate, response_size, step_of, tangent_rate
from .one_sided import neglected_work, switching_springs
from .static import unscaled

# rotation or strain of the linear response above which a load factor means nothing
LARGEST = 1e3
# number of unknowns up to which an unsymmetric problem is solved with a dense matrix
DENSE = 1000
# relative imaginary part that counts as zero
REAL = 1e-6
EXTRA = 3
LANCZOS = 1e-10
# change of the stiffness by the loads, relative to it, that is round-off if nothing moves
UNSTRESSED = 1e-12
RESTARTS = 200
# share of a shape in gaps between neighbouring elements, above which it is an artefact of the mesh; beams have 1e-8
GAPS = 1e-3
# rotation or strain by a flow above which the flow counts as changing the state
MOVED = 1e-3
# rotation or strain of the linear response above which critical factors are estimates
FAR = 0.1
# shares of the stiffness neglected by the linearisation, above which a load factor is an estimate, or is omitted
ROUGH, MISSED = 0.02, 0.5


def solve_buckling(model: Model, spec: Buckling) -> Iterator[State]:
    """Yield the linear response to the full load with the load factors at which it buckles, and their shapes.

    (K + mu dK/dt) phi = 0, dK/dt the derivative of the tangent along the linear response to the loads that the factor
    scales. Loads with an amplitude of their own are constant and applied before.
    """
    if model.loads.flows:
        yield _critical_velocities(model, spec)
        return
    base, turned, warnings, iterations = _preloaded(model)
    pencil = Pencil(model, base, 0.0, True, turned)
    if not model.symmetric:
        yield _growth_state(pencil, spec, warnings, iterations)
        return
    pivots = pencil.system.factor({"solver": "buckling"})
    pencil.system.check_strained(pencil.stiffness, pivots, {"solver": "buckling"})
    unstable = pencil.negative(pivots)
    u = _response(pencil)
    size = response_size(pencil, u)
    moves = size * model.extent > pencil.system.displacement_noise(pencil.d, 1.0)
    # if nothing moves, the tangent is linear in the multipliers
    h = step_of(pencil, u, size if moves else 0.0)
    pencil.B = -tangent_rate(pencil, u, h)
    # the differences have overwritten the factors
    pencil.factor(0.0)
    if not moves and not _stressed(pencil):
        factors, V = np.zeros(0), np.zeros((0, model.numbering.n_unknowns))
    elif unstable != 0:
        factors, V = _general_factors(pencil, spec.modes)
    else:
        factors, V = _definite_factors(pencil, spec.modes)
    # a larger linear response is meaningless for the beam
    known = factors * size <= LARGEST
    factors, V = factors[known], V[known]
    factors, V, meshed, doubts = _trusted(pencil, u, h, factors, V, size, _mesh_artefacts(model, base, V))
    if unstable:
        warnings.append("the state without the scaled loads is already unstable")
    warnings += doubts
    warnings += [f"shape {k + 1} (load factor {factors[k]:.6g}) is an artefact of the mesh: neighbouring elements "
                 "separate. Use fewer elements, or a type whose neighbours share their sections, such as vallejo"
                 for k in np.flatnonzero(meshed)]
    start = State(0.0, base, pencil.balance.Q, model.external(0.0), 0.0, turned=turned)
    good = ~meshed & (factors * size <= FAR)
    warnings += Resolution(model).of_buckling(start, u, h, factors[good],
                                              full_shapes(model, V[good]))
    if len(factors) < spec.modes:
        warnings.append(f"{len(factors)} positive load factors were found instead of {spec.modes}"
                        + ("" if doubts or len(factors) else ": these loads do not buckle the model in this direction"))
    yield response_state(pencil, base, u, factors, V, warnings, iterations)


def _growth_state(pencil: Pencil, spec: Buckling, warnings: list[str], iterations: int) -> State:
    """Return the linear response with the factors at which small motions about it begin to grow.

    Loads that turn with the body have no potential: vibrations may grow although no other equilibrium is near. Raises
    ComputationError if a body has no mass.
    """
    model, d = pencil.model, pencil.d
    lacking = [name for name, mesh in model.meshes.items() if not mesh.plan.section.rhoA and not mesh.plan.rigid]
    if lacking:
        raise ComputationError(f"flutter depends on the mass: {', '.join(lacking)} has none", at={"solver": "buckling"},
                               advice="material.rho, or section.rhoA if the section is given by stiffnesses")
    pencil.system.factor({"solver": "buckling"})
    u = _response(pencil)
    size = response_size(pencil, u)
    h = step_of(pencil, u, size)
    values = tangent_rate(pencil, u, h)
    pencil.B, rate = -values, to_sparse(model, pencil.matrix, values)
    zero = np.zeros(len(d))
    small = Linearised(Base(model, State(0.0, d, zero, zero, 0.0, turned=pencil.system.turns()[1]), True))
    from scipy.sparse import diags_array

    moved = diags_array((model.numbering.free < model.n_q).astype(float))
    change = load_change(model, d, u, (moved @ rate @ moved).tocsc(), h)
    found = critical_factors(small, change, spec.modes)
    share = _neglected_shares(pencil, u, h, [(c.factor, c.vector) for c in found.critical])
    warnings += _factor_warnings(
        pencil, u, np.array([c.factor for c in found.critical]), size, share, np.zeros(len(share), dtype=bool),
        "static to go to a load, and eigen with about: static to see whether motions grow there")
    found = replace(found, critical=[c for c, one in zip(found.critical, share, strict=True) if one <= MISSED])
    wanted = spec.modes if (share <= MISSED).all() else 0
    return _stability_state(small, u, found, wanted, warnings, iterations, size, "load factor")


def _critical_velocities(model: Model, spec: Buckling) -> State:
    """Return the state under the loads alone, with the critical factors on the velocities of flows along bodies.

    At these factors, small motions about the state begin to grow.
    """
    change = speed_change(model)
    assert change.square is not None
    set_speed(model, 0.0)
    small = Linearised(base_state(model, about_without_flow(model)))
    base, warnings = small.base, list(small.base.state.warnings)
    found = critical_factors(small, change, spec.modes)
    iterations = int(base.state.history["iterations"])
    pushed, moved = np.zeros((2, len(model.numbering.place)))
    state = _stability_state(small, np.zeros_like(pushed), found, spec.modes, warnings, iterations, 0.0, "factor")
    set_speed(model, 1.0)
    for batch in base.model.interactions.flows:
        np.add.at(pushed, batch.dofs, batch.matrices(base.state.d, 0.0)[1])
    small.pencil.factor(0.0)
    model.numbering.expand(small.pencil.solve(model.numbering.reduce(pushed)), moved)
    fastest = max((c.factor for c in found.critical), default=1.0)
    if response_size(small.pencil, moved) * fastest**2 > MOVED:
        state.warnings.append("flow along a curved body changes the state about which it vibrates; the critical "
                              "factors are those about the state without flow")
    return state


def _stability_state(small: Linearised, u: Array, found: Stability, modes: int, warnings: list[str], iterations: int,
                     size: float, called: str) -> State:
    """Return the state with the factors at which motions begin to grow; ``size`` is that of the linear response u."""
    pencil, d = small.pencil, small.pencil.d
    problem = Quadratic(small)
    factors = np.array([c.factor for c in found.critical])
    V = np.array([problem.phases(c.vector)[0] for c in found.critical]).reshape(-1, problem.n)
    shears = any(mesh.plan.element.section_kind != "tangent" for mesh in small.model.meshes.values())
    coarser = "type: cable or fewer elements" if shears else "fewer elements"
    if len(factors) < modes:
        warnings.append(f"{len(factors)} critical {called}s were found up to {found.last:.6g} instead of {modes}"
                        if len(factors) else f"no small motion grows up to the {called} {found.last:.6g}")
    warnings += [f"a small motion may begin to grow near the {called} {factor:.4g}, but round-off hides whether it "
                 "does, as it can in very slender bodies. Check with solver eigen and about: static at that load, or "
                 f"use {coarser}" for factor in found.doubtful]
    if found.error > POOR:
        warnings.append("round-off limits the accuracy of the lowest frequencies without loads to about "
                        f"{found.error:.1g} of their values, so {called}s may be wrong. Use {coarser}")
    for c in found.critical:
        if c.factor * size > FAR:
            warnings.append(f"load factor {c.factor:.6g}: the linear response rotates or strains the model by "
                            f"{c.factor * size:.2g} there, so this factor is only an estimate")
    state = response_state(pencil, d, u, factors, V, warnings, iterations)
    state.report["critical"] = [{"factor": c.factor, "kind": c.kind, "omega": c.omega} for c in found.critical]
    state.tables["modes"] |= {"omega": [c.omega for c in found.critical],
                              "instability": [c.kind for c in found.critical]}
    state.tables["locus"] = dict(found.locus)
    return state


def _trusted(pencil: Pencil, u: Array, h: float, factors: Array, V: Array, size: float, meshed: NDArray[np.bool_]
             ) -> tuple[Array, Array, NDArray[np.bool_], list[str]]:
    """Return the factors at which the linearised tangent represents the tangent, their shapes, and warnings.

    Shapes that are artefacts of the mesh (``meshed``, returned too) are kept in any case, as they have their own
    warning.
    """
    share = _neglected_shares(pencil, u, h, list(zip(factors, V, strict=True)))
    good = meshed | (share <= MISSED)
    doubts = _factor_warnings(pencil, u, factors, size, share, meshed,
                              "static with method: arc_length to find critical points")
    return factors[good], V[good], meshed[good], doubts


def _neglected_shares(pencil: Pencil, u: Array, h: float, found: Sequence[tuple[float, NDArray[Any]]]) -> Array:
    """Return the share of the stiffness that the linearisation neglects at each factor with its vector (n,).

    This is the difference between K + mu dK/dt and the tangent at mu u along the vector, relative to K. Axial stiffness
    times the square of a rotation reaches the bending stiffness long before the rotation is large, in structures that
    bend before they buckle. Or, if larger, it is the work of the loads that one-sided springs take up as they engage or
    release before mu, even if they do not act on the vector. Up to the step ``h``, no spring engages or releases.
    """
    share = []
    for factor, v in found:
        pencil.system.assemble(pencil.d + factor * u, factor)
        tangent = pencil.matrix.target.values.copy()
        rest = stiffness = 0.0j
        for part, x in ((1.0, v.real), (1.0j, v.imag)):
            Kx = pencil.apply_K(x)
            stiffness += part * np.vdot(v, Kx)
            rest += part * np.vdot(v, pencil.matrix.product(tangent, x) - Kx + factor * pencil.apply_B(x))
        share.append(max(abs(rest) / abs(stiffness), neglected_work(pencil, u, factor, h)))
    return np.array(share)


def _factor_warnings(pencil: Pencil, u: Array, factors: Array, size: float, share: Array, meshed: NDArray[np.bool_],
                     use: str) -> list[str]:
    """Return warnings about factors at which a linear response of ``size`` does not represent the equilibrium."""
    out = []
    for some, says in ((~meshed & (share > MISSED), "does not apply at"),
                       (~meshed & (share > ROUGH) & (share <= MISSED), "only estimates")):
        if some.any():
            k = int(np.flatnonzero(some)[-1])
            named = ", ".join(f"{f:.6g}" for f in factors[some])
            names = ", ".join(switching_springs(pencil, u, factors[k]))
            before = (f"{names} begins or ceases to act before the structure buckles" if names else
                      f"The structure bends or strains before it buckles, by {factors[k] * size:.2g} (rad)")
            out.append(f"linear buckling {says} the load factor{'s' if some.sum() > 1 else ''} {named}. {before} at "
                       f"{factors[k]:.6g}, where the linearisation neglects {share[k]:.2g} of the stiffness. Use "
                       f"solver {use}")
    return out


def _mesh_artefacts(model: Model, base: Array, V: Array) -> NDArray[np.bool_]:
    """Return for each shape whether neighbouring elements separate, as no beam does (m,)."""
    if any(mesh.plan.rigid for mesh in model.meshes.values()):
        # rigid bodies have no section motion to classify
        return np.zeros(len(V), dtype=bool)
    verdicts = Classifier(model, base)(full_shapes(model, V), np.zeros(len(V), dtype=bool))
    return np.array([verdict.gaps > GAPS for verdict in verdicts], dtype=bool)


def _preloaded(model: Model) -> tuple[Array, Array | None, list[str], int]:
    """Return the state under the constant loads, its turns, warnings on the way, and the number of iterations."""
    states = list(unscaled(model))
    if not states:
        return model.displacements(np.zeros(model.numbering.n_unknowns), 0.0), None, [], 0
    warnings, iterations = [w for s in states for w in s.warnings], sum(int(s.history["iterations"]) for s in states)
    return states[-1].d, states[-1].turned, warnings, iterations


def _response(pencil: Pencil) -> Array:
    """Return dd/dt (n_full,) at factor 0: the linear response to the loads that the factor scales.

    Raises ComputationError if no load scales with the factor.
    """
    model, num = pencil.model, pencil.model.numbering
    z = pencil.d[num.free]
    moved = (model.displacements(z, SMALL) - model.displacements(z, -SMALL)) / (2 * SMALL)
    (R, changes), u = residual_rate(pencil), moved
    if not moved.any() and not changes:
        raise ComputationError("no load scales with the load factor", at={"solver": "buckling"},
                               advice="a load without an amplitude (an amplitude makes it constant)")
    for _ in range(4):
        change = -pencil.solve(R + num.reduce(pencil.full_stiffness(u)))
        new = moved.copy()
        num.expand(u[num.free] + change, new)
        if model.moves:
            # dependents follow prescribed motion as well as the unknowns
            new += moved - num.expanded(moved[num.free])
        u = new
        if pencil.system.norm(change) <= 1e-14 * pencil.system.norm(u[num.free]):
            break
    if not np.isfinite(u).all():
        raise ComputationError("the linear response is not finite", at={"solver": "buckling"})
    return u


def _stressed(pencil: Pencil) -> bool:
    """Return whether loads that move nothing change the stiffness: K^-1 dK/dt x is not zero for a random x."""
    num = pencil.model.numbering
    forces = np.where(num.free < num.n_q, np.random.default_rng(0).normal(size=num.n_unknowns), 0.0)
    x = pencil.solve(forces)
    return pencil.system.norm(pencil.solve(pencil.apply_B(x))) > UNSTRESSED * pencil.system.norm(x)


def _definite_factors(pencil: Pencil, m: int) -> tuple[Array, Array]:
    """Return the lowest positive factors if K is positive definite on the motions that constraints allow.

    They belong to the largest theta = 1/mu of B phi = theta K phi.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    n = pencil.n
    k = min(m + EXTRA, n - 2 * pencil.multipliers - 1)
    if n <= max(60, 3 * k):
        return _general_factors(pencil, m)
    B, K, inverse = (LinearOperator((n, n), matvec=f, dtype=float)
                     for f in (pencil.apply_B, pencil.apply_K, lambda b: pencil.solve(np.ascontiguousarray(b).ravel())))
    start = pencil.solve(np.random.default_rng(0).standard_normal(n))
    try:
        theta, vectors = eigsh(B, k, M=K, Minv=inverse, which="LA", v0=start, ncv=min(n, 2 * k + 20), tol=LANCZOS,
                               maxiter=RESTARTS)
    except ArpackNoConvergence as error:
        # if there are fewer positive factors, the iteration stalls in the cluster near theta = 0
        theta, vectors = error.eigenvalues, error.eigenvectors
    V = np.ascontiguousarray(vectors.T[np.argsort(-theta)])
    KV = map_rows(pencil.stiffness, V)
    # if loads stress nothing, the vectors are motions without energy, up to round-off
    sound = np.einsum("ij,ij->i", V, KV) > 0.0
    if not sound.any():
        return np.zeros(0), np.zeros((0, n))
    V, KV = V[sound], KV[sound]
    values, Y = ritz(V, -map_rows(pencil.apply_B, V), KV, len(V))
    return _factors(-values, Y @ V, m)


def _general_factors(pencil: Pencil, m: int) -> tuple[Array, Array]:
    """Return the lowest positive factors if K is indefinite (unstable states) or there are few unknowns."""
    n = pencil.n
    if n <= DENSE:
        C = map_rows(lambda x: pencil.solve(pencil.apply_B(x)), np.eye(n)).T
        theta, vectors = np.linalg.eig(C)
    else:
        from scipy.sparse.linalg import LinearOperator, eigs

        C = LinearOperator((n, n), matvec=lambda x: pencil.solve(pencil.apply_B(np.ascontiguousarray(x).ravel())),
                           dtype=float)
        theta, vectors = eigs(C, m + EXTRA, which="LR", v0=np.random.default_rng(0).standard_normal(n), tol=LANCZOS)
    real = np.abs(theta.imag) <= REAL * np.abs(theta)
    order = np.argsort(-theta[real].real)
    V = np.ascontiguousarray(vectors.real.T[real][order])
    return _factors(theta[real].real[order], V, m)


def _factors(theta: Array, V: Array, m: int) -> tuple[Array, Array]:
    """Return 1/theta of the m largest theta that are positive beyond round-off, and their vectors."""
    good = theta > 1e-12 * np.abs(theta).max(initial=0.0)
    return 1.0 / theta[good][:m], V[good][:m]


def response_state(pencil: Pencil, base: Array, u: Array, factors: Array, V: Array, warnings: list[str],
                   iterations: int) -> State:
    """Return the linear response u (n_full,) about a base (n_full,), with load factors (m,) and their shapes."""
    model = pencil.model
    d = base + u
    elastic = pencil.full_stiffness(u)
    Q = pencil.balance.Q + elastic
    # forces of turning loads, which the factor scales too
    for t, sign in ((1.0, 1.0), (0.0, -1.0)):
        pencil.system.add_loads(Q, base, t, sign)
    natural = np.zeros_like(Q)
    stored = pencil.system.add_natural(natural, base, 0.0, 1.0) + float(natural @ u)
    Q += natural
    F = model.external(1.0)
    shapes = full_shapes(model, V / np.maximum(np.abs(V).max(axis=1, initial=0.0), 1e-300)[:, None])
    history = {"step": 1, "factor": 1.0, "iterations": iterations + 1}
    energy = pencil.balance.energy + 0.5 * float(elastic @ u) + stored
    return State(1.0, d, Q, F, energy, linear=True, last=True, history=history,
                 warnings=warnings, report={"load_factors": [float(f) for f in factors],
                                            "critical": [{"factor": float(f), "kind": "divergence", "omega": 0.0}
                                                         for f in factors]},
                 arrays={"modes/shapes": (shapes, "1", "buckling shapes: rows of nodal coordinates")},
                 tables={"modes": {"load_factor": [float(f) for f in factors]}})
