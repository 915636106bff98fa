"""Loads that depend on the motion: controllers and formulas, compared with closed forms and SciPy."""

from __future__ import annotations

import math
from typing import Any

import helpers as h
import numpy as np
import pytest
from motions import GRAVITY, Ride, ride, rigid, rod
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import ancf2d
from ancf2d.errors import CaseError, ComputationError
from ancf2d.interactions import body_loads
from ancf2d.kernels.motion.feedback import tail_size
from ancf2d.kernels.motion.ode import tangents
from ancf2d.solvers.motion.dense import dense
from ancf2d.solvers.motion.problem import make_problem

J, KP, KD, KI, LIMIT, FILTER = 0.2 + 1.5 / 4, 20.0, 1.0, 30.0, 8.0, 0.01
PID = {"type": "pid", "input": "1 - hub.theta", "kp": KP, "kd": KD, "ki": KI, "filter": FILTER,
       "limit": [-LIMIT, LIMIT]}


def arm(torque: str, **more) -> dict:
    """A rigid arm on a pin, driven by a motor."""
    amplitude = {"type": "expression", "value": torque}
    return {"bodies": {"arm": rigid([0, 0], [1, 0], 1.5, 0.2)}, "bc": [{"type": "pin", "at": "arm@0"}],
            "loads": [{"type": "moment", "at": "arm@0", "value": 1, "amplitude": amplitude}],
            "output": {"probes": {"hub": "arm@0", "tip": "arm@1"}}, **more}


def told(motion: Ride) -> dict[str, float]:
    """Return the quantities on which the motion depends, at its end, by name."""
    found = motion.stepper.feedback
    return dict(zip(found.of_model.names, found.values_at(motion.rows[-1]), strict=True))


@pytest.mark.parametrize(("method", "error"), [("radau5", 1e-10), ("radau9", 1e-10), ("DOP853", 1e-10),
                                               ("generalized_alpha", 1e-5)])
def test_a_pd_motor_is_a_damped_oscillator(method, error):
    """J theta'' = -kp (theta - 1) - kd theta', which has a closed form."""
    motion = ride(arm("-kp*(hub.theta - 1) - kd*hub.omega", parameters={"kp": KP, "kd": KD}), 1.0, tolerance=1e-9,
                  method=method, estimate=False)
    decay, omega = 0.5 * KD / J, math.sqrt(KP / J - (0.5 * KD / J)**2)
    wanted = 1 - math.exp(-decay) * (math.cos(omega) + decay / omega * math.sin(omega))
    assert told(motion)["hub.theta"] == pytest.approx(wanted, abs=error)


def test_a_pd_motor_on_a_flexible_arm_is_a_spring_with_a_damper():
    scene = arm("0", initial={"rotation_rate": {"omega": 3}})
    scene["bodies"] = {"arm": h.body(h.line(1.0), h.element("reissner3", 2), {"height": 0.008, "width": 0.02},
                                     {"E": 7e10, "nu": 0.33, "rho": 2700, "damping": {"kelvin_voigt": 1e-4}})}
    spring = {"type": "rotational", "between": [[0, 0], "arm@0"], "stiffness": 4, "damping": 0.8}
    motor = arm("-4*hub.theta - 0.8*hub.omega")["loads"]
    motions = [ride({**scene, **more}, 0.2, dt=1e-3, method="radau5", estimate=False)
               for more in ({"springs": [spring]}, {"loads": motor})]
    given, found = (m.full()[:2] for m in motions)
    assert np.abs(given[0]).max() > 0.1
    assert found == pytest.approx(np.array(given), abs=1e-8)


def limited(t: float, y: np.ndarray) -> list[float]:
    """The same arm with a PID controller whose integration stops at its limits."""
    theta, omega, integral, filtered = y
    e = 1 - theta
    rate = (e - filtered) / FILTER
    u = KP * e + integral + KD * rate
    gain = 0.0 if (u >= LIMIT and e > 0) or (u <= -LIMIT and e < 0) else KI * e
    return [omega, min(max(u, -LIMIT), LIMIT) / J, gain, rate]


