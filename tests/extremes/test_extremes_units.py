"""The same scene in other units gives the same numbers, and modes are found at any slenderness."""

from __future__ import annotations

import helpers
import pytest
from instruments.extremes import modes, scaling
from instruments.extremes.scenes import DEFAULTS
from instruments.extremes.statics import slender

UNITS = dict(scaling.AXES["all units"])


@helpers.covering({"label": ["vallejo", "cable", "reissner3"]},
                  label=[s.label for s in DEFAULTS if s.label != "ancf[3,3]"],
                  scene=["linear statics", "statics", "arc length", "modes", "buckling"], units=UNITS)
def test_statics_modes_and_buckling_do_not_depend_on_units(label: str, scene: str, units: str) -> None:
    """Coordinates like r_yy have units of their own: in micrometres their numbers are 1e6 times those of r_y."""
    assert scaling.compared(scene, label, UNITS[units]).error < scaling.SAME


# SciPy's integrators are given their tolerances alike: one in larger units, one in smaller ones
@pytest.mark.parametrize(("scene", "units"), helpers.chosen(
    [*((f"motion, {method}", units) for method in ("radau5", "energy_momentum") for units in UNITS),
     *zip(("motion, RK45", "motion, BDF"), list(UNITS)[1:], strict=True)], [("motion, radau5",)]))
def test_motions_do_not_depend_on_units(scene: str, units: str) -> None:
    assert scaling.compared(scene, "cable", UNITS[units]).error < scaling.SAME


@pytest.mark.parametrize("label", ["vallejo", "reissner3", "kerkkanen", "ancf[2,2]", "cable"])
@pytest.mark.parametrize("ratio", [1e2, 1e6])
def test_bending_of_a_very_slender_beam_is_not_a_rigid_motion(label: str, ratio: float) -> None:
    """Its eigenvalue is 1e-8 of the shift that keeps the factors of K positive, not 0."""
    assert modes.first_bending(label, slender(ratio), 16).error < 0.02


@pytest.mark.parametrize("label", ["vallejo", "reissner3", "cable", "ancf[2,2]", "ancf[3,3]"])
@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e5, 1e6, 1e7])
def test_a_free_beam_has_three_rigid_modes(label: str, ratio: float) -> None:
    found = modes.free_modes(label, slender(ratio), 16)
    assert found.error < 0.01
    assert not found.warnings


@pytest.mark.parametrize("label", ["vallejo", "reissner2", "reissner3", "cable", "ancf[2,2]", "ancf[3,3]"])
@pytest.mark.parametrize("ratio", [1e8, 1e9, 1e10, 1e11])
def test_modes_hidden_by_round_off_are_reported(label: str, ratio: float) -> None:
    """The assembled stiffness has no digit of bending left; computed from strains it still has some."""
    found = modes.free_modes(label, slender(ratio), 16)
    assert found.error < 0.01 or any("round-off" in text for text in found.warnings)


@pytest.mark.parametrize("label", ["vallejo", "reissner3"])
@pytest.mark.parametrize("ratio", [1e5, 1e7])
def test_damped_pairs_hidden_by_round_off_are_reported(label: str, ratio: float) -> None:
    found = modes.damped_bending(label, slender(ratio), 16)
    assert any("round-off" in text for text in found.warnings) == (ratio > 1e5)
    assert found.error < 0.01 or ratio > 1e5
