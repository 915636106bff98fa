"""Solutions as data sets of xarray."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_api import TEXT

import ancf2d


@pytest.fixture(scope="module")
def solution() -> ancf2d.Solution:
    return ancf2d.solve(TEXT)


# the slow tests install it
@pytest.mark.slow
def test_a_solution_as_a_data_set_of_xarray(solution: ancf2d.Solution) -> None:
    xarray = pytest.importorskip("xarray")
    data = solution.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert data["uy"].dims == ("t", "probe")
    assert data["uy"].units == "m"
    np.testing.assert_array_equal(data["uy"].sel(probe="tip"), solution.course["tip"]["uy"])
    np.testing.assert_array_equal(data["d"], solution.d)
    np.testing.assert_array_equal(data["t_state"], solution.t)
    assert "d" not in solution.to_xarray(states=False)
    assert data.attrs["solver"] == "static"


@pytest.mark.slow
def test_fields_motions_and_modes_as_data_sets(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    case = {"output.fields": ["stress", "M"]}
    data = ancf2d.solve(TEXT, case).to_xarray()
    assert data["beam.M"].dims == ("state", "element_beam", "xi", "eta_1")
    assert data["beam.stress"].sel(component="xx").shape == (*data["beam.M"].shape[:3], data.sizes["eta_5"])
    modal = {"solver": {"type": "eigen", "modes": 2}, "loads": [], "goal": {"kind": "bending", "number": 1}}
    modes = ancf2d.solve(TEXT, modal).to_xarray()
    assert modes["mode_omega"].shape == (2,)
    assert modes["mode_shape"].dims == ("mode", "coordinate")


@pytest.mark.slow
def test_responses_linear_models_and_tables_as_data_sets() -> None:
    """C (i omega - A)^-1 B + D of the linear model is the frequency response."""
    pytest.importorskip("xarray")
    more: dict[str, Any] = {"loads.0.name": "push", "goal": None,
                            "bodies.beam.material.damping": {"kelvin_voigt": 1e-3}}
    response = ancf2d.solve(TEXT, more | {
        "solver": {"type": "frequency_response", "inputs": ["push"], "frequencies": [1, 5]}}).to_xarray()
    assert response["push.tip.uy"].dims == ("hz",)
    model = ancf2d.solve(TEXT, more | {
        "solver": {"type": "state_space", "inputs": ["push"], "outputs": ["tip.uy"], "modes": 8}}).to_xarray()
    assert model["outputs.output"].item() == "tip.uy"
    A, B, C, D = (model[name].to_numpy() for name in "ABCD")
    s = 2j * np.pi * 5
    np.testing.assert_allclose((C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D).item(),
                               response["push.tip.uy"].sel(hz=5).item(), rtol=1e-4)


def test_without_xarray_the_message_says_what_to_install(
        monkeypatch: pytest.MonkeyPatch, solution: ancf2d.Solution) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ImportError, match=r"pip install 'ancf2d\[xarray\]'"):
        solution.to_xarray()
