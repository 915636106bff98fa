"""Random frames and mechanisms compared with independent equations: a few, or as many as --trials says."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from instruments.own_equations import frames as frames_module
from instruments.own_equations import mechanisms as mechanisms_module
from instruments.own_equations.frames import KINDS, frames
from instruments.own_equations.mechanisms import mechanisms
from instruments.own_equations.verdict import Verdict, judge

FRAMES = [0, 1, 3, 4, 5, 30, 7, 8, 9, 22, 11]
RIGID = [0, 1, 2, 3]


def judged(verdicts: Iterable[Verdict], measured: Callable[..., None], place: str) -> list[Verdict]:
    """Note the verdicts on a frame or mechanism; return violated ones with their cases."""
    found = list(verdicts)
    for verdict in found:
        measured("robustness.md", place, verdict.as_row(), "instruments.own_equations.verdict:report")
    return [v for v in found if not v.holds]


@pytest.mark.trials([pytest.param(number, id=KINDS[number % len(KINDS)].name,
                                  marks=() if number == 0 else pytest.mark.slow) for number in FRAMES])
def test_frames(number: int, measured: Callable[..., None]) -> None:
    assert judged(frames([number]), measured, "frames") == []


@pytest.mark.slow
@pytest.mark.trials(RIGID)
def test_mechanisms(number: int, measured: Callable[..., None]) -> None:
    assert judged(mechanisms([number]), measured, "mechanisms") == []


@pytest.mark.slow
def test_a_frame_that_is_too_stiff_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """In ancf2d, one body of several has a section higher by a hundredth."""
    right = frames_module._computed

    def stiffer(case: dict[str, Any]) -> dict[str, np.ndarray]:
        section = case["bodies"]["m0"]["section"]
        for key in section.keys() & {"EI", "I", "height"}:
            section[key] *= 1.01
        return right(case)

    monkeypatch.setattr(frames_module, "_computed", stiffer)
    assert [v.holds for v in frames([1])] == [False, False, False]


@pytest.mark.slow
def test_a_mechanism_in_too_much_gravity_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """In ancf2d, gravity is larger by a thousandth."""
    right, number = mechanisms_module._computed, 0
    assert mechanisms_module.mechanism(number, {"type": "rigid"})["loads"][0]["type"] == "gravity"

    def heavier(case: dict[str, Any]) -> dict[str, np.ndarray]:
        case["loads"][0]["value"] = [1.001 * v for v in case["loads"][0]["value"]]
        return right(case)

    monkeypatch.setattr(mechanisms_module, "_computed", heavier)
    assert not next(mechanisms([number])).holds


def test_the_allowed_deviation() -> None:
    """The error of the finer of two runs of order 2 is a third of their difference; three times that is allowed."""
    def verdict(fine: float) -> Verdict:
        found = Verdict(0, "", "", {})
        true, *runs = ({"forces": np.array([value])} for value in (1.0, fine + 3e-3, fine))
        judge(found, true, runs, order=2, extent=1.0)
        return found

    assert verdict(1.0029).holds
    assert not verdict(1.0031).holds
    assert verdict(1.0031).what == "forces"
