"""Kernels that several processes need at once are compiled by one of them."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jobs import BEAM, compile_alone

import ancf2d
from ancf2d.case import load_case_text
from ancf2d.elements.formulations import FORMULATIONS
from ancf2d.elements.registry import ELEMENTS
from ancf2d.errors import CaseError
from ancf2d.kernels.lowlevel import jit
from ancf2d.study import warmup
from ancf2d.study.every_kernel import MEMORY, STATIC, STIFF, cases_of_every_kind
from ancf2d.study.pool import Workers, run_jobs
from ancf2d.study.run import prepare, vocabulary
from ancf2d.study.warmup import _compile_lock, _locked, kernels_of

ROOT = Path(__file__).resolve().parents[2]

CASE = BEAM.replace("linear_static", "static")


def kernels(*overrides: str) -> str:
    return kernels_of(load_case_text(CASE, overrides=overrides, vocabulary=vocabulary()).data)


def test_kernels_depend_on_words_of_a_case_and_not_on_numbers() -> None:
    one = kernels()
    assert one == kernels("bodies.beam.element.count=32", "loads.tip.value=[3, 1e7]", "title=Another",
                          "bodies.beam.section.EI=5")
    others = [kernels(o) for o in ("bodies.beam.element.type=reissner2", "solver={type: linear_static}",
                                   "bodies.beam.element.formulation=green", "solver={type: dynamic, t_end: 1, dt: 0.1}",
                                   "solver={type: dynamic, t_end: 1, tolerance: 0.1}", "loads.tip.type=follower_force")]
    assert len({one, *others}) == 1 + len(others)


@pytest.mark.slow
def test_no_two_processes_compile_at_the_same_time(tmp_path: Path) -> None:
    """Even different kernels: the index of a function's kernels is one file."""
    spans = run_jobs(compile_alone, [(str(tmp_path), "a"), (str(tmp_path), "b")], Workers(2), lambda job: (0.0, 0.0))
    (first, end), (second, _) = sorted(spans)
    assert 0.0 < first < end <= second


def test_compiled_kernels_are_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "STOPPED_AFTER", 0.2)
    with _compile_lock(tmp_path, "kernels"):
        pass
    lock = os.open(tmp_path / "lock", os.O_RDWR)
    fcntl.flock(lock, fcntl.LOCK_EX)
    told = list[str]()
    with _compile_lock(tmp_path, "kernels", told.append), _compile_lock(None, "others", told.append):
        assert told == []  # who waits says so in the end
    os.close(lock)


def test_failed_compilations_are_not_recorded(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), _compile_lock(tmp_path, "kernels"):
        raise ZeroDivisionError
    assert [p.name for p in tmp_path.iterdir()] == ["lock"]


def test_a_cache_that_cannot_be_locked_is_used_without_a_lock(tmp_path: Path) -> None:
    with _compile_lock(tmp_path / "none", "kernels"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_stopped_process_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "STOPPED_AFTER", 0.2)
    lock, told = os.open(tmp_path / "lock", os.O_RDWR | os.O_CREAT), list[str]()
    fcntl.flock(lock, fcntl.LOCK_EX)
    with _compile_lock(tmp_path, "kernels", told.append):
        assert len(told) == 1
        assert "has stopped" in told[0]
    os.close(lock)


def test_a_process_that_compiles_for_long_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "STOPPED_AFTER", 5.0)
    monkeypatch.setattr(warmup, "BEAT", 0.05)
    ended, told, had = threading.Event(), list[str](), list[bool]()

    def other() -> None:
        with _locked(tmp_path / "lock", told.append):
            had.append(ended.is_set())
    with _locked(tmp_path / "lock", told.append):
        sign = (tmp_path / "lock").stat().st_mtime_ns
        thread = threading.Thread(target=other)
        thread.start()
        until = time.monotonic() + 30.0
        while (tmp_path / "lock").stat().st_mtime_ns == sign and time.monotonic() < until:
            time.sleep(0.02)
        assert (tmp_path / "lock").stat().st_mtime_ns > sign
        ended.set()
    thread.join(30.0)
    assert (had, told) == ([True], [])


def test_records_of_compiled_kernels_do_not_accumulate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warmup, "MOST_NAMES", 100)
    for k in range(50):
        with _compile_lock(tmp_path, f"{k:016x}"):
            pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["compiled", "lock"]
    assert 0 < (tmp_path / "compiled").stat().st_size < 200
    assert warmup._is_compiled(tmp_path, f"{49:016x}")


