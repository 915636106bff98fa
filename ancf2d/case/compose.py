"""Reads YAML events into nodes, and refuses YAML features that no case needs."""

from __future__ import annotations

import os
import sys
from typing import Any

import yaml

from ..errors import CaseError, Problem
from .binder import MAX_PROBLEMS
from .nodes import Broken, Entry, ListNode, MapNode, Mark, Node, Origin, Scalar, quoted

STDIN = "<stdin>"  # name of the standard input, where a file name is expected
_HDF5 = b"\x89HDF\r\n\x1a\n"
MAX_BYTES = 16 * 2**20
MAX_DEPTH = 40
MAX_VALUES = 500_000  # keys and values; this number takes ten seconds and 300 MB
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

# words in messages of libyaml -> ours; the first match is used
_HINTS = (
    ("found character '\\t'", "a tab is used where YAML allows only spaces"),
    ("found a tab character", "a tab is used where YAML allows only spaces"),
    ("mapping values are not allowed",
     "unexpected ':' here; check the indentation, and that the value before it has ended"),
    ("could not find expected ':'", "a key without ':' after it"),
    ("did not find expected ',' or ']'", "a '[' is not closed, or a ',' is missing in it"),
    ("did not find expected ',' or '}'", "a '{' is not closed, or a ',' is missing in it"),
    ("did not find expected key", "this does not continue the value above; check the indentation, and the quotes and "
     "brackets before it"),
    ("did not find expected '-' indicator", "this does not continue the list above; "
     "check the indentation"),
    ("found unexpected ':'", "a ':' must be followed by a space and a value"),
    ("block sequence entries are not allowed", "a list item '-' is not allowed here"),
    ("found unexpected end of stream", "a quote is not closed"),
    ("did not find expected <document start>", "text after the end of the case"),
    ("unknown escape character", "unknown escape in double quotes; use single quotes"),
    ("did not find expected node content", "a value is missing before this"),
)


def read_text(path: str | os.PathLike[str],
              expected: str = "a case; 'ancf2d info' shows what a result file contains") -> str:
    """Return the text of a file, or of stdin: UTF-8, at most 16 MB. Raises CaseError.

    ``expected``: what is expected in place of a result file.
    """
    name = os.fspath(path)
    try:
        if name == STDIN:
            data = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with open(name, "rb") as stream:
                data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CaseError(Problem(f"cannot read the file: {reason}", file=name)) from None
    if len(data) > MAX_BYTES:
        raise CaseError(Problem(f"the file is larger than {MAX_BYTES // 2**20} MB", file=name))
    if data.startswith(_HDF5):
        raise CaseError(Problem("this is an HDF5 file, such as a result file, not text", file=name,
                                expected=expected))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        kind = "UTF-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "something else"
        message = (f"the file is not UTF-8 text but {kind}: "
                   f"byte 0x{data[error.start]:02x} cannot be read")
        raise CaseError(Problem(message, file=name, line=line, column=column)) from None


def compose(text: str, origin: Origin, column: int = 1, problems: list[Problem] | None = None) -> Node | None:
    """Return the root node of a YAML text, or None if it is empty.

    The text begins at ``column`` of the first line of its origin. Refused constructs are appended to ``problems``;
    invalid syntax raises CaseError.
    """
    composer = _Composer(origin, column, problems if problems is not None else [])
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            composer.take(event)
    except yaml.MarkedYAMLError as error:
        raise CaseError([*composer.problems, composer.syntax(error)]) from None
    except yaml.reader.ReaderError as error:
        raise CaseError([*composer.problems, composer.unreadable(error, text)]) from None
    except UnicodeEncodeError as error:
        raise CaseError([*composer.problems, composer.unreadable(error, text)]) from None
    return composer.root


