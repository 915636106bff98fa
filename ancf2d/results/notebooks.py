"""Representations of result files for notebooks, and as data sets of xarray."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from xarray import Dataset

Variables = dict[str, tuple[Sequence[str], Any, dict[str, str]]]


def html_table(rows: Iterable[Sequence[object]], head: Sequence[object] = ()) -> str:
    """Return rows of cells as an HTML table; cells that begin with a digit, after a sign, are aligned to the right."""
    def line(cells: Sequence[object], tag: str) -> str:
        found = (f'<{tag} style="text-align: {_side(str(c))}">{escape(str(c))}</{tag}>' for c in cells)
        return f"<tr>{''.join(found)}</tr>"

    return "<table>" + (line(head, "th") if head else "") + "".join(line(r, "td") for r in rows) + "</table>"


def _side(cell: str) -> str:
    return "right" if cell.lstrip("+-")[:1].isdigit() else "left"


def one_line(results: Any) -> str:
    """Return a description of a result file in one line."""
    title = f" {results.title!r}" if results.title else ""
    return f"<Results{title}: {results.status}, {results.solver}, {results.nt} states, {results.path.name}>"


def as_html(results: Any) -> str:
    """Return the contents of a result file as HTML for notebooks."""
    span = f"{results.t[0]:g} to {results.t[-1]:g}" if results.nt else ""
    what = f"t [{results.units.time}]" if results.over_time else "load factor"
    rows = [("file", results.path.name), ("solver", f"{results.solver}, {results.status}"),
            ("states", f"{results.nt} states" + (f", {what} {span}" if span else ""))]
    rows += [("body", f"{name}: {len(b.dofs)} elements {b.element_type}") for name, b in results.bodies.items()]
    rows += [("probe", f"{name}: {', '.join(f'{q} [{columns.units[q]}]' for q in columns)}")
             for name, columns in results.probes.items()]
    rows += [("fields", f"{body}: {', '.join(found)}") for body, found in results.fields.items()]
    return f"<b>{escape(results.title)}</b>" * bool(results.title) + html_table(rows)


def to_xarray(results: Any, states: bool = True) -> Dataset:
    """Return all stored data as a data set of xarray, with units; the package xarray has to be installed.

    Probe quantities are variables over ``t`` (load factor or time) and ``probe``; energies, nodal coordinates d and
    their rates v and a over ``state``, whose load factor or time is ``t_state``; shapes of modes over ``mode``; fields
    ``BODY.FIELD`` over state, elements of the body and stations; complex responses ``INPUT.PROBE.QUANTITY`` over
    ``hz``; columns ``TABLE.COLUMN`` of other tables over the rows of each; A to D of a linear model over its states,
    inputs and outputs. Without ``states``, arrays over states are left out.
    Raises ImportError if xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise ImportError("to_xarray needs the package xarray: pip install 'ancf2d[xarray]'") from None
    variables: Variables = _probe_variables(results)
    coords: Variables = {"t": (("t",), results.probe_t, {"units": _t_units(results)}),
                         "probe": (("probe",), list(results.probes), {})}
    if states and results.nt:
        coords["t_state"] = ("state",), results.t, {"units": _t_units(results)}
        variables["e0"] = ("coordinate",), results.e0, {"description": "reference nodal coordinates"}
        variables |= {name: (("state", "coordinate"), results.rows(name), {}) for name in "dva" if results.holds(name)}
        variables |= {f"energy_{name}": (("state",), values, {"units": results.energies.units[name]})
                      for name, values in results.energies.items()}
        variables |= _field_variables(results, coords)
    variables |= _mode_variables(results) | _table_variables(results, coords) | _linear_model(results)
    about = {"title": results.title, "solver": results.solver, "status": results.status,
             "case": str(results.attrs.get("case_name", "")), "ancf2d": str(results.attrs.get("version_ancf2d", ""))}
    return xarray.Dataset(variables, coords, about)


def _t_units(results: Any) -> str:
    return results.units.time if results.over_time else "1"


def _probe_variables(results: Any) -> Variables:
    """Return probe quantities over (t, probe), nan for probes without them."""
    out: Variables = {}
    for q in dict.fromkeys(q for columns in results.probes.values() for q in columns):
        missing = np.full(len(results.probe_t), np.nan)
        values = [columns.get(q, missing) for columns in results.probes.values()]
        units = next(columns.units[q] for columns in results.probes.values() if q in columns)
        out[q] = ("t", "probe"), np.stack(values, axis=1), {"units": units}
    return out


def _field_variables(results: Any, coords: Variables) -> Variables:
    """Return the stored fields; add their stations to ``coords``."""
    out: Variables = {}
    for body, found in results.fields.items():
        for name, record in found.items():
            values = np.stack([results.field(body, name, i) for i in range(results.nt)])
            across = f"eta_{len(record.eta)}"
            own = record.xi.ndim > 1
            xi, element = f"xi_{body}" if own else "xi", f"element_{body}"
            along = f"station_{body}" if own else xi
            dims = ["state", element, along, across]
            coords[xi] = (element, along) if own else (xi,), record.xi, {
                "description": "place along the element, 0 to 1"}
            coords[across] = (across,), record.eta, {"description": "place across the section, -1 to 1"}
            attrs = {"units": record.units, "description": record.description}
            if len(record.components) == 1:
                out[f"{body}.{name}"] = dims, values[..., 0], attrs
            else:
                coords["component"] = ("component",), list(record.components), {}
                out[f"{body}.{name}"] = [*dims, "component"], values, attrs
    return out


def _mode_variables(results: Any) -> Variables:
    """Return the data of modes: the columns of their table, and their shapes."""
    out: Variables = {}
    if "modes" in results.tables:
        out |= {f"mode_{name}": (("mode",), values, {"units": results.tables["modes"].units.get(name, "")})
                for name, values in results.tables["modes"].items()}
    for name, array in (("mode_shape", "modes/shapes"), ("mode_quarter", "modes/quarter")):
        if array in results.arrays:
            out[name] = ("mode", "coordinate"), results.array(array), {
                "description": results.arrays[array].attrs["description"]}
    return out


def _table_variables(results: Any, coords: Variables) -> Variables:
    """Return the columns of all tables but that of modes; add the frequencies of responses to ``coords``."""
    out: Variables = {}
    for name, table in results.tables.items():
        if name == "response":
            coords["hz"] = ("hz",), table["hz"], {"units": table.units["hz"]}
            parts = [column.removesuffix(".re") for column in table if column.endswith(".re")]
            out |= {part: (("hz",), table[part + ".re"] + 1j * table[part + ".im"],
                           {"units": table.units[part + ".re"]}) for part in parts}
        elif name != "modes":
            out |= {f"{name}.{column}": ((name,), values, {"units": table.units[column]})
                    for column, values in table.items()}
    return out


def _linear_model(results: Any) -> Variables:
    """Return A to D of a linear model; the names of states, inputs and outputs are tables."""
    dims = {"A": ("states", "from_states"), "B": ("states", "inputs"), "C": ("outputs", "states"),
            "D": ("outputs", "inputs")}
    return {name: (along, results.array(f"state_space/{name}"), {}) for name, along in dims.items()
            if f"state_space/{name}" in results.arrays}
