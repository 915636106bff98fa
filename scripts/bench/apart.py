"""Measurements, each in a process of its own, which nothing that ran before it disturbs."""

from __future__ import annotations

import importlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from ancf2d.processors import THREADS
from scripts.pages import ROOT


def apart(function: str, *arguments: Any, threads: int = 1, seconds: float | None = None) -> Any:
    """Return what ``MODULE.FUNCTION`` of this folder returns, from a process of its own; {"error": ...} if it fails.

    Arguments and result pass as JSON. ``seconds``: after which the process is killed.
    """
    command = [sys.executable, "-m", "scripts.bench.apart", function, json.dumps(arguments)]
    environment = {**os.environ, **dict.fromkeys(THREADS, str(threads)),
                   "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds, env=environment)
    if done.returncode == 0:
        # tools print what they like before it
        return json.loads(done.stdout.strip().splitlines()[-1])
    # OpenSees says goodbye behind its failure
    lines = [x for x in (done.stderr or done.stdout).splitlines() if x.strip() and not x.startswith("Process ")]
    return {"error": lines[-1] if lines else f"exit code {done.returncode}"}


def seconds(call: Callable[[], Any], repeat: int) -> list[float]:
    """Return the processor's time of each of some calls [s]."""
    out = []
    for _ in range(repeat):
        began = time.process_time()
        call()
        out.append(time.process_time() - began)
    return out


def peak_mb() -> float:
    """Return the peak resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    module, _, name = sys.argv[1].partition(".")
    found = getattr(importlib.import_module(f"scripts.bench.{module}"), name)(*json.loads(sys.argv[2]))
    print("\n" + json.dumps(found), flush=True)
