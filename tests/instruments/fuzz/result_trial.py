"""The outcome of commands and of the Python interface on one mutant of a result file."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ancf2d.errors import Ancf2dError
from scripts.pages import table

from . import result_mutants
from .command import INTERRUPTED, Called, call, told
from .pen import Ended, Limits, confined

MUTANT = "mutant.h5"
SUFFIXES = (".vtkhdf", ".csv", ".json")
SECONDS = 30.0  # of the processor's time within which each command must end


@dataclass
class Trial:
    """The outcome of one mutant: the number of commands by exit code, and broken promises."""

    number: int
    codes: Counter[tuple[str, int]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    @property
    def read(self) -> bool:
        """Whether the mutant was accepted as a result."""
        return bool(self.codes["info", 0])


def trials(folder: Path, bases: list[Path], seed: int, numbers: range,
           limits: Limits | None = None) -> Iterator[tuple[Trial, Ended]]:
    """Yield the outcome of each mutant, tried in its own process in an empty folder."""
    def work(number: int) -> Trial:
        return examine(folder, bases, seed, number)

    for number, ended in confined(work, numbers, limits or Limits(patience=3 * SECONDS)):
        trial = ended.value or Trial(number)
        trial.faults += [*([ended.fault] if ended.fault else []), *ended.notes]
        yield trial, ended


def report(count: int, seed: int = 1) -> str:
    """Return the table of outcomes of mutants of result files, and a line for each fault."""
    codes: Counter[tuple[str, int]] = Counter()
    faults, read, most, began = [], 0, 0, time.monotonic()
    with tempfile.TemporaryDirectory() as sound, tempfile.TemporaryDirectory() as folder:
        bases = result_mutants.make_bases(Path(sound))
        for trial, ended in trials(Path(folder), bases, seed, range(count)):
            codes += trial.codes
            read, most = read + trial.read, max(most, ended.memory)
            faults += [f"{trial.number}: {fault}" for fault in trial.faults]
    rows = [[name, sum(n for (k, _), n in codes.items() if k == name), *(codes[name, code] for code in (0, 1, 2))]
            for name in dict.fromkeys(name for name, _ in codes)]
    return (table(["command", "calls", "exit 0", "exit 1", "exit 2"], rows)
            + f"\n\nSeed {seed}; {count} mutants, of which {read} were read as results; "
            f"{time.monotonic() - began:.0f} s in all, at most {most / 1e6:.0f} MB for one mutant. {told(faults)}")


def examine(folder: Path, bases: list[Path], seed: int, number: int) -> Trial:
    """Read a mutant by each command; kinds of figure and formats take turns."""
    os.chdir(folder)
    for name in os.listdir():
        os.unlink(name)
    base = result_mutants.mutant(bases, Path(MUTANT), seed, number)
    trial = Trial(number)
    for arguments, made in _commands(str(base), number):
        began = time.process_time()
        called = call(*arguments)
        trial.codes[arguments[0], called.code] += 1
        trial.faults += called.faults() + _made(called, made)
        if time.process_time() - began > SECONDS:
            trial.faults.append(f"{' '.join(arguments)} took {time.process_time() - began:.0f} s")
        if called.code == INTERRUPTED:
            break
    trial.faults += _by_python()
    return trial


def _commands(base: str, number: int) -> Iterator[tuple[list[str], str]]:
    """Yield command lines, each with the file that it writes."""
    from ancf2d.plot import KINDS

    yield ["info", MUTANT, *(["--json"] if number % 2 else [])], ""
    yield ["compare", *([MUTANT, base] if number % 2 else [base, MUTANT]), *(["--json"] if number % 3 else [])], ""
    kinds = [[], *([kind] for kind in KINDS)]
    yield ["plot", MUTANT, *kinds[number % len(kinds)], "--save", "figure.svg", "--data", "figure.csv"], "figure.svg"
    suffix = SUFFIXES[number % len(SUFFIXES)]
    yield ["export", MUTANT, "out" + suffix], "out" + suffix
    if number % 3 == 0:
        yield ["view", MUTANT, "--save", "page.html"], "page.html"
    if number % 7 == 0:
        yield ["plot", MUTANT, "--list"], ""
    if number % 20 == 0:
        yield ["plot", MUTANT, "--animate", "film.gif", "--frames", "2"], "film.gif"


def _made(called: Called, name: str) -> list[str]:
    """Return the faults of the file that a command should have written."""
    if name and (called.code == 0) != Path(name).exists():
        return [f"{' '.join(called.arguments)} ends with {called.code}, {name} is {'' if called.code else 'not '}there"]
    rest = [n for n in os.listdir() if ".part" in n or n.endswith(".tmp")]
    return [f"{' '.join(called.arguments)} leaves {rest}"] if rest else []


def _by_python() -> list[str]:
    """Return the exception, if it is not an expected one, of reading everything in Python."""
    import ancf2d

    try:
        with ancf2d.open_results(MUTANT) as r:
            _ = r.units, r.summary, r.case_text, r.case_completed, r.overrides, r.t, r.history, r.energies, r.probe_t
            _ = r.probes, r.tables, r.fields, r.checkpoint
            for body in r.bodies:
                for i in range(-1, min(r.nt, 3)):
                    r.faces(body, i if i >= 0 else None)
                    r.nodes(body, i if i >= 0 else None)
                for name in r.fields.get(body, {}):
                    r.field(body, name)
            for name in r.arrays:
                r.array(name)
    except Ancf2dError:
        return []
    except Exception as error:
        return [f"open_results: {type(error).__name__}: {error}"]
    return []
