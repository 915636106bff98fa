"""``ancf2d tradeoff``: the cost of accuracy over element types, meshes, integrators and steps, and its report."""

from __future__ import annotations

import math
import re
import shlex
import textwrap
from collections import Counter
from typing import TYPE_CHECKING, Any

import click

from ..errors import CaseError
from .convergence import element_counts, positive_numbers, reference_value
from .failures import FAILED
from .options import (
    case_argument,
    complete_types,
    either,
    examples,
    force_option,
    jobs_option,
    json_session,
    parsed,
    read_case,
    scheduler_option,
    set_option,
    workers,
)
from .session import Bar, Session
from .text import TIME, duration, number, say, table

if TYPE_CHECKING:
    from ..study.tradeoff.plan import Choice
    from ..study.tradeoff.study import Row, TradeoffStudy


WIDTH = 100


def report(study: TradeoffStudy, command: str) -> str:
    """Return a study as text: rows, limits, omitted settings and recommendations; ``command`` runs the case."""
    lines = [study.title] if study.title else []
    lines += [f"{study.goal}: error against measured time", "", *_rows(study), "", *_limits(study)]
    lines += [*_left_out(study), "", *_recommended(study, command)]
    return "\n".join(lines)


def _names(study: TradeoffStudy) -> dict[tuple[str, str], str]:
    """Return the displayed names of types, with the formulation if a type has several."""
    found = dict.fromkeys((r.measured.element, r.measured.formulation) for r in study.rows)
    several = Counter(element for element, _ in found)
    return {(e, f): f"{e}:{f}" if several[e] > 1 and f else e for e, f in found}


def _rows(study: TradeoffStudy) -> list[str]:
    rows = [row for row in study.rows if row.measured.status != "refused"]
    names = _names(study)
    columns = ["quadrature"] if any(r.task.setting.quadrature is not None for r in rows) else []
    columns += ["method"] if any(r.task.setting.method is not None for r in rows) else []
    key = next((r.task.setting.key for r in rows if r.task.setting.key), "")
    both = study.against == "continuum"
    head = ["element", *columns, *([key] if key else []), "elements", "coordinates", "error",
            *(["total"] if both else []), TIME, "memory", "front", ""]
    out = [head]
    for row in rows:
        m, setting = row.measured, row.task.setting
        steps = [number(setting.step, 4)] if key else []
        out.append([names[m.element, m.formulation], *(_text(getattr(setting, c)) for c in columns), *steps,
                    str(m.elements), "-" if m.dofs is None else str(m.dofs), error_text(row),
                    *([total_text(row)] if both else []), time_text(row), memory_text(m.memory),
                    "*" if row.pareto else "", f"failed: {m.reason}" if m.reason else ""])
    lines = table(out, left=(*range(len(columns) + 1), len(head) - 1))
    lines += ["", *_wrapped(_meaning(study))]
    for text in dict.fromkeys(_refusal(r, names) for r in study.rows if r.measured.status == "refused"):
        lines += _wrapped(text)
    return lines


def _refusal(row: Row, names: dict[tuple[str, str], str]) -> str:
    quadrature = row.task.setting.quadrature
    rule = "" if quadrature is None else f" with quadrature {quadrature}"
    return f"{names[row.measured.element, row.measured.formulation]}{rule} is refused: {row.measured.reason}"


def _text(value: Any) -> str:
    return "-" if value is None else str(value)


def error_text(row: Row) -> str:
    """Return the error of a row, or its upper bound if only that is known."""
    if row.error is not None:
        return f"{row.error:.1e}"
    return "?" if row.error_below is None else f"<{row.error_below:.0e}"


def total_text(row: Row) -> str:
    """Return the upper bound of the error and the model error together."""
    return f"{row.judged:.1e}" if math.isfinite(row.judged) else "?"


def time_text(row: Row) -> str:
    """Return the solve time of a row."""
    return "-" if row.measured.wall_s is None else duration(row.measured.wall_s)


def memory_text(count: int | None) -> str:
    """Return a number of bytes with three digits in seven characters, so that all columns have the same width."""
    if count is None:
        return "-"
    size, unit = count / 1e3, "kB"
    for larger in ("MB", "GB"):
        if size >= 999.5:
            size, unit = size / 1e3, larger
    digits = 2 if size < 9.995 else 1 if size < 99.95 else 0
    return f"{size:.{digits}f} {unit}".rjust(7)


