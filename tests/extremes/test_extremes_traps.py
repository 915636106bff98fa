"""Traps of statics: snap-through in the first step, sections turned over, numbers beyond floating point."""

from __future__ import annotations

from dataclasses import replace

import helpers
import pytest
from instruments.extremes import across, cell, modes, statics, traps
from instruments.extremes.scenes import BY_LABEL, SUBJECTS, Beam, cantilever, force

import ancf2d

FEW = ["vallejo", "cable", "reissner3", "2d3n", "omar"]


@pytest.mark.parametrize("label", helpers.chosen(["vallejo", "reissner3", "cable", "patel"], ["cable"]))
def test_a_frame_that_snaps_through_in_the_first_step_is_not_solved(label: str) -> None:
    """The first step alone exceeds the limit load twice: the state beyond is no continuation of the reference."""
    with pytest.raises(ancf2d.ComputationError, match=r"beyond load factor 0\.[01]"):
        traps.snap(label)


@pytest.mark.parametrize("turn", [2.0, 3.1])
@pytest.mark.parametrize("label", helpers.chosen([s.label for s in SUBJECTS], FEW))
def test_a_section_turned_in_one_step_has_the_prescribed_angle(label: str, turn: float) -> None:
    """sin(angle) = 0 holds for the opposite direction, too."""
    try:
        found = traps.flipped(label, turn)
    except ancf2d.ComputationError:
        return
    assert found.error < 1e-6


@pytest.mark.parametrize("label", helpers.chosen([s.label for s in SUBJECTS if s.type.degree_y <= 1], FEW))
def test_no_bar_is_pressed_through_itself(label: str) -> None:
    """The equations have such equilibria; a run ends before the length vanishes, 1/1.1 of the way.

    How near it gets, to 1e-3 or less of the way, is up to round-off: pressed so short, the straight bar is unstable in
    all its modes, and Newton leaves it for none or returns.
    """
    with pytest.raises(ancf2d.ComputationError, match="beyond load factor ") as caught:
        statics.pressed(label, -0.1)
    reached = float(str(caught.value).split("beyond load factor ")[1].split(":")[0])
    assert 0.908 < reached < 1 / 1.1


@pytest.mark.parametrize("label", ["vallejo", "cable", "reissner3", "omar"])
def test_a_bar_pressed_to_a_hundredth_is_right(label: str) -> None:
    assert statics.pressed(label, 0.01).error < 1e-9


def test_a_motion_that_turns_an_element_inside_out_says_so() -> None:
    """Rubber under an impulse that would throw its end through its wall."""
    case = cantilever(BY_LABEL["vallejo"], Beam(L=0.1, E=1e4), 2, [force([-3e3, 0])],
                      {"type": "dynamic", "t_end": 0.02, "dt": 1e-4, "method": "newmark", "estimate": False})
    run = ancf2d.solve(case, states=False, partial=True)
    assert run.status == "failed" or any("is inverted" in w for w in run.warnings)


@pytest.mark.parametrize("label", ["2d2n", "2d3n", "2d2n-nu", "2d3n-nu"])
def test_buckling_of_the_mesh_is_distinguished_from_that_of_the_beam(label: str) -> None:
    found = modes.euler(label, statics.slender(20), 1000)
    assert found.error > 0.9
    assert any("artefact of the mesh" in w for w in found.warnings)


@pytest.mark.parametrize("label", ["2d2n", "vallejo", "cable", "reissner3"])
def test_buckling_of_the_beam_is_not_attributed_to_the_mesh(label: str) -> None:
    found = modes.euler(label, statics.slender(20), 100)
    assert found.error < 0.03
    assert not any("artefact of the mesh" in w for w in found.warnings)


@pytest.mark.parametrize("change", ["bodies.beam.section.height=1e-150", "bodies.beam.material.E=1e300",
                                    "bodies.beam.section.width=1e-300"])
def test_stiffnesses_beyond_floating_point_are_refused_at_their_line(change: str) -> None:
    with pytest.raises(ancf2d.CaseError, match="range of floating-point numbers"):
        traps.extreme_number(change)


@pytest.mark.parametrize("row", [c for c in traps.rows() if c.quick], ids=lambda c: c.key)
def test_traps_are_solved_or_refused_or_announced(row: cell.Cell) -> None:
    assert cell.run(replace(row, seconds=600.0)).verdict in ("holds", "degrades", "refused")


@pytest.mark.parametrize("label", ["omar", "patel", "ancf[1,2]", "ancf[3,1]", "2d3n", "vallejo"])
def test_round_off_of_forces_that_cancel_at_a_clamp_between_nodes_is_no_imbalance(label: str) -> None:
    """An element clamped in its middle turns: the forces of its halves there cancel and leave large round-off."""
    found = across.spun(label, 0.3, 1e-6, 1)
    assert found.error < across.LIMIT
