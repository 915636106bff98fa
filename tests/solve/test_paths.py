"""Paths through limit points: closed solutions, exact ends, agreement with load control, failures."""

from __future__ import annotations

import math

import helpers
import numpy as np
import pytest
from helpers import path, reaches

from ancf2d.case import load_case_text
from ancf2d.errors import CaseError, ComputationError
from ancf2d.results import open_results
from ancf2d.solvers.registry import solve
from ancf2d.solvers.statics.continuation import Curve, PathPoint
from ancf2d.solvers.statics.path import Follower
from ancf2d.solvers.statics.path_controls import ProbeValue
from ancf2d.solvers.statics.path_events import hides_limit_points
from ancf2d.solvers.system import System
from ancf2d.study.run import run_case, vocabulary

STIFF = {"EA": 1e4, "kGA": 1e4, "EI": 1.0}
EI = helpers.MATERIAL["E"] * 0.2 * 0.3**3 / 12


# ------------------------------------------------------------------ a truss with a closed solution

BASE, RISE, EA = 1.0, 0.3, 2e3
LENGTH = math.hypot(BASE, RISE)
AT_LIMIT = (BASE**2 * LENGTH) ** (1 / 3)


def truss(solver, **scene):
    """One bar of a two-bar truss (von Mises 1923), whose top slides down its line of symmetry under a unit load.

    Engineering strain: P = EA y (1/l - 1/L), l^2 = b^2 + y^2, with limit points where l^3 = b^2 L.
    """
    scale = scene.pop("scale", 1.0)
    bar = helpers.body({"type": "line", "start": [0, 0], "end": [BASE * scale, RISE * scale]},
                       helpers.element("reissner2", 1), {"EA": EA, "kGA": EA, "EI": 1e3 * scale**2})
    bc = [{"name": "foot", "type": "pin", "at": "bar@0"}, {"type": "roller", "at": "bar@1", "fixed": "x"}]
    loads = scene.pop("loads", [{"type": "force", "at": "bar@1", "value": [0, -1]}])
    probes = {"top": "bar@1", "foot": "bar@0"}
    return helpers.solved({"bar": bar}, solver, bc=bc, loads=loads, output={"probes": probes}, **scene)


def truss_load(y):
    return EA * y * (1 / math.hypot(BASE, y) - 1 / LENGTH)


HIGH = math.sqrt(AT_LIMIT**2 - BASE**2)


@pytest.mark.parametrize("solver", [path({"limit_points": 2}), path(reaches("top", "uy", -1.2 * 2 * RISE)),
                                    path(reaches("top", "uy", -1.2 * 2 * RISE), "displacement")],
                         ids=["limit points", "arc length", "displacement"])
def test_limit_points_of_the_truss_are_those_of_its_closed_solution(solver):
    points = truss(solver).state.report["limit_points"]
    assert len(points) == 2
    np.testing.assert_allclose([p["factor"] for p in points], [truss_load(HIGH), truss_load(-HIGH)], rtol=1e-9)
    np.testing.assert_allclose([p["probes"]["top"]["y"] for p in points], [HIGH, -HIGH], rtol=1e-7)


@pytest.mark.parametrize(("stiffness", "stop", "end"), [(5e3, 0.1, 60), (5e3, 0.0, 60), (1e6, 0.1, 60), (1e6, 0.0, 60),
                                                        (4.9e5, 0.118, 300)])
def test_the_load_turns_back_where_a_falling_truss_meets_a_stop(stiffness, stop, end):
    """The path has an acute corner where a one-sided spring begins to act while the load factor falls.

    The last corner and the limit point before it lie within a step that would otherwise rise at both ends.
    """
    spring = {"type": "translational", "between": ["bar@1", [BASE, -1]], "stiffness": stiffness, "only": "compression",
              "gap": RISE - stop}
    out = truss(path({"load_factor": end}), springs=[spring])
    first, second = out.state.report["limit_points"]
    assert first["factor"] == pytest.approx(truss_load(HIGH), rel=1e-9)
    assert second["factor"] == pytest.approx(truss_load(stop), rel=1e-5, abs=1e-5 * truss_load(HIGH))
    y = RISE + out.state.d[out.point("bar@1").dofs()[1]]
    assert truss_load(y) + stiffness * (stop - y) == pytest.approx(end, rel=1e-8)


