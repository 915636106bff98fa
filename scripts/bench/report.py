"""Measure start, statics, size, kernels, modes and motion and write docs/speed.md, stamped with versions and machine.

The peers that it measures beside are the extra ``peers`` (``pip install .[peers]``): what is not installed is left out.
It takes about ten minutes; a machine that does nothing else gives the best figures. ``--json FILE`` also writes all
figures; ``--only`` measures some parts anew and takes the others from that file; ``--only none`` writes the page alone.

    python scripts/bench/report.py --json speed.json
    python scripts/bench/report.py --json speed.json --only start,modes
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import aims
import arithmetic
import dynamics
import eigen
import frames
import page
import sampling
import scaling
import startup
import static_cantilever
from stamp import machine, versions

PAGE = Path(__file__).resolve().parents[2] / "docs" / "speed.md"
TYPES = ["reissner2", "reissner3", "kerkkanen", "vallejo"]
SIZES = [1000, 10_000]
PARTS: dict[str, Callable[[int], Any]] = {
    "start": startup.measure,
    "static": lambda repeat: {str(n): static_cantilever.compare(n, TYPES, repeat) for n in SIZES},
    "scaling": lambda repeat: scaling.collect(scaling.TYPES, scaling.SIZES[-1], repeat),
    "arithmetic": lambda repeat: arithmetic.measure(arithmetic.TYPES, 3 * repeat),
    "frames": lambda repeat: frames.measure(3 * repeat),
    "sampling": lambda repeat: sampling.measure(),
    "modes": lambda repeat: eigen.compare(["reissner2", "vallejo"], 100_000),
    "motion": dynamics.collect}


def text(found: dict[str, Any]) -> str:
    """Return the page."""
    peak = found["arithmetic"]["peak"]
    return f"""# Speed

Measured by `python scripts/bench/report.py` on {found["stamp"]}.
Times are the processor's, which other programs on the machine disturb little, and medians of runs made in turn: trust
the ratios more than the seconds.

## What to expect

* A small case takes about as long as the imports of Python's numerical libraries; `--help` and `validate` load no
  compiler. The first run of a formulation compiles its kernels; they are kept in the user's cache folder under a name
  that changes with the sources, so that they are never stale.
* Time and memory grow in proportion to the number of elements, up to a million. A chain of elements is factored as a
  band, frames that branch or close in loops front by front. Statics of 8000 elements and more shares them out to
  threads, one for each processor or as `OMP_NUM_THREADS` says, with the same bits. The command line lets OpenBLAS have
  one thread, as those of its own take more time than they save here; scripts do well to set `OPENBLAS_NUM_THREADS=1`
  before they import NumPy. What is set already stays.
* Motion is integrated by high order (`radau5`, `radau9`): smooth motion takes few steps, and wanted digits cost little
  more. Fixed steps with `estimate: false` do without the coarser runs beside, which tell how far the result is right. A
  state that is stored costs about 0.1 ms on top, whatever the step.
* `reissner3` is the fastest way to a beam's answer, `reissner2` the fastest per element; elements with 12 coordinates
  cost three to six times as much each.

## Aims

What this program is meant to reach beside what it reached in this run, on one core where nothing else is said. `*`: a
time is extrapolated, as told below.

{aims.aims_table(found)}

{aims.limits(found)}

## Start

{page.start_table(found)}

## Large deflection of a cantilever

Table 2's beam, 500 kN at the tip in 10 load steps, one core, the solve alone. Exudyn runs its geometrically exact beam,
the like of `reissner2`, at the tightest tolerance that it meets (relative 1e-6). OpenSees runs its beam by forces with
shear in a corotational frame, with a line search: without one it does not solve meshes as fine; its Timoshenko element
takes no large turns. PyElastica has no static solver. Memory is the peak of the process less what it had after its
imports.

{page.static_table(found)}

## Cost against size

The same beam and load, ten load steps, from 8 to a million elements; memory is that above the imports. From 1000
elements on time grows with the number of elements to the power of {page.exponents(found)}. With
all cores, from 8192 elements on threads share them.

{page.scaling_table(found)}

## Kernels and the processor

One core reaches {peak / 1e9:.0f} billion operations per second here, in chains of multiply-adds that stay in its
registers. Operations are those that forces, and forces with the lower half of the tangent, take by the shapes of the
law, zeros of B left out, as `scripts/bench/arithmetic.py` states them; the time is that of an element among
{arithmetic.ELEMENTS}.

{page.kernel_table(found)}

One Newton iteration of {arithmetic.MANY} elements, per element, on one core:

{page.iteration_table(found)}

## Frames

One Newton iteration of frames that are no chain beside a chain of as many elements, microseconds per element on one
core. They are factored front by front where that costs less than a band; beside it what factors and solution take with
the band of reverse Cuthill-McKee, and with general sparse factors (SuperLU). `scripts/bench/frames.py` has the scenes.

{page.frames_table(found)}

## Sampling points

How few points keep each type's accuracy: its own quadrature beside one point fewer and one more along and across. A
slender and a thick cantilever under large loads, 8 elements; errors are relative to 32 elements of the type with its
own points. `cable` samples its stretch at Lobatto points by default; its other rows have Gauss points alone. Fewer
points leave motions without strain; more points lock (`reissner2`, `reissner3`, `kerkkanen`, `vallejo` and `2d2n` along
the axis) or change little for more time. Only `patel` would do with one point fewer across, which its source does not
have.

{page.sampling_table(found)}

## Modes of many elements

The 20 lowest modes of Table 3's beam (its Timoshenko solution: 95.63398088 rad/s for the first). Time and memory are
those of the whole process, imports included.

{page.modes_table(found)}

## Motion

The pendulums of the paper's Sec. 5.4, one core: (1), a thin steel bar, to 1.5 s, and (2), a thick soft one, to 1.1 s.
The error is the largest distance of the tip, at multiples of 0.01 s, from a fine solution of the same theory; the time
is that of the solve without states stored between.

Exudyn steps by generalized alpha with modified Newton, at a tolerance of 1e-5 (its default lies below round-off on
pendulum (1)). OpenSees steps by HHT with alpha 0.95 and starts from the accelerations of the fall; its beams hang when
they are built and are turned up, because its corotational frames turn by no more than half a turn. PyElastica steps
explicitly by position Verlet. `quartic` is a geometrically exact beam of five nodes, [an element in a
file](adding-an-element.md#an-element-in-a-file), `scripts/bench/quartic.yaml`, 0.8 of whose mass Gauss-Lobatto points
integrate. The fine solution is the last of each
tool's ladder; Exudyn's geometrically exact beam and `quartic` have that of `reissner3`.

{page.errors_table(found)}

`*`: not reached by the runs below; extrapolated by the power of the error that cost grew with up to the best run, from
the last one with at least twice its error. `-`: no such run.

{page.explicit_text(found)}

One implicit step of pendulum (2), 8 elements, dt = 1e-4, generalized alpha:

{page.step_table(found)}

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
