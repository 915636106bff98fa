"""Small cases that together need every kernel; solving them fills the cache."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..case import TEMPLATES, Goal, LoadedCase, load_case_text, template
from ..elements.formulations import FORMULATIONS
from ..elements.registry import ELEMENTS
from ..kernels.lowlevel.jit import CACHE, REFUSED
from ..solvers.motion.integrators import INTEGRATORS
from .expressions import GoalValues
from .gradient import gradient
from .run import run_case, vocabulary
from .warmup import seldom_collected

STIFF = {"E": 1e10, "nu": 0.3, "rho": 1000.0}
DAMPED = {**STIFF, "damping": {"kelvin_voigt": 1e-4}}
SECTION = {"height": 0.05, "width": 0.05}
MOMENT: dict[str, Any] = {"type": "dynamic", "t_end": 1e-4, "tolerance": 1e-2, "estimate": False}
# one step: with a tolerance, motions with contact would start with very short ones
STEP = {"type": "dynamic", "t_end": MOMENT["t_end"], "dt": MOMENT["t_end"]}
FEW = {"interval": MOMENT["t_end"]}
STATIC = {"type": "static", "steps": 1}
GRAVITY = {"type": "gravity", "value": [0, -9.81]}
# one integrator of each family; the others have the same kernels
METHODS = ("radau5", "generalized_alpha", "energy_momentum", "Radau")
# motions differentiated with respect to numbers of an element and of a law; kernels of other integrators are the same
PROBE = "tip"
DIFFERENTIATED = {"radau5 with springs and joints": ("bodies.a.material.E", "springs.0.stiffness")}
SIDE = 6  # storeys and columns of a frame for which a matrix in fronts is cheaper than a band
LAW = {"stiffness": 1e6, "damping": 1.0}
# materials with memory or large strains; their kernels serve any number of fibres and of terms
MEMORY: dict[str, dict[str, Any]] = {
    "yields": {"yield": 1e8}, "relaxes": {"viscoelastic": [{"modulus": 0.5, "time": 1.0}]},
    "stretches like rubber": {"law": "neo_hooke"}}


def compile_everything(done: Callable[[float, str], None] = lambda share, what: None,
                       wanted: Callable[[str], bool] = lambda name: True) -> tuple[int, Path | None, str]:
    """Solve a case of every kind, or of those whose names are ``wanted``, and store all results possible.

    Returns the number of cases and the folder of the kernel cache, or None and why it cannot be used. ``done`` is
    called with the share of cases done and the name of the next one. Raises the errors of the solvers.
    """
    known, cases = vocabulary(), [case for case in cases_of_every_kind() if wanted(case[0])]
    # the many objects of compiled kernels would be looked through for garbage in each run, too
    with TemporaryDirectory() as folder, seldom_collected():
        for k, (name, text, changes) in enumerate(cases):
            done(k / len(cases), name)
            loaded = load_case_text(text, name, changes, vocabulary=known)
            outcome = run_case(loaded, str(Path(folder, "out.h5")), force=True)
            if outcome.failure is not None:
                raise outcome.failure
            if name in DIFFERENTIATED:
                _differentiate(loaded, DIFFERENTIATED[name])
    return len(cases), CACHE, REFUSED


def _differentiate(loaded: LoadedCase, paths: tuple[str, ...]) -> None:
    """Differentiate a motion by the numbers at ``paths``: backwards for a goal, and forwards for its last state."""
    gradient(loaded, GoalValues((Goal(probe=PROBE, quantity="uy"),)), paths)
    gradient(loaded, lambda model, states: np.array(states[-1].d), paths)


def cases_of_every_kind() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield names, texts and changes of cases that cover every solver, kind of matrix, interaction and integrator.

    The templates cover contact, controllers, and materials with memory.
    """
    for name, case in _small_cases():
        yield name, json.dumps(case), ()
    for kind in TEMPLATES:
        text = template(kind, kind)
        yield f"template {kind}", text, ("solver.t_end=0.02",) if "t_end" in text else ()


