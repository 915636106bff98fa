"""Random scenes that must not change in other words and elsewhere: a few of those of ``scripts/invariance.py``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from scenes import campaign

# scenes of each solver, all checks of each; the same command tries any number of others
QUICK = {"linear_static": range(8), "static": range(4), "eigen": range(6), "buckling": range(4)}


@pytest.mark.parametrize(("solver", "number"), [(s, n) for s, numbers in QUICK.items() for n in numbers])
def test_scene_does_not_change(solver: str, number: int) -> None:
    record = campaign.examine(1, number, solver, drawn=99)
    assert record.violations == {}
