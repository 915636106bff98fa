"""``ancf2d schema``: the formats of case files and of the output of commands."""

from __future__ import annotations

import json
import os
from typing import Any

import click

from .options import examples, force_option, plain_session
from .session import Session
from .text import write

Schema = dict[str, Any]


def _is(kind: str, doc: str = "") -> Schema:
    """Return the schema of a value of one JSON type, or of that type or null if ``kind`` ends in '?'."""
    name = kind.rstrip("?")
    return {"type": [name, "null"] if kind.endswith("?") else name, **({"description": doc} if doc else {})}


def _list(item: Schema, doc: str = "") -> Schema:
    return {"type": "array", "items": item, **({"description": doc} if doc else {})}


def _named(value: Schema, doc: str = "") -> Schema:
    return {"type": "object", "additionalProperties": value, **({"description": doc} if doc else {})}


def _object(doc: str, optional: Schema | None = None, /, **keys: Schema) -> Schema:
    """Return the schema of an object that has all ``keys`` and may have ``optional`` ones."""
    return {"type": "object", "description": doc, "properties": {**keys, **(optional or {})}, "required": list(keys)}


NUMBER, WHOLE, TEXT, FLAG = _is("number"), _is("integer"), _is("string"), _is("boolean")
NUMBER_OR_NONE = _is("number?")
AT = _is("object", "where it failed: a place in a file, a time, a load factor, ...")
SECONDS = _is("number?", "time of the solve alone [s]")
QUANTITIES = _named(NUMBER_OR_NONE)
PROBLEM = _object("a mistake in a case", file=TEXT, line=WHOLE, column=WHOLE, path=_is("string", "as in --set"),
                  message=TEXT, expected=TEXT, near=_is("string", "the name that may have been meant"))
_FAILED: Schema = {"reason": _is("string", "why it failed"), "at": AT, "advice": _is("string", "what to change"),
                   "residuals": _list(NUMBER_OR_NONE), "problems": _list(PROBLEM)}
_WARNINGS = _list(TEXT, "as on stderr")
_ELEMENT: Schema = {"element": TEXT, "formulation": TEXT}
_EVENTS = _list(_object("what begins or ends", {
    "impulse": _is("object", "fx, fy, m of a support on its body"),
    "offset": _is("object", "deviation from the prescribed position and angle")},
    t=_is("number", "time"), what=_is("string", "what it is")))
_IMPACTS = _object("of contacts without a law in a motion", count=_is("integer", "how many"),
                   lost=_is("number", "energy that they took"), **dict.fromkeys(
    ("first", "strongest"), _is("object", "t, contact, body, touched, S, points, impulse, lost")))
_ACCURACY = _is("object?", "of the goal, or of time or load steps: estimate (relative), wanted, achieved, "
                "by_body (parts of the estimate), ...")


