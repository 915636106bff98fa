"""The element kernels: beside what the processor can do, inside one Newton iteration, and with other sampling points.

Operations of an element's forces and tangent are counted from the shapes of its law: s stations, b entries of B that
are not zero (fields times coordinates at most), f fields, e strains, n coordinates, k entries of D that are not zero,
c and h the operations of strain and of second derivatives, counted by running them on numbers that count. A station:

    u = B d: 2 b;  strains: c;  stresses and energy: 2 k + 2 e;  J^T sigma: 2 e f;  forces: 2 b
    D J: 2 k f;  half of J^T (D J): e f (f + 1);  second derivatives: h;
    half of B^T H B: the smaller of 2 f b + (n + 1) b  (H B first)  and  the products of B's rows times H, 2 per product

The peak is that of one core in double precision, measured by chains of multiply-adds that fit into registers.

Sampling: two cantilevers under large loads, slender (Table 2's) and four times as long as high, 8 elements of each type
with its default formulation; the tip's deflection beside that of 32 elements of the type with its own points; motions
of one free element beyond the rigid ones that strain no point; the time of forces and tangent per element.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

import numpy as np

from .apart import seconds
from .statics import model_of

TYPES = ["reissner2", "reissner3", "vallejo", "2d2n"]
# as many elements as one core's caches hold
ELEMENTS, MANY = 256, 100_000
CHAIN, LANES = 16, 1024
BEAMS = {"slender": (0.1, -500e3), "thick": (0.5, -62.5e6)}
SAMPLED = ["reissner2", "reissner3", "cable", "kerkkanen", "vallejo", "omar", "li", "patel", "2d2n", "2d3n"]
COUNT, FINE = 8, 32
# strain energy of a unit motion below this share of the largest is none
NOTHING = 1e-10


class Counted:
    """A number that counts what is done to it."""

    operations = 0

    def __init__(self, value: float) -> None:
        self.value = float(value)

    def _with(self, value: float) -> Counted:
        Counted.operations += 1
        return Counted(value)

    def __add__(self, other: Any) -> Counted:
        return self._with(self.value + number(other))

    def __sub__(self, other: Any) -> Counted:
        return self._with(self.value - number(other))

    def __rsub__(self, other: Any) -> Counted:
        return self._with(number(other) - self.value)

    def __mul__(self, other: Any) -> Counted:
        return self._with(self.value * number(other))

    def __truediv__(self, other: Any) -> Counted:
        return self._with(self.value / number(other))

    def __rtruediv__(self, other: Any) -> Counted:
        return self._with(number(other) / self.value)

    def __neg__(self) -> Counted:
        return Counted(-self.value)

    def __lt__(self, other: Any) -> bool:
        return self.value < number(other)

    def __abs__(self) -> Counted:
        return Counted(abs(self.value))

    # numpy calls these for arrays of objects
    def sin(self) -> Counted:
        """Return the sine, as one operation."""
        return self._with(np.sin(self.value))

    def cos(self) -> Counted:
        """Return the cosine, as one operation."""
        return self._with(np.cos(self.value))

    def sqrt(self) -> Counted:
        """Return the root."""
        return self._with(self.value**0.5)

    __radd__, __rmul__ = __add__, __mul__


def number(x: Any) -> float:
    """Return a plain number."""
    return x.value if isinstance(x, Counted) else float(x)


def counted(shape: tuple[int, ...], seed: int) -> Any:
    """Return an array of numbers that count, small and none zero."""
    values = 1e-3 * np.random.default_rng(seed).uniform(0.5, 1.0, shape)
    return np.vectorize(Counted, otypes=[object])(values)


def strain_operations(law: Any) -> tuple[int, int]:
    """Return what the strains of a point with J, and their second derivatives, take."""
    f, e, ref, found = law.fields, law.strains, counted((law.references, 1), 0), []
    u, sigma, J = counted((f, 1), 1), counted((e, 1), 4), counted((e, f, 1), 3)
    for call in (lambda: law.strain(ref, u, counted((e, 1), 2), J, 1),
                 lambda: law.geometric(ref, u, sigma, J, counted((f, f, 1), 5), 1)):
        Counted.operations = 0
        call()
        found.append(Counted.operations)
    return found[0], found[1]


def operations(law: Any, group: Any) -> dict[str, int]:
    """Return the operations of an element's forces, and of forces with the lower half of its tangent."""
    B, D = group.law.B, group.law.D
    f, stations, n, e = B.shape[1], B.shape[2] * group.plan.parts, B.shape[3], D.shape[1]
    points = f // law.fields
    c, h = (points * x for x in strain_operations(law))
    b_rows, k = np.count_nonzero(B[0, :, 0], axis=1), int(np.count_nonzero(D[0, :, :, 0]))
    b, entries = int(b_rows.sum()), points * law.strains * law.fields
    force = 4 * b + c + 2 * k + 2 * e + 2 * entries
    two_products = 2 * f * b + (n + 1) * b
    rows = sum(2 * int(b_rows[i] * b_rows[j]) for i in range(f) for j in range(i + 1))
    tangent = force + 2 * k * law.fields + e * law.fields * (f + 1) + h + min(two_products, rows)
    return {"stations": stations, "fields": f, "strains": e, "coordinates": n, "force": stations * force,
            "tangent": stations * tangent}


