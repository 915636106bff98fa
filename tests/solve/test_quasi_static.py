"""Steps of equilibria over time: where they end."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import CaseError, ComputationError
from ancf2d.model.build import build_model
from ancf2d.solvers.state_results import reactions


def test_yield_depends_on_the_load_history_not_on_the_steps() -> None:
    """Steps end at the peaks of a sine: 7 cycles in some hundred steps give the right final yield stress.

    In yield strains and stresses, fibres of E = 1 and H = 0.1 flow by f/1.1 where |e - p| is above the yield stress
    by f.
    """
    body = {"geometry": h.line(1.0), "element": h.element("reissner3", 1),
            "section": {"height": 0.02, "width": 0.02},
            "material": {"E": 2e11, "nu": 0.3, "yield": 2e8, "hardening": {"isotropic": 2e10}}}
    move = {"type": "sine", "frequency": 7.25, "scale": 3e-3}
    found = h.Solution(build_model(h.load({"rod": body}, {"type": "quasi_static", "t_end": 1.0, "tolerance": 1e-3},
        bc=[{"type": "clamp", "at": "rod@0"},
            {"type": "prescribed", "at": "rod@1", "name": "end", "ux": move, "uy": 0, "angle": 0}])))
    plastic, most = 0.0, 1.0
    for k in range(15):
        trial = 3.0 * (-1.0)**k - plastic
        flow = max(abs(trial) - most, 0.0) / 1.1
        plastic, most = plastic + np.copysign(flow, trial), most + 0.1 * flow
    force = reactions(found.model, found.state)["end"]["fx"] / 0.02**2
    assert force == pytest.approx(2e8 * (3.0 - plastic), rel=1e-9)


def test_steps_end_at_requested_times() -> None:
    """A stretched bar has its stress of (1 + g exp(-t/tau)) E e there, however long its steps are."""
    times = [0.0, 0.0123, 0.2, 0.77, 1.0]
    case = h.load({"beam": {"geometry": h.line(1.0), "element": h.element("reissner3", 2),
                            "section": {"height": 0.02, "width": 0.02},
                            "material": {"E": 2e6, "nu": 0.3, "viscoelastic": [{"modulus": 0.5, "time": 0.1}]}}},
                  {"type": "quasi_static", "t_end": 1.0, "tolerance": 1e-3}, bc=[
                      {"type": "clamp", "at": "beam@0"},
                      {"type": "prescribed", "at": "beam@1", "name": "end", "ux": 1e-6, "uy": 0, "angle": 0}],
                  output={"probes": {"tip": "beam@1"}})
    found = ancf2d.solve(case, {"solver.times": times, "output.fields": ["N"]})
    at = [int(np.argmin(np.abs(found.course_t - t))) for t in times]
    np.testing.assert_allclose(found.course_t[at], times, atol=1e-12)
    exact = 2e6 * 0.02**2 * 1e-6 * (1.0 + 0.5 * np.exp(-np.array(times) / 0.1))
    np.testing.assert_allclose(found.course["tip"]["N"][at], exact, rtol=1e-6)
    with pytest.raises(CaseError, match=r"does not reach 1\.5"):
        ancf2d.load(case, {"solver.times": [0.5, 1.5]})


@pytest.mark.parametrize(("course", "begins", "ends"), [
    ({"type": "table", "t": [0, 1, 2], "value": [0, 2, 0]}, 0.5, 1.5),
    ({"type": "expression", "value": "2 if 0.3 < t < 1.2 else 0"}, 0.3, 1.2)], ids=["gradual", "at once"])
def test_a_column_beyond_its_buckling_load_is_called_unstable(course: dict, begins: float, ends: float) -> None:
    """A straight column under twice its buckling load pi^2 EI/4 and back, in steps of at most a hundredth."""
    body = {"geometry": h.line(1.0), "element": h.element("reissner3", 4), "section": {"EA": 1e6, "kGA": 1e6, "EI": 1}}
    load = {"type": "force", "at": "rod@1", "value": [-np.pi**2 / 4, 0], "amplitude": course}
    found = h.Solution(build_model(h.load({"rod": body}, {"type": "quasi_static", "t_end": 2.0}, loads=[load],
                                          bc=[{"type": "clamp", "at": "rod@0"}])))
    told = [(w.split(" from t")[0], s.t) for s in found.states for w in s.warnings]
    assert [what for what, _ in told] == ["unstable equilibrium", "the equilibrium is stable again"]
    late = np.array([t for _, t in told]) - [begins, ends]
    assert np.all((late >= 0.0) & (late <= 0.02))


def test_states_are_stored_after_each_interval() -> None:
    """Steps end there; the deflection F L^3/(3 E I) follows the load t."""
    body = {"geometry": h.line(1.0), "element": h.element("cable", 1), "section": {"EA": 1e6, "kGA": 1e6, "EI": 10}}
    load = {"type": "force", "at": "rod@1", "value": [0, 3e-3], "amplitude": {"type": "expression", "value": "t"}}
    case = h.load({"rod": body}, {"type": "quasi_static", "t_end": 1.0}, loads=[load],
                  bc=[{"type": "clamp", "at": "rod@0"}], output={"probes": {"tip": "rod@1"}, "interval": 0.3})
    found = ancf2d.solve(case)
    assert found.summary["t"] == 1.0
    np.testing.assert_allclose(found.t, [0.0, 0.3, 0.6, 0.9, 1.0], rtol=1e-15)
    tip = [found.axis("rod", k)[-1, 1] for k in range(5)]
    np.testing.assert_allclose(tip, 1e-4 * found.t, rtol=1e-6)


def test_a_failure_at_the_start_names_prescribed_motions_that_do_not_begin_there() -> None:
    body = {"geometry": h.line(0.5), "element": h.element("reissner3", 8),
            "section": {"height": 0.006, "width": 0.03}, "material": {"E": 2e11, "nu": 0.3}}
    model = build_model(h.load({"leaf": body}, {"type": "quasi_static", "t_end": 1.0}, bc=[
        {"type": "clamp", "at": "leaf@0"}, {"type": "prescribed", "at": "leaf@1", "name": "mover", "x": 2.0, "y": 0}]))
    with pytest.raises(ComputationError) as caught:
        h.Solution(model)
    assert "mover: the prescribed x is 2 at t = 0, but the point is at x = 0.5" in caught.value.failure.advice
    assert "prescribed y" not in caught.value.failure.advice


def test_a_line_load_is_a_formula_in_time() -> None:
    """w = (11/120) q L^4/(E I) at the tip of a cantilever under q s; for t^2 q s, that of the time."""
    body = {"geometry": h.line(1.0), "element": h.element("cable", 8), "section": {"EA": 1e6, "kGA": 1e6, "EI": 10}}
    found = h.Solution(build_model(h.load({"rod": body}, {"type": "quasi_static", "t_end": 2.0, "times": [1.0]},
        bc=[{"type": "clamp", "at": "rod@0"}],
        loads=[{"type": "distributed", "on": "rod", "value": [0, "1e-3*t^2*s"]}])))
    uy = {s.t: found.u("rod@1", k)[1] for k, s in enumerate(found.states)}
    assert [uy[1.0], uy[2.0]] == pytest.approx([11e-4 / 120, 4 * 11e-4 / 120], rel=1e-5)
