"""Compilation before timing: the first run of a kind of model compiles its kernels, and reports it."""

from __future__ import annotations

import gc
import hashlib
import json
import logging
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..case import Dynamic
from ..case.emit import written
from ..errors import Ancf2dError
from ..model.model import Model
from ..processors import spread

try:
    import fcntl
except ImportError:  # without file locks, processes that compile at the same time do the work twice
    fcntl = None  # type: ignore[assignment]

# seconds of compiling before it is reported
PATIENCE = 1.5
# the file in the cache that lists what was compiled, and the size in bytes (some thousand names) at which it is emptied
NAMES, MOST_NAMES = "compiled", 1 << 16
# a compiling process touches the lock file every BEAT seconds; without that for STOPPED_AFTER seconds, it has stopped
BEAT, STOPPED_AFTER, TICK = 0.5, 5.0, 0.05
# number of objects that are frozen already: Python 3.12 starts with some
FROZEN = gc.get_freeze_count()
# share of a motion that is computed to compile its kernels
MOMENT = 1e-6
# names of the kernels that this process has used: another case of the same kind needs no new ones
_READY: set[str] = set()
# thresholds of the garbage collector while kernels are compiled
SELDOM = (100_000, 50, 1000)


def warm_up(model: Model, compiling: Callable[[str], None] = lambda text: None, kernels: str = "") -> None:
    """Compile (or load from the cache) the kernels that a model's solve will call, on empty work.

    Compiling, here or in a process that this one waits for, is reported to ``compiling`` and the logger "ancf2d": at
    once if the cache is empty, else after 1.5 s. If several processes need the same kernels, one compiles them and the
    others wait. Nothing is done if this process has solved a case of the same kind before. ``kernels`` is the name of
    the kernels by ``kernels_of``, if known.
    """
    from ..kernels.lowlevel.jit import CACHE, REFUSED, expect_kernels

    loaded = model.loaded
    kernels = kernels or kernels_of(loaded.data if loaded is not None and loaded.case is model.case
                                    else written(model.case))
    if kernels in _READY:
        return
    what = f"compiling kernels, which cannot be cached for the next run: {REFUSED}" if REFUSED else (
        "compiling kernels for this machine (first run of this kind only) ...")
    expect_kernels()
    begun, ended = threading.Event(), threading.Event()
    threading.Thread(target=_announce, args=(what, compiling, begun, ended), daemon=True).start()
    try:
        with _compile_lock(CACHE, kernels, compiling) as new, seldom_collected():
            begun.set()
            if isinstance(model.case.solver, Dynamic):
                _touch_motion(model, model.case.solver, new)
            else:
                _touch(model, new)
        _READY.add(kernels)
    finally:
        ended.set()


