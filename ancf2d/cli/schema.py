"""``ancf2d schema``: the format of case files, for editors and for readers."""

from __future__ import annotations

import json
import os

import click

from .options import debug_option, examples, force_option
from .session import Session


@click.command(epilog=examples("ancf2d schema -o ancf2d.schema.json", "ancf2d schema --markdown"))
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write to a file instead of stdout.")
@click.option("--markdown", is_flag=True, help="The reference of all keys as Markdown, instead of the JSON Schema.")
@click.option("--definition", is_flag=True, help="The schema of files that define your own elements.")
@force_option
@debug_option
@click.pass_obj
def command(session: Session, output: str | None, markdown: bool, definition: bool, force: bool) -> int:
    """Print the JSON Schema of case files."""
    if markdown and definition:
        raise click.UsageError("--markdown and --definition exclude each other.")
    text = schema_text(markdown, definition)
    if output is None:
        click.echo(text, nl=False)
        return 0
    write_schema(output, text, force)
    session.out(f"wrote {output}")
    return 0


def schema_text(markdown: bool = False, definition: bool = False) -> str:
    """Return the JSON Schema of cases (or of element definitions), or the reference in Markdown."""
    from ..case import definition_schema, json_schema, markdown_reference
    from ..results.own import MARK
    from ..study.run import vocabulary

    names = vocabulary()
    if markdown:
        return f"{markdown_reference(names)}\n<!-- {MARK} -->\n"
    schema = definition_schema(names) if definition else json_schema(names)
    return json.dumps({"$comment": MARK, **schema}, indent=2) + "\n"


def write_schema(path: str | os.PathLike[str], text: str, force: bool) -> None:
    """Write a schema; ResultsError where that would replace something else, or cannot be done."""
    from ..results.replace import replacing

    with replacing(path, force) as private:
        private.write_text(text, encoding="utf-8")
