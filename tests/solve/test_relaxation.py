"""Materials that relax, in equilibria over time, beside closed forms of linear viscoelasticity."""

from __future__ import annotations

import itertools
from typing import Any

import helpers as h
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import ancf2d
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.model.points import dot, point_ref
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.solvers.post import reactions
from ancf2d.solvers.registry import solve
from ancf2d.study.run import prepare

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
    """The instantaneous response at t = 0, then 1 - g/(1 + g) exp(-t/((1 + g) tau)), of bending and shear alike."""
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
    """Of a spring a thousand times the long-time one the beam is Maxwell's: its deflection grows by a rate for long."""
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    done = ancf2d.solve(beam(kind, terms, end, loads=load))
    whole = ancf2d.solve(beam(kind, (), 1.0, loads=load)).course["tip"]["uy"][-1]
    exact = creep(done.course_t, terms)
    error = np.abs(done.course["tip"]["uy"] / whole - exact) / np.maximum.accumulate(exact)
    assert 1e-8 < error.max() < 1e-6
    if end == 50.0:
        np.testing.assert_allclose(exact, (1.0 + done.course_t) / 1001.0, rtol=0.03)


def test_one_kernel_serves_any_number_of_terms() -> None:
    """Bodies of one and of five terms side by side call the same compiled law, and relax each by its own terms."""
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


def test_steps_are_told_in_time() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    states = list(solve(build_model(beam(TYPES[0], ZENER, 0.5, 1e-3, loads=load))))
    steps = [(s.history["t"], s.history["dt"]) for s in states]
    assert all("factor" not in s.history for s in states)
    assert steps[0] == (0.0, 0.0)
    assert steps[-1][0] == 0.5
    assert sum(dt for _, dt in steps) == pytest.approx(0.5)


@pytest.mark.slow
def test_five_terms_creep_over_decades_as_accurately_as_asked_for() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, FORCE]}]
    whole = ancf2d.solve(beam(TYPES[0], (), 1.0, loads=load)).course["tip"]["uy"][-1]
    for tolerance in (1e-3, 1e-4):
        done = ancf2d.solve(beam(TYPES[0], PRONY, 100.0, tolerance, loads=load))
        error = np.abs(done.course["tip"]["uy"] / whole - creep(done.course_t, PRONY)).max()
        assert 1e-3 * tolerance < error < tolerance


def test_a_stretched_bar_relaxes_exactly() -> None:
    """Strains that do not change make no error: F = E A e (1 + sum g exp(-t/tau))."""
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": 1e-6, "uy": 0, "angle": 0}]
    case = beam(TYPES[0], PRONY, 20.0, bc=held)
    found = h.Solution(build_model(case))
    t = np.array([s.t for s in found.states])
    force = [reactions(found.model, s)["end"]["fx"] for s in found.states]
    exact = E * SIZE**2 * 1e-6 * (1.0 + sum(g * np.exp(-t / tau) for g, tau in PRONY))
    np.testing.assert_allclose(force, exact, rtol=1e-9)


def test_a_ramp_of_strain_is_exact_and_a_jump_takes_no_time() -> None:
    """F/(E A) = e + sum g e' tau (1 - exp(-t/tau)) along a ramp of any step; behind a jump 1 + sum g of it."""
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
def test_the_force_of_what_is_moved_is_as_accurate_as_asked_for(tolerance: float) -> None:
    """Where all is moved only stress is unknown: F/(E A) = e(t) + sum g h, h' = e' - h/tau, in a pulse of e."""
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


def test_statics_are_those_of_the_long_time() -> None:
    load = [{"type": "force", "at": "beam@1", "value": [0, 0.05]}]
    ends = [h.cantilever(h.element("reissner3", 2), load, length=LENGTH, section={"height": SIZE, "width": SIZE},
                         material=material(terms)).u("beam@1") for terms in ((), PRONY)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-9)


def test_an_elastic_arch_follows_its_load_over_time() -> None:
    """Without memory, the states are those of statics at the load of each moment."""
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


