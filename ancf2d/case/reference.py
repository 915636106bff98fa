"""The case format for people and editors, as Markdown, JSON Schema and templates, generated from the records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..errors import CaseError, Problem
from .binder import Binder, Vocabulary, listed, nearest
from .definition import ElementDefinition
from .emit import flow, text_scalar
from .kinds import Book, Choice, Kind, ListOf, MapOf
from .records import ByKeys, ByShape, Key, OneOf, Record, define, keys_of, tag_of, title_of
from .schema import Case

_INTRO = """\
# Case files

A case file is YAML. A number may be written `1e3`, `1.0e3` or `1000`; `on`, `yes` and dates are
text; anchors, aliases, merge keys and tags are not used. Units are SI unless `units` says
otherwise, angles are in radians, x points to the right, y up, positive rotation is
counter-clockwise. A point is written `BODY@S` with S in [0, 1] along the body's arc length.

Every value can be overridden on the command line: `--set bodies.beam.element.count=32`,
`--set loads.0.value.1=-500`; items of lists are named by index or by their `name`.
`--set 'loads+={type: moment, at: beam@1, value: 3}'` appends an item to a list, and `--set goal=null` removes an
optional key, if it is there, or an item. `ancf2d run -` reads the case from stdin.
"""

# notes on a key of the case, in addition to its records
_NOTES = {"units": """\
Nothing is converted: labels are printed with results, and all numbers of the case are in one consistent set. Its unit
of mass is force time^2/length. In mm, N and s, which suit small parts, it is the tonne (t = N s^2/mm):

| | in m, N, s | in mm, N, s |
| --- | --- | --- |
| length of a beam | 2 m | 2000 mm |
| E of steel | 2.07e11 Pa | 2.07e5 N/mm^2 (MPa) |
| rho of steel | 7850 kg/m^3 | 7.85e-9 t/mm^3 |
| gravity | 9.81 m/s^2 | 9810 mm/s^2 |
| line load | 1 N/m | 1e-3 N/mm |
| moment | 1 N m | 1000 N mm |
| mass, moment of inertia | 1 kg, 1 kg m^2 | 1e-3 t, 1e3 t mm^2 |

`ancf2d validate` and `run` warn about a density or modulus that no material has in the labelled units, a modulus that
seems to be in MPa or GPa, gravity that differs from that of the earth by a power of 1000, and a yield stress that no
material with this modulus has.
"""}
SCHEMA_FILE = "ancf2d.schema.json"


def markdown_reference(vocabulary: Vocabulary | None = None) -> str:
    """Return the reference of every key of a case file: its value, default and meaning."""
    writer = _Writer(Binder(vocabulary))
    writer.lines = [_INTRO, "## The case", ""]
    writer.anchors = {k.kind.cls: k.name for k in keys_of(Case).values()
                      if isinstance(k.kind, Record)}
    writer.table(Case)
    for k in keys_of(Case).values():
        records = _records(k.kind)
        if not records:
            continue
        writer.lines += [f"## {k.name}", ""]
        if not isinstance(k.kind, Record):
            writer.lines.append(f"{k.doc}.")
        if isinstance(k.kind, OneOf) or isinstance(getattr(k.kind, "item", None), OneOf):
            writer.lines += ["", "`type` says which:", ""]
            writer.lines += [f"* `{tag_of(c)}`: {title_of(c)}" for c in records]
        if writer.lines[-1]:
            writer.lines.append("")
        if isinstance(k.kind, Record):
            # the section of the key is the section of its record
            writer.record(k.kind.cls, level=2)
            writer.lines += [_NOTES[k.name]] if k.name in _NOTES else []
        else:
            for cls in records:
                writer.record(cls, level=3)
    return "\n".join(writer.lines).rstrip() + "\n"


def _records(kind: Any) -> list[type]:
    """Return the records that a value of this kind may be, without those of their keys."""
    if isinstance(kind, Record):
        return [kind.cls]
    if isinstance(kind, OneOf):
        return list(kind.options.values())
    if isinstance(kind, ByKeys):
        return [cls for cls, _ in kind.options]
    if isinstance(kind, ListOf | MapOf):
        return _records(kind.item)
    if isinstance(kind, ByShape):
        return [cls for below in kind.kinds.values() for cls in _records(below)]
    return []


class _Writer:
    """Lines of Markdown; each record is described once, where it first occurs."""

    def __init__(self, binder: Binder) -> None:
        self.binder = binder
        self.lines: list[str] = []
        self.seen: set[type] = set()
        # records that are described under the key of the case that has them
        self.anchors: dict[type, str] = {}

    def record(self, cls: type, level: int) -> None:
        """Describe a record and, below it, the records of its keys."""
        if cls in self.seen:
            return
        self.seen.add(cls)
        if cls not in self.anchors:
            self.lines += [f"{'#' * level} {heading(cls)}", ""]
        self.lines += [title_of(cls), ""]
        if keys_of(cls):
            self.table(cls)
        for k in keys_of(cls).values():
            for below in _records(k.kind):
                self.record(below, min(level + 1, 5))

    def table(self, cls: type) -> None:
        """Write the table of a record's keys."""
        self.lines += ["| key | value | default | meaning |", "| --- | --- | --- | --- |"]
        self.lines += [self.row(k) for k in keys_of(cls).values()]
        self.lines.append("")

    def row(self, k: Key) -> str:
        value = self.value(k.kind)
        if k.example is not None:
            value += f", such as `{_short(k.example)}`"
        default = "**required**" if k.required else _default(k)
        return f"| `{k.name}` | {value} | {default} | {k.doc} |"

    def link(self, cls: type) -> str:
        """Return a link to the description of a record."""
        text = self.anchors.get(cls) or heading(cls)
        anchor = "".join(c for c in text.lower() if c.isalnum() or c in " -_")
        return f"[{tag_of(cls) or cls.__name__}](#{anchor.replace(' ', '-')})"

    def value(self, kind: Kind) -> str:
        """Return a description of the allowed values, with links to records."""
        if isinstance(kind, OneOf):
            return " or ".join(self.link(cls) for cls in _records(kind))
        if isinstance(kind, Record | ByKeys):
            short = getattr(kind, "short", "")
            links = " or ".join(self.link(cls) for cls in _records(kind))
            return f"{self.value(keys_of(kind.cls)[short].kind)}, or {links}" if (
                isinstance(kind, Record) and short) else links
        if isinstance(kind, ByShape):
            return ", or ".join(self.value(below) for below in kind.kinds.values())
        if isinstance(kind, ListOf | MapOf) and _records(kind):
            return kind.words(self.binder)
        if isinstance(kind, Choice):
            return ", ".join(f"`{name}`" for name in kind.names(self.binder)) or "text"
        return kind.words(self.binder)


