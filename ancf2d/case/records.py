"""Records: a frozen dataclass for each mapping of the format, and the choices between them.

Each field has its kind and its meaning (see declare.py); reading, the JSON Schema, the reference and the completed text
are all derived from these.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

from .binder import Binder, Path, dotted, listed
from .kinds import Book, Choice, JsonSchema, Kind, ListOf, MapOf
from .nodes import Broken, Entry, MapNode, Mark, Node, Scalar, quoted

_REQUIRED: Any = dataclasses.MISSING
# minimum similarity of a misspelt key; maximum number of places suggested for a word
TYPO, FEW = 0.8, 3


class Key(NamedTuple):
    """A key of a record as in the file."""

    name: str
    field: str
    kind: Kind
    doc: str
    default: Any
    refers: str
    example: Any

    @property
    def required(self) -> bool:
        """Whether the key must be given."""
        return self.default is _REQUIRED


@cache
def keys_of(cls: Any) -> dict[str, Key]:
    """Return the keys of a record by their names in a file (``from`` for ``from_``)."""
    result = {}
    for f in dataclasses.fields(cls):
        m = f.metadata
        if not m:
            continue
        name = m["name"] or f.name.rstrip("_")
        made: Any = f.default_factory
        default = f.default if made is _REQUIRED else made()
        result[name] = Key(name, f.name, m["kind"], m["doc"], default, m["refers"], m["example"])
    return result


def tag_of(cls: type) -> str:
    """Return the ``type`` of a record, or an empty text if it has none."""
    return cls.__dict__.get("tag", "")


def title_of(cls: type) -> str:
    """Return the first line of a record's docstring."""
    return (cls.__doc__ or "").strip().split("\n")[0]


def form(cls: type) -> str:
    """Return the keys of a record in braces; long lists are cut."""
    names = list(keys_of(cls))
    return "{" + ", ".join(names if len(names) <= 6 else [*names[:4], "..."]) + "}"


class Record(Kind):
    """A mapping with fixed keys; with ``short``, a text is accepted as the value of that key alone.

    ``what`` describes that text where the words of the key's kind are too long.
    """

    def __init__(self, cls: type, short: str = "", what: str = "") -> None:
        self.cls, self.short, self.what = cls, short, what

    def words(self, binder: Binder) -> str:
        first = self.what or (keys_of(self.cls)[self.short].kind.words(binder) if self.short
                              else "")
        return f"{first}{', or ' if first else ''}a mapping {form(self.cls)}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if self.short and isinstance(node, Scalar) and node.shape == "text":
            short = node
            node = MapNode(short.mark)
            node.entries[self.short] = Entry(short.mark, short)
        if not isinstance(node, MapNode):
            return binder.wrong(node, path, self.words(binder))
        return bind_record(self.cls, node, path, binder)

    def schema(self, book: Book) -> JsonSchema:
        reference = define(self.cls, book)
        if not self.short:
            return reference
        return {"anyOf": [keys_of(self.cls)[self.short].kind.schema(book), reference]}


class OneOf(Kind):
    """A mapping whose ``type`` selects the record."""

    def __init__(self, union: Any) -> None:
        self.known: dict[str, type] = {tag_of(cls): cls for cls in union.__args__}

    @property
    def options(self) -> dict[str, type]:
        """The records by their types."""
        return self.known

    def words(self, binder: Binder) -> str:
        return f"a mapping with type: {listed(self.options)}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, MapNode):
            return binder.wrong(node, path, self.words(binder))
        entry = node.entries.get("type")
        if entry is None:
            return self.untyped(node, path, binder)
        if isinstance(entry.node, Broken):
            return binder.skip(path)
        tag = entry.node.text if isinstance(entry.node, Scalar) else ""
        if tag not in self.options:
            near = binder.nearest(tag, self.options, TYPO)
            where = "" if near or binder.full or not binder.root else _misplaced(binder.root, tag)
            shown = (quoted(tag) if tag else entry.node.shown()) + where
            return binder.unknown(entry.node.mark, (*path, "type"), shown, self.options,
                                  near or ("" if where else binder.nearest(tag, self.options)))
        return bind_record(self.options[tag], node, path, binder,
                           {f"type {name}": cls for name, cls in self.options.items()})

    def untyped(self, node: MapNode, path: Path, binder: Binder) -> Any:
        """Report a mapping without ``type``; return INVALID."""
        near = binder.nearest("type", node.entries, cutoff=0.7)
        if near:
            return binder.fail(node.entries[near].mark, (*path, near), f"unknown key "
                               f"{quoted(near)} in {dotted(path)}", near="type")
        return binder.skip(path) if node.partial else binder.fail(
            node.mark, path, f"{dotted(path)}.type is missing", listed(self.options))

    def schema(self, book: Book) -> JsonSchema:
        return {"oneOf": [define(cls, book) for cls in self.options.values()]}


# modules that register records, like plugins do; imported when a case is read
PROVIDERS = ["ancf2d.interactions"]


