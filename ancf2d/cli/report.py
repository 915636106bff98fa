"""The printed summary of a run, and of the solves and the accuracy reached with ``--accuracy``."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..case import Units
from ..case.units import unit_label, with_unit
from ..errors import many, percent
from ..quantities import DISPLACEMENTS, FORCES, KIND_OF
from .failures import FAILED, expected_met
from .session import Session
from .text import TIME, command_line, duration, number, rounded, say, table

if TYPE_CHECKING:
    from ..case import LoadedCase
    from ..study.goal import Target


# unit labels of length, force and time
Labels = tuple[str, str, str]
# greatest numbers of listed events and poles
MOST_EVENTS, MOST_POLES = 20, 20
# round-off of displacements and forces, relative to the largest
ROUND_OFF = 1e-12
# greatest unbalanced force, relative to the largest force, that counts as round-off
MOST = 1e-5


def run_report(summary: dict[str, Any], units: Units, extent: float, unbalanced: float = 0.0) -> str:
    """Return the summary of a finished run as text: status, probes, reactions, contacts, expected values.

    ``extent`` [length] of the model and the ``unbalanced`` forces [force] determine which values are round-off.
    """
    labels = (units.length, units.force, units.time)
    lines = [summary["title"]] if summary["title"] else []
    facts = [summary["solver"], many(summary["elements"], "element"), many(summary["dofs"], "nodal coordinate")]
    if summary["solver"] != "linear_static":
        facts.append(f"{many(summary['iterations'], 'iteration')} in {many(summary['steps'], 'step')}")
    lines.append(f"{summary['status']}: {', '.join(facts)}, {duration(summary['wall_s'])}")
    if summary["solver"] == "dynamic":
        lines += motion_lines(summary, labels)
    elif error := _accuracy(summary.get("accuracy") or {}):
        lines.append(f"error     {error}")
    if summary["solver"] == "static" and summary.get("load_factor", 1.0) != 1.0:
        lines.append(f"load factor {number(summary['load_factor'])}")
    floors = round_off_floors(summary, extent, unbalanced)
    for title, key in (("probe", "probes"), ("reaction", "reactions")):
        if summary.get(key):
            lines += ["", *_quantities(title, summary[key], labels, floors)]
    if summary.get("contacts"):
        lines += ["", *_contacts(summary["contacts"], labels, floors["force"])]
    for key, described in _FINDINGS.items():
        if summary.get(key):
            lines += ["", *described(summary[key], labels)]
    if summary.get("checks"):
        lines += ["", *_checks(summary["checks"], labels)]
    return "\n".join(lines)


def _contacts(found: list[dict[str, Any]], labels: Labels, floor: float) -> list[str]:
    """Return force, pressing force and zone of each contact; the forces of a body on itself cancel."""
    forces = (f"{of} [{labels[1]}]" for of in ("fx", "fy", "pressing"))
    rows = [["contact", *forces, f"length [{labels[0]}]", "from S", "to S"]]
    for one in found:
        values = [rounded(value, floor) for value in (*one["force"], one["normal"])]
        if one["normal"] > floor and not any(one["force"]):
            values[:2] = "", ""
        zone = ["" if one[end] is None else number(one[end]) for end in ("from", "to")]
        rows.append([one["name"], *values, number(one["length"]), *zone])
    return table(rows)


def _frequencies(found: list[dict[str, Any]], labels: Labels) -> list[str]:
    growing = any(f.get("growth") for f in found)
    more = ["growth [1/s]", "damping ratio", "residual"] if growing else []
    rows = [["mode", "omega [rad/s]", "f [Hz]", *more, "kind", "largest share"]]
    for k, f in enumerate(found, start=1):
        share = max(f["shares"], key=lambda name: f["shares"][name]) if f["shares"] else ""
        growth = [number(f.get("growth", 0.0)), number(f.get("damping", 0.0)), number(f.get("residual", 0.0), 2)]
        rows.append([str(k), number(f["omega"], 7), number(f["hz"]), *(growth if growing else []),
                     f"{f['kind']} {f['number']}", f"{share} {100 * f['shares'][share]:.0f} %" if share else ""])
    return table(rows, left=(len(rows[0]) - 2, len(rows[0]) - 1))


def _critical(found: list[dict[str, Any]], labels: Labels) -> list[str]:
    vibrates = any(c["omega"] for c in found)
    rows = [["buckling mode", "load factor", "kind", *(["omega [rad/s]", "f [Hz]"] if vibrates else [])]]
    for k, c in enumerate(found, start=1):
        frequencies = [number(c["omega"], 7), number(c["omega"] / (2 * math.pi))] if vibrates else []
        rows.append([str(k), number(c["factor"], 8), c["kind"], *frequencies])
    return table(rows, left=(2,))


def _response(found: dict[str, Any], labels: Labels) -> list[str]:
    """Return the largest amplitudes of displacements, rotations and section forces, with frequency and phase."""
    hz = found["hz"]
    rows = [["response to", "probe", "largest amplitude", "", "at f [Hz]", "phase [degrees]"]]
    for name in (n for n in found if n != "hz"):
        for probe, quantities in found[name].items():
            for q in (q for q in (*DISPLACEMENTS, *FORCES) if q in quantities):
                values = [complex(*v) for v in zip(quantities[q]["re"], quantities[q]["im"], strict=True)]
                k = max(range(len(values)), key=lambda i: abs(values[i]))
                if values[k]:
                    rows.append([name, probe, with_unit(q, labels), number(abs(values[k])), number(hz[k]),
                                 number(math.degrees(math.atan2(values[k].imag, values[k].real)), 4)])
    return table(rows, left=(0, 1, 2))


def _linear_model(found: dict[str, Any], labels: Labels) -> list[str]:
    rows = [["pole", "omega [rad/s]", "f [Hz]", "growth [1/s]", "damping ratio"]]
    for k, p in enumerate(found["poles"][:MOST_POLES], start=1):
        rows.append([str(k), number(p["omega"], 7), number(p["hz"]), number(p["growth"]), number(p["damping"])])
    more = len(found["poles"]) - MOST_POLES
    return [f"linear model: {many(len(found['states']), 'state')}; from {', '.join(found['inputs'])} to "
            f"{', '.join(found['outputs'])}", "", *table(rows),
            *([f"{more} more poles of greater modulus are in the result file and in --json"] if more > 0 else [])]


def _limit_points(found: list[dict[str, Any]], labels: Labels) -> list[str]:
    named = [(p, q) for p in found[0]["probes"] for q in DISPLACEMENTS]
    rows = [["limit point", "load factor", *(with_unit(f"{p} {q}", labels) for p, q in named)]]
    floor = ROUND_OFF * max((abs(f["probes"][p][q]) for f in found for p, q in named), default=0.0)
    rows += [[str(k), number(f["factor"], 8), *(rounded(f["probes"][p][q], floor) for p, q in named)]
             for k, f in enumerate(found, start=1)]
    return table(rows)


def _bifurcations(found: list[dict[str, Any]], labels: Labels) -> list[str]:
    rows = ([str(k), number(f["factor"])] for k, f in enumerate(found, start=1))
    return table([["bifurcation", "load factor"], *rows])


def _controllers(found: dict[str, dict[str, float]], labels: Labels) -> list[str]:
    rows = [["controller", "output", "states"]]
    rows += [[name, number(values["output"]), ", ".join(f"{k} {number(v)}" for k, v in values.items() if k != "output")]
             for name, values in found.items()]
    return table(rows, left=(0, 2))


def _windows(found: dict[str, dict[str, float | None]], labels: Labels) -> list[str]:
    rows = [[name, *("-" if v is None else number(v) for v in (one["value"], one["sampling"]))]
            for name, one in found.items()]
    return table([["over a window of time", "value", "sampling error"], *rows])


def _event(event: dict[str, Any]) -> str:
    """Return the description of an event with its numbers."""
    more = (f"{name}: " + ", ".join(f"{k} {number(v)}" for k, v in event[name].items())
            for name in ("impulse", "offset") if name in event)
    return "; ".join([event["what"], *more])


def _events(found: list[dict[str, Any]], labels: Labels) -> list[str]:
    rows = [[f"t [{labels[2]}]", "event"], *([number(event["t"]), _event(event)] for event in found[-MOST_EVENTS:])]
    more = len(found) - MOST_EVENTS
    return [*table(rows, left=(1,)), *([f"and {more} earlier ones"] if more > 0 else [])]


# functions for results of solvers besides probes and reactions
_FINDINGS: dict[str, Callable[[Any, Labels], list[str]]] = {
    "frequencies": _frequencies, "response": _response, "state_space": _linear_model, "critical": _critical,
    "limit_points": _limit_points,
    "bifurcations": _bifurcations, "controllers": _controllers, "events": _events, "windows": _windows,
}


def round_off_floors(summary: dict[str, Any], extent: float, unbalanced: float) -> dict[str, float]:
    """Return, for each kind of quantity, the magnitude below which a value is round-off.

    This is 1e-12 of the largest of its kind among probes, reactions and contacts. Moments and rotations count as forces
    and displacements at the distance ``extent``, and vice versa, because a column of round-off alone has no scale of
    its own. The floor of forces is at least the ``unbalanced`` force of the solution.
    """
    largest: dict[str, float] = dict.fromkeys(KIND_OF.values(), 0.0)
    pressing = [{"fx": one["normal"]} for one in summary.get("contacts", ())]
    for row in (*(row for key in ("probes", "reactions") for row in summary.get(key, {}).values()), *pressing):
        for q, value in row.items():
            largest[KIND_OF.get(q, q)] = max(largest.get(KIND_OF.get(q, q), 0.0), abs(value))
    scales = dict(largest)
    scales["position"] = max(largest["position"], extent)
    for small, large in (("force", "moment"), ("rotation", "displacement")):
        scales[small] = max(largest[small], largest[large] / extent)
        scales[large] = max(largest[large], largest[small] * extent)
    floors = {kind: ROUND_OFF * scale for kind, scale in scales.items()}
    unknown = min(unbalanced, MOST * scales["force"])
    floors["force"] = max(floors["force"], unknown)
    floors["moment"] = max(floors["moment"], unknown * extent)
    return floors


def _quantities(title: str, values: dict[str, dict[str, float]], labels: tuple[str, str, str],
                floors: dict[str, float]) -> list[str]:
    names = list(dict.fromkeys(q for row in values.values() for q in row))
    header = [title, *(with_unit(q, labels) for q in names)]
    rows = [[name, *(rounded(row[q], floors[KIND_OF.get(q, q)]) if q in row else "" for q in names)]
            for name, row in values.items()]
    return table([header, *rows])


def _checks(checks: list[dict[str, Any]], labels: Labels) -> list[str]:
    rows = [["expected", "computed", "known", "", ""]]
    for c in checks:
        what = with_unit(c["what"], labels)
        rows.append([what, number(c["value"], 8), number(c["expected"], 8), _verdict(c), c["source"]])
    return table(rows, left=(0, 3, 4))


def _verdict(check: dict[str, Any]) -> str:
    """Return 'ok', or the difference and the allowed one, in per cent if the expected value is not 0."""
    if check["met"]:
        return "ok"
    if check["value"] is None:
        return "not computed"
    size = abs(check["expected"])
    if size == 0:
        return f"differs by {abs(check['difference']):.2g}, allowed {check['allowed']:.2g}"
    return f"differs by {percent(check['difference'] / size)}, allowed {percent(check['allowed'] / size)}"


def built_report(model: Any) -> str:
    """Return the text of ``-v`` on a model: its parts, and the parts that were left out as not needed."""
    from ..solvers.state_results import asks_for_forces

    num, lines = model.numbering.in_reference, []
    for name, mesh in model.meshes.items():
        plan = mesh.plan
        if plan.rigid:
            lines.append(f"body {name}: rigid, {many(plan.count, 'piece')}")
            continue
        alike = "all alike" if len(mesh.classes) == 1 else f"{len(mesh.classes)} different ones"
        lines.append(f"body {name}: {many(plan.count, 'element')} {plan.element.name} ({alike}), "
                     f"{plan.formulation.name}, {plan.rule}")
        if plan.split:
            lines.append("    nodes where something acts: S = " + ", ".join(f"{s:.6g}" for s in plan.split))
    eliminated = model.n_q - (num.n_unknowns - num.n_multipliers)
    lines.append(f"unknowns: {num.n_unknowns} of {many(model.n_q, 'nodal coordinate')}; {eliminated} eliminated by "
                 f"supports and joints; {many(num.n_multipliers, 'multiplier')}")
    size = f"half-bandwidth {num.half_bandwidth}" if num.fronts is None else (
        f"{many(len(num.fronts.parent), 'front')}, the largest of {num.fronts.largest} unknowns")
    lines.append(f"matrix: {matrix_text(model)}, {size}")
    formulations = ", ".join(dict.fromkeys(m.plan.formulation.name for m in model.meshes.values() if not m.plan.rigid))
    lines.append(f"kernels: force, tangent and energy of {formulations or 'no body'}")
    left_out = ["mass matrix (static)"] if model.case.solver.balances else []
    left_out += [] if num.n_multipliers else ["multipliers (every support and joint could be eliminated)"]
    left_out += [] if asks_for_forces(model.case) else ["section forces (not requested)"]
    lines.append("left out: " + ", ".join(left_out))
    return "\n".join(lines)


_MATRICES = {"SymmetricBand": "symmetric band, LDL^T",
             "SymmetricFronts": "symmetric, LDL^T front by front",
             "GeneralBand": "band, LU with pivoting (LAPACK): follower loads",
             "GeneralSparse": "sparse, LU (SuperLU): follower loads, and the mesh is not a chain"}


def matrix_text(model: Any) -> str:
    """Return the name of the matrix storage and factorisation of a model's tangent."""
    from ..solvers.linear import make_matrix

    if model.case.solver.moves:
        # with inertia on the diagonal, and multipliers ordered after the coordinates they act on, LDL^T needs no
        # pivoting
        return _MATRICES["SymmetricBand" if not model.numbering.nested else "SymmetricFronts"]
    kind = type(make_matrix(model, model.numbering.in_reference)).__name__
    return _MATRICES.get(kind, kind)


