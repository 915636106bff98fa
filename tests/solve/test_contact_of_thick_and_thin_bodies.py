"""Contact of a thick body with a thin one: points touch the near face alone, not the far one through the body."""

from __future__ import annotations

from typing import Any

import helpers as h
import pytest

import ancf2d

RUBBER = {"E": 2e7, "nu": 0.45, "rho": 1100}


def finger_beside_a_block(touches: bool, solver: dict[str, Any], law: Any, kind: str) -> ancf2d.Solution:
    """A finger of 9 mm bends towards a block of 40 mm, whose end is 10 mm away."""
    element = h.element(kind, 10)
    bodies = {"finger": h.body({"type": "line", "start": [-0.045, 0.2], "end": [-0.045, 0.02]}, element,
                               {"height": 0.009, "width": 0.02}, RUBBER),
              "block": h.body({"type": "line", "start": [-0.03, 0.021], "end": [0.03, 0.021]}, {"type": "rigid"},
                              {"height": 0.04, "width": 0.02}, RUBBER)}
    case = {"bodies": bodies, "solver": solver, "output": {"probes": {"tip": "finger@1"}},
            "boundary_conditions": [{"type": "clamp", "at": "finger@0"}, {"type": "clamp", "at": "block@0.5"}],
            "loads": [{"type": "force", "at": "finger@1", "value": [0.02, 0]}]}
    if touches:
        case["contacts"] = [{"between": ["finger", "block"], **({"law": law} if law else {})}]
    return ancf2d.solve(case, states=False)


@pytest.mark.parametrize("law", [{"stiffness": 1e6}, None])
@pytest.mark.parametrize("solver", [
    {"type": "static"}, {"type": "dynamic", "t_end": 0.2, "estimate": False, "tolerance": 1e-5},
    {"type": "dynamic", "t_end": 0.2, "estimate": False, "dt": 1e-3, "method": "generalized_alpha"}])
@pytest.mark.parametrize("kind", ["reissner3", "vallejo"])
def test_a_thin_body_does_not_touch_a_thick_one_across_a_gap(solver: dict[str, Any], law: Any, kind: str) -> None:
    with_contact, without = (finger_beside_a_block(touches, solver, law, kind) for touches in (True, False))
    assert with_contact.summary["contacts"][0]["normal"] == 0.0
    # without a law another method is the default, so steps differ
    assert with_contact.probes["tip"]["ux"] == pytest.approx(without.probes["tip"]["ux"], rel=5e-3)
