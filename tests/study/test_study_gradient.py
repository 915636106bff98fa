"""Derivatives of goals with respect to numbers of a case: closed forms, and differences of whole runs."""

import re
from dataclasses import replace
from pathlib import Path

import helpers as h
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import ancf2d
from ancf2d.case.numbers import CaseNumber, number_at, numbers_of
from ancf2d.errors import CaseError, ComputationError
from ancf2d.solvers.derivatives.differences import derivative
from ancf2d.solvers.derivatives.statics import Equilibrium
from ancf2d.study.expressions import Measures, Vocabulary, read_measure
from ancf2d.study.gradient import derivatives, gradient

CANTILEVER = {
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]},
                        "section": {"EA": 1e6, "kGA": 4e5, "EI": 500.0, "rhoA": 2.0, "rhoI": 1e-3},
                        "element": {"type": "reissner3", "count": 4}}},
    "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "beam@0"}],
    "loads": [{"name": "tip", "type": "force", "at": "beam@1", "value": [0, -3]}],
    "solver": {"type": "linear_static"},
    "goal": {"probe": "tip", "quantity": "uy"},
    "output": {"probes": {"tip": "beam@1"}},
}


def test_timoshenko_cantilever():
    """u = -P (L^3/(3 EI) + L/kGA): Timoshenko's tip deflection, differentiated by hand."""
    P, L, EI, kGA = 3.0, 2.0, 500.0, 4e5
    case = ancf2d.load(CANTILEVER)
    values, J = gradient(case, [case.case.goal], ["bodies.beam.section.EI", "bodies.beam.section.kGA",
                                                  "bodies.beam.section.EA", "loads.tip.value.1",
                                                  "bodies.beam.geometry.end.0"])
    exact = [P * L**3 / (3 * EI**2), P * L / kGA**2, 0.0, L**3 / (3 * EI) + L / kGA, -P * (L**2 / EI + 1 / kGA)]
    assert values == pytest.approx([-P * (L**3 / (3 * EI) + L / kGA)], rel=1e-9)
    assert J[0] == pytest.approx(exact, rel=1e-8, abs=1e-20)


def test_ends_of_tables_that_change_the_mesh():
    """The end of a table is a node, so if it leaves the end of its body there is one more element."""
    strain = {"name": "bend", "type": "eigenstrain", "on": "beam", "curvature": {"s": [0, 1], "value": [0.1, 0.3]}}
    case = ancf2d.load(CANTILEVER | {"loads": [strain]})
    for path in ("loads.bend.curvature.s.0", "loads.bend.curvature.s.1"):
        with pytest.raises(ComputationError, match=f"the mesh changes with {re.escape(path)}"):
            gradient(case, [case.case.goal], [path])


def test_numbers_are_found_by_their_paths():
    """Names for items of lists, defaults of the case format, S of a point."""
    case = ancf2d.load(CANTILEVER)
    paths = [v.path for v in numbers_of(case)]
    assert {"loads.tip.value.1", "bodies.beam.section.EI"} <= set(paths)
    assert not [p for p in paths if p.startswith(("solver", "output", "boundary_conditions"))]
    assert number_at(case, "loads.0.value.1") == CaseNumber("loads.0.value.1", -3.0, 3.0)
    assert number_at(case, "loads.tip.at").override(0.5) == "loads.tip.at=beam@0.5"
    with pytest.raises(CaseError, match=r"did you mean 'bodies\.beam\.section\.EI'"):
        number_at(case, "bodies.beam.section.El")


@pytest.mark.parametrize(("path", "words"), [
    ("loads.tip.type", "'loads.tip.type' is the text 'force'; expected a number, or the key of a point"),
    ("loads", "'loads' is a list of 1; expected a number, such as loads.tip.value.0"),
    ("masses", "the case has no 'masses'"), ("units", "the case has no 'units'"),
    ("title", "'title' is the text '' by default; expected a number, or the key of a point"),
    ("beam@1", "'beam@1' is a point, not the path of a key; expected loads.tip.at or output.probes.tip"),
    ("beam@0.3", "'beam@0.3' is a point, not the path of a key; expected the path of a key that has a point")])