def motion_lines(summary: dict[str, Any], labels: tuple[str, str, str]) -> list[str]:
    """Return lines on steps, error estimate, energies and momentum of a dynamic run; ``labels`` are its units."""
    time, energy, force, moment = (unit_label(u, labels) for u in ("s", "N m", "N", "N m"))
    rows = [("time", f"{number(summary['t'])} {time}{_steps(summary, time)}" if "t" in summary else "")]
    rows.append(("error", _accuracy(summary.get("accuracy") or {})))
    found = {k: v for k, v in summary.get("energy", {}).items() if v is not None}
    rows.append(("energy", ", ".join(f"{name} {number(value)}" for name, value in found.items())
                 + (f" [{energy}]" if found else "")))
    if summary.get("energy_drift") is not None:
        rows.append(("drift", f"{summary['energy_drift']:.2g} of the largest kinetic plus strain energy"))
    if impacts := summary.get("impacts"):
        from ..results.info import impact_text

        rows.append(("impacts", f"{impacts['count']} took {number(impacts['lost'])} [{energy}], the strongest: "
                     f"{impact_text(impacts['strongest'], force, time)}"))
    momentum = summary.get("momentum")
    if momentum:
        linear = ", ".join(number(p) for p in momentum["linear"])
        rows.append(("momentum", f"linear ({linear}) [{force} {time}], about the origin "
                                 f"{number(momentum['angular'])} [{moment} {time}]"))
    return [f"{name:<9} {text}" for name, text in rows if text]


