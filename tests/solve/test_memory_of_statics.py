"""Statics of long meshes: an upper bound on the stored numbers per coordinate."""

from __future__ import annotations

import tracemalloc

import helpers as h
import pytest

from ancf2d.model.model import Model
from ancf2d.solvers.statics.linear_static import solve_linear
from ancf2d.solvers.statics.static import solve_static

COUNT = 12000
# besides the band: model, state and three earlier ones, forces, residual and round-off; vectors of the refinement
OTHERS = 27


def cantilever(element: str, count: int) -> Model:
    """Return the model of a steel cantilever whose tip sinks by a third of its length."""
    beam = h.body(h.line(2.0), h.element(element, count), {"height": 0.1, "width": 0.1}, h.STEEL)
    return h.build({"beam": beam}, bc=[{"type": "clamp", "at": "beam@0"}], loads=h.tip(0.0, -500e3))


@pytest.mark.parametrize("element", ["vallejo", "reissner2"])
def test_statics_hold_few_vectors(element):
    # compile and import first
    model = cantilever(element, 8)
    assert [solve_linear(model), *solve_static(model, 2)]
    tracemalloc.start()
    try:
        model = cantilever(element, COUNT)
        most = (model.numbering.half_bandwidth + 1 + OTHERS) * 8 * model.n_q
        for solve in (lambda: [solve_linear(model)], lambda: (state for state in solve_static(model, 4))):
            tracemalloc.reset_peak()
            for _ in solve():
                pass
            assert tracemalloc.get_traced_memory()[1] < most
    finally:
        tracemalloc.stop()
