"""The reader of values of all kinds: it collects problems and words their messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from ..errors import Problem
from ..quantities import KINEMATIC
from .declare import record
from .nodes import Broken, ListNode, MapNode, Mark, Node, shorten
from .syntax import Names
from .units import SI, unit_label

Path = tuple[Any, ...]
# most problems of different kinds, and most in all
MAX_PROBLEMS, MAX_ALIKE = 100, 1000
# with more names than this, a message shows only the nearest one
_MANY = 6


class _Invalid:
    """Placeholder in a draft of a case for a value whose problem was already reported."""

    def __repr__(self) -> str:
        return "INVALID"

    def __bool__(self) -> bool:
        return False


INVALID: Any = _Invalid()


class Issue(NamedTuple):
    """A problem that a record finds in itself: ``key`` is a path below the record, empty for the record as a whole."""

    key: Path
    message: str
    expected: str = ""
    near: str = ""


def reversed_range(start: float, end: float) -> Iterator[Issue]:
    """Yield an issue if the key ``from`` of a record is not less than ``to``."""
    if not start < end:
        yield Issue(("to",), f"{{}}: from must be less than to, got from {start:g} to {end:g}")


@record
class Vocabulary:
    """The names that a case may use, from the registries; empty leaves them unchecked."""

    element_types: tuple[str, ...] = ()
    formulations: tuple[str, ...] = ()
    nodal_coordinates: tuple[str, ...] = ()
    integrators: tuple[str, ...] = ()
    output_fields: tuple[str, ...] = ()
    # problems of a draft of an element definition, whose invalid values are INVALID
    element_issues: Callable[[Any], Iterable[Issue]] = lambda draft: ()


class KnownRecords:
    """The records that were read without problems, by the mapping below a root node that each was read from.

    ``plain`` has the plain data of each record by its id, and ``texts`` the YAML text of these data by their id, both
    filled on demand (``case.emit``). ``below`` has all values at and below each record at a path (``emit.walk``). This
    object keeps nodes, records and data alive, so their ids stay unique.
    """

    def __init__(self, root: Node | None = None) -> None:
        self._nodes = {id(node): node for node in _mappings(root)}
        self._found: dict[tuple[int, type, Path], Any] = {}
        self.plain: dict[int, Any] = {}
        self.texts: dict[int, str] = {}
        self.below: dict[tuple[int, Path], list[tuple[Path, Any, str]]] = {}

    def get(self, cls: type, node: MapNode, path: Path) -> Any:
        """Return the record of a class that was read from a mapping at a path, or None if there is none."""
        return self._found.get((id(node), cls, path))

    def add(self, cls: type, node: MapNode, path: Path, record: Any) -> None:
        """Store a record, unless its mapping is not part of this text (it came from an override)."""
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
    """Collects the problems of one case; has its units and the names that it may use."""

    def __init__(self, vocabulary: Vocabulary | None = None,
                 problems: list[Problem] | None = None) -> None:
        self.vocabulary = vocabulary or Vocabulary()
        self.problems = problems if problems is not None else []
        self.labels = SI
        self.unreported = 0
        self.kinds: set[tuple[str, ...]] = set()
        self.skipped: list[Path] = []
        self.numbers: dict[str, float] = {}
        self.probes: tuple[str, ...] = ()
        self.controllers: tuple[str, ...] = ()
        self.states: tuple[str, ...] = ()
        # record of the whole file, in which misplaced words are looked up
        self.root: type | None = None
        # records of the same text, read before with other overrides
        self.known = KnownRecords()

    def names(self, variable: str, local: tuple[str, ...] = (), feedback: bool = False) -> Names:
        """Return the names that an expression may use; ``feedback`` adds those of states, controllers and probes."""
        if not feedback:
            return Names(variable, self.numbers, local)
        of_probes = (f"{probe}.{quantity}" for probe in self.probes for quantity in KINEMATIC)
        return Names(variable, self.numbers, (*local, *self.states, *self.controllers, *of_probes), self.probes)

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
            self.kinds.add(self.problems[-1].kind)
        return INVALID

    def skip(self, path: Path) -> Any:
        """Return INVALID for a value whose problem was already reported before it was read."""
        self.skipped.append(path)
        return INVALID

    @property
    def invalid(self) -> int:
        """The number of invalid values found; a record is checked as a whole only if none of its own is invalid."""
        return len(self.problems) + self.unreported + len(self.skipped)

    @property
    def full(self) -> bool:
        """Whether further problems are only counted, so that their messages need not be composed."""
        return len(self.kinds) >= MAX_PROBLEMS or len(self.problems) >= MAX_ALIKE

    def nearest(self, word: str, names: Iterable[str], cutoff: float = 0.6) -> str:
        """Return the name most like a word; empty if none is near, or if no more messages are shown."""
        return "" if self.full else nearest(word, names, cutoff)

    def instead(self, word: str, names: Iterable[str]) -> tuple[str, str]:
        """Return what to expect in place of a word, which is empty if a name is near, and this name."""
        names = sorted(names)
        near = self.nearest(word, names)
        return "" if near else listed(names), near

    def wrong(self, node: Node, path: Path, wanted: str, expected: str = "") -> Any:
        """Report that a value is not as wanted, with what else to expect; return INVALID."""
        if isinstance(node, Broken):
            return self.skip(path)
        if self.full:
            return self.fail(node.mark, path, "")
        what = "has no value" if node.shape == "null" else None
        message = (f"{dotted(path)} {what}" if what
                   else f"{dotted(path)} must be {wanted}, got {node.shown()}")
        return self.fail(node.mark, path, message, wanted if what else expected)

    def unknown(self, mark: Mark, path: Path, shown: str, names: Iterable[str],
                near: str) -> Any:
        """Report that a text is not one of the allowed names; return INVALID."""
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
    """Return the name most like a word, or an empty text if none is near."""
    from difflib import get_close_matches
    if not 0 < len(word) <= 80:
        return ""
    lower = {name.lower(): name for name in names}
    found = get_close_matches(word.lower(), list(lower)[:10000], n=1, cutoff=cutoff)
    return lower[found[0]] if found else ""


def listed(names: Iterable[str]) -> str:
    """Return names joined as in a sentence: ``a, b or c``; long lists are cut."""
    names = list(names)
    if len(names) > 24:
        return ", ".join(names[:24]) + ", ..."
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
