"""Derivatives of limit points, ends of paths, frequency responses, damped and equal frequencies."""

import cmath
import math

import numpy as np
import pytest

import ancf2d
from ancf2d.case.numbers import number_at
from ancf2d.errors import ComputationError

BASE, RISE, EA = 1.0, 0.3, 2e3
TRUSS = {
    "bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [BASE, RISE]},
                       "section": {"EA": EA, "kGA": EA, "EI": 1e3}, "element": {"type": "reissner2", "count": 1}}},
    "boundary_conditions": [{"name": "foot", "type": "pin", "at": "bar@0"},
                            {"name": "guide", "type": "roller", "at": "bar@1", "fixed": "x"}],
    "loads": [{"name": "push", "type": "force", "at": "bar@1", "value": [0, -1]}],
    "output": {"probes": {"top": "bar@1"}},
}


def differences(f, x, h):
    """Return f'(x) of fourth order."""
    return (8 * (f(x + h) - f(x - h)) - (f(x + 2 * h) - f(x - 2 * h))) / (12 * h)


def truss_at_limit(base, rise):
    """Return P/EA and the fall at the first limit point of a von Mises truss of one bar: l^3 = b^2 L."""
    L = math.hypot(base, rise)
    high = math.sqrt((base**2 * L) ** (2 / 3) - base**2)
    return high * (1 / math.hypot(base, high) - 1 / L), high - rise


@pytest.mark.slow
def test_limit_points_of_a_truss():
    """lambda' = -psi^T dR/dp / psi^T dR/dt, and where the limit points are: the closed solution, differentiated."""
    solver = {"type": "static", "method": "arc_length", "until": {"limit_points": 2}}
    factor, fall = ([differences(lambda x, part=part, k=k: truss_at_limit(*np.where(np.arange(2) == k, x, (BASE, RISE)))
                                 [part], (BASE, RISE)[k], 1e-3) for k in range(2)] for part in range(2))
    wanted = {
        "of the first": ({"limit_point": 1}, [EA * factor[0], EA * factor[1], truss_at_limit(BASE, RISE)[0]]),
        "place of it": ({"limit_point": 1, "probe": "top", "quantity": "uy"}, [fall[0], fall[1], 0.0]),
        # symmetric to the first about the line of feet
        "at the end": ({"probe": "top", "quantity": "uy"}, [-fall[0], -fall[1] - 2.0, 0.0])}
    paths = ["bodies.bar.geometry.end.0", "bodies.bar.geometry.end.1", "bodies.bar.section.EA"]
    for name, (goal, exact) in wanted.items():
        found = {row.path: row for row in ancf2d.sensitivity({**TRUSS, "solver": solver, "goal": goal}, paths).rows}
        assert {row.method for row in found.values()} == {"exact"}, name
        assert [found[p].derivative for p in paths] == pytest.approx(exact, rel=1e-8, abs=1e-12), name


def test_the_end_of_a_path_at_a_value_of_a_probe():
    """With the fall u given, the load P = EA y (1/l - 1/L) at y = rise + u changes, with all that depends on it."""
    u = -0.4
    solver = {"type": "static", "method": "displacement", "until": {"probe": "top", "quantity": "uy", "reaches": u}}

    def load(base, rise, u):
        return EA * (rise + u) * (1 / math.hypot(base, rise + u) - 1 / math.hypot(base, rise))
    case = {**TRUSS, "solver": solver, "goal": {"reaction": "foot", "quantity": "fy"}}
    study = ancf2d.sensitivity(case, ["bodies.bar.geometry.end.0", "bodies.bar.geometry.end.1", "solver.until.reaches"])
    found = {row.path.rpartition(".")[2]: row.derivative for row in study.rows if row.method == "exact"}
    assert found == pytest.approx({"0": differences(lambda x: load(x, RISE, u), BASE, 1e-3),
                                   "1": differences(lambda x: load(BASE, x, u), RISE, 1e-3),
                                   "reaches": differences(lambda x: load(BASE, RISE, x), u, 1e-3)}, rel=1e-8)


