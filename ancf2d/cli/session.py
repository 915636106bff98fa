"""State and output of one invocation of the command line: messages, JSON, a progress bar."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import click

from ..interrupts import uninterrupted
from ..json_values import json_text
from ..pace import Pace, SteadyEstimate
from .text import command_line, duration, printable, say, write


@dataclass
class Session:
    """The options shared by all commands, and the subject of the command for the JSON object of a failure."""

    arguments: list[str] = field(default_factory=list)
    debug: bool = False
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    subject: dict[str, Any] = field(default_factory=dict)
    _printed: bool = False
    _noted: set[str] = field(default_factory=set)
    parting: Callable[[], None] = lambda: None  # called after an interruption; prints the completed part

    @property
    def command_line(self) -> str:
        """The command as typed, quoted for a shell."""
        return command_line(*self.arguments)

    def out(self, text: str) -> None:
        """Print a result to stdout, unless --json or --quiet is given."""
        if not self.json and not self.quiet:
            say(text)

    def note(self, text: str) -> None:
        """Print a remark to stderr, unless --quiet is given."""
        if not self.quiet:
            say(text, err=True)

    def note_once(self, text: str) -> None:
        """Print a remark to stderr once per invocation, such as that kernels are compiled."""
        if text not in self._noted:
            self._noted.add(text)
            self.note(text)

    def detail(self, text: str) -> None:
        """Print an additional message of ``-v`` to stderr."""
        if self.verbose and not self.quiet:
            say(text, err=True)

    def warn(self, text: str) -> None:
        """Print a warning to stderr."""
        self.note(f"warning: {text}")

    def print_json(self, value: dict[str, Any]) -> None:
        """Print the one JSON object of this invocation to stdout, if requested; later objects are ignored."""
        if self.json and not self._printed:
            text = json_text(value)
            with uninterrupted():  # an incomplete object cannot be parsed
                self._printed = True
                write(text + "\n")

    def report_study(self, study: Any, text: str, output: str | None, write: Callable[[str], Any]) -> None:
        """Print the results of a study as JSON or text, with its warnings; first write its ``output`` file, if any."""
        for warning in study.warnings:
            self.warn(warning)
        if output is not None:
            write(output)
        self.print_json(study.as_json() | ({} if output is None else {"output": output}))
        self.out(text)
        if output is not None:
            self.out(f"\nresults in {output}; next: {command_line('plot', output)}")

    @property
    def shows_progress(self) -> bool:
        """Whether a progress bar may be drawn: only on a terminal."""
        return not self.quiet and sys.stderr is not None and sys.stderr.isatty()


PATIENCE = 0.7  # seconds before a bar is drawn
STEPS = 1000
WIDTH = 20  # a bar and the text next to it fit in 80 columns
REDRAW = 1.0  # seconds after which the text is redrawn although the bar has not moved


class Bar:
    """Progress bar of a share in [0, 1]; it appears only after ``PATIENCE`` seconds, and only if ``shown``."""

    def __init__(self, label: str, shown: bool) -> None:
        self.label, self.shown = label, shown
        self.started = self.drawn = time.monotonic()
        self.bar: Any = None
        self.done = 0
        self.pace: tuple[float, Pace] | None = None  # start time of the first step, and the pace since
        self.steady = SteadyEstimate()

    def __enter__(self) -> Bar:
        return self

    def update(self, share: float, text: str = "", left: float | None = None) -> None:
        """Move to a share of the whole; ``text`` and the remaining time are shown next to the bar.

        ``left`` [s] is the remaining time, if it is known better than from the growth of the share; 0 if it is unknown.
        The time is shown once it has settled.
        """
        if not self.shown:
            return
        moment = time.monotonic()
        if self.pace is None:
            self.pace = moment, Pace(share)
        began, pace = self.pace
        pace.mark(share, moment - began)
        rest = self.steady(moment - began, pace.left(1.0) if left is None else left or None)
        if self.bar is None:
            if moment - self.started < PATIENCE:
                return
            self.bar = click.progressbar(length=STEPS, label=self.label, file=sys.stderr, show_eta=False,
                                         width=WIDTH, item_show_func=lambda shown: shown)
            self.bar.__enter__()
        now = min(int(STEPS * share), STEPS)
        if now > self.done or moment - self.drawn > REDRAW:
            parts = printable(text), f"{duration(rest)} left" if rest and share < 1.0 else ""
            self.bar.current_item = ", ".join(part for part in parts if part)
            self.bar.update(max(now - self.done, 0))
            self.bar.render_progress()
            self.done, self.drawn = max(now, self.done), moment

    def follow(self, share: float, left: float | None) -> None:
        """Update the bar with the progress of a study."""
        self.update(share, left=left)

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self.bar is not None:
            self.bar.__exit__(kind, value, trace)
