"""All kinds of matrices compared with dense algebra on real scenes; inertia; singular coordinates are named."""

import helpers
import numpy as np
import pytest
from helpers import dense
from scipy.sparse import csc_array

from ancf2d.errors import ComputationError
from ancf2d.model import numbering
from ancf2d.model.numbering import half_bandwidth, order_unknowns
from ancf2d.solvers.element_loads import _sparse_least_squares
from ancf2d.solvers.ldl import SymmetricBand, SymmetricFronts
from ancf2d.solvers.linear import GeneralBand, GeneralSparse, make_matrix, pattern
from ancf2d.solvers.small_motions.factors import BAND, Factors
from ancf2d.solvers.statics.newton import FLOOR
from ancf2d.solvers.system import System


def bars(corners, specs):
    out = {}
    for k, (a, b, spec) in enumerate(zip(corners[:-1], corners[1:], specs, strict=True)):
        geometry = {"type": "line", "start": list(a), "end": list(b)}
        out[f"b{k}"] = helpers.body(geometry, helpers.element(*spec))
    return out


def pin(*points, kind="pin"):
    return {"type": kind, "between": list(points)}


def chain():
    bodies = bars([(0, 0), (1, 0), (2, 0.3), (3, 0.3)], [("vallejo", 3), ("omar", 2), ("cable", 3)])
    return {
        "bodies": bodies,
        "bc": [{"type": "clamp", "at": "b0@0"}],
        "joints": [pin("b0@1", "b1@0", kind="weld"), pin("b1@1", "b2@0", kind="weld")],
    }


def loop():
    bodies = bars([(0, 0), (1, 0), (0.5, 0.8), (0, 0)], [("vallejo", 4), ("reissner3", 4), ("cable", 4)])
    return {
        "bodies": bodies,
        "bc": [{"type": "pin", "at": "b0@0"}, {"type": "roller", "at": "b0@1", "fixed": "y"}],
        "joints": [pin("b0@1", "b1@0"), pin("b1@1", "b2@0"), pin("b2@1", "b0@0")],
    }


def star():
    ends = [(np.cos(a), np.sin(a)) for a in (0, 1.3, 2.5, 4.0, 5.2)]
    bodies = {
        f"b{k}": helpers.body({"type": "line", "start": [0, 0], "end": list(e)}, helpers.element("vallejo", 2 + k))
        for k, e in enumerate(ends)
    }
    return {
        "bodies": bodies,
        "bc": [{"type": "clamp", "at": f"b{k}@1"} for k in (0, 2)],
        "joints": [pin(*(f"b{k}@0" for k in range(5)), kind="weld")],
    }


def stepped():
    spec = helpers.element("ancf[3,3]", 3)
    return {
        "bodies": {"b": helpers.body({"type": "polyline", "points": [[0, 0], [1, 0], [1.5, 0.7]]}, spec)},
        "bc": [{"type": "clamp", "at": "b@0", "hold": "breathe"}, {"type": "roller", "at": "b@0.63", "normal": [1, 2]}],
    }


SCENES = {f.__name__: f for f in (chain, loop, star, stepped)}

def of_kind(kind: str, model, bw: int):
    """Return an empty matrix of a kind for a model."""
    matrix = KINDS[kind](model, model.numbering.n_unknowns, bw)
    matrix.places = model.numbering.rows
    return matrix


KINDS = {
    "symmetric band": lambda m, n, bw: SymmetricBand(n, bw),
    "fronts": lambda m, n, bw: SymmetricFronts(m.numbering.fronts),
    "general band": lambda m, n, bw: GeneralBand(n, bw),
    "compressed rows": lambda m, n, bw: GeneralSparse(n, *pattern(m)),
    "rows exchanged": lambda m, n, bw: GeneralSparse(n, *pattern(m), exchange=True),
}


def built(kind: str | None, **scene):
    """Return a model that uses fronts whatever they cost if the kind is that, and no fronts otherwise."""
    with pytest.MonkeyPatch.context() as patch:
        if kind is not None:
            patch.setattr(numbering, "LOOSE", 0.0)
            patch.setattr(numbering, "FEW", 0)
            patch.setattr(numbering, "band_cost", lambda n, width: np.inf if kind == "fronts" else 0.0)
        return helpers.build(**scene)


