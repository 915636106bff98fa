"""The seed paper's Figures 3 to 5 and the modes of its Table 4, and what all its figures are drawn with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ancf2d.errors import ComputationError
from ancf2d.plot import Curves, Picture, build, rendered, save
from ancf2d.plot.modes import Modes
from ancf2d.results import open_results
from ancf2d.study.convergence import convergence, write_convergence
from ancf2d.study.run import load, run_case
from scripts import table3
from scripts.pages import CASES
from scripts.paper_tables import MESHES

# the rows of Table 2 as the paper names them, with what stands for them where that is another element
NAMES = {"2d2n": "2d2n", "2d3n": "2d3n", "beam188": "BEAM188 (reissner2)", "beam189": "BEAM189 (reissner3)",
         "omar": "Ref. [18] (omar)"}
COMPARED = ("2d2n", "2d3n", "beam188")
DIRECTIONS = {"ux": "horizontal", "uy": "vertical"}
THEORIES = {"linear": "fig4_linear", "nonlinear": "table2"}
# of Table 4
MODE_ELEMENTS = 16
MODE_TYPES = ("2d2n", "2d3n")


@dataclass(frozen=True)
class Drawn:
    """A picture that stands for one of the paper.

    ``claim`` is what the paper reads from it, ``seen`` what is measured here, ``holds`` whether that bears it out, and
    ``but`` what to say with that.
    """

    name: str
    title: str
    file: Path
    claim: str
    seen: str
    holds: bool
    but: str = ""


@dataclass(frozen=True)
class Workshop:
    """Where pictures and result files go, and how large what is drawn is.

    ``meshes`` are the numbers of elements of Figure 3, ``elements`` that of Figures 4 and 5, ``share`` the part of
    their time that motions are followed, ``suffix`` the format of the pictures.
    """

    folder: Path
    meshes: Sequence[int] = MESHES
    elements: int = MESHES[-1]
    share: float = 1.0
    suffix: str = "png"
    told: Callable[[str], None] = field(default=lambda text: None)

    def solve(self, name: str, case: str, overrides: Sequence[str] = ()) -> Path:
        """Return the result file of a case, solved unless it is there. Raises CaseError and ComputationError."""
        file = self.folder / f"{name}.h5"
        if not file.exists():
            self.told(f"solving {case} {' '.join(overrides)}".rstrip())
            outcome = run_case(load(CASES / f"{case}.yaml", list(overrides)), str(file))
            if outcome.failure is not None:
                raise outcome.failure
        return file

    def build(self, files: dict[str, Path], kind: str, title: str, **options: Any) -> Picture:
        """Return the picture of files by the names that they go by."""
        with ExitStack() as stack:
            results = {label: stack.enter_context(open_results(file)) for label, file in files.items()}
            picture = build(results, kind, **options)
        picture.title = title
        return picture

    def save(self, picture: Picture, name: str) -> Path:
        """Write a picture and return its file."""
        return save(rendered(picture), self.folder / f"{name}.{self.suffix}", force=True)


def length(meters: float) -> str:
    """Return a length in metres or, below a tenth of one, millimetres, two digits."""
    return f"{meters:.2g} m" if meters >= 0.1 else f"{1e3 * meters:.2g} mm"


def static_figures(shop: Workshop) -> list[Drawn]:
    """Draw Figures 3 to 5. Raises CaseError, ComputationError and ResultsError."""
    return [*(_figure_3(shop, quantity) for quantity in DIRECTIONS), _figure_4(shop),
            *(_figure_5(shop, theory) for theory in THEORIES)]


def _figure_3(shop: Workshop, quantity: str) -> Drawn:
    files, last = {}, {}
    for name, label in NAMES.items():
        loaded = load(CASES / "paper" / f"table2_{name}.yaml", [f"goal.quantity={quantity}"])
        files[label] = shop.folder / f"figure3_{quantity}_{name}.h5"
        found = convergence(loaded, meshes=shop.meshes)
        write_convergence(found, loaded, str(files[label]))
        answer = found.rows[-1].answer
        if answer is None:
            raise ComputationError(f"Figure 3: {label} has no solution with {shop.meshes[-1]} elements")
        last[name] = answer.value
    way = DIRECTIONS[quantity]
    picture = shop.build(files, "convergence", f"Figure 3: {way} displacement of the tip", values=True)
    off = {name: abs(last[name] / last["beam189"] - 1) for name in ("2d2n", "2d3n", "omar")}
    seen = (f"With {shop.meshes[-1]} elements the {way} displacement is {off['2d2n']:.2%} (2d2n), {off['2d3n']:.2%} "
            f"(2d3n) and {off['omar']:.1%} (Ref. [18]) from the geometrically exact beam.")
    return Drawn("Figure 3", f"{way} displacement of the cantilever's tip over the number of elements",
                 shop.save(picture, f"figure3_{quantity}"),
                 "2d2n, 2d3n, BEAM188 and BEAM189 tend to be consistent; the element of Ref. [18] tends elsewhere.",
                 seen, max(off["2d2n"], off["2d3n"]) < 0.1 * off["omar"])


def _cantilevers(shop: Workshop, theory: str) -> dict[str, Path]:
    return {NAMES[name]: shop.solve(f"{theory}_{name}", f"paper/{THEORIES[theory]}_{name}",
                                    [f"bodies.beam.element.count={shop.elements}"]) for name in COMPARED}


def _figure_4(shop: Workshop) -> Drawn:
    files = {f"{theory} {label}": file for theory in THEORIES for label, file in _cantilevers(shop, theory).items()}
    picture = shop.build(files, "shape", "Figure 4: cantilever by linear and nonlinear theory")
    most = max(max(farthest(_apart(shop, theory)).values()) for theory in THEORIES)
    return Drawn("Figure 4", "deformed cantilever by linear and nonlinear theory", shop.save(picture, "figure4"),
                 "The configurations of 2d2n and 2d3n are identical to that of BEAM188.",
                 f"They are within {length(most)} of it, {most / 2:.2%} of the beam's length: one line in the picture.",
                 most < 0.01)


def _apart(shop: Workshop, theory: str) -> Curves:
    picture = shop.build(_cantilevers(shop, theory), "difference", f"Figure 5: cantilever by {theory} theory")
    if not isinstance(picture, Curves):
        raise TypeError("distances are curves")
    return picture


def farthest(picture: Curves) -> dict[str, float]:
    """Return the largest value of each curve by name."""
    return {c.name: float(c.y.max()) for panel in picture.panels for c in panel.curves}


def _figure_5(shop: Workshop, theory: str) -> Drawn:
    picture = _apart(shop, theory)
    found = farthest(picture)
    told = ", ".join(f"{length(value)} ({name})" for name, value in found.items())
    return Drawn("Figure 5", f"distance from BEAM188 along the cantilever, {theory} theory",
                 shop.save(picture, f"figure5_{theory}"), "The errors are very small compared with the deformation.",
                 f"At most {told}.",
                 max(found.values()) < 0.01)


def mode_figures(shop: Workshop) -> list[Drawn]:
    """Draw the modes of both elements. Raises CaseError, ComputationError and ResultsError."""
    return [_modes(shop, element) for element in MODE_TYPES]


def _modes(shop: Workshop, element: str) -> Drawn:
    count = table3.PER_ELEMENT * MODE_ELEMENTS + table3.MORE
    file = shop.solve(f"table4_{element}", f"paper/table3_{element}",
                      [f"bodies.beam.element.count={MODE_ELEMENTS}", f"solver.modes={count}"])
    picture = shop.build({"": file}, "modes", f"Table 4: modes of {element}, {MODE_ELEMENTS} elements", count=count)
    if not isinstance(picture, Modes):
        raise TypeError("modes are drawn as modes")
    # labels end with 'KIND N: OMEGA rad/s'
    omegas = np.array([float(m.label.split(": ")[1].split()[0]) for m in picture.modes])
    chosen, worst = [], 0.0
    for (kind, number), printed in zip(table3.NAMES, table3.PRINTED[element, MODE_ELEMENTS].split(), strict=True):
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
