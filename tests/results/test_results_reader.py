"""Reading files from elsewhere: damaged, foreign, newer and hostile files are refused with an explanation."""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic import BODIES, HEADER, bent_beam, coordinates, table_file, tangent_body

from ancf2d.errors import ResultsError
from ancf2d.results import FieldRecord, ResultWriter, describe, describe_text, open_results, part_path, write_tables
from ancf2d.results import safe as safe_module
from ancf2d.results import series as series_module
from ancf2d.results import writer as writer_module
from ancf2d.results.geometry import axis_values, body_faces, body_levels, body_rates


def everything(path: Path) -> None:
    """Read all data."""
    describe_text(describe(path))
    with open_results(path) as r:
        _ = r.bodies, r.probes, r.history, r.tables, r.summary, r.case_text, r.case_completed
        for name in r.bodies:
            for i in (None, *range(r.nt)):
                r.faces(name, i)
                r.nodes(name, i)
        for name in r.arrays:
            r.array(name)


def test_a_missing_file_names_the_unfinished_one(tmp_path: Path) -> None:
    with pytest.raises(ResultsError, match=r"there is no result file '.*a\.h5'$"):
        open_results(tmp_path / "a.h5")
    bent_beam(tmp_path / "a.h5", finish=False)
    with pytest.raises(ResultsError, match=r"there is an unfinished '.*a\.h5\.part'"):
        open_results(tmp_path / "a.h5")


def test_files_that_are_no_results_are_named(tmp_path: Path) -> None:
    for name, content, words in (("case.yaml", b"format: 1\n", "is not an HDF5 file"),
                                 ("empty.h5", b"", "is empty")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ResultsError, match=f"{name}' {words}"):
            open_results(tmp_path / name)
    with h5py.File(tmp_path / "foreign.h5", "w") as f:
        f["data"] = np.zeros(3)
    with pytest.raises(ResultsError, match="an HDF5 file but not an ancf2d result"):
        open_results(tmp_path / "foreign.h5")
    with pytest.raises(ResultsError, match="is not a file"):
        open_results(tmp_path)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.6, 0.9, 0.999])
def test_a_truncated_file_is_reported_as_cut_off(tmp_path: Path, share: float) -> None:
    path = bent_beam(tmp_path / "a.h5")
    content = path.read_bytes()
    path.write_bytes(content[:int(share * len(content))])
    with pytest.raises(ResultsError, match=r"truncated|damaged"):
        open_results(path)


