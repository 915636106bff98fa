"""Libraries that a run imports, and kernels that the first one compiles."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

# what no linear static run calls, nor loads where its kernels are compiled already
NOT_NEEDED = {"matplotlib", "unittest", "scipy.linalg", "scipy.sparse", "scipy.integrate", "scipy.optimize",
              "scipy.special", "numba.np.npyimpl", "numba.typed.listobject", "ancf2d.plot", "ancf2d.view", "ancf2d.api",
              "ancf2d.kernels.motion.advance", "ancf2d.kernels.points", "ancf2d.solvers.motion.stepping",
              "ancf2d.study.convergence", "ancf2d.study.sweep"}
# kernels of the package, and functions of numba's own, that linear statics takes; natural strains and states at the
# stations are six of them, as every element has the same program; small ones that laws share are called, not copied
KERNELS, LIBRARY = 84, 5
# cases that between them need every kind of kernel, with what is changed
SHORT = ("solver.t_end=0.01",)
RELAXES = "bodies.rod.material.viscoelastic=[{modulus: 0.5, time: 0.1}]"
LET_GO = "boundary_conditions.pivot.active={until: t > 1}"
RUNS = [
    *((f"static/{name}.yaml", ()) for name in ("uniform_load", "follower_force", "portal_frame", "deep_arch",
                                               "thick_cantilever_three_node", "three_hinged_frame")),
    *((f"buckling/{name}.yaml", ()) for name in ("stretched_column", "beck", "cantilever_pipe")),
    *((f"modes/{name}.yaml", ()) for name in ("portal_frame", "receptance", "state_space_cantilever")),
    ("paths/shallow_arch.yaml", ()), ("contact/shared_force.yaml", ()), ("static/bent_beyond_yield.yaml", ()),
    *((f"dynamic/{name}.yaml", SHORT) for name in ("slider_crank_rigid", "four_bar", "double_pendulum", "pid_arm")),
    ("dynamic/caught_rod.yaml", ()), ("dynamic/moving_force.yaml", ()),
    *(("dynamic/double_pendulum.yaml", (*SHORT, f"solver.method={method}", "solver.tolerance=1e-3"))
      for method in ("radau9", "hht", "generalized_alpha", "newmark", "RK45", "DOP853", "Radau", "BDF", "LSODA")),
    ("dynamic/pendulum2_cable.yaml", (*SHORT, "solver.method=energy_momentum")),
    ("dynamic/moving_mass.yaml", SHORT), ("modes/rotating_cantilever_vallejo.yaml", ()),
    *(("dynamic/pendulum1_reissner3.yaml", (*SHORT, f"solver.method={method}", RELAXES))
      for method in ("radau5", "generalized_alpha")),
    *(("dynamic/pendulum2_cable.yaml", (*SHORT, f"solver.method={method}", LET_GO))
      for method in ("radau5", "energy_momentum")),
]
# cases that are differentiated, back through a motion and forth
DIFFERENTIATED = [("dynamic/double_pendulum.yaml", (*SHORT, f"solver.method={method}", "solver.tolerance=1e-3", *goal))
                  for method in ("radau5", "generalized_alpha")
                  for goal in ((), ("goal={quantity: strain_energy}",))]
RUN = """
import json, sys
from numba.core import event
compiled, warm = [], []

class Compiled(event.Listener):
    def on_start(self, found):
        function = found.data["dispatcher"].py_func
        compiled.append(f"{function.__module__}.{function.__qualname__}")
    def on_end(self, found):
        pass

event.register("numba:compile", Compiled())
import ancf2d.study.warmup as warmup
warm_up = warmup.warm_up
def counted(*arguments):
    warm_up(*arguments)
    warm.extend(compiled)
warmup.warm_up = counted
from ancf2d.cli import main
try:
    main(["run", "beam.yaml", "-q", "--force"])
except SystemExit as end:
    assert end.code == 0, end.code
print(json.dumps({"compiled": compiled, "warm": warm, "modules": sorted(sys.modules)}))
"""

# commands one after another; every kernel that they take, from the cache or compiled, is noted, in forked processes too
EACH = """
import json, os, sys
from ancf2d.kernels.lowlevel import jit

notes = os.open("taken", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o600)
load = jit.Storage.load_overload

def noted(cache, signature, target):
    function = cache.function
    os.write(notes, f"{function.__module__}.{function.__qualname__}{signature}\\n".encode())
    return load(cache, signature, target)

jit.Storage.load_overload = noted
from ancf2d.cli import main
from ancf2d.study import warmup
# whatever other tests have compiled, each case goes through all of its kernels
warmup._is_compiled = lambda cache, kernels: False
for arguments in json.loads(sys.argv[1]):
    try:
        main(arguments)
    except SystemExit as end:
        assert end.code == 0, arguments
"""


def run(folder: Path, **environment: str) -> dict[str, Any]:
    """Run the case in its own process; return what was compiled, also by the end of the warm-up, and imported."""
    found = subprocess.run([sys.executable, "-c", RUN], cwd=folder, text=True, capture_output=True, timeout=240,
                           env={**os.environ, **environment})
    assert found.returncode == 0, found.stderr
    out: dict[str, Any] = json.loads(found.stdout)
    return out


def test_a_first_run_compiles_few_kernels_and_a_second_one_imports_few_modules(folder: Path) -> None:
    # code that is optimised less counts as much, and is there sooner
    # on one processor, by this process alone
    cache = {"XDG_CACHE_HOME": str(folder / "cache"), "NUMBA_OPT": "1", "OMP_NUM_THREADS": "1"}
    first, second = run(folder, **cache), run(folder, **cache)
    own = [name for name in first["compiled"] if name.startswith("ancf2d.")]
    assert 0 < len(own) <= KERNELS, own
    assert len(first["compiled"]) - len(own) <= LIBRARY, first["compiled"]
    assert not {name.rpartition(".")[2] for name in own} & {"force", "force_noise", "stations"}
    assert first["warm"] == first["compiled"], "compiled after the warm-up, on the clock of the solve"
    assert second["compiled"] == []
    assert not NOT_NEEDED & set(second["modules"])


def test_load_steps_without_points_do_not_import_kernels_of_points(folder: Path) -> None:
    """No spring, constraint or contact: a second run imports the kernels of elements and matrices alone."""
    case = folder / "beam.yaml"
    case.write_text(case.read_text().replace("linear_static", "static"))
    run(folder)
    assert not NOT_NEEDED & set(run(folder)["modules"])


def kernels_taken(folder: Path, *commands: list[str]) -> set[str]:
    """Run commands in their own process; return the kernels that they use, with the types of their arguments."""
    found = subprocess.run([sys.executable, "-c", EACH, json.dumps(commands)], cwd=folder, text=True,
                           capture_output=True)
    assert (found.returncode, found.stdout) == (0, ""), found.stderr
    return set((folder / "taken").read_text(encoding="utf-8").splitlines())


def test_after_compile_no_run_compiles_anything(folder: Path) -> None:
    """``compile`` includes every integrator, joint, spring, matrix storage and element."""
    compiled = kernels_taken(folder, ["compile", "-q"])
    cases = Path(__file__).parents[2] / "cases"
    # one process for all: their imports take longer than they do
    whole = [(["run", "--force"], RUNS), (["sensitivity", "--to=loads.0.value.1", "--to=bodies.upper.material.E"],
                                          DIFFERENTIATED)]
    needed = kernels_taken(folder, *([command, str(cases / name), "-q", *options, *(f"--set={c}" for c in changes)]
                                     for (command, *options), tried in whole for name, changes in tried))
    assert len(needed) > 50
    assert needed - compiled == set()
