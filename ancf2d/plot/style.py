"""The look of figures: one style sheet, a palette for colour-blind eyes, units in labels."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axis import Axis, XAxis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import AutoLocator, ScalarFormatter

from ancf2d.errors import ResultsError

STYLE = Path(__file__).with_name("ancf2d.mplstyle")
# Okabe & Ito (2008) without yellow, which is too faint for lines on white
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
REFERENCE = "#8a8a8a"
MAX_ENTRIES = 36  # of a legend: more would leave no room for the axes


@dataclass(frozen=True)
class Look:
    """A user's settings of a figure on top of the packaged style sheet.

    ``size`` [inch] width and height, ``font_size`` [pt], ``dpi`` dots per inch of images, ``sheet`` a style file of
    Matplotlib, or the name of one of its styles; None keeps the default.
    """

    size: tuple[float, float] | None = None
    font_size: float | None = None
    dpi: float | None = None
    sheet: str | None = None

    def apply(self) -> None:
        """Change Matplotlib's settings. Raises ResultsError if there is no such style file."""
        if self.sheet is not None:
            try:
                matplotlib.style.use(self.sheet)
            except OSError:
                raise ResultsError(f"'{self.sheet}' is neither a style file of Matplotlib nor one of its styles: "
                                   f"{', '.join(matplotlib.style.available)}") from None
        if self.font_size is not None:
            matplotlib.rcParams["font.size"] = self.font_size
        if self.dpi is not None:
            matplotlib.rcParams["savefig.dpi"] = self.dpi


@contextmanager
def style(look: Look | None = None) -> Iterator[None]:
    """Use the packaged style sheet, without warnings of glyphs missing in its font; restore all settings afterwards."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)
        matplotlib.rcdefaults()
        matplotlib.style.use(STYLE)
        (look or Look()).apply()
        yield


def line_style(i: int) -> dict[str, Any]:
    """Return colour, dash and marker of the i-th line: 28 lines differ, and none of them in colour alone."""
    return {"color": PALETTE[i % len(PALETTE)], "linestyle": DASHES[i % len(DASHES)],
            "marker": MARKERS[i % len(MARKERS)]}


# stresses have their own units
_NAMED = {"N/m^2": "Pa", "N/mm^2": "MPa", "kN/m^2": "kPa", "N/m/m": "Pa"}


def pretty(units: str) -> str:
    """Return units for printing: N·m, m/s², Pa."""
    return _NAMED.get(units, units).replace("*", "·").replace("^2", "²").replace("^3", "³")


def label(name: str, units: str) -> str:
    """Return an axis label; dimensionless quantities have no units."""
    return name if units in ("", "1", "none") else f"{name} [{pretty(units)}]"


LAYOUTS = 5  # largest number of layouts of axes with equal scales
LETTER, BETWEEN = 0.62, 0.5  # width of a digit, and of the space between two numbers, relative to the font size
_SHORT = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}


def time_unit(units: str, largest: float) -> tuple[str, float]:
    """Return the unit that makes the ticks of a time axis short, and how many of it are one of ``units``."""
    if units != "s" or not 0.0 < largest < 0.1:
        return units, 1.0
    return next(((name, 1 / size) for name, size in _SHORT.items() if largest >= 0.1 * size), (units, 1.0))


def in_unit(axis: Axis, factor: float, minor: bool = False) -> None:
    """Show the ticks of an axis in another unit: multiplied by ``factor``."""
    (axis.set_minor_formatter if minor else axis.set_major_formatter)(lambda value, position: f"{value * factor:.6g}")


class PlainTicks(ScalarFormatter):
    """Tick labels as plain text, which is laid out much faster than formulas; only their common power is a formula."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the label at x."""
        return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")


