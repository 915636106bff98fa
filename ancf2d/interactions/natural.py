"""Natural strains: what a body would take if it were free, by its temperature or as an actuator gives it."""

from __future__ import annotations

from collections.abc import Iterator

from ..case.binder import Issue
from ..case.declare import key, record
from ..case.kinds import Name, Number
from ..case.schema.amplitudes import Amplitude
from ..case.schema.profiles import Profile, ProfileOf
from ..elements.formulations import FORMULATIONS
from ..model.natural import AlongBody, NaturalStrain
from ..model.profiles import breaks
from .forces import AMPLITUDE, AMPLITUDE_DOC, NAME, LoadContext, LoadError, LoadSet, load


def _add(load: Eigenstrain | Temperature, values: tuple[AlongBody, AlongBody, AlongBody, AlongBody],
         context: LoadContext, out: LoadSet) -> None:
    mesh = context.meshes[load.on]
    plan = mesh.plan
    if plan.rigid:
        raise LoadError(("on",), f"body '{load.on}' is rigid", "a body that deforms")
    if plan.formulation.natural is None:
        known = [f.name for f in FORMULATIONS.values() if f.natural is not None and f.refuse(plan.element) is None]
        raise LoadError(("on",), f"formulation {plan.formulation.name} of body '{load.on}' knows no natural strains",
                        "one of " + ", ".join(known))
    out.natural.append(NaturalStrain(mesh, load.from_, load.to, values, context.amplitude))


def _places(load: Eigenstrain | Temperature, *parts: AlongBody) -> tuple[str, tuple[float, ...]]:
    inner = {s for p in parts if not isinstance(p, float) for s, _ in breaks(p) if load.from_ < s < load.to}
    return load.on, (load.from_, *sorted(inner), load.to)


def _issues(load: Eigenstrain | Temperature, empty: str) -> Iterator[Issue]:
    if not load.from_ < load.to:
        yield Issue(("to",), f"{{}}: from must be less than to, got from {load.from_:g} to {load.to:g}")
    if empty:
        yield Issue((), f"{{}} strains nothing: {empty} are both 0", f"{empty.replace(' and ', ', ')} or both")


@load
@record
class Eigenstrain:
    """Strains that a body would take if it were free, caused by actuators, growth or an initial curvature."""

    tag = "eigenstrain"
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="strip")
    axial: float | Profile = key(ProfileOf(), "Strain of the axis", default=0.0, example=1e-3)
    curvature: float | Profile = key(ProfileOf("1/m"), "Change of the angle per length of the reference, "
                                     "counter-clockwise", default=0.0, example=0.2)
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def places(self) -> tuple[str, tuple[float, ...]]:
        """The body, and where along it nodes are wanted."""
        return _places(self, self.axial, self.curvature)

    def check(self) -> Iterator[Issue]:
        """Yield an extent that is empty or backward, and an eigenstrain of nothing."""
        yield from _issues(self, "axial and curvature" if self.axial == 0.0 and self.curvature == 0.0 else "")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add what it strains."""
        _add(self, (self.axial, self.curvature, 0.0, 0.0), context, out)


@load
@record
class Temperature:
    """A change of temperature, which strains the body by the material's alpha, the same in all directions."""

    tag = "temperature"
    on: str = key(Name("the name of a body"), "Body it acts on", refers="bodies", example="strip")
    value: float | Profile = key(ProfileOf("K"), "Change of temperature on the axis", default=0.0, example=60)
    gradient: float | Profile = key(ProfileOf("K/m"), "Change per metre across, along the section's y axis",
                                    default=0.0)
    from_: float = key(Number("", ge=0, le=1), "S where it begins", default=0.0)
    to: float = key(Number("", ge=0, le=1), "S where it ends", default=1.0)
    amplitude: Amplitude | None = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    @property
    def places(self) -> tuple[str, tuple[float, ...]]:
        """The body, and where along it nodes are wanted."""
        return _places(self, self.value, self.gradient)

    def check(self) -> Iterator[Issue]:
        """Yield an extent that is empty or backward, and a temperature that stays."""
        yield from _issues(self, "value and gradient" if self.value == 0.0 and self.gradient == 0.0 else "")

    def add(self, context: LoadContext, out: LoadSet) -> None:
        """Add what it strains by the thermal expansion of the material."""
        section = context.meshes[self.on].plan.section
        if not section.alpha:
            raise LoadError(("on",), f"body '{self.on}' has no thermal expansion",
                            f"bodies.{self.on}.material.alpha, in 1/K")
        _add(self, (0.0, 0.0, self.value, self.gradient), context, out)
