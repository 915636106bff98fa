"""The beams and frames of ``scenes`` in Exudyn, OpenSees and PyElastica (``pip install .[peers]``).

Exudyn: its planar geometrically exact beam and its Euler-Bernoulli ANCF cable; its default tolerance lies below
round-off in these scenes and is loosened. OpenSees: corotational beams, by forces (with shear) and elastic (without),
mass lumped at the nodes with its rotary inertia; its Timoshenko element takes no large turns and stays out.
PyElastica: a Cosserat rod, stepped explicitly (position Verlet); its sections keep their volume as the rod stretches,
so its limit is one of its own. It has no static solver.
"""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from itertools import pairwise
from typing import Any

import numpy as np

from .apart import peak_mb
from .scenes import CYCLE, DEEP, FIBRES, PENDULUMS, STATIC, STEEL, STEPS, WIDE, YIELDING, Bar

MODULES = {"ancf2d": "ancf2d", "exudyn": "exudyn", "opensees": "openseespy", "pyelastica": "elastica"}
# the tightest at which Exudyn converges, in statics and in motion
EXUDYN_STATIC, EXUDYN_MOTION = 1e-6, 1e-5
OPENSEES_STATIC, OPENSEES_MOTION, ITERATIONS = 1e-9, 1e-8, 100


def tools() -> list[str]:
    """Return the tools that are installed."""
    found = [name for name, module in MODULES.items() if importlib.util.find_spec(module)]
    for name in MODULES.keys() - set(found):
        print(f"{name} is not installed (pip install .[peers]): left out", file=sys.stderr)
    return found


# ---------------------------------------------------------------------- Exudyn


def _exudyn(bar: Bar, element: str, count: int, held: int, falls: bool) -> tuple[Any, Any]:
    """Return (system, last node) of a bar along x, the first ``held`` coordinates of its first node fixed."""
    import exudyn as exu
    from exudyn import itemInterface as items  # noqa: N813

    mbs = exu.SystemContainer().AddSystem()
    A, I, h = bar.area, bar.inertia, bar.length / count
    common = {"physicsLength": h, "physicsMassPerLength": bar.rho * A, "physicsBendingStiffness": bar.E * I,
              "physicsAxialStiffness": bar.E * A}
    exact = element == "geometrically exact"
    nodes = [mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[h * i, 0, 0]) if exact else
                         items.NodePoint2DSlope1(referenceCoordinates=[h * i, 0, 1, 0])) for i in range(count + 1)]
    for i in range(count):
        ends = [nodes[i], nodes[i + 1]]
        body = mbs.AddObject(
            items.ObjectBeamGeometricallyExact2D(
                nodeNumbers=ends, physicsCrossSectionInertia=bar.rho * I,
                physicsShearStiffness=bar.shear_stiffness, **common) if exact else
            items.ObjectANCFCable2D(nodeNumbers=ends, **common))
        if falls:
            marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=body))
            mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0, -bar.gravity, 0]))
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    for k in range(held):
        marker = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, marker]))
    return mbs, nodes[-1]


def static_exudyn(element: str, count: int) -> dict[str, Any]:
    """Bend the cantilever; return tip, seconds of build and solve, and memory beyond the imports [MB]."""
    import exudyn as exu
    from exudyn import itemInterface as items  # noqa: N813

    base, start = peak_mb(), time.process_time()
    mbs, tip = _exudyn(STATIC, element, count, 3, falls=False)
    mbs.AddLoad(items.Force(markerNumber=mbs.AddMarker(items.MarkerNodePosition(nodeNumber=tip)),
                          loadVector=[0, -STATIC.load, 0]))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.staticSolver.numberOfLoadSteps = STEPS
    settings.staticSolver.newton.relativeTolerance = EXUDYN_STATIC
    settings.solutionSettings.writeSolutionToFile = False
    settings.staticSolver.verboseMode = 0
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    built = time.process_time()
    mbs.SolveStatic(settings)
    seconds = time.process_time() - built
    u = mbs.GetNodeOutput(tip, exu.OutputVariableType.Displacement)
    return {"u": [float(u[0]), float(u[1])], "build_s": built - start, "solve_s": seconds, "iterations": None,
            "memory_mb": peak_mb() - base}


