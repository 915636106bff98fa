"""The independent equations are right: matrices, frequencies and motions of the textbooks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from instruments.own_equations.motion import move
from instruments.own_equations.scene import Scene
from instruments.own_equations.statics import large, linear, modes
from scipy.special import ellipj, ellipk

EA, kGA, EI, rhoA, rhoI = 3e4, 9e3, 50.0, 2.0, 0.03
SECTION = {"EA": EA, "kGA": kGA, "EI": EI, "rhoA": rhoA, "rhoI": rhoI}


def beam(geometry: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return the case of one beam ``b``."""
    body = {"geometry": geometry, "section": SECTION, "element": {"type": "reissner3"}}
    return {"bodies": {"b": body}, **more}


def line(length: float) -> dict[str, Any]:
    """Return a line along x."""
    return {"type": "line", "start": [0, 0], "end": [length, 0]}


CLAMP = [{"name": "wall", "type": "clamp", "at": "b@0"}]


def test_a_bar_has_timoshenkos_matrix_at_its_ends() -> None:
    """Przemieniecki, Theory of Matrix Structural Analysis, 5.6, in x, y, theta of both ends."""
    L, scene = 0.7, Scene(beam(line(0.7)))
    bar, first = scene.bars[0]
    K = scene.stiffness(scene.x0)[first:, first:]
    ends = [k * bar.n + node for node in (0, bar.n - 1) for k in range(3)]
    inner = [k for k in range(len(K)) if k not in ends]
    condensed = K[np.ix_(ends, ends)] - K[np.ix_(ends, inner)] @ np.linalg.solve(K[np.ix_(inner, inner)],
                                                                                K[np.ix_(inner, ends)])
    phi = 12 * EI / (kGA * L**2)
    a, b = EA / L, EI / (L**3 * (1 + phi))
    wanted = np.array([[a, 0, 0, -a, 0, 0],
                       [0, 12 * b, 6 * b * L, 0, -12 * b, 6 * b * L],
                       [0, 6 * b * L, (4 + phi) * b * L**2, 0, -6 * b * L, (2 - phi) * b * L**2],
                       [-a, 0, 0, a, 0, 0],
                       [0, -12 * b, -6 * b * L, 0, 12 * b, -6 * b * L],
                       [0, 6 * b * L, (2 - phi) * b * L**2, 0, -6 * b * L, (4 + phi) * b * L**2]])
    assert condensed == pytest.approx(wanted, abs=1e-9 * a)


def test_a_uniform_load_on_a_clamped_beam() -> None:
    """Both ends bear half of the load and f L^2/12."""
    supports = [*CLAMP, {"name": "other", "type": "clamp", "at": "b@1"}]
    found = linear(beam(line(1.5), boundary_conditions=supports,
                        loads=[{"type": "distributed", "on": "b", "value": [0, -4.0]}]))
    reactions = found.scene.reactions(found.multipliers)
    assert (reactions["wall"]["fy"], reactions["wall"]["m"]) == pytest.approx((3.0, 0.75))
    assert (reactions["other"]["fy"], reactions["other"]["m"]) == pytest.approx((3.0, -0.75))


def test_a_quarter_circle_bends_as_castigliano_says() -> None:
    """Clamped at (R, 0), P down at (0, R): v = P R (pi/4 R^2/EI + pi/4 /EA + pi/4 /kGA)."""
    R, P = 0.8, 1e-3
    arc = {"type": "arc", "center": [0, 0], "radius": R, "from": 0.0, "to": math.pi / 2}
    found = linear(beam(arc, boundary_conditions=CLAMP, loads=[{"type": "force", "at": "b@1", "value": [0, -P]}]))
    wanted = -P * R * math.pi / 4 * (R**2 / EI + 1 / EA + 1 / kGA)
    assert found.probe("b@1")["uy"] == pytest.approx(wanted, rel=1e-8)


