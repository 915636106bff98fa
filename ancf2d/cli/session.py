"""What one invocation of the command line knows of itself, and how it speaks."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..interrupts import uninterrupted
from ..json_values import json_text
from .text import command_line, say, write


@dataclass
class Session:
    """The options that every command shares, and what is known of its subject for a failure's JSON object."""

    arguments: list[str] = field(default_factory=list)
    debug: bool = False
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    subject: dict[str, Any] = field(default_factory=dict)
    _printed: bool = False
    _noted: set[str] = field(default_factory=set)
    parting: Callable[[], None] = lambda: None  # called after an interruption: what is left of the work

    @property
    def command_line(self) -> str:
        """The command as it was typed, quoted for a shell."""
        return command_line(*self.arguments)

    def out(self, text: str) -> None:
        """Print a result to stdout; nothing where JSON alone is wanted, or only errors."""
        if not self.json and not self.quiet:
            say(text)

    def note(self, text: str) -> None:
        """Print a remark to stderr, unless only errors are wanted."""
        if not self.quiet:
            say(text, err=True)

    def note_once(self, text: str) -> None:
        """Print a remark to stderr that this invocation has not made yet, such as that kernels are compiled."""
        if text not in self._noted:
            self._noted.add(text)
            self.note(text)

    def detail(self, text: str) -> None:
        """Print what ``-v`` adds to stderr."""
        if self.verbose and not self.quiet:
            say(text, err=True)

    def warn(self, text: str) -> None:
        """Print a warning to stderr."""
        self.note(f"warning: {text}")

    def print_json(self, value: dict[str, Any]) -> None:
        """Print the one JSON object of this invocation to stdout, where it was asked for; the first one stands."""
        if self.json and not self._printed:
            text = json_text(value)
            with uninterrupted():  # half of an object is none
                self._printed = True
                write(text + "\n")

    @property
    def shows_progress(self) -> bool:
        """Whether a progress bar may be drawn: on a terminal only."""
        return not self.quiet and sys.stderr is not None and sys.stderr.isatty()
