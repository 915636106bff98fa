"""A progress bar on stderr, for runs that take long enough to wait for."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

import click

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
        self.first: tuple[float, float] | None = None  # where the first step began: moment, share

    def __enter__(self) -> Bar:
        return self

    def update(self, share: float, text: str = "") -> None:
        """Move to a share of the whole; ``text`` and an estimate of the time left stand beside the bar."""
        if not self.shown:
            return
        moment = time.monotonic()
        if self.first is None:
            self.first = (moment, share)
        if self.bar is None:
            if moment - self.started < PATIENCE:
                return
            self.bar = click.progressbar(length=STEPS, label=self.label, file=sys.stderr, show_eta=False,
                                         width=WIDTH, item_show_func=lambda shown: shown)
            self.bar.__enter__()
        now = min(int(STEPS * share), STEPS)
        if now > self.done or moment - self.drawn > REDRAW:
            self.bar.current_item = ", ".join(part for part in (printable(text), self._left(moment, share)) if part)
            self.bar.update(max(now - self.done, 0))
            self.bar.render_progress()
            self.done, self.drawn = max(now, self.done), moment

    def _left(self, moment: float, share: float) -> str:
        """Return the time left as far as it can be told: what is left takes as long, share by share, as what was."""
        began, first = self.first or (moment, share)
        if not first < share < 1.0 or moment - began < PATIENCE:
            return ""
        return f"{duration((moment - began) * (1.0 - share) / (share - first))} left"

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self.bar is not None:
            self.bar.__exit__(kind, value, trace)