def test_every_state_of_the_path_lies_on_the_closed_solution():
    for solver in (path({"limit_points": 2}), path(reaches("top", "uy", -0.8), "displacement", steps=7)):
        out = truss(solver)
        y = [RISE + s.d[out.point("bar@1").dofs()[1]] for s in out.states]
        assert len(y) > 7
        np.testing.assert_allclose([s.t for s in out.states], [truss_load(v) for v in y], rtol=1e-8, atol=1e-7)


def test_multipliers_are_not_among_the_negative_pivots_of_a_path():
    """A frame with a multiplier at its corner (Lee, Manuel & Rossow 1968) is stable up to its limit point."""
    section = {"EA": 43200.0, "EI": 1.0, "rhoA": 1.0}
    legs = {name: helpers.body({"type": "line", "start": a, "end": b}, helpers.element("cable", 5), section)
            for name, a, b in (("a", [0, 0], [0, 1]), ("b", [0, 1], [1, 1]))}
    out = helpers.solved(legs, path({"limit_points": 1}), bc=[{"type": "pin", "at": at} for at in ("a@0", "b@1")],
                         joints=[{"type": "weld", "between": ["a@1", "b@0"]}],
                         loads=[{"type": "force", "at": "b@0.2", "value": [0, -1]}])
    assert out.model.numbering.n_multipliers == 1
    (limit,) = out.state.report["limit_points"]
    assert limit["factor"] == pytest.approx(18.5, rel=5e-3)
    assert {state.history["negative_pivots"] for state in out.states if state.t < 0.9 * limit["factor"]} == {0}


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_path_does_not_depend_on_the_unit_of_length(scale):
    points = truss(path({"limit_points": 2}), scale=scale).state.report["limit_points"]
    np.testing.assert_allclose([p["factor"] for p in points], [truss_load(HIGH), truss_load(-HIGH)], rtol=1e-9)
    assert points[0]["probes"]["top"]["y"] == pytest.approx(HIGH * scale, rel=1e-7)


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_a_path_does_not_depend_on_the_size_of_the_scaled_load(size):
    loads = [{"type": "force", "at": "bar@1", "value": [0, -size]}]
    points = truss(path({"limit_points": 2}), loads=loads).state.report["limit_points"]
    np.testing.assert_allclose([p["factor"] * size for p in points], [truss_load(HIGH), truss_load(-HIGH)], rtol=1e-9)


@pytest.mark.parametrize("blind", [1e-5, 1e-7])
def test_limit_points_are_located_where_the_tangent_is_singular_to_round_off(monkeypatch, blind):
    """No trial succeeds within ``blind`` of dt/ds = 0."""
    advance = Follower._advance

    def failing(self, a, h, guess=None):
        point = advance(self, a, h, guess)
        if abs(point.rate) * math.sqrt(self.curve.metric.load) < blind:
            raise ComputationError("singular")
        return point

    monkeypatch.setattr(Follower, "_advance", failing)
    points = truss(path({"limit_points": 2})).state.report["limit_points"]
    np.testing.assert_allclose([p["factor"] for p in points], [truss_load(HIGH), truss_load(-HIGH)], rtol=1e-9)
    np.testing.assert_allclose([p["probes"]["top"]["y"] for p in points], [HIGH, -HIGH], rtol=1e-7)


