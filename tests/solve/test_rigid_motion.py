"""Rigid bodies, springs, dampers and follower loads in motion, compared with closed forms and small ODE systems."""

from __future__ import annotations

import helpers
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ancf2d.model.rotation import Rotation
from ancf2d.solvers.energy import Energies

MASS, INERTIA, LENGTH = 1.3, 0.2, 1.2
GRAVITY = [{"type": "gravity", "value": [0, -9.81]}]


def rigid(geometry, mass=MASS, inertia=INERTIA):
    return {"geometry": geometry, "element": {"type": "rigid", "mass": mass, "inertia": inertia}}


def move(bodies, t_end, method="radau5", dt=None, output=None, **scene):
    """Return the solution with states every twentieth of its time."""
    solver = {"type": "dynamic", "t_end": t_end, "dt": dt or t_end / 200, "method": method}
    return helpers.solved(bodies, solver, output=output or {"interval": t_end / 20}, **scene)


def positions(sol, at):
    """Return times (n,) and positions (n, 2) of BODY@S."""
    columns, e0 = sol.point(at).position(), sol.model.e0
    d = np.array([s.d[:sol.model.n_q] for s in sol.states])
    return np.array([s.t for s in sol.states]), np.stack([(e0 + d)[:, c] @ w for c, w in columns], axis=1)


def angles(sol, at):
    """Return the rotations (n,) of BODY@S, through full turns."""
    rotation, out = Rotation(sol.point(at)), [0.0]
    for state in sol.states:
        d = state.d[:sol.model.n_q]
        out.append(rotation.value(sol.model.e0 + d, d, out[-1]))
    return np.array(out[1:])


def violation(sol):
    """Return the largest |g| of all states."""
    model = sol.model
    return max(abs(g) for s in sol.states for g, _, _ in model.interactions.gradients(s.d, s.t))


ERRORS = [("radau5", 2e-7), ("generalized_alpha", 3e-3), ("energy_momentum", 3e-3)]


