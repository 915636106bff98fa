"""Stored states of materials with memory, read later: each with the memory of its elements at that state."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import helpers as h
import numpy as np
import pytest

import ancf2d
from ancf2d.results import open_results
from ancf2d.solvers.fields import FieldReader
from ancf2d.solvers.state_results import Observer, energies, reactions
from ancf2d.study.record import Progress
from ancf2d.study.run import run_case

E, YIELD, AREA, LENGTH = 2e11, 250e6, 1e-4, 0.2
FIRST = YIELD / E
MATERIALS: dict[str, dict[str, Any]] = {
    "yields": {"yield": YIELD, "hardening": {"isotropic": 1e10, "kinematic": 1e10}},
    "relaxes": {"viscoelastic": [{"modulus": 0.5, "time": 0.2}]}}


def pulled(material: str) -> Any:
    """Return a bar that is stretched to 4 e_y, back to zero and to half of that."""
    solver = {"type": "static", "steps": 8} if material == "yields" else {"type": "quasi_static", "t_end": 1,
                                                                           "tolerance": 1e-3}
    course = {"type": "table", "t": [0, 0.3, 0.7, 1], "value": [0, 4 * FIRST * LENGTH, 0, 2 * FIRST * LENGTH]}
    return h.load({"bar": {"geometry": h.line(LENGTH), "element": h.element("cable", 2),
                           "section": {"height": 0.01, "width": 0.01},
                           "material": {"E": E, "nu": 0.3, **MATERIALS[material]}}}, solver,
                  bc=[{"type": "clamp", "at": "bar@0"},
                      {"type": "prescribed", "at": "bar@1", "name": "end", "ux": course, "uy": 0, "angle": 0}],
                  output={"probes": {"mid": "bar@0.5"}, "fields": ["N", "strain", "stress"] if material == "yields"
                          else ["N"]})


@pytest.mark.slow_rows("relaxes")
@pytest.mark.parametrize("material", MATERIALS)
def test_section_forces_of_all_states_balance_their_reactions(material: str) -> None:
    states: list[Any] = []
    model = run_case(pulled(material), progress=Progress(state=states.append)).model
    observer, reader = Observer(model), FieldReader(model)
    pull = np.array([reactions(model, s)["end"]["fx"] for s in states])
    most = np.abs(pull).max()
    assert np.ptp(pull) > most
    np.testing.assert_allclose([observer.observe(s)["mid"]["N"] for s in states], pull, atol=1e-9 * most)
    for state, force in zip(states, pull, strict=True):
        np.testing.assert_allclose(reader.read(state)["bar", "N"], force, atol=1e-9 * most)
    # the elastic part of the first state, which knows nothing of the cycle to come
    first = next(s for s in states if s.t > 0)
    strain = np.interp(first.t, [0.0, 0.3], [0.0, 4 * FIRST])
    if material == "yields" and strain < FIRST:
        assert energies(model, first)["strain"] == pytest.approx(0.5 * E * strain**2 * AREA * LENGTH, rel=1e-9)


def test_a_file_begins_with_the_reference_without_memory(tmp_path: Path) -> None:
    """With few steps, the first one yields; the reference still has zero forces and stresses."""
    case = pulled("yields")
    run_case(case, str(tmp_path / "bar.h5"))
    with open_results(tmp_path / "bar.h5") as found:
        assert found.t[0] == 0.0
        assert found.probes["mid"]["N"][0] == 0.0
        assert not found.field("bar", "stress", 0).any()
        assert np.abs(found.field("bar", "stress", 1)).max() > 0.5 * YIELD


@pytest.mark.slow_rows("relaxes-generalized_alpha", "yields-generalized_alpha", "yields-radau5")
@pytest.mark.parametrize("method", ["radau5", "generalized_alpha"])
@pytest.mark.parametrize("material", MATERIALS)
def test_energy_is_in_balance_within_steps_too(material: str, method: str) -> None:
    """Dissipation of materials up to a time inside a step never falls, and the total is constant."""
    period = float(4 * LENGTH * np.sqrt(7850 / E))
    body = {"geometry": h.line(LENGTH), "element": h.element("cable", 2), "section": {"height": 0.01, "width": 0.01},
            "material": {"E": E, "nu": 0.3, "rho": 7850, **MATERIALS[material]}}
    if material == "relaxes":
        body["material"]["viscoelastic"] = [{"modulus": 0.5, "time": 0.2 * period}]
    case = h.load({"bar": body}, {"type": "dynamic", "t_end": 2 * period, "dt": period / 80, "method": method,
                                  "estimate": False},
                  bc=[{"type": "clamp", "at": "bar@0"}], output={"interval": period / 350}, loads=[
                      {"type": "force", "at": "bar@1", "value": [1.2 * YIELD * AREA, 0],
                       "amplitude": {"type": "expression", "value": f"sin(pi*t/{period!r})^2"}}])
    found = ancf2d.solve(case).energies
    size = np.max(found["kinetic"] + found["strain"])
    total = found["kinetic"] + found["strain"] + found["potential"] + found["dissipated"] - found["work"]
    assert found["dissipated"][-1] > 0.05 * size
    # the stages solve what relaxes to the fifth order; the rest is of second order
    close = 1e-6 if (material, method) == ("relaxes", "radau5") else 5e-3
    assert np.diff(found["dissipated"]).min() > -0.1 * close * size
    assert np.ptp(total) < close * size