def test_the_reason_for_repeated_compilation_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "CACHE", None)
    monkeypatch.setattr(jit, "REFUSED", "'/here' belongs to another user")
    monkeypatch.setattr(warmup, "PATIENCE", 0.0)
    monkeypatch.setattr(warmup, "_READY", set())
    told = threading.Event()
    texts: list[str] = []
    monkeypatch.setattr(warmup, "_touch", lambda *_: told.wait(30.0))
    model = prepare(load_case_text(CASE, vocabulary=vocabulary()))
    warmup.warm_up(model, lambda text: (texts.append(text), told.set()))
    assert texts == ["compiling kernels, which cannot be cached for the next run: '/here' belongs to another user"]


@pytest.mark.parametrize("missed", [False, True])
def test_only_compilation_is_reported(monkeypatch: pytest.MonkeyPatch, missed: bool) -> None:
    """Reading kernels may take long on a busy machine, too."""
    monkeypatch.setattr(jit, "cache_is_cold", lambda: False)
    monkeypatch.setattr(jit, "CACHE", "somewhere")
    monkeypatch.setattr(jit, "REFUSED", "")
    monkeypatch.setattr(warmup, "PATIENCE", 0.0)
    monkeypatch.setattr(warmup, "_READY", set())
    monkeypatch.setattr(warmup, "_is_compiled", lambda cache, kernels: True)
    told, texts = threading.Event(), list[str]()

    def touch(*_: object) -> None:
        jit._MISSED[0] = int(missed)
        told.wait(30.0 if missed else 0.3)
    monkeypatch.setattr(warmup, "_touch", touch)
    model = prepare(load_case_text(CASE, vocabulary=vocabulary()))
    warmup.warm_up(model, lambda text: (texts.append(text), told.set()))
    assert texts == (["compiling kernels for this machine (first run of this kind only) ..."] if missed else [])


def test_kernels_of_a_kind_of_case_are_prepared_once_per_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Later cases of the kind cost nothing; other numbers are the same kind, another element is not."""
    touched: list[str] = []
    monkeypatch.setattr(warmup, "_READY", set())
    monkeypatch.setattr(warmup, "_touch", lambda model, cold: touched.append(next(iter(model.meshes))))
    for text in (CASE, CASE, CASE.replace("count: 2", "count: 4"), CASE.replace("cable", "reissner2")):
        warmup.warm_up(prepare(load_case_text(text, vocabulary=vocabulary())))
    assert len(touched) == 2


def test_a_motion_with_prepared_kernels_is_the_same_bit_for_bit(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """A strip slides over a floor: the preparation leaves no anchor of friction behind."""
    quick = {"bodies.strip.element.count": 2, "solver.dt": 0.01, "solver.t_end": 0.1}
    monkeypatch.setattr(warmup, "_READY", set())
    one, other = (ancf2d.solve(ROOT / "cases/contact/sliding_strip.yaml", quick) for _ in range(2))
    for quantity, values in one.course["end"].items():
        np.testing.assert_array_equal(values, other.course["end"][quantity])
    assert one.summary["energy"] == other.summary["energy"]


def test_every_law_that_a_formulation_accepts_is_compiled_ahead() -> None:
    """A material with memory or of large strains is in a case of each formulation that accepts it."""
    def laws(case: dict[str, Any]) -> set[tuple[str, str]]:
        return {(body["element"]["formulation"], kind) for body in case.get("bodies", {}).values()
                if "formulation" in body["element"]
                for kind, keys in MEMORY.items() if keys.items() <= body.get("material", {}).items()}

    def accepted(case: dict[str, Any]) -> bool:
        try:
            prepare(load_case_text(json.dumps(case), vocabulary=vocabulary()))
        except CaseError:
            return False
        return True
    cases = [json.loads(text) for name, text, _ in cases_of_every_kind() if " that " in name]
    one = next(case for case in cases if laws(case))
    wanted = set()
    for name, formulation in FORMULATIONS.items():
        element = next(t.name for t in ELEMENTS.values() if formulation.refuse(t) is None)
        for kind, keys in MEMORY.items():
            body = {**one["bodies"]["a"], "element": {"type": element, "formulation": name, "count": 2},
                    "material": {**STIFF, **keys}}
            solver = {"type": "quasi_static", "t_end": 1.0} if kind == "relaxes" else STATIC
            wanted |= {(name, kind)} if accepted({**one, "bodies": {"a": body}, "solver": solver}) else set()
    assert {law for case in cases for law in laws(case)} == wanted
    assert {kind for _, kind in wanted} == set(MEMORY)
    assert all(accepted(case) for case in cases if laws(case))
