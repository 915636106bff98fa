"""A solution in a notebook."""

from __future__ import annotations

from html import escape

import numpy as np

from ..plot.body import magnified, visible_scale

WIDTH, HEIGHT, MARGIN = 480.0, 240.0, 12.0
# bodies without any height, or width, are no reason to divide by zero [length]
SMALLEST = 1e-300
# along all bodies: further points would only make the page large
MOST_POINTS = 4000
REFERENCE, NOW = "#999999", "#1f5fa8"


def shown(report: str, before: list[np.ndarray], after: list[np.ndarray]) -> str:
    """Return a solution as HTML: the axes of its bodies (n, 2) before and after, where there are some, and its report.
    """
    picture = _picture(before, after) if before else ""
    # columns stay below each other in a window that is too narrow for them
    return f'{picture}<pre style="white-space: pre; overflow-x: auto">{escape(report)}</pre>'


def _picture(before: list[np.ndarray], after: list[np.ndarray]) -> str:
    """Return the axes of all bodies, in the reference and in the last state, as SVG; small displacements magnified."""
    extent = float(np.hypot(*np.ptp(np.concatenate(before), axis=0)))
    factor = visible_scale(extent, max(float(np.hypot(*(b - a).T).max()) for a, b in zip(before, after, strict=True)))
    after = [a + factor * (b - a) for a, b in zip(before, after, strict=True)]
    lines = [*((line, REFERENCE) for line in before), *((line, NOW) for line in after)]
    step = max(1, sum(len(points) for points, _ in lines) // MOST_POINTS)
    points = np.concatenate([line for line, _ in lines])
    if not np.isfinite(points).all():
        return ""
    low, high = points.min(0), points.max(0)
    scale = float(np.min((np.array([WIDTH, HEIGHT]) - 2 * MARGIN) / np.maximum(high - low, SMALLEST)))
    size = (high - low) * scale + 2 * MARGIN
    drawn = "".join(_line(np.append(line[:-1:step], line[-1:], 0), colour, low, scale, size[1])
                    for line, colour in lines)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
            f'role="img">{drawn}</svg>' + (f"<p>{magnified(factor).lstrip(', ')}</p>" if factor != 1.0 else ""))


def _line(points: np.ndarray, colour: str, low: np.ndarray, scale: float, height: float) -> str:
    x, y = ((points - low) * scale + MARGIN).T
    text = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, height - y, strict=True))
    dashes = ' stroke-dasharray="5 4"' if colour == REFERENCE else ""
    return f'<polyline points="{text}" fill="none" stroke="{colour}" stroke-width="2"{dashes}/>'
