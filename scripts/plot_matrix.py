"""Draw kinds of figure with few and many bodies, short and long titles, small and large numbers, side by side."""

from __future__ import annotations

import argparse
import io
import json
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

from PIL import Image

from ancf2d.case import load_case_text
from ancf2d.plot import draw
from ancf2d.results import open_results
from ancf2d.study.run import run_case, vocabulary

LONG = ("two girders of ten kilometres each, welded to each other in the middle, pressed down by one force that is as "
        "large as it has to be to be seen")
# number of bodies, length of each, title
ROWS = ((1, 1e-5, "One body"), (2, 1e4, LONG), (8, 1.0, "Eight bodies"), (40, 0.3, "Forty bodies"),
        (100, 0.1, "A hundred bodies"))
COLUMNS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("shape", {}), ("section_forces", {}), ("fields", {}), ("snapshots", {"count": 6}), ("trajectory", {}),
    ("load_deflection", {}))
CELL = 320, 240  # pixels


def girder(bodies: int, length: float, title: str) -> dict[str, Any]:
    """Return the case of a row of welded beams, clamped at one end; several stand on a roller at the other."""
    E, height = 2e11, 0.12 * length
    names = [f"part {k + 1}" for k in range(bodies)]
    section = {"height": height, "width": height}
    supports: list[dict[str, Any]] = [{"type": "clamp", "at": f"{names[0]}@0"}]
    if bodies > 1:
        supports.append({"type": "roller", "fixed": "y", "at": f"{names[-1]}@1"})
    middle = f"{names[bodies // 2]}@0.5"
    # a twentieth of the span, by the formula of a cantilever of that length
    force = 0.05 * 3 * E * height**4 / 12 / (bodies * length) ** 2 * (1 if bodies == 1 else 20)
    return {
        "title": title,
        "bodies": {name: {"geometry": {"type": "line", "start": [length * k, 0], "end": [length * (k + 1), 0]},
                          "section": section, "material": {"E": E, "nu": 0.3, "rho": 7850},
                          "element": {"type": "reissner3", "count": 2}} for k, name in enumerate(names)},
        "boundary_conditions": supports,
        "joints": [{"type": "weld", "between": [f"{a}@1", f"{b}@0"]}
                   for a, b in pairwise(names)],
        "loads": [{"type": "force", "at": middle, "value": [0, -force]}, {"type": "gravity", "value": [0, -9.81]}],
        "solver": {"type": "static", "steps": 5},
        "output": {"probes": {"middle": middle}, "fields": ["N", "Q", "M", "stress"]}}


def matrix(target: Path) -> None:
    """Write all figures of all cases as one picture."""
    width, height = CELL
    sheet = Image.new("RGB", (width * len(COLUMNS), height * len(ROWS)), "white")
    with tempfile.TemporaryDirectory() as folder:
        for row, scene in enumerate(ROWS):
            file = Path(folder) / f"{row}.h5"
            run_case(load_case_text(json.dumps(girder(*scene)), vocabulary=vocabulary()), str(file))
            with open_results(file) as results:
                for column, (kind, options) in enumerate(COLUMNS):
                    stream = io.BytesIO()
                    draw(results, kind, **options).savefig(stream, dpi=100)
                    with Image.open(stream) as image:
                        small = image.convert("RGB")
                        small.thumbnail((width - 10, height - 10), Image.Resampling.LANCZOS)
                        sheet.paste(small, (column * width, row * height))
    sheet.quantize(128, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    matrix(parser.parse_args().file)
