"""Patch tests: states of constant strain are exact on unequal elements, for any type."""

import helpers
import numpy as np
import pytest

H, B, E, NU = 0.2, 0.1, 2.0e6, 0.3
SECTION, MATERIAL = {"height": H, "width": B}, {"E": E, "nu": NU, "rho": 1.0}
A, I = H * B, B * H**3 / 12
# corners without a turn: four pieces of unequal length
BREAKS = [0.0, 0.3, 0.75, 1.0, 2.0]
VARIANTS = helpers.SMALL_VARIANTS


def unequal(angle: float = 0.0) -> dict:
    c, s = np.cos(angle), np.sin(angle)
    return {"type": "polyline", "points": [[c * x, s * x] for x in BREAKS]}


def beam(name: str, formulation: str, geometry: dict, count: int = 6, nu: float = NU, **more):
    return {
        "beam": helpers.body(
            geometry, helpers.element(name, count, formulation, **more), SECTION, {**MATERIAL, "nu": nu}
        )
    }


def cantilever(name: str, formulation: str, loads: list, angle: float = 0.0, nu: float = NU, **more):
    return helpers.solved(
        beam(name, formulation, unequal(angle), nu=nu, **more),
        "linear_static",
        bc=[{"name": "wall", "type": "clamp", "at": "beam@0", "hold": wall(name)}],
        loads=loads,
    )


def wall(name: str) -> str:
    return "breathe" if helpers.TYPES[name].section_kind == "interpolated" else "section"


@pytest.mark.parametrize("angle", [0.0, 0.6])
@helpers.every_small_variant
def test_tension_is_exact_on_unequal_elements(name, formulation, angle):
    """u = F x/(EA) everywhere: with the section free to contract, also under Poisson coupling."""
    # the faces of nonconforming neighbours part by y^2, and a constant stress does work on the gap; the end is exact
    between = 5e-3 if helpers.TYPES[name].common_coefficients else 1e-11
    F = 10.0
    out = cantilever(name, formulation, helpers.tip(F * np.cos(angle), F * np.sin(angle), spread="uniform"), angle)
    for s in (0.1, 0.37, 0.5, 0.8, 1.0):
        np.testing.assert_allclose(
            out.u(f"beam@{s}"),
            F * 2 * s / (E * A) * np.array([np.cos(angle), np.sin(angle)]),
            rtol=0,
            atol=(1e-11 if s == 1 else between) * F * 2 / (E * A),
        )


BENDS = [
    v
    for v in VARIANTS
    if helpers.TYPES[v[0]].degree_x >= 2
    and v[0] not in ("patel", "2d2n", "2d3n")
    and v[1] not in ("continuum", "enhanced", "strain_split")
]


@pytest.mark.parametrize(("name", "formulation"), helpers.chosen(BENDS, helpers.FEW_VARIANTS))
def test_pure_bending_is_exact_on_unequal_elements(name, formulation):
    M = 0.3
    out = cantilever(name, formulation, [{"type": "moment", "at": "beam@1", "value": M}])
    for s in (0.15, 0.5, 1.0):
        x = 2 * s
        np.testing.assert_allclose(out.u(f"beam@{s}"), [0, M * x**2 / (2 * E * I)], atol=1e-9 * M * 2 / (E * I))
        assert out.theta(f"beam@{s}") == pytest.approx(M * x / (E * I), rel=1e-9)


@pytest.mark.parametrize("formulation", ["enhanced", "strain_split", "continuum"])
@pytest.mark.parametrize("name", ["vallejo", "omar", "li", "ancf[3,1]"])
def test_pure_bending_of_straight_sections_is_exact_without_poisson_coupling(name, formulation):
    M = 0.3
    rule = [2, 2] if name == "vallejo" else [helpers.TYPES[name].degree_x, helpers.TYPES[name].degree_y + 1]
    out = cantilever(name, formulation, [{"type": "moment", "at": "beam@1", "value": M}], nu=0.0, quadrature=rule)
    for s in (0.15, 0.5, 1.0):
        x = 2 * s
        np.testing.assert_allclose(out.u(f"beam@{s}"), [0, M * x**2 / (2 * E * I)], atol=1e-9 * M * 2 / (E * I))


