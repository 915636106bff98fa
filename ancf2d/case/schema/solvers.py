"""Solvers: what to compute, and where to end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...quantities import KINEMATIC, MOTIONS
from ..binder import Issue, reversed_range
from ..declare import key, record
from ..kinds import Choice, Flag, Integer, Known, ListOf, Name, Number, ProbeQuantity, Sign
from ..records import ByKeys, Record
from .active import Condition

# shortest step over the duration of the motion: smaller ones are lost to round-off when added to the time
SHORTEST = 1e-12
# default error of the cubic between neighbouring frequencies, relative to the response there
RESOLUTION = 1e-3
# defaults: relative error of adaptive steps, number of load steps and of time steps, largest step of a path (as a share
# of the size of the model and of the length of the path)
STEP_TOLERANCE, LOAD_STEPS, TIME_STEPS, LARGEST_STEP = 1e-6, 10, 100, 0.1
INPUTS_DOC = ("Names of the loads and prescribed motions that oscillate. Their values are the amplitudes; their "
              "amplitudes over time are ignored, and they do not act on the static state")


def _about() -> Any:
    return key(Choice("reference", "static"), "State about which the model vibrates: the reference, or the static "
               "equilibrium under the loads", default="reference")


class Kind:
    """The properties that a solver declares, so that the rest of the code need not ask for solvers by name."""

    # computes a motion (moves), states over time from 0 to t_end (timed), equilibria, whose balance gives section
    # forces (balances), these for small displacements only (linear), vibrations about a state (vibrates), load factors
    # (scales)
    moves = timed = balances = linear = vibrates = scales = False
    # whether results on three meshes show an order: one state for each, which finer meshes do not replace
    shows_order: Any = False
    # whether it reports probes only
    probes_alone = False

    @property
    def on_path(self) -> bool:
        """Whether it follows a path along which the load factor is an unknown."""
        return False

    @property
    def takes_guess(self) -> bool:
        """Whether it can start from a guess of its last state."""
        return False

    @property
    def end(self) -> float:
        """The final load factor or time; on a path it is found by the solver."""
        return 1.0

    def with_steps(self, ratio: float) -> dict[str, Any]:
        """Return the keys that multiply its number of steps to an equilibrium by ``ratio``, if it has such steps."""
        return {}

    @property
    def course(self) -> tuple[float, float]:
        """The range of load factors or times passed through, as (lowest, highest)."""
        return min(0.0, self.end), max(0.0, self.end)


@record
class LoadFactor:
    """Follow the path up to a load factor."""

    value: float = key(Number(), "Load factor", name="load_factor", example=1)


@record
class LimitPoints:
    """Follow the path through a number of limit points."""

    count: int = key(Integer(), "Number of limit points", name="limit_points", example=2)


@record
class ProbeReaches:
    """Follow the path until a probe reaches a value."""

    probe: str = key(Name("the name of a probe"), "Probe", refers="probes", example="tip")
    quantity: str = key(Choice(*MOTIONS), "Quantity of the probe", example="uy")
    reaches: float = key(Number(), "Value at which to stop", example=-80)


@record
class BranchAt:
    """Leave the path at a bifurcation, without an imperfection."""

    at: int = key(Integer(), "Number of the bifurcation along the path, counted from 1", default=1)
    direction: int = key(Sign(), "Direction of the branch along its mode; with 1, the point that moves most "
                         "moves towards positive x or y", default=1)


@record
class LinearStatic(Kind):
    """Static equilibrium for small displacements."""

    tag = "linear_static"
    balances = linear = shows_order = True


@record
class Static(Kind):
    """Static equilibrium, or an equilibrium path, with large displacements."""

    tag = "static"
    balances = True
    steps: int | None = key(Integer(), "Number of load steps: each raises the load by at most 1/steps of the total; "
                            "with arc_length, the maximum number of steps", default=None)
    tolerance: float | None = key(Number("", gt=0, lt=1), "Relative size of the last Newton "
                                  "correction", default=None, example=1e-10)
    max_iterations: int | None = key(Integer(), "Maximum number of Newton iterations per step",
                                     default=None)
    factors: tuple[float, ...] | None = key(ListOf(Number(), "load factors", 1), "Load factors at which steps end, in "
                                            "addition to those of ``steps`` (method newton)", default=None,
                                            example=[0.25, 0.6])
    largest_step: float | None = key(
        Number("", gt=0, le=1), "Largest step of a path (method arc_length): the displacement of a point relative to "
        "the size of the model, and the share of the distance to a load factor or value (default "
        f"{LARGEST_STEP:g})", default=None,
        example=0.02)
    method: str = key(Choice("newton", "arc_length", "displacement"), "Path-following method",
                      default="newton")
    until: LoadFactor | LimitPoints | ProbeReaches = key(
        ByKeys((LimitPoints, ("limit_points",)),
               (ProbeReaches, ("probe", "quantity", "reaches")), (LoadFactor, ())),
        "Where the path ends (default: load factor 1)", default=LoadFactor(1.0),
        example={"load_factor": 1})
    branch: BranchAt | None = key(Record(BranchAt), "Where to leave the path, and to which side (arc_length)",
                                  default=None, example={"at": 1, "direction": 1})
    verify: bool = key(Flag(), "Repeat the solution with load steps half as long to estimate the error of the steps, "
                               "for example where fibres yield (method newton)", default=False)

    @property
    def on_path(self) -> bool:
        """Whether the load factor is an unknown along the path."""
        return self.method != "newton"

    @property
    def takes_guess(self) -> bool:
        """Whether it can start from a guess of its last state: not on a path, which is followed from its start."""
        return not self.on_path

    @property
    def shows_order(self) -> bool:
        """Whether results on three meshes show an order: not if a path is followed, whose end is refined separately."""
        return not self.on_path

    @property
    def end(self) -> float:
        """The final load factor; on a path it is found by the solver."""
        return self.until.value if isinstance(self.until, LoadFactor) else 1.0

    def with_steps(self, ratio: float) -> dict[str, Any]:
        """Return the keys that give it ``ratio`` times as many steps."""
        if self.method == "arc_length":
            most = {} if self.steps is None else {"steps": max(round(self.steps * ratio), self.steps)}
            return {"largest_step": min((self.largest_step or LARGEST_STEP) / ratio, 1.0), **most}
        return {"steps": max(int((self.steps or LOAD_STEPS) * ratio), 1)}

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each key that the method does not allow."""
        if self.verify and self.on_path:
            yield Issue(("verify",), f"{{}}.verify compares states at equal load factors, which method {self.method} "
                        "does not have", "method: newton")
        if self.factors is not None and self.on_path:
            yield Issue(("factors",), f"{{}}.factors: method {self.method} finds the load factors", "method: newton")
        elif (beyond := next((f for f in self.factors or () if not min(self.end, 0.0) <= f <= max(self.end, 0.0)),
                             None)) is not None:
            yield Issue(("factors",), f"{{}}: the solution does not reach the factor {beyond:g}",
                        f"factors from 0 to {self.end:g}")
        if isinstance(self.until, LimitPoints) and self.method != "arc_length":
            yield Issue(("until",), f"{{}}: limit points cannot be passed with method "
                        f"{self.method}", "method: arc_length")
        if isinstance(self.until, ProbeReaches) and self.method == "newton":
            yield Issue(("until",), "{}: method newton ends at a load factor, not at a displacement", "method: "
                        "arc_length or displacement")
        if isinstance(self.until, LoadFactor) and self.method == "displacement":
            yield Issue(("until",), "{}: method displacement ends where a probe reaches a value",
                        "until: {probe, quantity, reaches}")
        if self.largest_step is not None and self.method != "arc_length":
            yield Issue(("largest_step",), f"{{}}: method {self.method} has no largest step; steps sets how many it "
                        "takes", "steps, or method: arc_length")
        if self.branch is not None and self.method != "arc_length":
            yield Issue(("branch",), f"{{}}: method {self.method} cannot follow branches", "method: arc_length")


