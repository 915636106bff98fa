"""Kinetic energy, momentum and potential of rigidly moving bodies compared with those of a rigid body."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from motions import Ride

from ancf2d.solvers.energy import Energies
from ancf2d.solvers.motion.dynamic import Balance
from ancf2d.solvers.motion.initial import initial_motion
from ancf2d.solvers.system import System

DYNAMIC = {"type": "dynamic", "t_end": 1, "dt": 0.01}
V, OMEGA, ABOUT = np.array([0.4, -1.0]), 3.0, np.array([0.2, 0.7])
MOTION = {"velocity": V, "rotation_rate": {"omega": OMEGA, "about": ABOUT}}
A, I, RHO = 0.3 * 0.2, 0.2 * 0.3**3 / 12, h.MATERIAL["rho"]


def rigid_body(name: str, masses=()) -> tuple[float, np.ndarray, float]:
    """Return mass, centre and moment of inertia about it of helpers.LINE with point masses (s, m, J)."""
    ends = np.array([h.LINE["start"], h.LINE["end"]])
    L = np.hypot(*(ends[1] - ends[0]))
    rhoI = 0.0 if h.TYPES[name].section_kind == "tangent" else RHO * I
    parts = [(RHO * A * L, ends.mean(axis=0), RHO * A * L**3 / 12 + rhoI * L)]
    parts += [(m, ends[0] + s * (ends[1] - ends[0]), J) for s, m, J in masses]
    m = sum(p[0] for p in parts)
    centre = sum(p[0] * p[1] for p in parts) / m
    return m, centre, sum(p[2] + p[0] * ((p[1] - centre) ** 2).sum() for p in parts)


@pytest.mark.parametrize("masses", [(), ((0.3, 2.0, 0.5), (1.0, 0.7, 0.0))], ids=["beam", "with masses"])
@h.every_small_type
def test_energy_and_momentum_of_a_rigid_motion(name, masses):
    items = [{"at": f"b@{s}", "mass": m, "inertia": J} if J else {"at": f"b@{s}", "mass": m} for s, m, J in masses]
    model = h.build({"b": h.body(h.LINE, h.element(name, 3))}, DYNAMIC, masses=items, initial=MOTION)
    d, v, _ = initial_motion(model)
    energies = Energies(model)
    m, c, J = rigid_body(name, masses)
    vc = V + OMEGA * np.array([ABOUT[1] - c[1], c[0] - ABOUT[0]])
    assert energies.kinetic(v) == pytest.approx(0.5 * m * vc @ vc + 0.5 * J * OMEGA**2, rel=1e-12)
    expected = [*(m * vc), m * (c[0] * vc[1] - c[1] * vc[0]) + J * OMEGA]
    np.testing.assert_allclose(energies.momentum(d, v), expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_momentum_follows_the_body_as_it_turns(name):
    """The same motion of a body that is rotated and shifted has the momentum of its new position."""
    model = h.build({"b": h.body(h.LINE, h.element(name, 3))}, DYNAMIC, initial={"velocity": V})
    _, v, _ = initial_motion(model)
    d = h.rotate(np.zeros(model.n_q), model, 2.0, (5.0, -3.0))
    m, c, _ = rigid_body(name)
    R = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    c = R @ c + [5.0, -3.0]
    expected = [*(m * V), m * (c[0] * V[1] - c[1] * V[0])]
    np.testing.assert_allclose(Energies(model).momentum(d, v), expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["2d2n", "vallejo", "cable", "reissner3"])
def test_inertia_of_a_steady_rotation_is_the_centrifugal_force(name):
    """M a of a steady rotation is the centrifugal force of the turning frame, including point masses with inertia."""
    bodies = {"b": h.body(h.LINE, h.element(name, 3))}
    masses = [{"at": "b@0.3", "mass": 2.0, "inertia": 0.5}]
    frame = h.build(bodies, "static", bc=[{"type": "clamp", "at": "b@0"}], masses=masses,
                    steady_rotation={"omega": OMEGA, "about": ABOUT})
    moving = h.build(bodies, DYNAMIC, masses=masses)
    d = h.random_state(moving, 0.1)[:moving.n_q]
    e, energies = moving.e0 + d, Energies(moving)
    kinds = energies.kinds
    a = np.zeros(moving.n_q)
    kinds.rotation(a, _velocity(moving, e), OMEGA)
    a[kinds.theta] = 0.0
    centrifugal = np.zeros(moving.n_q)
    for patch in frame.loads.patches:
        np.add.at(centrifugal, patch.dofs, patch.evaluate(e, d, 1.0)[1])
    np.testing.assert_allclose(energies.M @ a, centrifugal, atol=1e-12 * abs(centrifugal).max())


def _velocity(model, e):
    v = np.zeros(model.n_q)
    Energies(model).kinds.rotation(v, e, OMEGA, tuple(ABOUT))
    return v


GRAVITY = [{"type": "gravity", "value": [0, -10]}]


def test_potential_is_weight_times_height_above_the_reference():
    model = h.build({"b": h.body(h.LINE, h.element("2d2n", 3))}, DYNAMIC, loads=GRAVITY,
                    masses=[{"at": "b@0.3", "mass": 2.0}])
    m, _, _ = rigid_body("2d2n", ((0.3, 2.0, 0.0),))
    d = h.rotate(np.zeros(model.n_q), model, 0.0, (5.0, 0.25))
    assert Energies(model).potential(d) == pytest.approx(m * 10 * 0.25, rel=1e-12)


def test_only_constant_gravity_has_a_potential():
    scaled = {"type": "constant", "scale": 0.5}
    loads = [{**GRAVITY[0], "amplitude": scaled}, {**GRAVITY[0], "amplitude": {"type": "sine", "frequency": 1}},
             {"type": "force", "at": "b@1", "value": [0, 3.0]}]
    model = h.build({"b": h.body(h.LINE, h.element("2d2n", 3))}, DYNAMIC, loads=loads)
    d = h.rotate(np.zeros(model.n_q), model, 0.0, (0.0, 1.0))
    assert Energies(model).potential(d) == pytest.approx(0.5 * 10 * rigid_body("2d2n")[0], rel=1e-12)


@pytest.mark.parametrize("name", ["2d2n", "cable", "reissner3"])
def test_strain_energy_is_that_of_elements_and_springs(name):
    springs = [{"type": "translational", "between": ["b@1", [3, 3]], "stiffness": 40.0, "length": 1.0}]
    scene = {"springs": springs, "bc": [{"type": "clamp", "at": "b@0"}]}
    ride = Ride({"bodies": {"b": h.body(h.LINE, h.element(name, 3))}, **scene}, 1.0, dt=1e-3)
    d = h.random_state(ride.model, 0.05)
    ride.stepper.start(d, np.zeros_like(d), np.zeros(1))
    row = ride.stepper.last()
    statics = h.build({"b": h.body(h.LINE, h.element(name, 3))}, "static", **scene)
    expected = System(statics).forces(ride.stepper.full(row)[0], 1.0).energy
    assert Balance(ride.model, ride.stepper).evaluate(row)["strain"] == pytest.approx(expected, rel=1e-13)
    assert expected > 20.0
