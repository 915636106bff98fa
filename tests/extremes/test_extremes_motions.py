"""Motions: error estimates of far too long steps, and a quick part of the map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from instruments.extremes import cell, motions
from instruments.extremes.scenes import BY_LABEL, Beam

import ancf2d


def solution(dt: float, method: str = "generalized_alpha") -> ancf2d.Solution:
    """Return a pendulum that falls for half a second with given steps."""
    beam = Beam(L=1.0, h=0.05, b=0.05, E=1e7)
    return ancf2d.solve(motions.pendulum(BY_LABEL["vallejo"], beam, 4, 0.5, method=method, dt=dt), states=False)


@pytest.mark.parametrize(("dt", "method"), [(0.1, "energy_momentum"), (0.5, "energy_momentum"),
                                            (0.5, "generalized_alpha")])
def test_runs_cut_to_the_same_steps_have_no_estimate(dt: float, method: str) -> None:
    """Their differences vanish, but the error does not."""
    run = solution(dt, method)
    assert run.accuracy["estimate"] is None
    assert any("no error estimate" in w for w in run.warnings)


def test_far_too_long_steps_estimate_their_error_and_warn() -> None:
    """Half a second of fall in five steps has an error of 8 %."""
    run, fine = solution(0.1), solution(1e-3)
    end, wanted = (np.array([one.probes["tip"][q] for q in ("ux", "uy")]) for one in (run, fine))
    error = np.linalg.norm(end - wanted) / np.linalg.norm(wanted)
    assert 0.05 < error < run.accuracy["estimate"] < 5.0 * error
    assert any("too large for this motion" in w for w in run.warnings)


def test_a_very_slender_beam_falls_in_about_as_many_steps_as_a_slender_one() -> None:
    """Newton's method leaves no strains of sections, which would dwarf those of bending at tiny displacements."""
    runs = [ancf2d.solve(motions.pendulum(BY_LABEL["vallejo"], motions.falling(ratio), 8, 0.1, estimate=False,
                                          tolerance=1e-6), states=False) for ratio in (1e4, 1e6)]
    assert runs[1].summary["steps"] < 5000
    assert runs[1].probes["tip"]["uy"] == pytest.approx(runs[0].probes["tip"]["uy"], rel=1e-3)


def test_resolved_steps_are_estimated() -> None:
    run = solution(2e-3)
    assert 1e-6 < run.accuracy["estimate"] < 1e-2
    assert not run.warnings


def test_accurate_steps_of_any_length_are_estimated() -> None:
    """Uniform flight: runs with longer steps differ by round-off only, but they are different runs."""
    run = ancf2d.solve({"bodies": {"rod": Beam(L=1.0, h=0.05, b=0.05, E=1e7).body(BY_LABEL["vallejo"], 2)},
                        "initial": {"velocity": [1.0, 0.5]}, "output": {"probes": {"tip": "rod@1"}},
                        "solver": {"type": "dynamic", "t_end": 0.5, "dt": 0.01, "method": "generalized_alpha"}},
                       states=False)
    assert run.accuracy["estimate"] < 1e-9
    assert not run.warnings


@pytest.mark.slow
@pytest.mark.parametrize("row", [c for c in motions.rows() if c.quick], ids=lambda c: c.key)
def test_motions_are_right_or_refused_or_announced(row: cell.Cell) -> None:
    assert cell.run(replace(row, seconds=600.0)).verdict in ("holds", "degrades", "refused")


def spinning(label: str, turns: float, **solver: float) -> ancf2d.Solution:
    """Return a free rod that has turned so many times."""
    case = {"bodies": {"rod": Beam(L=1.0, h=0.5, b=0.02, E=2e7).body(BY_LABEL[label], 1, (-0.5, 0.0))},
            "initial": {"rotation_rate": {"omega": 20.0, "about": [0, 0]}},
            "solver": {"type": "dynamic", "t_end": math.pi * turns / 10.0, "estimate": False, **solver}}
    return ancf2d.solve(case, states=False)


def test_many_turns_that_loosen_the_tolerance_give_a_warning() -> None:
    """Angles count as displacements, to which local errors are relative."""
    assert any("error of the steps is larger than the tolerance" in w
               for w in spinning("reissner2", 10.0, tolerance=1e-3).warnings)


@pytest.mark.parametrize(("label", "turns", "solver"), [
    ("vallejo", 10.0, {"tolerance": 1e-3}), ("reissner2", 1.0, {"tolerance": 1e-3}), ("reissner2", 10.0, {"dt": 0.01})])
def test_turns_that_loosen_nothing_give_no_warning(label: str, turns: float, solver: dict[str, float]) -> None:
    assert not spinning(label, turns, **solver).warnings
