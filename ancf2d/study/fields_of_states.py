"""Fields over the bodies of a result file, computed from its states if they are not stored."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Dynamic, LoadedCase, Stiffness, load_case_text
from ..case.part_checks import refused_field
from ..case.records import tag_of
from ..errors import Ancf2dError
from ..results import FieldRecord, Results
from ..solvers.fields import FIELDS, FieldReader
from .run import field_records, vocabulary

if TYPE_CHECKING:
    from ..model.model import Model
    from ..solvers.state import State
    from ..solvers.stored_states import MotionAtTimes
    from ..solvers.system import System


class StatesWithFields(Results):
    """An open result file with every field that follows from its states, stored or not."""

    @cached_property
    def _model(self) -> Model | None:
        """The model of the case with the fields to compute, or None if no field follows from its states."""
        from ..model.build import build_model

        try:
            def built(fields: list[str]) -> Model:
                return build_model(self._with(fields))

            model = built([])
            # stored states do not contain the history variables of elements
            fields = [] if model.remembers else _computable_fields(model)
            found = built(fields) if fields else None
        except Ancf2dError:
            return None
        same = found is not None and found.n_q == self.nq and np.array_equal(found.e0, self.e0)
        return found if same else None

    def _with(self, fields: list[str]) -> LoadedCase:
        """Return the case with other fields. Raises Ancf2dError."""
        name = str(self.attrs.get("case_name", ""))
        return load_case_text(self.case_completed, name, [f"output.fields=[{', '.join(fields)}]"], vocabulary(),
                              os.path.dirname(name))

    def refused(self, field: str) -> str:
        """Return why the case cannot store a field; empty if it can."""
        try:
            case = self._with([]).case
        except Ancf2dError:
            return ""
        found = refused_field(case, tag_of(type(case.solver)), field)
        return "" if found is None else found[0]

    @cached_property
    def _reader(self) -> FieldReader | None:
        return None if self._model is None else FieldReader(self._model)

    @cached_property
    def fields(self) -> dict[str, dict[str, FieldRecord]]:
        """The fields over the bodies, both those stored and those that can be computed."""
        found: dict[str, dict[str, FieldRecord]] = {}
        labels = {"F": self.units.force, "L": self.units.length, "T": self.units.time}
        for record in field_records(self._model) if self._model is not None and self.nt else ():
            units = record.units.format(**labels)
            found.setdefault(record.body, {})[record.name] = replace(record, units=units)
        for body, stored in self._stored_fields.items():
            found.setdefault(body, {}).update({name: record for name, (record, _) in stored.items()})
        return found

    def field(self, body: str, name: str, i: int = -1) -> np.ndarray:
        """Return the values (ne, nx, ny, components) of a field over a body in state i; see ``fields``."""
        if name in self._stored_fields.get(body, {}) or self._reader is None:
            return super().field(body, name, i)
        number = self._number(i)
        if self._last is None or self._last[0] != number:
            self._last = number, self._reader.read(self._state(number))
        return self._last[1][body, name]

    _last: tuple[int, dict[tuple[str, str], Any]] | None = None

    def _state(self, i: int) -> State:
        """Return a stored state in the form in which its solver yielded it."""
        from ..solvers.state import State
        from ..solvers.statics.stored_equilibria import equilibrium_at

        model = self._model
        assert model is not None
        d, v = np.zeros((2, len(model.numbering.place)))
        d[:model.n_q] = self.d(i)
        t, turned = float(self.t[i]), self.turned(i)
        if turned is None:
            turned = model.turns.from_reference(d)
        if model.case.solver.balances:
            return equilibrium_at(self._system, t, d, turned, model.case.solver.linear)
        if self._motion is not None and self.holds("v"):
            v[:model.n_q] = self.v(i)
            return self._motion.at(t, d, v, turned)
        zero = np.zeros_like(d)
        return State(t, d, zero, zero, 0.0, turned, v=self.v(i) if self.holds("v") else None)

    @cached_property
    def _system(self) -> System:
        from ..solvers.system import System
        from .warmup import warm_up

        assert self._model is not None
        warm_up(self._model)
        return System(self._model)

    @cached_property
    def _motion(self) -> MotionAtTimes | None:
        """The solver for the accelerations of stored states, or None if the case is not a motion."""
        from ..solvers.stored_states import MotionAtTimes
        from .warmup import warm_up

        model = self._model
        assert model is not None
        if not isinstance(model.case.solver, Dynamic):
            return None
        warm_up(model)
        return MotionAtTimes(model, model.case.solver)


def _computable_fields(model: Model) -> list[str]:
    """Return the names of the fields that can be computed from stored states.

    Sections given by their stiffnesses have no stress. States do not contain contact forces. N, Q and M follow from
    equilibrium, with the multipliers of supports and joints and the accelerations of motions; neither is stored, both
    are recomputed.
    """
    solid = all(not isinstance(body.section, Stiffness) or model.meshes[name].plan.rigid
                for name, body in model.case.bodies.items())
    solid = solid and not any(mesh.plan.formulation.law.state for mesh in model.meshes.values())
    balanced = model.case.solver.balances or model.case.solver.moves or not model.constraints
    return [f.name for f in FIELDS.values() if not f.kept and (solid if f.over else balanced)]
