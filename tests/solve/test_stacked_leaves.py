"""Leaf springs that lie on one another from end to end."""

from __future__ import annotations

import re
from itertools import product
from typing import Any

import helpers as h
import pytest

import ancf2d

HEIGHT, RUBBER = 0.02, {"E": 1e7, "nu": 0.3, "rho": 1000.0}
# 3 EI/L^3 of a leaf of length 1
STIFF = 3.0 * RUBBER["E"] * 0.05 * HEIGHT**3 / 12.0


def leaf(start: float, end: float, y: float, spec: dict[str, Any]) -> dict[str, Any]:
    return h.body({"type": "line", "start": [start, y], "end": [end, y]}, spec,
                  {"height": HEIGHT, "width": 0.05}, RUBBER)


def stack(spec: dict[str, Any], force: float, gap: float, opposite: bool, **solver: Any) -> dict[str, Any]:
    """Return two leaves of equal length, clamped at the same end or at opposite ones, with a force at the upper tip."""
    ends = (1.0, 0.0) if opposite else (0.0, 1.0)
    return {"bodies": {"low": leaf(0.0, 1.0, 0.5 * HEIGHT, spec), "up": leaf(*ends, 1.5 * HEIGHT + gap, spec)},
            "boundary_conditions": [{"name": name, "type": "clamp", "at": f"{name}@0"} for name in ("low", "up")],
            "contacts": [{"between": ["up", "low"]}],
            "loads": [{"type": "force", "at": "up@1", "value": [0.0, -force]}],
            "solver": {"type": "static", **solver}, "output": {"probes": {"tip": "up@1"}}}


@pytest.mark.parametrize(("name", "count"), [("2d2n", 2), ("vallejo", 4)])
def test_a_tip_that_is_squeezed_over_the_end_of_the_other_leaf_rests_on_its_corner(name: str, count: int) -> None:
    """The force squeezes the section of the tip: its lower corner is pushed outwards, past the end of the leaf below.

    The corner there bears all that does not bend the upper leaf.
    """
    gap, force = 1e-4, 5.0
    found = ancf2d.solve(stack(h.element(name, count), force, gap, True, steps=3))
    down = -float(found.course["tip"]["uy"][-1])
    assert gap < down < 0.05 * HEIGHT
    assert found.reactions["low"]["fy"] == pytest.approx(force, abs=2.0 * STIFF * down)


# with ten elements, round-off decides whether the contact points are found (docs/contact.md, "Limits")
UNSURE = pytest.mark.xfail(raises=ancf2d.ComputationError, strict=False)


@pytest.mark.parametrize(("count", "gap"), [
    *h.chosen(product((4, 6, 8), (0.0, 1e-4)), [(4, 1e-4), (8, 0.0)]),
    *(pytest.param(10, gap, marks=[pytest.mark.slow, UNSURE]) for gap in (0.0, 1e-4))])
def test_leaves_that_touch_all_along_bend_alike_however_few_their_elements(count: int, gap: float) -> None:
    """Where one cubic lies in another, more places touch than an element has points: these stand for the others.

    Without friction each leaf bears half of the force, and bends as it does alone.
    """
    force = 5.0
    spec = h.element("cable", count)
    found = ancf2d.solve(stack(spec, force, gap, False))
    alone = stack(spec, 0.5 * force, 0.0, False)
    alone["bodies"].pop("low")
    alone["boundary_conditions"] = alone["boundary_conditions"][1:]
    alone.pop("contacts")
    tip = ancf2d.solve(alone).course["tip"]["uy"][-1]
    assert tip < -0.7
    # the faces that touch are half a height from the axes
    assert found.course["tip"]["uy"][-1] == pytest.approx(tip, abs=0.5 * HEIGHT)
    # what is left between points is what a warning may tell (docs/contact.md)
    depths = [float(m[1]) for w in found.warnings if (m := re.search(r"(\S+) deep in an obstacle", w))]
    assert max(depths, default=0.0) < 1e-7 * found.model.extent
