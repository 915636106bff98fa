"""Rigid motions that nothing resists, found without solving, and redundant constraints.

Two multipliers for the same motion make the tangent singular. ``drop_repeated`` removes only constraints that are
redundant in every configuration; equations that coincide only in the reference stay. Linear theory knows the reference
alone, and ``linear_row`` gives its equations.
"""

from __future__ import annotations

import math

import numpy as np

from ..elements.shape import Array
from ..interactions.springs import Spring
from .constraints import LENGTH, Constraint, Equations, Row
from .mesh import BodyMesh, Index
from .numbering import Elimination
from .point_patch import PointConstraint

# a linear function of the unknowns, a pair of functions as one complex function; the key -1 - r is the prescribed
# motion of row r
Terms = dict[int, complex]
# relative elongation of springs under a weight
STRETCH = 1e-2
# relative difference below which coefficients count as equal
EQUAL = 1e-9
# rigid motions of more bodies are first looked for with sparse factors; singular values above this share of the largest
# are no round-off in these; iterations
MANY, HELD, INVERSE_ITERATIONS = 300, 1e-7, 5


def rigid_motion(mesh: BodyMesh, coords: Index, e: Array, centre: Array) -> Array:
    """Return the rates (n, 3) of coordinates for unit translation in x, in y and rotation about ``centre``.

    ``e`` are the current nodal coordinates (full vector).
    """
    coords = np.asarray(coords)
    kinds = mesh.kinds[coords - mesh.first_dof]
    out = np.zeros((len(coords), 3))
    # x and y of r, theta, then x and y of a gradient, which rotates but does not translate
    x, y, u, v = (coords[kinds == kind] for kind in (0, 1, 3, 4))
    out[kinds == 0, 0] = out[kinds == 1, 1] = out[kinds == 2, 2] = 1.0
    out[kinds == 0, 2], out[kinds == 1, 2] = -(e[x + 1] - centre[1]), e[y - 1] - centre[0]
    out[kinds == 3, 2], out[kinds == 4, 2] = -e[u + 1], e[v - 1]
    return out


def own_motion(mesh: BodyMesh, e0: Array, k: int) -> Array:
    """Return the rates (n_dofs,) of a body's coordinates in the reference: k = 0, 1 is translation in x, y.

    2 is rotation about its middle.
    """
    if k < 2:
        return mesh.kinds == k
    if mesh.rotation is None:
        coords = np.arange(mesh.first_dof, mesh.first_dof + mesh.n_dofs)
        mesh.rotation = rigid_motion(mesh, coords, e0, np.asarray(mesh.plan.position(0.5)[0]))[:, 2].copy()
    return mesh.rotation


def _resistance(meshes: list[BodyMesh], rows: list[Row], constraints: list[Constraint], springs: list[Spring],
                e0: Array, centres: list[Array], sizes: list[float], fall: Array | None) -> Array:
    """Return coefficients (equations, 3 bodies) of equations and springs on rigid motions; rotations times length.

    ``fall`` (n_q,) moves all bodies as their weight does; springs that it stretches also resist motions across them.
    """
    first = np.array([m.first_dof for m in meshes])
    found = [(r.coords, r.coefs) for r in rows]
    found += [(c.dofs, c.reference_gradient()) for c in constraints]
    for spring in springs:
        for K in _under_weight(spring, fall) if fall is not None else [spring.reference_stiffness()]:
            values, vectors = np.linalg.eigh(K)
            keep = values > 1e-9 * _stiffness(spring)
            found += [(spring.dofs[0], v) for v in vectors.T[keep]]
    out, terms = np.zeros((len(found), 3 * len(meshes))), np.zeros(len(found))
    coords, coefs = (np.concatenate([f[k] for f in found] or [first[:0]]) for k in (0, 1))
    equation = np.repeat(np.arange(len(found)), [len(f[0]) for f in found])
    owner = np.searchsorted(first, coords, side="right")
    for b in np.unique(owner).tolist():
        part = owner == b
        each = coefs[part][:, None] * rigid_motion(meshes[b - 1], coords[part], e0, centres[b - 1])
        each[:, 2] /= sizes[b - 1]
        np.add.at(out[:, 3 * b - 3:3 * b], equation[part], each)
        # a component of a gradient counts with the length of the gradient: its own rate may be round-off
        kinds = meshes[b - 1].kinds[coords[part] - meshes[b - 1].first_dof]
        partner = coords[part] + (kinds == 3) - (kinds == 4)
        length = np.where(kinds >= 3, np.hypot(e0[coords[part]], e0[partner]), 0.0)
        np.maximum.at(terms, equation[part], np.abs(each).max(axis=1))
        np.maximum.at(terms, equation[part], np.abs(coefs[part]) * length / sizes[b - 1])
    norm = np.abs(out).max(axis=1)
    # terms that cancel, as for a rigid length or a spring within a body, resist no motion; only round-off is left
    some = norm > 1e-12 * terms
    return out[some] / norm[some, None]


