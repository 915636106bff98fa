"""Print the seed paper's tables beside what ancf2d computes, digit by digit.

    python -m scripts.reproduce_paper [--table 1] [--json]
    python -m scripts.reproduce_paper --figures FOLDER
    python -m scripts.reproduce_paper --report report.html

The second form draws Figures 3 to 5 into a folder instead, with the result files that they are drawn from; the third
writes all tables and figures into one page, in a few minutes. Exit code 0 where every verdict is the documented one
(see paper_tables.py), else 1.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from ancf2d.study.run import load, run_case
from scripts.pages import CASES
from scripts.paper_tables import TABLES, Entry, Table


@cache
def probes(case: str, overrides: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Return the probes of a solved case. Raises CaseError or ComputationError where it cannot be solved."""
    outcome = run_case(load(CASES / "paper" / f"{case}.yaml", list(overrides)))
    if outcome.failure is not None:
        raise outcome.failure
    return outcome.summary["probes"]


def rounded(value: float, like: str) -> str:
    """Return a value with as many decimals as the printed text."""
    return f"{value:.{len(like.partition('.')[2])}f}"


def judge(entry: Entry, value: float) -> dict[str, Any]:
    """Return the verdict on one entry whose computed value, in the table's unit, is given."""
    digits = rounded(value, entry.printed)
    same = digits.lstrip("-") == entry.printed if entry.sign_lost else digits == entry.printed
    documented = same if entry.computed is None else digits == entry.computed and not same
    verdict = "same to all printed digits" if same else f"differs: computed {digits}, printed {entry.printed}"
    return {"row": entry.row, "column": entry.column, "printed": entry.printed, "computed": digits, "value": value,
            "same": same, "documented": documented, "verdict": verdict, "why": "" if same else entry.why}


def examine(table: Table) -> list[dict[str, Any]]:
    """Return the verdicts on all entries of a table."""
    return [judge(e, probes(e.case, e.overrides)[e.probe][e.quantity] * e.scale) for e in table.entries]


def report(table: Table, verdicts: Sequence[dict[str, Any]]) -> str:
    """Return a table with its verdicts as text; each reason stands once, below."""
    reasons = list(dict.fromkeys(v["why"] for v in verdicts if v["why"]))
    lines = [f"{table.title} [{table.unit}]", *table.notes, "",
             f"{'':14} {'':8} {'printed':>10} {'computed':>10}  verdict"]
    for v in verdicts:
        mark = f" [{reasons.index(v['why']) + 1}]" if v["why"] else ""
        alarm = "" if v["documented"] else "   <-- NOT AS DOCUMENTED"
        word = "same to all printed digits" if v["same"] else "differs"
        lines.append(f"{v['row']:14} {v['column']:8} {v['printed']:>10} {v['computed']:>10}  {word}{mark}{alarm}")
    same = sum(v["same"] for v in verdicts)
    lines += ["", f"{same} of {len(verdicts)} entries are the same to all printed digits."]
    return "\n".join(lines + [f"[{i}] {text}." for i, text in enumerate(reasons, 1)])


def write_report(file: Path) -> bool:
    """Write all tables and figures into one HTML page; return whether every verdict is the documented one."""
    from scripts.paper_figures import Workshop  # matplotlib only where something is drawn
    from scripts.paper_report import page

    with tempfile.TemporaryDirectory() as folder:
        text, documented = page(Workshop(Path(folder), suffix="svg", told=_tell), examine)
    file.write_text(text, encoding="utf-8")
    return documented


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def draw_figures(folder: Path) -> list[Path]:
    """Draw Figures 3 to 5 into a folder; return the pictures."""
    from scripts.paper_figures import Workshop, static_figures

    folder.mkdir(parents=True, exist_ok=True)
    return [drawn.file for drawn in static_figures(Workshop(folder))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine the tables that are asked for, draw the figures, or write the report; return the exit code."""
    parser = argparse.ArgumentParser(description="The paper's tables beside what ancf2d computes, or its figures.")
    parser.add_argument("--table", choices=sorted(TABLES), action="append", help="only this table (repeatable)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw Figures 3 to 5 into a folder instead")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write all tables and figures into one page")
    options = parser.parse_args(arguments)
    if options.figures is not None or options.report is not None:
        if options.table or options.json or None not in (options.figures, options.report):
            parser.error("--figures and --report go alone")
        if options.report is not None:
            if not options.report.absolute().parent.is_dir() or options.report.is_dir():
                parser.error(f"--report: cannot write '{options.report}': no such folder, or a folder itself")
            documented = write_report(options.report)
            print(f"wrote {options.report}")
            return 0 if documented else 1
        print("\n".join(f"wrote {picture}" for picture in draw_figures(options.figures)))
        return 0
    found = {name: examine(TABLES[name]) for name in options.table or sorted(TABLES)}
    if options.json:
        print(json.dumps({"tables": {n: {"title": TABLES[n].title, "unit": TABLES[n].unit, "entries": v}
                                     for n, v in found.items()}}, indent=1))
    else:
        print("\n\n".join(report(TABLES[n], v) for n, v in found.items()))
    return 0 if all(v["documented"] for verdicts in found.values() for v in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
