"""Case files in, validated cases out."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from ..errors import CaseError, Problem
from .binder import MAX_PROBLEMS, Binder, Vocabulary, dotted
from .checks import check_case
from .compose import compose, read_text
from .definition import ElementDefinition, load_definition
from .emit import written, yaml_text
from .nodes import MapNode, Node, Origin, Scalar, Source, line_breaks
from .overrides import apply_overrides
from .records import bind_record
from .schema import Case


@dataclass(frozen=True)
class LoadedCase:
    """A checked case and its source: the file, its text and the overrides."""

    case: Case
    source: Source
    text: str
    overrides: tuple[str, ...] = ()
    definitions: dict[str, ElementDefinition] = field(default_factory=dict)

    @cached_property
    def completed(self) -> str:
        """The case as YAML with defaults filled in and overrides applied; loads back the same."""
        return yaml_text(written(self.case))


def load_case(path: str | os.PathLike[str], overrides: Sequence[str] = (),
              vocabulary: Vocabulary | None = None) -> LoadedCase:
    """Return the case in a file, with ``PATH=VALUE`` overrides applied.

    Raises CaseError with every problem found, in the order of the file.
    """
    name = os.fspath(path)
    return _load(read_text(name), name, overrides, vocabulary, os.path.dirname(name))


def load_case_text(text: str, name: str = "<string>", overrides: Sequence[str] = (),
                   vocabulary: Vocabulary | None = None, directory: str = "") -> LoadedCase:
    """Return the case in a text; ``directory`` is what file names in it are relative to."""
    return _load(text, name, overrides, vocabulary, directory)


def with_overrides(loaded: LoadedCase, more: Sequence[str], vocabulary: Vocabulary) -> LoadedCase:
    """Return a case with more ``PATH=VALUE`` overrides. Raises CaseError."""
    name = loaded.source.file
    return _load(loaded.text, name, (*loaded.overrides, *more), vocabulary, os.path.dirname(name))


def refined(loaded: LoadedCase) -> LoadedCase:
    """Return the case with twice as many elements in every body."""
    bodies = {name: body if body.element.number is None else
              replace(body, element=replace(body.element, refine=2 * (body.element.refine or 1)))
              for name, body in loaded.case.bodies.items()}
    return replace(loaded, case=replace(loaded.case, bodies=bodies))


def _load(text: str, name: str, overrides: Sequence[str], vocabulary: Vocabulary | None,
          directory: str) -> LoadedCase:
    text = text.removeprefix("\ufeff")
    problems: list[Problem] = []
    origin = Origin(name, line_breaks(text))
    root = compose(text, origin, problems=problems)
    if not isinstance(root, MapNode):
        raise CaseError(problems or _no_case(root, name))
    apply_overrides(root, list(overrides), problems)
    source = Source(name, text, root)
    binder = Binder(vocabulary, problems)
    binder.labels = _labels(root)
    _tell_names(root, binder)
    case = bind_record(Case, root, (), binder)
    check_case(case, source, binder)
    definitions = _definitions(case, directory, binder, source)
    if binder.unreported:
        problems.append(Problem(f"{binder.unreported} more problems, not shown after the first "
                                f"{MAX_PROBLEMS}", file=name, line=len(origin.lines), column=1))
    if problems:
        raise CaseError(problems)
    return LoadedCase(case, source, text, tuple(overrides), definitions)


def _no_case(root: object, name: str) -> Problem:
    wanted = "a mapping with at least 'bodies' and 'solver'"
    if root is None or (isinstance(root, Scalar) and root.value is None):
        return Problem("the file is empty", file=name, expected=wanted)
    got = root.shown() if hasattr(root, "shown") else "something else"
    return Problem(f"the file holds {got}, not a case", file=name, expected=wanted)


def _labels(root: MapNode) -> tuple[str, str, str]:
    """Return the unit labels for messages before the case is read; SI where they are unusable."""
    found = _entries(root, "units")
    labels = []
    for name, default in (("length", "m"), ("force", "N"), ("time", "s")):
        node = found.get(name)
        usable = isinstance(node, Scalar) and node.shape == "text" and len(node.text) <= 12
        labels.append(node.text if usable and isinstance(node, Scalar) else default)
    return labels[0], labels[1], labels[2]


def _tell_names(root: MapNode, binder: Binder) -> None:
    """Let a binder know the parameters, probes and controllers of a case before the case is read."""
    parameters = _entries(root, "parameters")
    binder.numbers = {name: float(node.value) for name, node in parameters.items()
                      if isinstance(node, Scalar) and node.shape == "number"}
    output = root.entries.get("output")
    binder.probes = tuple(_entries(output.node, "probes") if output is not None else ())
    binder.controllers = tuple(_entries(root, "controllers"))


def _entries(node: Node, name: str) -> dict[str, Node]:
    """Return the nodes of a mapping below a key by name; none where there is no mapping."""
    entry = node.entries.get(name) if isinstance(node, MapNode) else None
    found = {} if entry is None or not isinstance(entry.node, MapNode) else entry.node.entries
    return {key: item.node for key, item in found.items()}


def _definitions(case: Case, directory: str, binder: Binder,
                 source: Source) -> dict[str, ElementDefinition]:
    """Return the element definitions that bodies name, by body; report what is wrong with them."""
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
                # a file that cannot be read at all is best reported where it is named
                binder.problems.extend(
                    p if p.line else source.problem(place, f"{dotted(place)}: {path}: {p.message}")
                    for p in error.problems)
        definition = read[path]
        if definition is not None:
            found[name] = definition
    return found
