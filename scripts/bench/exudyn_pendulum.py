"""The pendulums of Sec. 5.4 in Exudyn: its geometrically exact beam and its Euler-Bernoulli ANCF cable.

Exudyn's default tolerance lies below round-off on pendulum (1): it must be loosened, or it aborts.
"""

from __future__ import annotations

import time

import numpy as np
from scenes import PENDULUMS, Bar


def build(p: Bar, element: str, count: int):
    """Return (system, tip node); ``element`` is ``geometrically exact`` or ``cable``."""
    import exudyn as exu
    from exudyn.itemInterface import (
        CoordinateConstraint,
        LoadMassProportional,
        MarkerBodyMass,
        MarkerNodeCoordinate,
        NodePoint2DSlope1,
        NodePointGround,
        NodeRigidBody2D,
        ObjectANCFCable2D,
        ObjectBeamGeometricallyExact2D,
    )

    system = exu.SystemContainer()
    mbs = system.AddSystem()
    A, I, h = p.area, p.inertia, p.length / count
    common = {"physicsLength": h, "physicsMassPerLength": p.rho * A, "physicsBendingStiffness": p.E * I,
              "physicsAxialStiffness": p.E * A}
    exact = element == "geometrically exact"
    nodes = [mbs.AddNode(NodeRigidBody2D(referenceCoordinates=[h * i, 0, 0]) if exact else
                         NodePoint2DSlope1(referenceCoordinates=[h * i, 0, 1, 0])) for i in range(count + 1)]
    for i in range(count):
        ends = [nodes[i], nodes[i + 1]]
        body = mbs.AddObject(
            ObjectBeamGeometricallyExact2D(
                nodeNumbers=ends, physicsCrossSectionInertia=p.rho * I,
                physicsShearStiffness=p.shear_stiffness, **common) if exact else
            ObjectANCFCable2D(nodeNumbers=ends, **common))
        mbs.AddLoad(LoadMassProportional(
            markerNumber=mbs.AddMarker(MarkerBodyMass(bodyNumber=body)), loadVector=[0, -p.gravity, 0]))
    ground = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=mbs.AddNode(NodePointGround()), coordinate=0))
    for k in range(2):
        held = mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(CoordinateConstraint(markerNumbers=[ground, held]))
    return mbs, nodes[-1]


def solve(number: int, element: str, count: int, t_end: float, dt: float, interval: float, *, modified: bool = False,
          tolerance: float = 1e-6, radius: float = 0.9) -> dict:
    """Return the tip (n, 2) at multiples of ``interval``, the seconds of the solve call and the number of steps."""
    import exudyn as exu
    from exudyn.itemInterface import SensorNode

    mbs, tip = build(PENDULUMS[number], element, count)
    sensor = mbs.AddSensor(SensorNode(nodeNumber=tip, storeInternal=True, writeToFile=False,
                                      outputVariableType=exu.OutputVariableType.Position))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    ti, steps = settings.timeIntegration, round(t_end / dt)
    ti.numberOfSteps, ti.endTime, ti.verboseMode = steps, t_end, 0
    ti.newton.useModifiedNewton, ti.newton.relativeTolerance = modified, tolerance
    ti.generalizedAlpha.spectralRadius = radius
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = interval
    settings.linearSolverType = exu.LinearSolverType.EXUdense if count <= 8 else exu.LinearSolverType.EigenSparse
    started = time.process_time()
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    seconds = time.process_time() - started
    data = np.array(mbs.GetSensorStoredData(sensor))
    return {"t": data[:, 0].tolist(), "tip": data[:, 1:3].tolist(), "solve_s": seconds, "steps": steps}
