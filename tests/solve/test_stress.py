"""Fields over the bodies compared with statics by hand, each formulation by its own law, energy with the solver's."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest

from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.errors import CaseError
from ancf2d.model.model import Model
from ancf2d.solvers.fields import FIELDS, FieldReader
from ancf2d.solvers.section_forces import SectionForces
from ancf2d.solvers.state import State
from ancf2d.study.run import prepare

L, H, B, F = 2.0, 0.1, 0.2, -3000.0
A, I, E, NU = H * B, B * H**3 / 12, 2e11, 0.3
SECTION, STEEL = {"height": H, "width": B}, {"E": E, "nu": NU, "rho": 1000}
EVERY = {"fields": [name for name, field in FIELDS.items() if not field.kept]}
AXIS_TYPES = ["cable", "reissner2", "reissner3", "structural"]
CONTINUA = [("vallejo", "enhanced"), ("omar", "strain_split"), ("patel", "continuum"), ("ancf[3,3]", "continuum")]


def spec(name: str, count: int) -> dict:
    return h.element("omar", count, name) if name in FORMULATIONS and name == "structural" else h.element(name, count)


def cantilever(element: dict, solver: str = "linear_static", angle: float = 0.0, **scene) -> tuple[Model, State]:
    beam = {"beam": h.body(h.line(L, angle), element, SECTION, STEEL)}
    force = [F * -np.sin(angle), F * np.cos(angle)]
    scene.setdefault("loads", [{"type": "force", "at": "beam@1", "value": force, "spread": "parabolic"}])
    out = h.solved(beam, solver, bc=[{"name": "wall", "type": "clamp", "at": "beam@0", "hold": "section"}],
                   output=EVERY, **scene)
    return out.model, out.state


def fields(model: Model, state: State) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return the fields, and x (ne, nx, 1) and y (ny,) of their stations."""
    reader = FieldReader(model)
    (body,) = reader.bodies
    ne = len(model.meshes["beam"].dofs)
    x = (np.arange(ne)[:, None] + body.xi)[..., None] * L / ne
    return {name: v for (_, name), v in reader.read(state).items()}, x, 0.5 * H * body.eta


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("name", AXIS_TYPES)
def test_recovered_stress_of_a_cantilever(name: str, angle: float) -> None:
    """M = F (L - x), Q = F; sigma = -M y/I, tau = 3 Q/(2 A) (1 - (2 y/h)^2)."""
    found, x, y = fields(*cantilever(spec(name, 4), angle=angle))
    M = F * (L - x)
    scale = abs(F) * L * H / 2 / I
    assert abs(found["N"]).max() < 1e-6 * abs(F)
    np.testing.assert_allclose(found["Q"], F, rtol=1e-7)
    np.testing.assert_allclose(found["M"][..., 0], M, atol=1e-7 * abs(F) * L)
    np.testing.assert_allclose(found["stress"][..., 0], -M * y / I, atol=1e-7 * scale)
    parabola = 1.5 * F / A * (1 - (2 * y / H) ** 2)
    np.testing.assert_allclose(found["stress"][..., 2], np.broadcast_to(parabola, found["stress"].shape[:3]),
                               atol=1e-7 * abs(F) / A)
    np.testing.assert_allclose(found["strain"][..., 1], -NU * found["stress"][..., 0] / E, atol=1e-12 * scale / E)


@pytest.mark.parametrize(("name", "formulation"), [*CONTINUA[:3], ("2d3n-nu", "continuum"), ("li", "enhanced")])
def test_own_stress_of_a_cantilever(name: str, formulation: str) -> None:
    """The law of the element gives sigma = -M y/I on a fine mesh, and Q as the sum of its shear stress."""
    found, x, y = fields(*cantilever(h.element(name, 8, formulation)))
    middle, scale = slice(2, 6), abs(F) * L * H / 2 / I
    np.testing.assert_allclose(found["stress"][middle, ..., 0], (-F * (L - x) * y / I)[middle], atol=0.09 * scale)
    np.testing.assert_allclose(found["stress"][middle, 2, ..., 0], (-F * (L - x) * y / I)[middle, 2], atol=0.01 * scale)
    sums = found["stress"][middle, ..., 2] @ np.array([7, 32, 12, 32, 7]) / 90
    np.testing.assert_allclose(sums, F / A, rtol=1e-3)


