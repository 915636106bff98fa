"""The seed paper's Figures 3 to 5, computed and drawn anew."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from paper_tables import MESHES

from ancf2d.plot import draw, save
from ancf2d.results import open_results
from ancf2d.study.convergence import convergence
from ancf2d.study.convergence_file import write_convergence
from ancf2d.study.run import load, run_case

CASES = Path(__file__).resolve().parents[1] / "cases" / "paper"
# the rows of Table 2 as the paper names them, with what stands for them where that is another element
NAMES = {"2d2n": "2d2n", "2d3n": "2d3n", "beam188": "BEAM188 (reissner2)", "beam189": "BEAM189 (reissner3)",
         "omar": "Ref. [18] (omar)"}
COMPARED = ("2d2n", "2d3n", "beam188")
DIRECTIONS = {"ux": "horizontal", "uy": "vertical"}
THEORIES = {"linear": "fig4_linear", "nonlinear": "table2"}


def make_figures(folder: Path, meshes: Sequence[int] = MESHES, elements: int = MESHES[-1]) -> list[Path]:
    """Write the figures and the result files that they are drawn from into a folder; return the pictures.

    ``meshes`` are the numbers of elements of Figure 3, ``elements`` that of Figures 4 and 5. Raises CaseError,
    ComputationError and ResultsError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pictures = [_figure_3(folder, quantity, meshes) for quantity in DIRECTIONS]
    files = {(theory, name): _solve(folder, theory, name, elements) for theory in THEORIES for name in COMPARED}
    pictures.append(_picture({f"{theory} {NAMES[name]}": file for (theory, name), file in files.items()},
                             folder / "figure4.png", "shape", "Figure 4: cantilever by linear and nonlinear theory"))
    for theory in THEORIES:
        named = {NAMES[name]: files[theory, name] for name in COMPARED}
        pictures.append(_picture(named, folder / f"figure5_{theory}.png", "difference",
                                 f"Figure 5: cantilever by {theory} theory"))
    return pictures


def _figure_3(folder: Path, quantity: str, meshes: Sequence[int]) -> Path:
    files = {}
    for name, label in NAMES.items():
        loaded = load(CASES / f"table2_{name}.yaml", [f"goal.quantity={quantity}"])
        files[label] = folder / f"figure3_{quantity}_{name}.h5"
        write_convergence(convergence(loaded, meshes=meshes), loaded, str(files[label]))
    return _picture(files, folder / f"figure3_{quantity}.png", "convergence",
                    f"Figure 3: {DIRECTIONS[quantity]} displacement of the tip", values=True)


def _solve(folder: Path, theory: str, name: str, elements: int) -> Path:
    file = folder / f"{theory}_{name}.h5"
    outcome = run_case(load(CASES / f"{THEORIES[theory]}_{name}.yaml", [f"bodies.beam.element.count={elements}"]),
                       str(file))
    if outcome.failure is not None:
        raise outcome.failure
    return file


def _picture(files: dict[str, Path], picture: Path, kind: str, title: str, **options: Any) -> Path:
    with ExitStack() as stack:
        results = {label: stack.enter_context(open_results(file)) for label, file in files.items()}
        return save(draw(results, kind, title=title, **options), picture)
