"""Names that plugins import to define their own springs, loads and formulations; see docs/extending.md.

A plugin is one Python file. It declares the record of a case file and the law as numerical functions; ancf2d compiles
the law and uses it in statics, paths, modes and motion, in ``validate``, ``schema`` and the messages on wrong input.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any

from ..case import GroundPoint, Point
from ..case.declare import key, record
from ..case.kinds import NAME, Choice, Flag, Integer, Name, Number, Vector
from ..case.schema.points import ENDS, POINT
from ..elements.formulations import FORMULATIONS, Formulation, Rule, Sampler
from ..elements.formulations.base import StrainLaw
from ..errors import PluginError
from ..interactions.forces import AMPLITUDE, AMPLITUDE_DOC
from ..interactions.forces import position_load as load
from ..interactions.springs import spring

__all__ = [
    "AMPLITUDE", "AMPLITUDE_DOC", "ENDS", "FORMULATIONS", "NAME", "POINT", "Choice", "Flag", "Formulation",
    "GroundPoint", "Integer", "Name", "Number", "Point", "Rule", "Sampler", "StrainLaw", "Vector", "formulation",
    "helper", "key", "load", "record", "spring",
]

# arguments of the functions of a formulation's law
ARGUMENTS = {"strain": ("ref", "u", "eps", "J", "lanes"), "geometric": ("ref", "u", "sigma", "J", "H", "lanes"),
             "internal": ("ref", "eps", "old", "new", "slope", "lanes")}


def helper(function: Callable[..., Any]) -> Callable[..., Any]:
    """Mark a function of a plugin so that its law can call it; it is compiled with the law."""
    from numba.extending import register_jitable

    return register_jitable(function)  # type: ignore[no-any-return]


def formulation(made: Formulation) -> Formulation:
    """Register a formulation of the elastic forces for all element types that it does not refuse.

    Raises PluginError if the name is taken or a function of its law has other arguments than expected.
    """
    for name, arguments in ARGUMENTS.items():
        function = getattr(made.law, name)
        if function is not None and len(signature(function).parameters) != len(arguments):
            raise PluginError(f"formulation '{made.name}': {name}{signature(function)} takes other arguments; expected "
                              f"{name}({', '.join(arguments)})")
    if FORMULATIONS.setdefault(made.name, made) is not made:
        raise PluginError(f"there is already a formulation '{made.name}'")
    return made
