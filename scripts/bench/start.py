"""What starting costs: help, validation, a warm run and the first run ever, beside the imports they cannot avoid."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time

from scripts.pages import CASES

CASE = str(CASES / "paper" / "table1_2d2n.yaml")
ANCF2D = [sys.executable, "-m", "ancf2d"]
ALONE, FIRST = "the imports alone", "first run ever"
COMMANDS = {ALONE: [sys.executable, "-c", "import numpy, scipy.linalg, numba, h5py, yaml, click"],
            "--help": [*ANCF2D, "--help"], "validate": [*ANCF2D, "validate", CASE], "run": [*ANCF2D, "run", CASE, "-q"]}


def seconds(command: list[str], folder: str, cache: str | None = None) -> tuple[float, float]:
    """Return the processor's and the wall's time of a command [s]; ``cache`` is a folder for compiled kernels.

    Python may keep its bytecode, as it does for every package that is installed.
    """
    environment = dict(os.environ, **({"XDG_CACHE_HOME": cache} if cache else {}))
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, time.perf_counter() - began


def measure(repeat: int) -> dict[str, float]:
    """Return the median time of each way to start [s]; the wall's too of the first run, which processors share."""
    first = [FIRST, f"{FIRST}, by the wall"]
    found: dict[str, list[float]] = {name: [] for name in [*COMMANDS, *first]}
    with tempfile.TemporaryDirectory() as folder:
        for command in COMMANDS.values():
            seconds(command, folder)
        for k in range(repeat):
            for name, command in COMMANDS.items():
                found[name].append(seconds(command, folder)[0])
            if k < 3:
                with tempfile.TemporaryDirectory() as cache:
                    for name, time_ in zip(first, seconds(COMMANDS["run"], folder, cache), strict=True):
                        found[name].append(time_)
    return {name: statistics.median(times) for name, times in found.items()}
