"""The ends of commands: exit codes and messages."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from commandline import BEAM, start

from ancf2d.cli import main
from ancf2d.cli.app import COMMANDS
from ancf2d.results import open_results
from ancf2d.study import run as study_run

Call = Callable[..., Result]

# enough small steps that an interruption comes in the middle
LONG = BEAM.replace("count: 2", "count: 200").replace("{type: linear_static}", "{type: static, steps: 100000}")


@pytest.mark.parametrize(("arguments", "said"), [
    (["rum", "beam.yaml"], "did you mean 'run'?"),
    (["frobnicate"], "no such command 'frobnicate'; there are new, validate, run"),
    (["run"], "missing argument 'CASE'"),
    (["run", "beam.yaml", "--forse"], "no such option '--forse'; did you mean '--force'?"),
    (["run", "none.yaml"], "cannot read the file"),
    (["run", "."], "cannot read the file"),
    (["run", "beam.yaml", "-o", "no/such/folder.h5"], "the folder 'no/such' does not exist"),
    (["run", "beam.yaml", "--set", "bodies.beam.element.cuont=3"], "did you mean 'count'?"),
    (["run", "beam.yaml", "--set", "nonsense"], "not PATH=VALUE"),
    (["convergence", "beam.yaml", "--elements", "2,x"], "not a list of numbers of elements"),
    (["convergence", "beam.yaml", "--elements", "0"], "not a list of numbers of elements"),
    (["convergence", "beam.yaml", "--reference", "nan"], "neither a number nor auto"),
    (["convergence", "beam.yaml", "--jobs", "0"], "--jobs"),
    (["convergence", "beam.yaml", "--element", "cabel"], "did you mean 'cable'?"),
    (["convergence", "beam.yaml", "--element", "ancf"], "needs its orders"),
    (["convergence", "beam.yaml", "--element", "ancf[9,9]"], "outside"),
    (["convergence", "beam.yaml", "--element", "vallejo:structual"], "did you mean 'structural'?"),
    (["convergence", "beam.yaml", "--formulation", "structual"], "did you mean 'structural'?"),
    (["plot", "none.h5"], "there is no result file 'none.h5'"),
    (["plot", "shape"], "there is no result file to draw"),
    (["plot", "beam.yaml"], "is not an HDF5 file"),
    (["info", "beam.yaml"], "is not an HDF5 file"),
    (["info", "none.h5"], "there is no result file"),
    (["compare", "none.h5", "none.h5"], "there is no result file"),
    (["compare", "a.h5", "b.h5", "--rtol", "-1"], "--rtol"),
    (["compare", "a.h5", "b.h5", "--rtol", "x"], "'x' is not a number (see"),
    (["plot", "none.h5", "--fps", "3.5"], "'3.5' is not a whole number (see"),
    (["elements", "cabel"], "did you mean 'cable'?"),
    (["new", "no/such/folder"], "cannot write"),
    (["new", "x", "--kind", "bridge"], "cantilever"),
    (["schema", "--markdown", "--definition"], "exclude each other"),
], ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_wrong_command_line_or_input_is_2_with_one_sentence_on_stderr(call: Call, arguments: list[str],
                                                                      said: str) -> None:
    result = call(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert said in result.stderr
    assert result.stderr.count("error: ") == 1
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("arguments", [["run", "beam.yaml", "--json", "--bad-option"],
                                       ["run", "--bad-option", "--json"],
                                       ["sweep", "beam.yaml", "--json"], ["rum", "beam.yaml", "--json"],
                                       ["convergence", "beam.yaml", "--jobs", "0", "--json"]], ids=" ".join)
def test_wrong_command_line_is_one_json_object_wherever_json_stands(call: Call, arguments: list[str]) -> None:
    result = call(*arguments)
    found = json.loads(result.stdout)
    assert (result.exit_code, found["status"]) == (2, "failed")
    assert found["reason"].lower().rstrip(".").split(";")[0] in result.stderr.lower()


@pytest.mark.parametrize("options", [["--set", "bodies.beam.element.count=-3"], ["--set", "x"],
                                     ["--set", "loads.tip.value=3", "--set", "goal.probe=tap"]], ids=" ".join)
def test_a_wrong_option_is_shown_once(call: Call, options: list[str]) -> None:
    err = call("run", "beam.yaml", *options).stderr
    assert err.count("--set") == options.count("--set") == err.count("error: ")


def test_suggested_commands_can_be_pasted_into_a_shell(call: Call, folder: Path) -> None:
    for arguments in (["run", "beam.yaml"], ["convergence", "beam.yaml", "--elements", "1,2"]):
        told = call(*arguments, "-o", "a beam's.h5").stdout
        words = shlex.split(told.split("next: ")[1])
        assert words == ["ancf2d", "plot", "a beam's.h5"]
        assert call(*words[1:]).exit_code == 0
    told = call("new", "my bridge").stdout.split("next: ")[1]
    assert shlex.split(told)[-3:] == ["ancf2d", "run", "my bridge.yaml"]


@pytest.mark.parametrize("arguments", [["new", "x"], ["info", "beam.h5"], ["compare", "beam.h5", "beam.h5"],
                                       ["elements"], ["schema", "-o", "s.json"], ["export", "beam.h5", "t.csv"],
                                       ["plot", "beam.h5"], ["validate", "beam.yaml"], ["elements", "cable"]],
                         ids=" ".join)
def test_quiet_prints_errors_only(call: Call, arguments: list[str]) -> None:
    assert call("run", "beam.yaml", "-q").output == ""
    result = call(*arguments, "-q")
    assert (result.exit_code, result.output) == (0, "")


def test_every_command_can_be_quiet() -> None:
    assert [name for name in COMMANDS if "--quiet" not in CliRunner().invoke(main, [name, "--help"]).stdout] == []


@pytest.mark.slow
def test_caches_of_matplotlib_give_no_messages(call: Call, folder: Path) -> None:
    """If its cache is not writable, Matplotlib logs the folder it uses instead."""
    call("run", "beam.yaml", "-q")
    (folder / "file").write_text("no folder")
    environment = {**os.environ, "HOME": str(folder), "MPLCONFIGDIR": str(folder / "file")}
    found = subprocess.run([sys.executable, "-m", "ancf2d", "plot", "beam.h5"], capture_output=True, text=True,
                           cwd=folder, env=environment)
    assert (found.stdout, found.stderr) == ("wrote beam-shape.png (shape)\n", "")


def test_all_problems_of_a_case_are_printed_and_counted(call: Call, folder: Path) -> None:
    wrong = BEAM.replace("count: 2", "cont: 2").replace("at: beam@1, value", "at: bean@1, value")
    (folder / "beam.yaml").write_text(wrong)
    result = call("run", "beam.yaml")
    assert result.exit_code == 2
    assert "beam.yaml:7:28: error: unknown key 'cont'" in result.stderr
    assert "did you mean 'beam'?" in result.stderr
    assert result.stderr.rstrip().split("\n")[-1] == f"{result.stderr.count('error: ')} problems in beam.yaml"


def test_problems_outside_the_case_are_counted_separately(call: Call, folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM)
    result = call("fit", "beam.yaml", "--data", "none.csv", "--vary", "bodies.beam.material.E=1e9:1e12")
    assert result.exit_code == 2
    assert result.stderr.endswith("No such file or directory\n1 problem\n")


@pytest.mark.parametrize("command", [["run"], ["convergence"]])
def test_wrong_case_is_one_json_object_too(call: Call, folder: Path, command: list[str]) -> None:
    (folder / "beam.yaml").write_text(BEAM.replace("count: 2", "count: two"))
    result = call(*command, "beam.yaml", "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 2
    assert found["status"] == "failed"
    assert "count" in found["reason"]
    assert (found["at"]["line"], found["at"]["column"]) == (7, 35)
    assert found["problems"][0]["path"] == "bodies.beam.element.count"


def test_unexpected_exception_is_one_line_and_a_traceback_only_with_debug(call: Call,
                                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: Any, **options: Any) -> None:
        raise ZeroDivisionError("division by zero\nsecond line")
    monkeypatch.setattr(study_run, "run_case", broken)
    result = call("run", "beam.yaml")
    assert result.exit_code == 1
    assert result.stderr == ("internal error, please report: ZeroDivisionError: division by zero (--debug shows "
                             "where)\n")
    debug = call("run", "beam.yaml", "--debug", "--json")
    assert "Traceback" in debug.stderr
    assert json.loads(debug.stdout)["status"] == "failed"
    assert "Traceback" in call("--debug", "run", "beam.yaml").stderr


def test_lack_of_memory_is_not_an_internal_error(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: Any, **options: Any) -> None:
        raise MemoryError
    monkeypatch.setattr(study_run, "run_case", broken)
    result = call("run", "beam.yaml")
    assert (result.exit_code, result.stderr) == (1, "error: there is not enough memory for this\n")


def test_warnings_of_libraries_are_silent_unless_debugging(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def noisy(*args: Any, **options: Any) -> None:
        import warnings

        warnings.warn("overflow somewhere", RuntimeWarning, stacklevel=1)
        raise KeyboardInterrupt
    monkeypatch.setattr(study_run, "run_case", noisy)
    result = call("run", "beam.yaml")
    assert result.exit_code == 130
    assert "overflow" not in result.stderr


def test_interrupted_while_the_command_is_imported() -> None:
    """The process ends with 130 and a message, not by the signal or with a traceback."""
    code = """if True:
        import sys
        class Interrupted:
            def find_spec(self, name, path, target=None):
                if name == "click":
                    raise KeyboardInterrupt
        sys.meta_path.insert(0, Interrupted())
        from ancf2d.cli import main
    """
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stderr) == (130, "interrupted\n")


@pytest.mark.slow
def test_interrupted_run_keeps_its_states_and_ends_with_130(folder: Path) -> None:
    (folder / "beam.yaml").write_text(LONG)
    process = start(["run", "beam.yaml", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder)
    part = folder / "beam.h5.part"
    _wait_until(lambda: part.exists() and part.stat().st_size > 100_000, process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert json.loads(out)["status"] == "interrupted"
    assert "interrupted" in err
    assert "the results so far are in beam.h5.part" in err
    assert "Traceback" not in err
    assert not (folder / "beam.h5").exists()
    with open_results(part) as found:
        assert 0 < found.t[-1] < 1
        assert found.status == "interrupted"


@pytest.mark.slow
def test_interrupted_study_with_processes_ends_at_once_and_leaves_none_behind(folder: Path) -> None:
    (folder / "beam.yaml").write_text(LONG)
    process = start(["convergence", "beam.yaml", "--jobs", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                    cwd=folder, start_new_session=True)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        pytest.skip("this system does not list the children of a process")
    _wait_until(lambda: len(children.read_text().split()) >= 3, process)
    pids = children.read_text().split()
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in err
    for _ in range(100):
        if not any(_alive(pid) for pid in pids):
            return
        time.sleep(0.05)
    raise AssertionError("processes are left behind")


def _alive(pid: str) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "Z (zombie)" not in status.read_text()


def _wait_until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    for _ in range(600):
        if condition():
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    process.kill()
    raise AssertionError("nothing happened in 30 seconds")


def unread(arguments: Sequence[str], folder: Path) -> tuple[int, str]:
    """Return the exit code and stderr of a command with nobody reading its stdout."""
    process = start(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr:
        err = process.stderr.read()
    return process.wait(timeout=60), err


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["--help"], ["schema"], ["elements"]], ids=" ".join)
def test_a_closed_pipe_gives_no_message(folder: Path, arguments: list[str]) -> None:
    assert unread(arguments, folder) == (0, "")


@pytest.mark.slow
def test_a_closed_pipe_does_not_change_the_exit_code(call: Call, folder: Path) -> None:
    """A case that misses its expected values still fails if nobody reads stdout."""
    wrong = ["run", "beam.yaml", "--check", "--set", "expected.0.value=1"]
    assert unread(wrong, folder) == (1, "error: 1 expected value not met\n")
    assert (folder / "beam.h5").exists()


@pytest.mark.slow
def test_a_closed_pipe_gets_no_json_of_a_failure(folder: Path) -> None:
    code, err = unread(["run", "none.yaml", "--json"], folder)
    assert code == 2
    assert err.endswith("1 problem in none.yaml\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_under_stdout_is_reported(folder: Path) -> None:
    with open("/dev/full", "w") as full:
        # what is buffered fails as it is flushed, which PYTHONUNBUFFERED would do at once
        process = start(["elements"], stdout=full, stderr=subprocess.PIPE, cwd=folder,
                        env={k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"})
        _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert err == ("error: cannot read or write the output: the disk is full (No space left on device); free space "
                   "on it, or write to another one\n")


@pytest.mark.slow
def test_closed_stdout_and_its_missing_characters_do_no_harm(folder: Path) -> None:
    (folder / "beam.yaml").write_text(BEAM.replace("Cantilever", "Kragträger Δ"))
    command = [sys.executable, "-m", "ancf2d", "validate", "beam.yaml"]
    closed = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *command], capture_output=True, text=True, cwd=folder)
    assert (closed.returncode, closed.stderr) == (0, "")
    found = subprocess.run([*command[:3], "run", "beam.yaml"], capture_output=True, cwd=folder,
                           env={**os.environ, "PYTHONIOENCODING": "latin-1"})
    assert found.returncode == 0, found.stderr
    assert found.stdout.startswith("Kragträger \\u0394 with".encode("latin-1"))
