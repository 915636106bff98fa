"""Finding and loading plugins: files given on the command line, and installed packages with an entry point."""

from __future__ import annotations

import hashlib
import os
import re
import sys
import traceback
from functools import cache
from importlib import util
from importlib.metadata import entry_points
from pathlib import Path

from ..errors import PluginError

# environment variable with the plugin files of this process and its child processes
VARIABLE = "ANCF2D_PLUGINS"
GROUPS = ("ancf2d.interactions", "ancf2d.formulations")


def add_plugin(path: str) -> None:
    """Load a plugin file, in this process and its child processes. Raises PluginError."""
    full = os.path.abspath(path)
    _load_file(full)
    files = _named()
    if full not in files:
        os.environ[VARIABLE] = os.pathsep.join([*files, full])


@cache
def load_plugins() -> None:
    """Load installed plugins and files named in the environment, once. Raises PluginError."""
    for group in GROUPS:
        for point in entry_points(group=group):
            try:
                point.load()
            except Exception as error:
                raise PluginError(f"the plugin '{point.name}' ({point.value}) cannot be loaded: "
                                  f"{_words(error)}") from error
    for path in _named():
        _load_file(path)


def blame(error: BaseException) -> PluginError | None:
    """Return the PluginError for an error in running or compiling the code of a plugin, or None for all others."""
    modules = [sys.modules.get(point.module) for group in GROUPS for point in entry_points(group=group)]
    files = [*_named(), *(file for file in (getattr(module, "__file__", None) for module in modules) if file)]
    run = [(frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)
           if frame.filename in files]
    # numba's message names the file and line of a function that it cannot compile, in one of two forms
    forms = r'File "(.+?)", line (\d+)', r"(\S+) \((\d+)\)"
    named = [part for form in forms for part in re.findall(form, str(error))]
    compiled = [(os.path.abspath(file), line) for file, line in named if os.path.abspath(file) in files]
    if not run and not compiled:
        return None
    file, place = run[-1] if run else compiled[0]
    if run:
        return PluginError(f"{file}:{place}: the plugin fails: {_words(error)}")
    lines = [line.strip() for line in str(error).splitlines() if line.strip() and "mode pipeline" not in line
             and not line.startswith('File "')]
    return PluginError(f"{file}:{place}: the plugin cannot be compiled: {' '.join(lines[:2])}")


def digest() -> str:
    """Return a digest of the plugin files in use, empty if there are none."""
    found = hashlib.sha256()
    for path in _named():
        found.update(Path(path).read_bytes())
    return found.hexdigest() if _named() else ""


def _named() -> list[str]:
    return [path for path in os.environ.get(VARIABLE, "").split(os.pathsep) if path]


@cache
def _load_file(path: str) -> None:
    if not os.path.isfile(path):
        raise PluginError(f"the plugin file '{path}' does not exist")
    # records of a plugin are pickled by the name of their module, which must be the same in all processes
    name = f"ancf2d_plugin_{Path(path).stem}_{hashlib.sha256(path.encode()).hexdigest()[:8]}"
    spec = util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"the plugin file '{path}' is not a Python file (.py)")
    module = util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
        if isinstance(error, SyntaxError):
            lines = [error.lineno]
        place = f"{path}:{lines[-1]}" if lines else path
        raise PluginError(f"{place}: the plugin cannot be loaded: {_words(error)}") from error


def _words(error: BaseException) -> str:
    return str(error) if isinstance(error, PluginError) else f"{type(error).__name__}: {error}".rstrip(": ")
