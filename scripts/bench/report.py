"""Measure start, statics, size, kernels, modes and motion and write docs/speed.md, stamped with versions and machine.

The peers that it measures beside are the extra ``peers`` (``pip install .[peers]``): what is not installed is left out.
It takes about ten minutes; a machine that does nothing else gives the best figures. ``--json FILE`` also writes all
figures; ``--only`` measures some parts anew and takes the others from that file; ``--only none`` writes the page alone.

    python -m scripts.bench.report --json speed.json
    python -m scripts.bench.report --json speed.json --only start,modes
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

from scripts.pages import DOCS, machine, versions

from . import kernels, many, modes, motion, page, start, statics, waits
from .apart import apart

PAGE = DOCS / "speed.md"
PARTS: dict[str, Callable[[int], Any]] = {
    "start": start.measure,
    "waits": waits.measure,
    "static": lambda repeat: {str(n): statics.compare(n, repeat) for n in statics.COMPARED},
    "scaling": statics.scale,
    "arithmetic": lambda repeat: apart("kernels.measure", 3 * repeat),
    "frames": lambda repeat: apart("frames.measure", 3 * repeat),
    "sampling": lambda repeat: apart("kernels.sample"),
    "modes": lambda repeat: modes.compare(),
    "feedback": lambda repeat: apart("feedback.measure", 3 * repeat),
    "many": many.measure,
    "motion": motion.collect}


def text(found: dict[str, Any]) -> str:
    """Return the page."""
    peak = found["arithmetic"]["peak"]
    return f"""# Speed

Measured by `python -m scripts.bench.report` on {found["stamp"]}.
Times are processor times, which depend little on other programs, and medians of interleaved runs. Ratios are more
reliable than seconds.

## What to expect

* A small case takes about as long as importing Python's numerical libraries. `--help` and `validate` do not load the
  compiler. The first run of a kind of model compiles its kernels. They are stored in the user's cache folder under a
  name that changes with the sources, so they are never out of date.
* Time and memory grow in proportion to the number of elements, up to a million. A chain of elements is factored as a
  band matrix; frames with branches or loops use the multifrontal method. Statics with 8000 elements and more uses
  several threads, one per processor or as set by `OMP_NUM_THREADS`, with bitwise identical results. The command line
  restricts OpenBLAS to one thread, because more threads cost more time than they save here; in scripts, set
  `OPENBLAS_NUM_THREADS=1` before you import NumPy. An existing setting is not changed.
