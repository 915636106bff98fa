"""The neo-Hookean law compared with its energy, and bodies of it with closed forms."""

from __future__ import annotations

from typing import Any

import helpers as h
import numpy as np
import pytest
from scipy.optimize import brentq

import ancf2d
from ancf2d.elements.formulations.green import elasticity
from ancf2d.elements.neo_hooke import internal
from ancf2d.elements.section import Section
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model

E, NU, HEIGHT, WIDTH, LENGTH = 2e6, 0.4, 0.1, 0.05, 1.0
MU, LAMBDA = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
RUBBER = {"E": E, "nu": NU, "law": "neo_hooke"}
BAR = {"geometry": h.line(LENGTH), "element": h.element("vallejo", 1, "continuum"), "material": RUBBER,
       "section": {"height": HEIGHT, "width": WIDTH}}


def energy(eps: np.ndarray) -> float:
    """Return W of Green's strain (3,) at the thickness for zero transverse stress."""
    C = np.array([[1 + 2 * eps[0], eps[2]], [eps[2], 1 + 2 * eps[1]]])
    det = np.linalg.det(C)
    c = brentq(lambda v: MU * (v - 1) + 0.5 * LAMBDA * np.log(det * v), 1e-6, 1e6, xtol=1e-15, rtol=1e-15)
    log_j = 0.5 * np.log(det * c)
    return float(0.5 * MU * (np.trace(C) + c - 3 - 2 * log_j) + 0.5 * LAMBDA * log_j**2)


