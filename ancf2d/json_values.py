"""Conversion of values of any type to JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from types import NoneType
from typing import Any


def plain(value: Any) -> Any:
    """Convert a value that JSON cannot represent to a plain number, list, mapping or text."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, complex):
        return [value.real, value.imag]
    return str(value)


def json_text(value: Any) -> str:
    """Return a value as JSON text; infinite numbers and NaN become null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if type(value) in (str, int, float, bool, NoneType) else _finite(plain(value))
