"""Thirty more cases to be solved to a wanted accuracy, among them some in which graded elements pay."""

from __future__ import annotations

from .cases import CHAIN, KNEE, PINNED, RING, RUBBER, TIP, Study, beam

TENSE = "{EA: 1e7, kGA: 1e7, EI: 1}"
LINEAR = "{type: linear_static}"
EIGEN = "{type: eigen, modes: 4}"


def tense(element: str, turns: str, tension: float, goal: str, load: str) -> str:
    """Return a beam of 2 m clamped at both ends under tension, which bends in layers of sqrt(EI/tension) alone."""
    return beam(element, goal, f"{{type: force, at: beam@1, value: [{tension}, 0]}}, {load}", section=TENSE,
                supports="{name: wall, type: clamp, at: beam@0}, {name: end, type: roller, at: beam@1, fixed: y}, "
                         f"{{type: fix, at: beam@1, coordinates: [{turns}]}}")


UNIFORM = "{type: distributed, on: beam, value: [0, -1e-3]}"
MIDDLE = "{type: force, at: beam@0.5, value: [0, -1e-3]}"
ROOT, MID = "{probe: root, quantity: M}", "{probe: mid, quantity: uy}"
DOWN = "{type: force, at: beam@1, value: [0, -2e5]}"

MORE = (
    # layers at the ends, and at forces at points
    Study("layers, cable, moment", tense("{type: cable, count: 2}", "rx_y", 1e5, ROOT, UNIFORM)),
    Study("layers, reissner3, moment", tense("{type: reissner3, count: 2}", "theta", 1e5, ROOT, UNIFORM)),
    Study("layers, reissner2, energy", tense("{type: reissner2, count: 2}", "theta", 1e4, "{quantity: strain_energy}",
                                             UNIFORM)),
    Study("layers, reissner2, reaction", tense("{type: reissner2, count: 2}", "theta", 3e4,
                                               "{reaction: wall, quantity: m}", UNIFORM)),
    Study("thin layers, reissner3, moment", tense("{type: reissner3, count: 2}", "theta", 1e6, ROOT, UNIFORM)),
    Study("tense, point load, moment", tense("{type: cable, count: 2}", "rx_y", 1e5, "{probe: mid, quantity: M}",
                                             MIDDLE)),
    Study("tense, point load, reissner2", tense("{type: reissner2, count: 2}", "theta", 3e4, MID, MIDDLE)),
    # element types and loads
    Study("cantilever, omar structural", beam("{type: omar, formulation: structural, count: 2}", TIP, DOWN)),
    Study("cantilever, li", beam("{type: li, count: 2}", TIP, DOWN)),
    Study("cantilever, 2d3n-nu", beam("{type: 2d3n-nu, count: 2}", TIP, DOWN)),
    Study("cantilever, patel, turn", beam("{type: patel, count: 2}", "{probe: tip, quantity: theta}", DOWN)),
    Study("cantilever, ancf[3,3]", beam("{type: ancf, order: [3, 3], count: 2}", TIP, DOWN, height=0.2)),
    Study("moment at the end, cable", beam("{type: cable, count: 2}", "{probe: mid, quantity: ux}",
                                           "{type: moment, at: beam@1, value: 1.2}", section="{EA: 1e6, EI: 1}")),
    Study("weight and a force, vallejo", beam("{type: vallejo, count: 2}", MID, "{type: gravity, value: [0, -9.81]}, "
                                              "{type: force, at: beam@0.3, value: [0, -4e4]}", height=0.05)),
    Study("force near a pin, linear, energy", beam("{type: reissner2, count: 2}", "{quantity: strain_energy}",
                                                   "{type: force, at: beam@0.02, value: [0, -1e5]}", LINEAR,
                                                   supports=PINNED)),
    Study("force between, linear, moment", beam("{type: cable, count: 2}", "{probe: root, quantity: M}",
                                                "{type: force, at: beam@0.3, value: [0, -1e4]}", LINEAR,
                                                supports="{name: wall, type: clamp, at: beam@0}, {name: right, type: "
                                                         "roller, at: beam@1, fixed: y}")),
    Study("load over a strip, reissner2", beam("{type: reissner2, count: 2}", MID, "{type: distributed, on: beam, "
                                               "value: [0, -1e6], from: 0.48, to: 0.5}", LINEAR, supports=PINNED)),
    Study("half ring, reissner2", RING.replace("ELEMENT", "{type: reissner2, count: 2}")),
    Study("half ring, 2d2n-nu, reaction", RING.replace("ELEMENT", "{type: 2d2n-nu, count: 2}"),
          ("goal={reaction: left, quantity: m}", "loads.0.at=ring@0.6")),
    Study("half ring, linear, cable", RING.replace("ELEMENT", "{type: cable, count: 2}"),
          ("solver.type=linear_static", "loads.0.value=[0, -150]")),
    Study("knee, linear", KNEE, ("solver.type=linear_static",)),
    Study("knee, moment at the foot", KNEE, ("goal={reaction: foot, quantity: m}",)),
    Study("chain, place of the bar", CHAIN, ("goal={probe: mid, quantity: uy}",)),
    Study("uniform load", "static/uniform_load.yaml"),
    Study("tapered cantilever", "static/tapered_cantilever.yaml"),
    Study("rotating beam", "static/rotating_beam.yaml"),
    # frequencies, load factors and motions
    Study("clamped at both ends, second frequency, li", beam("{type: li, count: 2}", "{kind: bending, number: 2}", "",
                                                             EIGEN, supports="{type: clamp, at: beam@0}, {type: clamp, "
                                                                             "at: beam@1}")),
    Study("wedge, first frequency", "modes/wedge.yaml"),
    Study("clamped column, load factor", "buckling/euler_clamped.yaml"),
    Study("swinging beam, reissner3", beam(
        "{type: reissner3, count: 2}", "{probe: tip, quantity: y}", "{type: gravity, value: [0, -9.81]}",
        "{type: dynamic, t_end: 0.4, tolerance: 1e-4}", height=0.1, material=RUBBER,
        supports="{name: pivot, type: pin, at: beam@0}"), ("output.interval=0.02",)),
)
