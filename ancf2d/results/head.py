"""The part of a result file that never changes: where it comes from, the case, the mesh."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import h5py
import numpy as np

from ancf2d import __version__
from ancf2d.results.records import FORMAT, FORMAT_VERSION, BodyRecord, FieldRecord, Units, escape
from ancf2d.results.series import set_text, write_fixed, write_texts

PACKAGES = ("numpy", "scipy", "numba", "h5py")


def versions() -> dict[str, str]:
    """Return the versions that a result depends on, read without importing the packages."""
    found = {"ancf2d": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def provenance(case_text: str) -> dict[str, str]:
    """Return the root attributes that say when, where and with what a result was made."""
    found = {f"version_{name}": version for name, version in versions().items()}
    found["platform"] = platform.platform()
    found["created"] = datetime.now(UTC).isoformat(timespec="seconds")
    found["case_sha256"] = hashlib.sha256(case_text.encode("utf-8", "replace")).hexdigest()
    return found


def coordinate_units(units: Units) -> str:
    """Return the units of nodal coordinates, whose kinds follow from their names."""
    length = units.length
    return f"{length}; slopes 1; angles rad; d^k r/dy^k {length}^(1-k)"


def write_head(file: h5py.File, header: Mapping[str, Any], units: Units) -> None:
    """Write the root attributes and the case."""
    case_text = header.get("case_text") or ""
    attributes = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "status": "running",
        **{k: header.get(k) or "" for k in ("title", "solver", "case_name", "case_files", "command_line")},
        **{f"units_{k}": getattr(units, k) for k in ("length", "force", "time")},
        **provenance(case_text),
    }
    for name, value in attributes.items():
        if isinstance(value, str):
            set_text(file, name, value)
        else:
            file.attrs[name] = value
    # rows of states, history and probes that are known to be on disk
    file.attrs["committed"] = np.zeros(3, np.int64)
    case = file.create_group("case")
    completed = header.get("case_completed") or ""
    write_texts(case, "text", case_text, "none", "the case as given")
    write_texts(case, "completed", completed, "none",
                "the case as completed with defaults and overrides")
    overrides = [str(o) for o in header.get("overrides") or []]
    write_texts(case, "overrides", overrides, "none", "PATH=VALUE given on the command line")


def write_mesh(file: h5py.File, units: Units, bodies: Sequence[BodyRecord], e0: np.ndarray,
               names: Mapping[str, Sequence[str]]) -> None:
    """Write reference coordinates ``e0`` (nq,) and the bodies, after checking that they fit."""
    mesh = file.create_group("mesh")
    write_fixed(mesh, "e0", e0, coordinate_units(units), "nodal coordinates in the reference",
                compress=True)
    group = mesh.create_group("bodies", track_order=True)
    for body in bodies:
        body.check(len(e0))
        _write_body(group.create_group(escape(body.name)), body, units.length,
                    names.get(body.name, body.coordinate_names))


def write_fields(file: h5py.File, units: Units, fields: Sequence[FieldRecord]) -> None:
    """Write what is known of the fields before there is a state: /fields/BODY/NAME."""
    for field in fields:
        bodies = file.require_group("fields")
        group = bodies.require_group(escape(field.body)).create_group(field.name)
        set_text(group, "units", units.fill(field.units))
        set_text(group, "description", field.description)
        write_texts(group, "components", field.components, "none", "components, in the order of the last index")
        write_fixed(group, "xi", field.xi, "1", "stations along an element, 0 to 1" + (
            ", of each element" if field.xi.ndim > 1 else ""))
        write_fixed(group, "eta", field.eta, "1", "stations across it, y/(h/2)")


def _write_body(group: h5py.Group, body: BodyRecord, length: str, names: Sequence[str]) -> None:
    for name in ("name", "element_type", "formulation", "section_kind"):
        set_text(group, name, str(getattr(body, name)))
    for name in ("height", "width"):
        value = getattr(body, name)
        group.attrs[name] = np.nan if value is None else float(value)
        set_text(group, f"{name}_units", length)
    for name, units, text, kind in (
        ("dofs", "1", "columns of e0 and d for the coordinates of each element", int),
        ("nodes", "1", "global node numbers of each element", int),
        ("node_shape", "1", "shape function that is r at each node", int),
        ("classes", "1", "row of sample_S, sample_S_x and lengths of each element", int),
        ("lengths", length, "length of the elements of a class", float),
        ("sample_xi", "1", "sample points along an element, 0 to 1", float),
        ("sample_S", "1", "shape functions at bottom, axis, top and the lines between layers", float),
        ("sample_S_x", f"1/{length}", "dS/dx on the axis", float),
        ("arclength", "1", "S-coordinate of the element ends, 0 to 1", float),
        ("heights", length, "height of the sections at the sample points of each element, where it varies", float),
        ("levels", length, "y of bottom, axis, top and the lines between layers, where not -h/2, 0, h/2", float),
    ):
        value = getattr(body, name)
        if value is None:
            continue
        data = np.asarray(value, kind)
        if kind is int and (not data.size or data.max() < 2**31):
            data = data.astype(np.int32)
        write_fixed(group, name, data, units, text, compress=True)
    if names:
        write_texts(group, "coordinate_names", names, "none",
                    "names of one element's coordinates")