def test_a_cubic_section_has_the_parabola_of_shear_by_its_own_law() -> None:
    found, _, y = fields(*cantilever(h.element("ancf[3,3]", 40)))
    expected = 1.5 * F / A * (1 - (2 * y / H) ** 2)
    np.testing.assert_allclose(found["stress"][15:25, 2, :, 2], np.tile(expected, (10, 1)), atol=0.03 * abs(F) / A)


def simpson(model: Model, values: np.ndarray) -> float:
    """Integrate (ne, 5, ny, 1) over the straight body by closed Newton-Cotes rules."""
    boole = np.array([7, 32, 12, 32, 7]) / 90
    ne, ny = len(values), values.shape[2]
    y = np.linspace(-1, 1, ny)
    moments = [(1 - (-1) ** (k + 1)) / (2 * (k + 1)) for k in range(ny)]
    across = np.linalg.solve(np.vander(y, increasing=True).T, moments)
    return float(np.einsum("exy,x,y->", values[..., 0], boole, across)) * A * L / ne


@pytest.mark.parametrize(("name", "formulation"), CONTINUA[:3])
def test_energy_density_sums_to_the_strain_energy(name: str, formulation: str) -> None:
    model, state = cantilever(h.element(name, 3, formulation, quadrature="exact"))
    found, _, _ = fields(model, state)
    assert simpson(model, found["energy"]) == pytest.approx(0.5 * state.Q @ state.d, rel=1e-9)


@pytest.mark.parametrize(("name", "shears"), [("cable", 0.0), ("reissner3", 1.0)])
def test_recovered_energy_density_is_that_of_the_sections_stiffnesses(name: str, shears: float) -> None:
    """F^2 L^3/(6 EI) + F^2 L/(2 kGA), the latter where the section shears."""
    model, state = cantilever(h.element(name, 3))
    section = model.meshes["beam"].plan.section
    expected = F**2 * L**3 / (6 * E * I) + shears * F**2 * L / (2 * section.kGA)
    assert simpson(model, fields(model, state)[0]["energy"]) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(("name", "formulation"), [*CONTINUA, ("reissner3", None), ("cable", None)])
def test_a_large_rotation_makes_no_stress_and_a_stretch_the_same_in_any_direction(name, formulation) -> None:
    model = h.build({"beam": h.body(h.line(L), h.element(name, 2, formulation), SECTION, STEEL)}, "static",
                    bc=[{"type": "clamp", "at": "beam@0"}], output=EVERY)
    turned = np.zeros(len(model.numbering.place))
    turned[:model.n_q] = h.rotate(np.zeros(model.n_q), model, 2.1)
    state = State(0.0, turned, turned, turned, 0.0)
    found, _, _ = fields(model, state)
    assert abs(found["stress"]).max() < 1e-9 * E
    pulled = cantilever(h.element(name, 2, formulation), "static",
                        loads=[{"type": "force", "at": "beam@1", "value": [1e5, 0], "spread": "uniform"}])
    stretched, _, _ = fields(*pulled)
    np.testing.assert_allclose(stretched["stress"][1, 2, :, 0], 1e5 / A, rtol=8e-2)
    np.testing.assert_allclose(stretched["N"][1], 1e5, rtol=1e-6)


def test_damping_adds_its_stress() -> None:
    """A bar at rest with a rate of strain: sigma = tau E rate, with the lateral rate free."""
    model = h.build({"beam": h.body(h.line(L), h.element("vallejo", 2), SECTION,
                                    {**STEEL, "damping": {"kelvin_voigt": 1e-3}})},
                    {"type": "dynamic", "t_end": 1, "dt": 0.1}, output=EVERY)
    from ancf2d.model.rotation import CoordinateKinds

    zero, v = np.zeros(model.n_q), np.zeros(model.n_q)
    x = CoordinateKinds(model.meshes.values()).x
    v[x], v[x + 1] = 1e-2 * model.e0[x], -NU * 1e-2 * model.e0[x + 1]
    found, _, _ = fields(model, State(0.0, zero, zero, zero, 0.0, v=v, a=zero))
    np.testing.assert_allclose(found["stress"][..., 0], 1e-3 * E * 1e-2, rtol=1e-9)
    assert abs(found["energy"]).max() == 0.0


