"""Animations: the requested number of frames, fixed axes, explained refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter, PillowWriter
from PIL import Image
from synthetic import bent_beam, mechanism

from ancf2d.errors import ResultsError
from ancf2d.plot import animate, frames
from ancf2d.plot.body import even_states
from ancf2d.results import open_results


def test_a_gif_has_the_frames_and_their_rate(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        path = animate(results, tmp_path / "a.gif", length=5, fps=10)
    with Image.open(path) as image:
        assert image.n_frames == 5
        assert image.info["duration"] == 100
        assert image.info["loop"] == 0
    assert [p.name for p in tmp_path.glob("*part*")] == []


def test_all_frames_show_the_same_part_of_the_plane(tmp_path: Path) -> None:
    with open_results(mechanism(tmp_path / "a.h5")) as results:
        pictures = list(frames(results, length=5))
        assert [p.note for p in pictures] == [f"t = {t:g} s" for t in np.linspace(0, 1, 5)]
        for picture in pictures:
            np.testing.assert_array_equal(picture.box, pictures[0].box)
            for part in picture.parts:
                inside = part.deformed.boundary
                assert (picture.box[0] <= inside.min(axis=0)).all()
                assert (inside.max(axis=0) <= picture.box[1]).all()
        rod = pictures[2].parts[1].deformed
        np.testing.assert_array_equal(rod.axis, results.faces("rod", 20)["axis"].reshape(-1, 2))


@pytest.mark.slow
def test_the_axes_are_fixed_from_the_first_frame_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def noted(writer: PillowWriter, **options: object) -> None:
        axes = writer.fig.axes[0]
        title = axes.title.get_window_extent()
        seen.append([*axes.get_xlim(), *axes.get_ylim(), *axes.get_position().bounds])
        assert title.y1 <= writer.fig.bbox.y1
        original(writer, **options)

    original = PillowWriter.grab_frame
    monkeypatch.setattr(PillowWriter, "grab_frame", noted)
    words = "A title that fills its line so well that the time of a later state needs a line of"
    for kind in ("shape", None):
        with open_results(mechanism(tmp_path / "a.h5")) as results:
            animate(results, tmp_path / "a.gif", kind, length=4, title=words)
        assert len(seen) == 4
        np.testing.assert_allclose(seen, [seen[0]] * 4, rtol=0, atol=1e-12)
        seen.clear()


def test_labels_are_not_cut(tmp_path: Path) -> None:
    results = open_results(bent_beam(tmp_path / "a.h5", angle=0.7, length=0.325, height=0.02))
    with Image.open(animate(results, tmp_path / "a.gif", "shape", length=2)) as image:
        middle = np.asarray(image.convert("L"))[image.height // 4:image.height // 2]
    # the label of y, not the numbers beside the axis, is what stands first
    assert 0 < np.argmax(middle.min(axis=0) < 128) < 10


def test_frames_are_even_in_time_or_in_number_if_a_path_turns_back() -> None:
    assert list(even_states(np.array([0.0, 0.1, 0.2, 0.9, 1.0]), 3)) == [0, 2, 4]
    assert list(even_states(np.array([0.0, 2.0, 1.0, 3.0, 4.0]), 3)) == [0, 2, 4]
    assert list(even_states(np.arange(3.0), 10)) == [0, 1, 2]


def test_results_without_animation_are_explained(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as results:
        with pytest.raises(ResultsError, match="history cannot be animated; shape, fields, modes can"):
            animate(results, tmp_path / "a.gif", "history")
        with pytest.raises(ResultsError, match=r"animations are \.gif or \.mp4 files"):
            animate(results, tmp_path / "a.avi")
        with pytest.raises(ResultsError, match="shape has no option 'state'"):
            animate(results, tmp_path / "a.gif", "shape", state=3)
        with pytest.raises(ResultsError, match="cannot write"):
            animate(results, tmp_path / "none" / "a.gif", "shape", length=2)


def test_mp4_without_ffmpeg_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    said = pytest.raises(ResultsError, match=r"ffmpeg.*write a \.gif")
    with open_results(bent_beam(tmp_path / "a.h5")) as results, said:
        animate(results, tmp_path / "a.mp4")


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_mp4_is_written_with_ffmpeg(tmp_path: Path) -> None:
    with open_results(bent_beam(tmp_path / "a.h5")) as results:
        assert animate(results, tmp_path / "a.mp4", length=3).read_bytes()[4:8] == b"ftyp"
