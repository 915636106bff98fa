"""``--set PATH=VALUE`` sets whatever a file could contain; its errors point into its own text."""

from pathlib import Path

import pytest

from ancf2d.case import CaseText, load_case, load_case_text
from ancf2d.case.emit import walk
from ancf2d.case.numbers import numbers_of
from ancf2d.errors import CaseError
from ancf2d.study.run import vocabulary

CASE = Path(__file__).parent / "valid" / "simply_supported.yaml"
CASES = Path(__file__).parents[2] / "cases"


def load(vocabulary, *overrides):
    return load_case(CASE, overrides, vocabulary)


def refusal(vocabulary, *overrides):
    with pytest.raises(CaseError) as caught:
        load(vocabulary, *overrides)
    return str(caught.value)


@pytest.mark.parametrize(("override", "read"), [
    ("bodies.beam.element.count=32", lambda c: c.bodies["beam"].element.count == 32),
    ("bodies.beam.element.count=1e3", lambda c: c.bodies["beam"].element.count == 1000),
    ("loads.0.value.1=-500", lambda c: c.loads[0].value == (0.0, -500.0)),
    ("loads.0.value=[1, 2]", lambda c: c.loads[0].value == (1.0, 2.0)),
    ("boundary_conditions.left.name=other", lambda c: c.boundary_conditions[0].name == "other"),
    ("boundary_conditions.1.fixed=x", lambda c: c.boundary_conditions[1].fixed == "x"),
    ("solver={type: eigen, modes: 3}", None),
    ("bodies.beam.element.formulation=structural",
     lambda c: c.bodies["beam"].element.formulation == "structural"),
    ("bodies.beam.material.damping.kelvin_voigt=1e-3",
     lambda c: c.bodies["beam"].material.damping.kelvin_voigt == 1e-3),
    ("units.length=mm", lambda c: c.units.length == "mm"),
    ("output.probes.end=beam@1", lambda c: c.output.probes["end"].at.s == 1.0),
    # a number in place of a point BODY@S moves it along the body
    ("boundary_conditions.left.at=0.25", lambda c: (c.boundary_conditions[0].at.body,
                                                    c.boundary_conditions[0].at.s) == ("beam", 0.25)),
    ("title=a = b", lambda c: c.title == "a = b"),
    ("loads.0.amplitude={type: expression, value: 't <= 1'}",
     lambda c: c.loads[0].amplitude.value(0.5) == 1.0),
    ("bodies.beam.element=auto", lambda c: c.bodies["beam"].element.type == "auto"),
])
def test_sets(override, read, vocabulary):
    if read is None:
        assert "goal" in refusal(vocabulary, override)
    else:
        loaded = load(vocabulary, override)
        assert read(loaded.case)
        assert loaded.overrides == (override,)
        assert loaded.text == CASE.read_text()


@pytest.mark.parametrize("file", ["dynamic/pid_arm.yaml", "contact/shared_force.yaml", "static/bimetal.yaml",
                                  "dynamic/four_bar.yaml", "static/tendon_arm.yaml"])
def test_every_number_that_a_case_can_vary_is_set_by_its_path(file):
    """These are the paths that derivatives and samples use: keys, names and indices of items, points of bodies."""
    path = CASES / file
    text = CaseText(path.read_text(encoding="utf-8"), str(path))
    numbers = [number for number in numbers_of(text.load((), vocabulary())) if not number.path.endswith("count")]
    assert len(numbers) > 10
    for number in numbers:
        wanted = number.value * (1.0 - 1e-6) or 1e-6
        changed = text.load([f"{number.path}={wanted!r}"], vocabulary())
        assert {n.path: n.value for n in numbers_of(changed)}[number.path] == pytest.approx(wanted, rel=1e-12)


def test_later_ones_win_and_see_earlier_ones(vocabulary):
    case = load(vocabulary, "loads=[{type: force, at: beam@1, value: [1, 0]}]",
                "loads.0.value.0=3", "loads.0.value.0=4").case
    assert case.loads[0].value == (4.0, 0.0)


