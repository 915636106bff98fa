"""Any change of a case file gives either a case or a CaseError."""

import contextlib
import dataclasses
import json
import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case import load_case, load_case_text
from ancf2d.case.compose import compose
from ancf2d.case.emit import written, yaml_text
from ancf2d.case.nodes import Origin, plain_data, resolve
from ancf2d.errors import CaseError

HERE = Path(__file__).parent
TEXTS = [p.read_text(encoding="utf-8") for p in sorted((HERE / "valid").glob("*.yaml"))]
DATA = [plain_data(compose(text, Origin("f", []))) for text in TEXTS]
ODD = [None, True, 0, -1, 1e308, -0.0, 8.5, "", "abc", "beam@0.5", "rest", "@", "x@", [], [0],
       [0, 0], [[0, 0], [1, 1]], {}, {"type": "force"}, {"type": []}, {"a": 1}, [None], "t", "1e3"]
MARKS = "\t:{}[]&*!|>%@`#,?-\"'\x85\u2028😀\ufeff\x00"
PROFILE = settings(derandomize=True, deadline=None, max_examples=50)


def loads_or_explains(text, vocabulary, **options):
    """Return the case, or None after checking that the refusal is well formed."""
    try:
        return load_case_text(text, vocabulary=vocabulary, directory=HERE / "valid", **options)
    except CaseError as error:
        refusal = error
    assert refusal.problems
    for problem in refusal.problems:
        assert problem.message
        assert problem.line >= 0
        assert "INVALID" not in str(problem) or "INVALID" in text
        assert "object at" not in str(problem)
    return None


def places(data, path=()):
    """Yield the path of every value inside plain data."""
    items = data.items() if isinstance(data, dict) else enumerate(
        data if isinstance(data, list) else ())
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def parent_of(data, path):
    for part in path[:-1]:
        data = data[part]
    return data


def mutate(data, rng):
    """Change one value of plain data: delete, rename, replace or swap."""
    path = rng.choice(list(places(data)))
    parent, last = parent_of(data, path), path[-1]
    action = rng.randrange(4)
    if action == 0:
        del parent[last]
    elif action == 1:
        parent[last] = rng.choice(ODD)
    elif action == 2 and isinstance(parent, dict):
        name = str(last)
        parent[name[:-1] + rng.choice("abxe_") if name else "q"] = parent.pop(last)
    else:
        other = rng.choice(list(places(data)))
        source = parent_of(data, other)
        if len(path) < 8:
            parent[last] = copy(source[other[-1]])


def copy(data):
    if isinstance(data, dict):
        return {k: copy(v) for k, v in data.items()}
    return [copy(v) for v in data] if isinstance(data, list) else data


@given(st.integers(0, len(DATA) - 1), st.integers(0, 10**9), st.integers(1, 4))
@PROFILE
def test_changed_values(which, seed, changes):
    data, rng = copy(DATA[which]), random.Random(seed)
    for _ in range(changes):
        if data:
            mutate(data, rng)
    loaded = loads_or_explains(as_text(data), VOCABULARY)
    if loaded is not None:
        again = load_case_text(loaded.completed, vocabulary=VOCABULARY, directory=HERE / "valid")
        assert again.case == loaded.case


def as_text(data):
    """Return plain data as YAML, of which JSON is a part."""
    return json.dumps(data, ensure_ascii=False)


@given(st.integers(0, len(TEXTS) - 1), st.lists(st.tuples(
    st.sampled_from(["cut", "flip", "insert", "twice", "indent", "drop"]),
    st.integers(0, 10**6), st.integers(0, 10**6)), min_size=1, max_size=4))
@PROFILE
def test_damaged_text(which, damages):
    text = TEXTS[which]
    for kind, a, b in damages:
        at = a % (len(text) + 1)
        lines = text.split("\n")
        row = a % len(lines)
        if kind == "cut":
            text = text[:at]
        elif kind == "flip":
            text = text[:at] + chr(b % 0x300) + text[at + 1:]
        elif kind == "insert":
            text = text[:at] + MARKS[b % len(MARKS)] + text[at:]
        elif kind == "twice":
            text = "\n".join(lines[: row + 1] + lines[row:])
        elif kind == "indent":
            text = "\n".join([*lines[:row], " " * (b % 4 + 1) + lines[row], *lines[row + 1:]])
        else:
            text = "\n".join(lines[:row] + lines[row + 1:])
    loads_or_explains(text, VOCABULARY)


@given(st.integers(0, len(TEXTS) - 1), st.integers(0, 10**6), st.integers(0, 255))
@settings(PROFILE, max_examples=40)
def test_damaged_bytes(which, at, byte):
    data = bytearray(TEXTS[which].encode())
    data[at % len(data)] = byte
    path = SCRATCH / "damaged.yaml"
    path.write_bytes(bytes(data))
    with contextlib.suppress(CaseError):
        load_case(path, vocabulary=VOCABULARY)


@given(st.text(max_size=60))
@PROFILE
def test_any_text(text):
    loads_or_explains(text, VOCABULARY)


@given(st.one_of(st.text(max_size=30), st.sampled_from(
    ["true", "null", "~", "no", "1e3", "0123", ".nan", "a: b", "a #b", "- a", "x ", "", "\x85"])))
@PROFILE
def test_texts_survive_being_written_out(text):
    case = dataclasses.replace(load_case_text(TEXTS[0], directory=HERE / "valid").case, title=text)
    assert load_case_text(yaml_text(written(case)), directory=HERE / "valid").case == case


@given(st.integers(0, len(TEXTS) - 1), st.integers(0, 10**6), st.sampled_from(ODD), st.booleans())
@PROFILE
def test_overrides(which, seed, value, further):
    """An override gives the same as the value in the file would; null removes the key, a number moves a point."""
    paths = list(places(DATA[which]))
    path = paths[seed % len(paths)]
    data = copy(DATA[which])
    dotted = ".".join(map(str, path)) + (".extra" if further else "")
    by_override = loads_or_explains(TEXTS[which], VOCABULARY, overrides=[f"{dotted}={as_text(value)}"])
    if not further:
        if value is None:
            del parent_of(data, path)[path[-1]]
        else:
            before = parent_of(data, path)[path[-1]]
            body, at, place = before.partition("@") if isinstance(before, str) else ("", "", "")
            moves = at and type(resolve(place)) in (int, float) and type(value) in (int, float)
            parent_of(data, path)[path[-1]] = f"{body}@{as_text(value)}" if moves else value
        by_file = loads_or_explains(as_text(data), VOCABULARY)
        assert (by_override is None) == (by_file is None)
        if by_override is not None:
            assert by_override.case == by_file.case


@pytest.fixture(autouse=True, scope="module")
def _shared(vocabulary, tmp_path_factory):
    global VOCABULARY, SCRATCH
    VOCABULARY = vocabulary
    SCRATCH = tmp_path_factory.mktemp("damaged")
