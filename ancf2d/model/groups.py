"""Pools as kernel groups: laws sampled for each element class, and the plan of work in batches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..elements.formulations.base import StrainLaw
from ..elements.shape import Array
from ..interactions.forces import NaturalStrain
from ..kernels.batch import Group, Law
from ..kernels.compiled_laws import internal_address, law_address
from ..kernels.forces import batch_address
from ..kernels.lanes import LANES, BatchPlan, buffer_length, station_rows
from ..kernels.lowlevel.blas import dgemm_address
from ..kernels.lowlevel.records import Record
from ..kernels.stress_free import COMPUTED, Memory, Natural, memory_of_some, no_memory, no_natural, of_some
from ..kernels.tangents import fill_products
from .body_groups import Pool
from .classes import ElementClass
from .mesh import Index

Pair = tuple[int, int]


def pair(a: int, b: int) -> Pair:
    """Return an entry of a symmetric matrix as (row, column) in its lower half."""
    return max(a, b), min(a, b)


def first_and_others(nc: int, positions: list[int]) -> tuple[list[int], list[list[int]]]:
    """Return x and y of the first position, and of the others; positions : numbers of their shape functions."""
    first, *others = ([k * nc, k * nc + 1] for k in positions)
    return first, others


def made(n: int, first: list[int]) -> list[Pair]:
    """Return the entries of the lower half, for n coordinates, that are computed and do not follow from others."""
    return [(a, b) for a in range(n) for b in range(a + 1) if a not in first and b not in first]


def following(n: int, nc: int, positions: list[int], entries: Index) -> tuple[list[Pair], Index]:
    """Return the entries that follow from the computed ones (m, 2), and ``following`` of ``kernels.lanes.BatchPlan``.

    With just two positions there is nothing to sum, so nothing is rounded.
    """
    first, others = first_and_others(nc, positions)
    number = {(int(a), int(b)): k for k, (a, b) in enumerate(entries)}
    rest = [a for a in range(n) if a not in first]
    sums: list[tuple[int, int, int]] = []
    follow: list[Pair] = []
    for a, b in [*((a, b) for a in rest for b in first), *((a, b) for a in first for b in first if b <= a)]:
        sources = [number[p] for other in others if (p := pair(a, other[b - first[0]])) in number]
        if sources:
            target = number[pair(a, b)] = len(entries) + len(follow)
            sums += _sum(target, sources)
            follow.append(pair(a, b))
    places = [a for other in others for a in other]
    alike = [(a, a) for a in places] + [(a, b) for a in places for b in places if b < a]
    known = [number[p] for p in alike if p in number] if len(others) > 1 else []
    rounded = [(len(known), len(places), -1), *((k, 0, 0) for k in known)] if known else []
    return follow, np.array(rounded + sums, dtype=np.int64).reshape(-1, 3)


def _sum(target: int, sources: list[int]) -> list[tuple[int, int, int]]:
    """Return the rules for an entry that is minus the sum of all sources: two at once, then one by one."""
    return [(target, sources[0], sources[min(1, len(sources) - 1)]), *((target, target, k) for k in sources[2:])]


# products of all classes are stored up to this many entries (32 MB); beyond, each batch computes its own
KEPT = 4_000_000
# matrices with up to this many entries are computed whole, with their zeros: one product is faster than several
WHOLE = 2000
# BLAS never divides products of so few multiplications among threads, whose number would change the digits
ALONE = 200_000
# relative round-off of equal numbers: shape functions are scaled by the mean height of a body
ROUNDED = 1e-15
# axes of a law's arrays (classes, parts, ...) along which values have one magnitude
_COMPARED = {"B": (1, 3, 4), "ref": (1, 2, 3), "D": (1, 4)}


def make_group(pool: Pool, natural: list[NaturalStrain], like: tuple[Pool, Record] | None = None) -> Record:
    """Return the kernel group (``Group``) of a pool.

    ``natural`` are all natural-strain loads; those of other bodies are ignored. ``like`` is another pool with its
    group, whose classes are reused where they are the same.
    """
    plan, point = pool.plan, pool.plan.formulation.law
    nc = plan.element.components
    if like is not None and (like[0].kind != pool.kind or like[0].plan.formulation is not plan.formulation):
        like = None
    if like is not None:
        law, batches = _law_like(pool, *like)
    else:
        B, ref, D = _sampled_classes(pool, pool.classes)
        n, positions = B.shape[3], [k for k, (_, name) in enumerate(plan.element.functionals) if name == "r"]
        blocks, pairs, entries = _blocks(B, nc, made(n, first_and_others(nc, positions)[0]))
        follow, rules = following(n, nc, positions, entries)
        parts = _parts(B.shape[1], blocks)
        law = Law(law_address(point), internal_address(point), point.fields, point.strains, point.references,
                  point.state, point.timed, *_in_parts_of_law(B, ref, D, parts))
        batches = _plan(law, parts, nc, blocks, pairs, np.concatenate([entries, np.array(follow)]), rules)
    parts = batches.parts
    group = Group(law, _natural(pool, natural, parts), _memory(law, point, parts, len(pool.dofs)),
                  np.ascontiguousarray(pool.cls, dtype=np.int64), np.ascontiguousarray(pool.turn),
                  np.ascontiguousarray(pool.dofs, dtype=np.int64), batches)
    return Record(group) if like is None else like[1].replaced(**group._asdict())


def _sampled_classes(pool: Pool, classes: Sequence[ElementClass]) -> tuple[Array, Array, Array]:
    """Return B, ref and D (classes, stations, ...) of classes of elements."""
    samples = [pool.plan.formulation.sample(c.sampler, pool.plan.rule) for c in classes]
    B, ref, D = (np.array(part) for part in zip(*samples, strict=True))
    return B, ref, D


def _in_parts_of_law(B: Array, ref: Array, D: Array, parts: int) -> tuple[Array, Array, Array]:
    """Return B, ref and D in the layout of a ``Law``."""
    return _in_parts(B, parts, 2), _in_parts(ref, parts, 2), _in_parts(D, parts, 3, 0.0)


def _law_like(pool: Pool, other: Pool, group: Record) -> tuple[Law, BatchPlan]:
    """Return law and plan of a pool, with the sampled classes of another pool's group where they are the same."""
    old, plan = group.values.law, group.values.plan
    place = {id(c): k for k, c in enumerate(other.classes)}
    source = [place.get(id(c), -1) for c in pool.classes]
    new = [k for k, at in enumerate(source) if at < 0]
    law = old
    if new or source != list(range(len(other.classes))):
        known = old.B, old.ref, old.D
        own = _in_parts_of_law(*_sampled_classes(pool, [pool.classes[k] for k in new]), plan.parts) if new else known
        B, ref, D = (_rows(one, two, source, new, plan.parts) for one, two in zip(known, own, strict=True))
        law = old._replace(B=B, ref=ref, D=D)
    fresh = _with_own_work(plan)._replace(coupled=_coupled(law))
    if law is old or np.array_equal(law.B, old.B):
        return law, fresh
    return law, _with_products(law, fresh._replace(vectors=_vectors(law, pool.plan.element.components)))


