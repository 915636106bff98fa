"""``ancf2d tradeoff``: what accuracy costs, over element types, meshes, integrators and steps."""

from __future__ import annotations

import math
import re
import shlex
from typing import TYPE_CHECKING, Any

import click

from ..errors import CaseError
from .convergence import element_counts, positive_numbers, reference_value
from .failures import FAILED
from .options import (
    case_argument,
    complete_types,
    debug_option,
    examples,
    force_option,
    jobs_option,
    json_option,
    quiet_option,
    scheduler_option,
    set_option,
    workers,
)
from .progress import Bar
from .session import Session
from .text import command_line, say
from .tradeoff_report import report

if TYPE_CHECKING:
    from ..study.tradeoff.plan import Choice

UNITS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


def _seconds(ctx: click.Context, parameter: click.Parameter, value: str) -> float:
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(s|min|h|)\s*", value)
    try:
        seconds = float(found[1]) * UNITS[found[2]] if found else math.nan
    except ValueError:
        seconds = math.nan
    if not 0.0 <= seconds < math.inf:
        raise click.BadParameter(f"'{value}' is not a time; expected for example 60s or 5min.")
    return seconds


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
@click.option("--budget", default="60s", show_default=True, callback=_seconds, metavar="TIME",
              help="Time that the study may take, without compilation, in s, min or h. It is divided among the types; "
              "each solves its cheapest settings first. Settings that do not fit are left out and listed.")
@click.option("--repeat", default=3, show_default=True, type=click.IntRange(min=1), metavar="N",
              help="Number of timed runs of each setting, more for short ones; the median counts.")
@click.option("--accuracy", "accuracies", default="1e-2,1e-3,1e-4", show_default=True, callback=positive_numbers,
              metavar="TOL,...", help="Relative errors for which a setting is recommended.")
@click.option("--against", type=click.Choice(["limit", "continuum"]), default="limit", show_default=True,
              help="Error that the front and the recommendations are based on: relative to each type's own limit, or "
              "to the plane-stress continuum, which adds the model error.")
@click.option("--reference", default="auto", show_default=True, callback=reference_value, metavar="VALUE",
              help="Reference for the errors: a number, or auto for a finer solution of the same type.")
@jobs_option("Number of settings solved at the same time; this changes measured times but no errors.", "1")
@scheduler_option
@click.option("-o", "--output", type=click.Path(), metavar="OUT.h5", help="Write the table to a result file.")
@set_option
@force_option
@json_option
@quiet_option
@debug_option
@click.pass_obj
def command(session: Session, case: str, overrides: tuple[str, ...], jobs: int | None, scheduler: str | None,
            output: str | None, force: bool, **chosen: Any) -> int:
    """Measure what accuracy costs, and recommend a setting for each wanted accuracy.

    Prints error, solve time, and memory of every setting, marks those that no other beats in both error and time, and
    says which is the cheapest for each wanted accuracy.
    """
    session.subject = {"case": case}
    from ..results import check_output
    from ..study.digests import inputs_of
    from ..study.run import load
    from ..study.tradeoff.study import tradeoff

    choice, who = _choice(**chosen), workers(jobs, scheduler, default=1)
    loaded = load(case, overrides)
    check_output(output, force, *inputs_of(loaded))
    with Bar("solving", session.shows_progress) as bar:
        study = tradeoff(loaded, choice, who, session.note_once, bar.follow)
    for text in study.warnings:
        session.warn(text)
    result = study.as_json()
    if output is not None:
        from ..study.tradeoff.file import write_tradeoff

        write_tradeoff(study, loaded, output, session.command_line, force=force)
        result["output"] = output
    session.print_json(result)
    given = [part for text in overrides for part in ("--set", text)]
    session.out(report(study, shlex.join(["ancf2d", "run", case, *given])))
    if output is not None:
        session.out(f"\nresults in {output}; next: {command_line('plot', output)}")
    if not study.converged:
        say(f"error: {result['reason']}", err=True)
        return FAILED
    return 0


def _quadratures(text: str) -> tuple[Any, ...]:
    """Return the quadratures in ``[2,2],exact``; whether they can be, the case tells."""
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

    if dts and tolerances:
        raise click.UsageError("--dt and --tolerance are both given; give only one.")
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
        key="dt" if dts else "tolerance" if tolerances else "", steps=dts or tolerances or (), repeat=repeat,
        budget=budget, accuracies=accuracies, reference=reference, continuum=against == "continuum")