class Registered(OneOf):
    """A mapping whose ``type`` selects one of the records registered from outside this folder."""

    def __init__(self) -> None:
        self.known = {}

    @property
    def options(self) -> dict[str, type]:
        for name in PROVIDERS:
            import_module(name)
        return self.known


class RegisteredRecord(Record):
    """A mapping with the keys of the only record that is registered from outside this folder."""

    def __init__(self) -> None:
        self.short = self.what = ""
        self.registered = Registered()

    @property
    def known(self) -> dict[str, type]:
        """The record by its type, which is empty."""
        return self.registered.known

    @property
    def cls(self) -> type:  # type: ignore[override]
        (found,) = self.registered.options.values()
        return found


class ByKeys(Kind):
    """A mapping whose keys select the record: the first option with one of its ``marks`` among the keys."""

    def __init__(self, *options: tuple[type, tuple[str, ...]]) -> None:
        self.options = options

    def words(self, binder: Binder) -> str:
        return f"a mapping {listed(form(cls) for cls, _ in self.options)}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, MapNode):
            return binder.wrong(node, path, self.words(binder))
        for cls, marks in self.options:
            if not marks or any(m in node.entries for m in marks):
                return bind_record(cls, node, path, binder,
                                   {form(other): other for other, _ in self.options})
        return binder.wrong(node, path, self.words(binder))

    def schema(self, book: Book) -> JsonSchema:
        return {"anyOf": [define(cls, book) for cls, _ in self.options]}


class ByShape(Kind):
    """A value whose shape (``number``, ``text``, ``list``, ``map``) selects its kind."""

    def __init__(self, **kinds: Kind) -> None:
        self.kinds = kinds

    def words(self, binder: Binder) -> str:
        return ", or ".join(kind.words(binder) for kind in self.kinds.values())

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        kind = self.kinds.get(node.shape)
        if kind is None:
            return binder.wrong(node, path, self.words(binder))
        names = kind.names(binder) if isinstance(kind, Choice) else ()
        if names and isinstance(node, Scalar) and node.text not in names:
            others = [other.words(binder) for other in self.kinds.values() if other is not kind]
            return binder.unknown(node.mark, path, quoted(node.text), [*others, *names],
                                  binder.nearest(node.text, names))
        return kind.bind(node, path, binder)

    def schema(self, book: Book) -> JsonSchema:
        return {"anyOf": [kind.schema(book) for kind in self.kinds.values()]}


def bind_record(cls: type, node: MapNode, path: Path, binder: Binder,
                others: Mapping[str, type] | None = None) -> Any:
    """Return a record whose invalid fields are INVALID; report all of its problems.

    ``others`` are the other records that the mapping could have been, by their descriptions.
    """
    known, before = binder.known.get(cls, node, path), binder.invalid
    if known is not None:
        return known
    keys = keys_of(cls)
    misspelt = unknown_keys(cls, node, path, binder, others or {})
    values = {}
    for name, k in keys.items():
        entry = node.entries.get(name)
        if entry is not None:
            values[k.field] = (binder.skip((*path, name)) if isinstance(entry.node, Broken)
                               else k.kind.bind(entry.node, (*path, name), binder))
        elif k.required:
            values[k.field] = binder.skip((*path, name))
            if name not in misspelt and not node.partial:
                binder.fail(node.mark, (*path, name),
                            f"{dotted((*path, name))} is missing: {lower_first(k.doc)}",
                            k.kind.words(binder))
    record = cls(**values)
    check = getattr(record, "check", None)
    if check is not None and before == binder.invalid:
        for issue in check():
            mark = mark_below(node, issue.key, path)
            binder.fail(mark, (*path, *issue.key), issue.message.replace("{}", dotted(path)),
                        issue.expected, issue.near)
    if before == binder.invalid:
        binder.known.add(cls, node, path, record)
    return record


def unknown_keys(cls: type, node: MapNode, path: Path, binder: Binder,
                 others: Mapping[str, type]) -> set[str]:
    """Report the unknown keys of a record; return the keys that were probably meant."""
    keys = keys_of(cls)
    tag = tag_of(cls)
    meant = set()
    given = node.removed | {name: entry.mark for name, entry in node.entries.items()}
    for name, mark in given.items():
        if name in keys or (tag and name == "type"):
            continue
        free = [k for k in keys if k not in node.entries]
        near, places = binder.nearest(name, free, TYPO), [] if binder.full else elsewhere(cls, name, path)
        known = [*keys, "type"] if tag else keys
        near = near or ("" if places else binder.nearest(name, free) or binder.nearest(name, known))
        meant.add(near)
        where = f" in {dotted(path)}" if path else ""
        of = f" of type {tag}" if tag else ""
        owners = [] if near else [t for t, other in others.items() if name in keys_of(other)]
        if owners:
            of += f"; it belongs to {listed(owners)}"
        elif name.isdigit():
            of += "; write decimals with a point, not a comma"
        wanted = "" if near or owners else listed(places or keys) if places or keys else "no key but type"
        binder.fail(mark, (*path, name), f"unknown key {quoted(name)}{where}{of}",
                    wanted, near)
    return meant


