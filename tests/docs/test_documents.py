"""Commands of the documents run and print what is shown; generated parts are current; links lead to files."""

from __future__ import annotations

import ast
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from ancf2d.cli import main
from ancf2d.plot import output, style

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
EVERY = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: p.stem)
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
NAMED_FILE = re.compile(r"[Ss]ave this as `([\w.-]+)`:\n\n```(?:yaml|python)\n(.*?)^```$", re.M | re.S)
# what depends on the machine: times, and where round-off ends Newton's method
TIME = re.compile(r"\b[\d.]+ (us|ms|s|iterations)\b")
# what the shell leaves as it is
QUOTED = re.compile(r"'[^']*'|\"[^\"$`]*\"")
# a number this small is a zero with round-off in it
ZERO = re.compile(r"-?\b\d(\.\d+)?e-(0[7-9]|[1-9]\d)\b")


def commands(text: str) -> list[tuple[str, list[str] | None]]:
    """Return the commands of console blocks with the lines they print, and of bash blocks with None, in order."""
    out: list[tuple[str, list[str] | None]] = []
    for language, body in BLOCK.findall(text):
        if language == "bash":
            out += [(line, None) for line in body.splitlines() if line and not line.startswith("#")]
        elif language == "console":
            for line in body.splitlines():
                if line.startswith("$ "):
                    out.append((line[2:], []))
                else:
                    out[-1][1].append(line)
    return out


def normal(line: str) -> str:
    """Return a line without its machine-dependent parts and the width of columns."""
    line = ZERO.sub("0", TIME.sub("TIME", line))
    return " ".join(line.split())