def test_the_end_of_a_path_at_a_load_factor():
    """P = EA y (1/l - 1/L) of y = rise + u: the fall u changes by 1/P'(u)."""
    u = -0.05

    def load(u):
        return EA * (RISE + u) * (1 / math.hypot(BASE, RISE + u) - 1 / math.hypot(BASE, RISE))
    case = {**TRUSS, "solver": {"type": "static", "method": "arc_length", "until": {"load_factor": load(u)}},
            "goal": {"probe": "top", "quantity": "uy"}}
    row, = ancf2d.sensitivity(case, ["solver.until.load_factor"]).rows
    assert row.method == "exact"
    assert row.derivative == pytest.approx(1 / differences(load, u, 1e-3), rel=1e-8)


def test_line_loads_within_elements_grow_with_the_factor_at_the_end_of_a_path():
    """M between nodes contains the line load at its factor there, which depends on a number: differences of paths."""
    case = ancf2d.load({
        "bodies": {"arch": {"geometry": {"type": "arc", "center": [0, -1.0], "radius": 1.1, "from": 2.1, "to": 1.0},
                            "section": {"EA": 1.5e4, "EI": 1.1}, "element": {"type": "cable", "count": 4}}},
        "boundary_conditions": [{"type": "pin", "at": "arch@0"}, {"type": "pin", "at": "arch@1"}],
        "loads": [{"name": "w", "type": "distributed", "on": "arch", "value": [0, -9.0]}],
        "solver": {"type": "static", "method": "displacement", "tolerance": 1e-12,
                   "until": {"probe": "top", "quantity": "uy", "reaches": -0.05}},
        "goal": {"probe": "beside", "quantity": "M"}, "output": {"probes": {"top": "arch@0.5", "beside": "arch@0.3"}}})
    row, = ancf2d.sensitivity(case, ["solver.until.reaches"]).rows
    expected = differences(lambda x: ancf2d.solve(case, [f"{row.path}={x!r}"], states=False).value, row.value, 1e-4)
    assert row.method == "exact"
    assert row.derivative == pytest.approx(expected, rel=1e-6)


k, c, m, F = 50.0, 3.0, 2.0, 4.0
OSCILLATOR = {
    "bodies": {"mass": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                        "section": {"height": 0.1, "width": 0.1},
                        "element": {"type": "rigid", "mass": m, "inertia": 1.0}}},
    "springs": [{"name": "k", "type": "translational", "between": ["mass@0", [-1, 0]], "stiffness": k, "length": 1.0,
                 "damping": c}],
    "boundary_conditions": [{"type": "roller", "at": "mass@0", "fixed": "y"},
                            {"type": "roller", "at": "mass@1", "fixed": "y"}],
    "loads": [{"name": "shaker", "type": "force", "at": "mass@0", "value": [F, 0]}],
    "output": {"probes": {"mass": "mass@0"}},
}
OF_OSCILLATOR = ["springs.k.stiffness", "springs.k.damping", "bodies.mass.element.mass", "loads.shaker.value.0"]


def slopes_of(f):
    """Return the derivatives of f(k, c, m, F)."""
    at = [k, c, m, F]
    return [differences(lambda x, i=i: f(*at[:i], x, *at[i + 1:]), at[i], 1e-3 * at[i]) for i in range(4)]


@pytest.mark.slow_rows("phase")
@pytest.mark.parametrize("part", ["abs", "phase"])
def test_response_of_an_oscillator(part):
    """H = F/(k - m w^2 + i c w) at 0.7 Hz."""
    goal = {"input": "shaker", "probe": "mass", "quantity": "ux", "hz": 0.7, "part": part}
    study = ancf2d.sensitivity({**OSCILLATOR, "goal": goal, "solver": {
        "type": "frequency_response", "inputs": ["shaker"], "frequencies": [0.2, 0.7]}}, OF_OSCILLATOR)
    w, of = 2 * math.pi * 0.7, {"abs": abs, "phase": cmath.phase}[part]
    exact = slopes_of(lambda k, c, m, F: of(F / (k - m * w**2 + 1j * c * w)))
    found = {row.path: row for row in study.rows}
    assert {row.method for row in study.rows} == {"exact"}
    assert [found[p].derivative for p in OF_OSCILLATOR] == pytest.approx(exact, rel=1e-8, abs=1e-12)


