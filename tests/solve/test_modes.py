"""Modes: mass and products, completeness, rigid and hidden modes, constraints, prestress, fine meshes."""

import math
from typing import Any

import helpers as h
import numpy as np
import pytest
import scipy.linalg

from ancf2d.kernels.matrices.matrix import band_product
from ancf2d.model.determinacy import rigid_motion
from ancf2d.solvers.small_motions import lowest_modes as lowest_module
from ancf2d.solvers.small_motions.lowest_modes import Pencil, lowest
from ancf2d.study.run import prepare

THICK = {"height": 0.4, "width": 0.4}
SOFT = {"E": 1e9, "nu": 0.3, "rho": 7850}
PINNED = [{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}]


def beam(spec: dict[str, Any], angle: float = 0.0, **more: Any) -> dict[str, Any]:
    return h.body(h.line(2.0, angle), spec, more.get("section", THICK), more.get("material", SOFT))


def frequencies(bodies: dict[str, Any], modes: int = 8, about: str = "reference", **scene: Any) -> list[dict[str, Any]]:
    solver = {"type": "eigen", "modes": modes, "about": about}
    return h.solved(bodies, solver, **scene).state.report["frequencies"]


def pencil_of(model: Any) -> Pencil:
    return Pencil(model, np.zeros(len(model.numbering.place)), 0.0, loads=False).with_mass()


def star(count: int) -> dict[str, Any]:
    """Return many bars that end at one point: a branched frame, so that the tangent is stored as fronts."""
    spec = h.element("reissner2", 6)
    bodies = {f"m{k}": h.body(h.line(1.0 + 0.01 * k, 0.7 * k), spec, h.SECTION) for k in range(count)}
    joint = {"type": "weld", "between": [f"m{k}@0" for k in range(count)]}
    bc = [{"type": "pin", "at": f"m{k}@1"} for k in range(count)]
    return {"bodies": bodies, "joints": [joint], "bc": bc}


@pytest.mark.parametrize("solver_scene", [
    ({"b": beam(h.element("vallejo", 3))}, {}), (star(30)["bodies"], {k: star(30)[k] for k in ("joints",)})],
    ids=["band", "compressed rows"])
def test_mass_of_a_translation_is_the_total_mass(solver_scene):
    bodies, scene = solver_scene
    name = next(iter(bodies))
    model = h.build(bodies, "eigen", masses=[{"at": f"{name}@0.3", "mass": 11.0, "inertia": 2.0}], **scene)
    pencil = pencil_of(model)
    total = 11.0 + sum(m.plan.section.rhoA * m.plan.length for m in model.meshes.values())
    for k in (0, 1):
        v = np.concatenate([rigid_motion(m, m.first_dof + np.arange(m.n_dofs), model.e0, np.zeros(2))[:, k]
                            for m in model.meshes.values()])[model.numbering.free]
        assert v @ pencil.apply_B(v) == pytest.approx(total, rel=1e-12)


def test_band_product_is_the_matrix_product():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((9, 4))
    for i in range(4):
        A[i, :3 - i] = 0.0
    full = np.array([[A[max(i, j), 3 - abs(i - j)] if abs(i - j) <= 3 else 0.0 for j in range(9)] for i in range(9)])
    x, y = rng.standard_normal(9), np.empty(9)
    band_product(A, x, y)
    np.testing.assert_allclose(y, full @ x, rtol=1e-13, atol=1e-13)


@h.every_small_variant
def test_stiffness_by_strains_is_the_tangent_at_any_state(name, formulation):
    model = h.build({"b": h.body(h.ARC, h.element(name, 2, formulation))}, "eigen", bc=[{"type": "pin", "at": "b@0"}])
    d, x = h.random_state(model, 0.02), np.random.default_rng(2).standard_normal(model.numbering.n_unknowns)
    num = model.numbering
    num.expand(d[num.free], d)
    pencil = Pencil(model, d, 0.0, loads=False)
    size = np.abs(pencil.K).max() * np.abs(x).max()
    np.testing.assert_allclose(pencil.stiffness(x), pencil.apply_K(x), rtol=1e-9, atol=1e-11 * size)


def test_lanczos_agrees_with_a_dense_solver(monkeypatch):
    model = h.build({"b": beam(h.element("reissner3", 20))}, "eigen", bc=PINNED)
    monkeypatch.setattr(lowest_module, "DENSE", 0)
    pencil = pencil_of(model)
    K, M = (h.dense(type(pencil.matrix.target)(values), pencil.n) for values in (pencil.K, pencil.B))
    modes = lowest(pencil, 12)
    assert modes.counted
    np.testing.assert_allclose(modes.values, scipy.linalg.eigh(K, M, eigvals_only=True)[:12], rtol=1e-8)


