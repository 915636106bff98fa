"""The exact values that cases expect, recomputed from the beam's differential equation."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from instruments.references import statics as references
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipkinc

from ancf2d.study.run import load

STATIC = Path(__file__).parents[2] / "cases" / "static"
SLIM = references.Beam(math.inf, math.inf, 1.0)
SLENDER = references.rectangle(2.07e11, 0.3, 0.1, 0.1)


def expected(case: str, probe: str) -> np.ndarray:
    """Return the expected ux, uy and, where given, theta of a probe."""
    values = {e.quantity: e.value for e in load(STATIC / f"{case}.yaml").case.expected if e.probe == probe}
    return np.array([values[q] for q in ("ux", "uy", "theta") if q in values])


def test_elastica_by_elliptic_integrals_agrees_with_shooting() -> None:
    # P L^2/EI = 2: F(pi/2, k) - F(phi_0, k) = sqrt(2), sin(phi_0) = 1/(k sqrt(2)), after Mattiasson 1981
    def load_of(k: float) -> float:
        phi = math.asin(1 / (k * math.sqrt(2)))
        return (ellipkinc(math.pi / 2, k * k) - ellipkinc(phi, k * k)) ** 2

    k = brentq(lambda k: load_of(k) - 2, 0.7072, 0.9999, xtol=1e-15)
    phi = math.asin(1 / (k * math.sqrt(2)))
    deflection = 1 - 2 / math.sqrt(2) * (ellipeinc(math.pi / 2, k * k) - ellipeinc(phi, k * k))
    angle = math.asin(2 * k * k - 1)
    ux, uy, theta = references.cantilever(SLIM, 1, [0, -2])
    np.testing.assert_allclose([-uy, -theta], [deflection, angle], rtol=1e-11)
    assert 1 + ux == pytest.approx(math.sqrt(2 * math.sin(angle) / 2), rel=1e-11)


@pytest.mark.slow_rows("five-5", "ten-10")
@pytest.mark.parametrize(("probe", "P"), [("half", 0.5), ("one", 1), ("two", 2), ("five", 5), ("ten", 10)])
def test_elastica(probe: str, P: float) -> None:
    np.testing.assert_allclose(references.cantilever(SLIM, 1, [0, -P]), expected("elastica", probe), rtol=2e-11)


@pytest.mark.parametrize(("probe", "kGA"), [("stiff", 500), ("soft", 50)])
def test_elastica_with_shear(probe: str, kGA: float) -> None:
    beam = references.Beam(math.inf, kGA, 1.0)
    exact = references.cantilever(beam, 1, [0, -1])[:2]
    np.testing.assert_allclose(exact, expected("elastica_shear", probe), rtol=2e-11)


@pytest.mark.slow_rows("slender_cantilever_cable-beam2-1293750", "slender_cantilever_shear-beam1-1293750")
@pytest.mark.parametrize(("case", "beam", "P"), [
    ("thick_cantilever_exact", references.rectangle(2.07e11, 0.3, 0.5, 0.1), 62.5e6),
    ("slender_cantilever_shear", SLENDER, 1293750),
    ("slender_cantilever_cable", references.Beam(SLENDER.EA, math.inf, SLENDER.EI), 1293750)])
def test_cantilevers_of_the_literature(case: str, beam: references.Beam, P: float) -> None:
    np.testing.assert_allclose(references.cantilever(beam, 2, [0, -P])[:2], expected(case, "tip"), rtol=1e-10)


def test_table_2_exact_beam() -> None:
    beam = references.rectangle(2.07e11, 0.3, 0.1, 0.1, k=5 / 6)
    tip = references.cantilever(beam, 2, [0, -5e5])[:2]
    np.testing.assert_allclose(tip, [-0.1447677, -0.6808863], rtol=0, atol=2e-7)


def test_follower_force() -> None:
    np.testing.assert_allclose(references.follower_cantilever(SLIM, 1, [0, -4]), expected("follower_force", "tip"),
                               rtol=1e-10)


def test_a_follower_force_that_hardly_turns_is_a_dead_one() -> None:
    follower = references.follower_cantilever(SLIM, 1, [0, -1e-4])
    np.testing.assert_allclose(follower[1:], [-1e-4 / 3, -1e-4 / 2], rtol=1e-6)


@pytest.mark.slow
def test_lee_frame() -> None:
    np.testing.assert_allclose(references.lee_frame(15000), expected("lee_frame", "load"), rtol=1e-9)


@pytest.mark.slow
def test_deep_arch() -> None:
    np.testing.assert_allclose(references.deep_arch(700), expected("deep_arch", "apex"), rtol=1e-9)