def _announce(what: str, compiling: Callable[[str], None], begun: threading.Event, ended: threading.Event) -> None:
    """Report ``what`` if compiling, or waiting for another process, takes long."""
    from ..kernels.lowlevel.jit import cache_is_cold, missed

    cold, since = cache_is_cold(), math.inf
    while not ended.wait(0.0 if cold else TICK):
        if missed() or not begun.is_set():
            since = min(since, time.monotonic())
        if cold or time.monotonic() - since > PATIENCE:
            logging.getLogger("ancf2d").info(what)
            compiling(what)
            return


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Collect garbage rarely: compiling makes little of it, and looking for it takes a tenth of the time."""
    before = gc.get_threshold()
    gc.set_threshold(*SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def objects_frozen() -> Iterator[None]:
    """Collect no garbage among the objects that exist already: looking through them takes a tenth of small runs."""
    outermost = gc.get_freeze_count() <= FROZEN
    gc.freeze()
    try:
        yield
    finally:
        if outermost:
            gc.unfreeze()


def kernels_of(data: dict[str, Any]) -> str:
    """Return a name for the kernels that a case, as plain data, needs: its words select them, its numbers do not."""
    return hashlib.sha256(json.dumps(_words(data)).encode()).hexdigest()[:16]


def _words(data: Any) -> Any:
    if isinstance(data, dict):
        return {name: _words(value) for name, value in data.items() if name not in ("title", "units")}
    if isinstance(data, list):
        return [_words(value) for value in data]
    return data if isinstance(data, str | bool) else 0


@contextmanager
def _compile_lock(cache: Path | None, kernels: str,
                  report: Callable[[str], None] = lambda text: None) -> Iterator[bool]:
    """Keep other processes from compiling at the same time, unless these kernels were compiled before.

    Yields whether the kernels still have to be compiled into the cache.
    """
    if cache is None or fcntl is None or _is_compiled(cache, kernels):
        yield False
        return
    with ExitStack() as lock:
        lock.enter_context(_locked(cache / "lock", report))
        new = not _is_compiled(cache, kernels)
        if not new:
            # another process has compiled them meanwhile; reading them needs no lock
            lock.close()
        yield new
        _note_compiled(cache, kernels)


def _is_compiled(cache: Path, kernels: str) -> bool:
    try:
        return kernels in (cache / NAMES).read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return False


def _note_compiled(cache: Path, kernels: str) -> None:
    with suppress(OSError), (cache / NAMES).open("a", encoding="ascii") as stream:
        if stream.tell() > MOST_NAMES:
            stream.truncate(0)
        stream.write(f"{kernels}\n")


@contextmanager
def _locked(path: Path, report: Callable[[str], None]) -> Iterator[None]:
    """Hold a lock; continue without it if it cannot be obtained: at worst the same work is done twice."""
    descriptor, ended = None, threading.Event()
    try:
        with suppress(OSError):
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
            if _acquire(descriptor):
                threading.Thread(target=_keep_alive, args=(path, ended), daemon=True).start()
            else:
                report("another process that was compiling kernels has stopped; continuing without it")
        yield
    finally:
        ended.set()
        if descriptor is not None:
            with suppress(OSError):
                fcntl.flock(descriptor, fcntl.LOCK_UN)
            os.close(descriptor)


def _acquire(descriptor: int) -> bool:
    """Wait for a lock; return False if the process that holds it shows no sign of life."""
    seen, since = 0, time.monotonic()
    while True:
        with suppress(BlockingIOError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        # the file may be stamped by another machine's clock, so only changes of the time count
        sign = os.fstat(descriptor).st_mtime_ns
        if sign != seen:
            seen, since = sign, time.monotonic()
        elif time.monotonic() - since > STOPPED_AFTER:
            return False
        time.sleep(TICK)


def _keep_alive(path: Path, ended: threading.Event) -> None:
    while not ended.wait(BEAT):
        with suppress(OSError):
            os.utime(path)


def _touch(model: Model, new: bool) -> None:
    """Call the kernels of a static or modal solve on empty work; if ``new``, first compile them on all processors."""
    from ..solvers.linear import make_matrix

    matrix = make_matrix(model, model.numbering.in_reference)
    touched: list[Callable[[], object]] = [*_drivers(model, matrix), partial(_touch_matrix, type(matrix))]
    if new:
        from ..model.point_tables import interaction_compilations
        from ..solvers.motion.problem import element_compilations, empty_problem

        laws = interaction_compilations(model, False, empty_problem().layout)
        spread([*laws[:1], *element_compilations(model), *laws[1:], *touched])
    _ = model.groups
    for each in touched:
        each()


def _drivers(model: Model, matrix: Any) -> list[Callable[[], object]]:
    """Return calls, on empty work, of the kernels that loop over elements and patches."""
    from ..kernels.batch import no_group
    from ..kernels.elements import force, force_noise, force_tangent, natural_slope, tangent_action
    from ..kernels.lowlevel.records import Record
    from ..kernels.matrices.matrix import scatter_patches

    solver, num, none, out = model.case.solver, model.numbering, Record(no_group()), list[Callable[[], object]]()
    places, no_index = num.places, np.zeros(0, dtype=np.int64)
    d = np.zeros(len(num.place))
    if not all(mesh.plan.rigid for mesh in model.meshes.values()):
        out.append(partial(force_tangent, none, d, 1.0, d, matrix.target, places))
        if not model.case.solver.linear:
            out += [partial(force_noise, none, d, d), partial(force, none, d, d)]
        if model.moves or solver.linear or solver.vibrates or solver.scales:
            out.append(partial(tangent_action, none, d, d, d))
        if model.loads.natural:
            out.append(partial(natural_slope, none, d, d))
    if model.patches or model.constraints:
        out.append(lambda: list(model.interactions.patches(d, 0.0)))
        out.append(partial(scatter_patches, matrix.target, np.zeros((0, 1, 1)), no_index.reshape(0, 1), 0, 0, places))
    if model.hangs or solver.vibrates or solver.scales:
        from ..kernels.matrices.matrix import scatter_classes
        from ..solvers.linear import matrix_of_one

        small = matrix_of_one(type(matrix))
        out += [partial(scatter_classes, matrix.target, np.zeros((1, 1, 1)), no_index, no_index.reshape(0, 1), places),
                partial(small.product, small.values, np.zeros(1))]
    return out


def _touch_motion(model: Model, spec: Dynamic, new: bool) -> None:
    """Solve the first moment of a motion; problems of the case are left for the run itself to report."""
    from ..model.point_tables import interaction_compilations
    from ..solvers.contact import memory, restore_memory
    from ..solvers.motion.integrators import INTEGRATORS, default_method
    from ..solvers.motion.problem import empty_problem, motion_compilations
    from ..solvers.registry import SOLVERS

    if new:
        conserves = INTEGRATORS[spec.method or default_method(model)].conserves
        laws = interaction_compilations(model, conserves, empty_problem().layout)
        spread([*laws[:1], *motion_compilations(model, spec), *laws[1:]])
    _ = model.groups
    moment, contacts = MOMENT * spec.t_end, memory(model)
    with suppress(Ancf2dError):
        for _ in SOLVERS[Dynamic](model, replace(spec, t_end=moment, dt=None if spec.dt is None else moment)):
            pass
    # restore the contact memory: friction holds nothing when the run starts
    restore_memory(model, contacts)


def _touch_matrix(kind: type) -> None:
    """Factor and solve with a matrix of one unknown, which also imports the library for it."""
    from ..solvers.linear import matrix_of_one

    small = matrix_of_one(kind)
    small.values.fill(1.0)
    small.factor()
    small.solve(np.ones(1))
