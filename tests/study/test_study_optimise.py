"""Optimised numbers of a case: designs with closed forms, expressions of results, and the written case."""

import helpers as h
import numpy as np
import pytest
import scipy.optimize
from scipy.optimize import brentq, linprog, minimize

import ancf2d
from ancf2d.case.numbers import text_with
from ancf2d.errors import CaseError
from ancf2d.solvers import stress
from ancf2d.solvers.fields import FieldReader
from ancf2d.study.expressions import Measures, Vocabulary, mass_of, read_constraint, read_measure
from ancf2d.study.extremes import Evaluated
from ancf2d.study.record import Progress
from ancf2d.study.run import prepare, run_case, vocabulary

TEXT = """# a cantilever
bodies:
  beam:  # of steel
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.05, width: 0.1}   # height is to be found
    material: {E: 2.0e11, nu: 0, rho: 7800}
    element: {type: vallejo, count: 2}
masses:
  - {at: beam@0.5, mass: 3}
boundary_conditions:
  - {name: wall, type: clamp, at: beam@0}
loads:
  - {name: tip, type: force, at: beam@1, value: [0, -1000]}
solver: {type: linear_static}
goal: {probe: tip, quantity: uy}
output: {probes: {tip: beam@1}}
"""
HEIGHT = "bodies.beam.section.height"


@pytest.mark.parametrize("method", ["slsqp", pytest.param("trust-constr", marks=pytest.mark.slow)])
def test_lightest_cantilever(method):
    """tip.uy = -4 P L^3/(E b h^3): the smallest h that allows 10 mm is (4 P L^3/(E b 0.01))^(1/3)."""
    found = ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mass", "tip.uy >= -0.01", method=method)
    h = (4 * 1000.0 * 2.0**3 / (2e11 * 0.1 * 0.01)) ** (1 / 3)
    # sections shear, and the axis of the wall holds: a thousandth
    assert found.found
    assert found.rows[0].value == pytest.approx(h, rel=3e-3)
    assert found.minimum == pytest.approx(7800 * 0.1 * 2.0 * found.rows[0].value + 3.0, rel=1e-9)
    (constraint,) = found.constraints
    assert constraint["met"]
    assert constraint["excess"] == pytest.approx(0.0, abs=1e-6)
    assert found.evaluations <= 40
    assert not [text for text in found.warnings if "the search starts" in text]


def test_a_design_that_starts_at_a_bound_says_so():
    found = ancf2d.optimise(TEXT, {HEIGHT: (0.1, 0.2)}, "mass")
    assert f"{HEIGHT} is 0.05 in the case, beyond the bound 0.1: the search starts at 0.1" in found.warnings
    assert found.rows[0].start == 0.1


def test_the_slowest_throw():
    """The slowest throw of a body that is to be at x = 3 after 1 s has v_x = 3 and v_y = g."""
    case = {"bodies": {"stone": {"geometry": {"type": "line", "start": [0, 0], "end": [0.1, 0]},
                                 "element": {"type": "rigid", "mass": 1.0, "inertia": 1e-3},
                                 "section": {"height": 0.1, "width": 0.1}}},
            "loads": [{"type": "gravity", "value": [0, -9.81]}], "initial": {"velocity": [1.0, 2.0]},
            "solver": {"type": "dynamic", "t_end": 1.0, "dt": 0.1}, "output": {"probes": {"end": "stone@0.5"}}}
    found = ancf2d.optimise(case, {"initial.velocity.0": (0, 9), "initial.velocity.1": (0, 20)},
                            "end.vx^2 + end.vy^2", "end.ux >= 3")
    assert found.found
    assert [row.value for row in found.rows] == pytest.approx([3.0, 9.81], rel=1e-6)
    assert found.minimum == pytest.approx(9.0, rel=1e-6)


@pytest.mark.slow
def test_constraints_that_cannot_be_met_are_reported():
    """The largest height has 7800*0.03*0.1*2 + 3 = 49.8 kg; as mass is linear, the search ends at its start."""
    found = ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.03)}, "mass", ["mass >= 60", "wall.fy >= 0"])
    assert not found.found
    assert [one["met"] for one in found.constraints] == [False, True]
    assert found.as_json()["status"] == "failed"


