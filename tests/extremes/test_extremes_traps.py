"""Traps of statics: snap-through in the first step, sections turned over, numbers beyond floating point."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import ancf2d

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from extremes import cell, traps
from extremes.scenes import SUBJECTS


@pytest.mark.parametrize("label", ["vallejo", "reissner3", "cable", "patel"])
def test_a_frame_that_snaps_through_in_the_first_step_is_not_solved(label: str) -> None:
    """The first step alone exceeds the limit load twice: the state beyond is no continuation of the reference."""
    with pytest.raises(ancf2d.ComputationError, match="beyond load factor 0.[01]"):
        traps.snap(label)


@pytest.mark.parametrize("turn", [2.0, 3.1])
@pytest.mark.parametrize("label", [s.label for s in SUBJECTS])
def test_a_section_turned_in_one_step_stands_where_it_is_told(label: str, turn: float) -> None:
    """sin(angle) = 0 holds for the opposite direction, too."""
    try:
        found = traps.flipped(label, turn)
    except ancf2d.ComputationError:
        return
    assert found.error < 1e-6


@pytest.mark.parametrize("change", ["bodies.beam.section.height=1e-150", "bodies.beam.material.E=1e300",
                                    "bodies.beam.section.width=1e-300"])
def test_stiffnesses_beyond_floating_point_are_refused_where_they_are_given(change: str) -> None:
    with pytest.raises(ancf2d.CaseError, match="range of floating-point numbers"):
        traps.extreme_number(change)


@pytest.mark.parametrize("row", [c for c in traps.rows() if c.quick], ids=lambda c: c.key)
def test_traps_hold_or_are_refused_or_told(row: cell.Cell) -> None:
    assert cell.run(row).verdict in ("holds", "degrades", "refused")
