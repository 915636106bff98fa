"""Violations of joints and supports in motion: from the solver's log, and from the positions of probes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scripts.pages import small, table

from .runs import Motion, case, distance, follow

METHODS = {"radau5": "tolerance: 1e-6", "generalized_alpha": "dt: 5e-4, estimate: false",
           "energy_momentum": "dt: 5e-4, estimate: false"}
# bodies of the scenes
ROD = ("{{geometry: {{type: line, start: {start}, end: {end}}}, section: {{height: 0.02, width: 0.05}}, "
       "material: {{E: {E}, nu: 0.3, rho: 1000}}, element: {{type: {element}, count: 2}}}}")
BAR = "{{geometry: {{type: line, start: {start}, end: {end}}}, element: {{type: rigid, mass: 1, inertia: 0.1}}}}"


@dataclass(frozen=True)
class Joint:
    """A joint in a scene: bodies, constraints, probes, and its violation from the probes [m or rad]."""

    name: str
    bodies: dict[str, str]
    more: str
    probes: dict[str, str]
    off: Callable[[Motion], float] | None


def rod(element: str, start: list[float], end: list[float], E: float = 2e7) -> str:
    """Return a rod as YAML, soft by default."""
    return ROD.format(element=element, start=start, end=end, E=E)


def bar(start: list[float], end: list[float]) -> str:
    """Return a rigid bar as YAML."""
    return BAR.format(start=start, end=end)


def _apart(motion: Motion) -> float:
    return distance(motion.place("one"), motion.place("two"))


def _bent(motion: Motion) -> float:
    return float(np.max(np.abs(motion.column("one", "theta") - motion.column("two", "theta"))))


def _welded(motion: Motion) -> float:
    return max(_apart(motion), _bent(motion))


def _off_line(motion: Motion) -> float:
    return float(np.max(np.abs(motion.place("one")[:, 1])))


def _stretched(motion: Motion) -> float:
    length = np.hypot(*(motion.place("one") - motion.place("two")).T)
    return float(np.max(np.abs(length - length[0])))


def _off_signal(motion: Motion) -> float:
    return float(np.max(np.abs(motion.column("one", "theta") - 0.8 * (1.0 - np.cos(6.0 * motion.t)))))


A, B, C = [0.0, 0.0], [1.0, 0.0], [2.0, 0.0]
PIN = "boundary_conditions: [{type: pin, at: a@0}]\n"
TURN = ("boundary_conditions: [{type: pin, at: a@0}, {type: prescribed, at: a@0, "
        "angle: {type: expression, value: '0.8*(1-cos(6*t))'}}]\n")


def _between(kind: str) -> str:
    return f"{PIN}joints: [{{type: {kind}, between: [a@1, b@0]}}]\n"


ENDS = {"one": "a@1", "two": "b@0"}
JOINTS = (
    Joint("pin, two rods", {"a": rod("cable", A, B), "b": rod("cable", B, C)}, _between("pin"), ENDS, _apart),
    Joint("pin, rod and rigid bar", {"a": rod("vallejo", A, B), "b": bar(B, C)}, _between("pin"), ENDS, _apart),
    Joint("weld, one type", {"a": rod("cable", A, B), "b": rod("cable", B, [1.6, 0.8])}, _between("weld"), ENDS,
          _welded),
    Joint("weld, two types", {"a": rod("cable", A, B), "b": rod("vallejo", B, [1.6, 0.8])}, _between("weld"), ENDS,
          _welded),
    Joint("weld, rod and rigid bar", {"a": rod("vallejo", A, B), "b": bar(B, [1.6, 0.8])}, _between("weld"), ENDS,
          _welded),
    Joint("slider", {"a": rod("cable", [0.0, 0.5], [1.0, 0.0])},
          "boundary_conditions: []\njoints: [{type: slider, at: a@1, through: [0, 0], along: [1, 0]}]\n",
          {"one": "a@1"}, _off_line),
    Joint("prismatic", {"a": rod("cable", A, B), "b": bar([0.35, 0.1], [0.65, -0.1])},
          f"{PIN}joints: [{{type: prismatic, point: b@0.5, on: a}}]\n", {"one": "b@0.5"}, None),
    Joint("rigid bar's length", {"a": bar(A, B), "b": bar(B, C)}, _between("pin"), {"one": "b@0", "two": "b@1"},
          _stretched),
    Joint("prescribed angle, theta", {"a": rod("reissner3", A, B, 2e9)}, TURN, {"one": "a@0"}, _off_signal),
    Joint("prescribed angle, direction", {"a": rod("vallejo", A, B, 2e9)}, TURN, {"one": "a@0"}, _off_signal),
    Joint("prescribed angle, rigid bar", {"a": bar(A, B)}, TURN, {"one": "a@0"}, _off_signal),
)


def hold(joint: Joint, solver: str) -> tuple[float, float | None]:
    """Return the largest violation in the log of all steps, and at probes of stored states over the scene's size."""
    bodies = "\n".join(f"  {name}: {text}" for name, text in joint.bodies.items())
    probes = ", ".join(f"{name}: {at}" for name, at in joint.probes.items())
    motion = follow(case(f"bodies:\n{bodies}\n{joint.more}loads: [{{type: gravity, value: [0, -9.81]}}]\n"
                         f"solver: {{type: dynamic, t_end: 0.4, {solver}}}\n"
                         f"output: {{interval: 0.0123, probes: {{{probes}}}}}\n"))
    if motion.outcome.failure is not None:
        raise motion.outcome.failure
    return motion.violation, None if joint.off is None else joint.off(motion) / motion.outcome.model.extent


def report() -> str:
    """Return the table of joints."""
    rows = []
    for joint in JOINTS:
        row = [joint.name]
        for method, solver in METHODS.items():
            if method == "energy_momentum" and "reissner3" in str(joint.bodies):
                row += ["refused", ""]
                continue
            log, seen = hold(joint, f"method: {method}, {solver}")
            row += [small(log), small(seen)]
        rows.append(row)
    return table(["joint", *(f"{m}{what}" for m in METHODS for what in ("", ", by probes"))], rows)
