"""Multifrontal elimination of branched frames: which unknowns are eliminated together, and which they couple to.

Unknowns are ordered by minimum degree, which eliminates a frame from its free ends along its members and into its
loops. The unknowns that are eliminated together and the later ones that they couple to form a front. The fronts form a
tree, in which each adds its Schur complement to its parent (Duff & Reid 1983, The multifrontal solution of indefinite
sparse symmetric linear equations). All of this depends only on the mesh and is done once.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from ..kernels.matrices.layout import Fronts
from .mesh import Index

# measured costs relative to updating a block of 4 x 4 numbers with four pivots: a front, four pivots, dividing a block
# by them, a single pivot, a number that it changes, a number passed to the parent
FRONT, FOUR, DIVIDED, ALONE, CHANGED, HANDED = 12.0, 4.0, 1.6, 3.0, 0.1, 0.2


@cache
def cost(pivots: int, below: int) -> float:
    """Return the cost of a front of ``pivots`` unknowns above ``below`` rows, in updates of 4 x 4 blocks."""
    total = FRONT + 0.5 * HANDED * below**2
    for k in range(0, pivots - pivots % 4, 4):
        blocks = -(-(pivots + below - k - 4) // 4)
        total += FOUR + DIVIDED * blocks + 0.5 * blocks * (blocks + 1)
    for k in range(pivots - pivots % 4, pivots):
        total += ALONE + CHANGED * (pivots + below - k) ** 2
    return total


def band_cost(n: int, half_bandwidth: int) -> float:
    """Return the cost of factoring a band, in the same unit."""
    blocks = -(-half_bandwidth // 4)
    return 0.25 * n * (FOUR + DIVIDED * blocks + 0.5 * blocks * (blocks + 1))


def fronts_cost(fronts: Fronts) -> float:
    """Return the total cost of the fronts."""
    return sum(cost(int(s), int(u)) for s, u in zip(np.diff(fronts.first), np.diff(fronts.start), strict=True))


def _alike(n: int, sets: list[Index]) -> Index:
    """Return labels (n,), equal for unknowns that occur in the same rows of the same sets."""
    random, marks = np.random.default_rng(1), np.zeros(n, dtype=np.uint64)
    for rows in sets:
        used = rows >= 0
        mark = random.integers(1, 2**63, size=len(rows), dtype=np.uint64)
        np.add.at(marks, rows[used], np.broadcast_to(mark[:, None], rows.shape)[used])
    marks = np.where(marks == 0, np.arange(1, n + 1, dtype=np.uint64), marks)
    return np.asarray(np.unique(marks, return_inverse=True)[1], dtype=np.int64).ravel()


def meeting(n: int, sets: list[Index]) -> Any:
    """Return which of n unknowns share a row of a set (-1 for none), as compressed sparse rows with the diagonal.

    Computed as a sparse product, because a list of all pairs would exhaust the memory where long bodies touch.
    """
    from scipy.sparse import coo_array, eye_array

    rows, columns, first = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], 0
    for part in sets:
        used = part >= 0
        rows.append(np.broadcast_to(first + np.arange(len(part))[:, None], part.shape)[used])
        columns.append(part[used])
        first += len(part)
    at = np.concatenate(rows), np.concatenate(columns)
    inside = coo_array((np.ones(len(at[0]), dtype=np.int32), at), shape=(first, n)).tocsr()
    out = (inside.T @ inside + eye_array(n, dtype=np.int32, format="csr")).tocsr()
    out.sort_indices()
    return out


def _graph(count: int, labels: Index, sets: list[Index]) -> Any:
    """Return which labels share a row of a set."""
    return meeting(count, [np.where(part >= 0, labels[part], -1) for part in sets])


def least_degree(n: int, sets: list[Index]) -> Index:
    """Return the position (n,) of each unknown in a minimum-degree order; unknowns couple in the rows of ``sets``.

    The order is that of SuperLU's multiple minimum degree; equally coupled unknowns are next to each other.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.linalg import splu

    labels = _alike(n, sets)
    graph = csr_matrix(_graph(int(labels.max()) + 1, labels, sets), dtype=float)
    graph.data[:] = -1.0
    graph.setdiag(1.0 + np.diff(graph.indptr))
    order = splu(graph.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    position = np.empty(n, dtype=np.int64)
    position[np.lexsort((np.arange(n), np.asarray(order.perm_c)[labels]))] = np.arange(n)
    return position


def make_fronts(position: Index, sets: list[Index]) -> Fronts:
    """Return the fronts of unknowns that are eliminated in the order ``position`` (n,).

    Their rows differ from ``position`` only where the order does not matter: the pivots of a front are consecutive.
    """
    n = len(position)
    order = np.argsort(position)
    labels = _alike(n, sets)[order]
    # equally coupled unknowns are eliminated together, as a run
    ends = np.append(np.flatnonzero(np.diff(labels)) + 1, n)
    runs = [order[a:b] for a, b in zip(np.append(0, ends[:-1]), ends, strict=True)]
    run_of = np.empty(n, dtype=np.int64)
    run_of[order] = np.repeat(np.arange(len(runs)), np.diff(np.append(0, ends)))
    reached = _reached(_graph(len(runs), run_of, sets))
    sizes = [len(r) for r in runs]
    members, parent = _merged(sizes, reached)
    return _numbered(members, parent, runs, sizes, reached, position)


def _reached(graph: Any) -> list[set[int]]:
    """Return the later runs that each run couples to when it is eliminated, fill-in included."""
    out: list[set[int]] = []
    children: list[list[int]] = [[] for _ in range(graph.shape[0])]
    for j in range(graph.shape[0]):
        later = graph.indices[graph.indptr[j]:graph.indptr[j + 1]]
        found = set(later[later > j].tolist()).union(*(out[c] for c in children[j]))
        found.discard(j)
        out.append(found)
        if found:
            children[min(found)].append(j)
    return out


def _merged(sizes: list[int], reached: list[set[int]]) -> tuple[dict[int, list[int]], dict[int, int]]:
    """Return the runs of each front by its last run, and the parents; merge children where this costs less."""
    below = [sum(sizes[k] for k in r) for r in reached]
    pivots, parent = list(sizes), {j: min(r) if r else -1 for j, r in enumerate(reached)}
    members: dict[int, list[int]] = {}
    children: dict[int, list[int]] = {j: [] for j in range(-1, len(sizes))}
    for j in range(len(sizes)):
        members[j] = [j]
        for c in sorted(children[j], key=lambda c: -below[c]):
            together = cost(pivots[j] + pivots[c], below[j])
            if together <= cost(pivots[j], below[j]) + cost(pivots[c], below[c]):
                pivots[j] += pivots[c]
                members[j] = members.pop(c) + members[j]
                del parent[c]
                for k in children[c]:
                    parent[k] = j
                children[j] += children[c]
        # merged children are no longer children
        children[j] = [c for c in children[j] if c in parent]
        children[parent[j]].append(j)
    return members, parent


def _numbered(members: dict[int, list[int]], parent: dict[int, int], runs: list[Index], sizes: list[int],
              reached: list[set[int]], position: Index) -> Fronts:
    """Return the fronts, numbered so that children come right before their parents."""
    order = _children_first(parent)
    final, unknown, first = np.empty(len(position), dtype=np.int64), np.empty(len(position), dtype=np.int64), [0]
    for j in order:
        unknowns = np.concatenate([runs[k] for k in sorted(members[j])])
        final[unknowns] = first[-1] + np.arange(len(unknowns))
        first.append(first[-1] + len(unknowns))
    rows = [np.sort(final[np.concatenate([runs[k] for k in reached[j]])]) if reached[j] else np.zeros(0, np.int64)
            for j in order]
    start = np.concatenate([[0], np.cumsum([len(r) for r in rows])])
    number = {j: k for k, j in enumerate(order)}
    above = [number.get(parent[j], -1) for j in order]
    into = []
    for k, q in enumerate(above):
        whole = np.append(np.arange(first[q], first[q + 1]), rows[q]) if q >= 0 else rows[k]
        into.append(np.searchsorted(whole, rows[k]))
    heights = np.diff(first) + np.diff(start)
    unknown[final] = np.arange(len(final))
    return Fronts(np.array(first), start, np.concatenate(rows), np.concatenate(into),
                  np.concatenate([[0], np.cumsum(heights**2)]), np.array(above),
                  np.repeat(np.arange(len(order)), np.diff(first)), int(heights.max()), unknown, final,
                  np.zeros(2, dtype=np.int64))


def _children_first(parent: dict[int, int]) -> list[int]:
    """Return the fronts in postorder, each right after the last of its children."""
    children: dict[int, list[int]] = {}
    for j in sorted(parent, reverse=True):
        children.setdefault(parent[j], []).append(j)
    out, stack = [], list(children.get(-1, []))
    # parents before children, then reversed
    while stack:
        out.append(stack.pop())
        stack += children.get(out[-1], [])
    return out[::-1]