class _Composer:
    """Builds nodes from events, without recursion so that the depth is limited by MAX_DEPTH and not by Python."""

    def __init__(self, origin: Origin, column: int, problems: list[Problem]) -> None:
        self.origin, self.column = origin, column
        self.problems = problems
        self.root: Node | None = None
        self.documents = self.values = 0
        # open collections, each with the key that waits for its value, and whether it can be read
        self.stack: list[tuple[Node, list[Entry | str | None], bool]] = []

    def mark(self, place: Any) -> Mark:
        shift = self.column - 1 if place.line == 0 else 0
        return Mark(self.origin, place.line + 1, place.column + 1 + shift)

    def refuse(self, mark: Mark, message: str) -> None:
        """Report a construct; raise CaseError after too many problems, so that the rest of the file is not read."""
        self.problems.append(mark.problem(message))
        if len(self.problems) >= MAX_PROBLEMS:
            raise CaseError([*self.problems, mark.problem("too many problems; the rest of the file was not read")])

    def take(self, event: Any) -> None:
        if isinstance(event, yaml.ScalarEvent):
            self.count(event)
            self.scalar(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            self.count(event)
            self.open(event)
        elif isinstance(event, yaml.CollectionEndEvent):
            self.close()
        elif isinstance(event, yaml.AliasEvent):
            self.refuse(self.mark(event.start_mark), f"the alias *{event.anchor} is not supported; "
                        "write the value out")
            self.add(Broken(self.mark(event.start_mark)))
        elif isinstance(event, yaml.DocumentStartEvent):
            self.documents += 1
            if self.documents == 2:
                raise CaseError([*self.problems, self.mark(event.start_mark).problem(
                    "a second document begins here; a file holds one")])

    def count(self, event: Any) -> None:
        self.values += 1
        if self.values > MAX_VALUES:
            raise CaseError([*self.problems, self.mark(event.start_mark).problem(
                f"the file holds more than {MAX_VALUES} keys and values")])

    def plain(self, event: Any) -> bool:
        """Refuse anchors and tags; return whether the value can be read without its tag."""
        if event.anchor:
            self.refuse(self.mark(event.start_mark), f"the anchor &{event.anchor} is not supported; "
                        "write the value out where it is needed")
        if event.tag is not None:
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            self.refuse(self.mark(event.start_mark), f"the tag {quoted(tag)} is not supported; leave it out")
        return event.tag is None

    def scalar(self, event: Any) -> None:
        readable = self.plain(event)
        mark = self.mark(event.start_mark)
        if self.stack and isinstance(self.stack[-1][0], MapNode) and self.stack[-1][1][0] is None:
            self.key(mark, event.value)
        else:
            self.add(Scalar(mark, event.value, not event.style) if readable else Broken(mark))

    def key(self, mark: Mark, text: str) -> None:
        node, waiting, _ = self.stack[-1]
        assert isinstance(node, MapNode)
        first = node.entries.get(text)
        if text == "<<":
            waiting[0] = ""
            node.partial = True
            self.refuse(mark, "the merge key << is not supported; write the keys out")
        elif first is not None:
            where = f"line {first.mark.line}" if first.mark.line != mark.line else "this line"
            waiting[0] = ""
            self.refuse(mark, f"duplicate key {quoted(text)}, first given in {where} (column {first.mark.column})")
        else:
            waiting[0] = Entry(mark, Broken(mark))
            waiting[1] = text

    def open(self, event: Any) -> None:
        readable = self.plain(event)
        if len(self.stack) >= MAX_DEPTH:
            raise CaseError([*self.problems, self.mark(event.start_mark).problem(
                f"values are nested more than {MAX_DEPTH} deep")])
        mark = self.mark(event.start_mark)
        mapping = isinstance(event, yaml.MappingStartEvent)
        self.stack.append((MapNode(mark) if mapping else ListNode(mark), [None, None], readable))

    def close(self) -> None:
        node, _, readable = self.stack.pop()
        self.add(node if readable else Broken(node.mark))

    def add(self, node: Node) -> None:
        if not self.stack:
            self.root = node
            return
        parent, waiting, _ = self.stack[-1]
        if isinstance(parent, ListNode):
            parent.items.append(node)
        elif isinstance(parent, MapNode):
            if waiting[0] is None:
                # a list or a mapping where a key is expected
                waiting[0] = ""
                parent.partial = True
                self.refuse(node.mark, "a key must be plain text")
                return
            if isinstance(waiting[0], Entry):
                if isinstance(node, MapNode):
                    # a problem of a mapping as a whole is best reported at its name
                    node.mark = waiting[0].mark
                parent.entries[str(waiting[1])] = Entry(waiting[0].mark, node)
            waiting[0] = None

    def syntax(self, error: yaml.MarkedYAMLError) -> Problem:
        """Return a syntax error of the YAML library in plain words."""
        words = f"{error.context or ''} {error.problem or ''}"
        place = error.problem_mark or error.context_mark
        mark = self.mark(place) if place is not None else Mark(self.origin, 1, 1)
        lines = self.origin.lines
        source = lines[mark.line - 1] if 0 < mark.line <= len(lines) else ""
        text = next((ours for theirs, ours in _HINTS if theirs in words), "")
        if "cannot start any token" in words:
            char = source[mark.column - 1: mark.column]
            text = ("a tab is used where YAML allows only spaces" if char == "\t" else
                    f"{quoted(char)} cannot begin a value; put the value in quotes")
        text = text or words.strip()
        opened = error.context_mark
        if opened is not None and place is not None and opened.line != place.line:
            if "is not closed" in text:
                mark = self.mark(opened)
            else:
                text += f" (in the value that begins in line {opened.line + 1})"
        return mark.problem(f"not valid YAML: {text}")

    def unreadable(self, error: Any, text: str) -> Problem:
        """Return the problem of a character that YAML does not allow."""
        bad = next((i for i, c in enumerate(text) if not _allowed(c)), None)
        if bad is None:
            return Mark(self.origin, 1, 1).problem(f"not valid YAML: {error}")
        before = text[:bad].split("\n")
        column = len(before[-1]) + (self.column if len(before) == 1 else 1)
        mark = Mark(self.origin, len(before), column)
        return mark.problem(f"not valid YAML: the control character U+{ord(text[bad]):04X} "
                            "is not allowed")


def _allowed(c: str) -> bool:
    """Return whether YAML allows a character."""
    n = ord(c)
    return (n in (0x9, 0xA, 0xD, 0x85) or 0x20 <= n <= 0x7E or 0xA0 <= n <= 0xD7FF
            or (0xE000 <= n <= 0xFFFD and n != 0xFEFF) or n >= 0x10000)
