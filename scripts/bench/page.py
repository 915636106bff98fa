"""docs/speed.md from what was measured: tables, aims, and what stands between the two."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from scripts.pages import table

from . import many, motion
from .motion import GEOMETRICALLY_EXACT as EXACT
from .motion import QUARTIC, REISSNER
from .scenes import T_END

Found = dict[str, Any]
Aim = tuple[str, str, str, bool]
MILLION = 1_000_000


def brief(seconds: float | None) -> str:
    """Return a time in fitting units."""
    if seconds is None:
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size or unit == "us":
            return f"{seconds / size:.3g} {unit}" if seconds < 1e4 else f"{seconds:.0f} s"
    return "-"


def waits_table(found: Found) -> str:
    """Return what compiling costs."""
    return table(["kind of case", "compiling"], [[name, f"{t:.1f} s"] for name, t in found["waits"].items()])


def start_table(found: Found) -> str:
    """Return what starting costs."""
    base = found["start"]["the imports alone"]
    return table(["run", "median", "relative to the imports"],
                 [[name, f"{t:.2f} s", f"{t / base:.1f}"] for name, t in found["start"].items()])


def static_table(found: Found) -> str:
    """Return the cantilever beside other tools."""
    rows = []
    for elements, results in found["static"].items():
        for r in results:
            head = [elements, r["tool"], r["element"]]
            if "error" in r:
                rows.append([*head, f"failed: {r['error']}", "", "", "", ""])
                continue
            ratio = f"{r['ratio']:.2f}" if r["ratio"] else ""
            rows.append([*head, brief(r["solve_s"]), ratio, r["iterations"] or "", f"{r['memory_mb']:.0f} MB",
                         f"{r['u'][1]:.6f} m"])
    return table(["elements", "tool", "type", "solve", "relative to Exudyn", "iterations", "memory", "tip"], rows)


def scaling_table(found: Found) -> str:
    """Return cost against size."""
    rows: dict[tuple[str, int], dict[str, str]] = {}
    for r in found["scaling"]["rows"]:
        line = rows.setdefault((r["element"], r["elements"]), {"memory": "", "each": "", "one": "", "all": ""})
        if "error" in r:
            line["all"] = f"failed: {r['error']}"
            continue
        line["memory"] = f"{r['memory_mb']:.0f} MB"
        if r["cores"] == "1" or not line["one"]:
            line["one"], line["each"] = brief(r["solve_s"]), brief(r["solve_s"] / r["elements"])
        if r["cores"] != "1":
            line["all"] = brief(r["wall_s"])
    body = [[e, n, v["one"], v["each"], v["all"], v["memory"]] for (e, n), v in rows.items()]
    return table(["type", "elements", "processor time", "per element",
                  f"wall time, {found['scaling']['cores']} cores", "memory"], body)


def exponents(found: Found) -> str:
    """Return the exponents in words."""
    return ", ".join(f"{e['exponent']:.2f} with `{e['element']}`" for e in found["scaling"]["exponents"]
                     if e["exponent"] is not None)


def kernel_table(found: Found) -> str:
    """Return the kernels beside the processor's peak."""
    rows = [[k["element"], f"{k['stations']}, {k['fields']}, {k['strains']}, {k['coordinates']}", k["force"],
             f"{k['force_ns']:.0f} ns", f"{100 * k['force_share']:.1f} %", k["tangent"], f"{k['tangent_ns']:.0f} ns",
             f"{100 * k['tangent_share']:.1f} %"] for k in found["arithmetic"]["kernels"]]
    return table(["type", "stations, fields, strains, coordinates", "operations of forces", "time", "of the peak",
                  "with tangent", "time", "of the peak"], rows)


def iteration_table(found: Found) -> str:
    """Return the parts of one Newton iteration."""
    parts = ["force, tangent, assembly", "factor", "solve", "all"]
    return table(["type", *parts], [[r["element"], *(f"{r[p]:.2f} us" for p in parts)]
                                    for r in found["arithmetic"]["iterations"]])


def feedback_table(found: Found) -> str:
    """Return what controllers cost."""
    return table(["integrator", "driven by", "step", "relative to spring and damper"],
                 [[r["method"], r["way"], f"{r['step_us']:.0f} us", f"{r['ratio']:.2f}"] for r in found["feedback"]])


