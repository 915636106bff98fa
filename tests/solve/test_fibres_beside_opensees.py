"""Sections of fibres beside those of OpenSees (``pip install .[peers]``): the same fibres, hardening and load steps.

OpenSees has elements by forces with five Gauss-Lobatto sections, with elastic shear, in a corotational frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d

E, NU, YIELD, KINEMATIC, SHEAR = 2e11, 0.3, 2.5e8, 2e10, 5 / 6
HEIGHT, WIDTH, FIBRES = 0.1, 0.05, 16
MOMENT = YIELD * WIDTH * HEIGHT**2 / 6
CYCLE: dict[str, Any] = {"type": "table", "t": [0, 0.25, 0.75, 1], "value": [0, 1, -1, 0.5]}
STEPS = 40
EVERY = range(1, STEPS + 1)


@pytest.fixture
def ops() -> Any:
    """Return OpenSees with a plane model, the section of fibres (1) with shear (2), and sections along (1)."""
    try:
        import openseespy.opensees as found
    except (ImportError, RuntimeError) as error:
        pytest.skip(f"OpenSees cannot be imported ({error}): pip install .[peers]")
    found.wipe()
    found.model("basic", "-ndm", 2, "-ndf", 3)
    found.uniaxialMaterial("Hardening", 1, E, YIELD, 0.0, KINEMATIC)
    found.uniaxialMaterial("Elastic", 2, SHEAR * E / (2 * (1 + NU)) * HEIGHT * WIDTH)
    found.section("Fiber", 1)
    for x, w in zip(*np.polynomial.legendre.leggauss(FIBRES), strict=True):
        found.fiber(0.5 * HEIGHT * x, 0.0, 0.5 * HEIGHT * WIDTH * w, 1)
    found.section("Aggregator", 2, 2, "Vy", "-section", 1)
    found.geomTransf("Corotational", 1)
    found.beamIntegration("Lobatto", 1, 2, 5)
    return found


def cycled(ops: Any, node: int, force: tuple[float, ...], component: int) -> np.ndarray:
    """Return a displacement (STEPS,) of a node under a force that goes through the cycle."""
    # its last step may end beyond 1 by round-off, where a path has ended
    ops.timeSeries("Path", 1, "-time", *CYCLE["t"], 2.0, "-values", *CYCLE["value"], CYCLE["value"][-1])
    ops.pattern("Plain", 1, 1)
    ops.load(node, *force)
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandGen")
    ops.test("NormUnbalance", 1e-7 * max(map(abs, force)), 60)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0 / STEPS)
    ops.analysis("Static")
    found = []
    for _ in range(STEPS):
        assert ops.analyze(1) == 0
        found.append(ops.nodeDisp(node, component))
    ops.wipe()
    return np.array(found)


def ours(bodies: dict[str, Any], at: str, quantity: str, force: list[float], steps: Sequence[int], **scene: Any,
         ) -> np.ndarray:
    """Return the same displacement here, at the end of some steps of OpenSees."""
    done = ancf2d.solve(h.load(bodies, {"type": "static", "steps": STEPS}, output={"probes": {"point": at}}, loads=[
        {"type": "force", "at": at, "value": force, "amplitude": CYCLE}], **scene))
    wanted = np.array(steps) / STEPS
    found = [int(np.argmin(np.abs(done.course_t - t))) for t in wanted]
    np.testing.assert_allclose(done.course_t[found], wanted, rtol=1e-12)
    return np.asarray(done.course["point"][quantity][found])


def rod(start: list[float], end: list[float], count: int, kind: str = "reissner3") -> dict[str, Any]:
    element = {**h.element(kind, count), **({"shear_factor": SHEAR} if kind == "reissner3" else {})}
    return {"geometry": {"type": "line", "start": start, "end": end}, "element": element,
            "section": {"height": HEIGHT, "width": WIDTH},
            "material": {"E": E, "nu": NU, "yield": YIELD, "hardening": {"kinematic": KINEMATIC}}}


def close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


def test_a_cyclic_cantilever(ops: Any) -> None:
    n, force = 32, 1.4 * MOMENT
    for i in range(n + 1):
        ops.node(i + 1, i / n, 0.0)
    ops.fix(1, 1, 1, 1)
    for i in range(n):
        ops.element("forceBeamColumn", i + 1, i + 1, i + 2, 1, 1, "-iter", 50, 1e-12)
    close(ours({"beam": rod([0, 0], [1, 0], 96)}, "beam@1", "uy", [0, force], EVERY,
               bc=[{"type": "clamp", "at": "beam@0"}]),
          cycled(ops, n + 1, (0.0, force, 0.0), 2))


def test_a_cyclic_portal(ops: Any) -> None:
    n, tall, wide = 32, 1.5, 2.0
    corners = [(0.0, 0.0), (0.0, tall), (wide, tall), (wide, 0.0)]
    places = [corners[0]]
    for a, b in pairwise(np.array(corners)):
        places += [tuple(a + (b - a) * (k + 1) / n) for k in range(n)]
    for i, (x, y) in enumerate(places):
        ops.node(i + 1, float(x), float(y))
    for node in (1, 3 * n + 1):
        ops.fix(node, 1, 1, 1)
    for i in range(3 * n):
        ops.element("forceBeamColumn", i + 1, i + 1, i + 2, 1, 1, "-iter", 50, 1e-12)
    force = 5.0 * MOMENT / tall
    bodies = {name: rod(list(a), list(b), 64) for name, a, b in zip(
        ("left", "top", "right"), corners[:-1], corners[1:], strict=True)}
    close(ours(bodies, "left@1", "ux", [force, 0], EVERY,
               bc=[{"type": "clamp", "at": "left@0"}, {"type": "clamp", "at": "right@1"}],
               joints=[{"type": "weld", "between": ["left@1", "top@0"]},
                       {"type": "weld", "between": ["top@1", "right@0"]}]),
          cycled(ops, n + 1, (force, 0.0, 0.0), 1))


def test_three_cyclic_bars(ops: Any) -> None:
    """A bar between two at 45 degrees hangs from three hinges."""
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 2)
    ops.uniaxialMaterial("Hardening", 1, E, YIELD, 0.0, KINEMATIC)
    tops = [(-1.0, 1.0), (0.0, 1.0), (1.0, 1.0)]
    for i, (x, y) in enumerate(tops):
        ops.node(i + 2, x, y)
        ops.fix(i + 2, 1, 1)
    ops.node(1, 0.0, 0.0)
    for i in range(3):
        ops.element("corotTruss", i + 1, i + 2, 1, HEIGHT * WIDTH, 1)
    force = -2.3 * YIELD * HEIGHT * WIDTH
    bodies = {f"bar{i}": rod(list(top), [0, 0], 1, "cable") for i, top in enumerate(tops)}
    # steps may be cut here where bars begin to yield, but they end where the force turns
    turns = [10, 30, 40]
    close(ours(bodies, "bar1@1", "uy", [0, force], turns, bc=[{"type": "pin", "at": f"bar{i}@0"} for i in range(3)],
               joints=[{"type": "pin", "between": [f"bar{i}@1", "bar1@1"]} for i in (0, 2)]),
          cycled(ops, 1, (0.0, force), 2)[np.array(turns) - 1])
