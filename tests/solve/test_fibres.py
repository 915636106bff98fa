"""Fibres with plasticity or curves, in statics, compared with closed forms of plasticity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.elements.fibres import places
from ancf2d.elements.section import Section
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.plot.kinds import build
from ancf2d.results import open_results
from ancf2d.solvers.fields import FieldReader
from ancf2d.solvers.section_forces import SectionForces
from ancf2d.solvers.state_results import reactions
from ancf2d.study.run import run_case

E, YIELD, HEIGHT, WIDTH, LENGTH = 2e11, 250e6, 0.1, 0.05, 1.0
EA, EI = E * HEIGHT * WIDTH, E * WIDTH * HEIGHT**3 / 12
FIRST = YIELD / E
# curvature and moment at which the outermost fibre yields
BENT, MOMENT = 2 * FIRST / HEIGHT, YIELD * WIDTH * HEIGHT**2 / 6
STEEL = {"E": E, "nu": 0.3, "yield": YIELD}
TYPES = [("reissner3", None), ("cable", None), ("vallejo", "structural")]


def held(kind: tuple[str, str | None], motion: dict[str, Any], material: dict[str, Any], steps: int = 12,
         section: dict[str, Any] | None = None) -> h.Solution:
    """Return a clamped rod with a prescribed motion of its end."""
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]), "material": material,
            "section": section or {"height": HEIGHT, "width": WIDTH}}
    if section:
        del body["material"]
    return h.solved({"rod": body}, {"type": "static", "steps": steps}, bc=[
        {"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "name": "end", **motion}])


def at(found: h.Solution, *factors: float) -> list[dict[str, float]]:
    """Return the reactions of the end at load factors of states."""
    t = np.array([s.t for s in found.states])
    near = [int(np.argmin(np.abs(t - f))) for f in factors]
    np.testing.assert_allclose(t[near], factors, rtol=1e-12)
    return [reactions(found.model, found.states[k])["end"] for k in near]


def fibres(count: int, curvature: float) -> float:
    """Return the moment of a rectangle of elastic, perfectly plastic fibres."""
    y, w = places(Section(HEIGHT, WIDTH, E, 0.0, 1.0, EA, 1.0, EI), count)
    return float(np.sum(w * y * np.clip(E * curvature * y, -YIELD, YIELD)))


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
def test_a_rectangle_bends_beyond_yield_and_back(kind: tuple[str, str | None]) -> None:
    """M/M_y = 3/2 - (kappa_y/kappa)^2/2 (Prager & Hodge 1951); elastic unloading to M = 0 leaves kappa - M/(E I)."""
    curvature = 4.0 * BENT
    moment = fibres(16, curvature)
    remaining = (curvature - moment / EI) / curvature
    turn = {"type": "table", "t": [0, 0.37, 1], "value": [0, curvature * LENGTH, remaining * curvature * LENGTH]}
    there, back = (r["m"] for r in at(held(kind, {"angle": turn}, STEEL), 0.37, 1.0))
    # the directions that vallejo interpolates between its nodes turn unevenly
    near = 1e-5 if kind[1] else 1e-7
    assert there == pytest.approx(moment, rel=near)
    assert there == pytest.approx(MOMENT * (1.5 - 0.5 / 16), rel=2e-3)
    assert abs(back) < near * moment


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
def test_fibres_that_yield_under_an_eigenstrain_before_the_first_step_remember_it(kind: tuple[str, str | None]) -> None:
    """Bent back to zero elastic strain in one step: M = -f(k) + 2 f(k/2) with the moment f of virgin loading (Masing).

    Sections that are held straight under a natural curvature are in balance, so no iteration finds their state.
    """
    k = 4.0 * BENT
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}}
    found = h.solved({"rod": body}, {"type": "static", "steps": 1}, bc=[
        {"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "name": "end", "angle": k * LENGTH}],
        loads=[{"type": "eigenstrain", "on": "rod", "curvature": k, "amplitude": {"type": "constant"}}])
    assert at(found, 1.0)[0]["m"] == pytest.approx(2.0 * fibres(16, 0.5 * k) - fibres(16, k), rel=1e-4)


@pytest.mark.parametrize("kind", TYPES[:2], ids=lambda k: k[0])
def test_fibres_have_their_stress_and_plastic_strain(kind: tuple[str, str | None], tmp_path: Path) -> None:
    """Bent to kappa and released, fibres keep p = e - clip(E e)/E and the stress clip(E e) - M y/I of the moment M.

    The figure of moment over curvature has both at its corners.
    """
    curvature = 4.0 * BENT
    moment = fibres(16, curvature)
    left = curvature - moment / EI
    turn = {"type": "table", "t": [0, 0.5, 1], "value": [0, curvature * LENGTH, left * LENGTH]}
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]), "material": {**STEEL, "alpha": 1e-5},
            "section": {"height": HEIGHT, "width": WIDTH}}
    case = h.load({"rod": body}, {"type": "static", "steps": 8}, bc=[
        {"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "angle": turn}],
        loads=[{"type": "temperature", "on": "rod", "value": 10.0}],
        output={"fields": ["stress", "strain", "plastic_strain", "M"]})
    run_case(case, str(tmp_path / "a.h5"))
    with open_results(tmp_path / "a.h5") as found:
        eta = found.fields["rod"]["stress"].eta
        stress, strain, plastic = (found.field("rod", name)[..., 0] for name in ("stress", "strain", "plastic_strain"))
        curve = build(found, "moment_curvature", point="rod@0.3").panels[0].curves[0]
        loop = build(found, "stress_strain", height=float(eta[-1])).panels[0].curves[0]
    y = 0.5 * HEIGHT * eta
    bent = -curvature * y
    yielded = np.clip(E * bent, -YIELD, YIELD)
    # polynomials are no arcs: those of the exact formulation alone bend evenly
    shape, near = stress.shape, 1e-6 if kind[0] == "reissner3" else 5e-3
    np.testing.assert_allclose(plastic, np.broadcast_to(bent - yielded / E, shape), atol=near * FIRST)
    np.testing.assert_allclose(stress, np.broadcast_to(yielded + moment / EI * E * y, shape), atol=near * YIELD)
    np.testing.assert_allclose(strain, np.broadcast_to(1e-4 - left * y, shape), atol=near * FIRST)
    middle = int(np.argmax(curve.y))
    assert (curve.x[middle], curve.y[middle]) == pytest.approx((curvature, moment), rel=near)
    assert curve.x[-1] == pytest.approx(left, rel=near)
    assert abs(curve.y[-1]) < near * moment
    assert loop.y.min() == pytest.approx(-YIELD)
    assert (loop.x[-1], loop.y[-1]) == pytest.approx((strain[0, 0, -1], stress[0, 0, -1]), rel=1e-9)


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
def test_the_fields_of_layers_add_up_to_their_section_forces(kind: tuple[str, str | None]) -> None:
    """Sums of the stress over the fibres are N and M, of a metal on a rubber-like layer that hardens along a curve."""
    soft = {"E": 1e10, "nu": 0.4, "stress_strain": {"strain": [1e-3, 3e-3], "stress": [1e7, 1.4e7],
                                                        "unloading": "curve"}}
    hard = {**STEEL, "hardening": {"isotropic": 2e10}}
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 4, kind[1]),
            "section": {"width": WIDTH, "axis": "middle", "layers": [{"height": 0.02, "material": hard},
                                                                   {"height": 0.05, "material": soft}]}}
    model = build_model(h.load({"rod": body}, {"type": "static", "steps": 6}, bc=[
        {"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "ux": 2e-3, "uy": 0.02, "angle": 0.06}],
        output={"fields": ["stress"]}))
    reader, last = FieldReader(model), h.Solution(model).state
    read = reader.read(last)
    y, w = (v[:, 0] for v in places(model.meshes["rod"].plan.section, 16))
    stress = read["rod", "stress"][..., 0]
    assert np.ptp(stress) > YIELD
    N, _, M = np.moveaxis([SectionForces(model, model.meshes["rod"], xi)(last)[k] for k, xi in enumerate(
        reader.bodies[0].fibres)], -1, 0)
    # at the Gauss points of elements inside, laws are in balance exactly; elsewhere in the mean
    for exact, some in ((kind[0] == "reissner3", slice(1, -1)), (False, slice(None))):
        np.testing.assert_allclose((stress @ w)[some], N[some], rtol=1e-9 if exact else 3e-2)
        np.testing.assert_allclose(-(stress @ (w * y))[some], M[some], rtol=1e-9 if exact else 0.15)


@pytest.mark.parametrize(("kind", "stations"), [(("reissner3", None), 2), (("cable", None), 3),
                                                (("vallejo", "structural"), 2), (("omar", "structural"), 3)])
def test_only_stations_with_normal_force_and_moment_have_memory(kind: tuple[str, str | None], stations: int) -> None:
    """Stations of the section's stretch, at Lobatto points of ANCF types, have no fibres that could yield."""
    body = {"geometry": h.line(1.0), "element": h.element(kind[0], 3, kind[1]), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}}
    model = build_model(h.load({"beam": body}, {"type": "static"}, bc=[{"type": "clamp", "at": "beam@0"}]))
    law = model.meshes["beam"].plan.formulation.law
    assert model.states.size == 3 * stations * law.state
    assert law.state == 2 * law.strains + 2 * 16 + 3


