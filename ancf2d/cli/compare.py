"""``ancf2d compare``: compare the numbers in two result files."""

from __future__ import annotations

import click

from .failures import FAILED
from .options import examples, json_session
from .session import Session


@click.command(epilog=examples("ancf2d compare beam.h5 stored.h5",
                               "ancf2d compare beam.h5 stored.h5 --rtol 1e-6 --json"))
@click.argument("a", type=click.Path(), metavar="A.h5")
@click.argument("b", type=click.Path(), metavar="B.h5")
@click.option("--rtol", type=click.FloatRange(min=0), default=1e-9, show_default=True, metavar="TOL",
              help="Allowed difference, relative to the largest value of the same kind.")
@click.option("--atol", type=click.FloatRange(min=0), default=0.0, show_default=True, metavar="TOL",
              help="Allowed absolute difference.")
@click.option("--all", "everything", is_flag=True, help="Also compare the numbers of steps and iterations, and require "
              "the same stored states.")
@json_session
def command(session: Session, a: str, b: str, rtol: float, atol: float, everything: bool) -> int:
    """Compare the numbers in two result files.

    Compares mesh, states, probes, tables, modes and the summary. Ignores wall times, versions, dates and names and,
    without --all, the numbers of steps and iterations. If the files have different numbers of states, compares the
    states at common times or load factors. Exits with 1 if the files differ by more than the tolerance.
    """
    session.subject = {"a": a, "b": b}
    from ..results import compare_results, comparison_text, differences_json, left_out, open_results

    with open_results(a) as one, open_results(b) as two:
        differences = compare_results(one, two, rtol, atol, everything)
        remark = "" if everything else left_out(one, two)
    session.print_json({**session.subject, "status": "differ" if differences else "agree", "rtol": rtol, "atol": atol,
                        "differences": differences_json(differences)})
    session.out(comparison_text(differences, a, b))
    if remark:
        session.out(remark)
    return FAILED if differences else 0