@pytest.mark.slow_rows("DOP853")
@pytest.mark.parametrize("method", ["radau5", "DOP853"])
def test_a_pid_controller_with_limits_agrees_with_scipy(method):
    motion = ride(arm("motor", controllers={"motor": PID}), 1.0, tolerance=1e-10, method=method, estimate=False)
    wanted = solve_ivp(limited, (0, 1), [0, 0, 0, 1], method="DOP853", rtol=1e-11, atol=1e-12, max_step=2e-3).y[:, -1]
    found = told(motion)
    names = ("hub.theta", "motor:integral", "motor:filtered")
    assert [found[n] for n in names] == pytest.approx(wanted[[0, 2, 3]], abs=1e-8)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_an_output_that_its_integral_alone_would_raise_stays_at_its_limit(method):
    """It falls to its limit, is kept there by the necessary integration, and leaves it in a linear motion."""
    kp, ki, kd, limit, end = 2.0, 5.0, 1.0, 0.5, 1.4
    a = limit / J
    # kp (1 - a t^2/2) - kd a t = limit; what the integral has to make up for, kp omega + kd a, exceeds ki e later
    falls = (-kd * a + math.sqrt((kd * a)**2 + 2 * kp * a * (kp - limit))) / (kp * a)
    leaves = (-kp * a + math.sqrt((kp * a)**2 + 2 * ki * a * (ki - kd * a))) / (ki * a)
    assert falls < leaves < end
    theta, omega = a * leaves**2 / 2, a * leaves
    start = [theta, omega, limit - kp * (1 - theta) + kd * omega, 1.0]
    rates = [[0, 1, 0, 0], [-kp / J, -kd / J, 1 / J, kp / J], [-ki, 0, 0, ki], [0, 0, 0, 0]]
    wanted = expm(np.array(rates) * (end - leaves)) @ start
    pid = {"type": "pid", "input": "1 - hub.theta", "kp": kp, "ki": ki, "kd": kd, "limit": [-limit, limit]}
    motion = ride(arm("motor", controllers={"motor": pid}), end, tolerance=1e-8, method=method, estimate=False)
    # where the integral stops is solved for exactly; a rate that only fades out in a band takes 2600 and 59 000 steps
    assert len(motion.log) < 2000
    found = told(motion)
    near = 1e-7 if method == "radau5" else 1e-4
    assert [found[n] for n in ("hub.theta", "motor:integral")] == pytest.approx(wanted[[0, 2]], abs=near)


@pytest.mark.parametrize(("kp", "ki", "stiffness"), [(1.0, 5.0, 50.0), (5.0, 30.0, 50.0)])
@pytest.mark.parametrize("method", ["radau5", "radau9", "generalized_alpha"])
def test_a_limited_controller_drives_an_arm_against_a_stop(method, kp, ki, stiffness):
    """Rates of the integral jump where the stop engages while the output is at its limit; compared with SciPy.

    Errors of the integral that fall like the step, not its square, ended such motions in ever shorter steps.
    """
    pid = {"type": "pid", "input": "0.5 - hub.theta", "kp": kp, "ki": ki, "kd": 0.1, "filter": FILTER,
           "limit": [-1.0, 1.0]}
    stop = {"type": "translational", "between": [[1, 1], "arm@1"], "stiffness": stiffness, "only": "compression",
            "length": 0.9}

    def rates(t: float, y: np.ndarray) -> list[float]:
        theta, omega, integral, filtered = y
        e, x, up = 0.5 - theta, 1 - math.cos(theta), 1 - math.sin(theta)
        u = kp * e + integral + 0.1 * (e - filtered) / FILTER
        stops = (u >= 1.0 and e > 0) or (u <= -1.0 and e < 0)
        gap = math.hypot(x, up)
        push = stiffness * min(gap - 0.9, 0.0) / gap
        turn = push * (up * math.cos(theta) - x * math.sin(theta))
        return [omega, (min(max(u, -1.0), 1.0) + turn) / J, 0.0 if stops else ki * e, (e - filtered) / FILTER]

    motion = ride(arm("motor", controllers={"motor": pid}, springs=[stop]), 1.0, tolerance=1e-6, method=method,
                  estimate=False)
    wanted = solve_ivp(rates, (0, 1), [0, 0, 0, 0.5], method="RK23", rtol=1e-4, atol=1e-6, max_step=1e-3).y[:, -1]
    found = told(motion)
    assert [found["hub.theta"], found["motor:integral"]] == pytest.approx(wanted[[0, 2]], abs=2e-3)


