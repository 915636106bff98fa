"""``ancf2d export``: write results in other formats."""

from __future__ import annotations

import os

import click

from .options import examples, force_option, json_session
from .session import Bar, Session


@click.command(epilog=examples("ancf2d export swing.h5 swing.vtkhdf", "ancf2d export swing.h5 tip.csv",
                               "ancf2d export swing.h5 swing.json"))
@click.argument("source", type=click.Path(), metavar="OUT.h5")
@click.argument("file", type=click.Path(), metavar="FILE")
@force_option
@json_session
def command(session: Session, source: str, file: str, force: bool) -> int:
    """Write results in another format, selected by the suffix of FILE.

    .vtkhdf: the bodies with their sections over time, for ParaView. .csv: the probes, one line per stored value.
    .npz and .mat: the matrices A, B, C, D of solver state_space, for NumPy and MATLAB. .json: all small data: origin,
    summary, probes, steps, tables.
    """
    session.subject = {"file": source, "output": file}
    from ..results.export import export

    with Bar("writing", session.shows_progress) as bar:
        chosen = export(source, file, force, bar.update)
    session.print_json({**session.subject, "status": "written", "bytes": os.path.getsize(file)})
    session.out(f"wrote {file} ({chosen.holds})")
    return 0
