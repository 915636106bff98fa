"""Curved bodies that lie on an obstacle in the reference, whose elements are not exactly the curve."""

from __future__ import annotations

import math
from typing import Any

import helpers
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import CaseError

RADIUS, HEIGHT, PULL = 0.05, 5e-4, 10.0


def rope(element: dict[str, Any], solver: dict[str, Any], friction: float = 0.0) -> dict[str, Any]:
    """Return a rope around the upper half of a drum, fixed at its start and pulled down at its end."""
    axis = {"type": "arc", "center": [0, 0], "radius": RADIUS + HEIGHT / 2, "from": math.pi, "to": 0}
    return {"format": 1, "title": "rope", "solver": solver,
            "bodies": {"rope": {"geometry": axis, "section": {"height": HEIGHT, "width": 0.01},
                                "material": {"E": 1e9, "nu": 0.3, "rho": 1000}, "element": element}},
            "obstacles": {"drum": {"type": "circle", "center": [0, 0], "radius": RADIUS}},
            "contacts": [{"between": ["rope", "drum"], "friction": friction}],
            "boundary_conditions": [{"type": "pin", "at": "rope@0"}],
            "loads": [{"type": "force", "at": "rope@1", "value": [0, -PULL]}]}


@pytest.mark.slow_rows("vallejo-solver0", "vallejo-solver1", "reissner3-solver1")
@pytest.mark.parametrize("solver", [{"steps": 4}, {"method": "arc_length", "until": {"load_factor": 1}}])
@pytest.mark.parametrize("kind", ["cable", "reissner3", "vallejo"])
def test_a_rope_on_a_drum_without_friction_bears_the_same_force_at_both_ends(kind: str, solver: dict[str, Any]) -> None:
    solution = ancf2d.solve(rope({"type": kind, "count": 20}, {"type": "static", **solver}), states=False)
    assert solution.reactions["rope@0"]["fy"] == pytest.approx(-PULL, rel=1e-4)
    assert solution.reactions["drum"]["fy"] == pytest.approx(2 * PULL, rel=1e-4)


@pytest.mark.slow
def test_a_rope_on_a_drum_slips_at_the_ratio_of_euler_and_eytelwein() -> None:
    solution = ancf2d.solve(rope({"type": "vallejo", "count": 40}, {"type": "static", "steps": 4}, 0.3), states=False)
    assert -solution.reactions["rope@0"]["fy"] == pytest.approx(PULL / math.exp(0.3 * math.pi), rel=2e-2)


@pytest.mark.slow
def test_in_motion_the_drum_is_smaller_by_the_overlap_of_the_elements() -> None:
    motion = {"type": "dynamic", "t_end": 1e-4, "tolerance": 1e-3, "estimate": False}
    case = rope({"type": "vallejo", "count": 20}, motion)
    model = helpers.build(**case)
    (pair,) = model.contacts
    gaps = pair.gaps(np.zeros(len(model.e0)), 0.0)
    assert 0.0 < pair.setback < 1e-5 * RADIUS
    assert gaps.min() == pytest.approx(0.0, abs=1e-15)
    energies = {name: values[-1] for name, values in ancf2d.solve(case).energies.items()}
    assert 0.0 < energies["kinetic"] + energies["strain"] + energies["dissipated"] <= 1.01 * energies["work"]


def test_gaps_along_the_rope_are_those_to_the_smaller_drum() -> None:
    model = helpers.build(**rope({"type": "vallejo", "count": 20}, {"type": "dynamic", "t_end": 1e-4}))
    (pair,) = model.contacts
    d = np.zeros(len(model.e0))
    assert pair.setback > 0.0
    np.testing.assert_array_equal(pair.with_points(pair.item, pair.mesh, pair.spots).gaps(d, 0.0), pair.gaps(d, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["generalized_alpha", "hht"])
def test_points_that_alternate_within_round_off_do_not_end_a_motion(method: str) -> None:
    """The whole rope lies on the drum under tension; each point that opens lets its neighbours close."""
    motion = {"type": "dynamic", "t_end": 2e-5, "method": method, "tolerance": 1e-4, "estimate": False}
    solution = ancf2d.solve(rope({"type": "cable", "count": 10}, motion))
    energies = {name: values[-1] for name, values in solution.energies.items()}
    assert solution.t[-1] == pytest.approx(2e-5)
    assert 0.0 < energies["kinetic"] + energies["strain"] + energies["dissipated"] <= 1.01 * energies["work"]


def test_chords_of_a_circle_are_refused() -> None:
    with pytest.raises(CaseError, match="expected rope outside drum"):
        helpers.build(**rope({"type": "reissner2", "count": 20}, {"type": "static"}))
