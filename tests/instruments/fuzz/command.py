"""The command line in this process, and promises that every command keeps."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

CODES = {0, 1, 2}
INTERRUPTED = 130
# what no reader should ever see: the names of exceptions and of the machinery below
LEAKS = ("Traceback (most recent call last)", "internal error", " object at 0x", "RuntimeWarning")


def told(faults: list[str]) -> str:
    """Return the number of mutants that broke a promise, and a line for each fault, ``NUMBER: FAULT``."""
    numbers = {fault.split(":")[0] for fault in faults}
    return (f"Mutants with another exit code, a traceback, a damaged file or no bound: {len(numbers)}."
            + "".join(f"\n* {fault}" for fault in faults))


@dataclass
class Called:
    """One command: its arguments, exit code and output."""

    arguments: list[str]
    code: int
    out: str
    err: str

    def faults(self, codes: set[int] = CODES) -> list[str]:
        """Return broken promises: an unexpected exit code, a traceback, a failure without a message, missing JSON."""
        name = " ".join(self.arguments)
        found = [f"{name}: exit code {self.code}: {self.err.strip()[-300:]}"] if self.code not in codes else []
        found += [f"{name}: prints '{leak}': {self.err.strip()[-300:]}"
                  for leak in LEAKS if leak in self.out + self.err]
        if self.code and not self.err.strip() and "--json" not in self.arguments and self.arguments[0] != "compare":
            found.append(f"{name}: exit code {self.code} without a word")
        if "--json" in self.arguments:
            try:
                json.loads(self.out, parse_constant=lambda word: found.append(f"{name}: {word} in its JSON"))
            except ValueError as error:
                found.append(f"{name}: no JSON ({error}): {self.out[:100]!r}")
        return found


def call(*arguments: str) -> Called:
    """Call the command line as a user would."""
    from click.testing import CliRunner

    from ancf2d.cli import main

    found = CliRunner().invoke(main, list(arguments))
    error = found.exception
    if error is not None and not isinstance(error, SystemExit):
        return Called(list(arguments), -1, found.stdout, f"{found.stderr}{type(error).__name__}: {error}")
    return Called(list(arguments), found.exit_code, found.stdout, found.stderr)


def unreal(path: Path) -> list[str]:
    """Return the names of values that are not finite in a result file of a successful run."""
    from ancf2d.results import open_results

    found: list[str] = []
    with open_results(path) as r:
        names = [name for name in ("d", "v", "a") if r.nt and r.holds(name)]
        found += [f"state {name}" for name in names if not np.isfinite(r.rows(name)).all()]
        found += [f"probe {p}.{q}" for p, columns in r.probes.items() for q, values in columns.items()
                  if not np.isfinite(values).all()]
        found += [f"energy {name}" for name, values in r.energies.items() if not np.isfinite(values).all()]
        found += unreal_numbers(r.summary)
    return found


def unreal_numbers(value: Any, path: str = "summary") -> list[str]:
    """Return the paths of floats in nested plain data that are not finite."""
    if isinstance(value, dict):
        return [f for k, v in value.items() for f in unreal_numbers(v, f"{path}.{k}")]
    if isinstance(value, list):
        return [f for i, v in enumerate(value) for f in unreal_numbers(v, f"{path}[{i}]")]
    return [path] if isinstance(value, float) and not math.isfinite(value) else []
