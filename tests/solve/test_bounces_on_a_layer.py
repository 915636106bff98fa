"""Bodies that bounce off a contact layer, compared with free flights and half oscillations in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from motions import ride, rigid

MASS, HEIGHT, G, LASTS = 1.0, 0.2, 9.81, 2.0
FLOOR = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}


def dropped(stiffness: float, tilt: float = 0.0) -> dict[str, Any]:
    """Return a rigid bar of 1 m that falls on a floor, parallel to it without ``tilt`` [m].

    It swings in the layer as often up and down as about its middle: a tilt of round-off does not grow.
    """
    touch = {"between": ["bar", "floor"], "side": "axis", "law": {"stiffness": stiffness}}
    return {"bodies": {"bar": rigid([0, HEIGHT], [1, HEIGHT + tilt], MASS, MASS / 12)}, "obstacles": FLOOR,
            "contacts": [touch], "loads": [{"type": "gravity", "value": [0, -G]}]}


def bouncing(t: float, stiffness: float) -> float:
    """Return its height at t: free fall, oscillation about the static depth, and equal rise."""
    omega, speed = math.sqrt(stiffness / MASS), math.sqrt(2 * G * HEIGHT)
    # in the layer y = G/omega^2 (cos(omega t) - 1) - speed/omega sin(omega t)
    phase = math.atan2(speed / omega, G / omega**2)
    within, flight = (2 * math.pi - 2 * phase) / omega, 2 * speed / G
    t = (t + flight / 2) % (flight + within)
    if t < flight:
        return speed * t - G * t * t / 2
    s = t - flight
    return G / omega**2 * (math.cos(omega * s) - 1) - speed / omega * math.sin(omega * s)


def off(stiffness: float, **solver: Any) -> float:
    """Return the largest error of a motion through five bounces, relative to its size."""
    found = ride(dropped(stiffness), LASTS, states=20, **solver)
    return max(abs(found.place("bar@0.5", k)[1] - bouncing(0.1 * k, stiffness)) for k in range(21)) / HEIGHT


@pytest.mark.parametrize(("method", "tolerance", "times"), [
    ("radau5", 1e-4, 1.0), ("radau9", 1e-4, 1.0), ("generalized_alpha", 1e-4, 3.0), ("DOP853", 1e-4, 1.0),
    ("Radau", 1e-4, 1.0), ("RK45", 1e-4, 10.0),
    # a step of 0.2 s that begins in the air ends where the layer itself holds it, on its surface
    ("generalized_alpha", 1e-6, 3.0)])
@pytest.mark.parametrize("stiffness", [1e4, 1e7])
def test_errors_follow_the_tolerance_through_bounces(method, tolerance, times, stiffness):
    """Errors of the speed after a bounce grow with time, so local errors there are measured as rates."""
    assert off(stiffness, method=method, tolerance=tolerance) < times * tolerance


@pytest.mark.parametrize(("method", "order"), [("radau5", 5), ("generalized_alpha", 2)])
def test_the_order_is_kept_through_bounces(method, order):
    coarse, fine = (off(1e4, method=method, dt=dt) for dt in (2e-3, 1e-3))
    assert math.log2(coarse / fine) > order - 0.6


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-3])
def test_a_bar_that_comes_to_rest_in_the_layer_gains_no_energy(tilt):
    """At a loose tolerance its last bounces are smaller than the errors, and its points touch one after another."""
    found = ride(dropped(1e7, tilt), LASTS, states=200, method="generalized_alpha", tolerance=1e-2)
    energy, _ = found.totals()
    assert energy.max() - energy[0] < 2e-2 * MASS * G * HEIGHT
    assert max(abs(found.place("bar@0.5", k)[0] - 0.5) for k in range(len(found.rows))) < 1e-9


def test_an_elastic_bar_that_falls_flat_bounces_to_the_tolerance():
    """Compared with steps a thousand times more accurate; all points touch at once."""
    bar = {"geometry": {"type": "line", "start": [0, HEIGHT], "end": [1, HEIGHT]},
           "section": {"EA": 6e4, "EI": 2.0, "kGA": 2e4, "rhoA": 1.0, "rhoI": 1e-3},
           "element": {"type": "reissner3", "count": 2}}
    scene = {**dropped(1e5), "bodies": {"bar": bar}}
    found = [np.array([run.place("bar@0.3", k)[1] for k in range(11)]) for run in (
        ride(scene, 1.0, states=10, method="radau9", tolerance=tolerance) for tolerance in (1e-8, 1e-4))]
    assert np.abs(found[1] - found[0]).max() < 1e-4 * HEIGHT


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "DOP853"])
def test_a_rising_floor_throws_up_a_bar_at_rest(method):
    """The bar has no rate when it is hit; after half an oscillation it has twice the speed of the floor."""
    gap, speed, stiffness = 0.05, 1.0, 1e5
    scene = {**dropped(stiffness), "bodies": {"bar": rigid([0, gap], [1, gap], MASS, 0.1)}, "loads": [], "obstacles": {
        "floor": {**FLOOR["floor"], "motion": {"y": {"type": "ramp", "t1": 0.2, "scale": 0.2 * speed}}}}}
    found = ride(scene, 0.2, states=8, method=method, tolerance=1e-4)
    leaves = gap / speed + math.pi / math.sqrt(stiffness / MASS)
    place = gap + speed * math.pi / math.sqrt(stiffness / MASS) + 2 * speed * (0.2 - leaves)
    assert found.place("bar@0.5")[1] == pytest.approx(place, abs=1e-4 * place)