@pytest.mark.parametrize(("method", "error"), ERRORS)
def test_a_compound_pendulum_swings_by_its_equation(method, error):
    sol = move({"b": rigid(helpers.line(LENGTH))}, 2.0, method, bc=[{"type": "pin", "at": "b@0.2"}], loads=GRAVITY)
    t, r = positions(sol, "b@1")
    arm = 0.3 * LENGTH
    exact = solve_ivp(lambda _, y: [y[1], -MASS * 9.81 * arm * np.cos(y[0]) / (INERTIA + MASS * arm**2)], (0, 2),
                      [0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12).y[0]
    tip = [0.2 * LENGTH, 0.0] + 0.8 * LENGTH * np.stack([np.cos(exact), np.sin(exact)], axis=1)
    np.testing.assert_allclose(r, tip, atol=error)
    assert np.ptp(exact) > 2.5
    assert violation(sol) < 1e-12


def test_two_rigid_pendulums_swing_by_lagranges_equations():
    bodies = {"a": rigid(helpers.line(1.0)), "b": rigid(helpers.line(0.8, 0.5, (1.0, 0.0)), 0.7, 0.05)}
    sol = move(bodies, 1.5, bc=[{"type": "pin", "at": "a@0"}], joints=[{"type": "pin", "between": ["a@1", "b@0"]}],
               loads=GRAVITY)

    def rates(_, y):
        p, q, pd, qd = y
        M = np.array([[INERTIA + MASS / 4 + 0.7, 0.7 * 0.4 * np.cos(p - q)],
                      [0.7 * 0.4 * np.cos(p - q), 0.05 + 0.7 * 0.16]])
        s = 0.7 * 0.4 * np.sin(p - q)
        f = [-s * qd**2 - 9.81 * (MASS * 0.5 + 0.7) * np.cos(p), s * pd**2 - 9.81 * 0.7 * 0.4 * np.cos(q)]
        return [pd, qd, *np.linalg.solve(M, f)]

    t, r = positions(sol, "b@1")
    p, q, *_ = solve_ivp(rates, (0, 1.5), [0.0, 0.5, 0.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-12).y
    exact = np.stack([np.cos(p) + 0.8 * np.cos(q), np.sin(p) + 0.8 * np.sin(q)], axis=1)
    np.testing.assert_allclose(r, exact, atol=1e-6)
    assert violation(sol) < 1e-12


@pytest.mark.parametrize("method", ["radau5", "energy_momentum"])
def test_a_torsion_spring_with_a_damper_unwinds_through_full_turns(method):
    k, c, omega = 2.0, 0.1, 30.0
    sol = move({"b": rigid(helpers.line(LENGTH))}, 2.0, method, bc=[{"type": "pin", "at": "b@0.5"}], dt=0.002,
               springs=[{"type": "rotational", "between": [[0, 0], "b@1"], "stiffness": k, "damping": c}],
               initial={"rotation_rate": {"omega": omega, "about": [LENGTH / 2, 0]}})
    t, _ = positions(sol, "b@1")
    decay = 0.5 * c / INERTIA
    w = np.sqrt(k / INERTIA - decay**2)
    exact = omega / w * np.exp(-decay * t) * np.sin(w * t)
    found = angles(sol, "b@1")
    assert exact.max() > 2 * np.pi
    np.testing.assert_allclose(found, exact, atol=1e-4 if method == "radau5" else 0.05)
    lost = sol.state.history["dissipated"]
    rate = omega * np.exp(-decay * 2.0) * (np.cos(2 * w) - decay / w * np.sin(2 * w))
    assert lost == pytest.approx(0.5 * INERTIA * (omega**2 - rate**2) - 0.5 * k * exact[-1] ** 2, rel=2e-3)


@pytest.mark.parametrize(("rate", "rel"), [(0.1, 1e-3), (1.0, 0.02), (10.0, 0.5)])
def test_unresolved_dashpots_dissipate_little_more_than_the_energy(rate, rel):
    """v = v_0 exp(-c t/m): m v_0^2/2 is lost in total, for any step length relative to m/c."""
    dt, v0 = 0.1, 2.0
    c = rate * MASS / dt
    sol = move({"b": rigid(helpers.line(LENGTH))}, 40 * dt / min(rate, 1.0), "generalized_alpha", dt=dt,
               springs=[{"type": "translational", "between": [[-1, 0], "b@0"], "damping": c, "stiffness": 0.0}],
               initial={"velocity": [v0, 0.0]})
    assert sol.state.history["dissipated"] == pytest.approx(0.5 * MASS * v0**2, rel=rel)


def test_two_bodies_on_a_spring_and_damper_swing_about_their_centre():
    """m_1 m_2/(m_1 + m_2) L'' + c L' + k (L - L_0) = 0; the common centre moves uniformly."""
    bodies = {"a": rigid(helpers.line(1.0), 1.0), "b": rigid(helpers.line(1.0, 0.0, (3.0, 0.0)), 2.0)}
    k, c = 40.0, 1.5
    sol = move(bodies, 2.0, springs=[{"type": "translational", "between": ["a@1", "b@0"], "stiffness": k, "damping": c,
                                      "length": 1.5}], initial={"velocity": [0.3, 0.0]})
    t, a = positions(sol, "a@1")
    _, b = positions(sol, "b@0")
    reduced = 2.0 / 3.0
    decay = 0.5 * c / reduced
    w = np.sqrt(k / reduced - decay**2)
    exact = 1.5 + 0.5 * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    np.testing.assert_allclose(b[:, 0] - a[:, 0], exact, atol=1e-6)
    centre = (a[:, 0] + 2 * b[:, 0]) / 3
    np.testing.assert_allclose(centre - centre[0], 0.3 * (t - t[0]), atol=1e-9)


@pytest.mark.parametrize("method", ["radau5", "energy_momentum"])
def test_a_moment_spins_a_free_body_up_and_a_follower_force_turns_with_it(method):
    """theta = M t^2/(2 J); the force along the body accelerates the centre in its direction."""
    sol = move({"b": rigid(helpers.line(LENGTH))}, 2.0, method, dt=0.002,
               loads=[{"type": "moment", "at": "b@1", "value": 0.8},
                      {"type": "follower_force", "at": "b@0.5", "value": [2.0, 0.5]}])
    t, r = positions(sol, "b@0.5")
    theta = 0.5 * 0.8 / INERTIA * t**2
    np.testing.assert_allclose(angles(sol, "b@1"), theta, atol=1e-5 if method == "radau5" else 1e-4)

    def rates(s, y):
        angle = 0.4 / INERTIA * s**2
        c, n = np.cos(angle), np.sin(angle)
        return [y[2], y[3], (2.0 * c - 0.5 * n) / MASS, (2.0 * n + 0.5 * c) / MASS]

    exact = solve_ivp(rates, (0, 2), [LENGTH / 2, 0, 0, 0], t_eval=t, rtol=1e-11, atol=1e-12).y[:2].T
    np.testing.assert_allclose(r, exact, atol=1e-5 if method == "radau5" else 1e-3)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "energy_momentum"])
