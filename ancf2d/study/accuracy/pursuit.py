"""Levels solved on the way to a wanted accuracy, each once, and what their sequence tells of the error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from ...case import Dynamic, LoadedCase
from ...errors import Ancf2dError, CaseError, ComputationError, verdict
from ...model.model import Model
from ...solvers.motion.schemes import DEFAULT, SHARPER, default_method
from ...solvers.registry import solve
from ..goal import Solved, Target, sequence, solve_for_goal
from ..order import Estimate, estimate, observed_order, round_off_level
from ..record import Progress
from ..run import Outcome, Solve, prepare
from .setting import Level, Setting, bodies_with_meshes, with_setting

if TYPE_CHECKING:
    from ...solvers.statics.newton import Start

# of all bodies, on the way to an accuracy
MOST_ELEMENTS = 200_000
# elements times iterations of one solve: some minutes
MOST_WORK = 10**7
MOST_LEVELS = 30
LEAST_TOLERANCE = 1e-12


# of a solved level: what meshes tell, and its relative error
Told = Callable[[Level], tuple[Estimate, float]]


@dataclass
class Pursuit:
    """A case, the relative accuracy that is wanted, and all levels solved so far, in their order.

    ``apart``: the error of simpler models, which meshes do not tell of; ``guesses``: whether statics may begin from
    the ``latest`` state of the same element types on another mesh. ``last``: the level solved last, and its solution;
    ``case``: the case with its setting. ``weights``: by how much the mesh of each body moves the goal, relative to one
    another; ``by_adjoint``: whether the adjoint tells them.
    """

    loaded: LoadedCase
    wanted: float
    progress: Progress
    target: Target | None = None
    tell: Callable[[str], None] = lambda text: None
    levels: list[Level] = field(default_factory=list)
    known: dict[Any, Level] = field(default_factory=dict)
    apart: float = 0.0
    report: dict[str, Any] = field(default_factory=dict)
    outcome: Outcome | None = None
    written: Level | None = None
    guesses: bool = True
    latest: dict[Any, Solved] = field(default_factory=dict)
    last: tuple[Level, Solved] | None = None
    case: LoadedCase | None = None
    weights: dict[str, float] = field(default_factory=dict)
    by_adjoint: bool = False

    def solve(self, setting: Setting, why: str, told: Told | None = None) -> Level:
        """Return the level of a setting, solved unless it is known.

        ``told`` tells of its error where it may be the result: it is written, unless it begins from a guess. Raises
        CaseError for a case that cannot be.
        """
        level = self.known.get(setting.name)
        if level is None:
            level = self.begun(setting, why)
            if self.begins:
                self._run(level, None, lambda model: solve(model, self._guess(model, level)))
            else:
                self._run(level, told)
        return level

    def begun(self, setting: Setting, why: str) -> Level:
        """Return a new level of a setting, which is told of and not solved yet."""
        self.tell(f"{setting.elements} elements" + (
            "" if setting.tolerance is None else f", tolerance {setting.tolerance:.1g}") + (
            "" if setting.method is None else f", {setting.method}") + f": {why}")
        level = self.known[setting.name] = Level(setting, why, kinks=self.slides(setting),
                                                 zones=self.ends_within(setting))
        self.levels.append(level)
        return level

    def whole(self, setting: Setting, why: str, told: Told) -> Level:
        """Return the level of a setting, solved with all its load steps and written as the result, for now."""
        return self.again(self.known.get(setting.name) or self.begun(setting, why), told)

    def again(self, level: Level, told: Told) -> Level:
        """Solve a level with all its load steps and write it as the result, for now."""
        self._run(level, told)
        return level

    def beside(self, found: tuple[Level, Any]) -> tuple[Level, Any]:
        """Keep a level that was solved beside another one, with what belongs to it; return both."""
        level, other = found
        self.tell(f"{level.setting.elements} elements: {level.why}")
        self.levels.append(level)
        self.known.setdefault(level.setting.name, level)
        return level, other

    def slides(self, setting: Setting) -> bool:
        """Whether a point slides along a body that deforms."""
        case = self.loaded.case
        meshed = bodies_with_meshes(case, setting.types)
        return any(joint.slides_along in meshed for joint in case.joints)

    def ends_within(self, setting: Setting) -> bool:
        """Whether zones end within elements, at another place in each mesh: where fibres of a body that deforms yield
        or follow a curve, or where bodies touch without a law in statics."""
        case = self.loaded.case
        meshed = bodies_with_meshes(case, setting.types)
        touches = case.solver.balances and any(contact.law is None for contact in case.contacts)
        return touches or any(material.fibres for body in meshed.values() for material in body.materials)

    def write(self, level: Level, told: Told) -> None:
        """Make a level the result, solved once more, from the reference on, unless it is written already."""
        if self.written is not level:
            self.tell(f"{level.setting.elements} elements: the result")
            self._run(level, told)

    @property
    def begins(self) -> bool:
        """Whether meshes begin from the state of another one."""
        return self.guesses and self.loaded.case.solver.takes_guess

    def _guess(self, model: Model, level: Level) -> Start | None:
        """Return the latest state of the same element types on another mesh."""
        from ...model.transfer import transferred
        from ...solvers.statics.newton import Start

        latest = self.latest.get(level.setting.kinds)
        if latest is None:
            return None
        d = transferred(latest.state.d, latest.model, model)
        return None if d is None else Start(d, int(latest.state.history["negative_pivots"]), latest.state.turned)

    def _run(self, level: Level, told: Told | None, how: Solve | None = None) -> None:
        """Solve a level; where its error is ``told`` it is the result, for now."""
        # of meshes on the way their sequence tells more than each by itself
        quiet = replace(self.progress, warn=lambda text: None, note=lambda text: None, judges=told is not None)

        def conclude(found: Solved) -> None:
            level.take(found.answer, found.summary)
            level.dofs, level.reason, self.last = found.model.n_q, "", (level, found)
            if told is not None:
                found.summary["accuracy"] = self.accuracy(level, *told(level))

        target = None if told is None else self.target
        self.case = with_setting(self.loaded, level.setting)
        try:
            found = solve_for_goal(self.case, quiet, target, conclude, how)
        except (ComputationError, MemoryError) as error:
            level.reason = verdict(error)[1]
            return
        if self.loaded.case.solver.takes_guess and not level.off:
            # an obstacle that a mesh has missed may be on the other side of the body
            self.latest[level.setting.kinds] = found
        if told is not None:
            self.outcome, self.written = found.outcome, level
            if self.target is not None:
                self.target.written = True

    def accuracy(self, level: Level, found: Estimate, error: float) -> dict[str, Any]:
        """Return ``accuracy`` of the summary for a level, of which meshes tell ``found`` and ``error``."""
        sampled = 0.0 if level.answer is None else level.answer.sampling / level.answer.size
        total, note = error + self.apart + sampled, found.note
        if sampled:
            self.report["sampling_error"] = sampled
        if sampled > 0.5 * self.wanted:
            note = "; ".join(n for n in (note, "stored times are too far apart for the window: a smaller "
                                         "output.interval helps") if n)
        value, size = (None, None) if level.answer is None else (level.answer.value, level.answer.size)
        estimate = total if math.isfinite(total) else None
        if self.loaded.case.goal is None:
            value = None
        return {"value": value, "estimate": estimate, "scale": size,
                "absolute": None if estimate is None or size is None else estimate * size, "wanted": self.wanted,
                "achieved": bool(total <= self.wanted), "order": found.order, "limit": found.value,
                "by_body": self.by_body(level, error),
                "elements": dict(level.setting.counts), "nodes": level.setting.places(),
                "tolerance": level.setting.tolerance, "steps": level.setting.steps, "note": note,
                "solves": len(self.levels), "wall_s": self.wall_s, **self.report,
                "path": [level.as_json() for level in self.levels]}

    def by_body(self, level: Level, error: float) -> dict[str, float] | None:
        """Return the parts of the mesh's error that are due to each body, None where that is unknown.

        They add up to what of the estimate is neither due to time steps nor to simpler models.
        """
        left = error - self.report.get("time_error", 0.0) - self.report.get("steps_error", 0.0)
        bodies = level.setting.counts
        if not math.isfinite(left) or (len(bodies) > 1 and not self.weights):
            return None
        weights = {name: self.weights.get(name, 0.0) for name in bodies}
        whole = sum(weights.values())
        if whole == 0.0:
            # one body alone, or none moves the goal
            weights, whole = dict.fromkeys(bodies, 1.0), float(len(bodies))
        return {name: left * weights.get(name, 0.0) / whole if whole else 0.0 for name in self.loaded.case.bodies}

    def sharper(self, setting: Setting) -> Setting:
        """Return a setting whose time steps show by how much those of a solved one err.

        Where Newton's method limits the steps, a smaller tolerance changes few of them, so the default method is judged
        by a better one. A method that the case names remains.
        """
        assert setting.tolerance is not None
        solver = self.loaded.case.solver
        method = setting.method
        if isinstance(solver, Dynamic) and solver.method is None and self.last is not None:
            method = SHARPER if default_method(self.last[1].model) == DEFAULT else None
        return replace(setting, tolerance=tenth(setting.tolerance), method=method)

    def refuses(self, setting: Setting) -> Ancf2dError | None:
        """Return why the case cannot be built with a setting, None where it can."""
        try:
            prepare(with_setting(self.loaded, setting))
        except CaseError as error:
            return error
        return None

    @property
    def wall_s(self) -> float:
        """Seconds of all solves."""
        return sum(level.wall_s for level in self.levels)



def tenth(tolerance: float) -> float:
    """Return a tenth of a tolerance, without the digits that tenths of decimal numbers leave."""
    return float(f"{0.1 * tolerance:.6g}")


# orders that errors are estimated by, how much neighbouring ones may differ, and what is added to be safe
LEAST, MOST, ALIKE, SAFETY = 0.5, 8.0, 2.0, 1.75
# what an order that nothing confirms may promise, one that changes sign, and what is added there
UNCONFIRMED, SWINGING, DOUBTFUL = 3.0, 2.0, 2.0
# a mesh that misses so much of the goal says little of the order: what it may promise there
FAR, ROUGH = 0.1, 2.0
# orders by which changes between meshes have fallen since, the last first, where zones end within elements
OF_ZONES = 0.0, 1.5, 2.0
# levels that the best is looked for in, and the share of the last estimate below which an earlier one is better
RECENT, SPOILT = 4, 0.1
# levels without which no order is confirmed
CONFIRMING = 3
# what the last of two orders promises at least, where the one before was none
NONE_BEFORE = 1.0


def apart(level: Level, finest: Level) -> float:
    """Return how far the answers of two solved levels are apart, relative."""
    if level.answer is None or finest.answer is None:
        return math.inf
    return level.answer.distance(finest.answer) / finest.answer.size


def choose(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return the coarsest of solved levels whose error is below the wanted one, its error, and what they tell.

    The error of the finest is estimated from the order, those of the others are their distance to it beside. The
    finest where none will do, None where there are none.
    """
    found, last = judge(levels)
    if not levels:
        return None, last, found
    for level in levels:
        error = max(last + (0.0 if level is levels[-1] else apart(level, levels[-1])), level.off)
        if error <= wanted:
            return level, error, found
    return levels[-1], last, found


