"""Compiled strain functions: the type of a law selects its formulation, also in cached kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from ..elements.formulations import FORMULATIONS

_BY_LAW = {f.law: f for f in FORMULATIONS.values()}


def strain(law: Any, c: int, s: int, u: Any, eps: Any, J: Any) -> None:
    """Fill eps and J = d eps/du at station s of class c (J's zeros must be zero on entry)."""
    _BY_LAW[type(law)].strain(law, c, s, u, eps, J)


def geometric(law: Any, c: int, s: int, u: Any, sigma: Any, H: Any) -> None:
    """Add sigma . d2 eps/du2 to H."""
    _BY_LAW[type(law)].geometric(law, c, s, u, sigma, H)


def mean(law: Any, c: int, s: int, u0: Any, u1: Any, eps0: Any, eps1: Any, J: Any) -> None:
    """Overwrite J of ``strain`` with the discrete Jacobian: J (u1 - u0) = eps1 - eps0, the strains given.

    Not a number where the formulation has none (``Formulation.mean`` tells it beforehand).
    """
    (_BY_LAW[type(law)].mean or _no_mean)(law, c, s, u0, u1, eps0, eps1, J)


def _no_mean(law, c, s, u0, u1, eps0, eps1, J):  # type: ignore[no-untyped-def]
    J[:] = np.nan


@overload(strain, inline="always")
def _strain(law, c, s, u, eps, J):  # type: ignore[no-untyped-def]
    return _BY_LAW[law.instance_class].strain


@overload(geometric, inline="always")
def _geometric(law, c, s, u, sigma, H):  # type: ignore[no-untyped-def]
    return _BY_LAW[law.instance_class].geometric


@overload(mean, inline="always")
def _mean(law, c, s, u0, u1, eps0, eps1, J):  # type: ignore[no-untyped-def]
    return _BY_LAW[law.instance_class].mean or _no_mean
