"""Laws of tendons: accurate lengths, forces and stiffness as derivatives, energy over a step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ancf2d.elements.point_laws import DIRECTION, THETA, PointLaw
from ancf2d.interactions.tendon_laws import ELASTIC, TENSION, piece, stretch_of


@pytest.mark.parametrize("kind", [DIRECTION, THETA])
@pytest.mark.parametrize("angle", [1e-6, 0.3, 2.0])
def test_a_turning_arm_stretches_a_tendon_to_full_precision(kind: int, angle: float) -> None:
    """From (1, 0) to an arm (a, 0) that turns: sqrt(1 + 2 a cos + a^2) - (1 + a), by half angles."""
    a, size = 0.3, 7
    p0, u = np.array([1.0, 0.0, 0.0, 0.0, a, 0.0, kind]), np.zeros(size)
    if kind == THETA:
        u[2] = angle
    else:
        p0[2], u[2:4] = 1.3, 1.3 * np.array([-2.0 * np.sin(0.5 * angle)**2, np.sin(angle)])
    less = 4.0 * a * np.sin(0.5 * angle)**2
    exact = -less / (np.sqrt((1.0 + a)**2 - less) + 1.0 + a)
    assert stretch_of(p0, u, size) == pytest.approx(exact, rel=1e-12, abs=0)


@pytest.mark.parametrize(("start", "end"), [(0.3, 0.5), (-0.4, 0.5), (0.5, -0.4)], ids=["taut", "taken up", "let go"])
def test_the_work_of_an_elastic_tendon_over_a_step_is_the_difference_of_energy(start: float, end: float
                                                                               ) -> None:
    """Two spans between points: f . (u1 - u0) = U1 - U0. Winding up is lossless."""
    rng, size = np.random.default_rng(1), 12
    p0 = np.zeros(2 * size)
    p0[[0, 1, size, size + 1]] = 1.0, 0.5, -0.6, 0.8
    length = np.hypot(1.0, 0.5) + 1.0
    par, zero = np.array([3.0, length, 0.5, size]), np.zeros(2 * size)

    def energy(u: Any, a: float) -> tuple[float, float]:
        f, H = np.zeros(len(p0)), np.zeros((len(p0),) * 2)
        return ELASTIC.forces(p0, u, zero, par, np.array([a, 0.3, 0.0]), np.zeros(2), f, H, 0 * H)
    u = []
    for share in (start, end):
        one = np.zeros(len(p0))
        one[[0, 1, size, size + 1]] = share * p0[[0, 1, size, size + 1]] + rng.uniform(-0.05, 0.05, 4)
        u.append(one)
    f, a = np.zeros(len(p0)), np.array([0.2, 0.0, 0.0])
    after, lost = ELASTIC.mean(p0, *u, zero, par, a, a, np.zeros(2), f)
    assert np.abs(f).max() > 0.1
    assert after == pytest.approx(energy(u[1], 0.2)[0], abs=1e-14)
    assert lost == 0.0
    assert f @ (u[1] - u[0]) == pytest.approx(energy(u[1], 0.2)[0] - energy(u[0], 0.2)[0], abs=1e-12)
    _, wound = ELASTIC.mean(p0, u[1], u[1], zero, par, a, np.array([0.2, 0.3, 0.0]), np.zeros(2), f)
    assert wound == 0.0


@pytest.mark.parametrize("kinds", [(0, 0), (THETA, 0), (DIRECTION, THETA), (DIRECTION, DIRECTION), "u", "u, v"])
@pytest.mark.parametrize("law", [TENSION, ELASTIC])
def test_forces_and_stiffness_are_derivatives(law: PointLaw, kinds: tuple[int, int] | str) -> None:
    """Derivatives of T l and of the energy, by central differences; the fields that describe arms are fixed."""
    rng, size, pieces = np.random.default_rng(0), 12, 1 if law is TENSION else 3
    if isinstance(kinds, str):
        # along sections with an angle
        size = 3 + len(kinds.split(","))
        p0, free = rng.uniform(-1, 1, size * pieces), np.arange(size * pieces)
    else:
        p0 = np.concatenate([[*rng.uniform(-1, 1, 6), kinds[0], *rng.uniform(-1, 1, 4), kinds[1]]
                             for _ in range(pieces)])
        free = np.array([k for k in range(len(p0)) if k % size not in (6, 11)])
    par = np.array([3.0, size] if law is TENSION else [3.0, 2.0, -2.0, size])

    def at(u: Any) -> tuple[float, Any, Any]:
        f, H = np.zeros(len(p0)), np.zeros((len(p0),) * 2)
        energy, _ = law.forces(p0, u, np.zeros(len(p0)), par, np.array([0.7, 0.3, 0.0]), np.zeros(2), f, H, 0 * H)
        if law is TENSION:
            energy = 0.7 * 3.0 * np.hypot(*piece(p0, u, u, 0, size))
        return energy, f, H

    u, h = np.zeros(len(p0)), 1e-6
    u[free] = rng.uniform(-0.1, 0.1, len(free))
    _, f, H = at(u)
    assert np.abs(f).max() > 0.1
    np.testing.assert_allclose(H, H.T, atol=1e-14)
    for k in free:
        e = h * np.eye(len(p0))[k]
        (U1, f1, _), (U0, f0, _) = at(u + e), at(u - e)
        assert f[k] == pytest.approx((U1 - U0) / (2 * h), abs=1e-8)
        np.testing.assert_allclose(H[free, k], ((f1 - f0) / (2 * h))[free], atol=1e-8)
