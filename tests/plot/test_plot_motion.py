"""Figures of dynamic runs: the energy balance, and the steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import HEADER, bent_beam, coordinates, tangent_body

from ancf2d import plot
from ancf2d.errors import ResultsError
from ancf2d.plot.kinds import build
from ancf2d.plot.motion import thinned
from ancf2d.plot.picture import Curves
from ancf2d.results import ResultWriter, open_results

RNG = np.random.default_rng(3)


def swinging(path: Path, *, states: int = 40, per_state: int = 25, probes: bool = False, drift: float = 1e-6,
             largest: float = 1e-2) -> Path:
    """A dynamic run with kinetic energy 5 - 5 cos(t), whose balance drifts to ``drift`` of its maximum."""
    with ResultWriter(path, {**HEADER, "solver": "dynamic"}, [tangent_body("beam", 2, 1.0, 0.1)],
                      coordinates("tangent", np.linspace(0, 1, 3), 0.0)) as w:
        for k in range(states + 1):
            t, n = 0.25 * k, per_state if k else 0
            lost, given, kinetic = 0.3 * t, 0.1 * t, 5 - 5 * np.cos(t)
            energies = {"kinetic": kinetic, "strain": 0.0, "work": given, "dissipated": lost,
                        "potential": given - lost - kinetic - drift * t}
            steps = {"step": np.arange(n), "t": t - 0.25 + 0.25 * np.arange(1, n + 1) / max(n, 1),
                     "dt": np.geomspace(1e-4, largest, n), "iterations": RNG.integers(2, 5, n),
                     "rejected": (np.arange(n) == 3).astype(int), "error": RNG.uniform(1e-9, 1e-6, n),
                     "violation": np.full(n, 1e-30)}
            w.append(t, np.zeros(12), steps=steps, energies=energies,
                     probes={"tip": {"ux": np.sin(t), "theta": t}} if probes else None)
        return w.finish({"status": "converged"})


def picture(path: Path, kind: str | None = None) -> Curves:
    with open_results(path) as r:
        found = build(r, kind)
        plot.draw(r, kind).canvas.draw()  # type: ignore[attr-defined]
    assert isinstance(found, Curves)
    return found


def test_energies_and_their_balance(tmp_path: Path) -> None:
    kinds, balance = picture(swinging(tmp_path / "a.h5"), "energy").panels
    curves = {c.name: c for c in kinds.curves}
    t = curves["kinetic"].x
    np.testing.assert_allclose(curves["kinetic"].y, 5 - 5 * np.cos(t), atol=1e-12)
    np.testing.assert_allclose(curves["total"].y, -0.2 * t - 1e-6 * t, atol=1e-12)
    assert "strain" not in curves  # it is zero throughout
    (off,) = balance.curves
    largest = np.max(5 - 5 * np.cos(t))
    np.testing.assert_allclose(off.y, -1e-6 * t / largest, atol=1e-14)
    assert off.name == "total + dissipated - work"


def test_two_runs_are_overlaid(tmp_path: Path) -> None:
    files = [swinging(tmp_path / f"{name}.h5", drift=drift) for name, drift in (("a", 0.0), ("b", 1e-3))]
    with open_results(files[0]) as a, open_results(files[1]) as b:
        found = build([a, b], "energy")
        steps = build([a, b], "steps")
    assert isinstance(found, Curves)
    assert [c.name.split(":")[0] for c in found.panels[1].curves] == ["a", "b"]
    assert np.abs(found.panels[1].curves[0].y).max() < 1e-12 < np.abs(found.panels[1].curves[1].y).max()
    assert isinstance(steps, Curves)
    assert {"a", "b", "a: after a rejected step"} <= {c.name for c in steps.panels[0].curves}


def test_steps_show_sizes_iterations_and_errors(tmp_path: Path) -> None:
    found = picture(swinging(tmp_path / "a.h5"), "steps")
    assert [p.y[0] for p in found.panels] == ["step size", "iterations", "local error"]  # no violation at all
    assert [p.log for p in found.panels] == [True, False, True]
    assert [p.whole for p in found.panels] == [False, True, False]
    each, given_up = found.panels[0].curves
    assert len(each.x) == 1000
    np.testing.assert_allclose(given_up.y, np.geomspace(1e-4, 1e-2, 25)[3], rtol=1e-12)
    assert len(given_up.x) == 40


def test_fixed_steps_are_drawn_on_a_plain_axis(tmp_path: Path) -> None:
    found = picture(swinging(tmp_path / "a.h5", largest=1.001e-4), "steps")
    assert not found.panels[0].log


def test_the_default_figures_of_a_motion(tmp_path: Path) -> None:
    with open_results(swinging(tmp_path / "a.h5")) as r:
        assert plot.default_kind(r) == "energy"
    with open_results(swinging(tmp_path / "b.h5", probes=True)) as r:
        assert plot.default_kind(r) == "history"


def test_a_static_run_has_no_energies_over_time(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as r, pytest.raises(ResultsError, match="no energies"):
        plot.draw(r, "energy")


def test_load_steps_are_drawn_by_their_number(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5", steps=5)) as r:
        figure = plot.draw(r, "steps")
        factor, iterations = figure.axes
        assert (factor.get_ylabel(), iterations.get_ylabel(), iterations.get_xlabel()) == (
            "load factor", "iterations", "step")
        np.testing.assert_allclose(factor.lines[0].get_xydata(), [(k, k / 5) for k in range(6)])
        np.testing.assert_array_equal(iterations.lines[0].get_ydata(), np.full(6, 3))
        ticks = iterations.get_xticks()
        np.testing.assert_array_equal(ticks, np.round(ticks))


def test_very_many_steps_are_drawn_by_their_extremes() -> None:
    t, y = np.arange(1e6), RNG.normal(size=1_000_000)
    y[[17, 999_990]], y[20] = (50.0, -50.0), np.nan
    x, drawn = thinned(t, y)
    assert len(x) <= 4002
    assert (np.diff(x) > 0).all()
    assert {(17.0, 50.0), (999_990.0, -50.0)} <= set(zip(x.tolist(), drawn.tolist(), strict=True))
    assert (x[0], x[-1]) == (0, 999_999)
    np.testing.assert_array_equal(y[x.astype(int)], drawn)
    short = np.arange(10.0)
    assert thinned(short, short)[0] is short
