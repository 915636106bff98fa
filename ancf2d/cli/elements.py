"""``ancf2d elements``: list element types and their formulations."""

from __future__ import annotations

import re
from typing import Any

import click

from ..errors import CaseError, Problem, many
from .options import complete_types, examples, json_session
from .session import Session
from .text import table


@click.command(epilog=examples("ancf2d elements", "ancf2d elements 2d2n", 'ancf2d elements "ancf[3,2]"',
                               "ancf2d elements mine.yaml"))
@click.argument("name", required=False, metavar="[NAME]", shell_complete=complete_types)
@json_session
def command(session: Session, name: str | None) -> int:
    """List element types, or describe one type, listed or defined in a file.

    The default formulation of each type is marked with *.
    """
    from ..elements import registry
    from ..elements.registry import RIGID_TYPE

    types = [registry.ELEMENTS[n] for n in registry.ELEMENTS] if name is None else [_named(name)]
    found = [_describe(t) for t in types]
    if name is not None:
        session.print_json(found[0])
        session.out(_one(found[0]))
        return 0
    p, q = registry.MAX_ORDER
    session.print_json({"elements": found, "families": [{"name": registry.FAMILY, "max_order": [p, q]}]})
    rows = [["type", "coordinates", "formulations", "source"]]
    for t in found:
        names = [f["name"] + "*" * f["default"] for f in t["formulations"] if f["refused"] is None]
        rows.append([t["name"], f"{t['dofs']}: {_nodes(t)}", ", ".join(names), t["source"]])
    rows.append([f"{registry.FAMILY}[p,q]", f"order along p <= {p}, across q <= {q}", "'ancf2d elements ancf[3,2]'",
                 "any member of the family by its order"])
    rows.append([RIGID_TYPE.name, f"{RIGID_TYPE.n_dof}: {_nodes(_describe(RIGID_TYPE))}", "none: it has no strain",
                 RIGID_TYPE.source])
    session.out("\n".join(table(rows, left=(0, 1, 2, 3))))
    session.out("\n* default; 'ancf2d elements NAME' shows the details of one")
    return 0


def _named(name: str) -> Any:
    """Return an element type by name or from a file. Raises CaseError with the nearest name if there is none."""
    from ..elements.registry import RIGID_TYPE
    from ..study.variants import described, element_named, is_file

    if is_file(name):
        return described(name)[0]
    if name == RIGID_TYPE.name:
        return RIGID_TYPE
    try:
        return element_named(name)
    except ValueError as error:
        raise CaseError(Problem(str(error))) from None


def _nodes(found: dict[str, Any]) -> str:
    """Return '2 nodes: r, r_x, r_y'; usually all nodes of a type have the same coordinates."""
    sets = list(dict.fromkeys(tuple(n["coordinates"]) for n in found["nodes"]))
    return f"{many(len(found['nodes']), 'node')}: " + "; ".join(", ".join(s) for s in sets)


def _describe(element: Any) -> dict[str, Any]:
    """Return an element type as an object for JSON."""
    from ..elements.formulations import FORMULATIONS, Rule

    formulations = []
    for f in FORMULATIONS.values():
        refused = f.refuse(element)
        rule = None if refused else list(element.quadrature.get(f.name, f.rule(element)))
        points = None if rule is None else str(Rule((rule[0], rule[1]), (rule[0], rule[1]), f.lobatto))
        formulations.append({"name": f.name, "default": f.name == element.formulation, "quadrature": rule,
                             "points": points, "refused": refused, "doc": f.doc, "source": f.source})
    return {"name": element.name, "basis": [_tidy(b) for b in element.basis], "dofs": element.n_dof,
            "nodes": [{"at": n.at, "coordinates": list(n.coordinates)} for n in element.nodes],
            "formulations": formulations,
            "shear_factor": None if element.section_kind == "tangent" else element.shear_factor,
            "preset": {k: list(v) if isinstance(v, tuple) else v for k, v in element.preset.items()},
            "source": element.source, "note": element.note}


def _tidy(function: str) -> str:
    """Return a basis function without powers of 0 and 1: ``x^1*y^0`` becomes x."""
    factors = [re.sub(r"\^1\b", "", f) for f in function.split("*") if not re.fullmatch(r"[xy]\^0", f)]
    return "*".join(factors) or "1"


def _one(found: dict[str, Any]) -> str:
    """Return the full description of one element type as text."""
    at = ", ".join(f"{n['at']:.4g}" for n in found["nodes"])
    factors = {None: "none: this type has no shear strain", "timoshenko": "timoshenko: 10 (1 + nu)/(12 + 11 nu)",
               "none": "none: 1"}
    rows = [["basis", ", ".join(found["basis"])],
            ["nodes", f"{_nodes(found)}, at {at} along the element"],
            ["coordinates", f"{found['dofs']} per element"],
            ["shear factor", factors.get(found["shear_factor"], str(found["shear_factor"]))],
            ["source", found["source"]]]
    if found["preset"]:
        rows.append(["preset: paper", ", ".join(f"{k} {v}" for k, v in found["preset"].items())])
    if found["note"]:
        rows.append(["note", found["note"]])
    lines = [found["name"], *table(rows, left=(0, 1), indent="  ")]
    if not any(f["default"] for f in found["formulations"]):
        return "\n".join([*lines, "", "  no strain: a constraint keeps the length"])
    lines += ["", "  formulations"]
    offered = [[f["name"], "default" if f["default"] else "", f["points"], f["doc"]]
               for f in found["formulations"] if f["refused"] is None]
    lines += table(offered, left=(0, 1, 2, 3), indent="    ")
    refused = [[f["name"], f["refused"]] for f in found["formulations"] if f["refused"] is not None]
    if refused:
        lines += ["", "  not offered", *table(refused, left=(0, 1), indent="    ")]
    return "\n".join(lines)
