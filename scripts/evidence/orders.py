"""The order in time that every integrator of the tool's own shows, on the scenes of the tests."""

from __future__ import annotations

import sys

import numpy as np

from .runs import ROOT, small, table

sys.path += [str(ROOT / "tests"), str(ROOT / "tests" / "solve")]
import test_motion_orders as scenes
from motions import ride


def observed(scene: str, method: str, reference: np.ndarray) -> tuple[float, float, tuple[int, int], float]:
    """Return the orders of places and of rates, the numbers of steps and the smaller error of places [m]."""
    data, t_end = scenes.SCENES[scene]
    order = scenes.ORDER[method]
    steps = (6, 12) if order == 9 and scene in scenes.SMOOTHEST else scenes.STEPS[order]
    errors = [np.abs(ride(data, t_end, method=method, dt=t_end / n, **scenes.TIGHT).end() - reference).max(axis=1)
              for n in steps]
    seen = np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0])
    return float(seen[0]), float(seen[1]), steps, float(errors[1][0])


def report() -> str:
    """Return the table of orders."""
    rows = []
    for scene, (data, t_end) in scenes.SCENES.items():
        reference = ride(data, t_end, method="radau9", dt=t_end / 96, **scenes.TIGHT).end()
        for method, order in scenes.ORDER.items():
            if (scene, method) not in scenes.PAIRS:
                continue
            places, rates, steps, error = observed(scene, method, reference)
            rows.append([scene, method, str(order), f"{places:.2f}", f"{rates:.2f}", f"{steps[0]}, {steps[1]}",
                         small(error)])
    return table(["scene", "method", "order", "seen in places", "in rates", "steps", "error of places [m]"], rows)
