"""Stations of several elements side by side: the vector lanes that laws are evaluated in.

A batch is a run of elements of one class. Its lanes are the stations of all its elements, station by station, element
by element within: what is constant along a row of the work buffer is a component, what varies is the lane. Fields
u = B d, forces B^T g and tangents are products of matrices for the whole batch at once (BLAS).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import register_jitable

from .lowlevel.jit import inner
from .lowlevel.records import STRIDE

# lanes of a batch; rows lie further apart (STRIDE)
LANES = 64
# lanes are rounded up to full vectors
VECTOR = 8


class Plan(NamedTuple):
    """How the batches of a group are worked on.

    parts : stations come in this many parts of equal length; most : elements of a batch at most; vectors : (v, 2)
    fields that are the x and y of a vector; coupled : (points, points) whether D couples points of a station; blocks :
    (b, 4) first pair, pairs, first entry and entries of K that are made at once; pairs : (k, 2) fields i <= j of the
    entries of H that are used; entries : (m, 2) coordinates a >= b of the entries of K, those of blocks first;
    following : (k, 3) how others follow from them (``tangents.follow``); products : (classes parts, size) what the
    entries of H are multiplied by, empty where it is made anew each time; held : class and elements that
    the constants in ``work`` are for; dgemm, forces : addresses of what multiplies matrices and makes a batch's forces.
    """

    parts: int
    most: int
    vectors: Any
    coupled: Any
    blocks: Any
    pairs: Any
    entries: Any
    following: Any
    products: Any
    held: Any
    work: Any
    dgemm: int
    forces: int


class Slots(NamedTuple):
    """Rows of a point where each quantity starts, and how many they are: all constants of its law.

    u, eps, sigma, J : fields, strains, stresses and Jacobian; u0, eps0 : other fields and strains beside them; t, DJ :
    D eps and D J; D, H, g : stiffness, second derivatives of the energy and forces by the fields; ref : reference
    values. Of laws with memory, slope : of internal strains by strains; JE : what the fields make of strains that bear
    stress, J of other laws; old, new : state before and after.
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


class Places(NamedTuple):
    """Rows of the work buffer of a station: ``rows`` of each point, then D and H of pairs of points, then the turns.

    Where a station is one point, D and H are the point's own.
    """

    rows: int
    D: int
    H: int
    turn: int
    end: int


@register_jitable
def slots(fields, strains, references, state):  # type: ignore[no-untyped-def]
    """Return the rows of a point whose law has so many fields, strains, reference values and numbers of state.

    Those whose number only a run tells come last: others are a constant distance apart, and are seen not to overlap.
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
    return Slots(0, u0, eps, eps0, t, sigma, J, DJ, D, H, g, slope, JE, ref, old, new, new + state)


@register_jitable
def places(fields, strains, references, state, points):  # type: ignore[no-untyped-def]
    """Return the places for stations of so many points."""
    at = slots(fields, strains, references, state)
    if points == 1:
        D, H, turn = at.D, at.H, at.rows
    else:
        D = points * at.rows
        H = D + points * points * strains * strains
        turn = H + points * points * fields * fields
    return Places(at.rows, D, H, turn, turn + 2)


@inner
def vectors_of(lanes):  # type: ignore[no-untyped-def]
    """Return lanes rounded up to full vectors: those beyond repeat the first, and count nowhere."""
    return (lanes + VECTOR - 1) // VECTOR * VECTOR


@register_jitable
def matrices_at(at, n, flat, entries):  # type: ignore[no-untyped-def]
    """Return where displacements, lanes in a row, forces, tangents and products start in the buffer."""
    de = at.end * STRIDE
    lanes = de + n * LANES
    Q = lanes + flat * LANES
    K = Q + n * LANES
    products = K + entries * LANES
    return de, lanes, Q, K, products


def room(at: Places, n: int, flat: int, entries: int, size: int) -> int:
    """Return the length of the work buffer for these sizes."""
    return int(matrices_at(at, n, flat, entries)[-1]) + size
