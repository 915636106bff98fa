"""``ancf2d audit``: examine an element type."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from .options import complete_types, examples, json_session, parsed, whole_numbers
from .session import Bar, Session
from .text import number, table

if TYPE_CHECKING:
    from ..study.audit.examine import Audit


_quadrature = parsed(lambda text: text if text == "exact" else whole_numbers(text),
                     lambda found: found == "exact" or (len(found) == 2 and min(found) >= 1),
                     "not a pair of numbers of Gauss points; expected for example 2,2, or exact")


@click.command(epilog=examples("ancf2d audit 2d2n", "ancf2d audit omar --preset paper",
                               'ancf2d audit "ancf[3,2]" --json',
                               "ancf2d audit mine.yaml --formulation continuum --quadrature 3,2"))
@click.argument("element", metavar="ELEMENT", shell_complete=complete_types)
@click.option("--preset", type=click.Choice(["paper"]), help="Formulation, quadrature and shear factor of the paper.")
@click.option("--formulation", help="Formulation. Default: the one recommended for the type.")
@click.option("--quadrature", callback=_quadrature, metavar="NX,NY",
              help="Gauss points along and across, or exact. Default: those of type and formulation.")
@click.option("--laws", is_flag=True, help="Also examine the material laws that the formulation supports: tangent, "
              "objectivity, dissipation and cycles.")
@json_session
def command(session: Session, element: str, preset: str | None, formulation: str | None,
            quadrature: list[int] | str | None, laws: bool) -> int:
    """Examine an element type: basis, forces, patch tests, locking, convergence, cost.

    ELEMENT is a type listed by 'ancf2d elements', or a file that defines an element of your own. Each check prints a
    number, a verdict (pass, fail or note) and its meaning. The exit code is 0 even if checks fail.
    """
    session.subject = {"element": element}
    from ..processors import THREADS

    # the matrices are small, so that threads would only wait for each other
    for name in THREADS:
        os.environ.setdefault(name, "1")
    from ..study.audit.examine import CHECKS, LAW_CHECKS, audit
    from ..study.audit.subject import subject

    found = subject(element, preset, formulation, quadrature)
    with Bar("examining", session.shows_progress) as bar:
        result = audit(found, (*CHECKS, *(LAW_CHECKS if laws else ())), compiling=session.note_once, done=bar.update)
    session.print_json(result.as_json())
    session.out(report(result))
    return 0


def report(audit: Audit) -> str:
    """Return an audit as printed text: the subject, a line for each check, the number of each verdict."""
    s, plan = audit.subject, audit.subject.plan
    lines = [f"{s.name}: basis {', '.join(s.element.basis)}; {s.element.n_dof} coordinates"]
    if plan is not None:
        lines.append(f"formulation {plan.formulation.name}, {plan.rule}")
    rows = [["check", "value", "verdict", "meaning"]]
    made = audit.made
    for result in made:
        f = result.finding
        rows.append([result.check.name, number(f.value, 4), f.verdict, f.meaning])
    lines += ["", *table(rows, left=(0, 2, 3)), ""]
    verdicts = [a.finding.verdict for a in made]
    lines.append(", ".join(f"{verdicts.count(v)} {v}" for v in ("pass", "fail", "note") if v in verdicts))
    if len(made) < len(audit.results):
        lines.append(f"{len(audit.results) - len(made)} other checks were not made because there are no shape "
                     "functions")
    return "\n".join(lines)
