"""Compiled kernels shared by processes: read without the compiler's libraries, robust to damaged files."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numba.core.errors import TypingError

from ancf2d.kernels.lowlevel import cache
from ancf2d.kernels.lowlevel.arrays import copy_rows
from ancf2d.kernels.lowlevel.jit import addressed, kernel, kernel_with_memory

SOURCE = """
import numpy as np
from ancf2d.kernels.lowlevel.jit import kernel_with_memory

@kernel_with_memory
def filled(n, x):
    out = np.zeros((n, 2))
    out[:, 1] = x
    return out
"""
# what numba imports before it compiles
COMPILING = ("scipy.linalg", "numba.np.npyimpl", "numba.typed.listobject")


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module with one kernel and its own cache."""
    (tmp_path / "one_kernel.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")
    monkeypatch.delitem(sys.modules, "one_kernel", raising=False)
    return importlib.import_module("one_kernel")


def anew(module: ModuleType) -> Any:
    """The kernel as another process finds it."""
    return kernel_with_memory(module.filled.py_func)


def hits_and_misses(compiled: Any) -> tuple[int, int]:
    """Number of reads of a kernel from the cache, and of compilations."""
    assert compiled(3, 2.0).tolist() == [[0.0, 2.0]] * 3
    return sum(compiled.stats.cache_hits.values()), sum(compiled.stats.cache_misses.values())