def test_flipped_bytes_raise_only_results_errors(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    places: list[int] = []

    def collect(_: str, node: object) -> None:
        if isinstance(node, h5py.Dataset) and (offset := node.id.get_offset()):
            places.extend(range(offset, offset + node.nbytes))

    with h5py.File(path) as f:
        f.visititems(collect)
    content, rng, refused = path.read_bytes(), np.random.default_rng(3), 0
    for _ in range(20):
        broken = bytearray(content)
        for at in rng.choice(places, 8):
            broken[at] ^= int(rng.integers(1, 256))
        path.write_bytes(broken)
        try:
            everything(path)
        except ResultsError:
            refused += 1
    assert 0 < refused < 20


def edited(tmp_path: Path, edit: Callable[[h5py.File], None]) -> Path:
    path = bent_beam(tmp_path / "a.h5")
    with h5py.File(path, "r+") as f:
        edit(f)
    return path


def replaced(name: str, **options: object) -> Callable[[h5py.File], None]:
    def edit(f: h5py.File) -> None:
        del f[name]
        f.create_dataset(name, **options)
    return edit


def external(f: h5py.File) -> None:
    del f["mesh/e0"]
    with h5py.File(Path(f.filename).with_name("other.h5"), "w") as other:
        other["e0"] = np.zeros(20)
    f["mesh/e0"] = h5py.ExternalLink("other.h5", "/e0")


def virtual(f: h5py.File) -> None:
    layout = h5py.VirtualLayout(shape=(20,), dtype=float)
    layout[:] = h5py.VirtualSource("other.h5", "d", shape=(20,))
    del f["mesh/e0"]
    f.create_virtual_dataset("mesh/e0", layout)


def outside(f: h5py.File) -> None:
    f["mesh/bodies/beam/dofs"][0, 0] = 10**6


HOSTILE = {
    "missing mesh": lambda f: f.__delitem__("mesh"),
    "missing states": lambda f: f.__delitem__("states"),
    "a link to another file": external,
    "a view of another file": virtual,
    "data in another file": replaced("mesh/e0", shape=(20,), dtype=float,
                                     external=[("/etc/passwd", 0, 160)]),
    "a link inside the file": lambda f: f.move("mesh/e0", "e0") or f.__setitem__(
        "mesh/e0", h5py.SoftLink("/e0")),
    "large and empty": replaced("mesh/e0", shape=(10**8,), dtype=float, chunks=(1000,)),
    "huge and empty": replaced("mesh/e0", shape=(10**13,), dtype=float, chunks=(1000,)),
    "huge states": replaced("states/d", shape=(6, 10**13), dtype=float, chunks=(1, 1000)),
    "huge chunks": replaced("states/t", shape=(6,), maxshape=(None,), dtype=float,
                            chunks=(4 * 10**8,), compression="gzip"),
    "bomb": replaced("mesh/bodies/beam/dofs", shape=(10**8, 8), dtype=np.int8,
                     chunks=(10**6, 8), compression="gzip"),
    "text for numbers": replaced("mesh/e0", data=np.bytes_("not numeric")),
    "numbers for text": replaced("summary", data=np.zeros(3)),
    "no JSON": replaced("summary", data=np.bytes_("{'a': 1")),
    "a JSON list": replaced("summary", data=np.bytes_("[1]")),
    "text of variable length": replaced("summary", data="{}"),
    "nested JSON": replaced("summary", data=np.bytes_("[" * 100_000)),
    "coordinates outside": outside,
    "fewer rows than counted": replaced("states/t", data=np.zeros(2)),
    "wrong dimension": replaced("mesh/bodies/beam/dofs", data=np.zeros(8, int)),
    "unknown section": lambda f: f["mesh/bodies/beam"].attrs.__setitem__("section_kind", "x"),
    "no counts": lambda f: f.attrs.__delitem__("committed"),
    "negative counts": lambda f: f.attrs.__setitem__("committed", np.array([-1, 0, 0])),
    "version in words": lambda f: f.attrs.__setitem__("format_version", "two"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_in_little_memory(tmp_path: Path, name: str) -> None:
    path = edited(tmp_path, HOSTILE[name])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ResultsError, match=r"a\.h5"):
        everything(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def test_a_newer_format_says_so(tmp_path: Path) -> None:
    path = edited(tmp_path, lambda f: f.attrs.__setitem__("format_version", 2))
    with pytest.raises(ResultsError, match=r"format 2, newer than the 1.*install a newer ancf2d"):
        open_results(path)


def test_unknown_groups_are_ignored(tmp_path: Path) -> None:
    path = edited(tmp_path, lambda f: f.create_group("VTKHDF"))
    everything(path)


def test_states_beyond_the_file_are_refused(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as r:
        np.testing.assert_array_equal(r.d(-1), r.d(5))
        for i in (6, -7):
            with pytest.raises(ResultsError, match=f"no state {i}: it holds 6"):
                r.d(i)
        with pytest.raises(ResultsError, match="does not hold v"):
            r.v(0)
        with pytest.raises(ResultsError, match=r"no body 'bem'.*beam"):
            r.faces("bem")


# ---------------------------------------------------------------------- rows and blocks of them


def motion(path: Path, states: int = 7) -> Path:
    """Write a motion with rates, a field, probes, energies, a table and an array."""
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    field = FieldRecord("beam", "N", ("N",), "{F}", "axial force", np.linspace(0, 1, 3), np.zeros(1))
    with ResultWriter(path, HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0, fields=[field]) as w:
        for k in range(states):
            w.append(float(k), e0 * k, {"step": k}, {"tip": {"ux": float(k)}}, v=e0 - k,
                     energies={"kinetic": float(k)}, fields={("beam", "N"): np.full((2, 3, 1, 1), 1.0 + k)})
        w.table("convergence", {"element": ["cable"], "error": [0.1]})
        w.array("modes/shapes", np.eye(3), "1", "mode shapes")
        return w.finish({})


def test_every_dataset_is_checked_once_while_its_file_is_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checked: Counter[str] = Counter()
    check = safe_module._check_storage
    monkeypatch.setattr(safe_module, "_check_storage", lambda dataset: checked.update([dataset.name]) or check(dataset))
    with open_results(motion(tmp_path / "a.h5")) as r:
        _ = r.t, r.history, r.energies, r.tables, r.probes, r.probe_t, r.bodies, r.fields, r.summary
        for i in range(r.nt):
            _ = r.d(i), r.v(i), r.e(i), r.faces("beam", i), r.field("beam", "N", i), r.array("modes/shapes")
        for name in "dv":
            assert r.holds(name)
            _ = r.rows(name), list(r.blocks(name))
        assert len(list(r.field_blocks("beam", "N"))) == 1
    assert {"/mesh/e0", "/states/d", "/states/v", "/fields/beam/N/values", "/probes/tip/ux", "/history/step",
            "/tables/convergence/element", "/arrays/modes/shapes"} <= checked.keys()
    assert set(checked.values()) == {1}, checked.most_common(3)


@pytest.mark.parametrize(("numbers", "lengths"), [(1, [1] * 7), (30, [2, 2, 2, 1]), (1 << 17, [7])])
def test_blocks_are_the_rows_in_bounded_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, numbers: int,
                                               lengths: list[int]) -> None:
    monkeypatch.setattr(series_module, "BLOCK", numbers)
    with open_results(motion(tmp_path / "a.h5")) as r:
        blocks = list(r.blocks("v"))
        assert [len(block) for block in blocks] == lengths
        np.testing.assert_array_equal(np.concatenate(blocks), [r.v(i) for i in range(7)])
        np.testing.assert_array_equal(np.concatenate(blocks), r.rows("v"))
        fields = list(r.field_blocks("beam", "N"))
        assert max(block.size for block in fields) <= max(numbers, 6)
        np.testing.assert_array_equal(np.concatenate(fields), [r.field("beam", "N", i) for i in range(7)])
        with pytest.raises(ResultsError, match="does not hold a of its states"):
            r.blocks("a")
        with pytest.raises(ResultsError, match="no field 'M' of body 'beam'"):
            r.field_blocks("beam", "M")


def test_an_open_file_does_not_change_while_its_run_continues(tmp_path: Path,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "FLUSH_SECONDS", 0.0)
    e0 = coordinates("tangent", np.linspace(0, 1, 3), 0.0)
    w = ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("beam", 2, 1.0, 0.1)], e0)
    for k in range(3):
        w.append(float(k), e0 + k)
    with open_results(part_path(tmp_path / "a.h5")) as r:
        first = r.d(0)
        for k in range(3, 300):
            w.append(float(k), e0 + k)
        w.finish({})
        assert r.nt == 3
        np.testing.assert_array_equal(r.rows("d"), [first, r.d(1), e0 + 2])
        np.testing.assert_array_equal(np.concatenate(list(r.blocks("d"))), r.rows("d"))
        with pytest.raises(ResultsError, match="no state 3: it holds 3"):
            r.d(3)
    with open_results(tmp_path / "a.h5") as r:
        assert r.nt == 300


def test_a_field_with_fewer_rows_than_states_is_damage(tmp_path: Path) -> None:
    path = motion(tmp_path / "a.h5")
    with h5py.File(path, "r+") as f:
        replaced("fields/beam/N/values", data=np.zeros((3, 6)))(f)
    with open_results(path) as r:
        assert not r.field("beam", "N", 2).any()
        for read in (lambda: r.field("beam", "N", 3), lambda: r.field("beam", "N"),
                     lambda: list(r.field_blocks("beam", "N"))):
            with pytest.raises(ResultsError, match=r"a\.h5' is damaged"):
                read()


@pytest.mark.parametrize("name", ["d", "v"])
def test_whole_numbers_in_place_of_states_are_damage_that_names_them(tmp_path: Path, name: str) -> None:
    path = motion(tmp_path / "a.h5")
    with h5py.File(path, "r+") as f:
        replaced(f"states/{name}", data=np.ones(f[f"states/{name}"].shape, int))(f)
    with open_results(path) as r:
        for read in (getattr(r, name), r.e if name == "d" else r.v):
            with pytest.raises(ResultsError, match=rf"a\.h5' is damaged .*/states/{name} has numbers of type int64"):
                read(1)


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 1e308])
def test_points_that_overflow_are_silent_and_do_not_affect_other_elements(kind: str, value: float) -> None:
    body, e = BODIES[kind]("beam", 3, 2.0, 0.1), coordinates(kind, np.linspace(0, 2, 4), 0.3)
    v = np.random.default_rng(0).normal(size=len(e))
    per_node = len(e) // 4
    for k in range(per_node):
        far = e.copy()
        far[k] = value
        for found in (body_levels, partial(body_rates, v=v)):
            np.testing.assert_array_equal(found(body, e=far)[:, 1:], found(body, e=e)[:, 1:])
        s = np.array([0.1, 0.5, 0.9])
        np.testing.assert_array_equal(axis_values(body, far, s)[1:], axis_values(body, e, s)[1:])
        if not np.isfinite(value) and k < 2:
            assert not np.isfinite(body_faces(body, far)["axis"][0, :, k]).any()
    # and nothing else is silent afterwards
    assert np.geterr()["invalid"] == "warn"