def _small_cases() -> Iterator[tuple[str, dict[str, Any]]]:
    laws, interactions, frame = _laws(), _interactions(), _frame()
    for solver in ({"type": "linear_static"}, STATIC, {"type": "eigen", "modes": 2}, {"type": "buckling", "modes": 1}):
        yield str(solver["type"]), {**laws, "solver": solver}
    yield "statics with springs and joints", {**interactions, "solver": STATIC, "output": {"fields": ["N", "Q", "M"]}}
    yield "statics with springs and joints under dead loads", {**interactions, "solver": STATIC, "loads": [GRAVITY]}
    yield "statics of a frame", {**frame, "solver": STATIC}
    yield "modes of a frame", {**frame, "solver": {"type": "eigen", "modes": 2}}
    follower = [{"type": "follower_force", "at": "c0_0@1", "value": [1.0, 0.0]}]
    yield "statics of a frame under a follower force", {**frame, "solver": STATIC, "loads": follower}
    yield "flutter", {**_column(), "solver": {"type": "buckling", "modes": 1}}
    yield "flutter of a pipe", {**_column(), "fluid": {"on": "column", "rhoA": 0.2, "velocity": 1.0},
                                "solver": {"type": "buckling", "modes": 1}, "loads": []}
    bodies, rough = _contact_of_bodies(), {"between": ["a", "c"], "friction": 0.1}
    impacts: dict[str, Any] = {"solver": {**STEP, "method": "generalized_alpha"}, "output": FEW}
    yield "statics of contact between bodies", {**bodies, "contacts": [*bodies["contacts"], rough], "solver": STATIC}
    yield "generalized_alpha of contact between bodies", {**bodies, **impacts, "contacts": [*bodies["contacts"], rough]}
    yield "generalized_alpha of contact with obstacles", {**_contact_with_obstacles(), **impacts}
    # integrators call these kernels by address, so one integrator suffices; they are many, for
    # other processors to compile beside the steps of this one
    yield "radau5 with controllers, events and moving points", {
        **_feedback(), "solver": {**MOMENT, "method": "radau5"}, "output": {**FEW, "probes": {PROBE: "b@1"}}}
    # the same contacts with the steps of another method
    yield "radau5 of contact with obstacles", {**_contact_with_obstacles(), **impacts,
                                               "solver": {**STEP, "method": "radau5"}}
    yield from _memories()
    for name in METHODS:
        motion, conserved = {"solver": {**MOMENT, "method": name}, "output": FEW}, INTEGRATORS[name].conserves
        yield name, {**_laws(conserved), **motion}
        probed = {**motion, "output": {**FEW, "probes": {PROBE: "b@1"}}}
        yield f"{name} with springs and joints", {**_interactions(), **probed}
        if INTEGRATORS[name].scipy is None:
            yield f"{name} with releases", {**_let_go(), **probed}
            yield f"{name} of a frame", {**_frame(conserved), **motion}


def _body(start: list[float], end: list[float], element: dict[str, Any], material: dict[str, Any]) -> dict[str, Any]:
    return {"geometry": {"type": "line", "start": start, "end": end}, "section": SECTION, "material": material,
            "element": {"count": 2, **element}}


def _laws(conserved: bool = False) -> dict[str, Any]:
    """Return a case with a body of every formulation, or only of those that can conserve energy."""
    bodies = {}
    for k, (name, formulation) in enumerate(FORMULATIONS.items()):
        if formulation.law.mean is not None or not conserved:
            element = next(t for t in ELEMENTS.values() if formulation.refuse(t) is None)
            bodies[name] = _body([0.0, k], [1.0, k], {"type": element.name, "formulation": name}, DAMPED)
    return {"format": 1, "title": "formulations", "bodies": bodies,
            "boundary_conditions": [{"type": "clamp", "at": f"{name}@0"} for name in bodies],
            "loads": [GRAVITY, *({"type": "force", "at": f"{name}@1", "value": [-1.0, 0.1]} for name in bodies)]}


def _column() -> dict[str, Any]:
    """Return a clamped column under a follower force, whose matrices are not symmetric."""
    column = _body([0, 0], [1, 0], {"type": "cable", "count": 4}, STIFF)
    column |= {"section": {"EA": 1e6, "EI": 1.0, "rhoA": 1.0}, "material": {}}
    return {"format": 1, "title": "column", "bodies": {"column": column},
            "boundary_conditions": [{"type": "clamp", "at": "column@0"}],
            "loads": [{"type": "follower_force", "at": "column@1", "value": [-1, 0]}]}


