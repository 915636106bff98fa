"""The requested results: goal, expected values, output."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...quantities import FORCES, KINEMATIC, MOTIONS, REACTIONS
from ..binder import Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import Choice, Integer, Known, ListOf, MapOf, Name, Number, Text
from ..nodes import Node, Scalar, quoted
from ..records import Record
from .points import PROBE, Probe

PROBE_QUANTITIES = (*MOTIONS, "vx", "vy", *FORCES)
RESPONSE_QUANTITIES = (*KINEMATIC, *FORCES)
PARTS = ("abs", "re", "im", "phase")
CASE_QUANTITIES = ("strain_energy",)
MODE_KINDS = ("bending", "axial", "shear", "thickness", "rigid", "mixed", "spurious")
# tolerance within which a number of intervals counts as whole
ROUND = 1e-9
FORMS = ("{probe, quantity}, {reaction, quantity}, {quantity: strain_energy}, {kind, number}, "
         "{load_factor}, {limit_point} or {input, probe, quantity}")


def _window(what: str) -> Any:
    return key(ListOf(Number("s", ge=0), "times", 2, 2), what, default=None, example=[0.1, 0.2])


def _window_issues(goal: Any) -> Iterator[Issue]:
    """Yield an issue if a goal has two windows, an empty one, or one for a value that is not a function of time."""
    given = [k for k in ("mean_over", "peak_over") if getattr(goal, k) is not None]
    if len(given) > 1:
        yield Issue((given[1],), "{}: mean_over and peak_over cannot both be given", "one of them")
        return
    for name in given:
        begin, end = getattr(goal, name)
        if not begin < end:
            yield Issue((name,), f"{{}}.{name} is empty: it ends at {end:g} s and begins at {begin:g} s",
                        "two times, the later one last")
        for other in ("kind", "load_factor", "limit_point", "input"):
            if getattr(goal, other) is not None:
                yield Issue((name,), f"{{}}: {name} cannot be given with {other}", "{probe, quantity}, {reaction, "
                            "quantity} or {quantity: strain_energy} of a motion")


def goal_issues(goal: Any) -> Iterator[Issue]:
    """Yield an issue if a goal has none of the known forms, or mixes two."""
    given = [k for k in ("probe", "reaction", "kind", "load_factor", "limit_point")
             if getattr(goal, k) is not None]
    if given == ["probe", "limit_point"]:
        given = ["probe"]
    wrong = [*_response_issues(goal), *_window_issues(goal)]
    yield from wrong
    if wrong:
        return
    if len(given) > 1:
        yield Issue((given[1],), f"{{}}: {given[0]} and {given[1]} cannot both be given", FORMS)
        return
    form = given[0] if given else ""
    allowed = {"probe": PROBE_QUANTITIES if goal.input is None else RESPONSE_QUANTITIES,
               "reaction": REACTIONS, "": CASE_QUANTITIES}.get(form, ())
    if not form and goal.quantity is None:
        yield Issue((), "{}: no quantity is given", FORMS)
    elif goal.quantity is None and allowed:
        yield Issue((), f"{{}}.quantity is missing: which quantity of the {form}", ", ".join(allowed))
    elif goal.quantity is not None and not allowed:
        yield Issue(("quantity",), f"{{}}: quantity cannot be given with {form}")
    elif goal.quantity is not None and goal.quantity not in allowed:
        of = f"a {form}" if form else "the whole case"
        if goal.input is not None:
            of = "a response"
        near = " (is 'probe' or 'reaction' missing?)" if not form else ""
        yield Issue(("quantity",), f"{{}}: {goal.quantity} is not a quantity of {of}{near}",
                    ", ".join(allowed))
    if (goal.kind is None) != (goal.number is None):
        yield (Issue(("number",), "{}: number is for modes only; 'kind' is missing",
                     ", ".join(MODE_KINDS)) if goal.kind is None else
               Issue((), "{}.number is missing: which mode of that kind, counted from 1"))


def _response_issues(goal: Any) -> Iterator[Issue]:
    """Yield an issue if keys of responses are given without the input, probe or frequency that they need."""
    for name in ("hz", "part"):
        if goal.input is None and getattr(goal, name) is not None:
            yield Issue((name,), f"{{}}: {name} is for responses only; 'input' is missing",
                        "input: the name of an input")
    if goal.input is not None and goal.probe is None:
        yield Issue(("input",), "{}: input is given without a probe", "{input, probe, quantity}")
    if goal.input is not None and goal.hz is None and goal.part not in (None, "abs"):
        yield Issue(("part",), f"{{}}: {goal.part} needs a frequency", "hz, or part: abs for the largest amplitude")


class _Quantity(Choice):
    """A quantity; an expression is told where it can be written."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if isinstance(node, Scalar) and "(" in node.text:
            return binder.fail(node.mark, path, f"{dotted(path)} must be a quantity, not the expression "
                               f"{quoted(node.text)}", "{probe, quantity} for a point of a body, with peak_over: "
                               "[t0, t1] for the largest magnitude over time; extremes along the bodies, such as "
                               "max(abs(M)), are for ancf2d optimise")
        return super().bind(node, path, binder)


@record(kw_only=True)
class Value:
    """A value of a solution, as a goal or an expected value names it."""

    probe: str | None = key(Name("the name of a probe"), "Probe", default=None, refers="probes", example="mid")
    quantity: str | None = key(
        _Quantity(*PROBE_QUANTITIES, "omega", *REACTIONS, *CASE_QUANTITIES),
        "Quantity: x, y, ux, uy, theta, vx, vy, N, Q, M of a probe; fx, fy, m of a reaction; strain_energy of the "
        "case; x, y, ux, uy, theta, vx, vy, omega, N, Q, M of a response", default=None, example="uy")
    reaction: str | None = key(Name("the name of a boundary condition"), "Boundary condition whose reaction is the "
                               "goal", default=None, refers="reactions", example="left")
    kind: str | None = key(Choice(*MODE_KINDS), "Kind of mode (eigen)", default=None, example="bending")
    number: int | None = key(Integer(), "Number of the mode within its kind, counted from 1", default=None)
    load_factor: int | None = key(Integer(), "Number of the buckling load factor, counted from 1", default=None)
    limit_point: int | None = key(
        Integer(), "Number of the limit point along the path, counted from 1; the goal is its load factor or, with "
        "probe and quantity, that quantity of the probe there", default=None)
    input: str | None = key(Name("the name of an input"), "Input, one of solver.inputs, whose response is the goal "
                            "(frequency_response)", default=None, example="shaker")
    hz: float | None = key(Number("Hz", ge=0), "Frequency of the response (default: that of the largest amplitude)",
                           default=None, example=10)
    part: str | None = key(Choice(*PARTS), "Part of the complex amplitude: abs (default), re, im, or phase [rad], by "
                           "which it leads the input", default=None, example="abs")
    mean_over: tuple[float, float] | None = _window("Window of time [s]: the mean of the quantity over it (motions)")
    peak_over: tuple[float, float] | None = _window("Window of time [s]: the largest magnitude of the quantity within "
                                                    "it (motions)")

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the value has none of the known forms, or mixes two."""
        return goal_issues(self)


@record(kw_only=True)
class Goal(Value):
    """Value whose accuracy matters."""

    model: str | None = key(Choice("beam", "continuum"), "With element: auto, the reference for the "
                            "error: the geometrically exact beam (default), or the plane-stress continuum",
                            default=None)


class _Goal(Record):
    """A goal; a text is read as its quantity, so that messages say what else it needs."""

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        if node.shape == "text":
            return Record(self.cls, "quantity").bind(node, path, binder)
        return super().bind(node, path, binder)


GOAL = _Goal(Goal)


@record(kw_only=True)
class Expected(Value):
    """A known value, for checking the result."""

    value: float = key(Number(), "Known value", example=-9.6061e-5)
    rtol: float | None = key(Number("", ge=0), "Allowed error, relative to the value", default=None,
                             example=1e-4)
    atol: float | None = key(Number("", ge=0), "Allowed error, absolute", default=None)
    source: str | None = key(Text(number=True), "Source of the value", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the value has no known form, or lacks a tolerance."""
        yield from super().check()
        if self.rtol is None and self.atol is None:
            yield Issue((), "{}: neither rtol nor atol is given", "rtol (relative to the value) "
                        "or atol")
        elif self.value == 0 and not self.atol:
            yield Issue(("value",), "{}: a value of 0 needs an absolute tolerance",
                        "atol > 0")


@record
class Output:
    """What to store in the result file."""

    probes: dict[str, Probe] = key(MapOf(PROBE, "points by name"), "Points whose motion is recorded: BODY@S, or "
                                   "{at: BODY@S, y: distance from the axis}",
                                   default={}, example={"mid": "beam@0.5"})
    every: int | None = key(Integer(), "Number of steps between stored states (default in motion: about 200 states, at "
                            "the ends of fixed steps)", default=None)
    interval: float | None = key(Number("s", gt=0), "Time between stored states", default=None)
    fields: tuple[str, ...] = key(ListOf(Known("output_fields"), "field names"),
                                  "Fields to store over the bodies: N, Q, M (at the probes too), stress, strain, "
                                  "energy (per volume), plastic_strain (of fibres), and pressure, traction, gap "
                                  "(of contact, on both faces)", default=())

    def stores(self, step: int, t: float) -> bool:
        """Return whether the equilibrium of a step, numbered from 1, at time t is stored."""
        if self.interval is None:
            return step % (self.every or 1) == 0
        n = t / self.interval
        return abs(n - round(n)) <= ROUND * max(n, 1.0)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the interval is given in two ways."""
        if self.every is not None and self.interval is not None:
            yield Issue(("interval",), "{}: every and interval are both given",
                        "one of every (steps) and interval (time)")


@record
class Units:
    """Labels of the consistent set of units that a case is written in."""

    length: str = key(Text("the name of a unit"), "Unit of length", default="m", example="mm")
    force: str = key(Text("the name of a unit"), "Unit of force", default="N", example="N")
    time: str = key(Text("the name of a unit"), "Unit of time", default="s", example="s")

    @property
    def labels(self) -> tuple[str, str, str]:
        """The labels of length, force and time."""
        return self.length, self.force, self.time
