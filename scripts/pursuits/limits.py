"""The limit of a case's goal over meshes and steps, with its own error, and the cheapest setting for an error."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from ancf2d.case import Dynamic, LoadedCase
from ancf2d.errors import ComputationError
from ancf2d.study.accuracy.control import BEAM
from ancf2d.study.accuracy.setting import Level, Setting, bodies_with_meshes, meshed, with_setting
from ancf2d.study.goal import GoalValue, solve_for_goal
from ancf2d.study.variants import Variant, parse_variants

# where references stop: relative differences that are round-off, and elements
SETTLED = 1e-12
MOST = {"Dynamic": 48, "Eigen": 512, "Static": 4096, "LinearStatic": 8192, "Buckling": 2048}
TIGHT = 1e-10
SIZES = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256,
         320, 384, 448, 512, 640, 768, 896, 1024)
TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7)


@dataclass
class Limit:
    """A goal's value on infinitely many elements, and how far it may be off, relative."""

    answer: GoalValue
    error: float

    def truth(self, answer: GoalValue) -> float:
        """Return the relative error of an answer."""
        return answer.distance(self.answer) / self.answer.size


class Solver:
    """Solves settings of a case, each once; ``kept``: the file that solves are read from, and put in by ``keep``."""

    def __init__(self, loaded: LoadedCase, kept: Path | None = None) -> None:
        self.kept = kept
        self.loaded = replace(loaded, case=replace(loaded.case, accuracy=None))
        self.moves = isinstance(loaded.case.solver, Dynamic)
        bodies = bodies_with_meshes(loaded.case, {})
        self.types = {name: BEAM for name, b in bodies.items() if b.element.type == "auto"}
        self.least = {name: mesh.least for name, mesh in meshed(loaded.case, self.types).items()}
        self.known: dict[Any, Level] = {}
        if kept is not None and kept.exists():
            self.known = pickle.loads(kept.read_bytes())

    def keep(self) -> None:
        """Write all solves, for the next time."""
        if self.kept is not None:
            self.kept.parent.mkdir(parents=True, exist_ok=True)
            self.kept.write_bytes(pickle.dumps(self.known))

    def solve(self, counts: dict[str, int], tolerance: float | None = None,
              types: dict[str, Variant] | None = None, nodes: dict[str, tuple[float, ...]] | None = None,
              method: str | None = None) -> Level:
        """Return a level, of geometrically exact beams where types are left open; without an answer where it failed."""
        types = self.types if types is None else types
        name = (tuple(counts.items()), tuple(types.items()), tolerance, *((nodes or {}).items()),
                *([method] if method else []))
        if name not in self.known:
            level = self.known[name] = Level(Setting(counts, types, tolerance, nodes or {}, method=method),
                                               "")
            try:
                found = solve_for_goal(with_setting(self.loaded, level.setting))
            except ComputationError as error:
                level.reason = error.failure.reason
            else:
                level.answer, level.wall_s = found.answer, found.summary["wall_s"]
                level.iterations = found.summary["iterations"]
        return self.known[name]

    def again(self, accuracy: dict[str, Any]) -> Level:
        """Return the level that was reached, solved with all load steps."""
        named = {name: chosen["element"] for name, chosen in accuracy.get("types", {}).items()}
        types = {name: Variant("rigid") if kind == "rigid" else parse_variants(kind)[0] for name, kind in named.items()}
        nodes = {name: tuple(places) for name, places in (accuracy["nodes"] or {}).items()}
        return self.solve(accuracy["elements"], accuracy["tolerance"], types, nodes, accuracy["method"])

    def even(self, size: int) -> dict[str, int]:
        """Return the counts of a mesh with the least of each body, times a size."""
        return {name: n * size for name, n in self.least.items()}

    def limit(self) -> Limit:
        """Return the limit over doubled meshes, extrapolated by the ratio of their differences."""
        most = MOST[type(self.loaded.case.solver).__name__]
        tight = TIGHT if self.moves else None
        size, answers, best = 2, [], Limit(GoalValue(0.0, 1.0), float("inf"))
        before: GoalValue | None = None
        while sum(self.even(size).values()) <= most and best.error > SETTLED:
            answer = self.solve(self.even(size), tight).answer
            size *= 2
            if answer is None:
                continue
            answers.append(answer)
            if len(answers) < 3:
                continue
            first, last = (b.distance(a) for a, b in pairwise(answers[-3:]))
            beyond = answer.beyond(answers[-2], 1.0 / (first / last - 1.0)) if last * 1.5 < first else answer
            error = last if before is None or beyond is answer else min(last, beyond.distance(before))
            if error / answer.size < best.error:
                best = Limit(beyond, error / answer.size)
            before = beyond
        if self.moves:
            looser = self.solve(self.even(size // 4), 10 * TIGHT).answer
            assert looser is not None
            best.error += looser.distance(answers[-2]) / best.answer.size
        return best

    def cheapest(self, limit: Limit, wanted: float) -> Level | None:
        """Return the setting of least work whose error, and that of the next finer mesh, is below the wanted one."""
        found = [level for level in map(lambda t: self._coarsest(limit, wanted, t), self._tolerances())
                 if level is not None]
        return min((self._thinned(limit, wanted, level) for level in found), key=lambda level: level.work, default=None)

    def _tolerances(self) -> tuple[float | None, ...]:
        return TOLERANCES if self.moves else (None,)

    def _reaches(self, limit: Limit, wanted: float, level: Level) -> bool:
        return level.answer is not None and limit.truth(level.answer) <= wanted

    def _coarsest(self, limit: Limit, wanted: float, tolerance: float | None) -> Level | None:
        before = None
        sizes = SIZES[:10] if self.moves else SIZES
        for size in sizes:
            level = self.solve(self.even(size), tolerance)
            if not self._reaches(limit, wanted, level):
                before = None
            elif before is not None:
                return before
            else:
                before = level
        return before

    def _thinned(self, limit: Limit, wanted: float, level: Level) -> Level:
        """Return a mesh with fewer elements of one body after the other."""
        for name, lowest in self.least.items() if len(self.least) > 1 else ():
            counts = level.setting.counts
            while counts[name] > lowest:
                fewer = {**counts, name: max(lowest, min(counts[name] - 1, int(0.75 * counts[name])))}
                tried = self.solve(fewer, level.setting.tolerance)
                if not self._reaches(limit, wanted, tried):
                    break
                level, counts = tried, fewer
        return level
