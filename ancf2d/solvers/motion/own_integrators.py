"""ancf2d's own time integrators: their coefficients and arrays for the kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from ...case import Dynamic
from ...elements.shape import Array
from ...kernels import calls
from ...kernels.lowlevel.records import Record
from ...kernels.motion.conserving import (
    Conserving,
    conserving_accept,
    conserving_restart,
    conserving_step,
    conserving_work,
)
from ...kernels.motion.newmark import (
    KRYLOV,
    Newmark,
    newmark_accept,
    newmark_go_on,
    newmark_inside,
    newmark_restart,
    newmark_step,
)
from ...kernels.motion.radau import Radau, radau_accept, radau_restart, radau_step
from ...kernels.motion.reused_tangent import add_moduli
from ...kernels.motion.stages import (
    TILE,
    begin_stages,
    lost_in_relaxing,
    radau_inside,
    radau_taken,
    relax,
    relaxing,
)
from ...kernels.motion.state import Step, method_of, no_restart
from ...kernels.motion.switching import (
    Switched,
    switched_accept,
    switched_go_on,
    switched_inside,
    switched_restart,
    switched_step,
    switched_taken,
)
from ...kernels.motion.work import work
from ...model.mesh import Index
from .integrators import Integrator, spectral_radius

MAX_ITERATIONS = 12
# tolerance of Newton's increments, relative to the size of the motion
TIGHT = 1e-10
CONSERVING = 1e-18
# factor on it between impacts: remaining increments would add up to energy of a body that bounces for ever
TIGHTER = 1e-3


# the type of ``Model.relaxing``
Relaxes = tuple[Index, Array]


class Kernels(NamedTuple):
    """The functions of a family of integrators.

    ``inside`` is for methods that step materials that relax, ``taken`` for those that solve these at their stages,
    ``work`` for those that compute the work of a step themselves; ``go_on`` continues after an impact or a stop.
    """

    step: Any
    accept: Any
    restart: Callable[[Any, Any], None]
    inside: Any = None
    work: Any = None
    go_on: Any = no_restart
    taken: Any = None


# by the type of an integrator's tuple of arrays
KERNELS = {
    Newmark: Kernels(newmark_step, newmark_accept, newmark_restart, newmark_inside, go_on=newmark_go_on),
    Conserving: Kernels(conserving_step, conserving_accept, conserving_restart, work=conserving_work),
    Radau: Kernels(radau_step, radau_accept, radau_restart, radau_inside, taken=radau_taken),
    Switched: Kernels(switched_step, switched_accept, switched_restart, switched_inside, go_on=switched_go_on,
                      taken=switched_taken),
}


class Maker(NamedTuple):
    """The maker of an integrator: the order of its local error in h, its interpolation polynomials, its arrays.

    ``make(spec, p, tolerance, end, relaxing)`` takes the record of a problem, the Step that holds the ends of steps,
    and ``Model.relaxing``.
    """

    order: int
    basis: Array
    make: Callable[[Dynamic, Any, float, Step, Relaxes], Any]


def hermite_basis() -> Array:
    """Return the polynomials (3, 4) of x in [0, 1] that belong to h z'(0), z(1) - z(0) and h z'(1) (Hermite)."""
    return np.array([[0.0, 1.0, -2.0, 1.0], [0.0, 0.0, 3.0, -2.0], [0.0, 0.0, -1.0, 1.0]])


def collocation_basis(c: Array) -> Array:
    """Return the polynomials (s + 1, s + 2) of x that belong to h z'(0) and h z'(c_i).

    The rates at the start and the stages determine the end: the quadrature of the stages is exact for them.
    """
    at = np.append(0.0, c)
    powers = np.arange(1, len(at) + 1)
    out = np.zeros((len(at), len(at) + 1))
    out[:, 1:] = np.linalg.inv(powers * at[:, None] ** (powers - 1.0)).T
    return out


def _newmark_family(alphas: Callable[[float], tuple[float, float]], radius: bool = True) -> Maker:
    """Return the maker of a Newmark method; ``alphas`` gives alpha_m, alpha_f for the spectral radius at infinity.

    Without ``radius``, the method has no such choice and ``alphas`` gets 1.
    """
    def make(spec: Dynamic, p: Any, tolerance: float, end: Step, _: Relaxes) -> Newmark:
        n = len(p.weights)
        am, af = alphas(spectral_radius(spec) if radius else 1.0)
        gamma = 0.5 + af - am
        return Newmark(am, af, 0.25 * (gamma + 0.5) ** 2, gamma, 1.0, tolerance, spec.max_iterations or MAX_ITERATIONS,
                       spec.newton == "full", end, np.zeros(n), np.zeros((2 * KRYLOV + 1, n)), np.zeros((3, n)),
                       np.zeros((3, n)))
    return Maker(3, hermite_basis(), make)


def _switched(radau: Radau, basis: Array, spec: Dynamic, p: Any, relaxes: Relaxes) -> tuple[Switched, list[Record]]:
    """Return a method that makes steps of Radau's method, and backward Euler steps where contacts open and close.

    Also return the records of the two methods.
    """
    n, items = len(p.weights), len(p.points.mem)
    euler = _newmark_family(lambda rho: (0.0, 0.0), radius=False).make(spec, p, radau.tolerance, radau.end, relaxes)
    parts = [Record(radau._replace(tolerance=max(TIGHTER * radau.tolerance, 1e-14))), Record(euler)]
    return Switched(parts[0].address, parts[1].address, calls.table({}), 0.0 if spec.dt else spec.tolerance or 0.0,
                    basis, radau.end, Step(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((0, n))), np.zeros(items),
                    np.zeros((3, items)), np.zeros(1)), parts


def _functions_of_both(problem: Any, radau: Any, euler: Any, relaxes: bool) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that a switching method calls, of its two methods."""
    out = {calls.radau_step: (radau_step, problem, radau), calls.radau_accept: (radau_accept, radau),
           calls.euler_step: (newmark_step, problem, euler)}
    if relaxes:
        out |= {calls.radau_inside: (radau_inside, problem, radau), calls.radau_taken: (radau_taken, problem, radau)}
    return out


