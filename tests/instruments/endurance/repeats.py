"""Repeated runs: a thousand in one process, in parallel processes, with other numbers of threads."""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from ancf2d.processors import THREADS
from ancf2d.results import open_results
from scripts.pages import table

from . import scenes

SWEEP = ("--over", "bodies.beam.element.count=2,4,6,8", "--over", "bodies.beam.section.height=0.1,0.11", "--jobs", "2",
         "--keep")


@dataclass
class Use:
    """What a process holds: memory (bytes), open files, threads."""

    memory: int
    files: int
    threads: int


def use() -> Use:
    """Return the memory, files and threads that this process holds, after garbage collection."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return Use(pages * os.sysconf("SC_PAGE_SIZE"), len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task")))


@dataclass
class Growth:
    """Runs in one process: resources after a tenth and after all, and the number of different results, by solver."""

    runs: int
    early: Use
    late: Use
    others: dict[str, int] = field(default_factory=dict)

    @property
    def per_run(self) -> float:
        """Bytes that each run left behind."""
        return (self.late.memory - self.early.memory) / (0.9 * self.runs)


def growth(runs: int, solvers: tuple[str, ...] = ("static", "eigen", "dynamic")) -> Growth:
    """Run cases in turn in this process and read each result; measure the resources that remain."""
    from ancf2d.case import load_case
    from ancf2d.results import describe
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
    """Return the table of resources that remain after runs in one process."""
    found = growth(runs)
    rows = [["memory", f"{found.early.memory / 1e6:.1f} MB", f"{found.late.memory / 1e6:.1f} MB"],
            ["open files", found.early.files, found.late.files], ["threads", found.early.threads, found.late.threads]]
    different = ", ".join(f"{solver} {count}" for solver, count in found.others.items())
    return (table(["held by the process", f"after {runs // 10} runs", f"after {runs}"], rows)
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
                                                         **dict.fromkeys(THREADS, str(n))))
                found.setdefault(solver, []).append(scenes.bits(out) if code == 0 else err)
    return found


def thread_report(counts: tuple[int, ...] = (8, 400)) -> str:
    """Return the table of results by numbers of threads."""
    rows = []
    for count in counts:
        rows += [[solver, count, len(found), len(set(found))] for solver, found in thread_bits(count).items()]
    return table(["solver", "elements", "processes (1, 2, 1, 2 threads)", "different results"], rows)


def cold(processes: int, solver: str = "static") -> dict[str, float]:
    """Run the same case in processes that share an empty cache; return the outcome."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = scenes.write(folder, "case", scenes.scenes()[solver])
        began = time.monotonic()
        # NUMBA_CACHE_DIR of the caller would hide the cache that is tried here
        running = [scenes.start(folder, "run", str(path), "-q", "-o", f"{k}.h5", XDG_CACHE_HOME=str(folder / "cache"),
                                NUMBA_CACHE_DIR="") for k in range(processes)]
        codes = [scenes.finished(p)[0] for p in running]
        seconds = time.monotonic() - began
        different = {scenes.bits(folder / f"{k}.h5") for k, code in enumerate(codes) if code == 0}
        return {"processes": processes, "succeeded": codes.count(0), "results": len(different), "seconds": seconds}


def sweeps(processes: int) -> dict[str, int]:
    """Run the same sweep in processes that share a folder, twice over; return the outcome."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = scenes.write(folder, "case", scenes.case({"type": "static"}))
        alone = scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "alone", "-q")
        assert scenes.finished(alone)[0] == 0
        wanted = {p.name: scenes.bits(p) for p in (folder / "alone").glob("runs/*.h5")}
        running = [scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "shared", "-q") for _ in range(processes)]
        codes = [scenes.finished(p)[0] for p in running]
        again = scenes.finished(scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "shared", "-q"))[0]
        found = {p.name: scenes.bits(p) for p in (folder / "shared").glob("runs/*.h5")}
        left = [p for p in (folder / "shared").iterdir() if p.suffix == ".part"]
        for p in (folder / "shared").glob("runs/*.h5"):
            with open_results(p) as r:
                assert r.status == "converged"
        shutil.rmtree(folder / "shared")
        return {"sweeps": processes, "succeeded": codes.count(0), "again": again, "results": len(found),
                "as alone": sum(found.get(k) == v for k, v in wanted.items()), "left over": len(left)}


def crowds_report(processes: int = 4) -> str:
    """Return the outcome of parallel processes in sentences."""
    c, s = cold(processes), sweeps(processes)
    return (f"{c['succeeded']} of {c['processes']} runs at once with an empty cache of kernels succeeded, in "
            f"{c['seconds']:.0f} s, with {c['results']} different result{'s' * (c['results'] != 1)}.\n\n"
            f"{s['succeeded']} of {s['sweeps']} equal sweeps at once with one folder of results succeeded; of the "
            f"{s['results']} files there, {s['as alone']} have the bits of a sweep alone, and {s['left over']} "
            f"unfinished ones were left over. A further sweep afterwards ended with {s['again']}.")
