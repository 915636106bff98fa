"""Write the parts of README.md and docs/ that are made from the program itself; --check only compares.

A part stands between ``<!-- generated: NAME -->`` and ``<!-- end -->``; case-reference.md and verification.md are made
as a whole.
Exit code of --check: 0 where everything is current, else 1 with the names of what is not.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

import click

from ancf2d import load as read_dict
from ancf2d.case import markdown_reference
from ancf2d.cli.app import COMMANDS, app
from ancf2d.elements import registry
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.errors import ComputationError
from ancf2d.solvers.registry import SOLVERS
from ancf2d.study.run import load, run_case, vocabulary
from scripts import audit_table, reproduce_paper, shape_functions, verification_manual
from scripts.pages import CASES, ROOT, table

MARKED = re.compile(r"(<!-- generated: (\S+) -->\n)(?:(?!<!-- ).*\n)*(<!-- end -->)")
# a difference below this is round-off, whose digits depend on the machine
ROUND_OFF = 1e-9
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
VALUE = re.compile(rf"(?<=\| )({NUMBER.pattern})(?= [%|])")
# of the largest value in the row of a table: what round-off makes of motions and paths of adaptive steps
SLACK = 1e-5


def elements() -> str:
    """Return the table of element types."""
    rows = []
    for t in registry.ELEMENTS.values():
        offered = [f.name for f in FORMULATIONS.values() if f.refuse(t) is None]
        offered = [t.formulation, *(name for name in offered if name != t.formulation)]
        names = ", ".join(dict.fromkeys(c for _, c in t.functionals)) + (", theta" if t.has_theta else "")
        rows.append([f"`{t.name}`", ", ".join(t.basis), f"{names} at {len(t.nodes)} nodes", ", ".join(offered),
                     t.source])
    p, q = registry.MAX_ORDER
    rows.append([f"`{registry.FAMILY}`", f"x^i y^j, i <= p, j <= q; `order: [p, q]`, p up to {p}, q up to {q}",
                 "r, r_y, r_yy, ... at p + 1 nodes", "enhanced (q = 1) or continuum, and others",
                 "Garcia-Vallejo et al. 2007, with orders"])
    return table(["type", "basis", "nodal coordinates", "formulations (the first is the default)", "after"], rows)


# title, case, its probe: the beams on which element types are compared
BEAMS = (("linear", "paper/table1_2d3n", "mid"), ("large deflection", "paper/table2_2d3n", "tip"),
         ("thick, large deflection", "static/thick_cantilever_exact", "tip"))
EXACT = "{type: reissner3, count: 256}"


@cache
def deflection(case: str, probe: str, element: str) -> float:
    """Return uy of a probe of a case with another element. Raises CaseError and ComputationError."""
    outcome = run_case(load(CASES / f"{case}.yaml", [f"bodies.beam.element={element}"]))
    if outcome.failure is not None:
        raise outcome.failure
    return outcome.summary["probes"][probe]["uy"]


def error(case: str, probe: str, element: str) -> str:
    """Return the relative error against the geometrically exact beam, two digits, or that there is no solution."""
    try:
        value = abs(deflection(case, probe, element) / deflection(case, probe, EXACT) - 1)
    except ComputationError:
        return "no solution"
    return "< 1e-9" if value < ROUND_OFF else f"{value:.1e}"


def accuracy(counts: Sequence[int], beams: Sequence[tuple[str, str, str]]) -> str:
    """Return the errors of every type on the given beams and meshes."""
    labels = {f"`{name}`": f"type: {name}" for name in registry.ELEMENTS}
    labels[f"`{registry.FAMILY}` [3, 3]"] = f"type: {registry.FAMILY}, order: [3, 3]"
    labels |= {f"`{t.name}`, preset: paper": f"type: {t.name}, preset: paper"
               for t in registry.ELEMENTS.values() if t.preset}
    rows = []
    for label, element in labels.items():
        rows.append([label, *(error(case, probe, f"{{{element}, count: {n}}}")
                              for _, case, probe in beams for n in counts)])
    return table(["type", *(f"{title}, {n}" for title, _, _ in beams for n in counts)], rows)


# cases whose meshes are refined, their elements, and where the limit of the same type is looked for
MESHES = (("paper/table1_2d3n", (8, 16, 32, 64), 1024), ("paper/table1_2d2n", (2, 4, 8), 256),
          ("static/three_hinged_frame", (4, 8), 128), ("static/thick_cantilever", (2, 4), 256),
          ("modes/structural_two_node", (4, 8, 16), 128), ("modes/omar_enhanced", (2, 4, 8), 128))
TOLD = re.compile(r"(?:displacements have an error of|bending 2 by) about (\S+) %")


def resolution() -> str:
    """Return the errors of meshes beside the limits of their types, and what their warnings say."""
    rows = []
    for case, counts, limit in MESHES:
        def solved(count: int, case: str = case) -> tuple[list[float], list[str]]:
            loaded = load(CASES / f"{case}.yaml")
            more = [f"bodies.{name}.element.count={count}" for name in loaded.case.bodies]
            outcome = run_case(load(CASES / f"{case}.yaml", more))
            modes = [f["omega"] for f in outcome.summary.get("frequencies", ()) if f["kind"] == "bending"][:2]
            deflections = [p["uy"] for p in outcome.summary["probes"].values()][:1]
            return modes[1:] or deflections, [v for w in outcome.warnings for v in TOLD.findall(w)]

        (reference,), _ = solved(limit)
        for count in counts:
            (value,), told = solved(count)
            rows.append([f"`{case}`", str(count), f"{abs(100 * (value / reference - 1)):.2g} %",
                         f"about {told[0]} %" if told else ""])
    return table(["case", "elements", "error of the mesh", "the warning says"], rows)


def plastic_zones() -> str:
    """Return the errors of a cantilever with a plastic zone beside the limits of its types, and what warnings say."""
    def solved(kind: str, count: int) -> tuple[float, list[str]]:
        element = {"type": kind, "count": count} | ({"formulation": "structural"} if kind == "vallejo" else {})
        done = run_case(read_dict({
            "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": element,
                                "section": {"height": 0.1, "width": 0.05},
                                "material": {"E": 2e11, "nu": 0.3, "yield": 2.5e8, "hardening": {"isotropic": 2e9}}}},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}], "solver": {"type": "static", "steps": 4},
            "loads": [{"type": "force", "at": "beam@1", "value": [0, -1.4 * 2.5e8 * 0.05 * 0.1**2 / 6]}],
            "output": {"probes": {"tip": "beam@1"}}}))
        return done.summary["probes"]["tip"]["uy"], re.findall(r"yields, .* about (\S+) %", " ".join(done.warnings))

    rows = []
    for kind in ("reissner2", "reissner3", "cable", "vallejo"):
        limit, _ = solved(kind, 256)
        for count in (2, 4, 8, 16):
            value, told = solved(kind, count)
            rows.append([f"`{kind}`", str(count), f"{100 * abs(value / limit - 1):.2g} %",
                         f"about {told[0]} %" if told else ""])
    return table(["type", "elements", "error of the mesh", "the warning says"], rows)


def paper() -> str:
    """Return the paper's tables with a verdict per entry."""
    tables = reproduce_paper.TABLES.values()
    return "\n\n".join(f"```text\n{reproduce_paper.report(t, reproduce_paper.examine(t))}\n```" for t in tables)


