"""Options shared by all tests."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import measured as tables
import pytest

from ancf2d.processors import cores
from scripts.pages import one_thread

# files of few slow tests that take longest: begun last, they would leave one of two processes without work at the end
FIRST = ("docs/test_documents", "study/test_study_fit", "cli/test_cli_first_run", "cli/test_cli_examples",
         "study/test_study_optimise", "solve/test_friction_between_bodies",
         "study/test_study_gradient", "robustness/test_independent_equations", "robustness/test_endurance",
         "scripts/test_paper_report",
         "view/test_view_browser", "solve/test_contact_of_mirrored_bodies", "verification/test_verification_cases",
         "api/test_api", "solve/test_welds_and_objectivity", "results/test_results_resume", "cli/test_cli_resume",
         "cli/test_cli_sweep")

# few tests need the kernels of motions with fronts, and of each material with memory
COMPILE = """
from ancf2d.study.every_kernel import compile_everything
compile_everything(wanted=lambda name: " of a frame" not in name and " that " not in name)
"""

# folders whose tests need no kernels, and run while these are compiled; but for some files
EARLY = ("case", "elements", "results", "docs", "test_layers.py")
LATER = ("test_valid.py", "test_discrete_jacobians.py", "test_energies.py", "test_strain_functions.py")

COMPILING = pytest.StashKey["Compiling"]()

# the matrices of tests are small, and tests run beside each other: threads below numpy would only wait for cores.
# Nothing above may import numpy, for which it would be too late
one_thread()

# processes that tests start, and the next run of the tests, would each compile the same sources for a second or more
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# a shell without job control starts what is put behind & with Ctrl-C ignored, and so would be all that tests start
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# compiling makes hundreds of thousands of objects of which few are garbage: looking for it takes a tenth of the time
gc.set_threshold(100_000, 50, 1000)


class Compiling:
    """A process that compiles kernels; the file ``over`` exists once it has ended."""

    def __init__(self, folder: Path) -> None:
        self._place = TemporaryDirectory()
        self.over = Path(self._place.name, "over")
        # beside tests that need none of them, and the collection of all
        self._process = subprocess.Popen([sys.executable, "-c", COMPILE], cwd=folder,
                                         env={**os.environ, "OMP_NUM_THREADS": str(cores())})
        self._waiting = threading.Thread(target=self._wait)
        self._waiting.start()

    def _wait(self) -> None:
        self._process.wait()
        self.over.touch()

    def end(self) -> int:
        """Wait for the process; return its exit code."""
        self._waiting.join()
        self._place.cleanup()
        return self._process.returncode


@cache
def is_early(path: Path) -> bool:
    """Whether a test file runs while kernels are compiled."""
    return path.relative_to(Path(__file__).parent).parts[0] in EARLY and path.name not in LATER


def pytest_configure(config: pytest.Config) -> None:
    """Gather the rows of tables if ``--pages`` is given."""
    if config.getoption("pages") or config.getoption("trials") is not None:
        config.pluginmanager.register(tables.Measured(config))


pytest_generate_tests = tables.numbered


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(collector: Any, name: str, obj: Any) -> list[pytest.Item] | None:
    """Make no tests that would all be left out: of the thousands of both tiers, every process makes its own.

    Marks of a test, its rows, class and module count, not those of rows of fixtures: give these by ``indirect``.
    """
    option, marks = collector.config.getoption, [*getattr(obj, "pytestmark", ()), *collector.iter_markers()]
    names = {mark.name for mark in marks}
    left_out = "pages" in names and not option("pages")
    if option("markexpr") == "not slow":
        left_out |= "slow" in names
    elif option("markexpr") == "slow" and not {"slow", "slow_rows"} & names:
        rows = [row for mark in marks if mark.name in ("parametrize", "trials") for row in mark.args[-1]]
        left_out |= not any(mark.name == "slow" for row in rows for mark in getattr(row, "marks", ()))
    return [] if left_out and name.startswith("test_") else None


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark the rows as slow that a mark ``slow_rows`` names."""
    if any(item.callspec.id in mark.args for mark in item.iter_markers("slow_rows")):
        item.add_marker("slow")


def check_slow_rows(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Raise UsageError if a mark ``slow_rows`` names a row that its test does not have."""
    if any("::" in path for path in config.args):
        return
    lacking = {(item.nodeid.split("[")[0], row) for item in items for mark in item.iter_markers("slow_rows")
               for row in mark.args} - {(item.nodeid.split("[")[0], item.callspec.id) for item in items
                                        if hasattr(item, "callspec")}
    if lacking:
        raise pytest.UsageError(f"slow_rows names rows that are not there: {sorted(lacking)}")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start with the slowest files; before them, in the quick tier, with files that need no kernels."""
    tables.wanted(config, items)
    check_slow_rows(config, items)
    place = {f"{name}.py": k for k, name in enumerate(FIRST)}
    quick = config.getoption("markexpr") == "not slow"

    def rank(item: pytest.Item) -> int:
        later = place.get(f"{item.path.parent.name}/{item.path.name}", len(FIRST))
        return -1 if quick and is_early(item.path) else later
    items.sort(key=rank)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """Start compiling kernels that each process would otherwise compile or wait for."""
    from ancf2d.kernels.lowlevel.jit import cache_is_cold

    everything = [Path(path).resolve() for path in config.args] == [config.rootpath / "tests"]
    if everything and cache_is_cold():
        config.stash[COMPILING] = Compiling(config.rootpath)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Tell a test process what to wait for."""
    if COMPILING in node.config.stash:
        node.workerinput["compiled"] = str(node.config.stash[COMPILING].over)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Wait for kernels before a test that may need some, outside the time limit of the test."""
    compiled = getattr(item.config, "workerinput", {}).get("compiled")
    while compiled is not None and not is_early(item.path) and not Path(compiled).exists():
        time.sleep(0.1)
    return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if the kernels could not be compiled."""
    if COMPILING in session.config.stash and session.config.stash[COMPILING].end() != 0:
        pytest.exit("the kernels could not be compiled", returncode=1)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Run the tests of a file in one process: they share kernels, models and solutions. Trials share none."""
    from xdist.scheduler import LoadFileScheduling

    if config.getoption("pages") or config.getoption("trials") is not None:
        return None
    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --update: rewrite stored outputs and golden messages (review the difference before committing)."""
    parser.addoption("--update", action="store_true", default=False,
                     help="rewrite stored outputs and golden messages; review the difference")
    tables.options(parser)


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Return a function that notes a row, or the text, of a place of a page, or of none.

    ``maker`` (MODULE:FUNCTION) makes the text of all rows.
    """
    def note(page: str, place: str, row: Any, maker: str = "") -> None:
        request.node.user_properties.append(("measured", (page, place, maker, row)))

    return note
