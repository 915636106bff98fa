"""Test ancf2d with the oldest or the newest versions that pyproject.toml allows of everything that it depends on.

    python -m scripts.versions --python python3.11 --oldest
    python -m scripts.versions --python python3.13 tests/kernels tests/solve
    python -m scripts.versions --processor nehalem

makes an environment in a temporary folder, installs the tree that this file is in, and runs the quick tests (or those
that are named) with the versions that it prints. Exits as pytest does.

With an older x86 processor, last digits differ from those of this machine, as on the machines of others: vectors are
shorter, and nehalem has no fused multiply-adds.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from scripts.pages import ROOT


def oldest(requirement: str) -> str:
    """Return the constraint that holds a requirement to its lower bound, ``numpy>=2.0`` to ``numpy==2.0.*``.

    Raises:
        ValueError: a requirement without a lower bound.
    """
    found = re.match(r"([\w.-]+)(?:\[[\w,]+\])?>=([\d.]+)", requirement)
    if found is None:
        raise ValueError(f"pyproject.toml: '{requirement}' has no lower bound")
    return f"{found[1]}=={found[2]}.*"


def constraints() -> list[str]:
    """Return the oldest allowed version of every dependency."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [oldest(requirement) for requirement in project["dependencies"]]


# processors by the instructions of numpy that they lack
LACKING = {"haswell": ("X86_V4", "AVX512"), "nehalem": ("",)}


def as_on(processor: str, python: str) -> dict[str, str]:
    """Return the variables by which numba, OpenBLAS and numpy of an environment use an older processor's instructions.
    """
    asked = "from numpy._core._multiarray_umath import __cpu_dispatch__ as d, __cpu_features__ as f; " \
            "print(*(x for x in d if f[x]))"
    found = subprocess.run([python, "-c", asked], check=True, capture_output=True, text=True).stdout.split()
    return {"NUMBA_CPU_NAME": processor, "NUMBA_CPU_FEATURES": "-avx512f", "OPENBLAS_CORETYPE": processor.capitalize(),
            "NPY_DISABLE_CPU_FEATURES": " ".join(x for x in found if x.startswith(LACKING[processor]))}


def main() -> int:
    """Make the environment, print its versions, run the tests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environment")
    parser.add_argument("--oldest", action="store_true", help="lower bounds, not the newest versions")
    parser.add_argument("--processor", choices=LACKING, help="use the instructions of this older processor alone")
    parser.add_argument("tests", nargs="*", help="files, folders or options for pytest (default: the quick tests)")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([given.python, "-m", "venv", f"{folder}/venv"], check=True)
        python = f"{folder}/venv/bin/python"
        limits = Path(folder, "constraints.txt")
        limits.write_text("\n".join(constraints() if given.oldest else []), encoding="utf-8")
        subprocess.run([python, "-m", "pip", "install", "-q", "-c", limits, "-e", f"{ROOT}[test]"], check=True)
        subprocess.run([python, "-m", "pip", "list", "--format=freeze"], check=True)
        # a cache of its own: machine code of another version of numba is not taken, but would pile up
        environment = os.environ | {"XDG_CACHE_HOME": folder}
        environment |= as_on(given.processor, python) if given.processor else {}
        return subprocess.run([python, "-m", "pytest", "-n", "2", *given.tests], cwd=ROOT, env=environment,
                              check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