def test_wrong_paths_are_reported_without_positions_outside_the_file(path: str, words: str) -> None:
    with pytest.raises(CaseError, match=re.escape(words)) as caught:
        number_at(ancf2d.load(CANTILEVER), path)
    assert "completed" not in str(caught.value)


def test_numbers_of_the_goal_itself_are_refused():
    """The differentiated quantity would be another one: 0 would be a wrong answer."""
    case = {**STRUT, "loads": [{"name": "push", "type": "force", "at": "strut@1", "value": [0, 1]}],
            "solver": {"type": "frequency_response", "inputs": ["push"], "from": 1, "to": 3},
            "goal": {"probe": "tip", "quantity": "uy", "input": "push", "hz": 2}}
    with pytest.raises(CaseError, match=r"'goal\.hz' belongs to the goal itself and cannot vary"):
        ancf2d.sensitivity(case, "goal.hz")


def test_errors_of_states_are_weighted_by_the_dependence_of_values(monkeypatch):
    """With the relative error e of dz/dL, u_y' = -P (L^2/EI + 1/kGA) has it too; mass' = rhoA has no such error."""
    share, slope = 1e-3, Equilibrium.slope

    def rough(self, at, h):
        found = slope(self, at, h)
        return replace(found, error=np.full(len(found.value), share * np.abs(found.value).max()))
    monkeypatch.setattr(Equilibrium, "slope", rough)
    case = ancf2d.load(CANTILEVER)
    texts = ["mass", "tip.uy", "mass + tip.uy"]
    read = Measures([read_measure(text, "", Vocabulary(case)) for text in texts], case.case.goal)
    found = derivatives(case, read, [number_at(case, "bodies.beam.geometry.end.0")])
    by_states = -3.0 * (2.0**2 / 500.0 + 1 / 4e5)
    assert found.jacobian[:, 0] == pytest.approx([2.0, by_states, 2.0 + by_states], rel=1e-8)
    assert found.errors[1:, 0] == pytest.approx([-share * by_states] * 2, rel=1e-3)
    assert found.errors[0, 0] <= 1e-9


def test_differences_of_smooth_functions():
    """Fourth order on both sides, or on one side if the other is refused, and shorter steps if they are too long."""
    def f(h):
        return np.array([np.exp(3 * h), np.sin(h), 1.0])

    found = derivative(f, 2e-3)
    assert found.value == pytest.approx([3.0, 1.0, 0.0], abs=1e-9)
    assert (np.abs(found.value - [3.0, 1.0, 0.0]) <= 10 * found.error + 1e-11).all()

    def half(h):
        if h < 0:
            raise CaseError("negative")
        return f(h)

    assert derivative(half, 1e-3).value == pytest.approx([3.0, 1.0, 0.0], abs=1e-8)
    assert derivative(lambda h: np.array([np.sin(300 * h)]), 1e-2).value == pytest.approx([300.0], rel=1e-7)


def differences_of_solves(case, path, h, read):
    """Return d read/d p from whole solves at p +- h and p +- 2 h: a difference of fourth order."""
    variable = number_at(case, path)

    def at(k):
        return read(ancf2d.solve(case, [variable.override(variable.value + k * h)], states=False))
    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)


def assert_exact(case, overrides, steps, rel=1e-6):
    """Assert that derivatives need no runs, and are those of converged solves, for each path and step."""
    loaded = ancf2d.load(case, overrides)
    study = ancf2d.sensitivity(loaded, list(steps))
    assert study.goal == pytest.approx(ancf2d.solve(loaded, states=False).value, rel=1e-9)
    for row in study.rows:
        assert row.method == "exact", row.path
        expected = differences_of_solves(loaded, row.path, steps[row.path], lambda s: s.value)
        # what hardly depends on a number is known beside the goal itself
        floor = 1e-8 * abs(study.goal / (row.value or 1.0))
        assert row.derivative == pytest.approx(expected, rel=rel, abs=floor), row.path
        assert abs(row.derivative - expected) <= 10 * row.error + 1e-6 * abs(expected) + floor


