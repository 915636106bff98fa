"""Bodies of layers: coupling of stretch and bending, shear by equilibrium, stresses, and bimetal strips."""

from __future__ import annotations

import copy
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from helpers import covering

import ancf2d
from ancf2d.elements.section import Layer, laminate
from ancf2d.plot.fields import fields
from ancf2d.plot.picture import Source
from ancf2d.results import open_results
from ancf2d.results.export import export

L, WIDTH, T, F = 0.1, 0.01, 50.0, -2.0
LINEAR = {"type": "linear_static"}


def layer(height: float, E: float, alpha: float = 0.0, nu: float = 0.3, rho: float = 1000) -> dict[str, Any]:
    return {"height": height, "material": {"E": E, "nu": nu, "alpha": alpha, "rho": rho}}


def strip(kind: Any, layers: list[dict[str, Any]], loads: list[dict[str, Any]], axis: Any = "middle", count: int = 4,
          formulation: str | None = None, **more: Any) -> dict[str, Any]:
    element: dict[str, Any] = {"type": kind} if isinstance(kind, str) else {"type": "ancf", "order": kind}
    element |= {"count": count, **({"formulation": formulation} if formulation else {})}
    element |= {"quadrature": more.pop("quadrature")} if "quadrature" in more else {}
    section = {"width": WIDTH, "layers": layers, "axis": axis}
    return {"bodies": {"strip": {"geometry": {"type": "line", "start": [0, 0], "end": [L, 0]}, "section": section,
                                 "element": element}},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "strip@0"}], "loads": loads,
            "solver": LINEAR, "output": {"probes": {"tip": "strip@1", "a": "strip@0.4", "b": "strip@0.6"}}, **more}


def probes(case: dict[str, Any]) -> dict[str, Any]:
    return ancf2d.solve(case, states=False).summary["probes"]


def timoshenko(m: float, n: float, h: float, difference: float) -> float:
    """Curvature of a bimetal strip: m = a1/a2, n = E1/E2 (Timoshenko 1925, Eq. 4)."""
    return 6 * difference * T * (1 + m) ** 2 / (h * (3 * (1 + m) ** 2 + (1 + m * n) * (m * m + 1 / (m * n))))


BIMETALS = [(1e-3, 1e-3, 2e11, 1e11), (0.5e-3, 1.5e-3, 7e10, 2.1e11), (2e-3, 0.5e-3, 1e11, 1e11)]
HEAT = [{"type": "temperature", "on": "strip", "value": T}]


@covering(kind=["reissner3", "cable", "vallejo"], axis=["middle", "centroid", 0.0], metals=BIMETALS)
def test_bimetal_strips_bend_as_timoshenko_says(kind: str, axis: Any, metals: tuple[float, ...]) -> None:
    low, high, E1, E2 = metals
    tip = probes(strip(kind, [layer(low, E1, 1e-5), layer(high, E2, 2.5e-5)], HEAT, axis))["tip"]
    assert tip["theta"] == pytest.approx(-L * timoshenko(low / high, E1 / E2, low + high, 1.5e-5), rel=1e-9)


def test_layers_with_zero_mean_expansion_bend() -> None:
    tip = probes(strip("reissner3", [layer(1e-3, 1e11, -1e-5), layer(1e-3, 1e11, 1e-5)], HEAT))["tip"]
    assert tip["theta"] == pytest.approx(-L * timoshenko(1.0, 1.0, 2e-3, 2e-5), rel=1e-9)
    with pytest.raises(ancf2d.CaseError, match=r"expected bodies.strip.section.layers.0.material"):
        probes(strip("reissner3", [layer(1e-3, 1e11), layer(1e-3, 1e11)], HEAT))


@pytest.mark.parametrize(("low", "high", "E1", "E2"), BIMETALS)
def test_a_bimetal_continuum_bends_as_a_strip_far_from_its_ends(low: float, high: float, E1: float, E2: float) -> None:
    case = strip([3, 3], [layer(low, E1, 1e-5, nu=0.2), layer(high, E2, 2.5e-5)], HEAT, count=80)
    found = probes(case)
    curvature = (found["b"]["theta"] - found["a"]["theta"]) / (0.2 * L)
    assert curvature == pytest.approx(-timoshenko(low / high, E1 / E2, low + high, 1.5e-5), rel=1e-6)


