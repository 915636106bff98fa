"""Result files made by hand: straight bodies of known shape, without any solver."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ancf2d.results import BodyRecord, Results, ResultWriter, open_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADER = {
    "case_text": "format: 1\ntitle: Cantilever\n", "case_completed": "format: 1\n",
    "case_name": "cantilever", "overrides": ["bodies.beam.element.count=4"],
    "title": "Cantilever with a tip load", "solver": "static",
    "units": {"length": "m", "force": "N", "time": "s"},
    "command_line": "ancf2d run cantilever.yaml",
}


def hermite(xi: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Cubic shape functions (ns, 4) of r and r_x at two nodes, and their x-derivatives."""
    x = xi[:, None]
    s = np.hstack([1 - 3 * x**2 + 2 * x**3, length * (x - 2 * x**2 + x**3),
                   3 * x**2 - 2 * x**3, length * (x**3 - x**2)])
    ds = np.hstack([(6 * x**2 - 6 * x) / length, 1 - 4 * x + 3 * x**2,
                    (6 * x - 6 * x**2) / length, 3 * x**2 - 2 * x])
    return s, ds


def tangent_body(name: str, ne: int, length: float, height: float, first: int = 0) -> BodyRecord:
    """A cable of Hermite elements: coordinates r, r_x at each node, from column ``first`` on."""
    h, xi = length / ne, np.linspace(0, 1, 9)
    s, ds = hermite(xi, h)
    dofs = first + 4 * np.arange(ne)[:, None] + np.arange(8)
    return BodyRecord(name, "cable", "centreline", height, 0.1, "tangent", dofs,
                      np.arange(ne)[:, None] + np.arange(2), np.array([0, 2]),
                      np.zeros(ne, int), np.array([h]), xi, np.stack([s] * 3)[None], ds[None],
                      np.linspace(0, 1, ne + 1), ("x1", "y1", "rx1_x", "rx1_y",
                                                  "x2", "y2", "rx2_x", "rx2_y"))


