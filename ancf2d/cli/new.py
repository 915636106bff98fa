"""``ancf2d new``: write a commented case to start from."""

from __future__ import annotations

import os
from pathlib import Path

import click

from ..errors import ResultsError
from .options import examples, plain_session
from .schema import schema_text, write_schema
from .session import Session
from .text import command_line

# same as case.TEMPLATES, whose import takes time that --help need not spend
KINDS = tuple(sorted(file.stem for file in (Path(__file__).parents[1] / "case" / "templates").glob("*.yaml")))
DEFAULT = "cantilever"


@click.command(epilog=examples("ancf2d new bridge --kind simply_supported", "ancf2d new fall --kind pendulum"))
@click.argument("name", type=click.Path(), metavar="NAME")
@click.option("--kind", type=click.Choice(KINDS),
              help=f"Template. Default: NAME if it is the name of a template, else {DEFAULT}.")
@click.option("--force", is_flag=True, help="Replace NAME.yaml if it exists.")
@plain_session
def command(session: Session, name: str, kind: str | None, force: bool) -> int:
    """Write a commented case NAME.yaml to start from.

    Also writes the schema of case files to the same folder if it is not there yet; editors use it to complete and
    check the case.
    """
    if not os.path.basename(name):
        raise ResultsError(f"'{name}' is not a valid case name; expected for example bridge")
    path = Path(name) if name.endswith((".yaml", ".yml")) else Path(name + ".yaml")
    if os.path.lexists(path) and not force:
        raise ResultsError(f"'{path}' exists; choose another name, or replace the file with --force")
    from ..case import SCHEMA_FILE, template
    from ..results.target import replacing

    text = template(path.stem, kind or (path.stem if path.stem in KINDS else DEFAULT))
    with replacing(path, force) as private:
        private.write_text(text, encoding="utf-8")
    session.out(f"wrote {path}")
    schema = path.parent / SCHEMA_FILE
    if not schema.exists():
        write_schema(schema, schema_text(), False)
        session.out(f"wrote {schema} (editors check the case against it)")
    session.out(f"next: edit it, {command_line('validate', path)}, {command_line('run', path)}")
    return 0