def test_the_sum_over_fibres_converges_with_their_number() -> None:
    for count in (4, 8, 12, 16, 20):
        for ratio in (1.5, 2.0, 4.0, 8.0):
            exact = MOMENT * (1.5 - 0.5 / ratio**2)
            assert abs(fibres(count, ratio * BENT) / exact - 1.0) < 2.0 / count**2


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
@pytest.mark.parametrize("law", ["kinematic", "isotropic"])
def test_a_bar_under_cycles(kind: tuple[str, str | None], law: str) -> None:
    """Between +e and -e: a loop of width 2 s_y, shifted, or one that grows (Simo & Hughes 1998)."""
    hard, most = 2e10, 5 * FIRST
    slope = E * hard / (E + hard)
    first = YIELD + slope * (most - FIRST)
    expected = [first]
    for sign in (-1.0, 1.0, -1.0):
        last = abs(expected[-1])
        # how far it goes back before it yields again: twice the yield stress, which the last one is or is not
        back = 2 * YIELD if law == "kinematic" else 2 * last
        expected.append(sign * (back - last + slope * (2 * most - back / E)))
    pull = {"type": "table", "t": [0, 0.1, 0.4, 0.7, 1], "value": [0, *(s * most * LENGTH for s in (1, -1, 1, -1))]}
    found = at(held(kind, {"ux": pull, "uy": 0, "angle": 0}, {**STEEL, "hardening": {law: hard}}), 0.1, 0.4, 0.7, 1.0)
    # the stress of engineering strain, but for the width of Green's strain in none of these formulations
    np.testing.assert_allclose([r["fx"] for r in found], np.array(expected) * HEIGHT * WIDTH, rtol=1e-7)


