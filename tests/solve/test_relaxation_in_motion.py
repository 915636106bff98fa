"""Motions of materials that relax: order, energy and resumed runs, compared with closed forms of viscoelasticity."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest
from scipy.linalg import expm
from test_relaxation import CYCLE, FORCE, LENGTH, PRONY, SIZE, TYPES, ZENER, E, beam, complex_modulus, material

import ancf2d
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.model.points import dot, point_ref
from ancf2d.solvers.motion import stepping
from ancf2d.solvers.motion.dynamic import solve_dynamic
from ancf2d.study.run import prepare


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
    """A clamped rubber beam under a sudden force, compared with all its modes: the error falls as h to the order."""
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


def test_other_methods_refuse_relaxing_materials() -> None:
    body = {"geometry": h.line(LENGTH), "element": h.element("cable", 1), "material": material(ZENER),
            "section": {"height": SIZE, "width": SIZE}}
    with pytest.raises(CaseError) as refused:
        ancf2d.solve(h.load({"beam": body}, {"type": "dynamic", "t_end": 1.0, "method": "energy_momentum"},
                            bc=[{"type": "clamp", "at": "beam@0"}]), states=False)
    # no other formulation would help
    (problem,) = refused.value.problems
    assert "energy_momentum does not support formulations with memory" in problem.message


def swing(dt: float, interval: float) -> Any:
    """Return the motion of a rubber pendulum, soft enough to bend, next to a bar that could yield."""
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
    """The dissipation of internal strains is summed over the stages; states in between follow their polynomials."""
    between, ends, fine = swing(2.5e-3, 6.25e-4), swing(2.5e-3, 0.01), swing(6.25e-4, 6.25e-4)
    strain = between.energies["strain"]
    np.testing.assert_array_equal(strain[::16], ends.energies["strain"])
    np.testing.assert_allclose(strain, fine.energies["strain"], atol=2e-4 * np.max(strain))
    coarse = between.summary["energy_drift"]
    assert coarse == pytest.approx(ends.summary["energy_drift"], rel=1e-3)
    assert 2.0**6 * fine.summary["energy_drift"] < coarse < 1e-6


def test_springs_of_a_stretched_bar_give_their_energy_to_their_dashpots() -> None:
    """A constant strain e stores E e^2/2 (1 + sum g exp(-2 t/tau)); in motion dissipation never falls.

    The first steps, which do not resolve the fastest vibrations, are off by the error of the stages.
    """
    held = [{"type": "prescribed", "at": "beam@1", "name": "end", "ux": 1e-6, "uy": 0, "angle": 0}]
    done = ancf2d.solve(beam(TYPES[0], PRONY, 20.0, 1e-3, bc=held), states=False)
    exact = 0.5 * E * SIZE**2 * 1e-12 * (1.0 + sum(g * np.exp(-2.0 * 20.0 / tau) for g, tau in PRONY))
    assert done.summary["energy"]["strain"] == pytest.approx(exact, rel=1e-6)
    swung = swing(2.5e-3, 2.5e-3).energies
    assert (np.diff(swung["dissipated"]) > -1e-8 * swung["strain"].max()).all()
    assert swung["dissipated"][-1] > 0.0


@pytest.mark.parametrize("solver", [{"method": "radau5", "tolerance": 1e-4}, {"method": "radau5", "dt": 5e-4},
                                    {"method": "generalized_alpha", "tolerance": 1e-4}],
                         ids=["radau5", "radau5-dt", "generalized_alpha"])
def test_a_resumed_motion_of_rubber_is_the_same_to_the_last_bit(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fixed steps of Radau's method continue with the earlier tangent of internal strains."""
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


def cycled() -> list[dict[str, Any]]:
    """Return the force at the fixed end of a bar of unit length whose other end oscillates."""
    move = {"type": "sine", "frequency": CYCLE["hz"], "scale": CYCLE["strain"]}
    return [{"type": "clamp", "at": "beam@0"}, {"type": "prescribed", "at": "beam@1", "name": "end", "ux": move,
                                                "uy": 0, "angle": 0}]


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
    """Two strains in each section with two points each, in contrast to the bar above with one."""
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
