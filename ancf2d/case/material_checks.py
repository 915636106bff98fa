"""Checks of materials against what the rest of a case asks of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .binder import INVALID, Path, dotted
from .schema import Layers

# solvers that know the elastic part of a law alone, and fields that are those of a linear one
LINEAR = ("linear_static", "buckling")
FIELDS = ("stress", "strain", "energy")


def materials_of(case: Any) -> Iterator[tuple[Path, Any]]:
    """Yield the materials of all bodies and layers with their places."""
    for name, body in case.bodies.items() if case.bodies is not INVALID else ():
        if body is INVALID:
            continue
        if isinstance(body.section, Layers):
            for k, layer in enumerate(body.section.layers if body.section.layers is not INVALID else ()):
                if layer is not INVALID:
                    yield ("bodies", name, "section", "layers", k, "material"), layer.material
        else:
            yield ("bodies", name, "material"), body.material


def check_materials(checker: Any) -> None:
    """Check that solvers and fields know the laws of the materials."""
    case = checker.case
    for path, material in materials_of(case):
        if material in (None, INVALID) or path in checker.failed or not material.fibres:
            continue
        key = (*path, "yield" if material.yield_ is not None else "stress_strain")
        if checker.solver in LINEAR:
            checker.fail(key, f"{dotted(key)} cannot be used with solver {checker.solver}, which is linear", "solver "
                         "static")
        fields = case.output.fields if case.output is not INVALID else ()
        for k, name in enumerate(fields if fields is not INVALID else ()):
            if name in FIELDS:
                checker.fail(("output", "fields", k), f"output.fields: {name} is not known of a material that yields "
                             "or follows a curve", "N, Q, M")
        return