def _with_products(law: Law, plan: BatchPlan) -> BatchPlan:
    """Return a plan with the stored products of all classes, unless these are too many."""
    size = plan.products.shape[1]
    kept = len(law.B) if len(law.B) * size <= KEPT else 0
    plan = plan._replace(products=np.zeros((kept, size)))
    for q in range(kept):
        fill_products(law.B, q, plan, plan.products[q])
    return plan


def _rows(old: Array, new: Array, source: Sequence[int], at: Sequence[int], parts: int) -> Array:
    """Return the parts of classes: from ``source`` in the old ones, or the new ones at places ``at``."""
    if len(at) == len(source):
        return new
    old, new = (x.reshape(-1, parts, *x.shape[1:]) for x in (old, new))
    out = old[np.maximum(source, 0)]
    out[at] = new[:len(at)]
    return out.reshape(-1, *out.shape[2:])


def _memory(law: Law, point: StrainLaw, parts: int, elements: int) -> Memory:
    """Return the initial history variables of elements; those of a timed law are fully relaxed."""
    if not law.state or point.elastic:
        return no_memory()
    stations, points = parts * law.B.shape[2], law.B.shape[1] // law.fields
    if point.inelastic:
        # stations come last that only bear shear, or the stretch of sections
        bears = np.any(law.D[:, list(point.inelastic)] != 0.0, axis=(1, 2)).reshape(-1, stations).any(axis=0)
        stations = 1 + int(np.flatnonzero(bears)[-1])
    states = np.zeros((elements, stations, points * law.state))
    if point.timed:
        states[:, :, law.state - 1::law.state] = np.inf
    return no_memory()._replace(row=np.arange(elements), states=states)


