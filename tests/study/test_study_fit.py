"""Fitted parameters: recovered from closed forms and from the case itself, with true standard errors."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ancf2d
from ancf2d.case.axes import read_bounds
from ancf2d.errors import CaseError
from ancf2d.results import open_results
from ancf2d.study.fit import Fit, fit, write_case, write_fit
from ancf2d.study.fit_data import DataValues, comparable, data_of, read_data
from ancf2d.study.record import Progress
from ancf2d.study.run import load, run_case
from scripts import measured_cantilever as strip

ROOT = Path(__file__).resolve().parents[2]
STRIP = str(ROOT / "cases/dynamic/measured_cantilever.yaml")
E, TAU = "bodies.strip.material.E", "bodies.strip.material.damping.kelvin_voigt"
BENT = """\
# a comment that stays
title: Cantilever
bodies:
  beam:
    geometry: {type: line, start: [0, 0], end: [2, 0]}
    section: {EA: 1.0e6, kGA: 3.0e5, EI: 1.0e3, rhoA: 1, rhoI: 1.0e-3}   # EI is a guess
    element: {type: cable, count: 4}
boundary_conditions:
  - {name: root, type: clamp, at: beam@0}
loads:
  - {name: tip, type: force, at: beam@1, value: [0, -300]}
solver: {type: static}
output:
  probes:
    tip: beam@1
"""
EI, F = "bodies.beam.section.EI", "loads.tip.value.0"


def fitted(case: Any, data: Any, *vary: str, **options: Any) -> Fit:
    return fit(ancf2d.load(case) if isinstance(case, str) else case, data, vary, **options)


def strip_fit(seed: int, start: dict[str, float] | None = None) -> Fit:
    t, u = (column[:50] for column in strip.measured(seed, 5e-5))
    return fitted(ancf2d.load(STRIP, start or {}), data_of({"t": t, "tip.uy": u}), f"{E}=50e9:90e9", f"{TAU}=1e-4:1e-2")


def deviations(found: Fit) -> list[float]:
    """Return the errors of the fitted parameters of the strip in standard errors."""
    errors = [row.standard_error for row in found.rows]
    assert all(errors)
    return [(row.value - true) / float(error or 0.0) for row, true, error in
            zip(found.rows, (strip.E, strip.TAU), errors, strict=True)]


@pytest.mark.slow
def test_stiffness_and_damping_of_a_measured_vibration() -> None:
    """The data are a sum over modes with noise; the guess has errors of 14 and 50 %."""
    found = strip_fit(1)
    assert max(map(abs, deviations(found))) < 3.0
    # what the noise leaves undetermined: some parts in a thousand, and some percent
    assert found.rows[0].standard_error == pytest.approx(1.5e-3 * strip.E, rel=0.5)
    assert found.rows[1].standard_error == pytest.approx(0.08 * strip.TAU, rel=0.5)
    # the residual is the noise
    assert found.rms[0] == pytest.approx(5e-5, rel=0.2)


@pytest.mark.slow
def test_standard_errors_are_those_of_many_measurements() -> None:
    """Deviations over standard errors are normal with variance 1; docs/fits.md has a hundred."""
    found = np.array([deviations(strip_fit(seed, {E: strip.E, TAU: strip.TAU})) for seed in range(16)])
    assert (np.sum(np.abs(found) < 2.0, axis=0) >= 12).all()
    assert np.std(found, axis=0) == pytest.approx([1.0, 1.0], abs=0.5)
    assert (abs(found.mean(axis=0)) < 5.0 / 4.0).all()


def test_measured_load_factors_are_ends_of_steps() -> None:
    """The path has a kink where the beam meets the floor, which no curve through other states follows."""
    case = ancf2d.load(BENT + "obstacles: {floor: {type: half_plane, through: [0, -0.2], normal: [0, 1]}}\n"
                       "contacts: [{between: [beam, floor], side: axis}]\n")
    factors = [0.137, 0.2513, 0.2641, 0.8314]
    data = data_of({"factor": factors, "tip.theta": [0.0] * 4, "tip.ux": [0.0] * 4})
    states: list[Any] = []
    ready = comparable(case, data)
    model = run_case(ready, progress=Progress(state=states.append)).model
    ends = [ancf2d.solve(case, {"solver.until": {"load_factor": f}}, states=False).summary["probes"]["tip"]
            for f in factors]
    assert DataValues(data)(model, states) == pytest.approx([end[q] for end in ends for q in ("theta", "ux")], rel=1e-7)


def path_of(EI: float, pull: float, factors: list[float]) -> dict[str, Any]:
    """Return columns of a path whose steps are not those of the fit."""
    overrides = [f"bodies.beam.section.EI={EI}", f"loads.tip.value=[{pull},-300]", "solver.steps=20"]
    solved = ancf2d.solve(BENT, overrides)
    results = solved.results
    t, probe = results.probe_t, results.probes["tip"]
    at = [int(np.argmin(np.abs(t - f))) for f in factors]
    assert np.allclose(t[at], factors)
    return {"factor": t[at], **{f"tip.{q}": probe[q][at] for q in ("uy", "theta")}}


@pytest.mark.slow
def test_an_equilibrium_path_determines_stiffness_and_load() -> None:
    """A tension stiffens the beam like EI, but more for larger bending; without noise both are exact."""
    factors = [0.2, 0.4, 0.6, 0.8, 1.0]
    data = path_of(1250.0, 200.0, factors)
    data["tip.theta"][2] = np.nan
    found = fitted(BENT, data_of(data), f"{EI}=100:1e4", f"{F}=-100:500")
    assert [row.value for row in found.rows] == pytest.approx([1250.0, 200.0], rel=1e-6)
    assert found.residual < 1e-7
    assert found.as_json()["points"] == 9
    assert found.correlation[0, 1] < -0.5
    np.testing.assert_allclose(found.model[:, 0], data["tip.uy"], rtol=1e-6)
    assert math.isnan(found.model[2, 1])


@pytest.mark.slow
def test_the_force_of_a_bar_at_constant_strain_determines_its_relaxation() -> None:
    """F = E A e (1 + g exp(-t/tau)), measured at few times that are not ends of steps."""
    case = """\