def _meaning(study: TradeoffStudy) -> str:
    against = {"limit": "the type's own limit", "continuum": "the type's own limit", "reference": "the number given"}
    text = (f"error: relative to {against[study.against]}; '<' marks an upper bound, if the error is less than ten "
            "times that of the reference. time: median solution time, without compilation. memory: peak memory of "
            "Python and NumPy for model and solution. *: no other setting is both faster and more accurate")
    return text + (", including the model error." if study.against == "continuum" else ".")


def _limits(study: TradeoffStudy) -> list[str]:
    if study.against == "reference":
        return []
    from ..case.units import with_unit

    rows, notes = [], []
    several = any(known.quadrature is not None for known in study.series)
    for known in study.series:
        name, limit = [known.element, known.formulation, *([_text(known.quadrature)] if several else [])], known.limit
        if limit.answer is not None:
            rows.append([*name, number(limit.answer.value, 10), f"{limit.bar:.0e}" if limit.known else "?",
                         model_text(known)])
        if limit.note and not known.refused:
            notes += _wrapped(f"{known.element} ({known.formulation}): {limit.note}")
    head = ["element", "formulation", *(["quadrature"] if several else []),
            f"limit of {with_unit(study.goal, study.labels)}", "accurate to", "model error"]
    lines = table([head, *rows], left=(0, 1, 2) if several else (0, 1)) if rows else []
    lines += ["", *notes] if notes else []
    if study.continuum.answer is not None and lines:
        q = ", ".join(str(k) for k in study.continuum_q)
        lines += ["", *_wrapped("model error: relative distance of the limit from the plane-stress continuum, "
                                f"{number(study.continuum.answer.value, 8)} (accurate to {study.continuum.bar:.0e}). "
                                f"The continuum is the limit of ancf[3,q] with q = {q}, with forces and supports "
                                "spread over the section.")]
    elif lines:
        lines += ["", f"model error: unknown; {study.continuum.note}"]
    return lines


def model_text(known: Any) -> str:
    """Return the model error of a series, or its upper bound if only that is known."""
    if known.model_error is None:
        return "-"
    if known.model_error < known.model_error_bar:
        return f"<{known.model_error + known.model_error_bar:.0e}"
    return f"{known.model_error:.1e}"


def _left_out(study: TradeoffStudy) -> list[str]:
    rows, references = Counter[str](), Counter[str]()
    for task in study.dropped:
        (rows if task.repeat else references)[task.element] += 1
    if not rows and not references:
        return []
    parts = [f"{what} of {', '.join(f'{name} ({count})' for name, count in found.items())}"
             for what, found in (("settings", rows), ("finer references", references)) if found]
    return ["", *_wrapped(f"left out because of the time limit of {duration(study.budget)}: {'; '.join(parts)}")]


def _recommended(study: TradeoffStudy, command: str) -> list[str]:
    from ..study.tradeoff.study import accuracy_name, setting_text

    lines = []
    for accuracy in study.accuracies:
        row = study.recommended(accuracy)
        if row is None:
            lines.append(f"for {accuracy_name(accuracy)}: no setting is known to be this accurate")
            continue
        both = study.against == "continuum"
        error = f"error and model error {total_text(row)}" if both else f"error {error_text(row)}"
        lines.append(f"for {accuracy_name(accuracy)}: {setting_text(row)}: {error} in {time_text(row)}")
        lines.append(f"    {command} " + " ".join(f"--set {shlex.quote(text)}" for text in row.task.chosen))
    return lines


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH)


UNITS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


def _seconds(text: str) -> float:
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(s|min|h|)\s*", text)
    return float(found[1]) * UNITS[found[2]] if found else math.nan


@click.command(epilog=examples("ancf2d tradeoff beam.yaml --element cable,reissner3 --budget 5s",
                               "ancf2d tradeoff beam.yaml --elements 2,4,8,16 --accuracy 1e-3,1e-6 -o study.h5",
                               "ancf2d tradeoff swing.yaml --method radau5,generalized_alpha "
                               "--dt 0.02,0.01 --element reissner3 --budget 5s"))
@case_argument
@click.option("--element", "types", metavar="TYPE,...", shell_complete=complete_types,
              help="Element types, e.g. 2d2n, ancf[3,2], vallejo:structural (TYPE:FORMULATION), own.yaml (a file that "
                   "describes one). Default: the case's "
                   "own, reissner3, cable, vallejo, ancf[3,1], 2d2n and 2d3n.")
@click.option("--elements", "meshes", callback=element_counts, metavar="N,N,...",
              help="Numbers of elements of the whole model. Default: doubling from the coarsest mesh that has the "
                   "case's proportions.")
