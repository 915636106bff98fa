"""Motion across breaks of amplitudes: jumps of loads, of prescribed rates and their work, states stored there."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from motions import OWN, rigid, rod

from ancf2d.kernels.motion.state import WORK
from ancf2d.solvers.energy import Energies
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.motion.integrators import SCIPY_METHODS

CONSTRAINED = [m for m in OWN if m != "newmark"]
BREAK = 0.0523


def told(value):
    """Return an amplitude: a formula, or the given value."""
    return value if isinstance(value, dict) else {"type": "expression", "value": value}


def moved(scene, t_end, output=None, **solver):
    """Return the run of a scene and its states."""
    more = {k: v for k, v in scene.items() if k != "bodies"}
    model = h.build(scene["bodies"], {"type": "dynamic", "t_end": t_end, **solver}, output=output or {}, **more)
    run = Run(model, model.case.solver)
    return run, list(run.states())


def seen(model, state, at):
    """Return position and velocity (2,) of BODY@S."""
    name, s = at.split("@")
    columns = h.point_ref(model.meshes[name], float(s)).position()
    e = model.e0 + state.d[:model.n_q]
    return np.array([h.dot(c, e) for c in columns]), np.array([h.dot(c, state.v) for c in columns])


FREE = {"bodies": {"a": rod("cable", 1)}}
PUSHES = {"<": f"1 if t < {BREAK} else 0", "<=": f"1 if t <= {BREAK} else 0", ">": f"0 if t > {BREAK} else 1",
          ">=": f"0 if t >= {BREAK} else 1"}


@pytest.mark.parametrize("method", h.chosen([*OWN, *SCIPY_METHODS], [*OWN, "DOP853"]))
def test_a_force_that_ends_inside_a_step_gives_its_impulse(method):
    """However it bends meanwhile, a free body has the momentum of the impulse."""
    # a step over the break would be off by its error; the impulse of steps that end there is exact, whatever that is
    step = {"dt": 1e-3, "estimate": False} if method in OWN else {"tolerance": 1e-3}
    for name, push in PUSHES.items() if method == "radau5" else [("<", PUSHES["<"])]:
        scene = {**FREE, "loads": [{"type": "force", "at": "a@1", "value": [1, 0], "amplitude": told(push)}]}
        run, states = moved(scene, 1.2 * BREAK, method=method, **step)
        px, *_ = Energies(run.model).momentum(states[-1].d, states[-1].v)
        assert px == pytest.approx(BREAK, rel=1e-12 if method in OWN else 1e-6), name


@pytest.mark.parametrize("method", ["radau5", "energy_momentum"])
def test_a_force_that_ends_with_the_motion_acts_up_to_its_end(method):
    table = {"type": "table", "t": [0.0, 0.05], "value": [0.0, 1.0], "smooth": True}
    for text, impulse in ((f"1 if t < {BREAK} else 0", BREAK), (table, 0.025)):
        scene = {**FREE, "loads": [{"type": "force", "at": "a@1", "value": [1, 0], "amplitude": told(text)}]}
        t_end = BREAK if isinstance(text, str) else 0.05
        run, states = moved(scene, t_end, method=method, dt=1e-3, estimate=False)
        # both rules integrate a cubic with level ends exactly
        assert Energies(run.model).momentum(states[-1].d, states[-1].v)[0] == pytest.approx(impulse, rel=1e-12)


# ---------------------------------------------------------------------- rates that jump

A, V, LENGTH, MASS, INERTIA, ANGLE = 0.0123, 2.5, 1.0, 2.0, 0.5, 0.7
RATES = {
    "ramp": {"type": "ramp", "t0": A, "t1": BREAK, "scale": V * (BREAK - A)},
    "table": {"type": "table", "t": [0, A, BREAK, 1], "value": [0, 0, V * (BREAK - A), V * (BREAK - A)]},
    "<": f"{V}*(0 if t < {A} else (t - {A}) if t < {BREAK} else {BREAK - A!r})",
    "<=": f"{V}*(0 if t <= {A} else (t - {A}) if t <= {BREAK} else {BREAK - A!r})",
    ">": f"{V}*({BREAK - A!r} if t > {BREAK} else (t - {A}) if t > {A} else 0)",
    ">=": f"{V}*({BREAK - A!r} if t >= {BREAK} else (t - {A}) if t >= {A} else 0)",
    "abs": f"{V}*0.5*(abs(t - {A}) - abs(t - {BREAK}) + {BREAK - A!r})",
    "nested": f"{V}*((t - {A} if (t > {A})*(t < {BREAK}) else {BREAK - A!r}) if t > {A} else 0)",
    "nonlinear": f"{V}*(0 if t^2 < {A**2!r} else (t - {A}) if exp(t) < {float(np.exp(BREAK))!r} else {BREAK - A!r})",
}


def swung(t_end):
    """Return position and velocity of the end of a bar whose other end starts to move along x, and stops.

    Between the jumps it turns steadily about the end that is moved; a jump of its speed by V turns it by the impulse
    there, MASS LENGTH/2 sin(angle) V about it.
    """
    about, arm = INERTIA + MASS * LENGTH**2 / 4, MASS * LENGTH / 2
    omega = arm * np.sin(ANGLE) * V / about
    angle = ANGLE + omega * (BREAK - A)
    omega -= arm * np.sin(angle) * V / about
    angle += omega * (t_end - BREAK)
    across = np.array([-np.sin(angle), np.cos(angle)])
    return [V * (BREAK - A), 0] + LENGTH * np.array([np.cos(angle), np.sin(angle)]), omega * LENGTH * across


@pytest.mark.parametrize(("method", "spelled"), [
    *(("radau5", name) for name in RATES), *((m, "<=") for m in CONSTRAINED if m != "radau5"), ("RK45", "<"),
    ("DOP853", "ramp"), ("LSODA", "<")])
def test_bodies_follow_a_jump_of_a_prescribed_rate(method, spelled):
    """Velocities jump by the impulse of the drive, whose work is in the energy balance."""
    scene = {"bodies": {"b": rigid([0, 0], LENGTH * np.array([np.cos(ANGLE), np.sin(ANGLE)]), MASS, INERTIA)},
             "bc": [{"name": "hand", "type": "prescribed", "at": "b@0", "ux": told(RATES[spelled]), "uy": 0}]}
    step = {"dt": 2e-3} if method in OWN else {"tolerance": 1e-9}
    run, states = moved(scene, 0.1, method=method, **step)
    place, velocity = seen(run.model, states[-1], "b@1")
    want, rate = swung(0.1)
    second = method in OWN and run.stepper.method.order == 2
    np.testing.assert_allclose(place, want, atol=1e-6 if second else 1e-9)
    np.testing.assert_allclose(velocity, rate, atol=1e-6 if second else 1e-8)
    assert run.balance.drift < (1e-6 if second else 1e-9)
    assert states[-1].warnings == []


def test_states_stored_at_a_jump_are_those_before_it():
    scene = {"bodies": {"b": rigid([0, 0], [1, 0], MASS, INERTIA)},
             "bc": [{"name": "hand", "type": "prescribed", "at": "b@0", "ux": told("2*t if t < 0.05 else 0.1"),
                     "uy": 0}],
             "loads": [{"type": "force", "at": "b@0.5", "value": [3, 0], "amplitude": told("1 if t < 0.05 else 0")}]}
    for step in ({"dt": 0.01}, {"tolerance": 1e-6}):
        run, states = moved(scene, 0.1, {"interval": 0.05}, method="radau5", **step)
        (state,) = [s for s in states if s.t == pytest.approx(0.05)]
        for at in ("b@0", "b@0.5", "b@1"):
            place, velocity = seen(run.model, state, at)
            assert place[0] == pytest.approx(float(at[2:]) + 0.1, abs=1e-12)
            assert velocity[0] == pytest.approx(2.0, abs=1e-9)
        assert state.F[:run.model.n_q].max() > 1.0
        assert state.history["kinetic"] == pytest.approx(0.5 * MASS * 2.0**2, rel=1e-9)


# ---------------------------------------------------------------------- orders

WAVE = "0.005*abs(sin(20*pi*t + 1)) - 0.005*sin(1)"
BROKEN = {
    "force": {"loads": [{"type": "force", "at": "a@1", "value": [0, 3], "amplitude": told("sin(22*pi*t + 1) > 0")}]},
    "follower": {"loads": [{"type": "follower_force", "at": "a@1", "value": [0, 3],
                            "amplitude": told("sin(22*pi*t + 1) > 0")}]},
    "moment": {"loads": [{"type": "moment", "at": "a@1", "value": 1, "amplitude": told("sin(22*pi*t + 1) > 0")}]},
    "gravity": {"loads": [{"type": "gravity", "value": [0, -9], "amplitude": told("abs(sin(22*pi*t + 1))")}]},
    "shaken": {"bc": [{"name": "hand", "type": "prescribed", "at": "a@0", "ux": told(WAVE), "uy": told(WAVE)}]},
    "turned": {"bc": [{"name": "hand", "type": "prescribed", "at": "a@0", "ux": 0, "uy": 0, "angle": told(WAVE)}]},
}
PINNED = [{"name": "hand", "type": "pin", "at": "a@0"}]
KNEE = [{"type": "pin", "between": ["a@1", "b@0"]}]
BARS = {"a": rigid([0, 0], [0.3, 0.1], 1.3, 0.2), "b": rigid([0.3, 0.1], [0.6, -0.6], 0.9, 0.11)}


@pytest.fixture(scope="module")
def references():
    return {}


@pytest.mark.slow_rows("force-generalized_alpha-(160, 320)-2", "gravity-generalized_alpha-(160, 320)-2",
                       "moment-energy_momentum-(160, 320)-2")
@h.covering(what=BROKEN, scheme=[("generalized_alpha", (160, 320), 2), ("radau5", (10, 40), 3),
                                 ("energy_momentum", (160, 320), 2)])
def test_ten_breaks_do_not_reduce_the_order(references, what, scheme):
    """Steps are cut at breaks, so no order is lost there. Radau's soon reaches round-off."""
    scene = {"bodies": BARS, "joints": KNEE, "bc": PINNED, **BROKEN[what]}
    method, steps, order = scheme

    def end(method, n):
        run, states = moved(scene, 0.5, method=method, dt=0.5 / n, estimate=False)
        assert len(run.stepper.pieces) >= 10
        return np.concatenate([seen(run.model, states[-1], at)[0] for at in ("a@1", "b@1")])

    if what not in references:
        references[what] = end("radau5", 320)
    errors = [np.abs(end(method, n) - references[what]).max() for n in steps]
    assert errors[1] < 1e-8 or np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) > order - 0.3


