"""Smaller scenes that show the same violation."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

from .rearrange import with_points
from .shapes import Data, pieces, position, split_point

LISTS = ("loads", "springs", "masses", "joints", "boundary_conditions")
# keys of an element, a body or the case that say more than is needed
EXTRAS = ("formulation", "quadrature", "shear_factor", "preset")
# digits that numbers are rounded to, coarsest first
DIGITS = (1, 2, 3)
MOST_TRIES = 300


def shrunk(case: Data, violates: Callable[[Data], bool], most: int = MOST_TRIES) -> Data:
    """Return a case that still ``violates``, reduced as far as single steps allow."""
    tries = 0
    found = True
    while found and tries < most:
        found = False
        for smaller in smaller_cases(case):
            tries += 1
            if tries >= most:
                break
            if violates(smaller):
                case, found = smaller, True
                break
    return case


def smaller_cases(case: Data) -> Iterator[Data]:
    """Yield cases that are one step simpler, the largest steps first."""
    yield from without_bodies(case)
    for key in LISTS:
        for i in range(len(case.get(key, ()))):
            out = copy.deepcopy(case)
            del out[key][i]
            yield {k: v for k, v in out.items() if v != []}
    for key in ("initial", "damping", "steady_rotation"):
        if key in case:
            yield {k: v for k, v in case.items() if k != key}
    yield from simpler_items(case)
    for name, body in case["bodies"].items():
        for simpler in simpler_bodies(body):
            yield {**case, "bodies": {**case["bodies"], name: simpler}}
    probes = case["output"]["probes"]
    for name in probes if len(probes) > 1 else ():
        yield {**case, "output": {**case["output"], "probes": {k: p for k, p in probes.items() if k != name}}}
    if "fields" in case["output"]:
        yield {**case, "output": {"probes": probes}}
    for digits in DIGITS:
        out = rounded(case, digits)
        if out != case:
            yield out


def without_bodies(case: Data) -> Iterator[Data]:
    """Yield cases with one body less, and without its loads and constraints."""
    for name in case["bodies"] if len(case["bodies"]) > 1 else ():
        out = copy.deepcopy(case)
        del out["bodies"][name]
        for key in LISTS:
            kept = [without_points(item, name) for item in out.get(key, ())]
            out[key] = [item for item in kept if item is not None]
        probes = out["output"]["probes"]
        out["output"]["probes"] = {k: p for k, p in probes.items()
                                   if split_point(p if isinstance(p, str) else p["at"])[0] != name}
        start = out.get("initial", {})
        if name in start.get("bodies", {}):
            del out["initial"]
        yield {k: v for k, v in out.items() if v != []}


def without_points(item: Data, name: str) -> Data | None:
    """Return a joint, load, ... without the points of a body; None if nothing remains."""
    if item.get("on") == name or any(split_point(item[k])[0] == name for k in ("at", "point") if k in item):
        return None
    if "between" in item:
        kept = [p for p in item["between"] if not isinstance(p, str) or split_point(p)[0] != name]
        return {**item, "between": kept} if len(kept) > 1 else None
    return item


def simpler_items(case: Data) -> Iterator[Data]:
    """Yield cases with a simpler load, joint, ..."""
    for key in LISTS:
        for i, item in enumerate(case.get(key, ())):
            for extra in ("amplitude", "active", "spread", "hold", "inertia", "follower", "from", "to", "damping",
                          "angle", "length", "only", "gap"):
                if extra in item and item["type" if "type" in item else "at"] != "prescribed":
                    out = copy.deepcopy(case)
                    del out[key][i][extra]
                    yield out
            if len(item.get("between", ())) > 2:
                for k in range(len(item["between"])):
                    out = copy.deepcopy(case)
                    del out[key][i]["between"][k]
                    yield out


def simpler_bodies(body: Data) -> Iterator[Data]:
    """Yield bodies with a simpler axis, mesh, element or section."""
    geometry, spec = body["geometry"], body["element"]
    if geometry["type"] != "line":
        ends = [[float(v) for v in position(geometry, s)] for s in (0.0, 1.0)]
        yield {**body, "geometry": {"type": "line", "start": ends[0], "end": ends[1]}}
    for count in dict.fromkeys((pieces(geometry), spec.get("count", 1) - 1)):
        if pieces(geometry) <= count < spec.get("count", 1):
            yield {**body, "element": {**spec, "count": count}}
    for key in EXTRAS:
        if key in spec:
            yield {**body, "element": {k: v for k, v in spec.items() if k != key}}
    if "damping" in body.get("material", {}):
        yield {**body, "material": {k: v for k, v in body["material"].items() if k != "damping"}}


def rounded(case: Data, digits: int) -> Data:
    """Return a case with all numbers rounded to so many digits."""
    def short(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: short(v) for k, v in value.items()}
        if isinstance(value, list):
            return [short(v) for v in value]
        return float(f"{value:.{digits}g}") if isinstance(value, float) else value

    return with_points(short(case), lambda p: p)
