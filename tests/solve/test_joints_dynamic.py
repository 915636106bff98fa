"""Joints in motion compared with closed forms: beads on driven and free bars, a slider-crank of rigid bars."""

import helpers
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ancf2d.errors import ComputationError
from ancf2d.kernels.elements import force
from ancf2d.model.points import dot
from ancf2d.solvers.energy import Energies
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.registry import solve

OMEGA, R0, MASS = 3.0, 0.45, 1.7
RAIL = {"E": 2e14, "nu": 0.3, "rho": 100.0}
THICK = {"height": 0.05, "width": 0.05}
TURN = {"type": "expression", "value": f"{OMEGA}*t"}


def rigid(start, end, mass, inertia=0.0):
    """Return a rigid body."""
    geometry = {"type": "line", "start": start, "end": end}
    return {"geometry": geometry, "element": {"type": "rigid", "mass": mass, "inertia": inertia}}


def place(solution, at, k):
    """Return the position (2,) of BODY@S in state k."""
    e = solution.model.e0 + solution.states[k].d[: solution.model.n_q]
    return np.array([dot(c, e) for c in solution.point(at).position()])


def bead(rail, t_end, held, **solver):
    """Return the scene of a bead (a small bar, held at its centre) on a rail along x from the origin."""
    bodies = {"rail": rail, "bead": rigid([R0 - 0.05, 0], [R0 + 0.05, 0], MASS, 2e-3)}
    return helpers.build(
        bodies,
        {"type": "dynamic", "t_end": t_end, **solver},
        bc=[held],
        joints=[{"name": "sleeve", "type": "prismatic", "point": "bead@0.5", "on": "rail"}],
        initial={"rotation_rate": {"omega": OMEGA, "about": [0, 0]}},
    )


DRIVEN = {"type": "prescribed", "name": "shaft", "at": "rail@0", "ux": 0, "uy": 0, "angle": TURN}
HINGED = {"type": "pin", "name": "shaft", "at": "rail@0"}
RAILS = {
    "rigid": lambda: rigid([0, 0], [2, 0], 1.0, 0.5),
    "cable": lambda: helpers.body(helpers.line(2.0), helpers.element("cable", 4), THICK, RAIL),
}


def test_a_bead_on_a_turning_bar_flies_out_as_a_hyperbolic_cosine():
    solution = helpers.Solution(bead(RAILS["rigid"](), 0.6, DRIVEN, tolerance=1e-8))
    (multiplier,) = [c.multiplier for c in solution.model.constraints if c.owner == "sleeve"]
    for k, state in enumerate(solution.states):
        r, rate = R0 * np.cosh(OMEGA * state.t), OMEGA * R0 * np.sinh(OMEGA * state.t)
        turn = OMEGA * state.t
        np.testing.assert_allclose(place(solution, "bead@0.5", k), [r * np.cos(turn), r * np.sin(turn)], atol=1e-7)
        # the bar pushes it sideways: m a_n = 2 m omega r', and the joint gives -lambda n
        assert state.d[multiplier] == pytest.approx(-2 * MASS * OMEGA * rate, rel=1e-3, abs=1e-3)
    assert r > 1.35
    assert len(solution.states) > 3


@pytest.mark.slow
def test_the_bead_passes_from_element_to_element():
    solution = helpers.Solution(bead(RAILS["cable"](), 0.6, DRIVEN, tolerance=1e-6))
    r, turn = R0 * np.cosh(OMEGA * 0.6), OMEGA * 0.6
    assert r > 2.0 * 2 / 4
    np.testing.assert_allclose(solution.r("bead@0.5"), [r * np.cos(turn), r * np.sin(turn)], atol=2e-5)


@pytest.mark.slow_rows("cable")
@pytest.mark.parametrize("kind", ["rigid", "cable"])
def test_a_bead_that_flies_off_the_end_ends_the_run(kind, monkeypatch):
    """Before the first stored state beyond the end of the rail, however many steps a call of the kernels makes."""
    end, met = np.arccosh(2.0 / R0) / OMEGA, []
    for chunk in (0.0, 1e9):
        monkeypatch.setattr(stepping, "CHUNK_SECONDS", chunk)
        model, times = bead(RAILS[kind](), 1.5 * end, DRIVEN, tolerance=1e-6), []
        with pytest.raises(ComputationError, match=r"sleeve: bead@0\.5 has slid off the end of rail") as caught:
            times.extend(state.t for state in solve(model))
        met.append((times, caught.value.failure.at["t"]))
        assert times[-1] < end < met[-1][1] < 1.0001 * (2 * times[-1] - times[-2])
    assert met[0] == met[1]


