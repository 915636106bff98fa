"""The same scene in another form: bodies in another order, a body reversed, a body split and welded again."""

from __future__ import annotations

import copy
import random
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from ancf2d.elements.definition import ElementType

from .bodies import type_of
from .shapes import Data, at, curve_of, is_rigid, part_of, path_ends, position, split_point, turned_round
from .similar import ODD, UnfitError, swapped, times, turn_layers


def reordered(case: Data, rng: random.Random) -> Data:
    """Return a case with its bodies and all lists in another order."""
    out = copy.deepcopy(case)
    for key in ("joints", "springs", "masses", "loads", "boundary_conditions"):
        if key in out:
            rng.shuffle(out[key])
    for joint in out.get("joints", ()):
        if "between" in joint:
            rng.shuffle(joint["between"])
    for spring in out.get("springs", ()):
        if rng.random() < 0.5:
            spring["between"].reverse()
            if "angle" in spring:
                spring["angle"] = -spring["angle"]
            if spring["type"] == "rotational":
                spring.update(swapped(spring))
    for load in out.get("loads", ()):
        if load["type"] == "torque" and rng.random() < 0.5:
            load["between"].reverse()
            load["value"] = -load["value"]
    names = list(case["bodies"])
    while len(names) > 1 and names == list(case["bodies"]):
        rng.shuffle(names)
    out["bodies"] = {name: out["bodies"][name] for name in names}
    return out


# ---------------------------------------------------------------------- points


def with_points(case: Data, change: Callable[[str], str]) -> Data:
    """Return a case with every BODY@S in it changed."""
    out = copy.deepcopy(case)
    for item in (*out.get("boundary_conditions", ()), *out.get("loads", ()), *out.get("masses", ()),
                 *out.get("joints", ())):
        for key in ("at", "point"):
            if key in item:
                item[key] = change(item[key])
    for load in out.get("loads", ()):
        if "through" in load:
            load["through"] = [change(p) if isinstance(p, str) else {**p, "at": change(p["at"])}
                               for p in load["through"]]
    for item in (*out.get("joints", ()), *out.get("springs", ()), *out.get("loads", ())):
        if "between" in item:
            item["between"] = [change(p) if isinstance(p, str) else p for p in item["between"]]
    probes = out["output"]["probes"]
    for name, p in probes.items():
        probes[name] = change(p) if isinstance(p, str) else {**p, "at": change(p["at"])}
    return out


# ---------------------------------------------------------------------- reversed


def symmetric_under_reversal(kind: ElementType) -> bool:
    """Return whether a basis spans the same polynomials from the other end: (x, y) -> (1 - x, -y).

    Judged at points: with these functions' values as columns, those of the reversed ones add no rank.
    """
    x, y = np.meshgrid(np.linspace(0.1, 0.85, 12), np.linspace(-0.4, 0.3, 9))

    def values(x: Any, y: Any) -> Any:
        return np.array([sum(term_value(t, x, y) for t in p.terms) for p in kind.polynomials]).reshape(
            len(kind.basis), -1).T

    A = values(x, y)
    both = np.hstack([A, values(1.0 - x, -y)])
    return bool(np.linalg.matrix_rank(both, 1e-10) == np.linalg.matrix_rank(A, 1e-10))


def term_value(term: Any, x: Any, y: Any) -> Any:
    """Return the values of a term, Poisson's ratio being 0.3."""
    return term.coefficient * 0.3**term.nu * x**term.i * y**term.j


