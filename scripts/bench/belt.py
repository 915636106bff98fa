"""The belt drive of ``belt.yaml`` here and in Exudyn, in steps of the same length (``python -m scripts.bench.belt``).

Exudyn: ANCFCable2D with the same nodes, contact of 8 segments of an element with a circle, friction that sticks by a
spring of the stiffness of the layer, trapezoidal rule. Here a layer acts at 4 Gauss points of an element and sticks by
a spring of its stiffness; generalized alpha. Both are judged by their own finest run. Times are those of the processor
without compiling, from the model to the results and for the motion alone. Multipliers of the trapezoidal rule alternate
from step to step: Exudyn's torque is the mean of the last two, with the sign of what the shaft does to the pulley. The
torque at one time depends on which points have just let go; its mean from 0.1 s on does not.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from .apart import apart

STEPS = (2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
FINEST = {"ancf2d": 5e-5, "exudyn": 2e-5}
HELD, BEGIN, T_END = 0.05, 0.1, 0.2
RADIUS, WAY, COUNT, SEGMENTS = 0.10495, 0.1 * math.pi, 60, 8
EA, EI, RHO_A = 8000.0, 0.06666666666666667, 0.8288
LAYER, DAMPING, FRICTION, BRAKE = 8e6, 160.0, 0.5, 1.5
SHORTER, MOVES = -0.025006251562890824, -0.0025


def ancf2d(dt: float) -> dict[str, Any]:
    """Return velocity of the driven pulley, torque of the shaft, its mean, and seconds, of all and of the motion.

    What four steps take is not of the motion, but of the model and the result file.
    """
    import ancf2d as package

    path = Path(__file__).with_name("belt.yaml")

    def solve(changes: dict[str, Any]) -> tuple[Any, float]:
        began = time.process_time()
        return package.solve(path, {"solver.dt": dt, **changes}), time.process_time() - began

    few = {"solver.t_end": 4 * dt, "output.interval": 4 * dt}
    # compiled on first use
    solve(few)
    (found, seconds), (_, begin) = solve({}), solve(few)
    goal = {"reaction": "shaft", "quantity": "m", "mean_over": [BEGIN, T_END]}
    course = package.solve(path, {"solver.dt": dt, "output": {"every": 1}, "goal": goal})
    torques = course.course["shaft"]["m"][course.t > BEGIN - 0.5 * dt]
    return {"omega": float(found.course["driven"]["omega"][-1]), "torque": float(found.reactions["shaft"]["m"]),
            "mean": course.value, "jump": float(np.abs(np.diff(torques)).mean()), "seconds": seconds,
            "motion": seconds - begin}


def _belt(items: Any, mbs: Any) -> tuple[list[int], list[float]]:
    """Add the belt, with weight; return its elements and their lengths."""
    straight = round(COUNT * WAY / (2 * WAY + 2 * math.pi * RADIUS))
    curved = COUNT // 2 - straight
    places, lengths = [], []
    for x, turn in ((0.0, 0.0), (WAY, math.pi)):
        s, c = math.sin(turn), math.cos(turn)
        for k in range(straight):
            places.append((x + c * WAY * k / straight, -c * RADIUS, c, s))
        for k in range(curved):
            a = turn - 0.5 * math.pi + math.pi * k / curved
            places.append((WAY - x + RADIUS * math.cos(a), RADIUS * math.sin(a), -math.sin(a), math.cos(a)))
        lengths += [WAY / straight] * straight + [math.pi * RADIUS / curved] * curved
    nodes = [mbs.AddNode(items.NodePoint2DSlope1(referenceCoordinates=list(p))) for p in places]
    cables = []
    for i, length in enumerate(lengths):
        cable = mbs.AddObject(items.ObjectANCFCable2D(
            nodeNumbers=[nodes[i], nodes[(i + 1) % len(nodes)]], physicsLength=length, physicsMassPerLength=RHO_A,
            physicsBendingStiffness=EI, physicsAxialStiffness=EA, strainIsRelativeToReference=1.0,
            useReducedOrderIntegration=1))
        marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=cable))
        mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0, -9.81, 0]))
        cables.append(cable)
    return cables, lengths


def _pulley(items: Any, mbs: Any, ground: int, x: float, belt: tuple[list[int], list[float]]
            ) -> tuple[int, list[int], int]:
    """Add a pulley that the belt touches; return its node, markers of its coordinates, and what holds it along x."""
    node = mbs.AddNode(items.NodeRigidBody2D(referenceCoordinates=[x, 0, 0]))
    body = mbs.AddObject(items.ObjectRigidBody2D(physicsMass=50, physicsInertia=0.25, nodeNumber=node))
    coordinates = [mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=k)) for k in range(3)]
    held, _ = (mbs.AddObject(items.CoordinateConstraint(markerNumbers=[ground, m])) for m in coordinates[:2])
    centre = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body))
    for cable, length in zip(*belt, strict=True):
        share = length / SEGMENTS
        shape = mbs.AddMarker(items.MarkerBodyCable2DShape(bodyNumber=cable, numberOfSegments=SEGMENTS))
        data = mbs.AddNode(items.NodeGenericData(
            initialCoordinates=[0.1] * SEGMENTS + [-2] * SEGMENTS + [0.0] * SEGMENTS,
            numberOfDataCoordinates=3 * SEGMENTS))
        mbs.AddObject(items.ObjectContactFrictionCircleCable2D(
            markerNumbers=[centre, shape], nodeNumber=data, numberOfContactSegments=SEGMENTS,
            contactStiffness=LAYER * share, contactDamping=DAMPING * share, frictionVelocityPenalty=0.0,
            frictionStiffness=LAYER * share, frictionCoefficient=FRICTION, circleRadius=RADIUS,
            useSegmentNormals=False))
    return node, coordinates, held


def exudyn(dt: float) -> dict[str, Any]:
    """Return the same of Exudyn."""
    import exudyn as exu
    from exudyn import itemInterface as items  # noqa: N813

    started = time.process_time()
    mbs = exu.SystemContainer().AddSystem()
    ground = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0))
    belt = _belt(items, mbs)
    (_, first, held), (driven, second, _) = (_pulley(items, mbs, ground, x, belt) for x in (0.0, WAY))
    drive = mbs.AddObject(items.CoordinateConstraint(
        markerNumbers=[ground, first[2]], velocityLevel=True,
        offsetUserFunction_t=lambda mbs, t, item, offset: max(0.0, 12.0 / 0.55 * (t - HELD))))
    mbs.AddObject(items.CoordinateSpringDamper(markerNumbers=[ground, second[2]], damping=BRAKE))

    torques: list[float] = []

    def straighten(mbs: Any, t: float) -> bool:
        # what is read is of the step before
        if t > BEGIN + 0.5 * dt:
            torques.append(float(np.ravel(mbs.GetObjectOutput(drive, exu.OutputVariableType.Force))[0]))
        if t <= HELD + dt:
            left = max(1.0 - t / HELD, 0.0)
            for cable in belt[0]:
                mbs.SetObjectParameter(cable, "strainIsRelativeToReference", left)
                mbs.SetObjectParameter(cable, "referenceAxialStrain", SHORTER * (1.0 - left))
            mbs.SetObjectParameter(held, "offset", MOVES * (1.0 - left))
        return True

    mbs.Assemble()
    mbs.SetPreStepUserFunction(straighten)
    settings = exu.SimulationSettings()
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    settings.solutionSettings.writeSolutionToFile = False
    settings.parallel.numberOfThreads = 1
    ti = settings.timeIntegration
    ti.endTime, ti.numberOfSteps, ti.verboseMode, ti.newton.useModifiedNewton = T_END, round(T_END / dt), 0, True
    began = time.process_time()
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
    ended = time.process_time()
    omega = mbs.GetNodeOutput(driven, exu.OutputVariableType.AngularVelocity)
    torques.append(float(np.ravel(mbs.GetObjectOutput(drive, exu.OutputVariableType.Force))[0]))
    return {"omega": float(np.ravel(omega)[-1]), "torque": -float(np.mean(torques[-2:])),
            "mean": -float(np.trapezoid(torques)) / (len(torques) - 1),
            "jump": float(np.abs(np.diff(torques)).mean()), "seconds": ended - started, "motion": ended - began}


def main() -> None:
    """Print velocity, torque, its mean and time for every step, with distances from the finest."""
    for tool, finest in FINEST.items():
        fine = apart(f"belt.{tool}", finest)
        if "error" in fine:
            print(f"{tool}: {fine['error']}")
            continue
        for dt in (*STEPS, finest):
            found = fine if dt == finest else apart(f"belt.{tool}", dt)
            if "error" in found:
                print(f"{tool}  dt {dt:g}: {found['error']}", flush=True)
                continue
            off = {name: f"{found[name]:.5f} ({abs(found[name] - fine[name]):.1e})" for name in ("omega", "mean")}
            print(f"{tool}  dt {dt:g}: omega {off['omega']}, torque {found['torque']:.3f}, mean {off['mean']}, between "
                  f"steps {found['jump']:.2f}, {found['seconds']:.2f} s, motion {found['motion']:.2f} s", flush=True)


if __name__ == "__main__":
    main()
