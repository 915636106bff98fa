"""Matrices of motions as dense arrays."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array
from ...kernels.lowlevel.records import Record
from ...kernels.matrices.layout import Fronts, entries, stored_entries
from ...kernels.motion.feedback import tail_size


def dense(A: Array, p: Record) -> Array:
    """Return a dense matrix from one stored as in ``kernels.matrices.symmetric``, including the terms of feedback."""
    n, rank, states = len(p.coordinate), p.rank, p.feedback.states
    tail = 0
    if rank:
        tail = tail_size(n, rank, states)
    base, out = A[:len(A) - tail], np.zeros((n, n))
    out[:p.inner, :p.inner] = _of_band(base.reshape(-1, p.width)) if p.width else _of_fronts(base, p.fronts)
    if rank:
        P, R = A[len(base):len(base) + 2 * rank * n].reshape(2, rank, n)
        out += P.T @ R
        inner = np.arange(p.inner, n)
        out[inner, inner] += A[len(base) + 2 * rank * n:][:states]
    return out


def _of_fronts(A: Array, fronts: Fronts) -> Array:
    n = len(fronts.owner)
    out = np.zeros((n, n))
    i, j = stored_entries(fronts)
    out[i, j] = out[j, i] = A[entries(fronts, i, j)]
    return out


def _of_band(band: Array) -> Array:
    n, w = band.shape
    out = np.zeros((n, n))
    for k in range(w):
        i = np.arange(k, n)
        out[i, i - k] = out[i - k, i] = band[k:, w - 1 - k]
    return out