@click.option("--quadrature", "quadratures", metavar="Q,...",
              help="Quadratures, e.g. [2,2],[3,2],exact. Default: that of each type.")
@click.option("--method", "methods", metavar="NAME,...", help="For a motion: integrators. Default: the case's.")
@click.option("--dt", "dts", callback=positive_numbers, metavar="DT,...", help="For a motion: fixed time steps.")
@click.option("--tolerance", "tolerances", callback=positive_numbers, metavar="TOL,...",
              help="For a motion: tolerances of adaptive steps. Default: three, up to the case's own.")
@click.option("--budget", default="60s", show_default=True, metavar="TIME",
              callback=parsed(_seconds, lambda found: 0.0 <= found < math.inf,
                              "not a time; expected for example 60s or 5min"),
              help="Time limit of the study, without compilation, in s, min or h. It is divided among the types; each "
              "solves its cheapest settings first. Settings that do not fit are left out and listed.")
@click.option("--repeat", default=3, show_default=True, type=click.IntRange(min=1), metavar="N",
              help="Number of timed runs of each setting, more for short ones; the median counts.")
@click.option("--accuracy", "accuracies", default="1e-2,1e-3,1e-4", show_default=True, callback=positive_numbers,
              metavar="TOL,...", help="Relative errors for which a setting is recommended.")
@click.option("--against", type=click.Choice(["limit", "continuum"]), default="limit", show_default=True,
              help="Reference for the errors of the front and the recommendations: each type's own limit, or the "
              "plane-stress continuum, which adds the model error.")
@click.option("--reference", default="auto", show_default=True, callback=reference_value, metavar="VALUE",
              help="Reference for the errors: a number, or auto for a finer solution of the same type.")
@jobs_option("Number of settings solved at the same time; this changes measured times but no errors.", "1")
@scheduler_option
@click.option("-o", "--output", type=click.Path(), metavar="OUT.h5", help="Write the table to a result file.")
@set_option
@force_option
@json_session
def command(session: Session, case: str, overrides: tuple[str, ...], jobs: int | None, scheduler: str | None,
            output: str | None, force: bool, **chosen: Any) -> int:
    """Measure what accuracy costs, and recommend a setting for each required accuracy.

    Prints error, solve time and memory of every setting, marks those that no other setting beats in both error and
    time, and recommends the cheapest for each required accuracy.
    """
    session.subject = {"case": case}
    from ..study.tradeoff.study import tradeoff, write_tradeoff

    choice, who = _choice(**chosen), workers(jobs, scheduler, default=1)
    loaded = read_case(case, overrides, output, force)
    with Bar("solving", session.shows_progress) as bar:
        study = tradeoff(loaded, choice, who, session.note_once, bar.follow)
    given = [part for text in overrides for part in ("--set", text)]
    session.report_study(study, report(study, shlex.join(["ancf2d", "run", case, *given])), output,
                 lambda path: write_tradeoff(study, loaded, path, session.command_line, force=force))
    if not study.converged:
        say(f"error: {study.as_json()['reason']}", err=True)
        return FAILED
    return 0


def _quadratures(text: str) -> tuple[Any, ...]:
    """Return the quadratures in ``[2,2],exact``; the case checks later whether they are possible."""
    from ..case.axes import read_axes

    try:
        return read_axes([f"quadrature={text}"])[0].values
    except CaseError:
        raise click.UsageError(f"--quadrature: '{text}' is not a list of quadratures; expected for example "
                               "[2,2],[3,2],exact.") from None


def _choice(types: str | None, meshes: list[int] | None, quadratures: str | None, methods: str | None,
            dts: tuple[float, ...] | None, tolerances: tuple[float, ...] | None, budget: float, repeat: int,
            accuracies: tuple[float, ...], against: str, reference: float | None) -> Choice:
    from ..study.tradeoff.plan import Choice
    from ..study.variants import parse_variants

    key, steps = either(dts, tolerances)
    if reference is not None and against == "continuum":
        raise click.UsageError("--reference is a number: --against continuum needs the limits of the types.")
    try:
        variants = () if types is None else tuple(parse_variants(types))
    except ValueError as error:
        raise click.UsageError(f"{error}.") from None
    return Choice(
        variants=variants, meshes=tuple(meshes or ()),
        quadratures=(None,) if quadratures is None else _quadratures(quadratures),
        methods=(None,) if methods is None else tuple(dict.fromkeys(m.strip() for m in methods.split(","))),
        key=key, steps=steps, repeat=repeat, budget=budget,
        accuracies=accuracies, reference=reference, continuum=against == "continuum")
