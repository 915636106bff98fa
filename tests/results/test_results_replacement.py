"""ancf2d replaces files that it has made; it replaces others only with force."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers import chosen
from matplotlib.figure import Figure
from synthetic import bent_beam

from ancf2d.errors import ResultsError
from ancf2d.plot import animate, data_csv, save
from ancf2d.plot.style import Look
from ancf2d.results import check_output, open_results
from ancf2d.results.export import export
from ancf2d.results.target import CASE as CASE_FILE
from ancf2d.results.target import PAGE, RESULTS, TABLE, is_own

MEASURED = """\
t,tip.uy
0,0.0
0.1,-0.021
"""
CASE = "# drawn by ancf2d-output\nformat: 1\nbodies: {}\n"


def figure(folder: Path, path: Path, force: bool) -> None:
    # a file is marked whatever is drawn in it
    save(Figure(figsize=(1, 1)), path, force=force)


def moving(folder: Path, path: Path, force: bool) -> None:
    with open_results(folder / "a.h5") as results:
        animate(results, path, length=2, look=Look(dpi=20), force=force)


def data(folder: Path, path: Path, force: bool) -> None:
    kind = path.stem.partition("-")[2]
    with open_results(folder / "a.h5") as results:
        data_csv(results, path, kind, force=force)


def exported(folder: Path, path: Path, force: bool) -> None:
    export(folder / "a.h5", path, force)


def result(folder: Path, path: Path, force: bool) -> None:
    bent_beam(path, force=force)


Make = Callable[[Path, Path, bool], None]
MADE: dict[str, Make] = {
    **dict.fromkeys(("f.png", "f.svg", "f.pdf", "f.eps", "f.jpg", "f.tif", "f.webp"), figure), "m.gif": moving,
    **dict.fromkeys(("d-shape.csv", "d-load_deflection.csv", "d-snapshots.csv"), data),
    **dict.fromkeys(("e.csv", "e.json", "e.vtkhdf"), exported), "r.h5": result}


@pytest.mark.parametrize("name", chosen(MADE, ["f.png", "d-shape.csv", "e.vtkhdf", "r.h5"]))
def test_only_files_of_ancf2d_are_replaced(tmp_path: Path, name: str) -> None:
    bent_beam(tmp_path / "a.h5")
    path = tmp_path / name
    MADE[name](tmp_path, path, False)
    assert is_own(path)
    MADE[name](tmp_path, path, False)
    for text in (CASE, MEASURED, "{}", "mine", "") if name == "r.h5" else (CASE, ""):
        path.write_text(text)
        with pytest.raises(ResultsError, match="was not made by ancf2d"):
            MADE[name](tmp_path, path, False)
        assert path.read_text() == text
    MADE[name](tmp_path, path, True)
    assert is_own(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", name]


def test_a_table_is_recognised_by_its_header(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    for header, own in (("t,tip.x,tip.y,tip.ux,tip.uy,tip.theta,tip.vx,tip.vy", True), ("t,tip.uy", False),
                        ("factor,a.x,a.y,a.ux,a.uy,a.theta,b.uy", False),
                        ("factor,a.x,a.y,a.ux,a.uy,a.theta,wall.fx,wall.fy,wall.m", True),
                        ("t,a.x,a.y,a.ux,a.uy,a.theta,motor.output,motor.z,load.s", True),
                        ("t,a.x,a.y,a.ux,a.uy,a.theta,loads.1.at.s,motor.output", True),
                        ("t,a.x,a.y,a.ux,a.uy,a.theta,measured", False), ("t", False), ("x,y", False),
                        ("curve", False),
                        ("curve,displacement [m],load factor", True),
                        ("curve,time [s],displacement [m],rotation [rad]", True),
                        ("curve,path,share,standard error", True), ("path,value,change of tip uy [m]", True),
                        ("path,value,change", False), ("face,time [s],s [m],pressure [N/m]", True),
                        ("face,load factor [1],s [m],pressure [N/m]", True), ("face,time", False),
                        ("quantity,body,s [m],x [m],y [m],value", True), ("EI,status,elements", False),
                        ("EI,status,tip uy,elements,dofs,wall_s,estimate,output,reason", True)):
        path.write_text(f"{header}\n")
        assert is_own(path) is own, header


def test_a_truncated_result_is_still_recognised(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) // 2])
    assert bent_beam(path).read_bytes()[:4] == whole[:4]
    with open_results(path) as found:
        assert found.status == "converged"


@pytest.mark.parametrize(("name", "said"), [
    ("", "is empty"), (".", "is a folder"), ("/", "is a folder"), ("..", "is a folder"), ("folder", "in the way"),
    ("folder/..", "is a folder"), ("none/a", "does not exist"), ("a.h5/b", "is not a folder"), ("x" * 300, "too long"),
    ("/dev/null", "is a device"), ("a.h5", "is an input")])
@pytest.mark.parametrize("force", [False, True])
def test_odd_names_of_output_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str,
                                               force: bool) -> None:
    monkeypatch.chdir(tmp_path)
    bent_beam(tmp_path / "a.h5")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ResultsError, match=said):
        check_output(name, force, "a.h5")


@pytest.mark.parametrize(("kind", "own"), [(RESULTS, "a.h5"), (CASE_FILE, "a.yaml"), (PAGE, "a.html"),
                                           (TABLE, "a.csv")])
def test_no_file_has_the_suffix_of_another_format(tmp_path: Path, kind: str, own: str) -> None:
    for name in ("a.h5", "a.yaml", "a.html", "a.csv", "a.JSON", "a.png", "a.vtkhdf", "a", "a.v2", "a.b.part"):
        path = tmp_path / name
        if name == own or Path(name).suffix in ("", ".v2", ".part"):
            check_output(path, True, kind=kind)
        else:
            with pytest.raises(ResultsError, match=f"does not have the format of .*{own}'"):
                check_output(path, True, kind=kind)


def test_a_writer_refuses_the_suffix_of_another_format(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"expected for example '.*probes\.h5'"):
        bent_beam(tmp_path / "probes.csv")
    assert not [*tmp_path.iterdir()]
