"""SciPy's integrators on the equations of motion: convergence, constraints, derivatives, resumed runs, refusals."""

from __future__ import annotations

from functools import cache

import helpers as h
import numpy as np
import pytest

from ancf2d.errors import ComputationError
from ancf2d.kernels.motion.advance import CHECK
from ancf2d.solvers.motion.dynamic import Balance
from ancf2d.solvers.motion.initial import initial_motion
from ancf2d.solvers.motion.integrators import SCIPY_METHODS, method_problems
from ancf2d.solvers.motion.ode import OdeStepper
from ancf2d.solvers.motion.problem import make_problem
from ancf2d.solvers.motion.stepping import Stepper

SECTION, RUBBER = {"height": 0.1, "width": 0.05}, {"E": 2e7, "nu": 0.3, "rho": 2000}
GRAVITY = [{"type": "gravity", "value": [0, -9.81]}]
ONE_STEP = [name for name, scheme in SCIPY_METHODS.items() if scheme.one_step]
PENDULUM = {"bodies": {"a": h.body(h.line(1.0), h.element("reissner3", 2), SECTION, RUBBER)},
            "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}
# a driven arm, welded to one of another type: two multipliers, a spring with a damper, damping of the mass
ARM = {"bodies": {"a": h.body(h.line(1.0), h.element("vallejo", 2), SECTION, RUBBER),
                  "b": h.body(h.line(0.8, -1.5707963267948966, (1.0, 0.0)), h.element("reissner3", 1), SECTION,
                              RUBBER)},
       "bc": [{"type": "prescribed", "at": "a@0", "ux": 0.0, "uy": 0.0,
               "angle": {"type": "expression", "value": "0.5*(1-cos(5*t))"}}],
       "joints": [{"type": "weld", "between": ["a@1", "b@0"]}],
       "springs": [{"type": "translational", "between": ["b@1", [2, 0]], "stiffness": 500.0, "damping": 30.0,
                    "length": 1.0}], "damping": {"rayleigh": {"alpha": 3.0, "beta": 0.0}}, "loads": GRAVITY}


def stepper(scene, method, t_end=0.2, states=4, every=0, **solver):
    """Return the model of a scene and its stepper at the start."""
    model = h.build(scene["bodies"], {"type": "dynamic", "t_end": t_end, "method": method, **solver},
                    **{k: v for k, v in scene.items() if k != "bodies"})
    kind = OdeStepper if method in SCIPY_METHODS else Stepper
    wanted = np.linspace(0.0, t_end, states + 1)[1:]
    out = kind(model, *make_problem(model), model.case.solver, solver.get("dt", 0.0), wanted, every)
    out.start(*initial_motion(model))
    return model, out


def moved(scene, method, **how):
    """Return the model, its stepper at the end and the intermediate states."""
    model, out = stepper(scene, method, **how)
    rows = []
    while not out.done:
        rows += [row for row in out.run() if row.kind != CHECK]
    return model, out, rows


@cache
def reference(name):
    """Return the displacements at the end of a scene, by ancf2d's method of order 9."""
    model, own, rows = moved({"pendulum": PENDULUM, "arm": ARM}[name], "radau9", tolerance=1e-11)
    return own.full(rows[-1])[0][:model.n_q]


@pytest.mark.parametrize("method", h.chosen(SCIPY_METHODS, ["DOP853"]))
def test_the_error_follows_the_tolerance(method):
    errors = []
    for tolerance in (1e-4, 1e-8):
        model, own, rows = moved(PENDULUM, method, tolerance=tolerance)
        d = own.full(rows[-1])[0][:model.n_q]
        errors.append(np.max(np.abs(d - reference("pendulum")) * model.weights))
    assert errors[0] < 1e-2
    assert errors[1] < 1e-6
    assert errors[1] < 1e-2 * errors[0]


@pytest.mark.slow_rows("RK45", "Radau")
@pytest.mark.parametrize("method", ONE_STEP)
def test_multipliers_are_met_at_every_step(method):
    model, own, rows = moved(ARM, method, tolerance=1e-6)
    assert model.numbering.n_multipliers == 2
    log = np.concatenate([r.log for r in rows])
    assert log[:, 6].max() < 1e-13
    d, v, a = own.full(rows[-1])
    assert np.max(np.abs(d[:model.n_q] - reference("arm")) * model.weights) < 2e-5
    # the driven section turns as told, on all three levels
    theta, dofs = 0.5 * (1 - np.cos(1.0)), model.meshes["a"].dofs[0, 2:4]
    y = model.e0[dofs] + d[dofs]
    np.testing.assert_allclose(y / np.hypot(*y), [-np.sin(theta), np.cos(theta)], atol=1e-13)
    omega, alpha = 2.5 * np.sin(1.0), 12.5 * np.cos(1.0)
    cross = y[0] * v[dofs[1]] - y[1] * v[dofs[0]]
    assert cross / (y @ y) == pytest.approx(omega, rel=1e-11)
    turning = (y[0] * a[dofs[1]] - y[1] * a[dofs[0]] - 2 * omega * (y @ v[dofs])) / (y @ y)
    assert turning == pytest.approx(alpha, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["RK45", "Radau"])
def test_energy_gained_and_lost_is_the_work_of_drive_and_dampers(method):
    model, own, rows = moved(ARM, method, tolerance=1e-8)
    balance = Balance(model, own)
    for row in rows:
        balance.evaluate(row)
    assert rows[-1].lost > 1.0
    assert rows[-1].work > 1.0
    assert 0.0 < balance.drift < 1e-6


@pytest.mark.parametrize("scene", [
    pytest.param(PENDULUM, id="pendulum"),
    pytest.param({**ARM, "bc": [{"type": "pin", "at": "a@0"}], "joints": [{"type": "pin", "between": ["a@1", "b@0"]}]},
                 id="with springs and dampers", marks=pytest.mark.slow)])
def test_the_jacobian_is_the_derivative_of_the_rates(scene):
    model, own = stepper(scene, "Radau", tolerance=1e-6)
    d = h.random_state(model, 1e-3, 1)
    y = np.concatenate([d[own.p.full][own.free], h.random_state(model, 1e-2, 2)[own.p.full][own.free]])
    J = own.jacobian(0.05, y)
    for k in range(len(y)):
        step = np.zeros(len(y))
        step[k] = 1e-6 / np.tile(own.p.weights[own.free], 2)[k]
        column = (own.rates(0.05, y + step) - own.rates(0.05, y - step)) / (2 * step[k])
        np.testing.assert_allclose(J[:, k], column, atol=1e-6 * np.abs(column).max())


@pytest.mark.parametrize(("method", "scene", "at"), [
    ("RK45", PENDULUM, "a@1"), *(pytest.param(m, ARM, "b@1", marks=pytest.mark.slow) for m in ("RK45", "DOP853"))],
    ids=["pendulum", "RK45", "DOP853"])
def test_a_checkpoint_resumes_bit_for_bit(method, scene, at):
    """Steps of varying lengths, a break of the load in between, and with the arm a damper."""
    ramp = {"type": "force", "at": at, "value": [0, 40], "amplitude": {"type": "ramp", "t0": 0.03, "t1": 0.11}}
    scene = {**scene, "loads": [*GRAVITY, ramp]}
    _, _, whole = moved(scene, method, tolerance=1e-5, states=12)
    _, first = stepper(scene, method, tolerance=1e-5, states=12)
    rows = []
    while len(rows) < 5:
        rows += first.run()
    kept = {k: v.copy() for k, v in first.checkpoint().items()}
    _, second = stepper(scene, method, tolerance=1e-5, states=12)
    second.resume(kept)
    while not second.done:
        rows += second.run()
    rows = [r for r in rows if r.kind != CHECK]
    assert [r.t for r in rows] == [r.t for r in whole]
    for one, other in zip(rows, whole, strict=True):
        for part in ("z", "v", "a", "log"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
        assert (one.work, one.lost) == (other.work, other.lost)


def test_methods_with_inaccessible_state_have_no_checkpoint():
    assert stepper(PENDULUM, "Radau", tolerance=1e-4)[1].checkpoint() is None


@pytest.mark.slow_rows("BDF", "Radau")
@pytest.mark.parametrize("method", SCIPY_METHODS)
def test_dt_is_the_longest_step_and_errors_are_still_controlled(method):
    model, own, rows = moved(PENDULUM, method, dt=0.004)
    log = np.concatenate([r.log for r in rows])
    assert log[:, 2].max() <= 0.004 * (1 + 1e-12)
    assert log[:, 2].sum() == pytest.approx(0.2, rel=1e-12)
    d = own.full(rows[-1])[0][:model.n_q]
    assert np.max(np.abs(d - reference("pendulum")) * model.weights) < 1e-4


def test_a_state_is_stored_after_every_so_many_steps():
    _, _, rows = moved(PENDULUM, "RK45", tolerance=1e-4, every=5)
    numbers = [r.log[-1, 0] for r in rows]
    assert numbers == [5.0 * (k + 1) for k in range(len(rows))]
    assert all(r.t == r.log[-1, 1] for r in rows)


@pytest.mark.slow_rows("BDF", "LSODA")
@pytest.mark.parametrize("method", ["RK45", "BDF", "LSODA"])
def test_steps_end_where_a_load_breaks(method):
    load = {"type": "force", "at": "a@1", "value": [0, 40], "amplitude": {"type": "table", "t": [0, 0.07, 0.0700001, 1],
                                                                           "value": [0, 0, 1, 1]}}
    _, _, rows = moved({**PENDULUM, "loads": [load]}, method, tolerance=1e-6)
    ends = np.concatenate([r.log[:, 1] for r in rows])
    assert {0.07, 0.0700001} <= set(ends.tolist())
    # nothing moves before
    assert not rows[0].z.any()
    assert rows[-1].z.any()


def test_errors_of_steps_are_reported():
    _, _, rows = moved(PENDULUM, "RK45", tolerance=1e-5)
    errors = np.concatenate([r.log[:, 5] for r in rows])
    assert np.all(errors > 0.0)
    assert errors.max() < 1e-3
    _, _, tight = moved(PENDULUM, "DOP853", tolerance=1e-8)
    assert np.concatenate([r.log[:, 5] for r in tight]).max() < 1e-6


def test_rejected_steps_are_counted():
    kick = {"type": "force", "at": "a@1", "value": [0, 4000], "amplitude": {
        "type": "expression", "value": "exp(-((t-0.1)/0.002)^2)"}}
    _, _, rows = moved({**PENDULUM, "loads": [kick]}, "DOP853", tolerance=1e-6)
    assert np.concatenate([r.log[:, 4] for r in rows]).sum() >= 1


@pytest.mark.parametrize("method", ["BDF", "LSODA"])
def test_multistep_methods_refuse_multipliers_by_name(method):
    model, _ = stepper(ARM, "radau5", tolerance=1e-4)
    model = h.build(ARM["bodies"], {"type": "dynamic", "t_end": 1, "method": method, "tolerance": 1e-4},
                    **{k: v for k, v in ARM.items() if k != "bodies"})
    (problem,) = method_problems(model)
    assert problem.path == ("solver", "method")
    assert "cannot satisfy the constraints of a@0, joints.0" in problem.message
    assert "radau5" in problem.expected


@pytest.mark.parametrize("method", SCIPY_METHODS)
def test_methods_are_accepted_without_multipliers(method):
    model, _ = stepper(PENDULUM, method, tolerance=1e-4)
    assert method_problems(model) == []


@pytest.mark.slow_rows("BDF", "Radau")
@pytest.mark.parametrize("method", SCIPY_METHODS)
def test_an_expression_without_a_value_is_named(method):
    load = {"type": "force", "at": "a@1", "value": [0, 1], "amplitude": {"type": "expression", "value": "sqrt(0.1-t)"}}
    with pytest.raises(ComputationError, match="sqrt") as caught:
        moved({**PENDULUM, "loads": [load]}, method, tolerance=1e-5)
    assert caught.value.failure.reason