# ---------------------------------------------------------------------- the balance of energy

SMOOTH = "0.02*sin(20*pi*t + 1) - 0.02*sin(1)"
FED = [{"name": "hand", "type": "prescribed", "at": "a@0", "ux": told(SMOOTH), "uy": told(WAVE), "angle": told(WAVE)}]
MOVED = [{"name": "hand", "type": "prescribed", "at": "a@0", "ux": told(SMOOTH), "uy": told(WAVE)}]
DAMPED = {"damping": {"rayleigh": {"alpha": 3.0, "beta": 0.0}},
          "springs": [{"type": "translational", "between": ["b@1", [2, 0]], "stiffness": 50.0, "damping": 3.0,
                       "length": 1.0}],
          "loads": [{"type": kind, "at": "b@1", "value": [0, 3], "amplitude": told("sin(40*t)")}
                    for kind in ("force", "follower_force")]}


@pytest.mark.parametrize("more", [{}, DAMPED], ids=["driven", "and damped and loaded"])
@pytest.mark.parametrize("held", [MOVED, FED], ids=["moved", "turned"])
def test_energy_momentum_accounts_for_all_work_to_round_off(held, more):
    """Drives with jumping rates, damping and varying loads: by the forces of the steps themselves."""
    run, _ = moved({"bodies": BARS, "joints": KNEE, "bc": held, **more}, 0.2, method="energy_momentum", dt=2.5e-3,
                   estimate=False)
    assert len(run.stepper.pieces) >= 4
    assert abs(run.stepper.s.numbers[WORK]) > 1e-3
    assert run.balance.drift < 1e-11


