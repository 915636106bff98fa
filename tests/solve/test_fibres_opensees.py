"""Sections of fibres compared with OpenSees (``pip install .[peers]``): the same fibres, hardening and load steps.

OpenSees has elements by forces with five Gauss-Lobatto sections, with elastic shear, in a corotational frame.
"""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from scripts.bench import fibres, peers
from scripts.bench.scenes import CYCLE, DEEP, STEEL, WIDE


@pytest.fixture(autouse=True)
def installed() -> None:
    try:
        import openseespy.opensees  # noqa: F401
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"OpenSees cannot be imported ({error}): pip install .[peers]")


def close(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize(("scene", "own", "count"), [("cantilever", 96, 32), ("portal", 64, 32)])
def test_a_cyclic_frame(scene: str, own: int, count: int) -> None:
    close(fibres.push(scene, own)["u"], peers.yielding_opensees(scene, count)["u"])


def test_three_cyclic_bars() -> None:
    """A bar between two at 45 degrees hangs from three hinges."""
    import openseespy.opensees as ops

    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 2)
    ops.uniaxialMaterial("Hardening", 1, STEEL["E"], STEEL["yield"], 0.0, STEEL["kinematic"])
    tops = [(-1.0, 1.0), (0.0, 1.0), (1.0, 1.0)]
    for i, (x, y) in enumerate(tops):
        ops.node(i + 2, x, y)
        ops.fix(i + 2, 1, 1)
    ops.node(1, 0.0, 0.0)
    for i in range(3):
        ops.element("corotTruss", i + 1, i + 2, 1, DEEP * WIDE, 1)
    steps, force = 40, -2.3 * STEEL["yield"] * DEEP * WIDE
    bar = fibres.case("cantilever", 1)["bodies"]["m0"]
    bodies = {f"bar{i}": {**bar, "geometry": {"type": "line", "start": list(top), "end": [0, 0]},
                          "element": h.element("cable", 1)} for i, top in enumerate(tops)}
    done = ancf2d.solve(h.load(
        bodies, {"type": "static", "steps": steps}, output={"probes": {"point": "bar1@1"}}, loads=[
            {"type": "force", "at": "bar1@1", "value": [0, force],
             "amplitude": {"type": "table", "t": list(CYCLE[0]), "value": list(CYCLE[1])}}],
        bc=[{"type": "pin", "at": f"bar{i}@0"} for i in range(3)],
        joints=[{"type": "pin", "between": [f"bar{i}@1", "bar1@1"]} for i in (0, 2)]))
    # steps may be cut here where bars begin to yield, but they end where the force turns
    turns = np.array([10, 30, 40])
    found = [int(np.argmin(np.abs(done.course_t - t))) for t in turns / steps]
    np.testing.assert_allclose(done.course_t[found], turns / steps, rtol=1e-12)
    u, _ = peers.cycled_opensees(ops, 1, (0.0, force), steps)
    close(done.course["point"]["uy"][found], u[turns - 1, 1])
