"""Vector lanes: the stations of several elements side by side, at which laws are evaluated in vector instructions.

A batch is a run of elements of one class. Its lanes are the stations of all its elements, station by station, with the
elements inside. Each row of the work buffer holds one component for all lanes. Fields u = B d, forces B^T g and
tangents are matrix products for the whole batch at once (BLAS).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import register_jitable

from .lowlevel.jit import inner
from .lowlevel.records import STRIDE

# most lanes of a batch; the distance of rows is larger (STRIDE)
LANES = 64
# the number of lanes is rounded up to a multiple of this
VECTOR = 8


class BatchPlan(NamedTuple):
    """How the batches of a group are processed.

    parts : number of equal parts that the stations are divided into; most : most elements of a batch; vectors : (v, 2)
    fields that are the x and y of a vector; coupled : (points, points) whether D couples points of a station; blocks :
    (b, 4) first pair, pairs, first entry and entries of K that are computed by one product; pairs : (k, 2) fields
    i <= j of the entries of H that are used; entries : (m, 2) coordinates a >= b of the entries of K, computed ones
    first; rules : (k, 3) for the others (``tangents.apply_rules``); products : (classes * parts, size) factors of the
    entries of H (``tangents.fill_products``), empty if they are recomputed each time; loaded : class and number of
    elements of the constants in ``work``; dgemm, forces : addresses of BLAS's dgemm and of ``forces.element_batch``.
    """

    parts: int
    most: int
    vectors: Any
    coupled: Any
    blocks: Any
    pairs: Any
    entries: Any
    rules: Any
    products: Any
    loaded: Any
    work: Any
    dgemm: int
    forces: int


class PointRows(NamedTuple):
    """First row of each quantity of a point in the work buffer, and the number of rows; constants of a law.

    u, eps, sigma, J : fields, strains, stresses and Jacobian; u0, eps0 : second set of fields and strains; t, DJ :
    D eps and D J; D, H, g : stiffness, second derivatives of the energy by the fields, forces on the fields; ref :
    reference values. Laws with memory: slope : derivative of internal strains by strains; JE : Jacobian of strains
    less internal strains (J for other laws); old, new : state before and after.
    """

    u: int
    u0: int
    eps: int
    eps0: int
    t: int
    sigma: int
    J: int
    DJ: int
    D: int
    H: int
    g: int
    slope: int
    JE: int
    ref: int
    old: int
    new: int
    rows: int


class StationRows(NamedTuple):
    """Rows of a station in the work buffer: ``rows`` of each point, then D and H of pairs of points, then the turns.

    If a station has one point, D and H are the point's own.
    """

    rows: int
    D: int
    H: int
    turn: int
    end: int


@register_jitable
def point_rows(fields, strains, references, state):  # type: ignore[no-untyped-def]
    """Return the rows of a point for a law with these numbers of fields, strains, reference values and state variables.

    Quantities whose size is known only at run time come last: LLVM then sees that the others do not overlap.
    """
    u0 = fields
    eps = u0 + fields
    eps0 = eps + strains
    t = eps0 + strains
    sigma = t + strains
    J = sigma + strains
    DJ = J + strains * fields
    D = DJ + strains * fields
    H = D + strains * strains
    g = H + fields * fields
    slope = g + fields
    remembers = 1 if state > 0 else 0
    JE = slope + strains * strains if remembers else J
    ref = slope + remembers * (strains * strains + strains * fields)
    old = ref + references
    new = old + state
    return PointRows(0, u0, eps, eps0, t, sigma, J, DJ, D, H, g, slope, JE, ref, old, new, new + state)


@register_jitable
def station_rows(fields, strains, references, state, points):  # type: ignore[no-untyped-def]
    """Return the rows of a station with ``points`` points."""
    at = point_rows(fields, strains, references, state)
    if points == 1:
        D, H, turn = at.D, at.H, at.rows
    else:
        D = points * at.rows
        H = D + points * points * strains * strains
        turn = H + points * points * fields * fields
    return StationRows(at.rows, D, H, turn, turn + 2)


@inner
def vectors_of(lanes):  # type: ignore[no-untyped-def]
    """Return lanes rounded up to full vectors; padding lanes repeat the first one and are never summed."""
    return (lanes + VECTOR - 1) // VECTOR * VECTOR


@register_jitable
def matrices_at(at, n, flat, entries):  # type: ignore[no-untyped-def]
    """Return where displacements, flat lanes, forces, tangents and products start in the buffer."""
    de = at.end * STRIDE
    lanes = de + n * LANES
    Q = lanes + flat * LANES
    K = Q + n * LANES
    products = K + entries * LANES
    return de, lanes, Q, K, products


def buffer_length(at: StationRows, n: int, flat: int, entries: int, size: int) -> int:
    """Return the length of the work buffer for these sizes."""
    return int(matrices_at(at, n, flat, entries)[-1]) + size
