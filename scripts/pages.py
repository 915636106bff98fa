"""Pages of docs/ as scripts fill them: tables, the places of what was measured, and what the figures belong to."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ancf2d.processors import THREADS

ROOT = Path(__file__).resolve().parents[1]
CASES, DOCS = ROOT / "cases", ROOT / "docs"


def one_thread() -> None:
    """Let this process and those it starts use one thread, unless the caller says otherwise."""
    for name in THREADS:
        os.environ.setdefault(name, "1")


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def small(value: float | None) -> str:
    """Return two digits of an error, 0 for what is below any round-off, and nothing for None."""
    return "" if value is None else "0" if abs(value) < 1e-30 else f"{value:.1e}"


def machine() -> str:
    """Return the processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or "unknown processor"
    return f"{name}, {os.cpu_count()} cores"


def versions(*more: str) -> str:
    """Return the versions that figures belong to, those of ``more`` packages too."""
    found = []
    for package in ("ancf2d", "numpy", "scipy", "numba", *more):
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"no {package}")
    return f"Python {platform.python_version()}, " + ", ".join(found)


def stamp(command: str, *more: str) -> str:
    """Return when and on what ``python -m COMMAND`` measured, with versions of ``more`` packages."""
    return f"Measured by `python -m {command}` on {date.today()}: {machine()}; {versions(*more)}."


def write(page: Path, name: str, found: str) -> None:
    """Put a text into its place, ``<!-- measured: NAME -->`` to ``<!-- end -->``; ValueError where there is none."""
    text = page.read_text(encoding="utf-8")
    place = re.compile(rf"(<!-- measured: {re.escape(name)} -->\n)(?:(?!<!--).)*(<!-- end -->)", re.S)
    if not place.search(text):
        raise ValueError(f"{page} has no place for '{name}'")
    page.write_text(place.sub(lambda m: f"{m[1]}{found}\n{m[2]}", text), encoding="utf-8")