def test_goals_that_no_number_changes_are_reported():
    massless = TEXT.replace(", rho: 7800", "").replace("masses:\n  - {at: beam@0.5, mass: 3}\n", "")
    (warning,) = ancf2d.optimise(massless, {HEIGHT: (0.02, 0.2)}, "mass").warnings
    assert warning == ("mass does not depend on any of the numbers that vary: no material or section of the case has a "
                       "mass")


def test_values_of_expressions():
    """Mass, reactions, section forces, the history of a path, and von Mises stress at the clamped end."""
    case = ancf2d.load(TEXT, ["solver={type: static, steps: 4}"])
    words = Vocabulary(case)
    texts = ["mass", "wall.fy + 2*goal", "tip.M", "max(tip.uy)", "min(tip.uy)", "max(N)", "sqrt(wall.m^2)",
             "max(abs(M))", "min(M) + max(2*abs(M))"]
    states = []
    model = run_case(case, progress=Progress(state=states.append)).model
    got = Measures([read_measure(t, "--minimise", words) for t in texts], case.case.goal)(model, states)
    uy = ancf2d.solve(case, states=False).value
    assert got[0] == pytest.approx(7800 * 0.05 * 0.1 * 2 + 3)
    assert got[1] == pytest.approx(1000.0 + 2 * uy)
    assert got[2] == pytest.approx(0.0, abs=1e-4)
    assert got[3] == pytest.approx(uy / 4, rel=1e-2)
    assert got[4] == pytest.approx(uy, rel=1e-9)
    assert got[6] == pytest.approx(2000.0, rel=1e-3)
    # M is negative: its largest magnitude is at the wall
    assert got[7] == pytest.approx(2000.0, rel=1e-3)
    assert got[8] == pytest.approx(got[7], rel=1e-9)
    assert mass_of(prepare(case)) == got[0]


@pytest.mark.parametrize(("text", "message"), [
    ("mas", "did you mean 'mass'"), ("tip.uz", "did you mean 'tip.uy'"),
    ("max(stres)", r"'stres' is unknown.*of a field over the bodies \(.*stress"),
    ("2*parameters.h", "in expressions the parameter is written h"),
    ("max(abs(M)*tip.x)", "over the bodies for M but over time for the other names: tip.x"),
    ("max(max(mass))", "cannot stand in each other"), ("max(tip.uy", "is missing"), ("goal +", "ends too early")])
def test_wrong_expressions_are_refused(text, message):
    with pytest.raises(CaseError, match=message):
        read_measure(text, "--minimise", Vocabulary(ancf2d.load(TEXT)))


def test_all_unknown_names_of_expressions_are_told_at_once():
    with pytest.raises(CaseError) as caught:
        ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mas + max(stres) + 2*tip.uz + mas",
                        "min(gaol + tip.ux*zeal) <= tip.uw")
    said = sorted(p.message.split(" is unknown")[0] for p in caught.value.problems)
    assert said == ["'gaol'", "'mas'", "'stres'", "'tip.uw'", "'tip.uz'", "'zeal'"]
    # below the first letters of the names
    assert {p.source_line[p.column - 1:][:2] for p in caught.value.problems} == {"ga", "ma", "st", "ti", "ze"}


def test_fields_that_materials_do_not_have_are_reported():
    case = ancf2d.load(TEXT, ["solver={type: static}", "bodies.beam.material.yield=1e9",
                              "bodies.beam.element.formulation=structural"])
    with pytest.raises(CaseError, match="energy is not available for a material that yields"):
        ancf2d.optimise(case, {HEIGHT: (0.02, 0.2)}, "max(energy)")


def test_a_constraint_compares_two_expressions():
    with pytest.raises(CaseError, match="no constraint"):
        ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mass", "tip.uy")
    with pytest.raises(CaseError) as caught:
        ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mass", "tpi.uy")
    assert [problem.message.partition(":")[0] for problem in caught.value.problems] == [
        "'tpi.uy' is unknown", "no constraint"]


def test_the_start_is_the_number_of_the_case_or_the_bound_beyond_which_it_is():
    # 0.02 does not survive the scaling to the first range
    for low in (0.005, 0.03):
        (row,) = ancf2d.optimise(TEXT, {HEIGHT: (low, 0.05)}, "mass", overrides={HEIGHT: 0.02}, iterations=1).rows
        assert row.start == max(0.02, low)


