"""Export of results to other formats, from the result file alone."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ancf2d.errors import ResultsError
from ancf2d.results.reader import Results, open_results
from ancf2d.results.target import check_output, replacing

Done = Callable[[float], None]


@dataclass(frozen=True)
class Format:
    """A format: the contents of its files, and the module here whose ``writer(results, path, done)`` writes one."""

    suffix: str
    holds: str
    module: str
    writer: str

    def write(self, results: Results, path: Path, done: Done) -> None:
        """Write a new file; ``done`` is called with the fraction written. Raises ResultsError."""
        getattr(import_module(f"{__name__}.{self.module}"), self.writer)(results, path, done)


# the only place where a format is added
FORMATS = {f.suffix: f for f in (
    Format(".vtkhdf", "the bodies over time, for ParaView", "vtkhdf", "write"),
    Format(".csv", "the probes over time, load factor or frequency", "plain", "write_csv"),
    Format(".npz", "the linear model of small motions, for NumPy", "plain", "write_npz"),
    Format(".mat", "the linear model of small motions, for MATLAB", "plain", "write_mat"),
    Format(".json", "all small data: provenance, summary, probes, steps, tables", "plain", "write_json"),
)}


def format_of(path: str | os.PathLike[str]) -> Format:
    """Return the format of a file's suffix. Raises ResultsError, which lists the known formats."""
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        what = f"unknown suffix '{suffix}'" if suffix else "no suffix"
        raise ResultsError(f"cannot write '{path}': {what} (known: {', '.join(FORMATS)})")
    return FORMATS[suffix]


def export(source: str | os.PathLike[str], path: str | os.PathLike[str], force: bool = False,
           done: Done = lambda share: None) -> Format:
    """Write a result file in the format of the suffix of ``path``; return that format.

    The file appears when it is complete. Raises ResultsError for an unknown suffix, for a file without data of this
    kind, and if ``path`` was not made by ancf2d, unless ``force``.
    """
    chosen = format_of(path)
    check_output(path, force, source)
    with open_results(source) as results, replacing(path, force) as private:
        chosen.write(results, private, done)
    return chosen
