"""Energy of layers between bodies: none appears or vanishes where ends slide past points, or where bodies turn."""

from __future__ import annotations

from typing import Any

import h5py
import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.kernels.body_passages import may_be_deep
from ancf2d.model.point_tables import Batch

RUBBER = {"E": 1e7, "nu": 0.3, "rho": 1000.0}
RIGID = {"type": "rigid"}


def strip(start: Any, end: Any, element: dict[str, Any] = RIGID, height: Any = 0.03) -> dict[str, Any]:
    """Return a straight body."""
    geometry = {"type": "line", "start": [float(x) for x in start], "end": [float(x) for x in end]}
    return h.body(geometry, element, {"height": height, "width": 0.02}, RUBBER)


def angle_of(turn: float) -> dict[str, Any]:
    """Return a free body with two arms, which turns by an angle in degrees at the origin."""
    end = [0.25 * float(np.cos(np.deg2rad(turn))), 0.25 * float(np.sin(np.deg2rad(turn)))]
    return h.body({"type": "polyline", "points": [[-0.25, 0.0], [0.0, 0.0], end]}, RIGID,
                  {"height": 0.03, "width": 0.02}, RUBBER)


ROD = strip([-0.25, 0], [0.25, 0])
# its height is halved in the middle
HALVED = {"s": [0, 0.5, 0.5, 1], "value": [0.03, 0.03, 0.015, 0.015]}
STEPPED = strip([-0.25, 0], [0.25, 0], h.element("cable", 2), HALVED)
RING = h.body({"type": "path", "start": [0, 0], "pieces": [{"arc": 0.15, "angle": 2 * np.pi}], "closed": True},
              h.element("cable", 12), {"height": HALVED, "width": 0.02}, RUBBER)


def thrown(x: float, y: float, angle: float, velocity: tuple[float, float], spin: float, one: Any = ROD
           ) -> dict[str, Any]:
    """Return a free body at rest, and a rod, centred at x, y and inclined by an angle, that is thrown at it."""
    centre, half = np.array([x, y]), 0.175 * np.array([np.cos(angle), np.sin(angle)])
    return {"bodies": {"one": one, "two": strip(centre - half, centre + half)},
            "contacts": [{"between": ["one", "two"], "law": {"stiffness": 3e5}}],
            "initial": {"bodies": {"two": {"velocity": list(velocity),
                                           "rotation_rate": {"omega": spin, "about": centre.tolist()}}}}}


def sliding(order: list[str], element: Any, friction: float) -> dict[str, Any]:
    """Return a block that slides off the end of a plank and tips over it, pressed down by gravity."""
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
    """Return the largest change of the energy, with what was dissipated, relative to the largest energy."""
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
    (-0.191620, 0.243808, 2.502195, (-0.115937, -1.516995), 0.132971),
    # faces of two arms leave a gap outside of a corner: 0.2; and cross inside: 0.01
    (0.149917, -0.189494, -0.895955, (-1.417658, 1.440958), 0.414612, angle_of(90.0)),
    (-0.066597, 0.230622, 1.883145, (0.040719, -0.890906), 1.471895, angle_of(30.0))])
def test_rods_that_bounce_off_each_other_conserve_energy(way):
    assert drift(thrown(*way), 0.3, interval=0.05) < 1e-4


def model_of(body: dict[str, Any]) -> Any:
    """Return the model of a motion in which a rod, at first along the x axis, may touch a body."""
    scene = thrown(0.0, 0.0, 0.0, (0.0, 0.0), 0.0, body)
    return h.build(scene["bodies"], {"type": "dynamic", "t_end": 1.0, "tolerance": 1e-5}, contacts=scene["contacts"])


def moved(model: Any, angle: float, shift: Any) -> np.ndarray:
    """Return displacements that rotate the rod about the origin, and shift it."""
    out = h.rotate(np.zeros(model.n_q), model, angle, np.array(shift))
    out[:model.meshes["two"].first_dof] = 0.0
    return out