def peak() -> float:
    """Return the operations per second of one core that multiply-adds reach, 2 each."""
    import numba

    @numba.njit(fastmath={"contract"})
    def chains(x, a, b, repeat):
        for _ in range(repeat):
            for k in range(len(x)):
                v = x[k]
                for _ in range(CHAIN):
                    v = v * a + b
                x[k] = v

    x, repeat = np.ones(LANES), 2000
    chains(x, 0.999, 1e-3, 1)
    return 2.0 * CHAIN * LANES * repeat / min(seconds(lambda: chains(x, 0.999, 1e-3, repeat), 7))


def bent(element: str, count: int) -> tuple[Any, Any]:
    """Return Table 2's cantilever (model) and its state under the whole load."""
    from ancf2d.solvers.statics.static import solve_static

    model = model_of(element, count)
    *_, state = solve_static(model, 10)
    return model, state.d


def kernel(element: str, machine: float, repeat: int) -> dict[str, Any]:
    """Return operations, nanoseconds and the share of the peak of forces, and of forces with tangent, per element."""
    from ancf2d.kernels.elements import element_matrices, force

    model, d = bent(element, ELEMENTS)
    group, Q = model.groups[0], np.zeros(len(d))
    n = group.dofs.shape[1]
    Qe, Ke = np.zeros((ELEMENTS, n)), np.zeros((ELEMENTS, n, n))

    def repeated(call: Callable[..., Any], *arguments: Any) -> float:
        call(*arguments)
        return statistics.median(seconds(lambda: [call(*arguments) for _ in range(20)], repeat)) / 20 / ELEMENTS

    times = {"force": repeated(force, group, d, Q), "tangent": repeated(element_matrices, group, d, Qe, Ke)}
    (mesh,) = model.meshes.values()
    counts = operations(mesh.plan.formulation.law, group)
    return {"element": element, **counts,
            **{f"{name}_ns": 1e9 * t for name, t in times.items()},
            **{f"{name}_share": counts[name] / t / machine for name, t in times.items()}}


def iteration(element: str, count: int, repeat: int) -> dict[str, Any]:
    """Return microseconds per element of one Newton iteration, part by part."""
    from ancf2d.solvers.system import System

    bent(element, 8)
    model = model_of(element, count)
    d = model.displacements(np.zeros(model.numbering.n_unknowns), 0.0)
    system = System(model)
    parts: dict[str, list[float]] = {"force, tangent, assembly": [], "factor": [], "solve": []}
    R = system.assemble(d, 0.1).R
    for _ in range(repeat):
        parts["force, tangent, assembly"] += seconds(lambda: system.assemble(d, 0.1), 1)
        parts["factor"] += seconds(lambda: system.factor({}), 1)
        parts["solve"] += seconds(lambda: system.matrix.solve(R), 1)
    found = {name: 1e6 * statistics.median(t) / count for name, t in parts.items()}
    return {"element": element, "elements": count, **found, "all": sum(found.values())}