def test_a_crank_turned_by_a_signal_drives_a_slider_on_its_line(method):
    """The slider follows the kinematics, whatever the masses: all constraints are met at every state."""
    knee = (0.3, 0.0)
    bodies = {"crank": rigid(helpers.line(0.3)), "rod": rigid({"type": "line", "start": list(knee), "end": [0.8, 0.0]})}
    turn = {"type": "expression", "value": "4*t^2"}
    sol = move(bodies, 1.5, method, dt=0.003,
               bc=[{"type": "pin", "at": "crank@0"}, {"type": "prescribed", "at": "crank@0", "angle": turn}],
               joints=[{"type": "pin", "between": ["crank@1", "rod@0"]},
                       {"type": "slider", "at": "rod@1", "through": [0, 0], "along": [1, 0]}])
    t, r = positions(sol, "rod@1")
    a = 4 * t**2
    exact = 0.3 * np.cos(a) + np.sqrt(0.25 - 0.09 * np.sin(a) ** 2)
    np.testing.assert_allclose(r, np.stack([exact, 0 * t], axis=1), atol=1e-11)
    assert violation(sol) < 1e-12
    np.testing.assert_allclose(angles(sol, "crank@1"), a, atol=1e-11)
    # energy: the work that turned the crank is all that there is
    state = sol.state
    assert state.history["kinetic"] == pytest.approx(state.history["work"], rel=5e-2 if "radau" not in method else 1e-3)


def test_discrete_gradients_conserve_energy_and_angular_momentum_of_a_free_chain():
    """Two rigid bars and a beam, welded and on a torsion spring, in free flight."""
    end = 1.0 + 0.8 * np.cos(0.4), 0.8 * np.sin(0.4)
    beam = helpers.body(helpers.line(1.0, -0.3, end), helpers.element("cable", 3),
                        {"height": 0.05, "width": 0.05}, {"E": 1e7, "nu": 0.3, "rho": 200.0})
    bodies = {"a": rigid(helpers.line(1.0)), "b": rigid(helpers.line(0.8, 0.4, (1.0, 0.0))), "beam": beam}
    # states of the steps themselves: between them the motion is interpolated
    sol = move(bodies, 1.0, "energy_momentum", dt=0.005, output={"every": 10},
               joints=[{"type": "pin", "between": ["a@1", "b@0"]}, {"type": "weld", "between": ["b@1", "beam@0"]}],
               springs=[{"type": "rotational", "between": ["a@0.5", "b@0.5"], "stiffness": 5.0, "angle": 0.8},
                        {"type": "translational", "between": ["a@0", "beam@1"], "stiffness": 20.0, "length": 1.0}],
               initial={"rotation_rate": {"omega": 3.0, "about": [0.3, 0.4]}, "velocity": [0.5, -0.2]})
    energies = Energies(sol.model)
    total = [s.history["kinetic"] + s.history["strain"] for s in sol.states]
    momenta = [energies.momentum(s.d, s.v) for s in sol.states]
    assert np.ptp(total) < 1e-12 * max(total)
    assert np.ptp([s.history["strain"] for s in sol.states]) > 0.1
    assert np.ptp(momenta, axis=0).max() < 1e-12 * np.abs(momenta).max()
    assert violation(sol) < 1e-12


def test_fixed_bars_do_not_move_and_balance_their_load():
    """Two bars between two pins and their joint, and a clamped one: round-off is neither motion nor lost energy."""
    top, foot = np.array([1.1, 0.7]), np.array([2.0, 0.1])
    bodies = {"a": rigid({"type": "line", "start": [0.0, 0.0], "end": top}),
              "b": rigid({"type": "line", "start": foot, "end": top}), "c": rigid(helpers.line(1.0, 0.3))}
    loads = [{"type": "force", "at": at, "value": [3.0, 4.0], "amplitude": {"type": "sine", "frequency": 3.0}}
             for at in ("a@1", "c@1")]
    sol = move(bodies, 0.1, dt=0.01, loads=loads, joints=[{"type": "pin", "between": ["a@1", "b@1"]}],
               bc=[{"name": k, "type": "pin", "at": f"{k}@0"} for k in "ab"] + [{"type": "clamp", "at": "c@0"}])
    assert sol.state.report["energy_drift"] < 1e-3
    assert sol.state.report["accuracy"]["estimate"] == 0.0
    assert not any(s.warnings for s in sol.states)
    np.testing.assert_allclose(sol.u("a@1"), 0.0, atol=1e-14)
    force = np.linalg.solve(np.array([top, top - foot]).T, [-3.0, -4.0])[0] * top * np.sin(0.6 * np.pi)
    np.testing.assert_allclose([sol.reactions()["a"][k] for k in ("fx", "fy")], force, rtol=1e-9)
