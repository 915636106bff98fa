"""A study of work and precision as people read it."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections import Counter
from typing import TYPE_CHECKING, Any

from .text import TIME, duration, number, table

if TYPE_CHECKING:
    from ..study.tradeoff.result import Row, Study

WIDTH = 100


def report(study: Study, command: str) -> str:
    """Return a study as text: rows, limits, what was left out, and what is recommended; ``command`` runs the case."""
    lines = [study.title] if study.title else []
    lines += [f"{study.goal}: error against measured time", "", *_rows(study), "", *_limits(study)]
    lines += [*_left_out(study), "", *_recommended(study, command)]
    return "\n".join(lines)


def _names(study: Study) -> dict[tuple[str, str], str]:
    """Return how types are called: with their formulation where there are several of it."""
    found = dict.fromkeys((r.measured.element, r.measured.formulation) for r in study.rows)
    several = Counter(element for element, _ in found)
    return {(e, f): f"{e}:{f}" if several[e] > 1 and f else e for e, f in found}


def _rows(study: Study) -> list[str]:
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
                    *([total_text(row)] if both else []), time_text(row), _memory(m.memory),
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
    """Return the error of a row; where it is not told, what it is below."""
    if row.error is not None:
        return f"{row.error:.1e}"
    return "?" if row.error_below is None else f"<{row.error_below:.0e}"


def total_text(row: Row) -> str:
    """Return the most that the error and that of the model are together."""
    return f"{row.judged:.1e}" if math.isfinite(row.judged) else "?"


def time_text(row: Row) -> str:
    """Return the solve time of a row."""
    return "-" if row.measured.wall_s is None else duration(row.measured.wall_s)


def _memory(count: int | None) -> str:
    if count is None:
        return "-"
    return f"{count / 1e3:.0f} kB" if count < 1e6 else f"{count / 1e6:.3g} MB"


def _meaning(study: Study) -> str:
    against = {"limit": "the type's own limit", "continuum": "the type's own limit", "reference": "the number given"}
    text = (f"error: against {against[study.against]}, relative; '<' if it is less than ten times that of the "
            "reference, so that only a bound is known. time: median of the solve alone, without compilation. memory: "
            "peak use of Python and numpy for model and solution. *: no other setting is both faster and more accurate")
    return text + (", counting the model error." if study.against == "continuum" else ".")


def _limits(study: Study) -> list[str]:
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
            f"limit of {with_unit(study.goal, study.labels)}", "known to", "model error"]
    lines = table([head, *rows], left=(0, 1, 2) if several else (0, 1)) if rows else []
    lines += ["", *notes] if notes else []
    if study.continuum.answer is not None and lines:
        q = ", ".join(str(k) for k in study.continuum_q)
        lines += ["", *_wrapped("model error: relative distance of the limit from the plane-stress continuum, "
                                f"{number(study.continuum.answer.value, 8)} known to {study.continuum.bar:.0e}, found "
                                f"as the limit of ancf[3,q] with q = {q}, forces and supports spread over the "
                                "section.")]
    elif lines:
        lines += ["", f"model error: not known; {study.continuum.note}"]
    return lines


def model_text(known: Any) -> str:
    """Return the model error of a series; what it is below where it is not known better."""
    if known.model_error is None:
        return "-"
    if known.model_error < known.model_error_bar:
        return f"<{known.model_error + known.model_error_bar:.0e}"
    return f"{known.model_error:.1e}"


def _left_out(study: Study) -> list[str]:
    rows, references = Counter[str](), Counter[str]()
    for task in study.dropped:
        (rows if task.repeat else references)[task.element] += 1
    if not rows and not references:
        return []
    parts = [f"{what} of {', '.join(f'{name} ({count})' for name, count in found.items())}"
             for what, found in (("settings", rows), ("finer references", references)) if found]
    return ["", *_wrapped(f"left out, for a budget of {duration(study.budget)}: {'; '.join(parts)}")]


def _recommended(study: Study, command: str) -> list[str]:
    from ..study.tradeoff.result import accuracy_name, setting_text

    lines = []
    for accuracy in study.accuracies:
        row = study.recommended(accuracy)
        if row is None:
            lines.append(f"for {accuracy_name(accuracy)}: no setting solved is known to be this accurate")
            continue
        both = study.against == "continuum"
        error = f"error and model error {total_text(row)}" if both else f"error {error_text(row)}"
        lines.append(f"for {accuracy_name(accuracy)}: {setting_text(row)}: {error} in {time_text(row)}")
        lines.append(f"    {command} " + " ".join(f"--set {shlex.quote(text)}" for text in row.task.chosen))
    return lines


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH)
