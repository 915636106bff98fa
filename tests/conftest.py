"""Options shared by all tests."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import measured as tables
import pytest

from ancf2d.processors import cores
from ancf2d.study.pool import THREADS

# files of few slow tests that take longest: begun last, they would leave one of two processes without work at the end
FIRST = ("docs/test_documents", "study/test_study_fit", "cli/test_cli_first_run", "cli/test_cli_examples",
         "study/test_study_gradient", "robustness/test_beside_own_equations", "robustness/test_endurance",
         "scripts/test_paper_report",
         "view/test_view_browser", "solve/test_contact_of_mirrored_bodies", "verification/test_verification_cases",
         "api/test_api", "solve/test_welds_and_objectivity", "results/test_results_resume", "cli/test_cli_resume",
         "cli/test_cli_sweep")

# few tests need the kernels of motions with fronts, and of each material with memory
COMPILE = """
from ancf2d.study.every_kernel import compile_everything
compile_everything(wanted=lambda name: " of a frame" not in name and " that " not in name)
"""

COMPILING = pytest.StashKey["subprocess.Popen[bytes]"]()

# the matrices of tests are small, and tests run beside each other: threads below numpy would only wait for cores
for _name in THREADS:
    os.environ.setdefault(_name, "1")

# processes that tests start, and the next run of the tests, would each compile the same sources for a second or more
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# a shell without job control starts what is put behind & with Ctrl-C ignored, and so would be all that tests start
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# compiling makes hundreds of thousands of objects of which few are garbage: looking for it takes a tenth of the time
gc.set_threshold(100_000, 50, 1000)


def pytest_configure(config: pytest.Config) -> None:
    """Gather the rows of tables where these are asked for."""
    if config.getoption("pages") or config.getoption("trials") is not None:
        config.pluginmanager.register(tables.Measured(config))


pytest_generate_tests = tables.numbered


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files that take longest."""
    tables.wanted(config, items)
    place = {f"{name}.py": k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(f"{item.path.parent.name}/{item.path.name}", len(FIRST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """Begin to compile the kernels that processes would otherwise each compile, or wait for one another."""
    from ancf2d.kernels.lowlevel.jit import cache_is_cold

    everything = [Path(path).resolve() for path in config.args] == [config.rootpath / "tests"]
    if everything and cache_is_cold():
        # beside the collection of the tests, which leaves it most of the processors
        config.stash[COMPILING] = subprocess.Popen([sys.executable, "-c", COMPILE], cwd=config.rootpath,
                                                   env={**os.environ, "OMP_NUM_THREADS": str(cores())})


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Run the tests of a file in one process: they share kernels, models and solutions. Trials share none."""
    from xdist.scheduler import LoadFileScheduling

    if config.getoption("pages") or config.getoption("trials") is not None:
        return None

    class AfterCompiling(LoadFileScheduling):
        def schedule(self) -> None:
            compiling = config.stash.get(COMPILING, None)
            if compiling is not None and compiling.wait() != 0:
                raise pytest.UsageError("the kernels could not be compiled")
            super().schedule()

    config.option.loadscopereorder = False
    return AfterCompiling(config, log)


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