def reversed_body(case: Data, name: str) -> Data:
    """Return a case with one body written from its other end."""
    body = case["bodies"][name]
    if not is_rigid(body) and not symmetric_under_reversal(type_of(body["element"])):
        raise UnfitError("the element is not symmetric under reversal")
    out = with_points(case, lambda p: at(name, 1.0 - split_point(p)[1]) if split_point(p)[0] == name else p)
    out["bodies"][name]["geometry"] = reversed_axis(out["bodies"][name]["geometry"])
    change_profiles(out["bodies"][name], turned_round)
    turn_layers(out["bodies"][name])
    for load in out.get("loads", ()):
        own = load.get("on") == name or split_point(load.get("at", "@0"))[0] == name
        if own and (load["type"] == "follower_force" or load.get("follower")):
            load["value"] = [-v for v in load["value"]]
        if load.get("on") == name:
            load.update({k: times(turned_round(load[k]), -1.0) for k in ODD if k in load})
        if load.get("on") == name and ("from" in load or "to" in load):
            load["from"], load["to"] = 1.0 - load.get("to", 1.0), 1.0 - load.get("from", 0.0)
    eyelets = [p for load in out.get("loads", ()) for p in load.get("through", ())]
    for p in (*out["output"]["probes"].values(), *eyelets):
        if isinstance(p, dict) and split_point(p["at"])[0] == name:
            p["y"] = -p["y"]
    return out


def reversed_axis(geometry: Data) -> Data:
    """Return an axis from its other end."""
    g, kind = geometry, geometry["type"]
    if kind in ("polyline", "spline"):
        points = g["points"]
        return {**g, "points": [points[0], *points[:0:-1]] if g.get("closed") else points[::-1]}
    if kind == "curve":
        return {**g, **{k: with_parameter(g[k], "1 - s") for k in ("x", "y")}}
    if kind == "path":
        heading = g.get("heading", 0.0) + sum(p.get("angle", 0.0) for p in g["pieces"]) + np.pi
        pieces = [{**p, "angle": -p["angle"]} if "angle" in p else p for p in g["pieces"][::-1]]
        return {**g, "start": position(g, 1.0).tolist(), "heading": heading, "pieces": pieces}
    first, last = ("start", "end") if kind == "line" else ("from", "to")
    return {**g, first: g[last], last: g[first]}


def with_parameter(text: str, of_s: str) -> str:
    """Return an expression in s with another expression in its place."""
    return re.sub(r"\bs\b", f"({of_s})", text)


# what is the same along a body
FIXED = ("damping", "layers", "hardening", "stress_strain", "viscoelastic")


def change_profiles(body: Data, change: Callable[[Any], Any]) -> None:
    """Change the numbers of section and material of a body, which may be tables over s."""
    for key in ("section", "material"):
        if key in body:
            body[key] = {k: v if k in FIXED else change(v) for k, v in body[key].items()}


# ---------------------------------------------------------------------- split


def points_on(case: Data, name: str) -> list[float]:
    """Return S of all points of a body with a load or constraint."""
    found: list[float] = []

    def seen(p: str) -> str:
        if split_point(p)[0] == name:
            found.append(split_point(p)[1])
        return p

    with_points({**case, "output": {"probes": {}}}, seen)
    found += [s for part in ("section", "material") for v in case["bodies"][name].get(part, {}).values()
              if isinstance(v, dict) for s in v.get("s", ())]
    along = [load for load in case.get("loads", ()) if load.get("on") == name]
    found += [s for load in along for key in ODD if isinstance(load.get(key), dict) for s in load[key]["s"]]
    return found + [load.get(key, 0.0) for load in along for key in ("from", "to") if key in load]


def splits(case: Data, name: str) -> list[tuple[float, int]]:
    """Return possible cuts of a body that keep its mesh: S and the number of elements before."""
    body = case["bodies"][name]
    geometry, spec = body["geometry"], body["element"]
    slid_on = any(j.get("on") == name for j in case.get("joints", ()))
    # what is left of a spline that is cut is no spline through the points that are left
    if geometry["type"] in ("polyline", "spline") or slid_on:
        return []
    # one tendon is as tight everywhere
    if any(load.get("on") == name and "stiffness" in load for load in case.get("loads", ())):
        return []
    if is_rigid(body):
        return [] if "mass" in spec or geometry["type"] == "path" else [(0.4, 0)]
    n = spec["count"]
    if geometry["type"] == "path":
        ends = path_ends(geometry)
        # how many elements each piece has is known where each has one
        fits = n == len(ends) - 1 and all(np.abs(np.subtract(ends, s)).min() < 1e-9 for s in points_on(case, name))
        return [(ends[k], k) for k in range(1, n)] if fits else []
    if any(abs(s * n - round(s * n)) > 1e-9 for s in points_on(case, name)):
        return []
    return [(k / n, k) for k in range(1, n)]


