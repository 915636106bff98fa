"""Motions that cannot continue: states are kept, and violated assumptions are reported."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import helpers as h
import numpy as np
import pytest
from motions import GRAVITY, RUBBER, Ride, rod

import ancf2d
from ancf2d.case.schema.amplitudes import Expression
from ancf2d.errors import ComputationError
from ancf2d.kernels.motion.state import COUNT, NOT_FINITE, NUMBERS, SINGULAR
from ancf2d.model.timing import Signal
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.motion.estimate import DOUBLE, LEVELS, SAFETY, TENFOLD, Estimate
from ancf2d.solvers.motion.failures import failure, other_method
from ancf2d.solvers.motion.integrators import INTEGRATORS
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state import State
from ancf2d.study.run import load, run_case

SWING = {"type": "expression", "value": "0.8*(1-cos(6*t))"}


def followed(bodies, t_end: float, method: str, **scene) -> tuple[list[State], ComputationError | None]:
    """Return the states of a motion, twenty if it succeeds, and the error that ended it."""
    how = {"dt": 5e-4, "estimate": False} if method in ("generalized_alpha", "energy_momentum") else {"tolerance": 1e-6}
    model = h.build(bodies, {"type": "dynamic", "t_end": t_end, "method": method, **how},
                    output={"interval": t_end / 20}, **scene)
    states: list[State] = []
    try:
        for state in solve(model):
            states.append(state)
    except ComputationError as error:
        return states, error
    return states, None


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "energy_momentum"])
def test_a_section_that_inverts_at_its_support_ends_the_motion(method: str) -> None:
    """A rod too soft to follow its driven end: r_y there shrinks to zero and changes sign."""
    scene = {"bc": [{"type": "pin", "at": "a@0"}, {"type": "prescribed", "at": "a@0", "angle": SWING}],
             "loads": GRAVITY}
    states, error = followed({"a": rod("vallejo", 2)}, 0.4, method, **scene)
    assert error is not None
    assert "a@0" in error.failure.reason
    assert "is inverted" in error.failure.reason
    assert states[-1].t > 0.3
    _, error = followed({"a": rod("vallejo", 2, E=100 * RUBBER["E"])}, 0.4, method, **scene)
    assert error is None


@pytest.mark.parametrize("level", range(LEVELS))
def test_a_motion_has_no_estimate_if_a_coarser_one_fails_before_its_first_state(level: int) -> None:
    run = Run(model := h.build({"a": rod("cable", 2)}, {"type": "dynamic", "t_end": 0.2, "tolerance": 1e-6},
                               loads=GRAVITY, bc=[{"type": "pin", "at": "a@0"}]), model.case.solver)
    assert run.estimate is not None
    run.estimate.coarse[level].failed = ComputationError("the forces are no longer finite")
    *_, last = run.states()
    assert last.report["accuracy"]["estimate"] is None
    assert any("could not be computed (the forces are no longer finite)" in w for w in last.warnings)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha", "RK45"])
def test_states_before_a_failure_are_not_lost(method: str) -> None:
    fading = {"type": "expression", "value": "sqrt(0.1-t)"}
    load = {"type": "force", "at": "a@1", "value": [0, 0.1], "amplitude": fading}
    states, error = followed({"a": rod("cable", 1)}, 0.2, method, bc=[{"type": "pin", "at": "a@0"}], loads=[load])
    assert error is not None
    assert "sqrt" in error.failure.reason
    np.testing.assert_allclose([s.t for s in states[:10]], 0.01 * np.arange(10), atol=1e-12)


def test_a_motion_so_large_that_strains_are_lost_is_reported_to_grow() -> None:
    """Positions have 16 digits, so beyond 1e9 times the size of a model hardly any are left for strains."""
    model = h.build({"a": rod("cable", 1)}, {"type": "dynamic", "t_end": 1.0, "dt": 0.01}, loads=GRAVITY)
    motion = Run(model, model.case.solver)
    motion.begin()
    for far, words in ((1e6, "the matrix of a step is singular"), (1e10, "the motion grows without bound")):
        motion.stepper.s.z[:] = far
        assert words in failure(motion.stepper, SINGULAR).failure.reason


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_a_loop_that_spins_a_section_up_ends_the_motion(method: str) -> None:
    """Steps of less than a turn would continue for hours: the motion ends at an unreasonable rate."""
    spun = {"type": "moment", "at": "a@0", "value": 1, "amplitude": {"type": "expression", "value": "1 + root.omega"}}
    model = h.build({"a": rod("reissner3", 1)}, {"type": "dynamic", "method": method, "t_end": 100.0},
                    bc=[{"type": "pin", "at": "a@0"}], loads=[spun], output={"probes": {"root": "a@0"}})
    with pytest.raises(ComputationError, match="grows without bound: it has become faster than 1e"):
        list(Run(model, model.case.solver).states())


def test_a_resumed_motion_still_reports_inverted_elements() -> None:
    """Rubber under an impulse that throws its end through its wall before the checkpoint."""
    hit = [{"type": "force", "at": "a@1", "value": [-3e3, 0]}]
    rubber = h.body(h.line(0.1), h.element("vallejo", 2), {"height": 0.1, "width": 0.1},
                    {"E": 1e4, "nu": 0.3, "rho": 1e3})
    model = h.build({"a": rubber}, {"type": "dynamic", "t_end": 0.02, "dt": 1e-4, "method": "newmark",
                                    "estimate": False},
                    bc=[{"type": "clamp", "at": "a@0"}], loads=hit, output={"interval": 0.001})
    states = list(solve(model))
    told = [w for w in states[-1].warnings if "is inverted" in w]
    assert told
    *_, last = solve(model, states[-2].checkpoint)
    assert told == [w for w in last.warnings if "is inverted" in w]


def estimate_of(fine: float, tolerance: float, steps: int, asked: bool = True, growth: float = 10.0,
                driven: str | None = None, method: str = "radau5", obstacle: bool = False) -> Estimate:
    """An estimate whose levels differ by ``fine`` and ``growth`` times that, with the largest displacement 1.

    A support is ``driven``, or an ``obstacle``. Ten times the tolerance lengthens steps by 10^(1/4), as errors of
    order 4 in a step do.
    """
    signals = [] if driven is None else [Signal(Expression(driven))]
    model = SimpleNamespace(extent=1.0, sided=False, case=SimpleNamespace(
        accuracy=None, initial=None, solver=SimpleNamespace(tolerance=tolerance if asked else None)),
        contacts=[SimpleNamespace(hard=False, signal=tuple(signals))] if obstacle else [])
    numbers = np.zeros(NUMBERS)
    numbers[COUNT] = steps
    found = Estimate.__new__(Estimate)
    found.stepper = SimpleNamespace(model=model, tolerance=tolerance, s=SimpleNamespace(numbers=numbers), t=1.0,
                                    signals=signals, driving=range(len(signals)), method=INTEGRATORS[method])
    found.made = np.array([[1.0, steps / TENFOLD ** (level / 4)] for level in range(1, 1 + LEVELS)])
    found.factor, found.order, found.failed, found.levels = TENFOLD, 1, "", LEVELS
    found.largest, found.moved = np.array([[fine], [growth * fine]]), np.ones(1)
    return found


@pytest.mark.parametrize(("growth", "share"), [(2.0**5, 1 / 7), (2.0**4.2, 1 / (2**2.6 - 1)), (2.0**3.5, 1.0),
                                                (2.0, 1.0), (0.5, 1.0)])
def test_fixed_steps_assume_half_of_the_order_of_the_method(growth: float, share: float) -> None:
    """Radau's order is 5; steps of dt, 2 dt and 4 dt."""
    found = estimate_of(1e-4, 1e-5, 773, growth=growth)
    found.factor, found.made = DOUBLE, np.array([[1.0, 773 / 2], [1.0, 773 / 4]])
    assert found.report()["estimate"] == pytest.approx(SAFETY * 1e-4 * share, rel=1e-2)


