"""Names that plugins import to define their own springs, loads and formulations; see docs/extending.md.

A plugin is one Python file. It declares the record of a case file and the law as numerical functions; ancf2d compiles
the law and uses it in statics, paths, modes and motion, in ``validate``, ``schema`` and the messages on wrong input.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from inspect import signature
from types import FunctionType
from typing import Any

import numpy as np

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
        _check_places(made, name, arguments)
    if FORMULATIONS.setdefault(made.name, made) is not made:
        raise PluginError(f"there is already a formulation '{made.name}'")
    return made


def _check_places(made: Formulation, name: str, arguments: tuple[str, ...]) -> None:
    """Run a function of a law in Python: compiled, it would write beyond the end of its arrays without a message."""
    law, function = made.law, getattr(made.law, name)
    if not isinstance(function, FunctionType):
        return
    n, m = law.strains, law.fields
    shapes = {"ref": (law.references,), "u": (m,), "eps": (n,), "sigma": (n,), "J": (n, m), "H": (m, m),
              "old": (law.state,), "new": (law.state,), "slope": (n, n)}
    given: dict[str, Any] = {key: np.ones((*shape, 1)) for key, shape in shapes.items()}
    try:
        # whether the law has a value at ones, which no body need have, says nothing
        with np.errstate(all="ignore"), suppress(ArithmeticError, ValueError):
            function(*(given.get(argument, 1) for argument in arguments))
    except IndexError as error:
        sizes = ", ".join(f"{key} {given[key].shape[:-1]}" for key in arguments if key in given)
        raise PluginError(f"formulation '{made.name}': {name} uses places that its arrays do not have ({error}); by "
                          f"the StrainLaw, their sizes without lanes are {sizes}") from error
