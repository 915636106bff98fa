"""Shared by tests of studies: cantilevers, and functions that are sent to other processes."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np

BEAM = """\
title: Cantilever
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3, rhoA: 1, rhoI: 1.0e-3}
    element: {type: cable, count: 2}
boundary_conditions:
  - {name: root, type: clamp, at: beam@0}
loads:
  - {name: tip, type: force, at: beam@1, value: [0, -3]}
solver: {type: linear_static}
output:
  probes:
    tip: beam@1
"""
GOAL = "goal: {probe: tip, quantity: uy}\n"
# a cantilever with shear, whose deflections by bending and shear are known
F, L, EI, KGA = -3.0, 2.0, 1.0e3, 3.0e5
BENDING, SHEAR = F * L**3 / (3 * EI), F * L / KGA
CANTILEVER = f"""\
title: Cantilever with a tip force
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [{L}, 0]}}
    section: {{EA: 1.0e6, kGA: {KGA}, EI: {EI}}}
    element: {{type: reissner2, count: 2}}
boundary_conditions:
  - {{name: root, type: clamp, at: beam@0}}
loads:
  - {{type: force, at: beam@1, value: [0, {F}]}}
solver: {{type: linear_static}}
goal: {{probe: tip, quantity: uy}}
output:
  probes: {{tip: beam@1}}
"""
# one with a section and a material
SQUARE = """
bodies:
  b: {geometry: {type: line, start: [0, 0], end: [2, 0]}, section: {height: 0.1, width: 0.1},
      material: {E: 2.07e11, nu: 0.3}, element: {type: reissner3, count: 2}}
boundary_conditions: [{type: clamp, at: b@0}]
loads: [{type: force, at: b@1, value: [0, -1]}]
solver: {type: linear_static}
goal: {probe: tip, quantity: uy}
output: {probes: {tip: b@1}}
"""


def square(x: float) -> float:
    return x * x


def die(x: int) -> int:
    if x % 10 == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def threads(_: int) -> int:
    """Return the number of threads of this process that are not Python's own."""
    a = np.ones((400, 400))
    assert (a @ a)[0, 0] == 400
    return len(os.listdir("/proc/self/task")) - threading.active_count()


def wait_with_note(folder: str) -> int:
    """Leave the number of this process in a folder, and run for a long time."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)
    return 0


def compile_alone(job: tuple[str, str]) -> tuple[float, float]:
    """Return the start and end times of exclusive work of a process."""
    from ancf2d.study.warmup import _compile_lock

    with _compile_lock(Path(job[0]), job[1]):
        began = time.time()
        time.sleep(0.3)
        return began, time.time()
