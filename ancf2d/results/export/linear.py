"""Linear models x' = A x + B u, y = C x + D u, with the names of u, y and x, for NumPy and MATLAB."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.results.export import Done
from ancf2d.results.reader import Results
from ancf2d.results.target import MARK

NAMES = {"inputs": "input", "outputs": "output", "states": "state"}


def matrices(results: Results) -> dict[str, Any]:
    """Return A, B, C, D and the lists inputs, outputs, states. Raises ResultsError where there is no such model."""
    if "state_space/A" not in results.arrays:
        raise ResultsError(f"'{results.path}' holds no linear model; solver state_space makes one")
    found: dict[str, Any] = {name: results.array(f"state_space/{name}") for name in "ABCD"}
    for table, column in NAMES.items():
        found[table] = [str(name) for name in results.tables[table][column]]
    return found


def write(results: Results, path: Path, done: Done) -> None:
    """Write A, B, C, D, inputs, outputs and states as an archive of NumPy."""
    # as bytes the mark is found in the file
    with path.open("wb") as stream:
        np.savez(stream, made_by=np.bytes_(MARK), **matrices(results))
    done(1.0)
