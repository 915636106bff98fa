"""Random motions of rods that fall among obstacles, and their invariants: no depth, no passage, no energy gained.

Also random beams pressed onto obstacles: an equilibrium exists, in balance and outside the obstacles, on a path around
them.

Positions of points follow from the states that are stored: at the end of every step, of fixed steps that were not made
in parts. Ways are looked at between states with one step between them. Distances are those of this module.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

import ancf2d
from ancf2d.errors import Ancf2dError
from ancf2d.model.points import point_ref
from scripts.pages import table

Array = npt.NDArray[np.float64]
Data = dict[str, Any]
# depth beside the size of the scene where nothing penetrates; how deep the straight way of a step may lead through
# an obstacle that both its ends are out of; and energy that may come from nothing beside the largest there is, that of
# loads, work and losses counted
DEPTH, PASSAGE, GAIN, GIVEN = 1e-8, 2e-3, 2e-2, 1e-9
# forces of an equilibrium beside the largest that may be left; how deep the straight way of a load step may lead
# through an obstacle, in which points slide along what is round
BALANCE, SLID = 1e-6, 5e-2
SAMPLES = 200


@dataclass
class Verdict:
    """The outcome of a scene: depth and passage over its size, energy gained over the largest, or the failure.

    ``given`` is work that is told of steps in which nothing touches an obstacle that moves, beside the largest energy.
    """

    number: int
    kind: str = ""
    depth: float = 0.0
    passage: float = 0.0
    gain: float = 0.0
    given: float = 0.0
    failure: str = ""
    warnings: list[str] = field(default_factory=list)

    @property
    def faults(self) -> list[str]:
        """Return the violated invariants."""
        out = [f"{name} {value:.1e}" for name, value, most in (
            ("depth", self.depth, DEPTH), ("passage", self.passage, PASSAGE), ("gain", self.gain, GAIN),
            ("given", self.given, GIVEN)) if not value <= most]
        return [*out, self.failure] if self.failure else out


# ---------------------------------------------------------------------- made


def scene(seed: int, number: int) -> Data:
    """Return the scene of a number as the data of a case; the same in every process."""
    rng = random.Random(f"touching {seed} {number}")
    made: Data = json.loads(json.dumps(_made(rng)))
    return made


def _made(rng: random.Random) -> Data:
    flexible, law = rng.random() < 0.4, rng.random() < 0.3
    length, angle, mass = rng.uniform(0.3, 1.0), rng.uniform(0.0, 2 * math.pi), 10 ** rng.uniform(-1, 0.7)
    middle = np.array([rng.uniform(-0.5, 0.5), 1.9])
    half = 0.5 * length * np.array([math.cos(angle), math.sin(angle)])
    bodies: Data = {"rod": _rod(rng, middle - half, middle + half, mass, length, flexible)}
    obstacles: Data = {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]},
                       "left": {"type": "half_plane", "through": [-2.0, 0], "normal": [1, 0.2]},
                       "right": {"type": "half_plane", "through": [2.0, 0], "normal": [-1, 0.2]}}
    supports: list[Data] = []
    for k in range(rng.randint(1, 3)):
        obstacles[f"o{k}"] = _obstacle(rng, f"wheel{k}", k, bodies, supports)
    hold = {"law": {"stiffness": 10 ** rng.uniform(4, 5.5) * mass / length, "damping": rng.choice((0.0, 30.0)) * mass}
            } if law else {"restitution": rng.choice((0.0, 0.5, 1.0, rng.random()))}
    friction = rng.choice((0.0, 0.0, 0.3, 1.0))
    side = "surface" if flexible and rng.random() < 0.3 else "axis"
    contacts = [{"name": f"on {name}", "between": ["rod", name], "side": side, "friction": friction, **hold}
                for name in obstacles]
    if law:
        how: Data = {"tolerance": 1e-5, "method": rng.choice(("generalized_alpha", "radau5"))}
    else:
        how = {"tolerance": 1e-4} if rng.random() < 0.3 else {"dt": rng.choice((0.05, 0.01, 0.002))}
    made: Data = {"bodies": bodies, "boundary_conditions": supports, "obstacles": obstacles, "contacts": contacts,
            "loads": [{"type": "gravity", "value": [0, -9.81]}],
            "initial": {"bodies": {"rod": {"velocity": [rng.uniform(-6, 6), rng.uniform(-6, 2)]}}},
            "solver": {"type": "dynamic", "t_end": 1.0, "estimate": False, **how}, "output": {"every": 1}}
    # drawn last, so that other scenes keep their numbers
    if not law and not friction and rng.random() < 0.4:
        made["solver"]["method"] = "radau5"
    return made


def _rod(rng: random.Random, start: Array, end: Array, mass: float, length: float, flexible: bool) -> Data:
    """Return a rod; a flexible one takes a few tenths of a second for its slowest vibration."""
    line = {"type": "line", "start": start.tolist(), "end": end.tolist()}
    if not flexible:
        return {"geometry": line, "element": {"type": "rigid", "mass": mass, "inertia": mass * length**2 / 12}}
    height = length * 10 ** rng.uniform(-2, -1.3)
    rho = mass / length
    # EI = rhoA L^4 (w/22.4)^2
    EI = rho * length**4 * (2 * math.pi * 10 ** rng.uniform(0.3, 1.3) / 22.4) ** 2
    section = {"EA": 12 * EI / height**2, "kGA": 4 * EI / height**2, "EI": EI, "rhoA": rho,
               "rhoI": rho * height**2 / 12}
    return {"geometry": line, "section": section,
            "element": {"type": rng.choice(("cable", "reissner2", "reissner3")), "count": rng.randint(2, 8)}}


def _obstacle(rng: random.Random, wheel: str, k: int, bodies: Data, supports: list[Data]) -> Data:
    """Return an obstacle that is fixed, rotates freely about its middle, or shakes."""
    x, y = rng.uniform(-1.2, 1.2), rng.uniform(0.2, 0.8)
    if rng.random() < 0.5:
        out: Data = {"type": "circle", "center": [x, y], "radius": rng.uniform(0.02, 0.3)}
    else:
        R, turn = rng.uniform(0.1, 0.35), rng.uniform(0, 2 * math.pi)
        corners = rng.randint(3, 6)
        out = {"type": "polyline", "closed": True,
               "points": [[x + R * math.cos(turn + 2 * math.pi * i / corners + rng.uniform(-0.3, 0.3)),
                           y + R * math.sin(turn + 2 * math.pi * i / corners)] for i in range(corners)]}
    how = rng.random()
    if how < 0.2:
        bodies[wheel] = {"geometry": {"type": "line", "start": [x - 0.05, y], "end": [x + 0.05, y]},
                         "element": {"type": "rigid", "mass": 1.0, "inertia": 0.01}}
        supports.append({"name": f"axle {k}", "type": "pin", "at": f"{wheel}@0.5"})
        out["on"] = wheel
    elif how < 0.4:
        out["motion"] = {rng.choice("xy"): {"type": "sine", "scale": 0.05, "frequency": rng.uniform(0.5, 3)}}
    return out


def pressed_scene(seed: int, number: int) -> Data:
    """Return a clamped beam that a force at its tip bends onto obstacles, or one between two supports, as a case."""
    rng = random.Random(f"pressed {seed} {number}")
    kind = rng.choice(("circle", "two circles", "half plane", "block", "arch"))
    side, gap = rng.choice(("axis", "surface")), rng.uniform(0.0, 0.05) if rng.random() < 0.7 else 1e-4
    height, width, E, x, R = 0.02, 0.05, 1e7, rng.uniform(0.2, 0.95), rng.uniform(0.05, 1.0)
    EI, gravity = E * width * height**3 / 12, rng.uniform(0.0, 1.0)
    y = -gap - (height / 2 if side == "surface" else 0.0)
    obstacles: Data = {"under": {"type": "half_plane", "through": [0, y - (0.02 if kind == "arch" else 0.0)],
                                 "normal": [0, 1]}}
    if "circle" in kind:
        obstacles["under"] = {"type": "circle", "center": [x, y - R], "radius": R}
    if kind == "two circles":
        obstacles["over"] = {"type": "circle", "center": [0.5 * x, 0.1 - y], "radius": 0.1}
    if kind == "block":
        obstacles["under"] = {"type": "polyline", "closed": True, "points": [
            [1.5, y - 0.3], [x + 0.1, y], [x - 0.1, y], [x - 0.15, y - 0.5], [1.4, y - 0.8]]}
    holds: list[Data] = [{"name": "wall", "type": "clamp", "at": "beam@0"}]
    if kind == "arch":
        holds = [{"type": "pin", "at": "beam@0"}, {"type": "roller", "at": "beam@1", "fixed": "y"}]
    force = {"type": "force", "at": "beam@0.5" if kind == "arch" else "beam@1",
             "value": [10 * EI * rng.uniform(-0.3, 0.3), -3 * EI * rng.uniform(0.2, 1.5)]}
    element = {"type": rng.choice(("cable", "reissner2", "reissner3", "vallejo")), "count": rng.randint(4, 13)}
    beam = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": element,
            "section": {"height": height, "width": width}, "material": {"E": E, "nu": 0.3, "rho": 100 * gravity}}
    made: Data = json.loads(json.dumps({
        "bodies": {"beam": beam}, "boundary_conditions": holds, "obstacles": obstacles,
        "loads": [force, {"type": "gravity", "value": [0, -9.81]}], "solver": {"type": "static", "steps": 5},
        "contacts": [{"between": ["beam", name], "side": side} for name in obstacles]}))
    return made


# ---------------------------------------------------------------------- judged


def pressed(seed: int, number: int, stiffness: float | None = None, **solver: Any) -> list[str]:
    """Return the violations of the equilibrium of a pressed beam, on layers if these have a stiffness."""
    case = pressed_scene(seed, number)
    case["solver"] = {"type": "static", **(solver or {"steps": 5})}
    for contact in case["contacts"] if stiffness else ():
        contact["law"] = {"stiffness": stiffness}
    try:
        solution = ancf2d.solve(case)
    except Ancf2dError as error:
        return [" ".join(str(error).split())]
    section, load = case["bodies"]["beam"], np.array(case["loads"][0]["value"])
    load[1] -= 9.81 * section["material"]["rho"] * section["section"]["height"] * section["section"]["width"]
    held = np.array([[r["fx"], r["fy"]] for r in solution.reactions.values()])
    out = [] if np.abs(held.sum(axis=0) + load).max() <= BALANCE * np.abs(held).max() else ["forces are not in balance"]
    for pair in solution.model.contacts:
        S = sorted({float(s) for s, spot in zip(pair.s, pair.spots, strict=True) if not spot.free})
        obstacle, X = case["obstacles"][pair.other], _places(solution, "beam", S)
        gaps = distance(obstacle, X)
        if pair.item.side == "axis" and not stiffness and gaps[-1].min() < -DEPTH * solution.model.extent:
            out.append(f"{-gaps[-1].min():.1e} deep in {pair.other}")
        passage = _passage(obstacle, X, gaps, np.ones(len(X) - 1, dtype=bool))
        if passage > SLID * solution.model.extent:
            out.append(f"passes {passage:.1e} deep through {pair.other}")
    return out


def judged(seed: int, number: int, case: Data | None = None) -> Verdict:
    """Return the outcome of a scene."""
    case = scene(seed, number) if case is None else case
    out = Verdict(number, _kind(case))
    try:
        solution = ancf2d.solve(case)
    except Ancf2dError as error:
        out.failure = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return out
    out.warnings = solution.warnings
    size, steps = solution.model.extent, solution.results.history["t"]
    # where a step was made again in parts, points went around corners between
    whole = np.diff(np.searchsorted(steps, solution.t + 1e-9 * solution.t[-1])) == 1
    # steps in which nothing may touch what moves by a signal, by how far it is at both ends
    alone = whole.copy()
    for pair in solution.model.contacts:
        obstacle = case["obstacles"][pair.name.removeprefix("on ")]
        # Gauss points of layers, and free points that stand elsewhere in every state, are no places of their own
        S = sorted({float(s) for s, spot in zip(pair.s, pair.spots, strict=True) if not spot.free})
        X = _places(solution, pair.body, S)
        for k, t in enumerate(solution.t):
            X[k] = _seen(X[k], pair.frame.origin, pair.frame.pose(solution.d[k], float(t)))
        gaps = distance(obstacle, X)
        if pair.item.law is None and pair.item.side == "axis":
            out.depth = max(out.depth, -float(gaps.min()) / size)
        out.passage = max(out.passage, _passage(obstacle, X, gaps, whole) / size)
        if "motion" in obstacle:
            way = np.hypot(*np.moveaxis(np.diff(X, axis=0), -1, 0)).max(axis=1)
            near = np.minimum(gaps[:-1], gaps[1:]).min(axis=1) - way - _reach(case["bodies"]["rod"], S)
            alone &= near > 0.0
    energies = solution.energies
    free = energies["kinetic"] + energies["strain"] + energies["potential"] - energies["work"]
    most = float(np.ptp(energies["potential"]) + (energies["kinetic"] + energies["strain"]).max())
    balance = free + energies["dissipated"]
    out.gain = max(0.0, float((free - free[0]).max()), float((balance - balance[0]).max())) / most
    out.given = float(np.abs(np.diff(energies["work"])[alone]).max(initial=0.0)) / most
    return out


def _reach(rod: Data, S: list[float]) -> float:
    """Return the largest distance from a point of a rod to its nearest contact point: half a height, half a spacing."""
    start, end = (np.array(rod["geometry"][k]) for k in ("start", "end"))
    section = rod.get("section", {"EI": 0.0, "EA": 1.0})
    return float(np.sqrt(3.0 * section["EI"] / section["EA"]) + max(np.diff(S)) * np.hypot(*(end - start)))


def _kind(case: Data) -> str:
    """Return the kind of a scene."""
    contact, solver = case["contacts"][0], case["solver"]
    hold = "law" if "law" in contact else f"restitution {contact['restitution']:.2g}"
    step = f"dt {solver['dt']:g}" if "dt" in solver else f"tolerance {solver['tolerance']:g}"
    return (f"{case['bodies']['rod']['element']['type']}, {hold}, friction {contact['friction']:g}, {contact['side']}, "
            f"{solver.get('method', 'generalized_alpha')}, {step}")


def _places(solution: Any, body: str, S: list[float]) -> Array:
    """Return the positions of points of the axis of a body in every state (states, points, 2)."""
    mesh, e = solution.model.meshes[body], solution.e
    out = np.zeros((len(e), len(S), 2))
    for i, s in enumerate(S):
        for axis, (coords, weights) in enumerate(point_ref(mesh, s).position()):
            out[:, i, axis] = e[:, coords] @ weights
    return out


def _seen(X: Array, origin: tuple[float, float], pose: tuple[float, float, float]) -> Array:
    """Return points in the frame of a moved obstacle."""
    x, y, angle = pose
    c, s = math.cos(angle), math.sin(angle)
    moved = X - np.array(origin) - np.array([x, y])
    turned: Array = moved @ np.array([[c, -s], [s, c]]) + np.array(origin)
    return turned


def distance(obstacle: Data, X: Array) -> Array:
    """Return the distance of points (..., 2) from an obstacle, negative inside."""
    if obstacle["type"] == "half_plane":
        n = np.array(obstacle["normal"], dtype=float)
        found: Array = (X - np.array(obstacle["through"])) @ (n / np.hypot(*n))
        return found
    if obstacle["type"] == "circle":
        return np.asarray(np.hypot(*np.moveaxis(X - np.array(obstacle["center"]), -1, 0)) - obstacle["radius"])
    points = np.array(obstacle["points"], dtype=float)
    best, crossings = np.full(X.shape[:-1], np.inf), np.zeros(X.shape[:-1], dtype=int)
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        way = b - a
        s = np.clip((X - a) @ way / (way @ way), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*np.moveaxis(X - a - s[..., None] * way, -1, 0)))
        above = (a[1] > X[..., 1]) != (b[1] > X[..., 1])
        # by even and odd crossings of a ray along x
        crossings += above & (X[..., 0] < a[0] + (X[..., 1] - a[1]) * way[0] / (way[1] if way[1] != 0.0 else 1.0))
    return np.where(crossings % 2 == 1, -best, best)


def _passage(obstacle: Data, X: Array, gaps: Array, whole: npt.NDArray[np.bool_]) -> float:
    """Return the largest depth of straight steps of points through an obstacle whose ends are outside.

    ``whole`` (states - 1,): which of the ways are of one step.
    """
    way = np.diff(X, axis=0)
    far = np.hypot(way[..., 0], way[..., 1]) > gaps[:-1] + gaps[1:]
    asked = far & (gaps[:-1] > 0.0) & (gaps[1:] > 0.0) & whole[:, None]
    if not asked.any():
        return 0.0
    s = np.linspace(0.0, 1.0, SAMPLES)[:, None, None]
    return max(0.0, -float(distance(obstacle, X[:-1][asked] + s * way[asked]).min()))


# ---------------------------------------------------------------------- told


def report(rows: Iterable[Data]) -> str:
    """Return the table of outcomes of scenes (verdicts as data)."""
    kinds: dict[str, list[Verdict]] = {}
    for v in (Verdict(**row) for row in rows):
        kinds.setdefault(v.kind.split(", ")[1].split(" ")[0] + ", " + v.kind.rsplit(", ", 1)[1], []).append(v)
    rows = []
    for kind, found in sorted(kinds.items()):
        done = [v for v in found if not v.failure]
        hard = [v.depth for v in done if "law" not in kind]
        bad = [sum(getattr(v, what) > most for v in done)
               for what, most in (("depth", DEPTH), ("passage", PASSAGE), ("gain", GAIN), ("given", GIVEN))]
        rows.append([kind.replace("restitution", "no law"), len(found), len(found) - len(done),
                     f"{max(hard):.0e}" if hard else "", *bad])
    return table(["contact, steps", "scenes", "not computed", "deepest", "too deep", "passed through",
                  "energy from nothing", "work of what nothing touches"], rows)