def test_a_sampled_controller_is_its_recurrence():
    """Between samples the torque is constant, so the arm moves along parabolas."""
    step, theta, omega, integral, filtered = 0.01, 0.0, 0.0, 0.0, 1.0
    for _ in range(100):
        e = 1 - theta
        rate = (e - filtered) / (FILTER + step)
        u = KP * e + integral + KI * step * e + KD * rate
        if not ((u >= LIMIT and e > 0) or (u <= -LIMIT and e < 0)):
            integral += KI * step * e
        torque = min(max(KP * e + integral + KD * rate, -LIMIT), LIMIT)
        filtered += step * rate
        theta, omega = theta + step * omega + 0.5 * step**2 * torque / J, omega + step * torque / J
    motion = ride(arm("motor", controllers={"motor": {**PID, "sample": step}}), 1.0, tolerance=1e-10, estimate=False)
    found = told(motion)
    assert [found["hub.theta"], found["motor:integral"]] == pytest.approx([theta, integral], abs=1e-8)


def test_states_of_a_controller_obey_their_equations():
    """z' = -z + w, w' = -z from (1, 0), beside an arm that does not depend on them."""
    watch = {"type": "state", "rate": {"z": "w - z", "w": "-z"}, "initial": {"z": 1}, "output": "2*z"}
    motion = ride(arm("0*watch", controllers={"watch": watch}), 1.0, tolerance=1e-9, estimate=False)
    omega = math.sqrt(0.75)
    z = math.exp(-0.5) * (math.cos(omega) - 0.5 / omega * math.sin(omega))
    assert told(motion)["watch:z"] == pytest.approx(z, abs=1e-7)


@pytest.mark.parametrize("method", ["radau5", pytest.param("generalized_alpha", marks=pytest.mark.slow)])
def test_a_state_that_starts_as_the_smallest_number_is_weighed_by_what_it_becomes(method):
    """The inverse of its size would be infinite; so start inputs such as sin(t) minus an angle at rest."""
    watch = {"type": "state", "rate": {"z": "sin(3*t)"}, "initial": {"z": 1e-320}, "output": "2*z"}
    motion = ride(arm("0*watch", controllers={"watch": watch}), 1.0, dt=1e-3, method=method, estimate=False)
    assert told(motion)["watch:z"] == pytest.approx((1 - math.cos(3)) / 3, abs=1e-5)


def test_an_unused_controller_follows_the_motion():
    """It counts whole turns of a spinning arm, as it would if a load followed it."""
    watch = {"type": "pid", "input": "hub.theta", "kp": 1}
    scene = arm("0", controllers={"watch": watch}, initial={"rotation_rate": {"omega": 10}})
    motion = ride(scene, 1.0, tolerance=1e-9, estimate=False)
    found = motion.stepper.feedback.update_model(motion.rows[-1])
    assert found["watch"]["output"] == pytest.approx(10.0, abs=1e-8)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "DOP853"])
def test_controllers_of_a_model_without_unknowns_continue(method: str) -> None:
    """A fixed body, as in trials of accuracy control: the only unknowns are the controller's, the integral of 1, and 1.

    The first assertion keeps a matrix without room for what controllers add from being written to.
    """
    scene = arm("ctl", controllers={"ctl": {**PID, "limit": [-100, 100]}})
    scene["bc"] = [{"type": "clamp", "at": "arm@0"}]
    p, _ = make_problem(h.build(solver={"type": "dynamic", "t_end": 0.3, "method": method}, **scene))
    assert p.inner == 0
    assert len(p.mass) == tail_size(len(p.coordinate), p.rank, p.feedback.states)
    steps = {"tolerance": 1e-9} if method == "DOP853" else {"dt": 0.01}
    motion = ride(scene, 0.3, method=method, estimate=False, **steps)
    assert told(motion)["hub.theta"] == 0.0
    assert sum(motion.rows[-1].z) == pytest.approx(KI * 0.3 + 1.0, rel=1e-9)


