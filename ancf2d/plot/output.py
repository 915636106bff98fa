"""Output of figures and animations: to a file, to a table of their data, to the screen."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from ancf2d.errors import ResultsError
from ancf2d.plot.kinds import KINDS, Input, build, chosen_kind, draw
from ancf2d.plot.picture import Picture
from ancf2d.plot.style import Look, lay_out, plain_ticks, style
from ancf2d.results.target import MARK, replacing

# without the time of writing, equal figures give equal files
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
    """Return the options of ``savefig`` that mark a file as made by ancf2d."""
    if suffix not in _PHOTOGRAPHS:
        return {"metadata": _METADATA.get(suffix)}
    from PIL.Image import Exif

    exif = Exif()
    exif[_SOFTWARE] = MARK
    return {"pil_kwargs": {"comment": MARK} if suffix == "gif" else {"exif": exif}}


def save(figure: Figure, path: str | os.PathLike[str], *, force: bool = False, look: Look | None = None) -> Path:
    """Write a figure in the format of the path's suffix; equal figures give equal bytes.

    Raises ResultsError for an unknown suffix, and if the file was not made by ancf2d, unless ``force``.
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
    """Write the data that ``draw`` draws as a CSV table with units in its header, at full precision.

    Raises ResultsError if the file was not made by ancf2d, unless ``force``.
    """
    picture = build(results, kind, **options)
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(picture.header())
    writer.writerows(picture.rows())
    _write(Path(path), stream.getvalue().encode(errors="backslashreplace"), force)
    return Path(path)


def show(results: Input, kind: str | None = None, **options: Any) -> None:
    """Draw on the screen and wait until the window is closed. Raises ResultsError without a display."""
    import matplotlib.pyplot as plt
    from matplotlib.backends import BackendFilter, backend_registry

    if plt.get_backend().lower() not in backend_registry.list_builtin(BackendFilter.INTERACTIVE):
        raise ResultsError("there is no display to show the figure on; "
                           "write it to a file with --save FILE.png")
    draw(results, kind, figure=plt.figure(), **options)
    plt.show()


class _Gif(PillowWriter):
    """Matplotlib's writer of GIF files, with a comment that marks them as made by ancf2d."""

    def finish(self) -> None:
        """Write all frames."""
        first, *others = self._frames  # type: ignore[attr-defined]
        first.save(self.outfile, save_all=True, append_images=others, duration=int(1000 / self.fps), loop=0,
                   comment=MARK)


class _Mp4(FFMpegWriter):
    """Matplotlib's writer of MP4 files, with a comment that marks them as made by ancf2d."""

    def __init__(self, fps: int) -> None:
        super().__init__(fps, metadata={"comment": MARK})


# the only place where a format is added
WRITERS: dict[str, type[_Gif] | type[_Mp4]] = {".gif": _Gif, ".mp4": _Mp4}
FRAMES, RATE, DPI = 60, 20, 100
MORE_DIGITS = 6
SMALLEST = 2  # smallest number of frames of an animation


def _writer(path: Path, fps: int) -> AbstractMovieWriter:
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise ResultsError(f"cannot write '{path}': animations are {' or '.join(WRITERS)} files")
    if not WRITERS[suffix].isAvailable():
        raise ResultsError(f"cannot write '{path}': this needs the program ffmpeg, which is not installed; install it, "
                           "or write a .gif file")
    return WRITERS[suffix](fps=fps)


def frames(results: Input, kind: str | None = None, *, length: int = FRAMES, title: str | None = None,
           **options: Any) -> Iterator[Picture]:
    """Yield the pictures of an animation, all with the same axes; see ``animate``. Raises ResultsError."""
    sources, chosen = chosen_kind(results, kind, options, animated=True)
    if chosen.frames is None:
        moving = ", ".join(k.name for k in KINDS.values() if k.frames is not None)
        raise ResultsError(f"{chosen.name} cannot be animated; {moving} can")
    if length < SMALLEST:
        raise ResultsError(f"an animation needs at least {SMALLEST} frames, not {length}")
    for picture in chosen.frames(sources, length, **options):
        if title is not None:
            picture.title = title
        yield picture


Place = tuple[Bbox, tuple[float, float], tuple[float, float]]


def _lay_out(figure: Figure, picture: Picture) -> list[Place]:
    """Draw a picture and return the positions and limits of its axes, which are used for all pictures."""
    # later times may have more digits, which may need one more line in the title
    note = getattr(picture, "note", None)
    if note is not None:
        vars(picture)["note"] = f"{note}{'0' * MORE_DIGITS}"
    picture.render(figure)
    plain_ticks(figure)
    lay_out(figure)
    if note is not None:
        vars(picture)["note"] = note
    return [(axes.get_position(original=True), axes.get_xlim(), axes.get_ylim()) for axes in figure.axes]


def _drawn(figure: Figure, picture: Picture, places: Sequence[Place]) -> None:
    """Draw a picture with its axes at the given positions and limits."""
    figure.clear()
    picture.render(figure)
    plain_ticks(figure)
    for axes, (place, x, y) in zip(figure.axes, places, strict=True):
        axes.set_position(place)
        axes.set_xlim(x)
        axes.set_ylim(y)


def animate(results: Input, path: str | os.PathLike[str], kind: str | None = None, *, length: int = FRAMES,
            fps: int = RATE, title: str | None = None, look: Look | None = None, force: bool = False,
            done: Callable[[float], None] = lambda share: None, **options: Any) -> Path:
    """Write an animation of at most ``length`` frames, ``fps`` per second, as .gif or (with ffmpeg) .mp4.

    States are evenly spaced in time. ``done`` is called with the fraction of the frames drawn. Raises ResultsError if
    the kind cannot be animated, if the file cannot be written, and if it was not made by ancf2d, unless ``force``.
    """
    path = Path(path)
    writer, pictures = _writer(path, fps), list(frames(results, kind, length=length, title=title, **options))
    first = pictures[0]
    look = look or Look()
    with replacing(path, force) as private, style(look):
        figure = Figure(figsize=look.size or first.size)
        FigureCanvasAgg(figure)
        with writer.saving(figure, str(private), look.dpi or DPI):
            places = _lay_out(figure, first)
            for k, picture in enumerate(pictures):
                done(k / len(pictures))
                _drawn(figure, picture, places)
                writer.grab_frame()
            done(1.0)
    return path