def _run() -> Schema:
    frequency = _object(
        "a mode", {"gaps": NUMBER, "verified": FLAG, "growth": _is("number", "real part of the eigenvalue [1/s]"),
                   "damping": _is("number", "-real part/modulus"), "residual": _is("number", "relative"),
                   "strain": _named(NUMBER, "shares of the strain energy")},
        omega=_is("number", "imaginary part of the eigenvalue [rad/s]"), hz=NUMBER, kind=TEXT,
        number=_is("integer", "within its kind"), shares=_named(NUMBER, "of its energy"))
    critical = _object("where small motions begin to grow", factor=NUMBER, kind=_is("string", "flutter or divergence"),
                       omega=_is("number", "[rad/s]"))
    amplitude = _object("complex amplitudes of exp(i omega t)", re=_list(NUMBER), im=_list(NUMBER))
    pole = _object("a pole", omega=_is("number", "[rad/s]"), hz=NUMBER, growth=NUMBER, damping=NUMBER)
    linear = _object("a linear model of small motions", inputs=_list(TEXT), outputs=_list(TEXT), states=_list(TEXT),
                     poles=_list(pole, "one of each pair, lowest modulus first"))
    limit = _object("a limit point", factor=NUMBER, probes=_named(QUANTITIES))
    check = _object("an expected value", what=TEXT, expected=NUMBER, value=NUMBER_OR_NONE, difference=NUMBER_OR_NONE,
                    allowed=NUMBER, met=FLAG, source=TEXT)
    contact = _object("a contact, as it acts on the first body named", {
        "from": _is("number?", "least S that touches"), "to": _is("number?", "largest S that touches")}, name=TEXT,
        force=_list(NUMBER), moment=_is("number", "about the origin"),
        normal=_is("number", "integral of the pressure"), length=_is("number", "of the reference axis"))
    window = _object("a mean or peak", {"from": _is("number", "where it begins"), "to": _is("number", "where it ends")},
                     of=TEXT, value=NUMBER_OR_NONE, sampling=NUMBER_OR_NONE)
    optional: Schema = {
        "reactions": _named(QUANTITIES, "fx, fy, m of each support and obstacle"),
        "contacts": _list(contact, "in the order of the case"),
        "controllers": _named(QUANTITIES, "output and states of each controller at the end"),
        "windows": _named(window, "goals and expected values that are over windows of time"),
        "energy": _named(NUMBER_OR_NONE, "strain, kinetic, potential; of motions also work and dissipated"),
        "t": _is("number", "the last time"), "load_factor": _is("number", "the last load factor"),
        "negative_pivots": _is("integer", "of the tangent at the static state: 0 if it is stable"),
        "frequencies": _list(frequency, "lowest first"), "load_factors": _list(NUMBER, "of buckling"),
        "critical": _list(critical, "those load factors"), "state_space": linear,
        "response": {**_object("of frequency_response", hz=_list(NUMBER, "the frequencies")),
                     "additionalProperties": _named(_named(amplitude, "by probe and quantity"), "of one input")},
        "response_error": _is("number?", "estimate, relative to the largest displacement of a probe at that frequency; "
                              "null if each frequency is solved"),
        "limit_points": _list(limit, "in order along the path"), "bifurcations": _list(_is("object")),
        "method": _is("string", "the integrator"), "rejected": _is("integer", "steps repeated smaller"),
        "dt": _list(NUMBER, "the smallest and the largest step"), "initial": _is("object", "the initial velocities"),
        "energy_drift": _is("number?", "relative to the largest kinetic plus strain energy"),
        "events": _EVENTS, "impacts": _IMPACTS,
        "momentum": _object("at the end", linear=_list(NUMBER), angular=_is("number", "about the origin")),
        "accuracy": _ACCURACY, "contact_error": _is("number", "position error of bodies between contact points")}
    return _object("one solved case", {**optional, **_FAILED}, case=TEXT, title=TEXT, status=TEXT, solver=TEXT,
                   elements=WHOLE, dofs=_is("integer", "nodal coordinates before elimination"),
                   probes=_named(QUANTITIES, "x, y, ux, uy, theta, ... of each probe at the end"), iterations=WHOLE,
                   steps=WHOLE, wall_s=SECONDS, checks=_list(check), output=_is("string?", "the result file"),
                   warnings=_WARNINGS)


def _validate() -> Schema:
    case = _object("one case", case=TEXT, status=TEXT, problems=_list(PROBLEM), warnings=_WARNINGS)
    return _object("all cases", status=TEXT, cases=_list(case))


def _convergence() -> Schema:
    limit: Schema = {"extrapolated": _is("number?", "the limit"), "error_bar": NUMBER_OR_NONE,
                     "order": NUMBER_OR_NONE, "asymptotic": _is("boolean?"), "note": _is("string?")}
    row = _object("one level", {"reason": TEXT, "dt": NUMBER_OR_NONE, "tolerance": NUMBER_OR_NONE}, **_ELEMENT,
                  elements=WHOLE, dofs=WHOLE, value=NUMBER_OR_NONE, error=_is("number?", "relative"),
                  order=NUMBER_OR_NONE, wall_s=SECONDS, status=TEXT)
    return _object("a convergence study; of several element types, the limits are in elements", _FAILED, case=TEXT,
                   title=TEXT, status=TEXT, goal=TEXT, reference={"type": ["number", "string"]}, over=TEXT,
                   rows=_list(row), **limit, elements=_list(_object("one element type", **_ELEMENT, **limit)),
                   warnings=_WARNINGS)


def _tradeoff() -> Schema:
    setting: Schema = {"quadrature": {}, "method": TEXT, "dt": NUMBER, "tolerance": NUMBER, "error_below": NUMBER}
    measured: Schema = {**_ELEMENT, "elements": WHOLE, "dofs": _is("integer?"), "value": NUMBER_OR_NONE,
                        "error": _is("number?", "relative to the type's own limit"),
                        "judged": _is("number?", "the error that the front is based on"),
                        "model_error": NUMBER_OR_NONE, "wall_s": SECONDS, "memory_bytes": _is("integer?")}
    row = _object("one setting", {**setting, "reason": TEXT}, **measured, runs=_is("integer"), pareto=FLAG, status=TEXT)
    best = {"anyOf": [_object("a setting", setting, **measured, set=_list(TEXT, "options of --set")), {"type": "null"}]}
    return _object("error against measured cost", _FAILED, case=TEXT, title=TEXT, status=TEXT, goal=TEXT, against=TEXT,
                   meaning=_named(TEXT), rows=_list(row), recommended=_named(best, "for each wanted accuracy"),
                   series=_list(_is("object")), continuum=_is("object?"), budget_s=NUMBER, spent_s=NUMBER,
                   dropped=_list(_is("object")), warnings=_WARNINGS)