@pytest.mark.parametrize("kind", ["sine", "expression"])
def test_load_steps_end_where_a_load_reverses(kind: str) -> None:
    """For 3 e_y sin(5 pi f/2), the bar goes to 3, to -3, and back to 3 at the end, however few the steps are."""
    course = {"sine": {"type": "sine", "frequency": 1.25, "scale": 3 * FIRST},
              "expression": {"type": "expression", "value": f"{3 * FIRST!r}*sin(2*pi*1.25*t)"}}[kind]
    found = held(TYPES[0], {"ux": course, "uy": 0, "angle": 0}, {**STEEL, "hardening": {"isotropic": E / 10}}, steps=3)
    stress, most, plastic = 0.0, 1.0, 0.0
    for strain in (3.0, -3.0, 3.0):
        # in e_y and s_y: E = 1, H = 0.1
        trial = strain - plastic
        flow = max(abs(trial) - most, 0.0) / 1.1
        plastic, most = plastic + np.copysign(flow, trial), most + 0.1 * flow
        stress = strain - plastic
    assert reactions(found.model, found.state)["end"]["fx"] == pytest.approx(stress * YIELD * HEIGHT * WIDTH, rel=1e-9)
    assert {0.2, 0.6} <= {round(s.t, 9) for s in found.states}