@pytest.mark.parametrize("formulation", ["enhanced", "strain_split"])
@pytest.mark.parametrize("axis", ["middle", 0.0])
@pytest.mark.parametrize(("low", "high", "E1", "E2"), BIMETALS)
def test_bimetal_strips_with_uniform_transverse_stretch(formulation: str, axis: Any, low: float, high: float,
                                                        E1: float, E2: float) -> None:
    """For any nu of the layers and any position of the axis."""
    layers = [layer(low, E1, 1e-5, nu=0.1), layer(high, E2, 2.5e-5)]
    found = probes(strip("vallejo", layers, HEAT, axis, 16, formulation))
    curvature = (found["b"]["theta"] - found["a"]["theta"]) / (0.2 * L)
    assert curvature == pytest.approx(-timoshenko(low / high, E1 / E2, low + high, 1.5e-5), rel=1e-9)


@pytest.mark.parametrize(("low", "high", "E1", "E2"), BIMETALS)
def test_bimetal_strips_with_y2_coupled_to_x2(low: float, high: float, E1: float, E2: float) -> None:
    found = probes(strip("2d3n-nu", [layer(low, E1, 1e-5), layer(high, E2, 2.5e-5)], HEAT, count=16))
    curvature = (found["b"]["theta"] - found["a"]["theta"]) / (0.2 * L)
    assert curvature == pytest.approx(-timoshenko(low / high, E1 / E2, low + high, 1.5e-5), rel=1e-3)


SANDWICH = [(1e-3, 2e11), (3e-3, 1e9), (0.5e-3, 7e10)]


@pytest.mark.parametrize(("kind", "formulation", "within"), [
    ("vallejo", "enhanced", 1e-3), ("vallejo", "strain_split", 1e-3), ("li", "enhanced", 1e-3),
    ("vallejo", "continuum", 0.01), ([2, 2], "continuum", 0.01), ([2, 2], "enhanced", 0.02),
    ([3, 3], "continuum", 0.02),
    ("2d3n-nu", "continuum", 0.04),
])
def test_a_short_sandwich_shears_by_equilibrium(kind: Any, formulation: str, within: float) -> None:
    """Shear is 30 % of its deflection; end effects of a clamp, and each type's section kinematics, remain."""
    EA, ES, EI = moments(SANDWICH, 2.25e-3)
    ends = np.cumsum([0.0, *(h for h, _ in SANDWICH)]) - 2.25e-3
    kGA = laminate(WIDTH, tuple(Layer(a, b, E, 0.3, 0, 0) for (a, b), (_, E)
                                in zip(pairwise(ends), SANDWICH, strict=True))).kGA
    case = strip(kind, [layer(h, E) for h, E in SANDWICH], [{"type": "force", "at": "strip@1", "value": [0, F]}],
                 formulation=formulation, count=8)
    case["bodies"]["strip"]["geometry"]["end"] = [0.04, 0]
    expected = F * 0.04**3 / (3 * (EI - ES**2 / EA)) + F * 0.04 / kGA
    assert probes(case)["tip"]["uy"] == pytest.approx(expected, rel=within)


@pytest.mark.parametrize("kind", ["reissner3", [3, 3]])
def test_layers_of_one_material_are_one_rectangle(kind: Any) -> None:
    loads = [{"type": "force", "at": "strip@1", "value": [0, F]}]
    layers = probes(strip(kind, [layer(0.4e-3, 7e10), layer(1.6e-3, 7e10)], loads))["tip"]
    whole = strip(kind, [], loads)
    whole["bodies"]["strip"] |= {"section": {"height": 2e-3, "width": WIDTH}, "material": {"E": 7e10, "nu": 0.3}}
    if kind == "reissner3":
        whole["bodies"]["strip"]["element"]["shear_factor"] = 5 / 6
    assert layers["uy"] == pytest.approx(probes(whole)["tip"]["uy"], rel=1e-9)


