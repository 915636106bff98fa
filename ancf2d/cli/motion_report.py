"""What a run through time says of its steps, energies and accuracy."""

from __future__ import annotations

from typing import Any

from ..case.units import unit_label
from .text import many, number


def motion_lines(summary: dict[str, Any], labels: tuple[str, str, str]) -> list[str]:
    """Return steps, estimate of the error, energies and momentum of a dynamic run; ``labels`` are the case's units."""
    time, energy, force, moment = (unit_label(u, labels) for u in ("s", "N m", "N", "N m"))
    rows = [("time", f"{number(summary['t'])} {time}{_steps(summary, time)}" if "t" in summary else "")]
    rows.append(("error", _accuracy(summary.get("accuracy") or {})))
    found = {k: v for k, v in summary.get("energy", {}).items() if v is not None}
    rows.append(("energy", ", ".join(f"{name} {number(value)}" for name, value in found.items())
                 + (f" [{energy}]" if found else "")))
    if summary.get("energy_drift") is not None:
        rows.append(("drift", f"{summary['energy_drift']:.2g} of the largest kinetic plus strain energy"))
    momentum = summary.get("momentum")
    if momentum:
        linear = ", ".join(number(p) for p in momentum["linear"])
        rows.append(("momentum", f"linear ({linear}) [{force} {time}], about the origin "
                                 f"{number(momentum['angular'])} [{moment} {time}]"))
    return [f"{name:<9} {text}" for name, text in rows if text]


def _steps(summary: dict[str, Any], time: str) -> str:
    dt = summary.get("dt")
    if not dt:
        return ""
    sizes = f"of {number(dt[0], 4)} {time}" if dt[1] - dt[0] <= 1e-9 * dt[1] else (
        f"from {number(dt[0], 3)} to {number(dt[1], 3)} {time}")
    cut = summary.get("rejected", 0)
    return f", steps {sizes}" + (f", {many(cut, 'step')} rejected and repeated smaller" if cut else "")


def _accuracy(found: dict[str, Any]) -> str:
    """Return what is known of the error in time."""
    if found.get("estimate") is None:
        return ""
    if found.get("wanted") is not None:
        # said with the goal already, over meshes and steps
        return ""
    return f"about {found['estimate']:.2g} from the steps in time (not the mesh), relative to the largest displacements"
