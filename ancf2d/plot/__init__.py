"""Figures from result files alone."""

from ancf2d.plot.kinds import KINDS, KindInfo, build, default_animated, default_kind, draw, list_kinds, rendered
from ancf2d.plot.output import animate, data_csv, frames, save, show
from ancf2d.plot.picture import Curve, Curves, Kind, Panel, Picture, Source
from ancf2d.plot.style import Look

__all__ = [
    "KINDS",
    "Curve",
    "Curves",
    "Kind",
    "KindInfo",
    "Look",
    "Panel",
    "Picture",
    "Source",
    "animate",
    "build",
    "data_csv",
    "default_animated",
    "default_kind",
    "draw",
    "frames",
    "list_kinds",
    "rendered",
    "save",
    "show",
]
