"""Springs that act on one side or beyond a gap, and torques between sections, compared with closed forms."""

from __future__ import annotations

import math
from typing import Any

import helpers as h
import numpy as np
import pytest
from motions import ride, rigid
from scipy.integrate import solve_ivp

import ancf2d
from ancf2d.errors import CaseError, ComputationError

SECTION = {"EA": 1e4, "EI": 1, "kGA": 1e4, "rhoA": 1, "rhoI": 1e-4}
ARMS = {"a": h.body(h.line(1.0), h.element("reissner3", 2), SECTION),
        "b": {**h.body(h.line(1.0), h.element("reissner3", 2), SECTION),
              "geometry": {"type": "line", "start": [1, 0], "end": [2, 0]}}}
ELBOW = {"bc": [{"type": "clamp", "at": "a@0"}], "joints": [{"type": "pin", "between": ["a@1", "b@0"]}]}
STATIC = {"type": "static", "steps": 3}


def turned(springs: list, loads: list) -> float:
    """Return the angle of the elbow, whose springs and loads bend neither arm."""
    return h.solved(ARMS, STATIC, springs=springs, loads=loads, **ELBOW).theta("b@0")


@pytest.mark.parametrize(("torque", "angle"), [(0.04, 0.08), (0.3, 0.2), (-0.3, -0.2)])
def test_a_torque_turns_an_elbow_against_its_stop(torque, angle):
    """0.5 theta below the stop at 0.1, plus 2 (theta - 0.1) beyond."""
    between = ["a@1", "b@0"]
    springs = [{"type": "rotational", "between": between, "stiffness": 0.5},
               {"type": "rotational", "between": between, "stiffness": 2.0, "gap": 0.1}]
    assert turned(springs, [{"type": "torque", "between": between, "value": torque}]) == pytest.approx(angle, rel=1e-9)


@pytest.mark.parametrize(("name", "spring", "tip"), [("translational", {"only": "tension"}, (0.015, -0.03)),
                                                     ("translational", {"only": "compression"}, (0.03, -0.015)),
                                                     ("translational", {"gap": 0.006}, (0.018, -0.018)),
                                                     ("rotational", {"only": "tension"}, (0.03, -0.015)),
                                                     ("rotational", {"only": "compression"}, (0.015, -0.03))])
def test_a_spring_acts_only_on_its_side(name, spring, tip):
    """A stiff bar on a pin and two springs of 1 N/m or N m/rad: one always active, one on a side or beyond a gap."""
    between = ["b@1", [1, -5]] if name == "translational" else ["b@1", [0, 0]]
    always = {"type": name, "between": between, "stiffness": 1.0}
    # what sinks shortens the spring below it; the relative rotation is that of the ground less that of the bar
    for force, wanted in zip((0.03, -0.03), tip, strict=True):
        load = ({"type": "force", "at": "b@1", "value": [0, force]} if name == "translational"
                else {"type": "moment", "at": "b@1", "value": force})
        found = h.solved({"b": h.body(h.line(1.0), h.element("reissner3", 1), SECTION)}, STATIC,
                         bc=[{"type": "pin", "at": "b@0"}], springs=[always, {**always, **spring}], loads=[load])
        moved = found.u("b@1")[1] if name == "translational" else found.theta("b@1")
        assert moved == pytest.approx(wanted, rel=3e-3), force


@pytest.mark.parametrize("name", ["translational", "rotational"])
def test_a_load_that_its_only_spring_does_not_resist_is_told(name):
    between = ["b@1", [1, -5]] if name == "translational" else [[0, 0], "b@0"]
    case = {"bodies": {"b": h.body(h.line(1.0), h.element("reissner3", 1), SECTION)}, "solver": STATIC,
            "boundary_conditions": [{"type": "pin", "at": "b@0"}],
            "springs": [{"type": name, "between": between, "stiffness": 1.0, "only": "tension"}],
            "loads": [{"type": "force", "at": "b@1", "value": [0, -0.03]}]}
    with pytest.raises(ComputationError) as error:
        ancf2d.solve(case)
    assert error.value.failure.advice.startswith("loads in the direction in which springs.0 resists, since nothing")
    case["loads"][0]["value"] = [0, 0.03]
    assert ancf2d.solve(case).status == "converged"