def agrees(shown: list[str], printed: str) -> bool:
    """Whether a command printed the expected lines; a line ``...`` stands for any number of lines."""
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else re.escape(normal(line)) + "\n" for line in shown)
    text = "".join(normal(line) + "\n" for line in printed.splitlines())
    return re.fullmatch(pattern.replace(re.escape("\n"), "\n"), text) is not None


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("cases", "scripts", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    monkeypatch.setenv("MPLBACKEND", "agg")
    # pictures are composed and written, but stay white: tests/plot has every kind drawn
    monkeypatch.setattr(Figure, "draw", lambda figure, renderer: None)
    monkeypatch.setattr("ancf2d.plot.style.STYLE", [style.STYLE, {"savefig.dpi": 55}])
    # studies in this process, which has its imports
    monkeypatch.setattr("ancf2d.processors.cores", lambda: 1)
    # of an animation a few frames, whatever its length
    frames = output.frames
    monkeypatch.setattr(output, "frames", lambda *given, length, **more: frames(*given, length=min(length, 3), **more))
    return tmp_path


def run(command: str) -> tuple[int, str, str]:
    """Return exit code, stdout and stderr; ancf2d and scripts run in this process, which has their imports."""
    words = shlex.split(command)
    if not set("|<>&;$*`") & set(QUOTED.sub("", command)):
        if words[0] == "ancf2d":
            found = CliRunner().invoke(main, words[1:])
            return found.exit_code, found.stdout, found.stderr
        if words[0] == "python" and len(words) == 2:
            out, err = io.StringIO(), io.StringIO()
            with redirect_stdout(out), redirect_stderr(err):
                runpy.run_path(words[1], run_name="__main__")
            return 0, out.getvalue(), err.getvalue()
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=300, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.slow
@EVERY
def test_commands_print_the_output_shown(document: Path, workplace: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for name, content in NAMED_FILE.findall(text):
        (workplace / name).write_text(content, encoding="utf-8")
    for command, shown in commands(text):
        code, out, err = run(command)
        assert code == 0, f"{command}\n{out}{err}"
        if shown is not None:
            # a terminal shows both streams; progress and warnings need not stand in a document
            assert agrees(shown, out) or agrees(shown, err + out), f"{command} prints\n{out}\n{err}"


@EVERY
def test_links_lead_to_files(document: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", document.read_text(encoding="utf-8"), flags=re.M | re.S)
    targets = [t.partition("#")[0] for t in re.findall(r"\]\(([^)\s]+)\)", text) if not t.startswith("http")]
    assert [t for t in targets if t and not (document.parent / t).exists()] == []
    paths = re.findall(r"`((?:cases|docs|scripts|tests|ancf2d)/[\w./-]+)`", text)
    assert [p for p in paths if not (ROOT / p).exists()] == []


def words_to_avoid() -> list[str]:
    """Return the words in the last column of the table of terms."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| [^|]+ \| [^|]+ \|([^|]*)\|$", text[text.index("## Words"):text.index("## Rules")], re.M)
    return [word.strip() for row in rows[2:] for word in row.split(",") if word.strip()]


def prose(document: Path) -> str:
    """Return a document without its code blocks."""
    text = re.sub(r"^```.*?^```$", "", document.read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.sub(r"`[^`]*`", "", text)


def texts(source: Path) -> Iterator[str]:
    """Yield the texts of a program: messages, help, docstrings."""
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        # a name, such as a key of a file, has no spaces
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.value


@pytest.mark.slow
def test_texts_use_one_term_for_each_idea() -> None:
    avoided = words_to_avoid()
    assert "arclength" in avoided
    pattern = re.compile(rf"(?<![\w./])({'|'.join(avoided)})(?!\w|\.\w| ?\()", re.I)
    pages = [d for d in DOCUMENTS if d.name != "CONTRIBUTING.md"]
    found = [f"{d.name}: {word}" for d in pages for word in pattern.findall(prose(d))]
    found += [f"{p.relative_to(ROOT)}: {word}" for folder in ("case", "cli", "interactions", "model", "plot", "results",
                                                             "solvers", "study", "view")
              for p in sorted((ROOT / "ancf2d" / folder).rglob("*.py")) for text in texts(p)
              for word in pattern.findall(text)]
    assert found == []


def test_names_of_tests_have_nouns_as_subjects() -> None:
    names = [name for path in (ROOT / "tests").rglob("test_*.py")
             for name in re.findall(r"^def (test_\w+)", path.read_text(encoding="utf-8"), re.M)]
    assert names
    assert [name for name in names if re.match("test_(what|whatever|where|that)_", name)] == []


def headings(document: Path) -> set[str]:
    """Return the anchors of the headings of a document."""
    text = re.sub(r"^```.*?^```$", "", document.read_text(encoding="utf-8"), flags=re.M | re.S)
    return {re.sub(r"[^\w\- ]", "", h.lower()).strip().replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.M)}


@EVERY
def test_links_to_headings_lead_to_headings(document: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]*\.md)?#([^)]+)\)", document.read_text(encoding="utf-8"))
    assert [(f, a) for f, a in links if a not in headings(document.parent / f if f else document)] == []


def test_readme_has_two_set_up_commands_of_one_line_each() -> None:
    blocks = [body for language, body in BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
              if language == "sh"]
    assert [len(b.splitlines()) for b in blocks] == [1, 1]
    assert "ancf2d run cases/paper/" in blocks[0]
    assert "-m pytest" in blocks[1]


def test_first_case_fits_on_a_screen() -> None:
    (_, case), = NAMED_FILE.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(case.splitlines()) <= 20


@pytest.mark.slow
def test_generated_parts_are_current(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    from scripts import make_docs

    # which takes the solutions of all cases: tests/verification/test_verification_cases.py
    monkeypatch.delitem(make_docs.WHOLE, "verification.md")
    # which takes the examination of all types: tests/scripts/test_audit_table.py
    monkeypatch.setattr(make_docs, "MARKED", re.compile(make_docs.MARKED.pattern.replace(r"(\S+)", r"((?!audit-)\S+)")))
    assert make_docs.main(["--check"]) == 0, capsys.readouterr().out + "run: python -m scripts.make_docs"


def test_generated_tables_are_compared_up_to_round_off() -> None:
    from scripts.make_docs import same

    row = "| tip y | -0.300792 | -0.3014365 | 6.4e-04 | ok |"
    assert same(f"a\n{row}", "a\n| tip y | -0.300792 | -0.3014359 | 6.4e-04 | ok |")
    assert same("| x | 61.1417137 | 61.14171 | 2.1e-06 |", "| x | 61.1417137 | 61.14171 | 2.2e-06 |")
    assert same("| gap | 3.2e-06 | 5 |", "| gap | 3.3e-06 | 5 |")
    assert same("| gap | 0.5 | round-off | ok |", "| gap | 0.5 | 1.4e-09 | ok |")
    assert not same("| w | 0.0072135 | Allen 1969 |", "| w | 0.0072138 | Allen 1969 |")
    for other in ("| gap | 3.4e-06 |", "| gap | 3.3e-05 |", "| gap | 3e-06 |", "| gap | round-off |"):
        assert not same("| gap | 3.2e-06 |", other), other
    assert not same("| mesh | 8 |", "| mesh | 9 |")
    changed = [row.replace("-0.3014365", "-0.3015"), row.replace("ok", "off"), row.replace(" | ok", ""), f"{row}\na"]
    assert not any(same(row, other) for other in changed)
    assert not same("1.0000001", "1.0000002")


def test_output_is_compared_up_to_times_and_round_off() -> None:
    assert agrees(["tip  1.5  3 ms  -5.2e-09", "...", "end"], "tip 1.5 12.1 ms 7e-12\nany\nmore\nend\n")
    assert not agrees(["tip  1.5"], "tip 1.6\n")
    assert not agrees(["a"], "a\nb\n")
