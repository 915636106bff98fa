"""Options shared by all tests."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --update: rewrite stored outputs and golden messages (review the difference before committing)."""
    parser.addoption("--update", action="store_true", default=False,
                     help="rewrite stored outputs and golden messages; review the difference")
