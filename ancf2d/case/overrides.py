"""Overrides ``--set PATH=VALUE``, ``PATH+=ITEM``, ``PATH=null``: they change the nodes of a case before it is read."""

from __future__ import annotations

from typing import Any

from ..errors import CaseError, Problem, many, raise_any
from .binder import listed, nearest
from .compose import compose
from .nodes import Entry, ListNode, MapNode, Mark, Node, Origin, Scalar, quoted

OPTION = "--set "


def apply_overrides(root: MapNode, overrides: list[str], problems: list[Problem]) -> MapNode:
    """Return ``root`` with each ``PATH=VALUE`` applied in turn; unchanged nodes are shared.

    PATH is dotted; a part that selects an item of a list is its index or its ``name``. ``PATH+=ITEM`` appends to a
    list, which is created if it is missing; ``PATH=null`` removes a key, if it is there, or an item. A number in place
    of a point BODY@S moves it to this S. Problems are added to ``problems``, with a caret into the override.
    """
    for text in overrides:
        try:
            root = _apply(root, text)
        except CaseError as error:
            problems.extend(error.problems)
    return root


def _apply(root: MapNode, text: str) -> MapNode:
    shown = OPTION + text
    origin = Origin(shown, shown.split("\n"), numbered=False)
    path, equals, value = text.partition("=")
    start = Mark(origin, 1, len(OPTION) + 1)
    if not equals or not path.strip():
        raise CaseError(start.problem("not PATH=VALUE", expected="for example "
                                      "bodies.beam.element.count=32"))
    column = len(OPTION) + len(path) + 2
    appends = path.rstrip().endswith("+")
    parts = _parts(path.rstrip().removesuffix("+") if appends else path, origin)
    refused: list[Problem] = []
    node = compose(value, origin, column, refused)
    raise_any(refused)
    if node is None:
        node = Scalar(Mark(origin, 1, column), "", True)
    changed = root.copy()
    removes = not appends and isinstance(node, Scalar) and node.value is None and bool(value.strip())
    parent: Node = changed
    for i, (part, mark) in enumerate(parts):
        if removes and isinstance(parent, MapNode) and part not in parent.entries:
            # the reader of the mapping checks the key
            parent.removed[part] = mark
            return changed
        if i < len(parts) - 1:
            parent = _step(parent, part, parts[: i + 1], parts[i + 1])
    if appends:
        _append(parent, parts, node)
    elif removes:
        _remove(parent, parts)
    else:
        _put(parent, parts, _along_body(below(parent, parts[-1][0]), node))
    return changed


def _along_body(old: Node | None, new: Node) -> Node:
    """Return the point BODY@S of the old body for a number S in place of such a point, else the new node."""
    if isinstance(old, Scalar) and isinstance(new, Scalar) and old.point and new.shape == "number":
        return Scalar(new.mark, f"{old.point[0]}@{new.text}", True)
    return new


def _parts(path: str, origin: Origin) -> list[tuple[str, Mark]]:
    """Return the parts of a dotted path, each with its place."""
    column = len(OPTION) + 1
    parts = []
    for part in path.split("."):
        mark = Mark(origin, 1, column + len(part) - len(part.lstrip()))
        if not part.strip():
            raise CaseError(mark.problem(f"the path {quoted(path)} has an empty part"))
        parts.append((part.strip(), mark))
        column += len(part) + 1
    return parts


def _step(parent: Node, part: str, done: list[tuple[str, Mark]], then: tuple[str, Mark]) -> Node:
    """Return a copy of the child node ``part``, put in its place; create a missing mapping if a key may follow."""
    mark = done[-1][1]
    if isinstance(parent, ListNode):
        k = _index(parent, part, done)
        parent.items[k] = parent.items[k].copy()
        return parent.items[k]
    if not isinstance(parent, MapNode):
        raise CaseError(mark.problem(f"{quoted(_joined(done[:-1]))} is {parent.shown()}; nothing "
                                     "can be set below it"))
    entry = parent.entries.get(part)
    if entry is None:
        near = nearest(part, parent.entries, cutoff=0.75)
        if near or then[0].isdigit():
            raise CaseError(mark.problem(f"the case has no {quoted(_joined(done))}", near=near))
        entry = Entry(mark, MapNode(mark))
    parent.entries[part] = entry = Entry(entry.mark, entry.node.copy())
    return entry.node