def _functions_of_stages(problem: Any, radau: Any) -> dict[Any, tuple[Any, ...]]:
    """Return the functions that Radau's method calls if materials relax."""
    return {calls.begin_stages: (begin_stages, radau), calls.relax: (relax, problem, radau),
            calls.lost_in_relaxing: (lost_in_relaxing, problem, radau), calls.add_moduli: (add_moduli, problem, radau)}


def _energy_momentum(spec: Dynamic, p: Any, tolerance: float, end: Step, _: Relaxes) -> Conserving:
    n = len(p.weights)
    return Conserving(tolerance, spec.max_iterations or 4 * MAX_ITERATIONS, spec.newton == "full", end,
                      np.zeros(len(p.place)), np.zeros(n), np.zeros(n), np.zeros(n),
                      np.zeros((3, len(p.programs.first) - 1, 3)))


def radau_nodes(stages: int) -> Array:
    """Return the nodes c of Radau IIA: roots of P_s - P_(s-1) on [0, 1], the last one 1."""
    from numpy.polynomial import legendre

    roots = np.sort(legendre.legroots([0.0] * (stages - 1) + [-1.0, 1.0]).real)
    return np.append(0.5 * (roots[:-1] + 1.0), 1.0)


def collocation(c: Array) -> Array:
    """Return A (s, s): A[i, j] = int_0^c_i of the Lagrange polynomial j on the nodes c."""
    out = np.zeros((len(c), len(c)))
    for j in range(len(c)):
        others = np.delete(c, j)
        lagrange = polynomial.polyfromroots(others) / np.prod(c[j] - others)
        out[:, j] = polynomial.polyval(c, polynomial.polyint(lagrange))
    return out


class Coefficients(NamedTuple):
    """The coefficients of Radau IIA as in ``Radau``; ``weights`` (s,) are those of the end of a step."""

    c: Array
    W: Array
    mu: float
    mus: Array
    apart: Array
    together: Array
    embedded: Array
    gamma: float
    weights: Array


@cache
def _coefficients(stages: int) -> Coefficients:
    """Return the (shared, read-only) coefficients of Radau IIA with an odd number of stages."""
    c = radau_nodes(stages)
    A = collocation(c)
    W = np.asarray(np.linalg.inv(A), dtype=float)
    values, right = np.linalg.eig(W)
    left = np.linalg.inv(right)
    k = int(np.argmin(np.abs(values.imag)))
    upper = np.flatnonzero(values.imag > 1e-9)
    gamma = 1.0 / float(values[k].real)
    # weights b of the embedded formula: order s with gamma f(y_0) among them
    powers = np.arange(stages)
    embedded = np.linalg.solve(c[None, :] ** powers[:, None], 1.0 / (powers + 1.0) - gamma * (powers == 0))
    rows, columns = [left[k].real], [right[:, k].real]
    for q in upper:
        rows += [left[q].real, left[q].imag]
        columns += [2.0 * right[:, q].real, -2.0 * right[:, q].imag]
    return Coefficients(c, W, float(values[k].real), values[upper], -np.array(rows), np.array(columns).T.copy(),
                        (W.T @ (embedded - A[-1]))[None], gamma, A[-1].copy())