def _under_weight(spring: Spring, fall: Array) -> list[Array]:
    """Return the stiffness (n, n) of a spring in the reference and, if ``fall`` may stretch it, stretched.

    A spring across the fall, or one that it compresses, does not hold a body.
    """
    _, H, _ = spring.forces(np.zeros(len(spring.p0)), 0.0)
    way, moved = np.linalg.eigh(H)[1][:, -1], spring.G @ fall[spring.dofs[0]]
    along, size = float(way @ moved), STRETCH * max(float(np.abs(spring.p0).max(initial=0.0)), 1e-300)
    # between bodies that fall alike, the spring bears one or the other
    sides = (1.0, -1.0) if not moved.any() else (np.sign(along),) if abs(along) > EQUAL * np.abs(moved).max() else ()
    found = [H, *(spring.forces(side * size * way, 0.0)[1] for side in sides)]
    return [spring.G.T @ H @ spring.G for H in found]


def _stiffness(spring: Spring) -> float:
    """Return the size of a spring's stiffness before terms cancel, as they do within a rigid body up to round-off."""
    _, H, _ = spring.forces(np.zeros(len(spring.G)), 0.0)
    return max(float(np.abs(H).max() * np.abs(spring.G).max() ** 2), 1e-300)


def _describe(meshes: list[BodyMesh], motion: Array, centres: list[Array], sizes: list[float]) -> str:
    words = []
    scale = np.abs(motion).max()
    for b, mesh in enumerate(meshes):
        tx, ty, phi = motion[3 * b:3 * b + 3] / scale
        if max(abs(tx), abs(ty), abs(phi)) < 1e-6:
            continue
        if abs(phi) > 1e-6:
            rate = phi / sizes[b]
            x, y = centres[b][0] - ty / rate, centres[b][1] + tx / rate
            x, y = (0.0 if abs(v) < 1e-9 * sizes[b] else v for v in (x, y))
            words.append(f"'{mesh.plan.name}' is free to turn about ({x:.6g}, {y:.6g})")
        else:
            n = math.hypot(tx, ty)
            dx, dy = (0.0 if abs(v) < 1e-9 else v for v in (tx / n, ty / n))
            words.append(f"'{mesh.plan.name}' is free to move along ({dx:.4g}, {dy:.4g})")
    return " while ".join(words)


def _full_rank(A: Array) -> bool:
    """Return whether a sparse factorisation shows quickly that A (m, n) has no null space, which it may have otherwise.

    Smallest singular value by inverse iteration: [a I, A; A^T, 0] [r; x] = [0; -b] gives x = a (A^T A)^-1 b (Bjorck,
    Numerical Methods for Least Squares Problems, 1996, section 2.5).
    """
    m, n = A.shape
    if n < MANY or m < n:
        return False
    from scipy.sparse import block_array, csc_array, eye_array
    from scipy.sparse.linalg import splu

    sparse = csc_array(A)
    a = HELD * math.sqrt(float(np.abs(A).sum(axis=0).max()) * float(np.abs(A).sum(axis=1).max()))
    try:
        factors = splu(csc_array(block_array([[a * eye_array(m), sparse], [sparse.T, None]])))
    except RuntimeError:  # singular
        return False
    x = np.random.default_rng(0).standard_normal(n)
    for _ in range(INVERSE_ITERATIONS):
        x = factors.solve(np.concatenate([np.zeros(m), x / np.linalg.norm(x)]))[m:]
    return bool(np.linalg.norm(x) < 1.0 / a)


def _kernel(A: Array) -> Array:
    """Return an orthonormal basis, as rows (k, n), of the null space of A (m, n)."""
    if _full_rank(A):
        return np.zeros((0, A.shape[1]))
    # all of vt, whose last rows span the null space, but no more of u than there are columns
    _, s, vt = np.linalg.svd(A, full_matrices=A.shape[0] < A.shape[1])
    rank = int((s > 1e-9 * s[0]).sum()) if len(s) else 0
    return vt[rank:]


def free_motions(meshes: list[BodyMesh], rows: list[Row], constraints: list[Constraint], springs: list[Spring],
                 e0: Array, weight: Array | None = None) -> list[str]:
    """Return a sentence for each independent rigid motion that no support, joint or spring resists.

    With the direction of a ``weight`` (2,), which can hold other motions, consider only those in which no body rotates,
    and springs and tendons on which bodies hang.
    """
    centres = [np.asarray(m.plan.position(0.5)[0]) for m in meshes]
    sizes = [m.plan.length for m in meshes]
    fall = None if weight is None else np.concatenate(
        [np.where(mesh.kinds == 0, weight[0], np.where(mesh.kinds == 1, weight[1], 0.0)) for mesh in meshes])
    held = _resistance(meshes, rows, constraints, springs, e0, centres, sizes, fall)
    null = _kernel(held) if len(held) else np.eye(3 * len(meshes))
    if weight is not None:
        null = _kernel(null[:, 2::3].T) @ null
    # reduced row echelon form, so that each sentence involves as few bodies as possible
    null = null.copy()
    for k in range(len(null)):
        large = np.abs(null[k:]) > 1e-9 * np.abs(null[k:]).max()
        p, c = map(int, np.unravel_index(np.argmax(large), large.shape))
        null[[k, k + p]] = null[[k + p, k]]
        null[k] /= null[k, c]
        others = (np.arange(len(null)) != k) & (null[:, c] != 0.0)
        null[others] -= np.outer(null[others, c], null[k])
    return [_describe(meshes, v, centres, sizes) for v in null]


