"""The limit points and post-buckling shapes that ``cases/paths`` expects, recomputed without finite elements."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from instruments.references import paths as path_references

from ancf2d.study.run import load

PATHS = Path(__file__).parents[2] / "cases" / "paths"


def expected(case: str, number: int) -> list[float]:
    """Return the expected load and displacements at a limit point."""
    return [e.value for e in load(PATHS / f"{case}.yaml").case.expected if e.limit_point == number]


# of several limit points of a curve, the others are in the solved cases, to the digits that these expect
@pytest.mark.slow
@pytest.mark.parametrize(("number", "q", "P"), [(1, [-0.35, -1.42, 0.66], 1.85)])
def test_limit_points_of_lee_frame(number: int, q: list[float], P: float) -> None:
    P, u = path_references.lee_frame_limit(q, P)
    for case in ("lee_frame_reissner3", "lee_frame_vallejo"):
        np.testing.assert_allclose([P, *u[:2]], expected(case, number), rtol=1e-8)


@pytest.mark.slow
def test_limit_point_of_the_deep_arch() -> None:
    P, u = path_references.deep_arch_limit([0.267, -0.309, -0.283], 0.897)
    for case in ("deep_arch_reissner3", "deep_arch_vallejo"):
        np.testing.assert_allclose([P, *u[:2]], expected(case, 1), rtol=1e-8)


@pytest.mark.parametrize(("number", "q", "P"), [
    (1, [-0.17, 0.034], 0.408), pytest.param(4, [-0.956, -0.299], -0.108, marks=pytest.mark.slow)])
def test_limit_points_of_the_shallow_arch(number: int, q: list[float], P: float) -> None:
    np.testing.assert_allclose(path_references.shallow_arch_limit(q, P), expected("shallow_arch", number), rtol=1e-8)


def test_elastica_of_the_buckled_column() -> None:
    P, x, y = path_references.buckled_cantilever(math.pi / 3)
    values = {e.quantity: e.value for e in load(PATHS / "column_postbuckling.yaml").case.expected}
    np.testing.assert_allclose([P, x, y], [values["fy"], values["x"], values["y"]], rtol=1e-8)
