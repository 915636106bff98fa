"""Options shared by all tests."""

from __future__ import annotations

import gc
import os
import signal
from typing import Any

import pytest

from ancf2d.study.pool import THREADS

# their first tests compile most: two at a time begin with unlike kernels, so that these are compiled once
FIRST = ("cli/test_cli_first_run", "docs/test_documents", "solve/test_reused_tangent", "kernels/test_element_kernels",
         "solve/test_rigid_motion", "solve/test_motion_orders", "solve/test_scipy_integrators",
         "solve/test_joints_dynamic", "solve/test_fronts_in_motion", "solve/test_step_allocations")

# the matrices of tests are small, and tests run beside each other: threads below numpy would only wait for cores
for _name in THREADS:
    os.environ.setdefault(_name, "1")

# a shell without job control starts what is put behind & with Ctrl-C ignored, and so would be all that tests start
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# compiling makes hundreds of thousands of objects of which few are garbage: looking for it takes a tenth of the time
gc.set_threshold(100_000, 50, 1000)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that compile most, while other processes have other things to do."""
    place = {f"{name}.py": k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(f"{item.path.parent.name}/{item.path.name}", len(FIRST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Run the tests of a file in one process: they share kernels, models and solutions."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --update: rewrite stored outputs and golden messages (review the difference before committing)."""
    parser.addoption("--update", action="store_true", default=False,
                     help="rewrite stored outputs and golden messages; review the difference")
