"""``ancf2d info``: describe a result file."""

from __future__ import annotations

import click

from .options import examples, json_session
from .session import Session


@click.command(epilog=examples("ancf2d info beam.h5", "ancf2d info beam.h5 --json"))
@click.argument("file", type=click.Path(), metavar="OUT.h5")
@json_session
def command(session: Session, file: str) -> int:
    """Describe the contents and origin of a result file.

    Also reads unfinished files (NAME.h5.part).
    """
    session.subject = {"file": file}
    from ..results import describe, describe_text

    found = describe(file)
    session.print_json(found)
    session.out(describe_text(found))
    return 0