@pytest.mark.parametrize("longest", [0.1, 0.03])
def test_a_loop_beside_other_parts_of_a_path_is_not_passed_over(longest):
    """A shallow arch through six limit points, on 8 elements: the third and the fourth lie on a loop.

    A step 30 times as long as the one before, towards a suspected bifurcation, passed from one side of it to the other.
    """
    arch = helpers.body({"type": "arc", "center": [0, -100], "radius": 100, "from": math.pi / 2 + 0.25,
                         "to": math.pi / 2 - 0.25}, helpers.element("reissner3", 8), {"height": 1, "width": 1},
                        {"E": 1e6, "nu": 0.3})
    out = helpers.solved({"arch": arch}, path(reaches("apex", "uy", -6.5)) | {"largest_step": longest},
                         bc=[{"type": "pin", "at": "arch@0"}, {"type": "pin", "at": "arch@1"}],
                         loads=[{"type": "force", "at": "arch@0.5", "value": [0, -1]}],
                         output={"probes": {"apex": "arch@0.5"}})
    found = [point["factor"] for point in out.state.report["limit_points"]]
    assert found == pytest.approx([409.33, -846.58, 736.82, 15.522, 987.10, -454.39], rel=1e-4)


def test_limit_points_under_a_follower_load_are_stationary_points_of_the_load():
    """Lee's frame under a load that turns with the beam: the tangent is not symmetric, its determinant changes sign."""
    corners = {"type": "polyline", "points": [[0, 0], [0, 120], [120, 120]]}
    scene = {"bc": [{"type": "pin", "at": "f@0"}, {"type": "pin", "at": "f@1"}], "output": {"probes": {"p": "f@0.6"}},
             "loads": [{"type": "follower_force", "at": "f@0.6", "value": [0, -1]}]}
    found = []
    for name in ("cable", "reissner3"):
        frame = helpers.body(corners, helpers.element(name, 40), {"EA": 4.32e7, "kGA": 4.32e7, "EI": 1.44e7})
        out = helpers.solved({"f": frame}, path({"limit_points": 2}), **scene)
        points = out.state.report["limit_points"]
        assert out.state.report["bifurcations"] == []
        t = np.array([s.t for s in out.states])
        k = int(np.argmax(t))
        assert t[k] == points[0]["factor"]
        assert (np.diff(t)[:k] > 0).all()
        assert (np.diff(t)[k:] < 0).all()
        found.append([points[0]["factor"], points[1]["factor"]])
    np.testing.assert_allclose(found[0], found[1], rtol=5e-3)


# ------------------------------------------------------------------ ends that are met exactly

@pytest.mark.parametrize("factor", [0.9 * truss_load(HIGH), -3.7])
def test_a_load_factor_is_met_exactly_on_either_side_of_zero(factor):
    out = truss(path({"load_factor": factor}))
    assert out.state.t == factor
    assert truss_load(out.r("bar@1")[1]) == pytest.approx(factor, rel=1e-9)


def test_a_load_factor_beyond_the_limit_point_is_met_after_the_snap_through():
    out = truss(path({"load_factor": 1.5 * truss_load(HIGH)}))
    assert out.state.t == 1.5 * truss_load(HIGH)
    assert out.r("bar@1")[1] < -RISE
    assert len(out.state.report["limit_points"]) == 2


@pytest.mark.parametrize("method", ["arc_length", "displacement"])
@pytest.mark.parametrize(("probe", "quantity", "value"),
                         [("top", "y", -0.05), ("top", "uy", -0.33), ("foot", "theta", -0.4)])
def test_a_value_of_a_probe_is_met_exactly(method, probe, quantity, value):
    out = truss(path(reaches(probe, quantity, value), method))
    y = {"y": value, "uy": RISE + value, "theta": BASE * math.tan(math.atan(RISE / BASE) + value)}[quantity]
    assert out.r("bar@1")[1] == pytest.approx(y, rel=1e-12)
    assert out.state.t == pytest.approx(truss_load(y), rel=1e-9)
    assert out.state.last


def test_a_path_that_starts_at_its_end_stops_there():
    held = [{"type": "force", "at": "bar@1", "value": [0, -1], "amplitude": {"type": "constant"}},
            {"type": "force", "at": "bar@1", "value": [0, -1]}]
    for loads, until in (({}, reaches("top", "uy", 0)), ({"loads": held}, {"load_factor": 0})):
        for method in ("arc_length", "displacement") if "probe" in until else ("arc_length",):
            out = truss(path(until, method), **loads)
            assert [(s.t, s.last) for s in out.states] == [(0.0, True)]
            assert truss_load(out.r("bar@1")[1]) == pytest.approx(len(loads), abs=1e-9)


