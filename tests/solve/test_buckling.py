"""Buckling: Euler's columns, prestress, frames, multipliers, and the singular tangent at the factor."""

import math
from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.elements.section import timoshenko
from ancf2d.errors import ComputationError
from ancf2d.solvers.small_motions.lowest_modes import Pencil
from ancf2d.solvers.statics import buckling as buckling_module

E, L = 2e11, 1000.0
EULER = E / 12 * (math.pi / L) ** 2
SECTION, MATERIAL = {"height": 1.0, "width": 1.0}, {"E": E, "nu": 0.3}
TURN = {"interpolated": "ry_x", "theta": "theta", "tangent": "rx_y"}
PROPPED = (4.493409457909064 / math.pi) ** 2


def ends(name: str) -> dict[str, tuple[float, list[dict[str, Any]]]]:
    """Return (factor of Euler's load, supports) of the four columns."""
    clamp, roller = {"type": "clamp", "at": "c@0"}, {"type": "roller", "at": "c@1", "fixed": "y"}
    guide = {"type": "fix", "at": "c@1", "coordinates": ["y", TURN[h.TYPES[name].section_kind]]}
    return {"pinned": (1.0, [{"type": "pin", "at": "c@0"}, roller]), "cantilever": (0.25, [clamp]),
            "propped": (PROPPED, [clamp, roller]), "clamped": (4.0, [clamp, guide])}


def column(name: str, count: int, how: str, loads: list[dict[str, Any]] | None = None, angle: float = 0.0,
           modes: int = 2, formulation: str | None = None) -> h.Solution:
    push = [-EULER * math.cos(angle), -EULER * math.sin(angle)]
    body = h.body(h.line(L, angle), h.element(name, count, formulation), SECTION, MATERIAL)
    return h.solved({"c": body}, {"type": "buckling", "modes": modes}, bc=ends(name)[how][1],
                    loads=loads or [{"type": "force", "at": "c@1", "value": push}])


def factors(solution: h.Solution) -> list[float]:
    return solution.state.report["load_factors"]


@pytest.mark.parametrize("how", ["pinned", "cantilever", "propped", "clamped"])
@pytest.mark.parametrize(("name", "formulation"), [("reissner3", None), ("vallejo", "structural"),
                                                   ("vallejo", "enhanced"), ("cable", None)])
def test_slender_columns_buckle_at_eulers_loads(name, formulation, how):
    """L/h = 1000; the effect of shear, at most 1e-5, is included."""
    euler = ends(name)[how][0]
    shear = 0.0 if name == "cable" else euler * EULER / (timoshenko(0.3) * E / 2.6)
    found = factors(column(name, 64, how, formulation=formulation))[0]
    assert found == pytest.approx(euler * (1 - shear), rel=1e-5)


def test_shear_lowers_the_load_by_haringx_formula():
    """The geometrically exact beam: P (1 + P/kGA) = EI (pi/L)^2 (Haringx 1948), here with P/kGA = 0.17."""
    section = {"EA": 1e12, "kGA": 50.0, "EI": 10.0}
    body = h.body(h.line(math.pi), h.element("reissner3", 64), section)
    scene = {"bc": [{"type": "pin", "at": "c@0"}, {"type": "roller", "at": "c@1", "fixed": "y"}],
             "loads": [{"type": "force", "at": "c@1", "value": [-1.0, 0]}]}
    found = factors(h.solved({"c": body}, {"type": "buckling", "modes": 1}, **scene))
    assert found[0] * (1 + found[0] / 50.0) == pytest.approx(10.0, rel=1e-5)


def test_the_direction_of_the_column_does_not_matter():
    straight, inclined = (factors(column("vallejo", 16, "cantilever", angle=a)) for a in (0.0, 0.8))
    assert inclined == pytest.approx(straight, rel=1e-7)


def test_tension_does_not_buckle():
    solution = column("reissner3", 16, "pinned", [{"type": "force", "at": "c@1", "value": [EULER, 0]}])
    assert factors(solution) == []
    assert "do not buckle" in solution.state.warnings[-1]


def test_a_constant_tension_adds_to_the_load():
    loads = [{"type": "force", "at": "c@1", "value": [0.5 * EULER, 0], "amplitude": {"type": "constant"}},
             {"type": "force", "at": "c@1", "value": [-EULER, 0]}]
    assert factors(column("reissner3", 64, "pinned", loads))[0] == pytest.approx(1.5, rel=1e-5)


