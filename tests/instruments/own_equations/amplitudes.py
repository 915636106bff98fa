"""Amplitudes as functions of time that give value, rate and acceleration."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

Course = Callable[[float], tuple[float, float, float]]
WORDS = {"sin": cmath.sin, "cos": cmath.cos, "exp": cmath.exp, "sqrt": cmath.sqrt, "pi": math.pi, "abs": abs,
         "__builtins__": {}}


def course(spec: Any, usual: str) -> Course:
    """Return (value, rate, acceleration) of an amplitude over time; a number stands for ``usual``, constant or ramp."""
    if spec is None or isinstance(spec, int | float):
        spec = {"type": usual, "scale": 1.0 if spec is None else spec}
    scale = spec.get("scale", 1.0)
    found = KINDS[spec["type"]](spec)
    return lambda t: tuple(scale * v for v in found(t))


def _constant(spec: dict[str, Any]) -> Course:
    return lambda t: (1.0, 0.0, 0.0)


def _ramp(spec: dict[str, Any]) -> Course:
    a, b = spec.get("t0", 0.0), spec.get("t1", 1.0)
    return lambda t: (min(max((t - a) / (b - a), 0.0), 1.0), 1 / (b - a) if a <= t < b else 0.0, 0.0)


def _table(spec: dict[str, Any]) -> Course:
    t, v = np.array(spec["t"], float), np.array(spec["value"], float)

    def value(now: float) -> tuple[float, float, float]:
        k = int(np.searchsorted(t, now, side="right")) - 1
        if k < 0 or k >= len(t) - 1:
            return float(v[0 if k < 0 else -1]), 0.0, 0.0
        slope = (v[k + 1] - v[k]) / (t[k + 1] - t[k])
        return float(v[k] + slope * (now - t[k])), float(slope), 0.0

    return value


def _sine(spec: dict[str, Any]) -> Course:
    w, phase = 2 * math.pi * spec["frequency"], spec.get("phase", 0.0)
    return lambda t: (math.sin(w * t + phase), w * math.cos(w * t + phase), -w * w * math.sin(w * t + phase))


def _expression(spec: dict[str, Any]) -> Course:
    """A polynomial in t has rates; other expressions, which occur in forces only, have NaN."""
    code = compile(str(spec["value"]).replace("^", "**"), "<expression>", "eval")
    try:
        p = eval(code, WORDS, {"t": Polynomial([0.0, 1.0])}) + Polynomial([0.0])
    except TypeError:
        return lambda t: (complex(eval(code, WORDS, {"t": t})).real, math.nan, math.nan)
    return lambda t: (float(p(t)), float(p.deriv()(t)), float(p.deriv(2)(t)))


KINDS: dict[str, Callable[[dict[str, Any]], Course]] = {
    "constant": _constant, "ramp": _ramp, "table": _table, "sine": _sine, "expression": _expression}
