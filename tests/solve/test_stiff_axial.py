"""Axial stiffness 1e9 times the bending stiffness: forces, not displacements, decide convergence."""

from __future__ import annotations

import helpers
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solvers.statics.newton import BALANCE
from ancf2d.solvers.statics.static import solve_static
from ancf2d.solvers.system import System

CASE = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{EA: 1e9, kGA: 50, EI: 1}}
    element: {{type: {element}, count: {count}}}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, -1]}}]
solver: {{type: static}}
"""


@pytest.mark.parametrize("count", [8, 32])
@pytest.mark.parametrize("element", ["reissner2", "reissner3"])
def test_a_stable_cantilever_passes_no_critical_point(element: str, count: int) -> None:
    """The tangent one increment before the end still contains the axial force of that increment."""
    model = build_model(load_case_text(CASE.format(element=element, count=count)))
    states = list(solve_static(model, 10))
    assert [s.history["negative_pivots"] for s in states] == [0] * 10
    assert not [w for s in states for w in s.warnings]


@pytest.mark.parametrize("element", ["reissner3", "vallejo, formulation: structural"])
def test_forces_balance_at_the_end_of_every_step(element: str) -> None:
    model = build_model(load_case_text(CASE.format(element=element, count=8)))
    system = System(model)
    for state in solve_static(model, 10):
        assert system.imbalance(system.forces(state.d, state.t)) <= BALANCE


def elastica(EI: float, EA: float, P: float) -> np.ndarray:
    """Return the tip (2,) of a cantilever of unit length under a tip load P down, by shooting with the moment."""
    def end(m: float) -> np.ndarray:
        def rates(s, y):
            stretch = 1.0 - P * np.sin(y[0]) / EA
            return y[1] / EI, P * np.cos(y[0]) * stretch, stretch * np.cos(y[0]), stretch * np.sin(y[0])

        return solve_ivp(rates, (0, 1), [0.0, m, 0.0, 0.0], rtol=1e-11, atol=1e-13, method="DOP853").y[:, -1]

    return end(brentq(lambda m: end(m)[1], -P, -1e-3 * P, xtol=1e-14 * P))[2:]


@pytest.mark.parametrize(("formulation", "slenderness"), [
    ("cable", 1e2), ("cable", 1e4), ("cable", 1e6), ("green", 1e4), ("green", 1e6)])
@pytest.mark.parametrize("count", [1, 4, 16])
def test_a_cable_bends_far_without_locking_for_any_axial_stiffness(formulation, slenderness, count):
    """The same error at every slenderness, where 3 Gauss points have 7e-3 with 4 elements and 5e-4 with 16.

    Round-off of the axial force adds to it: at 1e6 the tip's error goes from 7e-7 to 8e-6 as P changes by 1e-4.

    ``green`` has its own limit, which is the elastica's where strains are small.
    """
    EI, EA, P = 1.0, 12.0 * slenderness**2, 4.0
    spec, section = helpers.element("cable", count, formulation), {"EA": EA, "kGA": EA, "EI": EI}
    body = helpers.body(helpers.line(1.0), spec, section)
    out = helpers.solved({"c": body}, bc=[{"type": "clamp", "at": "c@0"}],
                         loads=[{"type": "force", "at": "c@1", "value": [0.0, -P]}])
    error = np.hypot(*(out.r("c@1") - elastica(EI, EA, P)))
    assert error < {1: 0.05, 4: 7e-4, 16: 5e-6}[count] + 1e-17 * slenderness**2


def test_a_straight_cable_has_no_hidden_modes():
    """One with r_x free at the clamp: 3 rigid motions are constrained, and all others have energy."""
    model = helpers.build({"c": helpers.body(helpers.line(1.0), helpers.element("cable", 3))}, bc=[
        {"type": "clamp", "at": "c@0"}])
    system = System(model)
    system.assemble(np.zeros(len(model.numbering.place)), 0.0)
    n = model.numbering.n_unknowns
    K = np.array([system.matrix.product(system.matrix.target.values.copy(), row) for row in np.eye(n)])
    values = np.linalg.eigvalsh(K)
    assert values[0] > 1e-6 * values[-1]
