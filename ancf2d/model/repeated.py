"""Constraints with multipliers that hold once more what supports and joints hold already.

Two multipliers for one motion make the tangent singular. Only what is held in every position counts in
``drop_repeated``: equations that happen to agree in the reference do not. Linear theory about the reference knows no
other position, and ``linear_row`` gives its equations.
"""

from __future__ import annotations

from .constraints import LENGTH, Constraint, Equations, Row
from .elimination import Elimination
from .point_patch import PointConstraint

# a linear function of the unknowns, two of them as one complex; prescribed motion of row r as the unknown -1 - r
Terms = dict[int, complex]
# relative difference of coefficients that count as equal
EQUAL = 1e-9


class _Names:
    """Numbers for linear functions that are equal to round-off."""

    def __init__(self) -> None:
        self.known: dict[frozenset[int], list[tuple[int, Terms]]] = {}
        self.count = 1

    def __call__(self, terms: Terms) -> int:
        """Return the number of a function: that of an earlier one where they are equal."""
        alike = self.known.setdefault(frozenset(terms), [])
        size = max(map(abs, terms.values()))
        for number, other in alike:
            if all(abs(terms[k] - other[k]) <= EQUAL * size for k in terms):
                return number
        alike.append((self.count, terms))
        self.count += 1
        return self.count - 1


class _Repeated:
    """Looks at constraints one by one, with what supports and joints have made dependent on other coordinates."""

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
        """Return the number of what turns a section: 0 where nothing does."""
        size = max(map(abs, terms.values()), default=0.0)
        return self.sections(terms) if any(abs(v.imag) > 1e-12 * size for v in terms.values()) else 0

    def _ends(self, c: PointConstraint) -> list[int]:
        """Return the sections that a constraint joins: directions by what turns them, angles by theta."""
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
        """Return whether a constraint repeats others."""
        if c.holds == LENGTH:
            terms, known = self._terms(c, [(0, 1.0), (1, 1.0j)]), self.lengths.count
            # bars that keep their angle and the ratio of their lengths are one function, turned and scaled
            return not terms or self.lengths({k: v / complex(*c.p0[:2]) for k, v in terms.items()}) < known
        a, b = map(self._root, self._ends(c))
        self.joined.update({max(a, b): min(a, b)} if a != b else {})
        return a == b


def linear_row(c: Constraint) -> Row:
    """Return what a constraint asks for in linear theory about the reference."""
    gradient = c.reference_gradient()
    if isinstance(c, PointConstraint) and c.signal is not None:
        return Row(c.dofs, gradient / -c.slopes()[c.fed], c.owner, c.holds, c.signal)
    return Row(c.dofs, gradient, c.owner, c.holds)


def drop_repeated(elimination: Elimination, equations: Equations, supports: set[str]) -> list[PointConstraint]:
    """Take off the constraints that repeat others; return those among them that prescribe a motion."""
    repeats = _Repeated(elimination, equations)
    # what begins or ends holds nothing in between
    found = [c for c in equations.constraints if isinstance(c, PointConstraint) and c.active is None and repeats(c)]
    equations.constraints = [c for c in equations.constraints if not any(c is f for f in found)]
    for c in found:
        follows = [elimination.dependents[i] for i in c.dofs.tolist() if i in elimination.dependents]
        held = len(follows) == len(c.dofs) and not any(f.terms for f in follows)
        holders = {equations.rows[r].owner for f in follows for r in f.rhs} & supports
        if c.signal is None and (c.holds != LENGTH or (held and len(holders) > 1)):
            equations.warnings.append(f"held twice: the {c.holds} of {c.owner}; its reaction is not determined")
    return [c for c in found if c.signal is not None]
