"""Checks of materials against what the rest of a case asks of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .binder import INVALID, Path, dotted, listed
from .schema import Layers

# solvers that know laws of fibres, and of materials that relax; fields that are those of a linear law
KNOWING = ("static", "quasi_static", "eigen", "frequency_response", "state_space", "dynamic")
RELAXING = ("linear_static", "static", "quasi_static", "buckling")
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
    case, said = checker.case, False
    for path, material in materials_of(case):
        if material in (None, INVALID) or path in checker.failed or not material.remembers:
            continue
        name = next(key for key in ("yield", "stress_strain", "viscoelastic") if getattr(
            material, key + "_" * (key == "yield")))
        key, allowed = (*path, name), RELAXING if name == "viscoelastic" else KNOWING
        if checker.solver not in allowed:
            checker.fail(key, f"{dotted(key)} cannot be used with solver {checker.solver}, only with {listed(allowed)}")
        fields = case.output.fields if case.output is not INVALID and not said else ()
        for k, field in enumerate(fields if fields is not INVALID else ()):
            if field in FIELDS:
                checker.fail(("output", "fields", k), f"output.fields: {field} is not known of a material that yields, "
                             "follows a curve or relaxes", "N, Q, M")
        said = True
