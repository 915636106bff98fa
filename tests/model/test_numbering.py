"""Coupled unknowns and their order."""

from __future__ import annotations

import numpy as np

from ancf2d.model.numbering import meeting


def test_unknowns_of_one_row_are_coupled_and_each_with_itself() -> None:
    rng = np.random.default_rng(3)
    sets = [rng.integers(-1, 30, (6, 4)), np.array([[31, 2, 31]]), np.zeros((0, 5), dtype=np.int64)]
    wanted = np.eye(33, dtype=bool)
    for row in (row[row >= 0] for rows in sets for row in rows):
        wanted[np.ix_(row, row)] = True
    found = meeting(33, sets)
    np.testing.assert_array_equal(found.toarray() > 0, wanted)
    assert found.has_sorted_indices