def test_mass_damping_acts_on_prescribed_motion_too():
    scene = {"bodies": BARS, "joints": KNEE, "bc": MOVED, "damping": {"rayleigh": {"alpha": 30.0, "beta": 0.0}}}
    drifts = [moved(scene, 0.05, method="radau5", dt=dt, estimate=False)[0].balance.drift for dt in (2e-3, 5e-4)]
    assert drifts[0] < 1e-3
    assert drifts[1] < 0.1 * drifts[0]


@pytest.mark.parametrize("output", [{}, {"every": 7}, {"interval": 0.0137}])
def test_the_drift_is_that_of_all_steps_for_any_stored_states(output):
    scene = {"bodies": {"a": rod("2d2n", 2)}, "bc": [{"type": "pin", "at": "a@0"}],
             "loads": [{"type": "gravity", "value": [0, -9.81]}]}
    run, states = moved(scene, 0.4, output, method="energy_momentum", dt=2e-3, estimate=False)
    assert len(states) > 20
    assert run.balance.drift < 1e-11


def test_stored_states_of_fixed_steps_are_ends_of_steps():
    for dt, count in ((1e-3, 201), (2.5e-4, 201), (3e-3, 68)):
        _, states = moved(FREE, 0.2, method="generalized_alpha", dt=dt, estimate=False)
        assert len(states) == count
        times = np.array([s.t for s in states[:-1]])
        np.testing.assert_array_equal(times, np.round(times / dt) * dt)


