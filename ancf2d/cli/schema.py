"""``ancf2d schema``: the format of case files and of what commands print, for editors, programs and readers."""

from __future__ import annotations

import json
import os
from typing import Any

import click

from .options import examples, force_option, plain_session
from .output_schema import OUTPUTS, output_schema
from .session import Session
from .text import write


@click.command(epilog=examples("ancf2d schema -o ancf2d.schema.json", "ancf2d schema --markdown",
                               "ancf2d schema --of run"))
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write to a file instead of stdout.")
@click.option("--markdown", is_flag=True,
              help="Print the reference of all keys as Markdown, in place of the JSON Schema.")
@click.option("--definition", is_flag=True, help="Print the schema of files that define your own elements.")
@click.option("--of", "of", type=click.Choice(list(OUTPUTS)),
              help="Print the schema of what a command prints with --json.")
@force_option
@plain_session
def command(session: Session, output: str | None, markdown: bool, definition: bool, of: str | None,
            force: bool) -> int:
    """Print the JSON Schema of case files, or of what a command prints with --json."""
    if markdown + definition + (of is not None) > 1:
        raise click.UsageError("--markdown, --definition and --of exclude each other.")
    text = schema_text(markdown, definition) if of is None else _as_text(output_schema(of))
    if output is None:
        write(text)
        return 0
    write_schema(output, text, force)
    session.out(f"wrote {output}")
    return 0


def schema_text(markdown: bool = False, definition: bool = False) -> str:
    """Return the JSON Schema of cases (or of element definitions), or the reference in Markdown."""
    from ..case import definition_schema, json_schema, markdown_reference
    from ..results.target import MARK
    from ..study.run import vocabulary

    names = vocabulary()
    if markdown:
        return f"{markdown_reference(names)}\n<!-- {MARK} -->\n"
    schema = definition_schema(names) if definition else json_schema(names)
    return _as_text(schema)


def _as_text(schema: dict[str, Any]) -> str:
    from ..results.target import MARK

    return json.dumps({"$comment": MARK, **schema}, indent=2) + "\n"


def write_schema(path: str | os.PathLike[str], text: str, force: bool) -> None:
    """Write a schema; ResultsError where that would replace something else, or cannot be done."""
    from ..results.target import replacing

    with replacing(path, force) as private:
        private.write_text(text, encoding="utf-8")
