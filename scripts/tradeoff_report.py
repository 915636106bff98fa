"""Measure what accuracy costs in four cases, draw it, and write the tables into docs/tradeoff.md, stamped.

About a quarter of an hour; on a machine that does nothing else, or with a priority that nothing else has (chrt -f 10),
or the times are not those of the solves.

    python -m scripts.tradeoff_report [--studies cantilever,beam]
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ancf2d.case.units import with_unit
from ancf2d.cli.tradeoff import error_text, model_text, time_text, total_text
from ancf2d.plot.kinds import draw
from ancf2d.plot.output import save
from ancf2d.results import Results
from ancf2d.study.run import load
from ancf2d.study.tradeoff.plan import Choice
from ancf2d.study.tradeoff.study import Row, TradeoffStudy, accuracy_name, cheapest, tradeoff, write_tradeoff
from ancf2d.study.variants import parse_variants
from scripts.gallery import IMAGES, shrunk
from scripts.pages import DOCS, ROOT, stamp, table, write

PAGE = DOCS / "tradeoff.md"
ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5)
FORMULATIONS = ("enhanced", "structural", "strain_split", "continuum")
METHODS = ("radau5", "radau9", "generalized_alpha", "hht", "newmark", "RK45")
SMALL_STEPS = ("solver={type: static, steps: 100}",)  # so that a solve takes long enough to be measured


@dataclass(frozen=True)
class Subject:
    """A case to study: its file, the title of its picture, seconds for it, and how often each time is measured."""

    case: str
    title: str
    budget: float
    continuum: bool = False
    overrides: tuple[str, ...] = ()
    repeat: int = 3


@dataclass(frozen=True)
class Contest:
    """A study in which a default stands beside what else could be one: what each needs for each accuracy.

    ``default``: how the default goes by in the table.
    """

    case: str
    default: str
    choice: Choice
    overrides: tuple[str, ...] = ()


SUBJECTS = {
    "cantilever": Subject("cases/paper/table2_2d2n.yaml", "Cantilever bent by a third of its length (Table 2)", 60.0,
                          overrides=("bodies.beam.element.count=64",), repeat=51),
    "beam": Subject("cases/paper/table3_2d2n.yaml", "First frequency of a thick beam, L/h = 5 (Table 3)", 120.0),
    "beam_continuum": Subject("cases/paper/table3_2d2n.yaml", "First frequency of a thick beam, L/h = 5 (Table 3)",
                              120.0, continuum=True),
    "pendulum1": Subject("cases/dynamic/pendulum1_reissner3.yaml", "Slender stiff pendulum (1)", 240.0),
    "pendulum2": Subject("cases/dynamic/pendulum2_reissner3.yaml", "Thick soft pendulum (2)", 120.0),
}

CONTESTS = {
    "points": Contest("cases/paper/table2_2d2n.yaml", "reissner3, [2, 1]", Choice(
        variants=tuple(parse_variants("reissner3")), quadratures=((2, 1), (3, 1), (4, 1)), meshes=(2, 4, 8, 16, 32),
        repeat=9, accuracies=ACCURACIES), overrides=("bodies.beam.element={type: reissner3, count: 4}", *SMALL_STEPS)),
    "formulations": Contest("cases/static/thick_cantilever.yaml", "vallejo (enhanced), [2, 2]", Choice(
        variants=tuple(parse_variants(",".join(f"vallejo:{name}" for name in FORMULATIONS))),
        quadratures=((2, 2), (3, 2), (2, 3)), meshes=(1, 2, 4, 8, 16, 32), repeat=9,
        accuracies=(3e-2, 1e-2, 5e-3, 3e-3, 2e-3), continuum=True),
        overrides=("bodies.beam.element={type: vallejo, count: 4}", *SMALL_STEPS)),
    "integrators": Contest("cases/dynamic/pendulum2_reissner3.yaml", "radau5", Choice(
        variants=tuple(parse_variants("reissner3")), methods=METHODS, meshes=(4, 8, 16, 32), key="tolerance",
        steps=(1e-2, 1e-3, 1e-4, 1e-5, 1e-6), repeat=9, budget=240.0, accuracies=(1e-2, 1e-3, 3e-4, 1e-4, 3e-5))),
}


def recommended(study: TradeoffStudy) -> str:
    """Return what is recommended for each accuracy."""
    rows = []
    for accuracy in study.accuracies:
        row = study.recommended(accuracy)
        if row is None:
            rows.append([accuracy_name(accuracy), "none", *4 * ["-"]])
            continue
        m, step = row.measured, row.task.setting.step
        found = total_text(row) if study.against == "continuum" else error_text(row)
        rows.append([accuracy_name(accuracy), f"`{m.element}`", str(m.elements), "-" if step is None else f"{step:g}",
                     found.replace("<", "&lt;"), time_text(row)])
    error = "error and model error" if study.against == "continuum" else "error"
    return table(["wanted", "element", "elements", "tolerance", error, "time"], rows)


def limits(study: TradeoffStudy) -> str:
    """Return the limit of every type, how well it is known, and its model error."""
    rows = []
    for known in study.series:
        limit = known.limit
        value = "none found" if not limit.known or limit.answer is None else f"{limit.answer.value:.9g}"
        rows.append([f"`{known.element}`", known.formulation, value, f"{limit.bar:.0e}" if limit.known else "-",
                     model_text(known).replace("<", "&lt;")])
    return table(["type", "formulation", f"limit of {with_unit(study.goal)}", "accurate to", "model error"], rows)


def tail(study: TradeoffStudy) -> str:
    """Return how the continuum was found, and what the budget had no room for."""
    if study.continuum.answer is None:
        text = "The continuum is unknown."
    else:
        text = (f"The continuum: {study.continuum.answer.value:.8g}, accurate to {study.continuum.bar:.0e}, from "
                f"ancf[3,q] with q up to {max(study.continuum_q)}.")
    left = sum(task.repeat > 0 for task in study.dropped)
    solved = sum(row.measured.answer is not None for row in study.rows)
    return (f"{text} {solved} settings were solved in {study.spent:.0f} s; "
            + (f"{left} did not fit into {study.budget:.0f} s." if left else "none was left out."))


def name_of(row: Row) -> str:
    """Return what a row of a contest is: its integrator, or its formulation and quadrature."""
    setting = row.task.setting
    if setting.method is not None:
        return str(setting.method)
    named = setting.variant.formulation
    return f"{row.measured.element}{f' ({named})' if named else ''}, {list(setting.quadrature)}"


def contest(study: TradeoffStudy, default: str) -> str:
    """Return the time of the cheapest mesh and steps of each for each accuracy; the default first, bold the fastest."""
    sorts: dict[str, list[Row]] = {default: []}
    for row in study.rows:
        sorts.setdefault(name_of(row), []).append(row)
    best = [study.recommended(a) for a in study.accuracies]
    lines = []
    for name, rows in sorts.items():
        cells = []
        for accuracy, winner in zip(study.accuracies, best, strict=True):
            k = cheapest([math.inf if r.measured.wall_s is None else r.measured.wall_s for r in rows],
                         [r.judged for r in rows], accuracy)
            found = "-" if k is None else f"{time_text(rows[k])}, {rows[k].measured.elements}"
            cells.append(f"**{found}**" if k is not None and rows[k] is winner else found)
        lines.append([f"`{name}`{' (default)' if name == default else ''}", *cells])
    return table(["", *(accuracy_name(a) for a in study.accuracies)], lines)


def picture(study: TradeoffStudy, subject: Subject, name: str, folder: Path) -> None:
    """Draw a study into docs/images."""
    write_tradeoff(study, load(str(ROOT / subject.case), subject.overrides), str(folder / f"{name}.h5"))
    with Results(folder / f"{name}.h5") as results:
        save(draw(results, title=subject.title), folder / f"{name}.png", force=True)
    shrunk(folder / f"{name}.png", IMAGES / f"tradeoff_{name}.png")


def study_of(name: str) -> list[str]:
    """Return what the page says of a subject or a contest, and draw the subject."""
    if name in CONTESTS:
        known = CONTESTS[name]
        study = tradeoff(load(str(ROOT / known.case), known.overrides), known.choice)
        return [contest(study, known.default)]
    subject = SUBJECTS[name]
    choice = Choice(budget=subject.budget, accuracies=ACCURACIES, continuum=subject.continuum, repeat=subject.repeat)
    study = tradeoff(load(str(ROOT / subject.case), subject.overrides), choice)
    with tempfile.TemporaryDirectory() as folder:
        picture(study, subject, name, Path(folder))
    return [recommended(study)] if subject.continuum else [recommended(study), limits(study), tail(study)]


def main() -> None:
    """Measure the studies that are asked for, and write each as it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", default=",".join((*SUBJECTS, *CONTESTS)), help="some of %(default)s")
    wanted = parser.parse_args().studies.split(",")
    if unknown := [name for name in wanted if name not in {**SUBJECTS, **CONTESTS}]:
        parser.error(f"no study {', '.join(unknown)}; there are {', '.join((*SUBJECTS, *CONTESTS))}")
    for name in wanted:
        parts = study_of(name)
        write(PAGE, name, "\n\n".join(parts))
        print(f"{name}\n\n" + "\n\n".join(parts) + "\n", flush=True)
    write(PAGE, "stamp", stamp("scripts.tradeoff_report"))


if __name__ == "__main__":
    main()