def _sweep() -> Schema:
    row = _object("one variant", {"reason": TEXT, "warnings": _WARNINGS}, set=_is("object", "path and value"),
                  status=TEXT, goal=NUMBER_OR_NONE, values=_named(NUMBER_OR_NONE), output=_is("string?"),
                  elements=_is("integer?"), dofs=_is("integer?"), wall_s=SECONDS, accuracy=_ACCURACY, reused=FLAG)
    said = _object("a computed value over all samples", count=_is("integer", "samples that were computed"),
                   mean=NUMBER_OR_NONE, sd=_is("number?", "with n - 1"), quantiles={"type": ["object", "null"]},
                   shares={"type": ["object", "null"], "description": "first-order shares of the variance by path"},
                   share_errors={"type": ["object", "null"], "description": "standard errors of the shares"})
    samples = _object("how samples were drawn", design=TEXT, seed=WHOLE, count=WHOLE)
    return _object("a sweep", {**_FAILED, "samples": samples, "statistics": _named(said)}, case=TEXT, title=TEXT,
                   status=TEXT, folder=TEXT, output=_is("string", "the file of all rows"), rows=_list(row))


def _sensitivity() -> Schema:
    row = _object("a number of the case", path=TEXT, value=NUMBER, derivative=NUMBER,
                  elasticity=_is("number?", "relative change of the goal by a relative change of the number"),
                  error=_is("number", "estimate of the error of the derivative"),
                  influence=_is("number", "change of the goal if the number changes by its own size"),
                  method=_is("string", "exact, or differences of runs and why"))
    return _object("derivatives of the goal, the most influential first", {"output": TEXT, **_FAILED}, case=TEXT,
                   title=TEXT, status=TEXT, of=TEXT, goal=NUMBER, rows=_list(row), warnings=_WARNINGS,
                   skipped=_named(TEXT, "why a number has no derivative"))


def _optimise() -> Schema:
    row = _object("a number of the case", path=TEXT, value=NUMBER, start=NUMBER, low=NUMBER, high=NUMBER,
                  at_bound=_is("string?", "low or high"))
    constraint = _object("a constraint", constraint=TEXT, excess=_is("number", "at most 0 if it is met"), met=FLAG,
                         active=FLAG)
    return _object("an optimum", {"history": TEXT, **_FAILED}, case=TEXT, title=TEXT, status=TEXT, minimise=TEXT,
                   rows=_list(row), minimum=NUMBER, constraints=_list(constraint), evaluations=WHOLE,
                   failed=_is("integer", "number of evaluations without a solution"), gradients=WHOLE,
                   message=_is("string", "how the optimiser ended"), output=TEXT, warnings=_WARNINGS)


def _fit() -> Schema:
    row = _object("a fitted number", path=TEXT, value=NUMBER, low=NUMBER, high=NUMBER, start=NUMBER,
                  standard_error=_is("number?", "null if the data do not determine the number"))
    column = _object("a measured column", name=TEXT, rms=_is("number", "root of the mean square difference"),
                     scale=_is("number", "scale of the differences: noise or range"))
    start = _object("a search", start=_named(NUMBER), residual=NUMBER, values=_named(NUMBER))
    return _object("a fit", _FAILED, case=TEXT, title=TEXT, status=TEXT, rows=_list(row), columns=_list(column),
                   residual=_is("number", "root of the mean square of all differences, each relative to its scale"),
                   correlation=_list(_list(NUMBER_OR_NONE)), points=WHOLE, runs=WHOLE, starts=_list(start),
                   output=_is("string", "the case with its fitted numbers"),
                   results=_is("string", "parameters, data and model"), warnings=_WARNINGS)


def _info() -> Schema:
    body = _object("a body", element=TEXT, formulation=TEXT, elements=WHOLE, nodes=WHOLE)
    return _object("a result file", _FAILED, file=TEXT, bytes=WHOLE, title=TEXT, case=TEXT, solver=TEXT, status=TEXT,
                   made=_is("object", "when, by which command and versions"), units=_named(TEXT), bodies=_named(body),
                   checkpoint=NUMBER_OR_NONE, dofs=WHOLE, states=WHOLE, steps=WHOLE, range=_list(NUMBER),
                   probes=_named(_named(_object("a quantity", value=NUMBER_OR_NONE, units=TEXT))),
                   fields=_is("object"), tables=_is("object"), arrays=_is("object"),
                   summary=_is("object", "what run --json has printed"))