def test_a_folded_antenna_unfolds_against_its_stops():
    """Two hinges turn by about 3 rad: k (theta - rest) + k_stop (theta - gap) = 0 at each; there is no other load.

    A stop of 5 kN m/rad and the round-off of 3 rad make moments far beyond the round-off of the displacements, and the
    root, which bears nothing, moves by round-off of the others alone.
    """
    mast = {"height": 0.02, "width": 0.02}, {"E": 7e10, "nu": 0.3}
    bodies = {"a": h.body(h.line(0.5, math.pi / 2), h.element("reissner3", 2), *mast),
              "b": {**h.body(h.line(1.0), {"type": "rigid"}, *mast),
                    "geometry": {"type": "line", "start": [0, 0.5], "end": [0.05, 0.02]}},
              "c": {**h.body(h.line(1.0), h.element("cable", 4), *mast),
                    "geometry": {"type": "line", "start": [0.05, 0.02], "end": [0.1, 0.5]}}}
    hinges = ["a@1", "b@0"], ["b@1", "c@0"]
    drives = (2.0, 3.6, 5e3, 3.0377, "tension"), (1.0, -3.5, 2e3, 2.9340, "compression")
    springs, turned = [], []
    for between, (k, rest, stop, gap, only) in zip(hinges, drives, strict=True):
        springs += [{"type": "rotational", "between": between, "stiffness": k, "angle": rest},
                    {"type": "rotational", "between": between, "stiffness": stop, "gap": gap, "only": only}]
        turned.append((k * rest + stop * math.copysign(gap, rest)) / (k + stop))
    found = h.solved(bodies, "static", bc=[{"type": "clamp", "at": "a@0"}], springs=springs,
                     joints=[{"type": "pin", "between": between} for between in hinges])
    first = 0.5j + (0.05 - 0.48j) * np.exp(1j * turned[0])
    tip = first + (0.05 + 0.48j) * np.exp(1j * sum(turned))
    assert found.r("c@1") == pytest.approx([tip.real, tip.imag], abs=1e-9)


GAP, MASS, STIFFNESS, SPEED = 0.1, 2.0, 800.0, 3.0
OMEGA = math.sqrt(STIFFNESS / MASS)
PERIOD = 4 * GAP / SPEED + 2 * math.pi / OMEGA
STOPS = {"bodies": {"b": rigid([0, 0], [1, 0], MASS, 0.1)},
         "bc": [{"type": "roller", "at": "b@0", "fixed": "y"}, {"type": "roller", "at": "b@1", "fixed": "y"}],
         "springs": [{"type": "translational", "between": [[-1, 0], "b@0"], "stiffness": STIFFNESS, "gap": GAP}],
         "initial": {"bodies": {"b": {"velocity": [SPEED, 0]}}}}


def test_a_bar_between_two_stops_has_the_period_of_free_flight_and_half_oscillations():
    swing = ride(STOPS, PERIOD, states=4, method="radau5", tolerance=1e-8)
    found = [swing.place("b@0", k)[0] for k in range(5)]
    # of a quarter of the period it flies 0.0333 s freely and is in the stop for the rest
    assert found == pytest.approx([0.0, GAP + SPEED / OMEGA, 0.0, -GAP - SPEED / OMEGA, 0.0], abs=1e-6)


def test_energy_is_conserved_through_the_stops():
    swing = ride(STOPS, 25 * PERIOD, every=1, method="energy_momentum", dt=PERIOD / 37)
    total, _ = swing.totals()
    assert np.ptp(total) < 1e-10 * total[0]


def test_linear_statics_refuses_one_sided_springs():
    with pytest.raises(CaseError, match="which linear statics cannot represent"):
        h.solved(ARMS, "linear_static", springs=[{"type": "rotational", "between": ["a@1", "b@0"], "stiffness": 2.0,
                                                  "only": "tension"}], **ELBOW)


def test_an_inactive_spring_that_is_the_only_support_is_named():
    """``test_a_torque_turns_an_elbow_against_its_stop`` has a weak spring in addition."""
    stop = {"type": "rotational", "between": ["a@1", "b@0"], "stiffness": 2.0, "gap": 0.1}
    with pytest.raises(CaseError, match=r"springs.0: inactive in the reference.*; expected .* a weak spring"):
        h.solved(ARMS, STATIC, springs=[stop], **ELBOW)


def test_small_motions_at_the_limit_of_a_spring_include_it():
    bar = {"b": rigid([0, 0], [1, 0], 2.0, 0.1)}
    pair = [h.solved(bar, {"type": "eigen", "modes": 1}, bc=STOPS["bc"],
                     springs=[{"type": "translational", "between": [[-1, 0], "b@0"], "stiffness": 800.0, **more}]).state
            for more in ({}, {"only": "tension"})]
    assert pair[1].tables["modes"]["omega"] == pytest.approx(pair[0].tables["modes"]["omega"], rel=1e-12)
    assert pair[0].warnings == []
    assert "is one-sided" in pair[1].warnings[0]