def test_shapes_are_those_of_the_column():
    solution = column("reissner3", 32, "pinned")
    mesh = solution.model.meshes["c"]
    y = np.array([0.0, *(mesh.plan.length * np.arange(1, 33) / 32)])
    for m, shape in enumerate(solution.state.arrays["modes/shapes"][0], start=1):
        w = shape[np.append(mesh.dofs[:, 1], mesh.dofs[-1, -2])]
        exact = np.sin(m * math.pi * y / L)
        assert abs(w @ exact) / np.linalg.norm(w) / np.linalg.norm(exact) == pytest.approx(1.0, abs=1e-8)


def test_the_tangent_of_the_loaded_state_is_singular_at_the_factor():
    solution = column("reissner3", 32, "propped", modes=1)
    factor, d = factors(solution)[0], solution.d
    model = solution.model
    negative = [Pencil(model, (1 + s) * factor * d, (1 + s) * factor, loads=True) for s in (-1e-4, 1e-4)]
    assert [p.negative(p.factor(0.0)) for p in negative] == [0, 1]


def test_the_linear_response_is_that_of_linear_statics():
    loads = [{"type": "force", "at": "c@1", "value": [-EULER, 10.0]}]
    solution = column("vallejo", 8, "cantilever", loads)
    linear = h.solved({"c": h.body(h.line(L), h.element("vallejo", 8), SECTION, MATERIAL)}, "linear_static",
                      bc=ends("vallejo")["cantilever"][1], loads=loads)
    np.testing.assert_allclose(solution.u("c@1"), linear.u("c@1"), rtol=1e-7)
    deflection = 10 * L**3 / (3 * E / 12) + 10 * L / (timoshenko(0.3) * E / 2.6)
    assert solution.u("c@1")[1] == pytest.approx(deflection, rel=1e-11)
    assert solution.reactions()["c@0"] == pytest.approx(linear.reactions()["c@0"], rel=1e-8, abs=1e-8 * EULER)


@pytest.mark.parametrize("dense", [1000, 0], ids=["dense", "arnoldi"])
def test_a_rotation_held_by_a_multiplier_gives_the_same_factor(monkeypatch, dense):
    monkeypatch.setattr(buckling_module, "DENSE", dense)
    body = {"c": h.body(h.line(L), h.element("vallejo", 24), SECTION, MATERIAL)}
    scene = {"loads": [{"type": "force", "at": "c@1", "value": [-EULER, 0]}]}
    solver = {"type": "buckling", "modes": 2}
    held = h.solved(body, solver, bc=[{"type": "clamp", "at": "c@0", "hold": "section"}], **scene)
    prescribed = {"type": "prescribed", "at": "c@0", "angle": 0}
    multiplied = h.solved(body, solver, bc=[{"type": "pin", "at": "c@0"}, prescribed], **scene)
    assert multiplied.model.numbering.n_multipliers == 1
    assert factors(multiplied) == pytest.approx(factors(held), rel=1e-6)


def test_sway_of_a_portal_frame():
    """Two clamped legs below a stiff beam sway at 2 EI (pi/L)^2: each leg is a guided column of length 2 L/2."""
    legs = {"EA": 1e9, "EI": 1.0, "kGA": 1e9}
    stiff = {"EA": 1e9, "EI": 1e6, "kGA": 1e9}
    bodies = {"a": h.body(h.line(1.0, math.pi / 2), h.element("reissner3", 24), legs),
              "b": h.body(h.line(1.0, math.pi / 2, (1.0, 0.0)), h.element("reissner3", 24), legs),
              "top": h.body(h.line(1.0, 0.0, (0.0, 1.0)), h.element("reissner3", 2), stiff)}
    found = factors(h.solved(
        bodies, {"type": "buckling", "modes": 1},
        bc=[{"type": "clamp", "at": "a@0"}, {"type": "clamp", "at": "b@0"}],
        joints=[{"type": "weld", "between": ["a@1", "top@0"]}, {"type": "weld", "between": ["b@1", "top@1"]}],
        loads=[{"type": "force", "at": p, "value": [0, -1.0]} for p in ("a@1", "b@1")]))
    assert found[0] == pytest.approx(math.pi**2, rel=1e-4)


def test_a_case_without_scaled_loads_says_so():
    with pytest.raises(ComputationError, match="no load scales"):
        column("reissner3", 4, "pinned", [{"type": "force", "at": "c@1", "value": [0, 0]}])