* Motions use high-order integrators (`radau5`, `radau9`): smooth motions take few steps, and more digits cost little
  extra time. `estimate: false` omits the coarser runs of the [error estimate](motion.md#summary). Each stored state
  adds about 0.05 ms, whatever the step.
* `reissner3` is the fastest type for beam theory, `reissner2` the fastest per element. Elements with 12 coordinates
  cost three to six times as much each.

## Performance goals

The table compares the performance goals with this measurement, on one core unless stated otherwise. `*` marks
extrapolated times, as explained below.

{page.aims_table(found)}

{page.limits(found)}

## Start

{page.start_table(found)}

### Compiling

Kernels are compiled once per machine, when a run first needs them. The table gives the additional processor time of the
first run of each kind of case compared with the second. The kinds are run in the order of the table, so each compiles
only the kernels that it adds; all processors share the work. `ancf2d compile` compiles the kernels of all kinds in
advance. `scripts/bench/waits.py` contains the cases.

{page.waits_table(found)}

## Large deflection of a cantilever

The beam of Table 2 with 500 kN at the tip in 10 load steps, on one core, solution time only. Exudyn uses its
geometrically exact beam, which corresponds to `reissner2`, at the tightest tolerance at which it converges (relative
1e-6). OpenSees uses its force-based beam with shear in a corotational frame, with a line search; without a line search
it does not converge on such fine meshes. Its Timoshenko element does not support large rotations. PyElastica has no
static solver. Memory is the peak of the process minus its memory after the imports.

{page.static_table(found)}

## Cost against size

The same beam and load, ten load steps, from 8 to a million elements. Memory excludes the imports. From 1000 elements
on, time grows with the number of elements to the power of {page.exponents(found)}. With all cores, threads share the
elements from 8192 elements on.

{page.scaling_table(found)}

## Kernels and the processor

One core reaches {peak / 1e9:.0f} billion operations per second here, in chains of multiply-adds that stay in its
registers. The operation counts are those of the forces, and of the forces with the lower half of the tangent, excluding
the zeros of B; `scripts/bench/kernels.py` derives them from the array shapes. The time is per element among
{kernels.ELEMENTS}.

{page.kernel_table(found)}

One Newton iteration of {kernels.MANY} elements, per element, on one core:

{page.iteration_table(found)}

## Frames

One Newton iteration of branched frames compared with a chain of the same number of elements, in microseconds per
element on one core. Frames use the multifrontal method if it costs less than a band matrix. The last columns give the
time of factorisation and solution with a band in reverse Cuthill-McKee order, and with a general sparse factorisation
(SuperLU). `scripts/bench/frames.py` defines the scenes.

{page.frames_table(found)}

## Sampling points

The table compares the default quadrature of each type with one point fewer and one more along and across. The
problems are a slender and a thick cantilever under large loads, with 8 elements; errors are relative to 32 elements of
the type with its default points. `cable` samples its stretch at Lobatto points by default; its other rows have Gauss
points only. Fewer points cause zero-energy modes. More points cause locking (`reissner2`, `reissner3`, `kerkkanen`,
`vallejo` and `2d2n` along the axis) or take more time for little gain. Only `patel` would keep its accuracy with one
point fewer across, but its source does not use that rule.

{page.sampling_table(found)}

## Modes of many elements

The 20 lowest modes of the beam of Table 3 (Timoshenko solution for the first: 95.63398088 rad/s). Time and memory are
those of the whole process, imports included.

{page.modes_table(found)}

{many.text(found["many"])}

## Motion

The pendulums of the paper's Sec. 5.4, on one core: (1) is a thin steel bar, computed to 1.5 s, and (2) a thick soft
one, to 1.1 s. The error is the largest distance of the tip, at multiples of 0.01 s, from a fine solution of the same
theory. The time is the solution time without intermediate stored states.

Exudyn uses generalized alpha with modified Newton and a tolerance of 1e-5 (its default is below round-off on pendulum
(1)). OpenSees uses HHT with alpha 0.95 and starts with the accelerations of the fall. Its beams are built hanging and
then rotated upwards, because its corotational frames rotate by at most half a turn. PyElastica uses explicit position
Verlet. `quartic` is a geometrically exact beam with five nodes, [an element in a
file](adding-an-element.md#an-element-in-a-file), `scripts/bench/quartic.yaml`; Gauss-Lobatto points integrate 0.8 of
its mass. The fine solution is the last of each tool's series of runs; Exudyn's geometrically exact beam and `quartic`
use that of `reissner3`.

{page.errors_table(found)}

`*`: none of the runs below reaches this error. The time is extrapolated with the power law of cost against error
between the best run and the last one with at least twice its error. `-`: no such run.

{page.explicit_text(found)}

One implicit step of pendulum (2), 8 elements, dt = 1e-4, generalized alpha:

{page.step_table(found)}

### Controllers

A motor at its hub drives a flexible arm (8 elements of `reissner3`, steps of 1 ms); the table compares it with a
rotational spring and damper in place of the motor. A PD motor gives the same motion in the same number of iterations.
Each load that depends on the motion, and each state of a controller, adds one solution with the factorised matrix after
every factorisation. A sampled controller restarts the motion at its sampling times, here at every hundredth step.
`scripts/bench/feedback.py` contains the scenes.

{page.feedback_table(found)}

### All runs

Pendulum (1), all runs:

{page.ladder_table(found, 1)}

Pendulum (2), all runs:

{page.ladder_table(found, 2)}
"""


def main() -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="file to write all figures to")
    parser.add_argument("--only", help=f"parts to measure anew: {', '.join(PARTS)}, or none")
    parser.add_argument("--repeat", type=int, default=3, help="runs that a median is of (default: 3)")
    args = parser.parse_args()
    parts = list(PARTS) if args.only is None else [p for p in args.only.split(",") if p != "none"]
    if unknown := set(parts) - PARTS.keys():
        parser.error(f"no part is named {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    found: dict[str, Any] = {}
    if args.only is not None:
        if args.json is None or not args.json.exists():
            parser.error("--only takes the other parts from --json FILE of an earlier run")
        found = json.loads(args.json.read_text(encoding="utf-8"))
    for part in parts:
        print(f"measuring {part}", flush=True)
        # keys are strings, as read from a file
        found[part] = json.loads(json.dumps(PARTS[part](args.repeat)))
        found["stamp"] = f"{date.today()}: {machine()}; {versions('exudyn', 'openseespy', 'pyelastica')}"
        if args.json is not None:
            args.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    missing = PARTS.keys() - found.keys()
    if missing:
        parser.error(f"{args.json} holds no {', '.join(sorted(missing))}: measure them too")
    PAGE.write_text(text(found), encoding="utf-8")
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    main()