def test_the_error_is_estimated_with_steps_cut_at_breaks():
    """States after every so many steps have the same times as in coarser runs, also after a break."""
    scene = {"bodies": {"b": rigid([0, 0], [1, 0], MASS, INERTIA)}, "bc": [{"type": "pin", "at": "b@0"}],
             "loads": [{"type": "force", "at": "b@1", "value": [0, 3], "amplitude": told(f"1 if t > {BREAK} else 0")}]}
    _, states = moved(scene, 0.4, {"every": 4}, method="generalized_alpha", dt=2e-3)
    assert 1e-7 < states[-1].report["accuracy"]["estimate"] < 1e-3


def test_the_log_of_steps_is_not_copied_at_every_break(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between stored states the log grows by doubling, so n breaks do not cost n^2."""
    logs, rooms, collect = [], {}, stepping.Stepper._collect

    def collected(self, *given):
        collect(self, *given)
        logs.append(self.pending)
        room = self.pending if self.pending.base is None else self.pending.base
        rooms[id(room)] = room

    monkeypatch.setattr(stepping.Stepper, "_collect", collected)
    zigzag = {"type": "table", "t": [k * 1e-3 for k in range(101)], "value": [(-1.0) ** k for k in range(101)]}
    load = {"type": "force", "at": "a@1", "value": [0, 1], "amplitude": zigzag}
    _, states = moved({**FREE, "loads": [load]}, 0.1, {"interval": 0.1}, dt=1e-3, method="radau5", estimate=False)
    assert len(logs) >= 100
    assert len(rooms) <= 2 + np.log2(len(logs))
    np.testing.assert_allclose(states[-1].blocks["t"], np.linspace(1e-3, 0.1, 100), rtol=1e-12)
