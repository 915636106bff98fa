"""The same again: a thousand runs in one process, other processes, other numbers of threads."""

from __future__ import annotations

import gc
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from . import scenes


@dataclass
class Use:
    """What a process holds: memory (bytes), open files, threads."""

    memory: int
    files: int
    threads: int


def use() -> Use:
    """Return what this process holds now, after rubbish is collected."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return Use(pages * os.sysconf("SC_PAGE_SIZE"), len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task")))


@dataclass
class Growth:
    """Runs in one process: what was held after a tenth and after all, and how many results differ, by solver."""

    runs: int
    early: Use
    late: Use
    others: dict[str, int] = field(default_factory=dict)

    @property
    def per_run(self) -> float:
        """Bytes that a run left behind."""
        return (self.late.memory - self.early.memory) / (0.9 * self.runs)


def growth(runs: int, solvers: tuple[str, ...] = ("static", "eigen", "dynamic")) -> Growth:
    """Run cases in turn in this process, reading each result; measure what stays."""
    from ancf2d.case import load_case
    from ancf2d.results import describe, open_results
    from ancf2d.study.run import run_case, vocabulary

    first: dict[str, str] = {}
    others = dict.fromkeys(solvers, 0)
    early = use()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k in range(runs):
            solver = solvers[k % len(solvers)]
            path = scenes.write(folder, solver, scenes.scenes(4)[solver])
            out = folder / f"{solver}.h5"
            run_case(load_case(path, vocabulary=vocabulary()), str(out))
            describe(out)
            with open_results(out) as r:
                r.rows("d") if r.holds("d") and r.nt else r.arrays
            others[solver] += scenes.bits(out) != first.setdefault(solver, scenes.bits(out))
            if k == runs // 10:
                early = use()
    return Growth(runs, early, use(), others)


def growth_report(runs: int) -> str:
    """Return the table of what runs in one process leave behind."""
    found = growth(runs)
    rows = [["memory", f"{found.early.memory / 1e6:.1f} MB", f"{found.late.memory / 1e6:.1f} MB"],
            ["open files", found.early.files, found.late.files], ["threads", found.early.threads, found.late.threads]]
    different = ", ".join(f"{solver} {count}" for solver, count in found.others.items())
    return (scenes.table(["held by the process", f"after {runs // 10} runs", f"after {runs}"], rows)
            + f"\n\nRuns whose results differ in any bit from the first of their kind: {different}.")


def thread_bits(count: int, numbers: tuple[int, ...] = (1, 2)) -> dict[str, list[str]]:
    """Return, by solver, the bits of results in processes with other numbers of threads, twice each."""
    found: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for solver, data in scenes.scenes(count).items():
            path = scenes.write(folder, solver, data)
            for k, n in enumerate((*numbers, *numbers)):
                out = folder / f"{solver}-{k}.h5"
                code, err = scenes.finished(scenes.start(folder, "run", str(path), "-q", "-o", str(out),
                                                         **dict.fromkeys(scenes.THREADS, str(n))))
                found.setdefault(solver, []).append(scenes.bits(out) if code == 0 else err)
    return found


def thread_report(counts: tuple[int, ...] = (8, 400)) -> str:
    """Return the table of results by numbers of threads."""
    rows = []
    for count in counts:
        rows += [[solver, count, len(found), len(set(found))] for solver, found in thread_bits(count).items()]
    return scenes.table(["solver", "elements", "processes (1, 2, 1, 2 threads)", "different results"], rows)
