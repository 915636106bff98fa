"""Every broken case is refused with exactly the stored message."""

from pathlib import Path

import pytest

from ancf2d.case import load_case
from ancf2d.errors import CaseError

BROKEN = Path(__file__).parent / "broken"
NAMES = sorted(path.stem for path in BROKEN.glob("*.yaml"))


def refusal(name, vocabulary):
    """Return the message about a broken case, its path as given being ``NAME.yaml``."""
    with pytest.raises(CaseError) as caught:
        load_case(f"{name}.yaml", vocabulary=vocabulary)
    return str(caught.value) + "\n", caught.value


@pytest.mark.parametrize("name", NAMES)
def test_message(name, vocabulary, monkeypatch, request):
    monkeypatch.chdir(BROKEN)
    text, error = refusal(name, vocabulary)
    golden = BROKEN / f"{name}.txt"
    if request.config.getoption("--update", default=False):
        golden.write_text(text, encoding="utf-8")
    assert text == golden.read_text(encoding="utf-8")
    assert error.exit_code == 2


def test_every_message_belongs_to_a_case():
    assert {path.stem for path in BROKEN.glob("*.txt")} == set(NAMES)


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith(("shape_", "value_", "cross_"))])
def test_problems_have_a_position(name, vocabulary, monkeypatch):
    monkeypatch.chdir(BROKEN)
    _, error = refusal(name, vocabulary)
    for problem in error.problems:
        lines = Path(problem.file).read_text(encoding="utf-8").split("\n") if problem.line else [""]
        assert problem.line or "cannot read the file" in problem.message
        assert problem.source_line == lines[max(problem.line - 1, 0)]
        assert problem.column <= len(problem.source_line) + 1


def test_a_problem_hides_no_other(vocabulary, monkeypatch):
    """Each problem of the file with many is also found when it is the only one left."""
    monkeypatch.chdir(BROKEN)
    _, error = refusal("many_problems", vocabulary)
    lines = [problem.line for problem in error.problems]
    assert lines == sorted(lines)
    assert len(lines) >= 19
