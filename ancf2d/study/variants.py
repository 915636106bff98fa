"""Variants of a case with other element types or finer meshes, as overrides of the case's text."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from typing import Any

from ..case import Body, Case, LoadedCase, Selective, Source, read_definition
from ..case.binder import listed, nearest
from ..case.emit import written
from ..elements import registry
from ..elements.definition import ElementType
from ..elements.formulations import FORMULATIONS
from ..elements.registry import RIGID_TYPE
from ..errors import CaseError
from ..model.curve import stretches
from ..model.grading import grading_of
from ..model.own_element import own_element
from ..model.plan import acting_points, has_regular_nodes
from .run import vocabulary

# elements per stretch of the coarsest mesh, of which finer ones are refinements
ENOUGH = 2
# number of meshes of a study whose options name none
LEVELS = 5
# suffixes of files that describe an element
SUFFIXES = (".yaml", ".yml", ".json")
_MEMBER = re.compile(r"(\w+)\[\s*(\d+)\s*,\s*(\d+)\s*\]")


def element_named(name: str) -> ElementType:
    """Return the element type named by ``2d2n`` or ``ancf[3,2]``. Raises ValueError with the nearest name."""
    member = _MEMBER.fullmatch(name.strip())
    if member and member[1] == registry.FAMILY:
        return registry.ancf(int(member[2]), int(member[3]))
    if name.strip() in registry.ELEMENTS:
        return registry.ELEMENTS[name.strip()]
    if name.strip() == registry.FAMILY:
        raise ValueError(f"{registry.FAMILY} needs its orders along and across, e.g. {registry.FAMILY}[3,2]")
    near = nearest(name, registry.ELEMENTS)
    hint = f"did you mean '{near}'?" if near else f"there are {listed([*registry.ELEMENTS, 'ancf[p,q]'])}"
    raise ValueError(f"there is no element type '{name}'; {hint}")


def is_file(name: str) -> bool:
    """Return whether a name is that of a file that describes an element, and not of a listed type."""
    return name.endswith(SUFFIXES) or (os.path.isfile(name) and name not in (*registry.names(), RIGID_TYPE.name))


def described(path: str) -> tuple[ElementType, Source]:
    """Return the element type described by a file. Raises CaseError with all mistakes of the file."""
    definition, source = read_definition(path, vocabulary())
    return own_element(definition, path), source


def formulation_named(name: str) -> str:
    """Return the name if it is a formulation. Raises ValueError with the nearest name."""
    if name not in FORMULATIONS:
        near = nearest(name, FORMULATIONS)
        hint = f"did you mean '{near}'?" if near else f"there are {listed(FORMULATIONS)}"
        raise ValueError(f"there is no formulation '{name}'; {hint}")
    return name


@dataclass(frozen=True)
class Variant:
    """An element type with a formulation that replace those of a case; None keeps that of the case.

    ``definition``: the file that describes a user-defined type.
    """

    type: str | None = None
    order: tuple[int, int] | None = None
    formulation: str | None = None
    definition: str | None = None

    @property
    def element(self) -> str:
        """The type as written by users: ``ancf[3,2]``; 'as given' for that of the case."""
        order = "" if self.order is None else f"[{self.order[0]},{self.order[1]}]"
        return f"{self.type or 'as given'}{order}"

    @property
    def label(self) -> str:
        """Type and formulation as written by users: ``vallejo:structural``."""
        return self.element + (f":{self.formulation}" if self.formulation else "")


def parse_variants(text: str, formulation: str | None = None) -> list[Variant]:
    """Return the variants in ``2d2n,ancf[3,2],vallejo:structural,own.yaml``; ``formulation`` for those without one.

    Raises ValueError for unknown types and formulations, CaseError for files that do not describe a type.
    """
    found = []
    for part in re.split(r",(?![^\[]*\])", text):
        name, colon, own = (p.strip() for p in part.partition(":"))
        path = os.path.abspath(name) if is_file(name) else None
        element = element_named(name) if path is None else described(path)[0]
        chosen = own if colon else formulation
        if chosen is not None:
            formulation_named(chosen)
        member = _MEMBER.fullmatch(element.name)
        kind, order = (member[1], (int(member[2]), int(member[3]))) if member else (element.name, None)
        variant = Variant(kind, order, chosen, path)
        if variant not in found:
            found.append(variant)
    return found


def pieces(body: Body) -> int:
    """Return the least number of elements of a body."""
    return body.geometry.least


def flexible(case: Case) -> dict[str, Body]:
    """Return the bodies that have a mesh."""
    return {name: body for name, body in case.bodies.items() if body.element.type != "rigid"}


def stretches_of(case: Case) -> dict[str, list[float]]:
    """Return the lengths of the stretches of each body that has a mesh; each needs at least one element."""
    acting = acting_points(case)
    return {name: stretches(body.geometry, () if has_regular_nodes(body.element) else acting[name],
                            grading_of(body.element))
            for name, body in flexible(case).items()}


def check_flexible(loaded: LoadedCase, instead: str) -> None:
    """Raise CaseError if no body has a mesh to refine; ``instead``: the alternative to suggest."""
    if not flexible(loaded.case):
        raise CaseError(loaded.source.problem(("bodies",), "every body is rigid, so there is no mesh to refine",
                                              expected=f"a body that deforms, or {instead}"))


def count_of(body: Body) -> int:
    """Return the number of elements of a body in the case (one per piece if it gives none)."""
    return (body.element.number or pieces(body)) * (body.element.refine or 1)


def distribute(case: Case, total: int) -> dict[str, int]:
    """Return the elements of each body for ``total`` elements, in the proportions of the case.

    Every body gets at least one per stretch, so that the sum can exceed ``total``.
    """
    bodies, least = flexible(case), {name: len(lengths) for name, lengths in stretches_of(case).items()}
    whole = sum(count_of(b) for b in bodies.values())
    parts = {name: divmod(total * count_of(b), whole) for name, b in bodies.items()}
    counts = {name: max(part, least[name]) for name, (part, _) in parts.items()}
    # elements left over by rounding down go to the largest remainders
    for name in sorted(parts, key=lambda n: -parts[n][1]):
        if sum(counts.values()) < total:
            counts[name] += 1
    return counts


def proportional(case: Case, counts: dict[str, int]) -> bool:
    """Return whether counts have the proportions of the case."""
    bodies = flexible(case)
    if not bodies:
        return True
    first = next(iter(bodies))
    return all(counts[n] * count_of(bodies[first]) == counts[first] * count_of(b) for n, b in bodies.items())


def default_meshes(case: Case) -> list[int]:
    """Return total element counts that double from the case's own."""
    total = sum(count_of(b) for b in flexible(case).values())
    return [total * 2**k for k in range(LEVELS)]


