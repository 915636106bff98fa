"""Energy of layers between bodies: conserved if ends slide past points, or bodies rotate."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.model.point_tables import Batch

RUBBER = {"E": 1e7, "nu": 0.3, "rho": 1000.0}
RIGID = {"type": "rigid"}


def strip(start: Any, end: Any, element: dict[str, Any] = RIGID, height: Any = 0.03) -> dict[str, Any]:
    """Return a straight body."""
    geometry = {"type": "line", "start": [float(x) for x in start], "end": [float(x) for x in end]}
    return h.body(geometry, element, {"height": height, "width": 0.02}, RUBBER)


def thrown(x: float, y: float, angle: float, velocity: tuple[float, float], spin: float) -> dict[str, Any]:
    """Return a free rod at rest, and a shorter inclined one, centred at x, y, that is thrown at it."""
    centre, half = np.array([x, y]), 0.175 * np.array([np.cos(angle), np.sin(angle)])
    return {"bodies": {"one": strip([-0.25, 0], [0.25, 0]), "two": strip(centre - half, centre + half)},
            "contacts": [{"between": ["one", "two"], "law": {"stiffness": 3e5}}],
            "initial": {"bodies": {"two": {"velocity": list(velocity),
                                           "rotation_rate": {"omega": spin, "about": centre.tolist()}}}}}


def sliding(order: list[str], element: Any, friction: float) -> dict[str, Any]:
    """Return a block that slides off the end of a plank and tips over it under gravity."""
    height, depth = 0.02, 0.001
    block = strip([-0.3, height - depth], [0.0, height - depth], element(4), height)
    return {"bodies": {"block": block, "plank": strip([-0.9, 0], [0.1, 0], element(8), height)},
            "boundary_conditions": [{"type": "clamp", "at": "plank@0"}],
            "loads": [{"type": "gravity", "value": [0, -9.81]}],
            # its depth at rest
            "contacts": [{"between": order, "law": {"stiffness": 1000.0 * height * 0.02 * 9.81 / depth},
                          "friction": friction}],
            "initial": {"bodies": {"block": {"velocity": [1.2, 0.0]}}}}


def drift(scene: dict[str, Any], t_end: float, tolerance: float = 1e-5, interval: float = 0.01) -> float:
    """Return the largest change of the energy, including dissipation, relative to the largest energy."""
    found = ancf2d.solve({**scene, "output": {"interval": interval}, "solver": {
        "type": "dynamic", "t_end": t_end, "tolerance": tolerance, "estimate": False}})
    e = found.energies
    total = e["kinetic"] + e["strain"] + e["potential"] - e["work"] + e["dissipated"]
    return float(np.abs(total - total[0]).max() / (e["kinetic"] + e["strain"]).max())


@pytest.mark.parametrize("way", [
    # an end of one slides past points of the other at a depth: 0.7 and 0.07 of the energy, if they cease to press there
    (-0.074, 0.306, 4.384, (-0.35, -1.93), 4.63), (-0.149, 0.326, 2.603, (-0.41, -1.60), -1.10),
    # an end turns away from the face that it is in: 0.1
    (0.139, 0.334, 3.043, (0.25, -1.98), 3.08),
    # points in corners go over from a face to an end: 0.01
    (-0.191620, 0.243808, 2.502195, (-0.115937, -1.516995), 0.132971)])
def test_rods_that_bounce_off_each_other_conserve_energy(way):
    assert drift(thrown(*way), 0.3, interval=0.05) < 1e-4


@pytest.mark.parametrize("seed", range(4))
def test_the_energy_of_each_point_is_continuous(seed):
    """It does not jump along straight paths on which corners of two rods pass through each other, at any depth."""
    rng, scene = np.random.default_rng(seed), thrown(0.0, 0.0, 0.0, (0.0, 0.0), 0.0)
    model = h.build(scene["bodies"], {"type": "dynamic", "t_end": 1.0, "tolerance": 1e-5}, contacts=scene["contacts"])
    points, ends, corner = Batch(model.springs), [], rng.choice([-1.0, 1.0], (2, 2))
    for _ in range(2):
        angle, (one, two) = rng.uniform(0.0, 2.0 * np.pi), corner * [[0.25, 0.015], [0.175, 0.015]]
        c, s = np.cos(angle), np.sin(angle)
        shift = one - np.array([[c, -s], [s, c]]) @ two + rng.uniform(-0.01, 0.01, 2)
        ends.append(h.rotate(np.zeros(model.n_q), model, angle, shift))
    ends = np.array(ends)
    ends[:, :model.meshes["two"].first_dof] = 0.0

    def energies(s):
        points.energies((1.0 - s) * ends[0] + s * ends[1], 0.0)
        return points._energy.copy()

    s = np.linspace(0.0, 1.0, 400)
    found = np.array([energies(x) for x in s])
    for k in range(found.shape[1]):
        at = int(np.argmax(abs(np.diff(found[:, k]))))
        low, high = s[at], s[at + 1]
        for _ in range(30):
            middle = 0.5 * (low + high)
            before, now, after = (energies(x)[k] for x in (low, middle, high))
            low, high = (low, middle) if abs(now - before) > abs(after - now) else (middle, high)
        assert abs(after - before) < 1e-6 * found.max()


@pytest.mark.parametrize("element", [lambda count: RIGID, pytest.param(lambda count: h.element("cable", count),
                                                                       marks=pytest.mark.slow)], ids=["rigid", "cable"])
@pytest.mark.parametrize("order", [["block", "plank"], ["plank", "block"]])
@pytest.mark.parametrize("friction", [0.0, pytest.param(0.2, marks=pytest.mark.slow)])
def test_a_block_that_slides_off_the_end_of_a_plank_conserves_energy(order, element, friction):
    """Its points could lose up to k g^2/4 per length there: up to 0.015 of the energy."""
    assert drift(sliding(order, element, friction), 0.2) < 1e-4


@pytest.mark.slow
def test_a_soft_whip_that_strikes_its_own_arm_conserves_energy():
    path = {"type": "path", "start": [0, 0], "pieces": [{"line": 0.35}, {"arc": 0.1, "angle": np.pi}, {"line": 0.3}]}
    whip = h.body(path, h.element("cable", 20), {"height": 0.02, "width": 0.02}, {**RUBBER, "E": 2e6})
    scene = {"bodies": {"whip": whip}, "boundary_conditions": [{"type": "clamp", "at": "whip@0"}],
             "loads": [{"type": "gravity", "value": [0, -9.81]}],
             "contacts": [{"self": "whip", "law": {"stiffness": 5e4}}]}
    # the tip lands after 0.2 s and slides along the arm
    assert drift(scene, 0.28) < 1e-4


SOFT = {"E": 1e8, "nu": 0.3, "rho": 1000.0}


def leaf(length: float, y: float = 0.0) -> dict[str, Any]:
    return h.body(h.line(length, start=(0.0, y)), h.element("cable", 6), {"height": 0.02, "width": 0.02}, SOFT)


# a post whose corner is beside a point of the beam that it presses; and friction that an equilibrium needs
HELD = {
    "post": {"bodies": {"beam": leaf(1.0), "post": strip([0.6037, 0.0079], [0.6037, 0.2], height=0.02)},
             "boundary_conditions": [{"type": "clamp", "at": at} for at in ("beam@0", "beam@1", "post@1")],
             "contacts": [{"between": ["post", "beam"], "law": {"stiffness": 1e5}}]},
    "leaves": {"bodies": {"long": leaf(1.0), "short": leaf(0.7, 0.0201)},
               "boundary_conditions": [{"type": "clamp", "at": f"{name}@0"} for name in ("long", "short")],
               "loads": h.tip(0.0, 1.0, at="long@1"),
               "contacts": [{"between": ["short", "long"], "law": {"stiffness": 1e6}, "friction": 0.3}]},
    "drum": {"bodies": {"long": leaf(1.0)}, "boundary_conditions": [{"type": "clamp", "at": "long@0"}],
             "obstacles": {"drum": {"type": "circle", "center": [0.4, -0.211], "radius": 0.2}},
             "loads": h.tip(0.3, -1.0, at="long@1"),
             "contacts": [{"between": ["long", "drum"], "law": {"stiffness": 1e6}, "friction": 0.3}]}}


@pytest.mark.parametrize("scene", HELD.values(), ids=HELD)
def test_a_motion_from_an_equilibrium_with_layers_stays_there(scene):
    found = ancf2d.solve({**scene, "initial": {"from": "static"},
                          "solver": {"type": "dynamic", "t_end": 0.02, "tolerance": 1e-5, "estimate": False}})
    assert found.energies["kinetic"].max() < 1e-15 * found.energies["strain"].max()


@pytest.mark.parametrize("scene", [*HELD, "smooth drum"])
def test_a_motion_from_a_static_file_reports_different_layer_forces(scene, tmp_path):
    """Near ends, and with friction; the disturbance is then a share of the energy of the layers."""
    case = HELD[scene.split()[-1]]
    if scene == "smooth drum":
        case = {**case, "contacts": [{**case["contacts"][0], "friction": 0.0}]}
    ancf2d.solve({**case, "solver": {"type": "static"}}, output=str(tmp_path / "still.h5"))
    found = ancf2d.solve({**case, "initial": {"from": str(tmp_path / "still.h5")},
                          "solver": {"type": "dynamic", "t_end": 0.002, "tolerance": 1e-5, "estimate": False}})
    kick = found.energies["kinetic"].max() / found.energies["strain"].max()
    told = [text for text in found.summary["warnings"] if "initial: {from: static} starts in equilibrium" in text]
    assert bool(told) == (scene != "smooth drum")
    assert bool(told) == (kick > 1e-12)
