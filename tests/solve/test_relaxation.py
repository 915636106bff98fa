"""Materials that relax, in equilibria over time, compared with closed forms of linear viscoelasticity."""

from __future__ import annotations

import itertools
from typing import Any

import helpers as h
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ancf2d
from ancf2d.model.build import build_model
from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import reactions

E, SIZE, LENGTH = 2e6, 0.02, 1.0
ZENER = ((0.5, 0.1),)
PRONY = ((0.3, 1e-3), (0.25, 1e-2), (0.4, 0.1), (0.2, 1.0), (0.5, 10.0))
# a force that moves the end by so little that the model is linear
FORCE = 1e-7
TYPES = [("reissner3", None), ("cable", None), ("vallejo", "structural"), ("2d3n-nu", "continuum"),
         ("kerkkanen", "enhanced")]


def material(terms: tuple[tuple[float, float], ...]) -> dict[str, Any]:
    """Return a rubber with terms (modulus, time)."""
    known = [{"modulus": g, "time": tau} for g, tau in terms]
    return {"E": E, "nu": 0.3, "rho": 1000, **({"viscoelastic": known} if known else {})}


def beam(kind: tuple[str, str | None], terms: tuple[tuple[float, float], ...], t_end: float, tolerance: float = 1e-6,
         **scene: Any) -> Any:
    """Return the case of a clamped beam over time."""
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 2, kind[1]), "material": material(terms),
            "section": {"height": SIZE, "width": SIZE}}
    bc = [{"type": "clamp", "at": "beam@0"}, *scene.pop("bc", [])]
    return h.load({"beam": body}, {"type": "quasi_static", "t_end": t_end, "tolerance": tolerance}, bc=bc,
                  output={"probes": {"tip": "beam@1"}}, **scene)