FRAME = """
parameters: {w: -30}
bodies:
  post:
    geometry: {type: arc, center: [1, 0], radius: 1, from: 3.141592653589793, to: 1.5707963267948966}
    section: {height: "0.03*(1 - 0.2*s)", width: 0.03}
    material: {E: 2e11, nu: 0.3, rho: 7800, alpha: 1.2e-5}
    element: {type: vallejo, count: 4}
  beam:
    geometry: {type: line, start: [1, 1], end: [2.2, 1.1]}
    section: {EA: 1.2e8, kGA: 4e7, EI: 2000, rhoA: 3, rhoI: 1e-3}
    element: {type: reissner3, count: 3}
boundary_conditions:
  - {name: foot, type: clamp, at: post@0}
  - {name: edge, type: roller, at: beam@1, normal: [0.1, 1]}
  - {name: hinge, type: pin, at: beam@0}
springs:
  - {name: tie, type: translational, between: [post@1, beam@0.2], stiffness: 9e3, length: 0.1}
  - {name: stay, type: translational, between: [post@0.3, [-0.4, 1.2]], stiffness: 2e4, length: 0.6, damping: 5}
  - {name: coil, type: rotational, between: [beam@0, beam@1], stiffness: 400, angle: 0.05}
masses:
  - {name: lump, at: post@0.5, mass: 4, inertia: 0.1}
loads:
  - {name: pull, type: force, at: beam@0.4, value: [200, -600]}
  - {name: push, type: follower_force, at: post@0.7, value: [50, -300]}
  - {name: twist, type: moment, at: post@1, value: 60}
  - {name: snow, type: distributed, on: beam, value: [0, "w*(1 + s)"]}
  - {name: heat, type: temperature, on: post, value: 30, gradient: 100}
  - {type: gravity, name: weight, value: [0, -9.81]}
solver: {type: static}
goal: {probe: knee, quantity: uy}
output: {probes: {knee: post@1, mid: beam@0.55}}
"""
# numbers of every kind, and the steps of the solves that they are compared with
KINDS = {"bodies.post.geometry.radius": 1e-4, "bodies.post.geometry.from": 1e-4, "bodies.post.section.width": 3e-6,
         "bodies.post.material.E": 2e8, "bodies.post.material.rho": 10.0, "bodies.post.material.alpha": 1e-8,
         "bodies.beam.section.EI": 2.0, "bodies.beam.section.EA": 1e5, "bodies.beam.geometry.end.0": 1e-4,
         "boundary_conditions.edge.normal.0": 1e-4, "springs.stay.stiffness": 20.0, "springs.stay.length": 1e-4,
         "springs.stay.between.1.0": 1e-4, "springs.coil.stiffness": 1.0, "springs.coil.angle": 1e-4,
         "springs.tie.between.1": 1e-4,
         "masses.lump.mass": 0.01, "loads.pull.value.1": 1.0, "loads.pull.at": 1e-4, "loads.push.value.0": 1.0,
         "loads.twist.value": 0.1, "parameters.w": 0.1, "loads.heat.value": 0.1, "loads.heat.gradient": 0.1,
         "loads.weight.value.1": 0.01}
LINEAR = ["bodies.post.geometry.from", "bodies.post.material.E", "bodies.beam.geometry.end.0",
          "boundary_conditions.edge.normal.0", "springs.stay.between.1.0", "springs.coil.stiffness", "masses.lump.mass",
          "loads.pull.at", "loads.heat.gradient"]


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_every_kind_of_number(solver):
    """dz/dp = -K^-1 dR/dp compared with solves: lengths, angles, profiles, materials, springs, loads, positions."""
    if solver == "linear_static":
        # by the same differences of residuals: a number of each part of the case tells that they are taken there
        assert_exact(FRAME, ["solver.type=linear_static"], {path: KINDS[path] for path in LINEAR})
    else:
        assert_exact(FRAME, ["solver={type: static, tolerance: 1e-12, steps: 1}"], KINDS)