def test_the_highest_response_of_a_range():
    """The peak F/(c sqrt(k/m - c^2/(4 m^2))) lies between the stored frequencies."""
    goal = {"input": "shaker", "probe": "mass", "quantity": "ux"}
    study = ancf2d.sensitivity({**OSCILLATOR, "goal": goal, "solver": {
        "type": "frequency_response", "inputs": ["shaker"], "from": 0.1, "to": 3.0, "points": 10}}, OF_OSCILLATOR)
    exact = slopes_of(lambda k, c, m, F: F / (c * math.sqrt(k / m - (c / m) ** 2 / 4)))
    found = {row.path: row for row in study.rows}
    assert [found[p].derivative for p in OF_OSCILLATOR] == pytest.approx(exact, rel=1e-7)


def test_frequency_of_a_damped_oscillator():
    """The frequency is sqrt(k/m - c^2/(4 m^2)), the imaginary part of a complex eigenvalue."""
    case = {**OSCILLATOR, "loads": [], "solver": {"type": "eigen", "modes": 1, "damped": True}}
    modes = ancf2d.solve(case, states=False).summary["frequencies"]
    case["goal"] = {"kind": modes[0]["kind"], "number": modes[0]["number"]}
    found = {row.path: row.derivative for row in ancf2d.sensitivity(case, OF_OSCILLATOR[:3]).rows}
    exact = slopes_of(lambda k, c, m, F: math.sqrt(k / m - (c / m) ** 2 / 4))
    assert [found[p] for p in OF_OSCILLATOR[:3]] == pytest.approx(exact[:3], rel=1e-8)


ARM = """
bodies:
  arm:
    geometry: {type: line, start: [0, 0], end: [0.6, 0.1]}
    section: {height: 0.03, width: 0.02}
    material: {E: 2e9, nu: 0.3, rho: 1200, damping: {kelvin_voigt: 1e-4}}
    element: {type: vallejo, count: 2}
boundary_conditions:
  - {name: base, type: prescribed, at: arm@0, ux: 0, angle: 0, uy: 0.01}
springs:
  - {name: stay, type: translational, between: [arm@1, [0.7, 0.6]], stiffness: 300, length: 0.4, damping: 4}
loads:
  - {name: push, type: force, at: arm@1, value: [1, 6]}
  - {name: weight, type: gravity, value: [0, -9.81]}
solver: {type: frequency_response, inputs: [push, base], frequencies: [9], about: static}
goal: {input: base, probe: tip, quantity: vy, hz: 9}
output: {probes: {tip: arm@1}}
"""


def test_response_about_an_equilibrium_that_moves(tmp_path):
    """Inputs, matrices and the equilibrium itself change with a number: differences of whole solves."""
    (tmp_path / "arm.yaml").write_text(ARM)
    case = ancf2d.load(tmp_path / "arm.yaml")
    for row in ancf2d.sensitivity(case, ["bodies.arm.material.damping.kelvin_voigt", "springs.stay.length"]).rows:
        assert row.method == "exact"
        variable = number_at(case, row.path)
        expected = differences(lambda x, v=variable: ancf2d.solve(case, [v.override(x)], states=False).value,
                               variable.value, 1e-3 * abs(variable.value))
        assert row.derivative == pytest.approx(expected, rel=1e-6), row.path


def twins(**more):
    """Return two alike struts side by side, clamped at one end, whose lowest values are equal in pairs."""
    bodies = {name: {"geometry": {"type": "line", "start": [0, y], "end": [3, y]},
                     "section": {"EA": 1e9, "kGA": 1e9, "EI": 200.0, "rhoA": 2.0, "rhoI": 1e-9},
                     "element": {"type": "reissner3", "count": 4}} for name, y in (("a", 0), ("b", 1))}
    return {"bodies": bodies, "boundary_conditions": [{"type": "clamp", "at": "a@0"}, {"type": "clamp", "at": "b@0"}],
            "loads": [{"name": f"push {name}", "type": "force", "at": f"{name}@1", "value": [-2, 0]}
                      for name in bodies], "output": {"probes": {"tip": "a@1"}}, **more}


@pytest.mark.parametrize(("solver", "goal", "power"), [
    ({"type": "eigen", "modes": 3}, {"kind": "bending"}, 0.5),
    ({"type": "buckling", "modes": 3}, {}, 1.0)], ids=["frequencies", "load factors"])