def moments(layers: list[tuple[float, float]], axis: float) -> tuple[float, float, float]:
    """EA, ES, EI of layers (height, E) about an axis above the lower face."""
    ends = np.cumsum([0.0, *(h for h, _ in layers)]) - axis
    return tuple(WIDTH * sum(E * (b ** (n + 1) - a ** (n + 1)) / (n + 1) for (a, b), (_, E)  # type: ignore[return-value]
                             in zip(pairwise(ends), layers, strict=True)) for n in range(3))


@pytest.mark.parametrize("kind", ["reissner3", "cable", "vallejo"])
@pytest.mark.parametrize("axis", ["centroid", 0.0, 2.5e-3])
def test_a_laminated_cantilever_bends_by_its_coupling(kind: str, axis: Any) -> None:
    parts = [(1e-3, 2e11), (3e-3, 1e9), (0.5e-3, 7e10)]
    EA, ES, EI = moments(parts, 2e-3)
    bending = EI - ES**2 / EA
    found = probes(strip(kind, [layer(h, E) for h, E in parts], [{"type": "force", "at": "strip@1", "value": [0, F]}],
                         axis))["tip"]
    ends = np.cumsum([0.0, *(h for h, _ in parts)]) - 2e-3
    kGA = laminate(WIDTH, tuple(Layer(a, b, E, 0.3, 0, 0) for (a, b), (_, E) in zip(pairwise(ends), parts, strict=True))
                   ).kGA
    shear = 0.0 if kind == "cable" else F * L / kGA
    assert found["uy"] == pytest.approx(F * L**3 / (3 * bending) + shear, rel=1e-9)


def test_the_shear_stiffness_is_that_of_equilibrium() -> None:
    one = laminate(0.3, (Layer(-1.0, 1.0, 2.6, 0.3, 0, 0),))
    assert one.kGA == pytest.approx(5 / 6 * 0.6, rel=1e-12)
    # thin stiff faces on a soft core: the core shears alone, over the distance between the faces
    t, c, G = 1e-4, 1.0, 1e-3
    sandwich = laminate(1.0, (Layer(-c / 2 - t, -c / 2, 1e6, 0.3, 0, 0), Layer(-c / 2, c / 2, 2 * G, 0.0, 0, 0),
                              Layer(c / 2, c / 2 + t, 1e6, 0.3, 0, 0)))
    assert sandwich.kGA == pytest.approx(G * (c + t) ** 2 / c, rel=1e-4)


def test_each_layer_is_stressed_by_its_own_stiffness(tmp_path: Path) -> None:
    parts = [(1e-3, 2e11), (2e-3, 7e10)]
    case = strip("reissner3", [layer(h, E) for h, E in parts], [{"type": "force", "at": "strip@1", "value": [0, F]}])
    case["output"]["fields"] = ["stress"]
    held = ancf2d.solve(case, output=tmp_path / "held.h5")
    stress, record = held.results.field("strip", "stress"), held.results.fields["strip"]["stress"]
    y = 1.5e-3 * record.eta
    E = np.where(y < -0.5e-3, 2e11, 7e10)
    EA, ES, EI = moments(parts, 1.5e-3)
    det = EA * EI - ES**2
    M = F * L  # at the wall
    assert stress[0, 0, :, 0] == pytest.approx(E * (ES - EA * y) * M / det, rel=1e-6)
    # no shear at the faces; at the interface it is continuous, and what the layer below hands on
    below = np.flatnonzero(y < -0.5e-3)
    assert abs(stress[0, 0, [0, -1], 2]).max() < 1e-6 * abs(stress[0, 0, :, 2]).max()
    assert stress[0, 0, below[-1], 2] == pytest.approx(stress[0, 0, below[-1] + 1, 2], rel=1e-6)
    flow = -F * 2e11 * (-ES * 1e-3 + EA * 0.5 * (0.5e-3**2 - 1.5e-3**2)) / det
    assert stress[0, 0, below[-1], 2] == pytest.approx(flow, rel=1e-6)


