"""Rigid bodies: mass in natural coordinates, constraints, refusals, and the order of multipliers."""

from __future__ import annotations

import helpers
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import CaseError
from ancf2d.model import determinacy
from ancf2d.model.classes import mass_matrix
from ancf2d.model.determinacy import rigid_motion
from ancf2d.model.point_patch import dot
from ancf2d.model.points import point_ref
from ancf2d.solvers.linear import full_mass

PIN = [{"type": "pin", "at": "b@0"}]
HINGE = {"type": "rotational", "between": ["b@0", [0, 0]], "stiffness": 1.0}
DYNAMIC = {"type": "dynamic", "t_end": 1.0, "dt": 0.1}
BENT = {"type": "polyline", "points": [[0, 0], [2, 0], [2, 1]]}


def rigid(geometry=None, **more):
    spec = {k: more.pop(k) for k in ("mass", "inertia", "count", "quadrature", "formulation") if k in more}
    return {"geometry": geometry or helpers.line(2.0, 0.3), "element": {"type": "rigid", **spec}, **more}


def model_of(body, solver="static", springs=(HINGE,), bc=PIN, **scene):
    return helpers.build({"b": body}, solver, bc=bc, springs=springs, **scene)


def kinetic(model, v):
    return 0.5 * v @ (full_mass(model) @ v)


def rates(model, vx, vy, omega, about=(0.0, 0.0)):
    """Return the rates of all coordinates for a rigid motion in the reference."""
    x, y = model.e0[0::2] - about[0], model.e0[1::2] - about[1]
    return np.stack([vx - omega * y, vy + omega * x], axis=1).ravel()


def test_the_mass_matrix_is_that_of_natural_coordinates():
    mesh = model_of(rigid(mass=3.0, inertia=0.7)).meshes["b"]
    m, J, L = 3.0, 0.7, 2.0
    own, other = m / 4 + J / L**2, m / 4 - J / L**2
    expected = np.kron([[own, other], [other, own]], np.eye(2))
    np.testing.assert_allclose(mass_matrix(mesh.classes[0].sampler), expected, atol=1e-14)


@pytest.mark.parametrize(("body", "mass", "inertia"), [
    (rigid(mass=3.0, inertia=0.7), 3.0, 0.7),
    (rigid(mass=3.0, inertia=5.0), 3.0, 5.0),
    (rigid(section={"height": 0.3, "width": 0.2}, material={"rho": 10.0}), 1.2, 1.2 * (4 + 0.09) / 12),
    (rigid(section={"A": 0.06, "I": 0.002, "height": 0.4}, material={"rho": 10.0}), 1.2, 1.2 * 4 / 12 + 0.04),
    (rigid(section={"EA": 1.0, "EI": 2.0, "rhoA": 0.5, "rhoI": 0.25}), 1.0, 4 / 12 + 0.5),
    (rigid(section={"EA": 1.0, "EI": 2.0, "rhoA": 0.5}), 1.0, 4 / 12 + 2.0),
])
def test_kinetic_energy_is_that_of_a_rigid_body_about_its_centre(body, mass, inertia):
    model = model_of(body)
    centre = np.array([np.cos(0.3), np.sin(0.3)])
    assert kinetic(model, rates(model, 0.4, -0.3, 0.0)) == pytest.approx(0.5 * mass * 0.25)
    assert kinetic(model, rates(model, 0.0, 0.0, 1.5, centre)) == pytest.approx(0.5 * inertia * 1.5**2)


