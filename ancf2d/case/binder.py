"""What every kind of value needs while it is read: where to report, and in which words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from ..errors import Problem
from .declare import record
from .nodes import Broken, ListNode, MapNode, Mark, Node, shorten
from .syntax import Names
from .units import SI, unit_label

Path = tuple[Any, ...]
MAX_PROBLEMS = 100
# the quantities of a probe that expressions may use
TOLD = ("x", "y", "ux", "uy", "theta", "vx", "vy", "omega")
# beyond so many names, the nearest one alone is shown
_MANY = 6


class _Invalid:
    """Stands in a draft of a case for a value whose problem is reported already."""

    def __repr__(self) -> str:
        return "INVALID"

    def __bool__(self) -> bool:
        return False


INVALID: Any = _Invalid()


@record
class Vocabulary:
    """The names that other rooms define and a case may use; empty leaves them unchecked."""

    element_types: tuple[str, ...] = ()
    formulations: tuple[str, ...] = ()
    nodal_coordinates: tuple[str, ...] = ()
    integrators: tuple[str, ...] = ()
    output_fields: tuple[str, ...] = ()


class Issue(NamedTuple):
    """What a record finds wrong with itself: ``key`` is a path below it, empty for the whole."""

    key: Path
    message: str
    expected: str = ""
    near: str = ""


class KnownRecords:
    """The records that mappings below a node were found to be, where nothing was wrong with them.

    ``plain`` has their plain data by the id of each record, and ``texts`` what YAML has of these by the id of the data,
    once they were asked for (``case.emit``); ``below`` what is at and below each record at a path (``emit.walk``).
    Nodes, records and data live as long as this, so that none has the id of another.
    """

    def __init__(self, root: Node | None = None) -> None:
        self._nodes = {id(node): node for node in _mappings(root)}
        self._found: dict[tuple[int, type, Path], Any] = {}
        self.plain: dict[int, Any] = {}
        self.texts: dict[int, str] = {}
        self.below: dict[tuple[int, Path], list[tuple[Path, Any, str]]] = {}

    def get(self, cls: type, node: MapNode, path: Path) -> Any:
        """Return the record of a class that a mapping at a path was read as, None where it was not."""
        return self._found.get((id(node), cls, path))

    def add(self, cls: type, node: MapNode, path: Path, record: Any) -> None:
        """Keep a record, unless its mapping is another case's alone."""
        if id(node) in self._nodes:
            self._found[id(node), cls, path] = record
            self.plain.setdefault(id(record))


def _mappings(node: Node | None) -> Iterator[MapNode]:
    """Yield all mappings at and below a node."""
    below = [node]
    while below:
        one = below.pop()
        if isinstance(one, MapNode):
            yield one
            below += [entry.node for entry in one.entries.values()]
        elif isinstance(one, ListNode):
            below += one.items


class Binder:
    """Collects the problems of one case, and knows its units and the names it may use."""

    def __init__(self, vocabulary: Vocabulary | None = None,
                 problems: list[Problem] | None = None) -> None:
        self.vocabulary = vocabulary or Vocabulary()
        self.problems = problems if problems is not None else []
        self.labels = SI
        self.unreported = 0
        self.refused: list[Path] = []
        self.numbers: dict[str, float] = {}
        self.probes: tuple[str, ...] = ()
        self.controllers: tuple[str, ...] = ()
        self.states: tuple[str, ...] = ()
        # those of a text that is read with other overrides
        self.known = KnownRecords()

    def names(self, variable: str, local: tuple[str, ...] = (), feedback: bool = False) -> Names:
        """Return the names that an expression may use; with ``feedback`` those of probes and controllers, too."""
        if not feedback:
            return Names(variable, self.numbers, local)
        told = (f"{probe}.{quantity}" for probe in self.probes for quantity in TOLD)
        return Names(variable, self.numbers, (*local, *self.states, *self.controllers, *told), self.probes)

    def unit(self, unit: str) -> str:
        """Return the label of an SI unit in the units of this case."""
        return unit_label(unit, self.labels)

    def fail(self, mark: Mark, path: Path, message: str, expected: str = "",
             near: str = "") -> Any:
        """Report a problem; return INVALID."""
        if self.full:
            self.unreported += 1
        else:
            self.problems.append(mark.problem(message, path, expected, near))
        return INVALID

    def refuse(self, path: Path) -> Any:
        """Return INVALID for a value whose problem was reported before it was read."""
        self.refused.append(path)
        return INVALID

    @property
    def invalid(self) -> int:
        """How many values were found to be invalid so far: a record is checked as a whole where none of its own is."""
        return len(self.problems) + self.unreported + len(self.refused)

    @property
    def full(self) -> bool:
        """Whether further problems are counted only, so that their words need not be found."""
        return len(self.problems) >= MAX_PROBLEMS

    def nearest(self, word: str, names: Iterable[str], cutoff: float = 0.6) -> str:
        """Return the name most like a word; empty where none is near, or nobody would see it."""
        return "" if self.full else nearest(word, names, cutoff)

    def wrong(self, node: Node, path: Path, wanted: str, near: str = "") -> Any:
        """Report that a value is not what is wanted; return INVALID."""
        if isinstance(node, Broken):
            return self.refuse(path)
        if self.full:
            return self.fail(node.mark, path, "")
        what = "has no value" if node.shape == "null" else None
        message = (f"{dotted(path)} {what}" if what
                   else f"{dotted(path)} must be {wanted}, got {node.shown()}")
        return self.fail(node.mark, path, message, wanted if what else "", near)

    def unknown(self, mark: Mark, path: Path, shown: str, names: Iterable[str],
                near: str) -> Any:
        """Report that a text is none of some names; return INVALID."""
        if self.full:
            return self.fail(mark, path, "")
        names = list(names)
        if near and len(names) > _MANY:
            message = f"{dotted(path)}: {shown} is not known"
        else:
            message = f"{dotted(path)} must be {listed(names)}, got {shown}"
        return self.fail(mark, path, message, near=near)


def dotted(path: Path) -> str:
    """Return a path as messages and ``--set`` write it: ``loads.0.value.1``."""
    return ".".join(shorten(str(part)) for part in path) or "the case"


def nearest(word: str, names: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the name most like a word, empty where none is near."""
    from difflib import get_close_matches
    if not 0 < len(word) <= 80:
        return ""
    lower = {name.lower(): name for name in names}
    found = get_close_matches(word.lower(), list(lower)[:10000], n=1, cutoff=cutoff)
    return lower[found[0]] if found else ""


def listed(names: Iterable[str]) -> str:
    """Return names as a sentence has them: ``a, b or c``; long lists are cut."""
    names = list(names)
    if len(names) > 24:
        return ", ".join(names[:24]) + ", ..."
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