@pytest.mark.parametrize("law", [{"stiffness": 800.0}, {"force": "800*u"}], ids=["stiffness", "formula"])
@pytest.mark.parametrize("only", ["tension", "compression"])
@pytest.mark.parametrize("gap", [0.1, 0.2, 0.25, 0.3, 0.7])
def test_a_gap_closed_in_the_reference_is_closed_despite_round_off(gap, only, law):
    """1 - 0.9 is less than 0.1 in doubles, 1 - 0.8 less than 0.2, and 1 - 0.75 is 0.25."""
    length = 1.0 - gap if only == "tension" else 1.0 + gap
    found = h.solved({"b": rigid([0, 0], [1, 0], 2.0, 0.1)}, {"type": "eigen", "modes": 1}, bc=STOPS["bc"],
                     springs=[{"type": "translational", "between": [[-1, 0], "b@0"], "length": length, "gap": gap,
                               "only": only, **law}]).state
    assert found.tables["modes"]["omega"] == pytest.approx([20.0], rel=1e-12)
    assert "is one-sided" in found.warnings[0]


# a bar of 0.4 kg that flies 0.1931 m to each side, at 1 m/s, and is in a stop for 13.7 ms
FREE, WITHIN = 0.1931, 13.7e-3
HARD, FLIES = 0.4 * (math.pi / WITHIN)**2, {
    "bodies": {"b": rigid([0, 0], [0.1, 0], 0.4, 1e-3)},
    "bc": [{"type": "roller", "at": f"b@{s}", "fixed": "y"} for s in (0, 1)],
    "initial": {"velocity": [1.0, 0]}}


def bouncing(t: float) -> float:
    """Return its position at t: uniform motion to a stop and back, and half a sine in it."""
    bounces, x = divmod(t + FREE, 2 * FREE + WITHIN)
    place = x - FREE if x < 2 * FREE else FREE + WITHIN / math.pi * math.sin(math.pi * (x - 2 * FREE) / WITHIN)
    return (-1.0)**bounces * place


def off(kind: str, **solver: Any) -> float:
    """Return the largest error of a motion through three bounces, relative to its size."""
    stop = {"type": "translational", "between": [[-1, 0], "b@0"]}
    springs = {"gap": [{**stop, "stiffness": HARD, "gap": FREE}],
               "only": [{**stop, "stiffness": HARD, "length": 1 + FREE, "only": "tension"},
                        {**stop, "stiffness": HARD, "length": 1 - FREE, "only": "compression"}],
               "formula": [{**stop, "force": f"{HARD:.17g}*u", "length": 1 + FREE, "only": "tension"},
                           {**stop, "force": f"{HARD:.17g}*u", "length": 1 - FREE, "only": "compression"}]}
    # T = stiffness (l - l0)/l0
    tendons = [{"type": "tendon", "through": [at, [x, 0]], "stiffness": HARD * (1 + FREE), "slack": FREE}
               for at, x in (("b@0", -1), ("b@1", 1.1))]
    acting = {"loads": tendons} if kind == "tendon" else {"springs": springs[kind]}
    motion = ride({**FLIES, **acting}, 1.5, states=6, **solver)
    return max(abs(motion.place("b@0", k)[0] - bouncing(0.25 * k)) for k in range(7)) / FREE


@pytest.mark.parametrize(("method", "limit"), [
    ("radau5", 1e-3), ("radau9", 1e-4), ("DOP853", 1e-4), ("RK45", 2e-3), ("Radau", 3e-5)])
def test_no_step_passes_over_a_stop(method, limit):
    """In free flight steps have no error, and grow longer than the time in the stop."""
    assert off("gap", method=method, tolerance=1e-5) < limit


@pytest.mark.parametrize("kind", ["only", "formula", "tendon"])
def test_every_kind_of_stop_is_found(kind):
    assert off(kind, method="radau9", tolerance=1e-5) < 1e-4


@pytest.mark.parametrize(("method", "order"), [("radau5", 5), ("generalized_alpha", 2), ("energy_momentum", 2)])
def test_the_order_is_kept_through_stops(method, order):
    """Steps end where a stop engages and releases."""
    coarse, fine = (off("gap", method=method, dt=dt) for dt in (2e-3, 1e-3))
    assert math.log2(coarse / fine) > order - 0.6


@pytest.mark.slow_rows("BDF")
@pytest.mark.parametrize("method", ["LSODA", "BDF"])
def test_multistep_methods_restart_at_stops(method):
    """They have no multipliers, so the bar bends and stretches; compared with radau9."""
    bar = {"geometry": {"type": "line", "start": [0, 0], "end": [0.1, 0]}, "element": {"type": "cable", "count": 1},
           "section": {"EA": 1e3, "EI": 1e-3, "rhoA": 4.0}}
    stop = {"type": "translational", "between": [[-1, 0], "b@0"], "stiffness": 0.01 * HARD, "gap": FREE}
    found = [ride({**FLIES, "bodies": {"b": bar}, "springs": [stop]}, 0.4, states=1, method=one, tolerance=1e-5)
             for one in (method, "radau9")]
    x = [motion.place("b@0", 1)[0] for motion in found]
    assert 0.0 < x[1] < FREE
    assert x[0] == pytest.approx(x[1], rel=1e-5)


