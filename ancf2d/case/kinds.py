"""The kinds of plain values in a case: numbers, texts, names, choices, vectors, lists."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..errors import ItemName
from .binder import INVALID, Binder, Path, dotted, listed
from .nodes import Broken, ListNode, MapNode, Node, Scalar, quoted

JsonSchema = dict[str, Any]


class Book:
    """A JSON Schema under construction: the vocabulary, and the definitions collected for it."""

    def __init__(self, vocabulary: Any) -> None:
        self.vocabulary = vocabulary
        self.definitions: dict[str, JsonSchema] = {}


class Kind:
    """How a value of a case is read, named in messages, and described to editors."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        """Return the value of a node, or INVALID after reporting its problem."""
        raise NotImplementedError

    def words(self, binder: Binder) -> str:
        """Return the expected value in words that follow 'must be'."""
        raise NotImplementedError

    def schema(self, book: Book) -> JsonSchema:
        """Return the JSON Schema (draft-07) of the value."""
        raise NotImplementedError


class Number(Kind):
    """A finite number in a unit, with bounds: ``gt``, ``lt`` open, ``ge``, ``le`` closed."""

    def __init__(self, unit: str = "", *, gt: float | None = None, ge: float | None = None,
                 lt: float | None = None, le: float | None = None) -> None:
        self.unit, self.gt, self.ge, self.lt, self.le = unit, gt, ge, lt, le

    def bounds(self, unit: str) -> str:
        """Return the bounds in words: ``> 0 Pa``, ``in (-1, 0.5)``; empty without bounds."""
        low, high = self.gt if self.ge is None else self.ge, self.lt if self.le is None else self.le
        tail = f" {unit}" if unit else ""
        if low is not None and high is not None:
            a, b = "(" if self.ge is None else "[", ")" if self.le is None else "]"
            return f"in {a}{low:g}, {high:g}{b}{tail}"
        if low is not None:
            return f"{'>' if self.ge is None else '>='} {low:g}{tail}"
        if high is not None:
            return f"{'<' if self.le is None else '<='} {high:g}{tail}"
        return ""

    def words(self, binder: Binder) -> str:
        unit = binder.unit(self.unit)
        bounds = self.bounds(unit)
        return f"a number {bounds}" if bounds else f"a number ({unit})" if unit else "a number"

    def inside(self, value: float) -> bool:
        """Return whether a number is within the bounds."""
        return not ((self.gt is not None and not value > self.gt)
                    or (self.ge is not None and not value >= self.ge)
                    or (self.lt is not None and not value < self.lt)
                    or (self.le is not None and not value <= self.le))

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, Scalar) or node.shape != "number":
            parameter = isinstance(node, Scalar) and node.text in binder.numbers
            return binder.wrong(node, path, self.words(binder),
                                "its value, because only expressions know parameters" * parameter)
        value = float(node.value)
        if not math.isfinite(value):
            return binder.wrong(node, path, "a finite number")
        if not self.inside(value):
            return binder.wrong(node, path, self.bounds(binder.unit(self.unit)))
        return value

    def schema(self, book: Book) -> JsonSchema:
        limits = {"exclusiveMinimum": self.gt, "minimum": self.ge,
                  "exclusiveMaximum": self.lt, "maximum": self.le}
        return {"type": "number", **{k: v for k, v in limits.items() if v is not None}}


class Integer(Kind):
    """A whole number between bounds; ``8``, ``8.0`` and ``1e3`` are whole numbers."""

    unit = ""

    def __init__(self, least: int = 1, most: int = 10**9) -> None:
        self.least, self.most = least, most

    def bounds(self, unit: str) -> str:
        """Return the bounds in words."""
        return (f">= {self.least}" if self.most >= 10**9
                else f"from {self.least} to {self.most}")

    def words(self, binder: Binder) -> str:
        return f"a whole number {self.bounds('')}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        value: Any = node.value if isinstance(node, Scalar) and node.shape == "number" else None
        if value is None or not math.isfinite(value) or value != int(value):
            return binder.wrong(node, path, self.words(binder))
        if not self.least <= value <= self.most:
            return binder.wrong(node, path, self.bounds(""))
        return int(value)

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


class Sign(Integer):
    """1 or -1."""

    def __init__(self) -> None:
        super().__init__(-1, 1)

    def words(self, binder: Binder) -> str:
        return "1 or -1"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        value: Any = node.value if isinstance(node, Scalar) and node.shape == "number" else None
        return int(value) if value in (1, -1) else binder.wrong(node, path, self.words(binder))

    def schema(self, book: Book) -> JsonSchema:
        return {"enum": [1, -1]}


class Flag(Kind):
    """``true`` or ``false``."""

    def words(self, binder: Binder) -> str:
        return "true or false"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if isinstance(node, Scalar) and node.shape == "flag":
            return node.value
        return binder.wrong(node, path, self.words(binder))

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "boolean"}


class Text(Kind):
    """Text; with ``number``, a number is also accepted, as the text that it was written as."""

    def __init__(self, what: str = "text", *, number: bool = False) -> None:
        self.what, self.number = what, number

    def words(self, binder: Binder) -> str:
        return self.what

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if isinstance(node, Scalar) and (node.shape == "text"
                                         or (self.number and node.shape == "number")):
            return node.text
        return binder.wrong(node, path, self.words(binder))

    def schema(self, book: Book) -> JsonSchema:
        return {"type": ["string", "number"] if self.number else "string"}


class Name(Text):
    """The name of something: text without ``@ . / =``, brackets and blanks at its ends."""

    pattern = r"^[^@./=\[\]\s]([^@./=\[\]]*[^@./=\[\]\s])?$"

    def __init__(self, what: str = "a name") -> None:
        super().__init__(what)

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is INVALID or good_name(text):
            return text
        assert isinstance(node, Scalar)
        return binder.fail(node.mark, path, bad_name(dotted(path), text))

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "string", "pattern": self.pattern}


NAME = Name()


class ProbeQuantity(Text):
    """A quantity of a probe: PROBE.QUANTITY."""

    def __init__(self, *quantities: str) -> None:
        super().__init__(f"PROBE.QUANTITY with one of {', '.join(quantities)}")
        self.quantities = quantities

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is INVALID:
            return text
        probe, _, quantity = text.partition(".")
        if good_name(probe) and quantity in self.quantities:
            return text
        assert isinstance(node, Scalar)
        near = binder.nearest(quantity, self.quantities)
        return binder.fail(node.mark, path, f"{dotted(path)}: {quoted(text)} is not a quantity of a probe", self.what,
                           f"{probe}.{near}" if near and probe else "")

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "string", "pattern": rf"^[^@./=\[\]]+\.({'|'.join(self.quantities)})$"}


def good_name(text: str) -> bool:
    """Return whether a text can be the name of a body, a probe or a support."""
    return (0 < len(text) <= 80 and text == text.strip() and text.isprintable()
            and not any(c in "@./=[]" for c in text))


def bad_name(what: str, text: str) -> str:
    """Return the message about a text that cannot be a name."""
    return (f"{what}: {quoted(text)} is not a valid name; a name has up to 80 characters, without @ . / = [ ]")


class Choice(Kind):
    """One of several texts."""

    def __init__(self, *options: str) -> None:
        self.options = options

    def names(self, binder: Any) -> tuple[str, ...]:
        """Return the allowed texts; empty if any text is allowed."""
        return self.options

    def words(self, binder: Binder) -> str:
        return listed(self.names(binder)) or "text"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        names = self.names(binder)
        if isinstance(node, Scalar) and node.shape in ("text", "number"):
            if node.text in names or (not names and node.shape == "text"):
                return node.text
            return binder.unknown(node.mark, path, quoted(node.text), names,
                                  binder.nearest(node.text, names))
        return binder.wrong(node, path, self.words(binder))

    def schema(self, book: Book) -> JsonSchema:
        names = self.names(book)
        return {"enum": list(names)} if names else {"type": "string"}


class Known(Choice):
    """One of the names that the vocabulary lists under ``attribute``, or one of ``options``."""

    def __init__(self, attribute: str, *options: str) -> None:
        super().__init__(*options)
        self.attribute = attribute

    def names(self, binder: Any) -> tuple[str, ...]:
        names = tuple(getattr(binder.vocabulary, self.attribute))
        return (*names, *(o for o in self.options if o not in names)) if names else ()


class Vector(Kind):
    """A list of as many numbers as ``names`` has; ``wrap`` turns them into a record."""

    def __init__(self, item: Any, names: str = "x, y",
                 wrap: Callable[..., Any] | None = None, *, nonzero: bool = False) -> None:
        self.item, self.names, self.wrap, self.nonzero = item, names, wrap, nonzero
        self.size = names.count(",") + 1

    def words(self, binder: Binder) -> str:
        unit = binder.unit(self.item.unit)
        sort = "whole numbers" if isinstance(self.item, Integer) else "numbers"
        return f"{self.size} {sort} [{self.names}]" + (f" ({unit})" if unit else "")

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, ListNode) or len(node.items) != self.size:
            return binder.wrong(node, path, self.words(binder))
        values = [self.item.bind(n, (*path, i), binder) for i, n in enumerate(node.items)]
        if any(v is INVALID for v in values):
            return INVALID
        if self.nonzero and not any(values):
            return binder.fail(node.mark, path, f"{dotted(path)} must not be zero")
        return self.wrap(*values) if self.wrap else tuple(values)

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "array", "items": self.item.schema(book),
                "minItems": self.size, "maxItems": self.size}


class ListOf(Kind):
    """A list of values of one kind."""

    def __init__(self, item: Kind, what: str, least: int = 0, most: int | None = None) -> None:
        self.item, self.what, self.least, self.most = item, what, least, most

    def words(self, binder: Binder) -> str:
        if self.most is not None and self.most == self.least:
            return f"a list of {self.least} {self.what}"
        return f"a list of {self.what}" if self.least == 0 else (
            f"a list of {self.least} or more {self.what}")

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, ListNode):
            return binder.wrong(node, path, self.words(binder))
        n = len(node.items)
        if n < self.least or (self.most is not None and n > self.most):
            return binder.wrong(node, path, self.words(binder))
        return tuple(self.item.bind(item, (*path, i), binder)
                     for i, item in enumerate(node.items))

    def schema(self, book: Book) -> JsonSchema:
        limits = {"minItems": self.least or None, "maxItems": self.most}
        return {"type": "array", "items": self.item.schema(book),
                **{k: v for k, v in limits.items() if v is not None}}


class MapOf(Kind):
    """Values of one kind by name."""

    def __init__(self, item: Kind, what: str, least: int = 0) -> None:
        self.item, self.what, self.least = item, what, least

    def words(self, binder: Binder) -> str:
        return f"a mapping of {self.what}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if not isinstance(node, MapNode):
            return binder.wrong(node, path, self.words(binder))
        if len(node.entries) < self.least:
            return binder.fail(node.mark, path, f"{dotted(path)} is empty",
                               f"{self.words(binder)}, at least {self.least}")
        result = {}
        for name, entry in node.entries.items():
            below = (*path, ItemName(name))
            if not good_name(name):
                binder.fail(entry.mark, below, bad_name(dotted(path), name))
            value = binder.skip(below) if isinstance(entry.node, Broken) else self.item.bind(entry.node, below, binder)
            result[name] = value
        return result

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "object", "additionalProperties": self.item.schema(book),
                "propertyNames": {"pattern": Name.pattern},
                **({"minProperties": self.least} if self.least else {})}
