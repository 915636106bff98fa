"""Bodies as arrays: nodes, coordinates, reference values and element classes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..elements.definition import ElementType, coordinate_components, derivative_order
from ..elements.formulations import Sampler
from ..elements.registry import RIGID_FRAME
from ..elements.section import CONSTANTS, NO_CONSTANTS, Section
from ..elements.shape import Array, FrameShape, ShapeFunctions, shape_functions
from .axis import ArcAxis
from .classes import ElementClass
from .curve import AT_NODE, Piece, peaks
from .plan import BodyPlan
from .profiles import SectionsAlong, alike_along

Index = NDArray[np.int64]
# stations along an element at which its axis is examined
STATIONS = np.array([0.0, 0.5, 1.0])
# elements that are evaluated at once
BLOCK = 4096
# attributes that meshes with the same nodes and coordinates share
LAID_OUT = ("dofs", "nodes", "turn", "e0", "n_dofs", "n_nodes", "piece_first", "kinds", "coordinate_names", "starts",
            "lengths", "angles", "shares_start", "rotation", "at_nodes", "_references", "_located")


def joined(parts: list[Any]) -> Any:
    """Return arrays in one; a single one itself, because long meshes need much memory."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def straight(shape: ShapeFunctions, section: Section) -> Sampler:
    """Return the sampler of a straight element."""
    piece = Piece(ArcAxis((0.0, 0.0), 0.0, 0.0), shape.l, 0.0, 1)
    return Sampler(shape, _reference(_named(shape.element), piece, shape.element.has_theta)[0], section)


def _named(element: ElementType) -> list[tuple[float, str]]:
    """Return the place along the element and the name of each vector-valued nodal coordinate."""
    return [(element.nodes[i].at, name) for i, name in element.functionals]


def _reference(element_nodes: list[tuple[float, str]], piece: Piece, theta: bool) -> Array:
    """Return the reference coordinates (n, n_shape, components) of the elements of a piece, each in its own frame.

    In its frame an element starts at the origin along x. For constant curvature, return one element for all (n = 1).
    """
    n = piece.count
    if piece.kappa is not None:
        piece, n = replace(piece, axis=ArcAxis((0.0, 0.0), 0.0, piece.kappa), begin=0.0), 1
    starts = piece.l * np.arange(n)
    origin, first = piece.position(starts)
    c, s = np.cos(first), np.sin(first)
    out = np.zeros((n, len(element_nodes), 3 if theta else 2))
    for k, (at, name) in enumerate(element_nodes):
        r, angle = piece.position(starts + at * piece.l)
        order = derivative_order(name)
        x, y = (r - origin if order == (0, 0) else piece.derivative(starts + at * piece.l, *order)).T
        out[:, k, 0], out[:, k, 1] = c * x + s * y, c * y - s * x
        if theta:
            out[:, k, 2] = angle - first
    return out


