"""Bodies: geometry, section, material, element."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from ..binder import Issue
from ..declare import key, record
from ..kinds import Choice, Integer, Known, ListOf, Number, Text, Vector
from ..records import ByKeys, ByShape, OneOf, Record
from .geometry import Geometry
from .materials import Material
from .profiles import Profile, ProfileOf

SECTION_KEYS = ("EA", "kGA", "EI", "rhoA", "rhoI")


@record
class Rectangle:
    """A rectangular section."""

    height: float | Profile = key(ProfileOf("m", gt=0), "Height, in the plane", example=0.1)
    width: float | Profile = key(ProfileOf("m", gt=0), "Width, out of the plane", example=0.1)


@record
class AreaSection:
    """A section of any shape, given by its area and second moment of area."""

    A: float | Profile = key(ProfileOf("m^2", gt=0), "Area", example=6)
    I: float | Profile = key(ProfileOf("m^4", gt=0), "Second moment of area", example=2)
    height: float | Profile = key(ProfileOf("m", gt=0), "Actual height of the section, in the plane", example=2)


@record(kw_only=True)
class Stiffness:
    """A section given by its stiffnesses, in place of dimensions and material."""

    EA: float | Profile = key(ProfileOf("N", gt=0), "Axial stiffness", example=2.8e7)
    kGA: float | Profile | None = key(ProfileOf("N", gt=0), "Shear stiffness, shear factor included",
                            default=None,
                            example=1e7)
    EI: float | Profile = key(ProfileOf("N m^2", gt=0), "Bending stiffness", example=1.4e4)
    rhoA: float | Profile | None = key(ProfileOf("kg/m", gt=0), "Mass per length", default=None)
    rhoI: float | Profile | None = key(ProfileOf("kg m", ge=0), "Rotary inertia per length", default=None)


@record
class LayerOf:
    """A layer of a section."""

    height: float = key(Number("m", gt=0), "Height, in the plane", example=1e-3)
    material: Material = key(Record(Material), "Material")


@record
class Layers:
    """A section of layers, each with its own material, in place of a material of the body."""

    width: float | Profile = key(ProfileOf("m", gt=0), "Width, out of the plane", example=0.01)
    layers: tuple[LayerOf, ...] = key(ListOf(Record(LayerOf), "layers", 1), "Layers, from bottom (negative y) to top")
    axis: float | str = key(ByShape(number=Number("m", ge=0), text=Choice("middle", "centroid")),
                            "Position of the axis: in the middle of the height, at the centroid of stiffness, or at a "
                            "distance above the lower face", default="middle")

    def check(self) -> Iterator[Issue]:
        """Yield an issue for an axis outside of the section, and for materials that layers cannot have."""
        if isinstance(self.axis, float) and self.axis > sum(layer.height for layer in self.layers):
            yield Issue(("axis",), f"{{}}.axis must be within the height, got {self.axis:g}")
        for k, layer in enumerate(self.layers):
            for name in ("E", "nu"):
                if getattr(layer.material, name) is None:
                    yield Issue(("layers", k, "material"), f"{{}}.layers.{k}.material.{name} is missing")
            if layer.material.viscoelastic != self.layers[0].material.viscoelastic:
                yield Issue(("layers", k, "material"), f"{{}}.layers.{k}.material relaxes differently from the lowest "
                            "layer", "the same viscoelastic in all layers")
            if not isinstance(layer.material.E, float | None) or not isinstance(layer.material.rho, float | None):
                yield Issue(("layers", k, "material"), f"{{}}.layers.{k}.material varies along the body",
                            "constant numbers in the materials of layers")
            if layer.material.law == "neo_hooke":
                yield Issue(("layers", k, "material", "law"), f"{{}}.layers.{k}.material.law: neo_hooke is not "
                            "available for layers", "linear, or a section {height, "
                            "width}")
            if layer.material.damping is not None:
                yield Issue(("layers", k, "material", "damping"), f"{{}}.layers.{k}.material.damping: layers cannot "
                            "have damping of their own", "damping.rayleigh of "
                            "the case")


Section = Rectangle | AreaSection | Stiffness | Layers


POINTS_RULE = Vector(Integer(1, 20), "nx, ny")


@record
class Selective:
    """Different numbers of Gauss points for the normal strains and for the shear strain."""

    normal: tuple[int, int] = key(POINTS_RULE, "Gauss points along and across, normal strains",
                                  example=[2, 2])
    shear: tuple[int, int] = key(POINTS_RULE, "Gauss points along and across, shear strain",
                                 example=[1, 1])


QUADRATURE = ByShape(text=Choice("exact"), list=POINTS_RULE, map=Record(Selective))
SHEAR_FACTOR = ByShape(number=Number("", gt=0, le=10), text=Choice("timoshenko", "none"))
ORDER = Vector(Integer(1, 8), "p, q")
NODES = ByShape(text=Choice("acting", "regular"), list=ListOf(Number(ge=0, le=1), "numbers", 2))


@record
class Element:
    """The element type and mesh of a body; with ``element: auto``, ancf2d chooses both."""

    type: str = key(Known("element_types", "auto", "user"), "Element type, or auto",
                    default="user", example="2d2n")
    count: int | None = key(Integer(), "Number of elements; a polyline or path needs at least one per piece "
                            "(default if nodes are listed: one between each two)", default=None, example=8)
    order: tuple[int, int] | None = key(
        ORDER, "Polynomial degrees of type ancf along (p, 1 to 8) and across (q, 1 to 5)", default=None,
        example=[2, 1])
    formulation: str | None = key(Known("formulations"), "Formulation of the elastic forces "
                                  "(default: the one recommended for the type)", default=None)
    quadrature: Any = key(QUADRATURE, "Gauss points along and across, exact, or separately for "
                          "{normal, shear}", default=None, example=[2, 2])
    fibres: int | None = key(Integer(2, 1000), "Fibres through each layer of a material that yields or follows a curve "
                             "(default: 16, or ny of the quadrature; with an accuracy, as many as it takes)",
                             default=None, example=32)
    shear_factor: float | str | None = key(
        SHEAR_FACTOR, "Shear correction: a number, timoshenko for 10(1+nu)/(12+11nu), "
        "none for 1", default=None)
    preset: str | None = key(Choice("paper"), "paper: as in the paper (continuum, shear factor "
                             "0.5, 2 x 2 Gauss points)", default=None)
    definition: str | None = key(Text("the name of a file"), "File that defines an element of your own, relative to "
                                 "the case", default=None)
    nodes: str | tuple[float, ...] | None = key(
        NODES, "Placement of nodes. acting: a node wherever a support, joint, "
        "spring, mass or load acts, and at the ends of line loads; count is divided among the "
        "stretches between these points in proportion to their lengths, with at least one "
        "element each, all of equal length. regular: "
        "all elements of a straight piece or arc are equally long (default: acting; "
        "regular with preset paper). A list: elements end at these places S from 0 to 1 and wherever something "
        "acts; count, if given, is divided equally among the stretches of the list", default=None)
    grading: float | Profile | None = key(
        ProfileOf(gt=0), "Unequal elements. A number: the length of elements at the end of the body over that at its "
        "start, in a geometric series between. A profile in s: lengths are proportional to it (default: equal)",
        default=None, example=10)
    refine: int | None = key(Integer(), "Divide each of the 'count' elements into this many; all nodes of the coarser "
                             "mesh remain nodes (default: 1)", default=None)
    mass: float | None = key(Number("kg", gt=0), "Mass of a rigid body (default: that of its section)", default=None)
    inertia: float | None = key(Number("kg m^2", gt=0), "Moment of inertia of a rigid body about its centre of mass "
                                "(default: that of its section)", default=None)

    def written(self) -> Any:
        """Return ``auto`` if the element is that alone, else None for the mapping of its keys."""
        return "auto" if self == Element("auto") else None

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each key that excludes, or lacks, another."""
        if self.type == "user" and self.definition is None:
            yield Issue((), "{}.type is missing: the element type, or 'definition' for an element of your own")
        if self.definition is not None and self.type != "user":
            yield Issue(("definition",), f"{{}}: type {self.type} and a definition exclude each "
                        "other", "type user, or no type, with 'definition'")
        if self.type == "auto":
            given = [k for k in ("count", "nodes", "grading", "refine", "order", "formulation", "quadrature",
                                 "shear_factor", "preset") if getattr(self, k) is not None]
            if given:
                yield Issue((given[0],), f"{{}}: {given[0]} cannot be given with type auto, which chooses it")
        elif self.number is None and self.type != "rigid":
            yield Issue((), "{}.count is missing: number of elements", "a whole number >= 1")
        yield from self._places()
        if (self.type == "ancf") != (self.order is not None):
            yield (Issue((), "{}.order is missing: type ancf needs its degrees [p, q]",
                         "p from 1 to 8, q from 1 to 5") if self.type == "ancf" else
                   Issue(("order",), f"{{}}: order is for type ancf only, not for {self.type}"))
        elif self.order is not None and self.order[1] > 5:
            yield Issue(("order", 1), f"{{}}.order: q must be from 1 to 5, got {self.order[1]}")
        if self.type != "rigid":
            for k in ("mass", "inertia"):
                if getattr(self, k) is not None:
                    yield Issue((k,), f"{{}}: {k} is for type rigid only, not for {self.type}")

    @property
    def number(self) -> int | None:
        """The number of elements before refinement: count, or one between each two of the given nodes."""
        return self.count if self.count is not None or not isinstance(self.nodes, tuple) else len(self.nodes) - 1

    def _places(self) -> Iterator[Issue]:
        if not isinstance(self.nodes, tuple):
            return
        if self.grading is not None:
            yield Issue(("grading",), "{}: nodes and grading exclude each other", "one of the two")
        for i, (a, b) in enumerate(pairwise(self.nodes)):
            if not a < b:
                yield Issue(("nodes", i + 1), f"{{}}.nodes must increase, got {b:g} after {a:g}")
                return
        for i, end in ((0, 0.0), (len(self.nodes) - 1, 1.0)):
            if self.nodes[i] != end:
                yield Issue(("nodes", i), f"{{}}.nodes must run from 0 to 1, got {self.nodes[i]:g} "
                            f"{'at the start' if i == 0 else 'at the end'}", f"{end:g}")
        if self.count is not None and self.count < len(self.nodes) - 1:
            yield Issue(("count",), f"{{}}.count must be >= {len(self.nodes) - 1}, one element between two of the "
                        f"nodes given, got {self.count}")