STRUT = {
    "bodies": {"strut": {"geometry": {"type": "line", "start": [0, 0], "end": [3, 0]},
                         "section": {"EA": 1e9, "kGA": 1e9, "EI": 200.0, "rhoA": 2.0, "rhoI": 1e-9},
                         "element": {"type": "reissner3", "count": 12}}},
    "boundary_conditions": [{"type": "clamp", "at": "strut@0"}],
    "loads": [{"name": "push", "type": "force", "at": "strut@1", "value": [-2, 0]}],
    "masses": [{"at": "strut@1", "mass": 1e-9}],
    "output": {"probes": {"tip": "strut@1"}},
}


@pytest.mark.parametrize(("goal", "tells"), [
    ({"probe": "mid", "quantity": "theta"}, {"loads.push.at"}),
    ({"probe": "mid", "quantity": "ux"}, {"loads.push.value.0", "bodies.beam.geometry.start.1",
                                          "bodies.beam.geometry.end.1"})])
def test_goals_that_vanish_by_symmetry_have_no_relative_changes(goal, tells):
    """The middle of a clamped beam under a central force neither rotates nor moves axially, for any E and height.

    The last digits do not: they change by many times themselves, as nothing that means anything.
    """
    study = ancf2d.sensitivity({
        "bodies": {"beam": {"geometry": h.line(2.0), "section": {"height": 0.1, "width": 0.1},
                            "material": {"E": 2.07e11, "nu": 0.3}, "element": h.element("vallejo", 8)}},
        "boundary_conditions": [{"type": "clamp", "at": "beam@0"}, {"type": "clamp", "at": "beam@1"}],
        "loads": [{"name": "push", "type": "force", "at": "beam@0.5", "value": [0, -5e5]}],
        "solver": {"type": "linear_static"}, "goal": goal, "output": {"probes": {"mid": "beam@0.5"}}})
    assert {row.path for row in study.rows} - {row.path for row in study.idle} == tells
    assert {row.elasticity for row in study.rows} == {None}
    assert any("vanishes by symmetry" in warning for warning in study.warnings) or study.goal == 0.0


LAWS = {"linear": {}, "neo_hooke": {"law": "neo_hooke"}, "relaxed": {"viscoelastic": [{"modulus": 0.5, "time": 0.1}]},
        "curve": {"stress_strain": {"strain": [0.001, 0.02], "stress": [2e8, 3e8], "unloading": "curve"}}}


@pytest.mark.parametrize(("law", "solver"), [
    ("linear", {"type": "quasi_static", "t_end": 1}), ("curve", {"type": "quasi_static", "t_end": 1}),
    ("neo_hooke", {"type": "static"}), ("relaxed", {"type": "static"}), ("curve", {"type": "static"})])
def test_path_independent_equilibria_have_exact_derivatives(law, solver):
    """Nonlinear laws, and loads over time, do not cause path dependence by themselves."""
    case = {"bodies": {"beam": {"geometry": h.line(2.0), "section": {"height": 0.1, "width": 0.1},
                                "material": {"E": 2e11, "nu": 0.3, **LAWS[law]},
                                "element": h.element("2d3n" if law == "neo_hooke" else "reissner3", 2)}},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "beam@0"}],
            "loads": [{"name": "tip", "type": "force", "at": "beam@1", "value": [1e3, -1e5],
                       "amplitude": {"type": "sine", "frequency": 0.3}}],
            "solver": solver, "goal": {"probe": "tip", "quantity": "ux"}, "output": {"probes": {"tip": "beam@1"}}}
    paths = [f"bodies.beam.{name}" for name in ("section.height", "material.E")] + [
        f"loads.tip.{name}" for name in ("value.1", "amplitude.frequency")]
    study = ancf2d.sensitivity(case, paths)
    assert {row.method for row in study.rows} == {"exact"}
    loaded = ancf2d.load(case)
    for row in study.rows:
        expected = differences_of_solves(loaded, row.path, 1e-4 * row.value, lambda s: s.value)
        assert row.derivative == pytest.approx(expected, rel=1e-6)


