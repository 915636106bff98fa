"""Linear equations between coordinates: the reduced coordinates span exactly the solutions."""

import helpers
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.errors import CaseError
from ancf2d.model.constraints import Row, combine
from ancf2d.model.numbering import eliminate, inconsistent


def rows_of(A, b) -> list[Row]:
    out = []
    for a, value in zip(A, b, strict=True):
        used = np.flatnonzero(a)
        out.append(Row(used, a[used], "o", "h", lambda t, v=value: float(v) * t))
    return out


def random_rows(seed: int, n: int, m: int, repeats: int):
    rng = np.random.default_rng(seed)
    A = rng.integers(-3, 4, size=(m, n)).astype(float)
    A[:, rng.random(n) < 0.3] = 0.0
    A[np.flatnonzero(~A.any(axis=1)), 0] = 1.0
    if repeats:
        A = np.vstack([A, rng.integers(-2, 3, size=(repeats, m)) @ A])
        A[~A.any(axis=1)] = A[0]
    return A


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(4, 12), m=st.integers(1, 4), repeats=st.integers(0, 2))
def test_dependents_solve_the_rows_and_nothing_else_is_fixed(seed, n, m, repeats):
    A = random_rows(seed, n, m, repeats)
    rng = np.random.default_rng(seed)
    motion = rng.normal(size=n)
    b = A @ motion
    rows = rows_of(A, b)
    out = eliminate(rows, lambda c: 1.0)
    rank = np.linalg.matrix_rank(A)
    assert len(out.dependents) == rank
    assert len(out.redundant) == len(A) - rank
    assert not inconsistent(out, rows, 0.5, 1.0)
    z, d = rng.normal(size=n), np.zeros(n)
    for c in range(n):
        d[c] = z[c]
    for c, dependent in out.dependents.items():
        assert not set(dependent.terms) & set(out.dependents)
        d[c] = sum(v * z[k] for k, v in dependent.terms.items()) + sum(v * b[r] for r, v in dependent.rhs.items())
    np.testing.assert_allclose(A @ d, b, atol=1e-9 * (1 + np.abs(A) @ np.abs(d)).max())


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(4, 10), m=st.integers(1, 4))
def test_contradicting_rows_are_found(seed, n, m):
    A = random_rows(seed, n, m, 1)
    b = A @ np.random.default_rng(seed).normal(size=n)
    b[-1] += 1.0
    rows = rows_of(A, b)
    found = inconsistent(eliminate(rows, lambda c: 1.0), rows, 1.0, 1.0)
    assert (len(found) > 0) == (np.linalg.matrix_rank(np.column_stack([A, b])) > np.linalg.matrix_rank(A))


def test_the_coordinate_that_moves_most_is_eliminated_in_any_units():
    row = Row(np.array([0, 1]), np.array([1.0, 1000.0]), "o", "h")
    assert list(eliminate([row], lambda c: 1.0).dependents) == [1]
    assert list(eliminate([row], lambda c: (1.0, 1e-6)[c]).dependents) == [0]


def test_combined_columns_have_no_repeats_and_no_zeros():
    a, b = (np.array([1, 2]), np.array([1.0, 2.0])), (np.array([2, 5]), np.array([2.0, 1.0]))
    coords, weights = combine((1.0, a), (-1.0, b))
    assert dict(zip(coords.tolist(), weights.tolist(), strict=True)) == {1: 1.0, 5: -1.0}


SCENES = {
    "clamp": {"bc": [{"type": "clamp", "at": "a@0"}]},
    "inclined roller between nodes": {
        "bc": [{"type": "clamp", "at": "a@0"}, {"type": "roller", "at": "a@0.61", "normal": [1, 2]}]
    },
    "pin joint": {
        "bc": [{"type": "clamp", "at": "a@0"}, {"type": "pin", "at": "b@1"}],
        "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
    },
    "weld": {"bc": [{"type": "clamp", "at": "a@0"}], "joints": [{"type": "weld", "between": ["a@1", "b@0"]}]},
}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("name", [*helpers.KINDS.values(), "li", "ancf[2,2]"])
def test_reduction_of_forces_is_the_transpose_of_expansion(name, scene):
    bodies = {
        "a": helpers.body(helpers.line(1.0), helpers.element(name, 3)),
        "b": helpers.body(helpers.line(1.0, 0.8, (1.0, 0.0)), helpers.element(name, 2)),
    }
    if "b@" not in str(SCENES[scene]):
        del bodies["b"]
    model = helpers.build(bodies, **SCENES[scene])
    num, rng = model.numbering, np.random.default_rng(2)
    z, y, d = rng.normal(size=num.n_unknowns), rng.normal(size=len(num.place)), np.zeros(len(num.place))
    num.expand(z, d)
    assert y @ d == pytest.approx(num.reduce(y) @ z, rel=1e-12)
    for row in model.rows:
        assert row.coefs @ d[row.coords] == pytest.approx(0, abs=1e-12)
    np.testing.assert_array_equal(num.place[num.free], np.arange(num.n_unknowns))


def test_a_redundant_support_is_reported_and_a_contradiction_is_an_error():
    beam = {"b": helpers.body(helpers.line(1.0), helpers.element("vallejo", 2))}
    clamp = {"type": "clamp", "at": "b@0"}
    model = helpers.build(beam, bc=[clamp, {"type": "pin", "at": "b@0"}])
    assert any("redundant" in w for w in model.warnings)
    with pytest.raises(CaseError, match="contradicts"):
        helpers.build(beam, bc=[clamp, {"name": "lift", "type": "prescribed", "at": "b@0", "uy": 0.1}])


TABLE = {"type": "table", "t": [0, 0.1, 0.15, 0.2, 1], "value": [0, 0, 0.1, 0, 0]}
PULSE = {"type": "expression", "value": "exp(-((t - 0.5437)/2e-3)^2)"}


@pytest.mark.parametrize("course", [TABLE, {**TABLE, "smooth": True}, PULSE,
                                    {"type": "sine", "frequency": 5, "phase": 0},
                                    {"type": "expression", "value": "1 if 0.41 < t < 0.4100001 else 0"}])
def test_motions_of_one_point_are_compared_as_functions_not_at_round_times(course):
    """A pin, and a motion that is zero at 0, 0.1, ..., 1 but not between."""
    beam = {"b": helpers.body(helpers.line(1.0), helpers.element("vallejo", 2))}
    scene = [{"type": "clamp", "at": "b@0"}, {"name": "lift", "type": "prescribed", "at": "b@0", "uy": course}]
    for bc in (scene, scene[::-1]):
        with pytest.raises(CaseError, match="contradicts"):
            helpers.build(beam, bc=bc)


def test_equal_motions_in_different_forms_may_both_be_given():
    beam = {"b": helpers.body(helpers.line(1.0), helpers.element("vallejo", 2))}
    spelled = [{"type": "table", "t": [0, 0.25, 1], "value": [0, 0.5, 0.5]}, {"type": "expression", "value":
               "2*t if t < 0.25 else 0.5"}, {"type": "ramp", "t0": 0, "t1": 0.25, "scale": 0.5}]
    for a in spelled:
        for b in spelled:
            helpers.build(beam, bc=[{"type": "prescribed", "at": "b@0", "x": 0, "angle": 0, "y": a},
                                    {"type": "prescribed", "at": "b@0", "y": b}])
