"""Goals over windows of time: means and peaks of a bar pulled over a floor, with known waves.

A bar slides along a floor at the speed at which its end is pulled when friction mu rho A g sets in. While it slides on,
its axial forces are those of a bar under a load per length b that is applied at once: with k_n = (2 n - 1) pi/(2 L),
N = (2 b/L) sum cos(k_n x)/k_n^2 (1 - cos(c k_n t)) (d'Alembert's waves; Graff, Wave Motion in Elastic Solids, 1975).
"""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from ancf2d.case import LoadedCase, load_case_text
from ancf2d.cli import main
from ancf2d.study.accuracy.control import solve_to_accuracy
from ancf2d.study.goal import solve_for_goal
from ancf2d.study.gradient import gradient
from ancf2d.study.run import vocabulary
from ancf2d.study.windows import mean, peak, window_weights

EA, MU, L = 1000.0, 0.3, 1.0
WAVE = math.sqrt(EA)
# in passages of the wave
BEGIN, END = 0.5 / WAVE, 2.5 / WAVE
PULLED = f"""
bodies:
  bar:
    geometry: {{type: line, start: [0, 0], end: [{L}, 0]}}
    section: {{EA: {EA}, EI: 10, rhoA: 1}}
    element: {{type: cable, count: 8}}
boundary_conditions: [{{name: pull, type: prescribed, at: bar@0, ux: {{type: expression, value: "-0.5*t"}}}}]
obstacles: {{floor: {{type: half_plane, through: [0, 1e-5], normal: [0, 1]}}}}
contacts: [{{between: [bar, floor], side: axis, friction: {MU}, law: {{stiffness: 1e6, damping: 1000}}}}]
loads: [{{type: gravity, value: [0, -10]}}]
initial: {{velocity: [-0.5, 0]}}
solver: {{type: dynamic, t_end: {END}, tolerance: 1e-4}}
output: {{interval: 1e-3, probes: {{mid: bar@0.5}}}}
"""


def axial_force(x: float, window: tuple[float, float]) -> float:
    """Return the mean of N at x over a window of time."""
    k = (2 * np.arange(1, 100_000) - 1) * math.pi / (2 * L)
    w, (a, b) = WAVE * k, window
    share = 1 - (np.sin(w * b) - np.sin(w * a)) / (w * (b - a))
    return float((2 * MU * 10.0 / L * np.cos(k * x) / k**2 * share).sum())


def pulled(goal: str, more: str = "", interval: str = "1e-3") -> LoadedCase:
    text = PULLED.replace("interval: 1e-3", f"interval: {interval}")
    return load_case_text(f"format: 1\n{text}goal: {{{goal}}}\n{more}", vocabulary=vocabulary())


def contains(accuracy: dict, truth: float) -> None:
    """Check that an error bar contains the true value, and is at most 5 times the error, or as wide as required."""
    off = abs(accuracy["value"] - truth)
    assert accuracy["achieved"]
    assert off <= accuracy["absolute"] <= max(5.0 * off, accuracy["wanted"] * abs(truth))


def test_the_error_bar_of_a_mean_force_contains_the_true_value():
    """The pulling force rises to 2 mu m g in two passages and falls: its mean from 0.5 to 2.5 of them is 1.375."""
    truth = -1.375 * MU * 10.0 * L
    assert -axial_force(0.0, (BEGIN, END)) == pytest.approx(truth, rel=1e-5)
    found = solve_to_accuracy(pulled(f"reaction: pull, quantity: fx, mean_over: [{BEGIN}, {END}]", "accuracy: 1e-2"))
    contains(found.accuracy, truth)


@pytest.mark.slow
@pytest.mark.parametrize(("goal", "wanted", "truth"), [
    (f"reaction: pull, quantity: fx, peak_over: [{BEGIN}, {END}]", "3e-2", 2.0 * MU * 10.0 * L),
    (f"probe: mid, quantity: N, mean_over: [{BEGIN}, {END}]", "1e-3", axial_force(0.5, (BEGIN, END)))])
def test_error_bars_of_a_peak_and_of_a_section_force_contain_the_true_value(goal, wanted, truth):
    found = solve_to_accuracy(pulled(goal, f"accuracy: {wanted}"))
    contains(found.accuracy, truth)


