"""Models that share meshes and classes of elements with a model of other numbers equal models built afresh."""

import numpy as np
import pytest

import ancf2d
from ancf2d.case.numbers import number_at
from ancf2d.errors import CaseError
from ancf2d.solvers.linear import full_mass
from ancf2d.study.gradient import prepare, varied
from ancf2d.study.run import run_case

SCENE = """
bodies:
  post:
    geometry: {type: arc, center: [1, 0], radius: 1, from: 3, to: 1.5}
    section: {height: {s: [0, 0.25, 0.5, 0.75, 1], value: [0.03, 0.02, 0.025, 0.02, 0.03]}, width: "0.03 - 0.01*s"}
    material: {E: 2e11, nu: 0.3, rho: 7800, alpha: 1.2e-5}
    element: {type: vallejo, count: 8}
  beam:
    geometry: {type: line, start: [1, 1], end: [2.2, 1.1]}
    section: {height: 0.02, width: 0.01}
    material: {E: 7e10, nu: 0.3, rho: 2700}
    element: {type: li, formulation: strain_split, count: 3}
boundary_conditions:
  - {name: foot, type: clamp, at: post@0}
  - {name: edge, type: roller, at: beam@1, normal: [0.1, 1]}
  - {name: hinge, type: pin, at: beam@0}
springs:
  - {name: stay, type: translational, between: [post@0.3, [-0.4, 1.2]], stiffness: 2e4, length: 0.6, damping: 5}
loads:
  - {name: snow, type: distributed, on: beam, value: [0, -30]}
  - {name: heat, type: temperature, on: post, value: 30, gradient: 100}
  - {type: gravity, name: weight, value: [0, -9.81]}
solver: {type: static}
"""
# a number, and how many classes of post and beam its models share with the model of the case
SHARED = {"bodies.post.section.height.value.1": (4, 1), "bodies.post.section.height.value.4": (6, 1),
          "bodies.post.material.nu": (0, 1), "bodies.post.geometry.radius": (0, 1), "bodies.beam.material.nu": (8, 0),
          "bodies.beam.geometry.end.0": (8, 0), "springs.stay.stiffness": (8, 1), "loads.heat.value": (8, 1),
          "boundary_conditions.edge.normal.0": (8, 1)}


def forces(model):
    """Return the data of elements, loads, springs and masses of a model, element by element."""
    out = []
    for group in model.groups:
        law, parts = group.values.law, group.values.plan.parts
        out += [x.reshape(-1, parts, *x.shape[1:])[group.values.cls].ravel() for x in (law.B, law.ref, law.D)]
        out += [group.values.natural.stretch.ravel(), group.values.plan.coupled.ravel()]
    out += [load.values for load in model.loads.dead] + [spring.par for spring in model.springs]
    return [*out, full_mass(model).toarray().ravel(), model.numbering.value, model.e0]


@pytest.fixture(scope="module")
def case():
    return ancf2d.load(SCENE)


@pytest.fixture(scope="module")
def base(case):
    return prepare(case)


@pytest.mark.parametrize("path", SHARED)
def test_a_model_with_shared_parts_equals_one_built_afresh(case, base, path):
    """To round-off, as shape functions are scaled by the mean height. Parts that differ are not shared."""
    assert base.groups
    variable = number_at(case, path)
    other = varied(case, variable, 1e-3 * abs(variable.value))
    shared, alone = prepare(other, base, for_differences=True), prepare(other)
    for one, two in zip(forces(shared), forces(alone), strict=True):
        assert one == pytest.approx(two, rel=1e-12, abs=1e-13 * np.abs(two).max(initial=0.0))
    known = {id(c) for pool in base.pools for c in pool.classes}
    assert tuple(sum(id(c) in known for c in mesh.classes) for mesh in shared.meshes.values()) == SHARED[path]


# what variants of a sweep set, one after the other: numbers, meshes, types, what is wrong and what fails
VARIANTS = [
    [], ["bodies.beam.material.E=6e10"], ["bodies.beam.section.height=0.04"], ["bodies.beam.section.height=0.05"],
    ["bodies.post.section.height.value.1=0.021"],
    # of two places whose mean stays as it was
    ["bodies.post.section.height.value.1=0.022", "bodies.post.section.height.value.3=0.018"],
    ["bodies.post.section.height.value.1=0.021", "bodies.post.section.height.value.3=0.019"],
    ["bodies.beam.element.count=5"], ["bodies.post.element.count=5"], ["bodies.post.geometry.radius=1.01",
                                                                     "bodies.post.geometry.center.0=1.01"],
    ["bodies.beam.geometry.end.0=2.4"], ["bodies.beam.material.nu=0.4"], ["bodies.beam.element.formulation=continuum"],
    ["bodies.beam.element.quadrature=[4, 2]"], ["bodies.beam.element.quadrature=[3, 1]"],
    ["bodies.beam.element={type: reissner3, count: 3}"], ["bodies.beam.element={type: omar, count: 3}"],
    # of the same formulation and as many points
    ["bodies.beam.element={type: li, count: 3}"], ["bodies.beam.element={type: vallejo, count: 3}"],
    ["bodies.beam.element={type: vallejo, count: 3}", "bodies.beam.section.width=0.012"],
    ["springs.stay.stiffness=3e4"], ["springs=null", "boundary_conditions.hinge.at=post@1"],
    ["loads.heat.value=-10"], ["loads.snow.value.1=-60"], ["loads.snow=null"], ["loads.weight.value.1=0"],
    ["boundary_conditions.edge.normal.0=0.4"], ["boundary_conditions.edge=null"],
    ["boundary_conditions.edge={name: edge, type: clamp, at: beam@1}"], ["boundary_conditions.foot.type=pin"],
    ["solver={type: static, steps: 2}"], ["solver={type: static, steps: 2}", "bodies.beam.section.width=0.012"],
    ["solver={type: static, max_iterations: 1}"], ["solver={type: eigen, modes: 4}"], []]


def outcome(loaded, like=None):
    """Return the results of a run without times, or the reason for none, and its model."""
    try:
        found = run_case(loaded, like=like)
    except CaseError as error:
        return str(error), None
    return {k: v for k, v in found.summary.items() if k != "wall_s"}, found.model


@pytest.mark.slow
def test_runs_with_shared_parts_are_the_same_bit_for_bit():
    """Each variant takes common parts from the model of the previous one, whatever differs between them."""
    case = ancf2d.load(SCENE, {"solver.type": "linear_static", "bodies.post.element.count": 4})
    before, words = None, set()
    for sets in VARIANTS:
        loaded = ancf2d.load(case, sets)
        alone, afresh = outcome(loaded)
        shared, model = outcome(loaded, before)
        assert shared == alone, sets
        assert model is None or all(map(np.array_equal, forces(model), forces(afresh))), sets
        words.add(alone if isinstance(alone, str) else alone["status"])
        before = model
    assert {"converged", "failed"} < words