def with_states(groups: list[Record]) -> tuple[list[Record], Array]:
    """Return groups that use copies of their states, all in one array, and this array."""
    states = np.concatenate([np.zeros(0), *(g.values.memory.states.ravel() for g in groups)])
    out, at = [], 0
    for group in groups:
        memory = group.values.memory
        own = states[at:at + memory.states.size].reshape(memory.states.shape)
        at += own.size
        out.append(group.replaced(memory=memory._replace(states=own)) if own.size else group)
    return out, states


def with_prescribed(groups: list[Record]) -> tuple[list[Record], Array, Array]:
    """Return groups whose relaxing laws can use prescribed internal strains instead of their own.

    Also return the prescribed strains and those increments of them that dissipate energy (2, k), group after group, and
    slopes.
    """
    laws, memories = ([getattr(group.values, name) for group in groups] for name in ("law", "memory"))
    sizes = [x.states.size // law.state * law.strains if law.timed else 0
             for law, x in zip(laws, memories, strict=True)]
    prescribed, slopes, ends = np.zeros((2, sum(sizes))), np.full(len(groups), COMPUTED), np.cumsum(sizes).tolist()
    out = []
    for k, (group, memory, size, end) in enumerate(zip(groups, memories, sizes, ends, strict=True)):
        views = (x[end - size:end].reshape(*memory.states.shape[:2], -1) for x in prescribed) if size else ()
        out.append(group.replaced(memory=memory._replace(slope=slopes[k:k + 1], **dict(
            zip(("prescribed", "change"), views, strict=True)))) if size else group)
    return out, prescribed, slopes


def with_trials(groups: list[Record]) -> list[Record]:
    """Return groups that also store the trial history variables of the last state whose forces were computed."""
    memories = [group.values.memory for group in groups]
    return [group.replaced(memory=memory._replace(trial=np.empty_like(memory.states))) if memory.states.size else group
            for group, memory in zip(groups, memories, strict=True)]


def _with_own_work(plan: BatchPlan) -> BatchPlan:
    """Return a plan with work arrays of its own."""
    return plan._replace(loaded=np.full_like(plan.loaded, -1), work=np.zeros_like(plan.work))


def with_own_arrays(group: Record) -> Record:
    """Return a copy of a group that shares no written array: with own work arrays and amounts of natural strains."""
    natural = group.values.natural
    return group.replaced(plan=_with_own_work(group.values.plan),
                          natural=natural._replace(amount=natural.amount.copy()))