def test_varying_the_end_time_changes_the_end():
    """A bar under F t: du/dt_end = F L/(E A); at a fixed time the equilibrium would not change."""
    study = ancf2d.sensitivity({
        "bodies": {"bar": {"geometry": h.line(2.0), "section": {"height": 0.1, "width": 0.1},
                           "material": {"E": 2e11, "nu": 0.3}, "element": h.element("cable", 1)}},
        "boundary_conditions": [{"type": "clamp", "at": "bar@0"}],
        "loads": [{"type": "force", "at": "bar@1", "value": [1e5, 0], "amplitude": {"type": "ramp", "t1": 10}}],
        "solver": {"type": "quasi_static", "t_end": 3}, "goal": {"probe": "end", "quantity": "ux"},
        "output": {"probes": {"end": "bar@1"}}}, ["solver.t_end"])
    assert study.rows[0].derivative == pytest.approx(1e4 * 2.0 / (2e11 * 0.01), rel=1e-6)


def test_relative_changes_of_a_peak_are_those_of_the_peak():
    """With a Kelvin-Voigt time, the peak of a mode goes with 1/(EI omega), so with EI^(-3/2).

    It is between the frequencies of the run; beside it, where it is but for 1e-5 of its width, it goes with EI^-1.501.
    """
    case = Path(__file__).parents[2] / "cases" / "modes" / "receptance.yaml"
    study = ancf2d.sensitivity(case, ["bodies.beam.section.EI"])
    assert study.rows[0].elasticity == pytest.approx(-1.5, rel=1e-4)


def test_euler_column():
    """mu P = pi^2 EI/(4 L^2) (Euler): the factor goes with EI, L^-2 and P^-1."""
    case = {**STRUT, "solver": {"type": "buckling", "modes": 2}, "goal": {"load_factor": 1}}
    study = ancf2d.sensitivity(case, ["bodies.strut.section.EI", "bodies.strut.geometry.end.0", "loads.push.value.0"])
    assert {row.method for row in study.rows} == {"exact"}
    assert study.goal == pytest.approx(np.pi**2 * 200.0 / (4 * 3.0**2) / 2.0, rel=1e-5)
    found = {row.path: row.elasticity for row in study.rows}
    assert found == pytest.approx({"bodies.strut.section.EI": 1.0, "bodies.strut.geometry.end.0": -2.0,
                                   "loads.push.value.0": -1.0}, abs=1e-5)


def test_a_column_between_approaching_ends():
    """EA mu u/L = pi^2 EI/L^2: the factor goes with EI, EA^-1, L^-1 and u^-1."""
    case = {**STRUT, "loads": [], "solver": {"type": "buckling", "modes": 1}, "goal": {"load_factor": 1},
            "boundary_conditions": [{"type": "pin", "at": "strut@0"},
                                    {"type": "prescribed", "at": "strut@1", "ux": -1e-6, "uy": 0}]}
    study = ancf2d.sensitivity(case, ["bodies.strut.section.EI", "bodies.strut.section.EA",
                                      "bodies.strut.geometry.end.0", "boundary_conditions.1.ux"])
    assert {row.method for row in study.rows} == {"exact"}
    assert study.goal == pytest.approx(np.pi**2 * 200.0 / (1e9 * 3.0 * 1e-6), rel=2e-5)
    assert {row.path.split(".")[-1]: row.elasticity for row in study.rows} == pytest.approx(
        {"EI": 1.0, "EA": -1.0, "0": -1.0, "ux": -1.0}, abs=1e-5)


