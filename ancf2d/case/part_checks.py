"""Checks of parts of a case against the rest of it: materials, controllers, amplitudes, flows, contacts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .binder import INVALID, Path, dotted, listed
from .nodes import quoted
from .schema import Active, Expression, Initial, Layers, MovingPoint, PointExpression
from .schema.controllers import DerivativeError, algebraic_loop, equations

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


def _depends_on_motion(value: Any) -> bool:
    """Return whether a value is an amplitude that depends on the motion."""
    return isinstance(value, Expression) and value.variable == "t" and bool(value.quantities)


def check_feedback(checker: Any) -> None:
    """Check that amplitudes depend on the motion only where one is computed, and that none is a prescribed motion."""
    method = getattr(checker.case.solver, "method", None)
    static = isinstance(checker.case.initial, Initial) and checker.case.initial.from_ == "static"
    for path, value, _ in checker.values:
        if isinstance(value, PointExpression) and "t" in value.quantities and not checker.case.solver.timed:
            checker.fail(path, f"{dotted(path)} uses t: solver {checker.solver} has no time", "an amplitude")
        if not _depends_on_motion(value):
            continue
        moves = path[0] == "boundary_conditions"
        plain = path[0] != "loads" or path[2] != "amplitude" or not checker.case.loads[path[1]].feedback
        used, path = ", ".join(value.quantities), (*path, "value")
        if moves:
            checker.fail(path, f"{dotted(path)} uses {used}: a prescribed motion cannot depend on the motion itself",
                      "an expression in t, or a spring and a load in place of the prescribed motion")
        elif checker.solver != "dynamic":
            checker.fail(path, f"{dotted(path)} uses {used}: solver {checker.solver} computes no motion on which a "
                               "load could depend", "solver dynamic, or an expression in t")
        elif static:
            checker.fail(path, f"{dotted(path)} uses {used}: initial.from static computes an equilibrium without "
                               "motion", "initial: {from: rest}, or the result of a case without this load")
        elif plain:
            checker.fail(path, f"{dotted(path)} uses {used}: it is a function of time alone", "an expression in t")
    if method == "energy_momentum" and _loads_depend_on_motion(checker):
        checker.fail(("solver", "method"), "solver.method: energy_momentum uses mean loads over a step, so loads "
                     "cannot use probes or controllers", "radau5, generalized_alpha or another "
                     "method")


def _loads_depend_on_motion(checker: Any) -> bool:
    """Return whether any load depends on the motion by probes or controllers."""
    found = any(_depends_on_motion(value) for path, value, _ in checker.values if path and path[0] == "loads")
    return found or bool(checker.case.controllers)


def check_controllers(checker: Any) -> None:
    """Check that names of controllers are unique, and that each controller has an output at every instant."""
    case = checker.case
    if case.controllers is INVALID or ("controllers",) in checker.failed:
        return
    outputs = {}
    for name, controller in case.controllers.items():
        path: Path = ("controllers", name)
        if isinstance(case.parameters, dict) and name in case.parameters:
            checker.fail(path, f"{dotted(path)}: '{name}' is also the name of a parameter", "different names",
                      on_key=True)
        elif name in checker.known("probes")[0]:
            checker.fail(path, f"{dotted(path)}: '{name}' is also the name of a probe", "different names",
                      on_key=True)
        try:
            outputs[name] = equations(name, controller).output
        except DerivativeError as error:
            checker.fail((*path, "kd"), f"{dotted((*path, 'kd'))}: {error}, so the derivative term needs a filter",
                         "filter: a time constant > 0, or sample")
    found = algebraic_loop(outputs)
    if found:
        checker.fail(("controllers", found[0]), f"controllers.{found[0]}: its output depends on itself at the same "
                  f"instant: {' -> '.join(found)}", "a controller with a state or with sample between them",
                  on_key=True)


def check_active(checker: Any) -> None:
    """Check that ``active`` is used in motions only."""
    for path, value, _ in checker.values:
        if isinstance(value, Active) and checker.solver != "dynamic":
            checker.fail(path, f"{dotted(path)} cannot be used with solver {checker.solver}, only with dynamic",
                         on_key=True)


def check_rates(checker: Any) -> None:
    """Check that no force depends on rates if the solver follows time without velocities."""
    solver = checker.case.solver
    if not solver.timed or solver.moves:
        return
    for path, instead in _forces_from_rates(checker):
        checker.fail(path, f"{dotted(path)} cannot be used with solver {checker.solver}, which computes no velocities",
                     f"solver dynamic, or {instead}")


def _forces_from_rates(checker: Any) -> Iterator[tuple[Path, str]]:
    """Yield the places of forces that depend on rates, and alternatives to them."""
    for path, material in materials_of(checker.case):
        damping = None if material in (None, INVALID) else material.damping
        if damping not in (None, INVALID) and damping.kelvin_voigt:
            yield (*path, "damping"), "material.viscoelastic"
    for i, spring in enumerate(checker.case.springs or ()):
        if spring is not INVALID and getattr(spring, "damped", False):
            yield ("springs", i, "damping" if getattr(spring, "damping", 0.0) else "force"), "a spring without damping"
    for i, contact in enumerate(checker.case.contacts or ()):
        if contact is not INVALID and contact.law not in (None, INVALID) and contact.law.damping:
            yield ("contacts", i, "law", "damping"), "a law without damping"
    for path, value, _ in checker.values:
        if isinstance(value, PointExpression) and {"vx", "vy"} & set(value.quantities):
            yield path, "a value without vx and vy"


def check_moving(checker: Any) -> None:
    """Check that points move along bodies only in motions, and not with method energy_momentum."""
    for path, value, _ in checker.values:
        if isinstance(value, MovingPoint) and checker.solver != "dynamic":
            checker.fail(path, f"{dotted(path)}: a point that moves along a body cannot be used with solver "
                         f"{checker.solver}, only with dynamic", "BODY@S")
        elif isinstance(value, MovingPoint) and getattr(checker.case.solver, "method", None) == "energy_momentum":
            checker.fail(path, f"{dotted(path)}: a point that moves along a body cannot be used with method "
                         "energy_momentum", "another method")


def check_flows(checker: Any) -> None:
    """Check flows along bodies: one of each kind on a body that deforms, and constant speed outside of motions."""
    if INVALID in (checker.case.transport, checker.case.fluid) or checker.failed & {("transport",), ("fluid",)}:
        return
    for what in ("transport", "fluid"):
        found, seen = getattr(checker.case, what), set()
        for i, one in enumerate(found if isinstance(found, tuple) else () if found is None else (found,)):
            path: Path = (what, i) if isinstance(found, tuple) else (what,)
            if one.on in seen:
                checker.fail((*path, "on"), f"{dotted(path)}.on: '{one.on}' is named twice")
            seen.add(one.on)
            body = checker.case.bodies.get(one.on) if checker.case.bodies is not INVALID else None
            if body not in (None, INVALID) and body.element not in (None, INVALID) and body.element.type == "rigid":
                checker.fail((*path, "on"), f"{dotted(path)}.on: '{one.on}' is rigid", "a body with elements")
            if not isinstance(one.velocity, float) and checker.solver != "dynamic":
                checker.fail((*path, "velocity"), f"{dotted(path)}.velocity: an amplitude over time needs solver "
                             "dynamic",
                             f"a number {checker.binder.unit('m/s')}")
    if checker.case.flows and checker.case.steady_rotation is not None:
        checker.fail(("steady_rotation",), "steady_rotation cannot be used with transport or fluid", on_key=True)


def check_contacts(checker: Any) -> None:
    """Check that the partners of contacts exist, and that obstacles are fixed to rigid bodies."""
    case: Any = checker.case
    if INVALID in (case.bodies, case.obstacles, case.contacts):
        return
    for name, obstacle in case.obstacles.items():
        if name in case.bodies:
            checker.fail(("obstacles", name), f"obstacles.{name}: a body also has this name", "different names",
                         on_key=True)
        on = None if obstacle is INVALID else obstacle.on
        if on in case.bodies and case.bodies[on] is not INVALID and case.bodies[on].element is not INVALID \
                and case.bodies[on].element.type != "rigid":
            checker.fail(("obstacles", name, "on"), f"obstacles.{name}.on: '{on}' deforms", "a rigid body")
    for i, contact in enumerate(case.contacts):
        if contact is not INVALID:
            _check_contact(checker, ("contacts", i), contact)


def _check_contact(checker: Any, path: Path, contact: Any) -> None:
    """Check friction, self-contact and partners of one contact."""
    case = checker.case
    method = getattr(checker.case.solver, "method", "newton")
    steps = checker.solver in ("quasi_static", "dynamic") or (checker.solver == "static" and method == "newton")
    if contact.friction and contact.law is None and not steps:
        what = f"method {method}" if checker.solver == "static" else f"solver {checker.solver}"
        checker.fail((*path, "friction"), f"{dotted(path)}: without a contact law, friction cannot be used with {what}",
                     "law: {stiffness, damping}")
    between = contact.between or ()
    itself = case.bodies.get(contact.self_, INVALID)
    if itself is not INVALID and itself.element is not INVALID and itself.element.type == "rigid":
        checker.fail((*path, "self"), f"{dotted(path)}.self: {contact.self_} is rigid, and cannot touch itself",
                     "a body that deforms")
    for k, name in enumerate(between):
        known = (*case.bodies, *case.obstacles)
        if name not in known and name is not INVALID:
            checker.fail((*path, "between", k), f"{dotted(path)}.between: there is no body or obstacle {quoted(name)}",
                         *checker.binder.instead(name, known))
    if between and all(name in case.obstacles for name in between):
        checker.fail((*path, "between"), f"{dotted(path)}.between: both are obstacles", "at least one body")
    for name in between:
        if name in case.obstacles and case.obstacles[name] is not INVALID and case.obstacles[name].on in between:
            checker.fail((*path, "between"), f"{dotted(path)}.between: {name} is fixed to {case.obstacles[name].on}",
                         "another body")
