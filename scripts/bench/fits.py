"""How many runs a fit of five numbers of a motion takes, and how often the numbers lie within two standard errors.

The data are the case's own deflections of three probes with noise, a hundred times; first guesses are 20 to 60 % off.

    python -m scripts.bench.fits           prints the table
    python -m scripts.bench.fits --page    writes it into docs/fits.md
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np

import ancf2d
from ancf2d.study.fit import Fit, fit
from ancf2d.study.fit_data import data_of
from scripts.pages import DOCS, one_thread, stamp, table, write

PAGE, FITS, PROBES = DOCS / "fits.md", 100, ("tip", "mid", "third")
ARM = """\
title: Arm that falls on a hub
bodies:
  arm:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.01, width: 0.03}
    material: {E: 7.0e+10, nu: 0.3, rho: 2700, damping: {kelvin_voigt: 3.0e-4}}
    element: {type: cable, count: 4}
boundary_conditions:
  - {name: hub, type: pin, at: arm@0}
springs:
  - {name: hub, type: rotational, between: [[0, 0], arm@0], stiffness: 300, damping: 0.5}
  - {name: stay, type: translational, between: [arm@0.6, [0.6, 0.4]], stiffness: 800, damping: 2, length: 0.4}
masses:
  - {name: tip, at: arm@1, mass: 0.3}
loads:
  - {name: weight, type: force, at: arm@1, value: [0, -15]}
solver: {type: dynamic, t_end: 0.6, dt: 4.0e-3, method: generalized_alpha}
output:
  interval: 0.012
  probes: {tip: arm@1, mid: arm@0.5, third: arm@0.3}
"""
E, DAMPING, MASS = "bodies.arm.material.E", "bodies.arm.material.damping.kelvin_voigt", "masses.tip.mass"
# of a number: its true value, first guess, and bounds
Numbers = dict[str, tuple[float, float, str]]
FIVE: Numbers = {DAMPING: (3e-4, 5e-4, "1e-5:3e-3"), "springs.hub.stiffness": (300.0, 380.0, "100:900"),
                 "springs.hub.damping": (0.5, 0.8, "0.05:5"), "loads.weight.value.1": (-15.0, -12.0, "-30:-5"),
                 MASS: (0.3, 0.36, "0.1:1")}


class Scene(NamedTuple):
    """A case, five numbers of it, and the noise [m] or, in shares of the deflections, its least and its most."""

    case: str
    numbers: Numbers
    noise: tuple[float, ...]


LONG = ARM.replace("t_end: 0.6", "t_end: 1.2").replace("interval: 0.012", "interval: 0.024")
SCENES = {
    "arm on a hub, 2.5 periods": Scene(ARM.replace(", damping: 2", ""), FIVE, (2e-4,)),
    "arm on a hub, 5 periods": Scene(LONG.replace(", damping: 2", ""), {
        E: (7e10, 8.5e10, "3e10:2e11"), DAMPING: (3e-4, 5e-4, "1e-5:3e-3"),
        "springs.hub.stiffness": (300.0, 380.0, "100:900"), "springs.hub.damping": (0.5, 0.8, "0.05:5"),
        MASS: (0.3, 0.24, "0.1:1")}, (2e-3, 1e-2)),
    "cantilever with a stay, 5 periods": Scene(
        LONG.replace("type: pin", "type: clamp").replace("t_end: 1.2", "t_end: 0.8").replace("0.024", "0.016"), {
            E: (7e10, 9e10, "3e10:2e11"), DAMPING: (3e-4, 5e-4, "1e-5:5e-3"),
            "springs.stay.stiffness": (800.0, 500.0, "100:3000"), "springs.stay.damping": (2.0, 3.2, "0.1:20"),
            MASS: (0.3, 0.24, "0.1:1")}, (2e-3, 1e-2))}


def fitted(scene: Scene, run: Any, seed: int) -> tuple[Fit, dict[str, Any]]:
    """Return a fit to what a run of the case found, with noise, and the noise itself of each column."""
    random, t = np.random.default_rng(seed), run.results.probe_t
    data, added = {"t": t}, {}
    share = np.exp(random.uniform(*np.log(scene.noise))) if len(scene.noise) > 1 else None
    for name in PROBES:
        exact = run.results.probes[name]["uy"]
        noise = (scene.noise[0] if share is None else share * np.ptp(exact)) * random.standard_normal(len(t))
        data[f"{name}.uy"], added[f"{name}.uy"] = exact + noise, noise
    guess = ancf2d.load(scene.case, {path: first for path, (_, first, _) in scene.numbers.items()})
    vary = [f"{path}={ends}" for path, (_, _, ends) in scene.numbers.items()]
    return fit(guess, data_of(data), vary), added


def main() -> None:
    """Print the table, or write it."""
    one_thread()
    rows = []
    for name, scene in SCENES.items():
        run, runs, near = ancf2d.solve(scene.case), [], []
        for seed in range(FITS):
            found, _ = fitted(scene, run, seed)
            runs.append(found.runs)
            near.append([row.standard_error is not None
                         and abs(row.value - scene.numbers[row.path][0]) < 2.0 * row.standard_error
                         for row in found.rows])
        rows.append([name, f"{np.median(runs):.0f}", str(max(runs)), str(sum(n <= 15 for n in runs)),
                     ", ".join(map(str, np.sum(near, axis=0)))])
        print(*rows[-1], flush=True)
    found_table = table(["case", "runs, median", "most", "fits of 100 in at most 15 runs",
                         "fits within 2 standard errors, number by number"], rows)
    if "--page" in sys.argv:
        write(PAGE, "fits", f"{found_table}\n\n{stamp('scripts.bench.fits --page')}")


if __name__ == "__main__":
    main()
