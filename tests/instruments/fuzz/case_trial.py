"""The outcome of commands on one mutant of a case file."""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import FrameType

from ancf2d.errors import ResultsError
from scripts.pages import table

from . import case_mutants
from .command import CODES, INTERRUPTED, Called, call, told, unreal
from .pen import Ended, Limits, confined

SECONDS = 30.0  # of the processor's time within which a file must be validated
IMPORTED = ("ancf2d.kernels.elements", "ancf2d.kernels.motion.radau", "ancf2d.solvers.registry",
            "ancf2d.solvers.motion.dynamic", "ancf2d.results", "ancf2d.study.warmup", "scipy.integrate",
            "scipy.sparse.linalg", "click.testing")
PATIENCE = 2.0  # seconds of the processor's time until a run is interrupted
SHORT = "there is not enough memory for this"
# what is run although it was refused: as many of 100
REFUSED = 10


@dataclass
class Trial:
    """The outcome of one mutant: exit codes of validate and run (None: not run), seconds, and broken promises."""

    number: int
    validated: int = -1
    ran: int | None = None
    seconds: float = 0.0
    faults: list[str] = field(default_factory=list)


def trials(folder: Path, seed: int, numbers: range, limits: Limits | None = None) -> Iterator[tuple[Trial, Ended]]:
    """Yield the outcome of each mutant, tried in its own process in an empty folder."""
    def work(number: int) -> Trial:
        return examine(folder, seed, number)

    case_mutants.bases()
    # an import that is interrupted is lost to its process: here, the next mutant would meet what is left of it
    for name in IMPORTED:
        import_module(name)
    for number, ended in confined(work, numbers, limits or Limits(patience=2 * SECONDS)):
        trial = ended.value or Trial(number)
        trial.faults += [*([ended.fault] if ended.fault else []), *ended.notes]
        yield trial, ended


def report(count: int, seed: int = 1) -> str:
    """Return the table of outcomes of mutants of case files, and a line for each fault."""
    ends: Counter[tuple[int, int | None]] = Counter()
    faults, most, slowest, began = [], 0, 0.0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for trial, ended in trials(Path(folder), seed, range(count)):
            ends[trial.validated, trial.ran] += 1
            most, slowest = max(most, ended.memory), max(slowest, trial.seconds)
            faults += [f"{trial.number}: {fault}" for fault in trial.faults]
    checked, ran = Counter[int](), Counter[int | None]()
    for (first, then), n in ends.items():
        checked[first] += n
        ran[then] += n
    rows = [["validated", count, *(checked[code] for code in (0, 1, 2)), ""],
            ["run", count - ran[None], *(ran[code] for code in (0, 1, 2, INTERRUPTED))]]
    return (table(["", "mutants", "exit 0", "exit 1", "exit 2", "interrupted after 2 s: exit 130"], rows)
            + f"\n\nSeed {seed}; {time.monotonic() - began:.0f} s in all, {slowest:.1f} s for the slowest validation, "
            f"at most {most / 1e6:.0f} MB for one mutant. {told(faults)}")


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Interrupt a command that takes more processor time, as Ctrl-C would."""
    signal.signal(signal.SIGPROF, _interrupt)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, signal.SIG_IGN)


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        # before and after this, the interruption would be that of the trial
        if (frame.f_globals.get("__name__"), frame.f_code.co_name) == ("click.core", "invoke"):
            signal.raise_signal(signal.SIGINT)
            return
        frame = frame.f_back


def examine(folder: Path, seed: int, number: int) -> Trial:
    """Validate a mutant; run it where it is valid, and sometimes where it is not."""
    content, definition = case_mutants.mutant(seed, number)
    os.chdir(folder)
    for name in os.listdir():
        os.unlink(name)
    Path("case.yaml").write_bytes(content)
    Path("own.yaml").write_bytes(definition)
    trial, began = Trial(number), time.process_time()
    checked = call("validate", "case.yaml")
    trial.validated, trial.seconds = checked.code, time.process_time() - began
    # as many elements as a case may have need more than this process has: told, that is no fault
    trial.faults += checked.faults({0, 1, 2} if SHORT in checked.err else {0, 2})
    if trial.seconds > SECONDS:
        trial.faults.append(f"validate took {trial.seconds:.0f} s")
    if checked.code == 0 or number % 100 < REFUSED:
        with interrupted_after(PATIENCE):
            ran = call("run", "case.yaml", "-o", "case.h5", "--json")
        trial.ran = ran.code
        trial.faults += ran.faults({*CODES, INTERRUPTED}) + _left(checked, ran)
    return trial


def _left(checked: Called, ran: Called) -> list[str]:
    """Return the faults of files that a run left behind."""
    if (checked.code, ran.code) in ((0, 2), (2, 0), (2, 1)):
        return [f"validate ends with {checked.code}, run with {ran.code}: {ran.err.strip()[:300]}"]
    left = set(os.listdir()) - {"case.yaml", "own.yaml"}
    complete, nothing = {"case.h5"}, set[str]()
    # an interruption may come when all is done
    wanted = {0: [complete], INTERRUPTED: [complete, {"case.h5.part"}, nothing]}
    if left not in wanted.get(ran.code, [{"case.h5.part"}, nothing]):
        return [f"run ends with {ran.code} and leaves {sorted(left)}"]
    found = []
    for name in left:
        try:
            wrong = unreal(Path(name))
        except ResultsError as error:
            found.append(f"what run left cannot be read: {error}")
            continue
        if wrong and ran.code == 0:
            found.append(f"no numbers in a result: {', '.join(wrong[:5])}")
    return found
