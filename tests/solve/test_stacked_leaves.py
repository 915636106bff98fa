"""Leaf springs that lie on one another from end to end."""

from __future__ import annotations

from itertools import pairwise, product
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


def stack(spec: dict[str, Any], force: float, gap: float, names: tuple[str, ...] = ("low", "up"),
          opposite: bool = False, friction: float = 0.0, **solver: Any) -> dict[str, Any]:
    """Return leaves of equal length, clamped at one end or at alternate ends, with a force at the last tip."""
    ends = [(1.0, 0.0) if opposite and k % 2 else (0.0, 1.0) for k in range(len(names))]
    return {"bodies": {name: leaf(*ends[k], (k + 0.5) * HEIGHT + k * gap, spec) for k, name in enumerate(names)},
            "boundary_conditions": [{"name": name, "type": "clamp", "at": f"{name}@0"} for name in names],
            "contacts": [{"between": [*pair], "friction": friction} for pair in pairwise(names)],
            "loads": [{"type": "force", "at": f"{names[-1]}@1", "value": [0.0, -force]}],
            "solver": {"type": "static", **solver}, "output": {"probes": {"tip": f"{names[-1]}@1"}}}


@pytest.mark.parametrize(("name", "count"), [("2d2n", 2), ("vallejo", 4)])
def test_a_tip_that_is_squeezed_over_the_end_of_the_other_leaf_rests_on_its_corner(name: str, count: int) -> None:
    """The force squeezes the section of the tip: its lower corner is pushed outwards, past the end of the leaf below.

    The corner there bears all that does not bend the upper leaf.
    """
    gap, force = 1e-4, 5.0
    found = ancf2d.solve(stack(h.element(name, count), force, gap, opposite=True, steps=3))
    down = -float(found.course["tip"]["uy"][-1])
    assert gap < down < 0.05 * HEIGHT
    assert found.reactions["low"]["fy"] == pytest.approx(force, abs=2.0 * STIFF * down)


@pytest.mark.parametrize(("name", "count", "gap", "leaves"), h.chosen(
    [*product(("cable",), (4, 6, 8, 10, 12, 16), (0.0, 1e-4), (2,)), ("cable", 8, 0.0, 3), ("cable", 10, 1e-4, 3),
     *product(("reissner3", "vallejo"), (6, 10), (0.0, 1e-4), (2,))],
    [("cable", 4, 1e-4), ("cable", 10, 0.0), ("cable", 8, 0.0, 3)]))
def test_leaves_that_touch_all_along_bend_alike(name: str, count: int, gap: float, leaves: int) -> None:
    """If one cubic lies in another, bodies touch at up to two places between neighbouring fixed points.

    Without friction each leaf bears its share of the force, and bends as it does alone.
    """
    share, spec, names = 2.5, h.element(name, count), ("low", "up", "top")[:leaves]
    found = ancf2d.solve(stack(spec, leaves * share, gap, names))
    tip = ancf2d.solve(stack(spec, share, 0.0, names[:1])).course["tip"]["uy"][-1]
    assert tip < -0.7
    # the faces that touch are half a height from the axes
    assert found.course["tip"]["uy"][-1] == pytest.approx(tip, abs=0.25 * leaves * HEIGHT)
    # one would tell that a body is deep in another between contact points
    assert not found.warnings


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 10])
def test_rubbing_leaves_in_large_bending_are_solved_and_stiffer(count: int) -> None:
    """Friction mu P/2 at half a height from the axes takes 3/4 mu h/L off a small deflection, less off a large one."""
    mu, spec = 0.2, h.element("cable", count)
    smooth, rough = (ancf2d.solve(stack(spec, 5.0, 1e-4, friction=value)) for value in (0.0, mu))
    tips = [found.course["tip"]["uy"][-1] for found in (smooth, rough)]
    assert 0.0 < 1.0 - tips[1] / tips[0] < 0.75 * mu * HEIGHT
    assert not rough.warnings
