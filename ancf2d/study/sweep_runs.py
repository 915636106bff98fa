"""One variant of a case, run where its turn comes: in this process, another one, or on a cluster."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from .. import __version__
from ..case import CaseText, Goal, LoadedCase
from ..errors import UNSOLVED, ResultsError, verdict
from .accuracy.control import is_pursued, solve_to_accuracy
from .accuracy.pursuit import Target
from .digests import content_name, files_of
from .pool import DIED
from .record import Progress
from .run import run_case, vocabulary

# between two looks at a result that another process is writing
TURN_SECONDS = 0.1


@dataclass(frozen=True)
class Job:
    """A run that another process can do.

    ``output`` is its result file where ``keep`` is set. ``name`` is that of its result by content, ``kernels`` what it
    compiles, ``size`` elements times steps.
    """

    text: str
    file: str
    overrides: tuple[str, ...]
    goal: Goal | None
    output: str
    name: str
    kernels: str
    size: float
    command: str
    force: bool = False
    keep: bool = False

    def load(self) -> LoadedCase:
        """Return the case. Raises CaseError."""
        return _origin(self.text, self.file).load(self.overrides, vocabulary())


@lru_cache(1)
def _origin(text: str, file: str) -> CaseText:
    """Return the text that the jobs of a sweep have in common."""
    return CaseText(text, file, os.path.dirname(file))


def stored_summary(job: Job) -> dict[str, Any] | None:
    """Return the summary of a finished result of the same case by the same ancf2d, None where there is none."""
    from ..results import open_results

    if not os.path.exists(job.output):
        return None
    try:
        with open_results(job.output) as found:
            # the name tells the case; that the file is what its name says is asked of what it holds
            same = content_name(found.case_completed, files_of(job.load())) == job.name
            if found.status != "converged" or found.attrs.get("version_ancf2d") != __version__ or not same:
                return None
            return {**found.summary, "output": job.output}
    except ResultsError:
        return None


def solve_job(job: Job, progress: Progress | None = None) -> dict[str, Any]:
    """Run one case and return its summary; what fails is told in it."""
    try:
        return _solve_in_turn(job, progress)
    except UNSOLVED as error:
        status, reason = verdict(error)
        return {"status": status, "reason": reason}
    except ResultsError as error:
        return {"status": "failed", "reason": str(error)}
    except Exception as error:
        # a row among thousands: the others are not given up for it
        return {"status": "failed", "reason": f"internal error, please report: {type(error).__name__}: {error}"}


def _solve_in_turn(job: Job, progress: Progress | None) -> dict[str, Any]:
    """Run one case, or wait for another process that runs it, and take its result."""
    from ..results.target import BusyError

    while True:
        try:
            return _solve(job, progress)
        except BusyError:
            time.sleep(TURN_SECONDS)
        summary = None if job.force else stored_summary(job)
        if summary is not None:
            return summary


def _solve(job: Job, progress: Progress | None) -> dict[str, Any]:
    from ..results import part_path

    loaded, place = job.load(), Path(job.output)
    if not job.keep:
        folder = place.parents[1]
        checkpoints = folder / f"{job.name}.checkpoint" if folder.is_dir() else None
        if job.force and checkpoints is not None:
            checkpoints.unlink(missing_ok=True)
        if is_pursued(loaded):
            return _judged(solve_to_accuracy(loaded).outcome.summary)
        return run_case(loaded, progress=progress, checkpoints=checkpoints).summary
    if not place.parent.is_dir():
        raise ResultsError(f"there is no folder '{place.parent}' on this worker; several machines need "
                           "a shared folder")
    options: dict[str, Any] = {"force": job.force or _left_over(job.output), "command": job.command}
    if is_pursued(loaded):
        return _judged(solve_to_accuracy(loaded, Target(job.output, **options)).outcome.summary)
    if not job.force and loaded.case.solver.moves and part_path(job.output).exists():
        try:
            return run_case(loaded, job.output, resume=True, progress=progress, **options).summary
        except ResultsError:
            # left by other options or an unreadable file: it is replaced
            pass
    return run_case(loaded, job.output, progress=progress, **options).summary


def _judged(summary: dict[str, Any]) -> dict[str, Any]:
    """Return a summary as that of a failure where the wanted accuracy was not reached."""
    wanted = summary["accuracy"]["wanted"]
    short = {"status": "failed", "reason": f"the wanted accuracy {wanted:g} was not reached"}
    return {**summary, **(short if fell_short(summary) else {})}


def fell_short(summary: dict[str, Any]) -> bool:
    """Whether a run has a value, but not with the accuracy that its case asks for."""
    return (summary.get("accuracy") or {}).get("achieved") is False


def _left_over(output: str) -> bool:
    """Return whether a file under the name of a result, which no one else gives, is one or the beginning of one."""
    from ..results.safe import SIGNATURE

    try:
        with open(output, "rb") as stream:
            return SIGNATURE.startswith(stream.read(len(SIGNATURE)))
    except OSError:
        return False


def lost(job: Job) -> dict[str, Any]:
    """Return the summary of a case whose process died."""
    return {"status": "failed", "reason": DIED}
