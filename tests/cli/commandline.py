"""A case with a known answer, and the command line in its own process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from typing import Any

# a cantilever with a tip force in linear statics; the cable is exact: uy = F L^3/(3 E I) with E I = 1e3 N m^2
BEAM = """\
format: 1
title: Cantilever with a tip force
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3}
    element: {type: cable, count: 2}
boundary_conditions:
  - {name: root, type: clamp, at: beam@0}
loads:
  - {name: tip, type: force, at: beam@1, value: [0, -3]}
solver: {type: linear_static}
goal: {probe: tip, quantity: uy}
output:
  probes:
    tip: beam@1
expected: [{probe: tip, quantity: uy, value: -8.0e-3, rtol: 1e-9, source: F L^3/(3 E I)}]
"""
# Newton cannot follow so large a moment in one element
HOPELESS = BEAM.replace("linear_static", "static").replace("{name: tip, type: force, at: beam@1, value: [0, -3]}",
                                                          "{name: tip, type: moment, at: beam@1, value: 1.0e7}")


def start(arguments: Sequence[str], **options: Any) -> subprocess.Popen[str]:
    """Start the command line in its own process."""
    return subprocess.Popen([sys.executable, "-m", "ancf2d", *arguments], text=True, **options)


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    """Run Python code in its own process."""
    return subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, timeout=60)
