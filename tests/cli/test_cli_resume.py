"""Motions that are interrupted and resumed on the command line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from ancf2d.results import compare_results, open_results, part_path, read_checkpoint

Call = Callable[..., Result]

PENDULUM = """\
format: 1
title: Flexible pendulum
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.02, width: 0.02}
    material: {E: 1.0e7, nu: 0.3, rho: 1000}
    element: {type: cable, count: 4}
boundary_conditions:
  - {name: hinge, type: pin, at: rod@0}
loads:
  - {type: gravity, value: [0, -9.81]}
solver: {type: dynamic, t_end: END, tolerance: 1e-6}
output:
  interval: 0.01
  probes:
    tip: rod@1
"""
# the command line, in a process that can go on from any state, makes every 50th safe, and signals itself behind one
STOPPED = """
import os, sys
from ancf2d.results.writer import ResultWriter
from ancf2d.solvers.motion import stepping

stepping.CHUNK_SECONDS = 1e-9
last, how, states = int(sys.argv.pop(1)), int(sys.argv.pop(1)), 0

def flush_often(writer):
    global states
    states += 1
    if states % 50 == 0:
        writer.flush()
    if states == last:
        os.kill(os.getpid(), how)

ResultWriter._flush_when_due = flush_often
from ancf2d.cli import main
main()
"""


@pytest.fixture
def pendulum(folder: Path) -> Path:
    """A folder with a pendulum that swings through 500 states."""
    (folder / "rod.yaml").write_text(PENDULUM.replace("END", "5"))
    return folder


def stopped(folder: Path, last: int, how: signal.Signals, *options: str) -> tuple[int, str, str]:
    """Start a run and stop it after so many states; return code, stdout, stderr."""
    done = subprocess.run([sys.executable, "-c", STOPPED, str(last), str(int(how)), "run", "rod.yaml", *options],
                          capture_output=True, text=True, cwd=folder, check=False)
    return done.returncode, done.stdout, done.stderr


def bits(path: Path) -> list[bytes]:
    """Return all computed numbers, bit for bit."""
    with open_results(path) as r:
        states = [r.t.tobytes(), *(r.d(i).tobytes() for i in range(r.nt)), *(r.v(i).tobytes() for i in range(r.nt))]
        columns = [table[name].tobytes() for table in (r.history, r.energies, r.probes["tip"]) for name in table]
    return states + columns


@pytest.mark.slow
def test_a_resumed_run_has_the_same_bits_and_another_case_is_refused(pendulum: Path, call: Call) -> None:
    code, out, err = stopped(pendulum, 283, signal.SIGINT, "--json")
    assert code == 130, err
    assert json.loads(out)["status"] == "interrupted"
    assert "to continue: ancf2d run rod.yaml --json --resume" in err
    assert "Traceback" not in err
    with open_results("rod.h5.part") as r:
        assert r.status == "interrupted"
        reached = r.t[-1]
        assert 0 < reached < 5
    found = read_checkpoint("rod.h5.part")
    assert found is not None
    assert 0 < found.t <= reached
    code, _, err = stopped(pendulum, 171, signal.SIGKILL, "--resume")
    assert f"resuming 'rod.h5.part' at t = {found.t:.6g} s" in err
    assert code == -signal.SIGKILL, err
    again = read_checkpoint("rod.h5.part")
    assert again is not None
    assert again.t > found.t
    other = call("run", "rod.yaml", "--resume", "--set", "bodies.rod.element.count=5")
    assert other.exit_code == 2
    assert "started with other --set options" in other.stderr
    assert part_path(pendulum / "rod.h5").exists()
    result = call("run", "rod.yaml", "--resume")
    assert result.exit_code == 0, result.stderr
    assert call("run", "rod.yaml", "-o", "whole.h5").exit_code == 0
    # not the lists as a whole: were they to differ, pytest would look for what they have in common for an hour
    pairs = zip(bits(pendulum / "rod.h5"), bits(pendulum / "whole.h5"), strict=True)
    assert [k for k, (resumed, whole) in enumerate(pairs) if resumed != whole] == []
    assert not compare_results("rod.h5", "whole.h5", rtol=0, everything=True)


def test_without_anything_to_resume_the_run_says_so_and_starts_afresh(call: Call, folder: Path) -> None:
    result = call("run", "beam.yaml", "--resume")
    assert result.exit_code == 0
    assert "a run of solver linear_static has no checkpoints: starting from the beginning" in result.stderr
    assert (folder / "beam.h5").exists()


def summary(call: Call, *arguments: str) -> dict[str, Any]:
    found = json.loads(call(*arguments, "--json").stdout)
    assert isinstance(found, dict)
    return found


def test_summary_of_a_motion_has_time_energies_and_momentum(pendulum: Path, call: Call) -> None:
    found = summary(call, "run", "rod.yaml", "--set", "solver.t_end=0.5")
    assert found["t"] == 0.5
    assert {"kinetic", "strain", "potential"} <= set(found["energy"])
    assert sum(found["energy"].values()) == pytest.approx(0.0, abs=1e-3 * found["energy"]["kinetic"])
    assert len(found["momentum"]["linear"]) == 2
    assert 0 <= found["energy_drift"] < 1e-3
    assert {"vx", "vy"} <= set(found["probes"]["tip"])
    assert found["steps"] > 10
