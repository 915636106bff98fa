"""The Pareto front and the cheapest setting, compared with their definitions."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from ancf2d.study.tradeoff.study import cheapest, pareto

# few values, so that ties are frequent; infinite where nothing is known
VALUE = st.sampled_from([0.0, 1e-9, 1e-3, 0.5, 1.0, 2.0, math.inf, math.nan])
POINTS = st.lists(st.tuples(VALUE, VALUE), max_size=12)


def beats(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] <= b[0] and a[1] <= b[1] and a != b


@given(POINTS)
def test_front_is_the_set_of_unbeaten_points(points: list[tuple[float, float]]) -> None:
    front = pareto([p[0] for p in points], [p[1] for p in points])
    known = [p for p in points if all(map(math.isfinite, p))]
    for point, on_front in zip(points, front, strict=True):
        assert on_front == (point in known and not any(beats(other, point) for other in known))


@given(POINTS, st.permutations(range(12)))
def test_front_does_not_depend_on_the_order(points: list[tuple[float, float]], order: list[int]) -> None:
    order = [i for i in order if i < len(points)]
    front = pareto([p[0] for p in points], [p[1] for p in points])
    shuffled = pareto([points[i][0] for i in order], [points[i][1] for i in order])
    assert shuffled == [front[i] for i in order]


@given(POINTS, st.sampled_from([1e-9, 1e-3, 1.0]))
def test_cheapest_reaches_the_accuracy_at_the_least_cost(points: list[tuple[float, float]],
                                                         wanted: float) -> None:
    cost, error = [p[0] for p in points], [p[1] for p in points]
    good = [c for c, e in points if e <= wanted and math.isfinite(c)]
    found = cheapest(cost, error, wanted)
    if found is None:
        assert not good
    else:
        assert error[found] <= wanted
        assert cost[found] == min(good)
        assert pareto(cost, error)[found]
