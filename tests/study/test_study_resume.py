"""Interrupted and resumed motions: states, probes and summary are those of an uninterrupted one."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.errors import CheckpointError, ComputationError, ResultsError
from ancf2d.model.model import Model
from ancf2d.results import compare_results, open_results, part_path, read_checkpoint
from ancf2d.results import writer as writer_module
from ancf2d.solvers import registry
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import Run
from ancf2d.solvers.state import State
from ancf2d.solvers.statics.quasi_static import Course
from ancf2d.study.record import Progress
from ancf2d.study.run import prepare, run_case, vocabulary

CASE = """\
format: 1
title: Beam that is moved about
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3, rhoA: 1, rhoI: 0.1}
    element: {type: cable, count: 2}
boundary_conditions:
  - {name: root, type: clamp, at: beam@0}
solver: {type: dynamic, t_end: 3, dt: 0.01}
output:
  probes:
    tip: beam@1
expected:
  - {probe: tip, quantity: theta, value: 15, atol: 1}
  - {probe: tip, quantity: theta, mean_over: [0, 3], value: 7.5, atol: 1}
"""
STATES = 30
SOLVE = registry.solve


def turning(model: Model, resume: dict[str, np.ndarray] | None = None, stop: int = STATES,
            how: type[BaseException] = KeyboardInterrupt) -> Iterator[State]:
    """Rotate all sections by 0.5 rad per state, with intermediate numbers that depend on every earlier bit."""
    first, x = (0, 0.3) if resume is None else (int(resume["k"]) + 1, float(resume["x"]))
    worst = 0.0 if resume is None else float(resume["worst"])
    for k in range(first, STATES + 1):
        if k == stop:
            raise how
        n = k % 3 + 1 if k else 0
        for _ in range(n):
            x = 3.9 * x * (1 - x)
        worst = max(worst, x)
        d, zero = np.zeros(len(model.numbering.place)), np.zeros(len(model.numbering.place))
        r_x = model.e0[2::4] == 1.0
        d[2:model.n_q:4], d[3:model.n_q:4] = (np.cos(0.5 * k) - 1) * r_x, np.sin(0.5 * k) * r_x
        d[8] = x
        t = 3.0 * k / STATES
        blocks = {"step": np.arange(n), "t": t - np.arange(n)[::-1] * 0.1 / max(n, 1),
                  "dt": np.full(n, 0.1 / max(n, 1)), "iterations": np.full(n, 2), "rejected": np.arange(n) % 2,
                  "error": np.full(n, x)}
        yield State(t, d, zero, zero, x, v=zero, a=zero, blocks=blocks, history={"kinetic": x, "strain": 1 - x},
                    report={**({"passed": [t]} if k == STATES // 2 else {}), "energy_drift": worst,
                            "momentum": {"linear": [x, 0.0], "angular": x}},
                    warnings=["half of it"] if k == STATES // 2 else [],
                    turned=np.full(len(model.meshes), 0.5 * k),
                    checkpoint={"k": np.array(k), "x": np.array(x), "worst": np.array(worst)})


@pytest.fixture
def loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LoadedCase:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 0.0)
    return load_case_text(CASE, vocabulary=vocabulary())


def run(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase, out: str, stop: int = STATES + 1, *, resume: bool = False,
        how: type[BaseException] = KeyboardInterrupt) -> tuple[dict[str, Any], list[str]]:
    """Return the summary of a run (empty if interrupted) and its remarks."""
    notes: list[str] = []
    monkeypatch.setattr(registry, "solve", lambda model, start=None: turning(model, start, stop, how))
    try:
        return run_case(loaded, out, resume=resume, progress=Progress(note=notes.append)).summary, notes
    except KeyboardInterrupt:
        return {}, notes


def test_a_resumed_run_has_the_same_file_and_summary(monkeypatch: pytest.MonkeyPatch,
                                                     loaded: LoadedCase) -> None:
    whole, _ = run(monkeypatch, loaded, "whole.h5")
    assert whole["status"] == "converged"
    for k, stop in enumerate((8, 9, 21)):
        found, notes = run(monkeypatch, loaded, "a.h5", stop, resume=k > 0)
        assert not found
        assert k == 0 or "resuming 'a.h5.part' at t = " in notes[0]
        left = read_checkpoint(part_path("a.h5"))
        assert left is not None
        assert left.t == pytest.approx(0.1 * (stop - 1))
    found, _ = run(monkeypatch, loaded, "a.h5", resume=True)
    for own in ("wall_s", "output"):
        whole.pop(own), found.pop(own)
    assert found == whole
    assert not compare_results("a.h5", "whole.h5", rtol=0, everything=True)
    with open_results("a.h5") as a, open_results("whole.h5") as b:
        assert a.attrs["resumed"] == 3
        assert a.nt == b.nt == STATES + 1
        for i in range(a.nt):
            assert a.d(i).tobytes() == b.d(i).tobytes()
        for name in b.history:
            assert a.history[name].tobytes() == b.history[name].tobytes()


def test_summary_of_a_motion(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase) -> None:
    found, _ = run(monkeypatch, loaded, "a.h5")
    steps = sum(k % 3 + 1 for k in range(1, STATES + 1))
    assert found["t"] == 3.0
    assert "load_factor" not in found
    assert (found["steps"], found["iterations"]) == (steps, 2 * steps)
    assert found["rejected"] == STATES * 2 // 3  # one in blocks of two and in blocks of three
    assert found["dt"] == pytest.approx([0.1 / 3, 0.1])
    assert set(found["energy"]) == {"kinetic", "strain"}
    assert found["energy_drift"] < 1
    # states that no forces lead to are none that a mesh could follow, which is said as well
    assert found["warnings"][0] == "half of it"
    assert found["probes"]["tip"]["theta"] == pytest.approx(15)
    assert found["checks"][0]["met"]
    with open_results("a.h5") as r:
        assert r.history.rows == steps
        assert r.energies.rows == len(r.probe_t) == r.nt == STATES + 1
        np.testing.assert_allclose(r.probes["tip"]["theta"], 0.5 * np.arange(STATES + 1), atol=1e-12)


def test_a_run_killed_after_its_last_state_computes_it_again(monkeypatch: pytest.MonkeyPatch,
                                                             loaded: LoadedCase) -> None:
    """The last state has no checkpoint: the resumed run needs a state to end with."""
    def dies(*args: Any) -> None:
        raise KeyboardInterrupt
    with monkeypatch.context() as patch:
        patch.setattr("ancf2d.study.run.summarise", dies)
        assert not run(monkeypatch, loaded, "a.h5")[0]
    with open_results("a.h5.part") as r:
        assert r.t[-1] == 3.0
    found, _ = run(monkeypatch, loaded, "a.h5", resume=True)
    assert found["t"] == 3.0
    run(monkeypatch, loaded, "b.h5")
    assert not compare_results("a.h5", "b.h5", rtol=0, everything=True)


def test_without_anything_to_resume_a_run_starts_afresh(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase) -> None:
    found, notes = run(monkeypatch, loaded, "a.h5", resume=True)
    assert found["t"] == 3.0
    assert notes == ["there is no unfinished 'a.h5.part': starting from the beginning"]
    text = CASE.replace("dynamic, t_end: 3, dt: 0.01", "linear_static").replace(" mean_over: [0, 3],", "")
    static = load_case_text(text, vocabulary=vocabulary())
    monkeypatch.undo()
    notes = []
    outcome = run_case(static, resume=True, progress=Progress(note=notes.append))
    assert outcome.summary["status"] == "converged"


def test_a_changed_case_is_refused_and_the_states_stay(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase) -> None:
    run(monkeypatch, loaded, "a.h5", 9)
    other = load_case_text(CASE.replace("EI: 1.0e3", "EI: 1.1e3"), vocabulary=vocabulary())
    with pytest.raises(ResultsError, match="the case has changed since then"):
        run(monkeypatch, other, "a.h5", resume=True)
    with open_results("a.h5.part") as r:
        assert r.nt == 9


def test_a_checkpoint_of_other_values_is_refused_by_name(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase,
                                                         tmp_path: Path) -> None:
    """From another version of the solver; without a file, as in sweeps, the run starts afresh."""
    run(monkeypatch, loaded, "a.h5", 9)
    monkeypatch.setattr(registry, "solve", SOLVE)
    with pytest.raises(ResultsError, match=r"'a\.h5\.part': its checkpoint was made by another version of the solver "
                                           r"\('a' is missing\); run the case without --resume"):
        run_case(loaded, "a.h5", resume=True)
    assert read_checkpoint("a.h5.part") is not None
    shutil.copy("a.h5.part", "kept")
    assert run_case(loaded, checkpoints=tmp_path / "kept").summary["t"] == 3.0
    assert not Path("kept").exists()


@pytest.mark.slow_rows("dynamic, t_end: 3, dt: 0.01, method: hht")
@pytest.mark.parametrize("solver", ["dynamic, t_end: 3, dt: 0.01, method: hht", "quasi_static, t_end: 3"])
def test_every_array_of_a_checkpoint_must_fit(solver: str) -> None:
    """Arrays with rows that numpy would broadcast, or too many, are refused; initially empty ones may have grown."""
    text = CASE.replace("dynamic, t_end: 3, dt: 0.01", solver).replace(" mean_over: [0, 3],", "")
    model = prepare(load_case_text(text, vocabulary=vocabulary()))
    kind = Run if solver.startswith("dynamic") else Course
    fresh = kind(model, model.case.solver).checkpoint()
    registry.solve(model, fresh)
    grown = {name: np.ones((3, *x.shape[1:])) for name, x in fresh.items() if x.shape[:1] == (0,)}
    registry.solve(model, {**fresh, **grown})
    assert "log" in grown or "path" in grown
    if "extra" in fresh:
        with pytest.raises(CheckpointError, match="'extra' has shape"):
            registry.solve(model, {**fresh, "extra": fresh["extra"][:1]})
    for name, x in fresh.items():
        if x.dtype != np.uint8:
            # an axis more, and a row or column more, unless rows are what may grow
            for shape in {(1, *x.shape), (*x.shape[:-1], x.shape[-1] + (x.shape != (0,)))} - {x.shape}:
                with pytest.raises(CheckpointError, match=f"'{name}' has shape"):
                    registry.solve(model, {**fresh, name: np.zeros(shape)})
        with pytest.raises(CheckpointError, match=f"'{name}' is missing"):
            registry.solve(model, {k: v for k, v in fresh.items() if k != name})
    with pytest.raises(CheckpointError, match="'more' is unknown"):
        registry.solve(model, {**fresh, "more": np.zeros(1)})


ELEMENT = "name: mine\nbasis: ['1', 'x', 'x^2', 'x^3']\nnodes: [{at: 0, coordinates: [r, r_x]}, " \
          "{at: 1, coordinates: [r, r_x]}]\n"
HELD = {"element.yaml": ("element: {type: cable, count: 2}", "element: {definition: element.yaml, count: 2}"),
        "start.h5": ("output:", "initial: {from: start.h5}\noutput:")}


@pytest.mark.slow
@pytest.mark.parametrize("file", ["element.yaml", "start.h5"])
def test_a_case_that_reads_a_changed_file_is_not_resumed(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase,
                                                         tmp_path: Path, file: str) -> None:
    """States before and after would belong to two models."""
    run(monkeypatch, loaded, "start.h5")
    (tmp_path / "element.yaml").write_text(ELEMENT)

    def other() -> LoadedCase:
        # nothing may hold what starts turned by 15 rad
        text = CASE.replace("boundary_conditions:\n  - {name: root, type: clamp, at: beam@0}\n", "")
        return load_case_text(text.replace(*HELD[file]), vocabulary=vocabulary())
    run(monkeypatch, other(), "a.h5", 9)
    run(monkeypatch, other(), "a.h5", 12, resume=True)
    before = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(before + (b"quadrature: [6, 1]\n" if file == "element.yaml" else b"\0"))
    with pytest.raises(ResultsError, match="a file that the case reads has changed since then"):
        run(monkeypatch, other(), "a.h5", resume=True)
    (tmp_path / file).write_bytes(before)
    assert run(monkeypatch, other(), "a.h5", resume=True)[0]["t"] == 3.0


def test_a_failed_run_says_how_far_it_got(monkeypatch: pytest.MonkeyPatch, loaded: LoadedCase) -> None:
    class GaveUpError(ComputationError):
        def __init__(self) -> None:
            super().__init__("the motion cannot go on", at={"t": 1.0})
    found, _ = run(monkeypatch, loaded, "a.h5", 11, how=GaveUpError)
    assert (found["status"], found["reason"]) == ("failed", "the motion cannot go on")
    assert found["t"] == pytest.approx(1.0)
    again, _ = run(monkeypatch, loaded, "a.h5", 11, how=GaveUpError, resume=True)
    assert again["status"] == "failed"
    assert read_checkpoint("a.h5.part") is not None


PENDULUM = """\
format: 1
title: Pendulum with a spring and a damper at its hinge
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {EA: 1.0e4, kGA: 3.0e3, EI: 5, rhoA: 0.4, rhoI: 1.0e-4}
    element: {type: cable, count: 3}