@pytest.mark.parametrize("inertia", [4.0, 2.0, 0.5, 1e-3])
def test_a_bent_body_has_its_mass_and_inertia_about_their_common_centre(inertia):
    model = model_of(rigid(BENT, mass=3.0, inertia=inertia))
    # 2 m along x with its middle at (1, 0), 1 m along y with its middle at (2, 0.5)
    centre = np.array([4 / 3, 1 / 6])
    assert kinetic(model, rates(model, 1.0, 0.0, 0.0)) == pytest.approx(1.5)
    assert kinetic(model, rates(model, 0.0, 0.0, 1.0, centre)) == pytest.approx(0.5 * inertia)
    # what the pieces leave free, a change of scale among it, has inertia whatever the case gives
    free = model_of(rigid(BENT, mass=3.0, inertia=inertia), DYNAMIC, springs=[], bc=[])
    T = np.zeros((free.n_q + 1, free.numbering.n_unknowns))
    for k, unit in enumerate(np.eye(free.numbering.n_unknowns)):
        free.numbering.expand(unit, T[:, k])
    T = T[:free.n_q][:, free.numbering.free < free.n_q]
    assert T.shape[1] == 4
    assert (np.linalg.eigvalsh(T.T @ full_mass(free).toarray() @ T) > 0).all()


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5, 8.0])
@pytest.mark.parametrize("geometry", [None, BENT])
def test_only_rigid_motion_keeps_lengths_and_corners(geometry, angle):
    model = model_of(rigid(geometry))
    d = helpers.rotate(np.zeros(model.n_q), model, angle, (0.3, 0.2))
    # of the pieces of one body, that keep their angles and the ratio of their lengths, one length is enough
    assert len(model.constraints) == 1
    for c in model.constraints:
        assert helpers.constraint_at(c, d, 1.0)[0] == pytest.approx(0, abs=1e-14)
    # coordinates less equations are the three rigid motions: no more is kept, no less
    seen = np.zeros((0, model.n_q))
    for c in model.constraints:
        row = np.zeros((1, model.n_q))
        row[0, c.dofs] = helpers.constraint_at(c, d, 1.0)[1]
        seen = np.vstack([seen, row])
    for r in model.rows:
        row = np.zeros((1, model.n_q))
        row[0, r.coords] = r.coefs
        seen = np.vstack([seen, row] if r.owner.startswith("corner") else [seen])
    assert np.linalg.matrix_rank(seen, tol=1e-9) == model.n_q - 3


def test_a_rigid_body_is_one_element_per_piece_for_any_count():
    assert model_of(rigid(count=7)).meshes["b"].plan.count == 1
    assert model_of(rigid(BENT, count=7)).meshes["b"].plan.count == 2


def test_rigid_bodies_have_no_strain_and_no_group():
    model = model_of(rigid(section={"height": 0.3, "width": 0.2}))
    assert model.groups == []
    assert model.meshes["b"].plan.section.height == 0.3
    assert model_of(rigid()).meshes["b"].plan.section.height == pytest.approx(0.1)


@pytest.mark.parametrize(("body", "word"), [
    (rigid(quadrature=[2, 2]), "quadrature has no effect"),
    (rigid(formulation="cable"), "formulation has no effect"),
])
def test_options_without_meaning_for_rigid_bodies_are_refused(body, word):
    with pytest.raises(CaseError, match=word):
        model_of(body)


@pytest.mark.parametrize("hold", [None, "all", "section"])
def test_a_clamp_fixes_the_whole_bar(hold):
    clamp = {"type": "clamp", "at": "b@0", **({"hold": hold} if hold else {})}
    model = model_of(rigid(), bc=[clamp])
    assert model.numbering.n_unknowns == 0
    d = np.zeros(model.n_q)
    assert all(r.coefs @ d[r.coords] == 0 for r in model.rows)
    turned = helpers.rotate(d, model, 0.2)
    assert max(abs(r.coefs @ turned[r.coords]) for r in model.rows) > 0.1
    assert not model.warnings


def test_mechanisms_of_a_bar_are_rotations_without_stretch():
    with pytest.raises(CaseError, match=r"'b' is free to turn about \(0, 0\)"):
        model_of(rigid(BENT), springs=[])
    spring = {"type": "translational", "between": ["b@0.2", "b@0.9"], "stiffness": 3.0}
    with pytest.raises(CaseError, match=r"'b' is free to turn about \(0, 0\)"):
        model_of(rigid(helpers.line(2.0, 0.3)), springs=[spring])


def test_a_bar_supported_at_both_ends_drops_its_length_constraint():
    model = model_of(rigid(), bc=[*PIN, {"type": "pin", "at": "b@1"}])
    assert not model.constraints
    assert any("redundant: the length of b" in w for w in model.warnings)


