"""Commands stopped at random moments, and full disks: files are complete or absent."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results import open_results
from scripts.pages import table

from . import scenes

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
# each with about how long it takes (s), so that moments fall into all of it
COMMANDS: dict[str, tuple[list[str], float]] = {
    "run": (["run", "long.yaml", "-o", "out.h5", "-q"], 4.0),
    "sweep": (["sweep", "static.yaml", "--over", "bodies.beam.element.count=" + ",".join(map(str, range(8, 64))),
               "--jobs", "2", "-o", "out", "-q"], 5.0),
    "convergence": (["convergence", "static.yaml", "--elements", "8,16,32,64,128,256", "-o", "out.h5", "-q"], 3.0),
    "tradeoff": (["tradeoff", "static.yaml", "--element", "reissner3,cable,2d2n", "--elements", "2,4,8,16", "--budget",
                  "3s", "-o", "out.h5", "-q"], 4.0),
    "plot": (["plot", "sound.h5", "--save", "out.png", "-q"], 3.0),
    "plot --animate": (["plot", "sound.h5", "--animate", "out.gif", "--frames", "20", "-q"], 4.0),
    "export": (["export", "sound.h5", "out.vtkhdf", "-q"], 1.5),
    "view": (["view", "sound.h5", "--save", "out.html", "-q"], 1.5),
    "audit": (["audit", "2d2n", "-q"], 3.0),
}
WRITERS = [name for name in COMMANDS if name != "audit"]
ALLOWED = {signal.SIGINT: {0, 130, -signal.SIGINT}, signal.SIGTERM: {0, -signal.SIGTERM},
           signal.SIGKILL: {-signal.SIGKILL, 0}}
ENDINGS = {".png": b"IEND\xaeB`\x82", ".html": b"</html>\n", ".gif": b";"}


@dataclass
class Stopped:
    """Outcome of stopping a command: exit codes, files left, and faults."""

    codes: Counter[int] = field(default_factory=Counter)
    left: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


@contextmanager
def workshop() -> Iterator[Path]:
    """Yield a folder with cases and a result for commands to work on."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenes.write(folder, "long", scenes.LONG)
        for solver in ("static", "dynamic"):
            scenes.write(folder, solver, scenes.scenes()[solver])
        # the second one has its kernels compiled before it is stopped
        for arguments in (["dynamic.yaml", "-o", "sound.h5"],
                          ["long.yaml", "-o", "short.h5", "--set", "solver.t_end=0.01"]):
            code, err = scenes.finished(scenes.start(folder, "run", *arguments, "-q"))
            if code:
                raise RuntimeError(err)
        yield folder


def stop(folder: Path, command: str, how: signal.Signals, after: float) -> tuple[int, str, list[str]]:
    """Stop a command; return its exit code, the files it left, and their faults."""
    for old in folder.glob("out*"):
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    before = set(folder.iterdir())
    process = scenes.start(folder, *COMMANDS[command][0])
    time.sleep(after)
    process.send_signal(how)
    # a kernel that is being compiled is waited for
    code, err = scenes.finished(process, 300)
    faults = [] if code in ALLOWED[how] else [f"{command} stopped by {how.name} ends with {code}: {err[-300:]}"]
    faults += [f"{command} stopped by {how.name}: {err[-300:]}"] if "Traceback" in err or "internal" in err else []
    files = _files(set(folder.iterdir()) - before)
    faults += [f"{command} stopped by {how.name} leaves {p.name}: {wrong}" for p in files if (wrong := damage(p))]
    return code, "nothing" if not files else "whole" if code == 0 else "readable", faults


def _files(found: Iterable[Path]) -> list[Path]:
    """Return files, also those in subfolders."""
    return [p for new in found for p in ([new] if new.is_file() else new.rglob("*")) if p.is_file()]


def damage(path: Path) -> str:
    """Return the fault of a file that was left, empty if it is complete."""
    if path.name.startswith("."):  # private to the process, and never anyone's result
        return ""
    if path.suffix in ENDINGS:
        return "" if path.read_bytes().endswith(ENDINGS[path.suffix]) else "not written to its end"
    if path.suffix in (".h5", ".part"):
        try:
            with open_results(path) as r:
                r.rows("d") if r.nt and r.holds("d") else r.arrays
        except ResultsError as error:
            return str(error)
        return ""
    if path.suffix == ".vtkhdf":
        import h5py

        try:
            with h5py.File(path) as file:
                return "" if "VTKHDF" in file else "without its data"
        except OSError as error:
            return str(error)
    if path.suffix == ".rows":  # a line of JSON each, of which only the last may be cut
        try:
            for line in path.read_text(encoding="utf-8").split("\n")[:-1]:
                json.loads(line)
        except ValueError as error:
            return str(error)
        return ""
    return "" if path.suffix in (".lock", ".csv") else "unknown"


