"""Symmetric matrices of the unknowns as motions keep them: a band, or front by front where there are fronts.

``fronts`` is None, or a tree (``kernels.tree``); ``A`` a band (n, bw + 1) (``kernels.band``), or the numbers of all
fronts. Which of the two is known when a kernel is compiled, and the other is not compiled into it.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import overload

from .band import ldl_factor_with, ldl_solve
from .fronts import fronts_factor, fronts_product, fronts_solve
from .jit import inner
from .mass import band_product, product_by_diagonals
from .matrix import Nested, SymBand


def chosen(fronts: Any, of_band: Any, of_fronts: Any) -> Any:
    """Return the function that suits the type of ``fronts``."""
    return of_band if isinstance(fronts, types.NoneType) else of_fronts


def stored(fronts: Any, A: Any) -> Any:
    """Return where element matrices go."""
    raise NotImplementedError


@overload(stored, inline="always")
def _stored(fronts, A):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A: SymBand(A), lambda fronts, A: Nested(A, fronts))


def factored(fronts: Any, A: Any, tiny: float, scale: Any) -> bool:
    """Factor A = L D L^T in place; return whether it could be. What is in ``scale`` (n,) is lost."""
    raise NotImplementedError


@overload(factored, inline="always")
def _factored(fronts, A, tiny, scale):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A, tiny, scale: ldl_factor_with(A, tiny, scale)[0] < 0,
                  lambda fronts, A, tiny, scale: fronts_factor(fronts, A, tiny, scale)[0] < 0)


def solve(fronts: Any, A: Any, x: Any) -> None:
    """Solve L D L^T x = b in place."""
    raise NotImplementedError


@overload(solve, inline="always")
def _solve(fronts, A, x):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A, x: ldl_solve(A, x), lambda fronts, A, x: fronts_solve(fronts, A, x))


def product(fronts: Any, A: Any, x: Any, y: Any) -> None:
    """Fill y = A x."""
    raise NotImplementedError


@overload(product, inline="always")
def _product(fronts, A, x, y):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A, x, y: band_product(A, x, y),
                  lambda fronts, A, x, y: fronts_product(fronts, A, x, y, False))


def mass_product_of(fronts: Any, p: Any, x: Any, y: Any) -> None:
    """Fill y = M x of a motion's mass matrix."""
    raise NotImplementedError


@overload(mass_product_of, inline="always")
def _mass_product_of(fronts, p, x, y):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, p, x, y: product_by_diagonals(p, x, y),
                  lambda fronts, p, x, y: fronts_product(fronts, p.mass, x, y, False))


@inner
def mass_product(p, x, y):  # type: ignore[no-untyped-def]
    """Fill y = M x of a motion's mass matrix."""
    mass_product_of(p.fronts, p, x, y)


def add_sizes(fronts: Any, A: Any, x: Any, y: Any) -> None:
    """Add |A| x to y."""
    raise NotImplementedError


@overload(add_sizes, inline="always")
def _add_sizes(fronts, A, x, y):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A, x, y: _add_sizes_of_band(A, x, y),
                  lambda fronts, A, x, y: fronts_product(fronts, A, x, y, True))


@inner
def _add_sizes_of_band(A, x, y):  # type: ignore[no-untyped-def]
    n, bw = len(y), A.shape[1] - 1
    for i in range(n):
        for j in range(max(0, i - bw), min(n, i + bw + 1)):
            y[i] += abs(A[i, bw + j - i] if j <= i else A[j, bw + i - j]) * x[j]


def keep_between(fronts: Any, A: Any, kind: Any) -> None:
    """Set to zero what is between unknowns of one kind (n,)."""
    raise NotImplementedError


@overload(keep_between, inline="always")
def _keep_between(fronts, A, kind):  # type: ignore[no-untyped-def]
    return chosen(fronts, lambda fronts, A, kind: _keep_of_band(A, kind),
                  lambda fronts, A, kind: _keep_of_fronts(fronts, A, kind))


@inner
def _keep_of_band(A, kind):  # type: ignore[no-untyped-def]
    bw = A.shape[1] - 1
    for i in range(A.shape[0]):
        for j in range(max(0, i - bw), i + 1):
            if kind[i] == kind[j]:
                A[i, bw + j - i] = 0.0


@inner
def _keep_of_fronts(fronts, A, kind):  # type: ignore[no-untyped-def]
    for q in range(len(fronts.parent)):
        first, pivots, start = fronts.first[q], fronts.first[q + 1] - fronts.first[q], fronts.start[q]
        height = pivots + fronts.start[q + 1] - start
        for i in range(height):
            row = first + i if i < pivots else fronts.rows[start + i - pivots]
            for j in range(min(i + 1, pivots)):
                if kind[row] == kind[first + j]:
                    A[fronts.at[q] + (i + 1) * (height - 1) + j] = 0.0
