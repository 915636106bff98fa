"""Springs, loads and formulations of one's own: what a plugin imports. A plugin is one Python file; docs/extending.md.

A plugin declares the record of a case file and the law in numbers; ancf2d compiles the law and takes it everywhere:
statics, paths, modes and motion, ``validate``, ``schema`` and the messages on wrong input.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from ..case import Case, GroundPoint, Point
from ..case.declare import key, record
from ..case.kinds import Choice, Flag, Integer, Name, Number, Vector
from ..case.records import keys_of, tag_of
from ..case.schema.joints import ENDS, spring_issues
from ..case.schema.loads import AMPLITUDE, AMPLITUDE_DOC
from ..case.schema.points import POINT
from ..elements.formulations import FORMULATIONS, Formulation, Rule, Sampler
from ..elements.formulations.base import PointLaw as StrainLaw
from ..elements.point_laws import MAX_CONSTANTS, position_law
from ..elements.spring_laws import spring_law
from ..errors import PluginError
from ..model.loads import LOADS, LoadContext, LoadSet
from ..model.point_patch import PointPatch, position_fields
from ..model.springs import SPRINGS, End, Spring, about, along

R = TypeVar("R", bound=type)
NAME = Name()

__all__ = [
    "AMPLITUDE", "AMPLITUDE_DOC", "ENDS", "FORMULATIONS", "NAME", "POINT", "Choice", "Flag", "Formulation",
    "GroundPoint", "Integer", "Name", "Number", "Point", "Rule", "Sampler", "StrainLaw", "Vector", "formulation",
    "helper", "key", "load", "record", "spring",
]


def helper(function: Callable[..., Any]) -> Callable[..., Any]:
    """Let the functions of a plugin call this one of its own; it is compiled with them."""
    from numba.extending import register_jitable

    return register_jitable(function)  # type: ignore[no-any-return]


def spring(force: Callable[..., Any], *, on: str = "elongation", damped: bool = False) -> Callable[[R], R]:
    """Register a record as a kind of spring, whose force is a function of the elongation, or of the angle.

    ``force(u, rate, par)`` returns the energy, the force N (N, or the moment in N m) and its derivatives dN/du and
    dN/d(rate), of the elongation u from the reference [m], or with ``on="angle"`` the relative rotation [rad]; ``par``
    are what the record's method ``constants()`` returns, at most five numbers. ``damped`` tells that N depends on the
    rate. The record has ``tag`` (its ``type``) and the keys ``between`` (kind ENDS) and ``name``. Raises
    PluginError.
    """
    if on not in ("elongation", "angle"):
        raise PluginError(f"a spring acts on its elongation or angle, not '{on}'")

    def register(cls: R) -> R:
        _declare(cls, "springs", ("between", "name"))
        law = spring_law(_law_name(cls), on == "angle", force)

        def build(item: Any, ends: list[End]) -> Spring:
            return (about if on == "angle" else along)(law, ends, _constants(item), damped)

        if "check" not in cls.__dict__:
            cls.check = _check_ends  # type: ignore[attr-defined]
        cls.damped = damped  # type: ignore[attr-defined]
        SPRINGS[cls] = build
        return cls
    return register


def load(force: Callable[..., Any], *, potential: bool) -> Callable[[R], R]:
    """Register a record as a kind of load: a force on a point, as a function of where the point is.

    ``force(x, y, par)`` returns fx, fy [N] and dfx/dx, dfx/dy, dfy/dx, dfy/dy; ``par`` as for springs. It is multiplied
    by the record's amplitude. ``potential`` tells whether dfx/dy = dfy/dx: without, modes about a static state and
    buckling are refused. The record has ``tag`` and the keys ``at`` (kind POINT), ``amplitude`` and ``name``. Raises
    PluginError.
    """
    def register(cls: R) -> R:
        _declare(cls, "loads", ("at", "amplitude", "name"))
        law = position_law(_law_name(cls), force, potential)

        def build(item: Any, context: LoadContext, out: LoadSet) -> None:
            fields = position_fields(context.point(item.at))
            out.patches.append(PointPatch(law, fields, _constants(item), context.amplitude))

        cls.potential = potential  # type: ignore[attr-defined]
        LOADS[cls] = build
        return cls
    return register


def formulation(made: Formulation) -> Formulation:
    """Register a formulation of the elastic forces, for every element type that it does not refuse.

    Raises PluginError where there is one of this name.
    """
    if FORMULATIONS.setdefault(made.name, made) is not made:
        raise PluginError(f"there is already a formulation '{made.name}'")
    return made


def _declare(cls: type, where: str, wanted: tuple[str, ...]) -> None:
    """Make a record one of the types of a list of the case."""
    tag, keys = tag_of(cls), keys_of(cls)
    if not tag:
        raise PluginError(f"{cls.__name__} has no tag, the type that a case gives it")
    missing = [name for name in wanted if name not in keys]
    if missing:
        raise PluginError(f"{cls.__name__} has no key {' and '.join(missing)}")
    if not callable(getattr(cls, "constants", None)):
        raise PluginError(f"{cls.__name__} has no method constants(), which gives the numbers of its law")
    types = keys_of(Case)[where].kind.item.options  # type: ignore[attr-defined]
    if types.setdefault(tag, cls) is not cls:
        raise PluginError(f"{where} already have a type '{tag}'")


def _law_name(cls: type) -> str:
    return f"{cls.__module__}_{tag_of(cls)}".replace(".", "_")


def _constants(item: Any) -> list[float]:
    found = [float(x) for x in item.constants()]
    if len(found) > MAX_CONSTANTS:
        raise PluginError(f"{type(item).__name__}.constants() returns {len(found)} numbers; expected at most "
                          f"{MAX_CONSTANTS}")
    return found


def _check_ends(self: Any) -> Iterator[Any]:
    return spring_issues(self.between)
