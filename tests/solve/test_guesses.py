"""Statics from the state of another mesh: the same equilibrium in few iterations, load steps for a bad guess."""

from __future__ import annotations

import numpy as np
import pytest

from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.model.transfer import transferred
from ancf2d.solvers.statics.newton import Start
from ancf2d.solvers.statics.static import solve_static
from ancf2d.study.run import vocabulary

FRAME = """
bodies:
  a:
    geometry: {type: polyline, points: [[0, 0], [0, 1], [1, 1]]}
    section: {height: 0.1, width: 0.1}
    material: {E: 1e8, nu: 0.3}
    element: {type: TYPE, count: COUNT}
  b:
    geometry: {type: arc, center: [2, 1], radius: 1, from: 3.141592653589793, to: 1.5707963267948966}
    section: {height: 0.1, width: 0.1}
    material: {E: 1e8, nu: 0.3}
    element: {type: TYPE, count: COUNT}
boundary_conditions: [{type: clamp, at: a@0}, {type: pin, at: b@1}]
joints: [{type: pin, between: [a@1, b@0]}]
loads: [{type: force, at: a@1, value: [0, -800]}]
solver: {type: static}
"""


def model(element: str, count: int):
    return build_model(load_case_text(FRAME.replace("TYPE", element).replace("COUNT", str(count)),
                                      vocabulary=vocabulary()))


@pytest.mark.parametrize("element", ["reissner3", "vallejo", "omar", "cable", "li", "kerkkanen"])
def test_a_mesh_of_halves_has_the_same_displacements(element):
    """Nested meshes of complete polynomials: the guess on the finer mesh is the state of the coarser one."""
    old, new = model(element, 4), model(element, 8)
    *_, state = solve_static(old)
    d = transferred(state.d, old, new)
    for name, s in (("a", 0.0), ("a", 0.25), ("a", 0.7), ("a", 1.0), ("b", 0.0), ("b", 0.3), ("b", 0.5), ("b", 0.9)):
        there, here = ([float(values @ coordinates[index]) for index, values in
                        _at(m, name, s).position()]
                       for m, coordinates in ((old, state.d), (new, d)))
        assert here == pytest.approx(there, rel=1e-8, abs=1e-10), (name, s)


def _at(of, name: str, s: float):
    from ancf2d.model.points import point_ref

    return point_ref(of.meshes[name], s)


@pytest.mark.parametrize("element", ["reissner3", "vallejo", "cable"])
def test_the_equilibrium_is_that_of_the_load_steps(element):
    old, new = model(element, 4), model(element, 8)
    *_, coarse = solve_static(old)
    stepped = list(solve_static(new))
    guess = Start(transferred(coarse.d, old, new), int(coarse.history["negative_pivots"]))
    found = list(solve_static(new, start=guess))
    assert len(found) == 1
    assert found[0].t == 1.0
    assert found[0].d == pytest.approx(stepped[-1].d, rel=1e-6, abs=1e-6 * np.abs(stepped[-1].d).max())
    assert found[0].history["iterations"] < 0.3 * sum(s.history["iterations"] for s in stepped)


def test_a_guess_that_is_far_or_on_another_branch_leads_to_load_steps():
    of = model("reissner3", 4)
    *_, end = solve_static(of)
    assert len(list(solve_static(of, start=Start(end.d, 0)))) == 1
    assert len(list(solve_static(of, start=Start(end.d, 1)))) >= 10
    assert len(list(solve_static(of, start=Start(0.3 * end.d, 0)))) >= 10


def test_other_element_types_give_no_guess():
    old, new = model("reissner3", 4), model("vallejo", 4)
    assert transferred(np.zeros(len(old.numbering.place)), old, new) is None