def split_body(case: Data, name: str, s: float, k: int) -> Data:
    """Return a case with one body cut at S, after k elements, and welded again."""
    other = name + name
    body, out = case["bodies"][name], {}

    def moved(p: str) -> str:
        owner, at_s = split_point(p)
        if owner != name:
            return p
        return at(name, min(at_s / s, 1.0)) if at_s <= s + 1e-12 else at(other, (at_s - s) / (1.0 - s))

    out = with_points(case, moved)
    out["bodies"] = {}
    for key, value in case["bodies"].items():
        out["bodies"][key] = copy.deepcopy(value)
        if key == name:
            out["bodies"][other] = copy.deepcopy(value)
    first, last = out["bodies"][name], out["bodies"][other]
    change_profiles(first, lambda v: part_of(v, 0.0, s))
    change_profiles(last, lambda v: part_of(v, s, 1.0))
    first["geometry"], last["geometry"] = halves(body["geometry"], s, k)
    if not is_rigid(body):
        first["element"]["count"], last["element"]["count"] = k, body["element"]["count"] - k
    welds = [{"name": "cut", "type": "weld", "between": [at(name, 1.0), at(other, 0.0)]}]
    if body["geometry"].get("closed"):
        welds.append({"name": "seam", "type": "weld", "between": [at(other, 1.0), at(name, 0.0)]})
    out["joints"] = [*out.get("joints", []), *welds]
    out["loads"] = [part for load in out.get("loads", ()) for part in split_load(load, name, other, s)]
    start = out.get("initial", {}).get("bodies", {})
    if name in start:
        start[other] = copy.deepcopy(start[name])
    return out


def halves(geometry: Data, s: float, k: int) -> tuple[Data, Data]:
    """Return both parts of an axis that is cut at S, a path after k pieces."""
    g, kind = {k: v for k, v in geometry.items() if k != "closed"}, geometry["type"]
    if kind == "arc":
        cut: Any = g["from"] + s * (g["to"] - g["from"])
        return {**g, "to": cut}, {**g, "from": cut}
    if kind == "curve":
        cut = curve_of(g).parameter(s)
        first, last = ({**g, **{x: with_parameter(g[x], part) for x in "xy"}}
                       for part in (f"{cut!r}*s", f"{cut!r} + {1.0 - cut!r}*s"))
        return first, last
    cut = position(g, s).tolist()
    if kind == "path":
        heading = g.get("heading", 0.0) + sum(p.get("angle", 0.0) for p in g["pieces"][:k])
        return {**g, "pieces": g["pieces"][:k]}, {**g, "start": cut, "heading": heading, "pieces": g["pieces"][k:]}
    return {**g, "end": cut}, {**g, "start": list(cut)}


def split_load(load: Data, name: str, other: str, s: float) -> list[Data]:
    """Return a load on a body as loads on its two parts."""
    if load.get("on") != name:
        return [load]
    a, b = load.get("from", 0.0), load.get("to", 1.0)
    first, last = ({k: part_of(v, *ends) if k in ODD else v for k, v in load.items()}
                   for ends in ((0.0, s), (s, 1.0)))
    parts = [{**first, "from": a / s, "to": min(b / s, 1.0)}] if a < s else []
    return parts + ([{**last, "on": other, "from": max((a - s) / (1 - s), 0.0), "to": (b - s) / (1 - s)}]
                    if b > s else [])