def case_reference() -> str:
    """Return the reference of case files, with the solvers that can be run."""
    text = markdown_reference(vocabulary())
    runs = {kind.__name__ for kind in SOLVERS}
    solvers = text[text.index("\n## solver\n"):text.index("\n## goal\n")]
    for kind, tag in re.findall(r"^### (\w+) \(`type: (\w+)`\)$", solvers, re.M):
        if kind not in runs:
            text = re.sub(rf"^\* `{tag}`: .*\n", "", text, flags=re.M)
            text = re.sub(rf" or \[{tag}\]\([^)]*\)", "", text)
            text = re.sub(rf"^### {kind} \(`type: {tag}`\)\n.*?(?=^##)", "", text, flags=re.M | re.S)
    return text


def command_line(name: str) -> str:
    """Return the usage, the help and the options of a command, but for those that all commands have."""
    command = app.get_command(None, name)  # type: ignore[arg-type]
    assert command is not None
    context = click.Context(command, info_name=name)
    rows = []
    for option in (p for p in command.params if isinstance(p, click.Option) and p.name != "debug"):
        record = option.get_help_record(context)
        if record is not None:
            # a | would end the cell
            rows.append([cell.replace("|", "\\|") for cell in (f"`{record[0]}`", " ".join(record[1].split()))])
    usage = " ".join(["ancf2d", name, *command.collect_usage_pieces(context)])
    return "\n\n".join([f"```text\n{usage}\n```", inspect.cleandoc(command.help or ""),
                        *([table(["option", "meaning"], rows)] if rows else [])])