def test_all_errors_of_a_problem_are_reported_at_once():
    with pytest.raises(CaseError) as caught:
        ancf2d.optimise(TEXT, {"bodies.beam.section.heigth": (0.02, 0.2), HEIGHT: (0.2, 0.02)}, "mas",
                        ["tip.uy", "max(stress <= 1"])
    said = [problem.message for problem in caught.value.problems]
    for part in ("heigth", "0.2:0.02 is not a range", "'mas' is unknown", "no constraint", "is missing"):
        assert sum(part in one for one in said) == 1


def test_infeasible_problems_and_too_few_evaluations_are_distinguished():
    never = ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mass", "mass <= -1")
    assert never.message == "no values within the bounds were found that meet all constraints"
    longer = ancf2d.optimise(TEXT, {HEIGHT: (0.02, 0.2)}, "mass - 100*tip.uy", iterations=1)
    assert not never.found
    assert not longer.found
    assert "no convergence within 1 iteration" in longer.message


def test_sides_of_a_constraint_read_their_own_extremes():
    """The other side of a constraint needs no reading of extremes."""
    words = Vocabulary(ancf2d.load(TEXT))
    both, side, kind = read_constraint("max(stress) + 1 <= 2*max(N)", "--subject-to", words)
    assert [e.field for e in both.extremes.values()] == ["stress", "N"]
    assert [e.field for e in side.extremes.values()] == ["N"]
    assert kind == "<="


def test_varied_models_share_the_strains_of_unchanged_elements(monkeypatch):
    """With five heights, linear in between, the second one changes the elements in the first two of four quarters."""
    found = []
    monkeypatch.setattr(stress, "_of_class", lambda *given, make=stress._of_class: found.append(1) or make(*given))
    five = TEXT.replace("height: 0.05", "height: {s: [0, 0.25, 0.5, 0.75, 1], value: [0.05, 0.06, 0.05, 0.04, 0.03]}"
                        ).replace("count: 2", "count: 8")
    states = []
    model = run_case(ancf2d.load(five), progress=Progress(state=states.append)).model
    FieldReader(model, ("stress",))
    assert len(found) == 8
    other = ancf2d.load(five, [f"{HEIGHT}.value.1=0.061"])
    beside = prepare(other, model, for_differences=True)
    read = FieldReader(beside, ("stress",)).read(states[-1])["beam", "stress"]
    assert len(found) == 8 + 4
    # the same as that of a model of its own
    own = FieldReader(prepare(other), ("stress",)).read(states[-1])["beam", "stress"]
    assert read == pytest.approx(own, abs=1e-12 * np.abs(own).max())


def test_the_written_case_keeps_its_comments():
    case = ancf2d.load(TEXT)
    text, kept = text_with(case, {HEIGHT: 0.0625, "loads.tip.at": 0.75, "loads.tip.value.1": -500.0}, vocabulary())
    assert kept
    assert text == TEXT.replace("height: 0.05", "height: 0.0625").replace("force, at: beam@1,", "force, at: beam@0.75,"
                                                                          ).replace("-1000", "-500")
    whole, kept = text_with(ancf2d.load(case, ["solver.type=static"]), {HEIGHT: 0.0625}, vocabulary())
    assert not kept
    assert ancf2d.load(whole).case.bodies["beam"].section.height == 0.0625


def leaf(n, load, solver="linear_static"):
    """A cantilever of length 1 and width 0.05 with n heights, linear in between, and a load at its tip."""
    heights = {"s": np.linspace(0.0, 1.0, n).tolist(), "value": [0.02] * n}
    return {
        "bodies": {"leaf": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                            "section": {"height": heights, "width": 0.05},
                            "material": {"E": 2e11, "nu": 0.0, "rho": 7800.0},
                            "element": {"type": "vallejo", "count": 2 * (n - 1), "formulation": "structural",
                                        "shear_factor": 10}}},
        "boundary_conditions": [{"type": "clamp", "at": "leaf@0"}],
        "loads": [{"type": "force", "at": "leaf@1", "value": [0, -load]}],
        "solver": {"type": solver}, "goal": {"probe": "tip", "quantity": "uy"},
        "output": {"probes": {"tip": "leaf@1"}}}


def heights(n, low=0.002, high=0.06):
    return {f"bodies.leaf.section.height.value.{k}": (low, high) for k in range(n)}


