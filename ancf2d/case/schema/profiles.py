"""Profiles: numbers that vary along a body, as expressions in s or tables over s."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

from ...errors import ComputationError
from ..binder import INVALID, Binder, Issue, Path, dotted
from ..declare import key, record
from ..kinds import Book, Flag, JsonSchema, ListOf, Number
from ..nodes import Node, Scalar
from ..records import ByShape, Record
from ..syntax import Constant, ExpressionError, quantities_of, syntax
from .amplitudes import Expression, ExpressionText

# positions from 0 to 1 at which the bounds of a profile are checked, in addition to those of a table
PLACES = tuple(k / 1000 for k in range(1001))


@record
class ProfileExpression(Expression):
    """A formula in s, which runs from 0 to 1 along a body's arc length."""

    variable = "s"

    def written(self) -> str:
        """Return the formula as text."""
        return self.value_


@record
class ProfileTable:
    """Values at positions s along a body, constant before the first and after the last."""

    s: tuple[float, ...] = key(ListOf(Number(ge=0, le=1), "numbers", 1), "Positions from 0 to 1 along the arc length, "
                               "in ascending order; a position given twice is a jump", example=[0, 0.4, 1])
    value_: tuple[float, ...] = key(ListOf(Number(), "numbers", 1), "Value at each position", example=[0.1, 0.1, 0.05])
    smooth: bool = key(Flag(), "Interpolate with monotone cubics of continuous slope instead of straight lines; "
                       "between two positions the curve stays between their values", default=False)

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the lists differ in length, or positions are out of order or given more than twice."""
        if len(self.s) != len(self.value_):
            yield Issue(("value",), f"{{}}: s has {len(self.s)} numbers and value has {len(self.value_)}",
                        "as many values as places")
        for i in range(1, len(self.s)):
            if self.s[i - 1] > self.s[i]:
                yield Issue(("s", i), f"{{}}.s must not decrease, got {self.s[i]:g} after {self.s[i - 1]:g}")
                return
            if i > 1 and self.s[i - 2] == self.s[i]:
                yield Issue(("s", i), f"{{}}.s names {self.s[i]:g} more than twice", "twice for a jump")
                return

    def value(self, s: float) -> float:
        """Return the value at s, from the right at a jump."""
        i = bisect_right(self.s, s) - 1
        if i < 0 or i == len(self.s) - 1:
            return self.value_[max(i, 0)]
        h, a, d = self.s[i + 1] - self.s[i], self.value_[i], self.value_[i + 1] - self.value_[i]
        x = (s - self.s[i]) / h
        if not self.smooth:
            return a + d * x
        m0, m1 = (h * m for m in self.slopes[i])
        return a + x * (m0 + x * (3 * d - 2 * m0 - m1 + x * (m0 + m1 - 2 * d)))

    @cached_property
    def slopes(self) -> tuple[tuple[float, float], ...]:
        """Slopes at the start and the end of each interval of the smooth table: Fritsch and Butland 1984.

        Jumps divide it into separate curves. The slope at the ends of a curve is that of the parabola through three
        points, limited so that the curve stays monotone.
        """
        n = len(self.s)
        cuts = [0, *(i for i in range(1, n) if self.s[i] == self.s[i - 1]), n]
        out: list[tuple[float, float]] = []
        for a, b in pairwise(cuts):
            m = _slopes(self.s[a:b], self.value_[a:b])
            out += [*pairwise(m), (0.0, 0.0)]
        return tuple(out)


def _slopes(t: tuple[float, ...], v: tuple[float, ...]) -> list[float]:
    n = len(t)
    if n < 3:
        return [0.0 if n == 1 else (v[1] - v[0]) / (t[1] - t[0])] * n
    h = [t[i + 1] - t[i] for i in range(n - 1)]
    d = [(v[i + 1] - v[i]) / h[i] for i in range(n - 1)]
    inner = [0.0 if d[i - 1] * d[i] <= 0 else
             3 * (h[i - 1] + h[i]) / ((2 * h[i] + h[i - 1]) / d[i - 1] + (h[i] + 2 * h[i - 1]) / d[i])
             for i in range(1, n - 1)]
    return [_end_slope(h[0], h[1], d[0], d[1]), *inner, _end_slope(h[-1], h[-2], d[-1], d[-2])]


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    m = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if m * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(m) > 3 * abs(d0) else m


Profile = ProfileExpression | ProfileTable


# studies read the same formula for every run
@lru_cache(maxsize=64)
def _samples(profile: Profile) -> tuple[float, ...]:
    """Return the values of a profile at ``PLACES``. Raises ComputationError if it has none."""
    return tuple(map(profile.value, PLACES))


@record
class PointExpression(Expression):
    """A formula in s and t, and in position, rotation and velocity of the point that a load acts on."""

    variable = "s"

    def written(self) -> str:
        """Return the formula as text."""
        return self.value_


class _Formula(ExpressionText):
    """The kind of an expression in s; one in s alone is not just a number in quotes."""

    pattern = r"^\s*[A-Za-z_]\w*\s*$|\b(s|pi)\b|[-+*/^(]"

    def __init__(self, local: tuple[str, ...] = ()) -> None:
        super().__init__("s", local)

    def schema(self, book: Book) -> JsonSchema:
        return {"type": "string", "pattern": self.pattern + (r"|^\s*[\d.]+(e\d+)?\s*$" if self.local else "")}


class ProfileOf(ByShape):
    """The kind of a number in a unit, with bounds, that may vary along a body.

    ``local`` are quantities of the point that it may also depend on; the value is a ``PointExpression`` if it does.
    """

    def __init__(self, unit: str = "", *, gt: float | None = None, ge: float | None = None,
                 local: tuple[str, ...] = ()) -> None:
        self.number, self.local = Number(unit, gt=gt, ge=ge), local
        self.unit, self.gt, self.ge = unit, gt, ge
        super().__init__(number=self.number, text=_Formula(local), map=Record(ProfileTable))

    def words(self, binder: Binder) -> str:
        known = ", ".join(("s", *self.local))
        return f"{self.number.words(binder)}, an expression in {known} or a table {{s, value}}"

    def bind(self, node: Node, path: Path, binder: Binder) -> Any:
        before = binder.invalid
        if isinstance(node, Scalar) and node.shape == "text" and not self._is_formula(node.text, binder):
            return binder.wrong(node, path, self.words(binder))
        found = super().bind(node, path, binder)
        if found is INVALID or binder.invalid != before or isinstance(found, float):
            return found
        if isinstance(found, str):
            if quantities_of(found):
                return PointExpression(found)
            found = ProfileExpression(found)
        try:
            problem = self._outside(found, binder)
        except ComputationError as error:
            problem = error.failure.reason
        if problem is None:
            return found
        return binder.fail(node.mark, path, f"{dotted(path)}: {problem}")

    def _is_formula(self, text: str, binder: Binder) -> bool:
        """Return whether a text is meant as an expression, not as a number in quotes or an unknown name."""
        known = binder.names("s", self.local)
        if text.strip() in (known.variable, *known.numbers, *known.quantities):
            return True
        try:
            # where motion counts, a component that is zero may be written like the other one: ["0", "-k*vy"]
            return bool(self.local) or not isinstance(syntax(text, known), Constant)
        except ExpressionError:
            return re.search(r"\b(s|pi)\b|[-+*/^(]", text) is not None

    def _outside(self, profile: Any, binder: Binder) -> str | None:
        """Return where a profile is out of bounds, or None."""
        if isinstance(profile, ProfileTable) and all(map(self.number.inside, profile.value_)):
            # between its positions it stays between their values
            return None
        values = list(zip(_samples(profile), PLACES, strict=True))
        if isinstance(profile, ProfileTable):
            # both sides of each jump
            values += zip(profile.value_, profile.s, strict=True)
        beyond = sorted((v, s) for v, s in values if not self.number.inside(v))
        if not beyond:
            return None
        v, s = beyond[0]
        first = min(place for _, place in beyond)
        wanted = self.number.bounds(binder.unit(self.unit))
        return f"it must be {wanted} everywhere, and is {v:g} at s = {s:g}" + (
            f" (not so from s = {first:g} on)" if first < s else "")
