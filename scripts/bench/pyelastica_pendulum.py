"""The pendulums of Sec. 5.4 in PyElastica: a Cosserat rod in the plane, stepped explicitly (position Verlet).

A circular section of the same area is made first; its matrices are then those of the rectangle. PyElastica has no
static solver. Its sections keep their volume as the rod stretches: its limit is one of its own.
"""

from __future__ import annotations

import time

import numpy as np
from scenes import PENDULUMS, Bar


def build(bar: Bar, count: int):
    """Return (system collection, rod): the rod along x, pinned at its start, under gravity."""
    import elastica as ea

    class Scene(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
        """A rod with a pin and gravity."""

    A, I, h = bar.area, bar.inertia, bar.length / count
    across = bar.height * bar.width**3 / 12
    G = bar.E / (2 * (1 + bar.nu))
    rod = ea.CosseratRod.straight_rod(
        count, start=np.zeros(3), direction=np.array([1.0, 0.0, 0.0]), normal=np.array([0.0, 1.0, 0.0]),
        base_length=bar.length, base_radius=(A / np.pi) ** 0.5, density=bar.rho, youngs_modulus=bar.E, shear_modulus=G)
    # directors: d1 along y, d2 along z (what the plane's bending turns about), d3 along the rod
    for diagonal, matrix in (((bar.shear_stiffness, bar.shear_stiffness, bar.E * A), rod.shear_matrix),
                             ((bar.E * across, bar.E * I, G * (I + across)), rod.bend_matrix),
                             ((bar.rho * h * across, bar.rho * h * I, bar.rho * h * (I + across)),
                              rod.mass_second_moment_of_inertia)):
        for k in range(3):
            matrix[k, k, :] = diagonal[k]
    for k in range(3):
        rod.inv_mass_second_moment_of_inertia[k, k, :] = 1 / rod.mass_second_moment_of_inertia[k, k, :]
    scene = Scene()
    scene.append(rod)
    scene.constrain(rod).using(ea.GeneralConstraint, constrained_position_idx=(0,))
    scene.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0.0, -bar.gravity, 0.0]))
    scene.finalize()
    return scene, rod


def solve_pendulum(number: int, count: int, t_end: float, dt: float, interval: float) -> dict:
    """Return the tip (n, 2) at multiples of ``interval``, the seconds of the steps and their number."""
    import elastica as ea

    scene, rod = build(PENDULUMS[number], count)
    stepper, steps, every = ea.PositionVerlet(), round(t_end / dt), round(interval / dt)
    # compiled on first use
    build_time = build(PENDULUMS[number], count)
    stepper.step(build_time[0], np.float64(0.0), np.float64(dt))
    now, t, tip, seconds = np.float64(0.0), [0.0], [rod.position_collection[:2, -1].tolist()], 0.0
    for _ in range(steps // every):
        began = time.process_time()
        for _ in range(every):
            now = stepper.step(scene, now, np.float64(dt))
        seconds += time.process_time() - began
        if not np.isfinite(rod.position_collection).all():
            raise RuntimeError(f"the motion has grown without bound before t = {now:g}: the step is too long")
        t.append(float(now))
        tip.append(rod.position_collection[:2, -1].tolist())
    return {"t": t, "tip": tip, "solve_s": seconds, "steps": steps}