def creep(t: np.ndarray, terms: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return the strain under a stress that is E from t = 0 on.

    With s = e + sum g h = 1, h_i' = e' - h_i/tau_i is a linear system for h (n,): (I + 1 g^T) h' = -h/tau.
    """
    g, tau = (np.array(v) for v in zip(*terms, strict=True))
    rate = -np.linalg.solve(np.eye(len(g)) + np.outer(np.ones(len(g)), g), np.diag(1.0 / tau))
    w, V = np.linalg.eig(rate)
    first = np.linalg.solve(V, np.full(len(g), 1.0 / (1.0 + g.sum())))
    return np.real(1.0 - np.exp(np.outer(t, w)) @ ((g @ V) * first))


@pytest.mark.slow_rows("2d3n-nu")
@pytest.mark.parametrize("kind", [pytest.param(kind, id=kind[0], marks=() if k % 2 else pytest.mark.slow)
                                  for k, kind in enumerate(TYPES)])
def test_a_beam_creeps(kind: tuple[str, str | None]) -> None:
    """The instantaneous response at t = 0, then 1 - g/(1 + g) exp(-t/((1 + g) tau)), for bending and shear alike."""
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    done = ancf2d.solve(beam(kind, ZENER, 0.5, loads=load))
    t, u = done.course_t, done.course["tip"]["uy"]
    assert t[0] == 0.0
    assert t[-1] == 0.5
    g, tau = ZENER[0]
    exact = 1.0 - g / (1.0 + g) * np.exp(-t / ((1.0 + g) * tau))
    np.testing.assert_allclose(exact, creep(t, ZENER), rtol=1e-12)
    whole = ancf2d.solve(beam(kind, (), 1.0, loads=load)).course["tip"]["uy"][-1]
    np.testing.assert_allclose(u / whole, exact, atol=1e-6)


@pytest.mark.parametrize(("kind", "terms", "end"), [
    pytest.param(TYPES[1], ((1000.0, 1.0),), 50.0, id="fluid"),
    *(pytest.param(kind, PRONY, 0.2, id=f"prony-{kind[0]}", marks=pytest.mark.slow) for kind in TYPES[1::2])])
def test_maxwell_and_prony_beams_creep_to_a_millionth(kind: tuple[str, str | None], terms: Any, end: float) -> None:
    """With a spring a thousand times the long-term one the beam is nearly a Maxwell beam and creeps for long."""
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    done = ancf2d.solve(beam(kind, terms, end, loads=load))
    whole = ancf2d.solve(beam(kind, (), 1.0, loads=load)).course["tip"]["uy"][-1]
    exact = creep(done.course_t, terms)
    error = np.abs(done.course["tip"]["uy"] / whole - exact) / np.maximum.accumulate(exact)
    assert 1e-8 < error.max() < 1e-6
    if end == 50.0:
        np.testing.assert_allclose(exact, (1.0 + done.course_t) / 1001.0, rtol=0.03)


def test_one_kernel_serves_any_number_of_terms() -> None:
    """Bodies with one and with five terms call the same compiled law, and each relaxes by its own terms."""
    bodies = {name: {"geometry": h.line(LENGTH), "element": h.element("reissner3", 1), "material": material(terms),
                     "section": {"height": SIZE, "width": SIZE}} for name, terms in (("a", ZENER), ("b", PRONY))}
    bc = [{"type": "clamp", "at": f"{name}@0"} for name in bodies]
    bc += [{"type": "prescribed", "at": f"{name}@1", "name": name, "ux": 1e-6, "uy": 0, "angle": 0} for name in bodies]
    found = h.Solution(build_model(h.load(bodies, {"type": "quasi_static", "t_end": 1.0, "tolerance": 1e-3}, bc=bc)))
    assert len({group.values.law.address for group in found.model.groups}) == 1
    assert len({group.values.law.state for group in found.model.groups}) == 2
    for name, terms in (("a", ZENER), ("b", PRONY)):
        exact = E * SIZE**2 * 1e-6 * (1.0 + sum(g * np.exp(-1.0 / tau) for g, tau in terms))
        assert reactions(found.model, found.state)[name]["fx"] == pytest.approx(exact, rel=1e-9)


def test_steps_are_reported_in_time() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    states = list(solve(build_model(beam(TYPES[0], ZENER, 0.5, 1e-3, loads=load))))
    steps = [(s.history["t"], s.history["dt"]) for s in states]
    assert all("factor" not in s.history for s in states)
    assert steps[0] == (0.0, 0.0)
    assert steps[-1][0] == 0.5
    assert sum(dt for _, dt in steps) == pytest.approx(0.5)


@pytest.mark.slow
def test_five_terms_creep_over_decades_within_the_tolerance() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    whole = ancf2d.solve(beam(TYPES[0], (), 1.0, loads=load)).course["tip"]["uy"][-1]
    for tolerance in (1e-3, 1e-4):
        done = ancf2d.solve(beam(TYPES[0], PRONY, 100.0, tolerance, loads=load))
        error = np.abs(done.course["tip"]["uy"] / whole - creep(done.course_t, PRONY)).max()
        assert 1e-3 * tolerance < error < tolerance


def test_a_stretched_bar_relaxes_exactly() -> None:
    """Constant strains cause no error: F = E A e (1 + sum g exp(-t/tau))."""
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": 1e-6, "uy": 0, "angle": 0}]
    case = beam(TYPES[0], PRONY, 20.0, bc=held)
    found = h.Solution(build_model(case))
    t = np.array([s.t for s in found.states])
    force = [reactions(found.model, s)["end"]["fx"] for s in found.states]
    exact = E * SIZE**2 * 1e-6 * (1.0 + sum(g * np.exp(-t / tau) for g, tau in PRONY))
    np.testing.assert_allclose(force, exact, rtol=1e-9)


def test_a_ramp_of_strain_is_exact_and_a_jump_takes_no_time() -> None:
    """F/(E A) = e + sum g e' tau (1 - exp(-t/tau)) along a ramp with any step; after a jump 1 + sum g of it."""
    ramp = {"type": "expression", "value": "(1e-6*t) if t < 0.2 else 3e-7"}
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": ramp, "uy": 0, "angle": 0}]
    found = h.Solution(build_model(beam(TYPES[0], ZENER, 0.4, 1e-3, bc=held)))
    t = np.array([s.t for s in found.states])
    force = np.array([reactions(found.model, s)["end"]["fx"] for s in found.states]) / (E * SIZE**2)
    (g, tau), before = ZENER[0], t < 0.2
    np.testing.assert_allclose(force[before], 1e-6 * (t + g * tau * -np.expm1(-t / tau))[before], atol=1e-15)
    behind, start = t[~before] - 0.2, 1e-6 * g * tau * -np.expm1(-0.2 / tau) + g * 1e-7
    np.testing.assert_allclose(force[~before], 3e-7 + start * np.exp(-behind / tau), atol=1e-15)


@pytest.mark.parametrize("tolerance", [1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
def test_the_force_of_a_prescribed_motion_is_within_the_tolerance(tolerance: float) -> None:
    """With all displacements prescribed only stress is unknown: F/(E A) = e(t) + sum g h, h' = e' - h/tau."""
    terms, middle, width = ((0.5, 0.1), (0.3, 0.02)), 0.5, 0.05
    pulse = {"type": "expression", "value": f"1e-6*exp(-((t - {middle})/{width})^2)"}
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": pulse, "uy": 0, "angle": 0}]
    case = beam(TYPES[0], terms, 1.0, tolerance, bc=held)
    found = h.Solution(build_model(case))
    t = np.array([s.t for s in found.states])
    force = np.array([reactions(found.model, s)["end"]["fx"] for s in found.states]) / (E * SIZE**2)
    exact = 1e-6 * np.exp(-((t - middle) / width) ** 2)
    for g, tau in terms:
        rise = solve_ivp(lambda t, h, tau=tau: -2e-6 * (t - middle) / width**2 * np.exp(
            -((t - middle) / width) ** 2) - h / tau, (0.0, 1.0), [0.0], "DOP853", t, rtol=1e-9, atol=1e-14)
        exact += g * rise.y[0]
    assert 1e-2 * tolerance < np.abs(force - exact).max() / np.abs(exact).max() < tolerance


def test_statics_have_the_long_term_modulus() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, 0.05]}]
    ends = [h.cantilever(h.element("reissner3", 2), load, length=LENGTH, section={"height": SIZE, "width": SIZE},
                         material=material(terms)).u("beam@1") for terms in ((), PRONY)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-9)


