"""Measure what accuracy costs in four cases, draw it, and write the tables into docs/tradeoff.md, stamped.

About ten minutes; on a machine that does nothing else, or the times are not those of the solves.

    OPENBLAS_NUM_THREADS=1 python scripts/tradeoff_report.py [--studies cantilever,beam]
"""

from __future__ import annotations

import argparse
import re
import tempfile
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from bench.stamp import machine, versions
from gallery import IMAGES, ROOT, shrunk

from ancf2d.cli.tradeoff_report import error_text, model_text, time_text, total_text
from ancf2d.plot.kinds import draw
from ancf2d.plot.output import save
from ancf2d.results import Results
from ancf2d.study.run import load
from ancf2d.study.tradeoff.file import write_tradeoff
from ancf2d.study.tradeoff.plan import Choice
from ancf2d.study.tradeoff.result import Study, accuracy_name
from ancf2d.study.tradeoff.study import tradeoff

PAGE = ROOT / "docs" / "tradeoff.md"
MARKED = r"(<!-- measured: {name} -->\n)(?:(?!<!--).)*(<!-- end -->)"
ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5)


@dataclass(frozen=True)
class Subject:
    """A case to study: its file, the title of its picture, and seconds for it."""

    case: str
    title: str
    budget: float
    continuum: bool = False
    overrides: tuple[str, ...] = ()


SUBJECTS = {
    "cantilever": Subject("cases/paper/table2_2d2n.yaml", "Cantilever bent by a third of its length (Table 2)", 60.0,
                          overrides=("bodies.beam.element.count=64",)),
    "beam": Subject("cases/paper/table3_2d2n.yaml", "First frequency of a thick beam, L/h = 5 (Table 3)", 120.0),
    "beam_continuum": Subject("cases/paper/table3_2d2n.yaml", "First frequency of a thick beam, L/h = 5 (Table 3)",
                              120.0, continuum=True),
    "pendulum1": Subject("cases/dynamic/pendulum1_reissner3.yaml", "Slender stiff pendulum (1)", 240.0),
    "pendulum2": Subject("cases/dynamic/pendulum2_reissner3.yaml", "Thick soft pendulum (2)", 120.0),
}


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def recommended(study: Study) -> str:
    """Return what is recommended for each accuracy."""
    rows = []
    for accuracy in study.accuracies:
        row = study.recommended(accuracy)
        if row is None:
            rows.append([accuracy_name(accuracy), "nothing that was solved", *4 * ["-"]])
            continue
        m, step = row.measured, row.task.setting.step
        found = total_text(row) if study.against == "continuum" else error_text(row)
        rows.append([accuracy_name(accuracy), f"`{m.element}`", str(m.elements), "-" if step is None else f"{step:g}",
                     found.replace("<", "&lt;"), time_text(row)])
    error = "error and model error" if study.against == "continuum" else "error"
    return table(["wanted", "element", "elements", "tolerance", error, "time"], rows)


def limits(study: Study) -> str:
    """Return the limit of every type, how well it is known, and its model error."""
    rows = []
    for known in study.series:
        limit = known.limit
        value = "none that is known" if not limit.known or limit.answer is None else f"{limit.answer.value:.9g}"
        rows.append([f"`{known.element}`", known.formulation, value, f"{limit.bar:.0e}" if limit.known else "-",
                     model_text(known).replace("<", "&lt;")])
    return table(["type", "formulation", f"limit of {study.goal}", "known to", "model error"], rows)


def tail(study: Study) -> str:
    """Return how the continuum was found, and what the budget had no room for."""
    if study.continuum.answer is None:
        text = "The continuum is not known."
    else:
        text = (f"The continuum: {study.continuum.answer.value:.8g}, known to {study.continuum.bar:.0e}, from "
                f"ancf[3,q] with q up to {max(study.continuum_q)}.")
    left = sum(task.repeat > 0 for task in study.dropped)
    solved = sum(row.measured.answer is not None for row in study.rows)
    return (f"{text} {solved} settings were solved in {study.spent:.0f} s; "
            + (f"{left} had no room in {study.budget:.0f} s." if left else "none was left out."))


def write(name: str, found: str) -> None:
    """Put a text in its place on the page. Raises ValueError where the page has none."""
    text = PAGE.read_text(encoding="utf-8")
    place = re.compile(MARKED.format(name=re.escape(name)), re.S)
    if not place.search(text):
        raise ValueError(f"{PAGE} has no place for '{name}'")
    PAGE.write_text(place.sub(lambda m: f"{m[1]}{found}\n{m[2]}", text), encoding="utf-8")


def picture(study: Study, subject: Subject, name: str, folder: Path) -> None:
    """Draw a study into docs/images."""
    write_tradeoff(study, load(str(ROOT / subject.case), subject.overrides), str(folder / f"{name}.h5"))
    with Results(folder / f"{name}.h5") as results:
        save(draw(results, title=subject.title), folder / f"{name}.png")
    shrunk(folder / f"{name}.png", IMAGES / f"tradeoff_{name}.png")


def main() -> None:
    """Measure the studies that are asked for, and write each as it is done."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", default=",".join(SUBJECTS), help="some of %(default)s")
    wanted = parser.parse_args().studies.split(",")
    if unknown := [name for name in wanted if name not in SUBJECTS]:
        parser.error(f"no study {', '.join(unknown)}; there are {', '.join(SUBJECTS)}")
    for name in wanted:
        subject = SUBJECTS[name]
        choice = Choice(budget=subject.budget, accuracies=ACCURACIES, continuum=subject.continuum)
        study = tradeoff(load(str(ROOT / subject.case), subject.overrides), choice)
        parts = [recommended(study)] if subject.continuum else [recommended(study), limits(study), tail(study)]
        with tempfile.TemporaryDirectory() as folder:
            picture(study, subject, name, Path(folder))
        write(name, "\n\n".join(parts))
        print(f"{name}\n\n" + "\n\n".join(parts) + "\n", flush=True)
    write("stamp", f"Measured with one thread by `python scripts/tradeoff_report.py` on {date.today()}: {machine()}; "
                   f"{versions()}.")


if __name__ == "__main__":
    main()