def largest_jump(model: Any, start: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Return the largest jump of the energy of a point along a straight path, and the largest energy."""
    points = Batch(model.springs)

    def energies(s: float) -> np.ndarray:
        points.energies((1.0 - s) * start + s * end, 0.0)
        return np.array(points._energy)

    s, jump = np.linspace(0.0, 1.0, 400), 0.0
    found = np.array([energies(x) for x in s])
    for k in range(found.shape[1]):
        at = int(np.argmax(abs(np.diff(found[:, k]))))
        (low, high), (before, after) = s[at:at + 2], found[at:at + 2, k]
        for _ in range(30):
            now = energies(middle := 0.5 * (low + high))[k]
            if abs(now - before) > abs(after - now):
                high, after = middle, now
            else:
                low, before = middle, now
        jump = max(jump, abs(after - before))
    return jump, float(found.max())


# a body, and a place at its surface
SURFACES = {"end": (ROD, [0.25, 0.015]), "corner": (angle_of(90.0), [0.0, 0.0]), "blunt": (angle_of(30.0), [0.0, 0.01]),
            "sharp": (angle_of(-150.0), [0.0, 0.0]), "step": (STEPPED, [0.0, 0.011]), "ring": (RING, [0.0, 0.011])}


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 8))])
@pytest.mark.parametrize("surface", SURFACES)
def test_the_energy_of_each_point_is_continuous(surface, seed):
    """It has no jump along straight paths on which a corner of a rod passes through the surface, at any depth."""
    rng, (body, place) = np.random.default_rng(seed), SURFACES[surface]
    model, ends, corner = model_of(body), [], rng.choice([-1.0, 1.0], (2, 2))
    for _ in range(2):
        angle, (one, two) = rng.uniform(0.0, 2.0 * np.pi), corner * [place, [0.175, 0.015]]
        c, s = np.cos(angle), np.sin(angle)
        ends.append(moved(model, angle, one - np.array([[c, -s], [s, c]]) @ two + rng.uniform(-0.01, 0.01, 2)))
    jump, most = largest_jump(model, *ends)
    assert jump <= 1e-6 * most


@pytest.mark.parametrize("surface", SURFACES)
def test_only_bodies_that_overlap_deeply_are_looked_at_closely(surface):
    """Chords of the curves show that no point is deep."""
    rng, (body, place) = np.random.default_rng(3), SURFACES[surface]
    model, counts = model_of(body), np.zeros((2, 2), dtype=int)
    for _ in range(300):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        to = place + rng.uniform(-0.02, 0.02, 2) - np.array([[c, -s], [s, c]]) @ [0.175, 0.015]
        d = moved(model, angle, to)
        for one in model.contact_tables:
            depth, limit = one.pair.overlap(d)[0], one.pair.too_deep
            found = may_be_deep(one.facing, one.table, d, limit, 0.5 * one.pair.height)
            counts[int(found), int(depth > limit)] += 1
            assert found or depth <= limit
    # at most those that hover as far away as they would be deep are looked at in vain
    assert counts[0, 0] > 50
    assert counts[1, 1] > 20


def test_a_point_keeps_its_energy_where_faces_leave_a_gap_at_a_blunt_corner():
    """It slides over the gap at a depth of half a millimetre, where it would have none."""
    model, (c, s) = model_of(angle_of(5.0)), (np.cos(np.deg2rad(2.5)), np.sin(np.deg2rad(2.5)))
    point = 0.175 * 0.75 * 0.3399810435848563
    start, end = (moved(model, np.arctan2(s, c), np.array([[c, -s], [s, c]]) @ [x - point, -0.0295])
                  for x in (-2e-3, 2e-3))
    jump, most = largest_jump(model, start, end)
    assert jump < 1e-6 * most


@pytest.mark.parametrize("element", [lambda count: RIGID, pytest.param(lambda count: h.element("cable", count),
                                                                       marks=pytest.mark.slow)], ids=["rigid", "cable"])
@pytest.mark.parametrize("order", [["block", "plank"], ["plank", "block"]])
@pytest.mark.parametrize("friction", [0.0, pytest.param(0.2, marks=pytest.mark.slow)])
def test_a_block_that_slides_off_the_end_of_a_plank_conserves_energy(order, element, friction):
    """Its points would lose up to k g^2/4 per length there: up to 0.015 of the energy."""
    assert drift(sliding(order, element, friction), 0.2) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vallejo", "2d2n"])
def test_the_end_of_a_body_rubs_alike_with_all_kinds_of_sections(name):
    """The place on an end is the height in the section, also where positions across it are interpolated."""
    def lost(element: str) -> float:
        post = strip([0.5, 0.0099], [0.5, 0.2], h.element(element, 2), 0.02)
        found = ancf2d.solve({
            "bodies": {"plank": leaf(1.0), "post": post | {"material": SOFT}},
            "boundary_conditions": [{"type": "clamp", "at": at} for at in ("plank@0", "plank@1")],
            "loads": [{"type": "gravity", "value": [3.0, -9.81]}],
            "contacts": [{"between": ["post", "plank"], "law": {"stiffness": 1e5, "damping": 100}, "friction": 0.6}],
            "solver": {"type": "dynamic", "t_end": 0.1, "tolerance": 1e-4, "estimate": False}})
        return float(found.energies["dissipated"][-1])

    assert lost(name) == pytest.approx(lost("cable"), rel=0.05)


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
    found = ancf2d.solve({**scene, "initial": {"from": "static"}, "output": {"interval": 0.002},
                          "solver": {"type": "dynamic", "t_end": 0.02, "tolerance": 1e-5, "estimate": False}})
    assert found.energies["kinetic"].max() < 1e-15 * found.energies["strain"].max()


@pytest.mark.parametrize("scene", ["drum", pytest.param("post", marks=pytest.mark.slow),
                                   pytest.param("leaves", marks=pytest.mark.slow)])
def test_a_motion_from_a_file_of_statics_stays_in_its_equilibrium(scene, tmp_path):
    """With what the points of layers remember, and with pressure that fades near ends. Older files lack the memory."""
    case, path = HELD[scene], tmp_path / "still.h5"

    def kick(**changes: Any) -> tuple[float, bool]:
        found = ancf2d.solve({**case, **changes, "initial": {"from": str(path)},
                              "solver": {"type": "dynamic", "t_end": 0.002, "tolerance": 1e-5, "estimate": False}})
        told = any("initial: {from: static} starts in equilibrium" in text for text in found.summary["warnings"])
        return found.energies["kinetic"].max() / found.energies["strain"].max(), told

    ancf2d.solve({**case, "solver": {"type": "static"}}, output=str(path))
    size, told = kick()
    assert size < 1e-15
    assert not told
    # without supports there is no equilibrium beside the stored state
    assert kick(boundary_conditions=[])[0] > 1e-6
    with h5py.File(path, "r+") as file:
        del file["arrays/contacts"]
    size, told = kick()
    assert size > 1e-12
    assert told
