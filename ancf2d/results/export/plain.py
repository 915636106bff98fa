"""Exports to small files: probes as CSV, all small data as JSON, linear models for NumPy and MATLAB."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.json_values import json_text
from ancf2d.results.export import Done
from ancf2d.results.info import describe
from ancf2d.results.reader import Results
from ancf2d.results.target import MARK

BLOCK = 4096  # lines between two reports of progress
MOST = 10_000  # maximum length of a series in JSON
# tables with the names of u, y and x of linear models, and their columns
NAMES = {"inputs": "input", "outputs": "output", "states": "state"}


def time_name(results: Results) -> str:
    """Return the name of the column of states: ``t``, or ``factor`` for load factors."""
    return "t" if results.over_time else "factor"


def write_csv(results: Results, path: Path, done: Done) -> None:
    """Write ``t`` or ``factor``, then ``NAME.x``, ``NAME.y``, ... of each probe. Raises ResultsError without probes.

    For a frequency response: ``hz``, then ``INPUT.NAME.x.re``, ``INPUT.NAME.x.im``, ...
    """
    columns = {time_name(results): results.probe_t, **{
        f"{name}.{q}": values for name, table in results.probes.items() for q, values in table.items()}}
    columns = results.tables.get("response", columns)
    if len(columns) < 2:
        advice = ("'ancf2d plot FILE.h5 --data FILE.csv' writes the numbers of its figures, a suffix .json its tables"
                  if not results.nt else "name points under output.probes in the case and run it again")
        raise ResultsError(f"{results.called} holds no values of probes; {advice}")
    count = len(next(iter(columns.values())))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(list(columns))
        for start in range(0, count, BLOCK):
            part = slice(start, start + BLOCK)
            writer.writerows(zip(*(c[part].tolist() for c in columns.values()), strict=True))
            done(min(start + BLOCK, count) / count)


def write_json(results: Results, path: Path, done: Done) -> None:
    """Write the data of ``ancf2d info``, the case with defaults, and the series; ``left_out`` lists those too long."""
    left_out: list[str] = []

    def short(name: str, columns: dict[str, Any]) -> dict[str, Any]:
        if max((len(values) for values in columns.values()), default=0) <= MOST:
            return columns
        left_out.append(name)
        return {}

    found = {"made_by": MARK, **describe(results.path)}
    when = time_name(results)
    found.update(
        states=short("states", {when: results.t}),
        probes={**short("probes", {when: results.probe_t}),
                **{name: short(f"probe {name}", table) for name, table in results.probes.items()}},
        energies=short("energies", results.energies), history=short("history", results.history),
        tables={name: {"rows": short(f"table {name}", table), "attributes": table.attrs}
                for name, table in results.tables.items()},
        case_completed=results.case_completed, left_out=left_out)
    path.write_text(json_text(found) + "\n", encoding="utf-8")
    done(1.0)


def matrices(results: Results) -> dict[str, Any]:
    """Return A, B, C, D and the lists inputs, outputs, states. Raises ResultsError if there is no linear model."""
    if "state_space/A" not in results.arrays:
        raise ResultsError(f"{results.called} holds no linear model; solver state_space makes one")
    found: dict[str, Any] = {name: results.array(f"state_space/{name}") for name in "ABCD"}
    for table, column in NAMES.items():
        found[table] = [str(name) for name in results.tables[table][column]]
    return found


def write_npz(results: Results, path: Path, done: Done) -> None:
    """Write A, B, C, D, inputs, outputs and states as an archive of NumPy. Raises ResultsError without a model."""
    # as bytes, so that the mark is found in the file
    with path.open("wb") as stream:
        np.savez(stream, made_by=np.bytes_(MARK), **matrices(results))
    done(1.0)


def write_mat(results: Results, path: Path, done: Done) -> None:
    """Write A, B, C, D and the cells inputs, outputs and states for MATLAB. Raises ResultsError without a model."""
    from scipy.io import savemat

    found = matrices(results)
    found.update({name: np.array(found[name], dtype=object) for name in NAMES}, made_by=MARK)
    with path.open("wb") as stream:
        savemat(stream, found)
    done(1.0)
