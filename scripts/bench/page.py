"""docs/speed.md from what was measured: what to expect, aims, tables."""

from __future__ import annotations

from typing import Any

import dynamics
from scenes import T_END

Found = dict[str, Any]
EXACT, REISSNER, QUARTIC, FORCES = (
    dynamics.GEOMETRICALLY_EXACT, dynamics.REISSNER, dynamics.QUARTIC, dynamics.FORCES)


def table(head: list[str], rows: list[list[Any]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(c) for c in line) + " |" for line in lines)


def brief(seconds: float | None) -> str:
    """Return a time in fitting units."""
    if seconds is None:
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size or unit == "us":
            return f"{seconds / size:.3g} {unit}" if seconds < 1e4 else f"{seconds:.0f} s"
    return "-"


# ---------------------------------------------------------------------- tables


def start_table(found: Found) -> str:
    """Return what starting costs."""
    base = found["start"]["the imports alone"]
    return table(["what", "median", "of the imports alone"],
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
    return table(["elements", "tool", "type", "solve", "to Exudyn", "iterations", "memory", "tip"], rows)


def scaling_table(found: Found) -> str:
    """Return cost against size."""
    rows: Found = {}
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
    return table(["type", "elements", "processor's time", "per element",
                  f"wall's, {found['scaling']['cores']} cores", "memory"], body)


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
    return table(["type", "points along x across", "motions without strain", "slender, 8 elements", "thick, 8 elements",
                  "an element"], rows)


def modes_table(found: Found) -> str:
    """Return the modes of long meshes."""
    head = ["elements", "type", "whole run", "memory", "first, off the exact one by", "all, off 1000 elements by"]
    return table(head, [[r["elements"], r["element"], brief(r["process_s"]), f"{r['memory_mb']:.0f} MB",
                         f"{r['to_exact']:.0e}", f"{r['to_coarse']:.0e}"] for r in found["modes"]])


def ladder_table(found: Found, number: int) -> str:
    """Return every rung of one pendulum."""
    rows = []
    for r in found["motion"]["ladders"][str(number)]:
        head = [r["tool"], r["element"], r["elements"], r["solver"].removesuffix(f", {dynamics.ALONE}")]
        if "error" in r:
            rows.append([*head, "", f"failed: {r['error']}", ""])
        elif not r["fine"] and r["solve_s"]:
            rows.append([*head, r["steps"], brief(r["solve_s"]), f"{r['error_m']:.1e} m"])
    return table(["tool", "type", "elements", "step", "steps", "solve", "largest tip error"], rows)


def times_at(found: Found, number: int, key: tuple[str, str]) -> list[tuple[float, bool] | None]:
    """Return the time that each wanted error takes, and whether it is extrapolated."""
    rows = found["motion"]["ladders"][str(number)]
    return [dynamics.at_error(rows, *key, wanted) for wanted in dynamics.WANTED]


def fastest(found: Found, number: int, keys: list[tuple[str, str]]) -> list[tuple[float, bool] | None]:
    """Return the same of the fastest of some types; what is extrapolated counts where nothing else reaches an error."""
    ladders = [times_at(found, number, key) for key in keys]
    return [min((a for a in at if a is not None), key=lambda a: (a[1], a[0]), default=None)
            for at in zip(*ladders, strict=True)]


def errors_table(found: Found) -> str:
    """Return the times that wanted errors take, both pendulums."""
    rows = []
    for number, ladders in dynamics.LADDERS.items():
        for key in ladders:
            at = times_at(found, number, key)
            if any(at):
                rows.append([f"({number})", *key, *("-" if a is None else brief(a[0]) + (" *" if a[1] else "")
                                                    for a in at)])
    return table(["pendulum", "tool", "type", *(f"{w:.0e} m" for w in dynamics.WANTED)], rows)


def step_table(found: Found) -> str:
    """Return the cost of one implicit step."""
    rows = [[r["tool"], r["element"], r["newton"],
             f"{r['step_us']:.1f} us" if "step_us" in r else f"failed: {r['error']}"] for r in found["motion"]["steps"]]
    return table(["tool", "type", "Newton", "a step"], rows)


def explicit_text(found: Found) -> str:
    """Return what explicit integration takes, in words."""
    names = {"RK45": "RK45 with 8 elements `2d2n`",
             "pyelastica": "PyElastica with 32 elements, at the longest step that its explicit method bears there"}
    lines = []
    for name, r in found["motion"]["explicit"].items():
        lines.append(f"{names[name]}: " + (f"failed, {r['error']}." if "error" in r else
                     f"{r['steps']} steps and {brief(r['measured_s'])} for {r['measured_to']:g} s of motion; "
                     f"{brief(r['extrapolated_s'])} for {T_END[1]:g} s, extrapolated."))
    return "\n".join(f"* {line}" for line in lines)
