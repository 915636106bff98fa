"""Linear models x' = A x + B u, y = C x + D u for MATLAB, which reads names as cells of texts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ancf2d.results.export import Done
from ancf2d.results.export.linear import NAMES, matrices
from ancf2d.results.reader import Results
from ancf2d.results.target import MARK


def write(results: Results, path: Path, done: Done) -> None:
    """Write A, B, C, D and the cells inputs, outputs and states. Raises ResultsError where there is no such model."""
    from scipy.io import savemat

    found = matrices(results)
    found.update({name: np.array(found[name], dtype=object) for name in NAMES}, made_by=MARK)
    with path.open("wb") as stream:
        savemat(stream, found)
    done(1.0)
