"""Matrices of bodies that touch each other have entries only for elements that are near each other, and follow them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import helpers
import numpy as np
import pytest
from test_contact_of_bodies import clamps

from ancf2d.model.numbering import Numbering
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.motion.near_elements import Layout
from ancf2d.solvers.registry import solve
from ancf2d.solvers.system import System

SECTION, RUBBER = {"height": 0.02, "width": 0.05}, {"E": 1e8, "nu": 0.3, "rho": 1000.0}
LAWS = {"law": {"law": {"stiffness": 1e7}}, "none": {}}


def beam(start: list[float], end: list[float], count: int) -> dict[str, Any]:
    geometry = {"type": "line", "start": start, "end": end}
    return helpers.body(geometry, helpers.element("reissner2", count), SECTION, RUBBER)


def sliding(solver: dict[str, Any], law: str, **more: Any) -> Any:
    """Return the model of a short beam that is pressed onto a long one and slides along it by several elements."""
    bodies = {"long": beam([0, 0], [1, 0], 60), "short": beam([0.1, 0.021], [0.3, 0.021], 12)}
    return helpers.build(bodies, solver, contacts=[{"between": ["long", "short"], **LAWS[law]}], **more)


def everything(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all elements of bodies that may touch each other couple."""
    monkeypatch.setattr(Numbering, "in_reference", property(lambda num: num.complete))
    monkeypatch.setattr(Layout, "follow", lambda layout: None)


def counted(monkeypatch: pytest.MonkeyPatch, owner: type) -> list[int]:
    """Return a list that grows whenever the entries of a matrix change."""
    calls, follow = list[int](), owner.follow  # type: ignore[attr-defined]
    monkeypatch.setattr(owner, "follow", lambda *args: (calls.append(1), follow(*args))[1])
    return calls


@pytest.mark.parametrize("law", LAWS)
def test_equilibria_do_not_depend_on_which_elements_couple(law, monkeypatch):
    scene = {"bc": [*clamps("long@0"), {"type": "roller", "at": "long@1", "fixed": "y"},
                    {"type": "prescribed", "at": "short@0.5", "x": 0.5, "y": -0.004, "angle": 0.0}]}
    model = sliding({"type": "static", "steps": 8}, law, **scene)
    assert model.numbering.couplings is not None
    changes = counted(monkeypatch, System)
    found = list(solve(model))[-1]
    assert len(changes) >= 3
    monkeypatch.undo()
    everything(monkeypatch)
    model = sliding({"type": "static", "steps": 8}, law, **scene)
    other = list(solve(model))[-1]
    w = model.weights
    np.testing.assert_allclose(found.d[:model.n_q] * w, other.d[:model.n_q] * w, atol=1e-9)


def riding(law: str, method: str) -> Run:
    """Return the motion of a short beam thrown along a long one."""
    model = sliding({"type": "dynamic", "t_end": 0.008, "dt": 2e-4, "method": method, "estimate": False}, law,
                    bc=clamps("long@0", "long@1"), initial={"bodies": {"short": {"velocity": [50.0, -2.0]}}})
    return Run(model, model.case.solver, follows=True)


@pytest.mark.parametrize(("law", "method"), [("law", "generalized_alpha"), ("none", "generalized_alpha"),
                                             ("law", "radau5")])
def test_motions_do_not_depend_on_which_elements_couple(law, method, monkeypatch):
    changes = counted(monkeypatch, Layout)
    run = riding(law, method)
    found = list(run.states())[-1]
    assert len(changes) >= 3
    monkeypatch.undo()
    everything(monkeypatch)
    other = list(riding(law, method).states())[-1]
    w = run.model.weights
    np.testing.assert_allclose(found.d[:run.model.n_q] * w, other.d[:run.model.n_q] * w, atol=1e-7)


def test_a_motion_resumes_bit_for_bit_with_the_entries_of_its_checkpoint():
    run = riding("law", "generalized_alpha")
    whole = list(run.states(advance=lambda: run.stepper.run(4)))
    kept = [state.checkpoint for state in whole if state.checkpoint is not None]
    middle = next(one for one in kept if not np.array_equal(kept[0]["layout"], one["layout"]))
    *_, last = riding("law", "generalized_alpha").states(middle)
    np.testing.assert_array_equal(last.d, whole[-1].d)


def test_few_entries_remain_where_bodies_touch_all_along():
    """The number of entries grows with that of elements, not with its square."""
    sizes = []
    for count in (40, 80):
        model = helpers.build({"upper": beam([0, 0.0201], [1, 0.0201], count), "lower": beam([0, 0], [1, 0], count)},
                              {"type": "static"}, bc=clamps("upper@0", "lower@0"),
                              contacts=[{"between": ["upper", "lower"], **LAWS["law"]}])
        sizes.append((len(System(model).matrix.values), len(System(model, fixed=True).matrix.values)))
    (few, all_of_few), (many, all_of_many) = sizes
    assert many < 2.5 * few
    assert all_of_many > 3.5 * all_of_few


def test_rows_of_a_matrix_leave_held_and_dependent_coordinates_as_they_are():
    """Also if there are more of these than unknowns."""
    num = sliding({"type": "static"}, "law", bc=clamps("long@0", "short@0")).numbering.in_reference
    more = replace(num, place=np.append(num.place, [-1, -2 - 3 * num.n_unknowns]))
    free = more.place >= 0
    np.testing.assert_array_equal(more.rows.place[~free], more.place[~free])
    np.testing.assert_array_equal(num.fronts.unknown[more.rows.place[free]], more.place[free])