class _Names:
    """Numbers for linear functions; functions that are equal up to round-off have the same number."""

    def __init__(self) -> None:
        self.known: dict[frozenset[int], list[tuple[int, Terms]]] = {}
        self.count = 1

    def __call__(self, terms: Terms) -> int:
        """Return the number of a function, the same as that of an equal earlier one."""
        alike = self.known.setdefault(frozenset(terms), [])
        size = max(map(abs, terms.values()))
        for number, other in alike:
            if all(abs(terms[k] - other[k]) <= EQUAL * size for k in terms):
                return number
        alike.append((self.count, terms))
        self.count += 1
        return self.count - 1


class _Repeated:
    """Check constraints one after another for redundancy, given the dependent coordinates of supports and joints."""

    def __init__(self, elimination: Elimination, equations: Equations) -> None:
        self.dependents, self.rows = elimination.dependents, equations.rows
        self.lengths, self.sections = _Names(), _Names()
        self.joined: dict[int, int] = {}

    def _terms(self, c: PointConstraint, fields: list[tuple[int, complex]]) -> Terms:
        out: Terms = {}
        for field, unit in fields:
            for coord, weight in zip(c.dofs.tolist(), c.G[field].tolist(), strict=True):
                follows = self.dependents.get(coord)
                terms = {coord: 1.0} if follows is None else dict(follows.terms)
                for r, factor in follows.rhs.items() if follows is not None else ():
                    if self.rows[r].signal is not None:
                        terms[-1 - r] = factor
                for k, v in terms.items():
                    out[k] = out.get(k, 0.0) + unit * weight * v
        size = max(map(abs, out.values()), default=0.0)
        return {k: v for k, v in out.items() if abs(v) > 1e-12 * size}

    def _section(self, terms: Terms) -> int:
        """Return the number of the function that rotates a section, or 0 if the section cannot rotate."""
        size = max(map(abs, terms.values()), default=0.0)
        return self.sections(terms) if any(abs(v.imag) > 1e-12 * size for v in terms.values()) else 0

    def _ends(self, c: PointConstraint) -> list[int]:
        """Return the numbers of the two sections that a constraint joins, found from their directions or theta."""
        out = []
        for k in range(0, 4 if c.law.name == "aligned" else 2, 2):
            terms = self._terms(c, [(k, 1.0), (k + 1, 1.0j)])
            out.append(self._section({i: v / c.p0[k] for i, v in terms.items()}))
        if c.law.name == "at_angle":
            out.append(self._section(self._terms(c, [(2, 1.0j)])))
        return out

    def _root(self, section: int) -> int:
        while section in self.joined:
            section = self.joined[section]
        return section

    def __call__(self, c: PointConstraint) -> bool:
        """Return whether a constraint repeats earlier ones."""
        if c.holds == LENGTH:
            terms, known = self._terms(c, [(0, 1.0), (1, 1.0j)]), self.lengths.count
            # bars that keep their angle and the ratio of their lengths have the same function up to rotation and scale
            return not terms or self.lengths({k: v / complex(*c.p0[:2]) for k, v in terms.items()}) < known
        a, b = map(self._root, self._ends(c))
        self.joined.update({max(a, b): min(a, b)} if a != b else {})
        return a == b


def linear_row(c: Constraint) -> Row:
    """Return the linear equation of a constraint about the reference."""
    gradient = c.reference_gradient()
    if isinstance(c, PointConstraint) and c.signal is not None:
        return Row(c.dofs, gradient / -c.slopes()[c.fed], c.owner, c.holds, c.signal)
    return Row(c.dofs, gradient, c.owner, c.holds)


def drop_repeated(elimination: Elimination, equations: Equations, supports: set[str]) -> list[PointConstraint]:
    """Remove redundant constraints, with warnings; return those among them that prescribe a motion."""
    repeats = _Repeated(elimination, equations)
    # constraints that act only for a while cannot replace others
    found = [c for c in equations.constraints if isinstance(c, PointConstraint) and c.active is None and repeats(c)]
    equations.constraints = [c for c in equations.constraints if not any(c is f for f in found)]
    for c in found:
        follows = [elimination.dependents[i] for i in c.dofs.tolist() if i in elimination.dependents]
        held = len(follows) == len(c.dofs) and not any(f.terms for f in follows)
        holders = {equations.rows[r].owner for f in follows for r in f.rhs} & supports
        if c.signal is None and (c.holds != LENGTH or (held and len(holders) > 1)):
            equations.warnings.append(f"redundant: the {c.holds} of {c.owner}; its reaction is indeterminate")
    return [c for c in found if c.signal is not None]