# keys that other programs put below a body -> their places here
OTHERS = {"support": "boundary_conditions of the case", "supports": "boundary_conditions of the case",
          "load": "loads of the case", "loads": "loads of the case", "nodes": "element.count", "mesh": "element"}


@record(kw_only=True)
class Body:
    """A beam, a cable or a rigid bar."""

    other_names = OTHERS
    geometry: Geometry = key(OneOf(Geometry), "Reference axis")
    section: Section | None = key(
        ByKeys((Stiffness, SECTION_KEYS), (AreaSection, ("A", "I")), (Layers, ("layers",)), (Rectangle, ())),
        "Cross-section", default=None)
    material: Material | None = key(Record(Material), "Material", default=None)
    element: Element = key(Record(Element, short="type", what="auto"), "Element type and mesh")

    @property
    def materials(self) -> tuple[Material, ...]:
        """The material, or those of the layers; empty if the section gives the stiffnesses."""
        if isinstance(self.section, Layers):
            return tuple(layer.material for layer in self.section.layers)
        return () if self.material is None else (self.material,)

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each conflict between the parts of the body."""
        least, count = self.geometry.least, self.element.count
        if count is not None and count < least:
            yield Issue(("element", "count"), f"{{}}.element.count must be >= {least}, one "
                        f"element for each piece of the {self.geometry.tag}, got {count}")
        rigid = self.element.type == "rigid"
        if isinstance(self.section, Stiffness):
            for k in ("E", "nu", "rho", "yield_", "stress_strain"):
                if self.material is not None and getattr(self.material, k) is not None:
                    name = k.rstrip("_")
                    yield Issue(("material", name), f"{{}}.material.{name} cannot be given: the section "
                                "gives the stiffnesses")
        elif isinstance(self.section, Layers):
            if self.material is not None:
                yield Issue(("material",), "{}.material cannot be given: each layer has one")
            if rigid:
                yield Issue(("section",), "{}.section: a rigid body has no layers",
                            "{height, width}, or mass and inertia")
        elif not rigid:
            yield from self._stiffness()

    def _stiffness(self) -> Iterator[Issue]:
        if self.section is None:
            yield Issue((), "{}.section is missing", "{height, width}, "
                        "{A, I, height}, {width, layers} or {EA, kGA, EI, rhoA, rhoI}")
        if self.material is None:
            yield Issue((), "{}.material is missing", "{E, nu} and rho where mass "
                        "matters")
            return
        if self.material.E is None:
            yield Issue(("material",), "{}.material.E is missing: Young's modulus",
                        "a number > 0")
        if self.material.nu is None and self.element.type != "cable":
            yield Issue(("material",), "{}.material.nu is missing: Poisson's ratio",
                        "a number in (-1, 0.5)")
