"""Amplitudes: random ones, their values, and the same on another time scale."""

from __future__ import annotations

import random
import re

from instruments.own_equations.amplitudes import course

from .shapes import Data


def random_amplitude(rng: random.Random, end: float, moves: bool = False) -> Data:
    """Return an amplitude of order one over times (or load factors) from 0 to ``end``."""
    kind = rng.choice(("constant", "ramp", "table", "smooth", "sine", "expression"))
    if not moves and kind == "constant":
        kind = "ramp"
    if kind == "constant":
        return {"type": "constant"}
    if kind == "ramp":
        return {"type": "ramp", "t0": 0.0, "t1": end * rng.choice((0.5, 1.0, 2.0))}
    if kind == "table":
        return {"type": "table", "t": [0.0, 0.4 * end, end], "value": [0.0, rng.uniform(0.2, 0.8), 1.0]}
    if kind == "smooth":
        return {"type": "table", "t": [0.0, 0.5 * end, end], "value": [0.0, rng.uniform(0.2, 0.8), 1.0],
                "smooth": True}
    if kind == "sine":
        return {"type": "sine", "frequency": rng.uniform(0.1, 0.3) / end}
    texts = ("t^2", "sin(1.3*t)", "t if t < 0.5 else 0.5", "1 - exp(-2*t)", "abs(t)*sqrt(t)")
    return {"type": "expression", "value": rng.choice(texts) if end == 1.0 else
            stretched_text(rng.choice(texts), end)}


def stretched_text(text: str, by: float) -> str:
    """Return an expression of t/by."""
    return re.sub(r"\bt\b", f"(t/{by!r})", text)


def stretched(amplitude: Data, by: float) -> Data:
    """Return an amplitude that takes ``by`` times as long."""
    out = dict(amplitude)
    for key in ("t0", "t1"):
        if key in out:
            out[key] = out[key] * by
    if amplitude["type"] == "ramp":
        out["t0"], out["t1"] = out.get("t0", 0.0), out.get("t1", by)
    if amplitude["type"] == "table":
        out["t"] = [t * by for t in out["t"]]
    if amplitude["type"] == "sine":
        out["frequency"] = out["frequency"] / by
    if amplitude["type"] == "expression":
        out["value"] = stretched_text(out["value"], by)
    return out


def scaled(amplitude: Data | float, by: float) -> Data | float:
    """Return an amplitude times a number."""
    if by == 1.0 or not isinstance(amplitude, dict):
        return amplitude if by == 1.0 else amplitude * by
    return {**amplitude, "scale": amplitude.get("scale", 1.0) * by}


def value(amplitude: Data | float | None, t: float, static: bool) -> float:
    """Return the value of an amplitude, or of the default without one."""
    if isinstance(amplitude, int | float):
        return amplitude
    if amplitude is not None and amplitude.get("smooth") and t not in amplitude["t"]:
        raise ValueError("a smooth table is known at its points alone")
    return course(amplitude, "ramp" if static else "constant")(t)[0]
