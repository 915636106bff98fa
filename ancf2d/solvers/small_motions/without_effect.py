"""Parts of a case without effect on small motions, or that keep the reference from being an equilibrium."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ...model.point_tables import Batch
from ..statics.newton import balanced
from .inputs_and_outputs import Input
from .linearised import Linearised


def warnings_of(small: Linearised, damped: bool = True, inputs: Sequence[Input] = ()) -> list[str]:
    """Return warnings about inputs and dampers without effect, and about unbalanced forces in the reference.

    Dampers are checked only if ``damped``.
    """
    model, base = small.model, small.base
    out = [f"{what}: its damping force is of higher order in the rates, so it has no effect on small motions"
           for what in _of_higher_order(small)] if damped else []
    out += [f"the input {one.name} exerts no force and moves nothing in this state, so nothing responds to it"
            for one in inputs if not one.f.any() and not one.p.any()]
    pencil = small.pencil
    if not base.loaded and not balanced(pencil.system, pencil.balance, pencil.d, base.state.t):
        layers = any(contact.law is not None for contact in model.case.contacts)
        acts = [*["springs are loaded"] * bool(model.case.springs), *["contact layers press"] * layers,
                *["material flows"] * bool(model.loads.flows)]
        out.append(f"the reference is not an equilibrium, because {' or '.join(acts)} there. Use about: static")
    return out


def _of_higher_order(small: Linearised) -> Iterator[str]:
    """Yield the springs and loads whose damping has no first-order term in the rates."""
    model, state = small.model, small.base.state
    loads = [(f"loads.{k}", item) for k, item in enumerate(model.case.loads)
             if getattr(item, "damped", False) and item.name not in model.inputs]
    drags = [patch for patch in model.loads.patches if getattr(patch, "damped", False)]
    parts: list[tuple[str, Any]] = [*((patch.path, patch) for patch in model.springs if patch.path and patch.damped),
                                    *((what, patch) for (what, _), patch in zip(loads, drags, strict=False))]
    for what, patch in parts:
        batch = Batch([patch])
        *_, C = batch.matrices(state.d, state.t)
        if not C.any():
            yield what
