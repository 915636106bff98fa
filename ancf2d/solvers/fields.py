"""Fields over the bodies that a case may request, and their evaluation for a state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Stiffness
from ..elements.fibres import places
from ..elements.formulations import Sampler
from ..elements.shape import Array
from ..errors import Problem
from ..interactions.contact_curves import levels_of
from ..model.mesh import BodyMesh
from ..model.model import Model

if TYPE_CHECKING:
    from .state import State

# distance from an interface of layers at which its two sides are evaluated, relative to half the height
SIDE = 1e-9
ALONG, ACROSS = 5, 5  # least number of stations along and across an element, including its ends and faces


@dataclass(frozen=True)
class OutputField:
    """A field over the bodies: component names, units (with {F}, {L}, {T}) and description.

    ``over``: also over the height, not only along the axis; ``part``: its entry in the computed results; ``kept``:
    whether it depends on history variables that a run stores, not on displacements alone; ``faces``: only on the lower
    and upper face.
    """

    name: str
    components: tuple[str, ...]
    units: str
    description: str
    over: bool
    part: str | int
    kept: bool = False
    faces: bool = False


_FORCE = "of the section, by equilibrium"
# the only place where a field is added
FIELDS: dict[str, OutputField] = {f.name: f for f in (
    OutputField("N", ("N",), "{F}", f"axial force {_FORCE}, tension positive", False, 0),
    OutputField("Q", ("Q",), "{F}", f"shear force {_FORCE}, along its y axis", False, 1),
    OutputField("M", ("M",), "{F}*{L}", f"bending moment {_FORCE}, counter-clockwise", False, 2),
    OutputField("stress", ("xx", "yy", "xy"), "{F}/{L}^2", "stress along and across the axis", True, "stress"),
    OutputField("strain", ("xx", "yy", "xy"), "1", "strain along and across the axis; xy is the angle 2 eps_xy",
                True, "strain"),
    OutputField("energy", ("energy",), "{F}/{L}^2", "strain energy per volume of the reference", True, "energy"),
    OutputField("plastic_strain", ("xx",), "1", "plastic strain of the fibres along the axis", True, "plastic", True),
    OutputField("pressure", ("pressure",), "{F}/{L}",
                "contact pressure on each face: normal force per length of the axis", False, "pressure", True, True),
    OutputField("traction", ("traction",), "{F}/{L}",
                "friction force on each face along the axis, per length", False, "traction", True, True),
    OutputField("gap", ("gap",), "{L}",
                "gap: distance of each face from the nearest surface, nan if nothing is opposite",
                False, "gap", True, True),
)}


def field_problems(model: Model, names: Sequence[str] | None = None) -> list[Problem]:
    """Return the problems of named fields, by default those a case requests, that its bodies cannot have."""
    case, source = model.case, None if model.loaded is None else model.loaded.source
    wanted = case.output.fields if names is None else names
    if source is None:
        return []
    touches = [] if case.contacts else [
        source.problem(("output", "fields", k) if names is None else (), ("output.fields: " if names is None else "")
                       + f"{name} is not available: this case has no contacts", "contacts")
        for k, name in enumerate(wanted) if FIELDS[name].faces]
    over = [k for k, name in enumerate(wanted) if FIELDS[name].over]
    bodies = [name for name, body in case.bodies.items()
              if isinstance(body.section, Stiffness) and not model.meshes[name].plan.rigid]
    if not over or not bodies:
        return touches
    what, expected = f"the section of body '{bodies[0]}' is given only by its stiffnesses", "N, Q, M"
    return touches + [
        source.problem(("output", "fields", k) if names is None else ("bodies", bodies[0], "section"),
                       ("output.fields: " if names is None else "") + f"{wanted[k]} is not known: {what}",
                       expected + ", or a section with height and width") for k in over]


@dataclass(frozen=True)
class BodyFields:
    """The fields of one body: stations ``xi`` (nx,) along each element, ``eta`` (ny,) across.

    ``fibres`` are the stations (ne, nx) of its fibres along each element, if it has any.
    """

    body: str
    fields: tuple[OutputField, ...]
    xi: Array
    eta: Array
    faces: Array
    fibres: Array | None = None

    def along(self, field: OutputField) -> Array:
        """Return the stations of a field along each element: (nx,), or (ne, nx) if they differ between elements."""
        return self.fibres if field.over and self.fibres is not None else self.xi

    def across(self, field: OutputField) -> Array:
        """Return the stations of a field across the body."""
        return self.eta if field.over else self.faces if field.faces else np.zeros(1)


class FieldReader:
    """Evaluate for states the fields that a case requests, or those given by name."""

    def __init__(self, model: Model, names: Sequence[str] | None = None) -> None:
        chosen = [FIELDS[name] for name in dict.fromkeys(model.case.output.fields if names is None else names)]
        self.model, self.bodies = model, list[BodyFields]()
        self._readers: list[tuple[BodyFields, Callable[[State], dict[OutputField, Array]]]] = []
        for name, mesh in model.meshes.items() if chosen else ():
            if not mesh.plan.rigid:
                body = BodyFields(name, tuple(chosen), *_stations(mesh), np.array(levels_of(mesh, "surface")),
                                  fibre_stations(mesh) if mesh.plan.section.laws else None)
                self.bodies.append(body)
                self._readers.append((body, _reader(model, mesh, body)))

    def read(self, state: State) -> dict[tuple[str, str], Array]:
        """Return by (body, field) the values (ne, nx, ny, components).

        ny = 1 for fields along the axis, 2 for fields on the faces.
        """
        with self.model.remembering(state.memory):
            return {(body.body, field.name): values for body, read in self._readers
                    for field, values in read(state).items()}


def fibre_stations(mesh: BodyMesh) -> Array:
    """Return the stations xi (ne, nx) of fibres along each element."""
    return np.stack([_where_fibres_bear(mesh, c.sampler) for c in mesh.classes])[mesh.cls]


def _where_fibres_bear(mesh: BodyMesh, sampler: Sampler) -> Array:
    """Return the stations (nx,) for normal force and moment of an element with fibres, which come first."""
    plan = mesh.plan
    assert plan.formulation.fibres is not None
    return plan.formulation.fibres(sampler, plan.rule)[0][:plan.rule.normal[0]]


def _stations(mesh: BodyMesh) -> tuple[Array, Array]:
    across = max(ACROSS, 2 * mesh.plan.element.degree_y + 1)
    section, along = mesh.plan.section, np.linspace(0.0, 1.0, ALONG)
    if section.laws:
        # those of Gauss, which most elements have
        xi = _where_fibres_bear(mesh, replace(mesh.classes[0].sampler, peak=0))
        return xi, places(section, mesh.plan.rule.normal[1])[0][:, 0] / (0.5 * section.height)
    if section.layers:
        # both sides of each interface
        half = 0.5 * section.height
        sides = [(layer.bottom + SIDE * half, layer.top - SIDE * half) for layer in section.layers]
        return along, np.concatenate([np.linspace(low, high, ACROSS) for low, high in sides]) / half
    return along, np.linspace(-1.0, 1.0, across)


def _reader(model: Model, mesh: BodyMesh, body: BodyFields) -> Callable[[State], dict[OutputField, Array]]:
    from .contact_fields import ContactFields
    from .section_forces import SectionForces
    from .stress import StressOfFibres, stress_of

    xi, eta = body.xi, body.eta
    over = [f for f in body.fields if f.over]
    along, faces = ([f for f in body.fields if not f.over and f.faces == known] for known in (False, True))
    stress = None
    if over:
        stress = stress_of(model, mesh, xi, eta) if body.fibres is None else StressOfFibres(
            model, mesh, body.fibres, eta)
    forces = SectionForces(model, mesh, xi) if along else None
    touching = ContactFields(model, mesh, xi) if faces else None

    def found(state: State) -> Iterator[tuple[OutputField, Any]]:
        if stress is not None:
            everything = stress(state)
            yield from ((f, getattr(everything, str(f.part))) for f in over)
        if forces is not None:
            values = forces(state)
            yield from ((f, values[:, :, None, int(f.part), None]) for f in along)
        if touching is not None:
            at_faces = touching(state)
            yield from ((f, at_faces[str(f.part)]) for f in faces)

    return lambda state: dict(found(state))
