"""Fields over the bodies: stress, strain, energy density or contact as colour over the plane or the arc length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ancf2d.errors import ResultsError
from ancf2d.plot import style
from ancf2d.plot.body import (
    Outline,
    bounds,
    check_state,
    chosen_scale,
    draw_obstacles,
    even_states,
    frame_plane,
    how_to_store,
    magnified,
    no_states,
    outline,
    when,
    with_obstacles,
)
from ancf2d.plot.picture import Kind, Source
from ancf2d.plot.section_forces import FORCES
from ancf2d.results import FieldRecord, Results
from ancf2d.results.geometry import (
    POSITIVE,
    Formula,
    even_weights,
    formulas_of,
    label_of,
    linear_weights,
    station_weights,
    weights_along,
)
from ancf2d.results.obstacles import Obstacle, obstacles_of

BARE = "0.82"  # bodies without the field: a colour that neither map has
COLORS = "cividis"  # its lightness grows evenly: the same order in grey, and to colour-blind eyes
SIGNED = "RdBu_r"  # white at zero, red in tension, blue in compression
ACROSS = 9  # points drawn across a body
LINE = 1e-6  # relative to half the height: stations closer than this are the two sides of an interface between layers
MAX_ELEMENTS = 2000  # drawn per body; of more elements, a selection
FLAT = 0.025  # relative to the extent: in a thinner body a field would be invisible, so it is drawn unrolled
STRIPS = 6  # largest number of bodies drawn unrolled, one below the other; more would make the figure too high
# order of preference if no field is named
ORDER = ("stress", "strain", "energy", "plastic_strain", "pressure", "traction", "gap")


@dataclass
class Surface:
    """One body with values: points (ne, nx, ny, 2) and values (ne, nx, ny); reference outline; arclength (ne, nx).

    ``y`` (ne, nx, ny) are the points' distances from the axis, ``levels`` the labelled y of faces, axis and interfaces
    between layers, ``lines`` which of the ny points are at an interface.
    """

    name: str
    points: np.ndarray
    values: np.ndarray
    reference: Outline
    s: np.ndarray
    y: np.ndarray
    levels: list[float]
    lines: list[int]

    @property
    def height(self) -> float:
        """The height of the highest section."""
        return float(np.ptp(self.y, axis=-1).max())

    def along(self, unrolled: bool) -> np.ndarray:
        """Return the points to draw: in the plane, or over arc length and distance from the axis."""
        if not unrolled:
            return self.points
        return np.stack(np.broadcast_arrays(self.s[..., None], self.y), axis=-1)


@dataclass
class Fields:
    """The picture of one field over all bodies of one file in one state."""

    title: str
    note: str
    units: str
    what: tuple[str, str]
    surfaces: list[Surface]
    unrolled: bool
    others: list[Outline] = field(default_factory=list)  # bodies without the field, such as rigid ones
    signed: bool = False
    limits: tuple[float, float] | None = None
    box: np.ndarray | None = field(default=None, repr=False)
    obstacles: list[Obstacle] = field(default_factory=list)

    def bounds(self) -> np.ndarray:
        """Return the lower left and upper right corner of the drawing in the plane."""
        if self.box is not None:
            return self.box
        points = [p.reshape(-1, 2) for s in self.surfaces for p in (s.points, s.reference.boundary)]
        points += [other.boundary for other in self.others]
        return with_obstacles(bounds(points), self.obstacles)

    @property
    def size(self) -> tuple[float, float]:
        if self.unrolled:
            return 6.4, 1.3 + 1.5 * len(self.surfaces) + 0.5
        width, height = np.ptp(self.bounds(), axis=0)
        return 6.4, float(np.clip(5.6 * height / width if width else 5.0, 1.4, 5.2)) + 2.0

    def range(self) -> tuple[float, float]:
        """Return the values at both ends of the colours, symmetric about zero for fields of either sign."""
        if self.limits is not None:
            return self.limits
        known = np.concatenate([s.values[np.isfinite(s.values)] for s in self.surfaces])
        low, high = float(known.min(initial=np.inf)), float(known.max(initial=-np.inf))
        if not len(known):
            low = high = 0.0
        top = max(abs(low), abs(high))
        if self.signed:
            return (-top, top) if top else (-0.5, 0.5)
        return (low, high) if high > low else (low - 0.5, high + 0.5)

    def render(self, figure: Figure) -> None:
        rows = len(self.surfaces) if self.unrolled else 1
        grid = figure.subplots(rows, 1, squeeze=False)[:, 0]
        low, high = self.range()
        mesh: Any = None
        for k, surface in enumerate(self.surfaces):
            mesh = self._surface(grid[k if self.unrolled else 0], surface, low, high)
        for k, axes in enumerate(grid):
            if self.unrolled:
                self._strip(axes, self.surfaces[k], k == rows - 1)
            else:
                self._plane(axes)
            axes.grid(False)
        bar = figure.colorbar(mesh, ax=list(grid), location="bottom", aspect=40, fraction=0.06, pad=0.04)
        style.verbatim(bar.ax.set_xlabel(style.label(*self.what)))
        style.title(figure, self.title, self.note)

    def _surface(self, axes: Axes, surface: Surface, low: float, high: float) -> QuadMesh:
        if not self.unrolled:
            axes.add_artist(Polygon(surface.reference.boundary, facecolor="none", edgecolor=style.REFERENCE,
                                    linestyle="--", linewidth=0.8))
        points = surface.along(self.unrolled)
        x, y, values = (v.reshape(-1, points.shape[2]) for v in (points[..., 0], points[..., 1], surface.values))
        # element after element, without gaps between them; rasterised within vector figures, where thousands of
        # triangles would be slow and show seams
        colors = SIGNED if low == -high else COLORS
        mesh = axes.pcolormesh(x, y, values, shading="gouraud", cmap=colors, vmin=low, vmax=high, rasterized=True,
                               zorder=2)
        edge = np.concatenate([points[:, :, 0].reshape(-1, 2), points[-1, -1], points[::-1, ::-1, -1].reshape(-1, 2),
                               points[0, 0, ::-1]])
        axes.add_artist(Polygon(edge, facecolor="none", edgecolor="0.25", linewidth=0.6, zorder=3))
        for k in surface.lines:
            axes.plot(*points[:, :, k].reshape(-1, 2).T, color="0.25", linewidth=0.4, zorder=3)
        return mesh

    def _plane(self, axes: Axes) -> None:
        for other in self.others:
            axes.add_artist(Polygon(other.boundary, facecolor=BARE, edgecolor="0.25", linewidth=0.6, zorder=1.9))
        draw_obstacles(axes, self.obstacles)
        frame_plane(axes, self.bounds(), self.units)

    def _strip(self, axes: Axes, surface: Surface, last: bool) -> None:
        axes.margins(0)
        axes.set_yticks(surface.levels)
        axes.yaxis.set_major_formatter("{x:.3g}")
        name = f"{surface.name}: y" if len(self.surfaces) > 1 else "y, across"
        style.verbatim(axes.set_ylabel(style.label(name, self.units)))
        if last:
            style.verbatim(axes.set_xlabel(style.label("arc length", self.units)))

    def header(self) -> list[str]:
        unit = f" [{self.units}]"
        return ["body", "element", f"s{unit}", f"x{unit}", f"y{unit}", f"{self.what[0]} [{self.what[1]}]"]

    def rows(self) -> Iterator[Sequence[Any]]:
        for surface in self.surfaces:
            for ie in range(len(surface.values)):
                for k, values in enumerate(surface.values[ie].tolist()):
                    for (x, y), value in zip(surface.points[ie, k].tolist(), values, strict=True):
                        yield surface.name, ie, float(surface.s[ie, k]), x, y, value


def _component(record: FieldRecord, component: str | None) -> tuple[str, Formula]:
    formulas = formulas_of(record)
    name = component or next(iter(formulas))
    if name not in formulas:
        raise ResultsError(f"{record.name} has no component '{name}' (it has {', '.join(formulas)})")
    return name, formulas[name]


def _surface(results: Results, name: str, record: FieldRecord, formula: Formula, state: int, scale: float) -> Surface:
    body = results.body(name)
    ne = len(body.dofs)
    some = np.unique(np.linspace(0, ne - 1, min(ne, MAX_ELEMENTS)).astype(int))
    heights, lines = body.heights_of(some)[..., None], []
    if body.levels is None:
        at = np.linspace(0, 1, ACROSS)
        across, over, y = even_weights(3, at), station_weights(0.5 * (1.0 + record.eta), at), heights * (at - 0.5)
        named = [-0.5 * float(heights.max()), 0.0, 0.5 * float(heights.max())]
    else:
        # the stations are on both sides of each interface between layers, where stresses jump
        y = 0.5 * record.eta * heights
        across, over = linear_weights(body.levels, y[0, 0]), np.eye(len(record.eta))
        named, lines = sorted(set(body.levels.tolist())), np.flatnonzero(np.diff(record.eta) < LINE).tolist()
    points = np.einsum("ya,aemc->emyc", across, results.levels(name, state, scale=scale, elements=some))
    stored = formula(results.field(name, record.name, state)[some])
    values = np.einsum("...xi,yj,...ij->...xy", weights_along(record, body.sample_xi, some), over, stored)
    # polynomials overshoot, and could make a zero energy negative
    if np.isfinite(stored).any():
        values = np.clip(values, np.nanmin(stored), np.nanmax(stored))
    lengths = body.lengths[body.classes]
    s = (np.cumsum(lengths) - lengths)[some, None] + lengths[some, None] * body.sample_xi
    return Surface(name, points, values, outline(results, body, None, 1.0), s, y, named, lines)


def _wanted(results: Results, wanted: str | None) -> str:
    """Return the name of the field to draw: the requested one, else the first of ORDER stored over the height."""
    known = list(dict.fromkeys(n for fields in results.fields.values() for n, f in fields.items() if len(f.eta) > 1))
    if wanted is None:
        return min(known, key=lambda n: ORDER.index(n) if n in ORDER else len(ORDER))
    if wanted in FORCES:
        raise ResultsError(f"{wanted} is stored along the axis only; draw it as section_forces")
    if wanted not in known:
        raise ResultsError(f"{results.called} has no field '{wanted}' (it has {', '.join(known)}; name those to store "
                           "under output: fields: in the case)")
    return wanted


def fields(sources: Sequence[Source], *, field: str | None = None, component: str | None = None,
           scale: float | str = "auto", state: int = -1, unrolled: bool | None = None) -> Fields:
    """Build one field over the bodies of one file.

    ``field``: stress, strain, energy, plastic_strain, pressure, traction or gap (default: the first that is stored);
    ``component``: xx, yy, xy, or mises of stress; ``unrolled``: over arc length and height instead of in the plane
    (default: if bodies are thin).
    """
    results = sources[0].results
    check_state(results, state)
    name = _wanted(results, field)
    records = {body: found[name] for body, found in results.fields.items() if name in found}
    first = next(iter(records.values()))
    part, formula = _component(first, component)
    factor = chosen_scale(sources, state, scale)
    surfaces = [_surface(results, body, record, formula, state, factor) for body, record in records.items()]
    extent = float(np.ptp(bounds([s.points.reshape(-1, 2) for s in surfaces]), axis=0).max())
    flat = unrolled
    if flat is None:
        flat = len(surfaces) <= STRIPS and max(s.height for s in surfaces) < FLAT * extent
    what = (label_of(name, part), first.units)
    note = when(results, state) + ("" if flat else magnified(factor))
    others = [outline(results, b, state, factor) for n, b in results.bodies.items() if n not in records]
    return Fields(results.title, note, results.units.length, what, surfaces, flat, others, part not in POSITIVE,
                  obstacles=obstacles_of(results, state, factor))


def moving(sources: Sequence[Source], count: int, *, field: str | None = None, component: str | None = None,
           scale: float | str = "auto", unrolled: bool | None = None) -> Iterator[Fields]:
    """Yield one field in at most ``count`` states, with the same axes and colours."""
    options: dict[str, Any] = {"field": field, "component": component}
    states = even_states(sources[0].results.t, count)
    options["scale"] = chosen_scale(sources, -1, scale)
    every = [fields(sources, state=i, unrolled=unrolled, **options) for i in states]
    ranges = np.array([f.range() for f in every])
    box = bounds([f.bounds() for f in every])
    low, high = float(ranges[:, 0].min()), float(ranges[:, 1].max())
    if every[0].signed:
        low, high = -max(-low, high), max(-low, high)
    for picture in every:
        picture.limits = low, high
        picture.box, picture.unrolled = box, every[-1].unrolled
        yield picture


def _no_surface(results: Results) -> str:
    if no_states(results):
        return no_states(results)
    known = any(len(f.eta) > 1 for found in results.fields.values() for f in found.values())
    return "" if known else f"it holds no stress, strain or energy ({how_to_store(results, 'stress')})"


FIELDS = Kind("fields", "stress, strain, energy or contact over the bodies, in colour", _no_surface, fields, moving,
              single=True)
