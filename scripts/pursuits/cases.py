"""Cases to be solved to a wanted accuracy, each a file of the collection or a few lines."""

from __future__ import annotations

from dataclasses import dataclass

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.study.run import load, vocabulary
from scripts.pages import CASES

STEEL = "{E: 2.07e11, nu: 0.3, rho: 7850}"
RUBBER = "{E: 1e7, nu: 0.3, rho: 1000}"


@dataclass(frozen=True)
class Study:
    """A case by name; ``source``: a path below cases/ or the text itself; ``sets`` are overrides."""

    name: str
    source: str
    sets: tuple[str, ...] = ()

    def loaded(self) -> LoadedCase:
        """Return the case, read."""
        if self.source.endswith(".yaml"):
            return load(CASES / self.source, self.sets)
        return load_case_text(self.source, vocabulary=vocabulary(), overrides=self.sets)


def beam(element: str, goal: str, loads: str, solver: str = "{type: static}", *, height: float = 0.1,
         section: str = "", material: str = STEEL, supports: str = "{name: wall, type: clamp, at: beam@0}",
         more: str = "") -> str:
    """Return the text of a case of one beam of 2 m, probed at its tip and middle."""
    what = f"section: {section}" if section else f"section: {{height: {height}, width: 0.1}}\n    material: {material}"
    return f"""
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    {what}
    element: {element}
boundary_conditions: [{supports}]
loads: [{loads}]
solver: {solver}
goal: {goal}
{more}
output: {{probes: {{tip: beam@1, mid: beam@0.5, root: beam@0}}}}
"""


TIP = "{probe: tip, quantity: uy}"
PINNED = "{name: left, type: pin, at: beam@0}, {name: right, type: roller, at: beam@1, fixed: y}"
# a thick column carries a slender beam, pinned to a wall
KNEE = """
bodies:
  column:
    geometry: {type: line, start: [0, 0], end: [0, 1]}
    section: {height: 0.3, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: 2d3n-nu, count: 2}
  girder:
    geometry: {type: line, start: [0, 1], end: [3, 1.5]}
    section: {height: 0.06, width: 0.1}
    material: {E: 2.07e11, nu: 0.3}
    element: {type: reissner3, count: 2}
boundary_conditions: [{name: foot, type: clamp, at: column@0}, {name: end, type: pin, at: girder@1}]
joints: [{type: weld, between: [column@1, girder@0]}]
loads: [{type: distributed, on: girder, value: [0, -2e4]}]
solver: {type: static}
goal: {probe: mid, quantity: uy}
output: {probes: {mid: girder@0.5}}
"""
CHAIN = """
bodies:
  first:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.05, width: 0.05}
    material: {E: 1e9, nu: 0.3}
    element: {type: reissner2, count: 2}
  bar:
    geometry: {type: line, start: [1, 0], end: [1.5, 0]}
    section: {height: 0.05, width: 0.05}
    material: {E: 1e9, nu: 0.3, rho: 1000}
    element: {type: rigid}
  last:
    geometry: {type: line, start: [1.5, 0], end: [2.5, 0]}
    section: {height: 0.03, width: 0.05}
    material: {E: 1e9, nu: 0.3}
    element: {type: cable, count: 1}
boundary_conditions: [{name: left, type: clamp, at: first@0}, {name: right, type: clamp, at: last@1}]
joints: [{type: pin, between: [first@1, bar@0]}, {type: pin, between: [bar@1, last@0]}]
loads: [{type: force, at: bar@0.3, value: [0, -300]}]
solver: {type: static}
goal: {reaction: right, quantity: m}
output: {probes: {mid: bar@0.5}}
"""
RING = """
bodies:
  ring:
    geometry: {type: arc, center: [0, 0], radius: 1, from: 0, to: 3.141592653589793}
    section: {height: 0.04, width: 0.04}
    material: {E: 2.07e11, nu: 0.3, rho: 7850}
    element: ELEMENT
boundary_conditions: [{name: left, type: clamp, at: ring@0}]
loads: [{type: force, at: ring@1, value: [0, -1500]}]
solver: {type: static}
goal: {probe: tip, quantity: ux}
output: {probes: {tip: ring@1}}
"""
SWING = beam("{type: cable, count: 2}", "{probe: tip, quantity: y}", "{type: gravity, value: [0, -9.81]}",
             "{type: dynamic, t_end: 0.5, tolerance: 1e-4}", height=0.05, material=RUBBER,
             supports="{name: pivot, type: pin, at: beam@0}")
STRUCK = beam("{type: vallejo, count: 2}", TIP,
              "{type: force, at: beam@1, value: [0, -20], amplitude: {type: sine, frequency: 2}}",
              "{type: dynamic, t_end: 0.4, tolerance: 1e-4}", height=0.2, material=RUBBER)

