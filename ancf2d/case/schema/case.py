"""The whole case, and its sections about motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

from ...errors import PluginError
from ..binder import INVALID, Binder, Issue, Path, dotted, nearest
from ..declare import key, record
from ..kinds import Integer, ListOf, MapOf, Number, Text, Vector
from ..nodes import Node, quoted
from ..records import ByShape, OneOf, Record, Registered, RegisteredRecord, keys_of, tag_of
from .body import Body
from .controllers import Controller, ControllerKind, Identifiers
from .output import GOAL, Expected, Goal, Output, Units
from .points import MovingPoint
from .solvers import Solver

PLACE = Vector(Number("m"))


class StartText(Text):
    """The kind of ``rest``, ``static`` or the name of a result file."""

    def __init__(self) -> None:
        super().__init__("rest, static or the name of a result file (.h5)")

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        text = super().bind(node, path, binder)
        if text is INVALID or text in ("rest", "static") or text.endswith((".h5", ".hdf5")):
            return text
        return binder.fail(node.mark, path, f"{dotted(path)} must be {self.what}, got "
                           f"{quoted(text)}", near=nearest(text, ("rest", "static")))


@record
class RotationRate:
    """A rigid rotation: velocity omega x (r - about)."""

    omega: float = key(Number("rad/s"), "Angular velocity, counter-clockwise", example=6)
    about: tuple[float, float] = key(PLACE, "Centre", default=(0.0, 0.0), example=[0, 0])


VELOCITY = Vector(Number("m/s"), "vx, vy")


@record
class BodyInitial:
    """Initial velocities of one body, in place of those of the whole model."""

    velocity: tuple[float, float] | None = key(VELOCITY, "Velocity", default=None)
    rotation_rate: RotationRate | None = key(Record(RotationRate), "Rotation", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if neither velocity nor rotation rate is given."""
        if self.velocity is None and self.rotation_rate is None:
            yield Issue((), "{}: nothing is given", "velocity, rotation_rate or both")


@record
class Initial:
    """How a motion starts."""

    from_: str = key(StartText(), "Initial state: rest (the reference), static (equilibrium under the loads), or the "
                     "last state of a result file, which must satisfy the supports and joints", default="rest")
    velocity: tuple[float, float] | None = key(VELOCITY, "Velocity of all bodies; components that violate supports, "
                                                         "joints or contacts are lost, as in a plastic impact",
                                                 default=None)
    rotation_rate: RotationRate | None = key(Record(RotationRate), "Rotation of all bodies about a point, added to the "
                                             "velocity", default=None)
    bodies: dict[str, BodyInitial] = key(MapOf(Record(BodyInitial), "bodies by name"),
                                         "Velocities of single bodies, in place of the above", default={})


@record
class Rayleigh:
    """Damping alpha M + beta K, where beta acts on the rates of strain."""

    alpha: float = key(Number("1/s", ge=0), "Factor of the mass matrix: forces -alpha M v, which also damp rigid "
                       "motions",
                       default=0.0)
    beta: float = key(Number("s", ge=0), "Added to every body's retardation time kelvin_voigt: stress D (eps + beta "
                      "d eps/dt), equal to beta K for small motions and zero in rigid motions", default=0.0)


@record
class Damping:
    """Damping of the whole model."""

    rayleigh: Rayleigh = key(Record(Rayleigh), "Rayleigh damping")


@record
class SteadyRotation:
    """A frame that rotates at constant speed, with the supports and dead loads fixed in it."""

    omega: float = key(Number("rad/s"), "Angular velocity", example=5)
    about: tuple[float, float] = key(PLACE, "Centre", default=(0.0, 0.0), example=[0, 0])


def _one_or_more(what: str) -> ByShape:
    kind = RegisteredRecord()
    return ByShape(map=kind, list=ListOf(kind, what, 1))


class FormatNumber(Integer):
    """The kind of the version of the format."""

    def __init__(self) -> None:
        super().__init__(1, 1)

    def words(self, binder: Binder) -> str:
        return "1"

    def bounds(self, unit: str) -> str:
        return "1, the only format that this version reads"


