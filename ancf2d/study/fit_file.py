"""What fits and designs write: the case with the numbers that were found, and data beside model in a result file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..case import LoadedCase
from ..case.numbers import text_with
from ..case.units import QUANTITY_UNITS, unit_label
from ..results import Column, ResultWriter
from ..results.target import MARK, replacing
from .digests import inputs_of
from .fit import Fit
from .run import result_header, vocabulary


def write_case(loaded: LoadedCase, values: Mapping[str, float], path: str | os.PathLike[str], how: str,
               force: bool = False) -> list[str]:
    """Write a case with other numbers at some paths, in the words of its file where these have a place there.

    Its first line says ``how`` they were found. Returns what is to be told of it. Raises ResultsError.
    """
    text, kept = text_with(loaded, values, vocabulary())
    lines = [line for line in text.splitlines(keepends=True) if not line.startswith(f"# {MARK}")]
    with replacing(path, force) as private:
        private.write_text(f"# {MARK}: {how}\n" + "".join(lines), encoding="utf-8")
    told = [] if kept else [f"'{path}' has the case with its defaults, without comments"]
    if inputs_of(loaded)[1:] and Path(path).absolute().parent != Path(loaded.source.file).absolute().parent:
        told.append(f"'{path}' names files that it is read with; they are beside '{loaded.source.file}'")
    return told


def write_fit(fit: Fit, path: str | os.PathLike[str], command: str = "", force: bool = False) -> None:
    """Write tables ``fit`` (parameters) and ``fitted`` (data and model) to a result file. Raises ResultsError."""
    labels = fit.loaded.case.units.labels
    columns = [Column(n, "as in the case" if n != "path" else "none", text) for n, text in (
        ("path", "path of the parameter"), ("value", "fitted value"), ("standard_error", "its standard error"),
        ("low", "lower bound"), ("high", "upper bound"), ("start", "where the search began"))]
    table: dict[str, Any] = {fit.data.axis: fit.data.x}
    for k, name in enumerate(fit.data.names):
        quantity = name.removesuffix(".re").removesuffix(".im").rpartition(".")[2]
        units = unit_label(QUANTITY_UNITS.get(quantity, "1"), labels)
        table |= {f"data {name}": fit.data.values[:, k], f"model {name}": fit.model[:, k]}
        columns += [Column(f"data {name}", units, f"{name} as measured"),
                    Column(f"model {name}", units, f"{name} of the fitted case")]
    columns.append(Column("factor", "1", "load factor") if fit.data.axis == "factor" else
                   Column("t", "{T}", "time") if fit.data.axis == "t" else Column("hz", "1/{T}", "frequency"))
    rows = {c.name: [np.nan if v is None else v for v in (getattr(row, c.name) for row in fit.rows)]
            for c in columns[:6]}
    header = {**result_header(fit.loaded, command)}
    with ResultWriter(path, header, [], np.zeros(0), columns=columns, force=force) as writer:
        writer.table("fit", rows)
        writer.table("fitted", table)
        writer.finish(fit.as_json())
