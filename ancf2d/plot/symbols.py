"""Symbols of supports, loads, joints, springs and masses in figures, of a size that does not depend on the model's."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.markers import MarkerStyle
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, ScaledTranslation, Transform

from ancf2d.results.symbols import Outline, Symbol, outlines

INK, LOAD = "0.15", "#a01414"
GRAVITY = 20.0  # length of its arrow in points


def _path(outline: Outline) -> Path:
    """Return the open lines of a symbol as one path."""
    codes = [code for line in outline.lines for code in (Path.MOVETO, *[Path.LINETO] * (len(line) - 1))]
    return Path([p for line in outline.lines for p in line], codes)


def _zigzag(points: np.ndarray, turns: int = 7) -> np.ndarray:
    """Return the line of a spring between two points."""
    a, b = points
    along = b - a
    across = 0.06 * np.array([-along[1], along[0]])
    s = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * turns + 1), [1.0]])
    side = np.concatenate([[0.0, 0.0], [(-1.0) ** k for k in range(2 * turns - 1)], [0.0, 0.0]])
    return a + s[:, None] * along + side[:, None] * across


def _mark(axes: Axes, symbol: Symbol, points: np.ndarray, transform: Transform) -> None:
    outline = outlines()[symbol.kind]
    path, ink = _path(outline), LOAD if outline.load else INK
    # a marker is as large as its outline reaches from its point
    size = 2.0 * outline.unit * float(np.abs(path.vertices).max())
    axes.plot(*points.T, linestyle="", marker=MarkerStyle(path, transform=Affine2D().rotate(symbol.angle)),
              markersize=size, markerfacecolor={"back": "white", "ink": ink}.get(outline.filled, "none"),
              markeredgecolor=ink, markeredgewidth=1.1, zorder=3.5, clip_on=False, transform=transform)


def _gravity(axes: Axes, symbol: Symbol, place: int) -> None:
    """Draw an arrow and its letter beside the axes, where no body can be; one of several below the one before."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    way = 0.5 * GRAVITY * np.array([math.cos(symbol.angle), math.sin(symbol.angle)])
    middle = np.array([0.5 * GRAVITY + 4.0, -0.5 * GRAVITY - 1.8 * GRAVITY * place])
    tip = middle + way
    moved = ScaledTranslation(tip[0] / 72, tip[1] / 72, figure.dpi_scale_trans)
    _mark(axes, symbol, np.ones((1, 2)), axes.transAxes + moved)
    axes.annotate("g", (1.0, 1.0), (middle[0], middle[1] - 0.5 * GRAVITY - 3.0), xycoords="axes fraction",
                  textcoords="offset points", ha="center", va="top", color=LOAD, style="italic", annotation_clip=False)


def draw_symbols(axes: Axes, symbols: list[Symbol]) -> None:
    """Draw symbols over the bodies of axes, gravity beside them."""
    down = [s for s in symbols if s.kind == "gravity"]
    for place, symbol in enumerate(down):
        _gravity(axes, symbol, place)
    for symbol in symbols:
        if symbol.kind == "spring":
            axes.plot(*_zigzag(symbol.points).T, color=INK, linewidth=1.0, zorder=3.4)
        elif symbol.kind == "tendon":
            axes.plot(*symbol.points.T, color=LOAD, linewidth=1.0, zorder=3.4)
        elif symbol.kind != "gravity":
            _mark(axes, symbol, symbol.points, axes.transData)