def strong(n, load, stress):
    """Return mass and heights of the lightest leaf whose outer fibres bear 6 P (1 - s)/(b h^2) <= stress.

    h(s) >= sqrt(6 P (1 - s)/(b stress)) at the five places of each element where stresses are read, with heights that
    are linear between their values: a linear program.
    """
    s, at = np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, 8 * (n - 1) + 1)
    each = np.array([np.interp(at, s, one) for one in np.eye(n)]).T
    weights = np.gradient(s) * np.where((s == 0.0) | (s == 1.0), 0.5, 1.0)
    found = linprog(7800.0 * 0.05 * weights, A_ub=-each, b_ub=-np.sqrt(6 * load * (1 - at) / (0.05 * stress)),
                    bounds=[(0.002, 0.06)] * n)
    return found.fun, found.x


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 5])
def test_the_lightest_taper_of_given_strength(n):
    """At the optimum several points have the largest stress, where max(stress) has a kink."""
    found = ancf2d.optimise(leaf(n, 100.0), heights(n), "mass", "max(stress) <= 60e6")
    mass, h = strong(n, 100.0, 60e6)
    assert found.found
    assert found.gradients <= 25
    assert found.minimum == pytest.approx(mass, rel=1e-6)
    assert [row.value for row in found.rows] == pytest.approx(h, rel=1e-4)


@pytest.mark.slow
def test_the_strongest_taper_of_given_mass():
    """The minimum of the largest stress: the lightest taper for it has the given mass."""
    found = ancf2d.optimise(leaf(2, 100.0), heights(2), "max(stress)", "mass <= 5")
    assert found.found
    assert found.minimum > 0.0
    assert strong(2, 100.0, found.minimum)[0] == pytest.approx(5.0, rel=1e-5)


@pytest.mark.slow
def test_a_search_that_fails_continues_in_a_trust_region():
    """The first step makes the tip so thin that it hangs down, where derivatives say nothing about stiff tips."""
    found = ancf2d.optimise(leaf(3, 300.0, "static"), heights(3), "mass", "max(stress) <= 200e6")
    assert found.found
    # deflections shorten the arm of the load a little: nearly the lightest one of small deflections
    assert found.minimum == pytest.approx(strong(3, 300.0, 200e6)[0], rel=0.02)
    assert all(one["met"] for one in found.constraints)


@pytest.mark.slow
def test_a_step_to_a_collapsing_design_is_shortened():
    """Tip of a perfectly plastic cantilever: delta/delta_y = (5 - (3 + m) sqrt(3 - 2 m))/m^2 with m = P L/M_y.

    The first step from the thick start goes to the lower bound, at 1/8 of the width that carries the load.
    """
    case = {"bodies": {"beam": h.body(h.line(1.0), h.element("reissner3", 2), {"height": 0.1, "width": 0.1},
                                      {"E": 2e11, "nu": 0.3, "rho": 7850, "yield": 250e6})},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": {"type": "static", "steps": 1},
            "loads": [{"type": "follower_force", "at": "beam@1", "value": [0, -10e3]}],
            "output": {"probes": {"tip": "beam@1"}}}
    best = ancf2d.optimise(case, {"bodies.beam.section.width": (0.002, 0.1)}, "mass", "tip.uy >= -0.011")
    assert best.found

    def deflection(width):
        m = 10e3 / (250e6 * width * 0.1**2 / 6)
        return 250e6 * 2 / (3 * 2e11 * 0.1) * (5 - (3 + m) * np.sqrt(3 - 2 * m)) / m**2
    width = best.rows[0].value
    assert best.minimum == pytest.approx(7850 * 0.1 * width)
    assert width == pytest.approx(brentq(lambda w: deflection(w) - 0.011, 0.0165, 0.02), rel=0.03)
    # runs that fail count
    assert best.failed > 0
    assert best.evaluations == len(best.history) + best.failed


@pytest.mark.slow
def test_a_search_that_ends_too_early_is_restarted():
    """The lightest beam of a given frequency is that of at least this frequency. With == slsqp ends 6e-6 above it."""
    case = {**leaf(3, 1.0), "loads": [], "masses": [{"at": "leaf@1", "mass": 0.5}],
            "solver": {"type": "eigen", "modes": 1}, "goal": {"kind": "bending", "number": 1}}
    least, equal = (ancf2d.optimise(case, heights(3), "mass", f"goal {sign} 12") for sign in (">=", "=="))
    assert least.found
    assert equal.found
    assert equal.minimum == pytest.approx(least.minimum, rel=1e-7)


