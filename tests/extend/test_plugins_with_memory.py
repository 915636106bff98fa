"""A custom formulation with memory, in every solver that steps it."""

from __future__ import annotations

import helpers as h
import numpy as np
import pytest
from test_plugins import add

import ancf2d
from ancf2d.errors import CaseError
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.study.run import prepare

# of tests/extend/plugins/friction.py
SHARE, LIMIT = 0.6, 1e-3
STIFF = 1e6


def rubbing(solver, **scene):
    body = {"geometry": h.line(1.0), "element": h.element("reissner2", 2, "friction"),
            "section": {"EA": STIFF, "kGA": 1e6, "EI": 1e4, "rhoA": 0.01, "rhoI": 1e-6}}
    held = [{"type": "clamp", "at": "rod@0"}, {"type": "roller", "at": "rod@1", "fixed": "y"}]
    probes = {"output": {"probes": {"end": "rod@1"}, **scene.pop("output", {})}}
    return h.load({"rod": body}, solver, bc=held, **probes, **scene)


def force_with_friction(strains):
    """Return the last force and the heat of the fibre along a strain history, by small steps."""
    slip, before, heat, N = 0.0, 0.0, 0.0, 0.0
    for target in strains:
        for x in np.linspace(before, target, 2001)[1:]:
            moved = min(max(slip, x - LIMIT), x + LIMIT)
            N = STIFF * ((1 - SHARE) * x + SHARE * (x - moved))
            heat += SHARE * STIFF * (x - moved) * (moved - slip)
            slip = moved
        before = target
    return N, heat


@pytest.mark.usefixtures("registries")
def test_a_formulation_remembers_the_accepted_steps_of_statics() -> None:
    """A force goes up, back below zero, and up again: a loop of straight lines."""
    add("friction")
    way = [2.4e-3, -0.9e-3, 1.3e-3]
    peaks = [force_with_friction(way[:k + 1])[0] for k in range(3)]
    force = {"type": "force", "at": "rod@1", "value": [1.0, 0],
             "amplitude": {"type": "table", "t": [0, 0.3, 0.7, 1], "value": [0, *peaks]}}
    for steps in (10, 40):
        done = ancf2d.solve(rubbing({"type": "static", "steps": steps}, loads=[force]))
        found = [done.course["end"]["ux"][np.argmin(np.abs(done.course_t - t))] for t in (0.3, 0.7, 1.0)]
        np.testing.assert_allclose(found, way, rtol=1e-9)
    # vibrations about a state on the verge are those of a fibre that sticks
    modes = [ancf2d.solve(rubbing({"type": "eigen", "modes": 1, "about": about}, loads=[force]),
                          states=False).summary["frequencies"]
             for about in ("static", "reference")]
    assert modes[0][0]["omega"] == pytest.approx(modes[1][0]["omega"], rel=1e-2)


@pytest.mark.usefixtures("registries")
def test_derivatives_of_equilibria_include_the_slip_on_the_way() -> None:
    """On the way up the fibre slips: N = E ((1 - s) x + s l), dx/dN = 1/(E (1 - s)), not 1/E as in sticking."""
    add("friction")
    N = force_with_friction([3e-3])[0]
    case = rubbing({"type": "static"}, loads=[{"type": "force", "at": "rod@1", "value": [N, 0]}],
                   goal={"probe": "end", "quantity": "ux"})
    row, = ancf2d.sensitivity(case, ["loads.0.value.0"]).rows
    assert row.method != "exact"
    assert row.derivative == pytest.approx(1.0 / (STIFF * (1.0 - SHARE)), rel=1e-9)
    # the accuracy of such an equilibrium includes that of its load steps
    assert "steps_error" in ancf2d.solve(case, accuracy=1e-3).accuracy


@pytest.mark.usefixtures("registries")
def test_a_formulation_remembers_the_accepted_points_of_a_path() -> None:
    add("friction")
    for method in ("arc_length", "displacement"):
        until = {"probe": "end", "quantity": "ux", "reaches": 2e-3}
        done = ancf2d.solve(rubbing({"type": "static", "method": method, "until": until},
                                    loads=[{"type": "force", "at": "rod@1", "value": [1000.0, 0]}]))
        assert 1000.0 * done.course_t[-1] == pytest.approx(force_with_friction([2e-3])[0], rel=1e-9)


def motion_with_friction(t_end, v):
    """Return the displacement of a mass on the fibre, and the heat at ten times, by steps of the mid-point rule."""
    mass, x, slip, heat, n = 10.0, 0.0, 0.0, [0.0], 40000
    h = t_end / n

    def slipped(y):
        return min(max(slip, y - LIMIT), y + LIMIT)

    def pull(y):
        return -STIFF * (y - SHARE * slipped(y)) / mass

    for k in range(n):
        middle = x + 0.5 * h * v
        a = pull(middle)
        x, v = x + h * v + 0.5 * h * h * a, v + h * a
        moved = slipped(x)
        heat[-1] += SHARE * STIFF * (x - moved) * (moved - slip)
        slip = moved
        if (k + 1) % (n // 10) == 0:
            heat.append(heat[-1])
    return x, heat[:-1]


@pytest.mark.slow_rows("radau5")
@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_a_formulation_remembers_the_accepted_steps_of_a_motion(monkeypatch, method) -> None:
    """Friction brakes a mass on the fibre, and its heat is reported; a resumed motion is the same."""
    add("friction")
    t_end, v = 0.05, 0.8
    scene = {"masses": [{"at": "rod@1", "mass": 10.0}], "initial": {"bodies": {"rod": {"velocity": [v, 0.0]}}}}
    loaded = rubbing({"type": "dynamic", "t_end": t_end, "dt": 5e-5, "method": method}, output={"interval": 5e-3},
                     **scene)
    done = ancf2d.solve(loaded)
    x, heat = motion_with_friction(t_end, v)
    assert heat[-1] > 1.0
    assert done.course["end"]["ux"][-1] == pytest.approx(x, abs=2e-3 * 5e-3)
    # at all times: on the way, more energy is stored by slip than is lost
    np.testing.assert_allclose(done.energies["dissipated"][1:], heat, rtol=1e-2, atol=1e-2 * heat[-1])
    assert done.summary["energy_drift"] < 1e-2
    # checkpoints come with calls of the kernels
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    kept = [s.checkpoint for s in solve_dynamic(prepare(loaded), loaded.case.solver) if s.checkpoint is not None]
    half = kept[len(kept) // 2]
    assert half["states"].any()
    *_, last = solve_dynamic(prepare(loaded), loaded.case.solver, half)
    np.testing.assert_allclose(last.d[:len(done.d[-1])], done.d[-1], rtol=1e-12, atol=1e-15)


@pytest.mark.usefixtures("registries")
def test_methods_that_cannot_step_a_memory_are_refused() -> None:
    add("friction")
    for method in ("energy_momentum", "Radau"):
        with pytest.raises(CaseError, match="does not support formulations with memory") as refused:
            prepare(rubbing({"type": "dynamic", "t_end": 1.0, "method": method}))
        for other in refused.value.problems[0].expected.replace(" or ", ", ").split(", "):
            prepare(rubbing({"type": "dynamic", "t_end": 1.0, "method": other}))
        assert "radau9" in refused.value.problems[0].expected
