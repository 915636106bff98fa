"""``ancf2d compare``: two result files as numbers."""

from __future__ import annotations

import click

from .failures import FAILED
from .options import debug_option, examples, json_option
from .session import Session


@click.command(epilog=examples("ancf2d compare beam.h5 stored.h5",
                               "ancf2d compare beam.h5 stored.h5 --rtol 1e-6 --json"))
@click.argument("a", type=click.Path(), metavar="A.h5")
@click.argument("b", type=click.Path(), metavar="B.h5")
@click.option("--rtol", type=click.FloatRange(min=0), default=1e-9, show_default=True,
              help="Allowed difference, relative to the largest value of the same kind.")
@click.option("--atol", type=click.FloatRange(min=0), default=0.0, show_default=True,
              help="Allowed difference, absolute.")
@json_option
@debug_option
@click.pass_obj
def command(session: Session, a: str, b: str, rtol: float, atol: float) -> int:
    """Compare two result files as numbers.

    Compared are mesh, states, probes, tables, modes and the summary; not wall times, versions, dates or
    names. Exits with 1 where they differ beyond the tolerance.
    """
    session.subject = {"a": a, "b": b}
    from ..results import compare_results, comparison_text, differences_json

    differences = compare_results(a, b, rtol, atol)
    session.print_json({**session.subject, "status": "differ" if differences else "agree", "rtol": rtol, "atol": atol,
                        "differences": differences_json(differences)})
    session.out(comparison_text(differences, a, b))
    return FAILED if differences else 0
