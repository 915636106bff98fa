"""Figures and their data as files, reproducible to the byte; no display unless requested."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from helpers import chosen
from synthetic import bent_beam, mechanism, table_file

from ancf2d.errors import ResultsError
from ancf2d.plot import data_csv, draw, save, show
from ancf2d.results import open_results

ROOT = Path(__file__).parents[2]


@pytest.mark.slow_rows(".pdf-%PDF", ".svg-<?xml")
@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"),
                                               (".svg", b"<?xml"),
                                               pytest.param(".PNG", b"\x89PNG", marks=pytest.mark.slow)])
def test_a_figure_is_written_in_the_format_of_its_suffix(tmp_path: Path, suffix: str,
                                                         magic: bytes) -> None:
    figure = draw(open_results(bent_beam(tmp_path / "a.h5")))
    assert save(figure, tmp_path / f"a{suffix}").read_bytes().startswith(magic)


@pytest.mark.parametrize("suffix", chosen([".svg", ".pdf", ".png"], [".svg"]))
def test_equal_figures_are_equal_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                       suffix: str) -> None:
    results = open_results(mechanism(tmp_path / "a.h5"))
    one = save(draw(results), tmp_path / f"1{suffix}").read_bytes()
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    two = save(draw(results), tmp_path / f"2{suffix}").read_bytes()
    assert one == two


def test_an_unknown_suffix_names_the_known_ones(tmp_path: Path) -> None:
    figure = draw(open_results(bent_beam(tmp_path / "a.h5")))
    for name in ("a.xyz", "a"):
        with pytest.raises(ResultsError, match=r"suffix.*\.pdf, .*\.png, .*\.svg"):
            save(figure, tmp_path / name)
    with pytest.raises(ResultsError, match=r"cannot write .*does not exist"):
        save(figure, tmp_path / "none" / "a.png")


def test_glyphs_missing_from_the_font_do_not_fail(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5", header={"title": "梁 beam"})
    save(draw(open_results(path)), tmp_path / "a.png")


@pytest.mark.parametrize("kind", chosen(["shape", "load_deflection", "snapshots", "history"], ["shape"]))
def test_dollar_signs_in_units_and_titles_are_text(tmp_path: Path, kind: str) -> None:
    odd = "$\\frac{$"
    header = {"title": odd, "units": {"length": odd, "force": odd, "time": odd}}
    save(draw(open_results(bent_beam(tmp_path / "a.h5", header=header)), kind), tmp_path / "a.png")


@pytest.mark.slow
def test_file_names_that_are_not_utf_8_can_be_drawn(tmp_path: Path) -> None:
    one, other = (bent_beam(tmp_path / f"{name}\udcff.h5", header={"title": ""}) for name in "ab")
    with open_results(one) as a, open_results(other) as b:
        for kind in ("shape", "load_deflection"):
            save(draw([a, b], kind, title="\udcff"), tmp_path / "\udcff.svg")
            data_csv([a, b], tmp_path / "\udcff.csv", kind)


def test_drawing_leaves_the_global_settings_alone(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    save(draw(open_results(bent_beam(tmp_path / "a.h5"))), tmp_path / "a.png")
    assert dict(mpl.rcParams) == before


def read(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


def test_the_data_of_a_load_deflection_curve_at_full_precision(tmp_path: Path) -> None:
    results = open_results(bent_beam(tmp_path / "a.h5"))
    header, rows = read(data_csv(results, tmp_path / "a.csv", "load_deflection"))
    assert header == ["curve", "displacement [m]", "load factor"]
    found = [(float(x), float(y)) for name, x, y in rows if name == "tip uy"]
    np.testing.assert_array_equal(found, np.stack([results.probes["tip"]["uy"],
                                                   results.probe_t], 1))


def test_the_data_of_a_shape_are_the_points_drawn(tmp_path: Path) -> None:
    results = open_results(bent_beam(tmp_path / "a.h5", angle=1e-4))
    header, rows = read(data_csv(results, tmp_path / "a.csv", "shape", scale=1))
    assert header == ["body", "state", "x_axis [m]", "y_axis [m]", "x_top [m]", "y_top [m]",
                      "x_bottom [m]", "y_bottom [m]"]
    deformed = np.array([row[2:] for row in rows if row[1] == "deformed"], float)
    faces = results.faces("beam")
    np.testing.assert_array_equal(deformed, np.hstack([faces[k].reshape(-1, 2)
                                                       for k in ("axis", "top", "bottom")]))


def test_the_data_of_several_panels_and_tables(tmp_path: Path) -> None:
    header, rows = read(data_csv(open_results(mechanism(tmp_path / "a.h5")), tmp_path / "a.csv"))
    assert header == ["curve", "time [s]", "displacement [m]", "rotation [rad]"]
    filled = {(row[0].split()[1], tuple(bool(value) for value in row[2:])) for row in rows}
    assert filled == {("ux", (True, False)), ("uy", (True, False)), ("theta", (False, True))}
    assert {row[0] for row in rows} == {f"{p} {q}" for p in ("end", "pin")
                                        for q in ("ux", "uy", "theta")}
    table = open_results(table_file(tmp_path / "b.h5", {"cable": 4.0}))
    header, rows = read(data_csv(table, tmp_path / "b.csv"))
    assert header == ["curve", "number of elements", "relative error of tip uy"]
    assert rows[0] == ["cable", "2.0", "0.03125"]


@pytest.mark.slow
def test_showing_without_a_display_says_what_to_do(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    code = ("from ancf2d.plot import show; from ancf2d.results import open_results\n"
            "from ancf2d.errors import ResultsError\n"
            f"try: show(open_results({str(path)!r}))\n"
            "except ResultsError as error: print(error)")
    env = {k: v for k, v in os.environ.items()
           if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=ROOT, env=env)
    assert "no display" in done.stdout
    assert "--save" in done.stdout


def test_showing_draws_into_a_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib.pyplot as plt

    shown = []
    monkeypatch.setattr(plt, "get_backend", lambda: "tkagg")
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf()))
    show(open_results(bent_beam(tmp_path / "a.h5")), "shape")
    (figure,) = shown
    assert figure.axes[0].get_xlabel() == "x [m]"
    plt.close("all")


@pytest.mark.slow
def test_drawing_never_imports_pyplot() -> None:
    code = "import sys, ancf2d.plot; print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=ROOT)
    assert done.stdout.strip() == "False"