def exudyn(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict[str, Any]:
    """Let a pendulum fall by generalized alpha; ``solver`` is the step, with ``full`` behind it for full Newton.

    This and the next two return the tip (n, 2) at multiples of ``interval``, the seconds of the steps, their number.
    """
    import exudyn as exu
    from exudyn.itemInterface import SensorNode

    dt, *full = solver.split()
    mbs, tip = _exudyn(PENDULUMS[number], element, count, 2, falls=True)
    sensor = mbs.AddSensor(SensorNode(nodeNumber=tip, storeInternal=True, writeToFile=False,
                                      outputVariableType=exu.OutputVariableType.Position))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    ti, steps = settings.timeIntegration, round(t_end / float(dt))
    ti.numberOfSteps, ti.endTime, ti.verboseMode = steps, t_end, 0
    ti.newton.useModifiedNewton, ti.newton.relativeTolerance = not full, EXUDYN_MOTION
    ti.generalizedAlpha.spectralRadius = 0.9
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = interval
    settings.linearSolverType = exu.LinearSolverType.EXUdense if count <= 8 else exu.LinearSolverType.EigenSparse
    started = time.process_time()
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    seconds = time.process_time() - started
    data = np.array(mbs.GetSensorStoredData(sensor))
    return {"t": data[:, 0].tolist(), "tip": data[:, 1:3].tolist(), "solve_s": seconds, "steps": steps}


# -------------------------------------------------------------------- OpenSees


def _opensees(bar: Bar, element: str, count: int, hangs: bool) -> Any:
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


def static_opensees(element: str, count: int) -> dict[str, Any]:
    """Bend the cantilever with a line search, without which steps of fine meshes fail; return what Exudyn's does."""
    # what loading its library takes
    import openseespy.opensees

    openseespy.opensees.wipe()
    base, began = peak_mb(), time.process_time()
    ops = _opensees(STATIC, element, count, hangs=False)
    ops.fix(1, 1, 1, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(count + 1, 0.0, -STATIC.load, 0.0)
    ops.test("NormDispIncr", OPENSEES_STATIC, ITERATIONS, 0)
    ops.algorithm("NewtonLineSearch", "-type", "Bisection")
    ops.integrator("LoadControl", 1.0 / STEPS)
    ops.analysis("Static")
    built, iterations = time.process_time(), 0
    for step in range(STEPS):
        if ops.analyze(1) != 0:
            raise RuntimeError(f"no equilibrium was found in load step {step + 1}")
        iterations += ops.testIter()
    seconds = time.process_time() - built
    return {"u": [ops.nodeDisp(count + 1, k) for k in (1, 2)], "build_s": built - began, "solve_s": seconds,
            "iterations": iterations, "memory_mb": peak_mb() - base}


def opensees(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict[str, Any]:
    """Let a pendulum fall by HHT; ``solver`` is the step."""
    bar, dt = PENDULUMS[number], float(solver)
    ops = _opensees(bar, element, count, hangs=True)
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
    ops.test("NormDispIncr", OPENSEES_MOTION, ITERATIONS, 0)
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


def fibres_opensees() -> Any:
    """Return OpenSees with a plane model, the section of ``scenes.STEEL`` (1), shear (2), and Lobatto points (1)."""
    import openseespy.opensees as ops

    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    ops.uniaxialMaterial("Hardening", 1, STEEL["E"], STEEL["yield"], 0.0, STEEL["kinematic"])
    ops.uniaxialMaterial("Elastic", 2, STEEL["shear"] * STEEL["E"] / (2 * (1 + STEEL["nu"])) * DEEP * WIDE)
    ops.section("Fiber", 1)
    for x, w in zip(*np.polynomial.legendre.leggauss(FIBRES), strict=True):
        ops.fiber(0.5 * DEEP * x, 0.0, 0.5 * DEEP * WIDE * w, 1)
    ops.section("Aggregator", 2, 2, "Vy", "-section", 1)
    ops.geomTransf("Corotational", 1)
    ops.beamIntegration("Lobatto", 1, 2, 5)
    return ops


def cycled_opensees(ops: Any, node: int, force: tuple[float, ...], steps: int) -> tuple[np.ndarray, float]:
    """Return displacements (steps, ...) of a node under a force that goes through the cycle, and the seconds taken."""
    # its last step may end beyond 1 by round-off, where a path has ended
    ops.timeSeries("Path", 1, "-time", *CYCLE[0], 2.0, "-values", *CYCLE[1], CYCLE[1][-1])
    ops.pattern("Plain", 1, 1)
    ops.load(node, *force)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGen")
    ops.test("NormUnbalance", 1e-7 * max(map(abs, force)), 60)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0 / steps)
    ops.analysis("Static")
    found, began = [], time.process_time()
    for step in range(steps):
        if ops.analyze(1) != 0:
            raise RuntimeError(f"no equilibrium was found in load step {step + 1}")
        found.append(ops.nodeDisp(node))
    seconds = time.process_time() - began
    ops.wipe()
    return np.array(found), seconds


def yielding_opensees(scene: str, count: int) -> dict[str, Any]:
    """Push a frame of fibres beyond yield and back, ``count`` elements in each member; return what ``fibres`` does."""
    # what loading its library takes
    import openseespy.opensees  # noqa: F401

    began, frame, ops = time.process_time(), YIELDING[scene], fibres_opensees()
    corners = np.array(frame.corners, dtype=float)
    places = [corners[0], *(a + (b - a) * (k + 1) / count
                            for a, b in pairwise(corners) for k in range(count))]
    for i, (x, y) in enumerate(places):
        ops.node(i + 1, float(x), float(y))
    for node in {1, len(places) if len(corners) > 2 else 1}:
        ops.fix(node, 1, 1, 1)
    for i in range(1, len(places)):
        ops.element("forceBeamColumn", i, i, i + 1, 1, 1, "-iter", 50, 1e-12)
    built = time.process_time() - began
    force = [0.0, 0.0, 0.0]
    force[frame.along] = frame.push
    u, seconds = cycled_opensees(ops, count + 1, tuple(force), frame.steps)
    return {"u": u[:, frame.along].tolist(), "build_s": built, "solve_s": seconds}


# ------------------------------------------------------------------ PyElastica


def _pyelastica(bar: Bar, count: int) -> tuple[Any, Any]:
    """Return (system collection, rod): the rod along x, pinned at its start, under gravity.

    A circular section of the same area is made first; its matrices are then those of the rectangle.
    """
    import elastica as ea

    class Scene(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        """A rod with a pin and gravity."""

    A, I, h = bar.area, bar.inertia, bar.length / count
    across = bar.height * bar.width**3 / 12
    G = bar.E / (2 * (1 + bar.nu))
    rod = ea.CosseratRod.straight_rod(
        count, start=np.zeros(3), direction=np.array([1.0, 0.0, 0.0]), normal=np.array([0.0, 1.0, 0.0]),
        base_length=bar.length, base_radius=(A / np.pi) ** 0.5, density=bar.rho, youngs_modulus=bar.E, shear_modulus=G)
    # directors: d1 along y, d2 along z (what the plane's bending turns about), d3 along the rod
    for diagonal, matrix in (((bar.shear_stiffness, bar.shear_stiffness, bar.E * A), rod.shear_matrix),
                             ((bar.E * across, bar.E * I, G * (I + across)), rod.bend_matrix),
                             ((bar.rho * h * across, bar.rho * h * I, bar.rho * h * (I + across)),
                              rod.mass_second_moment_of_inertia)):
        for k in range(3):
            matrix[k, k, :] = diagonal[k]
    for k in range(3):
        rod.inv_mass_second_moment_of_inertia[k, k, :] = 1 / rod.mass_second_moment_of_inertia[k, k, :]
    scene = Scene()
    scene.append(rod)
    scene.constrain(rod).using(ea.GeneralConstraint, constrained_position_idx=(0,))
    scene.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0.0, -bar.gravity, 0.0]))
    scene.finalize()
    return scene, rod


def pyelastica(number: int, element: str, count: int, solver: str, t_end: float, interval: float) -> dict[str, Any]:
    """Let a pendulum fall as a Cosserat rod; ``solver`` is the step."""
    import elastica as ea

    dt = float(solver)
    scene, rod = _pyelastica(PENDULUMS[number], count)
    stepper, steps, every = ea.PositionVerlet(), round(t_end / dt), round(interval / dt)
    # compiled on first use
    stepper.step(_pyelastica(PENDULUMS[number], count)[0], np.float64(0.0), np.float64(dt))
    now, t, tip, seconds = np.float64(0.0), [0.0], [rod.position_collection[:2, -1].tolist()], 0.0
    for _ in range(steps // every):
        began = time.process_time()
        for _ in range(every):
            now = stepper.step(scene, now, np.float64(dt))
        seconds += time.process_time() - began
        if not np.isfinite(rod.position_collection).all():
            raise RuntimeError(f"the motion has grown without bound before t = {now:g}: the step is too long")
        t.append(float(now))
        tip.append(rod.position_collection[:2, -1].tolist())
    return {"t": t, "tip": tip, "solve_s": seconds, "steps": steps}
