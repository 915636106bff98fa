"""Random scenes that must not change in other words and elsewhere: a few of those of ``scripts.invariance``."""

from __future__ import annotations

import helpers
import pytest

from scripts.scenes import campaign

# scenes of each solver, all checks of each; the same command tries any number of others
SCENES = {"linear_static": range(6), "static": range(4), "eigen": range(5), "buckling": range(4)}


@pytest.mark.parametrize(("solver", "number"), helpers.chosen(
    [(s, n) for s, numbers in SCENES.items() for n in numbers], [(s, 0) for s in SCENES]))
def test_scene_does_not_change(solver: str, number: int) -> None:
    record = campaign.examine(1, number, solver, drawn=99)
    assert record.violations == {}
