"""Counts how large the code is: modules, lines, import cycles, the longest files and functions.

Run it with ``python -m scripts.house``. Lines of code are all but blank lines, comments and docstrings.
"""

from __future__ import annotations

import ast
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ancf2d"
SHORT, LONGEST = 60, 5
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def sources(folder: Path) -> dict[Path, ast.Module]:
    """Return the Python files in a folder and below it, parsed."""
    return {path: ast.parse(path.read_text("utf-8")) for path in sorted(folder.rglob("*.py"))}


def code_lines(path: Path, tree: ast.Module) -> int:
    """Return how many lines of a file hold code."""
    with tokenize.open(path) as stream:
        lines = {line for token in tokenize.generate_tokens(stream.readline) if token.type not in LAYOUT
                 for line in range(token.start[0], token.end[0] + 1)}
    documented = (node for node in ast.walk(tree) if isinstance(node, DOCUMENTED) and ast.get_docstring(node, False))
    texts = [node.body[0] for node in documented]
    return len(lines.difference(*(range(text.lineno, (text.end_lineno or text.lineno) + 1) for text in texts)))


def functions(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Yield the name of each function, and how many lines it has."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, (node.end_lineno or node.lineno) - node.lineno + 1


def imports(package: Path, files: dict[Path, ast.Module]) -> dict[str, set[str]]:
    """Return the modules of a package that each of them imports: anywhere, in functions and for types alone too."""
    modules = {".".join((package.name, *path.relative_to(package).with_suffix("").parts)).removesuffix(".__init__"):
               path for path in files}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        parts = name.split(".") + (["__init__"] if path.name == "__init__.py" else [])
        found: set[str] = set()
        for node in ast.walk(files[path]):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                base = ".".join((*(parts[:-node.level] if node.level else []), *filter(None, [node.module])))
                # what is no module is a name within one
                found |= {full if (full := f"{base}.{alias.name}") in modules else base for alias in node.names}
        graph[name] = found & modules.keys() - {name}
    return graph


def cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that import each other, directly or by way of others."""
    reached = {name: set(others) for name, others in graph.items()}
    for via in graph:
        for name in graph:
            if via in reached[name]:
                reached[name] |= reached[via]
    together = {tuple(sorted(other for other in reached[name] if name in reached[other])) for name in graph}
    return sorted(list(names) for names in together if names)


def inner_cycles(package: Path, files: dict[Path, ast.Module]) -> list[list[str]]:
    """Return the import cycles of a package. Its ``__init__`` stands above all rooms: it is no part of them."""
    graph = imports(package, files)
    del graph[package.name]
    return cycles({name: others & graph.keys() for name, others in graph.items()})


def main() -> None:
    """Print the counts."""
    files = sources(PACKAGE)
    sizes = {path: len(path.read_text("utf-8").splitlines()) for path in files}
    loops = inner_cycles(PACKAGE, files)
    print(f"ancf2d/: {len(files)} modules, {sum(code_lines(*item) for item in files.items())} lines of code, "
          f"{sum(sizes.values())} lines in all")
    print(f"files of fewer than {SHORT} lines: {sum(size < SHORT for size in sizes.values())}")
    print(f"import cycles: {len(loops)}", *(f"\n  {', '.join(names)}" for names in loops), sep="")
    for name in ("scripts", "tests"):
        others = sources(ROOT / name)
        print(f"{name}/: {len(others)} files, {sum(code_lines(*item) for item in others.items())} lines of code, "
              f"{sum(len(path.read_text('utf-8').splitlines()) for path in others)} lines in all")
    print("longest files:", *(f"\n  {size} {path.relative_to(ROOT)}" for path, size in
                              sorted(sizes.items(), key=lambda item: -item[1])[:LONGEST]), sep="")
    long = sorted(((size, name, path) for path, tree in files.items() for name, size in functions(tree)), reverse=True)
    print("longest functions:", *(f"\n  {size} {path.relative_to(ROOT)}: {name}" for size, name, path in
                                  long[:LONGEST]), sep="")


if __name__ == "__main__":
    main()
