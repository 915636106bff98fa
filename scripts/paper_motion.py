"""The seed paper's Figures 7 to 19 (pendulums and slider-crank), computed and drawn anew.

They print no numbers: what is judged is what the paper reads from them, by distances that are measured here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ancf2d.plot import Curve, Curves, Panel
from ancf2d.results import open_results
from scripts.paper_figures import Drawn, Workshop, length

TYPES = ("2d2n", "2d3n")
PENDULUM_MESHES = (4, 8, 16)
# of the connecting rod: 2d3n needs more
ROD_MESHES = {"2d2n": (2, 4, 8), "2d3n": (8, 16, 32)}
ENDS = {"pendulum1": 1.5, "pendulum2": 0.5, "slider_crank": 0.3}  # s
STAND_INS = {"cable": "BEAM3 (cable)", "reissner3": "BEAM188 (reissner3)"}
ABAQUS = "B32 (reissner3)"
# where the size of a difference is judged: of the largest displacement
SMALL = 0.01
# m, beside a length of 1.2 m: what is seen as bent
LARGE = 0.1
FORCE = "The size of the driving force is not in the paper's text: 0.5 N is chosen."
TOO_STIFF = ("2d3n is too stiff in bending while its elements are much longer than high, as its column of Table 1 "
             "shows; with 8 elements they are 7 times as long here. " + FORCE)
WAYS = {"x": "horizontal", "y": "vertical"}


@dataclass(frozen=True)
class Run:
    """A motion: its case, below cases/dynamic, and what is changed in it."""

    case: str
    overrides: tuple[str, ...] = ()


def paper_run(problem: str, element: str, count: int, preset: bool = True) -> Run:
    """Return the motion of the paper's problem with one of its elements; ``preset``: with the paper's shear."""
    if problem == "slider_crank":
        bodies = {"crank": 2, "rod": count}
        case = "slider_crank_2d2n_8"
    else:
        bodies, case = {"rod": count}, f"{problem}_{element}_{count}"
    tail = ", preset: paper}" if preset else "}"
    return Run(case, tuple(f"bodies.{body}.element={{type: {element}, count: {n}{tail}" for body, n in bodies.items()))


@dataclass(frozen=True)
class Path2:
    """A probe over time: t (n,) [s] and position (n, 2) [m]."""

    t: np.ndarray
    r: np.ndarray

    @property
    def size(self) -> float:
        """The largest displacement [m]."""
        return float(np.linalg.norm(self.r - self.r[0], axis=1).max())


class Motions:
    """The paper's motions, each solved once."""

    def __init__(self, shop: Workshop) -> None:
        self.shop = shop

    def file(self, problem: str, run: Run) -> Path:
        """Return the result file of a motion."""
        changed = "_".join(o.partition("type: ")[2].strip("}").replace(": ", "").replace(", ", "-")
                           for o in run.overrides)
        end = () if self.shop.share == 1.0 else (f"solver.t_end={self.shop.share * ENDS[problem]:.6g}",)
        return self.shop.solve(f"{run.case}_{changed}".rstrip("_"), f"dynamic/{run.case}", (*run.overrides, *end))

    def paper(self, problem: str, element: str, count: int, preset: bool = True) -> Path:
        """Return the result file of a motion with one of the paper's elements."""
        return self.file(problem, paper_run(problem, element, count, preset))

    def other(self, problem: str, element: str) -> Path:
        """Return the result file of the motion with an element that stands for a closed one."""
        return self.file(problem, Run(f"{problem}_{element}"))


def path_of(file: Path, probe: str) -> Path2:
    """Return where a probe goes."""
    with open_results(file) as results:
        columns = results.probes[probe]
        return Path2(np.array(results.probe_t), np.column_stack([columns["x"], columns["y"]]))


def distance(a: Path2, b: Path2, axes: Sequence[int] = (0, 1)) -> np.ndarray:
    """Return how far one is from the other (n,) [m] at the times of both. Raises ValueError where those differ."""
    if len(a.t) != len(b.t) or np.abs(a.t - b.t).max() > 1e-9:
        raise ValueError("the two motions are stored at different times")
    return np.linalg.norm((a.r - b.r)[:, list(axes)], axis=1)


def apart(a: Path, b: Path, probe: str, axes: Sequence[int] = (0, 1)) -> tuple[float, float]:
    """Return the largest distance of a probe in two files [m], and its share of the largest displacement."""
    one, other = path_of(a, probe), path_of(b, probe)
    most = float(distance(one, other, axes).max())
    return most, most / other.size


def sag(file: Path) -> float:
    """Return how far the middle of a pendulum, pinned at the origin, comes to lie beside the line to its tip [m]."""
    tip, middle = path_of(file, "tip").r, path_of(file, "middle").r
    across = tip[:, 0] * middle[:, 1] - tip[:, 1] * middle[:, 0]
    return float(np.abs(across / np.linalg.norm(tip, axis=1)).max())


