"""Energy in contacts without a law of materials with memory: internal strains store a part."""

from __future__ import annotations

from functools import cache
from typing import Any

import helpers as h
import numpy as np
import pytest
from motions import ride

import ancf2d
from ancf2d.elements.shape import Array

FLOOR = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}
RELAXES = {"viscoelastic": [{"modulus": 0.8, "time": 0.05}]}
YIELDS = {"yield": 4e4, "hardening": {"isotropic": 1e5}}
HEIGHT, G = 0.3, 9.81


def strip(restitution: float, material: dict[str, Any]) -> dict[str, Any]:
    """Return a soft strip on a pin that falls on the floor and bounces."""
    body = h.body(h.line(1.0, start=(0.0, HEIGHT)), h.element("reissner3", 2), {"height": 0.02, "width": 0.02},
                  {"E": 5e6, "nu": 0.3, "rho": 1000.0, **material})
    return {"bodies": {"rod": body}, "loads": [{"type": "gravity", "value": [0, -G]}], "obstacles": FLOOR,
            "boundary_conditions": [{"type": "pin", "at": "rod@0"}],
            "contacts": [{"between": ["rod", "floor"], "side": "axis", "restitution": restitution}]}


@cache
def fallen(method: str, restitution: float, material: str, interval: float, **how: Any) -> ancf2d.Solution:
    """Return the motion of the strip through its fall and some bounces."""
    case = strip(restitution, {"relaxes": RELAXES, "yields": YIELDS}[material])
    solver = {"type": "dynamic", "t_end": 0.5, "method": method, "estimate": False, **how}
    return ancf2d.solve({**case, "solver": solver, "output": {"interval": interval}})


def balance(found: ancf2d.Solution) -> tuple[Array, Array]:
    """Return the energy of all states, also with dissipation, relative to the largest."""
    e = found.energies
    there = e["kinetic"] + e["strain"] + e["potential"] - e["work"]
    size = (e["kinetic"] + e["strain"]).max()
    return there / size, (there + e["dissipated"]) / size


@pytest.mark.slow_rows("radau5-1.0-yields")
@h.covering(method=["generalized_alpha", "radau5"], restitution=[0.0, 1.0], material=["relaxes", "yields"])
def test_energy_lost_is_dissipated_and_no_bounce_adds_energy(method, restitution, material):
    there, whole = balance(fallen(method, restitution, material, 5e-3, tolerance=1e-6))
    assert (there - np.minimum.accumulate(there)).max() < 1e-6
    # what is left out is lost to the steps that impacts are made in
    assert whole.max() - whole[0] < 1e-4
    assert whole[0] - whole.min() < 6e-3


@pytest.mark.slow
def test_energy_inside_steps_of_radau5_includes_relaxation():
    found = fallen("radau5", 0.0, "relaxes", 0.5 / 777, dt=1e-2)
    before = found.t < 0.2
    _, whole = balance(found)
    assert np.ptp(whole[before]) < 1e-6


def test_fixed_steps_of_radau5_keep_their_length():
    """They would shrink endlessly if relaxation seemed to gain energy."""
    found = ride(strip(0.0, RELAXES), 0.1, every=1, method="radau5", dt=2e-3)
    assert np.median(np.diff([row.t for row in found.rows])) == pytest.approx(2e-3)
    assert len(found.rows) < 60
