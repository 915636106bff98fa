"""Element definition files: a user's element type as polynomial basis and nodal coordinates."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

from ..errors import CaseError, Problem, raise_any
from .binder import INVALID, Binder, Issue, Vocabulary
from .compose import compose, read_text
from .declare import key, record
from .kinds import Known, ListOf, Name, Number, Text
from .nodes import MapNode, Origin, Source, line_breaks
from .records import Record, bind_record, mark_below
from .schema.body import QUADRATURE, SHEAR_FACTOR


@record
class DefinitionNode:
    """A node of an element: its place, and the derivatives of r that are coordinates there."""

    at: float = key(Number("", ge=0, le=1), "Position along the element, from 0 to 1", example=0)
    coordinates: tuple[str, ...] = key(ListOf(Text("the name of a nodal coordinate"),
                                              "nodal coordinates", 1),
                                       "Nodal coordinates: r, r_x, r_y, r_xy, r_yy, ...",
                                       example=["r", "r_x", "r_y"])

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each coordinate that is named twice."""
        for i, name in enumerate(self.coordinates):
            if name in self.coordinates[:i]:
                yield Issue(("coordinates", i), f"{{}}.coordinates: {name} is named twice")


@record
class ElementDefinition:
    """An element type described in a file."""

    name: str = key(Name("text"), "Name of the element", example="mine")
    basis: tuple[str, ...] = key(
        ListOf(Text("a polynomial in x and y", number=True), "polynomials in x and y", 1),
        "Polynomial basis", example=["1", "x", "y", "x*y", "x^2 + nu*y^2", "x^3"])
    nodes: tuple[DefinitionNode, ...] = key(
        ListOf(Record(DefinitionNode), "nodes {at, coordinates}", 1), "Nodes, in order along "
        "the element")
    formulation: str | None = key(Known("formulations"), "Formulation of the elastic forces",
                                  default=None)
    quadrature: Any = key(QUADRATURE, "Gauss points along and across, exact, or {normal, shear}",
                          default=None, example=[3, 2])
    shear_factor: float | str | None = key(SHEAR_FACTOR, "Shear correction: a number, timoshenko "
                                           "or none", default=None)
    lobatto: float = key(Number("", ge=0, le=1), "Fraction of the mass that is integrated with Gauss-Lobatto points "
                         "along the axis", default=0.0, example=0.8)


def _issues(draft: ElementDefinition) -> Iterator[Issue]:
    """Yield an issue for each node that is out of order, and each basis function that is given twice.

    Invalid values, which were reported before, are skipped.
    """
    for i, (a, b) in enumerate(pairwise(draft.nodes or ())):
        if valid_node(a) and valid_node(b) and not a.at < b.at:
            yield Issue(("nodes", i + 1, "at"), f"nodes.{i + 1}.at must be > {a.at:g}, the position of the "
                        f"previous node, got {b.at:g}")
    basis = draft.basis or ()
    for i, text in enumerate(basis):
        if text is not INVALID and text in basis[:i]:
            yield Issue(("basis", i), f"basis: '{text}' is given twice")


def valid_node(node: Any) -> bool:
    """Return whether a node of a draft has a valid position and valid coordinates."""
    return isinstance(node, DefinitionNode) and INVALID not in (node.at, node.coordinates, *(node.coordinates or ()))


def load_definition(path: str | os.PathLike[str],
                    vocabulary: Vocabulary | None = None) -> ElementDefinition:
    """Return the element that a file defines. Raises CaseError with all problems of the file.

    The polynomials stay text; ``elements`` parses them, and the vocabulary checks them.
    """
    return read_definition(path, vocabulary)[0]


def read_definition(path: str | os.PathLike[str], vocabulary: Vocabulary | None = None,
                    ) -> tuple[ElementDefinition, Source]:
    """Return the element that a file defines, and the places of its values for later checks.

    Raises CaseError with all problems of the file.
    """
    name = os.fspath(path)
    text = read_text(name, "a file that defines an element type")
    problems: list[Problem] = []
    root = compose(text, Origin(name, line_breaks(text)), problems=problems)
    if not isinstance(root, MapNode):
        raise CaseError(problems or Problem("the file holds no element definition", file=name,
                                            expected="a mapping {name, basis, nodes, ...}"))
    binder = Binder(vocabulary, problems)
    definition = bind_record(ElementDefinition, root, (), binder)
    for issue in (*_issues(definition), *binder.vocabulary.element_issues(definition)):
        binder.fail(mark_below(root, issue.key, ()), issue.key, issue.message, issue.expected)
    raise_any(problems)
    return definition, Source(name, text, root)