def _interactions() -> dict[str, Any]:
    """Return a case with every law of points, and a prismatic joint."""
    slope = {"type": "cable"}
    bodies = {"a": _body([0, 0], [1, 0], slope, STIFF), "b": _body([1, 0], [2, 0], slope, STIFF),
              "rider": _body([0.5, 0], [0.5, -0.4], slope, STIFF), "arm": _body([0, 1], [1, 1], slope, STIFF)}
    bodies["link"] = _body([2, 0], [3, 0], {"type": "rigid"}, STIFF)
    del bodies["link"]["element"]["count"]
    return {"format": 1, "title": "interactions", "bodies": bodies,
            "boundary_conditions": [
                {"type": "clamp", "at": "a@0"}, {"type": "pin", "at": "arm@0"},
                {"type": "prescribed", "at": "arm@0", "angle": {"type": "sine", "scale": 1e-3, "frequency": 1.0}}],
            "joints": [{"type": "weld", "between": ["a@1", "b@0"]}, {"type": "pin", "between": ["b@1", "link@0"]},
                       {"type": "prismatic", "point": "rider@0", "on": "a"}],
            "springs": [{"type": "translational", "between": ["link@1", [3, 1]], "stiffness": 10.0, "damping": 0.1},
                        {"type": "translational", "between": ["link@1", [4, 0]], "stiffness": 10.0},
                        {"type": "translational", "between": ["rider@0", [0, -1]], "stiffness": 10.0},
                        {"type": "rotational", "between": ["a@0.5", "rider@0"], "stiffness": 1.0, "damping": 0.1},
                        {"type": "rotational", "between": ["arm@1", [0, 0]], "stiffness": 1.0}],
            "loads": [{"type": "follower_force", "at": "b@0.5", "value": [0.0, 0.01]},
                      {"type": "tendon", "on": "a", "y": 0.01, "tension": 0.01},
                      {"type": "moment", "at": "arm@1", "value": 0.01}]}


def _contact_with_obstacles(material: dict[str, Any] = STIFF) -> dict[str, Any]:
    """Return a case of contact with obstacles, with and without a law; nothing needs to touch at the start."""
    bodies = {name: _body([0, k], [1, k], {"type": "cable"}, material) for k, name in enumerate(("hard", "soft"))}
    return {"format": 1, "title": "obstacles", "bodies": bodies, "loads": [GRAVITY],
            "boundary_conditions": [{"type": "clamp", "at": f"{name}@0"} for name in bodies],
            "obstacles": {"drum": {"type": "circle", "center": [1, -0.13], "radius": 0.1},
                          "floor": {"type": "half_plane", "through": [0, 0.97], "normal": [0, 1]}},
            "contacts": [{"between": ["hard", "drum"]}, {"between": ["soft", "floor"], "friction": 0.1, "law": LAW}]}


def _contact_of_bodies() -> dict[str, Any]:
    """Return a case of contact between bodies, with and without a law; nothing needs to touch at the start."""
    bodies = {name: _body([0, y], [1, y], {"type": "cable"}, STIFF)
              for name, y in (("a", 0.0), ("b", 0.06), ("c", 0.12))}
    return {"format": 1, "title": "bodies that touch", "bodies": bodies, "loads": [GRAVITY],
            "boundary_conditions": [{"type": "clamp", "at": f"{name}@0"} for name in bodies],
            "contacts": [{"between": ["b", "a"], "law": LAW}, {"between": ["c", "b"]}]}


def _feedback() -> dict[str, Any]:
    """Return a case with controllers, formulas, events, and a force and a mass that move along a body."""
    bodies = {name: _body([0, k], [1, k], {"type": "reissner3"}, STIFF) for k, name in enumerate(("a", "b"))}
    place = {"type": "expression", "value": "0.99 + 200*t"}  # the point leaves the body halfway through the motion
    return {"format": 1, "title": "feedback", "bodies": bodies,
            "boundary_conditions": [{"type": "clamp", "at": "a@0"}, {"type": "pin", "at": "b@0"},
                                    {"type": "roller", "at": "a@1", "fixed": "y", "active": {"after": "tip.y > 9"}}],
            "springs": [{"type": "rotational", "between": [[0, 1], "b@0"], "force": "2*sin(u) + 0.1*v"},
                        {"type": "translational", "between": ["b@1", [2, 1]], "force": "20*u + 30*u^3"}],
            "controllers": {"motor": {"type": "pid", "input": "1 - tip.theta", "kp": 3, "ki": 1, "kd": 0.1,
                                      "filter": 1e-3, "limit": [-5, 5]},
                            "lead": {"type": "state", "rate": {"z": "1 - tip.theta - z"}, "output": "z"}},
            "masses": [{"at": {"on": "a", "s": place}, "mass": 0.1}],
            "loads": [{"type": "moment", "at": "b@0", "value": 1,
                       "amplitude": {"type": "expression", "value": "motor + lead"}},
                      {"type": "distributed", "on": "b", "value": ["-0.1*vx", "-0.1*vy"]},
                      {"type": "force", "at": "a@1", "value": [0, 1], "active": {"until": "tip.y > 9"}},
                      {"type": "force", "at": {"on": "a", "s": place}, "value": [0, -1]}]}


