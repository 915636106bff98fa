"""Lists the values of a case, and writes it as YAML that reads back to the same case."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from .binder import KnownRecords, Path
from .nodes import resolve
from .records import keys_of, tag_of

_PLAIN = re.compile(r"[A-Za-z_][\w@./+ -]*(?<! )", re.ASCII)
_WIDTH = 88
# text in YAML 1.2, but truth values to readers of YAML 1.1
_YAML11 = ("yes", "no", "on", "off")


def walk(value: Any, path: Path = (), known: KnownRecords | None = None) -> list[tuple[Path, Any, str]]:
    """Return every value of a case at and below ``value`` as (path, value, list to whose names it refers).

    The values below ``known`` records are listed once and reused.
    """
    reusable = known.below if known is not None and id(value) in known.plain else {}
    if (id(value), path) in reusable:
        return reusable[id(value), path]
    reusable[id(value), path] = found = [(path, value, "")]
    if isinstance(value, dict | tuple):
        below = [(part, one, "") for part, one in (value.items() if isinstance(value, dict) else enumerate(value))]
    elif dataclasses.is_dataclass(value):
        cls: Any = type(value)
        below = [(name, one, k.refers) for name, k in keys_of(cls).items()
                 if (one := getattr(value, k.field)) is not None]
    else:
        return found
    for part, one, refers in below:
        found += [((*path, part), one, refers)] if isinstance(one, str) else walk(one, (*path, part), known)
    return found


def written(value: Any, known: KnownRecords | None = None) -> Any:
    """Return a value of a case as plain data in the form of a case file; None is left out.

    The data of ``known`` records are made once and must not be changed.
    """
    if known is not None and id(value) in known.plain:
        found = known.plain[id(value)]
        if found is None:
            found = known.plain[id(value)] = written(value)
        return found
    own = getattr(value, "written", None)
    short = own() if own is not None else None
    if short is not None:
        return written(short, known)
    if dataclasses.is_dataclass(value):
        cls: Any = type(value)
        data = {"type": tag_of(cls)} if tag_of(cls) else {}
        for name, k in keys_of(cls).items():
            below = written(getattr(value, k.field), known)
            if below is not None:
                data[name] = below
        return data
    if isinstance(value, dict):
        return {name: written(item, known) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [written(item, known) for item in value]
    return value


def yaml_text(data: dict[str, Any], known: KnownRecords | None = None) -> str:
    """Return plain data as YAML: mappings in blocks, values that fit on a line in flow style."""
    reusable = {id(one) for one in known.plain.values()} if known is not None else set()
    lines = _block(data, 0, _Texts(reusable, known.texts if known is not None else {}))
    return "\n".join(lines or ["{}"]) + "\n"


class _Texts:
    """One-line YAML texts of data; the texts of data with the given ids are stored for reuse."""

    def __init__(self, reusable: set[int], texts: dict[int, str]) -> None:
        self.reusable, self.texts = reusable, texts

    def line(self, value: Any) -> str:
        """Return plain data as YAML on one line."""
        if id(value) not in self.reusable:
            return flow(value, self.line)
        if id(value) not in self.texts:
            self.texts[id(value)] = flow(value)
        return self.texts[id(value)]


def _block(value: Any, indent: int, texts: _Texts) -> list[str]:
    pad = " " * indent
    lines = []
    if isinstance(value, dict):
        for name, item in value.items():
            head = f"{pad}{text_scalar(name)}:"
            line = texts.line(item)
            if len(head) + len(line) < _WIDTH or not isinstance(item, dict | list) or not item:
                lines.append(f"{head} {line}")
            else:
                lines.append(head)
                lines.extend(_block(item, indent + 2, texts))
        return lines
    for item in value:
        line = texts.line(item)
        if indent + len(line) < _WIDTH or not isinstance(item, dict | list) or not item:
            lines.append(f"{pad}- {line}")
        else:
            below = _block(item, indent + 2, texts)
            lines.append(f"{pad}- {below[0].lstrip()}")
            lines.extend(below[1:])
    return lines


def flow(value: Any, below: Callable[[Any], str] | None = None) -> str:
    """Return plain data as YAML on one line; ``below`` may supply the texts of the items of a mapping or list."""
    below = below or flow
    if isinstance(value, dict):
        return "{" + ", ".join(f"{text_scalar(k)}: {below(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(below(v) for v in value) + "]"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return number_text(value)
    return str(value) if isinstance(value, int) else text_scalar(value)


def number_text(value: float) -> str:
    """Return the shortest text that reads back as the same number: ``2.07e11``, ``0.1``, ``8``."""
    if not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    if value == int(value) and abs(value) < 1e6:
        return str(int(value)) if value or math.copysign(1, value) > 0 else "-0.0"
    if 1e-4 <= abs(value) < 1e6:
        return repr(value)
    for digits in range(17):
        text = f"{value:.{digits}e}"
        if float(text) == value:
            break
    mantissa, exponent = text.split("e")
    return f"{mantissa}e{int(exponent)}"


@lru_cache(4096)
def text_scalar(text: str) -> str:
    """Return a text as YAML: plain if it cannot be misread, else in double quotes."""
    if (_PLAIN.fullmatch(text) and isinstance(resolve(text), str)
            and text.lower() not in _YAML11):
        return text
    quoted = json.dumps(text, ensure_ascii=False)
    # JSON leaves some characters unescaped that YAML would fold or refuse
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in quoted)
