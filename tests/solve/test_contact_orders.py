"""Orders of fixed steps through a landing: 2 with a layer, 1 without one.

A rod falls flat on a floor and flies on. With a layer steps end where its force begins and ceases, which leaves the
order 2 of generalized alpha. Without a layer the rebound begins at the end of the step in which the rod lands, up to dt
late, which is an error of order 1.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from ancf2d import solve

G, HEIGHT, MASS, T_END = 10.0, 0.05, 2.0, 0.2517
# of the layer: as long in touch as some tens of the longest steps
STIFFNESS = 4000.0
# primes: landings are anywhere within a step
COUNTS = (83, 113, 157, 227, 317, 457, 641, 907, 1283, 1811, 2557)


def place(contact: dict, count: int, t_end: float = T_END) -> float:
    """Return the height of the rod at the end."""
    found = solve({
        "format": 1,
        "bodies": {"rod": {"geometry": {"type": "line", "start": [-0.5, HEIGHT], "end": [0.5, HEIGHT]},
                           "element": {"type": "rigid", "mass": MASS, "inertia": 0.2}}},
        "obstacles": {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        "contacts": [{"between": ["rod", "floor"], "side": "axis", **contact}],
        "loads": [{"type": "gravity", "value": [0, -G]}],
        "solver": {"type": "dynamic", "t_end": t_end, "dt": t_end / count, "method": "generalized_alpha",
                   "estimate": False},
        "output": {"interval": t_end, "probes": {"mid": "rod@0.5"}}})
    return float(found.course["mid"]["y"][-1])


def bounced(landed: float) -> float:
    """Return the final height of a rod that rebounds with its landing speed after ``landed`` s."""
    fall = math.sqrt(2.0 * HEIGHT / G)
    left = T_END - fall - landed
    return G * fall * left - 0.5 * G * left**2


@pytest.mark.parametrize("count", [640, 1280])
def test_a_rod_that_lands_at_the_end_of_a_step_rebounds_there(count):
    """Its gap is then round-off of either sign: it touches, but would have to be pulled to the floor."""
    assert place({"restitution": 1.0}, count, 0.25) == pytest.approx(HEIGHT - 0.5 * G * 0.05**2, abs=1e-11)


@pytest.fixture(scope="module")
def errors() -> dict[str, np.ndarray]:
    """The errors of all step lengths, with a layer and without one."""
    w = math.sqrt(STIFFNESS / MASS)
    phase = math.atan(w * math.sqrt(2.0 * HEIGHT * G) / G)
    touched = (2.0 * math.pi - 2.0 * phase) / w
    return {name: np.array([abs(place(contact, n) - bounced(landed)) for n in COUNTS]) for name, contact, landed in (
        ("layer", {"law": {"stiffness": STIFFNESS}}, touched), ("none", {"restitution": 1.0}, 0.0))}


@pytest.mark.slow
def test_order_2_through_a_layer(errors):
    """Errors depend on where in its step the rod lands: their bound falls with the square of the steps."""
    in_squares = errors["layer"] * np.array(COUNTS)**2
    assert in_squares[-4:].max() < 2.0 * in_squares[:4].max()
    # below any bound of order 1 that holds for long steps
    assert errors["layer"][-1] < 0.1 * errors["layer"][:4].max() * COUNTS[3] / COUNTS[-1]


@pytest.mark.slow
def test_order_1_of_a_rebound_without_a_layer(errors):
    """A rebound that is late by t < dt has a final height error of at most 2 v t."""
    in_steps = errors["none"] * np.array(COUNTS) / (2.0 * math.sqrt(2.0 * HEIGHT * G) * T_END)
    assert in_steps.max() < 1.0
    # not better by an order: the finest steps have as large a share of their length as the longest
    assert in_steps[-4:].max() > 0.05