def _put(parent: Node, parts: list[tuple[str, Mark]], node: Node) -> None:
    part, mark = parts[-1]
    if isinstance(parent, ListNode):
        parent.items[_index(parent, part, parts)] = node
    elif isinstance(parent, MapNode):
        parent.entries[part] = Entry(mark, node)
        if isinstance(node, MapNode):
            node.mark = mark
    else:
        raise CaseError(mark.problem(f"{quoted(_joined(parts[:-1]))} is {parent.shown()}; nothing "
                                     "can be set below it"))


def _append(parent: Node, parts: list[tuple[str, Mark]], item: Node) -> None:
    """Append an item to the list at a path."""
    part, mark = parts[-1]
    if isinstance(parent, MapNode) and part not in parent.entries:
        near = nearest(part, parent.entries, cutoff=0.75)
        if near:
            raise CaseError(mark.problem(f"the case has no {quoted(_joined(parts))}", near=near))
        parent.entries[part] = Entry(mark, ListNode(mark))
    found = _step(parent, part, parts, parts[-1]) if isinstance(parent, MapNode | ListNode) else parent
    if not isinstance(found, ListNode):
        raise CaseError(mark.problem(f"{quoted(_joined(parts))} is {found.shown()}; += appends to lists"))
    found.items.append(item)


def _remove(parent: Node, parts: list[tuple[str, Mark]]) -> None:
    """Remove the key or item at a path."""
    part, mark = parts[-1]
    if isinstance(parent, ListNode):
        del parent.items[_index(parent, part, parts)]
    elif isinstance(parent, MapNode):
        del parent.entries[part]
    else:
        raise CaseError(mark.problem(f"the case has no {quoted(_joined(parts))} that could be removed"))


def _index(parent: ListNode, part: str, done: list[tuple[str, Mark]]) -> int:
    """Return the index of the item of a list that a part of a path selects by index or ``name``. Raises CaseError."""
    found, n = index_of(parent, part), len(parent.items)
    if found is not None:
        return found
    mark, where = done[-1][1], quoted(_joined(done[:-1]))
    if part.isascii() and part.isdigit():
        raise CaseError(mark.problem(f"{where} has {many(n, 'item')}; there is no item {part}",
                                     expected=listed(map(str, range(n))) if n < 3 else
                                     f"0 to {n - 1}"))
    near = nearest(part, _names(parent))
    raise CaseError(mark.problem(f"{where} has no item named {quoted(part)}", (),
                                 "" if near else "an index from 0 or a name", near))


def index_of(parent: ListNode, part: str) -> int | None:
    """Return the index of the item of a list that a part of a path selects by index or ``name``, or None."""
    if part.isascii() and part.isdigit():
        return int(part) if len(part) < 10 and int(part) < len(parent.items) else None
    return _names(parent).get(part)


def place_of(root: Node, path: str) -> tuple[str, ...]:
    """Return the parts of a dotted path, with indices for the names of items of lists that the case has."""
    node: Node | None = root
    out: list[str] = []
    for part in map(str.strip, path.split(".")):
        k = index_of(node, part) if isinstance(node, ListNode) else None
        out.append(part if k is None else str(k))
        node = below(node, part)
    return tuple(out)


def below(node: Node | None, part: str) -> Node | None:
    """Return the value or item that a part of a path selects in a node, or None."""
    if isinstance(node, ListNode):
        k = index_of(node, part)
        return None if k is None else node.items[k]
    entry = node.entries.get(part) if isinstance(node, MapNode) else None
    return None if entry is None else entry.node


def _names(parent: ListNode) -> dict[str, int]:
    """Return the index of the first item with each name."""
    names: dict[str, int] = {}
    for i, item in enumerate(parent.items):
        name: Any = item.entries.get("name") if isinstance(item, MapNode) else None
        if name is not None and isinstance(name.node, Scalar):
            names.setdefault(name.node.text, i)
    return names


def _joined(parts: list[tuple[str, Mark]]) -> str:
    return ".".join(part for part, _ in parts)