@pytest.mark.parametrize(("text", "parts"), [
    ("max(N)", 1), ("2*max(N) - 1", 1), ("max(N) - min(N)", 2), ("max(N)^2", 1), ("-max(N)", 0),
    ("3 - min(Q)*max(N)", 2), ("exp(-max(N))", 0)])
def test_rows_of_an_expression_of_extremes(text, parts):
    """The largest row is the expression, for increasing and decreasing extremes; decreasing ones have no rows."""
    rng, measure = np.random.default_rng(0), read_measure(text, "--minimise", Vocabulary(ancf2d.load(TEXT)))
    for number in (1, 2, 7, 20):
        places = {name: rng.normal(0.5, 1.0, number) for name in measure.extremes}
        places = {name: np.append(values, 2.0 if measure.extremes[name].largest else -2.0)
                  for name, values in places.items()}
        meaning = {name: values.max() if measure.extremes[name].largest else values.min()
                   for name, values in places.items()}
        met = Evaluated(measure, meaning, places)
        for most in (3, 100):
            found = met.parts(0, most)
            assert len(found) == parts
            for part in found:
                rows = met.rows(part)
                assert len(rows) == min(number + 1, most)
                assert rows.max() == met.value()


@pytest.mark.slow
def test_the_lightest_taper_is_that_of_the_beam_equation():
    """min of the mass at a given deflection u = 12 P/(E b) int x^2/h^3 dx under an end load, x from the tip.

    6 heights, linear between them, beside SciPy's minimum of the same integrals; within 40 gradients. Of all shapes
    h = c sqrt(x) is the lightest (Lagrange), which straight pieces come near to.
    """
    n, P, E, b, rho, u = 6, 100.0, 2e11, 0.05, 7800.0, 0.004
    s = np.linspace(0.0, 1.0, n)
    found = ancf2d.optimise(leaf(n, P), heights(n), "mass", f"goal >= {-u}")
    assert found.found
    assert found.gradients <= 40

    points, weights = np.polynomial.legendre.leggauss(20)
    at = ((s[:-1] + s[1:])[:, None] + np.diff(s)[:, None] * points).ravel() / 2
    w = (np.diff(s)[:, None] * weights).ravel() / 2

    def mass(h):
        return rho * b * w @ np.interp(at, s, h)

    def deflection(h):
        return 12 * P / (E * b) * w @ ((1 - at)**2 / np.interp(at, s, h)**3)

    own = minimize(lambda h: mass(h / 100), np.full(n, 2.0), method="SLSQP", bounds=[(0.2, 6.0)] * n,
                   constraints={"type": "ineq", "fun": lambda h: 1.0 - deflection(h / 100) / u},
                   options={"ftol": 1e-12, "maxiter": 500})
    assert own.success
    assert found.minimum == pytest.approx(own.fun, rel=2e-3)
    h = np.array([row.value for row in found.rows])
    # the mass hardly feels the last heights
    assert h[:-2] == pytest.approx(own.x[:-2] / 100, rel=0.02)
    # of all beams with h = c sqrt(x) the one that bends by u: c^3 = 8 P/(E b u)
    parabola = rho * b * (8 * P / (E * b * u)) ** (1 / 3) * 2 / 3
    assert parabola * 0.999 < found.minimum < parabola * 1.03


def test_infeasible_constraints_end_the_search(monkeypatch):
    """No height lifts the tip of a cantilever under a load down; at its bound, derivatives promise no improvement.

    The optimiser is called once. How many points it tries before it ends depends on round-off.
    """
    calls = []
    monkeypatch.setattr(scipy.optimize, "minimize", lambda *args, **more: calls.append(args) or minimize(*args, **more))
    found = ancf2d.optimise({
        "bodies": {"beam": {"geometry": h.line(2.0), "section": {"height": 0.1, "width": 0.1},
                            "material": {"E": 2e11, "nu": 0.3, "rho": 7800}, "element": h.element("reissner3", 2)}},
        "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
        "loads": [{"type": "force", "at": "beam@1", "value": [0, -5e5]}], "solver": {"type": "static"},
        "output": {"probes": {"tip": "beam@1"}}}, {"bodies.beam.section.height": (0.05, 0.2)}, "mass", "tip.uy >= 0.5")
    assert not found.found
    assert found.rows[0].at_bound == "high"
    assert len(calls) == 1
