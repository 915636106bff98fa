"""Tangents of batches, K = B^T H B, in packed form without zero entries.

Entry (a, b) is the sum over stations and fields i <= j of H_ij (B_ia B_jb + B_ja B_ib), once where i = j. The brackets
are constants of a class, so one matrix product computes the tangents of a batch.
"""

from __future__ import annotations

import numpy as np

from .batch import copy_rows, is_rotated, layout, matrices, points_of, turn_rows
from .lanes import vectors_of
from .lowlevel.blas import multiply
from .lowlevel.jit import inner, kernel
from .lowlevel.records import STRIDE, array_at

# bits kept of the 53 of a number, so that sums of a few numbers are exact
ROUNDED_BITS = 51


@kernel
def fill_products(B, q, plan, out):  # type: ignore[no-untyped-def]
    """Fill out with the factors of the entries of H for class q: block by block, (entries, pairs, stations)."""
    S = B.shape[2]
    at = 0
    for b in range(len(plan.blocks)):
        for m in range(plan.blocks[b, 2], plan.blocks[b, 2] + plan.blocks[b, 3]):
            x, y = plan.entries[m, 0], plan.entries[m, 1]
            for k in range(plan.blocks[b, 0], plan.blocks[b, 0] + plan.blocks[b, 1]):
                i, j = plan.pairs[k, 0], plan.pairs[k, 1]
                for s in range(S):
                    v = B[q, i, s, x] * B[q, j, s, y]
                    if i != j:
                        v += B[q, j, s, x] * B[q, i, s, y]
                    out[at] = v
                    at += 1


@inner
def row_of_H(i, j, points, fields):  # type: ignore[no-untyped-def]
    """Return the row of H_ij relative to at.H: blocks of points, fields x fields each."""
    return ((i // fields) * points + j // fields) * fields * fields + (i % fields) * fields + j % fields


@inner
def turn_H(group, lanes):  # type: ignore[no-untyped-def]
    """Rotate H, given by its upper half, out of the element frames: rows, then columns."""
    work, vectors = group.plan.work, group.plan.vectors
    at, _ = layout(group.law)
    nu, NU, P = group.law.B.shape[1], group.law.fields, points_of(group.law)
    for i in range(nu):
        for j in range(i):
            copy_rows(work, (at.H + row_of_H(j, i, P, NU)) * STRIDE, 0, (at.H + row_of_H(i, j, P, NU)) * STRIDE, 0, 1,
                      lanes)
    for v in range(len(vectors)):
        x, y = vectors[v, 0], vectors[v, 1]
        for j in range(nu):
            turn_rows(work, at.H + row_of_H(x, j, P, NU), at.H + row_of_H(y, j, P, NU), at.turn, 1.0, lanes)
    for v in range(len(vectors)):
        x, y = vectors[v, 0], vectors[v, 1]
        for i in range(nu):
            turn_rows(work, at.H + row_of_H(i, x, P, NU), at.H + row_of_H(i, y, P, NU), at.turn, 1.0, lanes)


@inner
def tangents(group, part, q, count):  # type: ignore[no-untyped-def]
    """Add the packed tangents (entries, count) of H of this part (part 0: set them), in global components."""
    law, plan = group.law, group.plan
    S = law.B.shape[2]
    at, _ = layout(law)
    _, flat, _, start, scratch = matrices(group, at)
    lanes = S * count
    if is_rotated(group):
        turn_H(group, vectors_of(lanes))
    for k in range(len(plan.pairs)):
        source = at.H + row_of_H(plan.pairs[k, 0], plan.pairs[k, 1], points_of(law), law.fields)
        copy_rows(plan.work, source * STRIDE, 0, flat + k * lanes, 0, 1, lanes)
    size = plan.products.shape[1]
    if len(plan.products) == 0:
        fill_products(law.B, q, plan, array_at(plan.work, scratch, (size,)))
    where = 0
    for b in range(len(plan.blocks)):
        columns, m = plan.blocks[b, 1] * S, plan.blocks[b, 3]
        H, K = flat + plan.blocks[b, 0] * lanes, start + plan.blocks[b, 2] * count
        if len(plan.products) == 0:
            multiply(plan.dgemm, plan.work, scratch + where, plan.work, H, plan.work, K, m, columns, count, part > 0)
        else:
            multiply(plan.dgemm, plan.products, q * size + where, plan.work, H, plan.work, K, m, columns, count,
                     part > 0)
        where += m * columns
    if part == plan.parts - 1:
        apply_rules(plan.rules, array_at(plan.work, start, (len(plan.entries), count)))


@inner
def apply_rules(rules, K):  # type: ignore[no-untyped-def]
    """Fill the entries of tangents K (entries, m) that follow from others, so that translations cause exactly no force.

    The round-off of an element acts like a spring to the ground of stiffness EA/l times the unit round-off. It is the
    same in equal elements, and in a million of them it exceeds the bending stiffness. The entries of the first node's
    position are therefore minus the sum of those of the other nodes, which is exact because all summands are first
    rounded to multiples of one number. Rules: (n, m, -1), followed by n rows (entry, 0, 0): round these entries, by the
    largest of the first m, which are on the diagonal; (t, a, a): K_t = -K_a; (t, a, b): K_t = -K_a - K_b; (t, t, b):
    subtract K_b from K_t.
    """
    k, count = 0, K.shape[1]
    flat = array_at(K, 0, (K.shape[0] * count,))
    while k < len(rules):
        if rules[k, 2] < 0:
            _round_alike(rules, k + 1, k + 1 + rules[k, 1], k + 1 + rules[k, 0], flat, count)
            k += rules[k, 0]
        else:
            t, a, b = rules[k, 0] * count, rules[k, 1] * count, rules[k, 2] * count
            if a == t:
                for m in range(count):
                    flat[t + m] -= flat[b + m]
            elif a == b:
                for m in range(count):
                    flat[t + m] = -flat[a + m]
            else:
                for m in range(count):
                    flat[t + m] = -flat[a + m] - flat[b + m]
        k += 1


@inner
def _round_alike(rules, first, diagonal, last, flat, count):  # type: ignore[no-untyped-def]
    """Round entries to multiples of one power of two, chosen from the largest entry on the diagonal."""
    largest = 0.0
    for k in range(first, diagonal):
        for m in range(count):
            v = abs(flat[rules[k, 0] * count + m])
            if v > largest:
                largest = v
    if 1e-250 < largest < np.inf:
        grain = 2.0 ** (np.ceil(np.log2(largest)) - ROUNDED_BITS)
        over = 1.0 / grain
        for k in range(first, last):
            start = rules[k, 0] * count
            for m in range(count):
                flat[start + m] = np.rint(flat[start + m] * over) * grain