def of_elements(group: Record, which: Index | slice) -> Record:
    """Return a group of some elements, with work arrays of its own."""
    plan = _with_own_work(group.values.plan)
    turn = np.ascontiguousarray(group.turn[which]) if len(group.turn) > 1 else group.turn
    return group.replaced(cls=np.ascontiguousarray(group.cls[which]), turn=turn, plan=plan,
                          natural=of_some(group.values.natural, which),
                          memory=memory_of_some(group.values.memory, which),
                          dofs=np.ascontiguousarray(group.dofs[which]))


def unlike(groups: Sequence[Record]) -> Index:
    """Return the elements (m,) whose forces can differ between several groups of the same elements, at equal d.

    Elements with natural strains are included, as signals set these.
    """
    first, *others = (group.values for group in groups)
    found = np.full(len(first.dofs), any(len(group.natural.pattern) > 0 for group in groups))
    for other in others:
        if other.law.address != first.law.address or other.law.B.shape[1:] != first.law.B.shape[1:]:
            found[:] = True
            continue
        found |= (first.turn != other.turn).any(axis=1)
        pairs, place = np.unique(np.array([first.cls, other.cls]), axis=1, return_inverse=True)
        for name, axes in _COMPARED.items():
            one, two = (x.reshape(-1, first.plan.parts, *x.shape[1:])[k] for x, k in
                        zip((getattr(first.law, name), getattr(other.law, name)), pairs, strict=True))
            far = np.abs(one - two) > ROUNDED * np.abs(one).max(axis=axes, keepdims=True)
            found |= far.reshape(len(far), -1).any(axis=1)[place.ravel()]
    return np.flatnonzero(found)


def _blocks(B: Array, nc: int, entries: list[tuple[int, int]]) -> tuple[Index, Index, Index]:
    """Return blocks, pairs and entries of ``kernels.lanes.BatchPlan``: one block, or one per pair of components."""
    nu = B.shape[2]
    component = np.array([_component(B[:, :, i], nc) for i in range(nu)])
    pairs = [(i, j) for i in range(nu) for j in range(i, nu)]
    kinds = [frozenset({p, q}) for p in range(nc) for q in range(p, nc)]
    if len(pairs) * B.shape[1] * len(entries) <= WHOLE:
        return np.array([[0, len(pairs), 0, len(entries)]]), np.array(pairs), np.array(entries)
    blocks: list[list[int]] = []
    some: list[tuple[int, int]] = []
    ordered: list[tuple[int, int]] = []
    for kind in kinds:
        fields = [(i, j) for i, j in pairs if {component[i], component[j]} == kind]
        places = [(a, b) for a, b in entries if {a % nc, b % nc} == kind]
        if fields:
            blocks.append([len(some), len(fields), len(ordered), len(places)])
            some += fields
            ordered += places
    return np.array(blocks), np.array(some), np.array(ordered)


def _component(rows: Array, nc: int) -> int:
    """Return the component of the coordinates that a field depends on."""
    (found,) = {int(a) % nc for a in np.nonzero(np.any(rows, axis=(0, 1)))[0]}
    return found