def nested_base(count: int, stretches: int) -> int:
    """Return the elements of the coarse mesh of which a mesh of ``count`` elements is a refinement.

    Elements of several stretches are whole numbers, whose proportions would change from mesh to mesh. So doubled meshes
    are refinements of one with a few elements per stretch.
    """
    while stretches > 1 and count % 2 == 0 and count >= 2 * ENOUGH * stretches:
        count //= 2
    return count


def divided(count: int, base: int) -> dict[str, int]:
    """Return ``count`` and ``refine`` of a mesh, refined from ``base`` elements if ``count`` is a multiple of them."""
    return {"count": base, "refine": count // base} if base < count and count % base == 0 else {"count": count}


def element_data(body: Body, variant: Variant, count: int, base: int) -> dict[str, Any]:
    """Return the ``element`` of a body, in case format, for a variant and a mesh of ``count`` elements.

    The mesh is a refinement of ``base`` elements if ``count`` is a multiple of them. The case's own type keeps its
    options. Another type has its own defaults and takes from the case only the nodes, grading and fibres, the shear
    factor if it shears, and the preset if the paper has the type.
    """
    own = body.element
    same = variant.type is None or (variant.type, variant.order, variant.definition) == (own.type, own.order, None)
    data: dict[str, Any] = {"shear_factor": own.shear_factor,
                            "nodes": "regular" if has_regular_nodes(own) else own.nodes,
                            "grading": written(own.grading), "fibres": own.fibres}
    data |= divided(count, base)
    if same:
        data.update(type=own.type, order=own.order, preset=own.preset, definition=own.definition,
                    formulation=own.formulation, quadrature=_written(own.quadrature))
    else:
        if variant.definition is None:
            data.update(type=variant.type, order=variant.order)
            element = registry.element_type(str(variant.type), variant.order)
        else:
            data["definition"] = variant.definition
            element = described(variant.definition)[0]
        if element.preset and variant.formulation is None:
            data["preset"] = own.preset
        if element.section_kind == "tangent":
            data["shear_factor"] = None
    if variant.formulation is not None:
        data["formulation"] = variant.formulation
        if same and variant.formulation != own.formulation:
            data["quadrature"] = None
    return {k: v for k, v in data.items() if v is not None}


def _written(quadrature: Any) -> Any:
    if isinstance(quadrature, Selective):
        return {"normal": quadrature.normal, "shear": quadrature.shear}
    return quadrature


def overrides_for(case: Case, variant: Variant, counts: dict[str, int]) -> list[str]:
    """Return the ``PATH=VALUE`` overrides that turn a case into a variant on a mesh."""
    lengths = stretches_of(case)
    return [f"bodies.{name}.element="
            + json.dumps(element_data(body, variant, counts[name], nested_base(counts[name], len(lengths[name]))))
            for name, body in flexible(case).items()]