boundary_conditions:
  - {name: hinge, type: pin, at: rod@0}
springs:
  - {type: rotational, between: [rod@0, [0, 0]], stiffness: 0.5, damping: 0.01}
loads:
  - {type: gravity, value: [0, -9.81]}
initial: {rotation_rate: {omega: 0.5, about: [0, 0]}}
solver: {type: dynamic, t_end: 0.4, dt: 2.0e-3}
output:
  interval: 0.01
  probes:
    tip: rod@1
"""


# the estimate of fixed steps is largest on the way, by coarser motions that are ahead at a checkpoint
@pytest.mark.parametrize(("solver", "stored"), [
    ("t_end: 0.8, dt: 4.0e-3", "interval: 0.04"),
    *(pytest.param(f"t_end: {end}, {solver}", stored, marks=pytest.mark.slow) for end, solver, stored in [
        (0.4, "tolerance: 1e-5", "interval: 0.01"), (0.4, "tolerance: 1e-5", "every: 5"),
        (0.4, "dt: 2.0e-3, method: generalized_alpha", "every: 5"),
        (0.4, "dt: 2.0e-3, method: energy_momentum", "interval: 0.01"),
        (0.05, "tolerance: 1e-4, method: RK45", "every: 5")])])
def test_integrators_resume_from_a_checkpoint_to_the_same_bits(monkeypatch: pytest.MonkeyPatch, solver: str,
                                                               stored: str) -> None:
    """Another process reads the checkpoint: only its arrays remain of the run."""
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)  # the solver comes back often
    text = PENDULUM.replace("t_end: 0.4, dt: 2.0e-3", solver).replace("interval: 0.01", stored)
    case = load_case_text(text, vocabulary=vocabulary())
    whole = list(registry.solve(prepare(case)))
    kept = [k for k, state in enumerate(whole) if state.checkpoint is not None]
    assert len(kept) > 2
    at = kept[1]
    assert whole[at].checkpoint is not None
    values = {name: value.copy() for name, value in whole[at].checkpoint.items()}
    rest = list(registry.solve(prepare(case), values))
    assert len(rest) == len(whole) - at - 1
    for one, two in zip(whole[at + 1:], rest, strict=True):
        assert (one.t, one.history) == (two.t, two.history)
        assert one.d.tobytes() == two.d.tobytes()
        assert one.v is not None
        assert two.v is not None
        assert one.v.tobytes() == two.v.tobytes()
        for name, column in one.blocks.items():
            assert column.tobytes() == two.blocks[name].tobytes()
    assert rest[-1].report == whole[-1].report
