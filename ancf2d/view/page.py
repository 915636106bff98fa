"""One self-contained page: markup, style, script and data in a single text."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from ancf2d.results import Results
from ancf2d.results.own import MARK
from ancf2d.view.scene import BUDGET, LARGEST_CODE, scene

SCRIPTS = "scene.js", "layers.js", "controls.js"


@dataclass(frozen=True)
class Page:
    """A page, and in words what it holds less than the file."""

    html: str
    remark: str


def _part(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def make_page(results: Results, budget: int = BUDGET, fields: Sequence[str] = ()) -> Page:
    """Return the page of a result file; ``budget`` bounds the bytes of its states. Raises ResultsError.

    ``fields`` names those that are shown, without any all that the results have.
    """
    data = scene(results, budget, fields)
    # a title with a tag in it is no tag
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    script = "".join(map(_part, SCRIPTS))
    parts = {"TITLE": _escaped(data["title"]), "MARK": MARK, "STYLE": _part("page.css"), "SCRIPT": script, "DATA": text}
    # all at once: what is put in may look like a place itself
    html = re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _part("page.html"))
    shown, what = len(data["t"]), "modes" if data["kind"] == "modes" else "states"
    some = f"{shown} of {data['stored']} {what}" if shown < data["stored"] else f"all {shown} {what}"
    return Page(html, f"{some}, displacements to 1/{LARGEST_CODE} of the largest")
