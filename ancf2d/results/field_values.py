"""What can be shown of a stored field: its components, what follows from them, and values between the stations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ancf2d.results.records import FieldRecord

POSITIVE = ("mises", "energy")  # never below zero
Formula = Callable[[np.ndarray], np.ndarray]


def _one(s: np.ndarray, k: int) -> np.ndarray:
    return s[..., k]


def _mises(s: np.ndarray) -> np.ndarray:
    xx, yy, xy = s[..., 0], s[..., 1], s[..., 2]
    return np.sqrt(np.maximum(xx**2 - xx * yy + yy**2 + 3.0 * xy**2, 0.0))


# what can be shown beside the stored components, by field
DERIVED: dict[str, dict[str, Formula]] = {"stress": {"mises": _mises}}
LABELS = {("stress", "xx"): "stress along the axis, σ_xx", ("stress", "yy"): "stress across the axis, σ_yy",
          ("stress", "xy"): "shear stress, σ_xy", ("stress", "mises"): "von Mises stress",
          ("strain", "xx"): "strain along the axis, ε_xx", ("strain", "yy"): "strain across the axis, ε_yy",
          ("strain", "xy"): "shear strain, 2 ε_xy", ("energy", "energy"): "strain energy density",
          ("N", "N"): "axial force N", ("Q", "Q"): "shear force Q", ("M", "M"): "bending moment M"}


def formulas_of(record: FieldRecord) -> dict[str, Formula]:
    """Return by name what a field shows: each stored component, then what follows from all of them."""
    formulas: dict[str, Formula] = {c: partial(_one, k=k) for k, c in enumerate(record.components)}
    return formulas | DERIVED.get(record.name, {})


def label_of(field: str, component: str) -> str:
    """Return what a component of a field is called in a figure."""
    return LABELS.get((field, component), f"{field} {component}")


def linear_weights(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) of straight lines between values at ``nodes`` (n,), in any order."""
    order = np.argsort(nodes, kind="stable")
    return np.stack([np.interp(at, nodes[order], one) for one in np.eye(len(nodes))[:, order]], axis=-1)


def even_weights(n: int, at: np.ndarray) -> np.ndarray:
    """Return weights (len(at), n) of the polynomial through n evenly spaced values, at fractions in [0, 1]."""
    x, powers = np.linspace(-1.0, 1.0, n), np.arange(n)
    return ((2 * at - 1)[:, None] ** powers) @ np.linalg.inv(x[:, None] ** powers)