def law(eps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stress (3,) and dS/dE (3, 3) as in the kernels."""
    G = 0.9 * MU
    ref = np.array([MU, LAMBDA, E, NU, G])[:, None]
    new, slope = np.zeros((3, 1)), np.zeros((3, 3, 1))
    internal(ref, eps[:, None], None, new, slope, 1)
    D, _ = elasticity(Section(1.0, 1.0, E, NU, 1.0, EA=E, kGA=G, EI=1.0))
    return D @ (eps - new[:, 0]), D @ (np.eye(3) - slope[:, :, 0])


@pytest.mark.parametrize("eps", [(0.0, 0.0, 0.0), (1.5, -0.25, 0.4), (-0.3, 0.4, -0.2), (0.02, 0.01, 0.8)])
def test_stress_and_tangent_are_the_derivatives_of_the_energy(eps: tuple[float, ...]) -> None:
    at, small = np.array(eps), 1e-5
    S, T = law(at)
    steps = small * np.eye(3)
    np.testing.assert_allclose(S, [(energy(at + e) - energy(at - e)) / (2 * small) for e in steps], atol=1e-6 * E)
    columns = [(law(at + e)[0] - law(at - e)[0]) / (2 * small) for e in steps]
    np.testing.assert_allclose(T, np.transpose(columns), atol=1e-6 * E)
    np.testing.assert_allclose(T, T.T, atol=1e-12 * E)


def test_small_strains_keep_their_digits() -> None:
    D, _ = elasticity(Section(1.0, 1.0, E, NU, 1.0, EA=E, kGA=MU, EI=1.0))
    eps = np.array([1e-9, -3e-10, 5e-10])
    np.testing.assert_allclose(law(eps)[0], D @ eps, rtol=1e-7)


def pull(force: float) -> float:
    """Return the elongation of a bar on rollers."""
    case = h.load({"rod": BAR}, {"type": "static", "steps": 5}, bc=[
        {"type": "pin", "at": "rod@0"}, {"type": "roller", "at": "rod@1", "fixed": "y"}],
        loads=[{"type": "force", "at": "rod@1", "value": [force, 0]}], output={"probes": {"tip": "rod@1"}})
    return float(ancf2d.solve(case, states=False).probes["tip"]["ux"])


@pytest.mark.parametrize("stretch", [0.8, 1.5, 3.0])
def test_a_bar_in_tension_and_compression(stretch: float) -> None:
    """P = mu (l - c/l) in tension by l; for the squared transverse stretch c, mu (c - 1) + lambda ln(l c) = 0."""
    c = brentq(lambda v: MU * (v - 1) + LAMBDA * np.log(stretch * v), 1e-3, 1e3, xtol=1e-15, rtol=1e-15)
    force = HEIGHT * WIDTH * MU * (stretch - c / stretch)
    assert pull(force) == pytest.approx((stretch - 1) * LENGTH, rel=1e-8)


def test_a_cantilever_in_small_bending_is_that_of_linear_material() -> None:
    """In the limit of small strains the law is linear elasticity in plane stress, without a shear factor."""
    load = [{"type": "force", "at": "beam@1", "value": [0, 1e-6]}]
    tips = [h.cantilever({**h.element("vallejo", 2, "continuum"), **factor}, load, length=LENGTH, material=material,
                         section={"height": HEIGHT, "width": WIDTH}).u("beam@1")[1]
            for material, factor in ((RUBBER, {}), ({"E": E, "nu": NU}, {"shear_factor": "none"}))]
    assert tips[0] == pytest.approx(tips[1], rel=1e-7)


def test_the_tangent_of_a_body_is_exact() -> None:
    system = ancf2d.system(h.load({"rod": BAR}, "static", bc=[{"type": "clamp", "at": "rod@0"}], loads=[
        {"type": "force", "at": "rod@1", "value": [10.0, 5.0]}]))
    z = 0.05 * np.random.default_rng(1).standard_normal(len(system.names))
    K, small = system.tangent(z).toarray(), 1e-6
    columns = [(system.residual(z + e) - system.residual(z - e)) / (2 * small) for e in small * np.eye(len(z))]
    np.testing.assert_allclose(K, np.transpose(columns), atol=1e-6 * np.abs(K).max())


@pytest.mark.parametrize(("element", "words"), [
    (h.element("vallejo", 2, "structural"), "does not support the law neo_hooke"),
    (h.element("cable", 2), "does not support the law neo_hooke"),
    ({**h.element("vallejo", 2, "continuum"), "shear_factor": 0.8}, "no shear factor"),
    ({**h.element("vallejo", 2, "continuum"), "quadrature": {"normal": [2, 2], "shear": [1, 1]}}, "one quadrature")])
def test_formulations_without_the_law_are_refused(element: dict[str, Any], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        build_model(h.load({"rod": {**BAR, "element": element}}, "static", bc=[{"type": "clamp", "at": "rod@0"}]))


def test_a_bar_of_rubber_swings_without_loss() -> None:
    """Under a sudden force that stretches it by a fifth, the energy is that of W: the drift is that of the steps."""
    body, drifts = {**BAR, "material": {**RUBBER, "rho": 1000.0}}, []
    for dt in (2e-3, 5e-4):
        done = ancf2d.solve(h.load(
            {"bar": body}, {"type": "dynamic", "t_end": 0.2, "dt": dt, "method": "radau5", "estimate": False},
            bc=[{"type": "clamp", "at": "bar@0"}],
            loads=[{"type": "force", "at": "bar@1", "value": [0.1 * E * HEIGHT * WIDTH, 20.0]}],
            output={"probes": {"tip": "bar@1"}}))
        assert done.course["tip"]["ux"].max() > 0.2 * LENGTH
        assert not done.energies["dissipated"].any()
        drifts.append(done.summary["energy_drift"])
    assert drifts[0] < 1e-4
    assert drifts[1] < drifts[0] / 2.0**6


def test_the_strain_energy_of_statics_is_that_of_the_law() -> None:
    """A bar stretched by 1.5 between frictionless faces stores A L W."""
    found = ancf2d.solve(h.load({"bar": BAR}, {"type": "static", "steps": 2}, bc=[
        {"type": "clamp", "at": "bar@0", "hold": "section"},
        {"type": "prescribed", "at": "bar@1", "ux": 0.5 * LENGTH, "uy": 0, "angle": 0}]), states=False)
    long = 0.5 * (1.5**2 - 1.0)
    across = brentq(lambda v: law(np.array([long, v, 0.0]))[0][1], -0.4, 0.0, xtol=1e-14)
    exact = HEIGHT * WIDTH * LENGTH * energy(np.array([long, across, 0.0]))
    assert found.summary["energy"]["strain"] == pytest.approx(exact, rel=2e-2)


def test_a_slender_column_of_rubber_buckles_like_a_linear_one() -> None:
    load = [{"type": "force", "at": "bar@1", "value": [-1.0, 0]}]
    factors = []
    for material in (RUBBER, {"E": E, "nu": NU}):
        body = {"geometry": h.line(LENGTH), "element": h.element("2d3n-nu", 6, "continuum"), "material": material,
                "section": {"height": 0.02, "width": WIDTH}}
        solved = ancf2d.solve(h.load({"bar": body}, {"type": "buckling", "modes": 1},
                                     bc=[{"type": "clamp", "at": "bar@0"}], loads=load), states=False)
        factors.append(solved.summary["load_factors"][0])
    assert factors[0] == pytest.approx(factors[1], rel=5e-3)
