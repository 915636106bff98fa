"""Motions with yielding fibres: closed forms, unresolved vibrations and the energy balance."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from test_fibres import FIRST, HEIGHT, LENGTH, STEEL, WIDTH, YIELD, E

import ancf2d
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.study.run import prepare


@pytest.mark.parametrize("method", [pytest.param("generalized_alpha", marks=pytest.mark.slow), "radau5"])
def test_a_bar_yields_in_motion(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sudden force F = f A s_y stretches a bar by e_y/(2 (1 - f)), by the work of F; then it vibrates elastically.

    Its strain is that of one element; what of it is plastic, e_p, has taken A L s_y e_p. A motion that is resumed
    is the same one.
    """
    share, area = 0.8, HEIGHT * WIDTH
    period = 2 * np.pi * LENGTH * np.sqrt(7850 / (3 * E))
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner2", 1), "material": {**STEEL, "rho": 7850},
            "section": {"height": HEIGHT, "width": WIDTH}}
    loaded = h.load({"rod": body}, {"type": "dynamic", "t_end": 1.5 * period, "dt": period / 100, "method": method,
                                    "estimate": False}, bc=[{"type": "clamp", "at": "rod@0"}],
                    loads=[{"type": "force", "at": "rod@1", "value": [share * area * YIELD, 0]}],
                    output={"interval": period / 100, "probes": {"tip": "rod@1"}, "fields": ["plastic_strain"]})
    done = ancf2d.solve(loaded)
    strain = done.course["tip"]["ux"] / LENGTH / FIRST
    most = 0.5 / (1.0 - share)
    assert strain.max() == pytest.approx(most, rel=1e-3)
    after = strain[int(np.argmax(strain)):]
    assert 0.5 * (after.max() + after.min()) - share == pytest.approx(most - 1.0, rel=1e-3)
    assert done.energies["dissipated"][-1] / (area * LENGTH * YIELD * FIRST) == pytest.approx(most - 1.0, rel=1e-3)
    assert done.summary["energy_drift"] < 1e-4
    np.testing.assert_allclose(done.results.field("rod", "plastic_strain"), (most - 1.0) * FIRST, rtol=1e-3)
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    kept = [s.checkpoint for s in solve_dynamic(prepare(loaded), loaded.case.solver) if s.checkpoint is not None]
    half = kept[len(kept) // 2]
    assert half["states"].any()
    *_, last = solve_dynamic(prepare(loaded), loaded.case.solver, half)
    np.testing.assert_array_equal(last.d[:len(done.d[-1])], done.d[-1])


def test_motions_distorted_by_unresolved_vibrations_give_a_warning() -> None:
    """A bar under 1.3 of its yield force, alternating, with steps of 62 periods of its vibrations."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 1), "section": {
        "height": HEIGHT, "width": WIDTH}, "material": {**STEEL, "rho": 7850, "hardening": {"kinematic": 0.1 * E}}}
    told = [any("the energy balance is off" in w for w in ancf2d.solve(h.load({"rod": body}, {
        "type": "dynamic", "t_end": 1.0, "dt": 0.05, "method": method, "estimate": False},
        bc=[{"type": "clamp", "at": "rod@0"}], output={"interval": 0.1}, loads=[
            {"type": "force", "at": "rod@1", "value": [1.3 * HEIGHT * WIDTH * YIELD, 0],
             "amplitude": {"type": "sine", "frequency": 2.0}}]), states=False).warnings)
        for method in ("newmark", "radau5")]
    assert told == [True, False]


def test_the_balance_of_energy_is_of_the_order_of_the_motion() -> None:
    """The drift of a hardening bar falls with the square of the step, like the error of Newmark's method."""
    period = 2 * np.pi * LENGTH * np.sqrt(7850 / (3 * E))
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner2", 1), "section": {
        "height": HEIGHT, "width": WIDTH}, "material": {**STEEL, "rho": 7850, "hardening": {"kinematic": 0.1 * E}}}
    drifts = []
    for steps in (100, 400):
        done = ancf2d.solve(h.load({"rod": body}, {
            "type": "dynamic", "t_end": 2 * period, "dt": period / steps, "method": "generalized_alpha",
            "estimate": False}, bc=[{"type": "clamp", "at": "rod@0"}], loads=[
                {"type": "force", "at": "rod@1", "value": [1.2 * HEIGHT * WIDTH * YIELD, 0],
                 "amplitude": {"type": "sine", "frequency": 0.5 / period}}], output={"interval": period / 10}),
                            states=False)
        drifts.append(done.summary["energy_drift"])
    assert drifts[0] < 5e-3
    # 16 times for the second order, 4 for the first
    assert drifts[0] > 10.0 * drifts[1]