@pytest.mark.parametrize("more", [
    [{"type": "pin", "at": "b@1"}], [{"type": "fix", "at": "b@1", "coordinates": ["x", "y"]}],
    [{"type": "roller", "at": "b@0.5", "normal": [0, 1]}],
])
def test_a_prescribed_motion_of_a_whole_bar_contradicts_other_supports(more):
    moved = {"type": "prescribed", "at": "b@0", "ux": 0.0, "uy": 0.1, "angle": 0.3, "name": "drive"}
    with pytest.raises(CaseError, match=r"contradicts other supports or joints \(.*drive"):
        model_of(rigid(), "linear_static", springs=[], bc=[moved, {**more[0], "name": "held"}])


def test_a_support_that_agrees_with_the_motion_of_a_bar_is_redundant():
    """To first order, the end of a bar of length 2 rises by twice its angle."""
    moved = {"type": "prescribed", "at": "b@0", "ux": 0.0, "uy": 0.0, "angle": 0.3}
    follows = {"type": "prescribed", "at": "b@1", "uy": 0.6}
    model = model_of(rigid(helpers.line(2.0)), "linear_static", springs=[], bc=[moved, follows])
    assert [c.holds for c in model.constraints] == ["length"]
    assert any("redundant" in w for w in model.warnings)


def test_collinear_bars_to_one_point_are_redundant_in_linear_statics():
    """Bars from (0, 0) and (2, 0) to (1, 0) both fix its x; a spring acts along y."""
    bodies = {"a": rigid(helpers.line(1.0)), "b": rigid(helpers.line(1.0, start=(1.0, 0.0)))}
    scene = {"bc": [{"type": "pin", "at": "a@0"}, {"type": "pin", "at": "b@1"}],
             "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
             "springs": [{"type": "translational", "between": ["a@1", [1.0, 1.0]], "stiffness": 4.0}],
             "loads": [{"type": "force", "at": "a@1", "value": [3.0, -1.0]}]}
    found = helpers.solved(bodies, "linear_static", **scene)
    np.testing.assert_allclose(found.u("b@0"), [0.0, -0.25], atol=1e-14)
    assert any("redundant: the length of b" in w for w in found.model.warnings)
    # what does not stay in the reference needs both: they carry the load beyond
    assert len(helpers.build(bodies, "static", **scene).constraints) == 2


def test_a_bar_moved_at_both_ends_keeps_its_length_constraint():
    moved = {"type": "prescribed", "at": "b@1", "ux": 0.1, "uy": 0.0}
    assert len(model_of(rigid(), bc=[*PIN, moved]).constraints) == 1


def chain(solver):
    """Return two bars pinned to each other and to the ground, and a beam welded to them."""
    first, second = rigid(helpers.line(1.0, 0.4), mass=1.0, inertia=0.1), None
    end = (np.cos(0.4), np.sin(0.4))
    second = rigid(helpers.line(1.5, -0.3, end), mass=1.0, inertia=0.1)
    tip = (end[0] + 1.5 * np.cos(0.3), end[1] - 1.5 * np.sin(0.3))
    beam = helpers.body(helpers.line(1.0, 0.2, tip), helpers.element("vallejo", 3), helpers.SECTION, helpers.MATERIAL)
    return helpers.build(
        {"b": first, "c": second, "beam": beam}, solver,
        bc=[*PIN, {"type": "pin", "at": "beam@1"}],
        joints=[{"type": "pin", "between": ["b@1", "c@0"]}, {"type": "weld", "between": ["c@1", "beam@0"]}],
    )