def system_of(scene: str, kind: str | None = None):
    model = built(kind, **SCENES[scene]())
    system = System(model)
    if kind is not None:
        system.matrix = of_kind(kind, model, model.numbering.half_bandwidth)
    return model, system


def reduction(model) -> np.ndarray:
    """Return T (n_full, n_unknowns), column by column."""
    num = model.numbering
    T = np.zeros((len(num.place), num.n_unknowns))
    for k, unit in enumerate(np.eye(num.n_unknowns)):
        num.expand(unit, T[:, k])
    return T


def state(model, system):
    d = model.displacements(
        0.01 * np.random.default_rng(3).normal(size=model.numbering.n_unknowns) / system_scale(system), 1.0
    )
    return d


def system_scale(system):
    return np.where(system.weights > 0, system.weights, 1.0)


def congruence(model, system, d) -> np.ndarray:
    """Return T^T K T, with K column by column from the elements' and patches' actions."""
    T = reduction(model)
    K = np.stack([system.action(d, column, 1.0) for column in np.eye(len(d))], axis=1)
    return T.T @ K @ T


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES)
def test_every_kind_of_matrix_holds_and_solves_the_reduced_tangent(scene, kind):
    model, system = system_of(scene, kind)
    d = state(model, system)
    K = congruence(model, system, d)
    system.assemble(d, 1.0)
    s = 1 / np.sqrt(np.abs(K).max(axis=1))
    scaled = K * np.outer(s, s)
    assembled = dense(system.matrix.target, len(K)) * np.outer(s, s)
    np.testing.assert_allclose(assembled, scaled, atol=1e-12)
    b = np.random.default_rng(4).normal(size=len(K))
    pivots = system.matrix.factor()
    assert pivots.bad == -1
    assert 0 < pivots.smallest <= 1e3
    x, expected = system.matrix.solve(b / s) / s, np.linalg.solve(scaled, b)
    np.testing.assert_allclose(x, expected, atol=1e-9 * np.abs(expected).max())
    negative = int((np.linalg.eigvalsh(scaled) < 0).sum())
    if kind == "general band":
        # row exchanges leave the sign of the determinant
        assert pivots.negative == negative % 2
    elif kind in ("symmetric band", "fronts") or (kind == "compressed rows" and not model.constraints):
        # SuperLU exchanges rows at the zero diagonal of a multiplier
        assert pivots.negative == negative


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", SCENES)
def test_products_and_diagonals_are_those_of_the_matrix(scene, kind):
    model, system = system_of(scene, kind)
    system.assemble(state(model, system), 1.0)
    matrix = system.matrix
    K = dense(matrix.target, model.numbering.n_unknowns)
    x = np.random.default_rng(5).normal(size=len(K))
    np.testing.assert_allclose(matrix.product(matrix.values, x), K @ x, atol=1e-13 * np.abs(K).max() * np.abs(x).max())
    np.testing.assert_array_equal(matrix.diagonal(matrix.values), np.diag(K))