# common names of keys of a case -> the keys here
OTHERS = {
    "forces": "loads", "supports": "boundary_conditions", "boundary": "boundary_conditions",
    "constraints": "boundary_conditions or joints", "hinges": "joints", "dampers": "springs", "nodes": "bodies",
    "mesh": "bodies.NAME.element", "analysis": "solver", "time": "solver.t_end", "probes": "output.probes",
    "probe": "output.probes", "variables": "parameters", "constants": "parameters",
}


@record(kw_only=True)
class Case:
    """A case: the model, the solver and the requested results."""

    other_names = OTHERS

    format: int = key(FormatNumber(), "Version of this format", default=1)
    title: str = key(Text(number=True), "Title of the case", default="")
    units: Units = key(Record(Units), "Labels of the units that the numbers are in",
                       default=Units())
    bodies: dict[str, Body] = key(MapOf(Record(Body), "bodies by name", 1), "Bodies of the model")
    parameters: dict[str, float] = key(Identifiers(Number(), "numbers by name"),
                                       "Numbers that every expression may use by name", default={}, example={"kp": 3})
    # records of ancf2d/interactions and of plugins: see register
    boundary_conditions: tuple[Any, ...] = key(
        ListOf(Registered(), "boundary conditions"), "Supports and prescribed motion", default=())
    joints: tuple[Any, ...] = key(ListOf(Registered(), "joints"), "Joints between bodies", default=())
    springs: tuple[Any, ...] = key(ListOf(Registered(), "springs"), "Springs and dampers", default=())
    masses: tuple[Any, ...] = key(ListOf(RegisteredRecord(), "masses"), "Point masses", default=())
    loads: tuple[Any, ...] = key(ListOf(Registered(), "loads"), "Loads", default=())
    obstacles: dict[str, Any] = key(MapOf(Registered(), "obstacles by name"), "Obstacles that bodies may touch",
                                    default={})
    contacts: tuple[Any, ...] = key(ListOf(RegisteredRecord(), "contacts"), "Pairs that may touch (static, "
                                    "quasi_static, eigen, frequency_response, state_space, dynamic)",
                                    default=())
    controllers: dict[str, Controller] = key(
        Identifiers(ControllerKind(Controller), "controllers by name"), "Controllers: numbers that depend on the "
        "motion and on states of their own; amplitudes may use them by name (dynamic)", default={})
    initial: Initial | None = key(Record(Initial), "Initial state and velocities of the motion (dynamic)", default=None)
    damping: Damping | None = key(Record(Damping), "Damping of the whole model (dynamic, eigen, buckling, "
                                  "frequency_response)", default=None)
    steady_rotation: SteadyRotation | None = key(
        Record(SteadyRotation), "Steady rotation of the frame (static, eigen, frequency_response)", default=None)
    transport: Any = key(
        _one_or_more("transports"), "Bodies whose material moves through their supports, one or a list (eigen, "
        "frequency_response, state_space, buckling, dynamic)", default=None)
    fluid: Any = key(
        _one_or_more("fluids"), "Fluids that bodies carry, one or a list (eigen, frequency_response, state_space, "
        "buckling, dynamic)", default=None)
    solver: Solver = key(OneOf(Solver), "What to compute, and how")
    goal: Goal | None = key(GOAL, "Value whose accuracy matters", default=None)
    accuracy: float | None = key(Number("", gt=0, lt=1), "Required relative accuracy of the goal", default=None,
                                 example=1e-4)
    output: Output = key(Record(Output), "What to store in the result file", default=Output())
    expected: tuple[Expected, ...] = key(ListOf(Record(Expected), "known values"),
                                         "Known values, for checking the result", default=())

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the loads and prescribed motions that are inputs of the solver; empty if it has none."""
        return getattr(self.solver, "inputs", ())

    @property
    def flows(self) -> tuple[Any, ...]:
        """The flows along bodies: transports of their own material, and fluids."""
        out: list[Any] = []
        for one in (self.transport, self.fluid):
            out += [] if one is None else one if isinstance(one, tuple) else [one]
        return tuple(out)

    @property
    def resting_masses(self) -> tuple[Any, ...]:
        """The point masses that are fixed to their bodies, not moving along them."""
        return tuple(m for m in self.masses if not isinstance(m.at, MovingPoint))

    @property
    def resting_springs(self) -> dict[int, Any]:
        """The springs by number, except those with an end that moves along a body."""
        return {k: s for k, s in enumerate(self.springs) if not any(isinstance(p, MovingPoint) for p in s.between)}

    def places_over_time(self, t: float) -> dict[str, dict[str, float]]:
        """Return the position S at t of each point that moves along a body, in the form of recorded probes."""
        return {name: {"s": point.s.value(t)} for name, point in self.moving_points.items()}

    @property
    def moving_points(self) -> dict[str, MovingPoint]:
        """The points that move along bodies, by their place in the case: ``loads.0.at``."""
        out: dict[str, MovingPoint] = {}
        for key_, items in (("loads", self.loads), ("masses", self.masses), ("springs", self.springs)):
            for k, item in enumerate(items):
                places = {"at": getattr(item, "at", None)}
                places |= {f"between.{j}": end for j, end in enumerate(getattr(item, "between", ()))}
                out |= {f"{key_}.{k}.{where}": at for where, at in places.items() if isinstance(at, MovingPoint)}
        return out

    @property
    def goal_frequencies(self) -> tuple[float, ...]:
        """The frequencies [Hz] of the responses in the goal and the expected values."""
        goals = [self.goal, *self.expected]
        return tuple(one.hz for one in goals if one is not None and one.hz is not None)


R = TypeVar("R", bound=type)
# what the records of each list declare to the rest of the model, with the defaults
DECLARED: dict[str, dict[str, Any]] = {
    # acceleration: of everything that has mass; line: force per length of a body (both times the amplitude); places: a
    # body and positions S on it that need nodes; points: where it acts; feedback: whether its amplitude may depend on
    # the motion; drawn: points (S, y) of a body through which it is drawn (points and drawn are None if they follow
    # from its keys)
    "loads": {"acceleration": None, "line": None, "places": None, "points": None, "feedback": True, "drawn": None},
    # whether rates cause forces, and whether it acts only in part of its range of elongation
    "springs": {"damped": False, "breaks": False},
    # the body along which a point slides; when it is active, None for always
    "joints": {"slides_along": None, "active": None},
    # the prescribed motions by their keys; when it is active
    "boundary_conditions": {"motions": {}, "active": None},
    "masses": {},
    "obstacles": {},
    "contacts": {},
    "transport": {},
    "fluid": {},
}


def register(where: str, cls: R, wanted: tuple[str, ...] = ("name",), methods: tuple[str, ...] = (),
             **declared: Any) -> R:
    """Make a record one of the types of a list of the case, and set what it declares to the rest of the model.

    It must have the keys ``wanted`` and the ``methods``. Raises PluginError if one is missing or its type is taken.
    """
    tag, keys, typed = tag_of(cls), keys_of(cls), isinstance(_kind(where), Registered)
    if typed and not tag:
        raise PluginError(f"{cls.__name__} has no tag, the type by which a case names it")
    missing = [name for name in wanted if name not in keys]
    if missing:
        raise PluginError(f"{cls.__name__} has no key {' and '.join(missing)}")
    taken = [name for name in DECLARED[where] if name in keys and name != "active"]
    if taken:
        raise PluginError(f"{cls.__name__}: {where} declare {' and '.join(taken)} to the model; rename the key")
    for method in methods:
        if not callable(getattr(cls, method, None)):
            raise PluginError(f"{cls.__name__} has no method {method}(), which returns the constants of its law")
    if _kind(where).known.setdefault(tag, cls) is not cls:
        raise PluginError(f"{where} already have a type '{tag}'")
    for name, value in {**DECLARED[where], **declared}.items():
        if not hasattr(cls, name):
            setattr(cls, name, value)
    return cls


def _kind(where: str) -> Any:
    kind: Any = keys_of(Case)[where].kind
    return kind.kinds["map"] if isinstance(kind, ByShape) else kind.item