@pytest.mark.parametrize("solver", [DYNAMIC, "static"], ids=["motion", "static"])
def test_every_multiplier_follows_all_its_coordinates(solver):
    """Then LDL^T without row exchanges has pivots of the right sign for any stiffness."""
    model = chain(solver)
    num = model.numbering
    for k, c in enumerate(model.constraints):
        reached = set()
        for i in num.place[c.dofs].tolist():
            reached |= set(num.index[num.indptr[-2 - i]:num.indptr[-1 - i]].tolist()) if i < -1 else {i}
        assert num.place[model.n_q + k] > max(reached)
    A = np.zeros((num.n_unknowns, num.n_unknowns))
    full = np.zeros((len(num.place), len(num.place)))
    full[:model.n_q, :model.n_q] = full_mass(model).toarray()
    for k, c in enumerate(model.constraints):
        _, G, _ = helpers.constraint_at(c, np.zeros(model.n_q), 0.0)
        full[c.dofs, model.n_q + k] = full[model.n_q + k, c.dofs] = G
    T = np.zeros((len(full), num.n_unknowns))
    for k in range(num.n_unknowns):
        num.expand(np.eye(num.n_unknowns)[k], T[:, k])
    A = T.T @ full @ T
    wide = np.abs(np.subtract(*np.nonzero(np.abs(A) > 1e-12))).max()
    assert wide <= num.half_bandwidth
    for k in range(len(A)):
        pivot = np.linalg.det(A[:k + 1, :k + 1]) / (np.linalg.det(A[:k, :k]) if k else 1.0)
        assert pivot * (1 if num.free[k] < model.n_q else -1) > 0


def test_sliders_constrain_the_distance_from_their_line():
    body = helpers.body(helpers.line(1.0, 0.3), helpers.element("vallejo", 2))
    through = [np.cos(0.3) - 6, np.sin(0.3) - 8]
    slider = {"type": "slider", "at": "b@1", "through": through, "along": [3, 4]}
    model = helpers.build({"b": body}, bc=PIN, joints=[slider])
    (row,) = (r for r in model.rows if r.owner == "joints.0")
    d = np.zeros(model.n_q)
    d[row.coords] = [3.0, 4.0]
    assert row.coefs @ d[row.coords] == pytest.approx(0, abs=1e-14)
    d[row.coords] = [-4.0, 3.0]
    assert abs(row.coefs @ d[row.coords]) == pytest.approx(5.0)


def test_a_slider_that_is_not_on_its_line_is_refused():
    body = helpers.body(helpers.line(1.0), helpers.element("vallejo", 2))
    slider = {"type": "slider", "at": "b@1", "through": [0, 0.5], "along": [2, 0]}
    with pytest.raises(CaseError, match=r"b@1 is at \(1, 0\), 0\.5 away from the line"):
        helpers.build({"b": body}, bc=PIN, joints=[slider])


RING = {"type": "arc", "center": [0.3, -0.2], "radius": 2.0, "from": 2.8, "to": -0.4}
ELLIPSE = {"type": "curve", "x": "2*cos(2*pi*s)", "y": "sin(2*pi*s)", "closed": True}
SPLINE = {"type": "spline", "points": [[0, 0], [1, 0.4], [2, 0], [2.5, -1]]}
PATH = {"type": "path", "start": [0, 0], "heading": 0.3,
        "pieces": [{"line": 1}, {"arc": 0.5, "angle": 2.0}, {"line": 0.4}]}
BAR = {"height": 0.2, "width": 0.1}


def test_a_rigid_arc_has_the_mass_centre_and_inertia_of_an_arc():
    model = model_of(rigid(RING, section=BAR, material={"rho": 10.0}))
    R, half = 2.0, 1.6
    mass, inertia = 10.0 * 0.02 * 2 * half * R, 10.0 * 0.1 * 0.2**3 / 12 * 2 * half * R
    off, angle = R * np.sin(half) / half, 2.8 - half
    centre = np.array([0.3, -0.2]) + off * np.array([np.cos(angle), np.sin(angle)])

    def energy(vx, vy, omega):
        coords = np.arange(model.n_q)
        motions = rigid_motion(model.meshes["b"], coords, model.e0, centre)
        return kinetic(model, motions @ [vx, vy, omega])

    assert energy(0.6, -0.8, 0.0) == pytest.approx(0.5 * mass, rel=1e-13)
    about = mass * (R**2 - off**2) + inertia
    assert energy(0.0, 0.0, 1.5) == pytest.approx(0.5 * about * 1.5**2, rel=1e-13)
    assert energy(0.6, -0.8, 1.5) == pytest.approx(0.5 * mass + 0.5 * about * 1.5**2, rel=1e-13)


def test_the_division_of_a_rigid_arc_does_not_depend_on_round_off():
    """An arc of 1.5 rad has 15 pieces of 0.1 rad for any radius: derivatives need equal counts."""
    counts = {len(model_of(rigid({**RING, "from": 0.0, "to": 1.5, "radius": 1.0 + 1e-3 * k}, section=BAR)
                           ).meshes["b"].plan.pieces) for k in range(20)}
    assert counts == {15}