@pytest.mark.parametrize(("overrides", "read"), [
    (["loads+={type: moment, at: beam@1, value: 3}"], lambda c: [load.value for load in c.loads[-1:]] == [3.0]),
    (["loads+={type: moment, at: beam@1, value: 3}", "loads.1.value=4"], lambda c: c.loads[1].value == 4.0),
    (["masses+={at: beam@1, mass: 2}", "masses+={at: beam@0.5, mass: 3}"],
     lambda c: [m.mass for m in c.masses] == [2.0, 3.0]),
    (["goal=null"], lambda c: c.goal is None), (["expected.0=~"], lambda c: not c.expected),
    (["boundary_conditions.left.name=null"], lambda c: c.boundary_conditions[0].name is None),
])
def test_lists_grow_and_optional_keys_can_be_removed(overrides, read, vocabulary):
    before = load(vocabulary).case
    assert before.goal is not None
    assert before.expected
    assert before.boundary_conditions[0].name == "left"
    loaded = load(vocabulary, *overrides)
    assert read(loaded.case)
    assert loaded.overrides == tuple(overrides)


@pytest.mark.parametrize("override", [
    "accuracy=null", "accuracy=~", "steady_rotation=null", "steady_rotation.about=null", "output.fields=null",
    "bodies.beam.material.rho=null", "bodies.other=null", "bodies.other.section=null", "parameters.k=null",
    "loads.0.amplitude.scale=null"])
def test_keys_that_are_not_there_stay_away(override, vocabulary):
    text = CASE.read_text(encoding="utf-8").replace(", rho: 7850", "")
    assert load_case_text(text, overrides=[override], vocabulary=vocabulary).case == load_case_text(
        text, vocabulary=vocabulary).case


def test_completed_text_holds_them(vocabulary):
    assert "count: 32" in load(vocabulary, "bodies.beam.element.count=32").completed


@pytest.mark.parametrize(("override", "message"), [
    ("bodies.beam.element.count=abc", """\
error: bodies.beam.element.count must be a whole number >= 1, \
got the text 'abc'
      | --set bodies.beam.element.count=abc
      |                                 ^"""),
    ("bodies.bem.element.count=3", """\
error: the case has no 'bodies.bem'; did you mean 'beam'?
      | --set bodies.bem.element.count=3
      |              ^"""),
    ("bodies.beam.element.cuont=3", """\
error: unknown key 'cuont' in bodies.beam.element; \
did you mean 'count'?
      | --set bodies.beam.element.cuont=3
      |                           ^"""),
    ("loads.3.value=[0, 0]", """\
error: 'loads' has 1 item; there is no item 3; expected 0
      | --set loads.3.value=[0, 0]
      |             ^"""),
    ("boundary_conditions.lefft.fixed=y", """\
error: 'boundary_conditions' has no item named 'lefft'; \
did you mean 'left'?
      | --set boundary_conditions.lefft.fixed=y
      |                           ^"""),
    ("bodies.beam.element.count.x=3", """\
error: 'bodies.beam.element.count' is 8; nothing can be set \
below it
      | --set bodies.beam.element.count.x=3
      |                                 ^"""),
    ("bodies.beam.element.count", """\
error: not PATH=VALUE; expected for example \
bodies.beam.element.count=32
      | --set bodies.beam.element.count
      |       ^"""),
    ("loads..value=1", """\
error: the path 'loads..value' has an empty part
      | --set loads..value=1
      |             ^"""),
    ("loads.0.value=[1, 2", """\
error: not valid YAML: a '[' is not closed, or a ',' is missing in it
      | --set loads.0.value=[1, 2
      |                     ^"""),
    ("bodies.beam.material.E=-1", """\
error: bodies.beam.material.E must be > 0 Pa, got -1
      | --set bodies.beam.material.E=-1
      |                              ^"""),
    ("loads.0.at=bem@1", """\
error: loads.0.at: there is no body 'bem'; did you mean 'beam'?
      | --set loads.0.at=bem@1
      |                  ^"""),
    ("loads+={type: moment, at: beam@1, valu: 3}", """\
error: unknown key 'valu' in loads.1 of type moment; did you mean 'value'?
      | --set loads+={type: moment, at: beam@1, valu: 3}
      |                                         ^"""),
    ("title+=3", """\
error: 'title' is the text 'Simply supported beam with a midspan load'; += appends to lists
      | --set title+=3
      |       ^"""),
    ("gaol=null", """\
error: unknown key 'gaol'; did you mean 'goal'?
      | --set gaol=null
      |       ^"""),
    ("bodies.beam.section=null", None),
    ("goal=max(abs(M))", """\
error: goal.quantity must be a quantity, not the expression 'max(abs(M))'; expected {probe, quantity} for a point \
of a body, with peak_over: [t0, t1] for the largest magnitude over time; extremes along the bodies, such as \
max(abs(M)), are for ancf2d optimise
      | --set goal=max(abs(M))
      |            ^"""),
    ("goal=", """\
error: goal has no value; expected a mapping {probe, quantity, reaction, kind, ...}
      | --set goal=
      |            ^"""),
])
def test_problems_point_into_the_override(override, message, vocabulary):
    if message is None:
        assert "bodies.beam.section is missing" in refusal(vocabulary, override)
    else:
        assert refusal(vocabulary, override) == message


