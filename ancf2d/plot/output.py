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
from ancf2d.plot.style import Look, style
from ancf2d.results.target import MARK, replacing

# without the moment of writing, equal figures are equal files
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": MARK}, "svg": {"Creator": MARK, "Date": None}, "svgz": {"Date": None},
    "pdf": {"Creator": MARK, "CreationDate": None, "ModDate": None}, "ps": {"Creator": MARK}, "eps": {"Creator": MARK},
}
_PHOTOGRAPHS = ("jpg", "jpeg", "tif", "tiff", "webp", "avif", "gif")  # formats written by Pillow
_SOFTWARE = 0x131  # number of this tag in Exif metadata


def _write(path: Path, content: bytes, force: bool) -> None:
    with replacing(path, force) as private:
        private.write_bytes(content)


def _marked(suffix: str) -> dict[str, Any]:
    """Return the options of ``savefig`` that make a file known as ancf2d's own."""
    if suffix not in _PHOTOGRAPHS:
        return {"metadata": _METADATA.get(suffix)}
    from PIL.Image import Exif

    exif = Exif()
    exif[_SOFTWARE] = MARK
    return {"pil_kwargs": {"comment": MARK} if suffix == "gif" else {"exif": exif}}


def save(figure: Figure, path: str | os.PathLike[str], *, force: bool = False, look: Look | None = None) -> Path:
    """Write a figure in the format of the path's suffix; equal figures give equal bytes.

    Raises ResultsError for an unknown suffix, and where the file was not made by ancf2d, unless ``force``.
    """
    path = Path(path)
    suffix = path.suffix.lower().lstrip(".")
    known = figure.canvas.get_supported_filetypes()
    if suffix not in known:
        what = f"unknown suffix '.{suffix}'" if suffix else "no suffix"
        raise ResultsError(f"cannot write '{path}': {what} (known: "
                           f"{', '.join('.' + k for k in sorted(known))})")
    stream = io.BytesIO()
    with style(look):
        figure.savefig(stream, format=suffix, **_marked(suffix))
    _write(path, stream.getvalue(), force)
    return path


def data_csv(results: Input, path: str | os.PathLike[str], kind: str | None = None,
             *, force: bool = False, **options: Any) -> Path:
    """Write what ``draw`` draws as a CSV table with units in its header, at full precision.

    Raises ResultsError where the file was not made by ancf2d, unless ``force``.
    """
    picture = build(results, kind, **options)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(picture.header())
    writer.writerows(picture.rows())
    _write(Path(path), stream.getvalue().encode(errors="backslashreplace"), force)
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