@pytest.mark.parametrize("density", [{}, {"rho": 7850.0}], ids=["no density", "steel"])
def test_mesh_artefacts_are_reported_with_and_without_density(density: dict[str, float]) -> None:
    thick = h.body(h.line(2.0), h.element("2d2n", 16), {"height": 0.4, "width": 0.1}, {"E": E, "nu": 0.3, **density})
    found = h.solved({"c": thick}, {"type": "buckling", "modes": 3}, bc=[{"type": "clamp", "at": "c@0"}],
                     loads=[{"type": "force", "at": "c@1", "value": [-1e6, 0.0]}])
    told = [w.split(" (")[0] for w in found.state.warnings if w.startswith("shape")]
    assert told == ["shape 3"]


@pytest.mark.parametrize("name", ["reissner3", "vallejo", "cable"])
def test_a_transversely_loaded_cantilever_has_no_load_factor(name):
    """Its nonlinear path is stable far beyond the 0.03 to 0.05 at which the linearised tangent becomes singular."""
    body = h.body(h.line(2.0), h.element(name, 8), {"height": 0.1, "width": 0.1}, {"E": 2.07e11, "nu": 0.3})
    scene = {"bc": [{"type": "clamp", "at": "c@0"}],
             "loads": [{"type": "force", "at": "c@1", "value": [0.0, -500e3]}]}
    linear = h.solved({"c": body}, {"type": "buckling"}, **scene)
    assert factors(linear) == []
    told = [w for w in linear.state.warnings if "before it buckles" in w]
    assert len(told) == 1
    assert "arc_length" in told[0]
    path = h.solved({"c": body}, "static", **scene)
    assert all(s.history["negative_pivots"] == 0 for s in path.states)


def test_a_slightly_bent_column_gives_no_warning_and_an_arch_is_called_an_estimate():
    body = h.body(h.line(4.0, math.pi / 2), h.element("reissner3", 8), {"height": 0.1, "width": 0.1}, MATERIAL)
    bc = [{"type": "pin", "at": "c@0"}, {"type": "roller", "at": "c@1", "fixed": "x"}]
    loads = [{"type": "force", "at": "c@1", "value": [0, -1e5]}, {"type": "distributed", "on": "c", "value": [1e2, 0]}]
    bent = h.solved({"c": body}, {"type": "buckling", "modes": 1}, bc=bc, loads=loads)
    assert factors(bent)[0] == pytest.approx(math.pi**2 * E * 0.1**4 / 12 / 16 / 1e5, rel=0.01)
    assert not bent.state.warnings
    arch = h.body({"type": "arc", "center": [0, 0], "radius": 41.8, "from": 1.69, "to": 1.45},
                  h.element("reissner3", 16), {"height": 0.1, "width": 0.1}, MATERIAL)
    shallow = h.solved({"c": arch}, {"type": "buckling", "modes": 1},
                       bc=[{"type": "pin", "at": "c@0"}, {"type": "pin", "at": "c@1"}],
                       loads=[{"type": "distributed", "on": "c", "value": [0, -1e3]}])
    assert any("estimates" in w for w in shallow.state.warnings)


def test_prestressed_springs_stress_the_model_at_load_factor_zero():
    """A column in tension P0 from a spring at its end: Euler's load plus P0, as in the equilibrium."""
    EA, EI, L, k, pull = 1e6, 1.0, 1.0, 1e3, 4e-3
    body = h.body(h.line(L), h.element("reissner3", 16), {"EA": EA, "kGA": EA, "EI": EI})
    spring = {"type": "translational", "between": ["c@1", [2.0, 0.0]], "stiffness": k, "length": 1.0 - pull}
    found = h.solved({"c": body}, {"type": "buckling", "modes": 1}, springs=[spring],
                     bc=[{"type": "pin", "at": "c@0"}, {"type": "roller", "at": "c@1", "fixed": "y"}],
                     loads=[{"type": "force", "at": "c@1", "value": [-1.0, 0.0]}])
    # the load is shared with the spring as their stiffnesses are; kGA = EA is Euler's column exactly
    P0, share = k * pull / (1 + k * L / EA), 1 / (1 + k * L / EA)
    assert factors(found)[0] == pytest.approx((math.pi**2 * EI / L**2 + P0) / share, rel=1e-4)