def test_stations_of_a_whole_body_agree_with_single_points() -> None:
    arc = h.body(h.ARC, h.element("reissner3", 5), SECTION, STEEL)
    out = h.solved({"b": arc}, "static", bc=[{"type": "clamp", "at": "b@0"}],
                   loads=[{"type": "distributed", "on": "b", "value": [50.0, -3000.0], "from": 0.13, "to": 0.77,
                           "follower": True}, {"type": "gravity", "value": [0, -10]}])
    xi = np.array([0.1, 0.9])
    whole = SectionForces(out.model, out.model.meshes["b"], xi)(out.state)
    for ie in range(5):
        for k in range(2):
            point = out.point(f"b@{(ie + xi[k]) / 5}")
            found = h.section_forces(out.model, out.state, point)
            np.testing.assert_allclose(found, whole[ie, k], rtol=1e-9, atol=1e-9)


def test_section_forces_jump_by_a_force_on_a_middle_node() -> None:
    """Within a three-node element Q jumps at its middle node by the force there."""
    out = h.solved({"b": h.body(h.line(L), h.element("reissner3", 1), SECTION, STEEL)}, "linear_static",
                   bc=[{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}],
                   loads=[{"type": "force", "at": "b@0.5", "value": [0, -100]}])
    forces = SectionForces(out.model, out.model.meshes["b"], np.array([0.25, 0.75]))(out.state)[0]
    np.testing.assert_allclose(forces[:, 1], [-50, 50], rtol=1e-9)
    np.testing.assert_allclose(forces[:, 2], [25, 25], rtol=1e-9)


def test_every_formulation_of_a_body_with_a_continuous_section_has_its_law() -> None:
    for formulation in FORMULATIONS.values():
        assert (formulation.stress is not None) == (formulation.law is FORMULATIONS["continuum"].law)


def test_stress_of_a_section_given_by_stiffnesses_is_refused_at_its_line() -> None:
    body = h.body(h.line(L), h.element("reissner2", 2), {"EA": 1e6, "kGA": 1e5, "EI": 10.0})
    loaded = h.load({"b": body}, "linear_static", bc=[{"type": "clamp", "at": "b@0"}],
                    output={"fields": ["M", "stress"]})
    with pytest.raises(CaseError) as caught:
        prepare(loaded)
    (problem,) = caught.value.problems
    assert problem.path == ("output", "fields", 1)
    assert "body 'b' is given only by its stiffnesses" in problem.message


@pytest.mark.parametrize("name", ["vallejo", "omar", "patel"])
def test_strain_is_green_lagranges_of_the_gradients_in_any_state(name: str) -> None:
    """eps = (F^T F - 1)/2 with F = (r_x, r_y), shear as r_x . r_y, in the axes of a turned reference."""
    angle = 0.6
    model = h.build({"beam": h.body(h.line(L, angle), h.element(name, 1, quadrature="exact"), SECTION, STEEL)},
                    "static", bc=[{"type": "clamp", "at": "beam@0"}], output=EVERY)
    d = h.random_state(model, 0.3)
    found, _, _ = fields(model, State(0.0, d, d, d, 0.0))
    (body,), mesh = FieldReader(model).bodies, model.meshes["beam"]
    xi, eta = np.repeat(body.xi, len(body.eta)), np.tile(body.eta, len(body.xi))
    e = (model.e0 + d[:model.n_q])[mesh.dofs[0]].reshape(-1, 2)
    rx, ry = (mesh.classes[0].shape(xi, eta, i, j) @ e for i, j in ((1, 0), (0, 1)))
    expected = np.stack([0.5 * (np.sum(rx * rx, 1) - 1), 0.5 * (np.sum(ry * ry, 1) - 1), np.sum(rx * ry, 1)], axis=1)
    np.testing.assert_allclose(found["strain"][0].reshape(-1, 3), expected, atol=1e-9)
