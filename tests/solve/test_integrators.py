"""Integrators by name: their implementations, and refusals with their lines."""

from __future__ import annotations

import helpers as h
import pytest
from motions import GRAVITY, Ride, rigid, rod

from ancf2d.kernels.lowlevel.jit import kernel
from ancf2d.kernels.motion.advance import advance
from ancf2d.kernels.motion.state import SIZE, TIME
from ancf2d.kernels.motion.step_control import increment_tolerance
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.integrators import INTEGRATORS, SCIPY_METHODS, method_problems
from ancf2d.solvers.motion.own_integrators import MAKERS

FREE = {"bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}
EXACT = {**FREE, "bodies": {"a": rod("vallejo"), "b": rod("reissner3", 2, (1, 0), (2, 0))}}
HELD = {"bodies": {"a": rigid([0, 0], [1, 0], 1.0, 0.1)}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}


def refusals(scene, **solver):
    """Return (key, message, expected) of every refusal."""
    model = h.build(scene["bodies"], {"type": "dynamic", "t_end": 1.0, "dt": 0.01, **solver},
                    **{k: v for k, v in scene.items() if k != "bodies"})
    return [(p.path[1], p.message, p.expected) for p in method_problems(model)]


def test_every_integrator_is_from_ancf2d_or_scipy():
    assert set(MAKERS) | set(SCIPY_METHODS) == set(INTEGRATORS)
    assert not set(MAKERS) & set(SCIPY_METHODS)


@pytest.mark.parametrize("method", INTEGRATORS)
def test_every_integrator_accepts_a_model_without_multipliers(method):
    assert refusals(FREE, method=method) == []


def test_energy_momentum_refuses_strains_of_an_angle():
    ((key, message, expected),) = refusals(EXACT, method="energy_momentum")
    assert key == "method"
    assert "geometrically_exact of b" in message
    assert "generalized_alpha" in expected


@pytest.mark.parametrize(("solver", "key"), [
    ({"method": "newmark"}, "method"), ({"method": "hht", "spectral_radius": 1.0}, "spectral_radius"),
    ({"method": "generalized_alpha", "spectral_radius": 1.0}, "spectral_radius")])
def test_methods_without_damping_are_refused_with_multipliers(solver, key):
    ((found, message, _),) = refusals(HELD, **solver)
    assert found == key
    assert "makes the constraint forces of a grow from step to step" in message
    assert refusals(FREE, **solver) == []


def test_the_refusal_of_newmark_at_a_corner_names_elements_without_multipliers():
    def bent(name):
        frame = h.body({"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]]}, h.element(name, 2),
                             h.SECTION, h.MATERIAL)
        return {"bodies": {"a": frame}, "bc": [{"type": "clamp", "at": "a@0"}]}

    ((key, message, expected),) = refusals(bent("vallejo"), method="newmark")
    assert key == "method"
    assert "corner 1 of a" in message
    assert "generalized_alpha" in expected
    assert "reissner3" in expected
    assert refusals(bent("reissner3"), method="newmark") == []


@pytest.mark.parametrize(("solver", "part"), [
    ({"method": "hht", "spectral_radius": 0.4}, "0.4 is out of range for hht"),
    ({"method": "radau5", "spectral_radius": 0.8}, "radau5 has no spectral radius"),
    ({"spectral_radius": 0.8}, "radau5 has no spectral radius"),
    ({"method": "RK45", "spectral_radius": 0.8}, "RK45 has no spectral radius")])
def test_spectral_radii_out_of_range(solver, part):
    ((key, message, _),) = refusals(FREE, **solver)
    assert key == "spectral_radius"
    assert part in message


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("method", INTEGRATORS)
def test_contact_without_a_law_is_refused_with_a_list_of_methods_that_have_it(method, friction):
    scene = {"bodies": {"a": rod("vallejo")}, "obstacles": {"floor": {
        "type": "half_plane", "through": [0, -1], "normal": [0, 1]}}, "contacts": [
            {"between": ["a", "floor"], "friction": friction}]}
    told = [expected for _, message, expected in refusals(scene, method=method) if "without a law" in message]
    one = INTEGRATORS[method]
    assert len(told) == (0 if one.friction or (one.contact and not friction) else 1)
    suited = [m.name for m in INTEGRATORS.values() if (m.friction if one.contact else m.contact)]
    assert all(name in expected for expected in told for name in suited)


@pytest.mark.parametrize("room", [2, 3, 7])
def test_a_step_may_pass_more_states_than_there_is_room_for(monkeypatch, room):
    """Long steps, dense states, and many unknowns: the same states, to the bit, with any buffer."""
    scene = {"bodies": {"a": rod("reissner2", 2)}, "loads": GRAVITY, "bc": [{"type": "pin", "at": "a@0"}]}
    trips = []
    for some in (10**6, room):
        monkeypatch.setattr(stepping, "STATE_BYTES", 24 * 9 * some)
        trips.append(Ride(scene, 0.1, states=50, method="radau5", dt=0.05).start().on())
    assert len(trips[1].stepper.rows.t) < 10 <= len(trips[0].stepper.rows.t)
    whole, parts = ([(r.t, *r.z, *r.v, *r.a) for r in trip.rows] for trip in trips)
    assert len(whole) == 51
    assert parts == whole


def test_stepping_is_compiled_once_for_all_scenes_and_integrators():
    spring = {"type": "translational", "between": ["a@1", [1.0, 1.0]], "stiffness": 1.0}
    for scene, method in ((FREE, "radau5"), ({**FREE, "springs": [spring]}, "generalized_alpha")):
        Ride(scene, 1e-3, method=method, dt=1e-3).start().on()
    assert len(advance.signatures) == 1


@kernel
def small_enough(p, s, h, tolerance):
    """Call ``increment_tolerance``, which only kernels can call."""
    return increment_tolerance(p, s, h, tolerance)


def test_increments_are_small_relative_to_rates_in_very_short_steps():
    """Errors of rates are those of positions over h: relative to the size of a motion they could be large."""
    stepper = Ride(HELD, 1.0, dt=0.01).start().stepper
    p, s = stepper.p, stepper.s
    s.numbers[SIZE] = 2.0
    assert small_enough(p, s, 1e-9, 1e-8) == 2e-8
    s.numbers[TIME] = 0.5
    assert small_enough(p, s, 1e-3, 1e-8) == 2e-8
    # no rate: that of the motion so far
    assert small_enough(p, s, 1e-9, 1e-8) == pytest.approx(1e-8 * 1e4 * 1e-9 * 2.0 / 0.5)
    s.v[:] = 10.0 / p.weights.max()
    assert small_enough(p, s, 1e-9, 1e-8) == pytest.approx(1e-8 * 1e4 * 1e-9 * 10.0)
    # positions are known to round-off alone
    assert small_enough(p, s, 1e-13, 1e-12) == pytest.approx(1e-15 * max(2.0, p.extent))
    assert small_enough(p, s, 1e-13, 1e-16) == pytest.approx(2e-16)