# differences that shrink tenfold, of order 4 in steps that are 10^(1/4) times as long, by the error of order 2.5
LEFT = 10.0**(2.5 / 4) - 1.0


@pytest.mark.parametrize(("fine", "words"), [
    (LEFT * 9e-5, []),
    (LEFT * 1.1e-4, ["the tolerance is missed", "11 times", "tolerance of about 5e-06 for an error of about 6e-05"]),
    (LEFT * 5e-3, ["the tolerance is missed", "add up. Use a tolerance of about 2e-07 for an error of about 0.0001,"]),
    (LEFT * 8e-2, ["the tolerance is missed", "8000 times the tolerance 1e-05", "sensitive to its initial state"])])
def test_a_missed_tolerance_is_reported(fine: float, words: list[str]) -> None:
    """Errors of 773 steps of 1e-5 add up to 7.7e-3 without growth."""
    said = estimate_of(fine / SAFETY, 1e-5, 773).warnings()
    assert not estimate_of(fine / SAFETY, 1e-5, 773, asked=False).warnings()
    assert len(said) == bool(words)
    assert all(word in said[0] for word in words)


def test_errors_as_large_as_the_motion_are_reported_with_the_default_tolerance() -> None:
    (said,) = estimate_of(LEFT * 0.2 / SAFETY, 1e-6, 773, asked=False).warnings()
    assert "the estimated error is 0.2 of the largest displacements" in said
    assert "sensitive to its initial state" in said


@pytest.mark.slow
def test_the_advice_for_errors_that_add_up_reaches_the_error_that_it_names() -> None:
    """A force over ten elements: errors add up at each node, so the warning stays with every tolerance, not with an
    accuracy.
    """
    case = Path(__file__).parents[2] / "cases" / "dynamic" / "moving_force.yaml"
    given = {"solver.method": "radau5", "solver.tolerance": 1e-6, "expected": None}
    (said,) = ancf2d.solve(case, given, states=False).warnings
    found = re.search(r"a tolerance of about (\S+) for an error of about (\S+), or --accuracy with a goal", said)
    assert found is not None
    tolerance, error = map(float, found.groups())
    assert error <= 1e-5
    summary = ancf2d.solve(case, given | {"solver.tolerance": tolerance}, states=False).summary
    assert summary["accuracy"]["estimate"] <= 1.5 * error
    reached = ancf2d.solve(case, given, accuracy=1e-4, states=False)
    assert reached.accuracy["achieved"]
    assert reached.warnings == []