def test_the_error_of_load_steps_is_reported() -> None:
    """A load that reverses beyond yield, compared with fine steps; no error without path dependence."""
    def tip(steps: int, verify: bool = False, **more: Any) -> tuple[Any, Any]:
        found = ancf2d.solve({
            "bodies": {"rod": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                               "section": {"height": 0.04, "width": 0.02}, "element": {"type": "reissner3", "count": 4},
                               "material": {"E": 2e11, "nu": 0.3, **more}}},
            "boundary_conditions": [{"type": "clamp", "at": "rod@0"}],
            "loads": [{"type": "force", "at": "rod@1", "value": value, "amplitude": {"type": "expression", "value": f}}
                      for value, f in (([0, 2100], "sin(4*t)"), ([150000, 0], "1 - cos(4*t)"))],
            "solver": {"type": "static", "steps": steps, "verify": verify}, "output": {"probes": {"tip": "rod@1"}}},
                             states=False)
        return found.probes["tip"], found.accuracy
    steel = {"yield": 2.5e8, "hardening": {"isotropic": 2e9}}
    exact, _ = tip(640, **steel)
    for steps in (10, 20):
        found, told = tip(steps, True, **steel)
        off = np.hypot(found["ux"] - exact["ux"], found["uy"] - exact["uy"]) / np.hypot(exact["ux"], exact["uy"])
        assert 1.0 < told["estimate"] / off < 3.0
        assert (told["of"], told["steps"]) == ("load steps", 2 * steps)
    assert tip(4, True)[1]["estimate"] < 1e-9


def test_a_curve_defines_hardening_or_is_elastic() -> None:
    strain, stress = [FIRST, 2 * FIRST, 4 * FIRST], [YIELD, 1.1 * YIELD, 1.6 * YIELD]
    pull = {"type": "table", "t": [0, 0.4, 1], "value": [0, 6 * FIRST, 3 * FIRST]}
    top = 1.6 * YIELD + 2 * FIRST * (0.5 * YIELD / (2 * FIRST))
    for unloading, last in (("elastic", top - 3 * YIELD), ("curve", 1.35 * YIELD)):
        law = {"E": E, "nu": 0.3, "stress_strain": {"strain": strain, "stress": stress, "unloading": unloading}}
        found = at(held(TYPES[0], {"ux": pull, "uy": 0, "angle": 0}, law), 0.4, 1.0)
        np.testing.assert_allclose([r["fx"] for r in found], [top * HEIGHT * WIDTH, last * HEIGHT * WIDTH], rtol=1e-7)


def test_a_cantilever_has_a_plastic_zone() -> None:
    """delta/delta_y = (5 - (3 + m) sqrt(3 - 2 m))/m^2 with m = P L/M_y (Prager & Hodge 1951), without shear."""
    soft = {"E": 1e9 * E, "nu": 0.3, "yield": YIELD}
    m = 1.4
    tip = h.cantilever(h.element("cable", 20), [{"type": "force", "at": "beam@1", "value": [0, m * MOMENT / LENGTH]}],
                       length=LENGTH, section={"height": HEIGHT, "width": WIDTH}, material=soft).u("beam@1")[1]
    yields = MOMENT / LENGTH * LENGTH**3 / (3e9 * EI)
    assert tip / yields == pytest.approx((5 - (3 + m) * np.sqrt(3 - 2 * m)) / m**2, rel=4e-3)