def test_every_copy_of_a_multiple_frequency_is_found(monkeypatch):
    monkeypatch.setattr(lowest_module, "DENSE", 0)
    bodies = {f"b{k}": h.body(h.line(2.0, 0.3 * k), h.element("reissner3", 30), THICK, SOFT) for k in range(5)}
    found = frequencies(bodies, 15, bc=[{"type": "clamp", "at": f"b{k}@0"} for k in range(5)])
    omega = np.array([f["omega"] for f in found]).reshape(3, 5)
    np.testing.assert_allclose(omega, np.repeat(omega[:, :1], 5, axis=1), rtol=1e-9)
    assert omega[0, 0] < 0.9 * omega[1, 0] < 0.81 * omega[2, 0]


def test_modes_that_lanczos_misses_are_counted_and_found(monkeypatch):
    monkeypatch.setattr(lowest_module, "DENSE", 0)
    whole = lowest_module._lanczos
    missed = []

    def misses_one(pencil, shift, m, found, seed):
        values, V = whole(pencil, shift, m, found, seed)
        if len(found) == 0:
            missed.append(values[2])
            values, V = np.delete(values, 2), np.delete(V, 2, axis=0)
        return values, V

    monkeypatch.setattr(lowest_module, "_lanczos", misses_one)
    modes = lowest(pencil_of(h.build({"b": beam(h.element("reissner3", 40))}, "eigen", bc=PINNED)), 8)
    assert modes.counted
    assert modes.values[2] == pytest.approx(missed[0], rel=1e-9)


def test_a_branched_frame_has_the_modes_of_its_dense_matrices():
    scene = star(30)
    model = h.build(scene["bodies"], "eigen", joints=scene["joints"], bc=scene["bc"])
    pencil = pencil_of(model)
    assert type(pencil.matrix).__name__ == "SymmetricFronts"
    K, M = (np.column_stack([f(column) for column in np.eye(pencil.n)]) for f in (pencil.apply_K, pencil.apply_B))
    np.testing.assert_allclose(lowest(pencil, 10).values, scipy.linalg.eigh(K, M, eigvals_only=True)[:10], rtol=1e-8)


@pytest.mark.parametrize("count", [4, 150], ids=["dense", "lanczos"])
@pytest.mark.parametrize("name", ["omar", "vallejo", "2d3n", "patel", "cable", "reissner2"])
def test_a_free_body_has_three_rigid_modes(name, count):
    found = frequencies({"b": beam(h.element(name, count), 0.4)}, 5)
    assert [f["kind"] for f in found[:3]] == ["rigid"] * 3
    assert [f["omega"] for f in found[:3]] == [0.0, 0.0, 0.0]
    assert found[3]["kind"] != "rigid"
    assert found[3]["omega"] > 1.0


def test_two_free_bodies_with_a_pin_have_four_rigid_modes():
    bodies = {"a": h.body(h.line(2.0), h.element("vallejo", 4), THICK, SOFT),
              "b": h.body(h.line(1.5, 1.0, (2.0, 0.0)), h.element("reissner3", 4), THICK, SOFT)}
    found = frequencies(bodies, 6, joints=[{"type": "pin", "between": ["a@1", "b@0"]}])
    assert [f["kind"] for f in found].count("rigid") == 4
    assert all(f["omega"] > 0 for f in found[4:])


def test_a_stiff_body_on_soft_springs_is_not_called_rigid():
    springs = [{"type": "translational", "between": ["b@0.5", p], "stiffness": 10.0} for p in ([1.0, 1.0], [2.0, 0.0])]
    springs.append({"type": "rotational", "between": ["b@0.5", [1.0, 0.0]], "stiffness": 10.0})
    found = frequencies({"b": beam(h.element("vallejo", 4))}, 3, springs=springs)
    m = 7850 * 0.16 * 2
    J = m * 4 / 12 + 7850 * 0.4**4 / 12 * 2
    known = sorted([math.sqrt(10 / m), math.sqrt(10 / m), math.sqrt(10 / J)])
    assert [f["omega"] for f in found] == pytest.approx(known, rel=1e-6)
    assert "rigid" not in [f["kind"] for f in found]


def test_hidden_zero_energy_modes_are_spurious_with_frequency_zero():
    found = frequencies({"b": beam(h.element("omar", 8, "continuum", quadrature=[2, 2]))}, 4, bc=PINNED)
    assert [(f["kind"], f["omega"]) for f in found[:2]] == [("spurious", 0.0)] * 2
    assert found[2]["kind"] == "bending"