@pytest.mark.parametrize("kind", ["tangent", "interpolated", "theta"])
def test_faces_of_a_circular_arc_lie_on_circles(tmp_path: Path, kind: str) -> None:
    angle, length, height = 1.0, 2.0, 0.1
    path = bent_beam(tmp_path / "a.h5", kind, ne=8, angle=angle, length=length, height=height)
    with open_results(path) as r:
        faces, nodes = r.faces("beam"), r.nodes("beam")
        reference = r.faces("beam", None)
    radius, centre = length / angle, np.array([0.0, length / angle])
    # interpolation between nodes: 1 - cos(angle/ne/2) of the radius at worst for linear ones
    atol = 1e-5 if kind == "tangent" else radius * (1 - np.cos(angle / 16)) * 1.1
    for name, offset in (("axis", 0.0), ("top", -height / 2), ("bottom", height / 2)):
        distance = np.linalg.norm(faces[name] - centre, axis=-1)
        np.testing.assert_allclose(distance, radius + offset, rtol=0, atol=atol)
    exact = coordinates("theta", np.linspace(0, length, 9), angle / length).reshape(-1, 3)
    np.testing.assert_allclose(nodes, exact[:, :2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(reference["top"][..., 1], height / 2, rtol=0, atol=1e-15)
    np.testing.assert_allclose(reference["axis"][-1, -1], [length, 0], rtol=0, atol=1e-14)


def test_magnified_faces_scale_the_displacements(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5", angle=1e-3)) as r:
        one, ten = (r.faces("beam", -1, scale=s)["axis"] for s in (1.0, 10.0))
        start = r.faces("beam", None)["axis"]
        np.testing.assert_allclose(ten - start, 10 * (one - start), rtol=0, atol=1e-14)


def test_selected_elements_are_those_of_the_whole(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5", ne=9)) as r:
        whole = r.faces("beam")["top"]
        np.testing.assert_array_equal(r.faces("beam", elements=slice(None, None, 4))["top"],
                                      whole[::4])


# ---------------------------------------------------------------------- info


def test_info_lists_the_contents_of_a_file(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5")
    found = describe(path)
    assert found["bytes"] == path.stat().st_size
    assert (found["dofs"], found["states"], found["steps"]) == (20, 6, 6)
    assert found["bodies"]["beam"] == {"element": "cable", "formulation": "centreline",
                                       "elements": 4, "nodes": 5, "length": 2.0, "heights": None}
    assert found["probes"]["tip"]["theta"] == {"value": 1.0, "units": "rad"}
    assert found["made"]["overrides"] == ["bodies.beam.element.count=4"]
    text = describe_text(found)
    for words in ("Cantilever with a tip load", "static, converged", "ancf2d run cantilever.yaml",
                  "20 nodal coordinates, 6 states", "theta = 1 rad", "strain = 12.5 N m",
                  "numpy 2", "bodies.beam.element.count=4", "4 elements cable"):
        assert words in text, words


def test_info_of_an_unfinished_file_says_so(tmp_path: Path) -> None:
    path = bent_beam(tmp_path / "a.h5", finish=False)
    text = describe_text(describe(path))
    assert "interrupted" in text
    assert "stopped" in text


def test_info_lists_limit_points_and_events(tmp_path: Path) -> None:
    e0 = coordinates("tangent", np.array([0.0, 1.0]), 0.0)
    with ResultWriter(tmp_path / "a.h5", HEADER, [tangent_body("b", 1, 1.0, 0.1)], e0) as w:
        w.append(1.0, 0 * e0, {})
        hit = {"t": 0.25, "body": "rod", "touched": "floor", "S": 0.5, "impulse": 2.0}
        w.finish({"limit_points": [{"factor": 2.5, "probes": {}}], "bifurcations": [{"factor": 1.25}],
                  "events": [{"t": 0.1 * k, "what": f"stop {k} ends"} for k in range(12)],
                  "impacts": {"count": 7, "first": hit, "strongest": {**hit, "t": 0.5, "impulse": 3.0}}})
    text = describe_text(describe(tmp_path / "a.h5"))
    for words in ("load factor 1\n", "limit point 1 at load factor 2.5\n", "bifurcation 1 at load factor 1.25\n",
                  "event       stop 9 ends at 0.9 s\n", "event       and 2 more", "impacts     7\n",
                  "first       rod on floor at 0.25 s, S = 0.5: 2 N s\n",
                  "strongest   rod on floor at 0.5 s, S = 0.5: 3 N s\n"):
        assert words in text, words


def test_info_lists_tables(tmp_path: Path) -> None:
    path = table_file(tmp_path / "a.h5", {"cable": 4.0})
    assert describe(path)["tables"]["convergence"]["rows"] == 4
    assert "convergence: 4 rows of element, formulation" in describe_text(describe(path))
    with open_results(path) as r:
        assert r.tables["convergence"]["element"] == ["cable"] * 4
        assert r.tables["convergence"].attrs == {"goal": "tip uy"}
        assert np.isnan(r.tables["convergence"]["order"][0])


def test_info_of_a_study_has_no_mesh_size(tmp_path: Path) -> None:
    path = write_tables(tmp_path / "a.h5", HEADER, {"sweep": ({"height": [0.1, 0.2]}, {})}, (), {})
    text = describe_text(describe(path))
    assert "sweep: 2 rows of height" in text
    assert "nodal coordinate" not in text
