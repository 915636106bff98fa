"""Nodes of a YAML text with their places: YAML 1.2 scalars, no anchors, no tags."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

from ..errors import Problem

_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_CONSTANTS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_SHOWN = 60


@dataclass(frozen=True, eq=False)
class Origin:
    """The text that nodes come from: a file, or one ``--set`` override."""

    file: str
    lines: list[str]
    numbered: bool = True


class Mark(NamedTuple):
    """A place in a text; line and column count from 1."""

    origin: Origin
    line: int
    column: int

    def problem(self, message: str, path: tuple[Any, ...] = (), expected: str = "",
                near: str = "") -> Problem:
        """Return a Problem located here."""
        lines = self.origin.lines
        source = lines[self.line - 1] if 0 < self.line <= len(lines) else ""
        return Problem(message, file=self.origin.file,
                       line=self.line if self.origin.numbered else 0, column=self.column,
                       path=path, expected=expected, near=near, source_line=source)


class Node:
    """A value of a YAML text with its place."""

    __slots__ = ("mark",)
    shape = "broken"

    def __init__(self, mark: Mark) -> None:
        self.mark = mark

    def shown(self) -> str:
        """Return the value in the words of a message."""
        return "something unreadable"

    def copy(self) -> Node:
        """Return a copy that can be changed in place of this node; the nodes below are shared."""
        return self


class Broken(Node):
    """Placeholder for a value that was already refused; it binds to nothing and is not reported again."""

    __slots__ = ()


class Scalar(Node):
    """A scalar; ``plain`` if it was written without quotes."""

    __slots__ = ("plain", "text", "value")

    def __init__(self, mark: Mark, text: str, plain: bool) -> None:
        super().__init__(mark)
        self.text = text
        self.plain = plain
        self.value = resolve(text) if plain else text

    @property
    def shape(self) -> str:  # type: ignore[override]
        """The kind of value: ``number``, ``text``, ``flag`` or ``null``."""
        value = self.value
        if isinstance(value, str):
            return "text"
        if isinstance(value, bool):
            return "flag"
        return "null" if value is None else "number"

    @property
    def point(self) -> tuple[str, float] | None:
        """The body and s [-] of a point BODY@S; None of other values."""
        if self.shape != "text":
            return None
        body, _, place = self.text.partition("@")
        s = resolve(place)
        return (body, float(s)) if isinstance(s, int | float) and not isinstance(s, bool) else None

    def shown(self) -> str:
        """Return the value as in the file, a text with the words 'the text'."""
        if self.value is None:
            return "nothing"
        if not isinstance(self.value, str):
            return shorten(self.text)
        note = ""
        if not self.plain and isinstance(resolve(self.text), int | float):
            note = " in quotes"
        return f"the text {quoted(self.text)}{note}"


class ListNode(Node):
    """A sequence of nodes."""

    __slots__ = ("items",)
    shape = "list"

    def __init__(self, mark: Mark) -> None:
        super().__init__(mark)
        self.items: list[Node] = []

    def copy(self) -> ListNode:
        """Return a list of the same nodes."""
        out = ListNode(self.mark)
        out.items = list(self.items)
        return out

    def shown(self) -> str:
        """Return the length of the list in words."""
        n = len(self.items)
        return "an empty list" if n == 0 else f"a list of {n}"


class Entry(NamedTuple):
    """A key of a mapping: its place and its value."""

    mark: Mark
    node: Node


class MapNode(Node):
    """A mapping of text keys to nodes, in the order of the file.

    ``partial`` if some of its keys were refused, so that missing keys cannot be recognised. ``removed`` are the places
    of overrides that remove keys it does not have.
    """

    __slots__ = ("entries", "partial", "removed")
    shape = "map"

    def __init__(self, mark: Mark) -> None:
        super().__init__(mark)
        self.partial = False
        self.entries: dict[str, Entry] = {}
        self.removed: dict[str, Mark] = {}

    def copy(self) -> MapNode:
        """Return a mapping of the same nodes."""
        out = MapNode(self.mark)
        out.partial, out.entries, out.removed = self.partial, dict(self.entries), dict(self.removed)
        return out

    def shown(self) -> str:
        """Return the mapping's first keys in words."""
        if not self.entries:
            return "an empty mapping"
        keys = list(self.entries)
        return "a mapping with " + ", ".join(shorten(k) for k in keys[:3]) + (
            ", ..." if len(keys) > 3 else "")


def resolve(text: str) -> Any:
    """Return the value of a plain scalar by YAML 1.2: None, bool, int, float, or the text itself.

    ``0123`` is decimal 123; ``on``, ``yes``, dates and ``1:30`` are text. Numbers beyond the range of a double become
    infinity, which no kind of value accepts.
    """
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INT.fullmatch(text):
        return int(text) if len(text) < 300 else float(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", "", 1))
    return text


def plain_data(node: Node) -> Any:
    """Return a node as plain Python data: dict, list, str, float, int, bool, None."""
    if isinstance(node, MapNode):
        return {key: plain_data(entry.node) for key, entry in node.entries.items()}
    if isinstance(node, ListNode):
        return [plain_data(item) for item in node.items]
    return node.value if isinstance(node, Scalar) else None


def shorten(text: str) -> str:
    """Return ``text`` cut to a length suitable for messages, with control characters replaced."""
    text = "".join(c if c.isprintable() else "?" for c in text[: _SHOWN + 1])
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."


def quoted(text: str) -> str:
    """Return ``text`` shortened and in quotes."""
    return f"'{shorten(text)}'"


LINE_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


class Source:
    """The text of a case with the place of every value; locates the problems that later checks find."""

    def __init__(self, file: str, text: str, root: Node) -> None:
        self.file, self.text, self.root = file, text, root

    def node(self, path: tuple[Any, ...]) -> tuple[Node, bool]:
        """Return the node at a path, or its nearest ancestor and False."""
        node = self.root
        for part in path:
            if isinstance(node, MapNode) and str(part) in node.entries:
                node = node.entries[str(part)].node
            elif isinstance(node, ListNode) and isinstance(part, int) and part < len(node.items):
                node = node.items[part]
            else:
                return node, False
        return node, True

    def mark(self, path: tuple[Any, ...]) -> Mark:
        """Return the place of a value, or of its nearest ancestor in the text."""
        return self.node(path)[0].mark

    def key_mark(self, path: tuple[Any, ...]) -> Mark:
        """Return the place of a key, or of the value if it has no key (items of lists)."""
        parent, found = self.node(path[:-1])
        if found and isinstance(parent, MapNode) and str(path[-1]) in parent.entries:
            return parent.entries[str(path[-1])].mark
        return self.mark(path)

    def problem(self, path: tuple[Any, ...], message: str, expected: str | None = None,
                near: str | None = None) -> Problem:
        """Return a Problem located at a path, e.g. ``("joints", 0, "between", 1)``."""
        return self.mark(tuple(path)).problem(message, tuple(path), expected or "", near or "")


def line_breaks(text: str) -> list[str]:
    """Return the lines of a text, split at the line breaks of YAML."""
    return LINE_BREAK.split(text)
