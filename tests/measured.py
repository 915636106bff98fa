"""Tables of docs/ that are made from the results of tests.

The fixture ``measured`` notes a row, in whatever process a test runs. ``--pages`` writes the tables; ``--trials`` says
how many trials of each random kind there are.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import pytest

from scripts.pages import DOCS, stamp, write


def options(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("random trials, and tables of docs/")
    group.addoption("--trials", type=int, help="run random trials alone, so many of each kind that is chosen")
    group.addoption("--first", type=int, default=0, help="number of the first trial")
    group.addoption("--seed", type=int, default=1, help="of the trials")
    group.addoption("--pages", action="store_true", help="run what makes tables of docs/ alone, and write them")


def numbered(metafunc: pytest.Metafunc) -> None:
    """Number the trials of a test with the mark ``trials``: as many as requested, or the few of the mark."""
    mark, config = metafunc.definition.get_closest_marker("trials"), metafunc.config
    if mark is not None:
        first, count = config.getoption("first"), config.getoption("trials")
        metafunc.parametrize("number", mark.args[0] if count is None else range(first, first + count))


def wanted(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the requested tests: tests that only make tables run with ``--pages``, and then no others."""
    marks = {"trials"} if config.getoption("trials") is not None else set()
    marks |= {"pages", "trials"} if config.getoption("pages") else set()
    others = [item for item in items if (not any(item.get_closest_marker(mark) for mark in marks) if marks else
                                         item.get_closest_marker("pages"))]
    if others:
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if item not in set(others)]


class Measured:
    """Gathers the rows of each table, and prints or writes it at the end; with -k, those of many tests are printed."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.rows: dict[tuple[str, str, str], list[Any]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Store the rows that a test has noted."""
        if report.when == "call":
            for name, note in report.user_properties:
                if name == "measured":
                    *table, row = note
                    self.rows.setdefault(tuple(table), []).append(row)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Make the tables."""
        for (page, place, maker), rows in self.rows.items():
            module, _, function = maker.rpartition(":")
            text = getattr(import_module(module), function)(rows) if maker else rows[0]
            terminalreporter.write_line(f"\n{place}\n\n{text}")
            part = maker and self.config.getoption("keyword")
            if page and self.config.getoption("pages") and not part:
                path = DOCS / page
                made = stamp(" ".join(["pytest", *self.config.invocation_params.args]), "h5py")
                if "<!-- measured: stamp -->" in path.read_text(encoding="utf-8"):
                    write(path, "stamp", made)
                    write(path, place, text)
                else:
                    write(path, place, f"{text}\n\n{made}")