def stops(count: int, seed: int = 1) -> dict[str, Stopped]:
    """Stop each command so many times by each signal, at random moments."""
    rng, found = random.Random(seed), {name: Stopped() for name in COMMANDS}
    with workshop() as folder:
        for name, seen in found.items():
            for how in SIGNALS:
                for _ in range(count):
                    code, left, faults = stop(folder, name, how, rng.uniform(0.05, COMMANDS[name][1]))
                    seen.codes[code] += 1
                    seen.left[left] += 1
                    seen.faults += faults
    return found


def stops_report(count: int) -> str:
    """Return the table of commands that were stopped."""
    found = stops(count)
    rows = [[name, sum(s.codes.values()), s.left["nothing"], s.left["readable"], s.left["whole"], len(s.faults)]
            for name, s in found.items()]
    faults = [f for s in found.values() for f in s.faults]
    return table(["command", "stopped", "left nothing", "left what is readable", "had ended", "faults"],
                          rows) + "".join(f"\n* {f}" for f in faults)


@contextmanager
def small_disk(kilobytes: int, read_only: bool = False) -> Iterator[Path | None]:
    """Yield a folder on a small disk of its own, None if none can be mounted."""
    place = Path(tempfile.mkdtemp())
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(place)]
    mounted = subprocess.run(mount, capture_output=True).returncode
    try:
        if mounted == 0 and read_only:
            subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True, capture_output=True)
        yield None if mounted else place
    finally:
        if mounted == 0:
            subprocess.run(["umount", str(place)], check=True, capture_output=True)
        place.rmdir()


def full_disk(kilobytes: int) -> list[str]:
    """Run every command that writes on a full disk; return the faults of their ends."""
    faults: list[str] = []
    with workshop() as folder:
        for name in WRITERS:
            with small_disk(kilobytes) as place:
                if place is None:
                    return ["no disk can be mounted here"]
                faults += _ends_well(folder, place, name)
    return faults


def _ends_well(folder: Path, place: Path, command: str) -> list[str]:
    arguments = [str(place / a) if a.startswith("out") else a for a in COMMANDS[command][0]]
    code, err = scenes.finished(scenes.start(folder, *arguments), 120)
    return _faults(command, code, err, _files([place]))


def _faults(command: str, code: int, err: str, files: list[Path]) -> list[str]:
    if code == 0 and files:  # there was room for all of it
        return [f"{command} leaves {p.name}: {wrong}" for p in files if (wrong := damage(p))]
    faults = [] if code in (1, 2) else [f"{command} on a full disk ends with {code}: {err[-300:]}"]
    faults += [f"{command}: {err[-300:]}"] if "Traceback" in err or "internal" in err or not err.strip() else []
    return faults + [f"{command} leaves {p.name}: {wrong}" for p in files if (wrong := damage(p))]


def file_limit(kilobytes: int) -> list[str]:
    """Run every command under a limit on the size of files; return the faults of their ends."""
    faults: list[str] = []
    with workshop() as folder:
        for name in WRITERS:
            arguments = COMMANDS[name][0]
            for old in folder.glob("out*"):
                shutil.rmtree(old) if old.is_dir() else old.unlink()
            limit = (kilobytes * 1024, kilobytes * 1024)
            before = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit[0], before[1]))
            try:
                # Python would keep the first half of the bytecode of what it imports, and not import it again
                process = scenes.start(folder, *arguments, PYTHONDONTWRITEBYTECODE="1")
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, before)
            code, err = scenes.finished(process, 120)
            new = _files(folder.glob("out*"))
            faults += _faults(name, code, err, new)
    return faults


def read_only() -> list[str]:
    """Run every command in a read-only folder; return the faults of their ends."""
    faults: list[str] = []
    with workshop() as folder, small_disk(1000, read_only=True) as place:
        if place is None:
            return ["no disk can be mounted here"]
        for name in WRITERS:
            faults += _ends_well(folder, place, name)
    return faults


def places_report() -> str:
    """Return the table of full disks and read-only folders."""
    ways = {"a full disk (100 kB)": lambda: full_disk(100), "a full disk (16 kB)": lambda: full_disk(16),
            "a read-only disk": read_only}
    if os.name == "posix":
        ways["files of at most 20 kB"] = lambda: file_limit(20)
    rows, faults = [], []
    for name, way in ways.items():
        found = way()
        rows.append([name, len(WRITERS), len(found)])
        faults += found
    return table(["place", "commands tried", "faults"], rows) + "".join(f"\n* {f}" for f in faults)
