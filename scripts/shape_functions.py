"""Print the shape functions of the element types, in exact arithmetic, as docs/theory.md has them."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import prod

from ancf2d.elements import registry
from ancf2d.elements.definition import ElementType, Polynomial, derivative_order

# powers of x, y and nu -> coefficient, for an element of length 1
Sum = dict[tuple[int, int, int], Fraction]


def falling(n: int, k: int) -> int:
    """Return n (n - 1) ... (n - k + 1), the factor of the k-th derivative of x^n."""
    return prod(range(n - k + 1, n + 1))


def nodal_value(polynomial: Polynomial, at: Fraction, coordinate: str) -> Fraction:
    """Return what a nodal coordinate is of a basis function; none of them depends on nu."""
    i, j = derivative_order(coordinate)
    terms = [t for t in polynomial.terms if t.j == j and t.i >= i]
    assert not any(t.nu for t in terms), "a nodal coordinate would depend on the material"
    return sum((Fraction(t.coefficient) * falling(t.i, i) * falling(j, j) * at ** (t.i - i) for t in terms),
               Fraction(0))


def inverse(matrix: Sequence[Sequence[Fraction]]) -> list[list[Fraction]]:
    """Return the inverse of a regular matrix, exactly."""
    n = len(matrix)
    rows = [[*row, *(Fraction(i == k) for k in range(n))] for i, row in enumerate(matrix)]
    for k in range(n):
        p = next(i for i in range(k, n) if rows[i][k])
        rows[k], rows[p] = rows[p], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for i in (i for i in range(n) if i != k):
            rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


def shape_functions(kind: ElementType) -> list[Sum]:
    """Return s_k of a type, in the order of its nodal coordinates: s = A^-T p with A_ij = L_i(p_j)."""
    places = [Fraction(node.at).limit_denominator(1000) for node in kind.nodes]
    A = [[nodal_value(p, places[node], c) for p in kind.polynomials] for node, c in kind.functionals]
    found = []
    for column in zip(*inverse(A), strict=True):
        total: Sum = {}
        for factor, polynomial in zip(column, kind.polynomials, strict=True):
            for t in polynomial.terms:
                key = (t.i, t.j, t.nu)
                total[key] = total.get(key, Fraction(0)) + factor * Fraction(t.coefficient)
        found.append({key: value for key, value in total.items() if value})
    return found


def monomial(powers: tuple[int, int, int]) -> str:
    """Return xi^i eta^j nu^k as text, empty for 1."""
    names = zip(("nu", "xi", "eta"), (powers[2], powers[0], powers[1]), strict=True)
    return " ".join(name if n == 1 else f"{name}^{n}" for name, n in names if n)


def written(total: Sum) -> str:
    """Return a sum as text, low powers first."""
    out = ""
    for powers, value in sorted(total.items(), key=lambda item: (item[0][1], item[0][0])):
        size, name = abs(value), monomial(powers)
        factor = "" if size == 1 and name else f"{size} "
        sign = "-" if value < 0 else "+"
        out += f" {sign} {factor}{name}".rstrip() if out else f"{'-' if value < 0 else ''}{factor}{name}".rstrip()
    return out


def report(kind: ElementType) -> str:
    """Return the shape functions of a type as lines: nodal coordinate, its place, function."""
    lines = [kind.name]
    for (node, coordinate), total in zip(kind.functionals, shape_functions(kind), strict=True):
        order = sum(derivative_order(coordinate))
        text = written(total)
        scale = {0: "", 1: "l "}.get(order, f"l^{order} ")
        text = f"{scale}({text})" if scale else text
        lines.append(f"  {coordinate:5} at {kind.nodes[node].at:<4g} {text}")
    return "\n".join(lines)


def all_types() -> str:
    """Return the shape functions of all listed types."""
    return "```text\n" + "\n\n".join(report(t) for t in registry.ELEMENTS.values()) + "\n```"


if __name__ == "__main__":
    print(all_types())
