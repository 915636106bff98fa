"""Random motions of beams: error estimates from a finer run, compared with far finer meshes and steps."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import ancf2d
from ancf2d.errors import Ancf2dError
from ancf2d.study.accuracy.direct import Direct
from ancf2d.study.accuracy.pursuit import Pursuit
from ancf2d.study.accuracy.setting import with_setting
from ancf2d.study.accuracy.steps import Motion
from ancf2d.study.goal import solve_for_goal
from ancf2d.study.record import Progress

from .two_meshes import KNOWN, ROUND_OFF, TYPES, Judged

MATERIALS = [{"E": 1e7, "nu": 0.3, "rho": 1000}, {"E": 7e10, "nu": 0.3, "rho": 2700}]
GOALS: list[dict[str, Any]] = [
    *({"probe": name, "quantity": q} for name, q in (("tip", "uy"), ("tip", "ux"), ("mid", "uy"), ("tip", "theta"),
                                                     ("tip", "y"), ("tip", "vy"), ("mid", "M"))),
    {"quantity": "strain_energy"}]
WANTED = (1e-1, 3e-2, 1e-2, 1e-3, 1e-4)
# shares of the wanted error: tolerances of the far finer runs; elements of a mesh for which these would take too long
TIGHT, TIGHTER, MANY = 1e-2, 1e-3, 60


def scene(rng: random.Random) -> dict[str, Any]:
    """Return a case of a beam that swings, is struck, shaken, rotated or flies, for up to two periods."""
    L, height, material = rng.choice([1.0, 2.0]), rng.choice([0.02, 0.05, 0.1, 0.2]), rng.choice(MATERIALS)
    EI, mass = material["E"] * 0.1 * height**3 / 12.0, material["rho"] * 0.1 * height
    period = 2.0 * math.pi * L**2 / 3.516 * math.sqrt(mass / EI)
    size, kind = EI * rng.choice([0.01, 0.1, 0.5]) / L**2, rng.choice(["swings", "struck", "shaken", "turned", "flies"])
    wave = {"amplitude": {"type": "sine", "frequency": rng.choice([0.3, 1.0, 2.0]) / period}}
    force = {"type": "force", "at": f"beam@{rng.choice([1, 0.6])}", "value": [0.3 * size, -size]}
    loads: dict[str, list[dict[str, Any]]] = {
        "swings": [{"type": "gravity", "value": [0, -9.81]}], "struck": [force], "flies": [{**force, **wave}],
        "shaken": [{"type": "distributed", "on": "beam", "value": [0, -size / L], **wave}],
        "turned": [{"type": "moment", "at": "beam@0", "value": 0.5 * size * L, **wave}]}
    held = {"swings": "pin", "turned": "pin", "flies": ""}.get(kind, "clamp")
    t_end = float(f"{rng.choice([0.3, 1.0, 2.0]) * (period if kind != 'swings' else 0.5):.3g}")
    return {"bodies": {"beam": {
        "geometry": {"type": "line", "start": [0, 0], "end": [L, 0]}, "section": {"height": height, "width": 0.1},
        "material": material, "element": {**rng.choice(TYPES), "count": 2}}},
        "boundary_conditions": [{"type": held, "at": "beam@0"}] if held else [], "loads": loads[kind],
        "goal": rng.choice(GOALS), "solver": {"type": "dynamic", "t_end": t_end},
        "output": {"interval": t_end / rng.choice([10, 25]), "probes": {"tip": "beam@1", "mid": "beam@0.5"}}}


def judged(seed: int, number: int) -> Judged | None:
    """Return the verdict on the first run of a scene, or None without a solution or a known limit."""
    rng = random.Random(f"{seed} {number}")
    case, wanted = ancf2d.load(scene(rng)), rng.choice(WANTED)
    pursuit = Pursuit(case, wanted, Progress())
    counts = Direct(pursuit, {}, wanted).first().counts
    if sum(counts.values()) > MANY:
        return None
    level, verdict = Motion(pursuit, {}, counts, wanted).verified(wanted)
    if level.answer is None or verdict is None:
        return None
    try:
        coarse, fine, loose = (solve_for_goal(with_setting(case, replace(
            level.setting, counts={name: size * n for name, n in level.setting.counts.items()},
            tolerance=share * wanted))).answer for size, share in ((2, TIGHTER), (4, TIGHTER), (4, TIGHT)))
    except Ancf2dError:
        return None
    truth = level.answer.distance(fine) / fine.size
    # for order 1, the limit is as far from the finest mesh as that from the one before
    unknown = (fine.distance(coarse) + fine.distance(loose)) / fine.size
    return None if unknown > max(KNOWN * wanted, 0.5 * truth) else Judged(wanted, truth, verdict.error, None)


def report(rows: Iterable[dict[str, Any]]) -> str:
    """Return the outcome of scenes (``Judged`` as data) in words."""
    found = [Judged(**row) for row in rows]
    accepted = [v for v in found if v.two is not None and v.two <= v.wanted]
    below = [v for v in accepted if v.two is not None and v.two < v.truth > ROUND_OFF]
    far = sum(v.two > 5.0 * v.truth > 5.0 * ROUND_OFF for v in accepted if v.two is not None)
    return (f"{len(accepted)} of {len(found)} accepted, {sum(v.accepts_too_much(v.two) for v in found)} of them above "
            f"the wanted error; estimates: {len(below)} below the true error, of these "
            f"{sum(v.truth > KNOWN * v.wanted for v in below)} with a true error above a tenth of the wanted one, "
            f"{far} above five times it")
