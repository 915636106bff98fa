"""Figures out: to a file, to a table of their data, to the screen."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ancf2d.errors import ResultsError
from ancf2d.plot.kinds import Input, build, draw
from ancf2d.plot.style import style
from ancf2d.results.replace import replacing

# without the moment of writing, equal figures are equal files
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None},
    "ps": {"CreationDate": None}, "eps": {"CreationDate": None},
}


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as private:
        private.write_bytes(content)


def save(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure in the format of the path's suffix; equal figures give equal bytes."""
    path = Path(path)
    suffix = path.suffix.lower().lstrip(".")
    known = figure.canvas.get_supported_filetypes()
    if suffix not in known:
        what = f"unknown suffix '.{suffix}'" if suffix else "no suffix"
        raise ResultsError(f"cannot write '{path}': {what} (known: "
                           f"{', '.join('.' + k for k in sorted(known))})")
    stream = io.BytesIO()
    with style():
        figure.savefig(stream, format=suffix, metadata=_METADATA.get(suffix))
    _write(path, stream.getvalue())
    return path


def data_csv(results: Input, path: str | os.PathLike[str], kind: str | None = None,
             **options: Any) -> Path:
    """Write what ``draw`` draws as a CSV table with units in its header, at full precision."""
    picture = build(results, kind, **options)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(picture.header())
    writer.writerows(picture.rows())
    _write(Path(path), stream.getvalue().encode())
    return Path(path)


def show(results: Input, kind: str | None = None, **options: Any) -> None:
    """Draw on the screen and wait until the window is closed; ResultsError without a display."""
    import matplotlib.pyplot as plt
    from matplotlib.backends import BackendFilter, backend_registry

    if plt.get_backend().lower() not in backend_registry.list_builtin(BackendFilter.INTERACTIVE):
        raise ResultsError("there is no display to show the figure on; "
                           "write it to a file with --save FILE.png")
    draw(results, kind, figure=plt.figure(), **options)
    plt.show()
