"""Contact without a law in motion: impacts, rest, sliding and rolling, compared with closed forms."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import helpers as h
import numpy as np
import pytest
from instruments.references import contacts as references
from motions import ride, rigid

import ancf2d
from ancf2d.solvers.motion.integrators import method_problems
from ancf2d.solvers.motion.stepping import LOG
from ancf2d.solvers.registry import solve

G, HEIGHT, MASS, INERTIA = 9.81, 0.5, 2.0, 0.2
FLOOR = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}}
FLAT = rigid([0, HEIGHT], [1, HEIGHT], MASS, INERTIA)
FALL = [{"type": "gravity", "value": [0, -G]}]


def scene(rod: dict[str, Any] = FLAT, obstacles: Any = FLOOR, loads: Any = FALL, **contact: Any) -> dict[str, Any]:
    """Return a rod whose axis may touch an obstacle."""
    touch = {"name": "touch", "between": ["rod", next(iter(obstacles))], "side": "axis", **contact}
    return {"bodies": {"rod": rod}, "loads": loads, "obstacles": obstacles, "contacts": [touch]}


def flung(velocity: tuple[float, float], rod: dict[str, Any] = FLAT, obstacles: Any = FLOOR, **contact: Any,
          ) -> dict[str, Any]:
    """Return a weightless rod that is thrown at an obstacle."""
    return {**scene(rod, obstacles, [], **contact), "initial": {"velocity": list(velocity)}}


def middle(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return times and heights (states,) of the middle of the rod."""
    return np.array([row.t for row in found.rows]), np.array([found.place("rod@0.5", k)[1]
                                                              for k in range(len(found.rows))])


def lost(found: Any) -> float:
    """Return the energy lost in contact."""
    return float(found.rows[-1].lost)


def test_a_rod_that_falls_flat_lies_still_where_it_lands():
    found = ride(scene(), 0.6, dt=1e-3)
    for s in ("rod@0", "rod@1"):
        assert found.place(s)[1] == pytest.approx(0.0, abs=1e-12)
    _, v, _ = found.full()
    assert np.abs(v).max() < 1e-10
    # all that it had
    assert lost(found) == pytest.approx(MASS * G * HEIGHT, rel=1e-10)


def test_bounces_have_the_right_times_and_heights():
    found = ride(scene(restitution=0.8), 1.5, dt=5e-4, every=1)
    t, y = middle(found)
    times, heights = references.bounces(HEIGHT, 0.8, G, 3)
    hits = t[1:-1][(y[1:-1] <= y[:-2]) & (y[1:-1] < y[2:]) & (y[1:-1] < 1e-12)]
    # a step late at most, each
    assert hits[:3] == pytest.approx(times[:3], abs=3 * 5e-4)
    tops = [y[(t > a) & (t < b)].max() for a, b in pairwise(times)]
    assert tops[:2] == pytest.approx(heights[:2], rel=2e-3)


@pytest.mark.parametrize("dt", [3e-2, 1e-3])
def test_elastic_bounces_continue_forever(dt):
    found = ride(scene(restitution=1.0), 4000 * dt, dt=dt, states=50)
    total, _ = found.totals()
    assert total == pytest.approx(total[0] * np.ones_like(total), abs=1e-9 * MASS * G * HEIGHT)


@pytest.mark.slow
def test_a_bouncing_rod_gains_no_energy_in_100000_steps():
    tilted = rigid([0, HEIGHT], [0.9, 0.9], MASS, INERTIA)
    found = ride(scene(tilted, restitution=1.0), 100.0, dt=1e-3, states=1000)
    total, _ = found.totals()
    size = MASS * G * HEIGHT
    assert total[0] - 1e-3 * size <= total.min() <= total.max() <= total[0] + 1e-9 * size