def test_problems_of_several_and_of_the_file_come_together(vocabulary, tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(CASE.read_text().replace("width: 0.1", "width: 0"))
    with pytest.raises(CaseError) as caught:
        load_case(path, ["loads.0.value.0=x", "loads.9=1", "bodies.beam.element.count=-1"],
                  vocabulary)
    assert len(caught.value.problems) == 4


@pytest.mark.parametrize("override", ["=", "a", "", ".=1", "a=*x", "a=&x 1", "a=!!x 1", "a=\x01",
                                      "bodies=1", "bodies.beam=", "a\nb=1\n2", "loads.-1=2",
                                      "loads.00000000000000000000=1", "x.0=1", "😀=1", "=1"])
def test_nonsense_is_refused_in_words(override, vocabulary):
    assert "error: " in refusal(vocabulary, override)


def test_each_problem_of_several_overrides_is_reported_once(vocabulary):
    with pytest.raises(CaseError) as caught:
        load(vocabulary, "a", "c=[1", "d=*x", "e=[2")
    assert [p.file for p in caught.value.problems] == ["--set a", "--set c=[1", "--set d=*x", "--set e=[2"]


# of each value that is there, an item more, an item less, a key that is made, a unit that all is read with, a name that
# is used elsewhere, and several values that are wrong
SERIES = [(), ("bodies.beam.element.count=32",), ("loads+={type: force, at: beam@1, value: [0, 1]}",),
          ("loads.0=null",), ("loads.0.value.1=-7", "loads.0.name=tip"), ("units.length=mm",), ("loads.0.value.1=x",),
          ("output.probes.end=beam@1", "goal={probe: end, quantity: uy}"), ("bodies.beam.section.height=-1",),
          ("goal={probe: end, quantity: uy}",), ("solver={type: eigen, modes: 3}",), ("parameters.P=3",)]


def test_cases_of_one_text_equal_cases_read_anew(vocabulary):
    text = CASE.read_text(encoding="utf-8")
    shared = CaseText(text, str(CASE))

    def outcome(load):
        try:
            return load().completed
        except CaseError as error:
            return str(error)
    # twice and in both orders: what one of them changed, another would have
    for overrides in [*SERIES, *reversed(SERIES)]:
        assert (outcome(lambda o=overrides: shared.load(o, vocabulary))
                == outcome(lambda o=overrides: CaseText(text, str(CASE)).load(o, vocabulary))), overrides


def test_cases_of_one_text_share_parts_without_overrides(vocabulary):
    shared = CaseText(CASE.read_text(encoding="utf-8"), str(CASE))
    one, other = (shared.load([f"bodies.beam.element.count={n}"], vocabulary).case for n in (4, 8))
    assert (one.bodies["beam"].element.count, other.bodies["beam"].element.count) == (4, 8)
    assert one.bodies["beam"].section is other.bodies["beam"].section
    assert one.loads[0] is other.loads[0]


def test_shared_parts_of_cases_are_checked_once(vocabulary):
    shared = CaseText(CASE.read_text(encoding="utf-8"), str(CASE))
    for n in (4, 8):
        case = shared.load([f"bodies.beam.element.count={n}", f"loads.0.value.1={n}"], vocabulary).case
        assert walk(case, (), shared.known) == walk(case)
    section, path = case.bodies["beam"].section, ("bodies", "beam", "section")
    assert walk(section, path, shared.known) is walk(section, path, shared.known)
    assert walk(section, path, shared.known) == walk(section, path)
    assert (*path, "height") in [place for place, *_ in walk(section, path, shared.known)]
    # at another place it has other paths
    assert walk(section, ("other",), shared.known) == walk(section, ("other",))
