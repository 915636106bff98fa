"""``ancf2d plot``: draw figures from result files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import complete_kinds, examples, force_option, plain_session
from .session import Bar, Session
from .text import table

if TYPE_CHECKING:
    from ..plot import Look


def _size(ctx: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, float] | None:
    """Return width and height given as ``6.4,4.8``."""
    if value is None:
        return None
    try:
        width, height = (float(part) for part in value.replace("x", ",").split(","))
    except ValueError:
        raise click.BadParameter(f"'{value}' is not a width and height in inches; "
                                 "expected for example 6.4,4.8") from None
    if not (0.5 <= width <= 100 and 0.5 <= height <= 100):
        raise click.BadParameter(f"'{value}' is out of range; expected 0.5 to 100 inches for width and height")
    return width, height


@click.command(epilog=examples("ancf2d plot beam.h5", "ancf2d plot beam.h5 --list",
                               "ancf2d plot beam.h5 stored.h5 load_deflection --save path.pdf",
                               "ancf2d plot swing.h5 snapshots --count 5 --data swing.csv",
                               "ancf2d plot swing.h5 --animate swing.gif --frames 30"))
@click.argument("arguments", nargs=-1, required=True, type=click.Path(), metavar="OUT.h5... [KIND]",
                shell_complete=complete_kinds)
@click.option("-o", "--save", type=click.Path(), metavar="FILE", help="Write the figure: .png, .pdf, .svg, ... "
              "Default, unless another output is requested: NAME-KIND.png in the working directory.")
@click.option("--show", is_flag=True, help="Open a window (needs a display).")
@click.option("--data", type=click.Path(), metavar="FILE.csv", help="Write the plotted values as a table.")
@click.option("--animate", type=click.Path(), metavar="FILE", help="Write an animation: .gif, or .mp4 if ffmpeg is "
              "installed (shape, fields, modes).")
@click.option("--frames", metavar="N", type=click.IntRange(2), default=60, show_default=True,
              help="Maximum number of frames of the animation.")
@click.option("--fps", metavar="N", type=click.IntRange(1, 100), default=20, show_default=True,
              help="Frames per second of the animation.")
@click.option("--list", "list_only", is_flag=True, help="List the kinds of figure available for the file.")
@click.option("--scale", metavar="FACTOR", type=float,
              help="Magnification of displacements (shape, fields, snapshots).")
@click.option("--state", metavar="N", type=int,
              help="Stored state to draw; negative numbers count from the end (shape, fields, "
              "section_forces, difference).")
@click.option("--field", metavar="NAME", help="Field: stress, strain, energy, plastic_strain, pressure, "
              "traction or gap (fields).")
@click.option("--component", metavar="NAME", help="Component of the field: xx, yy, xy, or for stress mises "
              "(fields).")
@click.option("--unrolled/--in-place", default=None, help="Draw bodies unrolled (over arc length and height) or in "
              "place; default: unrolled if they are thin (fields), or one straight body (section_forces).")
@click.option("--symbols/--no-symbols", default=None, help="Draw supports, loads, joints, springs and masses, or leave "
              "them out; default: draw them (shape, section_forces).")
@click.option("--at", metavar="T,T,...", help="Times or load factors to draw (snapshots).")
@click.option("--point", metavar="BODY@S", help="Point of a body; BODY alone is its point of largest strain or "
              "moment; default: that of the first body (stress_strain, moment_curvature).")
@click.option("--height", metavar="Y", type=float, help="Position over the height, from -1 (lower face) to 1 (upper "
              "face); default: the outermost station (stress_strain).")
@click.option("--probe", metavar="NAME", multiple=True,
              help="Probe to draw; may be given several times (curves).")
@click.option("--quantity", metavar="NAME", multiple=True,
              help="Quantity to draw, e.g. uy, or a value of a sweep; may be given several times (curves, sweep).")
@click.option("--input", metavar="NAME", multiple=True,
              help="Input whose response is drawn; may be given several times (bode, nyquist).")
@click.option("--against", type=click.Choice(["elements", "dofs", "wall_s", "memory_bytes"]),
              help="Quantity on the horizontal axis (convergence, tradeoff).")
@click.option("--over", metavar="PATH", help="Varied number on the horizontal axis, or the end of its path (sweep).")
@click.option("--values", is_flag=True, default=None, help="Draw the value of the goal instead of its error "
              "(convergence).")
@click.option("--reference", metavar="FILE", help="File with which the others are compared; default: the last one "
              "(difference).")
@click.option("--first", metavar="N", type=click.IntRange(1), help="First mode to draw (modes).")
@click.option("--count", metavar="N", type=click.IntRange(1),
              help="Number of modes, instants or bars to draw (modes, snapshots, tornado).")
@click.option("--size", metavar="W,H", callback=_size, help="Width and height of the figure in inches.")
@click.option("--font-size", metavar="PT", type=click.FloatRange(1, 100), help="Font size in points. [default: 10]")
@click.option("--dpi", metavar="N", type=click.FloatRange(10, 2000), help="Dots per inch of images. [default: 200, for "
              "animations 100]")
@click.option("--style", "sheet", metavar="FILE", help="A Matplotlib style file, or the name of a style, applied "
              "on top of ancf2d's own.")
@click.option("--title", metavar="TEXT", help="Title of the figure; default: the title of the case, or the common part "
              "of several titles.")
@force_option
@plain_session
def command(session: Session, arguments: tuple[str, ...], save: str | None, show: bool, data: str | None,
            list_only: bool, title: str | None, animate: str | None, frames: int, fps: int, force: bool,
            size: tuple[float, float] | None, font_size: float | None, dpi: float | None, sheet: str | None,
            **options: Any) -> int:
    """Draw result files; several are drawn in one figure.

    KIND is shape, load_deflection, history, convergence, modes, ...; --list lists those available for a file.
    Default: the most informative figure for the first file.
    """
    from ..plot import KINDS, Look, default_animated, default_kind
    from ..results.target import TABLE, check_output
    from ..study.fields_of_states import StatesWithFields

    files, kind = _split(arguments, tuple(KINDS))
    for path, content in ((save, None), (data, TABLE), (animate, None)):
        check_output(path, force, *files, kind=content)
    look = Look(size, font_size, dpi, sheet)
    chosen = {k: v for k, v in options.items() if v is not None and v != ()}
    with ExitStack() as stack:
        results = [stack.enter_context(StatesWithFields(f)) for f in files]
        if list_only:
            _list(session, results)
            return 0
        if animate is not None:
            _animate(session, results, kind or default_animated(results[0]), animate, title, look, force,
                     {"length": frames, "fps": fps, **chosen})
            if save is None and data is None and not show:
                return 0
        name = kind or default_kind(results[0])
        if save is None and data is None and not show:
            save = f"{_stem(files[0])}-{name}.png"
        _draw(session, results, name, save, data, show, title, look, force, chosen)
    return 0


def _split(arguments: tuple[str, ...], kinds: tuple[str, ...]) -> tuple[list[str], str | None]:
    """Return the files and the kind among the arguments; a plain name that is not a file counts as a kind."""
    files: list[str] = []
    found: list[str] = []
    for text in arguments:
        bare = os.sep not in text and "." not in text
        (found if text in kinds or (bare and not os.path.exists(text)) else files).append(text)
    if len(found) > 1:
        raise click.UsageError(f"Give one kind of figure at a time, got {' and '.join(found)}.")
    if not files:
        raise click.UsageError(f"There is no result file to draw: {arguments[0]} is not one. The kinds of figure are "
                               f"{', '.join(kinds)}.")
    return files, found[0] if found else None


def _animate(session: Session, results: Sequence[Any], kind: str, path: str, title: str | None, look: Look,
             force: bool, options: dict[str, Any]) -> None:
    from .. import plot

    with Bar("drawing", session.shows_progress) as bar:
        plot.animate(results, path, kind, title=title, look=look, force=force, done=bar.update, **options)
    session.out(f"wrote {path} ({kind})")


def _draw(session: Session, results: Sequence[Any], kind: str, save: str | None, data: str | None, show: bool,
          title: str | None, look: Look, force: bool, options: dict[str, Any]) -> None:
    from .. import plot

    if save is not None:
        plot.save(plot.draw(results, kind, title=title, look=look, **options), save, force=force, look=look)
        session.out(f"wrote {save} ({kind})")
    if data is not None:
        plot.data_csv(results, data, kind, force=force, **options)
        session.out(f"wrote {data} ({kind})")
    if show:
        plot.show(results, kind, title=title, look=look, **options)


def _stem(file: str) -> str:
    return Path(file).name.removesuffix(".part").removesuffix(".h5")


def _list(session: Session, results: list[Any]) -> None:
    from ..plot import default_kind, list_kinds

    default = default_kind(results[0])
    rows = []
    for kind in list_kinds(results[0], len(results)):
        options = ", ".join(f"--{o}" for o in (*kind.options, *(["animate"] if kind.moves else [])))
        mark = "*" if kind.name == default else ""
        rows.append([kind.name + mark, *([f"no: {kind.missing}", ""] if kind.missing else [kind.doc, options])])
    session.out("\n".join(table(rows, left=(0, 1, 2))))
    session.out("\n* drawn if no kind is named")