def exact_motion(t: float, terms: tuple[tuple[float, float], ...], omega: np.ndarray, phi: np.ndarray, force: float
                 ) -> float:
    """Return the deflection at t of a force from t = 0 on: q'' + omega^2 (q + sum g h) = phi F, h' = q' - h/tau."""
    total, n = 0.0, len(terms)
    for w, p in zip(omega, phi, strict=True):
        A = np.zeros((2 + n, 2 + n))
        A[0, 1], A[1, 0] = 1.0, -w * w
        for k, (g, tau) in enumerate(terms):
            A[1, 2 + k], A[2 + k, 1], A[2 + k, 2 + k] = -w * w * g, 1.0, -1.0 / tau
        rest = np.linalg.solve(A, -np.eye(2 + n)[1] * p * force)
        total += p * float((rest - expm(A * t) @ rest)[0])
    return total


@pytest.mark.slow_rows("generalized_alpha-(150, 300)-2")
@pytest.mark.parametrize(("method", "steps", "order"), h.chosen(
    [("generalized_alpha", (150, 300), 2), ("newmark", (150, 300), 2), ("radau5", (30, 60), 5), ("radau9", (5, 8), 9)],
    ["generalized_alpha", "radau9"]))
def test_motions_keep_the_order_of_their_steps(method: str, steps: tuple[int, int], order: int) -> None:
    """A clamped beam of rubber under a sudden force, beside all of its modes: the error falls as h to the order."""
    terms = ((0.5, 0.05), (0.3, 0.5))
    body = {"geometry": h.line(LENGTH), "element": h.element("cable", 1), "material": material(terms),
            "section": {"height": SIZE, "width": SIZE}}
    bc, elastic = [{"type": "clamp", "at": "beam@0"}], {**body, "material": material(())}
    modes = ancf2d.solve(h.load({"beam": elastic}, {"type": "eigen", "modes": 4}, bc=bc))
    across = point_ref(build_model(h.load({"beam": elastic}, "static", bc=bc)).meshes["beam"], 1.0).position()[1]
    phi = np.array([dot(across, shape) for shape in modes.arrays["modes/shapes"]])
    omega = np.array([f["omega"] for f in modes.summary["frequencies"]])
    exact, error = exact_motion(0.6, terms, omega, phi, FORCE), []
    for dt in (0.6 / n for n in steps):
        done = ancf2d.solve(h.load(
            {"beam": body}, {"type": "dynamic", "t_end": 0.6, "dt": dt, "method": method, "estimate": False}, bc=bc,
            loads=[{"type": "force", "at": "beam@1", "value": [0, FORCE]}], output={"probes": {"tip": "beam@1"}}),
                            states=False)
        error.append(abs(done.probes["tip"]["uy"] / exact - 1.0))
    assert error[1] < 2e-3
    found = np.log(error[0] / error[1]) / np.log(steps[1] / steps[0])
    assert abs(found - order) < 0.25 * order


def test_other_methods_refuse_what_relaxes() -> None:
    body = {"geometry": h.line(LENGTH), "element": h.element("cable", 1), "material": material(ZENER),
            "section": {"height": SIZE, "width": SIZE}}
    with pytest.raises(CaseError) as refused:
        ancf2d.solve(h.load({"beam": body}, {"type": "dynamic", "t_end": 1.0, "method": "energy_momentum"},
                            bc=[{"type": "clamp", "at": "beam@0"}]), states=False)
    # no other formulation would help
    (problem,) = refused.value.problems
    assert "energy_momentum does not support formulations with memory" in problem.message


def swing(dt: float, interval: float) -> Any:
    """Return the motion of a pendulum of rubber, soft enough to bend, beside a bar that could yield."""
    rod = {"geometry": h.line(0.1), "element": h.element("cable", 1), "section": {"height": SIZE, "width": SIZE},
           "material": {"E": E, "rho": 1000, "nu": 0.3, "yield": 1e9}}
    rubber = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 1), "material": material(ZENER),
              "section": {"height": SIZE, "width": SIZE}}
    return ancf2d.solve(h.load(
        {"rubber": rubber, "rod": rod}, {"type": "dynamic", "t_end": 0.2, "dt": dt, "method": "radau5",
                                         "estimate": False},
        bc=[{"type": "pin", "at": "rubber@0"}, {"type": "clamp", "at": "rod@0"}],
        loads=[{"type": "gravity", "value": [0, -9.81], "name": "weight"}], output={"interval": interval}))


