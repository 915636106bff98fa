"""Checks of what answers the motion: where it may, and that controllers have an output at every instant."""

from __future__ import annotations

from typing import Any

from .binder import INVALID, Path, dotted
from .controllers import DerivativeError, equations, loop
from .records import walk
from .schema import Expression, Initial, PointExpression


def _answers(value: Any) -> bool:
    """Whether a value is an amplitude that depends on the motion."""
    return isinstance(value, Expression) and value.variable == "t" and bool(value.quantities)


def check_feedback(checker: Any) -> None:
    """Check that what answers the motion has one that runs while it acts, and is no motion itself."""
    method = getattr(checker.case.solver, "method", None)
    static = isinstance(checker.case.initial, Initial) and checker.case.initial.from_ == "static"
    for path, value, _ in walk(checker.case):
        if isinstance(value, PointExpression) and "t" in value.quantities and checker.solver != "dynamic":
            checker.fail(path, f"{dotted(path)} uses t: solver {checker.solver} has no time", "an amplitude")
        if not _answers(value):
            continue
        moves = path[0] == "boundary_conditions"
        plain = path[0] != "loads" or path[2] != "amplitude" or not checker.case.loads[path[1]].answers
        used, path = ", ".join(value.quantities), (*path, "value")
        if moves:
            checker.fail(path, f"{dotted(path)} uses {used}: a prescribed motion cannot depend on the motion itself",
                      "an expression in t; or a spring and a load in the place of the prescribed motion")
        elif checker.solver != "dynamic":
            checker.fail(path, f"{dotted(path)} uses {used}: solver {checker.solver} has no motion that a load could "
                      "answer", "solver dynamic, or an expression in t")
        elif static:
            checker.fail(path, f"{dotted(path)} uses {used}: the equilibrium of initial.from static is without "
                      "motion", "initial: {from: rest}, or the result of a case without this load")
        elif plain:
            checker.fail(path, f"{dotted(path)} uses {used}: it is a function of time alone", "an expression in t")
    if method == "energy_momentum" and _steered(checker.case):
        checker.fail(("solver", "method"), "solver.method: energy_momentum takes the mean of loads over a step, which "
                  "loads that use probes or controllers do not have", "radau5, generalized_alpha or another method")


def _steered(case: Any) -> bool:
    """Return whether any load answers the motion by probes or controllers."""
    found = any(_answers(value) for path, value, _ in walk(case) if path and path[0] == "loads")
    return found or bool(case.controllers)


def check_controllers(checker: Any) -> None:
    """Check that each controller has an output at every instant."""
    case = checker.case
    if case.controllers is INVALID or ("controllers",) in checker.failed:
        return
    outputs = {}
    for name, controller in case.controllers.items():
        path: Path = ("controllers", name)
        if isinstance(case.parameters, dict) and name in case.parameters:
            checker.fail(path, f"{dotted(path)}: '{name}' is the name of a parameter, too", "names that differ",
                      on_key=True)
        elif name in checker.known("probes")[0]:
            checker.fail(path, f"{dotted(path)}: '{name}' is the name of a probe, too", "names that differ",
                      on_key=True)
        try:
            outputs[name] = equations(name, controller).output
        except DerivativeError as error:
            checker.fail((*path, "kd"), f"{dotted((*path, 'kd'))}: {error}, so that the rate of the input has to be "
                      "found by a filter", "filter: a time constant > 0, or sample")
    found = loop(outputs)
    if found:
        checker.fail(("controllers", found[0]), f"controllers.{found[0]}: its output depends on itself at the same "
                  f"instant: {' -> '.join(found)}", "a controller with a state or with sample between them",
                  on_key=True)