def test_cantilever_frequency():
    """omega = 1.8751^2 sqrt(EI/(rhoA L^4)): powers 1/2, -1/2, -2; a small tip mass m adds -omega 2 m/(rhoA L)."""
    case = {**STRUT, "solver": {"type": "eigen", "modes": 2}, "goal": {"kind": "bending", "number": 1}}
    study = ancf2d.sensitivity(case, ["bodies.strut.section.EI", "bodies.strut.section.rhoA", "masses.0.mass",
                                      "bodies.strut.geometry.end.0"])
    omega = 1.8751040687**2 * np.sqrt(200.0 / (2.0 * 3.0**4))
    assert study.goal == pytest.approx(omega, rel=1e-5)
    found = {row.path: row for row in study.rows}
    assert {row.method for row in study.rows} == {"exact"}
    assert [found[f"bodies.strut.{key}"].elasticity for key in ("section.EI", "section.rhoA", "geometry.end.0")
            ] == pytest.approx([0.5, -0.5, -2.0], abs=1e-4)
    assert found["masses.0.mass"].derivative == pytest.approx(-0.5 * omega * 4.0 / (2.0 * 3.0), rel=1e-4)


def elastica(alpha2):
    """Return u/L, the tip deflection of an inextensible cantilever under a dead end load P, alpha2 = P L^2/EI.

    K(k) - F(phi, k) = alpha, k sin(phi) = 1/sqrt(2), u/L = 1 - 2 (E(k) - E(phi, k))/alpha (Bisshopp & Drucker 1945).
    """
    alpha = np.sqrt(alpha2)

    def phi(m):
        return np.arcsin(1 / np.sqrt(2 * m))
    m = brentq(lambda m: ellipk(m) - ellipkinc(phi(m), m) - alpha, 0.5 + 1e-12, 1 - 1e-12, xtol=1e-15, rtol=1e-15)
    return 1 - 2 * (ellipe(m) - ellipeinc(phi(m), m)) / alpha


def test_elastica():
    """d|u_y|/dP of the elastica, P L^2/EI = 4, to 1e-6."""
    L, EI, P = 3.0, 200.0, 4 * 200.0 / 9.0
    section = {"EA": 1e10, "kGA": 1e10, "EI": EI, "rhoA": 2.0, "rhoI": 1e-9}
    case = {**STRUT, "bodies": {"strut": {**STRUT["bodies"]["strut"], "section": section,
                                          "element": {"type": "reissner3", "count": 32}}},
            "loads": [{"name": "push", "type": "force", "at": "strut@1", "value": [0, -P]}],
            "solver": {"type": "static"}, "goal": {"probe": "tip", "quantity": "uy"}}
    (row,) = ancf2d.sensitivity(case, "loads.push.value.1").rows
    h = 1e-3
    slope = (8 * (elastica(4 + h) - elastica(4 - h)) - (elastica(4 + 2 * h) - elastica(4 - 2 * h))) / (12 * h)
    assert row.method == "exact"
    assert row.derivative == pytest.approx(L * slope * L**2 / EI, rel=1e-6)


def test_motion_of_an_oscillator():
    """A mass on a spring moves by u (cos(w t) - 1), w = sqrt(k/m), differentiated by hand."""
    case = {"bodies": {"mass": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"height": 0.1, "width": 0.1}, "element": {"type": "rigid", "mass": 2.0,
                                                                                      "inertia": 1.0}}},
            "springs": [{"name": "k", "type": "translational", "between": ["mass@0", [-1, 0]], "stiffness": 50.0,
                         "length": 0.8}],
            "boundary_conditions": [{"type": "roller", "at": "mass@0", "fixed": "y"},
                                    {"type": "roller", "at": "mass@1", "fixed": "y"}],
            "solver": {"type": "dynamic", "t_end": 1.0, "tolerance": 1e-9},
            "goal": {"probe": "mass", "quantity": "ux"}, "output": {"probes": {"mass": "mass@0"}}}
    study = ancf2d.sensitivity(case, ["springs.k.stiffness", "springs.k.length"])
    found, w, u = {row.path: row for row in study.rows}, 5.0, 0.2
    assert study.goal == pytest.approx(u * (np.cos(w) - 1), rel=1e-6)
    assert all(row.method == "exact" for row in study.rows)
    slope = -u * np.sin(w) / (2 * np.sqrt(50.0 * 2.0))
    assert found["springs.k.stiffness"].derivative == pytest.approx(slope, rel=1e-6)
    assert found["springs.k.length"].derivative == pytest.approx(1 - np.cos(w), rel=1e-6)
