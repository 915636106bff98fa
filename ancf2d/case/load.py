"""Loads case files and returns validated cases."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from ..errors import CaseError, Problem, raise_any
from .binder import Binder, KnownRecords, Vocabulary, dotted
from .checks import check_case
from .compose import compose, read_text
from .definition import ElementDefinition, load_definition
from .emit import written, yaml_text
from .nodes import MapNode, Node, Origin, Scalar, Source, line_breaks
from .overrides import apply_overrides, place_of
from .records import bind_record
from .schema import Case


@dataclass(frozen=True)
class LoadedCase:
    """A checked case and its source: the file, its text and the overrides.

    ``origin`` loads the same text with other overrides.
    """

    case: Case
    source: Source
    text: str
    overrides: tuple[str, ...] = ()
    definitions: dict[str, ElementDefinition] = field(default_factory=dict)
    origin: CaseText | None = field(default=None, repr=False, compare=False)

    @property
    def _known(self) -> KnownRecords | None:
        return None if self.origin is None else self.origin.known

    @cached_property
    def data(self) -> dict[str, Any]:
        """The case as plain data, with defaults filled in and overrides applied."""
        found: dict[str, Any] = written(self.case, self._known)
        return found

    @cached_property
    def completed(self) -> str:
        """The case as YAML with defaults filled in and overrides applied; loads back the same."""
        return yaml_text(self.data, self._known)


class CaseText:
    """A text from which cases with different overrides are read.

    The parts that overrides do not change are parsed and read once; the cases share their nodes and records, which must
    not be modified. ``directory`` is what file names in the text are relative to.
    """

    def __init__(self, text: str, name: str = "<string>", directory: str = "") -> None:
        self.text, self.name, self.directory = text.removeprefix("\ufeff"), name, directory
        self._context: object = None
        self.known: KnownRecords | None = None

    @cached_property
    def _root(self) -> tuple[Node | None, tuple[Problem, ...]]:
        problems: list[Problem] = []
        return compose(self.text, Origin(self.name, line_breaks(self.text)), problems=problems), tuple(problems)

    def place(self, path: str) -> tuple[str, ...]:
        """Return the parts of a dotted path, with indices for the names of items of lists that the case has."""
        root = self._root[0]
        return tuple(path.split(".")) if root is None else place_of(root, path)

    def load(self, overrides: Sequence[str] = (), vocabulary: Vocabulary | None = None) -> LoadedCase:
        """Return the case with ``PATH=VALUE`` overrides applied.

        Raises CaseError with every problem found, in the order of the file.
        """
        root, found = self._root
        problems = list(found)
        if not isinstance(root, MapNode):
            raise CaseError(problems or _no_case(root, self.name))
        changed = apply_overrides(root, list(overrides), problems)
        source = Source(self.name, self.text, changed)
        binder = Binder(vocabulary, problems)
        binder.labels, binder.root = _labels(changed), Case
        _set_names(changed, binder)
        binder.known = self._records(root, binder)
        case = bind_record(Case, changed, (), binder)
        check_case(case, source, binder)
        definitions = _definitions(case, self.directory, binder, source)
        if binder.unreported:
            problems.append(Problem(f"{binder.unreported} more problems, not shown after the first "
                                    f"{len(problems)}", file=self.name, line=len(line_breaks(self.text)), column=1))
        raise_any(problems)
        return LoadedCase(case, source, self.text, tuple(overrides), definitions, self)

    def _records(self, root: MapNode, binder: Binder) -> KnownRecords:
        """Return the records that were read from this text with the same names and units."""
        context = (binder.vocabulary, binder.labels, binder.numbers, binder.probes, binder.controllers)
        if self.known is None or context != self._context:
            self._context, self.known = context, KnownRecords(root)
        return self.known


def load_case(path: str | os.PathLike[str], overrides: Sequence[str] = (),
              vocabulary: Vocabulary | None = None) -> LoadedCase:
    """Return the case in a file, with ``PATH=VALUE`` overrides applied.

    Raises CaseError with every problem found, in the order of the file.
    """
    name = os.fspath(path)
    return load_case_text(read_text(name), name, overrides, vocabulary, os.path.dirname(name))


def load_case_text(text: str, name: str = "<string>", overrides: Sequence[str] = (),
                   vocabulary: Vocabulary | None = None, directory: str = "") -> LoadedCase:
    """Return the case in a text; file names in it are relative to ``directory``. Raises CaseError."""
    return CaseText(text, name, directory).load(overrides, vocabulary)


def with_overrides(loaded: LoadedCase, more: Sequence[str], vocabulary: Vocabulary) -> LoadedCase:
    """Return a case with additional ``PATH=VALUE`` overrides. Raises CaseError."""
    name = loaded.source.file
    origin = loaded.origin or CaseText(loaded.text, name, os.path.dirname(name))
    return origin.load((*loaded.overrides, *more), vocabulary)


def refined(loaded: LoadedCase) -> LoadedCase:
    """Return the case with twice as many elements in every body."""
    bodies = {name: body if body.element.number is None else
              replace(body, element=replace(body.element, refine=2 * (body.element.refine or 1)))
              for name, body in loaded.case.bodies.items()}
    return replace(loaded, case=replace(loaded.case, bodies=bodies))


def _no_case(root: object, name: str) -> Problem:
    wanted = "a mapping with at least 'bodies' and 'solver'"
    if root is None or (isinstance(root, Scalar) and root.value is None):
        return Problem("the file is empty", file=name, expected=wanted)
    got = root.shown() if hasattr(root, "shown") else "something else"
    return Problem(f"the file holds {got}, not a case", file=name, expected=wanted)


def _labels(root: MapNode) -> tuple[str, str, str]:
    """Return the unit labels for messages, before the case is read; those of SI if they are unusable."""
    found = _entries(root, "units")
    labels = []
    for name, default in (("length", "m"), ("force", "N"), ("time", "s")):
        node = found.get(name)
        usable = isinstance(node, Scalar) and node.shape == "text" and len(node.text) <= 12
        labels.append(node.text if usable and isinstance(node, Scalar) else default)
    return labels[0], labels[1], labels[2]


def _set_names(root: MapNode, binder: Binder) -> None:
    """Give a binder the parameters, probes and controllers of a case, before the case is read."""
    parameters = _entries(root, "parameters")
    binder.numbers = {name: _number(node) for name, node in parameters.items()}
    output = root.entries.get("output")
    binder.probes = tuple(_entries(output.node, "probes") if output is not None else ())
    binder.controllers = tuple(_entries(root, "controllers"))


def _number(node: Node) -> float:
    """Return the value of a parameter; 1 if it is no number, which is not a problem of each expression that uses it."""
    if isinstance(node, Scalar) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value) if math.isfinite(node.value) else 1.0
    return 1.0


def _entries(node: Node, name: str) -> dict[str, Node]:
    """Return the nodes of the mapping below a key, by name; empty if there is no mapping."""
    entry = node.entries.get(name) if isinstance(node, MapNode) else None
    found = {} if entry is None or not isinstance(entry.node, MapNode) else entry.node.entries
    return {key: item.node for key, item in found.items()}


def _definitions(case: Case, directory: str, binder: Binder,
                 source: Source) -> dict[str, ElementDefinition]:
    """Return the element definitions that bodies refer to, by body; report their problems."""
    found: dict[str, ElementDefinition] = {}
    bodies = case.bodies if isinstance(case.bodies, dict) else {}
    read: dict[str, ElementDefinition | None] = {}
    for name, body in bodies.items():
        file = body.element.definition if body and body.element else None
        if not isinstance(file, str) or body.element.type != "user":
            continue
        path = os.path.join(directory, file)
        if path not in read:
            place = ("bodies", name, "element", "definition")
            try:
                read[path] = load_definition(path, binder.vocabulary)
            except CaseError as error:
                read[path] = None
                # a file that cannot be read at all is best reported at the key that names it
                binder.problems.extend(
                    p if p.line else source.problem(place, f"{dotted(place)}: {path}: {p.message}")
                    for p in error.problems)
        definition = read[path]
        if definition is not None:
            found[name] = definition
    return found
