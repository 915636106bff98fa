"""Joints and supports hold to round-off in every step and every stored state, with every integrator."""

from __future__ import annotations

from dataclasses import replace

import helpers as h
import numpy as np
import pytest
from motions import GRAVITY, THIN, ride, rigid, rod
from scipy.optimize import minimize_scalar

from ancf2d.kernels.motion.advance import INSIDE
from ancf2d.model.rotation import Rotation

SOFT = {"E": 5e6, "nu": 0.3, "rho": 1000.0}
SWING = "0.4*(1-cos(9*t))"
METHODS = {"hht": {"dt": 0.004}, "generalized_alpha": {"dt": 0.004},
           "energy_momentum": {"dt": 0.004}, "radau5": {"tolerance": 1e-5}, "radau9": {"dt": 0.02}}


def weld(a, b):
    return {"type": "weld", "between": [a, b]}


def bent(name, start, end):
    return h.body({"type": "line", "start": start, "end": end}, h.element(name, 1), THIN, SOFT)


def chain(*kinds):
    """Return a zigzag of bodies of different kinds, welded, with a prescribed rotation at its start."""
    at, bodies, joints = [0.0, 0.0], {}, []
    for k, kind in enumerate(kinds):
        end = [at[0] + 0.3, at[1] + 0.2 * (-1) ** k]
        bodies[f"b{k}"] = rigid(at, end, 0.3, 0.01) if kind == "rigid" else bent(kind, at, end)
        at = end
        if k:
            joints.append(weld(f"b{k - 1}@1", f"b{k}@0"))
    held = {"type": "prescribed", "at": "b0@0", "ux": 0, "uy": 0, "angle": {"type": "expression", "value": SWING}}
    return {"bodies": bodies, "bc": [held], "joints": joints, "loads": GRAVITY}


def turned(moved, at, d):
    """Return the rotation of the section at BODY@S."""
    name, s = at.split("@")
    n = moved.model.n_q
    return Rotation(h.point_ref(moved.model.meshes[name], float(s))).value(moved.model.e0 + d[:n], d[:n])


MIXED = ("2d2n", "reissner3", "rigid", "cable")


@pytest.mark.parametrize(("method", "kinds"), [
    *((m, MIXED) for m in METHODS if m != "energy_momentum"), ("energy_momentum", ("cable", "rigid", "cable"))])
def test_welds_and_a_prescribed_angle(method, kinds):
    moved = ride(chain(*kinds), 0.6, method=method, states=23, **METHODS[method])
    assert moved.model.numbering.n_multipliers >= len(kinds)
    assert moved.column("violation").max() < 1e-12
    for row in moved.rows[1:]:
        d, v, _ = moved.stepper.full(replace(row, kind=INSIDE))
        swing = 0.4 * (1 - np.cos(9 * row.t))
        turns = [turned(moved, f"b{k}@{s}", d) for k in range(len(kinds)) for s in (0, 1)]
        assert turns[0] == pytest.approx(swing, abs=1e-12)
        for k in range(1, len(kinds)):
            assert turns[2 * k - 1] == pytest.approx(turns[2 * k], abs=2e-12)
        # and their rates, by the rotations a moment later
        later, before = ([turned(moved, at, d + sign * 1e-6 * v) for at in ("b0@0", "b0@1", "b1@0")]
                         for sign in (1, -1))
        rates = (np.array(later) - before) / 2e-6
        assert rates[0] == pytest.approx(3.6 * np.sin(9 * row.t), abs=1e-7)
        assert rates[1] == pytest.approx(rates[2], abs=1e-7)
    assert max(abs(np.diff(turns))) > 1e-3


@pytest.mark.slow
def test_rigid_bodies_keep_their_length_over_many_turns():
    scene = {"bodies": {"a": rigid([0, 0], [1, 0], 1.3, 0.2), "b": rigid([1, 0], [1.6, -0.7], 0.9, 0.11)},
             "bc": [{"type": "pin", "at": "a@0"}], "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
             "loads": GRAVITY, "initial": {"bodies": {"a": {"rotation_rate": {"omega": 12, "about": [0, 0]}}}}}
    moved = ride(scene, 20.0, method="generalized_alpha", dt=0.005, every=50)
    assert moved.column("violation").max() < 1e-13
    lengths = [np.hypot(*(moved.place("b@1", k) - moved.place("b@0", k))) for k in range(len(moved.rows))]
    np.testing.assert_allclose(lengths, np.hypot(0.6, 0.7), rtol=1e-13)


# a bar that bends, with one end on a line, and a sleeve on it
SLEEVE = {"bodies": {"rail": rod("cable", 3, (0, 0), (2, 1), E=5e6),
                     "bead": rigid([0.55, 0.3], [0.65, 0.3], 0.3, 0.01)},
          "bc": [{"type": "pin", "at": "rail@0"}], "loads": GRAVITY,
          "joints": [{"type": "slider", "at": "rail@1", "through": [2, 1], "along": [1, 3]},
                     {"type": "prismatic", "point": "bead@0.5", "on": "rail"}]}


@pytest.mark.parametrize("method", ["generalized_alpha", "radau5", "energy_momentum"])
def test_a_slider_stays_on_its_line_and_a_sleeve_on_its_bar(method):
    """The sleeve crosses the nodes of a bar that bends; the end of the bar slides on a line on the ground."""
    moved = ride(SLEEVE, 0.3, method=method, states=11, **METHODS[method])
    assert moved.column("violation").max() < 1e-12
    for k in (4, 11):
        moved.stepper.full(replace(moved.rows[k], kind=INSIDE))
        x, y = moved.place("rail@1", k) - [2, 1]
        assert abs(3 * x - y) < 1e-13 * np.sqrt(10)
        bead = moved.place("bead@0.5", k)

        def off(s, k=k, bead=bead):
            return np.hypot(*(moved.place(f"rail@{min(max(s, 0), 1)}", k) - bead))

        near = min(np.linspace(0, 1, 31), key=off)
        assert minimize_scalar(off, bounds=(near - 0.03, near + 0.03), options={"xatol": 1e-12}).fun < 1e-8
    assert np.hypot(*(moved.place("bead@0.5") - [0.6, 0.3])) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("method", ["generalized_alpha", "radau5", "energy_momentum"])
def test_stored_states_have_the_same_bits_however_steps_are_grouped(method):
    """One step, or all of them, in a call of the kernels: the clock decides how many."""
    one, all_ = (ride(SLEEVE, 0.3, method=method, states=37, chunk=chunk, **METHODS[method]) for chunk in (1, 1000))
    for a, b in zip(one.rows, all_.rows, strict=True):
        for x, y in zip(one.stepper.full(a), all_.stepper.full(b), strict=True):
            np.testing.assert_array_equal(x, y)
        np.testing.assert_array_equal(one.stepper.forces(a), all_.stepper.forces(b))