bodies:
  bar:
    geometry: {type: line, start: [0, 0], end: [0.1, 0]}
    section: {height: 0.01, width: 0.01}
    material: {E: 1.0e+9, nu: 0.3, viscoelastic: [{modulus: 1.0, time: 1.0}]}
    element: {type: cable, count: 1}
boundary_conditions:
  - {name: wall, type: clamp, at: bar@0}
  - {name: grip, type: prescribed, at: bar@1, ux: 1.0e-4, uy: 0, angle: 0}
solver: {type: quasi_static, t_end: 30, tolerance: 1.0e-3}
output:
  probes: {mid: bar@0.5}
"""
    t = np.array([0.0, 0.31, 1.07, 2.2, 3.9, 8.03, 20.4])
    path = "bodies.bar.material"
    found = fitted(case, data_of({"t": t, "mid.N": 100.0 * 1.3 * (1.0 + 0.6 * np.exp(-t / 2.5))}),
                   f"{path}.E=5e8:3e9", f"{path}.viscoelastic.0.modulus=0.1:3", f"{path}.viscoelastic.0.time=0.2:20")
    assert [row.value for row in found.rows] == pytest.approx([1.3e9, 0.6, 2.5], rel=1e-4)


@pytest.mark.slow_rows("100-10000.0-None", "100-950-is 1000 in the case, beyond the bound 950",
                       "1100-1500-is 1000 in the case, beyond the bound 1100: the search starts at 1284.52")
@pytest.mark.parametrize(("low", "high", "told"), [
    (100, 1e4, None), (1100, 1500, "is 1000 in the case, beyond the bound 1100: the search starts at 1284.52"),
    (100, 950, "is 1000 in the case, beyond the bound 950"), (1000, 1500, "is 1000 in the case, at the bound 1000")])
def test_a_search_with_another_start_than_the_case_says_so(low: float, high: float, told: str | None) -> None:
    found = fitted(BENT, data_of(path_of(1250.0, 0.0, [0.5, 1.0])), f"{EI}={low:g}:{high:g}")
    said = [text for text in found.warnings if "the search starts" in text]
    assert (told is None and not said) or (len(said) == 1 and f"{EI} {told}" in said[0])
    assert (found.rows[0].start == 1000.0) == (told is None)


@pytest.mark.slow
def test_undetermined_parameters_have_no_standard_error() -> None:
    data = path_of(1250.0, 0.0, [0.5, 1.0])
    found = fitted(BENT, data_of(data), f"{EI}=100:1e4", "bodies.beam.section.rhoA=0.5:2")
    assert found.rows[0].value == pytest.approx(1250.0, rel=1e-6)
    assert found.rows[0].standard_error is not None
    assert found.rows[1].standard_error is None
    assert any("do not determine it" in text for text in found.warnings)
    bound = fitted(BENT, data_of(data), f"{EI}=100:1100")
    assert bound.rows[0].value == pytest.approx(1100.0)
    assert any("ends at the bound" in text for text in bound.warnings)


@pytest.mark.slow
def test_a_frequency_response_determines_mass_and_damping() -> None:
    case = BENT.replace("solver: {type: static}", "solver: {type: frequency_response, inputs: [tip], from: 1, to: 20}\n"
                        "damping: {rayleigh: {alpha: 2, beta: 0}}")
    hz = np.linspace(1.0, 6.0, 21)
    solved = ancf2d.solve(case, {"bodies.beam.section.rhoA": 1.3, "damping.rayleigh.alpha": 3.0, "solver": {
        "type": "frequency_response", "inputs": ["tip"], "frequencies": list(hz)}}, states=False)
    H = solved.summary["response"]["tip"]["tip"]["uy"]
    data = data_of({"hz": hz, "tip.tip.uy.re": H["re"], "tip.tip.uy.im": H["im"]})
    found = fitted(case, data, "bodies.beam.section.rhoA=0.5:2", "damping.rayleigh.alpha=0.5:8")
    assert [row.value for row in found.rows] == pytest.approx([1.3, 3.0], rel=1e-5)


def test_noise_given_for_columns_weights_them() -> None:
    """Two columns that contradict each other: the parameter follows the one whose noise is small."""
    data = path_of(1000.0, 0.0, [0.5, 1.0])
    data["tip.theta"] = 1.2 * data["tip.theta"]
    names = ("tip.uy", "tip.theta")
    one, other = (fitted(BENT, data_of(data), f"{EI}=100:1e4", sigma=dict(zip(names, sigma, strict=True)))
                  for sigma in ((1e-6, 1.0), (1.0, 1e-6)))
    assert one.rows[0].value == pytest.approx(1000.0, rel=1e-6)
    assert other.rows[0].value < 850.0


@pytest.mark.slow
def test_several_starts_find_the_best_minimum() -> None:
    """In a narrow band around a resonance, a search that starts on the wrong side of the band sees no peak."""
    case = BENT.replace("solver: {type: static}", "solver: {type: frequency_response, inputs: [tip], from: 1, to: 20}\n"
                        "damping: {rayleigh: {alpha: 0.5, beta: 0}}")
    hz = [f for f in np.linspace(3.6, 4.6, 7)]
    # the first bending mode, at 3.516 sqrt(EI/rhoA)/(2 pi L^2) = 4.42 Hz for rhoA = 1
    solved = ancf2d.solve(case, {"solver": {"type": "frequency_response", "inputs": ["tip"], "frequencies": hz}},
                          states=False)
    H = solved.summary["response"]["tip"]["tip"]["uy"]
    data = data_of({"hz": hz, "tip.tip.uy.re": H["re"], "tip.tip.uy.im": H["im"]})
    far = ancf2d.load(case, {"bodies.beam.section.rhoA": 0.05})
    vary = ["bodies.beam.section.rhoA=0.02:50"]
    alone, best = fit(far, data, vary), fit(far, data, vary, starts=6)
    assert alone.residual > 0.1
    assert best.rows[0].value == pytest.approx(1.0, rel=1e-5)
    assert len(best.starts) == 6
    assert best.starts[0]["residual"] == best.residual < 1e-5 < best.starts[-1]["residual"]


# ---------------------------------------------------------------------------- files

def test_the_fitted_case_keeps_the_text_of_its_file(tmp_path: Path) -> None:
    (tmp_path / "bent.yaml").write_text(BENT)
    loaded = load(tmp_path / "bent.yaml")
    found = fit(loaded, data_of(path_of(1250.0, 0.0, [0.5, 1.0])), [f"{EI}=100:1e4"])
    out = tmp_path / "fitted.yaml"
    assert write_case(loaded, {EI: found.rows[0].value}, out, "fitted") == []
    text = out.read_text()
    assert "# a comment that stays" in text
    assert "# EI is a guess" in text
    assert found.rows[0].value == load(out).case.bodies["beam"].section.EI
    # it is ancf2d's own, and replaced without force
    fitted = load(out)
    write_case(fitted, {EI: found.rows[0].value}, out, "fitted again")
    assert out.read_text() == text.replace("fitted", "fitted again", 1)
    # what stands nowhere in the file is in the completed case
    other = load(tmp_path / "bent.yaml", [f"{EI}=900"])
    (told,) = write_case(other, {EI: 901.0}, out, "fitted")
    assert told == f"'{out}' has the case with its defaults, without comments"
    assert load(out).case.bodies["beam"].section.EI == 901.0
    write_fit(found, tmp_path / "fit.h5")
    with open_results(tmp_path / "fit.h5") as results:
        assert results.tables["fit"]["value"][0] == found.rows[0].value
        np.testing.assert_array_equal(results.tables["fitted"]["data tip.uy"], found.data.values[:, 0])
        assert results.tables["fitted"].units["model tip.uy"] == "m"


def test_wrong_data_are_reported_with_their_lines(tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("factor,tip.uy\n0.5,1\n0.7\n1,x\n")
    with pytest.raises(CaseError) as found:
        read_data(str(file))
    assert [p.line for p in found.value.problems] == [3, 4]
    for text in ("", "a,b\n1,2\n", "t\n1\n", "t,tip.uy\n,1\n2,2\n", "t,tip.uy\n1,\n"):
        file.write_text(text)
        with pytest.raises(CaseError):
            read_data(str(file))


def test_all_problems_of_a_fit_are_reported_at_once() -> None:
    data = data_of({"factor": [0.5, 2.0], "tap.uy": [1.0, 2.0], "tip.uz": [1.0, 2.0], "tip.vx": [1.0, 2.0],
                    "tip_uy": [1.0, 2.0]})
    with pytest.raises(CaseError) as found:
        fitted(BENT, data, f"{EI}=-1:1", "bodies.beam.section.EJ=1:2", f"{EI}=2:1", sigma={"tip.ux": 1.0})
    told = " ".join(p.message for p in found.value.problems)
    for text in ("range from 0.5 to 2", "no probe 'tap'", "'uz' is not a quantity", "a static state has no vx",
                 "must be > 0", "EJ", "2:1 is not a range", "no column 'tip.ux'", "'tip_uy' is not PROBE.QUANTITY"):
        assert text in told
    with pytest.raises(CaseError, match="the solver of the case is static"):
        fitted(BENT, data_of({"t": [1.0, 2.0], "tip.uy": [1.0, 2.0]}), f"{EI}=1:2")
    with pytest.raises(CaseError) as found:
        read_bounds(["a", "b=1", "c=2:1", "d=1:x", "=1:2", "e=1:2", "e=1:3"])
    assert len(found.value.problems) == 6


def test_a_file_of_another_kind_is_reported_once(tmp_path: Path) -> None:
    (tmp_path / "case.yaml").write_text("# a case\nbodies: {a: 1, b: 2}\n" * 20, encoding="utf-8")
    with pytest.raises(CaseError, match="the first column is '# a case'; expected t, factor or hz"):
        read_data(str(tmp_path / "case.yaml"))
    (tmp_path / "beam.h5").write_bytes(b"\x89HDF\r\n\x1a\n\x00")
    with pytest.raises(CaseError, match=r"an HDF5 file, such as a result file.*expected a CSV file; 'ancf2d export'"):
        read_data(str(tmp_path / "beam.h5"))
    (tmp_path / "data.csv").write_text("t;tip.uy\n0;0,1\n", encoding="utf-8")
    with pytest.raises(CaseError, match=r"'t;tip.uy'; expected t, factor or hz, in columns separated by commas"):
        read_data(str(tmp_path / "data.csv"))


def test_columns_without_a_value_and_infinite_numbers_are_named() -> None:
    data = {"factor": [0.5, 1.0], "tip.ux": [math.nan, math.nan], "tip.uy": [-1.0, math.inf], "tip.x": [1.0, math.nan]}
    with pytest.raises(CaseError) as found:
        data_of(data)
    assert [p.message for p in found.value.problems] == [
        "column tip.ux has no value", "column tip.uy holds an infinite number"]


def test_fits_from_python_can_be_solved() -> None:
    data = path_of(1250.0, 0.0, [0.5, 1.0])
    found = ancf2d.fit(BENT, data, {EI: (100.0, 1e4)})
    solved = ancf2d.solve(BENT, found.overrides(), states=False)
    assert solved.summary["probes"]["tip"]["uy"] == pytest.approx(data["tip.uy"][-1], rel=1e-6)


@pytest.mark.slow
def test_columns_of_round_off_count_as_the_largest_of_their_kind() -> None:
    """A strip slides along x: its transverse displacement and rotation are round-off; friction follows from the rest.

    Beside their own ranges, differences of round-off would outweigh all others.
    """
    case = ROOT / "cases/contact/sliding_strip.yaml"
    quick = {"bodies.strip.element.count": 2, "solver.dt": 0.01, "output.fields": []}
    course = ancf2d.solve(case, {**quick, "contacts.0.friction": 0.25})
    columns = {"t": course.t, **{f"end.{q}": course.course["end"][q] for q in ("ux", "uy", "theta", "vx")}}
    assert np.ptp(columns["end.uy"]) < 1e-12
    found = ancf2d.fit(ancf2d.load(case, quick), columns, {"contacts.0.friction": (0.1, 0.5)})
    assert found.rows[0].value == pytest.approx(0.25, rel=1e-4)
    scales = data_of({"t": [0, 1], "a.ux": [0, 2], "a.uy": [0, 1e-15], "a.theta": [0, 0], "a.vx": [3, 3],
                      "a.omega": [0, 1e-3], "a.M": [0, 5], "a.N": [0, 1e-9]}).scales(4.0)
    # of length, length, length over length; velocity, velocity over length; moment, moment over length
    np.testing.assert_allclose(scales, [2, 2, 2 / 4, 3, 1e-3, 5, 5 / 4])
    # positions that stay are no motion beside which others are faint
    still = data_of({"factor": [1], "a.x": [1.0], "a.uy": [-1e-7]}).scales(4.0)
    moving = data_of({"t": [0, 1], "a.x": [1000.0, 1000.0], "a.uy": [0, 1e-5]}).scales(4.0)
    np.testing.assert_allclose([still, moving], [[1.0, 1e-7], [1000.0, 1e-5]])


@pytest.mark.slow
def test_files_of_motions_with_controllers_and_moving_points_can_be_fitted(tmp_path: Path) -> None:
    """An exported motion is data of the same motion, including outputs of controllers."""
    case = {"parameters": {"target": 0.3, "speed": 5.0},
            "bodies": {"b": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                             "section": {"EA": 1e5, "EI": 10, "rhoA": 1}, "element": {"type": "cable", "count": 2}}},
            "boundary_conditions": [{"type": "clamp", "at": "b@0"}],
            "controllers": {"motor": {"type": "pid", "input": "target - tip.theta", "kp": 3, "ki": 2, "sample": 0.01}},
            "loads": [{"type": "moment", "at": "b@1", "value": 1,
                       "amplitude": {"type": "expression", "value": "motor"}},
                      {"type": "force", "at": {"on": "b", "s": {"type": "expression", "value": "speed*t"}},
                       "value": [0, -1]}],
            "solver": {"type": "dynamic", "t_end": 0.1, "dt": 2e-3}, "output": {"probes": {"tip": "b@1"}}}
    ancf2d.solve(case, output=tmp_path / "motion.h5")
    with open_results(tmp_path / "motion.h5") as results:
        probes = {f"{name}.{q}": y for name, p in results.probes.items() for q, y in p.items()}
        data = {"t": results.t, **{k: probes[k] for k in ("tip.uy", "motor.output", "motor.integral", "loads.1.at.s")}}
    vary = {"parameters.target": (0.1, 1), "parameters.speed": (3, 8)}
    found = ancf2d.fit({**case, "parameters": {"target": 0.4, "speed": 4.0}}, data, vary)
    assert [row.value for row in found.rows] == pytest.approx([0.3, 5.0], rel=1e-6)
    with pytest.raises(CaseError, match=r"column 'motor\.outptu': motor has no outptu"):
        ancf2d.fit(case, {"t": data["t"], "motor.outptu": data["motor.output"]}, vary)
