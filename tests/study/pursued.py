"""Cases that are solved to a wanted accuracy."""

from __future__ import annotations

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.study.accuracy.setting import Setting, with_setting
from ancf2d.study.goal import Answer, solve_for_goal
from ancf2d.study.run import vocabulary

CANTILEVER = """
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.07e11, nu: 0.3, rho: 7850}
    element: ELEMENT
boundary_conditions: [{type: clamp, at: beam@0}]
loads: [{type: force, at: beam@1, value: [0, -500e3]}]
solver: {type: static}
goal: {probe: tip, quantity: uy}
output: {probes: {tip: beam@1}}
"""
# the lower of two beams is short and stiff: its mesh hardly matters
TWO = """
bodies:
  post:
    geometry: {type: line, start: [0, 0], end: [0, 0.2]}
    section: {height: 0.2, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 1}
  arm:
    geometry: {type: line, start: [0, 0.2], end: [2, 0.2]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 1}
boundary_conditions: [{type: clamp, at: post@0}]
joints: [{type: weld, between: [post@1, arm@0]}]
loads: [{type: force, at: arm@1, value: [0, -500e3]}]
solver: {type: static}
goal: {probe: tip, quantity: uy}
output: {probes: {tip: arm@1}}
"""
SWING = """
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.1, width: 0.05}
    material: {E: 1e6, nu: 0.3, rho: 1000}
    element: {type: cable, count: 1}
boundary_conditions: [{type: pin, at: rod@0}]
loads: [{type: gravity, value: [0, -9.81]}]
solver: {type: dynamic, t_end: 0.2}
goal: {probe: tip, quantity: y}
accuracy: 1e-3
output: {interval: 0.02, probes: {tip: rod@1}}
"""
BETWEEN = (CANTILEVER.replace("clamp, at: beam@0", "pin, at: beam@0}, {type: roller, at: beam@1, fixed: y")
           .replace("force, at: beam@1", "force, at: beam@0.3").replace("tip: beam@1", "tip: beam@0.55")
           .replace("type: static", "type: linear_static"))
SLIDE = CANTILEVER.replace("boundary_conditions:", """  bead:
    geometry: {type: line, start: [0.7, 1], end: [0.7, 0]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: KIND
joints: [{type: prismatic, point: bead@1, on: beam}]
boundary_conditions:""", 1)


def case(text: str, element: str = "{type: vallejo, count: 3}", *overrides: str) -> LoadedCase:
    return load_case_text(text.replace("ELEMENT", element), vocabulary=vocabulary(), overrides=overrides)


def limit(loaded: LoadedCase, count: int, tolerance: float | None = None) -> Answer:
    """Return the answer on a mesh far finer than any that is used."""
    counts = dict.fromkeys(loaded.case.bodies, count)
    return solve_for_goal(with_setting(loaded, Setting(counts, {}, tolerance))).answer
