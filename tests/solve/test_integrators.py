"""The integrators by name: what each is made by, and what each refuses, where in the case."""

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
from ancf2d.solvers.motion.methods import MAKERS

FREE = {"bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}
EXACT = {**FREE, "bodies": {"a": rod("vallejo"), "b": rod("reissner3", 2, (1, 0), (2, 0))}}
HELD = {"bodies": {"a": rigid([0, 0], [1, 0], 1.0, 0.1)}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}


def refusals(scene, **solver):
    """Return what is refused: (key, message, expected) of every problem."""
    model = h.build(scene["bodies"], {"type": "dynamic", "t_end": 1.0, "dt": 0.01, **solver},
                    **{k: v for k, v in scene.items() if k != "bodies"})
    return [(p.path[1], p.message, p.expected) for p in method_problems(model)]


def test_every_integrator_is_made_by_the_tool_or_by_scipy():
    assert set(MAKERS) | set(SCIPY_METHODS) == set(INTEGRATORS)
    assert not set(MAKERS) & set(SCIPY_METHODS)


@pytest.mark.parametrize("method", INTEGRATORS)
def test_a_model_without_multipliers_is_moved_by_every_one(method):
    assert refusals(FREE, method=method) == []


def test_energy_cannot_be_kept_for_strains_by_an_angle():
    ((key, message, expected),) = refusals(EXACT, method="energy_momentum")
    assert key == "method"
    assert "geometrically_exact of b" in message
    assert "generalized_alpha" in expected


@pytest.mark.parametrize(("solver", "key"), [
    ({"method": "newmark"}, "method"), ({"method": "hht", "spectral_radius": 1.0}, "spectral_radius"),
    ({"method": "generalized_alpha", "spectral_radius": 1.0}, "spectral_radius")])
def test_what_damps_nothing_is_refused_with_multipliers(solver, key):
    ((found, message, _),) = refusals(HELD, **solver)
    assert found == key
    assert "makes the constraint forces of a grow from step to step" in message
    assert refusals(FREE, **solver) == []


def test_what_newmark_refuses_at_a_corner_says_which_elements_need_no_multipliers_there():
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
def test_spectral_radii_that_a_method_cannot_have(solver, part):
    ((key, message, _),) = refusals(FREE, **solver)
    assert key == "spectral_radius"
    assert part in message


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("method", INTEGRATORS)
def test_contact_without_a_law_is_refused_unless_it_is_declared_and_the_message_lists_the_others(method, friction):
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
    """Long steps, states close together, and many unknowns: the same states, to the bit, whatever the room."""
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
    """Do as ``increment_tolerance``, which kernels alone call."""
    return increment_tolerance(p, s, h, tolerance)


def test_increments_are_small_beside_what_rates_need_in_steps_far_shorter_than_usual():
    """Errors of rates are those of positions over h: beside the size of a motion they would be of any size."""
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