def radau(stages: int) -> Maker:
    """Return the maker of Radau IIA with an odd number of stages."""

    def make(spec: Dynamic, p: Any, tolerance: float, end: Step, relaxes: Relaxes) -> Radau:
        own = _coefficients(stages)
        yields = len(p.states) > sum(points * numbers for _, _, points, numbers, *_ in relaxes[0].tolist())
        n, entries, pairs = len(p.coordinate), len(p.mass), len(own.mus)
        X, V, accelerations, R, kept = (np.zeros((stages, n)) for _ in range(5))
        cosine, sine, F, row = (np.zeros((stages, m)) for m in (len(p.pairs), len(p.pairs), stages, TILE))
        return Radau(
            **{name: value for name, value in own._asdict().items() if name != "weights"}, tolerance=tolerance,
            max_iterations=spec.max_iterations or MAX_ITERATIONS, full=spec.newton == "full" or yields,
            fixed=spec.dt is not None, damped=bool(p.tau.any()) or len(p.points.mem) > 0 or p.rank > 0,
            multipliers=np.flatnonzero(p.coordinate == 0.0), end=end, X=X, V=V, A=accelerations, R=R, kept=kept,
            B=np.zeros(entries), C=np.zeros((pairs, entries), dtype=complex), y=np.zeros(n),
            u=np.zeros((pairs, n), dtype=complex), amps=np.zeros((stages, len(p.programs.first) - 1, 3)),
            cosine=cosine, sine=sine, held=np.zeros(4), facing=np.zeros((2, len(p.pairs))), F=F, rows=row,
            relaxing=relaxing(*relaxes, own.weights, p))

    return Maker(stages + 1, collocation_basis(radau_nodes(stages)), make)


# every integrator that is not SciPy's. HHT: spectral radius (1 - af)/(1 + af), 1/2 at the bound af = 1/3
MAKERS: dict[str, Maker] = {
    "radau5": radau(3), "radau9": radau(5),
    "generalized_alpha": _newmark_family(lambda rho: ((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0))),
    "hht": _newmark_family(lambda rho: (0.0, (1.0 - rho) / (1.0 + rho))),
    "newmark": _newmark_family(lambda rho: (0.0, 0.0), radius=False),
    "energy_momentum": Maker(3, hermite_basis(), _energy_momentum),
}


class Method:
    """An integrator for the kernels: ``record`` is its ``state.Method``, ``own`` the data of its family.

    ``functions`` are those that kernels call by address (``kernels.calls``), including the sum of work if it ``works``.
    """

    def __init__(self, name: str, spec: Dynamic, p: Record, tolerance: float, relaxes: Relaxes, works: bool) -> None:
        order, basis, make = MAKERS[name]
        method = method_of(order, basis, len(p.weights))
        own, parts = make(spec, p, tolerance, method.end, relaxes), list[Record]()
        if p.sided and isinstance(own, Radau):
            own, parts = _switched(own, basis, spec, p, relaxes)
        self.own = Record(own, parts)
        self.order, self._kernels = order, KERNELS[type(self.own.values)]
        self.functions = self._functions(p.layout, len(relaxes[0]) > 0, works)
        if parts:
            radau, euler = parts
            self.functions |= _functions_of_both(p.layout, radau.layout, euler.layout, len(relaxes[0]) > 0)
        # the record with Radau's stages, if materials relax at these
        self._relaxing = next((x for x in (self.own, *parts) if len(relaxes[0]) and isinstance(x.values, Radau)), None)
        # number of internal strains that are stored with the motion's tangent
        self.remembered = p.prescribed.shape[1] if self._relaxing is not None else 0
        if self._relaxing is not None:
            self.functions |= _functions_of_stages(p.layout, self._relaxing.layout)
        impulse = own.gamma * (1.0 - own.af) / (1.0 - own.am) if isinstance(own, Newmark) else 0.0
        self._unfinished = method._replace(own=self.own.address, exact=self._kernels.work is not None, impulse=impulse,
                                             switches=isinstance(own, Switched))

    def _functions(self, problem: Any, relaxes: bool, works: bool) -> dict[Any, tuple[Any, ...]]:
        kernels, own = self._kernels, self.own.layout
        out = {calls.step: (kernels.step, problem, own), calls.accept: (kernels.accept, own),
               calls.restart: (kernels.go_on, own)}
        if works:
            out[calls.work] = work, problem
        if works and kernels.work is not None:
            out[calls.work_of_step] = kernels.work, problem, own
        if relaxes:
            out[calls.inside] = kernels.inside, problem, own
            if kernels.taken is not None:
                out[calls.taken] = kernels.taken, problem, own
        return out

    @cached_property
    def record(self) -> Record:
        """Return the record for the kernels, with its functions compiled."""
        table = calls.table(self.functions)
        if isinstance(self.own.values, Switched):
            self.own.values.calls[:] = table
        if self._relaxing is not None:
            self._relaxing.values.relaxing.calls[:] = table
        return Record(self._unfinished._replace(calls=table))

    def restart(self, s: Any) -> None:
        """Restart the method from the motion s."""
        self._kernels.restart(self.own, s)


def newton_tolerance(method: Integrator, tolerance: float) -> float:
    """Return the tolerance of Newton's increments, relative to the size of the motion."""
    if method.conserves:
        return CONSERVING
    return max(min(TIGHT, 1e-2 * tolerance), 1e-14) if tolerance else TIGHT