@pytest.mark.parametrize("count", [6, 80], ids=["dense", "lanczos"])
def test_a_rotation_fixed_by_a_multiplier_agrees_with_one_fixed_by_a_row(count):
    bodies = {"b": beam(h.element("vallejo", count), 0.3)}
    held = frequencies(bodies, bc=[{"type": "clamp", "at": "b@0", "hold": "section"}])
    multiplied = frequencies(bodies, bc=[{"type": "pin", "at": "b@0"}, {"type": "prescribed", "at": "b@0", "angle": 0}])
    assert h.build(bodies, "eigen", bc=[{"type": "prescribed", "at": "b@0", "angle": 0}]).numbering.n_multipliers == 1
    assert [f["omega"] for f in multiplied] == pytest.approx([f["omega"] for f in held], rel=1e-9)
    assert [f["kind"] for f in multiplied] == [f["kind"] for f in held]


def test_a_heavy_tip_mass_on_a_light_cantilever():
    section = {"EA": 1e6, "kGA": 1e6, "EI": 20.0, "rhoA": 1e-6, "rhoI": 1e-9}
    body = {"b": h.body(h.line(2.0), h.element("reissner3", 8), section)}
    found = frequencies(body, 1, bc=[{"type": "clamp", "at": "b@0"}], masses=[{"at": "b@1", "mass": 5.0}])
    flexibility = 2.0**3 / (3 * 20.0) + 2.0 / 1e6
    assert found[0]["omega"] == pytest.approx(1 / math.sqrt(5.0 * flexibility), rel=1e-6)
    assert found[0]["kind"] == "bending"


def test_rotary_inertia_of_a_point_mass():
    section = {"EA": 1e6, "kGA": 1e6, "EI": 20.0, "rhoA": 1e-6, "rhoI": 1e-9}
    body = {"b": h.body(h.line(2.0), h.element("reissner3", 8), section)}
    found = frequencies(body, 1, bc=[*({"type": "pin", "at": "b@0"}, {"type": "pin", "at": "b@1"})],
                        masses=[{"at": "b@1", "mass": 1.0, "inertia": 3.0}])
    flexibility = 2.0 / (3 * 20.0) + 1 / (1e6 * 2.0)
    assert found[0]["omega"] == pytest.approx(1 / math.sqrt(3.0 * flexibility), rel=1e-6)


@pytest.mark.parametrize("force", [50.0, -1.0], ids=["tension", "compression"])
def test_an_axial_force_shifts_the_frequencies(force):
    section, E = {"height": 0.002, "width": 0.002}, 2.07e11
    bodies = {"b": h.body(h.line(2.0), h.element("reissner3", 24), section, h.STEEL)}
    found = frequencies(bodies, 3, "static", bc=PINNED, loads=[{"type": "force", "at": "b@1", "value": [force, 0]}])
    EI, rhoA = E * 0.002**4 / 12, 7850 * 0.002**2
    k = np.arange(1, 4) * math.pi / 2
    known = k * np.sqrt(np.abs(EI * k**2 + force) / rhoA)
    if force < 0:
        # the first mode is past its critical load: it grows
        assert found[0]["omega"] == 0.0
        assert found[0]["growth"] == pytest.approx(known[0], rel=1e-3)
        found, known = found[1:], known[1:]
    assert [f["omega"] for f in found] == pytest.approx(list(known), rel=2e-4)


def test_loads_have_no_effect_about_the_reference():
    bodies = {"b": beam(h.element("vallejo", 4))}
    loads = [{"type": "follower_force", "at": "b@1", "value": [-1e6, 2e5]},
             {"type": "moment", "at": "b@0", "value": 1e6}]
    with_loads, without = (frequencies(bodies, bc=PINNED, **more) for more in ({"loads": loads}, {}))
    assert [f["omega"] for f in with_loads] == [f["omega"] for f in without]


def test_prestressed_springs_are_reported():
    springs = [{"type": "translational", "between": ["b@0.5", [1.0, 1.0]], "stiffness": 10.0, "length": 0.5}]
    solution = h.solved({"b": beam(h.element("vallejo", 4))}, "eigen", bc=PINNED, springs=springs)
    assert any("not an equilibrium" in w for w in solution.state.warnings)


def test_modes_scale_with_units():
    metres = frequencies({"b": beam(h.element("vallejo", 8))}, bc=PINNED)
    # mm, t, s: stresses in MPa
    body = h.body({"type": "line", "start": [0, 0], "end": [2000, 0]}, h.element("vallejo", 8),
                  {"height": 400, "width": 400}, {"E": 1e3, "nu": 0.3, "rho": 7850e-12})
    millimetres = frequencies({"b": body}, bc=PINNED)
    assert [f["omega"] for f in millimetres] == pytest.approx([f["omega"] for f in metres], rel=1e-9)


