"""Groups of similar bodies: forces and tangents are those of each body alone, and elements keep their names."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest

from ancf2d.kernels.elements import force_tangent
from ancf2d.kernels.matrices.layout import Places
from ancf2d.kernels.matrices.matrix import SymBand
from ancf2d.model import body_groups
from ancf2d.model.body_groups import Pool, place_in_pools
from ancf2d.model.element_limits import inverted
from ancf2d.model.groups import make_group

SECTIONS = {"height": 0.1, "width": 0.1}, {"height": 0.2, "width": 0.05}


def frame(name: str, other: str = "cable"):
    """Return bodies of two sections, directions and lengths, one bent, one rigid, and one of another element."""
    element = h.element(name, 3)
    bodies = {
        "a": h.body({"type": "line", "start": [0, 0], "end": [1, 0]}, element, SECTIONS[0]),
        "b": h.body({"type": "line", "start": [0, 0], "end": [0, 1]}, element, SECTIONS[0]),
        "stone": {"geometry": {"type": "line", "start": [0, 0], "end": [2, 0]}, "element": {"type": "rigid"},
                  "section": SECTIONS[0], "material": h.MATERIAL},
        "other": h.body({"type": "line", "start": [0, 2], "end": [1, 2]}, h.element(other, 2), SECTIONS[0]),
        "c": h.body({"type": "polyline", "points": [[0, 1], [1, 1], [1.5, 0.2]]}, element, SECTIONS[1]),
    }
    return h.build(bodies, {"type": "dynamic", "t_end": 1, "dt": 0.1})


def tangent(group, model, d):
    """Return energy, forces and tangent (n_q, n_q) of a group."""
    n, none = model.n_q, np.zeros(0, dtype=np.int64)
    Q, K = np.zeros(n), np.zeros((n, n))
    return force_tangent(group, d, 1.0, Q, SymBand(K), Places(np.arange(n), none, none, np.zeros(0))), Q, K


@h.every_small_type
def test_forces_and_tangents_of_a_group_are_those_of_single_bodies(name):
    model = frame(name)
    d = h.random_state(model, 0.01)
    together = [tangent(group, model, d) for group in model.groups]
    flexible = [mesh for mesh in model.meshes.values() if not mesh.plan.rigid]
    alone = [tangent(make_group(Pool([mesh], 0.0), []), model, d) for mesh in flexible]
    assert len(together) < len(alone)
    for a, b in zip(*([sum(part) for part in zip(*found, strict=True)] for found in (together, alone)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13 * np.abs(b).max())


def test_similar_bodies_share_a_pool_and_equal_lengths_a_class():
    model = frame("vallejo")
    assert [[m.plan.name for m in pool.meshes] for pool in model.pools] == [["a", "b", "c"], ["other"]]
    first = model.pools[0]
    # a and b are of one class; the pieces of c have lengths of their own
    assert first.cls[:6].tolist() == [0] * 6
    assert len(first.classes) == 3
    assert [place_in_pools(model.pools, model.meshes[name]) for name in ("a", "b", "c", "other")] == [
        (0, 0), (0, 3), (0, 6), (1, 0)]


def test_long_bodies_have_their_own_group(monkeypatch):
    monkeypatch.setattr(body_groups, "MANY", 3)
    assert [[m.plan.name for m in pool.meshes] for pool in frame("vallejo").pools] == [["a"], ["b"], ["other"], ["c"]]


@pytest.mark.parametrize("body", ["a", "b", "c", "other"])
@pytest.mark.parametrize("element", [0, 1])
def test_inverted_elements_are_reported_with_the_name_of_their_body(body, element):
    model = frame("vallejo")
    mesh, d = model.meshes[body], np.zeros(model.n_q)
    assert inverted(model, d) is None
    # sections turned over: r_y, or the axis of a cable
    nc = mesh.plan.element.components
    functionals = [k for k, (_, name) in enumerate(mesh.plan.element.functionals) if name == "r_y"]
    if not functionals:
        assert inverted(model, d, np.zeros(model.n_q)) is None
        ends = mesh.dofs[element]
        d[ends[-2 * nc:-nc]] -= 3.0 * (model.e0[ends[-2 * nc:-nc]] - model.e0[ends[:nc]])
        assert inverted(model, d, np.zeros(model.n_q)).startswith(f"an element is inverted: '{body}'")
        return
    for k in functionals:
        at = mesh.dofs[element, nc * k:nc * k + nc]
        d[at] = -2.0 * model.e0[at]
    found = inverted(model, d)
    assert found is not None
    assert found.startswith(f"an element is inverted: '{body}' at S = ")
    ends = [s for p in mesh.plan.pieces for s in (p.s0 + p.l * np.arange(p.count)).tolist()]
    nearest = float(found.rsplit(" ", 1)[1]) * mesh.plan.length - ends[element]
    assert abs(nearest) <= 1.01 * mesh.plan.pieces[0].l