@pytest.mark.parametrize("restitution", [0.0, 0.6])
def test_a_rod_that_hits_a_stop_turns_by_its_impulse(restitution):
    # the stop is 0.3 to the right of the middle
    peg = {"peg": {"type": "polyline", "points": [[0.95, 0.3], [1.05, 0.3]]}}
    found = ride(flung((0, -2.0), obstacles=peg, restitution=restitution), 0.1005, dt=1e-3)
    _, v, _ = found.full()
    # of a rigid body: x, y of its first point and a direction
    vy, omega, _ = references.struck_rod(MASS, INERTIA, 0.5, 2.0, restitution)
    model = found.model
    rates = {s: float(h.dot(h.point_ref(model.meshes["rod"], s).position()[1], v)) for s in (0.5, 1.0)}
    # at once after the impact, while the rod has hardly turned
    assert rates[0.5] == pytest.approx(vy, abs=2e-2)
    assert (rates[1.0] - rates[0.5]) / 0.5 == pytest.approx(omega, abs=4e-2)


@pytest.mark.parametrize(("friction", "restitution", "sticks"), [
    (0.1, 0.0, False), (0.1, 0.4, False), (1.0, 0.4, True)])
def test_an_impact_with_friction_is_that_of_a_rigid_body(friction, restitution, sticks):
    """A rod hits the floor with one end and sticks or slides; the step of the impact turns it by 1e-3."""
    arm, before = 0.5 * np.array([math.cos(0.7), math.sin(0.7)]), np.array([2.5, -3.0, 0.0])
    start = np.array([0.0, arm[1] + 0.0289])
    rod = rigid(list(start - arm), list(start + arm), MASS, INERTIA)
    found = ride(flung((2.5, -3.0), rod, friction=friction, restitution=restitution), 0.02, dt=1e-3, every=1)
    vx, vy, omega = references.struck_with_friction(MASS, INERTIA, -arm, before, friction, restitution)
    middle = np.array([found.place("rod@0.5", k) for k in range(len(found.rows))])
    now, then = found.rows[-1].t, next(row.t for row in found.rows if row.t > 0.0105)
    rate = (middle[-1] - middle[[row.t for row in found.rows].index(then)]) / (now - then)
    assert (vx - omega * 0.5 * math.sin(-0.7) == pytest.approx(0.0, abs=1e-12)) == sticks
    if restitution > 0.0:
        # nothing acts behind it
        assert rate == pytest.approx([vx, vy], abs=5e-3)
    energy = 0.5 * (MASS * (before @ before) - MASS * (vx**2 + vy**2) - INERTIA * omega**2)
    assert lost(found) == pytest.approx(energy, rel=3e-3)


@pytest.mark.parametrize("restitution", [pytest.param(0.0, marks=pytest.mark.slow), 0.5])
def test_a_rod_that_falls_flat_slides_on_more_slowly(restitution):
    """Both ends hit at once: friction acts on the whole impulse, and at most stops the rod."""
    fall = math.sqrt(2.0 * G * HEIGHT)
    for friction in (0.2, 5.0):
        slides = {**scene(friction=friction, restitution=restitution), "initial": {"velocity": [4.0, 0.0]}}
        found = ride(slides, 0.3225, dt=5e-4)
        _, v, _ = found.full()
        rate = float(h.dot(h.point_ref(found.model.meshes["rod"], 0.5).position()[0], v))
        assert rate == pytest.approx(max(4.0 - friction * (1.0 + restitution) * fall, 0.0), abs=1e-2)


def test_friction_has_the_whole_impulse_in_the_step_of_an_impact():
    """A rod falls flat within a step and stays: friction mu times the impulse m g t slows it down, to round-off."""
    slides = {**scene(friction=0.2), "initial": {"velocity": [4.0, 0.0]}}
    found = ride(slides, 0.36, dt=2e-2)
    _, v, _ = found.full()
    rate = float(h.dot(h.point_ref(found.model.meshes["rod"], 0.5).position()[0], v))
    assert rate == pytest.approx(4.0 - 0.2 * G * 0.36, abs=1e-9)


