"""Derivatives of goals to numbers of a case: closed forms, and differences of whole runs."""

import numpy as np
import pytest

import ancf2d
from ancf2d.case.numbers import Variable, variable_at, variables_of
from ancf2d.errors import CaseError
from ancf2d.solvers.differences import derivative
from ancf2d.study.gradient import gradient

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


def test_numbers_are_found_by_their_paths():
    """Names stand for items of lists, defaults for what a case leaves out, S for a point."""
    case = ancf2d.load(CANTILEVER)
    paths = [v.path for v in variables_of(case)]
    assert {"loads.tip.value.1", "bodies.beam.section.EI"} <= set(paths)
    assert not [p for p in paths if p.startswith(("solver", "output", "boundary_conditions"))]
    assert variable_at(case, "loads.0.value.1") == Variable("loads.0.value.1", -3.0, 3.0)
    assert variable_at(case, "loads.tip.at").override(0.5) == "loads.tip.at=beam@0.5"
    with pytest.raises(CaseError, match=r"did you mean 'bodies\.beam\.section\.EI'"):
        variable_at(case, "bodies.beam.section.El")
    with pytest.raises(CaseError, match="expected a number"):
        variable_at(case, "loads.tip.type")


def test_differences_of_smooth_functions():
    """Fourth order on both sides, on one side where the other is refused, and shorter steps where they are too long."""
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
