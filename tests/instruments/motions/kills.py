"""Runs killed at random moments and resumed: files are readable, and the final bits the same."""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results import open_results, part_path
from scripts.pages import table

PENDULUM = """\
title: Flexible pendulum
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.02, width: 0.02}
    material: {E: 1.0e7, nu: 0.3, rho: 1000}
    element: {type: cable, count: 4}
boundary_conditions: [{name: hinge, type: pin, at: rod@0}]
loads: [{type: gravity, value: [0, -9.81]}]
solver: {type: dynamic, t_end: 40, tolerance: 1e-7}
output: {interval: 0.02, probes: {tip: rod@1}}
"""
# this share of the kills comes while a run starts, which takes about START s; the others within WITHIN s of new states
EARLY, START, WITHIN = 0.2, 3.0, 1.2


@dataclass
class Found:
    """Counts of kills by what they left, of runs that ended, and of those with other bits."""

    absent: int = 0
    readable: int = 0
    damaged: list[str] = field(default_factory=list)
    states: list[int] = field(default_factory=list)
    ended: int = 0
    other: int = 0

    @property
    def kills(self) -> int:
        """Number of kills."""
        return self.absent + self.readable + len(self.damaged)


def bits(path: Path) -> list[bytes]:
    """Return all computed numbers, bit for bit."""
    with open_results(path) as r:
        out = [r.t.tobytes(), *(r.d(i).tobytes() for i in range(r.nt)), *(r.v(i).tobytes() for i in range(r.nt))]
        return out + [t[name].tobytes() for t in (r.history, r.energies, r.probes["tip"]) for name in t]


def _start(folder: Path) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "ancf2d", "run", "rod.yaml", "-q", "--resume"], cwd=folder,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def _states(folder: Path) -> int:
    """Return how many states a run has stored so far."""
    # it may be gone, as the run has just ended
    with suppress(ResultsError), open_results(part_path(folder / "rod.h5")) as r:
        return r.nt
    return 0


def _wait(process: subprocess.Popen[bytes], folder: Path, chance: random.Random) -> None:
    """Wait for a random moment, or the end of a run."""
    seconds, before = chance.uniform(0.0, WITHIN), _states(folder)
    if chance.random() < EARLY:
        seconds = chance.uniform(0.0, START)
    else:
        while process.poll() is None and _states(folder) <= before:
            time.sleep(0.02)
    until = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)


def _look(folder: Path, found: Found) -> None:
    """Record what a killed run has left, and read every state of it."""
    part = part_path(folder / "rod.h5")
    if not part.exists():
        found.absent += 1
        return
    try:
        with open_results(part) as r:
            for i in range(r.nt):
                r.d(i)
            found.states.append(r.nt)
        found.readable += 1
    except ResultsError as error:
        found.damaged.append(str(error))


def _ended(folder: Path, whole: list[bytes], found: Found) -> None:
    """Compare a finished run with the uninterrupted one, and make room for the next."""
    found.ended += 1
    found.other += bits(folder / "rod.h5") != whole
    (folder / "rod.h5").unlink()


def kill(count: int, seed: int = 1) -> Found:
    """Kill runs ``count`` times; each resumes what the last one left. Raises RuntimeError if a run fails."""
    chance, found = random.Random(seed), Found()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rod.yaml").write_text(PENDULUM)
        command = [sys.executable, "-m", "ancf2d", "run", "rod.yaml", "-q", "-o", "whole.h5"]
        subprocess.run(command, cwd=folder, check=True)
        whole = bits(folder / "whole.h5")
        while found.kills < count or part_path(folder / "rod.h5").exists():
            process = _start(folder)
            if found.kills < count:
                _wait(process, folder, chance)
                process.kill()
            _, error = process.communicate()
            if process.returncode == 0:
                _ended(folder, whole, found)
            elif process.returncode < 0:
                _look(folder, found)
            else:
                raise RuntimeError(error.decode())
    return found


def report(count: int) -> str:
    """Return the table of kills."""
    f = kill(count)
    rows = [[str(f.kills), str(f.absent), str(f.readable), str(len(f.damaged)),
             f"{min(f.states, default=0)} to {max(f.states, default=0)}", str(f.ended), str(f.other)]]
    return table(["kills", "before a file existed", "left a readable file", "left a damaged file", "states in it",
                  "finished runs", "of these with other bits"], rows)
