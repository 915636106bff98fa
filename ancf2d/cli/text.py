"""Printing of text, tables and numbers."""

from __future__ import annotations

import math
import os
import re
import shlex
import sys
from collections.abc import Sequence
from typing import TextIO

import click

# characters that control a terminal: control characters, and those that change the direction of writing
_COMMANDS = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """Return a text that is safe to print on a terminal: escapes such as \\x1b replace control characters."""
    return _COMMANDS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def say(text: str, err: bool = False) -> None:
    """Print a text to stdout or stderr, with control characters in names and titles escaped."""
    write(printable(text) + "\n", err)


def write(text: str, err: bool = False) -> None:
    """Write a text to stdout or stderr; go on without the stream if its reader has closed it (``| head``)."""
    try:
        click.echo(text, nl=False, err=err)
    except BrokenPipeError:
        _discard(sys.stderr if err else sys.stdout)


def discard_output() -> None:
    """Discard the buffer of stdout if it cannot be written, because Python would fail again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        _discard(sys.stdout)


def _discard(stream: TextIO) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())  # otherwise Python would fail at exit when it flushes the buffer
    os.close(nowhere)


def command_line(*arguments: object) -> str:
    """Return an ancf2d command as typed in a shell."""
    return shlex.join(["ancf2d", *map(str, arguments)])


NOTHING = 1e-60


def number(value: float | None, digits: int = 6) -> str:
    """Return a number with few digits; '-' for none, and 0 for a tiny remainder of an iteration."""
    if value is None or math.isnan(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) > NOTHING else "0"


def rounded(value: float, floor: float) -> str:
    """Return a number whose uncertainty is ``floor``; smaller values are shown as 0."""
    return "0" if abs(value) <= floor else number(value)


# width of times, so that their column is equally wide in every run
TIME = "time".rjust(8)


def table(rows: Sequence[Sequence[str]], left: Sequence[int] = (0,), indent: str = "") -> list[str]:
    """Return rows of cells as aligned lines: columns in ``left`` are left-aligned, all others right-aligned."""
    widths = [max((len(row[k]) for row in rows if k < len(row)), default=0) for k in range(max(map(len, rows)))]
    lines = []
    for row in rows:
        cells = [c.ljust(w) if k in left else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=False))]
        lines.append(indent + "  ".join(cells).rstrip())
    return lines


def duration(seconds: float) -> str:
    """Return a time span in the most readable unit."""
    # 0.9996 s is 1 s, not 1e+03 ms
    if seconds < 0.9995e-3:
        return f"{1e6 * seconds:.0f} us"
    if seconds < 0.9995:
        return f"{1e3 * seconds:.3g} ms"
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 120 * 60 else f"{seconds / 3600:.3g} h"
