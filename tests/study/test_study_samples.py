"""Designs of samples and their statistics, compared with closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ancf2d.case.axes import read_distributions
from ancf2d.study.samples import DESIGNS, design, statistics

LAWS = read_distributions(["a~normal(1, 2)", "b~uniform(-1, 3)", "c~lognormal(0, 0.3)"])


@pytest.mark.parametrize("kind", DESIGNS)
def test_samples_follow_their_distributions_and_their_seed(kind: str) -> None:
    # every process that collects tests would import it
    from scipy import stats

    axes = design(LAWS, 500, 3, kind).axes
    for axis, law in zip(axes, (stats.norm(1, 2), stats.uniform(-1, 4), stats.lognorm(0.3)), strict=True):
        assert stats.kstest(axis.values, law.cdf).pvalue > 1e-3
    assert design(LAWS, 500, 3, kind).axes == axes
    assert design(LAWS, 500, 4, kind).axes != axes


def test_a_latin_hypercube_has_one_sample_in_each_stratum() -> None:
    units = design(LAWS, 50, 0, "lhs").units
    assert (np.sort(np.floor(50 * units), axis=0) == np.arange(50)[:, None]).all()


@pytest.mark.parametrize(("kind", "n", "near"), [("sobol", 512, 0.03), ("lhs", 512, 0.08), ("random", 4000, 0.08)])
def test_shares_are_those_of_a_sum_with_an_interaction(kind: str, n: int, near: float) -> None:
    """y = a + b + 4 c + (a - 1)(b - 1): variances 4, 16/12, 16 e^0.09 (e^0.09 - 1); interaction 4 * 16/12."""
    drawn = design(LAWS, n, 1, kind)
    a, b, c = (np.array(axis.values) for axis in drawn.axes)
    found = statistics(list(a + b + 4.0 * c + (a - 1.0) * (b - 1.0)), drawn)
    own = np.array([4.0, 4.0 / 3.0, 16.0 * np.exp(0.09) * np.expm1(0.09)])
    exact = own / (own.sum() + 16.0 / 3.0)
    assert list(found["shares"]) == ["a", "b", "c"]
    np.testing.assert_allclose(list(found["shares"].values()), exact, atol=near)
    errors = np.array(list(found["share_errors"].values()))
    # standard errors are of the size of the errors: neither far below nor useless
    assert (np.abs(np.array(list(found["shares"].values())) - exact) < 4.0 * errors).all()
    assert errors.max() < 0.1


def test_quantiles_and_moments_are_those_of_the_sample() -> None:
    drawn = design(LAWS[:1], 256, 0, "sobol")
    y = list(drawn.axes[0].values)
    found = statistics([*y[:-1], None], drawn)
    assert (found["count"], found["sd"]) == (255, pytest.approx(np.std(y[:-1], ddof=1)))
    assert found["quantiles"]["0.5"] == pytest.approx(np.median(y[:-1]))
    assert found["quantiles"]["0.95"] == pytest.approx(1.0 + 2.0 * 1.6449, abs=0.1)
    assert found["shares"]["a"] == pytest.approx(1.0, abs=1e-6)


def test_statistics_of_too_few_samples_or_constants_are_left_open() -> None:
    drawn = design(LAWS, 16, 0, "sobol")
    assert statistics([1.0] * 16, drawn)["shares"] is None
    assert statistics(list(drawn.axes[0].values), drawn)["shares"] is None
    assert statistics([None] * 16, drawn)["mean"] is None
