"""The places of docs/ that scripts fill with what they measured, and what these figures belong to."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

from bench.stamp import machine, versions

DOCS = Path(__file__).resolve().parents[1] / "docs"


def stamp(command: str, *more: str) -> str:
    """Return when and on what a command measured, with versions of ``more`` packages."""
    return f"Measured by `python scripts/{command}` on {date.today()}: {machine()}; {versions(*more)}."


def write(page: Path, name: str, found: str) -> None:
    """Put a text into its place, ``<!-- measured: NAME -->`` to ``<!-- end -->``; ValueError where there is none."""
    text = page.read_text(encoding="utf-8")
    place = re.compile(rf"(<!-- measured: {re.escape(name)} -->\n)(?:(?!<!--).)*(<!-- end -->)", re.S)
    if not place.search(text):
        raise ValueError(f"{page} has no place for '{name}'")
    page.write_text(place.sub(lambda m: f"{m[1]}{found}\n{m[2]}", text), encoding="utf-8")
