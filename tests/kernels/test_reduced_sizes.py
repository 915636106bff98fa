"""Sizes of full forces in terms of the unknowns: upper bounds for forces of any signs."""

from __future__ import annotations

import helpers as h
import numba
import numpy as np

from ancf2d.kernels.motion.dynamics import to_unknowns
from ancf2d.solvers.motion.problem import make_problem


@numba.njit
def reduced(p, full, sizes, out, bound):  # type: ignore[no-untyped-def]
    to_unknowns(p, full, out, False)
    to_unknowns(p, sizes, bound, True)


def test_sizes_of_dependents_do_not_cancel() -> None:
    """A clamp between nodes makes coordinates differences of others: round-off does not cancel there as forces do."""
    beam = {"b": h.body(h.line(1.0), h.element("vallejo", 2), {"height": 0.1, "width": 0.1})}
    model = h.build(beam, {"type": "dynamic", "t_end": 1.0, "dt": 0.1}, bc=[{"type": "clamp", "at": "b@0.3"}])
    p, _ = make_problem(model)
    assert (p.value < 0.0).any()
    assert (p.value > 0.0).any()
    rng, n = np.random.default_rng(1), len(p.full)
    out, bound = np.zeros(n), np.zeros(n)
    for _ in range(20):
        full = rng.choice([-1.0, 1.0], len(p.place))
        reduced(p, full, np.abs(full), out, bound)
        assert np.all(np.abs(out) <= bound * (1 + 1e-14))