def test_exchanging_rows_fills_factors_little():
    """The factors of a steel ring have O(n) entries; an ordering for K + K^T gives O(n^2) if rows are exchanged."""
    corners = [[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(9) / 8]
    bodies = {
        f"b{k}": helpers.body(
            {"type": "line", "start": corners[k], "end": corners[k + 1]},
            helpers.element("vallejo", 12), {"height": 0.05, "width": 0.05}, helpers.STEEL,
        )
        for k in range(8)
    }
    joints = [pin(f"b{k}@1", f"b{(k + 1) % 8}@0", kind="weld") for k in range(8)]
    model = built(None, bodies=bodies, bc=[{"type": "clamp", "at": "b0@0"}], joints=joints)
    system = System(model)
    matrix = system.matrix = of_kind("rows exchanged", model, 0)
    system.assemble(np.zeros(len(model.numbering.place)), 1.0)
    assert model.constraints
    assert matrix.factor().bad == -1
    assert matrix.lu.nnz < 3 * len(matrix.values)


@pytest.mark.parametrize("kind", ["symmetric band", "fronts", "compressed rows"])
def test_negative_pivots_are_the_inertia_beyond_a_critical_load(kind):
    """Compressed beyond Euler's load a strut has one negative eigenvalue, beyond the second load two."""
    EI = 5.0 * 0.1 * 0.1**3 / 12
    for factor, expected in ((0.5, 0), (2.5, 1), (6.0, 2)):
        P = factor * EI * np.pi**2
        strut = {"b": helpers.body(helpers.line(1.0), helpers.element("cable", 16), {"height": 0.1, "width": 0.1})}
        bc = [{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}]
        model = built(kind, bodies=strut, bc=bc)
        system = System(model)
        system.matrix = of_kind(kind, model, model.numbering.half_bandwidth)
        strain = -P / (5.0 * 0.01)
        d = np.zeros(model.n_q)
        for i in np.flatnonzero(model.meshes["b"].kinds == 0):
            d[i] = strain * model.e0[i]
        d[model.meshes["b"].kinds == 3] = strain
        system.assemble(d, 1.0)
        assert system.matrix.factor().negative == expected


@pytest.mark.parametrize("scene", SCENES)
def test_forces_with_and_without_tangent_are_the_same(scene):
    model, system = system_of(scene)
    d = state(model, system)
    balance, forces = system.assemble(d, 1.0), system.forces(d, 1.0)
    np.testing.assert_allclose(balance.R, forces.R, atol=1e-13 * np.abs(forces.Q).max())
    assert balance.energy == pytest.approx(forces.energy, rel=1e-13)


@helpers.every_small_type
def test_the_round_off_bound_of_a_rotated_body_is_tight(name):
    beam = {
        "b": helpers.body(
            helpers.line(2.0, 0.4), helpers.element(name, 8), {"height": 0.1, "width": 0.1}, helpers.STEEL
        )
    }
    model = helpers.build(beam, bc=[{"type": "clamp", "at": "b@0"}])
    system = System(model)
    full = helpers.rotate(np.zeros(model.n_q), model, 1.3, (0.4, 0.2))
    d = np.zeros(len(model.numbering.place))
    d[: model.n_q] = full
    R, noise = system.forces(d, 1.0).R, system.noise(d, 1.0)
    assert (np.abs(R) <= FLOOR * noise).all()
    weights = np.where(system.weights > 0, system.weights, 1.0)
    assert np.max(noise / weights) < 1e3 * max(np.max(np.abs(R) / weights), 1.0)


def test_an_ordering_with_a_narrower_band_replaces_the_general_one():
    n = 60
    shuffled = np.random.default_rng(1).permutation(n)
    sets = [np.stack([shuffled[:-1], shuffled[1:]], axis=1)]
    natural = half_bandwidth(np.arange(n), sets)
    position, width = order_unknowns(n, sets, 1)
    assert natural > 20
    assert width == half_bandwidth(position, sets) == 1
    assert sorted(position.tolist()) == list(range(n))
    kept, same = order_unknowns(n, [np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)], 1)
    np.testing.assert_array_equal(kept, np.arange(n))
    assert same == 1


def test_the_matrix_suits_the_scene():
    assert isinstance(make_matrix(helpers.build(**chain())), SymmetricBand)
    scene = chain()
    follower = [{"type": "follower_force", "at": "b2@1", "value": [0, 1]}]
    assert isinstance(make_matrix(helpers.build(**scene, loads=follower)), GeneralBand)
    spokes = {
        f"b{k}": helpers.body(
            {"type": "line", "start": [0, 0], "end": [np.cos(k), np.sin(k)]}, helpers.element("vallejo", 4)
        )
        for k in range(30)
    }
    joints = [pin(*(f"b{k}@0" for k in range(30)), kind="weld")]
    model = helpers.build(spokes, bc=[{"type": "clamp", "at": f"b{k}@1"} for k in range(30)], joints=joints)
    assert isinstance(make_matrix(model), SymmetricFronts)
    # where fronts are not worth it a band is, however wide
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numbering, "FEW", 10**6)
        model = helpers.build(spokes, bc=[{"type": "clamp", "at": f"b{k}@1"} for k in range(30)], joints=joints)
        assert model.numbering.half_bandwidth > 60
        assert isinstance(make_matrix(model), SymmetricBand)
    # as stiff a scene with a load that follows a body has no symmetric tangent, and a point that slides none of fronts
    assert not isinstance(make_matrix(built("fronts", **scene, loads=follower)), SymmetricFronts)


