"""Steps of a motion allocate no memory: sixty of them allocate as often as thirty, in any scene."""

from __future__ import annotations

from typing import Any, get_args

import helpers as h
import pytest
from motions import GRAVITY, OWN, RUBBER, THIN, Ride, rigid, rod
from numba.core.runtime import _nrt_python, rtsys

from ancf2d.case import schema
from ancf2d.case.records import keys_of
from ancf2d.elements.formulations import FORMULATIONS

pytestmark = pytest.mark.slow

DT, FEW, MANY = 1e-3, 30, 60
SWAY = {"type": "expression", "value": "0.01*sin(20*t)"}
RISE = {"type": "ramp", "t0": 0, "t1": 0.01}
WAVE = {"type": "table", "t": [0, 0.01, 0.02], "value": [0, 1, 0.5], "smooth": True}
SCENES: dict[str, dict[str, Any]] = {
    "pendulum": {"bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY},
    "shaken, damped, with a rigid end": {
        "bodies": {"a": rod("vallejo", damping={"kelvin_voigt": 1e-3}),
                   "b": rigid([1, 0], [1.5, 0], 0.3, 0.02)},
        "bc": [{"type": "prescribed", "at": "a@0", "ux": SWAY, "uy": 0}],
        "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
        "springs": [{"type": "translational", "between": ["b@1", [1.5, 1.0]], "stiffness": 20.0, "damping": 0.5}],
        "loads": [*GRAVITY, {"type": "moment", "at": "a@1", "value": 0.1}]},
    "loaded in every way": {
        "bodies": {"a": rod("cable"), "b": rod("2d2n", start=(0, 1), end=(1, 1), alpha=1e-5),
                   "c": rod("vallejo", start=(0, 2), end=(1, 2))},
        "bc": [{"type": "clamp", "at": "a@0"}, {"type": "roller", "at": "a@1", "fixed": "y"},
               {"type": "fix", "at": "b@0", "coordinates": ["x", "y"]},
               {"type": "prescribed", "at": "c@0", "ux": SWAY, "uy": 0}],
        "damping": {"rayleigh": {"alpha": 0.1, "beta": 1e-4}},
        "springs": [{"type": "translational", "between": ["b@1", "c@1"], "stiffness": 20.0, "damping": 0.5},
                    {"type": "rotational", "between": ["a@0.5", "b@0.5"], "stiffness": 0.1, "damping": 1e-3}],
        "masses": [{"at": "a@0.5", "mass": 0.2, "inertia": 1e-3}],
        "loads": [{"type": "gravity", "value": [0, -9.81], "amplitude": {"type": "constant", "scale": 0.5}},
                  {"type": "force", "at": "b@1", "value": [0, 0.2], "amplitude": {"type": "sine", "frequency": 3}},
                  {"type": "follower_force", "at": "c@1", "value": [0.1, 0.2], "amplitude": RISE},
                  {"type": "moment", "at": "a@0.5", "value": 0.1, "amplitude": WAVE},
                  {"type": "distributed", "on": "b", "value": [0, -1], "follower": True},
                  {"type": "torque", "between": ["b@1", "c@1"], "value": 0.1},
                  {"type": "eigenstrain", "on": "c", "axial": 1e-4, "amplitude": WAVE},
                  {"type": "temperature", "on": "b", "value": 10, "amplitude": RISE},
                  {"type": "tendon", "on": "a", "y": 0.01, "tension": 0.1},
                  {"type": "tendon", "through": ["b@0", "c@1", [2, 2]], "stiffness": 10}]},
    "joined in every way": {
        "bodies": {"rail": rod("cable", 3, (0, 0), (2, 0)), "bead": rigid([0.55, 0], [0.65, 0], 0.3, 0.01),
                   "arm": rod("vallejo", 2, (2, 0), (2, 1)), "end": rigid([2, 1], [2, 1.5], 0.2, 0.01)},
        "bc": [{"type": "pin", "at": "rail@0"}, {"type": "roller", "at": "arm@0.5", "normal": [2, 1]}],
        "loads": GRAVITY,
        "joints": [{"type": "prismatic", "point": "bead@0.5", "on": "rail"},
                   {"type": "weld", "between": ["rail@1", "arm@0"]},
                   {"type": "pin", "between": ["arm@1", "end@0"]},
                   {"type": "slider", "at": "end@1", "through": [2, 1.5], "along": [1, 3]}]},
    "answering": {
        "bodies": {"a": rod("vallejo")}, "bc": [{"type": "pin", "at": "a@0"}], "output": {"probes": {"hub": "a@0"}},
        "controllers": {"motor": {"type": "pid", "input": "1 - hub.theta", "kp": 0.3, "ki": 0.1, "kd": 0.01,
                                  "filter": 2e-3, "limit": [-1, 1]},
                        "drag": {"type": "state", "rate": {"z": "hub.omega - z"}, "output": "-0.01*z"}},
        "loads": [*GRAVITY, {"type": "moment", "at": "a@0", "value": 1,
                             "amplitude": {"type": "expression", "value": "motor + drag"}}]},
    "with what begins and ends": {
        "bodies": {"a": rod("vallejo")}, "output": {"probes": {"tip": "a@1"}},
        "bc": [{"type": "pin", "at": "a@0"}, {"type": "pin", "at": "a@1", "active": {"until": "tip.vy < -10"}}],
        "springs": [{"type": "translational", "between": ["a@0.5", [0.5, 1]], "stiffness": 20.0,
                     "active": {"after": "tip.uy < -10"}}],
        "loads": [*GRAVITY, {"type": "force", "at": "a@0.5", "value": [0, -0.1], "active": {"until": "tip.x < 0"}}]}}


def falling(material: dict[str, Any]) -> dict[str, Any]:
    """Return a rod of a material that falls about a hinge."""
    return {"bodies": {"a": h.body(h.line(1.0), h.element("cable", 2), THIN, {**RUBBER, **material})},
            "bc": [{"type": "pin", "at": "a@0"}], "loads": GRAVITY}


def of_every_formulation(conserving: bool) -> dict[str, Any]:
    """Return a rod of every formulation side by side, or of those that conserve the energy of a step."""
    bodies = {}
    for k, (name, formulation) in enumerate(FORMULATIONS.items()):
        type_ = next(t for t, element in h.TYPES.items() if formulation.refuse(element) is None)
        if not conserving or formulation.law.mean is not None:
            bodies[name] = h.body(h.line(1.0, start=(0.0, k)), h.element(type_, 2, name), THIN, RUBBER)
    return {"bodies": bodies, "bc": [{"type": "pin", "at": f"{name}@0"} for name in bodies], "loads": GRAVITY}


SCENES |= {"of every formulation": of_every_formulation(False), "conserving": of_every_formulation(True),
           "yielding": falling({"yield": 1e4, "hardening": {"isotropic": 1e6}}),
           "relaxing": falling({"viscoelastic": [{"modulus": 0.5, "time": 0.1}]})}
# multipliers refuse what damps nothing
FREE = ("pendulum", "loaded in every way", "of every formulation", "answering", "yielding", "relaxing")
# answers and memories have no means over a step
NO_MEANS = ("of every formulation", "answering", "yielding", "relaxing")
PAIRS = [(s, m) for s in SCENES for m in OWN if not (m == "newmark" and s not in FREE)
         and (s != "conserving" or m == "energy_momentum") and not (m == "energy_momentum" and s in NO_MEANS)]


@pytest.fixture(autouse=True)
def _counted() -> Any:
    _nrt_python.memsys_enable_stats()
    yield
    _nrt_python.memsys_disable_stats()


def allocated(scene: dict[str, Any], method: str, steps: int) -> int:
    """Return the number of allocations of compiled code in so many steps, with one state stored."""
    ride = Ride(scene, steps * DT, method=method, dt=DT).start()
    # all in one call
    ride.stepper.steps = 2 * MANY
    before = rtsys.get_allocation_stats().alloc
    ride.on()
    assert len(ride.log) >= steps
    return int(rtsys.get_allocation_stats().alloc - before)


@pytest.mark.parametrize(("scene", "method"), PAIRS)
def test_steps_allocate_no_memory(scene: str, method: str) -> None:
    assert allocated(SCENES[scene], method, MANY) == allocated(SCENES[scene], method, FEW)


def types_in(part: Any) -> set[str]:
    """Return every ``type`` that a part of a case names."""
    if isinstance(part, list):
        return {kind for inside in part for kind in types_in(inside)}
    if not isinstance(part, dict):
        return set()
    here = {part["type"]} if "type" in part else set()
    return here.union(*map(types_in, part.values()))


def test_the_scenes_contain_every_kind_of_a_motion() -> None:
    tags = {kind.tag for kind in get_args(schema.Amplitude)}
    keys = keys_of(schema.Case)
    tags = tags.union(*(keys[k].kind.item.options for k in ("boundary_conditions", "joints", "springs", "loads")))
    assert not tags - set().union(*map(types_in, SCENES.values()))
    assert any(scene.get("masses") for scene in SCENES.values())