@pytest.mark.slow
def test_a_swing_of_rubber_balances_its_energy_to_the_order_of_the_stages() -> None:
    """What internal strains take is summed over the stages; states between them are those of their polynomials."""
    between, ends, fine = swing(2.5e-3, 6.25e-4), swing(2.5e-3, 0.01), swing(6.25e-4, 6.25e-4)
    strain = between.energies["strain"]
    np.testing.assert_array_equal(strain[::16], ends.energies["strain"])
    np.testing.assert_allclose(strain, fine.energies["strain"], atol=2e-4 * np.max(strain))
    coarse = between.summary["energy_drift"]
    assert coarse == pytest.approx(ends.summary["energy_drift"], rel=1e-3)
    assert 2.0**6 * fine.summary["energy_drift"] < coarse < 1e-6


def test_springs_of_a_stretched_bar_give_their_energy_to_their_dashpots() -> None:
    """Of a strain e that is held, E e^2/2 (1 + sum g exp(-2 t/tau)) is stored; in motion what is lost never falls.

    The first steps, which do not resolve the fastest vibrations, are off by the error of the stages.
    """
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": 1e-6, "uy": 0, "angle": 0}]
    done = ancf2d.solve(beam(TYPES[0], PRONY, 20.0, 1e-3, bc=held), states=False)
    exact = 0.5 * E * SIZE**2 * 1e-12 * (1.0 + sum(g * np.exp(-2.0 * 20.0 / tau) for g, tau in PRONY))
    assert done.summary["energy"]["strain"] == pytest.approx(exact, rel=1e-6)
    swung = swing(2.5e-3, 2.5e-3).energies
    assert (np.diff(swung["dissipated"]) > -1e-8 * swung["strain"].max()).all()
    assert swung["dissipated"][-1] > 0.0


@pytest.mark.slow_rows("steel on an obstacle")
@pytest.mark.parametrize("law", ["rubber", "steel on an obstacle"])
def test_resumed_equilibria_over_time_are_the_same_to_the_last_bit(law: str) -> None:
    """From before and behind a jump of the load, and from within a stretch of steps."""
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


@pytest.mark.parametrize("solver", [{"method": "radau5", "tolerance": 1e-4}, {"method": "radau5", "dt": 5e-4},
                                    {"method": "generalized_alpha", "tolerance": 1e-4}],
                         ids=["radau5", "radau5-dt", "generalized_alpha"])
