"""The kinds of figure, the choice of one, and its drawing."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ancf2d.errors import ResultsError
from ancf2d.plot.contact import CONTACT
from ancf2d.plot.convergence import CONVERGENCE, TRADEOFF, WORK_PRECISION
from ancf2d.plot.curves import HISTORY, LOAD_DEFLECTION, MOMENT_CURVATURE, STRESS_STRAIN, near_hint
from ancf2d.plot.difference import DIFFERENCE
from ancf2d.plot.fields import FIELDS
from ancf2d.plot.modes import MODES
from ancf2d.plot.motion import ENERGY, PHASE, STEPS, TRAJECTORY
from ancf2d.plot.picture import Kind, Picture, Source
from ancf2d.plot.response import BODE, CAMPBELL, NYQUIST, ROOT_LOCUS
from ancf2d.plot.section_forces import SECTION_FORCES
from ancf2d.plot.shape import SHAPE, SNAPSHOTS
from ancf2d.plot.studies import FIT, HISTOGRAM, OPTIMISATION, SHARES, SWEEP, TORNADO
from ancf2d.plot.style import Look, lay_out, plain_ticks, style
from ancf2d.results import Results

# the only place where a kind of figure is added
KINDS: dict[str, Kind] = {k.name: k for k in (
    SHAPE, FIELDS, SECTION_FORCES, CONTACT, STRESS_STRAIN, MOMENT_CURVATURE, SNAPSHOTS, HISTORY, LOAD_DEFLECTION,
    TRAJECTORY, PHASE, MODES, CAMPBELL, ROOT_LOCUS, BODE, NYQUIST, ENERGY, STEPS, DIFFERENCE, CONVERGENCE,
    WORK_PRECISION, TRADEOFF, SWEEP, HISTOGRAM, SHARES, TORNADO, OPTIMISATION, FIT)}

Input = Results | Sequence[Results] | Mapping[str, Results]


@dataclass(frozen=True)
class KindInfo:
    """A kind for ``--list``: why a file cannot be drawn as this kind (``missing``), whether it can be animated."""

    name: str
    doc: str
    options: tuple[str, ...]
    missing: str
    moves: bool


def list_kinds(results: Results, files: int = 1) -> list[KindInfo]:
    """Return all kinds, with the data that the first of some files lacks for each (empty: none)."""
    def missing(kind: Kind) -> str:
        few = f"it compares at least {kind.least} files" if files < kind.least else ""
        return kind.missing(results) or few
    return [KindInfo(k.name, k.doc, _options(k), missing(k), k.frames is not None) for k in KINDS.values()]


def default_kind(results: Results) -> str:
    """Return the most informative kind for a file."""
    for kind in (CONVERGENCE, TRADEOFF, HISTOGRAM, SWEEP, TORNADO, OPTIMISATION, FIT, BODE):
        if not kind.missing(results):
            return kind.name
    if not MODES.missing(results):
        return MODES.name
    for kind in (HISTORY, ENERGY) if results.over_time else ():
        if not kind.missing(results):
            return kind.name
    if "limit_points" in results.summary and not LOAD_DEFLECTION.missing(results):
        return LOAD_DEFLECTION.name
    return SHAPE.name


def default_animated(results: Results) -> str:
    """Return the kind to animate if none is named: modes if there are some, else the bodies."""
    return SHAPE.name if MODES.missing(results) else MODES.name


def _options(kind: Kind, animated: bool = False) -> tuple[str, ...]:
    build = kind.frames if animated and kind.frames is not None else kind.build
    parameters = inspect.signature(build).parameters.values()
    return tuple(p.name for p in parameters if p.kind is p.KEYWORD_ONLY)


def _sources(results: Input) -> list[Source]:
    """Return the files with labels: file name or whole path, with the element types if these differ."""
    if isinstance(results, Results):
        return [Source("", results)]
    if isinstance(results, Mapping):
        return [Source(name, r) for name, r in results.items()]
    if not results:
        raise ResultsError("there is no result file to draw")
    if len(results) == 1:
        return [Source("", results[0])]
    names = [r.path.name.removesuffix(".part").removesuffix(".h5") for r in results]
    if len(set(names)) < len(names):
        names = [str(r.path) for r in results]
    types = [_types(r) for r in results]
    if len(set(types)) > 1:
        names = [f"{n} ({t})" if t and t not in n else n for n, t in zip(names, types, strict=True)]
    return [Source(name, r) for name, r in zip(names, results, strict=True)]


def _types(results: Results) -> str:
    """Return the element types in the table of a study or, without one, of the bodies."""
    table = results.tables.get("convergence", results.tables.get("tradeoff"))
    found = [b.element_type for b in results.bodies.values()] if table is None else map(str, table.get("element", []))
    return ", ".join(dict.fromkeys(found))


def chosen_kind(results: Input, kind: str | None, options: Mapping[str, Any], animated: bool = False,
                ) -> tuple[list[Source], Kind]:
    """Return the files with their labels and the chosen kind. Raises ResultsError if they do not go together."""
    sources = _sources(results)
    name = kind or (default_animated if animated else default_kind)(sources[0].results)
    if name not in KINDS:
        raise ResultsError(f"unknown kind of figure '{name}' (known: {', '.join(KINDS)})"
                           f"{near_hint(name, list(KINDS))}")
    chosen = KINDS[name]
    if chosen.single and len(sources) > 1:
        raise ResultsError(f"{name} is drawn from one file at a time, not from {len(sources)}")
    for source in sources:
        missing = chosen.missing(source.results)
        if missing:
            raise ResultsError(f"cannot draw {source.results.called} as {name}: {missing}")
    known = _options(chosen, animated)
    for option in options:
        if option not in known:
            raise ResultsError(f"{name} has no option '{option}' (it has {', '.join(known)}){near_hint(option, known)}")
    return sources, chosen


def build(results: Input, kind: str | None = None, **options: Any) -> Picture:
    """Return the picture of one or several files as a plain value; see ``draw``."""
    sources, chosen = chosen_kind(results, kind, options)
    return chosen.build(sources, **options)


def draw(results: Input, kind: str | None = None, *, figure: Figure | None = None, title: str | None = None,
         look: Look | None = None, **options: Any) -> Figure:
    """Draw one result file, or several overlaid in the same axes, and return the figure.

    ``results``: open results, a list of them, or a mapping from label to results; ``kind``: a name in KINDS (default:
    the most informative one for the first file); ``options``: those of the kind; ``figure``: an empty one to draw into;
    ``title``: instead of the case's; ``look``: its size, fonts, style file. Raises ResultsError if the kind is unknown
    or the file lacks what it needs.
    """
    picture = build(results, kind, **options)
    if title is not None:
        picture.title = title
    return rendered(picture, figure, look)


class ShownFigure(Figure):
    """A figure that notebooks show by themselves, without pyplot and magic commands."""

    def _repr_png_(self) -> bytes:
        with BytesIO() as stream:
            self.savefig(stream, format="png")
            return stream.getvalue()


def rendered(picture: Picture, figure: Figure | None = None, look: Look | None = None) -> Figure:
    """Draw a picture into a figure, a new one unless an empty one is given, and return the figure."""
    look = look or Look()
    with style(look):
        if figure is None:
            figure = ShownFigure()
            FigureCanvasAgg(figure)
        figure.set_layout_engine(ConstrainedLayoutEngine())
        figure.set_size_inches(*(look.size or picture.size))
        picture.render(figure)
        plain_ticks(figure)
        if any(axes.get_aspect() != "auto" for axes in figure.axes):
            lay_out(figure)
    return figure
