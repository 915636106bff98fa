"""Checks of materials against the requirements of the rest of a case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .binder import INVALID, Path, dotted, listed
from .schema import Layers

# solvers that support laws of fibres, hyperelastic and viscoelastic materials; fields that need a linear law
FIBRE_SOLVERS = ("static", "quasi_static", "eigen", "frequency_response", "state_space", "dynamic")
HYPERELASTIC_SOLVERS = (*FIBRE_SOLVERS, "buckling")
VISCOELASTIC_SOLVERS = ("linear_static", "static", "quasi_static", "eigen", "frequency_response", "state_space",
                        "buckling", "dynamic")
LINEAR_FIELDS = ("stress", "strain", "energy")
# solvers that update the history of fibres
HISTORY_SOLVERS = ("static", "quasi_static", "dynamic")
# yield stress over E: from a tenth of that of the softest pure metals to that of perfect crystals
YIELD_STRAINS = 1e-5, 0.1


def materials_of(case: Any) -> Iterator[tuple[Path, Any]]:
    """Yield the materials of all bodies and layers, each with its path."""
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
    """Check that the solver and the requested fields support the laws of the materials."""
    for path, material in materials_of(checker.case):
        if material in (None, INVALID) or path in checker.failed or not material.non_hookean:
            continue
        name = next((key for key in ("yield", "stress_strain", "viscoelastic") if getattr(
            material, key + "_" * (key == "yield"))), "law")
        key, allowed = (*path, name), {"viscoelastic": VISCOELASTIC_SOLVERS,
                                       "law": HYPERELASTIC_SOLVERS}.get(name, FIBRE_SOLVERS)
        if checker.solver not in allowed:
            checker.fail(key, f"{dotted(key)} cannot be used with solver {checker.solver}, only with {listed(allowed)}")
    _check_fields(checker)
    _check_layers(checker)


def material_warnings(case: Any) -> list[str]:
    """Return warnings about yield stresses that do not fit E, and about layers without alpha in heated bodies."""
    heated = {load.on for load in case.loads if load.tag == "temperature"}
    out = [f"{dotted((*path, 'alpha'))}: not given, so temperature does not expand this layer, unlike others" for
           path, m in materials_of(case) if path[1] in heated and len(path) > 3 and m.alpha is None]
    return out + [f"{dotted(path)}: no known material has yield: {m.yield_:g} with E: {m.E:g}: its strain at the yield "
            f"stress is {m.yield_ / m.E:.2g}, that of steel about 1e-3. Give both in the same units"
            for path, m in materials_of(case) if m is not None and m.yield_ is not None
            and isinstance(m.E, float | int) and not YIELD_STRAINS[0] <= m.yield_ / m.E <= YIELD_STRAINS[1]]


def refused_field(case: Any, solver: str, field: str) -> tuple[str, str] | None:
    """Return why a field over the height is not available for some material, and the alternative; None if it is.

    Fibres provide all of these fields but the energy.
    """
    materials = [m for _, m in materials_of(case) if m not in (None, INVALID)]
    others, follow = any(m.non_hookean and not m.fibres for m in materials), any(m.fibres for m in materials)
    available = not others and (not follow or solver in HISTORY_SOLVERS)
    if field == "plastic_strain" and not (follow and solver in HISTORY_SOLVERS):
        return (f"plastic_strain is available only for fibres, in solvers {listed(HISTORY_SOLVERS)}",
                "a material with yield or stress_strain")
    if field not in LINEAR_FIELDS or (available and not (follow and field == "energy")):
        return None
    whose = "relaxes or is hyperelastic" if others else "yields or follows a curve"
    return (f"{field} is not available for a material that {whose}",
            "N, Q, M" if others or not available else "N, Q, M, stress, strain, plastic_strain")


def _check_fields(checker: Any) -> None:
    """Check that the requested fields over the height are available for all materials."""
    case = checker.case
    if INVALID in (case.output, case.bodies) or case.output.fields is INVALID:
        return
    for k, field in enumerate(case.output.fields):
        if (refused := refused_field(case, checker.solver, field)) is not None:
            checker.fail(("output", "fields", k), f"output.fields: {refused[0]}", refused[1])


def _check_layers(checker: Any) -> None:
    """Check that temperature does not strain layers differently where one of them yields or follows a curve.

    Formulations subtract the thermal strain of the section as a whole. The strain of the fibres would not include the
    remaining differences between layers.
    """
    case = checker.case
    if INVALID in (case.bodies, case.loads):
        return
    for k, load in enumerate(case.loads):
        body = case.bodies.get(load.on, INVALID) if load is not INVALID and load.tag == "temperature" else INVALID
        if body is INVALID or not isinstance(body.section, Layers) or body.section.layers is INVALID:
            continue
        materials = [layer.material for layer in body.section.layers if layer is not INVALID]
        if INVALID in materials or not any(m.fibres for m in materials) or all(
                (m.alpha or 0.0) == (materials[0].alpha or 0.0) for m in materials):
            continue
        checker.fail(("loads", k, "on"), f"loads.{k}.on: the layers of '{load.on}' expand differently; fibres that "
                     "yield or follow a curve do not include the resulting stress within the "
                     "section",
                     "the same alpha in all layers, or elastic layers")
