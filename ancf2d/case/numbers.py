"""The numbers of a case by their paths, as varied by derivatives, fits and designs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from ..errors import CaseError, Problem, all_of, raise_any
from .axes import VARY, Bounds, bounds_and_problems
from .binder import Vocabulary, listed, nearest
from .compose import compose
from .emit import number_text, walk
from .load import LoadedCase, load_case_text, with_overrides
from .nodes import LINE_BREAK, ListNode, MapNode, Node, Origin, Scalar, line_breaks, quoted, resolve
from .overrides import below, index_of
from .schema import Case

# sections that results do not depend on, or only through the discretisation
NOT_VARIED = ("format", "title", "units", "solver", "goal", "accuracy", "output", "expected")
# a fraction of the way between bounds that is unlikely to give a whole number
BETWEEN = 0.3819


def unused_parameters(case: Case) -> list[str]:
    """Return the names of the parameters that no expression of a case uses."""
    texts = [value for _, value, _ in walk(case) if isinstance(value, str)] if case.parameters else []
    words = {word for text in texts for word in re.findall(r"\w+", text)}
    return [name for name in case.parameters if name not in words]


@dataclass(frozen=True)
class CaseNumber:
    """A number of a case: its path, its value and the largest magnitude in the list that contains it.

    For a point BODY@S the number is S, ``body`` the name of the body and ``list_scale`` 1; otherwise ``body`` is empty.
    """

    path: str
    value: float
    list_scale: float = 0.0
    body: str = ""

    def override(self, value: float) -> str:
        """Return ``PATH=VALUE`` that gives the number another value."""
        text = number_text(float(value))
        return f"{self.path}={self.body}@{text}" if self.body else f"{self.path}={text}"


def number_at(loaded: LoadedCase, path: str) -> CaseNumber:
    """Return the number at a path, or its default value if the case leaves it out.

    Parts of the path are keys, or for lists the index or name of an item. Raises CaseError if the path has no number.
    """
    file, found = loaded.source.file, _found(loaded.source.root, path)
    given = found is not None
    if found is None:
        text = loaded.completed
        found = _found(compose(text, Origin("completed", line_breaks(text)), problems=[]), path)
    if found is None or not (given or isinstance(found[0], Scalar)):
        raise CaseError(_missing(loaded, path))
    variable = _number_in(path, *found)
    if variable is None:
        node, below = found[0], next((v for v in _below(found[0], path, None) if not v.body), None)
        what = f"{quoted(path)} is {node.shown()}"
        # a value that is left out has no place in the file
        problem = node.mark.problem(what) if given else Problem(f"{what} by default", file=file)
        raise CaseError(replace(problem, expected="a number, or the key of a point BODY@S" if below is None
                                else f"a number, such as {below.path}"))
    if path.startswith("goal."):
        raise CaseError(Problem(f"{quoted(path)} belongs to the goal itself and cannot vary", file=file,
                                expected="a number that results depend on"))
    return variable


def _missing(loaded: LoadedCase, path: str) -> Problem:
    """Return the problem of a path without a value; for a point, it names the keys that have this point."""
    file, root, (body, at, place) = loaded.source.file, loaded.source.root, path.partition("@")
    if at and isinstance(root, MapNode):
        keys = [v.path for name, entry in root.entries.items() for v in _below(entry.node, name, None)
                if v.body == body and v.value == resolve(place)]
        return Problem(f"{quoted(path)} is a point, not the path of a key", file=file,
                       expected=listed(keys) if keys else "the path of a key that has a point, such as loads.0.at")
    near = nearest(path, [v.path for v in numbers_of(loaded)])
    return Problem(f"the case has no {quoted(path)}", file=file, near=near,
                   expected="" if near else "the path of a number, such as bodies.beam.section.height")


def numbers_at(loaded: LoadedCase, paths: Iterable[str]) -> list[CaseNumber]:
    """Return the numbers at paths, each path once. Raises CaseError with all paths that have none."""
    return all_of(*(partial(number_at, loaded, path) for path in dict.fromkeys(paths)))


def numbers_of(loaded: LoadedCase) -> list[CaseNumber]:
    """Return the numbers of a case that its results may depend on smoothly, and the points inside of bodies, in order.

    Numbers of meshes are left out. Other whole numbers are included: only varying them shows that they are whole.
    """
    root = loaded.source.root
    found = [] if not isinstance(root, MapNode) else [
        v for name, entry in root.entries.items() if name not in NOT_VARIED for v in _below(entry.node, name, None)]
    return [v for v in found if (0.0 < v.value < 1.0 if v.body else not _of_mesh(v.path))]


def _of_mesh(path: str) -> bool:
    parts = path.split(".")
    return parts[0] == "bodies" and parts[2:3] == ["element"] and parts[3:] not in (["mass"], ["inertia"])


def _found(root: Node | None, path: str) -> tuple[Node, Node | None] | None:
    """Return the node at a dotted path and its parent, or None if there is none."""
    node, parent = root, None
    for part in path.split("."):
        node, parent = below(node, part.strip()), node
    return None if node is None else (node, parent)


def _number_in(path: str, node: Node, parent: Node | None) -> CaseNumber | None:
    """Return the number in a node, or None if it has none."""
    if not isinstance(node, Scalar):
        return None
    if node.shape == "number":
        mates = parent.items if isinstance(parent, ListNode) else []
        sizes = [abs(float(m.value)) for m in mates if isinstance(m, Scalar) and m.shape == "number"]
        return CaseNumber(path, float(node.value), max(sizes, default=0.0))
    return CaseNumber(path, node.point[1], 1.0, node.point[0]) if node.point else None


def _below(node: Node, path: str, parent: Node | None) -> Iterator[CaseNumber]:
    """Yield the numbers at and below a node."""
    if isinstance(node, MapNode):
        for name, entry in node.entries.items():
            yield from _below(entry.node, f"{path}.{name}", node)
    elif isinstance(node, ListNode):
        for k, item in enumerate(node.items):
            called = item.entries.get("name") if isinstance(item, MapNode) else None
            label = called.node.text if called is not None and isinstance(called.node, Scalar) else ""
            # a name is used in the path only if no earlier item has it and a path can contain it
            plain = bool(label) and "." not in label and "=" not in label and index_of(node, label) == k
            yield from _below(item, f"{path}.{label if plain else k}", node)
    else:
        found = _number_in(path, node, parent)
        if found is not None:
            yield found


def numbers_between(loaded: LoadedCase, options: Sequence[str], vocabulary: Vocabulary
                    ) -> tuple[list[Bounds], list[CaseNumber]]:
    """Return the bounds of ``PATH=low:high`` options, and the numbers at their paths.

    Raises CaseError with all wrong options, all paths that have no number, and all numbers that the case does not allow
    at a bound or between.
    """
    found, (bounds, problems) = list[CaseNumber](), bounds_and_problems(options)
    for one in bounds:
        try:
            variable = number_at(loaded, one.path)
            # the value between is not whole, and fails for keys that need whole numbers
            for value in (one.low, one.high, one.low + BETWEEN * (one.high - one.low)):
                with_overrides(loaded, [variable.override(value)], vocabulary)
            found.append(variable)
        except CaseError as error:
            problems += [Problem(p.message, file=f"{VARY}{one.text}", expected=p.expected, near=p.near)
                         for p in error.problems]
    raise_any(problems)
    return bounds, found


def moved_starts(variables: Sequence[CaseNumber], bounds: Sequence[Bounds], starts: Sequence[float]) -> list[str]:
    """Return warnings about numbers that are not between their bounds, so that the search starts elsewhere."""
    return [f"{v.path} is {v.value:g} in the case, {'at' if v.value in (b.low, b.high) else 'beyond'} the bound "
            f"{b.low if v.value <= b.low else b.high:g}: the search starts at {start:g}"
            for v, b, start in zip(variables, bounds, starts, strict=True)
            if start != v.value and not b.low < v.value < b.high]


def text_with(loaded: LoadedCase, values: Mapping[str, float], vocabulary: Vocabulary) -> tuple[str, bool]:
    """Return a case's text with other numbers at some paths, and whether it is otherwise the text of the file.

    Comments and layout are kept. If the file lacks one of the numbers, or the case has overrides, the whole case is
    written with its defaults instead. Raises CaseError if the result is not a valid case.
    """
    directory = os.path.dirname(loaded.source.file)
    sets = [v.override(value) for v, value in zip(numbers_at(loaded, values), values.values(), strict=True)]
    whole = with_overrides(loaded, sets, vocabulary).completed
    changed = None if loaded.overrides else _replaced(loaded.text, values)
    if changed is not None:
        try:
            if load_case_text(changed, loaded.source.file, (), vocabulary, directory).completed == whole:
                return changed, True
        except CaseError:
            pass
    return whole, False


def _replaced(text: str, values: Mapping[str, float]) -> str | None:
    """Return a text with other numbers at their places, or None if one of them has no place in it."""
    text = text.removeprefix("\ufeff")
    origin = Origin("text", line_breaks(text))
    root, starts, places = compose(text, origin, problems=[]), [0], list[tuple[int, int, str]]()
    starts += [found.end() for found in LINE_BREAK.finditer(text)]
    for path, value in values.items():
        found = _found(root, path)
        variable = None if found is None else _number_in(path, *found)
        if found is None or variable is None or not isinstance(found[0], Scalar):
            return None
        node = found[0]
        at, old = starts[node.mark.line - 1] + node.mark.column - 1, node.text if node.plain else f'"{node.text}"'
        if not text.startswith(old, at):
            return None
        new = variable.override(value).partition("=")[2]
        places.append((at, at + len(old), new if node.plain else f'"{new}"'))
    for begin, end, new in sorted(places, reverse=True):
        text = text[:begin] + new + text[end:]
    return text
