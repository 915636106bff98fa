"""``ancf2d fit``: fit numbers of a case to measured data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ..errors import all_of, first_of, many, raise_any
from .options import case_argument, case_stem, examples, force_option, json_session, set_option, vary_option
from .session import Session
from .text import command_line, number, table

if TYPE_CHECKING:
    from ..study.fit import Fit


@click.command(epilog=examples("ancf2d fit beam.yaml --data tip.csv --vary bodies.beam.material.E=1e10:1e12",
                               "ancf2d fit beam.yaml --data tip.csv --vary bodies.beam.material.E=1e10:1e12 "
                               "--vary loads.tip.value.1=-10:0 --starts 2"))
@case_argument
@click.option("--data", "data_file", type=click.Path(), required=True, metavar="FILE.csv",
              help="Measured data: columns t, factor or hz, then PROBE.QUANTITY, as 'export' writes them; leave cells "
              "empty where nothing was measured.")
@vary_option
@click.option("--sigma", multiple=True, metavar="PROBE.QUANTITY=S",
              help="Standard deviation of the noise in a column, in its units; default: columns are weighted by their "
              "ranges. May be given several times.")
@click.option("--starts", type=click.IntRange(min=1, max=1000), default=1, show_default=True, metavar="N",
              help="Number of searches, from the case's own numbers and from others within the bounds; the best is "
              "kept.")
@set_option
@click.option("-o", "--output", type=click.Path(), metavar="FITTED.yaml",
              help="Case with the fitted numbers; default: the case's name with -fitted, in the working directory.")
@click.option("--results", type=click.Path(), metavar="FILE.h5",
              help="File of parameters, data and model; default: the case's name with -fit.h5.")
@force_option
@json_session
def command(session: Session, case: str, data_file: str, vary: tuple[str, ...], sigma: tuple[str, ...], starts: int,
            overrides: tuple[str, ...], output: str | None, results: str | None, force: bool) -> int:
    """Fit numbers of a case to measured data.

    Prints each number with its standard error, and writes the case with these numbers. 'ancf2d plot' draws data and
    model from the result file.
    """
    session.subject = {"case": case}
    from ..case.axes import read_bounds
    from ..results.target import CASE, RESULTS, check_output
    from ..study.digests import inputs_of
    from ..study.fit import fit, write_case, write_fit
    from ..study.fit_data import read_data
    from ..study.run import load

    loaded, data, noise = first_of(
        lambda: all_of(lambda: load(case, overrides), lambda: read_data(data_file), lambda: _noise(sigma)),
        lambda: read_bounds(vary))
    output = output if output is not None else f"{case_stem(case)}-fitted.yaml"
    results = results if results is not None else f"{case_stem(case)}-fit.h5"
    for path, kind in ((output, CASE), (results, RESULTS)):
        check_output(path, force, data_file, *inputs_of(loaded), kind=kind)
    found = fit(loaded, data, vary, noise, starts)
    fitted = {row.path: row.value for row in found.rows}
    found.warnings += write_case(loaded, fitted, output, session.command_line, force)
    write_fit(found, results, session.command_line, force)
    for text in found.warnings:
        session.warn(text)
    session.print_json({**found.as_json(), "output": output, "results": results})
    session.out(report(found))
    session.out(f"\nwrote {output}; data and model in {results}; next: {command_line('plot', results)}")
    return 0


def _noise(options: tuple[str, ...]) -> dict[str, float]:
    """Return the noise of columns given by --sigma. Raises CaseError with all problems."""
    from ..errors import Problem

    problems, found = [], {}
    for text in options:
        name, _, value = text.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            problems.append(Problem("not PROBE.QUANTITY=NUMBER", file=f"--sigma {text}",
                                    expected="for example tip.uy=1e-4"))
    raise_any(problems)
    return found


def report(fit: Fit) -> str:
    """Return a fit as printed text: parameters with their errors, then how well each column agrees."""
    from ..case.units import with_unit

    rows = [["number", "value", "standard error", "start", "low", "high"],
            *([row.path, number(row.value, 8), number(row.standard_error, 2), number(row.start, 4), number(row.low, 4),
               number(row.high, 4)] for row in fit.rows)]
    columns = [["column", "points", "rms difference", "scale"],
               *([with_unit(name.replace(".", " "), fit.loaded.case.units.labels), str(int(n)), number(rms, 4),
                  number(scale, 4)] for name, n, rms, scale in
                 zip(fit.data.names, fit.data.known.sum(axis=0), fit.rms, fit.scales, strict=True))]
    pairs = [(float(fit.correlation[i, j]), fit.rows[i].path, fit.rows[j].path)
             for i in range(len(fit.rows)) for j in range(i)]
    strong = [f"{a} and {b} are correlated: {c:.3f}" for c, a, b in pairs if abs(c) > 0.9]
    tried = [f"start {k}: residual {one['residual']:.4g}" for k, one in enumerate(fit.starts, start=1)]
    return "\n".join([*([fit.title, ""] if fit.title else []), *table(rows), "", *table(columns),
                      *(["", *strong] if strong else []), *(["", *tried] if len(tried) > 1 else []),
                      "", f"residual {fit.residual:.4g} after {many(fit.runs, 'run')}"])
