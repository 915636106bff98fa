"""Contact of jointed bodies: no contact near the joint, contact further along."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.errors import CaseError
from ancf2d.solvers.contact import contact_report

HEIGHT = 0.04
SOFT = {"E": 2e9, "nu": 0.3, "rho": 1000.0}


def link(start: Any, end: Any, count: int = 4) -> dict[str, Any]:
    """Return a straight, square bar."""
    return h.body({"type": "line", "start": list(start), "end": list(end)}, h.element("reissner3", count),
                  {"height": HEIGHT, "width": HEIGHT}, SOFT)


def folded(count: int = 4, **contact: Any) -> ancf2d.Solution:
    """Return the motion of a bar that hangs from a clamped one by a pin, and swings until it folds onto it."""
    return ancf2d.solve({
        "bodies": {"fixed": link([0, 0], [1, 0], count), "free": link([1, 0], [2, 0], count)},
        "boundary_conditions": [{"type": "clamp", "at": "fixed@0"}],
        "joints": [{"type": "pin", "between": ["fixed@1", "free@0"]}],
        "loads": [{"type": "gravity", "value": [0, -9.81]}],
        "contacts": [{"between": ["fixed", "free"], **contact}] if contact else [],
        "solver": {"type": "dynamic", "t_end": 0.8, "tolerance": 1e-4, "estimate": False},
        "output": {"interval": 0.05, "probes": {"tip": "free@1"}}})


def balance(found: ancf2d.Solution) -> tuple[float, float]:
    """Return the smallest and largest energy over the motion, including dissipation, over the largest energy."""
    e = found.energies
    total = e["kinetic"] + e["strain"] + e["potential"] - e["work"] + e["dissipated"]
    size = float((e["kinetic"] + e["strain"]).max())
    return float(total.min()) / size, float(total.max()) / size


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, 16])
def test_links_that_fold_onto_each_other_keep_their_energy(count):
    """A layer pushes from where faces begin to overlap, not from a distance from the joint, on any mesh."""
    free, layer = folded(), folded(count, law={"stiffness": 1e6})
    assert free.course["tip"]["theta"][-1] < -2.85
    # folded to a sharp angle, at which faces overlap deeply beside the pin, and held back
    assert -2.6 < layer.course["tip"]["theta"][-1] < -2.4
    low, high = balance(layer)
    assert -2e-3 < low <= high < 2e-3


def test_links_that_fold_onto_each_other_without_a_law_gain_nothing():
    found = folded(friction=0.0)
    low, high = balance(found)
    assert found.course["tip"]["theta"][-1] > -2.95
    assert found.energies["dissipated"][-1] > 0.0
    assert -5e-3 < low <= high < 5e-3


@pytest.mark.slow_rows("order1")
@pytest.mark.parametrize("order", [("one", "two"), ("two", "one")])
def test_tongs_touch_only_at_their_ends(order):
    """A bent arm, pinned to the end of a bar that it overlaps there, is pressed down until its other end touches it.

    About the pin, the force F on that end is carried by the contact below it, but for a soft spring.
    """
    force = 400.0
    arm = link([0, 0], [1, 0], 8)
    arm["geometry"] = {"type": "polyline", "points": [[0, 0], [0.15, 0.2], [0.85, 0.2], [0.85, 0.05]]}
    found = h.Solution(h.build(
        {"one": link([0, 0], [1, 0]), "two": arm},
        {"type": "static", "steps": 4}, bc=[{"type": "clamp", "at": f"one@{s}"} for s in (0, 1)],
        joints=[{"type": "pin", "between": ["one@0", "two@0"]}],
        springs=[{"type": "rotational", "between": ["one@0", "two@0"], "stiffness": 1.0}],
        loads=[{"type": "force", "at": "two@1", "value": [0, -force]}], contacts=[{"between": list(order)}]))
    (report,) = contact_report(found.model, found.state)
    # a corner bears, half a height beside the force
    assert report["force"][1] == pytest.approx(force if order[0] == "two" else -force, rel=0.5 * HEIGHT / 0.8)
    place = 1.0 if order[0] == "two" else 0.85
    assert report["from"] == pytest.approx(place, abs=0.03)
    assert report["to"] == pytest.approx(place, abs=0.03)


@pytest.mark.slow_rows("None-15.0", "None-45.0", "None-80.0")
@pytest.mark.parametrize("angle", [15.0, 45.0, 80.0])
@pytest.mark.parametrize("law", [{"stiffness": 1e6}, None])
def test_a_sharp_corner_of_a_body_does_not_push_its_arms_apart(angle, law):
    """Near a corner the arms of a bracket overlap: unless they close, it bends as without contact."""
    def tip(**scene: Any) -> Any:
        c, s = float(np.cos(np.radians(angle))), float(np.sin(np.radians(angle)))
        bracket = link([0, 0], [1, 0], 16)
        bracket["geometry"] = {"type": "polyline", "points": [[1, 0], [0, 0], [c, s]]}
        found = h.Solution(h.build({"bracket": bracket}, bc=[{"type": "clamp", "at": "bracket@0"}],
                                   loads=[{"type": "force", "at": "bracket@1", "value": [0, -5]}], **scene))
        return found.r("bracket@1")

    touching = tip(contacts=[{"self": "bracket"} | ({"law": law} if law else {})])
    np.testing.assert_allclose(touching, tip(), rtol=0, atol=1e-9)


@pytest.mark.slow_rows("None")
@pytest.mark.parametrize("law", [{"stiffness": 1e6}, None])
def test_a_loop_closed_by_a_pin_has_no_contact_there(law):
    """Jointed ends of one body overlap, too."""
    def top(**scene: Any) -> Any:
        loop = link([0, 0], [1, 0], 12)
        loop["geometry"] = {"type": "polyline", "points": [[0, 0], [0.5, 0.5], [1, 0], [0, 0]]}
        found = h.Solution(h.build({"loop": loop}, bc=[{"type": "clamp", "at": "loop@0"}],
                                   joints=[{"type": "pin", "between": ["loop@0", "loop@1"]}],
                                   loads=[{"type": "force", "at": "loop@0.3", "value": [0, -5]}], **scene))
        return found.r("loop@0.3")

    touching = top(contacts=[{"self": "loop"} | ({"law": law} if law else {})])
    np.testing.assert_allclose(touching, top(), rtol=0, atol=1e-9)


def test_bodies_within_the_overlap_of_their_joint_are_refused():
    with pytest.raises(CaseError, match=r"contacts\.0: all of a and b is so near to a joint of both"):
        h.build({"a": link([0, 0], [0.01, 0], 1), "b": link([0.01, 0], [0.02, 0], 1)},
                joints=[{"type": "pin", "between": ["a@1", "b@0"]}], contacts=[{"between": ["a", "b"]}])
