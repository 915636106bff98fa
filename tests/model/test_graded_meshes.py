"""Unequal elements: their lengths, nested refinement, required nodes, closed forms, every type and axis."""

from __future__ import annotations

import json
import math
import re
from typing import Any

import helpers
import numpy as np
import pytest

from ancf2d.case import Body, load_case_text, with_overrides
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.model.grading import Lengths, Nodes, Ratio, grading_of
from ancf2d.study.accuracy.setting import Setting, meshed, with_setting
from ancf2d.study.run import vocabulary
from ancf2d.study.variants import Variant, overrides_for

TABLE = {"s": [0, 0.3, 0.3, 1], "value": [1, 2, 0.25, 1]}
SPECS: dict[str, dict[str, Any]] = {
    "ratio": {"count": 6, "grading": 8}, "profile": {"count": 6, "grading": "1 + 7*s"},
    "table": {"count": 6, "grading": TABLE}, "nodes": {"nodes": [0, 0.1, 0.4, 1]},
    "more than nodes": {"nodes": [0, 0.1, 0.4, 1], "count": 6}}
CLOSED = {"type": "curve", "x": "2*cos(2*pi*s)", "y": "sin(2*pi*s)", "closed": True}
AXES = {**helpers.GEOMETRIES, "polyline": {"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 2]]}, "closed": CLOSED}


def ends(spec: dict[str, Any], geometry: Any = helpers.LINE, **scene: Any) -> np.ndarray:
    """Return the positions S of the ends of elements."""
    held = {"bc": [{"type": "clamp", "at": "b@0"}], **scene}
    mesh = helpers.build({"b": helpers.body(geometry, {"type": "reissner3", **spec})}, **held).meshes["b"]
    np.testing.assert_allclose(mesh.starts[1:], (mesh.starts + mesh.lengths)[:-1], rtol=1e-12)
    return np.append(mesh.starts, mesh.plan.length) / mesh.plan.length


def body_of(spec: dict[str, Any]) -> Body:
    return helpers.load({"b": helpers.body(helpers.LINE, {"type": "cable", **spec})},
                        bc=[{"type": "clamp", "at": "b@0"}]).case.bodies["b"]


@pytest.mark.parametrize("name", SPECS)
def test_positions_and_shares_of_elements_are_inverse_maps(name: str) -> None:
    grading = grading_of(body_of(SPECS[name]).element)
    assert grading is not None
    x = np.linspace(0.0, 1.0, 101)
    s = grading.places(x)
    np.testing.assert_allclose(grading.shares(s), x, atol=1e-12)
    assert (s[0], s[-1]) == pytest.approx((0.0, 1.0), abs=1e-14)
    assert np.all(np.diff(s) > 0)


def test_a_ratio_is_a_geometric_series_and_the_linear_profile_of_lengths() -> None:
    s = ends({"count": 6, "grading": 8})
    np.testing.assert_allclose(np.diff(s)[1:] / np.diff(s)[:-1], 8 ** (1 / 6), rtol=1e-12)
    np.testing.assert_allclose(ends({"count": 6, "grading": "1 + 7*s"}), s, atol=1e-12)
    np.testing.assert_allclose(ends({"count": 6, "grading": 1}), np.linspace(0, 1, 7), atol=1e-14)


def test_lengths_follow_a_table_with_jumps_and_given_nodes() -> None:
    fine = ends({"count": 400, "grading": TABLE})
    middle, length = 0.5 * (fine[1:] + fine[:-1]), np.diff(fine)
    away = abs(middle - 0.3) > 1e-2
    h = np.where(middle < 0.3, 1 + middle / 0.3, 0.25 + 0.75 * (middle - 0.3) / 0.7)
    np.testing.assert_allclose((length / h)[away] / (length / h)[0], 1.0, rtol=1e-4)
    np.testing.assert_allclose(ends(SPECS["nodes"]), [0, 0.1, 0.4, 1])
    np.testing.assert_allclose(ends(SPECS["more than nodes"]), [0, 0.05, 0.1, 0.25, 0.4, 0.7, 1])
    np.testing.assert_allclose(ends({**SPECS["nodes"], "refine": 2}), [0, 0.05, 0.1, 0.25, 0.4, 0.7, 1])


@helpers.covering(name=SPECS, geometry=AXES)
def test_refined_meshes_have_all_nodes_of_coarser_ones_on_every_axis(name: str, geometry: str) -> None:
    acting = {"masses": [{"at": "b@0.37", "mass": 1.0}]}
    spec, axis = SPECS[name], AXES[geometry]
    coarse = ends(spec, axis, **acting)
    assert 0.37 in coarse.round(12)
    fine = ends({**spec, "refine": 3}, axis, **acting)
    assert len(fine) == 3 * (len(coarse) - 1) + 1
    np.testing.assert_allclose(fine[::3], coarse, atol=1e-12)


@pytest.mark.parametrize("name", ["ratio", "table", "nodes"])
def test_studies_and_accuracy_control_halve_elements_and_keep_the_grading(name: str) -> None:
    loaded = helpers.load({"b": helpers.body(helpers.LINE, {"type": "reissner3", **SPECS[name]})},
                          bc=[{"type": "clamp", "at": "b@0"}], loads=[{"type": "force", "at": "b@1", "value": [0, 1]}])

    def places(sets: list[str]) -> np.ndarray:
        mesh = build_model(with_overrides(loaded, sets, vocabulary())).meshes["b"]
        return np.append(mesh.starts, mesh.plan.length) / mesh.plan.length

    own = places([])
    n = len(own) - 1
    for variant in (Variant(), Variant("cable")):
        np.testing.assert_allclose(places(overrides_for(loaded.case, variant, {"b": n})), own, atol=1e-12)
        np.testing.assert_allclose(places(overrides_for(loaded.case, variant, {"b": 4 * n}))[::4], own, atol=1e-12)
    least = meshed(loaded.case, {})["b"].least
    first, second = (build_model(with_setting(loaded, Setting({"b": k * least}))).meshes["b"] for k in (1, 2))
    np.testing.assert_allclose(second.starts[::2], first.starts, atol=1e-12)
    # a line of two metres, and places that the grading of the case has
    grading = grading_of(loaded.case.bodies["b"].element)
    assert grading is not None
    length = first.plan.length
    np.testing.assert_allclose(grading.shares(second.starts / length) * 2 * least,
                               np.round(grading.shares(second.starts / length) * 2 * least), atol=1e-9)


def test_grading_survives_writing_and_reading() -> None:
    for spec in SPECS.values():
        loaded = helpers.load({"b": helpers.body(helpers.LINE, {"type": "cable", **spec})},
                              bc=[{"type": "clamp", "at": "b@0"}])
        again = load_case_text(json.dumps(loaded.case, default=_written), vocabulary=vocabulary())
        assert again.case.bodies["b"].element == loaded.case.bodies["b"].element


def _written(value: Any) -> Any:
    from ancf2d.case.emit import written

    return written(value)


def test_the_kinds_of_grading() -> None:
    assert grading_of(body_of({"count": 3}).element) is None
    assert grading_of(body_of({"count": 3, "nodes": "acting"}).element) is None
    assert isinstance(grading_of(body_of(SPECS["ratio"]).element), Ratio)
    assert isinstance(grading_of(body_of(SPECS["table"]).element), Lengths)
    assert isinstance(grading_of(body_of(SPECS["nodes"]).element), Nodes)


@pytest.mark.parametrize(("spec", "told"), [
    ({"count": 20, "grading": 1e9}, "grading.*the shortest element is 2.*e-09 times as long as the longest one"),
    ({"nodes": [0, 0.5, 0.500001, 1]}, "nodes.*the shortest element is 1e-06 times as long as the body")])
def test_extremely_unequal_elements_are_refused(spec: dict[str, Any], told: str) -> None:
    with pytest.raises(CaseError) as error:
        ends(spec)
    (problem,) = error.value.problems
    assert re.search(told, f"{'.'.join(map(str, problem.path))} {problem.message}")


@helpers.every_small_type
def test_a_bar_under_tension_is_exact_for_any_grading(name: str) -> None:
    """u = F S L/(E A), nu = 0; 2d2n and 2d3n fail the patch test with equal elements too: exact at the end alone."""
    spec = {**helpers.element(name, 5), "grading": "0.2 + s^2"}
    model = helpers.cantilever(spec, helpers.tip(1e6, 0.0, spread="uniform"), material={"E": 2e11, "nu": 0.0},
                               solver="linear_static")
    for s in (1.0,) if name in ("2d2n", "2d3n") else (0.31, 1.0):
        assert model.u(f"beam@{s}")[0] == pytest.approx(s * 1e6 * 2.0 / (2e11 * 0.01), rel=1e-9)


@pytest.mark.parametrize("name", ["cable", "reissner3"])
def test_short_elements_resolve_a_boundary_layer(name: str) -> None:
    """A cantilever under tension N bends in a layer of sqrt(EI/N): u(L) = F/N (L - tanh(k L)/k), k = sqrt(N/EI)."""
    L, N, F, EI = 1.0, 1e4, 1e-2, 1.0
    section = {"EA": 1e12, "EI": EI} | ({} if name == "cable" else {"kGA": 1e13})
    k = math.sqrt(N / EI)
    exact = F / N * (L - math.tanh(k * L) / k)
    errors = [abs(helpers.cantilever({"type": name, "count": 6, **more}, helpers.tip(N, F), length=L, section=section,
                                     solver={"type": "static", "steps": 2}).u("beam@1")[1] / exact - 1.0)
              for more in ({}, {"grading": 100})]
    assert errors[1] < 0.05 * errors[0]
    assert errors[1] < 2e-4
