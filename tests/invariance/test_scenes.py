"""The generator of random scenes, their transformations and their reduction."""

from __future__ import annotations

import dataclasses
import math
import random
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
from instruments.scenes import campaign, checks, rearrange, shapes, shrink
from instruments.scenes.bodies import type_of
from instruments.scenes.generate import SOLVERS, scene
from instruments.scenes.similar import Similarity

import ancf2d
from ancf2d.case import schema
from ancf2d.case.records import keys_of
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS, names
from ancf2d.solvers.motion.integrators import INTEGRATORS
from ancf2d.study.run import prepare


@cache
def many() -> list[dict[str, Any]]:
    """Return 200 scenes for each solver."""
    return [scene(1, number, solver) for number in range(200) for solver in SOLVERS]


def tags(union: Any) -> set[str]:
    return {kind.tag for kind in get_args(union)}


def items(key: str) -> list[dict[str, Any]]:
    return [item for case in many() for item in case.get(key, ())]


def bodies() -> list[dict[str, Any]]:
    return [body for case in many() for body in case["bodies"].values()]


@pytest.mark.parametrize("key", ["boundary_conditions", "joints", "springs", "loads"])
def test_every_kind_of_support_joint_spring_and_load_is_made(key: str) -> None:
    assert {item["type"] for item in items(key)} == set(keys_of(schema.Case)[key].kind.item.options)


def test_one_sided_springs_and_stops_are_made_for_nonlinear_solvers() -> None:
    one_sided = [case["solver"]["type"] for case in many() for s in case.get("springs", ()) if {"only", "gap"} & set(s)]
    assert set(one_sided) == {"static", "dynamic"}


def test_loads_and_springs_begin_and_end_in_motions() -> None:
    """In other units of time their times change, too."""
    for key in ("loads", "springs"):
        switched = [(case, k) for case in many() for k, x in enumerate(case.get(key, ())) if "active" in x]
        assert {case["solver"]["type"] for case, _ in switched} == {"dynamic"}
        case, k = switched[0]
        moved = Similarity(time=2.0).case(case)[key][k]["active"]
        assert moved == {end: 2.0 * t for end, t in case[key][k]["active"].items()}


def test_every_kind_of_body_is_made() -> None:
    elements = [body["element"] for body in bodies()]
    assert {body["geometry"]["type"] for body in bodies()} == tags(schema.Geometry)
    assert {e["type"] for e in elements} == {*names(), "rigid"}
    assert {e["formulation"] for e in elements if "formulation" in e} == set(FORMULATIONS)
    sections = [frozenset(body["section"]) - {"rhoI"} for body in bodies() if "section" in body]
    known = {frozenset(f.name for f in dataclasses.fields(kind)) - {"rhoI"} for kind in get_args(schema.Section)}
    assert set(sections) == known


def test_every_amplitude_is_made() -> None:
    found = [x["amplitude"]["type"] for x in items("loads") if "amplitude" in x]
    assert set(found) == tags(schema.Amplitude)


# linear models of what eigen linearises, and equilibrium over time, which without memory is that of static: tests/solve
# compares them with closed forms and with direct solves
NOT_DRAWN = {"frequency_response", "state_space", "quasi_static"}


def test_every_solver_and_integrator_occurs() -> None:
    solvers = [case["solver"] for case in many()]
    assert {s["type"] for s in solvers} == tags(schema.Solver) - NOT_DRAWN
    assert {s.get("method", "radau5") for s in solvers if s["type"] == "dynamic"} == set(INTEGRATORS)
    assert {"masses", "initial", "damping", "steady_rotation"} <= {key for case in many() for key in case}


def test_a_scene_is_the_same_every_time() -> None:
    assert scene(3, 5) == scene(3, 5) != scene(3, 6)


def test_bodies_vary_along_and_close_and_tendons_are_elastic() -> None:
    loads = [x for case in many() for x in case.get("loads", ())]
    assert {type(x[key]) for x in loads for key in ("y", "curvature", "gradient") if key in x} == {float, dict}
    assert {"on" in x for x in loads if "slack" in x} == {True, False}
    assert {b["geometry"]["type"] for b in bodies() if b["geometry"].get("closed")} == {"path", "spline"}
    assert any(b["element"].get("nodes") == "regular" for b in bodies())


@pytest.mark.slow
def test_scenes_are_valid_or_refused_with_an_expected_reason() -> None:
    """Refusals without solving: mechanisms, contradictory supports, an unfit integrator."""
    refused = []
    for case in many()[:75]:
        try:
            prepare(ancf2d.load(case))
        except ancf2d.CaseError as error:
            refused.append(error.problems[0].message)
    assert 0 < len(refused) < 8
    known = ("no static solution", "contradicts other supports", "solver.method")
    assert [m for m in refused if not any(words in m for words in known)] == []


# ---------------------------------------------------------------------- transformations


@pytest.mark.parametrize("to", [Similarity(angle=0.7), Similarity(mirrored=True), Similarity(shift=(3.0, -2.0)),
                                Similarity(length=1e3, force=1e-2, time=60.0)], ids=lambda s: f"{s}")
def test_a_transformation_moves_the_points_of_a_scene(to: Similarity) -> None:
    for case in many()[:50]:
        moved = to.case(case)
        for name, body in case["bodies"].items():
            for s in (0.0, 0.3, 1.0):
                there = shapes.position(moved["bodies"][name]["geometry"], s)
                here = to.place(shapes.position(body["geometry"], s))
                assert there == pytest.approx(here, rel=1e-9, abs=1e-9 * to.length * shapes.extent(case))