STUDIES = (
    Study("cantilever, reissner3", beam("{type: reissner3, count: 1}", TIP,
                                        "{type: force, at: beam@1, value: [0, -5e5]}")),
    Study("cantilever, vallejo", beam("{type: vallejo, count: 1}", TIP,
                                      "{type: force, at: beam@1, value: [0, -5e5]}")),
    Study("cantilever, kerkkanen", beam("{type: kerkkanen, count: 1}", TIP,
                                        "{type: force, at: beam@1, value: [0, -2e5]}")),
    Study("cantilever, 2d2n-nu", beam("{type: 2d2n-nu, count: 1}", TIP,
                                      "{type: force, at: beam@1, value: [0, -2e5]}")),
    Study("thick continuum, ancf[3,2]", beam("{type: ancf, order: [3, 2], count: 1}", TIP,
                                             "{type: force, at: beam@1, value: [0, -1e6]}", "{type: linear_static}",
                                             height=0.5)),
    Study("thick, omar enhanced, distributed", beam("{type: omar, formulation: enhanced, count: 1}",
                                                    "{probe: mid, quantity: uy}",
                                                    "{type: distributed, on: beam, value: [0, -1e6]}",
                                                    "{type: linear_static}", height=0.4, supports=PINNED)),
    Study("load over a part, cable, M", beam("{type: cable, count: 1}", "{probe: root, quantity: M}",
                                             "{type: distributed, on: beam, value: [0, -1e3], from: 0.6, to: 1}",
                                             height=0.02)),
    Study("roll-up, reissner2", beam("{type: reissner2, count: 1}", "{probe: mid, quantity: ux}",
                                            "{type: moment, at: beam@1, value: 1.2}",
                                            section="{EA: 1e6, kGA: 1e6, EI: 1}")),
    Study("follower tip force", "static/follower_force.yaml"),
    Study("follower pressure, cable", beam("{type: cable, count: 1}", "{probe: tip, quantity: theta}",
                                           "{type: distributed, on: beam, value: [0, -1.0], follower: true}",
                                           section="{EA: 1e5, EI: 1}")),
    Study("elastica, strain energy", beam("{type: 2d3n-nu, count: 1}", "{quantity: strain_energy}",
                                          "{type: force, at: beam@1, value: [0, -3e3]}", height=0.02)),
    Study("propped, reaction", beam("{type: reissner2, count: 1}", "{reaction: right, quantity: fy}",
                                    "{type: distributed, on: beam, value: [0, -3e4]}", height=0.05,
                                    supports="{name: wall, type: clamp, at: beam@0}, {name: right, type: pin, "
                                             "at: beam@1}")),
    Study("deep arch", "static/deep_arch.yaml"),
    Study("half ring, vallejo", RING.replace("ELEMENT", "{type: vallejo, count: 2}")),
    Study("half ring, cable, load between nodes", RING.replace("ELEMENT", "{type: cable, count: 2}"),
          ("loads.0.at=ring@0.7",)),
    Study("Lee's frame", "static/lee_frame.yaml"),
    Study("frame of two types", KNEE),
    Study("chain with a rigid link, reaction", CHAIN),
    Study("three hinges", "static/three_hinged_frame.yaml"),
    Study("portal of three bodies", "static/portal_frame.yaml", ("solver.type=static", "loads.0.value=[300000, 0]")),
    Study("portal, third frequency", "modes/portal_frame.yaml", ("goal.number=4",)),
    Study("thick beam's frequency", "modes/omar_enhanced.yaml"),
    Study("turning beam's frequency", "modes/rotating_cantilever_cable.yaml"),
    Study("third frequency, vallejo", "modes/timoshenko_vallejo.yaml", ("goal.number=3",)),
    Study("column, load factor", "buckling/euler_propped.yaml"),
    Study("stretched column, reissner2", "buckling/stretched_column.yaml", (
        "bodies.column.element={type: reissner2, count: 4}",)),
    Study("limit point of a shallow arch", "paths/shallow_arch.yaml", (
        "solver.until={probe: apex, quantity: uy, reaches: -2.5}",)),
    Study("swinging cable", SWING, ("output.interval=0.02",)),
    Study("struck thick beam", STRUCK, ("output.interval=0.02",)),
    Study("four-bar linkage", "dynamic/four_bar.yaml", ("solver.t_end=0.1", "output.interval=0.0025")),
)

# element types left open: errors are against the geometrically exact beam
OPEN = (
    Study("auto: cantilever", beam("auto", TIP, "{type: force, at: beam@1, value: [0, -5e5]}")),
    Study("auto: frame, one thick member", KNEE, ("bodies.column.element=auto", "bodies.girder.element=auto")),
    Study("auto: stiff link between two beams", CHAIN, (
        "bodies.first.element=auto", "bodies.bar.element=auto", "bodies.last.element=auto",
        "bodies.bar.material.E=2e11",
        "bodies.bar.section.height=0.3")),
    Study("auto: four-bar linkage", "dynamic/four_bar.yaml", (
        "solver.t_end=0.1", "output.interval=0.0025", "bodies.crank.element=auto", "bodies.coupler.element=auto",
        "bodies.rocker.element=auto")),
)