def best(levels: Sequence[Level], wanted: float) -> tuple[Level | None, float, Estimate]:
    """Return what ``choose`` does; where none will do, the one of the last few whose estimate is far the smallest.

    Round-off grows with the mesh: the finest may be worse than those before.
    """
    level, last, found = choose(levels, wanted)
    for n in range(len(levels) - 1, max(len(levels) - RECENT, CONFIRMING), -1):
        before, error = judge(levels[:n])
        if last > wanted and error < SPOILT * last:
            return levels[n - 1], error, before
    return level, last, found


def telling(levels: Sequence[Level]) -> Sequence[Level]:
    """Return the last of solved levels, none of which misses an obstacle."""
    return levels[next((n for n in range(len(levels), 0, -1) if levels[n - 1].off), 0):]


def judge(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return what solved levels tell, and the estimated error of the last one, relative (infinite without one).

    Meshes that miss an obstacle, as their elements are longer than that, may agree: they say nothing of others.
    """
    found, error = _by_order(telling(levels) or levels)
    off = levels[-1].off if levels else 0.0
    if not off:
        return found, error
    note = "an obstacle is between the contact points of a body"
    return Estimate(None, None, None, False, note), max(off, error) if math.isfinite(error) else off


def _by_order(levels: Sequence[Level]) -> tuple[Estimate, float]:
    """Return what solved levels tell, and the estimated error of the last one, relative (infinite without one).

    Two neighbouring orders are averaged where they agree by and large, and the smaller one is taken where not: meshes
    on the way to an accuracy are seldom asymptotic yet, and orders that still grow promise too much. Of values that
    swing about their limit the differences tell the order.
    """
    answers = [level.answer for level in levels if level.answer is not None]
    n = [float(level.setting.elements) for level in levels if level.answer is not None]
    if not answers:
        return Estimate(None, None, None, False, "no mesh has a value"), math.inf
    if n[-1] == 0.0:
        return Estimate(None, None, None, True, "every body is rigid, so there is no mesh error"), 0.0
    f, size = sequence(answers), answers[-1].size
    # meshes that agree by chance are no round-off: the last ones have to
    if len(f) < 3 or round_off_level(f[-2:], size) is not None or round_off_level(f[-3:], size) == 1:
        found = estimate(n[-3:], f[-3:], size)
        return found, math.inf if found.error_bar is None else found.error_bar / size
    order, before = observed_order(n[-3:], f[-3:]), observed_order(n[-4:-1], f[-4:-1]) if len(f) > 3 else None
    gaps, ratio = (abs(f[-2] - f[-3]), abs(f[-1] - f[-2])), math.log(n[-1] / n[-2])
    if levels[-1].kinks or answers[-1].jumps:
        # an order between two of them says nothing of the next one; what two meshes moved bounds what a third will
        error = DOUBTFUL * max(gaps)
        why = "a point slides along a body, so its kink moves through the elements" if levels[-1].kinks else (
            "a peak may be another one on each mesh")
        return Estimate(f[-1], error, None, False, f"{why}: no order"), error / size
    if levels[-1].zones:
        return _of_zones(n, f, size)
    if (order is not None and order <= LEAST) or gaps[1] >= gaps[0]:
        error = 3.0 * max(gaps)
        return Estimate(None, error, order, False, "not asymptotic: the differences do not decrease"), error / size
    if order is None:
        trusted = min(max(math.log(gaps[0] / gaps[1]) / ratio, 1.0), SWINGING)
        error = DOUBTFUL * gaps[1] / math.expm1(trusted * ratio)
        return Estimate(f[-1], error, None, False, "the values oscillate about their limit"), error / size
    alike = before is not None and order / ALIKE < before < order * ALIKE
    if alike:
        assert before is not None
        trusted, safety = min(0.5 * (order + before), order, MOST), SAFETY
    else:
        most = ROUGH if gaps[0] > FAR * size else UNCONFIRMED
        trusted = min(order, most, order if before is None else max(before, NONE_BEFORE))
        safety = DOUBTFUL
    step = (f[-1] - f[-2]) / math.expm1(trusted * ratio)
    note = "" if alike else "the order is not confirmed"
    return Estimate(f[-1] + step, safety * abs(step), trusted, alike, note), safety * abs(step) / size


def _of_zones(n: Sequence[float], f: Sequence[float], size: float) -> tuple[Estimate, float]:
    """Return what ``_by_order`` does of values f on meshes n with zones that yield or touch and end within elements.

    How much of an element such a zone takes is a matter of chance, and so is a small change.
    """
    p = OF_ZONES[1]
    last = [abs(b - a) * (k / n[-1])**order for (a, b), k, order in zip(
        list(pairwise(f))[::-1], n[:0:-1], OF_ZONES, strict=False)]
    error = DOUBTFUL * max(last) / math.expm1(p * math.log(n[-1] / n[-2]))
    return Estimate(f[-1], error, p, False, "zones that yield, bend on a curve or touch end within elements: no order "
                    f"shows, and changes are taken to fall like h^{p:g}"), error / size
