"""What starting costs: help, validation, a warm run and the first run ever, beside the imports they cannot avoid.

Every figure is the median of whole processes, run in turn; ratios are to ``python -c "import numpy, scipy.linalg,
numba, h5py, yaml, click"`` in the same round.

    python scripts/bench/startup.py --repeat 5
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CASE = Path(__file__).resolve().parents[2] / "cases" / "paper" / "table1_2d2n.yaml"
IMPORTS = [sys.executable, "-c", "import numpy, scipy.linalg, numba, h5py, yaml, click"]
FIRST = "first run ever"
ANCF2D = [sys.executable, "-m", "ancf2d"]


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
    commands = {"the imports alone": IMPORTS, "--help": [*ANCF2D, "--help"],
                "validate": [*ANCF2D, "validate", str(CASE)], "run": [*ANCF2D, "run", str(CASE), "-q"]}
    first = [FIRST, f"{FIRST}, by the wall"]
    found: dict[str, list[float]] = {name: [] for name in [*commands, *first]}
    with tempfile.TemporaryDirectory() as folder:
        for command in commands.values():
            seconds(command, folder)
        for k in range(repeat):
            for name, command in commands.items():
                found[name].append(seconds(command, folder)[0])
            if k < 3:
                with tempfile.TemporaryDirectory() as cache:
                    for name, time_ in zip(first, seconds(commands["run"], folder, cache), strict=True):
                        found[name].append(time_)
    return {name: statistics.median(times) for name, times in found.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    found = measure(parser.parse_args().repeat)
    for name, middle in found.items():
        print(f"{name:20s} {middle:7.3f} s   {middle / found['the imports alone']:6.2f} of the imports alone")


if __name__ == "__main__":
    main()