def frames_table(found: Found) -> str:
    """Return the table of frames."""
    def us(seconds: float) -> str:
        return f"{seconds:.2f}"

    return table(["frame", "type", "elements", "unknowns", "fronts, largest", "forces, tangent, assembly", "factor",
                  "solve", "all", "factor and solve: band", "SuperLU"],
                 [[r["frame"], r["element"], r["elements"], r["unknowns"],
                   f"{r['fronts']}, {r['largest']}" if r["fronts"] else f"band of {r['half_bandwidth']}",
                   us(r["assembly"]), us(r["factor"]), us(r["solve"]), us(r["assembly"] + r["factor"] + r["solve"]),
                   us(r["band"]), us(r["superlu"])] for r in found["frames"]])


def sampling_table(found: Found) -> str:
    """Return the quadratures of the element types beside fewer and more points."""
    def error(x: float | None) -> str:
        return "no solution" if x is None else f"{x:.1e}"

    rows = [[f"`{r['element']}`", f"{r['rule'][0]} x {r['rule'][1]}" + (" (default)" if r["default"] else ""),
             r["zero_energy"], error(r["slender"]), error(r["thick"]), f"{r['cost_ns']:.0f} ns"]
            for r in found["sampling"]]
    return table(["type", "points along x across", "zero-energy modes", "slender, 8 elements", "thick, 8 elements",
                  "per element"], rows)


def modes_table(found: Found) -> str:
    """Return the modes of long meshes."""
    head = ["elements", "type", "whole run", "memory", "error of the first", "difference of all from 1000 elements"]
    return table(head, [[r["elements"], r["element"], brief(r["process_s"]), f"{r['memory_mb']:.0f} MB",
                         f"{r['to_exact']:.0e}", f"{r['to_coarse']:.0e}"] for r in found["modes"]])


def ladder_table(found: Found, number: int) -> str:
    """Return every rung of one pendulum."""
    rows = []
    for r in found["motion"]["ladders"][str(number)]:
        head = [r["tool"], r["element"], r["elements"], r["solver"].removesuffix(f", {motion.ALONE}")]
        if "error" in r:
            rows.append([*head, "", f"failed: {r['error']}", ""])
        elif not r["fine"] and r["solve_s"]:
            rows.append([*head, r["steps"], brief(r["solve_s"]), f"{r['error_m']:.1e} m"])
    return table(["tool", "type", "elements", "step", "steps", "solve", "largest tip error"], rows)


def times_at(found: Found, number: int, key: tuple[str, str]) -> list[tuple[float, bool] | None]:
    """Return the time that each wanted error takes, and whether it is extrapolated."""
    rows = found["motion"]["ladders"][str(number)]
    return [motion.at_error(rows, *key, wanted) for wanted in motion.WANTED]


def fastest(found: Found, number: int, keys: list[tuple[str, str]]) -> list[tuple[float, bool] | None]:
    """Return the same of the fastest of some types; what is extrapolated counts where nothing else reaches an error."""
    ladders = [times_at(found, number, key) for key in keys]
    return [min((a for a in at if a is not None), key=lambda a: (a[1], a[0]), default=None)
            for at in zip(*ladders, strict=True)]


def errors_table(found: Found) -> str:
    """Return the times that wanted errors take, both pendulums."""
    rows = []
    for number, ladders in motion.LADDERS.items():
        for key in ladders:
            at = times_at(found, number, key)
            if any(at):
                rows.append([f"({number})", *key, *("-" if a is None else brief(a[0]) + (" *" if a[1] else "")
                                                    for a in at)])
    return table(["pendulum", "tool", "type", *(f"{w:.0e} m" for w in motion.WANTED)], rows)


def step_table(found: Found) -> str:
    """Return the cost of one implicit step."""
    rows = [[r["tool"], r["element"], r["newton"],
             f"{r['step_us']:.1f} us" if "step_us" in r else f"failed: {r['error']}"] for r in found["motion"]["steps"]]
    return table(["tool", "type", "Newton", "time per step"], rows)


def explicit_text(found: Found) -> str:
    """Return what explicit integration takes, in words."""
    names = {"RK45": "RK45 with 8 elements `2d2n`",
             "pyelastica": "PyElastica with 32 elements, at the longest stable step of its explicit method"}
    lines = []
    for name, r in found["motion"]["explicit"].items():
        lines.append(f"{names[name]}: " + (f"failed, {r['error']}." if "error" in r else
                     f"{r['steps']} steps and {brief(r['measured_s'])} for {r['measured_to']:g} s of motion; "
                     f"{brief(r['extrapolated_s'])} for {T_END[1]:g} s, extrapolated."))
    return "\n".join(f"* {line}" for line in lines)