def _parts(stations: int, blocks: Index) -> int:
    """Return the number of parts that the stations are divided into, so that each fits the lanes and one thread."""
    together = min(LANES, max(1, ALONE // int(np.max(blocks[:, 1] * blocks[:, 3]))))
    return -(-stations // together)


def _in_parts(x: Array, parts: int, axis: int, weight: float = 1.0) -> Array:
    """Return sampled values (classes, stations, ...) as (classes parts, ...) with the stations moved to ``axis``.

    The last part is padded with copies of the first station times ``weight``.
    """
    length = -(-x.shape[1] // parts)
    missing = parts * length - x.shape[1]
    if missing:
        x = np.concatenate([x, np.repeat(weight * x[:, :1], missing, axis=1)], axis=1)
    x = x.reshape(x.shape[0] * parts, length, *x.shape[2:])
    return np.ascontiguousarray(np.moveaxis(x, 1, axis))


def _plan(law: Law, parts: int, nc: int, blocks: Index, pairs: Index, entries: Index, rules: Index) -> BatchPlan:
    nu, S, n = law.B.shape[1:]
    points = nu // law.fields
    size = S * int(np.sum(blocks[:, 1] * blocks[:, 3]))
    most = max(1, min(LANES // S, ALONE // (S * int(np.max(blocks[:, 1] * blocks[:, 3])))))
    at = station_rows(law.fields, law.strains, law.references, law.state, points)
    length = buffer_length(at, n, max(nu, len(pairs)), len(entries), size)
    return _with_products(law, BatchPlan(parts, most, _vectors(law, nc), _coupled(law), blocks, pairs, entries, rules,
                                    np.zeros((0, size)), np.full(2, -1), np.zeros(length), dgemm_address(),
                                    batch_address()))


def _coupled(law: Law) -> Index:
    """Return whether D couples the points (points, points) of a station."""
    points, ns = law.B.shape[1] // law.fields, law.D.shape[1]
    D = np.abs(law.D).max(axis=(0, 3)).reshape(points, ns // points, points, ns // points)
    return (D.max(axis=(1, 3)) > 0.0).astype(np.int64)


def _vectors(law: Law, nc: int) -> Index:
    """Return the pairs of fields (v, 2) that are x and y of a vector: the same functions of the x and y coordinates."""
    x, y = law.B[..., 0::nc], law.B[..., 1::nc]
    # few pairs are equal in the first class
    alike = (x[0][:, None] == y[0][None]).all(axis=(2, 3))
    left, found = set(range(law.B.shape[1])), []
    for i in range(law.B.shape[1]):
        point = range(i // law.fields * law.fields, (i // law.fields + 1) * law.fields)
        same = [j for j in point if j in left and alike[i, j] and x[:, i].any() and np.array_equal(x[:, i], y[:, j])]
        if same:
            found.append((i, same[0]))
            left -= {i, same[0]}
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _natural(pool: Pool, loads: list[NaturalStrain], parts: int) -> Natural:
    """Return the natural strains of a pool, its stations divided into parts."""
    own = [load for load in loads if any(load.mesh is mesh for mesh in pool.meshes)]
    if not own:
        return no_natural()
    first = {id(mesh): at for mesh, at in zip(pool.meshes, pool.first.tolist(), strict=True)}
    codes = np.zeros((len(pool.cls), 1 + len(own)), dtype=np.int64)
    codes[:, 0] = pool.cls
    for k, load in enumerate(own):
        at = first[id(load.mesh)]
        codes[at:at + len(load.mesh.dofs), 1 + k] = load.places()
    found, example, pattern = np.unique(codes, axis=0, return_index=True, return_inverse=True)
    amount, signal = np.zeros((len(own), 3)), np.zeros(len(own), dtype=np.int64)
    stretch = []
    for k, load in enumerate(own):
        load.amount, load.signal = amount[k], signal[k:k + 1]
        rows = [_sampled(pool, load, int(c[0]), int(e) - first[id(load.mesh)], bool(c[1 + k]))
                for c, e in zip(found, example, strict=True)]
        stretch.append(_in_parts(np.stack(rows), parts, 2))
    law = pool.plan.formulation.law
    quadratic = np.zeros(law.strains)
    quadratic[list(law.quadratic)] = 1.0
    return Natural(np.ascontiguousarray(np.stack(stretch)), quadratic,
                   np.ascontiguousarray(pattern.ravel(), dtype=np.int64), amount, signal)


def _sampled(pool: Pool, load: NaturalStrain, cls: int, element: int, strained: bool) -> Array:
    """Return the natural strains (stations, strains of all points) of one element of a class."""
    natural, rule = pool.plan.formulation.natural, pool.plan.rule
    # the model builder refuses natural strains for other formulations
    assert natural is not None
    return natural(pool.classes[cls].sampler, rule,
                   lambda xi: load.along(element, xi) if strained else np.zeros((4, len(xi))))
