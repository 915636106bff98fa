"""Work on hostile input in a separate process: limited in memory, interrupted, then killed, never trusted."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import resource
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

GRACE = 30.0  # seconds after an interruption in which work must have ended
# by the clock, work on a machine that others share may take so many times the processor's time
SHARED = 4.0
MEMORY = 2 << 30  # bytes that work may use beyond what its process uses before


@dataclass
class Limits:
    """Processor seconds until work is interrupted, and from then until it is killed; bytes of memory."""

    patience: float = 2.0
    grace: float = GRACE
    memory: int = MEMORY


@dataclass
class Ended:
    """The end of one piece of work: its return value, or why there is none."""

    value: Any = None
    fault: str = ""
    memory: int = 0
    notes: list[str] = field(default_factory=list)


def confined(work: Callable[[Any], Any], jobs: Iterable[Any], limits: Limits) -> Iterator[tuple[Any, Ended]]:
    """Yield each job with its end, done one after the other in a forked process.

    The process is replaced when it dies, hangs or has used much memory, so that jobs do not see each other.
    """
    context = multiprocessing.get_context("fork")
    process: Any = None
    here: Connection | None = None
    try:
        for job in jobs:
            if process is None:
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(work, there, limits.memory), daemon=True)
                process.start()
                there.close()
            assert here is not None
            ended = _one(process, here, job, limits)
            if ended.fault or ended.memory > limits.memory // 8:
                _stop(process)
                process = None
            yield job, ended
    finally:
        if process is not None:
            _stop(process)


def _one(process: Any, here: Connection, job: Any, limits: Limits) -> Ended:
    """Hand a job to the process and wait for its end."""
    here.send(job)
    try:
        if not _ends_within(limits.patience, process, here):
            os.kill(process.pid, signal.SIGINT)
            if not _ends_within(limits.grace, process, here):
                return Ended(fault=f"went on for {limits.grace:.0f} s after it was interrupted")
        found: Ended = here.recv()
        return found
    except (EOFError, OSError):
        process.join()
        code = process.exitcode
        return Ended(fault=f"its process was ended by {signal.Signals(-code).name}" if code < 0 else
                     f"its process ended with {code}")


def _ends_within(seconds: float, process: Any, here: Connection) -> bool:
    """Wait until work has ended or its time has run out."""
    used, began = _processor_time(process.pid), time.monotonic()
    while not here.poll(min(0.2, seconds)):
        if _processor_time(process.pid) - used > seconds or time.monotonic() - began > SHARED * seconds:
            return False
    return True


def _processor_time(pid: int) -> float:
    """Return the processor seconds of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _stop(process: Any) -> None:
    process.kill()
    process.join()


def _serve(work: Callable[[Any], Any], there: Connection, memory: int) -> None:
    """Do incoming jobs until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_AS, (_status("VmSize") + memory, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    while True:
        with contextlib.suppress(KeyboardInterrupt):  # one that comes late, after the work has ended
            try:
                job = there.recv()
            except EOFError:
                return
            there.send(_confess(work, job))


def _confess(work: Callable[[Any], Any], job: Any) -> Ended:
    """Do one job; report its outcome and the memory it took."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak is that of this job
    before = _status("VmRSS")
    ended = Ended()
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ended.value = work(job)
    except KeyboardInterrupt:
        ended.notes.append("interrupted outside of a command")
    except BaseException as error:
        ended.fault = f"{type(error).__name__}: {error}"
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    ended.memory = max(0, _status("VmHWM") - before)
    return ended


def _status(name: str) -> int:
    """Return a size (bytes) of this process from /proc."""
    for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) * 1024
    return 0