# of aims that are not reached, by name
NOTES = {
    "pendulum-1": (
        "Pendulum (1): most of the time is spent in Newton iterations. The axial stiffness is half a million times "
        "the bending stiffness here (EA L^2/EI). Steps of more than 0.01 s need so many more iterations that they "
        "gain nothing. Shorter steps, order 9 and generalized alpha were tried and are among the runs below."),
    "pendulum-2": (
        "Pendulum (2) to 1e-6 m: the sudden onset of gravity sends wave fronts with a jump in acceleration through "
        "the thick bar. The error is largest, ten times its mean over time, when the shear fronts reach the tip "
        "(0.19, 0.57 and 0.94 s). It has two causes of about equal size: the mesh propagates waves of its own "
        "element length too fast, ahead of the front, and a time step smears the front over the length of the step. "
        "High order in space helps less than elsewhere: with `reissner3` each halving of the elements divides the "
        "error by 2 to 5. With the mass that propagates waves best, 44 elements of order four are as accurate as 64 "
        "with the exact mass and as 256 of order two; orders six to ten take about as long. Longer steps lose more "
        "than they gain; shorter ones change little. Radau methods of order 13 and 17 take as long or longer; "
        "`vallejo`, and `ancf` of order five along the axis, are no better. With 44 elements, element forces take two "
        "fifths of the time (a quarter of that for sines and cosines), band solutions a third (three quarters of that "
        "complex ones), rates and rotations of the stages a fifth, and factorisations a fiftieth, because a tangent "
        "is reused for some thirty steps."),
    "iteration": (
        "One Newton iteration: {iteration}. The band is read from memory and written back."),
    "step": (
        "One full Newton step: each of its two iterations computes forces and tangent of 8 elements and factors a "
        "band of a few dozen unknowns. At these sizes, function calls and short loops cost more than the "
        "arithmetic."),
    "million": (
        "A million elements: {count}. Threads share the elements, but a single thread factors a chain, from one "
        "end to the other."),
    "memory": (
        "Memory: the band, two states of the path and the tables of the mesh, all of which the solution needs."),
    "cantilever": (
        "The cantilever: the same as one Newton iteration, below."),
    "exponent": (
        "The exponent: with a million elements, the forces at a converged state do not balance to 1e-8, so each "
        "load step computes their round-off bound. The band also exceeds the caches, and each iteration passes "
        "through it five times: clearing, filling, factorisation, forward and backward substitution."),
    "fixed": (
        "The exponent below 0.95: with a thousand elements, a few milliseconds of the time do not depend on the size; "
        "they are spent once per load step and iteration. From 10 000 elements on, the time per element is about "
        "constant."),
    "explicit": (
        "RK45: see pendulum (1)."),
    "start": (
        "Starting: beyond the imports, a warm run loads kernels from the cache, and reads, checks and writes the "
        "case. `scripts/bench/start.py` times each way to start."),
    "sweep": (
        "Rows of linear statics: assembling and solving 16 elements takes a millisecond or two. Building the model of "
        "a row, sampling its elements and checking its mesh each take about as long, and reading and checking its "
        "values half as long."),
    "first": (
        "The first run ever compiles the kernels that the case needs (material law, matrix, solver), on two "
        "processors where available. Other kernels are compiled when they are needed. The remaining time is that "
        "of the compiler itself.")}


def _first(rows: list[Found], **wanted: Any) -> Found:
    return next((r for r in rows if all(r.get(k) == v for k, v in wanted.items())), {})


def _times(name: str, text: str, factor: float, ours: Any, theirs: Any) -> Iterator[Aim]:
    """Yield an aim to be so many times faster; ``*`` where a time is extrapolated."""
    if ours is not None and theirs is not None:
        times = theirs[0] / ours[0]
        star = " *" if ours[1] or theirs[1] else ""
        yield name, text, f"{times:.3g} times{star} ({brief(ours[0])} against {brief(theirs[0])})", times >= factor


def _at_most(name: str, text: str, limit: float, found: float | None, unit: str, more: str = "") -> Iterator[Aim]:
    if found is not None:
        yield name, f"{text}: {limit:g} {unit}", f"{found:.2f} {unit}{more}", found <= limit


def motion_aims(found: Found) -> Iterator[Aim]:
    """Yield what is wanted of motion."""
    for number in (1, 2):
        ours, theirs = fastest(found, number, [REISSNER, QUARTIC]), times_at(found, number, EXACT)
        for wanted, factor in ((1e-4, 10), (1e-6, 100)):
            k = motion.WANTED.index(wanted)
            text = (f"pendulum ({number}) with a tip error of {wanted:.0e} m: {factor} times faster than Exudyn's "
                    "geometrically exact beam")
            yield from _times(f"pendulum-{number}", text, factor, ours[k], theirs[k])
    rk = found["motion"]["explicit"].get("RK45", {})
    if "extrapolated_s" in rk:
        text = "pendulum (1) with a tip error of 1e-04 m: 1000 times faster than RK45 with `2d2n`"
        yield from _times("explicit", text, 1000, times_at(found, 1, REISSNER)[1], (rk["extrapolated_s"], True))
    for element, limit in (("reissner2", 8), ("2d2n", 25), ("vallejo", 25)):
        r = _first(found["motion"]["steps"], tool="ancf2d", element=element)
        yield from _at_most("step", f"one full Newton step of pendulum (2), 8 elements `{element}`", limit,
                            r.get("step_us"), "us")


