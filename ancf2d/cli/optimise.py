"""``ancf2d optimise``: find the best values of some numbers of a case."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ..errors import first_of, many
from .failures import FAILED
from .options import case_argument, case_stem, examples, force_option, json_session, set_option, vary_option
from .session import Bar, Session
from .text import command_line, number, say, table

if TYPE_CHECKING:
    from ..study.optimum import Optimum


@click.command(epilog=examples(
    "ancf2d optimise beam.yaml --vary bodies.beam.section.height=0.02:0.2 --minimise mass "
    '--subject-to "tip.uy >= -2e-3"',
    "ancf2d optimise beam.yaml --vary bodies.beam.section.height=0.02:0.2 --vary bodies.beam.section.width=0.02:0.2 "
    '--minimise "max(stress)" --subject-to "mass <= 12"'))
@case_argument
@vary_option
@click.option("--minimise", required=True, metavar="EXPRESSION",
              help="Objective: an expression in goal, mass, strain_energy, parameters, PROBE.QUANTITY and SUPPORT.fx, "
              "fy or m (of the last state), and in max(...) and min(...) of such an expression over all states, or of "
              "a field over all bodies, e.g. max(abs(M)).")
@click.option("--subject-to", "constraints", multiple=True, metavar='"EXPRESSION <= C"',
              help="A constraint on such expressions, with <=, >= or ==. May be given several times.")
@click.option("--method", type=click.Choice(["slsqp", "trust-constr"]), default="slsqp", show_default=True,
              help="Optimiser, from SciPy.")
@click.option("--iterations", type=click.IntRange(min=1), default=100, show_default=True, metavar="N",
              help="Maximum number of iterations of the optimiser.")
@click.option("-o", "--output", type=click.Path(), metavar="BEST.yaml",
              help="Case with the best values; default: the case's name with -best, in the working directory.")
@click.option("--history", type=click.Path(), metavar="OUT.h5", help="Also write all evaluations that "
              "succeeded to a result file.")
@set_option
@force_option
@json_session
def command(session: Session, case: str, vary: tuple[str, ...], minimise: str, constraints: tuple[str, ...],
            method: str, iterations: int, output: str | None, history: str | None, overrides: tuple[str, ...],
            force: bool) -> int:
    """Find the best values of some numbers of a case.

    Writes the case with these values. Derivatives are those of the command sensitivity. Exits with 1 if the optimiser
    does not converge, or if no values within the bounds satisfy all constraints; the case then has the best values
    that did, or else the last ones tried.
    """
    session.subject = {"case": case}
    from ..case.axes import read_bounds
    from ..results.target import CASE, RESULTS, check_output
    from ..study.digests import inputs_of
    from ..study.fit import write_case
    from ..study.optimise import optimise, problem_of
    from ..study.optimum import write_optimisation
    from ..study.record import Progress
    from ..study.run import load

    loaded = first_of(lambda: load(case, overrides), lambda: read_bounds(vary))
    place = output if output is not None else f"{case_stem(case)}-best.yaml"
    for path, kind in ((place, CASE), (history, RESULTS)):
        check_output(path, force, *inputs_of(loaded), kind=kind)
    problem = problem_of(loaded, vary, minimise, constraints)
    with Bar("optimising", session.shows_progress) as bar:
        found = optimise(problem, method, iterations, Progress(compiling=session.note_once),
                         lambda point: bar.update(0.0, f"{minimise} = {number(point.value)}", 0.0))
    found.warnings += write_case(loaded, {row.path: row.value for row in found.rows}, place,
                                 session.command_line, force)
    for text in found.warnings:
        session.warn(text)
    result = {**found.as_json(), "output": place}
    if history is not None:
        write_optimisation(found, loaded, history, session.command_line, force=force)
        result["history"] = history
    session.print_json(result)
    session.out(report(found))
    session.out(f"\nwrote {place}; next: {command_line('run', place)}")
    if history is not None:
        session.out(f"results in {history}; next: {command_line('plot', history)}")
    if not found.found:
        say(f"error: {found.message}", err=True)
        return FAILED
    return 0


def report(found: Optimum) -> str:
    """Return an optimum as printed text: the numbers, the minimum, the constraints."""
    bound = {"low": "at the lower bound", "high": "at the upper bound", None: ""}
    rows = [["number", "start", "best", ""]] + [
        [row.path, number(row.start), number(row.value, 9), bound[row.at_bound]] for row in found.rows]
    lines = [found.title, ""] if found.title else []
    lines += [*table(rows, left=(0, 3)), ""]
    first = found.history[0].value
    lines.append(f"{found.measure} = {number(found.minimum, 9)}, {number(first, 9)} at the start")
    for one in found.constraints:
        state = "active" if one["met"] and one["active"] else "met" if one["met"] else "not met"
        lines.append(f"{one['constraint']}: {state}")
    failed = f", {found.failed} of them failed" if found.failed else ""
    lines.append(f"{many(found.evaluations, 'evaluation')}{failed}, {many(found.gradients, 'gradient')}")
    return "\n".join(lines)
