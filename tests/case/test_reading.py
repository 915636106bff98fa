"""Modules imported to read a case, and long cases."""

import subprocess
import sys
from pathlib import Path

import pytest

from ancf2d.case import load_case
from ancf2d.errors import CaseError

HERE = Path(__file__).parent


def test_importing_the_case_room_brings_no_numerics():
    code = ("import sys, ancf2d.case; "
            "print([m for m in ('numpy', 'scipy', 'numba', 'h5py', 'matplotlib', 'click') "
            "if m in sys.modules])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_a_table_of_20000_points_is_read_completely(vocabulary, tmp_path):
    times = ", ".join(str(i) for i in range(20000))
    text = (HERE / "valid" / "simply_supported.yaml").read_text().replace(
        "value: [0, -1000]}",
        f"value: [0, -1000], amplitude: {{type: table, t: [{times}], value: [{times}]}}}}")
    path = tmp_path / "long.yaml"
    path.write_text(text)
    loaded = load_case(path, vocabulary=vocabulary)
    assert loaded.case.loads[0].amplitude.value(19998.5) == 19998.5


def test_a_result_file_is_recognised(tmp_path):
    (tmp_path / "beam.h5").write_bytes(b"\x89HDF\r\n\x1a\n\x00")
    with pytest.raises(CaseError, match=r"an HDF5 file, such as a result file.*ancf2d info"):
        load_case(tmp_path / "beam.h5")
