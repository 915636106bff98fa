"""Element types and meshes of a case as overrides of its text."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import ancf2d
from ancf2d.case import Case, LoadedCase, load_case_text
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.study.run import vocabulary
from ancf2d.study.variants import (
    Variant,
    count_of,
    distribute,
    element_named,
    flexible,
    overrides_for,
    parse_variants,
    pieces,
    proportional,
    stretches_of,
)

FRAME = """\
bodies:
  post:
    geometry: {type: polyline, points: [[0, 0], [0, 1], [1, 1], [1, 2]]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.0e11, nu: 0.3}
    element: {type: 2d2n, count: POST, preset: paper}
  strut:
    geometry: {type: line, start: [1, 2], end: [3, 2]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.0e11, nu: 0.3}
    element: {type: vallejo, count: STRUT, shear_factor: 0.9, quadrature: {normal: [2, 2], shear: [1, 1]}}
boundary_conditions: [{type: clamp, at: post@0}, {name: end, type: clamp, at: strut@1}]
solver: {type: linear_static}
goal: {reaction: end, quantity: fx}
"""


def frame(post: int = 6, strut: int = 4) -> LoadedCase:
    return load_case_text(FRAME.replace("POST", str(post)).replace("STRUT", str(strut)), vocabulary=vocabulary())


def varied(loaded: LoadedCase, variant: Variant, counts: dict[str, int]) -> Case:
    return load_case_text(loaded.text, overrides=overrides_for(loaded.case, variant, counts),
                          vocabulary=vocabulary()).case


@given(st.integers(3, 40), st.integers(1, 40), st.integers(1, 500))
def test_counts_add_up_and_respect_proportions_and_pieces(post: int, strut: int, total: int) -> None:
    case = frame(post, strut).case
    counts = distribute(case, total)
    least = {name: pieces(body) for name, body in flexible(case).items()}
    assert least == {"post": 3, "strut": 1}
    assert all(counts[name] >= least[name] for name in counts)
    ideal = {name: total * count_of(body) / (post + strut) for name, body in flexible(case).items()}
    if all(ideal[name] >= least[name] for name in counts):
        assert sum(counts.values()) == total
        assert all(abs(counts[name] - ideal[name]) < 1 for name in counts)
    assert sum(counts.values()) >= total


def test_multiples_of_the_case_keep_its_proportions() -> None:
    case = frame(6, 4).case
    assert distribute(case, 30) == {"post": 18, "strut": 12}
    assert proportional(case, {"post": 18, "strut": 12})
    assert not proportional(case, {"post": 18, "strut": 13})


def test_the_type_of_the_case_keeps_its_options() -> None:
    loaded = frame()
    case = varied(loaded, Variant(), {"post": 9, "strut": 2})
    for name, count in (("post", 9), ("strut", 2)):
        before, after = loaded.case.bodies[name].element, case.bodies[name].element
        assert after.count == count
        for key in ("type", "order", "formulation", "quadrature", "shear_factor", "preset", "definition"):
            assert getattr(after, key) == getattr(before, key), key


def test_another_type_has_its_own_defaults_and_keeps_the_shear_factor() -> None:
    loaded, counts = frame(), {"post": 6, "strut": 4}
    post, strut = varied(loaded, Variant("ancf", (3, 2)), counts).bodies.values()
    assert (post.element.type, post.element.order, post.element.preset) == ("ancf", (3, 2), None)
    assert (strut.element.shear_factor, strut.element.quadrature) == (0.9, None)
    _, strut = varied(loaded, Variant("cable"), counts).bodies.values()
    assert strut.element.shear_factor is None
    _, strut = varied(loaded, Variant("vallejo", None, "structural"), counts).bodies.values()
    assert (strut.element.formulation, strut.element.quadrature) == ("structural", None)


def test_types_are_read_with_orders_and_formulations() -> None:
    assert parse_variants("2d2n, ancf[3,2],vallejo:structural,2d2n") == [
        Variant("2d2n"), Variant("ancf", (3, 2)), Variant("vallejo", None, "structural")]
    assert parse_variants("vallejo,omar:structural", "continuum") == [
        Variant("vallejo", None, "continuum"), Variant("omar", None, "structural")]
    assert parse_variants("ancf[ 3 , 2 ]:continuum")[0].label == "ancf[3,2]:continuum"


@pytest.mark.parametrize(("text", "said"), [
    ("2d2m", "did you mean '2d2n'"), ("", "there are"), ("ancf", "needs its orders"), ("ancf[0,1]", "outside"),
    ("2d2n[3,2]", "no element type"), ("vallejo:", "no formulation ''"), ("cable:grean", "did you mean 'green'")])
def test_unknown_names_are_answered_with_known_ones(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_variants(text)


MINE = """name: mine
basis: [1, x, y, x*y, x^2 + nu*y^2, x^3]
nodes:
  - {at: 0, coordinates: [r, r_x, r_y]}
  - {at: 1, coordinates: [r, r_x, r_y]}
"""


def test_an_element_in_a_file_is_a_type_among_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.yaml").write_text(MINE)
    monkeypatch.chdir(tmp_path)
    mine, other = parse_variants("mine.yaml:continuum,cable")
    assert (mine.element, mine.formulation, other.element) == ("mine", "continuum", "cable")
    loaded = frame()
    case = varied(loaded, mine, {"post": 6, "strut": 4})
    assert {b.element.definition for b in case.bodies.values()} == {str(tmp_path / "mine.yaml")}
    study = ancf2d.convergence(loaded, elements=[10, 20], types=["mine.yaml"])
    assert [row.element for row in study.rows] == ["mine", "mine"]


def test_a_file_that_describes_no_element_is_reported_with_its_lines(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(MINE.replace("x^3", "x^^3"))
    with pytest.raises(CaseError, match=r"mine\.yaml:2"):
        parse_variants(str(tmp_path / "mine.yaml"))


def test_member_of_the_family_is_the_registrys() -> None:
    assert element_named("ancf[2,1]").name == "ancf[2,1]"
    assert element_named("vallejo").name == "vallejo"


def test_doubled_meshes_are_nested_with_unequal_stretches() -> None:
    """All have the node at the load, and every node of the previous mesh."""
    text = FRAME.replace("solver:", "loads: [{type: force, at: post@0.77, value: [1, 0]}]\nsolver:").replace(
        "preset: paper", "nodes: acting")
    loaded = load_case_text(text.replace("POST", "7").replace("STRUT", "4"), vocabulary=vocabulary())
    assert {name: len(lengths) for name, lengths in stretches_of(loaded.case).items()} == {"post": 4, "strut": 1}
    before: set[float] = set()
    for total in (9, 18, 36, 72):
        changed = load_case_text(loaded.text, vocabulary=vocabulary(),
                                 overrides=overrides_for(loaded.case, Variant(), {"post": total, "strut": 4}))
        mesh = build_model(changed).meshes["post"]
        nodes = {round(s, 9) for s in (mesh.starts / mesh.plan.length).tolist()}
        assert len(nodes) == total
        assert before <= nodes
        assert 0.77 in nodes
        before = nodes


def test_a_body_has_no_fewer_elements_than_stretches() -> None:
    text = FRAME.replace("solver:", "loads: [{type: force, at: strut@0.3, value: [1, 0]}]\nsolver:")
    loaded = load_case_text(text.replace("POST", "3").replace("STRUT", "1"), vocabulary=vocabulary())
    assert distribute(loaded.case, 4) == {"post": 3, "strut": 2}
