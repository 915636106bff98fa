"""Travelling beams and fluid-conveying pipes, compared with closed forms and Galerkin's method in the test."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers import chosen
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.optimize import brentq

import ancf2d

Array = NDArray[np.float64]
PINNED = [{"type": "pin", "at": "pipe@0"}, {"type": "roller", "at": "pipe@1", "fixed": "y"}]
# nothing moves along a line, so that ends may be held along it or not
CLAMPED = [{"name": "wall", "type": "clamp", "at": "pipe@0"}]


def pipe(beta: float = 0.5, element: str = "cable", count: int = 12, **more: Any) -> dict[str, Any]:
    """A pipe of unit length, bending stiffness and mass, of which the fluid has the share beta."""
    return {"bodies": {"pipe": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"EA": 1e6, "kGA": 1e6, "EI": 1, "rhoA": 1 - beta, "rhoI": 0},
                                "element": {"type": element, "count": count}}},
            "fluid": {"on": "pipe", "rhoA": beta, "velocity": 1}, **more}


def galerkin(beta: float, u: float, pinned: bool, terms: int = 14) -> NDArray[np.complex128]:
    """Eigenvalues of w'''' + u^2 w'' + 2 sqrt(beta) u w't + w_tt = 0, by polynomials with the geometric conditions.

    Paidoussis 1998, Eq. (3.70); the natural conditions are those of the weak form.
    """
    x, weight = legendre.leggauss(terms + 8)
    x, weight = 0.5 * (x + 1), 0.5 * weight
    base = np.polynomial.Polynomial([0, 1, -1] if pinned else [0, 0, 1])
    P = [base * np.polynomial.Polynomial(legendre.leg2poly(np.eye(terms)[k]))(np.polynomial.Polynomial([-1, 2]))
         for k in range(terms)]
    w, w1, w2 = (np.array([p.deriv(k)(x) if k else p(x) for p in P]) for k in range(3))
    M, K = (w * weight) @ w.T, (w2 * weight) @ w2.T
    K = K + u * u * (w * weight) @ w2.T
    C = 2 * math.sqrt(beta) * u * (w * weight) @ w1.T
    Z, I = np.zeros_like(M), np.eye(terms)
    return np.linalg.eigvals(np.block([[Z, I], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]]))


def critical(beta: float, low: float, high: float) -> tuple[float, float]:
    """The velocity u at which a cantilever begins to flutter, and the frequency there."""
    u = brentq(lambda u: galerkin(beta, u, False).real.max(), low, high, xtol=1e-10)
    s = galerkin(beta, u, False)
    return u, abs(s[np.argmax(s.real)].imag)


def velocities(case: dict[str, Any], modes: int = 1) -> list[dict[str, Any]]:
    return ancf2d.solve({**case, "solver": {"type": "buckling", "modes": modes}}, states=False).summary["critical"]


# read off the figure of Gregory & Paidoussis 1966: 0.1: 4.7, 0.2: 5.6, 0.5: 9.3
@pytest.mark.parametrize(("beta", "about"), chosen([(0.1, 4.7), (0.2, 5.6), (0.5, 9.3)], [(0.2,)]))
def test_cantilever_pipes_flutter(beta: float, about: float) -> None:
    expected, omega = critical(beta, 0.9 * about, 1.1 * about)
    found = velocities(pipe(beta, count=16, boundary_conditions=CLAMPED))[0]
    assert found["kind"] == "flutter"
    # the factor is on a velocity of 1, and u = U sqrt(rhoA/EI) L
    assert found["factor"] * math.sqrt(beta) == pytest.approx(expected, rel=2e-4)
    assert found["omega"] == pytest.approx(omega, rel=1e-3)
    assert expected == pytest.approx(about, rel=0.02)


@pytest.mark.parametrize("element", ["vallejo", "reissner3", "omar"])
@pytest.mark.slow
def test_element_types_agree(element: str) -> None:
    slender = {"EA": 1.2e5, "kGA": 4e4, "EI": 1, "rhoA": 0.8} if element != "reissner3" else {
        "EA": 1.2e5, "kGA": 4e4, "EI": 1, "rhoA": 0.8, "rhoI": 0.8 / 1.2e5}
    case = pipe(0.2, element, 24 if element == "omar" else 12, boundary_conditions=CLAMPED)
    case["bodies"]["pipe"]["section"] = slender
    assert velocities(case)[0]["factor"] == pytest.approx(critical(0.2, 5, 6)[0] / math.sqrt(0.2), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("element", "more", "order"), [
    ("cable", {}, 4), ("reissner3", {}, 3), ("reissner3", {"masses": [{"at": "pipe@1", "mass": 0.3}]}, 2),
    ("reissner3", {"boundary_conditions": [*CLAMPED, {"type": "roller", "at": "pipe@1", "fixed": "y"}]}, 4)])
def test_orders_of_pipes_follow_from_the_accuracy_of_the_outlet_direction(element: str, more: dict[str, Any],
                                                                          order: int) -> None:
    """The outflow of momentum acts along r_x at the end, whose error has order 2, or 3 if w_xxx vanishes there."""
    def frequency(count: int) -> float:
        case = pipe(0.2, element, count, **{"boundary_conditions": CLAMPED, **more})
        case["fluid"]["velocity"] = 5.0
        case["solver"] = {"type": "eigen", "modes": 1}
        return ancf2d.solve(case, states=False).summary["frequencies"][0]["omega"]

    exact, coarse, fine = (frequency(n) for n in (128, 8, 16))
    assert math.log2((coarse - exact) / (fine - exact)) == pytest.approx(order, abs=0.35)


def test_pinned_pipes_buckle_and_loads_stay() -> None:
    case = pipe(0.5, boundary_conditions=PINNED)
    found = velocities(case)[0]
    assert found["kind"] == "divergence"
    assert found["factor"] == pytest.approx(math.pi / math.sqrt(0.5), rel=1e-5)
    # u^2 + P = pi^2
    pushed = velocities({**case, "loads": [{"type": "force", "at": "pipe@1", "value": [-4, 0]}]})[0]
    assert pushed["factor"] == pytest.approx(math.sqrt((math.pi**2 - 4) / 0.5), rel=2e-5)


def test_flow_that_loads_the_reference_gives_a_warning() -> None:
    """A fluid straightens a bent pipe, and does nothing to a straight one, up to round-off."""
    told = "the reference is not an equilibrium, because material flows there. Use about: static"
    bend = {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": 1}
    for support in (PINNED, CLAMPED):
        case = pipe(boundary_conditions=support, solver={"type": "eigen", "modes": 1})
        assert not any("equilibrium" in w for w in ancf2d.solve(case, states=False).warnings)
        case["bodies"]["pipe"]["geometry"] = bend
        assert told in ancf2d.solve(case, states=False).warnings


def test_travelling_beams() -> None:
    # all that moves is the beam itself: beta = 1
    case = pipe(0.0, boundary_conditions=PINNED)
    del case["fluid"]
    for v in (0.5, 2.0, 3.0):
        found = ancf2d.solve({**case, "transport": {"on": "pipe", "velocity": v},
                              "solver": {"type": "eigen", "modes": 2}}, states=False).summary["frequencies"]
        expected = np.sort(galerkin(1.0, v, True).imag)
        expected = expected[expected > 1e-6][:2]
        assert [f["omega"] for f in found] == pytest.approx(expected, rel=2e-4)
    found = velocities({**case, "transport": [{"on": "pipe", "velocity": 2}]})
    assert found[0]["factor"] == pytest.approx(math.pi / 2, rel=1e-5)


# the tension over the stretch: of engineering strain, and of Green's
@pytest.mark.parametrize(("element", "tension"), [("cable", 1e3 / 1.001), ("vallejo", 0.5e6 * (1.001**2 - 1))])
def test_travelling_string(element: str, tension: float) -> None:
    # stretched by 1e-3: omega = n pi c (1 - v^2/c^2)
    case = pipe(0.0, element, 20, boundary_conditions=[
        {"type": "pin", "at": "pipe@0"}, {"type": "prescribed", "at": "pipe@1", "x": 1.001, "y": 0}])
    del case["fluid"]
    case["bodies"]["pipe"]["section"] = {"EA": 1e6, "kGA": 4e5, "EI": 1e-2, "rhoA": 1}
    case["solver"] = {"type": "eigen", "modes": 2, "about": "static"}
    c = math.sqrt(tension)
    found = ancf2d.solve({**case, "transport": {"on": "pipe", "velocity": 0.4 * c}},
                         states=False).summary["frequencies"]
    assert [f["omega"] for f in found] == pytest.approx([k * math.pi * c * (1 - 0.16) for k in (1, 2)], rel=1e-3)


@pytest.mark.parametrize("method", ["radau5", pytest.param("energy_momentum", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_motions_grow_at_the_rate_of_modes(method: str) -> None:
    u, _ = critical(0.2, 5, 6)
    velocity = 1.05 * u / math.sqrt(0.2)
    case = pipe(0.2, "cable", 6, boundary_conditions=CLAMPED)
    case["bodies"]["pipe"]["section"]["EA"] = 1e4
    case["fluid"]["velocity"] = velocity
    modes = ancf2d.solve({**case, "solver": {"type": "eigen", "modes": 3}}, states=False).summary["frequencies"]
    grows = max(modes, key=lambda f: f["growth"])
    assert grows["growth"] > 0
    motion = ancf2d.solve({**case, "loads": [{"type": "force", "at": "pipe@1", "value": [0, 1e-7], "amplitude": {
        "type": "table", "t": [0, 0.1, 0.2], "value": [0, 1, 0]}}],
        "solver": {"type": "dynamic", "t_end": 6, "tolerance": 1e-6, "method": method, "estimate": False},
        "output": {"interval": 0.01, "probes": {"tip": "pipe@1"}}})
    t, y = motion.course_t[300:], motion.course["tip"]["uy"][300:]
    # y = exp(growth t) (a cos + b sin) behind the other modes, which decay
    envelope = np.exp(grows["growth"] * t)[:, None] * np.stack(
        [np.cos(grows["omega"] * t), np.sin(grows["omega"] * t)], axis=1)
    left = np.linalg.lstsq(envelope, y, rcond=None)[1]
    assert math.sqrt(left[0] / (y @ y)) < 0.02
    assert motion.summary["energy_drift"] < 1e-4


@pytest.mark.slow
def test_the_fluid_has_weight_and_is_checked() -> None:
    case = pipe(0.25, boundary_conditions=CLAMPED, loads=[{"type": "gravity", "value": [0, -1e-3]}])
    case["fluid"]["velocity"] = 0.0
    solved = ancf2d.solve({**case, "initial": {"from": "static"},
                           "solver": {"type": "dynamic", "t_end": 1e-3, "tolerance": 1e-4}}, states=False)
    assert solved.reactions["wall"]["fy"] == pytest.approx(1e-3)
    with pytest.raises(ancf2d.CaseError, match="cannot be used with solver static"):
        ancf2d.load({**case, "solver": {"type": "static"}})
    with pytest.raises(ancf2d.CaseError, match="named twice"):
        ancf2d.load({**case, "fluid": [case["fluid"], case["fluid"]], "solver": {"type": "eigen"}})
    moving = {**case["fluid"], "velocity": {"type": "ramp"}}
    with pytest.raises(ancf2d.CaseError, match="needs solver dynamic"):
        ancf2d.load({**case, "fluid": moving, "solver": {"type": "eigen"}})


@pytest.mark.slow_rows("True-True")
@pytest.mark.parametrize(("curved", "told"), [(False, False), (True, True)])
def test_flow_that_changes_the_state_gives_a_warning(curved: bool, told: bool) -> None:
    """A straight hanging pipe, stretched a little by its weight, and an arc of 1 rad."""
    case = pipe(0.5, solver={"type": "buckling", "modes": 1}, boundary_conditions=CLAMPED,
                loads=[{"type": "gravity", "value": [0, -1]}])
    line = {"type": "line", "start": [0, 0], "end": [0, -1]}
    arc = {"type": "arc", "center": [1, 0], "radius": 1, "from": math.pi, "to": math.pi + 1}
    case["bodies"]["pipe"]["geometry"] = arc if curved else line
    warnings = ancf2d.solve(case, states=False).warnings
    assert any("flow along a curved body changes the state" in w for w in warnings) == told