def _compare() -> Schema:
    difference = _object("the worst difference in a dataset", dataset=TEXT, what=TEXT, a={}, b={}, index=_list(WHOLE),
                         t=NUMBER_OR_NONE, absolute=NUMBER_OR_NONE, relative=NUMBER_OR_NONE, scale=NUMBER_OR_NONE,
                         count=WHOLE, total=WHOLE)
    return _object("a comparison", _FAILED, a=TEXT, b=TEXT, status=_is("string", "agree or differ"), rtol=NUMBER,
                   atol=NUMBER, differences=_list(difference))


def _elements() -> Schema:
    formulation = _object("a formulation", name=TEXT, default=FLAG, quadrature={}, points=_is("string?"),
                          refused=_is("string?", "why the type cannot have it"), doc=TEXT, source=TEXT)
    node = _object("a node", at=NUMBER, coordinates=_list(TEXT))
    keys: Schema = {"name": TEXT, "basis": _list(TEXT), "dofs": WHOLE, "nodes": _list(node),
                    "formulations": _list(formulation), "shear_factor": {}, "preset": _is("object"), "source": TEXT,
                    "note": TEXT}
    found = _object("an element type", **keys)
    return {"type": "object", "description": "all element types, or the one that is named",
            "properties": {"elements": _list(found), "families": _list(_is("object")), **keys, **_FAILED},
            "anyOf": [{"required": ["elements", "families"]}, {"required": list(keys)}]}


def _audit() -> Schema:
    check = _object("a check", name=TEXT, value=NUMBER_OR_NONE, meaning=TEXT, question=TEXT,
                    verdict={"enum": ["pass", "fail", "note", "skipped"]})
    return _object("an examination", {"formulation": TEXT, "shear_factor": {}, "quadrature": _is("object"), **_FAILED},
                   element=TEXT, basis=_list(TEXT), coordinates=WHOLE, checks=_list(check), verdicts=_named(WHOLE))


def _export() -> Schema:
    return _object("an export", _FAILED, file=TEXT, output=TEXT, status=TEXT, bytes=WHOLE)


# output of each command with --json if it succeeds
OUTPUTS = {"validate": _validate, "run": _run, "convergence": _convergence, "tradeoff": _tradeoff,
           "sensitivity": _sensitivity, "optimise": _optimise,
           "sweep": _sweep, "fit": _fit, "info": _info, "compare": _compare, "export": _export,
           "elements": _elements, "audit": _audit}


def output_schema(command: str) -> Schema:
    """Return the JSON Schema of the object that a command prints with ``--json``, including failures."""
    failure = _object("a failure", _FAILED, status={"enum": ["failed", "interrupted"]}, reason=TEXT, at=AT)
    return {"$schema": "http://json-schema.org/draft-07/schema#", "title": f"ancf2d {command} --json",
            "anyOf": [OUTPUTS[command](), failure]}


@click.command(epilog=examples("ancf2d schema -o ancf2d.schema.json", "ancf2d schema --markdown",
                               "ancf2d schema --of run"))
@click.option("-o", "--output", type=click.Path(), metavar="FILE", help="Write to a file instead of stdout.")
@click.option("--markdown", is_flag=True,
              help="Print the reference of all keys as Markdown, instead of the JSON Schema.")
@click.option("--definition", is_flag=True, help="Print the schema of files that define your own elements.")
@click.option("--of", "of", type=click.Choice(list(OUTPUTS)),
              help="Print the schema of the --json output of a command.")
@force_option
@plain_session
def command(session: Session, output: str | None, markdown: bool, definition: bool, of: str | None,
            force: bool) -> int:
    """Print the JSON Schema of case files, or of the --json output of a command."""
    if markdown + definition + (of is not None) > 1:
        raise click.UsageError("--markdown, --definition and --of exclude each other.")
    text = schema_text(markdown, definition) if of is None else _as_text(output_schema(of))
    if output is None:
        write(text)
        return 0
    write_schema(output, text, force)
    session.out(f"wrote {output}")
    return 0


def schema_text(markdown: bool = False, definition: bool = False) -> str:
    """Return the JSON Schema of cases (or of element definitions), or the reference in Markdown."""
    from ..case import definition_schema, json_schema, markdown_reference
    from ..results.target import MARK
    from ..study.run import vocabulary

    names = vocabulary()
    if markdown:
        return f"{markdown_reference(names)}\n<!-- {MARK} -->\n"
    schema = definition_schema(names) if definition else json_schema(names)
    return _as_text(schema)


def _as_text(schema: dict[str, Any]) -> str:
    from ..results.target import MARK

    return json.dumps({"$comment": MARK, **schema}, indent=2) + "\n"


def write_schema(path: str | os.PathLike[str], text: str, force: bool) -> None:
    """Write a schema to a file. Raises ResultsError if it would replace another file, or cannot be written."""
    from ..results.target import replacing

    with replacing(path, force) as private:
        private.write_text(text, encoding="utf-8")
