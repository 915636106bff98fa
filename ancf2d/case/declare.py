"""Declarations of the case format: frozen dataclasses whose fields describe the keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar, dataclass_transform

_T = TypeVar("_T", bound=type)


def key(kind: Any, doc: str, *, default: Any = dataclasses.MISSING, name: str = "",
        refers: str = "", example: Any = None) -> Any:
    """Declare a field of a record: its kind, its meaning, its default.

    ``name`` is the key in the file if that is not the field's name, ``refers`` the list of names that its text must
    belong to (``bodies``, ``probes``), ``example`` a value for editors.
    """
    bounds = {k: v for k in ("gt", "ge", "lt", "le", "least", "most")
              if (v := getattr(kind, k, None)) is not None}
    metadata = {"kind": kind, "doc": doc, "name": name, "refers": refers, "example": example,
                "unit": getattr(kind, "unit", ""), "choices": getattr(kind, "options", ()),
                **bounds}
    if isinstance(default, dict | list):
        made = type(default)
        return dataclasses.field(default_factory=made, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@dataclass_transform(frozen_default=True, field_specifiers=(key,))
def record(cls: _T | None = None, *, kw_only: bool = False) -> Any:
    """Turn a class into an immutable dataclass that compares by value.

    Same as ``dataclass(frozen=True)``, but only ``__init__`` is generated for each class; the other methods are shared,
    which makes importing the format four times as fast.
    """
    def make(cls: Any) -> Any:
        made: Any = dataclasses.dataclass(repr=False, eq=False, kw_only=kw_only)(cls)
        for name, method in _SHARED.items():
            setattr(made, name, method)
        return made
    return make if cls is None else make(cls)


def _values(self: Any) -> tuple[Any, ...]:
    return tuple(getattr(self, name) for name in self.__dataclass_fields__)


def _eq(self: Any, other: object) -> Any:
    return _values(self) == _values(other) if type(self) is type(other) else NotImplemented


def _hash(self: Any) -> int:
    return hash((type(self), _values(self)))


def _repr(self: Any) -> str:
    inside = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.__dataclass_fields__)
    return f"{type(self).__qualname__}({inside})"


def _setattr(self: Any, name: str, value: Any) -> None:
    # __init__ sets each field once
    if name in self.__dict__ or name not in self.__dataclass_fields__:
        raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
    self.__dict__[name] = value


def _delattr(self: Any, name: str) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


_SHARED: dict[str, Callable[..., Any]] = {
    "__eq__": _eq, "__hash__": _hash, "__repr__": _repr,
    "__setattr__": _setattr, "__delattr__": _delattr}
