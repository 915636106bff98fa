"""Processes at once: with an empty cache of kernels, and with one folder of results."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path

from ancf2d.results import open_results

from . import scenes

SWEEP = ("--over", "bodies.beam.element.count=2,4,6,8", "--over", "bodies.beam.section.height=0.1,0.11", "--jobs", "2")


def cold(processes: int, solver: str = "static") -> dict[str, float]:
    """Run the same case in processes that share an empty cache; return what came of it."""
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
    """Run the same sweep in processes that share a folder, twice over; return what came of it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = scenes.write(folder, "case", scenes.case({"type": "static"}))
        alone = scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "alone", "-q")
        assert scenes.finished(alone)[0] == 0
        wanted = {p.name: scenes.bits(p) for p in (folder / "alone").glob("*.h5")}
        running = [scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "shared", "-q") for _ in range(processes)]
        codes = [scenes.finished(p)[0] for p in running]
        again = scenes.finished(scenes.start(folder, "sweep", str(path), *SWEEP, "-o", "shared", "-q"))[0]
        found = {p.name: scenes.bits(p) for p in (folder / "shared").glob("*.h5")}
        left = [p for p in (folder / "shared").iterdir() if p.suffix == ".part"]
        for p in (folder / "shared").glob("*.h5"):
            with open_results(p) as r:
                assert r.status == "converged"
        shutil.rmtree(folder / "shared")
        return {"sweeps": processes, "succeeded": codes.count(0), "again": again, "results": len(found),
                "as alone": sum(found.get(k) == v for k, v in wanted.items()), "left over": len(left)}


def report(processes: int = 4) -> str:
    """Return what came of processes at once, in sentences."""
    c, s = cold(processes), sweeps(processes)
    return (f"{c['succeeded']} of {c['processes']} runs at once with an empty cache of kernels succeeded, in "
            f"{c['seconds']:.0f} s, with {c['results']} different result{'s' * (c['results'] != 1)}.\n\n"
            f"{s['succeeded']} of {s['sweeps']} equal sweeps at once with one folder of results succeeded; of the "
            f"{s['results']} files there, {s['as alone']} have the bits of a sweep alone, and {s['left over']} "
            f"unfinished ones were left over. A further sweep afterwards ended with {s['again']}.")