class FewTicks(AutoLocator):
    """Ticks of a horizontal axis, no more than fit side by side with all their digits."""

    def __init__(self, like: AutoLocator) -> None:
        super().__init__()
        vars(self).update(vars(like))  # copies whether all ticks are at whole numbers

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Return the places of ticks for an axis from one value to another."""
        axis = cast(XAxis, self.axis)
        most = int(np.clip(axis.get_tick_space(), 2, 9))
        low, high = min(vmin, vmax), max(vmin, vmax)
        while True:
            self.set_params(nbins=most)
            ticks = super().tick_values(vmin, vmax)
            texts = axis.get_major_formatter().format_ticks([t for t in ticks if low <= t <= high])
            # the axis reserves three times the font size for each tick
            if most == 2 or sum(LETTER * len(text) + BETWEEN for text in texts) <= 3 * (axis.get_tick_space() + 1):
                return ticks
            most -= 1


def plain_ticks(figure: Figure) -> None:
    """Use plain text for the ticks of all axes with linear scales."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if type(axis.get_major_formatter()) is ScalarFormatter:
                axis.set_major_formatter(PlainTicks())
        given = axes.xaxis.get_major_locator()
        if type(given) is AutoLocator:
            axes.xaxis.set_major_locator(FewTicks(given))


def lay_out(figure: Figure) -> None:
    """Place the axes of a figure, and keep them there.

    Axes with equal scales show a larger or smaller range depending on their width, so their numbers change once they
    are placed. The layout is repeated until all numbers are within the figure.
    """
    engine = ConstrainedLayoutEngine()
    figure.set_layout_engine(engine)
    canvas = cast(FigureCanvasAgg, figure.canvas)
    for _ in range(LAYOUTS):
        engine.execute(figure)
        needed, whole = figure.get_tightbbox(canvas.get_renderer()), figure.bbox_inches
        if needed.x1 <= whole.x1 and needed.x0 >= whole.x0:
            break
    figure.set_layout_engine("none")


def verbatim(text: Text | None) -> None:
    """Show a user's text literally: dollar signs do not begin a formula, and file names need not be UTF-8."""
    if text is not None:
        text.set_parse_math(False)
        text.set_text(text.get_text().encode(errors="backslashreplace").decode())


def title(figure: Figure, text: str, note: str = "") -> None:
    """Put the title above the first axes, with a note below it."""
    width = int(11.5 * (figure.get_figwidth() - 0.8))
    lines = textwrap.wrap(text, width) + textwrap.wrap(note, width)
    verbatim(figure.axes[0].set_title("\n".join(lines[:6])))


def heading(figure: Figure, text: str, note: str = "") -> None:
    """Put the title above all axes, each of which has its own title, with a note below it."""
    width = int(11.5 * (figure.get_figwidth() - 0.4))
    lines = textwrap.wrap(text, width) + textwrap.wrap(note, width)
    verbatim(figure.suptitle("\n".join(lines[:6]), x=0.02, ha="left", fontsize="large"))


def legend_rows(inches: float, labels: Sequence[str]) -> int:
    """Return the number of rows of a legend below a figure of a width."""
    labels = labels[:MAX_ENTRIES]
    room = 7.2 * inches  # in units of the font size
    widths = [0.55 * len(text) + 5 for text in labels]
    columns = len(labels) if sum(widths) <= room else max(1, int(room / max(widths)))
    return -(-len(labels) // columns)


def legend(figure: Figure, handles: Sequence[Artist], labels: Sequence[str]) -> None:
    """Put one legend below the axes, where it hides nothing, filled row by row, with at most MAX_ENTRIES entries."""
    if len(labels) > MAX_ENTRIES:
        handles = [*handles[:MAX_ENTRIES - 1], Line2D([], [], linestyle="")]
        labels = [*labels[:MAX_ENTRIES - 1], f"and {len(labels) - MAX_ENTRIES + 1} more"]
    rows = legend_rows(figure.get_figwidth(), labels)
    columns = -(-len(labels) // rows)
    # matplotlib fills column by column
    order = [i for c in range(columns) for i in range(c, len(labels), columns)]
    shown = figure.legend([handles[i] for i in order], [labels[i] for i in order],
                          loc="outside lower left", ncols=columns)
    for entry in shown.get_texts():
        verbatim(entry)