def test_a_transformation_and_its_inverse_restore_a_scene() -> None:
    there, back = Similarity(angle=0.5 * math.pi), Similarity(angle=-0.5 * math.pi)
    for case in many()[:50]:
        assert numbers(back.case(there.case(case))) == pytest.approx(numbers(case), rel=1e-12, abs=1e-12)
        mirror = Similarity(mirrored=True)
        assert mirror.case(mirror.case(case)) == case or numbers(mirror.case(mirror.case(case))) == numbers(case)


def numbers(case: Any) -> list[float]:
    if isinstance(case, dict):
        return [v for key in sorted(case) for v in numbers(case[key])]
    if isinstance(case, list):
        return [v for item in case for v in numbers(item)]
    return [float(case)] if isinstance(case, float) else []


def test_only_types_with_a_common_coefficient_at_one_end_change_under_reversal() -> None:
    """x^2 + y^2 and x^3 alone: (1 - x)^3 has a term x^2 without the y^2."""
    assert {name for name, kind in ELEMENTS.items() if not rearrange.symmetric_under_reversal(kind)} == {
        "2d2n", "2d2n-nu"}
    assert rearrange.symmetric_under_reversal(type_of({"type": "ancf", "order": [3, 2]}))


def test_parts_of_a_split_body_have_its_length_and_loads() -> None:
    rng, tried = random.Random(1), 0
    for case in many()[:100]:
        for name in case["bodies"]:
            ways = rearrange.splits(case, name)
            if not ways:
                continue
            tried += 1
            parts = rearrange.split_body(case, name, *rng.choice(ways))
            own = [shapes.length(parts["bodies"][n]["geometry"]) for n in (name, name + name)]
            whole = shapes.length(case["bodies"][name]["geometry"])
            assert sum(own) == pytest.approx(whole, rel=1e-12)
            loaded = sum((load.get("to", 1.0) - load.get("from", 0.0)) * length
                         for n, length in zip((name, name + name), own, strict=True)
                         for load in parts.get("loads", ()) if load.get("on") == n)
            before = sum((load.get("to", 1.0) - load.get("from", 0.0)) * whole
                         for load in case.get("loads", ()) if load.get("on") == name)
            assert loaded == pytest.approx(before, rel=1e-12)
    assert tried > 20


# ---------------------------------------------------------------------- checks that can fail, and what is small

BAR = {"bodies": {"a": {"geometry": {"type": "line", "start": [0.0, 0.0], "end": [1.0, 0.5]},
                        "section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e7, "nu": 0.3},
                        "element": {"type": "vallejo", "count": 2}}},
       "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "a@0"}],
       "loads": [{"type": "force", "at": "a@1", "value": [1.0, -2.0]}, {"type": "moment", "at": "a@0.5", "value": 0.3}],
       "solver": {"type": "linear_static"}, "output": {"probes": {"tip": "a@1"}}}


def test_a_deviation_of_a_millionth_is_a_violation() -> None:
    item = checks.Scene(BAR)
    assert not checks.agree(item, item.base).violated
    wrong = checks.answer({**item.case, "loads": [{**BAR["loads"][0], "value": [1.0, -2.000002]}, BAR["loads"][1]]})
    assert checks.agree(item, wrong).violated
    assert checks.agree(item, checks.answer(item.case), Similarity(angle=1e-6)).violated
    assert checks.agree(item, dataclasses.replace(item.base, refusal="no")).violated


def test_a_missing_reaction_violates_the_balance() -> None:
    item = checks.Scene(BAR)
    assert not checks.balanced(item).violated
    item.base.summary["reactions"]["wall"]["m"] *= 1.0 + 1e-6
    assert checks.balanced(item).violated


def test_a_violating_case_is_reduced() -> None:
    case = next(c for c in many() if len(c["bodies"]) == 4 and any(x["type"] == "moment" for x in c.get("loads", ())))

    def violates(smaller: dict[str, Any]) -> bool:
        return any(x["type"] == "moment" for x in smaller.get("loads", ()))

    small = shrink.shrunk(case, violates)
    assert len(small["bodies"]) == 1
    assert [x["type"] for x in small["loads"]] == ["moment"]
    assert not {"joints", "springs", "masses", "boundary_conditions"} & set(small)
    assert len(small["output"]["probes"]) <= 1


def test_outcomes_of_scenes_are_counted() -> None:
    held, refused = ({"number": k, "solver": "static", "refusal": why, "outcomes": {"mirrored": word}, "violations": {}}
                     for k, (why, word) in enumerate((("", "held"), ("too soft", "refused"))))
    text = campaign.report([held, refused])
    assert "| mirrored | static | 1 | 0 | 1 | 0 | 0 | 0 |" in text
    assert "| too soft | static | 1 |" in text


def test_condition_of_a_scaled_matrix() -> None:
    """Units of single coordinates have no effect: diag(1, 1e6) K diag(1, 1e6) is scaled back."""
    from instruments.scenes.roundoff import condition

    K = np.array([[2.0, 1.0], [1.0, 2.0]])
    D = np.diag([1.0, 1e6])
    assert condition(D @ K @ D) == pytest.approx(condition(K), rel=1e-6)
    assert condition(K) == pytest.approx(3.0)


