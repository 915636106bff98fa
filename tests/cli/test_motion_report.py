"""The report of a motion, and its progress bar."""

from __future__ import annotations

import io
import sys
from typing import Any

import pytest

from ancf2d.case import Units
from ancf2d.cli import session as session_module
from ancf2d.cli.report import run_report
from ancf2d.cli.session import Bar

FACTS: dict[str, Any] = {
    "title": "", "solver": "dynamic", "status": "converged", "elements": 8, "dofs": 54, "iterations": 2400,
    "steps": 1000, "wall_s": 0.5, "probes": {}, "reactions": {}, "t": 1.5, "dt": [1.5e-3, 1.5e-3], "rejected": 0,
    "energy": {"kinetic": 2.0, "strain": 0.5, "potential": -2.5}, "energy_drift": 3.2e-9,
    "momentum": {"linear": [1.5, -2.0], "angular": 0.25}}


def lines(units: Units | None = None, **changed: Any) -> dict[str, str]:
    """Return the lines of the report, keyed by their first words."""
    text = run_report({**FACTS, **changed}, units or Units(), 1.0)
    return {line.split()[0]: line.split(maxsplit=1)[1] for line in text.split("\n") if " " in line}


def test_time_steps_energies_and_momentum() -> None:
    found = lines()
    assert "2400 iterations in 1000 steps" in found["converged:"]
    assert found["time"] == "1.5 s, steps of 0.0015 s"
    assert found["energy"] == "kinetic 2, strain 0.5, potential -2.5 [N m]"
    assert found["drift"] == "3.2e-09 of the largest kinetic plus strain energy"
    assert found["momentum"] == "linear (1.5, -2) [N s], about the origin 0.25 [N m s]"
    assert "error" not in found


def test_adaptive_and_rejected_steps() -> None:
    found = lines(dt=[1e-5, 2e-3], rejected=12)
    assert found["time"] == "1.5 s, steps from 1e-05 to 0.002 s, 12 steps rejected and repeated smaller"
    assert lines(dt=[1e-5, 2e-3], rejected=1)["time"].endswith("1 step rejected and repeated smaller")


def test_estimate_of_the_error() -> None:
    assert lines(accuracy={"estimate": 1.26e-3, "of": "time steps"})["error"] == (
        "about 0.0013 from the time steps (not the mesh), relative to the largest displacements")
    # of a wanted accuracy the table of its solves tells
    assert "error" not in lines(accuracy={"estimate": 1e-3, "wanted": 1e-2, "achieved": True})


def test_units_are_those_of_the_case() -> None:
    found = lines(Units("mm", "kN", "ms"))
    assert found["time"] == "1.5 ms, steps of 0.0015 ms"
    assert "[kN mm]" in found["energy"]
    assert "[kN ms]" in found["momentum"]


def test_a_run_without_any_step_is_reported_too() -> None:
    nothing = {k: v for k, v in FACTS.items() if k not in ("t", "dt", "rejected", "energy", "energy_drift", "momentum")}
    assert "time" not in run_report(nothing, Units(), 1.0)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of the bar's clock, as the one entry of a list."""
    now = [100.0]
    monkeypatch.setattr(session_module.time, "monotonic", lambda: now[0])
    return now


class Terminal(io.StringIO):
    """A stderr that claims to be a terminal."""

    def isatty(self) -> bool:
        return True


def test_the_bar_shows_the_time_reached_and_the_time_left(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    """A run resumed at 0.4 that reached 0.6 in 10 s has 20 s left, shown once this has settled."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Bar("solving", True) as bar:
        bar.update(0.4, "t = 4 of 10 s")
        assert terminal.getvalue() == ""  # not worth a bar yet
        clock[0] += 1.0
        bar.update(0.42, "t = 4.2 of 10 s")
        assert "42%  t = 4.2 of 10 s" in terminal.getvalue()
        assert "left" not in terminal.getvalue()
        for k in range(2, 11):
            clock[0] += 1.0
            bar.update(0.4 + 0.02 * k, f"t = {4 + k / 5:g} of 10 s")
        assert "60%  t = 6 of 10 s, 20 s left" in terminal.getvalue()
        clock[0] += 2.0
        bar.update(0.6, "t = 6.0001 of 10 s")  # the bar does not move, the text does
        assert "60%  t = 6.0001 of 10 s, 28 s left" in terminal.getvalue()
        bar.update(1.0, "t = 10 of 10 s")
    assert "100%  t = 10 of 10 s " in terminal.getvalue()


def test_no_bar_without_a_terminal(monkeypatch: pytest.MonkeyPatch, clock: list[float]) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Bar("solving", False) as bar:
        for share in (0.0, 0.5):
            clock[0] += 10.0
            bar.update(share, "t")
    assert terminal.getvalue() == ""
