"""The discrete model for Python: the user's own solvers and integrators agree with those of ancf2d."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import eigsh, spsolve

import ancf2d

G = 9.81
STATIC = {"type": "static"}
DYNAMIC = {"type": "dynamic", "t_end": 0.03, "tolerance": 1e-11}


def body(element: str, start: tuple[float, float], end: tuple[float, float], count: int = 3, E: float = 2e7,
         **material: Any) -> dict[str, Any]:
    kind = {"type": element} if element == "rigid" else {"type": element, "count": count}
    return {"geometry": {"type": "line", "start": list(start), "end": list(end)}, "element": kind,
            "section": {"height": 0.05, "width": 0.02}, "material": {"E": E, "nu": 0.3, "rho": 1000, **material}}


def cantilever(element: str = "vallejo", **more: Any) -> dict[str, Any]:
    return {"bodies": {"beam": body(element, (0, 0), (1, 0))},
            "boundary_conditions": [{"name": "wall", "type": "clamp", "at": "beam@0"}],
            "loads": [{"type": "force", "at": "beam@1", "value": [0, -8]}],
            "solver": STATIC, "output": {"probes": {"tip": "beam@1"}}, **more}


# a frame of two beams with a hinge, and a beam that carries a rigid bar, whose length takes a multiplier
FRAME = cantilever(bodies={"beam": body("vallejo", (0, 0), (1, 0)), "column": body("vallejo", (1, 0), (1, -1))},
                   boundary_conditions=[{"type": "clamp", "at": "beam@0"}, {"type": "pin", "at": "column@1"}],
                   joints=[{"type": "pin", "between": ["beam@1", "column@0"]}],
                   loads=[{"type": "force", "at": "beam@0.5", "value": [3, -80]}])
WITH_BAR = cantilever(bodies={"beam": body("vallejo", (0, 0), (1, 0)), "bar": body("rigid", (1, 0), (1.5, 0.5))},
                      joints=[{"type": "weld", "between": ["beam@1", "bar@0"]}],
                      loads=[{"type": "force", "at": "bar@1", "value": [1, -6]}])
# everything whose forces depend on rates, and a load that turns with the beam
DAMPED = cantilever(
    bodies={"beam": body("vallejo", (0, 0), (1, 0), 2, damping={"kelvin_voigt": 0.01})}, solver=DYNAMIC,
    damping={"rayleigh": {"alpha": 0.7, "beta": 0.002}},
    loads=[{"type": "follower_force", "at": "beam@1", "value": [1, -3]}],
    springs=[{"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 8, "damping": 0.3, "length": 0.3},
             {"type": "rotational", "between": ["beam@1", [0, 0]], "stiffness": 0.05, "damping": 0.02}])
PENDULUM = {"bodies": {"rod": body("rigid", (0, 0), (0.8, 0))},
            "boundary_conditions": [{"name": "pivot", "type": "pin", "at": "rod@0"}],
            "loads": [{"type": "gravity", "value": [0, -G]}], "solver": DYNAMIC,
            "output": {"probes": {"end": "rod@1"}}}


def undamped(case: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in case.items() if key != "damping"}


def newton(s: ancf2d.DiscreteModel) -> np.ndarray:
    d = np.zeros(s.n)
    for factor in (0.25, 0.5, 0.75, 1.0):
        for _ in range(12):
            d -= spsolve(s.tangent(d, factor), s.residual(d, t=factor))
    return d


def integrated(s: ancf2d.DiscreteModel, t_end: float) -> tuple[np.ndarray, np.ndarray]:
    n = s.n
    found = solve_ivp(lambda t, y: np.append(y[n:], s.accelerations(y[:n], y[n:], t)[0]), (0, t_end),
                      np.concatenate(s.initial()), method="DOP853", rtol=1e-11, atol=1e-13)
    return found.y[:n, -1], found.y[n:, -1]


def some(s: ancf2d.DiscreteModel, size: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, size, s.n)


# ---------------------------------------------------------------------------- statics

@pytest.mark.parametrize("case", [cantilever(), cantilever("reissner3"), FRAME, WITH_BAR],
                         ids=["vallejo", "reissner3", "frame", "multipliers"])
def test_newtons_method_in_five_lines_finds_the_equilibrium_of_ancf2d(case: dict[str, Any]) -> None:
    s, tool = ancf2d.system(case), ancf2d.solve(case)
    d = newton(s)
    assert np.abs(s.expand(d) - tool.d[-1]).max() < 1e-9 * np.abs(tool.d[-1]).max()
    assert np.array_equal(s.e0, tool.e0)
    assert s.probe("tip", d) == pytest.approx(tool.probes["tip"], rel=1e-9, abs=1e-12)


def test_linear_statics_takes_one_step_from_anywhere() -> None:
    case = cantilever(solver={"type": "linear_static"})
    s = ancf2d.system(case)
    d = some(s, 0.1)
    d -= spsolve(s.tangent(d), s.residual(d))
    assert s.probe("tip", d) == pytest.approx(ancf2d.solve(case).probes["tip"], rel=1e-9)


def test_states_of_a_solution_are_accepted() -> None:
    s, tool = ancf2d.system(FRAME), ancf2d.solve(FRAME)
    assert np.abs(s.residual(tool.d[-1])).max() < 1e-7
    assert np.abs(s.residual(0.5 * tool.d[-1])).max() > 1e-3
    assert s.probe("tip", tool.d[-1]) == pytest.approx(tool.probes["tip"], rel=1e-12)


def test_modes_follow_from_tangent_and_mass() -> None:
    case = cantilever(solver={"type": "eigen", "modes": 3})
    s = ancf2d.system(case)
    found = eigsh(s.tangent(np.zeros(s.n), t=0.0), 3, s.mass, sigma=0, return_eigenvectors=False)
    omega = [mode["omega"] for mode in ancf2d.solve(case).summary["frequencies"]]
    assert np.sqrt(np.sort(found)) == pytest.approx(omega, rel=1e-8)


# ---------------------------------------------------------------------------- unknowns

def test_names_tell_unknowns_and_multipliers_apart() -> None:
    s = ancf2d.system(WITH_BAR)
    assert len(set(s.names)) == s.n == len(s.names)
    # of the bar's length and of the direction of the weld
    assert s.multipliers.tolist() == [s.n - 2, s.n - 1]
    assert [k for k, name in enumerate(s.names) if name.startswith("the multiplier of ")] == s.multipliers.tolist()
    s = ancf2d.system(cantilever(solver={"type": "linear_static"}))
    one = np.zeros(s.n)
    one[s.names.index("y of beam at S = 1")] = 1.0
    assert s.probe("tip", one)["uy"] == 1.0
    assert s.probe("tip", one)["ux"] == 0.0
    assert np.count_nonzero(s.expand(one)) == 1


def test_sides_of_a_corner_have_names_of_their_own() -> None:
    bent = {**body("vallejo", (0, 0), (1, 0)), "geometry": {"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]]}}
    s = ancf2d.system(cantilever(bodies={"beam": {**bent, "element": {"type": "vallejo", "count": 4}}}))
    assert len(set(s.names)) == s.n


def test_expanding_adds_supports_and_prescribed_motion() -> None:
    lifted = {"type": "prescribed", "at": "beam@0", "x": 0, "y": {"type": "expression", "value": "0.3*t^2"}}
    s = ancf2d.system(cantilever(boundary_conditions=[lifted], solver=DYNAMIC))
    none = np.zeros(s.n)
    foot = [s.expand(none, 2.0, order)[:2] for order in range(3)]
    assert np.array(foot) == pytest.approx(np.array([[0, 1.2], [0, 1.2], [0, 0.6]]), abs=1e-14)
    with pytest.raises(ValueError, match=r"violates supports and joints by 1\.2"):
        s.residual(np.zeros(len(s.e0)), t=2.0)


# ---------------------------------------------------------------------------- derivatives

@pytest.mark.parametrize("case", [DAMPED, WITH_BAR], ids=["follower and springs", "multipliers"])
def test_the_tangent_is_the_derivative_of_the_residual(case: dict[str, Any]) -> None:
    s, h = ancf2d.system(case), 1e-6
    d, way = some(s, 0.02), some(s, 1.0, 2)
    by_differences = (s.residual(d + h * way) - s.residual(d - h * way)) / (2 * h)
    K = s.tangent(d) @ way
    assert np.abs(K - by_differences).max() < 1e-8 * np.abs(K).max()


def test_the_damping_matrix_is_the_derivative_by_rates_column_by_column() -> None:
    s = ancf2d.system(DAMPED)
    d, v, big = some(s, 0.02), some(s, 1.0, 2), 1e6
    rest, C = s.residual(d), s.damping(d)
    # forces are linear in rates, so that large ones leave no error
    columns = np.array([(s.residual(d, big * e) - rest) / big for e in np.eye(s.n)]).T
    assert np.abs(C - columns).max() < 1e-10 * np.abs(columns).max()
    assert np.abs(s.residual(d, v) - rest - C @ v).max() < 1e-9 * np.abs(C @ v).max()
    # without any of them there is none, and Rayleigh's alpha is in proportion to the mass
    bare = {**undamped(DAMPED), "bodies": {"beam": body("vallejo", (0, 0), (1, 0), 2)}, "springs": []}
    assert not ancf2d.system(bare).damping(d).nnz
    alone = ancf2d.system({**bare, "damping": {"rayleigh": {"alpha": 0.7}}})
    assert np.abs(alone.damping(d) - 0.7 * alone.mass).max() < 1e-14


def test_statics_have_a_damping_matrix_too() -> None:
    moving = ancf2d.system(undamped(DAMPED))
    s = ancf2d.system({**undamped(DAMPED), "solver": STATIC})
    d = some(s, 0.02)
    assert s.damping(d).nnz
    assert np.abs(s.damping(d) - moving.damping(d)).max() < 1e-12 * np.abs(s.damping(d)).max()


def test_a_turning_frame_has_coriolis_forces() -> None:
    s = ancf2d.system(cantilever(loads=[], steady_rotation={"omega": 3.0, "about": [0, 0]}))
    C = s.damping(np.zeros(s.n)).toarray()
    assert np.abs(C + C.T).max() < 1e-12 * np.abs(C).max()
    v = np.zeros(s.n)
    v[[k for k, name in enumerate(s.names) if name.startswith("x of")]] = 1.0
    # in one direction the forces across are 2 omega times the mass that moves
    up = [k for k, name in enumerate(s.names) if name.startswith("y of")]
    assert s.residual(0 * v, v)[up].sum() - s.residual(0 * v)[up].sum() == pytest.approx(
        6.0 * (v @ s.mass @ v), rel=1e-2 + 1e-9)


def test_the_mass_matrix_moves_the_mass() -> None:
    s = ancf2d.system({**PENDULUM, "boundary_conditions": [], "bodies": {"rod": body("vallejo", (0, 0), (0.8, 0))}})
    v = np.array([float(name.startswith("x of")) for name in s.names])
    assert v @ s.mass @ v == pytest.approx(1000 * 0.05 * 0.02 * 0.8, rel=1e-12)


# ---------------------------------------------------------------------------- motion

@pytest.mark.parametrize("damped", [pytest.param(False, marks=pytest.mark.slow), True],
                         ids=["free", "spring and damper"])
def test_scipy_integrates_a_cable_as_ancf2d_does(damped: bool) -> None:
    spring = {"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 80, "damping": 3, "length": 0.3}
    case = cantilever("cable", bodies={"beam": body("cable", (0, 0), (1, 0), 2, 2e5)}, solver=DYNAMIC,
                      boundary_conditions=[{"type": "pin", "at": "beam@0"}], springs=[spring] * damped,
                      loads=[{"type": "gravity", "value": [0, -G]}])
    s, tool = ancf2d.system(case), ancf2d.solve(case)
    d, v = integrated(s, DYNAMIC["t_end"])
    assert np.abs(s.expand(d) - tool.d[-1]).max() < 1e-9 * np.abs(tool.d[-1]).max()
    assert s.probe("tip", d, v)["vy"] == pytest.approx(tool.probes["tip"]["vy"], rel=1e-8)
    a = s.accelerations(d, v, 0.03)[0]
    assert np.abs(s.mass @ a + s.residual(d, v, 0.03)).max() < 1e-12 * np.abs(s.mass @ a).max()


@pytest.mark.parametrize("lift", [None, "0.1*sin(3*t)^2"], ids=["fixed pivot", "moving pivot"])
def test_a_rigid_pendulum_follows_its_equation(lift: str | None) -> None:
    # (L^2/3 + h^2/12) theta'' = -(g + y'') L/2 cos(theta), y that of the pivot; the rod's length takes a multiplier
    pivot = {"type": "pin", "at": "rod@0"} if lift is None else {
        "type": "prescribed", "at": "rod@0", "x": 0, "y": {"type": "expression", "value": lift}}
    s = ancf2d.system(PENDULUM, {"boundary_conditions": [pivot]})

    def turn(t: float, y: np.ndarray) -> list[float]:
        up = 0.0 if lift is None else 0.1 * 18 * np.cos(6 * t)
        return [y[1], -0.4 / (0.8**2 / 3 + 0.05**2 / 12) * (G + up) * np.cos(y[0])]
    theta, omega = solve_ivp(turn, (0, 0.2), [0, 0], rtol=1e-12, atol=1e-12).y[:, -1]
    d, v = integrated(s, 0.2)
    end = s.probe("end", d, v, 0.2)
    height = 0.0 if lift is None else 0.1 * np.sin(0.6) ** 2
    assert (end["x"], end["y"]) == pytest.approx((0.8 * np.cos(theta), height + 0.8 * np.sin(theta)), abs=1e-8)
    assert end["omega"] == pytest.approx(omega, abs=1e-8)


def test_the_multipliers_balance_the_motion() -> None:
    s = ancf2d.system(PENDULUM, {"initial": {"rotation_rate": {"omega": 2.0, "about": [0, 0]}}})
    d, v = s.initial()
    assert s.probe("end", d, v, 0.0)["vy"] == pytest.approx(1.6, rel=1e-12)
    a, multipliers = s.accelerations(d, v, 0.0)
    assert not a[s.multipliers].any()
    d[s.multipliers] = multipliers
    assert np.abs(s.mass @ a + s.residual(d, v, 0.0)).max() < 1e-10


# ---------------------------------------------------------------------------- what is refused

def test_wrong_arrays_and_names_are_refused() -> None:
    s = ancf2d.system(cantilever())
    with pytest.raises(ValueError, match=rf"d has the shape \(3,\); expected \({s.n},\)"):
        s.residual(np.zeros(3))
    with pytest.raises(ValueError, match="v has the shape"):
        s.residual(np.zeros(s.n), np.zeros((s.n, 1)))
    with pytest.raises(TypeError, match="use real numbers"):
        s.residual(np.zeros(s.n) + 1e-20j)
    with pytest.raises(ValueError, match="no probe 'tap'; it has tip"):
        s.probe("tap", np.zeros(s.n))
    with pytest.raises(ancf2d.ComputationError, match="only dynamic cases"):
        s.initial()
    bar = ancf2d.system(WITH_BAR)
    with pytest.raises(ValueError, match=r"the unknowns$"):
        bar.residual(np.zeros(len(bar.e0)))


def test_a_body_without_density_has_no_mass_matrix() -> None:
    light = cantilever(bodies={"beam": {**body("vallejo", (0, 0), (1, 0)), "material": {"E": 2e7, "nu": 0.3}}})
    with pytest.raises(ancf2d.ComputationError, match="beam has no mass"):
        _ = ancf2d.system(light).mass


def test_an_open_mesh_is_refused() -> None:
    with pytest.raises(ancf2d.CaseError, match="type and count"):
        ancf2d.system(cantilever(goal={"probe": "tip", "quantity": "uy"}, accuracy=1e-3))


FLOOR = {"floor": {"type": "half_plane", "through": [0, -1], "normal": [0, 1]}}
HINTED = {"type": "expression", "value": "-tip.uy"}


@pytest.mark.parametrize(("scene", "words"), [
    ({"loads": [{"type": "force", "at": "beam@1", "value": [0, 1], "amplitude": HINTED}]},
     "loads.0: it depends on tip.uy"),
    ({"loads": [{"type": "force", "at": {"on": "beam", "s": {"type": "ramp"}}, "value": [0, 1]}]},
     "loads.0: it moves along a body"),
    ({"masses": [{"at": {"on": "beam", "s": {"type": "ramp"}}, "mass": 1}]}, "masses.0: it moves along a body"),
    ({"boundary_conditions": [{"type": "clamp", "at": "beam@0"},
                              {"type": "pin", "at": "beam@1", "active": {"to": 1}}]},
     "boundary_conditions.1: it is let go"),
    ({"springs": [{"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 1,
                   "active": {"until": "tip.uy > 1"}}]}, "springs.0: it waits for a condition"),
    ({"bodies": {"beam": body("vallejo", (0, 0), (1, 0), viscoelastic=[{"modulus": 1, "time": 1}])}},
     "bodies.beam: its material remembers past strains"),
    ({"obstacles": FLOOR, "contacts": [{"between": ["beam", "floor"]}]}, "contacts.0: impacts without a law"),
    ({"obstacles": FLOOR, "contacts": [{"between": ["beam", "floor"], "friction": 0.1, "law": {"stiffness": 1}}],
      "solver": STATIC}, "contacts.0.friction: friction depends on the load path")],
    ids=["feedback", "moving force", "moving mass", "let go", "condition", "memory", "impacts", "friction"])
def test_cases_beyond_the_residual_are_refused(scene: dict[str, Any], words: str) -> None:
    with pytest.raises(ancf2d.CaseError, match=words):
        ancf2d.system(cantilever(**{"solver": DYNAMIC, **scene}))
