"""Runs of single variants of a case: in this process, in another one, or on a cluster."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from .. import __version__
from ..case import CaseText, Goal, LoadedCase
from ..errors import UNSOLVED, ResultsError, WriteError, verdict
from ..model.model import Model
from .accuracy.control import is_pursued, solve_to_accuracy
from .digests import content_name, files_of
from .goal import Target
from .pool import DIED
from .record import Progress
from .run import run_case, vocabulary

# interval of checking for a result that another process is writing
TURN_SECONDS = 0.1
# largest number of elements of a model that is kept for the next variant
SMALL = 20_000


@dataclass(frozen=True)
class Job:
    """A run that another process can do.

    ``output`` is its result file if ``keep`` is set. ``name`` identifies its result by content, ``kernels`` the kernels
    it compiles, ``size`` is elements times steps. ``loaded`` is the case, which other processes read from the text.
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
    loaded: LoadedCase | None = field(default=None, repr=False, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state to send to another process, without the case."""
        return {**vars(self), "loaded": None}

    def load(self) -> LoadedCase:
        """Return the case. Raises CaseError."""
        return self.loaded or _origin(self.text, self.file).load(self.overrides, vocabulary())


@lru_cache(1)
def _origin(text: str, file: str) -> CaseText:
    """Return the parsed text that all jobs of a sweep share."""
    return CaseText(text, file, os.path.dirname(file))


class _Last:
    """The model of the variant that this process has run last; the next variant reuses its unchanged parts.

    It is not kept if it is large, where building a model takes a small share of the solve.
    """

    def __init__(self) -> None:
        self.text = ""
        self.model: Model | None = None

    def run(self, job: Job, loaded: LoadedCase, *args: Any, **options: Any) -> dict[str, Any]:
        """Run a case and return the summary of ``run_case``."""
        like, self.model = self.model if job.text == self.text else None, None
        outcome = run_case(loaded, *args, like=like, kernels=job.kernels, **options)
        model = outcome.model
        if model.n_elements <= SMALL:
            # the model's own predecessor is not needed any longer
            model.like = None
            self.text, self.model = job.text, model
        return outcome.summary


_last = _Last()


def stored_summary(job: Job) -> dict[str, Any] | None:
    """Return the summary of a finished result of the same case by the same ancf2d, or None if there is none."""
    from ..results import open_results

    if not os.path.exists(job.output):
        return None
    try:
        with open_results(job.output) as found:
            # the name identifies the case; check that the content of the file matches its name
            same = content_name(found.case_completed, files_of(job.load())) == job.name
            if found.status != "converged" or found.attrs.get("version_ancf2d") != __version__ or not same:
                return None
            return {**found.summary, "output": job.output}
    except ResultsError:
        return None


def solve_job(job: Job, progress: Progress | None = None) -> dict[str, Any]:
    """Run one case and return its summary; a failure is reported in the summary."""
    try:
        return _solve_in_turn(job, progress)
    except UNSOLVED as error:
        status, reason = verdict(error)
        return {"status": status, "reason": reason}
    except ResultsError as error:
        return {"status": "failed", "reason": str(error)}
    except Exception as error:
        # one row among thousands: an internal error in it must not stop the others
        return {"status": "failed", "reason": f"internal error, please report: {type(error).__name__}: {error}"}


def _solve_in_turn(job: Job, progress: Progress | None) -> dict[str, Any]:
    """Run one case; if another process is running it, wait and take over its result."""
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

    loaded = job.load()
    if not job.keep:
        checkpoints = _checkpoints(job) if loaded.case.solver.timed else None
        if is_pursued(loaded):
            return _with_status(solve_to_accuracy(loaded).outcome.summary)
        return _last.run(job, loaded, progress=progress, checkpoints=checkpoints, brief=True)
    folder = Path(job.output).parent
    if not folder.is_dir():
        raise ResultsError(f"there is no folder '{folder}' on this worker; several machines need a shared folder")
    options: dict[str, Any] = {"force": job.force or _left_over(job.output), "command": job.command}
    if is_pursued(loaded):
        return _with_status(solve_to_accuracy(loaded, Target(job.output, **options)).outcome.summary)
    if not job.force and loaded.case.solver.moves and part_path(job.output).exists():
        try:
            return _last.run(job, loaded, job.output, resume=True, progress=progress, **options)
        except WriteError:
            raise
        except ResultsError:
            # the unfinished file was written with other options or is unreadable: it is replaced
            pass
    return _last.run(job, loaded, job.output, progress=progress, **options)


def _checkpoints(job: Job) -> Path | None:
    """Return the checkpoint file of a run over time (``force`` deletes it), or None if there is no folder."""
    folder = Path(job.output).parents[1]
    found = folder / f"{job.name}.checkpoint" if folder.is_dir() else None
    if job.force and found is not None:
        found.unlink(missing_ok=True)
    return found


def _with_status(summary: dict[str, Any]) -> dict[str, Any]:
    """Return a summary with status 'failed' if the wanted accuracy was not reached."""
    wanted = summary["accuracy"]["wanted"]
    short = {"status": "failed", "reason": f"the wanted accuracy {wanted:g} was not reached"}
    return {**summary, **(short if fell_short(summary) else {})}


def fell_short(summary: dict[str, Any]) -> bool:
    """Return whether a run yields a value, but not with the accuracy that its case asks for."""
    return (summary.get("accuracy") or {}).get("achieved") is False


def _left_over(output: str) -> bool:
    """Return whether the file is a result file or the beginning of one, and may therefore be overwritten."""
    from ..results.safe import SIGNATURE

    try:
        with open(output, "rb") as stream:
            return SIGNATURE.startswith(stream.read(len(SIGNATURE)))
    except OSError:
        return False


def summary_of_lost(job: Job) -> dict[str, Any]:
    """Return the summary of a case whose process died."""
    return {"status": "failed", "reason": DIED}