def motion_figures(shop: Workshop) -> list[Drawn]:
    """Draw Figures 7 to 19. Raises CaseError, ComputationError and ResultsError."""
    motions = Motions(shop)
    return [figure for draw in FIGURES for figure in draw(motions)]


def _told(found: dict[str, tuple[float, float]]) -> str:
    return "; ".join(f"{name}: {length(most)} ({_percent(share)})" for name, (most, share) in found.items())


def _percent(share: float) -> str:
    return "under 0.01 %" if share < 1e-4 else f"{100 * share:.2g} %"


def figure_7(m: Motions) -> list[Drawn]:
    """The first pendulum over meshes."""
    files = {f"{e}, {n}": m.paper("pendulum1", e, n) for e in TYPES for n in PENDULUM_MESHES}
    found = {f"{e}, {n}": apart(files[f"{e}, {n}"], files[f"{e}, 16"], "tip") for e in TYPES for n in (4, 8)}
    seen = f"Farthest from 16 elements: {_told(found)}, of the largest displacement."
    return [Drawn("Figure 7", f"{WAYS[q]} position of the tip of pendulum (1), 4, 8 and 16 elements",
                  m.shop.save(m.shop.build(files, "history", f"Figure 7: {WAYS[q]} position of the tip, pendulum (1)",
                                           quantity=q, probe="tip"), f"figure7_{q}"),
                  "4, 8 and 16 elements give identical results.", seen, max(s for _, s in found.values()) < SMALL)
            for q in "xy"]


def _beside(m: Motions, problem: str) -> dict[str, Path]:
    return {**{f"{e}, 8": m.paper(problem, e, 8) for e in TYPES},
            **{label: m.other(problem, name) for name, label in STAND_INS.items()}}


def _against(files: dict[str, Path], reference: str, axes: Sequence[int] = (0, 1)) -> dict[str, tuple[float, float]]:
    return {name: apart(file, files[reference], "tip", axes) for name, file in files.items() if name != reference}


def figures_8_9(m: Motions) -> list[Drawn]:
    """The first pendulum beside ANSYS's beams."""
    files, out = _beside(m, "pendulum1"), []
    for number, (axis, q) in zip((8, 9), enumerate("xy"), strict=True):
        found = _against(files, STAND_INS["reissner3"], (axis,))
        picture = m.shop.build(files, "history", f"Figure {number}: {WAYS[q]} position of the tip, pendulum (1)",
                               quantity=q, probe="tip")
        out.append(Drawn(f"Figure {number}", f"{WAYS[q]} position of the tip of pendulum (1), 8 elements",
                         m.shop.save(picture, f"figure{number}"), "2d2n, 2d3n, BEAM3 and BEAM188 agree very well.",
                         f"Farthest from {STAND_INS['reissner3']}: {_told(found)}.",
                         max(s for _, s in found.values()) < SMALL))
    return out


def figures_10_11(m: Motions) -> list[Drawn]:
    """The second pendulum at several times."""
    files, out = {f"{e}, 8": m.paper("pendulum2", e, 8) for e in TYPES}, []
    end = ENDS["pendulum2"] * m.shop.share
    most, share = apart(files["2d2n, 8"], files["2d3n, 8"], "tip")
    deep = max(sag(file) for file in files.values())
    for number, parts in ((10, (0.0, 0.2, 0.4, 0.5)), (11, (0.6, 0.7, 0.8, 0.9, 1.0))):
        picture = m.shop.build(files, "snapshots", f"Figure {number}: pendulum (2), 2d2n and 2d3n",
                               at=",".join(f"{p * end:.6g}" for p in parts))
        out.append(Drawn(f"Figure {number}", f"falling pendulum (2) up to {parts[-1] * end:g} s",
                         m.shop.save(picture, f"figure{number}"), "The deformation becomes large.",
                         f"The middle is up to {length(deep)} beside the line from pin to tip; the tips of 2d2n "
                         f"and 2d3n are at most {length(most)} ({_percent(share)}) apart. The times that the paper "
                         "shows are not in its text; these are chosen.", deep > LARGE))
    return out


def figures_12_14(m: Motions) -> list[Drawn]:
    """The second pendulum beside ANSYS's beams."""
    files = _beside(m, "pendulum2")
    right = {f"{e}, 8": apart(m.paper("pendulum2", e, 8, preset=False), files[STAND_INS["reissner3"]], "tip")
             for e in TYPES}
    whole = _against(files, STAND_INS["reissner3"])
    more = (f"With the right shear energy {_told(right)}, in any direction. Most of it is the model's: the bar is so "
            "soft that Green-Lagrange strain and engineering strain stretch it differently.")
    out = []
    for number, kind, what, options in (
            (12, "history", "horizontal position of the tip", {"quantity": "x", "probe": "tip"}),
            (13, "history", "vertical position of the tip", {"quantity": "y", "probe": "tip"}),
            (14, "trajectory", "path of the tip", {"probe": "tip"})):
        picture = m.shop.build(files, kind, f"Figure {number}: {what}, pendulum (2)", **options)
        found = whole if kind == "trajectory" else _against(files, STAND_INS["reissner3"], (number - 12,))
        ours = {k: v for k, v in found.items() if k.startswith(TYPES)}
        out.append(Drawn(f"Figure {number}", f"{what} of pendulum (2), 8 elements",
                         m.shop.save(picture, f"figure{number}"), "The consistency is still good.",
                         f"Farthest from {STAND_INS['reissner3']}: {_told(found)}. {more}",
                         max(s for _, s in ours.values()) < 0.1))
    return out