def elsewhere(cls: type, name: str, path: Path) -> list[str]:
    """Return a few places where a word belongs that is not a key of a record at a path, or none.

    ``other_names`` of the record has places by other common names of keys; else the word may be a key or a type below
    it.
    """
    known_place = cls.__dict__.get("other_names", {}).get(name)
    if known_place is not None:
        return [known_place]
    head = f"{dotted(path)}." if path else ""
    return _places(cls, name, head) or (_places(cls, name[:-1], head) if name.endswith("s") else [])


def _misplaced(root: type, tag: str) -> str:
    """Return a clause that says where a type belongs in a record of the whole file, or an empty text."""
    key = next((key for key in (tag, f"{tag}s", f"{tag}es") if key in keys_of(root)), "")
    places = [place for place in _places(root, tag, "") if f"type: {tag}," in place]
    return f", which has its own key, {key}" if key else f", which belongs to {listed(places)}" if places else ""


def _places(cls: type, word: str, head: str) -> list[str]:
    """Return the places of a key or type below a record, on the highest level that has any; none if they are many."""
    level, seen = [(head, cls)], {cls}
    while level:
        found, deeper = dict[str, None](), []
        for before, record in level:
            for k in keys_of(record).values():
                for step, below, in_list in _below(k.kind):
                    if word and tag_of(below) == word:
                        found[f"{before}{k.name}: " + ("[{}]" if in_list else "{}").format(_sketch(below))] = None
                    if word in keys_of(below):
                        found[f"{before}{k.name}{step}.{word}"] = None
                    if below not in seen:
                        seen.add(below)
                        deeper.append((f"{before}{k.name}{step}.", below))
        if found:
            return list(found) if len(found) <= FEW else []
        level = deeper
    return []


def _below(kind: Any, step: str = "", in_list: bool = False) -> Iterator[tuple[str, type, bool]]:
    """Yield (step, record, whether it is in a list) for each record that a value of this kind may be."""
    if isinstance(kind, Record | OneOf):
        for cls in kind.options.values() if isinstance(kind, OneOf) else [kind.cls]:
            yield step, cls, in_list
    elif isinstance(kind, ListOf | MapOf):
        in_list = isinstance(kind, ListOf)
        yield from _below(kind.item, f"{step}.{'0' if in_list else 'NAME'}", in_list)
    for one in kind.kinds.values() if isinstance(kind, ByShape) else ():
        yield from _below(one, step, in_list)


def _sketch(cls: type) -> str:
    """Return the mapping with the required keys of a record: ``{type: gravity, value: [0, -9.81]}``."""
    needed = [f"{k.name}: {'...' if k.example is None else k.example}" for k in keys_of(cls).values() if k.required]
    return "{" + ", ".join([f"type: {tag_of(cls)}", *needed]) + "}"


def mark_below(node: Node, below: Path, path: Path) -> Mark:
    """Return the mark of the value at a path below a node, or of its nearest ancestor."""
    mark = node.mark
    for part in below:
        if isinstance(node, MapNode) and part in node.entries:
            node = node.entries[part].node
        elif hasattr(node, "items") and isinstance(part, int) and part < len(node.items):
            node = node.items[part]
        else:
            break
        mark = node.mark
    return mark


def lower_first(text: str) -> str:
    """Return a sentence in the form for use inside another: no capital, no full stop."""
    text = text.rstrip(".")
    return text if text[1:2].isupper() or text[1:2] == "'" else text[:1].lower() + text[1:]


def define(cls: type, book: Book) -> JsonSchema:
    """Add a record's JSON Schema to the definitions; return the reference to it."""
    name = cls.__name__
    if name not in book.definitions:
        book.definitions[name] = {}
        tag = tag_of(cls)
        properties: dict[str, JsonSchema] = {}
        if tag:
            properties["type"] = {"const": tag, "description": title_of(cls)}
        for k in keys_of(cls).values():
            properties[k.name] = key_schema(k, book)
        required = [k.name for k in keys_of(cls).values() if k.required]
        book.definitions[name] = {
            "type": "object", "description": title_of(cls), "properties": properties,
            "required": (["type"] if tag else []) + required, "additionalProperties": False}
    return {"$ref": f"#/definitions/{name}"}


def key_schema(k: Key, book: Book) -> JsonSchema:
    """Return the JSON Schema of one key with its description, default and example."""
    schema = k.kind.schema(book)
    if "$ref" in schema:
        # draft-07 ignores other keys next to $ref
        schema = {"allOf": [schema]}
    unit = getattr(k.kind, "unit", "") or getattr(getattr(k.kind, "item", None), "unit", "")
    schema["description"] = f"{k.doc} [{unit}]" if unit else k.doc
    if not k.required and isinstance(k.default, str | int | float):
        schema["default"] = k.default
    if k.example is not None:
        schema["examples"] = [k.example]
    return schema
