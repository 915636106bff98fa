"""Commented cases to start from."""

from __future__ import annotations

from ..errors import CaseError, Problem
from .binder import listed, nearest
from .emit import text_scalar
from .reference import SCHEMA_FILE, schema_comment

TEMPLATES = ("cantilever", "simply_supported", "frame", "pendulum", "leaf_spring", "flexure", "soft_arm", "bimetal",
             "controlled_arm", "latch", "cam", "snap_fit", "belt", "plastic_frame")


def template(name: str, kind: str = "cantilever", schema: str = SCHEMA_FILE) -> str:
    """Return the text of a commented case of a kind; ``schema`` is where editors find the schema.

    Raises CaseError where there is no such kind.
    """
    if kind not in TEMPLATES:
        raise CaseError(Problem(f"there is no template '{kind}'", expected=listed(TEMPLATES),
                                near=nearest(kind, TEMPLATES)))
    from importlib import resources

    body = resources.files(__package__).joinpath("templates", f"{kind}.yaml").read_text("utf-8")
    title, rest = body.split("\n", 1)
    title = title.removeprefix("title: ").replace("{name}", name)
    return f"{schema_comment(schema)}\nformat: 1\ntitle: {text_scalar(title)}\n{rest}"