def test_windows_of_straight_lines():
    """The trapezoidal rule is exact for piecewise linear samples, also between samples."""
    t, f = np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.0, 2.0, -3.0, 1.0])
    assert mean(t, f, (0.5, 1.5)) == pytest.approx((0.5 * (1.0 + 2.0) / 2 + 0.5 * (2.0 - 0.5) / 2) / 1.0, rel=1e-14)
    assert mean(t, f, (0.0, 4.0)) == pytest.approx((1.0 - 0.5 - 2.0) / 4.0, rel=1e-14)
    assert peak(t, f, (0.0, 1.5)) == 2.0
    assert peak(t, f, (0.0, 4.0)) == 3.0


def test_stored_times_too_far_apart_are_reported():
    """Every second of few samples moves the mean by more than half of the required accuracy."""
    goal = f"reaction: pull, quantity: fx, mean_over: [{BEGIN}, {END}]"
    assert solve_for_goal(pulled(goal)).answer.sampling < 1e-3
    assert solve_for_goal(pulled(goal, interval="0.02")).answer.sampling > 0.05


def test_derivatives_of_a_mean():
    """A mean of small displacements is proportional to the load: its derivative is the mean over the load."""
    loaded = load_case_text(f"""
format: 1
bodies:
  bar:
    geometry: {{type: line, start: [0, 0], end: [1, 0]}}
    section: {{EA: {EA}, EI: 10, rhoA: 1}}
    element: {{type: cable, count: 2}}
boundary_conditions: [{{type: clamp, at: bar@0}}]
loads: [{{type: force, at: bar@1, value: [1e-3, 0]}}]
solver: {{type: dynamic, t_end: {END}, dt: 2e-3}}
goal: {{probe: tip, quantity: ux, mean_over: [{BEGIN}, {END}]}}
output: {{probes: {{tip: bar@1}}}}
""", vocabulary=vocabulary())
    values, slopes = gradient(loaded, [loaded.case.goal], ["loads.0.value.0"])
    assert slopes[0, 0] == pytest.approx(values[0] / 1e-3, rel=1e-4)


def test_the_command_line_prints_windows(tmp_path, monkeypatch):
    """A run prints the value and the error of stored times; ``--json`` has both and follows its schema."""
    monkeypatch.chdir(tmp_path)
    goal = f"goal: {{reaction: pull, quantity: fx, mean_over: [{BEGIN}, {END}]}}\n"
    (tmp_path / "a.yaml").write_text(f"format: 1\n{PULLED}{goal}", encoding="utf-8")
    shown = CliRunner().invoke(main, ["run", "a.yaml", "--json"])
    assert shown.exit_code == 0
    (name, found), = json.loads(shown.stdout)["windows"].items()
    assert name == "mean of pull fx from 0.0158114 to 0.0790569 s"
    assert found["value"] == pytest.approx(-1.375 * MU * 10.0 * L, rel=1e-2)
    text = CliRunner().invoke(main, ["run", "a.yaml", "--force"]).stdout
    assert any(line.startswith(name) and f"{found['value']:.4f}"[:5] in line for line in text.splitlines())


@pytest.mark.parametrize("window", [(0.5, 2.75), (1.0, 3.0), (0.0, 4.0)])
@pytest.mark.parametrize("of", [mean, peak])
def test_weights_of_a_window_are_its_derivatives(of, window) -> None:
    """With a jump at t = 2; both values are linear in the samples, so they are weights times samples."""
    t, f = np.array([0.0, 1.0, 2.0, 2.0, 3.0, 4.0]), np.array([0.3, 1.0, -0.5, -2.0, 1.5, 0.1])
    goal = SimpleNamespace(mean_over=window if of is mean else None, peak_over=window if of is peak else None)
    weights = window_weights(goal, t, f)
    assert weights @ f == pytest.approx(of(t, f, window), rel=1e-14)
    step = 1e-6 * np.eye(len(f))
    by_differences = [(of(t, f + e, window) - of(t, f - e, window)) / 2e-6 for e in step]
    np.testing.assert_allclose(weights, by_differences, atol=1e-9)
