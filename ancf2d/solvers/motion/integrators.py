"""The time integrators by name: properties and restrictions.

A new one is an entry here, and one in ``own_integrators`` if it is not SciPy's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ...case import Dynamic
from ...case.binder import listed
from ...errors import Problem
from ...model.constraints import TURNED
from ...model.model import Model

# of methods with selectable damping, if the case does not give it
SPECTRAL_RADIUS = 0.8


@dataclass(frozen=True)
class SciPyMethod:
    """The properties of an integrator of SciPy.

    ``one_step``: uses no earlier steps, so that states can be projected onto the constraints; ``stages`` evaluated per
    try, if these give the number of tries of a step, else 0; ``keeps``: can be restarted from (t, y, h) alone;
    ``jacobian``: uses one; ``fixed``: its error weights cannot change on the way.
    """

    one_step: bool
    stages: int = 0
    keeps: bool = False
    jacobian: bool = False
    fixed: bool = False


@dataclass(frozen=True)
class Integrator:
    """A time integrator.

    ``order`` of its error at the end of a motion; ``rows`` stored from earlier steps; ``radii``: range of its spectral
    radius at infinity, if selectable; ``damps`` motions far too fast for the steps; ``conserves`` energy, by discrete
    gradients; ``scipy``: the properties of SciPy's methods. Contact without a law needs steps of one stage, at least
    where contacts open and close: ``contact``: whether there are such steps, ``friction``: whether they include
    friction.
    """

    name: str
    order: int
    rows: int
    source: str
    doc: str
    radii: tuple[float, float] | None = None
    damps: bool = True
    conserves: bool = False
    scipy: SciPyMethod | None = None
    contact: bool = False
    friction: bool = False


_LIST = (
    Integrator("radau5", 5, 5, "Hairer, Lubich & Roche 1989",
               "Radau IIA, three stages: order 5, damps motions that the steps do not resolve", contact=True),
    Integrator("radau9", 9, 7, "Hairer, Lubich & Roche 1989",
               "Radau IIA, five stages: order 9, for smooth motion to tight tolerances", contact=True),
    Integrator("generalized_alpha", 2, 3, "Chung & Hulbert 1993; Arnold & Bruls 2007",
               "second order, damping at infinity chosen by spectral_radius (default 0.8)", radii=(0.0, 1.0),
               contact=True, friction=True),
    Integrator("hht", 2, 3, "Hilber, Hughes & Taylor 1977",
               "second order, damping at infinity chosen by spectral_radius from 0.5 to 1 (default 0.8)",
               radii=(0.5, 1.0), contact=True, friction=True),
    Integrator("newmark", 2, 3, "Newmark 1959", "average acceleration: second order, no damping, no multipliers",
               damps=False),
    Integrator("energy_momentum", 2, 0, "Simo & Tarnow 1992; Gonzalez 1996",
               "second order, conserves energy and momentum exactly", damps=False, conserves=True),
    Integrator("RK45", 5, 0, "Dormand & Prince 1980", "SciPy's explicit pair 5(4), known as ode45",
               scipy=SciPyMethod(True, stages=6, keeps=True)),
    Integrator("DOP853", 8, 0, "Hairer, Norsett & Wanner 1993", "SciPy's explicit method of order 8",
               scipy=SciPyMethod(True, stages=12, keeps=True)),
    Integrator("Radau", 5, 0, "Hairer & Wanner 1996", "SciPy's Radau IIA of order 5, with dense matrices",
               scipy=SciPyMethod(True, jacobian=True)),
    Integrator("BDF", 5, 0, "Shampine & Reichelt 1997", "SciPy's BDF of orders 1 to 5, without multipliers",
               scipy=SciPyMethod(False, jacobian=True)),
    Integrator("LSODA", 5, 0, "Petzold 1983", "SciPy's switch between Adams and BDF, without multipliers",
               scipy=SciPyMethod(False, jacobian=True, fixed=True)),
)
INTEGRATORS: dict[str, Integrator] = {m.name: m for m in _LIST}
SCIPY_METHODS: dict[str, SciPyMethod] = {m.name: m.scipy for m in _LIST if m.scipy is not None}
DEFAULT = "radau5"
# skips the same vibrations as DEFAULT with a much smaller error: the difference is the error of DEFAULT
SHARPER = "radau9"
# for scenes with impacts
IMPACTS = "generalized_alpha"


def default_method(model: Model) -> str:
    """Return the method for a case that names none."""
    return IMPACTS if model.sided else DEFAULT


def spectral_radius(spec: Dynamic) -> float:
    """Return the factor per step on motions far too fast for the steps, for methods where it is selectable."""
    return SPECTRAL_RADIUS if spec.spectral_radius is None else spec.spectral_radius


# ---------------------------------------------------------------------- impossible combinations

Refusal = tuple[str, str, str]  # key, fault, expected value
Rule = Callable[[Integrator, Dynamic, Model], Iterator[Refusal]]


def _constrained(model: Model) -> str:
    """Return the names of the supports, joints and bodies with multipliers."""
    return ", ".join(sorted({c.owner for c in model.constraints}))


def _multistep(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    """Refuse multistep methods for models with constraints: their states cannot be projected."""
    if method.scipy is not None and not method.scipy.one_step and model.constraints:
        yield ("method", f"{method.name} is a multistep method, which cannot satisfy the constraints of "
               f"{_constrained(model)}", "Radau, RK45, DOP853, or one of ancf2d's own methods, such as radau5")


def _undamped(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    """Refuse methods without damping at infinity if constraint forces would oscillate (Cardona & Geradin 1989)."""
    if method.scipy is not None or method.conserves or not model.constraints:
        return
    why = f"makes the constraint forces of {_constrained(model)} grow from step to step"
    if not method.damps and any(pair.hard for pair in model.contacts):
        # refused by the rule for contact, with better advice
        return
    if not method.damps:
        turns = all(c.holds in ("rotation", TURNED) for c in model.constraints)
        types = ", or elements with the coordinate theta, such as reissner3" if turns else ""
        yield ("method", f"{method.name}, which has no numerical damping, {why}",
               f"radau5, energy_momentum or generalized_alpha{types}")
    elif method.radii is not None and spectral_radius(spec) == 1.0:
        yield "spectral_radius", f"1, which has no numerical damping, {why}", "a spectral radius below 1, such as 0.8"


def _radius(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    rho = spec.spectral_radius
    if rho is None:
        return
    if method.radii is None:
        yield ("spectral_radius", f"{method.name} has no spectral radius",
               "no spectral_radius, or method generalized_alpha")
    elif not method.radii[0] <= rho <= method.radii[1]:
        yield ("spectral_radius", f"{rho:g} is out of range for {method.name}",
               f"from {method.radii[0]:g} to {method.radii[1]:g}, or method generalized_alpha")


def _without_gradient(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    """Refuse energy conservation for strains that depend on an angle: they are not quadratic in the coordinates."""
    if not method.conserves:
        return
    names = [m.plan.name for m in model.meshes.values() if not m.plan.rigid and m.plan.formulation.law.mean is None
             and m.plan.name not in model.remembers]
    if names:
        formulations = sorted({model.meshes[n].plan.formulation.name for n in names})
        yield ("method", f"{method.name} has no energy-conserving forces for formulation "
               f"{', '.join(formulations)} of {', '.join(names)}",
               "generalized_alpha or radau5, or elements of another formulation, such as structural")


def _forgets(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    """Refuse methods that do not update history variables at the end of each step."""
    if model.remembers and (method.scipy is not None or method.conserves):
        yield ("method", f"{method.name} does not support formulations with memory, such as that of "
               f"{', '.join(model.remembers)}", "radau5, radau9, generalized_alpha, hht or newmark")


def _contact(method: Integrator, spec: Dynamic, model: Model) -> Iterator[Refusal]:
    """Refuse methods that cannot end a step without overlap or adhesion at contacts without a law.

    Contact between bodies is also refused for methods that conserve energy.
    """
    hard = [contact for contact in model.contacts if contact.hard]
    rubs = [contact for contact in hard if contact.item.friction]
    if method.contact and not method.friction and rubs:
        names = ", ".join(dict.fromkeys(contact.name for contact in rubs))
        yield ("method", f"{method.name} does not support friction without a law ({names})",
               f"{listed(m.name for m in _LIST if m.friction)}, no friction, or law: {{stiffness: ...}} for the "
               "contact")
    elif hard and not method.contact:
        names = ", ".join(dict.fromkeys(contact.name for contact in hard))
        yield ("method", f"{method.name} does not support contact without a law ({names})",
               f"{listed(m.name for m in _LIST if m.contact)}, or law: {{stiffness: ...}} for the contact")
    names = ", ".join(dict.fromkeys(contact.name for contact in model.contacts if contact.other in model.meshes))
    if method.conserves and names:
        yield ("method", f"{method.name} does not support contact between bodies ({names})",
               listed(m.name for m in _LIST if m.friction))


RULES: tuple[Rule, ...] = (_multistep, _undamped, _radius, _without_gradient, _forgets, _contact)


def method_problems(model: Model) -> list[Problem]:
    """Return why the method of a case cannot compute its motion, at the keys of the case."""
    spec = model.case.solver
    if not isinstance(spec, Dynamic) or model.loaded is None:
        return []
    method = INTEGRATORS[spec.method or default_method(model)]
    return [model.loaded.source.problem(("solver", key), f"solver.{key}: {message}", expected)
            for rule in RULES for key, message, expected in rule(method, spec, model)]
