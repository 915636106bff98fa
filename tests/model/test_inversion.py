"""Inverted elements are found wherever they occur."""

from __future__ import annotations

import helpers
import numpy as np
import pytest

from ancf2d.model import element_limits

COUNT = 7


@pytest.mark.parametrize("block", [1, 3, 100])
@pytest.mark.parametrize("name", ["vallejo", "reissner2", "cable", "ancf[3,3]"])
@pytest.mark.parametrize("element", [0, 3, 6])
def test_the_inverted_element_is_named(monkeypatch, block, name, element):
    """A point beyond the first node of an element moves in front of it."""
    monkeypatch.setattr(element_limits, "BLOCK", block)
    beam = {"b": helpers.body(helpers.line(COUNT), helpers.element(name, COUNT))}
    model = helpers.build(beam, bc=[{"type": "clamp", "at": "b@0"}])
    zero, d = np.zeros(model.n_q), np.zeros(model.n_q)
    assert element_limits.inverted(model, d, zero) is None
    mesh = model.meshes["b"]
    others = mesh.dofs[element][mesh.plan.element.components::mesh.plan.element.components]
    d[others] = -1.5 * (model.e0[others] - element)
    found = element_limits.inverted(model, d, zero)
    assert found is not None
    assert found.startswith("an element is inverted: 'b' at S = ")
    # the one before bends back where its end is turned
    assert element - 1 <= COUNT * float(found.rsplit(" ", 1)[1]) <= element + 1 + 1e-3
