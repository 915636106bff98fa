"""Element definition files."""

from pathlib import Path

import pytest

from ancf2d.case import DefinitionNode, ElementDefinition, load_case, load_definition
from ancf2d.errors import CaseError

HERE = Path(__file__).parent
NODE = DefinitionNode(0.0, ("r", "r_x", "r_y"))


def test_definition(vocabulary):
    definition = load_definition(HERE / "definitions" / "own_element.yaml", vocabulary)
    assert definition == ElementDefinition(
        "mine", ("1", "x", "y", "x*y", "x^2 + nu*y^2", "x^3"),
        (NODE, DefinitionNode(1.0, NODE.coordinates)), "continuum", (3, 2), "timoshenko")


def test_a_case_brings_its_definitions(vocabulary):
    loaded = load_case(HERE / "valid" / "column.yaml", vocabulary=vocabulary)
    assert loaded.definitions["column"].name == "mine"
    assert loaded.case.bodies["column"].element.type == "user"


@pytest.mark.parametrize(("text", "words"), [
    ("", "holds no element definition"), ("- 1", "holds no element definition"),
    ("name: a\nbasis: [1]\n", "nodes is missing"),
    ("name: a\nbasis: []\nnodes: []\n", "1 or more polynomials"),
    ("name: a\nbasis: [1, 1]\nnodes: [{at: 0, coordinates: [r]}]\n", "'1' is given twice"),
    ("name: a\nbasis: [1]\nnodes: [{at: 0, coordinates: [r]}, {at: 0, coordinates: [r]}]\n",
     "must be > 0, the position of the previous node"),
    ("name: a\nbasis: [1]\nnodes: [{at: 0, coordinates: [r, r]}]\n", "r is named twice"),
    ("name: a\nbasis: [1\n", "not closed"), ("name: a\nbases: [1]\n", "did you mean 'basis'")])
def test_broken_definitions(text, words, tmp_path, vocabulary):
    path = tmp_path / "e.yaml"
    path.write_text(text)
    with pytest.raises(CaseError, match=words):
        load_definition(path, vocabulary)


def test_byte_order_mark(tmp_path, vocabulary):
    path = tmp_path / "e.yaml"
    own = HERE / "definitions" / "own_element.yaml"
    path.write_text(own.read_text(), encoding="utf-8-sig")
    assert load_definition(path, vocabulary) == load_definition(own, vocabulary)


def test_missing_file(tmp_path):
    with pytest.raises(CaseError, match="cannot read the file"):
        load_definition(tmp_path / "none.yaml")