PARTS: dict[str, Callable[[], str]] = {
    "elements": elements,
    "accuracy": lambda: accuracy((8,), BEAMS),
    "accuracy-meshes": lambda: accuracy((2, 4, 8, 16, 32), BEAMS[1:2]),
    "accuracy-thick": lambda: accuracy((2, 4, 8, 16, 32), BEAMS[2:]),
    "resolution": resolution,
    "plastic-zones": plastic_zones,
    "paper": paper,
    "shape-functions": shape_functions.all_types,
    "audit-verdicts": audit_table.verdicts,
    "audit-failures": audit_table.failures,
    **{f"command-{name}": partial(command_line, name) for name in COMMANDS},
}


WHOLE: dict[str, Callable[[], str]] = {
    "case-reference.md": case_reference,
    "verification.md": verification_manual.manual,
}


def current(file: Path) -> str:
    """Return what a document should say."""
    if file.name in WHOLE:
        return WHOLE[file.name]()
    return MARKED.sub(lambda m: f"{m[1]}{PARTS[m[2]]()}\n{m[3]}", file.read_text(encoding="utf-8"))


def same(old: str, new: str) -> bool:
    """Return whether two texts differ by nothing but round-off in the rows of their tables."""
    lines = old.splitlines(), new.splitlines()
    return len(lines[0]) == len(lines[1]) and all(map(_same_line, *lines))


def _same_line(old: str, new: str) -> bool:
    if old == new:
        return True
    old, new = (line.replace("round-off", "0") for line in (old, new))
    if not old.startswith("|") or NUMBER.sub("", old) != NUMBER.sub("", new):
        return False
    a, b = NUMBER.findall(old), NUMBER.findall(new)
    # not the years of sources and the like
    slack = SLACK * max((abs(float(n)) for n in VALUE.findall(old)), default=0.0)
    return all(abs(float(x) - float(y)) <= max(slack, min(_last_digit(x), _last_digit(y)))
               for x, y in zip(a, b, strict=True))


def _last_digit(number: str) -> float:
    """Return what one in the last digit of a deviation such as 3.2e-06 is, which is known no better; 0 for others."""
    digits, mark, power = number.partition("e")
    # a little more, for the decimal digits are no binary ones
    return 1.01 * 10.0 ** (int(power) - len(digits.partition(".")[2])) if mark else 0.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check all documents; return the exit code."""
    parser = argparse.ArgumentParser(description="Generated parts of the documents.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 where one is not current")
    check = parser.parse_args(arguments).check
    stale = []
    files = {*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / name for name in WHOLE)}
    for file in (ROOT / "README.md", *sorted(files)):
        text = current(file)
        if not file.exists() or not same(file.read_text(encoding="utf-8"), text):
            stale.append(file.relative_to(ROOT).as_posix())
            if not check:
                file.write_text(text, encoding="utf-8")
    if stale:
        print(f"{'not current' if check else 'written'}: {', '.join(stale)}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