def test_an_elastic_arch_follows_its_load_over_time() -> None:
    """Without memory, the states are those of statics at the same loads."""
    sine = {"type": "sine", "frequency": 0.25}
    load = [{"type": "force", "at": "beam@1", "value": [0, 0.05], "amplitude": sine}]
    done = ancf2d.solve(beam(TYPES[0], (), 1.0, loads=load))
    alone = h.cantilever(h.element("reissner3", 2), [{"type": "force", "at": "beam@1", "value": [0, 0.05]}],
                         length=LENGTH, section={"height": SIZE, "width": SIZE}, material=material(()))
    assert done.course["tip"]["uy"][-1] == pytest.approx(alone.u("beam@1")[1], rel=1e-8)
    assert len(done.course_t) > 90


def complex_modulus(s: complex, terms: tuple[tuple[float, float], ...]) -> complex:
    """Return E(s)/E = 1 + sum g s tau/(1 + s tau)."""
    return 1.0 + sum(g * s * tau / (1.0 + s * tau) for g, tau in terms)


def real_roots(omega: float, terms: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return the real s of s^2 + omega^2 E(s)/E = 0, with the denominators multiplied out."""
    ways = [np.polynomial.Polynomial([1.0, tau]) for _, tau in terms]
    whole = np.prod(ways)
    total = (np.polynomial.Polynomial([omega**2, 0.0, 1.0])) * whole
    for (g, tau), own in zip(terms, ways, strict=True):
        total += omega**2 * np.polynomial.Polynomial([0.0, g * tau]) * (whole // own)
    s = total.roots()
    return np.asarray(s[np.abs(s.imag) < 1e-9 * np.abs(s)].real)


@pytest.mark.slow_rows("steel on an obstacle")
@pytest.mark.parametrize("law", ["rubber", "steel on an obstacle"])
def test_resumed_equilibria_over_time_are_the_same_to_the_last_bit(law: str) -> None:
    """From before and after a jump of the load, and from between steps."""
    table = {"type": "expression", "value": "t if t < 0.2 else (0.5 + t if t < 0.3 else 0.2)"}
    case = beam(TYPES[0], ZENER, 0.5, 1e-3, loads=[{"type": "force", "at": "beam@1", "value": [0, -0.02],
                                                    "amplitude": table}])
    if law != "rubber":
        body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 2),
                "section": {"height": SIZE, "width": SIZE}, "material": {
                    "E": E, "nu": 0.3, "rho": 1000, "yield": 4e3, "hardening": {"isotropic": 1e5, "kinematic": 1e5}}}
        case = h.load({"beam": body}, {"type": "quasi_static", "t_end": 0.5, "tolerance": 1e-3},
                      bc=[{"type": "clamp", "at": "beam@0"}], output={"probes": {"tip": "beam@1"}},
                      obstacles={"floor": {"type": "half_plane", "through": [0, -0.08], "normal": [0, 1]}},
                      contacts=[{"name": "floor", "between": ["beam", "floor"], "side": "axis", "friction": 0.3,
                                 "law": {"stiffness": 100.0}}],
                      loads=[{"type": "force", "at": "beam@1", "value": [0.02, -0.1], "amplitude": table}])
    whole = list(solve(build_model(case)))
    jump = next(k for k, (a, b) in enumerate(itertools.pairwise(whole)) if b.t - a.t < 1e-12)
    for k in (jump // 2, jump, jump + 1, (jump + len(whole)) // 2):
        rest = list(solve(build_model(case), whole[k].checkpoint))
        assert len(rest) == len(whole) - k - 1
        np.testing.assert_array_equal(rest[-1].d, whole[-1].d)
        np.testing.assert_array_equal(rest[0].d, whole[k + 1].d)


CYCLE = {"terms": ((0.5, 0.1), (0.3, 0.02)), "hz": 2.0, "strain": 1e-4, "end": 2.0}


@pytest.mark.slow
def test_a_cycle_of_equilibria_loses_the_energy_of_the_loss_modulus() -> None:
    """After transients, u = e L Im(J exp(i omega t)) with J = E/E(i omega): -pi E e^2 Im J per volume."""
    terms, omega, end = CYCLE["terms"], 2 * np.pi * CYCLE["hz"], 2.5
    pull = [{"type": "force", "at": "beam@1", "value": [CYCLE["strain"] * E * SIZE**2, 0],
             "amplitude": {"type": "sine", "frequency": CYCLE["hz"]}}]
    done = ancf2d.solve(beam(TYPES[0], terms, end, 1e-4, loads=pull))
    last = done.course_t > end - 1.0 / CYCLE["hz"]
    t = done.course_t[last]
    found = np.linalg.lstsq(np.array([np.sin(omega * t), np.cos(omega * t)]).T, done.course["tip"]["ux"][last])[0]
    exact = CYCLE["strain"] * LENGTH / complex_modulus(1j * omega, terms)
    assert found == pytest.approx([exact.real, exact.imag], rel=1e-4)


@pytest.mark.slow
def test_time_advances_although_only_round_off_moves() -> None:
    """A triangle of rigid links is fixed and loaded; a beam next to it relaxes without load."""
    body = {"geometry": h.line(0.1), "element": h.element("reissner3", 1), "material": material(ZENER),
            "section": {"height": 0.003, "width": 0.006}}
    ends = {"c": [-0.229, 0.028], "d": [-0.071, -0.039]}
    links = {name: {"geometry": {"type": "line", "start": [-0.07, 0.054], "end": end},
                    "element": {"type": "rigid", "mass": 0.05, "inertia": 1e-3}} for name, end in ends.items()}
    done = ancf2d.solve(h.load(
        {"beam": body, **links}, {"type": "quasi_static", "t_end": 1.0, "tolerance": 2.7e-5},
        bc=[{"type": "clamp", "at": "beam@0"}, {"type": "pin", "at": "c@1"}, {"type": "pin", "at": "d@1"}],
        joints=[{"type": "pin", "between": ["c@0", "d@0"]}], output={"probes": {"corner": "c@0"}},
        loads=[{"type": "distributed", "on": "d", "value": [0.2, 1.0]}]))
    assert done.course_t[-1] == 1.0
    assert np.abs(done.course["corner"]["ux"]).max() < 1e-12