class BodyMesh:
    """The mesh of one body.

    Elements of a piece share end nodes, and so do pieces that continue one another; at corners of a polyline and at
    kinks each piece has a node of its own, and these are welded. Coordinates are numbered node by node. ``dofs`` is
    (ne, n_dof), ``cls`` (ne,), ``turn`` (ne or 1, 2), ``e0`` (n_dofs,) the reference values of the coordinates
    first_dof, first_dof + 1, ... ``like`` is a mesh of the same body with other numbers: its classes are reused where
    they are equal, and its layout where nodes and numbering are. Without ``exactly``, classes are also reused if only
    the mean height, which scales the shape functions, differs; they then differ by round-off.
    """

    def __init__(self, plan: BodyPlan, first_dof: int, first_node: int, like: BodyMesh | None = None,
                 exactly: bool = True) -> None:
        self.plan, self.first_dof, self.first_node = plan, first_dof, first_node
        self.node_sizes = [plan.element.components * sum(c != "theta" for c in n.coordinates)
                           for n in plan.element.nodes]
        self.stride = sum(self.node_sizes[:-1])
        # cache of ``points.point_ref``, by S and y
        self.points: dict[tuple[float, float], Any] = {}
        self.classes: list[ElementClass] = []
        self._samplers: dict[tuple[Any, ...], list[Sampler]] = {}
        # warnings about the mesh, once computed
        self.warnings: list[list[str]] | None = None
        # cache of ``points.PointRef`` for positions and directions at nodes
        self.at_nodes: dict[tuple[Any, ...], Any] = {}
        # cache of ``determinacy.own_motion``
        self.rotation: Array | None = None
        self._known = {} if like is None or (exactly and like.plan.section != plan.section) else like.classes_in(plan)
        # reference coordinates of elements, each in its own frame
        self._references: dict[tuple[Any, ...], Array] = {}
        # cache of ``element_at``, by S
        self._located: dict[float, tuple[int, float, float]] = {}
        if like is not None and like._places == self._places:
            vars(self).update({name: value for name, value in vars(like).items() if name in LAID_OUT})
        else:
            self._lay_out()
        keys: dict[tuple[Any, ...], int] = {}
        # fibres are sampled where the moment peaks; Lobatto points include the nodes and need no such shift
        sought = bool(plan.section.laws) and not plan.rule.lobatto
        found = peaks(plan.pieces, plan.acting) if sought else [0] * plan.count
        self.cls: Index = np.concatenate([self._classes_of(piece, keys, found[first:first + piece.count])
                                          for piece, first in zip(plan.pieces, self.piece_first, strict=True)])

    @property
    def _places(self) -> tuple[Any, ...]:
        """Key of the layout: where the nodes are, and the numbers of nodes and coordinates."""
        return id(self.plan.element), self.first_dof, self.first_node, self.plan.pieces

    def _lay_out(self) -> None:
        """Set nodes, coordinates and their reference values."""
        element, pieces = self.plan.element, self.plan.pieces
        dofs, turn, nodes, e0 = [], [], [], []
        dof, node = self.first_dof, self.first_node
        self.piece_first: list[int] = np.cumsum([0, *(piece.count for piece in pieces[:-1])]).tolist()
        for piece in pieces:
            if piece.shared:
                dof, node = dof - self.node_sizes[-1], node - 1
            n = piece.count
            dofs.append(dof + self.stride * np.arange(n)[:, None] + np.arange(element.n_dof))
            nodes.append(node + (len(element.nodes) - 1) * np.arange(n)[:, None] + np.arange(len(element.nodes)))
            angle = piece.position(piece.l * np.arange(n))[1]
            turn.append(np.stack([np.cos(angle), np.sin(angle)], axis=1))
            values = self._reference_values(piece)
            e0.append(values[self.node_sizes[0]:] if piece.shared else values)
            dof += self.stride * n + self.node_sizes[-1]
            node += (len(element.nodes) - 1) * n + 1
        self.dofs: Index = joined(dofs)
        self.nodes: Index = joined(nodes)
        directions = np.concatenate(turn)
        straight = bool(np.all(directions == directions[0]))
        self.turn: Array = np.ascontiguousarray(directions[:1] if straight else directions)
        self.e0: Array = joined(e0)
        self.n_dofs, self.n_nodes = dof - self.first_dof, node - self.first_node

    def _classes_of(self, piece: Piece, keys: dict[tuple[Any, ...], int], peak: list[int]) -> Index:
        """Return the classes (n,) of the elements of a piece; add new ones to ``classes``."""
        found, samplers, turns = [], self._samplers_of(piece), piece.turning_angles
        length, mean, varying = float(f"{piece.l:.13e}"), self.plan.section, self.plan.varying
        begin: Array = piece.s0 + piece.l * np.arange(piece.count, dtype=float)
        along = None if varying is None else SectionsAlong(varying, begin / self.plan.length,
                                                           piece.l / self.plan.length, self.plan.cuts)
        alike = along is None and len(samplers) == 1 and not any(peak)
        starts = [None] if alike else list(range(piece.count))
        for ie in starts:
            known = self._known.get(float(begin[ie or 0]))
            if known is not None:
                if known.key not in keys:
                    keys[known.key] = len(self.classes)
                    self.classes.append(known)
                found.append(keys[known.key])
                continue
            section, profile, cuts = (mean, None, ()) if along is None else along.of(ie or 0)
            place = () if profile is None else (self.plan.name, float(begin[ie or 0]))
            k = (ie or 0) % len(samplers)
            bend = (piece.kappa,) if self._alike(piece) else (piece.axis, piece.begin + piece.l * k)
            key = (section, length, *bend, *place, peak[ie or 0])
            if key not in keys:
                keys[key] = len(self.classes)
                sampler = replace(samplers[k], section=section, profile=profile, cuts=cuts,
                                  peak=peak[ie or 0])
                self.classes.append(ElementClass(sampler, key, float(turns[ie or 0])))
            found.append(keys[key])
        return np.array(found * (piece.count // len(found)))

    def classes_in(self, plan: BodyPlan) -> dict[float, ElementClass]:
        """Return the classes of elements that another plan of the body leaves unchanged, by element start [m]."""
        own = self.plan
        if own.varying is None or plan.varying is None or plan.pieces != own.pieces or any(
                getattr(plan, name) != getattr(own, name) for name in ("element", "formulation", "rule", "name")):
            return {}
        if any(getattr(plan.section, name) != getattr(own.section, name) for name in ("nu", *NO_CONSTANTS)):
            return {}
        same = alike_along(own.varying.body, plan.varying.body, self.starts / own.length, self.lengths / own.length)
        return {begin: self.classes[k] for begin, k in zip(self.starts[same].tolist(), self.cls[same].tolist(),
                                                           strict=True)}

    def _samplers_of(self, piece: Piece) -> list[Sampler]:
        """Return the samplers of a piece's elements with the mean section; only one for constant curvature."""
        plan = self.plan
        key = (piece.l, piece.kappa) if self._alike(piece) else (piece.l, piece.axis, piece.begin)
        if plan.element is RIGID_FRAME:
            return [self._frame_sampler(piece)]
        if key not in self._samplers:
            shape = shape_functions(plan.element, piece.l, plan.section.height, plan.section.nu)
            if key not in self._references:
                self._references[key] = _reference(_named(plan.element), piece, plan.element.has_theta)
            self._samplers[key] = [Sampler(shape, e0, plan.section) for e0 in self._references[key]]
        return self._samplers[key]

    def _alike(self, piece: Piece) -> bool:
        """Return whether all elements of a piece have the same reference up to a rotation."""
        return piece.kappa is not None and self.plan.element is not RIGID_FRAME

    def _frame_sampler(self, piece: Piece) -> Sampler:
        """Return the sampler of a piece (one element) of a rigid body whose frame is at the body's start."""
        plan, first = self.plan, self.plan.pieces[0]
        origin, turn = complex(*first.start), np.exp(-1j * first.angle)

        def curve(x: Array, n: int) -> list[Any]:
            z = piece.position(x)[0] @ np.array([1.0, 1.0j])
            return [(z - origin) * turn, *(piece.axis.derivatives(piece.begin + x, n) * turn)]

        back = np.exp(-1j * piece.angle)
        e0 = np.array([(origin - complex(*piece.start)) * back, back / turn, 1j * back / turn])
        shape = FrameShape(RIGID_FRAME, piece.l, plan.section.height, curve)
        return Sampler(shape, np.stack([e0.real, e0.imag], axis=1), plan.section)

    def straight(self, one: ElementClass, length: float | None = None) -> Sampler:
        """Return the sampler of a straight element of ``length`` (default: that of the class) with the mean section."""
        plan = self.plan
        shape = shape_functions(plan.element, length or one.shape.l, plan.section.height, plan.section.nu)
        return straight(shape, plan.section)

    def uniform(self, one: ElementClass) -> Sampler:
        """Return the sampler of a class with the body's mean section along the whole element."""
        return replace(one.sampler, section=self.plan.section, profile=None, cuts=())

    def _reference_values(self, piece: Piece) -> Array:
        """Return e0 of one piece, node by node."""
        element, n, nc = self.plan.element, piece.count, self.plan.element.components
        if element is RIGID_FRAME:
            x, y = np.cos(self.plan.pieces[0].angle), np.sin(self.plan.pieces[0].angle)
            return np.array([*self.plan.pieces[0].start, x, y, -y, x])
        out = np.zeros(self.stride * n + self.node_sizes[-1])
        offset = 0
        for k, spec in enumerate(element.nodes):
            if k == len(element.nodes) - 1:
                break
            s = piece.l * (np.arange(n + 1 if k == 0 else n) + spec.at)
            r, theta = piece.position(s)
            for c in spec.coordinates:
                if c == "theta":
                    continue
                i, j = derivative_order(c)
                value = r if (i, j) == (0, 0) else piece.derivative(s, i, j)
                for m in range(nc):
                    out[offset + m::self.stride][:len(s)] = theta if m == 2 else value[:, m]
                offset += nc
        return out

    def tile(self, pattern: Sequence[float]) -> Array:
        """Return values per element coordinate repeated over all elements of the body (n_dofs,), shared nodes once."""
        parts: list[Array] = []
        for piece in self.plan.pieces:
            if piece.shared:
                parts.pop()
            parts += [np.tile(pattern[:self.stride], piece.count), np.asarray(pattern[-self.node_sizes[-1]:])]
        return np.concatenate(parts)

    @cached_property
    def shape_weights(self) -> Array:
        """The displacement [m] that a unit of each shape function's coordinate stands for (n_shape,).

        1 for r, l for r_x, h/2 for r_y, ...
        """
        half, l = self.plan.section.height / 2, max(p.l for p in self.plan.pieces)
        orders = [derivative_order(name) for _, name in self.plan.element.functionals]
        return np.array([l**i / factorial(i) * half**j / factorial(j) for i, j in orders])

    @cached_property
    def weights(self) -> Array:
        """The displacement that a unit of each coordinate stands for (n_dofs,): 1 for r, l for r_x, h/2 for r_y [m]."""
        element, half = self.plan.element, self.plan.section.height / 2
        return self.tile([v for w in self.shape_weights.tolist()
                          for v in ([w, w] if element.components == 2 else [w, w, half])])

    @cached_property
    def gradients(self) -> Array:
        """Rotation or strain that a unit of an element's coordinate stands for (n_dof,): 0 for r; 1 for r_x, theta."""
        element, half = self.plan.element, self.plan.section.height / 2
        l = max(p.l for p in self.plan.pieces)
        orders = [derivative_order(name) for _, name in element.functionals]
        sizes = [w * max(i / l, j / half) for w, (i, j) in zip(self.shape_weights.tolist(), orders, strict=True)]
        return np.array([v for g in sizes for v in ([g, g] if element.components == 2 else [g, g, 1.0])])

    @cached_property
    def blocks(self) -> list[slice]:
        """The elements in blocks: evaluated at once, long bodies would need much memory."""
        return [slice(k, k + BLOCK) for k in range(0, len(self.dofs), BLOCK)]

    def largest_gradient(self, d: Array) -> float:
        """Return the largest rotation or strain that displacements d (n_full,) of the coordinates stand for."""
        most, gradients = [], self.gradients
        for block in self.blocks:
            part = d[self.dofs[block]]
            most.append((gradients * np.abs(part, out=part)).max())
        # NaN if any is
        return float(most[0] if len(most) == 1 else np.max(most))

    @cached_property
    def kinds(self) -> NDArray[np.int8]:
        """Kind of each coordinate (n_dofs,): 0, 1 for x, y of r; 2 for theta; 3, 4 for x, y of a gradient."""
        nc = self.plan.element.components
        pattern = [m if name == "r" else m + 3 for _, name in self.plan.element.functionals for m in range(nc)]
        return self.tile(pattern).astype(np.int8)

    @cached_property
    def coordinate_names(self) -> tuple[tuple[str, ...], ...]:
        """Names of the coordinates of each node of an element."""
        element = self.plan.element
        return tuple(tuple(name for c in n.coordinates if c != "theta"
                           for name in coordinate_components(c, element.has_theta)) for n in element.nodes)

    @cached_property
    def starts(self) -> Array:
        """Arc length at which each element starts (ne,)."""
        return np.concatenate([p.s0 + p.l * np.arange(p.count) for p in self.plan.pieces])

    @cached_property
    def lengths(self) -> Array:
        """Reference length of each element (ne,)."""
        return np.repeat([p.l for p in self.plan.pieces], [p.count for p in self.plan.pieces])

    @cached_property
    def angles(self) -> Array:
        """Angle of the reference tangent at the start of each element (ne,)."""
        return np.concatenate([p.position(p.l * np.arange(p.count))[1] for p in self.plan.pieces])

    def piece_of(self, ie: int) -> tuple[Piece, int]:
        """Return the piece that contains an element, and the element's number in the piece."""
        k = int(np.searchsorted(self.piece_first, ie, side="right")) - 1
        return self.plan.pieces[k], ie - self.piece_first[k]

    def angles_at(self, elements: Index, xi: Array) -> Array:
        """Return the angles of the reference tangent (m, stations) at xi (m, stations) of elements (m,)."""
        if len(self.plan.pieces) == 1:
            if self.plan.pieces[0].kappa == 0.0:
                return np.full(xi.shape, self.angles[0])
            return self.plan.pieces[0].position(self.plan.pieces[0].l * (elements[:, None] + xi))[1]
        piece = np.searchsorted(self.piece_first, elements, side="right") - 1
        out = np.empty(xi.shape)
        for k in np.unique(piece):
            here, p = piece == k, self.plan.pieces[k]
            out[here] = p.position(p.l * ((elements[here] - self.piece_first[k])[:, None] + xi[here]))[1]
        return out

    def sections(self, xi: Array) -> Section:
        """Return the section constants at stations xi (n,) of all elements: arrays (ne, n) where they vary."""
        if self.plan.varying is None:
            return self.plan.section
        found = [one.sampler.at(xi) for one in self.classes]
        arrays: dict[str, Any] = {}
        for name in CONSTANTS:
            arrays[name] = np.array([np.broadcast_to(getattr(s, name), len(xi)) for s in found])[self.cls]
        return Section(**arrays)

    @cached_property
    def shares_start(self) -> NDArray[np.bool_]:
        """Return whether each element shares its first node with the last one of the element before (ne,)."""
        return np.concatenate([[False], self.nodes[1:, 0] == self.nodes[:-1, -1]])

    def element_at(self, s: float) -> tuple[int, float, float]:
        """Return (element, xi in [0, 1], reference angle) of the point at fraction s of the arc length."""
        if s not in self._located:
            self._located[s] = self._find_element(s)
        return self._located[s]

    def _find_element(self, s: float) -> tuple[int, float, float]:
        k, sigma = self.plan.locate(s)
        piece = self.plan.pieces[k]
        ie = min(int(sigma / piece.l * (1 + 1e-12)), piece.count - 1)
        xi = min(max(sigma / piece.l - ie, 0.0), 1.0)
        for spec in self.plan.element.nodes:
            if abs(xi - spec.at) < AT_NODE:
                xi = spec.at
        return self.piece_first[k] + ie, xi, float(piece.position(sigma)[1])

    def node_dofs(self, ie: int, k: int) -> Index:
        """Return the coordinates of node k of element ie."""
        start = sum(self.node_sizes[:k])
        return self.dofs[ie, start:start + self.node_sizes[k]]

    @property
    def can_part(self) -> bool:
        """Return whether faces of compressed neighbours can separate: common coefficients, and shorter than high."""
        return self.plan.element.common_coefficients and bool(
            np.any(self.lengths < np.transpose(self.sections(np.array([0.5])).height)))

    @property
    def seams(self) -> list[tuple[int, bool]]:
        """The first element after each node that pieces do not share, and whether strains can jump there.

        For a closed body this includes its start.
        """
        return [(first, p.kink) for first, p in zip(self.piece_first, self.plan.pieces, strict=True)
                if (first > 0 or self.plan.closed) and not p.shared]
