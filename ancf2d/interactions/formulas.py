"""Forces given by formulas in local quantities: of the points of a body, or of the elongation of a spring."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..case.schema.profiles import PointExpression, Profile, ProfileTable
from ..case.syntax import Constant, Quantity, Tree, named_in, quantities_of, renamed, syntax
from ..elements.point_laws import DIRECTION, GROUND, THETA, PointLaw, angle_near, evaluate_formula, formula_at
from ..elements.shape import Array
from ..model.point_patch import formula_record

# quantities, besides s, that a load along a body may depend on at each of its points
LOCAL = ("t", "x", "y", "vx", "vy", "theta")
RATES = frozenset(("vx", "vy"))
# Gauss points and weights of [0, 1], for the energy of a spring
_GAUSS = ((0.01985507175123188, 0.05061426814518813), (0.10166676129318664, 0.11119051722668724),
          (0.2372337950418355, 0.15685332293894363), (0.4082826787521751, 0.18134189168918100),
          (0.5917173212478249, 0.18134189168918100), (0.7627662049581645, 0.15685332293894363),
          (0.8983332387068134, 0.11119051722668724), (0.9801449282487681, 0.05061426814518813))


def along_body(p0, u, w, par, a, mem, f, H, C):  # type: ignore[no-untyped-def]
    """A force by formula at a point; fields: x, y, section rotation; par: weight [m], s, formula, rotation kind.

    The time is passed as the rate of the amplitude.
    """
    force, kind, weight = formula_at(par[2]), int(par[3]), par[0] * a[0]
    v = force.values
    v[0], v[1], v[2], v[3], v[4] = a[1], p0[0] + u[0], p0[1] + u[1], w[0], w[1]
    by_x, by_y = 0.0, 0.0
    if kind == THETA:
        v[5], by_x = u[2], 1.0
    elif kind == DIRECTION:
        px, py = p0[2] + u[2], p0[3] + u[3]
        v[5] = angle_near(p0[2], u[2], u[3], mem[0])
        by_x, by_y = -py / (px * px + py * py), px / (px * px + py * py)
    for k in range(2):
        evaluate_formula(force, k, par[1])
        out = force.out
        f[k] = -weight * out[0]
        for j in range(2):
            H[k, j], C[k, j] = -weight * out[2 + j], -weight * out[4 + j]
        if kind != GROUND:
            H[k, 2] = -weight * out[6] * by_x
        if kind == DIRECTION:
            H[k, 3] = -weight * out[6] * by_y
    return 0.0, 0.0


def along_body_mean(p0, u0, u1, w, par, a0, a1, mem, f):  # type: ignore[no-untyped-def]
    """The force at mid-step."""
    force, kind, weight = formula_at(par[2]), int(par[3]), 0.5 * par[0] * (a0[0] + a1[0])
    v = force.values
    v[0], v[3], v[4] = 0.5 * (a0[1] + a1[1]), w[0], w[1]
    v[1], v[2] = p0[0] + 0.5 * (u0[0] + u1[0]), p0[1] + 0.5 * (u0[1] + u1[1])
    if kind == THETA:
        v[5] = 0.5 * (u0[2] + u1[2])
    elif kind == DIRECTION:
        v[5] = angle_near(p0[2], 0.5 * (u0[2] + u1[2]), 0.5 * (u0[3] + u1[3]), mem[0])
    for k in range(2):
        evaluate_formula(force, k, par[1])
        f[k] = -weight * force.out[0]
    return 0.0, 0.0


def count_turn(p0, u, par, mem):  # type: ignore[no-untyped-def]
    """Update the last angle of a point's section with that at u."""
    if int(par[3]) == DIRECTION:
        mem[0] = angle_near(p0[2], u[2], u[3], mem[0])


ALONG_BODY = PointLaw("along_body", along_body, along_body_mean, symmetric=False, accept=count_turn)


def by_formula(s, rate, par):  # type: ignore[no-untyped-def]
    """A spring whose force is a formula beyond ``low`` and ``high``; par: formula, low, high, whether it has an energy.

    The energy is the integral of the force at zero rate, by 8 Gauss points.
    """
    low, high = par[1], par[2]
    if s >= high:
        x = s - high
    elif s <= low:
        x = s - low
    else:
        return 0.0, 0.0, 0.0, 0.0
    force, energy = formula_at(par[0]), 0.0
    if par[3] != 0.0:
        for at, weight in _GAUSS:
            force.values[0], force.values[1] = at * x, 0.0
            evaluate_formula(force, 0, 0.0)
            energy += weight * x * force.out[0]
    force.values[0], force.values[1] = x, rate
    evaluate_formula(force, 0, 0.0)
    return energy, force.out[0], force.out[1], force.out[2]


def spring_formula(text: str) -> Any:
    """Return the record of a spring's formula in u and v."""
    return formula_record([renamed(syntax(text, "u"), {"": Quantity("u")})], ("u", "v"), [str(text)])


def uses_rate(text: str) -> bool:
    """Return whether a spring's formula depends on the rate."""
    return "v" in quantities_of(text)


def density_formula(density: tuple[float | Profile, float | Profile]) -> tuple[Any, bool, bool]:
    """Return the record of the two components of a load along a body, and whether they use theta, and rates."""
    trees: list[Tree] = []
    for value in density:
        assert not isinstance(value, ProfileTable)
        trees.append(Constant(value) if isinstance(value, float) else value.tree)
    texts = [str(getattr(value, "value_", value)) for value in density]
    names = {name for tree in trees for name in named_in(tree)}
    return formula_record(trees, LOCAL, texts), "theta" in names, not RATES.isdisjoint(names)


def is_formula(density: Any) -> bool:
    """Return whether a load along a body depends on quantities of its points."""
    return any(isinstance(value, PointExpression) for value in density)


def weights_of(w: Array, s: Array, address: int, kind: int) -> Array:
    """Return the constants (elements, p, 4) of ``ALONG_BODY`` at points with weights w (p,) and s (elements, p)."""
    return np.stack(np.broadcast_arrays(w, s, float(address), float(kind)), axis=-1)
