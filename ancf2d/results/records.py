"""Records of a result file: bodies for drawing, named columns, and the units of each quantity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ancf2d.errors import ResultsError
from ancf2d.quantities import QUANTITIES, UNIT_OF

FORMAT = "ancf2d-results"
FORMAT_VERSION = 1
# solvers whose states belong to times
OVER_TIME = ("dynamic", "quasi_static")
# words for events, after the name of the item that begins or ends
EVENT_WORDS = "begins", "ends"
SECTION_KINDS = ("interpolated", "tangent", "theta")


@dataclass(frozen=True)
class Column:
    """One named column of numbers: ``units`` is a template such as ``"{F}*{L}"``.

    ``{L}``, ``{F}`` and ``{T}`` stand for the case's units of length, force and time; counts are stored as 64-bit
    integers, everything else as doubles.
    """

    name: str
    units: str = "1"
    description: str = ""
    integer: bool = False


@dataclass
class BodyRecord:
    """Data to draw one body from the nodal coordinates: its elements, shape functions and section.

    r(xi, eta) = sum_k S_k e_k with e_k = e[dofs[ie, k*nc : k*nc + 2]] (nc = 3 with an angle as the third component for
    ``theta``, else 2). There are ``ne`` elements with ``nd`` coordinates, ``nn`` nodes, ``nshape`` shape functions and
    ``ns`` samples along the axis.

    dofs (ne, nd); nodes (ne, nn) global node numbers; node_shape (nn,) the shape function of r at that node; classes
    (ne,) row of lengths, sample_S, sample_S_x; lengths (nclass,) [length]; sample_xi (ns,) in [0, 1]; sample_S (nclass,
    3 + k, ns, nshape) at the lower face, the axis, the upper face and k lines between layers; sample_S_x (nclass, ns,
    nshape) = dS/dx on the axis [1/length]; arclength (ne + 1,) in [0, 1]. ``section_kind`` gives the position of the
    faces: ``interpolated`` (by r at eta = -1, 1), ``tangent`` (h/2 along the normal of r_x) or ``theta`` (h/2 along the
    section's angle). ``heights`` (ne, ns) [length] are those of the sections at the samples if the height varies;
    ``height`` and ``width`` are then means. ``levels`` (3 + k,) [length] are y of both faces, the axis and the lines
    between layers in the order of sample_S, None if they are -h/2, 0, h/2.
    """

    name: str
    element_type: str
    formulation: str
    height: float
    width: float
    section_kind: str
    dofs: np.ndarray
    nodes: np.ndarray
    node_shape: np.ndarray
    classes: np.ndarray
    lengths: np.ndarray
    sample_xi: np.ndarray
    sample_S: np.ndarray
    sample_S_x: np.ndarray
    arclength: np.ndarray
    coordinate_names: tuple[str, ...] = field(default=())
    heights: np.ndarray | None = None
    levels: np.ndarray | None = None

    def heights_of(self, elements: np.ndarray) -> np.ndarray:
        """Return the heights (n, ns) [length] of the sections of elements (n,), 0 if they are unknown."""
        if self.heights is not None:
            return self.heights[elements]
        return np.full((len(elements), len(self.sample_xi)), self.height if np.isfinite(self.height) else 0.0)

    @property
    def components(self) -> int:
        """Components per shape function: x, y, and theta if the section has its own angle."""
        return 3 if self.section_kind == "theta" else 2

    def check(self, nq: int) -> None:
        """Raise ResultsError unless all arrays fit each other and the ``nq`` nodal coordinates."""
        if self.section_kind not in SECTION_KINDS:
            known = ", ".join(SECTION_KINDS)
            raise ResultsError(f"body '{self.name}': unknown section kind '{self.section_kind}' "
                               f"(known: {known})")
        if self.dofs.ndim != 2 or self.nodes.ndim != 2 or self.sample_S.ndim != 4:
            raise ResultsError(f"body '{self.name}': wrong dimension of dofs, nodes or sample_S")
        (ne, nd), (nclass, _, ns, nshape) = self.dofs.shape, self.sample_S.shape
        wanted: dict[str, tuple[int, ...]] = {
            "nodes": (ne, len(self.node_shape)), "classes": (ne,), "lengths": (nclass,),
            "sample_xi": (ns,), "sample_S": (nclass, 3 if self.levels is None else len(self.levels), ns, nshape),
            "sample_S_x": (nclass, ns, nshape), "arclength": (ne + 1,),
            "dofs": (ne, self.components * nshape),
        }
        if self.heights is not None:
            wanted["heights"] = (ne, ns)
        if self.levels is not None and len(self.levels) < 3:
            raise ResultsError(f"body '{self.name}': levels are not those of faces and axis")
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise ResultsError(f"body '{self.name}': {name} has shape "
                                   f"{getattr(self, name).shape}, expected {shape}")
        if self.coordinate_names and len(self.coordinate_names) != nd:
            raise ResultsError(f"body '{self.name}': {len(self.coordinate_names)} coordinate names "
                               f"for {nd} coordinates per element")
        for name, top in (("dofs", nq), ("classes", nclass), ("node_shape", nshape),
                          ("nodes", None)):
            array = getattr(self, name)
            if array.dtype.kind not in "iu":
                raise ResultsError(f"body '{self.name}': {name} are not whole numbers")
            if array.size and (array.min() < 0 or (top is not None and array.max() >= top)):
                raise ResultsError(f"body '{self.name}': {name} points outside its range")


@dataclass(frozen=True)
class FieldRecord:
    """A field stored over a body at stations along and across its elements; ``units`` is a template as in Column.

    ``xi`` (nx,) in [0, 1] are the stations along an element, or (ne, nx) if each element has its own, and ``eta`` (ny,)
    in [-1, 1] those across it. The values of a state are (ne, nx, ny, components).
    """

    body: str
    name: str
    components: tuple[str, ...]
    units: str
    description: str
    xi: np.ndarray
    eta: np.ndarray

    @property
    def stations(self) -> tuple[int, int]:
        """Numbers of stations along and across an element."""
        return self.xi.shape[-1], len(self.eta)

    def xi_of(self, ie: int) -> np.ndarray:
        """Return the stations (nx,) along an element."""
        return self.xi if self.xi.ndim == 1 else np.asarray(self.xi[ie])


# units of quantities, with the labels of a file
_LABELS = {"m": "{L}", "rad": "rad", "m/s": "{L}/{T}", "rad/s": "rad/{T}", "N": "{F}", "N m": "{F}*{L}"}
_PROBE: dict[str, Column] = {name: Column(name, _LABELS[UNIT_OF[name]], q.words) for name, q in QUANTITIES.items()} | {
    "s": Column("s", "1", "position of a moving point on its body, as a share of the arc length")}
_HISTORY: dict[str, Column] = {c.name: c for c in (
    Column("t", "{T}", "time"), Column("dt", "{T}", "step size"),
    Column("step", "1", "number of the step", True),
    Column("factor", "1", "load factor, or time"),
    Column("iterations", "1", "Newton iterations of the step", True),
    Column("residual", "1", "residual after the last iteration, relative to the forces' scale"),
    Column("increment", "1", "last Newton increment, relative to the coordinates' scale"),
    Column("cutbacks", "1", "number of times the step was halved before it converged", True),
    Column("negative_pivots", "1", "negative pivots of the tangent: critical loads passed", True),
    Column("energy", "{F}*{L}", "strain energy"), Column("strain", "{F}*{L}", "strain energy"),
    Column("kinetic", "{F}*{L}", "kinetic energy"),
    Column("potential", "{F}*{L}", "potential energy of the loads, from the reference"),
    Column("work", "{F}*{L}", "work done by loads without a potential and by moving supports"),
    Column("dissipated", "{F}*{L}", "energy lost in dampers and material"),
    Column("rejected", "1", "number of rejected attempts at the step, each repeated smaller", True),
    Column("error", "1", "estimate of the step's local error, relative to the size of the motion"),
    Column("violation", "1", "largest violation of a constraint, relative to its own size"),
)}
_TABLE: dict[str, Column] = {c.name: c for c in (
    Column("hz", "1/{T}", "frequency"),
    Column("element", "none", "element type"), Column("formulation", "none", "formulation"),
    Column("elements", "1", "number of elements", True),
    Column("dofs", "1", "nodal coordinates before elimination", True),
    Column("error", "1", "relative error of the goal's value"),
    Column("order", "1", "observed order of convergence between this row and the one before"),
    Column("wall_s", "s", "measured time of the solve alone"),
    Column("t", "{T}", "time"), Column("contact", "none", "name of the contact"),
    Column("body", "none", "body that has the point of contact with the largest impulse"),
    Column("touched", "none", "obstacle or body that it hits"),
    Column("S", "1", "position of that point on its body, as a share of the arc length"),
    Column("points", "1", "points of contact that have an impulse, of all contacts", True),
    Column("impulse", "{F}*{T}", "sum of their normal impulses"),
    Column("lost", "{F}*{L}", "energy lost in the impact"),
)}
_PARTS = {"re": "real", "im": "imaginary"}
_REGISTRY = {"probe": _PROBE, "history": _HISTORY, "table": _TABLE}


def known_column(role: str, name: str) -> Column:
    """Return the column with units and description by its name; ``role`` is probe, history or table."""
    part = _PARTS.get(name.rpartition(".")[2])
    quantity = _PROBE.get(name.split(".")[-2]) if role == "table" and part is not None and "." in name else None
    if quantity is not None:  # INPUT.PROBE.QUANTITY.re
        return Column(name, quantity.units, f"{part} part of the amplitude: {quantity.description}")
    return _REGISTRY[role].get(name) or Column(name, "1", name.replace("_", " "))


@dataclass(frozen=True)
class Units:
    """The labels of a consistent set of units; they are written but never converted."""

    length: str = "m"
    force: str = "N"
    time: str = "s"

    def fill(self, template: str) -> str:
        """Return a template with ``{L}``, ``{F}`` and ``{T}`` filled in."""
        for mark, unit in (("{L}", self.length), ("{F}", self.force), ("{T}", self.time)):
            template = template.replace(mark, unit)
        return template


def escape(name: str) -> str:
    """Return a user's name as one HDF5 link name, without ``/`` or a lone ``.``, which are special there."""
    name = name.replace("%", "%25").replace("/", "%2F")
    return name.replace(".", "%2E") if set(name) == {"."} else name


def unescape(key: str) -> str:
    """Undo ``escape``."""
    return key.replace("%2E", ".").replace("%2F", "/").replace("%25", "%")


def short_names(paths: Sequence[str]) -> list[str]:
    """Return the shortest ends of dotted paths that are unique; the index of an item is kept with its list."""
    def end(path: str, parts: int) -> str:
        return ".".join(path.split(".")[-parts:])

    out = []
    for path in paths:
        ends = (end(path, k) for k in range(1, path.count(".") + 1))
        out.append(next((e for k, e in enumerate(ends, 1)
                         if not e[0].isdigit() and sum(end(p, k) == e for p in paths) == 1), path))
    return out