def test_mirrored_layers_bend_the_other_way() -> None:
    up, down = (probes(strip([3, 3], layers, HEAT))["tip"]["uy"] for layers in (
        [layer(1e-3, 2e11, 1e-5), layer(2e-3, 1e11, 2e-5)], [layer(2e-3, 1e11, 2e-5), layer(1e-3, 2e11, 1e-5)]))
    assert up == pytest.approx(-down, rel=1e-8)


def test_frequencies_do_not_depend_on_where_the_axis_lies() -> None:
    def first(axis: Any) -> float:
        case = strip("vallejo", [layer(1e-3, 2e11, rho=7800), layer(3e-3, 1e10, rho=1000)], [], axis, 8,
                     solver={"type": "eigen", "modes": 1})
        return float(ancf2d.solve(case, states=False).summary["frequencies"][0]["omega"])

    assert first(0.0) == pytest.approx(first("middle"), rel=1e-6)


@pytest.mark.parametrize(("kind", "formulation"), [("vallejo", "enhanced"), ([3, 3], "continuum")])
def test_bodies_with_and_without_layers_stand_side_by_side(kind: Any, formulation: str) -> None:
    load = {"type": "force", "at": "strip@1", "value": [0, F]}
    alone = strip(kind, [layer(1e-3, 2e11), layer(2e-3, 1e11)], [load], formulation=formulation)
    both = strip(kind, [layer(1e-3, 2e11), layer(2e-3, 1e11)], [load], formulation=formulation)
    plain = {**both["bodies"]["strip"], "section": {"height": 3e-3, "width": WIDTH}, "material": {"E": 1e11, "nu": 0.3}}
    both["bodies"]["plain"] = plain
    both["boundary_conditions"] += [{"name": "other", "type": "clamp", "at": "plain@0"}]
    assert probes(both)["tip"]["uy"] == pytest.approx(probes(alone)["tip"]["uy"], rel=1e-9)


@pytest.mark.parametrize(("kind", "changes", "says"), [
    ("reissner3", {"solver": {"type": "eigen", "modes": 1}}, "centre of mass is"),
    ("vallejo", {"formulation": "continuum", "quadrature": {"normal": [2, 2], "shear": [1, 1]}}, "one quadrature"),
])
def test_impossible_layers_are_refused(kind: str, changes: dict[str, Any], says: str) -> None:
    case = strip(kind, [layer(1e-3, 2e11, rho=7800), layer(2e-3, 1e11)], [], **changes)
    with pytest.raises(ancf2d.CaseError, match=says):
        ancf2d.solve(case, states=False)


def test_a_body_of_layers_has_no_material_of_its_own() -> None:
    case = strip("reissner3", [layer(1e-3, 2e11)], [])
    case["bodies"]["strip"]["material"] = {"E": 1e9, "nu": 0.3}
    with pytest.raises(ancf2d.CaseError, match="each layer has one"):
        ancf2d.load(case)


@pytest.mark.parametrize("kind", ["reissner3", "cable", "vallejo"])
def test_faces_and_layers_are_drawn_in_position(kind: str, tmp_path: Path) -> None:
    """The axis is at the lower face; stresses in ParaView are those of each layer, on both sides of their interface."""
    case = strip(kind, [layer(1e-3, 1e11, 1e-5), layer(3e-3, 2e11, 2e-5)], HEAT, 0.0)
    case["output"]["fields"] = ["stress"]
    ancf2d.solve(case, output=tmp_path / "a.h5")
    with open_results(tmp_path / "a.h5") as results:
        y = results.levels("strip", None)[..., 1]
        for level, height in zip(y, (0.0, 0.0, 4e-3, 1e-3), strict=True):
            np.testing.assert_allclose(level, height, atol=1e-15)
        stored, eta = results.field("strip", "stress")[0, 0, :, 0], results.fields["strip"]["stress"].eta
        drawn = fields([Source("", results)], unrolled=True).surfaces[0]
        np.testing.assert_allclose(drawn.y[0, 0], 2e-3 * eta, atol=1e-15)
        np.testing.assert_allclose(drawn.values[0, 0], stored, rtol=1e-9)
        assert drawn.lines == [4]
    export(tmp_path / "a.h5", tmp_path / "a.vtkhdf")
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        grid = file["VTKHDF"]
        n = int(grid["NumberOfPoints"][0])
        points = (grid["Points"][:n] - grid["PointData/displacement"][:n])[:, 1]
        stress = grid["PointData/stress_xx"][:n]
        at = points.reshape(4, 5, -1)[0, :, 0]
        np.testing.assert_allclose(at, [0, 1e-3, 1e-3, 4e-3, 0], atol=1e-15)
        np.testing.assert_allclose(stress.reshape(4, 5, -1)[0, :4, 0], stored[[0, 4, 5, 9]], rtol=1e-4)


