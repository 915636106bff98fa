"""Random rods among obstacles: no penetration, no passage, no energy gain; beams in equilibrium."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import pytest
from instruments.scenes import touching, touching_bodies


@pytest.mark.trials([
    # bounces without loss until it spins by more than 0.4 rad in a step of 0.01 s
    62,
    # a cable of two elements whose waves are far too fast for its steps
    pytest.param(54, marks=pytest.mark.slow),
    # the same where an obstacle shakes, which gives energy in impacts
    pytest.param(191, marks=pytest.mark.slow),
    # points whose friction presses one another on as fast as it grows
    pytest.param(379, marks=pytest.mark.slow)])
def test_rods_do_not_penetrate_and_gain_no_energy(number: int, pytestconfig: pytest.Config,
                                                  measured: Callable[..., None]) -> None:
    found = touching.judged(pytestconfig.getoption("seed"), number)
    measured("", "touching", asdict(found), "instruments.scenes.touching:report")
    assert found.faults == []


@pytest.mark.trials([
    # passes behind a block in one load step, and deep through a side of an obstacle
    36, 380,
    # a point that is left out beside a closed one, without which the body is too deep
    124,
    # the place of lift-off goes to and fro between places at which other points open and close
    659,
    *(pytest.param(k, marks=pytest.mark.slow) for k in range(20))])
def test_a_beam_pressed_onto_obstacles_has_an_equilibrium_outside_them(number: int,
                                                                       pytestconfig: pytest.Config) -> None:
    assert touching.pressed(pytestconfig.getoption("seed"), number) == []


@pytest.mark.parametrize(("seed", "number"), [
    # what touches makes the path turn by more than 45 degrees there
    (77, 12), (77, 67),
    # a place slides beyond its interval within Newton's method
    (1, 448), *(pytest.param(77, k, marks=pytest.mark.slow) for k in range(20))])
def test_a_path_passes_all_obstacles_of_a_beam(seed: int, number: int) -> None:
    assert touching.pressed(seed, number, method="arc_length", until={"load_factor": 1}) == []


@pytest.mark.parametrize("number", [4, 30, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 7, 12, 15, 17, 24))])
def test_a_path_passes_the_layers_of_obstacles(number: int) -> None:
    """The path has a kink of more than 45 degrees where points enter a stiff layer."""
    assert touching.pressed(77, number, stiffness=1e7, method="arc_length", until={"load_factor": 1}) == []


@pytest.mark.parametrize("number", [19, *(pytest.param(k, marks=pytest.mark.slow) for k in (4, 10))])
def test_a_beam_pressed_onto_stiff_layers_has_an_equilibrium(number: int) -> None:
    """A full increment of Newton's method leads from inside a layer out of it, and the next one back."""
    assert touching.pressed(5, number, stiffness=1e7) == []


@pytest.mark.parametrize("number", [
    # layers at zero gap, without friction and with it, to which full increments go to and fro
    59, 31,
    # increments that lead too far, and that friction makes slow
    7, 25,
    # a thin beam that would pass through the softest layer
    2,
    *(pytest.param(k, marks=pytest.mark.slow) for k in range(24) if k not in (2, 7))])
def test_a_beam_pressed_onto_another_has_an_equilibrium(number: int) -> None:
    assert touching_bodies.pressed(3, number) == []


@pytest.mark.parametrize("number", [
    # layers at zero gap, which press just after the start: without friction, and with it
    20, 33,
    # the end of the lower beam, around which the upper one bends
    25,
    *(pytest.param(k, marks=pytest.mark.slow) for k in (0, 2, 5, 7, 10, 11, 30, 36, 37, 38))])
def test_a_path_passes_the_layers_between_two_beams(number: int) -> None:
    assert touching_bodies.pressed(3, number, method="arc_length", until={"load_factor": 1}) == []


@pytest.mark.slow
def test_a_rod_that_a_layer_throws_back_gains_no_energy() -> None:
    """The loss of a layer is measured at rates of approach: at others it may already have released."""
    assert touching.judged(5, 89).faults == []


def test_distances_are_those_of_plane_geometry() -> None:
    square = {"type": "polyline", "points": [[0, 0], [1, 0], [1, 1], [0, 1]]}
    X = np.array([[0.5, 0.25], [2.0, 2.0], [0.5, -1.0], [-1.0, 0.5]])
    np.testing.assert_allclose(touching.distance(square, X), [-0.25, math.sqrt(2.0), 1.0, 1.0])
    np.testing.assert_allclose(touching.distance({"type": "circle", "center": [0, 0], "radius": 1}, X[1:]),
                               [math.sqrt(8.0) - 1.0, math.sqrt(1.25) - 1.0, math.sqrt(1.25) - 1.0])
    np.testing.assert_allclose(touching.distance({"type": "half_plane", "through": [0, 1], "normal": [0, 2]}, X),
                               [-0.75, 1.0, -2.0, -0.5])


def test_a_passage_through_an_obstacle_is_detected() -> None:
    disc = {"type": "circle", "center": [0, 0], "radius": 0.1}
    X = np.array([[[-1.0, 0.0]], [[1.0, 0.0]]])
    one, parts = np.array([True]), np.array([False])
    assert touching._passage(disc, X, touching.distance(disc, X), one) == pytest.approx(0.1, abs=0.01)
    assert touching._passage(disc, X, touching.distance(disc, X), parts) == 0.0
    beside = X + np.array([0.0, 0.2])
    assert touching._passage(disc, beside, touching.distance(disc, beside), one) == 0.0