def test_pure_bending_with_poisson_coupling_is_exact_for_the_consistent_coefficient():
    """u = (-kappa x y, kappa (x^2 + nu y^2)/2) is only in the space of 2d3n-nu: 2d3n itself has an error."""
    M = 0.3
    loads = [{"type": "moment", "at": "beam@1", "value": M}]
    exact = M * 4 / (2 * E * I)

    def error(name: str) -> float:
        # the wall holds the mean of the section, which the bent section leaves
        out = cantilever(name, "continuum", loads)
        return abs((out.u("beam@1") - out.u("beam@0"))[1] / exact - 1)

    assert error("2d3n-nu") < 1e-9
    assert error("2d3n") > 1e-3
    assert error("vallejo") > 0.05


@pytest.mark.parametrize("name", ["vallejo", "ancf[3,1]", "reissner3"])
@pytest.mark.parametrize("formulation", ["continuum", "enhanced", "strain_split", "structural", "geometrically_exact"])
def test_settlement_of_a_fixed_beam_is_timoshenkos(name, formulation):
    """Both ends fixed upright, one lowered: 12 EI/(L^3 (1 + phi)) with phi = 12 EI/(k GA L^2) if there is shear."""
    if (name, formulation) not in VARIANTS:
        pytest.skip(f"{name} has no such formulation")
    drop, k = 1e-4, 0.8
    more = {"quadrature": [2, 2]} if name == "vallejo" else {}
    bodies = beam(name, formulation, unequal(), nu=0.0, shear_factor=k, **more)
    bc = [
        {"name": "wall", "type": "clamp", "at": "beam@0", "hold": "section"},
        {"name": "end", "type": "prescribed", "at": "beam@1", "uy": -drop, "ux": 0.0, "angle": 0.0},
    ]
    out = helpers.solved(bodies, "linear_static", bc=bc)
    phi = 12 * E * I / (k * E / 2 * A * 4)
    force = 12 * E * I / (8 * (1 + phi)) * drop
    r = out.reactions()
    assert r["end"]["fy"] == pytest.approx(-force, rel=1e-9)
    assert r["wall"]["fy"] == pytest.approx(force, rel=1e-9)
    assert r["end"]["m"] == pytest.approx(force, rel=1e-9)
    assert r["wall"]["m"] == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize("name", helpers.KINDS.values())
def test_the_energy_of_linear_statics_is_half_the_work_of_the_loads(name):
    """Clapeyron's theorem."""
    force = np.array([3.0, -2.0])
    out = cantilever(name, helpers.TYPES[name].formulation, helpers.tip(*force), 0.6)
    assert out.state.energy == pytest.approx(0.5 * force @ out.u("beam@1"), rel=1e-9)


@helpers.every_small_variant
def test_linear_reactions_balance_loads_and_their_moment(name, formulation):
    loads = [
        {"type": "force", "at": "beam@0.83", "value": [3.0, -2.0]},
        {"type": "distributed", "on": "beam", "value": [0.4, -1.0], "from": 0.25, "to": 0.5},
        {"type": "moment", "at": "beam@1", "value": 0.7},
    ]
    angle = 0.6
    out = cantilever(name, formulation, loads, angle)
    wall = out.reactions()["wall"]
    assert wall["fx"] == pytest.approx(-3.0 - 0.4 * 0.5, rel=1e-9)
    assert wall["fy"] == pytest.approx(2.0 + 1.0 * 0.5, rel=1e-9)
    c, s = np.cos(angle), np.sin(angle)
    moment = 1.66 * (c * -2.0 - s * 3.0) + 0.75 * (c * -0.5 - s * 0.2) + 0.7
    assert wall["m"] == pytest.approx(-moment, rel=1e-9)