def free_bead(J, t_end):
    """Return r and the angle of a bead on a hinged rigid bar with moment of inertia J about the hinge."""

    def rates(t, w):
        r, dr, _, turning = w
        inertia = J + MASS * r * r
        return [dr, r * turning**2, turning, -2 * MASS * r * dr * turning / inertia]

    w = solve_ivp(rates, (0, t_end), [R0, 0, 0, OMEGA], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return w[0], w[2]


METHODS = {
    "radau5": ({"tolerance": 1e-8}, 1e-6),
    "energy_momentum": ({"method": "energy_momentum", "dt": 1e-3, "estimate": False}, 2e-5),
}


@pytest.mark.parametrize("method", METHODS)
def test_a_bead_slows_the_bar_that_it_leaves(method):
    solver, atol = METHODS[method]
    solution = helpers.Solution(bead(RAILS["rigid"](), 0.5, HINGED, **solver))
    r, turn = free_bead(0.5 + 1.0 * 1.0**2, 0.5)
    assert r > 1.6 * R0
    assert turn < 0.95 * OMEGA * 0.5
    np.testing.assert_allclose(solution.r("bead@0.5"), [r * np.cos(turn), r * np.sin(turn)], atol=atol)


@pytest.mark.parametrize("kind", ["rigid", "cable"])
def test_sliding_conserves_energy_and_angular_momentum(kind):
    """To round-off, across the elements of a rail that bends and swings."""
    rail = RAILS[kind]()
    if kind == "cable":
        rail["material"] = {"E": 2e7, "nu": 0.3, "rho": 500.0}
    model = bead(rail, 0.4, HINGED, method="energy_momentum", dt=2e-3, estimate=False)
    solution, energies = helpers.Solution(model), Energies(model)
    totals, turning = [], []
    for state in solution.states:
        strain = sum(force(g, state.d, np.zeros(len(state.d))) for g in model.groups)
        totals.append(energies.kinetic(state.v) + strain)
        turning.append(energies.momentum(state.d, state.v)[2])
    assert np.hypot(*solution.r("bead@0.5")) > R0 + 0.2
    np.testing.assert_allclose(totals, totals[0], rtol=1e-10)
    np.testing.assert_allclose(turning, turning[0], rtol=1e-10)


CRANK, ROD, ROD_MASS, ROD_INERTIA, SPEED = 0.3, 0.7, 2.0, 0.15, 5.0


def slider_crank(t):
    """Return x of the slider, the centre of the rod (2,) and the rod's angle, at crank angle SPEED t."""
    phi = SPEED * t
    beta = np.arcsin(-CRANK * np.sin(phi) / ROD)
    knee = CRANK * np.array([np.cos(phi), np.sin(phi)])
    along = np.array([np.cos(beta), np.sin(beta)])
    return knee[0] + ROD * along[0], knee + 0.5 * ROD * along, beta


def kinetic(t, h=1e-4):
    """Return the kinetic energy of the rod, by differences of its closed-form motion."""
    (_, c0, b0), (_, c1, b1) = slider_crank(t - h), slider_crank(t + h)
    v, turning = (c1 - c0) / (2 * h), (b1 - b0) / (2 * h)
    return 0.5 * ROD_MASS * v @ v + 0.5 * ROD_INERTIA * turning**2


@pytest.mark.slow_rows("prismatic-radau5")
@pytest.mark.parametrize(("guide", "method"), [
    ("slider", "radau5"), ("slider", "generalized_alpha"), ("slider", "energy_momentum"), ("prismatic", "radau5")])
def test_a_slider_crank_of_rigid_bars_follows_its_kinematics(guide, method):
    bodies = {
        "crank": rigid([0, 0], [CRANK, 0], 1.0, 0.02),
        "rod": rigid([CRANK, 0], [CRANK + ROD, 0], ROD_MASS, ROD_INERTIA),
    }
    turn = {"type": "expression", "value": f"{SPEED}*t"}
    held = [{"type": "prescribed", "name": "shaft", "at": "crank@0", "ux": 0, "uy": 0, "angle": turn}]
    if guide == "slider":
        joint = {"type": "slider", "at": "rod@1", "through": [0, 0], "along": [2, 0]}
    else:
        bodies["rail"] = helpers.body(helpers.line(1.4, 0.0, (0.1, 0.0)), helpers.element("cable", 3), THICK, RAIL)
        held.append({"type": "clamp", "at": "rail@0"})
        joint = {"type": "prismatic", "point": "rod@1", "on": "rail"}
    t_end = 1.9 * np.pi / SPEED
    solution = helpers.solved(
        bodies,
        {"type": "dynamic", "method": method, "t_end": t_end, "tolerance": 1e-8},
        bc=held,
        joints=[{"name": "wrist", "type": "pin", "between": ["crank@1", "rod@0"]}, joint],
        # a rod that starts at rest would be set in motion by an impulse, which the rail would feel too
        initial={"bodies": {"crank": {"rotation_rate": {"omega": SPEED, "about": [0, 0]}},
                            "rod": {"rotation_rate": {"omega": -SPEED * CRANK / ROD, "about": [CRANK + ROD, 0]}}}},
    )
    atol = 1e-7 if guide == "slider" else 1e-5
    seen = []
    for k, state in enumerate(solution.states):
        x, centre, _ = slider_crank(state.t)
        seen.append(x)
        np.testing.assert_allclose(place(solution, "rod@1", k), [x, 0], atol=atol)
        np.testing.assert_allclose(place(solution, "rod@0.5", k), centre, atol=atol)
    assert min(seen) < ROD - CRANK + 0.05
    # all the work goes through the shaft, into the kinetic energy of the rod
    h = 1e-4
    power = (kinetic(t_end + h) - kinetic(t_end - h)) / (2 * h)
    assert abs(power) > 1.0
    # which geometry determines: that steps meet constraints in positions alone makes rates and forces no less accurate
    rel = 1e-6 if guide == "slider" else 1e-2
    of_crank = 0.5 * (0.02 + 0.25 * CRANK**2) * SPEED**2
    found = Energies(solution.model).kinetic(solution.states[-1].v) - of_crank
    # rates of this method satisfy constraints in the mean of steps
    assert found == pytest.approx(kinetic(t_end), rel=1e-3 if method == "energy_momentum" else rel)
    assert solution.reactions()["shaft"]["m"] * SPEED == pytest.approx(power, rel=rel)
