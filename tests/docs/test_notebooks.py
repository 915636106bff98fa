"""Every notebook of the documents runs from the first cell to the last and shows its figures and tables."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("xarray")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    book = nbformat.read(file, as_version=4)
    assert not any(cell.outputs for cell in book.cells if cell.cell_type == "code"), "commit it without outputs"
    nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    for cell in (c for c in book.cells if c.cell_type == "code"):
        last = cell.source.splitlines()[-1]
        shown = [out.get("data", {}) for out in cell.outputs]
        if ".plot(" in last:
            assert any("image/png" in data for data in shown), f"no figure from {last}"
        elif last.isidentifier():
            assert any("text/html" in data for data in shown), f"no table from {last}"
        assert not [out for out in cell.outputs if out.get("name") == "stderr"], cell.outputs
