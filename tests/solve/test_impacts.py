"""Stored impacts of a motion: times, positions, impulses, and energy lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.api.solving import load
from ancf2d.cli.report import motion_lines
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.motion.warnings import drift_warning
from ancf2d.study.run import prepare

G, M, J = 9.81, 2.0, 0.25


def rods(restitution: float, method: str, **solver: Any) -> dict[str, Any]:
    """Return a rod that falls by 0.5 m onto the floor with its left end, 0.4 m to the side of its centre."""
    solver = {"type": "dynamic", "method": method, "t_end": 0.35, **solver}
    return {
        "bodies": {"rod": {"geometry": {"type": "line", "start": [0.0, 0.5], "end": [0.8, 1.1]},
                           "element": {"type": "rigid", "mass": M, "inertia": J}}},
        "loads": [{"type": "gravity", "value": [0, -G]}],
        "obstacles": {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        "contacts": [{"name": "hit", "between": ["floor", "rod"], "side": "axis", "restitution": restitution}],
        "output": {"interval": 0.05, "probes": {"end": "rod@0"}}, "solver": solver}


@pytest.mark.parametrize(("method", "steps"), [
    ("generalized_alpha", {"tolerance": 1e-5}), ("radau5", {"tolerance": 1e-6}),
    ("generalized_alpha", {"dt": 1e-4, "estimate": False})], ids=["adaptive", "radau", "fixed"])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_the_impulse_of_a_rod_that_falls_on_its_end(restitution: float, method: str, steps: dict[str, Any]) -> None:
    """With m = 1/(1/M + r^2/J) at the end, r from the centre, it is (1 + e) m v and dissipates m v^2 (1 - e^2)/2."""
    told = ancf2d.solve(rods(restitution, method, **steps), states=False).summary["impacts"]
    v, m = math.sqrt(2.0 * G * 0.5), 1.0 / (1.0 / M + 0.4**2 / J)
    first = told["first"]
    rel = 1e-3 if "tolerance" in steps else 5e-3
    assert first["t"] == pytest.approx(v / G, rel=rel)
    assert first["impulse"] == pytest.approx((1.0 + restitution) * m * v, rel=rel)
    assert first["lost"] == pytest.approx(0.5 * m * v * v * (1.0 - restitution**2), rel=2.0 * rel)
    assert (first["contact"], first["body"], first["touched"], first["S"], first["points"]) == (
        "hit", "rod", "floor", 0.0, 1)
    assert told["count"] == 1
    assert told["lost"] == first["lost"]


def test_impacts_of_a_resumed_motion_are_those_of_an_uninterrupted_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each once, from any checkpoint; the energy they lose is all that is dissipated."""
    # every state ends a chunk, from which a run can go on
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    model = prepare(load(rods(0.5, "generalized_alpha", tolerance=1e-6, t_end=0.8, estimate=False)))
    states = list(Run(model, model.case.solver).states())
    whole = states[-1].tables["impacts"]
    assert len(whole["t"]) > 3
    assert sum(whole["lost"]) == pytest.approx(states[-1].history["dissipated"], rel=1e-3)
    kept = [s.checkpoint for s in states if s.checkpoint is not None]
    for checkpoint in (kept[0], kept[len(kept) // 2], kept[-1]):
        *_, end = Run(model, model.case.solver).states(checkpoint)
        assert end.tables["impacts"] == whole
        assert end.report["impacts"] == states[-1].report["impacts"]


def test_a_motion_without_collisions_has_no_impacts() -> None:
    assert "impacts" not in ancf2d.solve(rods(0.0, "generalized_alpha", tolerance=1e-4, t_end=0.2)).summary


def test_impacts_between_bodies_name_both() -> None:
    """Two equal bars of mass 2: a plastic impact takes half of the momentum as impulse, and half of the energy."""
    def bar(y: float) -> dict[str, Any]:
        return {"geometry": {"type": "line", "start": [0, y], "end": [1, y]},
                "section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e9, "nu": 0.3, "rho": 200.0},
                "element": {"type": "rigid"}}
    case = {"bodies": {"low": bar(0.0), "high": bar(0.2)}, "contacts": [{"between": ["low", "high"]}],
            "initial": {"bodies": {"high": {"velocity": [0, -1]}}},
            "solver": {"type": "dynamic", "t_end": 0.15, "tolerance": 1e-4}}
    solved = ancf2d.solve(case, states=False)
    first = solved.summary["impacts"]["strongest"]
    assert {first["body"], first["touched"]} == {"low", "high"}
    assert first["impulse"] == pytest.approx(1.0, rel=1e-6)
    assert first["lost"] == pytest.approx(0.5, rel=1e-6)
    assert first["t"] == pytest.approx(0.1, rel=1e-3)
    assert np.isfinite(first["S"])


def test_the_energy_lost_in_and_after_impacts_is_reported() -> None:
    summary = {"impacts": {"count": 2, "lost": 0.25, "strongest": {
        "t": 0.125, "body": "rod", "touched": "floor", "S": 0.5, "impulse": 3.0}}}
    (line,) = motion_lines(summary, ("m", "N", "s"))[-1:]
    assert line == "impacts   2 took 0.25 [N m], the strongest: rod on floor at 0.125 s, S = 0.5: 3 N s"
    assert not drift_warning(0.15, 0.02, True)
    (told,), (other,) = (drift_warning(0.15, 0.002, struck) for struck in (True, False))
    assert "impacts start vibrations" in told
    assert "impacts" not in other
