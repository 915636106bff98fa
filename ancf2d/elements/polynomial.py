"""Polynomials in (x, y) as the papers write them: ``"x^2 + nu*y^2"``, parsed once and evaluated exactly."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import comb

import numpy as np

_TERM = re.compile(r"\s*([+-])?\s*([^+-]+)")
_FACTOR = re.compile(r"(?P<name>x|y|nu)(?:\s*(?:\^|\*\*)\s*(?P<power>\d{1,2}))?|(?P<number>\d+(?:\.\d*)?)")
MAX_DEGREE = 12


@dataclass(frozen=True)
class Term:
    """One product ``coefficient * nu^k * x^i * y^j``."""

    coefficient: float
    nu: int
    i: int
    j: int


@dataclass(frozen=True)
class Polynomial:
    """A basis function of an element: a sum of terms in x (from the first node) and y (from the axis)."""

    text: str
    terms: tuple[Term, ...]

    @property
    def degree_x(self) -> int:
        """Highest power of x."""
        return max(t.i for t in self.terms)

    @property
    def degree_y(self) -> int:
        """Highest power of y."""
        return max(t.j for t in self.terms)

    def coefficients(self, nu: float, l: float, half: float) -> dict[tuple[int, int], np.longdouble]:
        """Return the coefficients of xi^i eta^j, with x = l (1 + xi)/2 and y = half * eta.

        The shifted and scaled coordinates keep high orders well conditioned.
        """
        out: dict[tuple[int, int], np.longdouble] = {}
        for t in self.terms:
            scale = np.longdouble(t.coefficient) * np.longdouble(nu) ** t.nu
            scale *= (np.longdouble(l) / 2) ** t.i * np.longdouble(half) ** t.j
            for k in range(t.i + 1):
                out[k, t.j] = out.get((k, t.j), np.longdouble(0)) + scale * comb(t.i, k)
        return out


def _parse_term(text: str, sign: float) -> Term:
    coefficient, powers = sign, {"x": 0, "y": 0, "nu": 0}
    for piece in re.split(r"\*(?!\*)", text.replace("**", "^")):
        match = _FACTOR.fullmatch(piece.strip())
        if match is None:
            raise ValueError(f"'{piece.strip()}' is not a power of x, y or nu, nor a number")
        if match["number"]:
            coefficient *= float(match["number"])
        else:
            powers[match["name"]] += int(match["power"] or 1)
    if max(powers.values()) > MAX_DEGREE:
        raise ValueError(f"powers above {MAX_DEGREE} are not supported")
    return Term(coefficient, powers["nu"], powers["x"], powers["y"])


def parse(text: str) -> Polynomial:
    """Parse a polynomial such as ``x^2 + nu*y^2``; raise ValueError with the offending piece."""
    text = str(text).strip()
    terms, position = [], 0
    while position < len(text):
        match = _TERM.match(text, position)
        if match is None or (position > 0 and match[1] is None) or len(text) > 200:
            raise ValueError(f"cannot read '{text[position:position + 40]}' as a polynomial in x and y")
        terms.append(_parse_term(match[2], -1.0 if match[1] == "-" else 1.0))
        position = match.end()
    if not terms:
        raise ValueError("an empty basis function")
    return Polynomial(text, tuple(terms))