def pressed(ratio: float, count: int, solver: Any, strain: float) -> h.Solution:
    """Solve a bar of E = h = b = 1, of elements 2d2n with l/h = ``ratio``, under an axial force."""
    body = h.body(h.line(ratio * count), h.element("2d2n", count), {"height": 1, "width": 1}, {"E": 1.0, "nu": 0.3})
    return h.solved({"b": body}, solver, loads=[{"type": "force", "at": "b@1", "value": [-strain, 0]}],
                    bc=[{"type": "clamp", "at": "b@0", "hold": "breathe"},
                        {"type": "fix", "at": "b@1", "coordinates": ["y"]}])


def test_short_nonconforming_elements_separate_at_a_strain_of_their_own():
    """It falls with (l/h)^2 for any number of elements: a property of the equations, not of round-off."""
    strains = {(r, n): factors(pressed(r, n, {"type": "buckling", "modes": 1}, 1.0))[0] / r**2
               for r, n in ((0.1, 20), (0.1, 80), (0.01, 20))}
    assert list(strains.values()) == pytest.approx([1.12] * 3, rel=0.01)
    held, parted = (pressed(0.1, 20, {"type": "static", "steps": 4}, s) for s in (0.0105, 0.0125))
    said = [[w for s in sol.states for w in s.warnings if "short elements separate in b" in w]
            for sol in (held, parted)]
    assert [len(w) for w in said] == [0, 1]


@pytest.mark.parametrize("name", ["rigid", "vallejo", "cable", "reissner3"])
def test_a_moment_at_a_support_causes_only_its_reaction_moment(name):
    """The load factor scales moments too, and their reactions are like any others."""
    element = {"type": "rigid"} if name == "rigid" else h.element(name, 4)
    given = {"mass": 1.0, "inertia": 1.0} if name == "rigid" else {}
    bar = {"geometry": h.line(L), "element": {**element, **given}, "section": SECTION, "material": MATERIAL}
    held = {"type": "prescribed", "at": "c@0", "ux": 0.0, "uy": 0.0, "angle": 0.0}
    solution = h.solved({"c": bar}, "buckling", bc=[{"name": "wall", **held}],
                        loads=[{"type": "moment", "at": "c@0", "value": EULER},
                               {"type": "force", "at": "c@1", "value": [-EULER, 0.0]}])
    assert solution.reactions()["wall"] == pytest.approx({"fx": EULER, "fy": 0.0, "m": -EULER}, abs=1e-6 * EULER)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2])
def test_a_load_on_a_support_buckles_nothing(angle: float) -> None:
    """The answer does not depend on whether the response is zero or round-off."""
    found = h.solved({"c": h.body(h.line(1.0, angle), h.element("reissner3", 4))}, {"type": "buckling", "modes": 1},
                     bc=[{"type": "clamp", "at": "c@0"}], loads=[{"type": "force", "at": "c@0", "value": [3.0, 4.0]}])
    assert factors(found) == []
    assert any("do not buckle the model" in w for w in found.state.warnings)


@pytest.mark.parametrize("stiffness", [1e4, 100.0])
def test_a_tendon_to_its_base_buckles_a_column_as_it_is_wound_up(stiffness: float) -> None:
    """Winding acts on tendon and column in series; the column bears pi^2 EI/L^2 of a force towards its base.

    The elasticity of the factor is the tendon's share of the compliance. The tendon hangs loose below the factor 0.
    """
    body = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": {"type": "cable", "count": 8},
            "section": {"EA": 2e5, "EI": 5 / 3}}
    slack = 10.0 / stiffness
    case = {"bodies": {"c": body}, "boundary_conditions": [{"type": "clamp", "at": "c@0"}],
            "loads": [{"type": "tendon", "through": ["c@1", [0, 0]], "stiffness": stiffness, "slack": -slack}],
            "solver": {"type": "buckling", "modes": 1}, "goal": {"load_factor": 1}}
    tension = slack / (1 / stiffness + 1 / 2e5)
    found = ancf2d.sensitivity(case, ["loads.0.stiffness"])
    assert found.goal == pytest.approx(math.pi**2 * 5 / 3 / tension, rel=3e-4)
    assert found.rows[0].elasticity == pytest.approx(-tension / slack / stiffness, rel=1e-3)


