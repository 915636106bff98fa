"""Random scenes under transformations that must not change the result: a few, or as many as --trials says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import helpers
import pytest
from instruments.scenes import campaign

# scenes of each solver, all checks of each
SCENES = {"linear_static": range(2), "static": range(2), "eigen": range(2), "buckling": range(2)}
# of so many scenes or more, checks that need a further solution are drawn by lot
MANY = 10


@pytest.mark.parametrize(("solver", "number"), helpers.chosen(
    [(s, n) for s, numbers in SCENES.items() for n in numbers], [(s, 0) for s in SCENES]))
def test_scene_does_not_change(solver: str, number: int) -> None:
    record = campaign.examine(1, number, solver, drawn=99)
    assert record.violations == {}


def tried(number: int, config: pytest.Config, folder: Path, laws: bool) -> campaign.Record:
    """Examine a scene; for the first violation, write the smallest case that shows it."""
    seed = config.getoption("seed")
    many = (config.getoption("trials") or 0) >= MANY
    record = campaign.examine(seed, number, drawn=campaign.DRAWN if many else 99, laws=laws)
    for name, what in list(record.violations.items())[:1]:
        path = folder / f"{number}-{name.replace(' ', '-')}.yaml"
        case = campaign.counterexample(seed, number, None, name, laws)
        campaign.write_case(path, case, f"{name}, scene {number} of seed {seed}\n{what}")
        record.violations[name] += f"; the smallest case is {path}"
    return record


@pytest.mark.trials([0])
def test_scenes(number: int, pytestconfig: pytest.Config, tmp_path: Path, measured: Callable[..., None]) -> None:
    """Scenes of any solver."""
    record = tried(number, pytestconfig, tmp_path, laws=False)
    measured("robustness.md", "invariances", asdict(record), "instruments.scenes.campaign:report")
    assert record.violations == {}


@pytest.mark.slow
@pytest.mark.trials([0, 2])
def test_scenes_with_memory(number: int, pytestconfig: pytest.Config, tmp_path: Path,
                            measured: Callable[..., None]) -> None:
    """Their materials yield, follow a curve or relax."""
    record = tried(number, pytestconfig, tmp_path, laws=True)
    measured("robustness.md", "laws", asdict(record), "instruments.scenes.campaign:report")
    assert record.violations == {}
