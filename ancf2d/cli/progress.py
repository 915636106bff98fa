"""A progress bar on stderr, for runs that take long enough to wait for."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

import click

from ..pace import Pace
from .text import duration, printable

PATIENCE = 0.7  # seconds before a bar is worth drawing
STEPS = 1000
WIDTH = 20  # with the text beside it, a bar fits 80 columns
REDRAW = 1.0  # seconds after which the text is drawn anew where the bar itself has not moved


class Bar:
    """Shows a share in [0, 1]; appears only after ``PATIENCE`` and only where ``shown``."""

    def __init__(self, label: str, shown: bool) -> None:
        self.label, self.shown = label, shown
        self.started = self.drawn = time.monotonic()
        self.bar: Any = None
        self.done = 0
        self.pace: tuple[float, Pace] | None = None  # when the first step began, and how fast it goes on since

    def __enter__(self) -> Bar:
        return self

    def update(self, share: float, text: str = "", left: float | None = None) -> None:
        """Move to a share of the whole; ``text`` and the time left stand beside the bar.

        ``left`` [s] is that time where it is known better than from how fast the share grows.
        """
        if not self.shown:
            return
        moment = time.monotonic()
        if self.pace is None:
            self.pace = moment, Pace(share)
        began, pace = self.pace
        pace.mark(share, moment - began)
        if self.bar is None:
            if moment - self.started < PATIENCE:
                return
            self.bar = click.progressbar(length=STEPS, label=self.label, file=sys.stderr, show_eta=False,
                                         width=WIDTH, item_show_func=lambda shown: shown)
            self.bar.__enter__()
        now = min(int(STEPS * share), STEPS)
        if now > self.done or moment - self.drawn > REDRAW:
            rest = pace.left(1.0) if left is None else left
            parts = printable(text), f"{duration(rest)} left" if rest and share < 1.0 else ""
            self.bar.current_item = ", ".join(part for part in parts if part)
            self.bar.update(max(now - self.done, 0))
            self.bar.render_progress()
            self.done, self.drawn = max(now, self.done), moment

    def follow(self, share: float, left: float | None) -> None:
        """Show the progress of a study."""
        self.update(share, left=left)

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self.bar is not None:
            self.bar.__exit__(kind, value, trace)