def test_no_tolerance_far_below_the_compared_levels_is_recommended() -> None:
    """Errors that grow by 1.8 per level (power 0.26) would require 1e-5 (10/100)^(1/0.26) = 1.2e-9."""
    (said,) = estimate_of(1e-3 * (10.0**0.255 - 1.0) / SAFETY, 1e-5, 773, growth=10.0**0.255).warnings()
    assert "Use a tolerance of about 1e-07" in said


def test_a_four_bar_with_a_sudden_start_reports_that_it_misses_its_tolerance() -> None:
    """The driven point is the middle of the crank, the tolerance 1e-5.

    Tried on the shipped four-bar, driven there: its own gradual start keeps the tolerance (1.4e-5), also with flexible
    members (1.1e-5); a start at 30 rad/s misses it with every mesh of the coupler and every end of the motion
    (1.4e-2 to 1.1e-1), with a thin crank as well (2.2e-2).
    """
    loaded = load(Path(__file__).parents[2] / "cases" / "dynamic" / "four_bar.yaml", [
        "boundary_conditions.motor.at=crank@0.5", "solver.tolerance=1e-5", "solver.t_end=0.05",
        "boundary_conditions.motor.angle={type: expression, value: 30*t}", "bodies.coupler.element.count=4"])
    summary = run_case(loaded).summary
    assert summary["status"] == "converged"
    assert summary["accuracy"]["estimate"] > 1e-3
    (said,) = [w for w in summary["warnings"] if w.startswith("the tolerance is missed")]
    assert "times the tolerance 1e-05" in said


def test_a_tolerance_missed_at_all_levels_gets_advice_to_resolve_vibrations() -> None:
    (said,) = estimate_of(4e-3, 1e-5, 773, growth=1.1).warnings()
    assert "fast vibrations" in said
    assert "use a larger tolerance" in said
    assert "add up" not in said


@pytest.mark.parametrize(("method", "told"), [("hht", True), ("radau5", False), ("radau9", False)])
def test_the_advice_for_methods_of_low_order_names_a_better_one(method: str, told: bool) -> None:
    for growth in (1.1, 10.0):
        (said,) = estimate_of(4e-3, 1e-5, 773, growth=growth, method=method).warnings()
        assert ("Method radau5 has a smaller error with fewer steps" in said) == told


@pytest.mark.parametrize(("angle", "told"), [("30*t", True), ("30*t^2", False), (None, False)])
def test_a_prescribed_motion_that_starts_with_a_jump_is_named_as_a_cause(angle: str | None, told: bool) -> None:
    (said,) = estimate_of(LEFT * 4e-3, 1e-5, 773, driven=angle).warnings()
    assert ("begins at full speed" in said) == told
    (said,) = estimate_of(LEFT * 4e-3, 1e-5, 773, driven=angle, obstacle=True).warnings()
    assert "begins at full speed" not in said


@pytest.mark.parametrize("size", [np.nan, np.inf, 1e200])
def test_states_that_are_not_finite_are_reported_without_numpy_warnings(size: float) -> None:
    """Numpy's warnings are errors in tests: a load that depends on angles and squares of such a state raises none."""
    told = {"type": "expression", "value": "1 + tip.uy^2 + tip.theta"}
    stepper = Ride({"bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}],
                    "loads": [{"type": "force", "at": "a@1", "value": [0, 1], "amplitude": told}],
                    "output": {"probes": {"tip": "a@1"}}}, 0.1, tolerance=1e-4).start().stepper
    for x in (stepper.s.z, stepper.s.v, stepper.s.a, stepper.w.x):
        x[:] = size
    try:
        found = failure(stepper, NOT_FINITE)
    except ComputationError as error:
        found = error
    assert any(words in str(found) for words in ("no longer finite", "grows without bound", "has no value"))


@pytest.mark.parametrize(("method", "friction", "said"), [
    ("generalized_alpha", 0.0, True), ("generalized_alpha", 0.3, False), ("radau5", 0.0, False)])
def test_contact_without_friction_recommends_another_method(method, friction, said):
    rod = {"geometry": h.line(1.0), "element": {"type": "rigid", "mass": 1.0, "inertia": 0.1}}
    model = h.build({"rod": rod}, {"type": "dynamic", "t_end": 1, "method": method},
                    obstacles={"floor": {"type": "half_plane", "through": [0, -1], "normal": [0, 1]}},
                    contacts=[{"between": ["rod", "floor"], "side": "axis", "friction": friction}])
    assert ("radau5" in other_method(Run(model, model.case.solver).stepper)) == said
