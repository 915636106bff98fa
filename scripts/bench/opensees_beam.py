"""The bench's scenes in OpenSees: corotational beams by forces (with shear) and the elastic one (without).

Mass is lumped at the nodes with its rotary inertia, gravity with it. The Timoshenko element of OpenSees takes no large
turns and stays out.
"""

from __future__ import annotations

import math
import time
from typing import Any

from scenes import PENDULUMS, STATIC, Bar

# tests and iterations of Newton's method; load steps of fine meshes are only met with a line search
STATIC_TOLERANCE, ITERATIONS = 1e-9, 100


def build(bar: Bar, element: str, count: int, hangs: bool) -> Any:
    """Return OpenSees with a bar from the origin along x, or down and with mass; nodes 1 to count + 1, none held."""
    import openseespy.opensees as ops

    A, I, h = bar.area, bar.inertia, bar.length / count
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for i in range(count + 1):
        ops.node(i + 1, *((0.0, -h * i) if hangs else (h * i, 0.0)))
        if hangs:
            m = (0.5 if i in (0, count) else 1.0) * h * bar.rho
            ops.mass(i + 1, m * A, m * A, m * I)
    ops.geomTransf("Corotational", 1)
    ops.section("Elastic", 1, bar.E, A, I, bar.E / (2 * (1 + bar.nu)), bar.shear)
    # exact for a section that is elastic
    ops.beamIntegration("Legendre", 1, 1, 2)
    for i in range(count):
        ends = (i + 1, i + 2)
        if element == "force-based":
            ops.element("forceBeamColumn", i + 1, *ends, 1, 1)
        else:
            ops.element("elasticBeamColumn", i + 1, *ends, A, bar.E, I, 1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("BandGen")
    return ops


def solve_static(element: str, count: int, steps: int) -> dict:
    """Bend the cantilever; return tip, seconds of build and solve, iterations."""
    began = time.process_time()
    ops = build(STATIC, element, count, hangs=False)
    ops.fix(1, 1, 1, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(count + 1, 0.0, -STATIC.load, 0.0)
    ops.test("NormDispIncr", STATIC_TOLERANCE, ITERATIONS, 0)
    ops.algorithm("NewtonLineSearch", "-type", "Bisection")
    ops.integrator("LoadControl", 1.0 / steps)
    ops.analysis("Static")
    built, iterations = time.process_time(), 0
    for step in range(steps):
        if ops.analyze(1) != 0:
            raise RuntimeError(f"no equilibrium was found in load step {step + 1}")
        iterations += ops.testIter()
    seconds = time.process_time() - built
    u = [ops.nodeDisp(count + 1, k) for k in (1, 2)]
    return {"u": u, "build_s": built - began, "solve_s": seconds, "iterations": iterations}


def solve_pendulum(number: int, element: str, count: int, t_end: float, dt: float, interval: float,
                   tolerance: float = 1e-8) -> dict:
    """Return the tip (n, 2) at multiples of ``interval``, the seconds of the solve and the number of steps."""
    bar = PENDULUMS[number]
    ops = build(bar, element, count, hangs=True)
    ops.fix(1, 1, 1, 0)
    for i in range(count + 1):
        # its corotational frames turn by less than half a turn from where they were built, in either sense
        s = bar.length * i / count
        for k, u in enumerate((s, s, 0.5 * math.pi)):
            ops.setNodeDisp(i + 1, k + 1, u, "-commit")
        if i > 0:
            ops.setNodeAccel(i + 1, 2, -bar.gravity, "-commit")
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    for i in range(count + 1):
        ops.load(i + 1, 0.0, -bar.gravity * ops.nodeMass(i + 1, 2), 0.0)
    ops.test("NormDispIncr", tolerance, ITERATIONS, 0)
    ops.algorithm("Newton")
    ops.integrator("HHT", 0.95)
    ops.analysis("Transient")
    steps, every = round(t_end / dt), round(interval / dt)
    t, tip, seconds = [0.0], [[bar.length, 0.0]], 0.0
    for _ in range(steps // every):
        began = time.process_time()
        failed = ops.analyze(every, dt)
        seconds += time.process_time() - began
        if failed:
            raise RuntimeError(f"Newton's method did not converge after t = {ops.getTime():g}")
        t.append(ops.getTime())
        tip.append([ops.nodeDisp(count + 1, 1), ops.nodeDisp(count + 1, 2) - bar.length])
    return {"t": t, "tip": tip, "solve_s": seconds, "steps": steps}