def test_three_bars_under_a_cycle() -> None:
    """F = A (s_1 + 2 c s_2) of a bar between two at 45 degrees, c their cosine, each within its yield stress.

    Strains are c^2 u/L there and u/L in the middle, so small that the geometry stays. The collapse load is
    A s_y (1 + 2 c) (Hodge, Plastic Analysis of Structures, 1959).
    """
    soft, c, area = 1e-4 * YIELD, np.sqrt(0.5), HEIGHT * WIDTH
    tops = [(-LENGTH, LENGTH), (0.0, LENGTH), (LENGTH, LENGTH)]
    bodies = {f"bar{i}": {
        "geometry": {"type": "line", "start": list(top), "end": [0, 0]}, "element": h.element("reissner2", 1),
        "section": {"height": HEIGHT, "width": WIDTH}, "material": {**STEEL, "yield": soft}}
        for i, top in enumerate(tops)}
    way = np.array([0.0, -4.0, 3.0, -1.0]) * soft / E * LENGTH
    found = at(h.solved(bodies, {"type": "static", "steps": 12}, bc=[
        *({"type": "pin", "at": f"bar{i}@0"} for i in range(3)),
        {"type": "prescribed", "at": "bar1@1", "name": "end", "ux": 0,
         "uy": {"type": "table", "t": [0, 0.25, 0.75, 1], "value": way.tolist()}}],
        joints=[{"type": "pin", "between": [f"bar{i}@1", "bar1@1"]} for i in (0, 2)]), 0.25, 0.75, 1.0)
    stress, expected = np.zeros(2), []
    for step in np.diff(-way) / LENGTH:
        stress = np.clip(stress + E * step * np.array([1.0, c**2]), -soft, soft)
        expected.append(area * (stress[0] + 2.0 * c * stress[1]))
    assert expected[0] == pytest.approx(area * soft * (1.0 + 2.0 * c))
    np.testing.assert_allclose([-r["fy"] for r in found], expected, rtol=1e-6)


def test_layers_yield_one_by_one() -> None:
    """Under equal strain, a yielded layer bears its yield stress, the other follows its stiffness."""
    layers = {"width": WIDTH, "axis": "middle", "layers": [
        {"height": 0.04, "material": {"E": E, "nu": 0.3, "yield": YIELD}},
        {"height": 0.06, "material": {"E": 0.5 * E, "nu": 0.3}}]}
    (r,) = at(held(TYPES[0], {"ux": 3 * FIRST * LENGTH, "uy": 0, "angle": 0}, {}, section=layers), 1.0)
    below, above = YIELD * 0.04 * WIDTH, 0.5 * E * 3 * FIRST * 0.06 * WIDTH
    assert r["fx"] == pytest.approx(below + above, rel=1e-7)
    # about the middle of the height: the lower layer's middle is at -0.03, the upper one's at 0.02
    assert r["m"] == pytest.approx(-(below * -0.03 + above * 0.02), rel=1e-7)


@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
def test_the_tangent_is_consistent_and_newton_converges_quadratically(kind: tuple[str, str | None]) -> None:
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]),
            "section": {"height": HEIGHT, "width": WIDTH}, "material": {**STEEL, "hardening": {"kinematic": 2e10}}}
    system = ancf2d.system(h.load({"rod": body}, "static", bc=[{"type": "clamp", "at": "rod@0"}], loads=[
        {"type": "force", "at": "rod@1", "value": [0.9 * YIELD * HEIGHT * WIDTH, 1.2 * MOMENT / LENGTH]}]))
    z, sizes = np.zeros(len(system.names)), []
    for _ in range(12):
        step = np.linalg.solve(system.tangent(z).toarray(), -system.residual(z))
        z = z + step
        sizes.append(np.linalg.norm(step))
    assert sizes[-1] < 1e-11 * sizes[0]
    last = next(k for k, size in enumerate(sizes) if size < 1e-6 * sizes[0])
    assert sizes[last + 1] < 1e-9 * sizes[0]
    K, small = system.tangent(z).toarray(), 1e-9
    for k in range(len(z)):
        e = np.zeros(len(z))
        e[k] = small
        column = (system.residual(z + e) - system.residual(z - e)) / (2 * small)
        np.testing.assert_allclose(K[:, k], column, atol=1e-4 * np.abs(K[:, k]).max())


