"""Nodes stand where something acts, for no element has a kink inside."""

from __future__ import annotations

from typing import Any

import helpers
import numpy as np
import pytest

from ancf2d.model.build import build_model
from ancf2d.model.points import dot, point_ref
from ancf2d.model.transfer import transferred
from ancf2d.solve.sections import class_motions, energies

L, A_AT = 2.0, 0.3
SECTION = {"EA": 1e6, "kGA": 2e5, "EI": 800.0, "rhoA": 3.0}
EXACT = ["vallejo", "reissner3", "cable"]


def acting(name: str, count: int) -> dict[str, Any]:
    """Return an element of a body that has nodes where something acts."""
    return helpers.element(name, count, nodes="acting", **({"formulation": "structural"} if name == "vallejo" else {}))


def simply_supported(name: str, count: int, angle: float = 0.0) -> helpers.Solution:
    """Solve a simply supported beam of length L with a transverse unit force at S = A_AT."""
    c, s = np.cos(angle), np.sin(angle)
    bc = [{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "normal": [-s, c]}]
    return helpers.solved({"b": helpers.body(helpers.line(L, angle), acting(name, count), SECTION)}, "linear_static",
                          bc=bc, loads=[{"type": "force", "at": f"b@{A_AT}", "value": [-s, c]}])


@pytest.mark.parametrize("count", [1, 3, 8])
@pytest.mark.parametrize("name", EXACT)
def test_a_force_anywhere_bends_a_beam_as_beam_theory_says(name: str, count: int) -> None:
    out = simply_supported(name, count, 0.7)
    a, b = A_AT * L, (1 - A_AT) * L
    shear = 0.0 if name == "cable" else a * b / (L * SECTION["kGA"])
    normal = np.array([-np.sin(0.7), np.cos(0.7)])
    assert out.u(f"b@{A_AT}") @ normal == pytest.approx(a**2 * b**2 / (3 * SECTION["EI"] * L) + shear, rel=1e-8)


ACTS: dict[str, dict[str, Any]] = {
    "support": {"bc": [{"type": "clamp", "at": "b@0"}, {"type": "roller", "at": "b@0.3", "fixed": "y"}]},
    "joint": {"joints": [{"type": "pin", "between": ["b@0.3", "c@0"]}]},
    "slider": {"joints": [{"type": "slider", "at": "b@0.3", "through": [0.6, 0], "along": [1, 0]}]},
    "spring": {"springs": [{"type": "translational", "between": ["b@0.3", [0, 1]], "stiffness": 1.0}]},
    "mass": {"masses": [{"at": "b@0.3", "mass": 1.0}]},
    "force": {"loads": [{"type": "force", "at": "b@0.3", "value": [0, 1]}]},
    "moment": {"loads": [{"type": "moment", "at": "b@0.3", "value": 1}]},
    "line load": {"loads": [{"type": "distributed", "on": "b", "from": 0.3, "value": [0, 1]}]},
}


def scene(count: int = 4, **what: Any) -> Any:
    """Return the case of a clamped beam ``b`` and a free one ``c`` that begins at its S = 0.3."""
    bodies = {"b": helpers.body(helpers.line(L), acting("reissner3", count)),
              "c": helpers.body(helpers.line(1.0, 1.0, (0.6, 0.0)), acting("reissner3", 2))}
    what.setdefault("bc", [{"type": "clamp", "at": "b@0"}])
    return helpers.load(bodies, {"type": "eigen", "modes": 2}, **what)


@pytest.mark.parametrize("kind", ACTS)
def test_everything_that_acts_has_a_node(kind: str) -> None:
    plan = build_model(scene(**ACTS[kind])).meshes["b"].plan
    assert plan.split == pytest.approx([0.3])
    assert plan.count == 4


def test_what_only_looks_on_or_slides_needs_no_node() -> None:
    slide = [{"type": "prismatic", "point": "c@0", "on": "b"}]
    model = build_model(scene(joints=slide, output={"probes": {"p": "b@0.37"}}))
    assert model.meshes["b"].plan.split == []


@pytest.mark.parametrize("name", ["vallejo", "2d2n", "reissner3"])
def test_equal_elements_stay_the_same_to_the_last_bit_where_their_nodes_will_do(name: str) -> None:
    models = []
    for nodes in ("acting", "regular"):
        body = helpers.body(helpers.ARC, helpers.element(name, 6, nodes=nodes))
        loads = [{"type": "force", "at": f"b@{s!r}", "value": [1, 2]} for s in (1 / 3, 0.5)]
        models.append(helpers.build({"b": body}, bc=[{"type": "clamp", "at": "b@0"}], loads=loads))
    assert np.array_equal(models[0].e0, models[1].e0)
    assert models[0].warnings == models[1].warnings


def test_a_mid_node_is_inside_an_element() -> None:
    load = [{"type": "force", "at": "b@0.5", "value": [0, 1]}]
    models = {nodes: helpers.build({"b": helpers.body(helpers.line(L), helpers.element("reissner3", 1, nodes=nodes))},
                                   bc=[{"type": "clamp", "at": "b@0"}], loads=load) for nodes in ("acting", "regular")}
    assert models["acting"].n_elements == 2
    assert any("element.count 1 is less than" in w for w in models["acting"].warnings)
    assert models["regular"].n_elements == 1
    assert any("inside an element, at S = 0.5" in w for w in models["regular"].warnings)


@pytest.mark.parametrize("name", helpers.SMALL_TYPES)
def test_a_state_is_the_same_on_a_nested_mesh_with_other_elements(name: str) -> None:
    """Of a mesh whose elements all are cut: displacements are polynomials that the finer one has, too."""
    bodies = [{"b": helpers.body(helpers.line(L, 0.4), helpers.element(name, n, nodes="acting"))} for n in (3, 12)]
    bc = [{"type": "clamp", "at": "b@0"}]
    loads = [[{"type": "force", "at": f"b@{s}", "value": [0, 1]} for s in places]
             for places in ((0.3, 0.5), (0.15, 0.3, 0.5, 0.875))]
    coarse, fine = (helpers.build(b, bc=bc, loads=f) for b, f in zip(bodies, loads, strict=True))
    d = helpers.random_state(coarse, 0.1)
    moved = transferred(d, coarse, fine)
    assert moved is not None
    for s in (0.1, 0.3, 0.4, 0.7, 1.0):
        before, after = ([dot(c, q) for c in point_ref(model.meshes["b"], s).position()]
                         for model, q in ((coarse, d), (fine, moved)))
        np.testing.assert_allclose(after, before, atol=1e-12)


@pytest.mark.parametrize("name", ["2d2n", "2d3n"])
def test_neighbours_of_unequal_length_have_no_gap_in_a_rigid_motion(name: str) -> None:
    load = [{"type": "force", "at": "b@0.3", "value": [0, 1]}]
    model = helpers.build({"b": helpers.body(helpers.line(L), helpers.element(name, 5, nodes="acting"))},
                          bc=[{"type": "clamp", "at": "b@0"}], loads=load)
    mesh = model.meshes["b"]
    assert len(mesh.classes) == 2
    spin = helpers.rotate(np.zeros(model.n_q), model, 1e-8) / 1e-8
    found = energies(mesh, [class_motions(c.sampler) for c in mesh.classes], spin)
    assert found.gaps < 1e-12 * found.total
    assert found.motions.sum() == pytest.approx(found.total, rel=1e-9)