@pytest.mark.slow_rows("20000")
@pytest.mark.parametrize("count", [5000, 20000])
def test_fine_meshes_keep_their_digits(count):
    """K of a slender beam's cubic elements loses eight digits with 5000 of them, and all with 20000; strains do not."""
    body = beam(h.element("cable", count), section={"height": 0.1, "width": 0.1})
    found = [f["omega"] for f in frequencies({"b": body}, 3, bc=PINNED)]
    known = (np.arange(1, 4) * math.pi / 2) ** 2 * math.sqrt(1e9 * 0.1**2 / 12 / 7850)
    np.testing.assert_allclose(found, known, rtol=1e-7)


def test_fewer_modes_than_requested_give_a_warning():
    solution = h.solved({"b": beam(h.element("reissner2", 1))}, {"type": "eigen", "modes": 40}, bc=PINNED)
    assert len(solution.state.report["frequencies"]) == 3
    assert solution.state.warnings == ["the model has 3 modes, not 40"]


def test_effects_that_modes_neglect_give_warnings():
    """Dashpots, material damping, and loads about the reference have no effect on these modes: a warning names each."""
    body = h.body(h.line(1.0), h.element("vallejo", 2))
    damped = {**body, "material": {**body["material"], "damping": {"kelvin_voigt": 1e-3}}}
    spring = {"type": "translational", "between": ["b@1", [2, 0]], "stiffness": 1, "damping": 0.1}
    scene = {"bc": [{"type": "clamp", "at": "b@0"}], "springs": [spring], "loads": [
        {"type": "force", "at": "b@1", "value": [0, 1]}]}
    told = prepare(h.load({"b": damped}, {"type": "eigen", "damped": False}, **scene)).warnings
    assert any("bodies.b.material.damping, springs.0.damping" in w for w in told)
    assert any("these modes are about the reference" in w for w in told)
    still = {**scene, "springs": [{**spring, "damping": 0}]}
    assert prepare(h.load({"b": body}, {"type": "eigen", "about": "static"}, **still)).warnings == []


@pytest.mark.parametrize("name", ["cable", "vallejo"])
def test_inertia_of_a_point_mass_on_a_light_cantilever(name: str) -> None:
    """Light cantilever with mass m and inertia J at its tip: K^-1 = [[L^3/3, L^2/2], [L^2/2, L]]/EI, M = diag(m, J)."""
    L, height, E, m, J, rho = 1.0, 0.02, 1e9, 1.0, 50.0, 1e-3
    EI = E * height**4 / 12
    flexibility = np.array([[L**3 / 3, L**2 / 2], [L**2 / 2, L]]) / EI
    wanted = 1 / np.sqrt(np.linalg.eigvals(flexibility @ np.diag([m, J])).real)
    beam = h.body(h.line(L), h.element(name, 64, **({"formulation": "structural"} if name == "vallejo" else {})),
                  {"height": height, "width": height}, {"E": E, "nu": 0.0, "rho": rho})
    found = h.solved({"beam": beam}, {"type": "eigen", "modes": 3}, bc=[{"type": "clamp", "at": "beam@0"}],
                     masses=[{"at": "beam@1", "mass": m, "inertia": J}]).state.report["frequencies"]
    axial = np.sqrt(E * height**2 / L / m)
    # the section's shear is (h/L)^2 of bending
    assert [f["omega"] for f in found] == pytest.approx(sorted([*wanted, axial]), rel=2 * (height / L) ** 2)


@pytest.mark.parametrize("links", [2, 4])
def test_a_chain_has_one_mode_for_each_free_coordinate(links: int) -> None:
    """A hanging row of rigid links and a strip: one stable mode per coordinate that constraints leave free."""
    def body(k: int, **element: Any) -> dict[str, Any]:
        return {"geometry": h.line(1.0, -math.pi / 2, (0.0, -float(k))), "element": element,
                "section": {"EA": 1e4, "EI": 1, "rhoA": 1}}
    bodies = {**{f"r{k}": body(k, type="rigid") for k in range(links)}, "c": body(links, type="cable", count=2)}
    joints = [{"type": "pin", "between": [f"r{k}@1", f"r{k + 1}@0"]} for k in range(links - 1)]
    joints.append({"type": "weld", "between": [f"r{links - 1}@1", "c@0"]})
    scene = {"bc": [{"type": "pin", "at": "r0@0"}], "joints": joints, "about": "static",
             "loads": [{"type": "gravity", "value": [0, -9.81]}]}
    found, few = (frequencies(bodies, modes, **scene) for modes in (60, 3))
    # the links' angles, two nodes of the strip, and how it stretches at the last link
    assert len(found) == links + 2 * 4 + 1
    assert all(f["growth"] == 0.0 < f["omega"] for f in found)
    assert [f["omega"] for f in found[:3]] == pytest.approx([f["omega"] for f in few], rel=1e-9)
