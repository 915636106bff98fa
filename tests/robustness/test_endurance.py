"""Repeats, very many events, parallel processes, stopped commands: small versions of docs/robustness.md."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest
from instruments.endurance import events, repeats, scenes, stops

pytestmark = pytest.mark.slow


def test_runs_in_one_process_leak_nothing_and_repeat_every_bit() -> None:
    repeats.growth(15)  # what is made once, some of it late
    found = repeats.growth(20)
    assert set(found.others.values()) == {0}
    assert (found.late.files, found.late.threads) == (found.early.files, found.early.threads)
    assert found.per_run < 200_000


def test_very_many_events_neither_drift_nor_leak() -> None:
    """Errors are round-off; each event keeps less than 300 bytes, some of them in the result."""
    for motion, count in ((events.instants, 150), (events.kinks, 30), (events.conditions, 20)):
        found = motion(count)
        assert found.position < 1e-9
        assert found.rate < 1e-9
        assert found.energy < 1e-8
    events.bounces(100, "energy_momentum")  # what is made once
    conserved = events.bounces(700, "energy_momentum")
    assert conserved.energy < 1e-12
    assert conserved.left < 300


# runs that are killed: tests/results/test_results_kills.py
@pytest.mark.parametrize(("command", "after", "how"), [("run", 2.0, signal.SIGTERM), ("sweep", 2.0, signal.SIGKILL),
                                                       ("plot", 1.0, signal.SIGTERM)])
def test_a_stopped_command_leaves_complete_files_or_none(command: str, after: float, how: signal.Signals,
                                                         workshop: Path) -> None:
    _, _, faults = stops.stop(workshop, command, how, after)
    assert faults == []


@pytest.fixture(scope="module")
def workshop():  # type: ignore[no-untyped-def]
    """A folder with cases and a result."""
    with stops.workshop() as folder:
        yield folder


def test_damage_is_detected(tmp_path: Path, workshop: Path) -> None:
    for name, content in (("a.png", b"\x89PNG"), ("a.gif", b"GIF89a"), ("a.html", b"<html>"),
                          ("a.h5", b"\x89HDF"), ("a.xyz", b"")):
        (tmp_path / name).write_bytes(content)
        assert stops.damage(tmp_path / name)
    assert stops.damage(workshop / "sound.h5") == ""


def test_a_read_only_folder_is_reported(tmp_path: Path) -> None:
    import os
    import shutil

    prefix: list[str] = []
    if os.geteuid() == 0:  # to root, every folder is open, unless that right is given up
        if shutil.which("setpriv") is None:
            pytest.skip("root writes into every folder, and there is no setpriv to give that up")
        prefix = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override"]
    path = scenes.write(tmp_path, "case", scenes.case({"type": "linear_static"}))
    shut = tmp_path / "shut"
    shut.mkdir(mode=0o555)
    if subprocess.run([*prefix, "touch", str(shut / "x")], capture_output=True).returncode == 0:
        pytest.skip("this folder can be written to whatever its mode")
    code, err = scenes.finished(scenes.start(shut, "run", str(path), prefix=prefix))
    assert code == 2
    assert "no permission to write in" in err
    assert list(shut.iterdir()) == []


def test_reports_are_tables() -> None:
    report = repeats.growth_report(3)
    assert report.startswith("| held by the process | after 0 runs | after 3 |\n| --- | --- | --- |\n| memory | ")
    assert "Runs whose results differ in any bit from the first of their kind: static 0, eigen 0, dynamic 0." in report
