"""Flutter and divergence under follower loads: published and closed-form critical loads."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

import ancf2d
from ancf2d.errors import ComputationError
from ancf2d.solvers.small_motions.flutter import UNDAMPED, _Sample, _Track

TIP = {"type": "follower_force", "at": "c@1", "value": [-1, 0]}


def column(load: dict[str, Any] = TIP, modes: int = 1, element: str = "cable", count: int = 10, solver: Any = None,
           **more: Any) -> dict[str, Any]:
    """A slender clamped column of EI = rhoA = L = 1."""
    body = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "element": {"type": element, "count": count},
            "section": {"EA": 1e7, "kGA": 1e7, "EI": 1, "rhoA": 1, "rhoI": 1e-7}, **more.pop("body", {})}
    return {"bodies": {"c": body}, "boundary_conditions": [{"type": "clamp", "at": "c@0"}], "loads": [load],
            "solver": solver or {"type": "buckling", "modes": modes}, **more}


def first(case: dict[str, Any]) -> dict[str, Any]:
    summary = ancf2d.solve(case, states=False).summary
    assert summary["load_factors"] == [c["factor"] for c in summary["critical"]]
    found: dict[str, Any] = summary["critical"][0]
    return found


@pytest.mark.parametrize(("element", "count"), [("cable", 16), pytest.param("reissner3", 24, marks=pytest.mark.slow)])
def test_becks_column(element: str, count: int) -> None:
    """Beck 1952: 20.0509; the frequency there is 11.0156."""
    found = first(column(element=element, count=count))
    assert found["kind"] == "flutter"
    assert found["factor"] == pytest.approx(20.0509, rel=1e-4)
    assert found["omega"] == pytest.approx(11.0156, rel=1e-4)


@pytest.mark.parametrize(("element", "slenderness", "count"), [
    ("vallejo", 1e5, 16), ("reissner3", 1e6, 16), pytest.param("cable", 1e8, 200, marks=pytest.mark.slow),
    pytest.param("cable", 1e10, 16, marks=pytest.mark.slow)])
def test_very_slender_columns_flutter_at_the_same_load(element: str, slenderness: float, count: int) -> None:
    """Shifts above the round-off of thin sections miss the lowest motions. A warning states where their digits end."""
    EI, length = 2e11 * 0.1**4 / 12.0, 0.1 * slenderness
    section = {"section": {"height": 0.1, "width": 0.1}, "material": {"E": 2e11, "nu": 0.3, "rho": 7850}}
    body = {"geometry": {"type": "line", "start": [0, 0], "end": [length, 0]}, **section}
    case = column({**TIP, "value": [-EI / length**2, 0]}, element=element, count=count)
    case["bodies"]["c"] = {"element": case["bodies"]["c"]["element"], **body}
    solution = ancf2d.solve(case, states=False)
    assert solution.summary["load_factors"] == pytest.approx([20.05], rel=1e-4)
    lost = [text for text in solution.warnings if "round-off limits" in text]
    assert bool(lost) == (slenderness > 1e7 and (count > 100 or slenderness > 1e9))


def test_sections_without_rotary_inertia_flutter_too() -> None:
    """Their rotations have stiffness and no mass: the lowest modes keep their digits despite a huge K/M."""
    section = {"EA": 2e5, "kGA": 2e5, "EI": 1, "rhoA": 1, "rhoI": 0}
    found = first(column(element="reissner3", count=16, body={"section": section}))
    assert found["kind"] == "flutter"
    assert found["factor"] == pytest.approx(20.0509, rel=1e-3)
    assert found["omega"] == pytest.approx(11.0156, rel=1e-3)


def test_leipholz_column() -> None:
    """Leipholz 1962: 40.0537 under a uniform tangential load."""
    load = {"type": "distributed", "on": "c", "value": [-1, 0], "follower": True}
    assert first(column(load, count=16))["factor"] == pytest.approx(40.0537, rel=1e-4)


def test_internal_damping_destabilises_becks_column() -> None:
    """Bolotin & Zhinzher 1969: 10.94 with vanishing Kelvin-Voigt damping; external damping changes little."""
    found = first(column(body={"material": {"damping": {"kelvin_voigt": 1e-4}}}))
    assert found["factor"] == pytest.approx(10.94, rel=1e-3)
    assert found["omega"] == pytest.approx(5.40, rel=1e-2)
    assert first(column(damping={"rayleigh": {"alpha": 1e-3}}))["factor"] == pytest.approx(20.0509, rel=1e-3)


def follower_column(P: Any, omega2: Any, mass: float = 0.0) -> Any:
    """Return what is 0 at the eigenvalues of Beck's column with a mass at its tip, w'''' + P w'' = omega^2 w.

    w(0) = w'(0) = w''(1) = 0, w'''(1) = -m omega^2 w(1).
    """
    root = np.sqrt(P * P / 4 + omega2)
    a, b = np.sqrt(root - P / 2), np.sqrt(root + P / 2)
    ch, sh, co, si = np.cosh(a), np.sinh(a), np.cos(b), np.sin(b)
    w1, w2 = ch - co, b * sh - a * si
    m1, m2 = a * a * ch + b * b * co, a * b * (a * sh + b * si)
    q1, q2 = a**3 * sh - b**3 * si, a * b * (a * a * ch + b * b * co)
    return m1 * (q2 + mass * omega2 * w2) - m2 * (q1 + mass * omega2 * w1)


ZENER, TWO = ((0.5, 1.0),), ((0.3, 0.02), (0.2, 0.3))


# few and many unknowns; reissner3 is a million times as stiff across a section as it is in bending, and its meshes are
# coarser for their order
@pytest.mark.slow
@pytest.mark.parametrize(("element", "count", "terms", "rel"), [
    ("cable", 24, ZENER, 1e-5), ("cable", 16, TWO, 1e-5), ("reissner3", 24, ZENER, 1e-5)], ids=str)
def test_becks_column_of_a_relaxing_material(element: str, count: int, terms: Any, rel: float) -> None:
    """Flutter begins at P and omega where w'''' + P/e w'' = omega^2/e w with e = E(i omega)/E: two real equations."""
    found = first(column(element=element, count=count, body=relaxing(*terms)))
    assert found["kind"] == "flutter"
    factor, omega = fsolve(lambda x: _left(terms, x[0], 1j * x[1]), [found["factor"], found["omega"]], xtol=1e-12)
    assert found["factor"] == pytest.approx(factor, rel=rel)
    assert found["omega"] == pytest.approx(omega, rel=rel)
    assert 11.0 < factor < 17.0


def test_a_motion_that_only_seems_to_grow_gives_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the whole space has no critical factor although the followed modes seem to, a warning names the factor."""
    monkeypatch.setattr("ancf2d.solvers.small_motions.flutter._Track.refined", lambda self, start, low, high: None)
    summary = ancf2d.solve(column(), states=False).summary
    assert summary["load_factors"] == []
    told = [re.search(r"may begin to grow near the load factor ([\d.]+),", warning) for warning in summary["warnings"]]
    assert any(one and 20.0 < float(one[1]) < 30.0 for one in told)


@pytest.mark.slow_rows("32")
@pytest.mark.parametrize("count", [8, 32])
def test_a_column_that_bends_before_flutter_has_no_critical_loads(count: int) -> None:
    """EA theta^2 reaches EI/L^2 long before Beck's load, where the tip turns by 0.5 P_y/EI: on any mesh."""
    summary = ancf2d.solve(column({**TIP, "value": [-1, -0.05]}, modes=2, count=count), states=False).summary
    assert summary["load_factors"] == []
    told = [w for w in summary["warnings"] if "linear buckling does not apply" in w]
    assert float(re.search(r"the load factor ([\d.]+)\. ", told[0])[1]) == pytest.approx(0.0224153, rel=1e-4)
    assert len(summary["warnings"]) == 1


def test_motions_of_a_slender_relaxing_column_grow_as_in_the_beam_equation() -> None:
    case = column({**TIP, "value": [-17, 0]}, element="reissner3", count=12, body=relaxing(*ZENER),
                  solver={"type": "eigen", "modes": 4, "about": "static"})
    pairs = [complex(f["growth"], f["omega"])
             for f in ancf2d.solve(case, states=False).summary["frequencies"] if f["omega"] > 0.1]
    # relaxations that the load makes pairs of come in addition, on some machines more than on others
    assert len(pairs) == 4
    # the mesh resolves the lower two better
    for s, error in zip(pairs, (2e-4, 2e-4, 3e-3, 3e-3), strict=True):
        growth, omega = fsolve(lambda x: _left(ZENER, 17.0, complex(*x)), [s.real, s.imag], xtol=1e-12)
        assert abs(s - complex(growth, omega)) < error * abs(s)
    assert max(s.real for s in pairs) == pytest.approx(0.01, rel=0.05)


def _left(terms: Any, P: float, s: complex) -> list[float]:
    e = 1.0 + sum(g * s * tau / (1.0 + s * tau) for g, tau in terms)
    value = follower_column(P / e, -s * s / e)
    return [value.real, value.imag]


def relaxing(*terms: tuple[float, float]) -> dict[str, Any]:
    return {"material": {"viscoelastic": [{"modulus": g, "time": tau} for g, tau in terms]}}


@pytest.mark.slow
def test_a_column_of_two_materials_flutters_at_an_imaginary_eigenvalue() -> None:
    """The eigenvalues under the critical load, about its equilibrium, are those of each body's complex modulus."""
    case = column({**TIP, "at": "d@1"}, body=relaxing((0.5, 1.0)), count=4)
    case["bodies"]["d"] = {**case["bodies"]["c"], **relaxing((3.0, 0.1), (0.2, 5.0)),
                           "geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}}
    case["joints"] = [{"type": "weld", "between": ["c@1", "d@0"]}]
    found = first(case)
    assert found["kind"] == "flutter"
    case["loads"][0]["value"] = [-found["factor"], 0]
    pairs = ancf2d.solve({**case, "solver": {"type": "eigen", "modes": 3, "about": "static"}},
                         states=False).summary["frequencies"]
    least = min(pairs, key=lambda one: abs(one["growth"]) if one["omega"] else np.inf)
    assert abs(least["growth"]) < 1e-5 * least["omega"]
    assert least["omega"] == pytest.approx(found["omega"], rel=1e-5)


@pytest.mark.slow
def test_a_creeping_column_diverges_at_the_load_of_its_long_term_modulus() -> None:
    dead = {"type": "force", "at": "c@1", "value": [-1, 0]}
    still = {"type": "follower_force", "at": "c@0", "value": [-1, 0]}
    found = first(column(dead, body=relaxing((0.5, 1.0)), loads=[dead, still]))
    assert found == {"factor": pytest.approx(math.pi**2 / 4, rel=1e-4), "kind": "divergence", "omega": 0.0}


def pflueger(mass: float) -> float:
    """The critical load of Beck's column with a mass at its tip, where the two lowest frequencies meet."""
    def roots(P: float) -> int:
        values = follower_column(P, np.linspace(1e-3, 600, 20001), mass)
        return int((np.diff(np.sign(values)) != 0).sum())
    low, high = 5.0, 25.0
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if roots(middle) >= 2 else (low, middle)
    return low


@pytest.mark.slow
def test_pfluegers_column_with_a_mass_at_its_tip() -> None:
    assert pflueger(0.0) == pytest.approx(20.0509, rel=1e-4)
    found = first(column(masses=[{"at": "c@1", "mass": 1}]))
    assert found["factor"] == pytest.approx(pflueger(1.0), rel=1e-4)


# Ziegler's pendulum: rigid links of length 1, masses 2 and 1 at their ends, springs of stiffness 1 at their joints
def ziegler(damping: float, load: float = -1.0, **more: Any) -> dict[str, Any]:
    link = {"element": {"type": "rigid", "mass": 1e-9, "inertia": 1e-9}}
    return {"bodies": {"lower": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, **link},
                       "upper": {"geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}, **link}},
            "boundary_conditions": [{"type": "pin", "at": "lower@0"}],
            "joints": [{"type": "pin", "between": ["lower@1", "upper@0"]}],
            "masses": [{"at": "lower@1", "mass": 2}, {"at": "upper@1", "mass": 1}],
            "springs": [{"type": "rotational", "between": between, "stiffness": 1, "damping": damping}
                        for between in (["lower@0", [0, 0]], ["lower@1", "upper@0"])],
            "loads": [{"type": "follower_force", "at": "upper@1", "value": [load, 0]}],
            "solver": {"type": "buckling", "modes": 2}, **more}


def test_zieglers_pendulum() -> None:
    """Ziegler 1952: 7/2 - sqrt 2 without damping, 41/28 with vanishing equal dampers; divergence at 7/2 + sqrt 2."""
    still, divergence = ancf2d.solve(ziegler(0.0), states=False).summary["critical"]
    assert still["factor"] == pytest.approx(3.5 - math.sqrt(2), rel=1e-7)
    assert still["omega"] == pytest.approx(2**-0.25, rel=1e-4)
    assert divergence == {"factor": pytest.approx(3.5 + math.sqrt(2), rel=1e-6), "kind": "divergence", "omega": 0.0}
    assert first(ziegler(1e-4))["factor"] == pytest.approx(41 / 28, rel=1e-4)


@pytest.mark.parametrize("beyond", [1e-3, 1e-5, 1e-7])
def test_narrow_bands_of_divergence_are_found(beyond: float) -> None:
    """The share b = 4/9 (1 + beyond) of the load is dead: det K = 1 - 3 b P + b P^2 < 0 about P = 3/2 only."""
    b = 4 / 9 * (1 + beyond)
    case = ziegler(0.0, b - 1)
    case["loads"].append({"type": "force", "at": "upper@1", "value": [-b, 0]})
    found = first(case)
    assert found["kind"] == "divergence"
    assert found["factor"] == pytest.approx((3 * b - math.sqrt(9 * b * b - 4 * b)) / (2 * b), rel=1e-6)


@pytest.mark.parametrize(("coupling", "damping"), [(1e-2, 0.0), (1e-3, 0.0), (1e-2, 1e-4)])
def test_narrow_bands_of_flutter_are_found(coupling: float, damping: float) -> None:
    """A pendulum next to Ziegler's, coupled to its upper link by a soft spring, flutters where frequencies cross."""
    case = ziegler(damping)
    case["bodies"]["third"] = {"geometry": {"type": "line", "start": [0, -1], "end": [1, -1]},
                               "element": {"type": "rigid", "mass": 1e-9, "inertia": 1e-9}}
    case["boundary_conditions"].append({"type": "pin", "at": "third@0"})
    case["masses"].append({"at": "third@1", "mass": 1})
    case["springs"] += [{"type": "rotational", "between": ["third@0", [0, -1]], "stiffness": 0.25},
                        {"type": "rotational", "between": ["upper@0", "third@0"], "stiffness": coupling}]

    M, C = np.diag([3.0, 1, 1]), np.zeros((3, 3))
    M[0, 1] = M[1, 0] = 1
    C[:2, :2] = damping * np.array([[2.0, -1], [-1, 1]])
    K = np.array([[2, -1, 0], [-1, 1 + coupling, -coupling], [0, -coupling, 0.25 + coupling]])

    def where_it_grows(P: np.ndarray) -> int:
        A = np.zeros((len(P), 6, 6))
        A[:, :3, 3:], A[:, 3:, 3:] = np.eye(3), -np.linalg.solve(M, C)
        A[:, 3:, :3] = -np.linalg.solve(M, K - P[:, None, None] * np.array([[1, -1, 0], [0, 0, 0], [0, 0, 0]]))
        # the round-off of a double eigenvalue; with damping all are simple
        grows = np.linalg.eigvals(A).real.max(axis=1) > (1e-9 if damping else 1e-6)
        assert grows.any()
        assert not grows[0]
        return int(np.argmax(grows))

    coarse = np.linspace(1.2, 1.45, 2501)
    k = where_it_grows(coarse)
    P = np.linspace(coarse[k - 1], coarse[k], 11)
    found = first(case)
    assert found["kind"] == "flutter"
    assert found["factor"] == pytest.approx(P[where_it_grows(P)], abs=2e-5)


def ziegler_eigenvalues(P: float, c: float) -> np.ndarray:
    """M = [[3, 1], [1, 1]], C = c [[2, -1], [-1, 1]], K = [[2 - P, P - 1], [-1, 1]] in the angles of the links."""
    M, C = np.array([[3.0, 1], [1, 1]]), c * np.array([[2.0, -1], [-1, 1]])
    K = np.array([[2 - P, P - 1], [-1, 1.0]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.linalg.eigvals(A)


@pytest.mark.parametrize(("most", "at"), [(0.04, 0.4), (0.01, 0.7)])
def test_a_pair_that_grows_between_two_load_factors_is_predicted_from_both(most: float, at: float) -> None:
    """D = most - (f - at)^2 of the pair 10 i + sqrt(D), 10 i - sqrt(D): it grows most at f = at, and cubics are exact.
    """
    track = object.__new__(_Track)
    track.limit, track.lowest = UNDAMPED, 10.0

    def sample(f: float) -> _Sample:
        root = np.sqrt(complex(most - (f - at) ** 2))
        return _Sample(f, 10j + np.array([-root, root]), (f - at) * np.array([1.0, -1.0]) / root, 0)
    assert track._predicted(sample(0.0), sample(1.0), False) == pytest.approx(at, abs=1e-6)
    # what grows at both is none that begins between them
    near = 0.5 * math.sqrt(most)
    assert track._predicted(sample(at - near), sample(at + near), False) is None


def test_modes_about_a_state_under_a_follower_load() -> None:
    case = ziegler(0.1, -1.8, solver={"type": "eigen", "modes": 2, "about": "static"})
    summary = ancf2d.solve(case, states=False).summary
    found = [complex(f["growth"], f["omega"]) for f in summary["frequencies"]]
    exact = ziegler_eigenvalues(1.8, 0.1)
    np.testing.assert_allclose(found, sorted(exact[exact.imag > 0], key=lambda s: float(s.imag)), rtol=1e-6)
    assert max(s.real for s in found) > 0
    assert any("unstable" in w for w in summary["warnings"])


@pytest.mark.slow
def test_a_motion_beyond_the_critical_load_grows_as_its_eigenvalue_says() -> None:
    P, c = 1.8, 0.1
    s = max(ziegler_eigenvalues(P, c), key=lambda s: float(s.real))
    case = ziegler(c, -P, solver={"type": "dynamic", "t_end": 82, "tolerance": 1e-9},
                   initial={"bodies": {"upper": {"rotation_rate": {"omega": 1e-3, "about": [1, 0]}}}},
                   output={"interval": 0.1, "probes": {"tip": "upper@1"}})
    solution = ancf2d.solve(case)
    tip = solution.course["tip"]
    t, size = solution.course_t, np.hypot(tip["vy"] / s.imag, tip["uy"])
    period = 2 * math.pi / s.imag
    # by then the other mode, which decays with 0.19/s, is small beside this one
    late, later = 40.0, 40.0 + 4 * period
    assert later < t[-1]
    grown = math.log(np.interp(later, t, size) / np.interp(late, t, size)) / (later - late)
    assert grown == pytest.approx(s.real, rel=1e-2)


def test_dead_loads_diverge_and_pulling_loads_do_nothing() -> None:
    dead = {"type": "force", "at": "c@1", "value": [-1, 0]}
    assert first(column(dead)) == {"factor": pytest.approx(math.pi**2 / 4, rel=1e-4), "kind": "divergence",
                                   "omega": 0.0}
    pulled = ancf2d.solve(column({**TIP, "value": [1, 0]}), states=False).summary
    assert pulled["critical"] == []
    assert any("no small motion grows" in w for w in pulled["warnings"])


def test_flutter_needs_a_mass() -> None:
    massless = column(body={"section": {"EA": 1e7, "kGA": 1e7, "EI": 1}})
    with pytest.raises(ComputationError, match="depends on the mass"):
        ancf2d.solve(massless, states=False)


def test_root_locus_marks_where_frequencies_meet() -> None:
    solution = ancf2d.solve(column(count=6))
    table, (critical,) = solution.tables["locus"], solution.summary["critical"]
    at = critical["factor"]
    for factor, growth in zip(table["factor"], table["growth"], strict=True):
        assert factor > at or abs(growth) < 1e-3
    assert max(table["growth"]) > 1.0
    above, below = solution.plot("root_locus").axes
    assert above.get_ylabel().startswith("frequency")
    assert any("flutter" in text.get_text() for text in above.texts)
    assert below.get_xlabel().startswith("load factor")