def test_a_moment_bends_a_beam_to_a_circle() -> None:
    """theta = M L/EI, so a beam of length L closes to most of a circle; its section forces are constant."""
    L, turn = 1.0, 5.0
    M = turn * EI / L
    found = large(beam(line(L), boundary_conditions=CLAMP, loads=[{"type": "moment", "at": "b@1", "value": M}]),
                  degree=14)
    tip = found.probe("b@1")
    wanted = {"ux": L * math.sin(turn) / turn - L, "uy": L * (1 - math.cos(turn)) / turn, "theta": turn, "N": 0, "Q": 0,
              "M": M}
    # the path by steps of the load turns sections by half a radian each; the polynomial of degree 14 has sin to 1e-8
    assert tip == pytest.approx(wanted, rel=1e-7, abs=1e-6)
    assert found.scene.reactions(found.multipliers)["wall"]["m"] == pytest.approx(-M)


def test_frequencies_of_a_simply_supported_beam_are_timoshenkos() -> None:
    """Both roots of rhoA rhoI w^4 - w^2 (rhoA EI k^2 + rhoI kGA k^2 + rhoA kGA) + kGA EI k^4 = 0, and axial ones."""
    L = 1.2
    supports = [{"type": "pin", "at": "b@0"}, {"type": "roller", "fixed": "y", "at": "b@1"}]
    bending = []
    for k in math.pi / L * np.arange(1, 5):
        b, c = rhoA * EI * k**2 + rhoI * kGA * k**2 + rhoA * kGA, kGA * EI * k**4
        bending.append(math.sqrt((b - math.sqrt(b * b - 4 * rhoA * rhoI * c)) / (2 * rhoA * rhoI)))
    axial = [(n - 0.5) * math.pi / L * math.sqrt(EA / rhoA) for n in range(1, 5)]
    wanted = sorted(bending + axial)[:4]
    assert modes(beam(line(L), boundary_conditions=supports), 4, degree=16) == pytest.approx(wanted, rel=1e-8)


def test_a_rigid_pendulum_swings_as_jacobis_functions() -> None:
    """Released at rest across its weight: sin(theta/2) = k sn(K - w t)."""
    L, m, J, g = 0.9, 1.3, 0.05, 9.81
    case = {"bodies": {"b": {"geometry": line(L), "element": {"type": "rigid", "mass": m, "inertia": J}}},
            "boundary_conditions": [{"name": "hook", "type": "pin", "at": "b@0"}],
            "loads": [{"type": "gravity", "value": [0, -g]}]}
    times = np.linspace(0, 2, 9)
    found = move(case, times)
    k, w = math.sin(math.pi / 4), math.sqrt(m * g * L / 2 / (J + m * L**2 / 4))
    angle = 2 * np.arcsin(k * ellipj(ellipk(k * k) - w * times, k * k)[0])
    assert found.course("b@1")["theta"] == pytest.approx(angle - math.pi / 2, abs=1e-9)
    energies, fall = found.energies(), found.scene.probe("b@0.5", found.x[-1])["uy"]
    assert energies["kinetic"] == pytest.approx(-m * g * fall, rel=1e-9)


def test_the_projection_of_velocities_conserves_momentum() -> None:
    """Two rods pinned at their ends, one at rest: momentum and angular momentum about the origin are conserved."""
    rod = {"type": "rigid", "mass": 1.0, "inertia": 1 / 12}
    bodies = {"a": {"geometry": line(1.0), "element": rod},
              "b": {"geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}, "element": rod}}
    case = {"bodies": bodies, "joints": [{"type": "pin", "between": ["a@1", "b@0"]}],
            "initial": {"bodies": {"a": {"velocity": [0, 1]}}}}
    found = move(case, np.array([0.0, 0.1]))
    assert found.momenta() == pytest.approx([0.0, 1.0, 0.5])
    # an impulse P at the pin: 1 - P (1 + 3) = P (1 + 3) for the ends of rods of unit mass, P = 1/8
    assert found.energies()["kinetic"] == pytest.approx(0.5 * (1 - 1 / 8))