@pytest.mark.parametrize(("name", "form"), [("vallejo", "structural"), ("cable", None), ("reissner3", None)])
def test_turns_are_counted_along_a_path(name, form):
    """Rolled up by M = EI theta/L to three full turns."""
    beam = {"beam": helpers.body(helpers.line(1.0), helpers.element(name, 48, form), STIFF)}
    loads = [{"type": "moment", "at": "beam@1", "value": 1.0}]
    out = helpers.solved(beam, path(reaches("tip", "theta", 6 * math.pi)), output={"probes": {"tip": "beam@1"}},
                         bc=[{"type": "clamp", "at": "beam@0"}], loads=loads)
    assert out.state.t == pytest.approx(6 * math.pi, rel=1e-3)
    assert out.state.report["limit_points"] == []


# ------------------------------------------------------------------ agreement with load control

def cantilever(name, solver, loads, bc=(), count=4):
    beam = {"beam": helpers.body(helpers.line(1.2, 0.2), helpers.element(name, count))}
    return helpers.solved(beam, solver, bc=[{"name": "wall", "type": "clamp", "at": "beam@0"}, *bc], loads=loads,
                          output={"probes": {"tip": "beam@1"}})


FOLLOWING = [{"type": "follower_force", "at": "beam@1", "value": [0, 0.8 * EI]},
             {"type": "distributed", "on": "beam", "value": [0, 0.5 * EI], "follower": True}]
MIXED = [{"type": "force", "at": "beam@1", "value": [0.4 * EI, -0.8 * EI]},
         {"type": "moment", "at": "beam@1", "value": 0.4 * EI}, *FOLLOWING]


# a tendon that the load factor winds up
WOUND = [{"type": "tendon", "through": ["beam@1", [0.9, 1]], "stiffness": EI, "slack": -0.3}]


@helpers.covering(name=helpers.KINDS.values(), loads=[helpers.tip(0, -EI), FOLLOWING, MIXED, WOUND])
def test_arc_length_and_displacement_control_give_the_states_of_load_control(name, loads):
    newton = cantilever(name, "static", loads)
    arc = cantilever(name, path({"load_factor": 1}), loads)
    np.testing.assert_allclose(arc.d, newton.d, atol=1e-9)
    for quantity, value in (("uy", newton.u("beam@1")[1]), ("theta", newton.theta("beam@1"))):
        out = cantilever(name, path(reaches("tip", quantity, float(value)), "displacement"), loads)
        assert out.state.t == pytest.approx(1, rel=1e-8)
        np.testing.assert_allclose(out.d, newton.d, atol=1e-8)
    assert arc.state.report == {"limit_points": [], "bifurcations": []}