def test_a_resumed_motion_of_rubber_is_the_same_to_the_last_bit(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fixed steps of Radau's method go on with a tangent of internal strains that were before."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 1), "material": material(ZENER),
            "section": {"height": SIZE, "width": SIZE}}
    loaded = h.load({"rubber": body}, {"type": "dynamic", "t_end": 0.1, **solver}, output={"interval": 2e-3},
                    bc=[{"type": "pin", "at": "rubber@0"}], loads=[{"type": "gravity", "value": [0, -9.81]}])
    monkeypatch.setattr(stepping, "CHUNK_SECONDS", 0.0)
    whole = list(solve_dynamic(prepare(loaded), loaded.case.solver))
    kept = [s.checkpoint for s in whole if s.checkpoint is not None]
    half = kept[len(kept) // 2]
    assert half["states"].any()
    *_, last = solve_dynamic(prepare(loaded), loaded.case.solver, half)
    np.testing.assert_array_equal(last.d, whole[-1].d)
    assert last.history["dissipated"] == whole[-1].history["dissipated"]


CYCLE = {"terms": ((0.5, 0.1), (0.3, 0.02)), "hz": 2.0, "strain": 1e-4, "end": 2.0}


def cycled() -> list[dict[str, Any]]:
    """Return what holds a bar of unit length at one end and moves its other one to and fro."""
    move = {"type": "sine", "frequency": CYCLE["hz"], "scale": CYCLE["strain"]}
    return [{"type": "clamp", "at": "beam@0"}, {"type": "prescribed", "at": "beam@1", "name": "end", "ux": move,
                                                "uy": 0, "angle": 0}]


@pytest.mark.slow
def test_a_cycle_of_equilibria_loses_the_energy_of_the_loss_modulus() -> None:
    """Once transients have died, u = e L Im(J exp(i omega t)) with J = E/E(i omega): -pi E e^2 Im J per volume."""
    terms, omega, end = CYCLE["terms"], 2 * np.pi * CYCLE["hz"], 2.5
    pull = [{"type": "force", "at": "beam@1", "value": [CYCLE["strain"] * E * SIZE**2, 0],
             "amplitude": {"type": "sine", "frequency": CYCLE["hz"]}}]
    done = ancf2d.solve(beam(TYPES[0], terms, end, 1e-4, loads=pull))
    last = done.course_t > end - 1.0 / CYCLE["hz"]
    t = done.course_t[last]
    found = np.linalg.lstsq(np.array([np.sin(omega * t), np.cos(omega * t)]).T, done.course["tip"]["ux"][last])[0]
    exact = CYCLE["strain"] * LENGTH / complex_modulus(1j * omega, terms)
    assert found == pytest.approx([exact.real, exact.imag], rel=1e-4)


@pytest.mark.slow_rows("2d3n-nu")
@pytest.mark.parametrize("kind", TYPES[:4:3], ids=lambda k: k[0])
def test_a_cycle_of_motion_loses_the_energy_of_the_loss_modulus(kind: tuple[str, str | None]) -> None:
    """Waves along the bar make it A E k cot(k L) with k^2 = rho omega^2/E(i omega): pi e^2 times its imaginary part.

    ``generalized_alpha`` loses it to its second order, ``radau5`` to a millionth.
    """
    omega = 2 * np.pi * CYCLE["hz"]
    modulus = E * complex_modulus(1j * omega, CYCLE["terms"])
    k = omega * np.sqrt(1000 / modulus)
    exact = np.pi * CYCLE["strain"]**2 * (SIZE**2 * modulus * k / np.tan(k)).imag
    body = {"geometry": h.line(LENGTH), "element": h.element(kind[0], 4, kind[1]),
            "material": {**material(CYCLE["terms"]), "nu": 0.0}, "section": {"height": SIZE, "width": SIZE}}

    def off(method: str, dt: float) -> float:
        lost = ancf2d.solve(h.load({"beam": body}, {"type": "dynamic", "t_end": CYCLE["end"], "dt": dt,
                                                    "method": method, "estimate": False}, bc=cycled(),
                                   output={"interval": 0.5 / CYCLE["hz"]})).energies["dissipated"]
        return float((lost[-1] - lost[-3]) / exact - 1.0)
    coarse, fine = off("generalized_alpha", 0.01), off("generalized_alpha", 0.005)
    assert abs(coarse) < 5e-3
    assert 3.8 < coarse / fine < 4.2
    assert abs(off("radau5", 0.0125)) < 1e-6


def test_the_balance_of_energy_of_a_beam_that_bends_is_of_second_order() -> None:
    """Two strains in each section and two points to each, beside the bar's one above."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 2), "material": material(CYCLE["terms"]),
            "section": {"height": SIZE, "width": SIZE}}

    def drift(dt: float) -> float:
        return float(ancf2d.solve(h.load(
            {"beam": body}, {"type": "dynamic", "t_end": 0.5, "dt": dt, "method": "newmark", "estimate": False},
            bc=[{"type": "clamp", "at": "beam@0"}], output={"interval": 0.5}, loads=[
                {"type": "force", "at": "beam@1", "value": [0, -1e-3 * E * SIZE**4 / LENGTH**2],
                 "amplitude": {"type": "expression", "value": "sin(12*t)^2"}}]), states=False).summary["energy_drift"])
    coarse, fine = drift(0.01), drift(0.005)
    assert coarse < 5e-3
    assert 3.5 < coarse / fine < 4.5


@pytest.mark.slow
def test_time_goes_on_where_nothing_moves_but_by_round_off() -> None:
    """A triangle of rigid links is held, and loaded; a beam beside it, which relaxes, is not."""
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
