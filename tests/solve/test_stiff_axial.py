"""Axial stiffness 1e9 times the bending stiffness: forces, not displacements, tell when Newton is done."""

from __future__ import annotations

import pytest

from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solve.newton import BALANCE
from ancf2d.solve.static import solve_static
from ancf2d.solve.system import System

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
    """The tangent one increment before the end still holds the axial force of that increment."""
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
