"""Reading a case costs little: validation must feel immediate."""

import subprocess
import sys
import time
from pathlib import Path

from ancf2d.case import load_case

HERE = Path(__file__).parent


def test_importing_the_case_room_brings_no_numerics():
    code = ("import sys, ancf2d.case; "
            "print([m for m in ('numpy', 'scipy', 'numba', 'h5py', 'matplotlib', 'click') "
            "if m in sys.modules])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_a_small_case_loads_within_milliseconds(vocabulary):
    best = 1.0
    for _ in range(5):
        start = time.perf_counter()
        load_case(HERE / "valid" / "frame.yaml", vocabulary=vocabulary)
        best = min(best, time.perf_counter() - start)
    assert best < 0.02


def test_a_long_table_is_linear_in_its_length(vocabulary, tmp_path):
    times = ", ".join(str(i) for i in range(20000))
    text = (HERE / "valid" / "simply_supported.yaml").read_text().replace(
        "value: [0, -1000]}",
        f"value: [0, -1000], amplitude: {{type: table, t: [{times}], value: [{times}]}}}}")
    path = tmp_path / "long.yaml"
    path.write_text(text)
    start = time.perf_counter()
    loaded = load_case(path, vocabulary=vocabulary)
    assert time.perf_counter() - start < 3.0
    assert loaded.case.loads[0].amplitude.value(19998.5) == 19998.5
