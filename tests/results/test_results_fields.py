"""Fields over the bodies in the result file: written and read, also after an interruption, and compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import HEADER, coordinates, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import (
    Checkpoint,
    FieldRecord,
    ResultWriter,
    compare_results,
    describe,
    describe_text,
    open_results,
)
from ancf2d.results import series as series_module

XI, ETA = np.linspace(0, 1, 3), np.linspace(-1, 1, 5)
E0 = coordinates("tangent", np.linspace(0, 2, 3), 0.0)
FIELDS = [FieldRecord("be/am", "stress", ("xx", "yy", "xy"), "{F}/{L}^2", "stress", XI, ETA),
          FieldRecord("be/am", "N", ("N",), "{F}", "axial force", XI, np.zeros(1))]


def values(t: float, change: float = 0.0) -> dict[tuple[str, str], np.ndarray]:
    stress = np.arange(2 * 3 * 5 * 3, dtype=float).reshape(2, 3, 5, 3) * t
    stress[1, 2, 4, 1] += change * t
    return {("be/am", "stress"): stress, ("be/am", "N"): np.full((2, 3, 1, 1), 1e3 * t)}


def states(w: ResultWriter, first: int, until: int, change: float = 0.0) -> None:
    for k in range(first, until):
        w.append(float(k), E0 * k, None, None, steps={"t": np.array([float(k)])}, fields=values(k, change),
                 checkpoint=Checkpoint(float(k), {"d": E0}, {}))


def written(path: Path, change: float = 0.0) -> Path:
    body = tangent_body("be/am", 2, 2.0, 0.1)
    with ResultWriter(path, {**HEADER, "solver": "dynamic"}, [body], E0, fields=FIELDS) as w:
        states(w, 0, 6, change)
        return w.finish({})


def test_fields_are_read_with_their_stations_components_and_units(tmp_path: Path) -> None:
    with open_results(written(tmp_path / "a.h5")) as results:
        stress = results.fields["be/am"]["stress"]
        assert (stress.components, stress.units) == (("xx", "yy", "xy"), "N/m^2")
        np.testing.assert_array_equal(stress.xi, XI)
        np.testing.assert_array_equal(stress.eta, ETA)
        for i in (0, 3, -1):
            np.testing.assert_array_equal(results.field("be/am", "stress", i), values(i % 6)[("be/am", "stress")])
        assert results.field("be/am", "N").shape == (2, 3, 1, 1)
        with pytest.raises(ResultsError, match="no field 'energy' of body 'be/am'"):
            results.field("be/am", "energy")
        with pytest.raises(ResultsError, match="no state 6: it holds 6"):
            results.field("be/am", "stress", 6)


@pytest.mark.parametrize("flushed", [True, False])
def test_a_resumed_run_continues_its_fields(tmp_path: Path, flushed: bool) -> None:
    path, header = tmp_path / "b.h5", {**HEADER, "solver": "dynamic"}
    w = ResultWriter(path, header, [tangent_body("be/am", 2, 2.0, 0.1)], E0, fields=FIELDS)
    states(w, 0, 3)
    if flushed:
        w.flush()
    w.finish({"reason": "stopped"}, "interrupted")
    w = ResultWriter.resume(path, header, E0)
    states(w, 3, 6)
    w.finish({})
    assert not compare_results(path, written(tmp_path / "a.h5"), rtol=0, everything=True)


@pytest.mark.parametrize("numbers", [1, 200, 1 << 17])  # blocks of one state, of two, of all
def test_a_difference_in_a_field_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: int) -> None:
    monkeypatch.setattr(series_module, "BLOCK", numbers)
    (found,) = compare_results(written(tmp_path / "a.h5"), written(tmp_path / "b.h5", change=1.0))
    assert found.dataset == "/fields/be/am/stress"
    assert found.index == (5, 1, 2, 4, 1)
    assert found.count == 5
    assert found.total == 6 * 90


def test_info_names_the_fields_with_their_units(tmp_path: Path) -> None:
    found = describe(written(tmp_path / "a.h5"))
    assert found["fields"]["be/am"]["stress"] == {"components": ["xx", "yy", "xy"], "units": "N/m^2",
                                                  "stations": [3, 5]}
    assert "fields      be/am: N [N], stress [N/m^2]" in describe_text(found)


def test_a_field_that_does_not_fit_its_body_is_damage(tmp_path: Path) -> None:
    import h5py

    path = written(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        group = file["fields/be%2Fam/N"]
        del group["values"]
        group["values"] = np.zeros((6, 7))
    with open_results(path) as results, pytest.raises(ResultsError, match="damaged"):
        results.field("be/am", "N")
