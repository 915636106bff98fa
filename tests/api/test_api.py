"""The Python interface loads, solves and refines as the command line does, and leaves no temporary files."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ancf2d

TEXT = """format: 1
title: A cantilever <of steel>
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {height: 0.1, width: 0.1}
    material: {E: 2.07e11, nu: 0.3, rho: 7850}
    element: {type: vallejo, count: 4}
boundary_conditions:
  - {name: wall, type: clamp, at: beam@0}
loads:
  - {type: force, at: beam@1, value: [0, -500e3]}
solver: {type: static}
goal: {probe: tip, quantity: uy}
output:
  probes:
    tip: beam@1
"""
# a fall that is short and coarse
MOTION = {"solver": {"type": "dynamic", "t_end": 0.02, "dt": 1e-3}}
# no load step, however short, ends after one iteration
HOPELESS = {"solver": {"type": "static", "max_iterations": 1}}


@pytest.fixture(scope="module")
def solution() -> ancf2d.Solution:
    return ancf2d.solve(TEXT)


def run_python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_importing_the_package_imports_no_library() -> None:
    heavy = "'numpy', 'scipy', 'numba', 'yaml', 'h5py', 'matplotlib', 'click', 'ancf2d.api'"
    assert run_python(f"import sys, ancf2d; dir(ancf2d); print([m for m in ({heavy}) if m in sys.modules])") == "[]"


@pytest.mark.parametrize("name", ancf2d.__all__)
def test_every_public_name_exists_and_is_documented(name: str) -> None:
    found = getattr(ancf2d, name)
    assert name in dir(ancf2d)
    assert name == "__version__" or found.__doc__


@pytest.mark.slow
def test_solve_is_the_function_after_any_import() -> None:
    assert run_python("import ancf2d.solvers.state, ancf2d; print(ancf2d.solve.__module__)") == "ancf2d.api.solving"


def test_other_names_are_no_attributes() -> None:
    with pytest.raises(AttributeError, match="no attribute 'solv'"):
        ancf2d.solv  # noqa: B018


def test_types_are_marked_as_given() -> None:
    assert Path(ancf2d.__file__).with_name("py.typed").exists()


# ---------------------------------------------------------------------------- cases

def test_a_case_is_the_same_from_file_text_and_mapping(tmp_path: Path) -> None:
    import yaml

    file = tmp_path / "beam.yaml"
    file.write_text(TEXT)
    found = [ancf2d.load(given).completed for given in (file, str(file), TEXT, yaml.safe_load(TEXT), ancf2d.load(TEXT))]
    assert len(set(found)) == 1


def test_a_mapping_from_a_yaml_1_1_parser_is_the_same_case() -> None:
    import yaml

    load = "  - {type: distributed, on: beam, value: [0, 1E+3]}\n"
    text = TEXT.replace("solver:", f"{load}solver:")
    mapping = yaml.safe_load(text)
    # ``on`` is true, and numbers with an exponent but without a point or its sign are texts
    assert (True in mapping["loads"][1], mapping["loads"][1]["value"], mapping["loads"][0]["value"]) == (
        True, [0, "1E+3"], [0, "-500e3"])
    assert ancf2d.load(mapping).completed == ancf2d.load(text).completed
    assert ancf2d.load(TEXT, {"loads": mapping["loads"]}).completed == ancf2d.load(text).completed


@pytest.mark.parametrize("value", [[0.0, -3.0], (0.0, -3.0), np.array([0.0, -3.0])], ids=["list", "tuple", "array"])
def test_overrides_are_values_by_path_or_texts(value: Any) -> None:
    by_path = ancf2d.load(TEXT, {"bodies.beam.element.count": np.int64(7), "loads.0.value": value, "title": "a: b"})
    texts = ancf2d.load(TEXT, ["bodies.beam.element.count=7", "loads.0.value=[0,-3]", "title='a: b'"])
    assert by_path.completed == texts.completed
    assert by_path.case.title == "a: b"


def test_a_loaded_case_keeps_its_overrides_below_new_ones() -> None:
    first = ancf2d.load(TEXT, {"bodies.beam.element.count": 7, "title": "old"})
    second = ancf2d.load(first, {"title": "new"})
    assert (second.case.bodies["beam"].element.count, second.case.title) == (7, "new")


def test_all_problems_of_a_case_are_reported_with_lines() -> None:
    with pytest.raises(ancf2d.CaseError) as found:
        ancf2d.solve(TEXT.replace("vallejo", "valejo").replace("nu: 0.3", "nu: 3"))
    assert [(p.line, p.near) for p in found.value.problems if p.near or "nu" in p.path] == [(7, ""), (8, "vallejo")]


# ---------------------------------------------------------------------------- solutions

def test_solving_gives_the_numbers_of_the_command(solution: ancf2d.Solution) -> None:
    assert solution.status == "converged"
    assert solution.value == solution.probes["tip"]["uy"] == pytest.approx(-0.6805405128, rel=1e-9)
    assert solution.reactions["wall"]["fy"] == pytest.approx(500e3, rel=1e-9)
    assert (solution.failure, solution.accuracy, solution.path) == (None, None, None)


def test_states_are_arrays_from_the_reference_to_the_last_load_step(solution: ancf2d.Solution) -> None:
    assert solution.t[0] == 0.0
    assert solution.t[-1] == 1.0
    assert solution.d.shape == (len(solution.t), len(solution.e0))
    assert not solution.d[0].any()
    assert np.array_equal(solution.e[-1], solution.e0 + solution.results.d(-1))
    assert solution.course["tip"]["uy"][-1] == solution.probes["tip"]["uy"]
    assert len(solution.course_t) == len(solution.course["tip"]["uy"])


def test_the_axis_of_a_body_runs_from_end_to_end(solution: ancf2d.Solution) -> None:
    axis, tip = solution.axis("beam"), solution.probes["tip"]
    assert axis[0] == pytest.approx([0, 0], abs=1e-12)
    assert axis[-1] == pytest.approx([tip["x"], tip["y"]], rel=1e-9)
    assert np.linalg.norm(np.diff(solution.axis("beam", None), axis=0), axis=1).min() > 0.0


def test_a_motion_has_rates_and_energies() -> None:
    found = ancf2d.solve(TEXT, {**MOTION, "bodies.beam.element.type": "reissner2"})
    assert found.v.shape == found.d.shape
    assert set(found.energies) >= {"kinetic", "strain"}
    assert len(found.energies["kinetic"]) == len(found.t)
    assert found.energies["kinetic"][-1] > 0.0


def test_statics_has_no_rates(solution: ancf2d.Solution) -> None:
    with pytest.raises(ancf2d.ResultsError, match="does not hold v"):
        _ = solution.v


def test_modes_are_arrays() -> None:
    found = ancf2d.solve(TEXT, {"solver": {"type": "eigen", "modes": 3}, "goal": {"kind": "bending", "number": 1}})
    assert any(a.ndim == 2 and a.shape[-1] == len(found.e0) for a in found.arrays.values())


def test_a_file_is_written_to_the_given_path(tmp_path: Path, solution: ancf2d.Solution) -> None:
    found = ancf2d.solve(TEXT, output=tmp_path / "beam.h5")
    assert found.path == tmp_path / "beam.h5"
    with ancf2d.open_results(tmp_path / "beam.h5") as results:
        assert np.array_equal(results.rows("d"), solution.d)
        assert results.case_text == TEXT


def test_the_case_itself_is_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "beam.yaml"
    file.write_text(TEXT)
    with pytest.raises(ancf2d.ResultsError, match="an input of this command"):
        ancf2d.solve(file, output=file, force=True)
    assert file.read_text() == TEXT


def test_a_foreign_file_is_replaced_only_with_force(tmp_path: Path) -> None:
    other = tmp_path / "other.h5"
    other.write_text("a letter")
    with pytest.raises(ancf2d.ResultsError):
        ancf2d.solve(TEXT, output=other)
    assert ancf2d.solve(TEXT, output=other, force=True).path == other


def test_a_forgotten_solution_leaves_no_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    found = ancf2d.solve(TEXT)
    assert len(list(tmp_path.iterdir())) == 1
    with pytest.raises(ancf2d.ComputationError):
        ancf2d.solve(TEXT, HOPELESS)
    with pytest.raises(ancf2d.CaseError):
        ancf2d.solve(TEXT, {"solver.type": "statics"})
    assert len(list(tmp_path.iterdir())) == 1
    del found
    gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_results_outlive_their_solution() -> None:
    """The temporary file of a solution lasts as long as its results."""
    results, whole = ancf2d.solve(TEXT).results, ancf2d.solve(TEXT)
    gc.collect()
    for name, probe in whole.results.probes.items():
        np.testing.assert_array_equal(results.probes[name]["uy"], probe["uy"])
    np.testing.assert_array_equal(results.d(-1), whole.d[-1])


def test_without_states_only_the_summary_remains(solution: ancf2d.Solution) -> None:
    found = ancf2d.solve(TEXT, states=False)
    assert found.value == solution.value
    with pytest.raises(ancf2d.ResultsError, match="kept no states"):
        _ = found.d
    assert "<svg" not in found._repr_html_()


def test_a_failure_is_raised_with_advice_or_returned_with_the_states_reached() -> None:
    with pytest.raises(ancf2d.ComputationError) as raised:
        ancf2d.solve(TEXT, HOPELESS)
    assert raised.value.failure.reason
    found = ancf2d.solve(TEXT, HOPELESS, partial=True)
    assert found.status == "failed"
    assert found.failure is not None
    assert str(found) == found.failure.text()
    assert "<pre " in found._repr_html_()


def test_an_accuracy_is_reached_and_reported(tmp_path: Path) -> None:
    found = ancf2d.solve(TEXT, accuracy=1e-3)
    assert found.accuracy is not None
    assert found.accuracy["achieved"]
    assert found.accuracy["estimate"] < 1e-3
    assert found.value == pytest.approx(-0.68105602, rel=1e-3)
    assert len(found.t) > 0


# ---------------------------------------------------------------------------- shown

def test_a_solution_names_itself_in_one_line(solution: ancf2d.Solution) -> None:
    assert repr(solution) == ("<Solution 'A cantilever <of steel>': converged, static, 4 elements, "
                              "tip uy = -0.68054051>")


def test_a_solution_is_printed_as_the_command_prints_it(solution: ancf2d.Solution) -> None:
    lines = str(solution).splitlines()
    assert lines[0] == "A cantilever <of steel>"
    assert any(line.startswith("tip") and "-0.680541" in line for line in lines)


def test_notebooks_show_the_bodies_before_and_after_and_the_report(solution: ancf2d.Solution) -> None:
    from xml.etree import ElementTree

    page = ElementTree.fromstring(f"<div>{solution._repr_html_()}</div>")
    before, after = ([tuple(map(float, p.split(","))) for p in line.attrib["points"].split()]
                     for line in page.iter("{http://www.w3.org/2000/svg}polyline"))
    assert len({y for _, y in before}) == 1
    # downward on a screen is larger
    assert after[-1][1] > before[-1][1] + 50
    assert "A cantilever <of steel>" in "".join(page.itertext())


def test_notebooks_magnify_invisible_displacements_and_say_so() -> None:
    page = ancf2d.solve(TEXT, {"loads.0.value": [0, -1]})._repr_html_()
    assert "displacements magnified" in page
    assert "magnified" not in ancf2d.solve(TEXT)._repr_html_()


def test_figures_show_themselves(solution: ancf2d.Solution) -> None:
    """IPython asks objects for _repr_png_, so nothing must be imported or switched on first."""
    assert solution.plot("shape")._repr_png_().startswith(b"\x89PNG")


def test_results_say_what_is_in_them(solution: ancf2d.Solution) -> None:
    from xml.etree import ElementTree

    results = solution.results
    assert repr(results) == "<Results 'A cantilever <of steel>': converged, static, 11 states, solution.h5>"
    text = " ".join(ElementTree.fromstring(f"<div>{results._repr_html_()}</div>").itertext())
    for words in ("A cantilever <of steel>", "11 states", "load factor 0 to 1", "4 elements", "ux [m]"):
        assert words in text


def test_a_solution_is_drawn(solution: ancf2d.Solution) -> None:
    assert solution.plot("shape", title="As it bends")._suptitle or solution.plot("shape").axes


# ---------------------------------------------------------------------------- refinement

def test_refinement_has_rows_and_limits_of_each_type() -> None:
    study = ancf2d.convergence(TEXT, elements=[2, 4, 8], types=["vallejo", "reissner3"])
    assert [(row.element, row.elements) for row in study.rows] == [(t, n) for t in ("vallejo", "reissner3")
                                                                     for n in (2, 4, 8)]
    beam = study.series[1]
    assert beam.estimate.value == pytest.approx(-0.6808644866, rel=1e-6)
    assert beam.rows[-1].error is not None
    assert beam.rows[-1].error < 1e-5


def test_a_study_is_printed_as_the_command_prints_it_and_is_a_table_in_notebooks() -> None:
    from xml.etree import ElementTree

    study = ancf2d.convergence(TEXT, elements=[2, 4])
    assert "\n" not in repr(study)
    assert repr(study).startswith("<Convergence 'A cantilever <of steel>': tip uy, 2 rows")
    lines = str(study).splitlines()
    assert lines[1] == "tip uy over meshes"
    page = ElementTree.fromstring(f"<div>{study._repr_html_()}</div>")
    rows = [["".join(cell.itertext()) for cell in row] for row in page.iter("tr")]
    assert rows[0][:4] == ["element", "elements", "coordinates", "tip uy [m]"]
    assert [row[1] for row in rows[1:]] == ["2", "4"]


def test_refinement_with_an_unknown_type_names_the_nearest() -> None:
    with pytest.raises(ancf2d.CaseError, match="did you mean 'vallejo'"):
        ancf2d.convergence(TEXT, types="valejo")


def test_refinement_by_two_kinds_of_steps_is_refused() -> None:
    with pytest.raises(ancf2d.CaseError, match="only one"):
        ancf2d.convergence(TEXT, MOTION, dt=[1e-3], tolerance=[1e-3])


# ---------------------------------------------------------------------------- types

@pytest.mark.slow
def test_scripts_that_use_the_interface_pass_a_strict_type_checker(tmp_path: Path) -> None:
    import re

    document = (Path(ancf2d.__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    for number, script in enumerate(re.findall(r"^```python\n(.*?)^```$", document, re.M | re.S)):
        (tmp_path / f"script{number}.py").write_text(script)
    (tmp_path / "wrong.py").write_text("import ancf2d\nancf2d.solve('beam.yaml').value + 'metres'\n"
                                       "ancf2d.solve('beam.yaml', acuracy=1e-3)\n")

    # SciPy comes without types; what no script names, and nothing of the interface returns, has very many
    (tmp_path / "mypy.ini").write_text("[mypy]\nstrict = true\nignore_missing_imports = true\n"
                                       "[mypy-dask.*,distributed.*,IPython.*,matplotlib.*,ancf2d.kernels.*,"
                                       "ancf2d.solvers.motion.*,ancf2d.solvers.statics.*,ancf2d.solvers.derivatives.*,"
                                       "ancf2d.interactions.*,ancf2d.plot.*,ancf2d.cli.*]\n"
                                       "follow_imports = skip\n")
    found = subprocess.run([sys.executable, "-m", "mypy", "--config-file", "mypy.ini", "--cache-dir", os.devnull,
                            "--no-error-summary", *map(str, tmp_path.glob("*.py"))],
                           capture_output=True, text=True, cwd=tmp_path, check=False).stdout
    assert {line.partition(":")[0] for line in found.splitlines() if ": error: " in line} == {"wrong.py"}, found
    assert "wrong.py:2: error: Unsupported" in found
    assert 'wrong.py:3: error: Unexpected keyword argument "acuracy"' in found