def _over_time(name: str, title: str, panels: Sequence[tuple[str, dict[str, Path], Path, str, Sequence[int]]],
               what: str) -> Curves:
    """Return distances over time: per panel its name, files, the reference, the probe, and the axes."""
    out = []
    for label, files, reference, probe, axes in panels:
        against = path_of(reference, probe)
        curves = [Curve(key, against.t[1:], distance(path_of(file, probe), against, axes)[1:])
                  for key, file in files.items()]
        out.append(Panel((f"time, {label}" if label else "time", "s"), (what, "m"), curves))
    return Curves(f"{name}: {title}", "", out, share="" if len(out) > 1 else "x", log_y=True)


def figure_15(m: Motions) -> list[Drawn]:
    """How far the paper's elements are from BEAM188 in both pendulums."""
    panels, found = [], {}
    for number in (1, 2):
        problem = f"pendulum{number}"
        files = {f"{e}, 8": m.paper(problem, e, 8) for e in TYPES}
        reference = m.other(problem, "reissner3")
        panels.append((f"pendulum ({number})", files, reference, "tip", (0, 1)))
        found[number] = {k: apart(f, reference, "tip") for k, f in files.items()}
    picture = _over_time("Figure 15", f"distance of the tips from {STAND_INS['reissner3']}", panels, "distance")
    return [Drawn("Figure 15", "errors of the two pendulums", m.shop.save(picture, "figure15"),
                  "The errors of the first, stiff pendulum are obviously smaller than those of the second.",
                  f"At most, pendulum (1): {_told(found[1])}; pendulum (2): {_told(found[2])}.",
                  max(v for v, _ in found[1].values()) < min(v for v, _ in found[2].values()))]


def figure_17(m: Motions) -> list[Drawn]:
    """The slider-crank over meshes."""
    files = {f"{e}, {n}": m.paper("slider_crank", e, n) for e in TYPES for n in ROD_MESHES[e]}
    reference = m.other("slider_crank", "reissner3")
    found = {k: apart(f, reference, "middle", (1,)) for k, f in files.items()}
    picture = m.shop.build(files, "history", "Figure 17: vertical position of the rod's middle, slider-crank",
                           quantity="y", probe="middle")
    nearer = {e: found[f"{e}, {n[-1]}"][0] < 0.7 * found[f"{e}, {n[0]}"][0] for e, n in ROD_MESHES.items()}
    return [Drawn("Figure 17", "vertical position of the middle of the connecting rod over meshes",
                  m.shop.save(picture, "figure17"), "The positions tend to be identical with more elements.",
                  f"Farthest from a fine geometrically exact beam: {_told(found)}. {TOO_STIFF}", all(nearer.values()),
                  "; ".join(f"{e} does not" for e, near in nearer.items() if not near))]


def figures_18_19(m: Motions) -> list[Drawn]:
    """The slider-crank beside ABAQUS."""
    reference = m.other("slider_crank", "reissner3")
    files = {f"{e}, 8": m.paper("slider_crank", e, 8) for e in TYPES}
    found = {k: apart(f, reference, "middle", (1,)) for k, f in files.items()}
    drawn = {**files, ABAQUS: reference}
    picture = m.shop.build(drawn, "history", "Figure 18: vertical position of the rod's middle, slider-crank",
                           quantity="y", probe="middle")
    errors = _over_time("Figure 19", f"vertical distance from {ABAQUS}",
                        [("", files, reference, "middle", (1,))], "distance")
    small = {e: found[f"{e}, 8"][1] < 0.05 for e in TYPES}
    return [Drawn("Figure 18", "vertical position of the middle of the connecting rod beside ABAQUS",
                  m.shop.save(picture, "figure18"), "2d2n is consistent with ABAQUS.",
                  f"Farthest from {ABAQUS}: {_told(found)}. {TOO_STIFF}", small["2d2n"]),
            Drawn("Figure 19", "error in the vertical position", m.shop.save(errors, "figure19"),
                  "The errors compared with ABAQUS are very small.", f"At most {_told(found)}. {FORCE}",
                  all(small.values()), "; ".join(f"{e} {'is near' if s else 'is not'}" for e, s in small.items()))]


FIGURES: tuple[Callable[[Motions], list[Drawn]], ...] = (
    figure_7, figures_8_9, figures_10_11, figures_12_14, figure_15, figure_17, figures_18_19)
