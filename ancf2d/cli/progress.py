"""A progress bar on stderr, for runs that take long enough to wait for."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

import click

PATIENCE = 0.7  # seconds before a bar is worth drawing
STEPS = 1000


class Bar:
    """Shows a share in [0, 1]; appears only after ``PATIENCE`` and only where ``shown``."""

    def __init__(self, label: str, shown: bool) -> None:
        self.label, self.shown = label, shown
        self.started = time.monotonic()
        self.bar: Any = None
        self.done = 0

    def __enter__(self) -> Bar:
        return self

    def update(self, share: float) -> None:
        """Move to a share of the whole."""
        if not self.shown or (self.bar is None and time.monotonic() - self.started < PATIENCE):
            return
        if self.bar is None:
            self.bar = click.progressbar(length=STEPS, label=self.label, file=sys.stderr)
            self.bar.__enter__()
        now = min(int(STEPS * share), STEPS)
        if now > self.done:
            self.bar.update(now - self.done)
            self.done = now

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self.bar is not None:
            self.bar.__exit__(kind, value, trace)
