"""Options shared by all tests."""

from __future__ import annotations

import os
import signal

import pytest

from ancf2d.study.pool import THREADS

# the matrices of tests are small, and tests run beside each other: threads below numpy would only wait for cores
for _name in THREADS:
    os.environ.setdefault(_name, "1")

# a shell without job control starts what is put behind & with Ctrl-C ignored, and so would be all that tests start
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --update: rewrite stored outputs and golden messages (review the difference before committing)."""
    parser.addoption("--update", action="store_true", default=False,
                     help="rewrite stored outputs and golden messages; review the difference")