def test_small_frames_and_chains_keep_their_band(monkeypatch):
    """Kernels for fronts need compilation: in motion, with many kernels, a band may cost three times as much."""
    def fronts(moves: bool = False, **more) -> bool:
        solver = {"solver": {"type": "dynamic", "t_end": 1.0, "dt": 0.1}} if moves else {}
        return helpers.build(**(star() | solver | more)).numbering.fronts is not None

    assert not fronts()
    monkeypatch.setattr(numbering, "FEW", 0)
    monkeypatch.setattr(numbering, "fronts_cost", lambda tree: 1.0)
    for share, taken in ((1.1, (False, False)), (2.0, (True, False)), (3.5, (True, True))):
        monkeypatch.setattr(numbering, "band_cost", lambda n, width, share=share: share)
        assert (fronts(), fronts(moves=True)) == taken
    monkeypatch.setattr(numbering, "LOOSE", 1e3)
    assert not fronts()


def test_long_chains_have_the_band_of_one_element():
    for name in helpers.SMALL_TYPES:
        model = helpers.build(
            {"b": helpers.body(helpers.line(1.0), helpers.element(name, 20))}, bc=[{"type": "clamp", "at": "b@0"}]
        )
        assert model.numbering.half_bandwidth <= helpers.TYPES[name].n_dof - 1


@pytest.mark.parametrize("solver", ["linear_static", "static"])
def test_a_singular_tangent_names_the_free_coordinate(solver):
    """With one Gauss point a kerkkanen element in continuum form has no bending stiffness."""
    spec = helpers.element("kerkkanen", 1, "continuum", quadrature=[1, 1])
    beam = {"b": helpers.body(helpers.line(1.0), spec)}
    with pytest.raises(ComputationError, match=r"singular: r?[xy]?(y_x|y_y|x|y) of b at S = 1") as error:
        helpers.solved(
            beam,
            solver,
            bc=[{"type": "pin", "at": "b@0"}, {"type": "prescribed", "at": "b@0", "angle": 0.0}],
            loads=[{"type": "force", "at": "b@1", "value": [0, 1]}],
        )
    if solver == "linear_static":
        assert "zero-energy mode" in error.value.failure.advice


@pytest.mark.parametrize("wide", [2, BAND + 30])
@pytest.mark.parametrize("seed", range(3))
def test_factors_have_the_phase_of_the_determinant(seed, wide):
    """det A = |det A| sign, where sign is -1 or 1 of real matrices, and on the unit circle of complex ones."""
    rng, n = np.random.default_rng(seed), BAND + 41
    i, j = np.tile(np.arange(n), 3), np.concatenate([np.arange(n), *rng.integers(0, n, (2, n))])
    j = np.where(np.abs(i - j) <= wide, j, i)
    for values in (rng.standard_normal(3 * n), rng.standard_normal(3 * n) + 1j * rng.standard_normal(3 * n)):
        A = csc_array((values, (i, j)), shape=(n, n))
        b, found = rng.standard_normal((n, 2)).astype(A.dtype), Factors(A)
        assert (found.bw > BAND) == (wide > BAND)
        assert found.phase == pytest.approx(np.linalg.slogdet(A.toarray())[0], abs=1e-9)
        np.testing.assert_allclose(found.solve(b), np.linalg.solve(A.toarray(), b), rtol=1e-6, atol=1e-9)
        assert Factors(csc_array((np.where(j == 3, 0.0, values), (i, j)), shape=(n, n))).singular


def test_reactions_of_many_equations_agree_with_dense_algebra():
    """With redundant rows, the minimum-norm least squares solution."""
    rng, rows = np.random.default_rng(0), 12
    owner, index = np.repeat(np.arange(rows), 3), rng.integers(0, 20, 3 * rows)
    index[-3:], data = index[-6:-3], rng.standard_normal(3 * rows)
    data[-3:] = data[-6:-3]
    dense, b = csc_array((data, (index, owner)), shape=(20, rows)).toarray(), rng.standard_normal(20)
    found = _sparse_least_squares(data, index, owner, dense.shape, b)
    np.testing.assert_allclose(found, np.linalg.lstsq(dense, b, rcond=None)[0], atol=1e-9)
