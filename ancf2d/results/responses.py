"""Frequency responses between the points at which they are computed."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml

from .reader import Results

# largest invisible distance of a chord from the curve, relative to the response; most chords between two points
UNSEEN, MOST = 3e-4, 64


def interpolated(x: np.ndarray, values: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values at ``at`` by the cubic through the four nearest points x, and the largest magnitude at these."""
    count = min(4, len(x))
    first = np.clip(np.searchsorted(x, at) - count // 2, 0, len(x) - count)
    some = first[:, None] + np.arange(count)
    near = x[some]
    weights = np.ones(near.shape)
    for i in range(count):
        for j in range(count):
            if j != i:
                weights[:, i] *= (at - near[:, j]) / (near[:, i] - near[:, j])
    shape = (*weights.shape, *(1,) * (values.ndim - 1))
    return (weights.reshape(shape) * values[some]).sum(axis=1), np.abs(values[some]).max(axis=1)


def spacing(results: Results) -> str:
    """Return ``log`` or ``linear`` if the points of a file were placed in a range, else an empty text."""
    solver: dict[str, Any] = yaml.safe_load(results.case_completed)["solver"]
    return "" if solver.get("from") is None else str(solver.get("scale", "log"))


def smooth(hz: np.ndarray, H: np.ndarray, scale: str) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and responses (m,), with points added until straight lines between them look like the curve.

    Points that were placed in a range (``scale`` of ``spacing``) are so close that cubics through four of them are
    accurate; other points are returned unchanged.
    """
    if not scale or len(hz) < 4:
        return hz, H
    x = np.log(hz) if scale == "log" else hz
    middle, size = interpolated(x, H, 0.5 * (x[1:] + x[:-1]))
    bend = np.abs(middle - 0.5 * (H[1:] + H[:-1])) / np.where(size > 0.0, size, 1.0)
    chords = np.clip(np.ceil(np.sqrt(bend / UNSEEN)), 1, MOST).astype(int)
    more = np.concatenate([a + (b - a) * np.arange(1, n) / n for a, b, n in zip(x, x[1:], chords, strict=False)])
    at = np.concatenate([x, more])
    order = np.argsort(at)
    values = np.concatenate([H, interpolated(x, H, more)[0]])
    return np.concatenate([hz, np.exp(more) if scale == "log" else more])[order], values[order]