def _steps(summary: dict[str, Any], time: str) -> str:
    dt = summary.get("dt")
    if not dt:
        return ""
    sizes = f"of {number(dt[0], 4)} {time}" if dt[1] - dt[0] <= 1e-9 * dt[1] else (
        f"from {number(dt[0], 3)} to {number(dt[1], 3)} {time}")
    cut = summary.get("rejected", 0)
    return f", steps {sizes}" + (f", {many(cut, 'step')} rejected and repeated smaller" if cut else "")


def _accuracy(found: dict[str, Any]) -> str:
    """Return a sentence on the estimated error of the steps, empty if there is none."""
    if found.get("estimate") is None:
        return ""
    if found.get("wanted") is not None:
        # already given with the goal, for meshes and steps together
        return ""
    return (f"about {found['estimate']:.2g} from the {found['of']} (not the mesh), relative to the largest "
            "displacements")


def pursue(session: Session, loaded: LoadedCase, out: str, force: bool, check: bool) -> int:
    """Solve a case to the accuracy that it requests and print the results; return the exit code."""
    from ..case.units import with_unit
    from ..study.accuracy.control import describe, solve_to_accuracy
    from ..study.goal import Target
    from ..study.record import Progress
    from ..study.run import describe_goal

    progress = Progress(warn=session.warn, note=session.note, compiling=session.note_once)
    target = Target(out, force, session.command_line)
    session.parting = lambda: _report_best(session, target)
    reached = solve_to_accuracy(loaded, target, progress, session.note)
    summary = reached.outcome.summary
    session.print_json(summary)
    for text in summary["warnings"]:
        session.warn(text)
    goal = loaded.case.goal
    named = "" if goal is None else with_unit(describe_goal(goal), loaded.case.units.labels)
    session.out(path_table(reached.accuracy, named))
    chosen = choices(reached.accuracy)
    if chosen:
        session.out(chosen)
    session.out(describe(reached.accuracy, loaded.case) + "\n")
    session.out(run_report(summary, loaded.case.units, reached.outcome.model.extent, 0.0))
    session.out(f"\nresults in {out}; next: {command_line('plot', out)}")
    if not reached.achieved:
        say(f"error: the wanted accuracy {reached.accuracy['wanted']:g} was not reached: "
            f"{reached.accuracy['note'] or 'the estimated error is larger'}", err=True)
        return FAILED
    return expected_met(summary, check)