@pytest.mark.parametrize(("method", "limit"), [("radau5", 1e-5), ("generalized_alpha", 5e-4), ("DOP853", 5e-5)])
def test_an_arm_between_two_rotational_stops(method, limit):
    inertia, stiffness, gap, rate = 0.35, 400.0, 0.3, 2.0
    omega = math.sqrt(stiffness / inertia)
    arm = ride({"bodies": {"b": rigid([0, 0], [1, 0], 1.0, 0.1)}, "bc": [{"type": "pin", "at": "b@0"}],
                "springs": [{"type": "rotational", "between": ["b@0", [0, 0]], "stiffness": stiffness, "gap": gap}],
                "initial": {"bodies": {"b": {"rotation_rate": {"omega": rate, "about": [0, 0]}}}}},
               2.0, states=20, method=method, tolerance=1e-5)
    for k in range(21):
        turns, x = divmod(0.1 * k + gap / rate, 2 * gap / rate + math.pi / omega)
        flies = x < 2 * gap / rate
        angle = (-1)**turns * (rate * x - gap if flies else gap + rate / omega * math.sin(omega * (x - 2 * gap / rate)))
        x, y = arm.place("b@1", k)
        assert math.atan2(y, x) == pytest.approx(angle, abs=limit)


@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
def test_a_spring_with_a_gap_and_a_moving_end_pulls_a_mass_at_rest(method):
    """The mass has no rate when the spring engages. Compared with SciPy's integrator."""
    mass, stiffness, gap = 1.0, 400.0, 0.1
    course = {"type": "expression", "value": "0.5 + 0.4*sin(6*t)"}
    found = ride({"bodies": {"rail": rigid([0, 0], [2, 0], 1.0, 0.1), "b": rigid([1, 1], [1.1, 1], mass, 0.1)},
                  "bc": [{"type": "clamp", "at": "rail@0"}, {"type": "roller", "at": "b@0", "fixed": "x"},
                         {"type": "prescribed", "at": "b@1", "angle": 0}],
                  "springs": [{"type": "translational", "between": [{"on": "rail", "s": course}, "b@0"],
                               "stiffness": stiffness, "gap": gap}]},
                 1.0, states=5, method=method, tolerance=1e-5)

    def rates(t: float, y: Any) -> list[float]:
        x = 1.0 - 2.0 * (0.5 + 0.4 * math.sin(6 * t))
        size = math.hypot(x, y[0])
        beyond = size - 1.0 - min(max(size - 1.0, -gap), gap)
        return [y[1], -stiffness * beyond * y[0] / size / mass]

    alone = solve_ivp(rates, (0, 1), [1.0, 0.0], t_eval=np.linspace(0, 1, 6), rtol=1e-9, atol=1e-11, max_step=1e-2)
    np.testing.assert_allclose([found.place("b@0", k)[1] for k in range(6)], alone.y[0], atol=1e-4)


@pytest.mark.parametrize(("keys", "never"), [({"gap": 1.0}, True), ({"gap": 0.99}, False), ({"length": 0.0}, True),
                                             ({"gap": 0.5, "length": 0.4}, True), ({"gap": 0.5, "length": 0.6}, False),
                                             ({"force": "u^3", "stiffness": 0.0, "gap": 2.0}, True),
                                             ({"only": "tension", "gap": 3.0}, False),
                                             ({"only": None, "gap": 3.0}, False)])
def test_a_stop_beyond_the_length_of_its_spring_never_acts_and_is_refused(keys: dict[str, Any], never: bool) -> None:
    """Ends at a distance of 1 come no nearer than 0: the spring cannot shorten by its whole length or more."""
    spring = {"type": "translational", "between": ["b@1", [1, -1]], "stiffness": 1.0, "only": "compression", **keys}
    scene = {"b": h.body(h.line(1.0), h.element("reissner3", 1), SECTION)}
    options = {"bc": [{"type": "clamp", "at": "b@0"}], "loads": [{"type": "force", "at": "b@1", "value": [0, 1e-6]}],
               "springs": [{k: v for k, v in spring.items() if v is not None}]}
    if not never:
        h.solved(scene, STATIC, **options)
        return
    with pytest.raises(CaseError, match=r"springs.0: it acts once .* which never happens"):
        h.solved(scene, STATIC, **options)
