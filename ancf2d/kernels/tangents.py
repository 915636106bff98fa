"""Tangents of batches: K = sum of entries of H times what B makes of them, packed, without the zeros.

Entry (a, b) of B^T H B is the sum over stations and fields i <= j of H_ij (B_ia B_jb + B_ja B_ib), once where i = j.
The factors in brackets are constants of a class: one product of matrices makes the tangents of a batch.
"""

from __future__ import annotations

from .batch import copy_rows, layout, matrices, points_of, turn_rows, turned
from .blas import multiply
from .jit import inlined, inner, kernel
from .lanes import STRIDE, array_at, vectors_of


@kernel
def fill_products(B, q, plan, out):  # type: ignore[no-untyped-def]
    """Fill what the entries of H of class q are multiplied by: block by block, (entries, pairs, stations)."""
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


@inlined
def row_of_H(i, j, points, fields):  # type: ignore[no-untyped-def]
    """Return the row of H_ij behind at.H: blocks of points, fields x fields each."""
    return ((i // fields) * points + j // fields) * fields * fields + (i % fields) * fields + j % fields


@inner
def turn_H(group, lanes):  # type: ignore[no-untyped-def]
    """Turn H, given by its upper half, out of the frames of the elements: rows, then columns."""
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
    """Make the packed tangents (entries, count) of what is in H, all parts so far, in global components."""
    law, plan = group.law, group.plan
    S = law.B.shape[2]
    at, _ = layout(law)
    _, flat, _, start, scratch = matrices(group, at)
    lanes = S * count
    if turned(group):
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
