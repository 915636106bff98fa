"""The seed paper's Table 4: the named modes of 2d2n and 2d3n with 16 elements, drawn with their frequencies."""

from __future__ import annotations

import numpy as np
from paper_figures import Drawn, Workshop
from table3 import MORE, NAMES, PER_ELEMENT, PRINTED

from ancf2d.plot.modes import Modes

ELEMENTS = 16
TYPES = ("2d2n", "2d3n")


def mode_figures(shop: Workshop) -> list[Drawn]:
    """Draw the modes of both elements. Raises CaseError, ComputationError and ResultsError."""
    return [_modes(shop, element) for element in TYPES]


def _modes(shop: Workshop, element: str) -> Drawn:
    file = shop.solve(f"table4_{element}", f"paper/table3_{element}",
                      [f"bodies.beam.element.count={ELEMENTS}", f"solver.modes={PER_ELEMENT * ELEMENTS + MORE}"])
    picture = shop.build({"": file}, "modes", f"Table 4: modes of {element}, {ELEMENTS} elements",
                         count=PER_ELEMENT * ELEMENTS + MORE)
    if not isinstance(picture, Modes):
        raise TypeError("modes are drawn as modes")
    # labels end with 'KIND N: OMEGA rad/s'
    omegas = np.array([float(m.label.split(": ")[1].split()[0]) for m in picture.modes])
    chosen, worst = [], 0.0
    for (kind, number), printed in zip(NAMES, PRINTED[element, ELEMENTS].split(), strict=True):
        k = int(np.argmin(np.abs(omegas - float(printed))))
        worst = max(worst, abs(omegas[k] - float(printed)))
        mode = picture.modes[k]
        mode.label = f"{kind} {number}, printed {printed}\nhere {mode.label}"
        chosen.append(mode)
    picture.modes = chosen
    return Drawn("Table 4", f"modes and frequencies of {element}", shop.save(picture, f"table4_{element}"),
                 "The modes are bending, axial, shear and thickness modes.",
                 "Drawn is the mode at each printed frequency, with what it is by its shape. Those printed as "
                 "thickness modes are others (Table 3).", bool(worst < 0.005),
                 "the frequencies; not all of the names")
