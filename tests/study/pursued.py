"""Cases that are solved to a required accuracy."""

from __future__ import annotations

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.study.accuracy.setting import Setting, with_setting
from ancf2d.study.goal import GoalValue, solve_for_goal
from ancf2d.study.run import vocabulary

STEEL = "{E: 2.07e11, nu: 0.3, rho: 7850}"


def _body(start: str, end: str, element: str, height: float = 0.1, material: str = STEEL) -> str:
    return (f"{{geometry: {{type: line, start: {start}, end: {end}}}, section: {{height: {height}, width: 0.1}}, "
            f"material: {material}, element: {element}}}")


def _tip(body: str, quantity: str, solver: str, output: str = "") -> str:
    return (f"solver: {{{solver}}}\ngoal: {{probe: tip, quantity: {quantity}}}\n"
            f"output: {{{output}probes: {{tip: {body}@1}}}}\n")


CANTILEVER = f"""
bodies:
  beam: {_body("[0, 0]", "[2, 0]", "ELEMENT")}
boundary_conditions: [{{type: clamp, at: beam@0}}]
loads: [{{type: force, at: beam@1, value: [0, -500e3]}}]
{_tip("beam", "uy", "type: static")}"""
# the lower of two beams is short and stiff: its mesh hardly matters
TWO = f"""
bodies:
  post: {_body("[0, 0]", "[0, 0.2]", "{type: reissner3, count: 1}", 0.2)}
  arm: {_body("[0, 0.2]", "[2, 0.2]", "{type: reissner3, count: 1}")}
boundary_conditions: [{{type: clamp, at: post@0}}]
joints: [{{type: weld, between: [post@1, arm@0]}}]
loads: [{{type: force, at: arm@1, value: [0, -500e3]}}]
{_tip("arm", "uy", "type: static")}"""
SWING = f"""
accuracy: 1e-3
bodies:
  rod: {_body("[0, 0]", "[1, 0]", "{type: cable, count: 1}", material="{E: 1e6, nu: 0.3, rho: 1000}")}
boundary_conditions: [{{type: pin, at: rod@0}}]
loads: [{{type: gravity, value: [0, -9.81]}}]
{_tip("rod", "y", "type: dynamic, t_end: 0.2", "interval: 0.02, ")}"""
BETWEEN = (CANTILEVER.replace("clamp, at: beam@0", "pin, at: beam@0}, {type: roller, at: beam@1, fixed: y")
           .replace("force, at: beam@1", "force, at: beam@0.3").replace("tip: beam@1", "tip: beam@0.55")
           .replace("type: static", "type: linear_static"))
SLIDE = CANTILEVER.replace("boundary_conditions:", f"""  bead: {_body("[0.7, 1]", "[0.7, 0]", "KIND")}
joints: [{{type: prismatic, point: bead@1, on: beam}}]
boundary_conditions:""", 1)


def case(text: str, element: str = "{type: vallejo, count: 3}", *overrides: str) -> LoadedCase:
    return load_case_text(text.replace("ELEMENT", element), vocabulary=vocabulary(), overrides=overrides)


def limit(loaded: LoadedCase, count: int, tolerance: float | None = None) -> GoalValue:
    """Return the answer on a mesh far finer than any used."""
    counts = dict.fromkeys(loaded.case.bodies, count)
    return solve_for_goal(with_setting(loaded, Setting(counts, {}, tolerance))).answer