def test_states_are_those_of_accepted_steps() -> None:
    """The same history in many more steps ends at the same force: rejected trials are forgotten."""
    turn = {"type": "table", "t": [0, 0.3, 0.6, 1], "value": [0, 0.2, -0.1, 0.15]}
    ends = [at(held(TYPES[0], {"angle": turn}, {**STEEL, "hardening": {"isotropic": 1e10}}, steps), 1.0)[0]
            for steps in (2, 40)]
    assert ends[0]["m"] == pytest.approx(ends[1]["m"], rel=1e-7)


@pytest.mark.parametrize(("change", "words"), [
    ({"element": h.element("vallejo", 2, "continuum")}, "has no fibres"),
    ({"section": {"A": 0.005, "I": 4e-6, "height": 0.1}}, "do not define the fibres"),
    ({"element": {**h.element("reissner3", 2), "quadrature": [2, 1]}}, "a single fibre")])
def test_bodies_without_fibres_are_refused(change: dict[str, Any], words: str) -> None:
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 2), "material": STEEL,
            "section": {"height": HEIGHT, "width": WIDTH}, **change}
    with pytest.raises(CaseError, match=words):
        build_model(h.load({"rod": body}, "static", bc=[{"type": "clamp", "at": "rod@0"}]))


@pytest.mark.parametrize("kind", TYPES[:2], ids=lambda k: k[0])
def test_hardening_and_residual_stress_store_strain_energy(kind: tuple[str, str | None]) -> None:
    """A bar stores s^2/(2 E) + K p^2/2 per volume; one bent and released the energy of its residual stress."""
    hard = 2e10
    most = 4.0 * FIRST
    found = ancf2d.solve(_moved(kind, {"ux": most * LENGTH, "uy": 0, "angle": 0}, {**STEEL, "hardening": {
        "kinematic": hard}}), states=False)
    p = (most - FIRST) * E / (E + hard)
    volume = HEIGHT * WIDTH * LENGTH
    exact = volume * (0.5 * E * (most - p) ** 2 + 0.5 * hard * p**2)
    assert found.summary["energy"]["strain"] == pytest.approx(exact, rel=1e-4)
    curvature = 4.0 * BENT
    moment = fibres(16, curvature)
    left = curvature - moment / EI
    turn = {"type": "table", "t": [0, 0.5, 1], "value": [0, curvature * LENGTH, left * LENGTH]}
    y, w = places(Section(HEIGHT, WIDTH, E, 0.0, 1.0, EA, 1.0, EI), 16)
    remains = np.clip(E * curvature * y, -YIELD, YIELD) - moment / EI * E * y
    bent = ancf2d.solve(_moved(kind, {"angle": turn}, STEEL), states=False).summary["energy"]["strain"]
    assert bent == pytest.approx(LENGTH * float(np.sum(w * remains**2)) / (2.0 * E), rel=5e-3)


def _moved(kind: tuple[str, str | None], motion: dict[str, Any], material: dict[str, Any]) -> Any:
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]), "material": material,
            "section": {"height": HEIGHT, "width": WIDTH}}
    return h.load({"rod": body}, {"type": "static", "steps": 8}, bc=[
        {"type": "clamp", "at": "rod@0"}, {"type": "prescribed", "at": "rod@1", "name": "end", **motion}])
