"""Killed at a random moment: what is on disk is readable, or there is nothing."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from ancf2d.results import open_results, part_path

HERE = Path(__file__).parent

ENDLESS = """
import sys
sys.path[:0] = {paths!r}
import numpy as np
import ancf2d.results.writer as writer
from synthetic import HEADER, coordinates, tangent_body
writer.FLUSH_SECONDS = {flush}
e0 = coordinates("tangent", np.linspace(0, 1, {ne} + 1), 0.0)
print("ready", flush=True)
with writer.ResultWriter({path!r}, HEADER, [tangent_body("beam", {ne}, 1.0, 0.1)], e0) as w:
    for i in range(10**9):
        w.append(i, np.full(len(e0), float(i)), {{"step": i}}, {{"tip": {{"x": i}}}})
"""


def test_a_kill_at_any_moment_leaves_a_readable_file_or_none(tmp_path: Path) -> None:
    rng, paths = random.Random(5), [str(HERE.parents[1]), str(HERE)]
    reached = 0
    for k in range(8):
        path = tmp_path / f"{k}.h5"
        code = ENDLESS.format(paths=paths, flush=rng.choice([0.0, 0.002]), path=str(path),
                              ne=rng.choice([4, 200]))
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(rng.uniform(0, 0.25))
            process.kill()
        assert not path.exists()
        if not part_path(path).exists():
            continue
        with open_results(part_path(path)) as r:
            reached += r.nt
            np.testing.assert_array_equal(r.t, np.arange(r.nt))
            for i in sorted({0, r.nt // 2, r.nt - 1}) if r.nt else ():
                np.testing.assert_array_equal(r.d(i), float(i))
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".part"] * len(list(tmp_path.iterdir()))
    assert reached > 0