@pytest.mark.parametrize("method", ["arc_length", "displacement"])
def test_loads_with_an_amplitude_are_constant_along_a_path(method):
    """A tip load with an amplitude acts in full at factor 0; only the moment is scaled."""
    held = helpers.tip(0.2 * EI, -0.9 * EI, amplitude={"type": "ramp", "t0": 0, "t1": 1})
    both = [*held, {"type": "moment", "at": "beam@1", "value": EI}]
    alone, newton = cantilever("vallejo", "static", held), cantilever("vallejo", "static", both)
    until = {"load_factor": 1} if method == "arc_length" else reaches("tip", "uy", float(newton.u("beam@1")[1]))
    out = cantilever("vallejo", path(until, method), both)
    assert out.states[0].t == 0.0
    np.testing.assert_allclose(out.states[0].d, alone.d, atol=1e-9)
    np.testing.assert_allclose(out.d, newton.d, atol=1e-8)
    assert out.state.t == pytest.approx(1, rel=1e-8)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_prescribed_numbers_are_scaled_and_prescribed_amplitudes_are_constant(name):
    x = 0.6 * math.cos(0.2) - 0.01
    move = {"type": "prescribed", "at": "beam@1", "uy": -0.3, "angle": -0.6}
    hold = {"type": "prescribed", "at": "beam@0.5", "x": {"type": "constant", "scale": x}}
    newton = cantilever(name, "static", [], [move, {**hold, "x": x}])
    out = cantilever(name, path({"load_factor": 1}), [], [move, hold])
    assert out.u("beam@0.5", 0)[0] == pytest.approx(-0.01, rel=1e-9)
    assert out.u("beam@1", 0)[1] == pytest.approx(0, abs=1e-15)
    np.testing.assert_allclose(out.d[:out.model.n_q], newton.d[:newton.model.n_q], atol=1e-8)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_rate_of_loading_is_the_derivative_of_the_residual(name):
    move = {"type": "prescribed", "at": "beam@0.5", "ux": -0.05, "angle": 0.3}
    out = cantilever(name, path({"load_factor": 0.3}), MIXED + WOUND, [move])
    model, z = out.model, out.d[out.model.numbering.free]
    curve, h = Curve(System(model), 1e-9, 30), 1e-4

    def residual(t):
        return curve.system.forces(model.displacements(z, t), t).R

    t = out.state.t
    expected = (residual(t - 2 * h) - 8 * residual(t - h) + 8 * residual(t + h) - residual(t + 2 * h)) / (12 * h)
    rate = curve.load_rate(model.displacements(z, t), t)
    np.testing.assert_allclose(rate, expected, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("quantity", ["x", "y", "ux", "uy", "theta"])
@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_derivatives_of_a_probe_off_the_axis_are_those_of_its_value(name, quantity):
    beam = {"beam": helpers.body(helpers.line(1.2, 0.2), helpers.element(name, 3))}
    model = helpers.build(beam, path(reaches("p", quantity, 1.0)), loads=helpers.tip(0, 1),
                          bc=[{"type": "clamp", "at": "beam@0"}, {"type": "prescribed", "at": "beam@1", "ux": 0.3}],
                          output={"probes": {"p": {"at": "beam@0.9", "y": 0.07}}})
    probe = ProbeValue(model, model.case.output.probes["p"], quantity)
    free, rng, h = model.numbering.free, np.random.default_rng(1), 1e-3
    z = 0.1 * helpers.random_state(model, 1.0)[free]
    dz, dt = rng.normal(size=len(free)) / np.where(model.weights[free] > 0, model.weights[free], 1), 0.7
    values = [probe.value(model.displacements(z + k * h * dz, 0.4 + k * h * dt)) for k in (-2, -1, 1, 2)]
    gradient, by_t = probe.derivatives(model.displacements(z, 0.4))
    expected = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    assert gradient @ dz + by_t * dt == pytest.approx(expected, rel=1e-6)


# ------------------------------------------------------------------ what a run tells

CASE = """
bodies:
  bar: {geometry: {type: line, start: [0, 0], end: [1, 0.3]}, section: {EA: 2e3, kGA: 2e3, EI: 1e3},
        element: {type: reissner2, count: 1}}
boundary_conditions:
  - {type: pin, at: bar@0}
  - {type: roller, at: bar@1, fixed: x}
loads: [{type: force, at: bar@1, value: [0, -1]}]
solver: {type: static, method: arc_length, until: {probe: top, quantity: uy, reaches: -0.7}}
goal: {limit_point: 1}
output: {probes: {top: bar@1}, every: 1000}
expected:
  - {limit_point: 2, value: VALUE, rtol: 1e-9}
  - {limit_point: 1, probe: top, quantity: y, value: HIGH, rtol: 1e-7}
  - {limit_point: 3, value: 1, rtol: 1}
""".replace("VALUE", repr(truss_load(-HIGH))).replace("HIGH", repr(HIGH))


def test_limit_points_are_in_summary_checks_and_result_file(tmp_path):
    summary = run_case(load_case_text(CASE, vocabulary=vocabulary()), str(tmp_path / "out.h5")).summary
    assert [p["factor"] for p in summary["limit_points"]] == pytest.approx([truss_load(HIGH), truss_load(-HIGH)])
    assert [(c["what"], c["met"]) for c in summary["checks"]] == [
        ("limit point 2", True), ("limit point 1 top y", True), ("limit point 3", False)]
    with open_results(summary["output"]) as results:
        table = results.tables["limit_points"]
        np.testing.assert_allclose(table["factor"], [p["factor"] for p in summary["limit_points"]])
        np.testing.assert_allclose(table["top.y"], [HIGH, -HIGH], rtol=1e-7)
        # the end of a path is stored whatever ``every`` says
        assert results.probes["top"]["uy"][-1] == pytest.approx(-0.7, rel=1e-12)
        assert results.t[-1] == pytest.approx(summary["load_factor"])
        assert len(results.t) == 2


# ------------------------------------------------------------------ bifurcations


@pytest.mark.parametrize(("low", "high", "rise", "hidden"), [(1, 1, 1, False), (1, 1, -0.5, True), (1, 1, 0.4, False),
                                                             (1, -1, 0, False), (-1, -1, 0.5, True), (1, 1, 0.2, True)])
def test_pairs_of_limit_points_within_a_step_are_found_by_the_cubic(low, high, rise, hidden):
    def point(s, t, rate):
        return PathPoint(np.zeros(1), t, s, np.zeros(1), rate, 0, None, 0, 0.0, 0.0, [], [])

    x = np.linspace(0, 1, 1001)
    slope = low * (1 - x) ** 2 + 2 * (3 * rise - low - high) * x * (1 - x) + high * x**2
    assert hidden == (low * high > 0 and (slope * low < -1e-9).any())
    assert hides_limit_points(point(2.0, 5.0, low), point(3.0, 5.0 + rise, high)) is hidden


# ------------------------------------------------------------------ failures

def test_a_path_without_scaled_loads_is_refused():
    loads = [{"type": "force", "at": "bar@1", "value": [0, 0]}]
    with pytest.raises(ComputationError, match="nothing moves as the load factor grows"):
        truss(path({"load_factor": 1}), loads=loads)


def test_displacement_control_of_a_fixed_point_is_refused():
    with pytest.raises(ComputationError, match=r"top ux does not change with the load factor"):
        truss(path(reaches("top", "ux", 0.1), "displacement"))


def test_displacement_control_says_where_the_path_snaps_back():
    """The load point of Lee's frame turns back; arc length continues to the same value."""
    corners = {"type": "polyline", "points": [[0, 0], [0, 120], [120, 120]]}
    frame = helpers.body(corners, helpers.element("reissner3", 20), {"A": 6, "I": 2, "height": 2},
                         {"E": 7.2e6, "nu": 0.3})
    scene = {"bc": [{"type": "pin", "at": "f@0"}, {"type": "pin", "at": "f@1"}], "output": {"probes": {"p": "f@0.6"}},
             "loads": [{"type": "force", "at": "f@0.6", "value": [0, -1]}]}
    model = helpers.build({"f": frame}, path(reaches("p", "uy", -80), "displacement", steps=40), **scene)
    followed = solve(model)
    reports = [next(followed).report]
    with pytest.raises(ComputationError, match="cannot be followed beyond load factor") as failed:
        reports += iter(lambda: next(followed).report, None)
    assert "arc_length" in failed.value.failure.advice
    assert len(reports[-1]["limit_points"]) == 1
    assert helpers.solved({"f": frame}, path(reaches("p", "uy", -80)), **scene).state.last


def test_too_few_steps_are_reported_with_the_value_reached():
    with pytest.raises(ComputationError, match="limit point 2 was not reached within 3 steps") as failed:
        truss(path({"limit_points": 2}, steps=3))
    assert failed.value.failure.at["step"] == 3


def test_constant_loads_without_equilibrium_are_named():
    held = [{"type": "force", "at": "bar@1", "value": [0, -2 * truss_load(HIGH)], "amplitude": {"type": "constant"}},
            {"type": "force", "at": "bar@1", "value": [0, -1]}]
    with pytest.raises(ComputationError, match="under the constant loads alone"):
        truss(path({"load_factor": 1}), loads=held)


def test_displacement_control_needs_something_to_control():
    with pytest.raises(CaseError, match="method displacement ends where a probe reaches a value"):
        truss(path({"load_factor": 1}, "displacement"))