def heading(cls: type) -> str:
    """Return the heading of a record."""
    return f"{cls.__name__} (`type: {tag_of(cls)}`)" if tag_of(cls) else cls.__name__


def _short(value: Any) -> str:
    return value if isinstance(value, str) else flow(value)


def _default(k: Key) -> str:
    if isinstance(k.default, bool | int | float | str) and k.default != "":
        return f"`{_short(k.default)}`"
    if isinstance(k.default, tuple) and k.default:
        return f"`{flow(list(k.default))}`"
    return "none" if isinstance(k.default, tuple | dict) else ""


def json_schema(vocabulary: Vocabulary | None = None) -> dict[str, Any]:
    """Return the JSON Schema (draft-07) of case files.

    It describes data as this package's loader reads it (YAML 1.2: 1e3 is a number); YAML language servers read it in
    the same way. Rules about several values at once are left to ``validate``.
    """
    return _root(Case, "ancf2d case", vocabulary)


def definition_schema(vocabulary: Vocabulary | None = None) -> dict[str, Any]:
    """Return the JSON Schema (draft-07) of element definition files."""
    return _root(ElementDefinition, "ancf2d element definition", vocabulary)


def _root(cls: type, title: str, vocabulary: Vocabulary | None) -> dict[str, Any]:
    book = Book(vocabulary or Vocabulary())
    define(cls, book)
    root = book.definitions.pop(cls.__name__)
    return {"$schema": "http://json-schema.org/draft-07/schema#", "title": title, **root,
            "definitions": book.definitions}


_FOLDER = Path(__file__).with_name("templates")
# every file in the folder is a template
TEMPLATES = tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


def template(name: str, kind: str = "cantilever") -> str:
    """Return the text of a commented case of a kind, which tells editors that its schema is in the same folder.

    Raises CaseError if there is no such kind.
    """
    if kind not in TEMPLATES:
        raise CaseError(Problem(f"there is no template '{kind}'", expected=listed(TEMPLATES),
                                near=nearest(kind, TEMPLATES)))
    body = (_FOLDER / f"{kind}.yaml").read_text("utf-8")
    title, rest = body.split("\n", 1)
    title = title.removeprefix("title: ").replace("{name}", name)
    return f"# yaml-language-server: $schema={SCHEMA_FILE}\nformat: 1\ntitle: {text_scalar(title)}\n{rest}"
