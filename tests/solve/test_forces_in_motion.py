"""Section forces, reactions and probes of moving bodies compared with d'Alembert's principle by hand."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from helpers import section_forces

from ancf2d.interactions.forces import DeadLoad
from ancf2d.model.rotation import CoordinateKinds
from ancf2d.solvers.linear import full_mass
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state import State
from ancf2d.solvers.state_results import Observer, energies, reactions
from ancf2d.solvers.system import System

DYNAMIC = {"type": "dynamic", "t_end": 1, "dt": 0.01}
SECTION, STEEL = {"height": 0.1, "width": 0.2}, {"E": 2e11, "nu": 0.3, "rho": 1000}
TYPES = ["2d2n", "2d3n-nu", "vallejo", "patel", "cable", "reissner2", "reissner3", "ancf[3,3]"]
RHOA = 1000 * 0.02


def bodies(name: str, count: int = 3, **material) -> dict:
    return {"b": h.body(h.line(2.0), h.element(name, count), SECTION, {**STEEL, **material})}


def moving(model, d, v=None, a=None, t=0.0) -> State:
    """Return the state of a model at given d, v, a (n_q,)."""
    full = np.zeros(len(model.numbering.place))
    parts = [full.copy() for _ in range(3)]
    for part, given in zip(parts, (d, v, a), strict=True):
        if given is not None:
            part[:model.n_q] = given[:model.n_q]
    balance = System(model).forces(parts[0], t)
    return State(t, parts[0], balance.Q, balance.F, balance.energy, v=parts[1], a=parts[2])


def whirl(name: str, omega: float = 30.0) -> tuple:
    """Return the model and the state of a bar that rotates steadily about its start, with its stretch."""
    frame = h.solved(bodies(name), "static", bc=[{"type": "clamp", "at": "b@0", "hold": "section"}],
                     steady_rotation={"omega": omega})
    model = h.build(bodies(name), DYNAMIC, bc=[{"name": "hub", "type": "pin", "at": "b@0"}],
                    output={"probes": {"p": "b@0.4", "off": {"at": "b@0.4", "y": 0.03}}, "fields": ["N"]})
    kinds, d = CoordinateKinds(model.meshes.values()), frame.d[:model.n_q]
    v, a = np.zeros(model.n_q), np.zeros(model.n_q)
    kinds.rotation(v, model.e0 + d, omega)
    kinds.rotation(a, v, omega)
    a[kinds.theta] = 0.0
    return model, moving(model, d, v, a)


@h.covering(name=TYPES, s=[0.0, 0.21, 0.5, 1.0])
def test_tension_of_a_whirling_bar(name, s):
    """N = rho A omega^2 (L^2 - x^2)/2."""
    model, state = whirl(name)
    N, Q, M = section_forces(model, state, h.point_ref(model.meshes["b"], s))
    full = RHOA * 900 * 2.0
    assert pytest.approx(full * (1 - s * s), rel=1e-4, abs=1e-6 * full) == N
    assert abs(Q) + abs(M) < 1e-6 * full


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_the_hub_pulls_a_whirling_bar_inwards(name):
    model, state = whirl(name)
    found = reactions(model, state)["hub"]
    assert pytest.approx(-RHOA * 900 * 2.0, rel=1e-4) == found["fx"]
    assert abs(found["fy"]) + abs(found["m"]) < 1e-6 * 36000


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_velocities_of_probes_on_and_off_the_axis(name):
    model, state = whirl(name)
    probes = Observer(model).observe(state)
    for probe in probes.values():
        np.testing.assert_allclose([probe["vx"], probe["vy"]], [-30 * probe["y"], 30 * probe["x"]], rtol=1e-12)
        assert probe["omega"] == pytest.approx(30.0, rel=1e-12)
    assert probes["off"]["vx"] == pytest.approx(-30 * 0.03, rel=1e-3)


def pushed(name: str, at: float, force: tuple[float, float], s: float) -> tuple[float, float, float]:
    """Return N, Q, M of a free bar pushed by a mean force at S = at, after vibrations have died out.

    Seen from the bar, inertia is a field of weight -F/m and the push is the reaction of a clamp.
    """
    g = -np.array(force) / (RHOA * 2.0)
    held = h.solved(bodies(name, 4), "static", bc=[{"type": "clamp", "at": f"b@{at}", "hold": "section"}],
                    loads=[{"type": "gravity", "value": g}])
    model = h.build(bodies(name, 4), DYNAMIC, loads=[{"type": "force", "at": f"b@{at}", "value": force}])
    a = np.zeros(model.n_q)
    CoordinateKinds(model.meshes.values()).translation(a, *(-g))
    return section_forces(model, moving(model, held.d, a=a), h.point_ref(model.meshes["b"], s))


@h.covering(name=TYPES, s=[0.0, 0.4, 1.0])
def test_a_bar_pushed_from_behind_is_compressed_by_its_inertia(name, s):
    """N = -F (1 - x/L)."""
    N, Q, M = pushed(name, 0.0, (500.0, 0.0), s)
    assert pytest.approx(-500 * (1 - s), rel=1e-6, abs=1e-4) == N
    assert abs(Q) + abs(M) < 1e-3


@h.covering(name=TYPES, s=[0.1, 0.25, 0.4])
def test_a_bar_pushed_at_its_middle_bends_under_its_inertia(name, s):
    """From the free end, rho A a = F/L per length: Q = F x/L and M = -F x^2/(2 L) up to the middle."""
    _, Q, M = pushed(name, 0.5, (0.0, 500.0), s)
    x = 2.0 * s
    assert pytest.approx(500 * x / 2, rel=1e-4) == Q
    assert pytest.approx(-500 * x * x / 4, rel=1e-4) == M


@pytest.mark.parametrize("name", TYPES)
def test_a_falling_bar_has_no_section_forces(name):
    model = h.build(bodies(name), DYNAMIC, loads=[{"type": "gravity", "value": [0, -10]}])
    a = np.zeros(model.n_q)
    CoordinateKinds(model.meshes.values()).translation(a, 0.0, -10.0)
    point = h.point_ref(model.meshes["b"], 0.4)
    assert np.abs(section_forces(model, moving(model, np.zeros(model.n_q), a=a), point)).max() < 1e-9
    at_rest = section_forces(model, moving(model, np.zeros(model.n_q)), point)
    assert np.abs(at_rest).max() > 1.0


@h.covering(name=TYPES, s=[0.0, 0.4])
def test_angular_acceleration_bends_a_bar(name, s):
    """M(x) = -alpha rho A ((L^3 - x^3)/3 - x (L^2 - x^2)/2) - alpha rho I (L - x), Q(x) from the forces only."""
    model = h.build(bodies(name), DYNAMIC, bc=[{"name": "wall", "type": "clamp", "at": "b@0", "hold": "section"}])
    alpha, a = 7.0, np.zeros(model.n_q)
    CoordinateKinds(model.meshes.values()).rotation(a, model.e0, alpha)
    statics = h.build(bodies(name), "static", bc=[{"type": "clamp", "at": "b@0", "hold": "section"}])
    everything = np.arange(model.n_q)
    statics.loads.dead.append(DeadLoad(everything, -(full_mass(model) @ a), lambda t: t))
    *_, held = solve(statics)
    state = moving(model, held.d, a=a)
    _, Q, M = section_forces(model, state, h.point_ref(model.meshes["b"], s))
    rhoI, x = 0.0 if name == "cable" else 1000 * 0.2 * 0.1**3 / 12, 2.0 * s
    moment = alpha * (RHOA * ((8 - x**3) / 3 - x * (4 - x**2) / 2) + rhoI * (2 - x))
    shear = alpha * RHOA * (4 - x**2) / 2
    assert pytest.approx(-moment, rel=1e-5) == M
    assert pytest.approx(-shear, rel=1e-5) == Q
    if s == 0.0:
        wall = reactions(model, state)["wall"]
        np.testing.assert_allclose([wall["fy"], wall["m"]], [shear, moment], rtol=1e-5)


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_damping_is_part_of_the_section_forces(name):
    """A bar that is being stretched but has no stretch yet: N = tau EA times the rate.

    Its inertia just cancels Rayleigh's alpha.
    """
    model = h.build(bodies(name, damping={"kelvin_voigt": 1e-3}), DYNAMIC, damping={"rayleigh": {"alpha": 2.0,
                    "beta": 1e-3}}, bc=[{"type": "clamp", "at": "b@0", "hold": "section"}])
    kinds, v = CoordinateKinds(model.meshes.values()), np.zeros(model.n_q)
    v[kinds.x] = 1e-3 * model.e0[kinds.x]
    if name == "2d2n":
        v[kinds.x + 1] = -0.3e-3 * model.e0[kinds.x + 1]
    zero = np.zeros(model.n_q)
    N, _, _ = section_forces(model, moving(model, zero, v, -2.0 * v), h.point_ref(model.meshes["b"], 0.5))
    assert pytest.approx(2e-3 * 2e11 * 0.02 * 1e-3, rel=1e-9) == N


def test_energies_of_a_whirling_bar():
    model, state = whirl("vallejo")
    found = energies(model, state)
    assert found["kinetic"] == pytest.approx(0.5 * RHOA * 8 / 3 * 900, rel=1e-3)
    assert found["strain"] == state.energy > 0
    assert found["potential"] == 0.0