@pytest.mark.parametrize(("kind", "formulation"), [
    ("reissner3", None), ("cable", None), ([3, 3], "continuum"),
    pytest.param("vallejo", "enhanced", marks=pytest.mark.slow),
    pytest.param("omar", "structural", marks=pytest.mark.slow)])
def test_layers_of_varying_width_equal_welded_parts(kind: Any, formulation: str | None) -> None:
    """A jump of the width, and a continuing taper: strips of two layers under heat and a force, and in two parts."""
    loads = [{"type": "force", "at": "strip@1", "value": [3.0, F]},
             {"type": "temperature", "on": "strip", "value": T, "gradient": 100.0}]
    case = strip(kind, [layer(1e-3, 2e11, 1e-5), layer(2e-3, 7e10, 2e-5)], loads, 0.5e-3, 4, formulation)
    body = case["bodies"]["strip"]
    body["section"]["width"] = {"s": [0, 0.5, 0.5, 1], "value": [0.02, 0.01, 0.006, 0.004]}
    whole = probes(case)["tip"]
    halves = copy.deepcopy(case)
    first = halves["bodies"]["strip"]
    last = halves["bodies"]["last"] = copy.deepcopy(first)
    for half, ends, widths in ((first, (0.0, L / 2), (0.02, 0.01)), (last, (L / 2, L), (0.006, 0.004))):
        half["geometry"] |= {"start": [ends[0], 0], "end": [ends[1], 0]}
        half["section"]["width"] = f"{widths[0]} + ({widths[1] - widths[0]})*s"
        half["element"]["count"] = 2
    halves["joints"] = [{"type": "weld", "between": ["strip@1", "last@0"]}]
    halves["loads"] = [{**loads[0], "at": "last@1"}, loads[1], {**loads[1], "on": "last"}]
    halves["output"]["probes"] = {"tip": "last@1"}
    for key, value in probes(halves)["tip"].items():
        assert whole[key] == pytest.approx(value, rel=1e-9, abs=1e-14), key


def test_a_tapered_laminate_has_the_compliance_and_stress_of_its_integrals(tmp_path: Path) -> None:
    """Width b0 (1 - s/2): the compliance integrates to logarithms; the stress at a section is that of its own width."""
    parts = [(1e-3, 2e11), (3e-3, 1e9), (0.5e-3, 7e10)]
    EA, ES, EI = moments(parts, 2.25e-3)
    case = strip("reissner3", [layer(h, E) for h, E in parts], [{"type": "force", "at": "strip@1", "value": [0, F]}],
                 count=16)
    case["bodies"]["strip"]["section"]["width"] = f"{WIDTH}*(1 - 0.5*s)"
    case["output"]["fields"] = ["stress"]
    held = ancf2d.solve(case, output=tmp_path / "a.h5")
    tip = held.summary["probes"]["tip"]
    # int (1 - s)^2/(1 - s/2) ds and int 1/(1 - s/2) ds over 0 to 1
    bend, shear = 2 * np.log(2) - 1, 2 * np.log(2)
    ends = np.cumsum([0.0, *(h for h, _ in parts)]) - 2.25e-3
    kGA = laminate(WIDTH, tuple(Layer(a, b, E, 0.3, 0, 0) for (a, b), (_, E) in zip(pairwise(ends), parts, strict=True))
                   ).kGA
    assert tip["uy"] == pytest.approx(F * L**3 * bend / (EI - ES**2 / EA) + F * L * shear / kGA, rel=1e-6)
    assert tip["theta"] == pytest.approx(F * L**2 * (2 - 2 * np.log(2)) / (EI - ES**2 / EA), rel=1e-6)
    record, found = held.results.fields["strip"]["stress"], held.results.field("strip", "stress")
    s = (np.arange(16)[:, None] + record.xi) / 16
    M, det = F * L * (1 - s) / (1 - 0.5 * s), EA * EI - ES**2
    top = 7e10 * (ES * M - 2.25e-3 * EA * M) / det
    np.testing.assert_allclose(found[:, :, -1, 0], top, atol=1e-6 * np.abs(top).max())


