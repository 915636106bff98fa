"""Make the measurement that ``cases/dynamic/measured_cantilever.yaml`` is fitted to: a closed form with noise."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

# aluminium strip: length, height, width [m], density [kg/m^3], force at the tip [N]
L, HEIGHT, WIDTH, RHO, FORCE = 1.0, 0.005, 0.03, 2700.0, -0.1
# what a fit is to find: Young's modulus [Pa] and the time of Kelvin-Voigt damping [s]
E, TAU = 70.0e9, 8.0e-4
# noise [m], seed, number and distance [s] of samples; modes of the sum
NOISE, SEED, SAMPLES, STEP, MODES = 2.0e-5, 1, 150, 0.01, 12
FILE = Path(__file__).resolve().parents[1] / "cases/dynamic/measured_cantilever.csv"


def tip(t: np.ndarray, E: float = E, tau: float = TAU) -> np.ndarray:
    """Return the displacement [m] of the tip of a slender cantilever at t, after a force has begun to act on it.

    Sum over the modes phi_k of an Euler-Bernoulli beam (Meirovitch, Fundamentals of Vibrations, 2001, section 8.8),
    with cos(b) cosh(b) = -1, omega = b^2 sqrt(EI/(rho A L^4)), phi_k(L)^2 = 4/(rho A L), ratios of damping tau omega/2.
    """
    A, I = WIDTH * HEIGHT, WIDTH * HEIGHT**3 / 12.0
    u = np.zeros(len(t))
    for k in range(1, MODES + 1):
        middle = (k - 0.5) * np.pi
        b = brentq(lambda x: np.cos(x) + 1.0 / np.cosh(x), middle - 0.4, middle + 0.4, xtol=1e-13)
        omega = b**2 * np.sqrt(E * I / (RHO * A * L**4))
        # roots of s^2 + tau omega^2 s + omega^2; complex arithmetic covers both sides of critical damping
        root = np.sqrt(complex((0.5 * tau * omega**2) ** 2 - omega**2))
        s1, s2 = -0.5 * tau * omega**2 + root, -0.5 * tau * omega**2 - root
        decay = (s1 * np.exp(s2 * t) - s2 * np.exp(s1 * t)) / (s1 - s2)
        u += (4.0 / (RHO * A * L)) * FORCE / omega**2 * (1.0 - decay.real)
    return u


def measured(seed: int = SEED, noise: float = NOISE) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) and noisy displacements (n,) of the tip."""
    t = STEP * np.arange(1, SAMPLES + 1)
    return t, tip(t) + noise * np.random.default_rng(seed).standard_normal(len(t))


def main() -> None:
    """Write the measurement."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with FILE.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["t", "tip.uy"])
        writer.writerows((f"{t:.2f}", f"{u:.6e}") for t, u in zip(*measured(), strict=True))


if __name__ == "__main__":
    main()