@pytest.mark.parametrize("dt", [2e-2, pytest.param(1e-3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("angle", [0.1, 1.2, 2.5])
def test_a_tumbling_rod_never_penetrates_nor_gains_energy(angle, dt):
    rod = rigid([0, 0.8], [0.9 * math.cos(angle), 0.8 + 0.9 * math.sin(angle)], MASS, INERTIA)
    found = ride(scene(rod), 2.0, dt=dt, every=1)
    total, _ = found.totals()
    for s in ("rod@0", "rod@1"):
        assert min(found.place(s, k)[1] for k in range(len(found.rows))) > -1e-9
    assert np.diff(total).max() < 2e-3 * MASS * G
    assert total.max() <= total[0] + 1e-9 * MASS * G


@pytest.mark.parametrize("dt", [0.3, 0.02, 1e-3])
def test_nothing_passes_through_an_obstacle_in_long_steps(dt):
    peg = {"peg": {"type": "circle", "center": [0, -1], "radius": 0.01}}
    found = ride(flung((0, -50.0), obstacles=peg), 0.3, dt=dt)
    # the end that met the peg lost its speed to the turning of the rod
    assert lost(found) > 100.0


def test_adaptive_steps_end_where_a_contact_closes():
    # nothing else makes the steps of a free fall short
    found = ride(scene(restitution=0.8), 1.0, tolerance=1e-6, every=1)
    v = math.sqrt(2.0 * G * HEIGHT)
    since = 1.0 - v / G * (1.0 + 2.0 * 0.8)
    assert found.place("rod@1")[1] == pytest.approx(0.8**2 * v * since - 0.5 * G * since**2, abs=2e-5)
    assert len(found.rows) < 200
    assert lost(found) == pytest.approx(0.5 * MASS * v**2 * (1.0 - 0.8**4), rel=1e-4)


def test_a_rising_floor_lifts_a_rod_and_its_work_is_counted():
    lift = {"floor": {**FLOOR["floor"], "motion": {"y": {"type": "expression", "value": "0.6*sin(t)^2"}}}}
    found = ride(scene(obstacles=lift), 1.0, dt=1e-3)
    assert found.place("rod@0")[1] == pytest.approx(0.6 * math.sin(1.0)**2, abs=1e-9)
    total, _ = found.totals()
    row = found.rows[-1]
    assert total[-1] - total[0] == pytest.approx(row.work - row.lost, rel=2e-3)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_moving_wall_does_work_of_its_impulse_times_its_speed(restitution):
    """A rod at rest leaves with (1 + e) V: the impulse m (1 + e) V does m (1 + e) V^2, m (1 - e^2) V^2/2 is lost."""
    V, gap, dt = 2.0, 0.05, 1e-3
    wall = {"wall": {"type": "half_plane", "through": [-gap, 0], "normal": [1, 0],
                     "motion": {"x": {"type": "expression", "value": f"{V}*t"}}}}
    rod = rigid([0, 0], [1, 0], MASS, INERTIA)
    found = ride(scene(rod, wall, [], restitution=restitution), 2.0 * gap / V, dt=dt, every=1)
    _, v, _ = found.full()
    assert v[0] == pytest.approx((1.0 + restitution) * V, rel=1e-9)
    row = found.rows[-1]
    assert row.work == pytest.approx(MASS * (1.0 + restitution) * V**2, rel=1e-9)
    assert row.lost == pytest.approx(0.5 * MASS * (1.0 - restitution**2) * V**2, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_a_bounce_with_friction_off_a_moving_floor_gains_at_most_its_work(speed):
    """If a rod sticks in a bounce, Newton's restitution and Coulomb's friction alone would add energy."""
    rod = rigid([0, 0.1], [math.cos(1.1), 0.1 + math.sin(1.1)], MASS, INERTIA)
    floor = {"floor": {**FLOOR["floor"], "motion": {"y": {"type": "expression", "value": f"{speed}*t"}}}}
    found = ride({**scene(rod, floor, [], friction=1.0, restitution=1.0), "initial": {"velocity": [3.0, -2.0]}}, 0.2,
                 dt=1e-2, every=1)
    total, _ = found.totals()
    balance = total + np.array([row.lost - row.work for row in found.rows])
    assert balance.max() < (1.0 + 1e-9) * balance[0]
    assert math.copysign(1.0, found.rows[-1].work) == math.copysign(1.0, speed)


def test_shaking_elsewhere_adds_no_energy_in_an_impact():
    """It has no effect on bounces that spin a rod by more than 0.4 rad per step, which are divided."""
    rod = rigid([0.0, 0.3], [0.02, 0.5], MASS, 1e-3)
    rests = {"type": "circle", "center": [9, 9], "radius": 0.5}
    shakes = {**rests, "motion": {"x": {"type": "sine", "scale": 0.05, "frequency": 2.0}}}
    touch = scene(rod, restitution=1.0)
    contacts = [*touch["contacts"], {**touch["contacts"][0], "name": "far", "between": ["rod", "far"]}]
    one, other = (ride({**touch, "obstacles": {**FLOOR, "far": far}, "contacts": contacts,
                        "initial": {"velocity": [1.0, -3.0]}}, 1.0, dt=2e-2, every=1) for far in (rests, shakes))
    total, _ = one.totals()
    assert total.max() < 1.005 * total[0]
    assert [row.t for row in one.rows] == [row.t for row in other.rows]
    np.testing.assert_allclose(other.totals()[0], total, rtol=1e-9)
    assert other.rows[-1].work == 0.0


def test_an_elastic_bar_stays_at_a_wall_for_two_passages_of_its_wave():
    count, v, gap = 40, 0.01, 0.005
    section = {"EA": 1.0, "EI": 1e-4, "kGA": 0.3, "rhoA": 1.0, "rhoI": 1e-4}
    bar = h.body({"type": "line", "start": [gap, 0], "end": [1 + gap, 0]}, h.element("reissner2", count), section)
    wall = {"wall": {"type": "half_plane", "through": [0, 0], "normal": [1, 0]}}
    found = ride(flung((-v, 0), bar, wall), 3.2, dt=0.5 / count, every=1)
    duration, force, after = references.bar_against_wall(1.0, 1.0, 1.0, v)
    t = np.array([row.t for row in found.rows])
    x = np.array([found.place("rod@0", k)[0] for k in range(len(t))])
    touching = t[x < 1e-9]
    assert touching[-1] - touching[0] == pytest.approx(duration, abs=2.5 / count)
    assert touching[0] == pytest.approx(gap / v, abs=1.0 / count)
    # impulse and rebound: what waves shorter than the elements keep is all that is missing
    _, momenta = found.totals()
    assert momenta[-1, 0] == pytest.approx(-after, rel=0.04)
    inside = (t > gap / v + 0.3) & (t < gap / v + 1.7)
    middle, ends = momenta[inside, 0], t[inside]
    assert (middle[-1] - middle[0]) / (ends[-1] - ends[0]) == pytest.approx(force, rel=0.02)


@pytest.mark.parametrize("mu", [0.5, 0.2])
def test_a_block_on_an_incline_sticks_or_slides(mu):
    rod = rigid([0, 0], [1, 0], MASS, INERTIA)
    slope, size = 0.3, G
    loads = [{"type": "gravity", "value": [size * math.sin(slope), -size * math.cos(slope)]}]
    found = ride(scene(rod, loads=loads, friction=mu), 1.0, dt=2e-3)
    way = references.on_incline(slope, mu, size, 1.0)
    assert found.place("rod@0")[0] == pytest.approx(way, rel=5e-3, abs=1e-5)
    # friction takes what the way costs
    row = found.rows[-1]
    assert row.lost - row.work == pytest.approx(mu * MASS * size * math.cos(slope) * way, rel=5e-3, abs=1e-4)


@pytest.mark.parametrize("mu", [0.3, 1.0])
def test_sliding_steps_take_few_iterations(mu):
    """A rod with a sliding foot falls: Newton's method has the whole tangent, which friction makes unsymmetric."""
    touch = {**scene(rigid([0, 0], [0.6, 0.8], MASS, INERTIA), friction=mu), "initial": {"velocity": [3.0, 0.0]}}
    found = ride(touch, 0.1, dt=1e-2, every=1)
    log = np.concatenate([row.log for row in found.rows])
    assert len(log) == 10
    assert log[:, LOG.index("iterations")].max() <= 4
    assert lost(found) > 0.1


@pytest.mark.slow_rows("0.5-steps1")
@pytest.mark.parametrize(("share", "steps"), [(0.5, {"dt": 1e-3}), (0.5, {"tolerance": 1e-6}), (0.96, {"dt": 1e-3}),
                                              (0.96, {"tolerance": 1e-4})])
def test_a_block_at_rest_takes_few_steps_and_no_warnings(share, steps):
    """The springs of sticking friction vibrate, but the block does not; ``share`` of the limit is borne."""
    block = {"geometry": {"type": "line", "start": [-0.05, 0.02], "end": [0.05, 0.02]}, "element": {"type": "rigid"},
             "section": {"height": 0.04, "width": 0.1}, "material": {"E": 2e11, "nu": 0.3, "rho": 1000}}
    solved = ancf2d.solve({
        "bodies": {"block": block}, "obstacles": {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        "contacts": [{"between": ["block", "floor"], "friction": 0.3}],
        "loads": [{"type": "gravity", "value": [share * 2.7, -9]}], "output": {"probes": {"c": "block@0.5"}},
        "solver": {"type": "dynamic", "t_end": 0.05, **steps}}, states=False)
    assert solved.summary["steps"] < 250
    assert abs(solved.probes["c"]["ux"]) < 1e-9
    assert solved.warnings == []
    assert solved.summary["energy_drift"] < 1e-2


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_energy_of_a_layer_is_balanced_and_an_obstacle_at_rest_does_no_work(friction):
    rod = rigid([0, 0.1], [0.8, 0.2], MASS, INERTIA)
    law = {"stiffness": 2e4, "damping": 20.0}
    found = ride(scene(rod, friction=friction, law=law), 0.5, tolerance=1e-7, every=1)
    total, _ = found.totals()
    took = np.array([row.lost for row in found.rows])
    assert max(abs(row.work) for row in found.rows) < 1e-8
    # strain of the layer included, and what friction holds on to less
    np.testing.assert_allclose(total + took, total[0], atol=2e-3 * MASS * G * 0.1)
    assert took[-1] > 0.1 * MASS * G * 0.1
    # sliding takes energy, and never gives any but what little it held
    assert np.diff(took).min() > -1e-4 * took[-1]


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("kind", h.chosen(["rigid", "cable"], ["cable"]))
def test_energy_momentum_conserves_energy_and_momentum_with_a_layer(kind, friction):
    """A tilted weightless rod bounces off floor and disc: to round-off, also with energy lost to friction."""
    start, end = [0, 0.05], [0.8, 0.15]
    section = {"EA": 2e3, "EI": 2.0, "rhoA": 1.0}
    rod = rigid(start, end, 2.0, 0.2) if kind == "rigid" else h.body(
        {"type": "line", "start": start, "end": end}, h.element("cable", 2), section)
    law = {"stiffness": 2e4}
    touch = flung((1.0, -2.0), rod, friction=friction, law=law)
    found = ride(touch, 0.4, dt=2e-3, every=1, method="energy_momentum")
    total, momenta = found.totals()
    took = np.array([row.lost for row in found.rows])
    np.testing.assert_allclose(total + took, total[0], rtol=1e-9)
    # it has left again, and the floor has pushed across itself alone where there is no friction
    assert momenta[-1, 1] > 0.2 * abs(momenta[0, 1])
    if friction == 0.0:
        np.testing.assert_allclose(momenta[:, 0], momenta[0, 0], rtol=1e-9)
        assert np.abs(took).max() < 1e-9 * total[0]
    else:
        assert took[-1] > 1e-2 * total[0]


@pytest.mark.parametrize(("stiffness", "passes"), [(5e3, True), (1e4, False)])
def test_a_layer_is_conservative_beyond_the_middle_of_an_obstacle(stiffness, passes):
    """Faces of a rod thrown at a soft disc come out on its other side, or turn inside; nothing else dissipates."""
    section = {"EA": 6e4, "EI": 2.0, "kGA": 2e4, "rhoA": 1.0, "rhoI": 1e-3}
    rod = h.body(h.line(1.0, start=(0.0, 0.15)), h.element("reissner3", 4), section)
    disc = {"disc": {"type": "circle", "center": [0.4, 0], "radius": 0.1}}
    found = ride(flung((0.0, -3.0), rod, disc, side="surface", law={"stiffness": stiffness}), 0.2, tolerance=1e-6,
                 every=1)
    total, _ = found.totals()
    np.testing.assert_allclose(total, 4.5, rtol=1e-3)
    assert (found.place("rod@0.4")[1] < -0.1) == passes


def test_steps_too_long_for_a_layer_give_a_warning():
    touch = {**scene(rigid([0, -1e-4], [1, -1e-4], MASS, INERTIA), law={"stiffness": 1e7}, friction=0.5),
             "initial": {"velocity": [1.0, -3.0]}}
    bodies = touch.pop("bodies")
    *_, last = solve(h.build(bodies, {"type": "dynamic", "t_end": 0.5, "dt": 0.02, "method": "newmark"}, **touch))
    assert any("of its energy by numerical errors: the steps are too long for the contact layer (touch)" in w
               for w in last.warnings)


def test_methods_that_cannot_step_an_impact_are_refused():
    rod = scene()
    bodies = rod.pop("bodies")
    for method in ("newmark", "energy_momentum", "RK45"):
        model = h.build(bodies, {"type": "dynamic", "t_end": 1, "dt": 0.1, "method": method}, **rod)
        found = method_problems(model)
        assert any("contact without a law (touch)" in p.message and "generalized_alpha" in p.expected for p in found)
        # nothing is advised that contact refuses in turn
        assert not any("energy_momentum" in p.expected for p in found)


@pytest.mark.slow_rows("cable-None")
@pytest.mark.parametrize(("element", "every"), [("cable", None), ("reissner3", 1)])
def test_a_flexible_block_thrown_along_a_floor_is_slowed_only_by_friction(element, every):
    """Waves of the impact open and close the contact; the total impulse is m g t, of which friction takes mu.

    The steps damp waves too short for them, which takes energy and gives none.
    """
    mu, end, drop = 0.3, 0.3, 1e-3
    body = h.body({"type": "line", "start": [0.2, 0.01 + drop], "end": [0.4, 0.01 + drop]}, h.element(element, 4),
                  {"height": 0.02, "width": 0.05}, {"E": 7e10, "nu": 0.3, "rho": 2700.0})
    found = ancf2d.solve({
        "bodies": {"block": body}, "obstacles": FLOOR, "loads": FALL,
        "contacts": [{"between": ["block", "floor"], "friction": mu}],
        "initial": {"bodies": {"block": {"velocity": [1.0, 0]}}},
        "output": {"probes": {"b": "block@0.5"}} | ({"every": every} if every else {}),
        "solver": {"type": "dynamic", "t_end": end, "tolerance": 1e-4, "estimate": False}})
    energy = found.energies
    total = sum(energy[part] for part in ("kinetic", "strain", "potential", "dissipated"))
    given = 0.5 * 0.54 * 1.0**2
    # at all stored states
    assert (total - np.minimum.accumulate(total)).max() < 1e-3 * given
    assert total[0] - total.min() < 0.02 * given
    assert energy["strain"].max() < 1e-2 * given
    assert found.probes["b"]["vx"] == pytest.approx(1.0 - mu * G * end, abs=2e-3)


def test_steps_with_contact_end_at_stored_states():
    """Rates jump within a step, so an interpolated state would have more energy than either end."""
    case = scene(rigid([0, 0.3], [1, HEIGHT], MASS, INERTIA), restitution=0.5)
    found = ride(case, 0.6, tolerance=1e-5, states=80)
    total, _ = found.totals()
    took = np.array([row.lost for row in found.rows])
    assert len(took) == 81
    assert took[-1] > 0.1 * MASS * G * HEIGHT
    assert np.abs(total + took - total[0]).max() < 1e-3 * MASS * G * HEIGHT
    # the grid of states is met to round-off
    steps = found.column("t")
    assert all(np.abs(steps - row.t).min() < 1e-12 for row in found.rows[1:])
