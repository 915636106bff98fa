"""Contact of tapered bodies: errors of statics and energies of motions, as for uniform bodies."""

from __future__ import annotations

from typing import Any

import helpers
import pytest
from test_energy_of_layers import drift, strip

import ancf2d

TAPER = "0.02*(1 - 0.5*s)"


def leaf(start: list[float], end: list[float], kind: str, count: int) -> dict[str, Any]:
    """Return a straight body that tapers to half."""
    return helpers.body({"type": "line", "start": start, "end": end}, helpers.element(kind, count),
                        {"height": TAPER, "width": 0.05}, helpers.STEEL)


def tip(bodies: dict[str, Any], partner: str, steps: int, **scene: Any) -> float:
    """Return the deflection of the end of a clamped leaf that is pressed down."""
    scene["boundary_conditions"] = [{"type": "clamp", "at": "leaf@0"}, *scene.get("boundary_conditions", [])]
    found = ancf2d.solve({"bodies": bodies, "contacts": [{"between": ["leaf", partner]}], **scene,
                          "output": {"probes": {"tip": "leaf@1"}}, "solver": {"type": "static", "steps": steps}})
    return float(found.summary["probes"]["tip"]["uy"])


@pytest.mark.parametrize("kind", ["cable", "reissner3", "vallejo"])
def test_a_disc_presses_a_leaf_to_the_same_place_with_few_elements_and_with_many(kind: str) -> None:
    disc = {"type": "circle", "center": [0.83, 0.12], "radius": 0.1, "motion": {"y": {"type": "ramp", "scale": -0.08}}}
    few, many = (tip({"leaf": leaf([0, 0], [1, 0], kind, n)}, "disc", 8, obstacles={"disc": disc}) for n in (16, 64))
    # the same as for contact of the axis, where heights do not matter
    assert few == pytest.approx(many, rel=1e-5)


@pytest.mark.parametrize("kind", ["cable", pytest.param("vallejo", marks=pytest.mark.slow)])
def test_leaves_press_each_other_to_the_same_place_with_few_elements_and_with_many(kind: str) -> None:
    holder = {"type": "prescribed", "at": "other@0", "ux": 0, "uy": {"type": "ramp", "scale": -0.08}, "angle": 0}
    few, many = (tip({"leaf": leaf([0, 0], [1, 0], kind, n), "other": leaf([1.83, 0.03], [0.83, 0.03], kind, n)},
                     "other", 4, boundary_conditions=[holder]) for n in (12, 24))
    assert few == pytest.approx(many, rel=1e-4)


def test_a_block_that_slides_along_a_tapered_plank_conserves_energy() -> None:
    """The surface has no steps between elements."""
    scene = {"bodies": {"block": strip([-0.6, 0.024], [-0.3, 0.024], helpers.element("cable", 2), 0.02),
                        "plank": strip([-0.9, 0], [0.1, 0], helpers.element("cable", 8), "0.03*(1 - 0.5*s)")},
             "boundary_conditions": [{"type": "clamp", "at": f"plank@{s}"} for s in (0, 1)],
             "loads": [{"type": "gravity", "value": [0, -9.81]}],
             "contacts": [{"between": ["block", "plank"], "law": {"stiffness": 3e5}}],
             "initial": {"bodies": {"block": {"velocity": [1.2, 0.0]}}}}
    assert drift(scene, 0.1) < 1e-4