def measure(repeat: int) -> dict[str, Any]:
    """Return the peak [operations/s], the kernels' shares of it and the parts of an iteration."""
    machine = peak()
    return {"peak": machine, "kernels": [kernel(t, machine, 3 * repeat) for t in TYPES],
            "iterations": [iteration(t, MANY, repeat) for t in TYPES]}


def default_rule(element: str) -> list[int]:
    """Return the points along and across that a type has by itself."""
    (mesh,) = model_of(element, 1).meshes.values()
    return list(mesh.plan.rule.normal)


def deflection(element: str, rule: list[int] | None, beam: str, count: int = COUNT) -> float | None:
    """Return how far the tip goes, or None where no solution is found."""
    from ancf2d.errors import ComputationError
    from ancf2d.solvers.state_results import Observer
    from ancf2d.solvers.statics.static import solve_static

    model = model_of(element, count, rule, *BEAMS[beam])
    try:
        *_, state = solve_static(model, 10)
    except ComputationError:
        return None
    return Observer(model).observe(state)["tip"]["uy"]


def zero_energy(element: str, rule: list[int] | None) -> int:
    """Return the motions of one free element beyond the three rigid ones that strain no sampling point."""
    from ancf2d.kernels.elements import element_matrices

    model = model_of(element, 1, rule, *BEAMS["thick"])
    group, weights = model.groups[0], model.weights
    n = group.dofs.shape[1]
    Q, K = np.zeros((1, n)), np.zeros((1, n, n))
    element_matrices(group, np.zeros(len(model.numbering.place)), Q, K)
    # coordinates as displacements
    scale = 1 / weights[group.dofs[0]]
    values = np.linalg.eigvalsh(K[0] * np.outer(scale, scale))
    return int((values < NOTHING * values[-1]).sum()) - 3


def cost(element: str, rule: list[int] | None, repeat: int = 15) -> float:
    """Return the time of forces and tangent of an element [s]."""
    from ancf2d.kernels.elements import element_matrices

    model = model_of(element, ELEMENTS, rule)
    group, d = model.groups[0], np.zeros(len(model.numbering.place))
    n = group.dofs.shape[1]
    Q, K = np.zeros((ELEMENTS, n)), np.zeros((ELEMENTS, n, n))
    element_matrices(group, d, Q, K)
    return statistics.median(seconds(lambda: element_matrices(group, d, Q, K), repeat)) / ELEMENTS


def neighbours(rule: list[int]) -> list[list[int]]:
    """Return a rule with those of one point fewer and more along and, where it has any across, across."""
    nx, ny = rule
    found = [[nx - 1, ny], [nx, ny - 1], [nx, ny], [nx + 1, ny]] + ([[nx, ny + 1]] if ny > 1 else [])
    return [r for r in found if min(r) > 0]


def sample() -> list[dict[str, Any]]:
    """Return a row for each type and rule."""
    rows = []
    for element in SAMPLED:
        own = default_rule(element)
        fine = {beam: deflection(element, None, beam, FINE) for beam in BEAMS}
        for points in neighbours(own):
            rule = None if points == own else points
            row: dict[str, Any] = {"element": element, "rule": points, "default": rule is None,
                         "zero_energy": zero_energy(element, rule), "cost_ns": 1e9 * cost(element, rule)}
            for beam, reference in fine.items():
                found = deflection(element, rule, beam)
                row[beam] = None if found is None or reference is None else abs(found / reference - 1)
            rows.append(row)
    return rows