def test_tangents_are_derivatives():
    """Of signals, states and formulas together, by coordinates and rates, on a flexible arm."""
    lead = {"type": "state", "rate": {"z": "tip.x*sin(tip.theta) - z*z"}, "initial": {"z": 0.3}, "output": "3*z"}
    scene = arm("motor - 0.3*hub.omega*tip.vy + lead", controllers={"motor": {**PID, "limit": [-50, 50]}, "lead": lead})
    scene["bodies"] = {"arm": h.body(h.line(1.0), h.element("vallejo", 1), {"height": 0.05, "width": 0.02},
                                     {"E": 1e5, "nu": 0.3, "rho": 1000})}
    scene["loads"].append({"type": "force", "at": "arm@1", "value": [1, 2],
                           "amplitude": {"type": "expression", "value": "tip.theta^2*hub.omega"}})
    motion = Ride(scene, 0.01, tolerance=1e-3, estimate=False, method="DOP853").start()
    stepper, rng = motion.stepper, np.random.default_rng(3)
    p, w, n = stepper.p, stepper.w, len(stepper.s.z)
    z, v = stepper.s.z + 1e-3 * rng.standard_normal(n), rng.standard_normal(n)
    matrices = [np.empty_like(w.A) for _ in range(3)]

    def residual(z: np.ndarray, v: np.ndarray) -> np.ndarray:
        stepper.s.z[:], stepper.s.v[:] = z, v
        tangents(p, w, stepper.s, 0.005, *matrices)
        return w.Q[p.full].copy()

    residual(z, v)
    K, C = (dense(A, p) for A in matrices[:2])
    for found, by in ((K, 0), (C - K, 1)):
        for k in range(n):
            change = 1e-6 * np.eye(n)[k]
            plus, minus = ((residual(z + s * change, v) if by == 0 else residual(z, v + s * change)) for s in (1, -1))
            wanted = (plus - minus) / 2e-6
            # the tangent of the moment itself is symmetric in its directions
            assert found[:, k] == pytest.approx(wanted, abs=1e-5 * max(1.0, np.abs(wanted).max()))


def test_a_falling_rod_reaches_its_terminal_velocity():
    """rho A v' = -rho A g + k v^2: v = -V tanh(g t/V), V^2 = rho A g/k."""
    scene = {"bodies": {"rod": h.body(h.line(1.0), h.element("reissner3", 2), {"height": 0.05, "width": 0.02},
                                      {"E": 1e7, "nu": 0.3, "rho": 1000})},
             "loads": [{"type": "gravity", "value": [0, -9.81]},
                       {"type": "distributed", "on": "rod",
                        "value": ["-k*vx*sqrt(vx^2 + vy^2)", "-k*vy*sqrt(vx^2 + vy^2)"]}],
             "parameters": {"k": 0.5}, "output": {"probes": {"mid": "rod@0.5"}}}
    motion = ride(scene, 2.0, tolerance=1e-9, estimate=False)
    V = math.sqrt(9.81 / 0.5)
    y = -V**2 / 9.81 * math.log(math.cosh(9.81 * 2.0 / V))
    assert motion.place("rod@0.5") == pytest.approx([0.5, y], abs=1e-9)