def test_equal_frequencies_split_to_both_sides(solver, goal, power):
    """Both are powers of EI. EI of one strut moves one of the two: the lower one has a kink, 0 or the whole."""
    case = twins(solver=solver, goal={**goal, "number" if goal else "load_factor": 1})
    row, = ancf2d.sensitivity(case, ["bodies.a.section.EI"]).rows
    whole = power * ancf2d.solve(case, states=False).value / 200.0
    assert row.method == "exact"
    assert row.derivative == pytest.approx(0.5 * whole, rel=1e-6)
    assert row.error == pytest.approx(0.5 * whole, rel=1e-6)


def test_equal_frequencies_that_stay_equal():
    """A height shared by both struts moves both of the equal frequencies, as if there were one."""
    case = twins(solver={"type": "eigen", "modes": 3}, goal={"kind": "bending", "number": 2}, loads=[],
                 parameters={"thick": 0.01})
    for body in case["bodies"].values():
        del body["section"]
        body |= {"section": {"height": "thick", "width": 0.1}, "material": {"E": 2e11, "nu": 0.3, "rho": 7800}}
    row, = ancf2d.sensitivity(case, ["parameters.thick"]).rows
    assert row.elasticity == pytest.approx(1.0, abs=1e-3)
    assert row.error <= 1e-6 * abs(row.derivative)
    # of the last pair there may be a third one that is not computed
    with pytest.raises(ComputationError, match=r"there may be more than solver\.modes"):
        ancf2d.sensitivity(case | {"solver": {"type": "eigen", "modes": 2}}, ["parameters.thick"])


@pytest.mark.slow
def test_section_forces_of_responses_about_a_bent_state():
    """M of a response of a bent cantilever is the same where E, rho and what bends it are all scaled; its width scales
    E and rho alike.
    """
    case = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"height": 0.02, "width": 0.05},
                                "material": {"E": 1e8, "nu": 0.3, "rho": 1000},
                                "element": {"type": "reissner3", "count": 4}}},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
            "loads": [{"name": "bend", "type": "force", "at": "beam@1", "value": [0, -8]},
                      {"name": "push", "type": "force", "at": "beam@1", "value": [0, 1]}],
            "solver": {"type": "frequency_response", "inputs": ["push"], "frequencies": [3.0], "about": "static"},
            "goal": {"input": "push", "probe": "mid", "quantity": "M", "hz": 3.0, "part": "re"},
            "output": {"probes": {"mid": "beam@0.63"}}}
    study = ancf2d.sensitivity(case, ["bodies.beam.material.E", "bodies.beam.material.rho", "loads.bend.value.1",
                                      "bodies.beam.section.width"])
    found = {row.path.rpartition(".")[2]: row for row in study.rows}
    assert {row.method for row in study.rows} == {"exact"}
    E, rho, bend, width = (found[name].elasticity for name in ("E", "rho", "1", "width"))
    assert E + rho + bend == pytest.approx(0.0, abs=3e-4)
    assert E + rho == pytest.approx(width, abs=3e-4)
    assert all(abs(row.error * row.value) < 1e-3 * abs(study.goal) for row in study.rows)


def test_round_off_of_a_stiff_state_is_part_of_the_error():
    """A chain of given EA/(rhoA g L), EI/(rhoA g L^3) swings at c sqrt(g/L): powers of g, EA and EI add up to 1/2.

    The last digits of its state are forces of 1e-8, which change with g as much as the weight does over short steps.
    """
    case = {"bodies": {"chain": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                 "section": {"EA": 1e8, "kGA": 1e8, "EI": 1e-6, "rhoA": 1},
                                 "element": {"type": "cable", "count": 16}}},
            "boundary_conditions": [{"type": "pin", "at": "chain@0"}],
            "loads": [{"type": "gravity", "value": [0, -9.81]}],
            "solver": {"type": "eigen", "about": "static", "modes": 1}, "goal": {"kind": "bending", "number": 1}}
    rows = ancf2d.sensitivity(case, ["loads.0.value.1", "bodies.chain.section.EA", "bodies.chain.section.EI"]).rows
    found = {row.path.split(".")[-1]: row for row in rows}
    omega = ancf2d.solve(case).summary["frequencies"][0]["omega"]
    assert found["1"].error <= 1e-6 * found["1"].derivative * -1.0
    unknown = sum(row.error * abs(row.value) for row in rows) / omega
    assert abs(sum(row.elasticity for row in rows) - 0.5) <= 5 * unknown
    assert found["1"].elasticity == pytest.approx(0.5 - found["EI"].elasticity, abs=1e-6)
