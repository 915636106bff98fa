"""Result files with damage that HDF5 does not detect."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from synthetic import HEADER, bent_beam, coordinates, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import ResultWriter, describe, open_results
from ancf2d.results.export import export
from ancf2d.view import make_page

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _bounded() -> Iterator[None]:
    """End the process if HDF5 loops forever: nothing else can stop it."""
    signal.alarm(20)
    yield
    signal.alarm(0)


def collections(content: bytes) -> list[int]:
    """Return the places where HDF5 stores texts of variable length."""
    found, at = [], content.find(b"GCOL")
    while at >= 0:
        found.append(at)
        at = content.find(b"GCOL", at + 1)
    return found


@pytest.mark.parametrize(("index", "size"), [(0, 0), (1, 2**64 - 16), (1, 2**63), (7, 10**6)])
def test_dangling_texts_are_damage(tmp_path: Path, index: int, size: int) -> None:
    path = bent_beam(tmp_path / "a.h5")
    content = bytearray(path.read_bytes())
    at = collections(bytes(content))[0] + 16
    content[at:at + 2], content[at + 8:at + 16] = index.to_bytes(2, "little"), size.to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=r"a\.h5' is damaged"):
        describe(path)


def test_the_signature_of_texts_within_data_is_no_damage(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file["other"] = np.frombuffer(b"GCOL\x01\x00\x00\x00" + (2**60).to_bytes(8, "little") + bytes(64), np.uint8)
    assert describe(path)["status"] == "converged"


@pytest.mark.parametrize("name", ["dofs", "nodes", "classes", "node_shape"])
def test_numbers_of_coordinates_are_whole(tmp_path: Path, name: str) -> None:
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        group: Any = file["mesh/bodies/beam"]
        values = group[name][()]
        del group[name]
        group[name] = values.astype(float)
    with open_results(path) as found, pytest.raises(ResultsError, match=f"{name} are not whole numbers"):
        _ = found.bodies


def test_a_page_of_modes_without_their_frequencies(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0) as writer:
        writer.append(0.0, np.zeros(12))
        writer.table("modes", {"kind": ["bending"], "number": [1]})
        writer.array("modes/shapes", np.ones((1, 12)), "1", "shapes")
        writer.finish({})
    with open_results(tmp_path / "a.h5") as found:
        assert "mode 1" in make_page(found).html


def test_a_page_of_probes_that_are_not_numbers(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0) as writer:
        for k in range(3):
            writer.append(float(k), np.zeros(12), probes={"tip": {"x": np.nan}})
        writer.finish({})
    with open_results(tmp_path / "a.h5") as found:
        assert '"probes": []' in make_page(found).html.replace('"probes":[]', '"probes": []')


@pytest.mark.parametrize("place", ["probes/tip/uy", "history/iterations", "energies/strain"])
def test_texts_in_place_of_numbers_are_damage(tmp_path: Path, place: str) -> None:
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0) as writer:
        for k in range(3):
            writer.append(float(k), np.zeros(12), history={"iterations": 3}, probes={"tip": {"uy": 0.0}},
                          energies={"strain": 0.0})
        writer.finish({})
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        del file[place]
        file[place] = np.array(["a", "b", "c"], dtype="S1")
    with open_results(tmp_path / "a.h5") as found, pytest.raises(ResultsError, match=r"a\.h5' is damaged"):
        _ = found.probes, found.history, found.energies


def test_more_states_than_the_file_holds_are_damage(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["committed"] = np.array([2**62] * 3, np.int64)
    with pytest.raises(ResultsError, match=r"damaged .*states where \d+ were stored"):
        open_results(path)


@pytest.mark.parametrize("place", ["states/t", "states/d", "mesh/e0", "probes/tip/uy", "history/energy"])
def test_numbers_too_long_for_python_are_damage(tmp_path: Path, place: str) -> None:
    """JSON and pages cannot contain such numbers."""
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        values = file[place][()]
        del file[place]
        file[place] = values.astype(np.longdouble)
    if np.dtype(np.longdouble).itemsize == 8:
        pytest.skip("here they are no longer than others")
    with pytest.raises(ResultsError, match="unknown compression or type"):
        export(path, tmp_path / ("a.vtkhdf" if place == "states/d" else "a.json"))


def test_attributes_too_long_for_python_are_left_out(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["wall_time_s"] = np.longdouble(1)
    if np.dtype(np.longdouble).itemsize > 8:
        assert describe(path)["made"]["wall_time_s"] is None
