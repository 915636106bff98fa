"""Imports between folders, import cycles, sizes of files and functions, and what kernels leave out."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from scripts.house import code_lines, cycles, imports, inner_cycles, sources

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "ancf2d"
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text("utf-8")
BASE = {"errors", "interrupts", "json_values", "pace", "processors", "quantities", "__version__"}
# what a room may import from, besides itself and the base
BELOW = {
    "case": set(), "elements": set(), "results": set(),
    # the machine that amplitudes run on
    "kernels": {"case", "elements"},
    # interactions need meshes and points of the model, and the model is built of interactions: the test of cycles keeps
    # apart what they use from what uses them
    "interactions": {"case", "elements", "model"},
    "model": {"case", "elements", "interactions", "kernels"},
    # a motion may begin with the last state of a result file
    "solvers": {"case", "elements", "interactions", "kernels", "model", "results"},
    "extend": {"case", "elements", "interactions"},
    "study": {"case", "elements", "extend", "kernels", "model", "results", "solvers"},
    "plot": {"results"}, "view": {"results"},
    # a solution is printed as the command line prints it
    "api": {"case", "cli", "plot", "results", "solvers", "study"},
    "cli": {"case", "elements", "extend", "plot", "results", "solvers", "study", "view"},
}
ROOMS = sorted(BELOW)
SOURCES = cache(lambda: sources(PACKAGE))
# all nodes of each file
NODES = cache(lambda: {path: list(ast.walk(tree)) for path, tree in SOURCES().items()})
# the loop of a motion, the machine of expressions and steps that are one compiled function each: calls there cost time
LONG = {"advance": 80, "run_with_gradient": 60, "consistent": 60, "_with_border": 60, "conserving_step": 60}


def imported(path: Path) -> Iterator[str]:
    """Return the folders that a file imports from."""
    parts = ("ancf2d", *path.relative_to(PACKAGE).parent.parts)
    for node in NODES()[path]:
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(parts[:len(parts) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, [base, node.module]))
            names = [f"{module}.{alias.name}" for alias in node.names]
        yield from (name.split(".")[1] for name in names if name.startswith("ancf2d."))


def test_inner_parts_of_numba_are_used_in_one_folder() -> None:
    inner = re.compile(r"^\s*(?:from|import) (?:llvmlite|numba\.(?:core|np|_\w+)|numba import _)", re.M)
    users = {path.relative_to(PACKAGE).parent.as_posix() for path in SOURCES() if inner.search(path.read_text("utf-8"))}
    assert users == {"kernels/lowlevel"}


def test_kernels_fill_no_slices_with_arrays() -> None:
    """A slice on the left of an array takes numba two seconds in each process, a loop nothing."""
    found = {f"{path.name}:{node.lineno}" for path, nodes in NODES().items() if path.is_relative_to(PACKAGE / "kernels")
             for function in nodes if isinstance(function, ast.FunctionDef) and function.decorator_list
             for node in ast.walk(function) if isinstance(node, ast.Assign)
             if any(isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice)
                    for target in node.targets) and not isinstance(node.value, ast.Constant | ast.Attribute)}
    assert not found


@pytest.mark.parametrize("room", ROOMS)
def test_folders_import_only_from_those_below(room: str) -> None:
    wrong = [f"{path.relative_to(PACKAGE)} imports {other}"
             for path in SOURCES() if path.is_relative_to(PACKAGE / room)
             for other in imported(path) if other not in BELOW[room] | BASE | {room}]
    assert not wrong


def test_every_folder_is_known() -> None:
    assert sorted(p.name for p in PACKAGE.iterdir() if p.is_dir() and any(p.glob("*.py"))) == ROOMS


def test_the_architecture_page_has_the_allowed_imports() -> None:
    rows = re.findall(r"^\| `(\w+)/` \| .* \| (.*) \|$", ARCHITECTURE, re.M)
    assert {room: set(re.findall(r"`(\w+)/`", others)) for room, others in rows} == BELOW
    named = re.search(r"modules at the top: (.*?)\.\s", ARCHITECTURE.replace("`", ""), re.S)
    assert named is not None
    assert set(re.findall(r"(\w+)\.py", named[1])) == BASE - {"__version__"}


def test_the_architecture_page_names_every_folder_and_only_existing_files() -> None:
    named = set(re.findall(r"`([\w./-]+(?:/|\.py))`", ARCHITECTURE))
    assert [name for name in sorted(named) if not ((PACKAGE / name).exists() or (ROOT / name).exists())] == []
    folders = {f"{path.relative_to(PACKAGE).as_posix()}/" for path in PACKAGE.rglob("*")
               if path.is_dir() and path.name != "__pycache__"}
    assert folders - named == set()


def test_modules_do_not_import_each_other() -> None:
    """Imports inside functions and for types count too: they hide a cycle and do not break it."""
    assert inner_cycles(PACKAGE, SOURCES()) == []


def test_cycles_are_found_wherever_a_module_is_imported(tmp_path: Path) -> None:
    package = tmp_path / "p"
    (package / "room").mkdir(parents=True)
    texts = {"__init__": "from .above import x", "above": "import p.room.a\n", "room/__init__": "",
             "room/a": "from __future__ import annotations\nfrom . import b\n",
             "room/b": "def f():\n    from .c import x\n", "room/c": "if TYPE_CHECKING:\n    from ..room.a import A\n"}
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    graph = imports(package, sources(package))
    assert graph == {"p": {"p.above"}, "p.above": {"p.room.a"}, "p.room": set(), "p.room.a": {"p.room.b"},
                     "p.room.b": {"p.room.c"}, "p.room.c": {"p.room.a"}}
    assert cycles(graph) == [["p.room.a", "p.room.b", "p.room.c"]]


def test_no_module_binds_a_name_twice() -> None:
    """The later value would replace the earlier one for the code above it too."""
    twice = []
    for path, tree in SOURCES().items():
        names = []
        for node in tree.body:
            if isinstance(node, ast.Assign):
                names += [n.id for target in node.targets for n in ast.walk(target) if isinstance(n, ast.Name)]
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                names.append(node.target.id)
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                names.append(node.name)
            elif isinstance(node, (ast.Import, ast.ImportFrom)):
                names += [alias.asname or alias.name for alias in node.names]
        twice += [f"{path.relative_to(PACKAGE)}: {name}" for name, count in Counter(names).items() if count > 1]
    assert not twice


def test_lines_of_code_are_those_of_statements(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text('"""Two\nlines."""\n\n# why\nx = (1,\n\n     2)  # both\n\n\ndef f():\n    """Text."""\n'
                    '    return """a\nb"""\n')
    # x and its second line, def, and two lines of a text that is returned
    assert code_lines(path, sources(tmp_path)[path]) == 5


def test_scripts_do_not_import_tests() -> None:
    tests = {path.stem for path in (ROOT / "tests").rglob("*.py")}
    wrong = []
    for path, tree in sources(ROOT / "scripts").items():
        nodes = list(ast.walk(tree))
        names = [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
        names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
        wrong += [f"{path.relative_to(ROOT)} imports {name}" for name in names if name.split(".")[0] in tests]
        wrong += [f"{path.relative_to(ROOT)} changes sys.path"] * ("sys.path" in path.read_text("utf-8"))
    assert not wrong


def test_files_and_functions_are_short() -> None:
    long = []
    for path, nodes in NODES().items():
        if len(path.read_text("utf-8").splitlines()) > 400:
            long.append(str(path.relative_to(PACKAGE)))
        for node in nodes:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > LONG.get(node.name, 50):
                    long.append(f"{path.relative_to(PACKAGE)}: {node.name}")
    assert not long


def test_rows_of_fixtures_have_no_marks() -> None:
    """Tests with a mark ``slow`` on some rows of a fixture would be left out of both tiers (``conftest``)."""
    found = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        text = path.read_text("utf-8")
        for call in ast.walk(ast.parse(text)) if "fixture(" in text else ():
            if isinstance(call, ast.Call) and ast.unparse(call.func).endswith("fixture"):
                rows = [ast.unparse(key.value) for key in call.keywords if key.arg == "params"]
                found += [f"{path.name}: {row}" for row in rows if re.search(r"marks|chosen|covering|pairwise", row)]
    assert found == []