def opensees() -> Any:
    """OpenSees; skips the test if it is not installed, or lacks a library of the system."""
    try:
        import openseespy.opensees as ops
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"OpenSees is not there (pip install .[peers], which needs libblas and liblapack): {error}")
    return ops


def opensees_tip(parts: list[tuple[float, float]], load: list[float], count: int, large: bool) -> list[float]:
    """Displacement of the tip [ux, uy, theta]: force-based elements with fibres, 400 in each layer (height, E)."""
    ops = opensees()
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    for i in range(count + 1):
        ops.node(i + 1, L * i / count, 0.0)
    ops.fix(1, 1, 1, 1)
    ops.section("Fiber", 1)
    y, fibres = -0.5 * sum(h for h, _ in parts), 400
    for k, (h, E) in enumerate(parts, start=1):
        ops.uniaxialMaterial("Elastic", k, E)
        for j in range(fibres):
            ops.fiber(y + h * (j + 0.5) / fibres, 0.0, WIDTH * h / fibres, k)
        y += h
    ops.geomTransf("Corotational" if large else "Linear", 1)
    ops.beamIntegration("Legendre", 1, 1, 2)
    for i in range(count):
        ops.element("forceBeamColumn", i + 1, i + 1, i + 2, 1, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(count + 1, *load)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("BandGen")
    ops.test("NormDispIncr", 1e-12, 100)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 0.05)
    ops.analysis("Static")
    assert ops.analyze(20) == 0
    return [ops.nodeDisp(count + 1, k) for k in (1, 2, 3)]


def test_undamped_modes_name_the_relaxing_layers() -> None:
    layers = [layer(0.001, 1e9), layer(0.002, 1e8)]
    for one in layers:
        one["material"]["viscoelastic"] = [{"modulus": 1, "time": 0.1}]
    case = strip("vallejo", layers, [], solver={"type": "eigen", "modes": 1, "damped": False})
    found = ancf2d.solve(case, states=False).summary
    places = ", ".join(f"bodies.strip.section.layers.{k}.material.viscoelastic" for k in (0, 1))
    assert found["warnings"] == [f"these modes are undamped (damped: false), so {places} have no effect"]


@pytest.mark.parametrize("large", [False, True])
def test_a_laminated_cantilever_agrees_with_fibre_sections_in_opensees(large: bool) -> None:
    """Steel under a soft core and aluminium, the axis in the middle: under a force, to a third of its length."""
    parts = [(1e-3, 2e11), (2e-3, 1e9), (0.5e-3, 7e10)]
    load = [20.0, 300.0 if large else F]
    theirs = opensees_tip(parts, [*load, 0.0], 64 if large else 1, large)
    ours = probes(strip("cable", [layer(h, E) for h, E in parts], [{"type": "force", "at": "strip@1", "value": load}],
                        count=32, solver={"type": "static"} if large else LINEAR))["tip"]
    assert abs(theirs[1]) > (0.3 * L if large else 0.0)
    assert [ours["ux"], ours["uy"], ours["theta"]] == pytest.approx(theirs, rel=1e-4)
