"""Every case of cases/dynamic compared with its reference over the whole motion, and with finer runs of itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from ancf2d.elements.shape import Array
from ancf2d.study.run import load
from instruments.references import motions as motion_references
from scripts.pages import CASES, small, table

from .runs import Motion, distance, follow

MOTIONS = CASES / "dynamic"


def _as_is(motion: Motion, probe: str) -> Array:
    return motion.place(probe)


def _in_hub(motion: Motion, probe: str) -> Array:
    """Return a probe in the frame that turns with the hub of the spin-up."""
    angle = np.array([motion_references.spin(t, 6, 15)[0] for t in motion.t])
    x, y = motion.place(probe).T
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x], axis=1)


@dataclass(frozen=True)
class Exact:
    """A case with a geometrically exact reference: its motion in ``motion_references`` and probes in that order.

    ``wanted`` [m] of the largest distance; ``step`` of the reference, which stored times are multiples of;
    ``frame`` in which places are compared.
    """

    motion: str
    probes: tuple[str, ...]
    wanted: float
    overrides: tuple[str, ...] = ()
    step: dict[str, float] = field(default_factory=dict)
    frame: Callable[[Motion, str], Array] = _as_is


EXACT = {
    "pendulum1_reissner3": Exact("pendulum_1", ("tip",), 2e-5),
    "pendulum1_cable": Exact("pendulum_1_euler_bernoulli", ("tip",), 2e-5),
    "pendulum2_reissner3": Exact("pendulum_2", ("tip",), 5e-5),
    "slider_crank_reissner3": Exact("slider_crank", ("middle",), 3e-4, step={"h": 5e-4}),
    "slider_crank_rigid": Exact("slider_crank_rigid", ("middle",), 3e-4, step={"h": 5e-4}),
    "spin_up": Exact("spin_up", ("tip",), 1e-3, ("solver.t_end=10",), frame=_in_hub),
    "four_bar": Exact("four_bar", ("middle",), 1e-4, step={"h": 5e-4}),
    "double_pendulum": Exact("double_pendulum", ("elbow", "tip"), 1e-4),
    "free_rod": Exact("free_rod", ("lower", "upper"), 1e-3),
}
# case: (probe, [(time, place, how far off it may be), ...], where the values are from)
GIVEN = {
    "pendulum1_cable": ("tip", [(0.5, (0.991498, -1.502307), 2e-5), (1.0, (-1.685664, -0.631293), 2e-5),
                                (1.5, (-1.774687, -0.300800), 2e-5)], "another Euler-Bernoulli cable"),
    "pendulum2_reissner3": ("tip", [(0.25, (1.171603, -0.308758), 5e-5), (0.5, (0.354320, -1.307083), 5e-5)],
                            "another geometrically exact beam"),
    "pendulum2_continuum": ("tip", [(0.25, (1.16778, -0.31014), 5e-3), (0.5, (0.33044, -1.29864), 5e-3)],
                            "another Green-Lagrange continuum"),
    "slider_crank_reissner3": ("middle", [(0.1, (None, 0.0674), 3e-4), (0.2, (None, -0.0251), 3e-4),
                                          (0.3, (None, 0.1219), 3e-4)], "another geometrically exact beam"),
    "spin_up": ("tip", [(5.0, (None, -0.4685), 1e-3), (7.5, (None, -0.5591), 1e-3), (10.0, (None, -0.3628), 1e-3)],
                "Simo & Vu-Quoc 1986, across in the hub's frame"),
}
GREEN = (0.33044, -1.29864)


def finer(name: str) -> list[str]:
    """Return the overrides of a case with twice the elements in flexible bodies and a hundredth of the tolerance."""
    loaded = load(MOTIONS / f"{name}.yaml").case
    out = [f"bodies.{b}.element.count={2 * body.element.count}" for b, body in loaded.bodies.items()
           if body.element.type != "rigid"]
    return [*out, f"solver.tolerance={loaded.solver.tolerance / 100:g}", "solver.estimate=false"]


def moved(name: str, *overrides: str) -> Motion:
    """Return the motion of a case. Raises ComputationError where it fails."""
    motion = follow(load(MOTIONS / f"{name}.yaml", overrides))
    if motion.outcome.failure is not None:
        raise motion.outcome.failure
    return motion


def exact() -> str:
    """Return the table of cases with a reference over the whole motion."""
    rows = []
    for name, e in EXACT.items():
        motion, fine = moved(name, *e.overrides), moved(name, *e.overrides, *finer(name))
        times = motion.t[1:].tolist()
        reference = motion_references.MOTIONS[e.motion](times, **e.step)
        off = max(distance(e.frame(motion, p)[1:], reference[:, 2 * k:2 * k + 2]) for k, p in enumerate(e.probes))
        own = max(distance(e.frame(motion, p), e.frame(fine, p)) for p in e.probes)
        model = max(distance(e.frame(fine, p)[1:], reference[:, 2 * k:2 * k + 2]) for k, p in enumerate(e.probes))
        estimate = motion.summary["accuracy"]["estimate"] * max(motion.extent(p) for p in e.probes)
        rows.append([f"[{name}](../cases/dynamic/{name}.yaml)", ", ".join(e.probes), f"{motion.t[-1]:g} s",
                     f"{max(motion.extent(p) for p in e.probes):.3g} m", small(off), small(e.wanted), small(own),
                     small(estimate), small(model), str(motion.summary["steps"]), met(off <= e.wanted)])
    return table(["case", "probe", "t_end", "displacement", "distance from the reference [m]", "allowed [m]",
                  "from the finer run [m]", "estimate [m]", "finer run from the reference [m]", "steps", ""], rows)


def met(good: bool) -> str:
    """Return how closely an expected value was met."""
    return "ok" if good else "MISSED"


def given() -> str:
    """Return the table of values given by others."""
    rows = []
    for name, (probe, values, source) in GIVEN.items():
        e = EXACT.get(name, Exact("", (probe,), 0.0))
        motion = moved(name, *e.overrides)
        places = e.frame(motion, probe)
        for t, known, wanted in values:
            found = places[int(np.argmin(np.abs(motion.t - t)))]
            off = max(abs(a - b) for a, b in zip(found, known, strict=True) if b is not None)
            rows.append([name, f"{probe}, t = {t:g} s", _pair(known), _pair(
                a if b is not None else None for a, b in zip(found, known, strict=True)), small(off),
                small(wanted), met(off <= wanted), source])
    return table(["case", "quantity", "published", "computed", "difference [m]", "allowed [m]", "", "source"], rows)


def apart() -> str:
    """Return the table of the divergence of two runs of the slider-crank over time."""
    name, times = "slider_crank_reissner3", (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    one, two = (moved(name, "solver.t_end=1", *more) for more in ((), finer(name)))
    gap = np.hypot(*(one.place("middle") - two.place("middle")).T)
    return table(["up to t =", *(f"{t:g} s" for t in times)],
                 [["distance [m]", *(small(float(gap[one.t <= t * (1 + 1e-9)].max())) for t in times)]])


def _pair(values: Iterable[float | None]) -> str:
    shown = [f"{v:.7g}" for v in values if v is not None]
    return f"({', '.join(shown)})" if len(shown) > 1 else shown[0]


def paper() -> str:
    """Return the table of the paper's elements at the end of each motion, with both limits."""
    rows = []
    names = [f.stem.rsplit("_", 1) for f in MOTIONS.glob("*_2d?n_*.yaml")]
    for kind, count in sorted(names, key=lambda n: (n[0], int(n[1]))):
        name = f"{kind}_{count}"
        loaded = load(MOTIONS / f"{name}.yaml").case
        beam = load(MOTIONS / f"{name.split('_2d')[0]}_reissner3.yaml").case
        motion = moved(name)
        end = motion.place(loaded.goal.probe)[-1]
        exact = [next(c.value for c in beam.expected if (c.probe, c.quantity) == (loaded.goal.probe, q)) for q in "xy"]
        green = small(math.dist(end, GREEN)) if name.startswith("pendulum2") else ""
        rows.append([name, f"({end[0]:.5f}, {end[1]:.5f})", small(math.dist(end, exact)), green,
                     met(all(c["met"] for c in motion.summary["checks"]))])
    return table(["case", "final position [m]", "distance from the beam [m]", "distance from the continuum [m]",
                  ""], rows)
