"""Shared by the tests of case/: a vocabulary, and the corpus of valid cases."""

from pathlib import Path

import pytest

from ancf2d.case import Vocabulary

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def vocabulary():
    return Vocabulary(
        element_types=("omar", "kerkkanen", "vallejo", "2d2n", "2d3n", "ancf", "cable",
                       "reissner2", "reissner3", "rigid"),
        formulations=("continuum", "enhanced", "strain_split", "structural"),
        nodal_coordinates=("x", "y", "rx_x", "rx_y", "ry_x", "ry_y", "theta"),
        integrators=("radau5", "generalized_alpha", "RK45", "Radau"),
        output_fields=("stress", "strain", "energy", "plastic_strain", "pressure", "traction", "gap", "N", "Q", "M"))


@pytest.fixture(scope="session")
def valid_cases():
    """Paths of the valid cases, which between them use the whole format."""
    return sorted((HERE / "valid").glob("*.yaml"))
