"""Radau's method with contacts without a law: closed points are constraints, and steps end where they change.

The changes are located, so that errors follow the tolerance, as they do without contact.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import helpers as h
import numpy as np
import pytest
from instruments.references import contacts as references
from motions import Ride, ride, rigid

import ancf2d
from ancf2d.kernels.motion.state import COUNT, SWITCHED
from ancf2d.solvers.motion.integrators import method_problems

G, HEIGHT, MASS, INERTIA = 9.81, 0.5, 2.0, 0.2
FALL = [{"type": "gravity", "value": [0, -G]}]
FLOOR = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}
WALL = {"wall": {"type": "half_plane", "through": [0, 0], "normal": [1, 0]}}
FLAT, TILTED = rigid([0, HEIGHT], [1, HEIGHT], MASS, INERTIA), rigid([0, HEIGHT], [0.9, 0.9], MASS, INERTIA)
RADAU = ("radau5", "radau9")


def falling(rod: dict[str, Any] = FLAT, **contact: Any) -> dict[str, Any]:
    """Return a rod whose axis may touch the floor."""
    return {"bodies": {"rod": rod}, "loads": FALL, "obstacles": FLOOR,
            "contacts": [{"name": "touch", "between": ["rod", "floor"], "side": "axis", **contact}]}


def whip() -> dict[str, Any]:
    """Return a soft strip on a pin that falls on the floor, where its points close and open in turn."""
    strip = h.body(h.line(1.0, start=(0.0, 0.3)), h.element("reissner3", 8), {"height": 0.02, "width": 0.02},
                   {"E": 5e6, "nu": 0.3, "rho": 1000.0})
    return {**falling(strip), "boundary_conditions": [{"type": "pin", "at": "rod@0"}]}


def bar(count: int = 10) -> dict[str, Any]:
    """Return a bar of unit length and wave speed that flies at a wall."""
    section = {"EA": 1.0, "EI": 1e-4, "kGA": 0.3, "rhoA": 1.0, "rhoI": 1e-4}
    body = h.body(h.line(1.0, start=(0.005, 0.0)), h.element("reissner2", count), section)
    return {"bodies": {"rod": body}, "obstacles": WALL, "initial": {"velocity": [-0.01, 0]},
            "contacts": [{"between": ["rod", "wall"], "side": "axis"}]}


def bounced(t: float, restitution: float) -> float:
    """Return the height at t of a body that falls from HEIGHT and bounces."""
    since, speed, y = 0.0, 0.0, HEIGHT
    while True:
        fall = (speed + math.sqrt(speed**2 + 2.0 * G * y)) / G
        if since + fall > t:
            return y + speed * (t - since) - 0.5 * G * (t - since) ** 2
        since, speed, y = since + fall, restitution * (G * fall - speed), 0.0


@cache
def fallen_strip(**how: Any) -> Ride:
    """Return the motion of the strip through its fall and later."""
    return ride(whip(), 0.5, every=1, method="radau5", **how)


@pytest.mark.parametrize("method", RADAU)
@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_errors_of_bounces_follow_the_tolerance(method, restitution):
    for tolerance in (1e-3, 1e-5, 1e-7):
        found = ride(falling(restitution=restitution), 1.0, method=method, tolerance=tolerance)
        assert found.place("rod@0.5")[1] == pytest.approx(bounced(1.0, restitution), abs=3.0 * tolerance * HEIGHT)


def test_fixed_steps_locate_bounces():
    """With generalized_alpha each would be up to a step of 20 ms late, with a height error of 6 cm."""
    found = ride(falling(restitution=0.6), 1.0, method="radau5", dt=2e-2)
    assert found.place("rod@0.5")[1] == pytest.approx(bounced(1.0, 0.6), abs=1e-7)


def test_a_rod_that_falls_flat_lies_still_where_it_lands():
    found = ride(falling(), 0.6, method="radau5", tolerance=1e-6)
    for s in ("rod@0", "rod@1"):
        assert found.place(s)[1] == pytest.approx(0.0, abs=1e-10)
    assert np.abs(found.full()[1]).max() < 1e-10
    # all that it had
    assert found.rows[-1].lost == pytest.approx(MASS * G * HEIGHT, rel=1e-6)


def test_an_elastic_bar_stays_at_a_wall_for_two_passages_of_its_wave():
    count, v, gap = 40, 0.01, 0.005
    found = ride(bar(count), 3.2, method="radau5", tolerance=1e-5, every=1)
    duration, force, after = references.bar_against_wall(1.0, 1.0, 1.0, v)
    t = np.array([row.t for row in found.rows])
    x = np.array([found.place("rod@0", k)[0] for k in range(len(t))])
    touching = t[x < 1e-9]
    assert touching[0] == pytest.approx(gap / v, abs=1e-4)
    # the front of the wave is as long as some elements
    assert touching[-1] - touching[0] == pytest.approx(duration, abs=2.5 / count)
    _, momenta = found.totals()
    assert momenta[-1, 0] == pytest.approx(-after, rel=0.04)
    inside = np.flatnonzero((t > gap / v + 0.3) & (t < gap / v + 1.7))
    pushed = momenta[inside[-1], 0] - momenta[inside[0], 0]
    assert pushed / (t[inside[-1]] - t[inside[0]]) == pytest.approx(force, rel=0.02)


def test_errors_of_an_elastic_impact_follow_the_tolerance():
    """Errors against the discrete equations, from a motion of a far smaller tolerance."""
    exact, *found = (ride(bar(), 3.2, method="radau5", tolerance=tolerance).end()[0]
                     for tolerance in (1e-9, 1e-4, 1e-6))
    rough, fine = (np.abs(one - exact).max() for one in found)
    assert fine < 1e-4 * np.abs(exact).max()
    # 100 at an order of 1 in the tolerance
    assert rough > 30.0 * fine


@pytest.mark.parametrize(("method", "how", "t_end"), [
    ("radau5", {"tolerance": 1e-6}, 20.0), ("radau9", {"tolerance": 1e-6}, 20.0), ("radau5", {"dt": 1e-2}, 20.0),
    pytest.param("radau5", {"dt": 1e-3}, 30.0, marks=pytest.mark.slow)])
def test_no_bounce_adds_energy(method, how, t_end):
    found = ride(falling(TILTED, restitution=1.0), t_end, method=method, states=200, **how)
    total, _ = found.totals()
    size = MASS * G * HEIGHT
    assert total[0] - 1e-4 * size <= total.min() <= total.max() <= total[0] + 1e-7 * size


@pytest.mark.slow_rows("how0")
@pytest.mark.parametrize("how", [{"tolerance": 1e-4}, {"dt": 5e-3}])
def test_chattering_points_gain_no_energy_and_do_not_penetrate(how):
    found = fallen_strip(**how)
    total, _ = found.totals()
    assert found.stepper.s.numbers[SWITCHED] > 20
    size = 0.4 * G * 0.3
    assert (total - np.minimum.accumulate(total)).max() < 1e-6 * size
    for s in np.linspace(0.0, 1.0, 17):
        y = np.array([found.place(f"rod@{s}", k)[1] for k in range(len(found.rows))])
        assert y.min() > -1e-9


@pytest.mark.parametrize("angle", [1.2, 1.4])
def test_an_impact_in_one_long_backward_euler_step_gains_no_energy(angle):
    """The end of a stiff cable bounces; its vibrations are far shorter than steps of the tolerance."""
    height, length = 2.0, 0.5
    end = (length * math.cos(angle), height + length * math.sin(angle))
    cable = h.body({"type": "line", "start": [0.0, height], "end": list(end)}, h.element("cable", 3),
                   {"height": 0.01, "width": 0.1}, {"E": 1.2e8, "nu": 0.3, "rho": 2000.0})
    found = ride(falling(cable, restitution=1.0), math.sqrt(2.0 * height / G) + 0.01, every=1, method="radau5",
                 tolerance=1e-4)
    total, _ = found.totals()
    assert found.stepper.s.numbers[SWITCHED] > 0
    assert (total - total[0]).max() < 1e-6 * G * height


def test_a_touch_between_the_sampled_times_is_found():
    """The tip of a spinning rod would be in the floor for less than an eighth of a step."""
    dip, begin = 1e-4, 0.5 * math.pi - 2.78125
    middle, (x, y) = 0.5 - dip, (0.5 * math.cos(begin), 0.5 * math.sin(begin))
    rod = rigid([-x, middle - y], [x, middle + y], MASS, INERTIA)
    scene = {"bodies": {"rod": rod}, "obstacles": FLOOR, "boundary_conditions": [{"type": "pin", "at": "rod@0.5"}],
             "initial": {"bodies": {"rod": {"rotation_rate": {"omega": 1.0, "about": [0.0, middle]}}}},
             "contacts": [{"between": ["rod", "floor"], "side": "axis"}]}
    found = ride(scene, 5.0, method="radau9", dt=0.5)
    # it stays where it touches
    assert found.place("rod@0") == pytest.approx([-math.sqrt(0.25 - middle**2), 0.0], abs=1e-8)
    assert np.abs(found.full()[1]).max() < 1e-10


def test_a_fixed_step_has_few_parts():
    found = fallen_strip(dt=5e-3)
    steps = np.round(found.column("t") / 5e-3 - 0.5 + 1e-6)
    assert np.bincount(steps.astype(int)).max() < 16
    assert found.stepper.s.numbers[COUNT] < 5 * 100


@pytest.mark.parametrize("dt", [2e-2, 1e-2, 5e-3])
@pytest.mark.parametrize("method", RADAU)
def test_the_estimate_of_fixed_steps_is_no_smaller_than_the_error(method, dt):
    case = {**falling(restitution=0.6), "output": {"interval": 0.1, "probes": {"mid": "rod@0.5"}},
            "solver": {"type": "dynamic", "t_end": 1.0, "method": method, "dt": dt}}
    found = ancf2d.solve(case)
    y, t = found.course["mid"]["y"], found.t
    exact = np.array([bounced(at, 0.6) for at in t])
    error = np.abs(y - exact).max() / np.abs(exact - HEIGHT).max()
    assert error <= found.accuracy["estimate"] < 1e-3


@pytest.mark.slow_rows("how0")
@pytest.mark.parametrize("how", [{"tolerance": 1e-4}, {"dt": 5e-3}])
def test_a_motion_does_not_depend_on_calls_and_resumes_from_a_checkpoint(how):
    def begin() -> Ride:
        return Ride(whip(), 0.3, every=1, method="radau5", **how).start()
    whole = begin().on()
    assert whole.stepper.s.numbers[SWITCHED] > 5
    parts = begin()
    parts.stepper.advance(parts.rows, 1)
    while parts.stepper.s.numbers[COUNT] < 0.7 * whole.stepper.s.numbers[COUNT]:
        parts.stepper.advance(parts.rows, 7)
    kept = {name: value.copy() for name, value in parts.stepper.checkpoint().items()}
    later = Ride(whip(), 0.3, every=1, method="radau5", **how)
    later.stepper.resume(kept)
    later.on()
    rows = {row.t: row for row in [*parts.rows, *later.rows]}
    assert sorted(rows) == sorted({row.t for row in whole.rows})
    for row in whole.rows:
        for name in ("z", "v", "a"):
            assert getattr(row, name).tobytes() == getattr(rows[row.t], name).tobytes()


def test_friction_without_a_law_is_refused():
    scene = falling(friction=0.3)
    bodies = scene.pop("bodies")
    for method in RADAU:
        model = h.build(bodies, {"type": "dynamic", "t_end": 1, "dt": 0.1, "method": method}, **scene)
        problem, = method_problems(model)
        assert "friction without a law (touch)" in problem.message
        assert "generalized_alpha" in problem.expected


@pytest.mark.slow
def test_a_chain_of_distant_links_moves_as_without_contact():
    """If Newton's method fails with nothing closed, steps become shorter, and remain those of Radau's method."""
    square, material = {"height": 0.05, "width": 0.05}, {"E": 1e9, "nu": 0.3, "rho": 1000.0}
    kinds = [{"type": "rigid"}, h.element("reissner3", 2), {"type": "rigid"}]
    bodies = {f"link {k}": h.body(h.line(0.5, start=(0.5 * k, 0.0)), kind, square, material)
              for k, kind in enumerate(kinds)}
    chain = {"bodies": bodies, "boundary_conditions": [{"type": "pin", "at": "link 0@0"}],
             "joints": [{"type": "pin", "between": [f"link {k}@1", f"link {k + 1}@0"]} for k in range(2)],
             "loads": [{"type": "gravity", "value": [0, -9.81]}],
             "solver": {"type": "dynamic", "t_end": 0.6, "method": "radau5", "tolerance": 1e-4, "estimate": False},
             "output": {"interval": 0.05, "probes": {"tip": "link 2@1"}}}
    pairs = [{"between": [f"link {k}", f"link {j}"]} for k, j in ((1, 0), (2, 1), (2, 0))]
    free, beside = ancf2d.solve(chain), ancf2d.solve({**chain, "contacts": pairs})
    np.testing.assert_allclose(beside.course["tip"]["y"], free.course["tip"]["y"], rtol=0, atol=1e-3)
    e = beside.energies
    total, size = e["kinetic"] + e["strain"] + e["potential"], (e["kinetic"] + e["strain"]).max()
    assert np.abs(total).max() < 1e-4 * size