def _report_best(session: Session, target: Target) -> None:
    """Print the file of the best result when the search is interrupted."""
    if target.written:
        session.note(f"the best so far is in {target.out}; next: {command_line('info', target.out)}")


def path_table(accuracy: dict[str, Any], goal: str) -> str:
    """Return a table of all solves, with the values of the ``goal`` if it has a name."""
    timed = accuracy["tolerance"] is not None
    rows = [["elements", *(["tolerance"] if timed else []), *([goal] if goal else []), "error about", TIME, "why"]]
    for level in accuracy["path"]:
        bodies = level.get("bodies")
        tolerance = f"{level['tolerance']:.1g}" if "tolerance" in level else ""
        rows.append([str(level["elements"]) if bodies is None else "+".join(str(n) for n in bodies.values()),
                     *([tolerance] if timed else []), *([number(level["value"], 10)] if goal else []),
                     "-" if level["estimate"] is None else f"{level['estimate']:.1e}", duration(level["wall_s"]),
                     f"failed: {level['reason']}" if "reason" in level else level["why"]])
    return "\n".join([*table(rows, left=(len(rows[0]) - 1,)), ""])


def choices(accuracy: dict[str, Any]) -> str:
    """Return the chosen element type of each body with element auto and the reason, and the parts of the error."""
    lines = [f"{name}: {chosen['element']}; {chosen['why']}" for name, chosen in accuracy.get("types", {}).items()]
    named = {"model_error": "model", "time_error": "time steps", "steps_error": "steps",
             "fibres_error": "number of fibres",
             "points_error": "points in the frequency"}
    parts = [f"{text} {accuracy[key]:.1e}" for key, text in named.items() if key in accuracy]
    if parts:
        lines.append("parts of the estimated error: " + ", ".join(parts))
    by_body = {name: error for name, error in (accuracy["by_body"] or {}).items() if error}
    if len(by_body) > 1:
        lines.append("mesh error by body: " + ", ".join(f"{name} {error:.1e}" for name, error in by_body.items()))
    return "\n".join([*lines, ""]) if lines else ""
