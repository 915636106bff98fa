"""Small scenes that once violated an invariance, as written by tests of random scenes, and scenes that vary."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from instruments.scenes import campaign
from instruments.scenes.checks import CHECKS
from instruments.scenes.compare import Scene

HERE = Path(__file__).parent / "scenes"
MOVED = ("rotated by any angle", "mirrored", "shifted by 1000 sizes", "in other units", "in another order")


def violations(name: str, *checks: str) -> dict[str, str]:
    case = yaml.safe_load((HERE / f"{name}.yaml").read_text())
    found = {}
    for seed in range(2):
        scene = Scene(case, seed)
        assert scene.base.refusal == ""
        for check in CHECKS:
            if check.name in checks:
                word, what = campaign.outcome(scene, check)
                if word not in ("held", "unfit"):
                    found[check.name] = f"{word}: {what}"
    return found


def test_reactions_of_rigid_bars_balance_the_loads_of_a_welded_beam() -> None:
    assert violations("rigid_frame", "forces and moments balance", *MOVED) == {}


def test_a_moved_cable_does_not_depend_on_its_position() -> None:
    assert violations("moved_cable", "forces and moments balance", *MOVED) == {}


@pytest.mark.slow_rows("in other units")
@pytest.mark.parametrize("check", MOVED)
def test_buckling_of_welded_unlike_bodies_does_not_depend_on_orientation(check: str) -> None:
    assert violations("unlike_column", check) == {}


@pytest.mark.slow_rows("pinned_bar")
@pytest.mark.parametrize("name", ["pinned_bar", "turned_bar", "held_bar"])
def test_reactions_of_a_single_rigid_bar_balance_its_loads(name: str) -> None:
    assert violations(name, "forces and moments balance", *MOVED) == {}


@pytest.mark.parametrize("name", ["tapered_frame", pytest.param("tapered_modes", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_varying_bodies_are_invariant(name: str) -> None:
    assert violations(name, *MOVED, "a body reversed", "a body split and welded") == {}


@pytest.mark.slow
def test_unloaded_bodies_stand_still() -> None:
    assert violations("still_beam", "forces and moments balance", *MOVED) == {}
    assert violations("unstressed_beam", *MOVED) == {}
