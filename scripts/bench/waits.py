"""What a user waits for once: kernels that the first run of each kind compiles, in an empty cache that fills up."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from .start import ANCF2D, seconds

MATERIAL = {"E": 1e7, "nu": 0.3, "rho": 1000.0}
STATIC = {"type": "static", "steps": 2}
MOTION = {"type": "dynamic", "t_end": 1e-3, "tolerance": 1e-2, "estimate": False}
ALPHA = {"type": "dynamic", "t_end": 1e-3, "dt": 1e-4, "method": "generalized_alpha", "estimate": False}
SPRING: dict[str, Any] = {"springs": [{"type": "translational", "between": ["a@1", [1, 1]], "stiffness": 10.0}]}
TENDON: dict[str, Any] = {"loads": [{"type": "tendon", "on": "a", "y": 0.01, "tension": 1}]}
FLOOR: dict[str, Any] = {"obstacles": {"floor": {"type": "half_plane", "through": [0, -0.03], "normal": [0, 1]}}}
TOUCHES: dict[str, Any] = {"between": ["a", "floor"]}
BODIES = {"between": ["a", "b"]}
LAW = {"law": {"stiffness": 1e5, "damping": 1.0}}
PID: dict[str, Any] = {
    "controllers": {"motor": {"type": "pid", "input": "1 - tip.theta", "kp": 3, "kd": 0.1, "filter": 1e-3}},
    "loads": [{"type": "moment", "at": "a@1", "value": 1, "amplitude": {"type": "expression", "value": "motor"}}]}


def kinds() -> dict[str, dict[str, Any]]:
    """Return cases by what each adds to those before."""
    return {
        "statics, the first run ever": _case(STATIC),
        "another formulation": _case(STATIC, {"type": "vallejo", "count": 4}),
        "a spring": _case(STATIC, **SPRING),
        "a tendon": _case(STATIC, **TENDON),
        "contact with an obstacle": _case(STATIC, contacts=[TOUCHES], **FLOOR),
        "the same with a law": _case(STATIC, contacts=[{**TOUCHES, **LAW}], **FLOOR),
        "contact between bodies": _case(STATIC, contacts=[BODIES]),
        "the same between bodies, with a law": _case(STATIC, contacts=[{**BODIES, **LAW}]),
        "the first motion": _case(MOTION),
        "another integrator": _case(ALPHA),
        "a spring in motion": _case(ALPHA, **SPRING),
        "contact with an obstacle in motion": _case(ALPHA, contacts=[TOUCHES], **FLOOR),
        "contact between bodies in motion": _case(ALPHA, contacts=[BODIES]),
        "a controller": _case(MOTION, **PID)}


def _case(solver: dict[str, Any], element: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    bodies = {name: {"geometry": {"type": "line", "start": [x, y], "end": [x + 1, y]}, "material": MATERIAL,
                     "section": {"height": 0.05, "width": 0.05}, "element": element or {"type": "cable", "count": 4}}
              for name, x, y in (("a", 0.0, 0.0), ("b", 0.5, -0.06))}
    return {"format": 1, "bodies": bodies, "solver": solver, "output": {"probes": {"tip": "a@1"}},
            "loads": [{"type": "force", "at": "a@1", "value": [0, -5.0]}],
            "boundary_conditions": [{"type": "clamp", "at": "a@0"}, {"type": "clamp", "at": "b@1"}], **more}


def measure(repeat: int) -> dict[str, float]:
    """Return the processor's time of a first run less that of a second one [s], by kind."""
    found = {}
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as cache:
        for name, case in kinds().items():
            Path(folder, "case.yaml").write_text(json.dumps(case), encoding="utf-8")
            first, second = (seconds([*ANCF2D, "run", "case.yaml", "-q"], folder, cache)[0] for _ in range(2))
            found[name] = first - second
    return found