@pytest.mark.parametrize("geometry", [RING, pytest.param(ELLIPSE, marks=pytest.mark.slow), SPLINE, PATH])
def test_the_points_of_a_rigid_curve_keep_their_positions_in_the_body(geometry):
    model = model_of(rigid(geometry, section=BAR, mass=3.0))
    turn = np.array([[np.cos(0.9), -np.sin(0.9)], [np.sin(0.9), np.cos(0.9)]])
    frame = model.e0.reshape(-1, 2)
    turned = np.concatenate([frame[:1], frame[1:] @ turn.T]).ravel()
    for s in (0.0, 0.13, 0.5, 0.87, 1.0):
        r, angle = model.meshes["b"].plan.position(s)
        for y in (0.0, 0.05):
            there = r + y * np.array([-np.sin(angle), np.cos(angle)])
            columns = point_ref(model.meshes["b"], s, y).position()
            np.testing.assert_allclose([dot(c, model.e0) for c in columns], there, atol=1e-13)
            moved = frame[0] + turn @ (there - frame[0])
            np.testing.assert_allclose([dot(c, turned) for c in columns], moved, atol=1e-13)


@pytest.mark.slow_rows("geometry1")
@pytest.mark.parametrize("geometry", [RING, SPLINE, PATH])
def test_a_spring_turns_a_rigid_curve_against_its_inertia_alone(geometry):
    body = rigid(geometry, section=BAR, mass=3.0, inertia=0.7)
    plan = model_of(body).meshes["b"].plan
    axis = np.array([plan.position(s)[0] for s in (np.arange(30) + 0.5) / 30])
    J = 0.7 + 3.0 * np.sum((axis.mean(axis=0) - plan.position(0.0)[0]) ** 2)
    case = {"bodies": {"b": body}, "boundary_conditions": PIN, "springs": [HINGE],
            "solver": {"type": "eigen", "modes": 1}}
    (mode,) = ancf2d.solve(case, states=False).summary["frequencies"]
    assert mode["omega"] == pytest.approx(J**-0.5, rel=1e-3)


def test_two_welded_halves_of_a_rigid_arc_are_one():
    halves = {name: rigid({**RING, "from": a, "to": b}, section=BAR, material={"rho": 10.0})
              for name, a, b in (("b", 2.8, 1.2), ("c", 1.2, -0.4))}
    weld = [{"type": "weld", "between": ["b@1", "c@0"]}]
    case = {"boundary_conditions": PIN, "springs": [HINGE], "solver": {"type": "eigen", "modes": 1}}
    two, one = (ancf2d.solve({**case, **scene}, states=False).summary["frequencies"][0]["omega"] for scene in (
        {"bodies": halves, "joints": weld}, {"bodies": {"b": rigid(RING, section=BAR, material={"rho": 10.0})}}))
    assert two == pytest.approx(one, rel=1e-9)


@pytest.mark.parametrize("hold", [None, "section"])
def test_a_clamp_fixes_the_whole_rigid_curve(hold):
    clamp = [{"type": "clamp", "at": "b@0.4", **({"hold": hold} if hold else {})}]
    model = model_of(rigid(RING, mass=1.0), bc=clamp, springs=[])
    assert model.numbering.n_unknowns == 0


def test_a_sparse_factorisation_shows_that_all_bodies_are_held(monkeypatch):
    """A chain of bodies, each held by the one before; without its first equation, all of it can move."""
    n = 2 * determinacy.MANY
    held = np.eye(n) - 0.99 * np.eye(n, k=-1)
    loose = held[1:].copy()
    (free,) = determinacy._kernel(loose)
    assert np.abs(loose @ free).max() < 1e-12
    (free,) = determinacy._kernel(np.vstack([loose, loose]))
    assert np.abs(loose @ free).max() < 1e-12
    # nearly free, but held: a number far above round-off decides
    (free,) = determinacy._kernel(np.vstack([loose, 1e-12 * held[:1]]))
    monkeypatch.setattr(np.linalg, "svd", None)
    assert len(determinacy._kernel(held)) == 0