def test_a_kernel_is_compiled_once(module: ModuleType) -> None:
    assert hits_and_misses(module.filled) == (0, 1)
    assert hits_and_misses(anew(module)) == (1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("damage", [lambda b: b"", lambda b: b[:len(b) // 2], lambda b: bytes(len(b)),
                                    lambda b: b[:len(b) // 2] + bytes([b[len(b) // 2] ^ 1]) + b[len(b) // 2 + 1:]],
                         ids=["empty", "half", "zeros", "one bit"])
def test_a_damaged_file_is_compiled_and_written_anew(module: ModuleType, tmp_path: Path, damage: Any) -> None:
    assert hits_and_misses(module.filled) == (0, 1)
    file, = (tmp_path / "cache").iterdir()
    file.write_bytes(damage(file.read_bytes()))
    assert hits_and_misses(anew(module)) == (0, 1)
    assert hits_and_misses(anew(module)) == (1, 0)


@pytest.mark.skipif(os.name != "posix", reason="modes of files")
def test_a_kernel_writable_by_others_is_not_run(module: ModuleType, tmp_path: Path) -> None:
    assert hits_and_misses(module.filled) == (0, 1)
    files = [p for p in (tmp_path / "cache").rglob("*") if p.is_file()]
    assert {p.stat().st_mode & 0o777 for p in files} == {0o600}
    for file in files:
        file.chmod(0o622)
        assert hits_and_misses(anew(module)) == (0, 1)
        assert hits_and_misses(anew(module)) == (1, 0)


def in_a_process(folder: Path, **environment: str) -> list[str]:
    """Call the kernel in its own process; return the imports of the call."""
    code = f"""
import sys
from one_kernel import filled
assert filled(3, 2.0).tolist() == [[0.0, 2.0]] * 3
print(*(m for m in {COMPILING!r} if m in sys.modules))
"""
    found = subprocess.run([sys.executable, "-c", code], cwd=folder, text=True, capture_output=True, timeout=60,
                           env={**os.environ, **environment})
    assert found.returncode == 0, found.stderr
    return found.stdout.split()


@pytest.mark.slow
def test_a_cached_kernel_does_not_import_the_compiler(tmp_path: Path) -> None:
    (tmp_path / "one_kernel.py").write_text(SOURCE)
    chosen = str(tmp_path / "cache")
    assert in_a_process(tmp_path, NUMBA_CACHE_DIR=chosen) == list(COMPILING)
    assert in_a_process(tmp_path, NUMBA_CACHE_DIR=chosen) == []


@pytest.mark.slow
def test_without_a_writable_cache_every_process_compiles(tmp_path: Path) -> None:
    (tmp_path / "one_kernel.py").write_text(SOURCE)
    # numba would keep kernels beside the sources, whose other files may change
    nowhere = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": str(tmp_path / "one_kernel.py")}
    assert in_a_process(tmp_path, **nowhere) == list(COMPILING)
    assert in_a_process(tmp_path, **nowhere) == list(COMPILING)


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sources in their own folder, and an empty home."""
    for room in ("kernels", "elements"):
        (tmp_path / "sources" / room).mkdir(parents=True)
        (tmp_path / "sources" / room / "a.py").write_text("x = 1\n")
    (tmp_path / "sources" / "case").mkdir()
    (tmp_path / "sources" / cache.JETS).write_text("x = 1\n")
    monkeypatch.setattr(cache, "_PACKAGE", tmp_path / "sources")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path


@pytest.mark.parametrize(("variable", "below"), [("HOME", ".cache"), ("XDG_CACHE_HOME", ""), ("NUMBA_CACHE_DIR", "")])
@pytest.mark.parametrize("changed", ["kernels/a.py", "elements/a.py", "elements/new.py", cache.JETS])
def test_changed_sources_have_another_cache_folder(places: Path, monkeypatch: pytest.MonkeyPatch,
                                                   variable: str, below: str, changed: str) -> None:
    monkeypatch.setenv(variable, str(places / "chosen"))
    before, why = cache.cache_folder()
    assert (before is not None and before.parent, why) == (places / "chosen" / below / "ancf2d", "")
    assert cache.cache_folder()[0] == before
    (places / "sources" / changed).write_text("x = 2\n")
    after, _ = cache.cache_folder()
    assert after is not None
    assert after != before
    assert {p.stat().st_mode & 0o777 for p in (after, after.parent)} == {0o700}


def test_a_folder_writable_by_others_is_not_used(places: Path) -> None:
    folder, _ = cache.cache_folder()
    assert folder is not None
    (folder / "kept.kernel").touch()
    folder.parent.chmod(0o755)
    assert cache.cache_folder() == (folder, "")
    assert (folder / "kept.kernel").exists()
    folder.chmod(0o770)
    assert cache.cache_folder() == (folder, "")
    assert not list(folder.iterdir())
    assert folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_of_another_user_is_not_used(places: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = cache.cache_folder()
    assert folder is not None
    (folder / "planted.kernel").touch()
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    found, why = cache.cache_folder()
    assert found is None
    assert "belongs to another user" in why
    assert (folder / "planted.kernel").exists()


@pytest.mark.parametrize("home", ["", "/", "relative"])
def test_without_a_home_nothing_is_cached(places: Path, monkeypatch: pytest.MonkeyPatch, home: str) -> None:
    monkeypatch.setenv("HOME", home)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache.cache_folder() == (None, "there is no home folder")


PARTS = """
from ancf2d.kernels.lowlevel.jit import inner, kernel

@inner
def doubled(x):
    return 2.0 * x[0]

@kernel
def one_more(x):
    return doubled(x) + 1.0

@kernel
def two_more(x):
    return doubled(x) + 2.0
"""


def test_later_kernels_read_shared_functions_from_the_cache(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "parts_of_kernels.py").write_text(PARTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")

    def imported() -> ModuleType:
        monkeypatch.delitem(sys.modules, "parts_of_kernels", raising=False)
        return importlib.import_module("parts_of_kernels")

    first, later, x = imported(), imported(), np.array([3.0])
    assert first.one_more(x) == 7.0
    assert later.two_more(x) == 8.0
    assert sum(later.doubled.stats.cache_hits.values()) == 1
    assert not later.doubled.stats.cache_misses
    assert imported().one_more(x) == 7.0


def test_a_kernel_that_makes_arrays_must_declare_it(module: ModuleType) -> None:
    with pytest.raises(TypingError, match="zeros"):
        kernel(module.filled.py_func)(3, 2.0)


LONG = """
import numpy as np
from ancf2d.kernels.lowlevel.jit import inner, kernel, kernel_with_memory

@inner
def turned(x):
    {steps}

@kernel
def one_more(x):
    turned(x)
    turned(x)
    return x[0] + 1.0

@kernel_with_memory
def two_more(x):
    turned(x)
    turned(x)
    return x[0] + one_more(x)
""".format(steps="\n    ".join(f"x[{i}] = x[{i}] / (x[{i + 1}] + {i}.5)" for i in range(60)))


@pytest.mark.slow
def test_kernels_have_their_own_copies_of_called_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Copies are optimised with each kernel: under a common name one that sums in another order could run."""
    (tmp_path / "long_kernels.py").write_text(LONG)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")
    module = importlib.import_module("long_kernels")
    assert np.isfinite(module.two_more(np.ones(61)))
    names = [{f.name for f in kernel.overloads[kernel.signatures[0]].library.get_defined_functions()}
             for kernel in (module.one_more, module.two_more)]
    assert all(any("turned" in name for name in found) for found in names)
    assert not {name for name in names[0] & names[1] if not name.startswith("NRT_")}


WITH_MEMORY = """
import numpy as np
from ancf2d.kernels.lowlevel.jit import inner_with_memory, kernel

@inner_with_memory
def total(n):
    return np.ones((n, 2)).sum()

@kernel
def half(n):
    return total(n) / 2.0
"""


def test_a_kernel_without_allocations_may_call_one_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "kernels_with_memory.py").write_text(WITH_MEMORY)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")
    assert importlib.import_module("kernels_with_memory").half(3) == 3.0


ADDRESSED = """
from ancf2d.kernels.lowlevel.jit import addressed

@addressed
def doubled(x):
    return 2.0 * x
"""


def test_functions_for_kernels_only_refuse_calls_from_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TypeError):
        copy_rows(np.ones((2, 2)), np.zeros((2, 2)))
    (tmp_path / "addressed_kernels.py").write_text(ADDRESSED)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr("ancf2d.kernels.lowlevel.jit.CACHE", tmp_path / "cache")
    first = importlib.import_module("addressed_kernels").doubled
    for each in (first, addressed(first.py_func)):
        with pytest.raises(TypeError):
            each(1.0)