def linear_samples(height: float, h: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of the element with basis 1, x, y, xy and coordinates r, r_y at two nodes."""
    xi = np.linspace(0, 1, 5)
    n1, n2 = 1 - xi, xi
    s = np.stack([np.stack([n1, y * n1, n2, y * n2], 1) for y in (-height / 2, 0, height / 2)])
    ds = np.stack([-1 / h + 0 * xi, 0 * xi, 1 / h + 0 * xi, 0 * xi], 1)
    return xi, s[None], ds[None]


def interpolated_body(name: str, ne: int, length: float, height: float,
                      first: int = 0) -> BodyRecord:
    """A beam of bilinear elements: coordinates r, r_y at each node."""
    xi, s, ds = linear_samples(height, length / ne)
    dofs = first + 4 * np.arange(ne)[:, None] + np.arange(8)
    return BodyRecord(name, "2d2n", "continuum", height, 0.1, "interpolated", dofs,
                      np.arange(ne)[:, None] + np.arange(2), np.array([0, 2]),
                      np.zeros(ne, int), np.array([length / ne]), xi, s, ds,
                      np.linspace(0, 1, ne + 1))


def theta_body(name: str, ne: int, length: float, height: float, first: int = 0) -> BodyRecord:
    """A geometrically exact beam: coordinates x, y, theta at each node, linear."""
    h, xi = length / ne, np.linspace(0, 1, 5)
    s = np.stack([1 - xi, xi], 1)
    ds = np.stack([-1 / h + 0 * xi, 1 / h + 0 * xi], 1)
    dofs = first + 3 * np.arange(ne)[:, None] + np.arange(6)
    return BodyRecord(name, "reissner2", "exact", height, 0.1, "theta", dofs,
                      np.arange(ne)[:, None] + np.arange(2), np.array([0, 1]),
                      np.zeros(ne, int), np.array([h]), xi, np.stack([s] * 3)[None], ds[None],
                      np.linspace(0, 1, ne + 1))


BODIES = {"tangent": tangent_body, "interpolated": interpolated_body, "theta": theta_body}


def coordinates(kind: str, x: np.ndarray, curvature: float) -> np.ndarray:
    """Nodal coordinates of a body of ``kind`` bent into a circle that starts at the origin."""
    angle = curvature * x
    if curvature:
        px, py = np.sin(angle) / curvature, 2 * np.sin(angle / 2) ** 2 / curvature
    else:
        px, py = x, 0 * x
    cos, sin = np.cos(angle), np.sin(angle)
    columns = {"tangent": (px, py, cos, sin), "interpolated": (px, py, -sin, cos),
               "theta": (px, py, angle)}[kind]
    return np.stack(columns, 1).ravel()


def bent_beam(path: Path, kind: str = "tangent", *, ne: int = 4, length: float = 2.0,
              height: float = 0.1, angle: float = 1.0, steps: int = 5,
              header: dict[str, object] | None = None, finish: bool = True, force: bool = False) -> Path:
    """Write a cantilever bent by ``angle`` in ``steps`` steps into a circle; return its path."""
    x = np.linspace(0, length, ne + 1)
    e0 = coordinates(kind, x, 0.0)
    body = BODIES[kind]("beam", ne, length, height)
    with ResultWriter(path, {**HEADER, **(header or {})}, [body], e0, force=force) as w:
        for step in range(steps + 1):
            factor = step / steps
            k = factor * angle / length
            tip = coordinates("theta", np.array([length]), k)
            probes = {"tip": {"x": tip[0], "y": tip[1], "ux": tip[0] - length, "uy": tip[1],
                              "theta": tip[2]}}
            w.append(factor, coordinates(kind, x, k) - e0,
                     {"step": step, "factor": factor, "iterations": 3, "residual": 1e-12,
                      "energy": 50 * k**2}, probes)
        if not finish:
            w.flush()
            return w.finish({"reason": "stopped"}, "interrupted")
        summary = {"case": "cantilever", "status": "converged", "solver": "static", "elements": ne,
                   "dofs": len(e0), "probes": probes, "iterations": 3 * steps, "steps": steps,
                   "energy": {"strain": 50 * k**2, "kinetic": 0.0, "potential": 0.0},
                   "reactions": {"left": {"fx": 0.0, "fy": 1e-14, "m": -100.0}}, "wall_s": 0.01}
        return w.finish(summary)


def table_file(path: Path, orders: dict[str, float], counts: tuple[int, ...] = (2, 4, 8, 16),
               ) -> Path:
    """Write a convergence table with errors counts**-order for each element type."""
    rows: dict[str, list[object]] = {k: [] for k in ("element", "formulation", "elements", "dofs",
                                                     "value", "error", "order", "wall_s")}
    for element, order in orders.items():
        for i, n in enumerate(counts):
            error = 0.5 * float(n) ** -order
            values = (element, "default", n, 6 * n, 1 + error, error, order if i else None, 1e-3)
            for key, value in zip(rows, values, strict=True):
                rows[key].append(value)
    body = tangent_body("beam", 1, 1.0, 0.1)
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(path, {**HEADER, "title": "Convergence of the tip"}, [body], e0) as w:
        w.table("convergence", rows, {"goal": "tip uy"})
        return w.finish({"status": "converged"})


def mechanism(path: Path, steps: int = 40) -> Path:
    """Write a dynamic run: a crank turning about the origin and a rod hanging on its end."""
    bodies = [theta_body("crank", 2, 0.5, 0.08), tangent_body("rod", 4, 2.0, 0.01, first=9)]
    x1, x2 = np.linspace(0, 0.5, 3), np.linspace(0, 2, 5)
    base = coordinates("tangent", x2, 0.0).reshape(-1, 4)
    base[:, 0] += 0.5
    e0 = np.concatenate([coordinates("theta", x1, 0.0), base.ravel()])
    header = {**HEADER, "title": "Crank and rod", "solver": "dynamic"}
    with ResultWriter(path, header, bodies, e0) as w:
        for t in np.linspace(0, 1, steps + 1):
            angle = 2.2 * t
            crank = np.stack([x1 * np.cos(angle), x1 * np.sin(angle), angle + 0 * x1], 1)
            rod = coordinates("tangent", x2, 0.8 * t).reshape(-1, 4)
            rod[:, :2] += crank[-1, :2]
            e = np.concatenate([crank.ravel(), rod.ravel()])
            probes = {"end": {"ux": rod[-1, 0] - 2.5, "uy": rod[-1, 1], "theta": 1.6 * t},
                      "pin": {"ux": crank[-1, 0] - 0.5, "uy": crank[-1, 1], "theta": angle}}
            w.append(t, e - e0, {"t": t, "strain": 0.0}, probes)
        return w.finish({"status": "converged"})


def opened(path: Path) -> Results:
    return open_results(path)


def legend_texts(figure: Figure) -> list[str]:
    return [t.get_text() for t in figure.legends[0].get_texts()]
