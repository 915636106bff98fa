"""Where the values of a case stand in its text."""

from __future__ import annotations

import re
from typing import Any

from ..errors import Problem
from .nodes import ListNode, MapNode, Mark, Node

_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


class Source:
    """The text of a case with the place of every value; makes problems for later checks."""

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
        """Return the place of a value, or of the nearest thing above it that is in the text."""
        return self.node(path)[0].mark

    def key_mark(self, path: tuple[Any, ...]) -> Mark:
        """Return the place of a key; of its value where it has none (items of lists)."""
        parent, found = self.node(path[:-1])
        if found and isinstance(parent, MapNode) and str(path[-1]) in parent.entries:
            return parent.entries[str(path[-1])].mark
        return self.mark(path)

    def problem(self, path: tuple[Any, ...], message: str, expected: str | None = None,
                near: str | None = None) -> Problem:
        """Return a Problem that stands at a path, e.g. ``("joints", 0, "between", 1)``."""
        return self.mark(tuple(path)).problem(message, tuple(path), expected or "", near or "")


def line_breaks(text: str) -> list[str]:
    """Return the lines of a text, broken where YAML breaks them."""
    return _BREAK.split(text)