def static_aims(found: Found) -> Iterator[Aim]:
    """Yield what is wanted of statics."""
    rows = found["static"].get("10000", [])
    own, peer = _first(rows, element="reissner2"), _first(rows, tool="exudyn")
    if "solve_s" in peer and "solve_s" in own:
        text = "cantilever of 10 000 elements: 5 times faster than Exudyn, with `reissner2`"
        yield from _times("cantilever", text, 5, (own["solve_s"], False), (peer["solve_s"], False))
        yield ("memory", "with no more memory", f"{own['memory_mb']:.0f} MB against {peer['memory_mb']:.0f} MB",
               own["memory_mb"] <= peer["memory_mb"])
    for element, limit in (("reissner2", 30), ("vallejo", 60)):
        r = _first(found["scaling"]["rows"][::-1], element=element, elements=MILLION)
        more = f" wall time, {brief(r['solve_s'])} processor time, {r['peak_mb'] / 1000:.1f} GB" if r else ""
        yield from _at_most("million", f"a million elements `{element}`, ten load steps, 4 GB, all cores", limit,
                            r.get("wall_s"), "s", more)
    for e in found["scaling"]["exponents"]:
        if e["exponent"] is not None:
            low = e["exponent"] < 0.95
            yield ("fixed" if low else "exponent",
                   f"exponent of time over elements with `{e['element']}`, from 1000 on: 0.95 to 1.05",
                   f"{e['exponent']:.2f}", 0.95 <= round(e["exponent"], 2) <= 1.05)
    for element, most in (("reissner2", 0.3), ("2d2n", 1.0), ("vallejo", 1.0)):
        r = _first(found["arithmetic"]["iterations"], element=element)
        yield from _at_most("iteration", f"one Newton iteration of 100 000 elements `{element}`, per element", most,
                            r.get("all"), "us")


def start_aims(found: Found) -> Iterator[Aim]:
    """Yield what is wanted of starting."""
    start = found["start"]
    yield from _at_most("start", "a warm run of a small case over the imports alone", 0.4,
                        start["run"] - start["the imports alone"], "s")
    yield from _at_most("first", "the first run ever, all cores", 10, start["first run ever, by the wall"], "s",
                        f" wall time, {brief(start['first run ever'])} processor time")


def many_aims(found: Found) -> Iterator[Aim]:
    """Yield what is wanted of sweeps."""
    for name, one in found["many"]["sweeps"].items():
        if "static" in name:
            limit = many.TIMES * one["rows"] * one["solve"] + many.BESIDE
            yield ("sweep", f"{one['rows']} rows of {name}: {many.TIMES:g} times their solves and {many.BESIDE:g} s",
                   f"{one['whole']:.1f} s against {limit:.1f} s", one["whole"] <= limit)


def aims(found: Found) -> list[Aim]:
    """Return (name, what is wanted, what was measured, whether it is reached)."""
    return [*motion_aims(found), *static_aims(found), *start_aims(found), *many_aims(found)]


def aims_table(found: Found) -> str:
    """Return the aims as a table."""
    return table(["goal", "measured", "reached"],
                 [[wanted, measured, "yes" if met else "no"] for _, wanted, measured, met in aims(found)])


def limits(found: Found) -> str:
    """Return what stands between the aims that are not reached and what was measured."""
    missed = dict.fromkeys(name for name, _, _, met in aims(found) if not met)
    parts = ", ".join(f"`{r['element']}` {r['force, tangent, assembly']:.2f} us for forces, tangent and assembly, "
                      f"{r['factor']:.2f} us for the factors, {r['solve']:.2f} us for the solution"
                      for r in found["arithmetic"]["iterations"])
    count = ", ".join(dict.fromkeys(f"{r['iterations']:.0f} iterations of `{r['element']}`"
                                    for r in found["scaling"]["rows"]
                                    if r["elements"] == MILLION and "iterations" in r))
    lines = [textwrap.fill(f"* {NOTES[name].format(iteration=parts, count=count)}", 120, subsequent_indent="  ",
                           break_on_hyphens=False) for name in missed]
    return "\n".join(["Goals that were not reached, and why:", "", *lines]) if lines else "All goals were reached."