@record
class QuasiStatic(Kind):
    """Equilibrium over time without inertia, for creep, slow cycles and thermal histories."""

    tag = "quasi_static"
    timed = balances = True
    t_end: float = key(Number("s", gt=0), "End time; the solution starts at t = 0 with the instantaneous response",
                       example=100)
    tolerance: float = key(Number("", gt=0, lt=1), "Error relative to the largest displacement and, if materials "
                           "relax, to the largest support force; steps adapt to it", default=STEP_TOLERANCE)
    steps: int | None = key(Integer(), "Minimum number of time steps: none is longer than t_end/steps (default "
                            f"{TIME_STEPS})", default=None, example=400)
    times: tuple[float, ...] | None = key(ListOf(Number("s", ge=0), "times", 1), "Times at which steps end, in "
                                          "addition to those that the tolerance requires", default=None,
                                          example=[1, 10, 100])
    max_iterations: int | None = key(Integer(), "Maximum number of Newton iterations per step", default=None)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if a time is after the end."""
        late = next((t for t in self.times or () if t > self.t_end), None)
        if late is not None:
            yield Issue(("times",), f"{{}}: the solution does not reach {late:g}", f"times up to t_end, {self.t_end:g}")

    @property
    def end(self) -> float:
        """The end time."""
        return self.t_end

    def with_steps(self, ratio: float) -> dict[str, Any]:
        """Return the keys that give it ``ratio`` times as many steps, whose errors are of second order."""
        return {"steps": max(int((self.steps or TIME_STEPS) * ratio), 1), "tolerance": self.tolerance / ratio**2}


@record
class Eigen(Kind):
    """Natural frequencies, damping and modes."""

    tag = "eigen"
    vibrates = True
    modes: int = key(Integer(), "Number of modes, from the lowest; if damping makes them complex, the number of "
                     "complex pairs, to which real eigenvalues are added", default=10)
    about: str = _about()
    damped: bool = key(Flag(), "Include dampers and damping", default=True)
    verify: bool = key(Flag(), "Check every mode on a mesh twice as fine: a mode without a counterpart there is "
                       "spurious", default=False)

    @property
    def shows_order(self) -> bool:
        """Whether results on three meshes show an order: not if ``verify`` solves on finer meshes itself."""
        return not self.verify


@record
class FrequencyResponse(Kind):
    """Response of the probes to oscillating loads and motions, as a function of the frequency."""

    tag = "frequency_response"
    vibrates = probes_alone = True
    inputs: tuple[str, ...] = key(ListOf(Name("the name of a load or of a prescribed motion"), "names", 1), INPUTS_DOC,
                                  example=["shaker"])
    from_: float | None = key(Number("Hz", gt=0), "Lowest frequency", default=None, example=1)
    to: float | None = key(Number("Hz", gt=0), "Highest frequency", default=None, example=500)
    points: int = key(Integer(2), "Minimum number of frequencies from the lowest to the highest; more are added where "
                      "a response curve bends", default=400)
    scale: str = key(Choice("log", "linear"), "Spacing of the frequencies: logarithmic or linear", default="log")
    frequencies: tuple[float, ...] | None = key(ListOf(Number("Hz", ge=0), "frequencies", 1), "Frequencies, "
                                                "in place of from and to", default=None, example=[1, 10, 100])
    tolerance: float | None = key(Number("", gt=0, lt=1), "Interpolation error allowed between the frequencies, "
                                  "relative to the response there; frequencies are added until a cubic through "
                                  f"neighbouring points is as accurate (default {RESOLUTION:g})",
                                  default=None, example=1e-4)
    about: str = _about()

    def check(self) -> Iterator[Issue]:
        """Yield an issue if frequencies are given twice or not at all."""
        ends = [k for k in ("from_", "to") if getattr(self, k) is not None]
        if self.frequencies is not None and ends:
            yield Issue(("frequencies",), "{}: frequencies and a range are both given", "frequencies, or from and to")
        elif self.frequencies is not None and self.tolerance is not None:
            yield Issue(("tolerance",), "{}: tolerance places points in a range, but frequencies are given",
                        "from and to, or no tolerance")
        elif self.frequencies is None and len(ends) < 2:
            yield Issue((), "{}: the frequencies are missing", "from and to, or frequencies")
        elif self.from_ is not None and self.to is not None:
            yield from reversed_range(self.from_, self.to)

    @property
    def resolution(self) -> float:
        """The allowed error of the cubic between neighbouring points of a range."""
        return RESOLUTION if self.tolerance is None else self.tolerance

    @property
    def hz(self) -> tuple[float, ...]:
        """The frequencies [Hz] that the case gives; in a range the solver may add more."""
        if self.frequencies is not None:
            return self.frequencies
        assert self.from_ is not None
        assert self.to is not None
        low, high, n = self.from_, self.to, self.points - 1
        if self.scale == "log":
            return (low, *(low * (high / low) ** (k / n) for k in range(1, n)), high)
        return (low, *(low + (high - low) * k / n for k in range(1, n)), high)


@record
class StateSpace(Kind):
    """Linear model x' = A x + B u, y = C x + D u of small motions, for controller design."""

    tag = "state_space"
    vibrates = True
    inputs: tuple[str, ...] = key(ListOf(Name("the name of a load or of a prescribed motion"), "names", 1), "Names of "
                                  "the loads and prescribed motions that are the inputs; u = 1 stands for the value in "
                                  "the case. Their amplitudes over time are ignored, and they do not act on the "
                                  "static state",
                                  example=["push"])
    outputs: tuple[str, ...] = key(ListOf(ProbeQuantity(*KINEMATIC), "PROBE.QUANTITY", 1),
                                   "Outputs y: the changes of these quantities of probes", example=["tip.uy"])
    modes: int = key(Integer(), "Number of modes, from the lowest; the static response of all others is in D",
                     default=20)
    about: str = _about()

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each output that is named twice."""
        for i, name in enumerate(self.outputs):
            if name in self.outputs[:i]:
                yield Issue(("outputs", i), f"{{}}.outputs: {name} is named twice")


@record
class Buckling(Kind):
    """Load factors at which the linear static state buckles."""

    tag = "buckling"
    scales = shows_order = True
    modes: int = key(Integer(), "Number of load factors, from the lowest", default=4)


@record
class Dynamic(Kind):
    """Motion over time."""

    tag = "dynamic"
    moves = timed = True
    t_end: float = key(Number("s", gt=0), "End of the motion", example=1)
    dt: float | None = key(Number("s", gt=0), "Fixed time step", default=None, example=1e-3)
    tolerance: float | None = key(Number("", gt=0, lt=1), "Relative error for adaptive time steps (without dt: "
                                  f"default {STEP_TOLERANCE:g})", default=None, example=1e-6)
    method: str | None = key(Known("integrators"), "Time integrator (default: the recommended "
                             "one)", default=None)
    max_iterations: int | None = key(Integer(), "Maximum number of Newton iterations per step",
                                     default=None)
    spectral_radius: float | None = key(
        Number("", ge=0, le=1), "Spectral radius at infinite frequency: the factor by which each step reduces motions "
        "far too fast for it, from 1 (no damping) to 0 (removed at once) (generalized_alpha; hht from 0.5; default "
        "0.8)",
        default=None)
    newton: str = key(Choice("reuse", "full"), "full: a new tangent in every Newton iteration; reuse: keep a tangent "
                      "as long as it converges", default="reuse")
    estimate: bool = key(Flag(), "Estimate the error by additional runs with steps of 2 dt and 4 dt, or with "
                         "10 and 100 times the tolerance", default=True)
    until: str | None = key(Condition(), "Condition that ends the motion (default: at t_end)", default=None,
                            example="tip.y < 0")

    @property
    def end(self) -> float:
        """The end time."""
        return self.t_end

    @property
    def local_error(self) -> float:
        """The allowed relative error of adaptive steps."""
        return STEP_TOLERANCE if self.tolerance is None else self.tolerance

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the step is given twice, or is too long or too short for the motion."""
        if self.dt is not None and self.tolerance is not None:
            yield Issue(("tolerance",), "{}: dt and tolerance are both given",
                        "dt for fixed steps, or tolerance for adaptive ones")
        if self.dt is not None and self.dt > self.t_end:
            yield Issue(("dt",), f"{{}}.dt must be <= t_end, got dt {self.dt:g} and t_end "
                        f"{self.t_end:g}")
        if self.dt is not None and self.dt < SHORTEST * self.t_end:
            yield Issue(("dt",), f"{{}}.dt is {self.dt:g}, {self.dt / self.t_end:.2g} of t_end: too small for time to "
                        "advance in floating-point numbers", f"at least {SHORTEST * self.t_end:g}")


# solvers of models that are linearised about a state
SmallMotions = Eigen | FrequencyResponse | StateSpace
Solver = LinearStatic | Static | QuasiStatic | Eigen | FrequencyResponse | StateSpace | Buckling | Dynamic