def test_one_sided_springs_at_their_limit_act_if_the_load_strains_them_or_are_refused() -> None:
    def pushed(between: list[Any], **only: Any) -> float:
        spring = {"type": "translational", "between": between, "stiffness": 0.5 * E / L, **only}
        support = ends("reissner3")["pinned"][1]
        return factors(h.solved({"c": h.body(h.line(L), h.element("reissner3", 6), SECTION, MATERIAL)},
                                {"type": "buckling", "modes": 1}, bc=support, springs=[spring],
                                loads=[{"type": "force", "at": "c@1", "value": [-EULER, 0]}]))[0]
    end, beside = ["c@1", [2 * L, 0]], ["c@0.5", [0.5 * L, L]]
    # forward and central differences, over strains of 1e-3, whose fourth power they miss
    assert pushed(end, only="tension") == pytest.approx(pushed(end), rel=1e-10)
    for between, only in ((end, "compression"), (beside, "tension"), (beside, "compression")):
        with pytest.raises(ComputationError, match=r"springs\.0 acts on one side alone"):
            pushed(between, only=only)


def with_stop(gap: float, direction: float, stiffness: float, clamped: bool, **only: Any) -> h.Solution:
    """A column below its buckling load, with a stop at the tip that engages at a share of its shortening."""
    shortening = EULER * L / E
    aim = [L + math.cos(direction), math.sin(direction)]
    stop = {"type": "translational", "between": ["c@1", aim], "stiffness": stiffness * E / L,
            "gap": gap * shortening * math.cos(direction), **only}
    support = [{"type": "clamp", "at": "c@0"}] if clamped else ends("reissner3")["pinned"][1]
    return h.solved({"c": h.body(h.line(L), h.element("reissner3", 6), SECTION, MATERIAL)},
                    {"type": "buckling", "modes": 1}, bc=support, springs=[stop] if stiffness else [],
                    loads=[{"type": "force", "at": "c@1", "value": [-EULER, 0]}])


@pytest.mark.parametrize("only", [{}, {"only": "tension"}, {"only": "compression"}], ids=["both", "tension", "other"])
@pytest.mark.parametrize("gap", [0.3, 1.5])
def test_stops_that_close_later_do_not_change_the_load_factor(gap: float, only: dict[str, str]) -> None:
    """The free end of a cantilever bears 1/4; an oblique stop that closes later does not act before.

    Nor does it act within the difference of states that gives the change of stiffness: their strains differ by 6e-8,
    and the round-off of the tangent of a column this slender is 1e-7.
    """
    free, beside = (factors(with_stop(gap, 0.8, stiffness, True, **only)) for stiffness in (0.0, 0.1))
    assert beside == pytest.approx(free, rel=1e-6)


def test_stops_that_engage_below_the_buckling_load_are_reported() -> None:
    for stiffness, told in ((1e-3, None), (0.2, "only estimates"), (5.0, "does not apply at")):
        found = with_stop(0.5, 0.0, stiffness, False)
        assert len(factors(found)) == (told != "does not apply at")
        said = [w for w in found.state.warnings if "springs.0 begins or ceases to act before the structure" in w]
        assert [told in w for w in said] == [True] * (told is not None)


def test_loads_that_stress_no_flexible_body_have_no_factors() -> None:
    """A rigid lever on a spring rotates a little; the beams next to it are unloaded, whatever round-off says."""
    beam = {"section": {"height": 0.2, "width": 0.4}, "material": {"E": 1.8e7, "nu": 0.0}}
    found = ancf2d.solve({
        "bodies": {
            "lever": {"geometry": {"type": "line", "start": [1.0, -0.2], "end": [4.3, -7.7]}, "element": "rigid"},
            "bent": {"geometry": {"type": "polyline", "points": [[2, 4.4], [4.5, 4.4], [6.3, 5.3]]}, **beam,
                     "element": {"type": "ancf", "order": [2, 2], "count": 4, "formulation": "enhanced"}},
            "short": {"geometry": {"type": "line", "start": [1.8, -4.2], "end": [-0.6, -5.5]}, **beam,
                      "element": h.element("cable", 1)}},
        "boundary_conditions": [{"type": "pin", "at": "lever@1"}, {"type": "clamp", "at": "bent@0"},
                                {"type": "clamp", "at": "short@1"}],
        "springs": [{"type": "translational", "between": ["lever@0", [4.3, 1.2]], "stiffness": 200}],
        "loads": [{"type": "moment", "at": "lever@1", "value": -460}],
        "solver": {"type": "buckling", "modes": 3}}, states=False)
    assert found.summary["load_factors"] == []
