"""Motions that start from rest as slowly as t^6: adaptive steps leave the rest."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from motions import ride

STIFF = h.body(h.line(1.0), h.element("reissner3", 2), {"height": 0.05, "width": 0.05}, h.STEEL)


@pytest.mark.parametrize("method", ["radau5", "radau9", "generalized_alpha", "hht", "newmark"])
@pytest.mark.parametrize("power", [4, 6])
def test_a_rod_turned_gently_follows_from_the_first_step(method: str, power: int) -> None:
    angle = {"type": "expression", "value": f"0.5*t^{power}"}
    moved = ride({"bodies": {"a": STIFF}, "bc": [{"type": "pin", "at": "a@0"},
                                                 {"type": "prescribed", "at": "a@0", "angle": angle}]},
                 1.0, method=method, tolerance=1e-5)
    # its own inertia bends it by less than the tolerance here
    np.testing.assert_allclose(moved.place("a@1"), [np.cos(0.5), np.sin(0.5)], atol=2e-3)
    assert len(moved.log) < 2000