def _let_go() -> dict[str, Any]:
    """Return a case with supports and a weld that end in a motion, unilateral springs, tendons and contact layers."""
    bodies = {name: _body([0, k], [1, k], {"type": kind}, DAMPED)
              for k, (name, kind) in enumerate([("a", "vallejo"), ("b", "cable"), ("c", "cable")])}
    bodies["d"] = _body([1, 2], [2, 2], {"type": "vallejo"}, DAMPED)
    ends = {"active": {"until": f"{PROBE}.uy > 9"}}
    angle = {"type": "sine", "scale": 1e-3, "frequency": 1.0}
    return {"format": 1, "title": "let go", "bodies": bodies,
            "boundary_conditions": [{"type": "clamp", "at": "a@0", "hold": "section", **ends},
                                    {"type": "clamp", "at": "a@1", "hold": "breathe", **ends},
                                    {"type": "pin", "at": "b@0", **ends}, {"type": "clamp", "at": "c@0"},
                                    {"type": "prescribed", "at": "b@0", "angle": angle, **ends}],
            "joints": [{"type": "weld", "between": ["c@1", "d@0"], **ends}],
            "springs": [{"type": "translational", "between": ["b@1", [2, 1]], "stiffness": 1.0, "only": "tension"},
                        {"type": "rotational", "between": ["b@1", [0, 0]], "stiffness": 1.0, "gap": 0.1}],
            "obstacles": {"floor": {"type": "half_plane", "through": [0, 1.97], "normal": [0, 1]}},
            "contacts": [{"between": ["c", "floor"], "friction": 0.1, "law": LAW}],
            "loads": [{"type": "follower_force", "at": "b@1", "value": [0, 0.1]},
                      {"type": "tendon", "on": "b", "y": 0.01, "tension": 0.01},
                      {"type": "tendon", "through": ["b@0.1", {"at": "b@0.5", "y": 0.01}], "stiffness": 1.0}]}


def _memories() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield cases for each formulation: statics with memory or large strains, then motions with memory."""
    for kind, keys in MEMORY.items():
        for name, formulation in FORMULATIONS.items():
            element = next(t for t in ELEMENTS.values() if formulation.refuse(t) is None)
            bears = {"yields": formulation.fibres is not None, "relaxes": True}.get(kind, name == "continuum")
            if not bears:
                continue
            body = _body([0, 0], [1, 0], {"type": element.name, "formulation": name}, {**STIFF, **keys})
            yield f"{name} that {kind}", {
                "format": 1, "title": kind, "bodies": {"a": body}, "loads": [GRAVITY],
                "boundary_conditions": [{"type": "clamp", "at": "a@0"}],
                "solver": {"type": "quasi_static", "t_end": 1.0} if kind == "relaxes" else STATIC}
    remembers = _contact_with_obstacles({**STIFF, **MEMORY["relaxes"]})
    for method in ("radau5", "generalized_alpha"):
        free = {key: value for key, value in remembers.items() if key not in ("obstacles", "contacts")}
        for what, case in (("motion", free), ("contact", remembers)):
            yield f"{method} of {what} that relaxes", {
                **case, "solver": {**STEP, "method": method}, "output": {"interval": 0.5 * STEP["t_end"]}}


def _frame(conserved: bool = False) -> dict[str, Any]:
    """Return a frame of many bodies, with a spring and a prismatic joint."""
    bodies, joints = {}, []
    element = {"type": "cable" if conserved else "reissner3"}
    for s in range(SIDE):
        for i in range(SIDE):
            bodies[f"c{s}_{i}"] = _body([i, s], [i, s + 1], element, DAMPED)
            joints += [{"type": "weld", "between": [f"c{s - 1}_{i}@1", f"c{s}_{i}@0"]}] if s else []
        for i in range(SIDE - 1):
            bodies[f"b{s}_{i}"] = _body([i, s + 1], [i + 1, s + 1], element, DAMPED)
            joints += [{"type": "weld", "between": [f"c{s}_{i}@1", f"b{s}_{i}@0"]},
                       {"type": "weld", "between": [f"b{s}_{i}@1", f"c{s}_{i + 1}@1"]}]
    bodies["rider"] = _body([0.5, 1], [0.5, 0.6], element, DAMPED)
    joints.append({"type": "prismatic", "point": "rider@0", "on": "b0_0"})
    # springs hold the rider in place, so that one load step reaches equilibrium
    return {"format": 1, "title": "frame", "bodies": bodies, "joints": joints, "loads": [GRAVITY],
            "springs": [{"type": "translational", "between": ["rider@0", [0, -1]], "stiffness": 1e3, "damping": 0.1},
                        {"type": "rotational", "between": ["rider@0", "b0_0@0.5"], "stiffness": 1e3}],
            "boundary_conditions": [{"type": "clamp", "at": f"c0_{i}@0"} for i in range(SIDE)]}