def test_a_pendulum_in_air():
    """A rigid rod: J w' = -m g L/2 cos theta - k L^4/4 w |w|, the moment of the drag along it."""
    scene = arm("0", parameters={"k": 0.8})
    scene["loads"] += [{"type": "gravity", "value": [0, -9.81]},
                       {"type": "distributed", "on": "arm", "value": ["-k*vx*sqrt(vx^2 + vy^2)",
                                                                      "-k*vy*sqrt(vx^2 + vy^2)"]}]
    motion = ride(scene, 1.0, tolerance=1e-9, estimate=False)
    wanted = solve_ivp(lambda t, y: [y[1], (-1.5 * 9.81 / 2 * math.cos(y[0]) - 0.2 * y[1] * abs(y[1])) / J], (0, 1),
                       [0, 0], method="DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
    assert motion.place("arm@1") == pytest.approx([math.cos(wanted), math.sin(wanted)], abs=1e-9)


def test_a_spring_by_formula_equals_the_spring_that_it_describes():
    """Linear formulas, with a gap, on one side; a nonlinear one by its energy."""
    def end(spring: dict, **more) -> np.ndarray:
        scene = {**arm("0"), "springs": [{"between": ["arm@1", [1, 2]], "type": "translational", **spring}],
                 "initial": {"rotation_rate": {"omega": 2}}, **more}
        return ride(scene, 0.5, tolerance=1e-10, estimate=False).place("arm@1")

    for more in ({}, {"gap": 0.1}, {"only": "compression"}):
        given = end({"stiffness": 20, "damping": 0.5, **more})
        assert end({"force": "20*u + 0.5*v", **more}) == pytest.approx(given, abs=1e-8)
    scene = {**arm("0"), "initial": {"rotation_rate": {"omega": 2}},
             "springs": [{"type": "rotational", "between": [[0, 0], "arm@0"], "force": "20*u + 30*u^3"}]}
    motion = ride(scene, 0.4, states=4, tolerance=1e-9, estimate=False)
    total, _ = motion.totals()
    assert total == pytest.approx(0.5 * J * 4, rel=1e-8)


@pytest.mark.parametrize("kind", ["cable", "reissner3"])
def test_drag_needs_no_more_gauss_points(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five more points along each element change the motion of a pendulum in air by far less than the mesh does."""
    scene = {"bodies": {"rod": rod(kind, 2)}, "bc": [{"type": "pin", "at": "rod@0"}], "loads": [
        *GRAVITY, {"type": "distributed", "on": "rod", "value": ["-2*vx*sqrt(vx^2+vy^2)", "-2*vy*sqrt(vx^2+vy^2)"]}]}
    found = []
    for more in (body_loads.OF_FORMULA, body_loads.OF_FORMULA + 5):
        monkeypatch.setattr(body_loads, "OF_FORMULA", more)
        found.append(Ride(scene, 0.5, tolerance=1e-9, method="radau9").start().on().stepper.s.z.copy())
    assert 0.0 < np.abs(found[1] - found[0]).max() < 1e-7


@pytest.mark.parametrize(("more", "what", "name", "bound"), [
    ({}, "expression '1 [+] sqrt", "hub.theta", 0.1),
    ({"springs": [{"type": "rotational", "between": [[0, 0], "arm@0"], "force": "sqrt(0.1 - u)"}]},
     "formula 'sqrt", "u", 0.1),
    ({"loads": [{"type": "distributed", "on": "arm", "value": [0, "10*sqrt(0.1 - vy)"]}]}, "formula '10", "vy", 0.1),
    ({"solver": {"until": "1 + sqrt(0.1 - hub.theta) > 2"}}, "condition '1 [+] sqrt", "hub.theta", 0.1),
    # what follows from it has none, either: another controller, and a condition on that
    ({"solver": {"until": "second > 2"}, "controllers": {
        "second": {"type": "state", "rate": {"z": "-z"}, "output": "z + first"},
        "first": {"type": "pid", "input": "sqrt(0.1 - hub.theta)", "kp": 1}}},
     "expression 'sqrt.*' in controllers.first.input", "hub.theta", 0.1)])
def test_an_expression_without_a_value_is_reported(more: dict, what: str, name: str, bound: float) -> None:
    """sqrt(0.1 - x) has none beyond 0.1, in any place; the message has the value of x."""
    scene = {**arm("1 + sqrt(0.1 - hub.theta)" if not more else "1"), "initial": {"rotation_rate": {"omega": 0.05}},
             **more}
    until = scene.pop("solver", {})
    with pytest.raises(ComputationError, match=f"{what}.* has no value") as caught:
        ride(scene, 3.0, tolerance=1e-7, estimate=False, **until)
    assert caught.value.failure.at[name] == pytest.approx(bound, abs=2e-2)


@pytest.mark.parametrize(("changes", "words"), [
    ({"solver": {"type": "dynamic", "t_end": 1, "method": "energy_momentum"}}, "energy_momentum uses mean loads"),
    ({"solver": {"type": "static"}}, "no motion on which a load could depend")])
def test_solvers_without_feedback_refuse_it(changes, words):
    scene = arm("hub.theta")
    with pytest.raises(CaseError, match=words):
        h.build(scene.pop("bodies"), changes["solver"], **scene)


@pytest.mark.parametrize("element", ["reissner3", "cable"])
def test_section_forces_include_line_loads_by_formula(element: str) -> None:
    """A load of 100 N/m as a formula and as a number: the same at a node, nearly between nodes."""
    def solve(value: list[Any]) -> Any:
        body = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                "section": {"height": 0.05, "width": 0.05}, "material": {"E": 1e9, "nu": 0.3, "rho": 1000},
                "element": {"type": element, "count": 4}}
        return ancf2d.solve({
            "bodies": {"b": body}, "boundary_conditions": [{"type": "clamp", "at": "b@0"}],
            "loads": [{"type": "distributed", "on": "b", "value": value}], "solver": {"type": "static"},
            "output": {"probes": {"node": "b@0.5", "inside": "b@0.6"}, "fields": ["N", "Q", "M"]}}, states=False).probes

    plain, formula = solve([0, -100]), solve(["0*vx", "-100 + 0*vx"])
    for q in ("N", "Q", "M"):
        assert formula["node"][q] == pytest.approx(plain["node"][q], rel=1e-7)
    # without it 40 N instead of 37.5 N on average over the element
    assert formula["inside"]["Q"] == pytest.approx(plain["inside"]["Q"], abs=2.5)
    assert formula["inside"]["M"] == pytest.approx(plain["inside"]["M"], rel=5e-3)


@pytest.mark.slow
def test_a_flexible_arm_under_pid_is_that_of_its_equations() -> None:
    """M z'' + R(z, z') = u at the hub, with the controller's equations beside it, by SciPy's DOP853."""
    body = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
            "section": {"EA": 100, "kGA": 50, "EI": 2, "rhoA": 1, "rhoI": 0.05},
            "element": {"type": "reissner3", "count": 2}}
    kp, ki, kd, filtered, t_end = 6.0, 4.0, 1.5, 0.02, 0.3
    case = {"bodies": {"arm": body}, "boundary_conditions": [{"type": "pin", "at": "arm@0"}],
            "solver": {"type": "dynamic", "t_end": t_end, "tolerance": 1e-10, "estimate": False},
            "output": {"interval": 0.1, "probes": {"hub": "arm@0", "tip": "arm@1"}}}
    own = ancf2d.system(case)
    hub, n, M = own.names.index("theta of arm at S = 0"), own.n, own.mass.toarray()

    def rates(t: float, y: Any) -> Any:
        z, v, integral, f = y[:n], y[n:2 * n], y[-2], y[-1]
        e = 1.0 - z[hub]
        forces = -own.residual(z, v, t)
        forces[hub] += kp * e + integral + kd * (e - f) / filtered
        return np.concatenate([v, np.linalg.solve(M, forces), [ki * e, (e - f) / filtered]])

    start = np.zeros(2 * n + 2)
    start[-1] = 1.0
    exact = solve_ivp(rates, (0.0, t_end), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    motor = {"type": "pid", "input": "1 - hub.theta", "kp": kp, "ki": ki, "kd": kd, "filter": filtered}
    found = ancf2d.solve({**case, "controllers": {"motor": motor}, "loads": [
        {"type": "moment", "at": "arm@0", "value": 1, "amplitude": {"type": "expression", "value": "motor"}}]},
                         states=False)
    for name in ("hub", "tip"):
        told = own.probe(name, exact[:n], exact[n:2 * n], t_end)
        for quantity in ("x", "y", "theta", "vx", "vy", "omega"):
            assert found.probes[name][quantity] == pytest.approx(told[quantity], abs=1e-7)
    assert found.summary["controllers"]["motor"]["filtered"] == pytest.approx(exact[-1], abs=1e-7)
