"""Samples of uncertain numbers of a case, and statistics of its goal: moments, quantiles, shares of variance."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..case.axes import SAMPLE, Axis, Distribution
from ..elements.shape import Array

DESIGNS = ("sobol", "lhs", "random")
QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
# highest degree of the polynomials in each parameter, and the least number of samples for each coefficient
DEGREE, SAMPLES_PER_TERM = 5, 8
# bootstrap resamples for the standard errors of the shares, and the seed for drawing them
RESAMPLES, SEED = 60, 0


@dataclass(frozen=True)
class Design:
    """Samples of some paths; ``units`` (n, paths) in (0, 1) are the probabilities at which quantiles are taken."""

    distributions: tuple[Distribution, ...]
    kind: str
    seed: int
    units: Array

    @property
    def axes(self) -> list[Axis]:
        """Return the samples as lists that are run through together."""
        return [Axis(d.path, tuple(_frozen(d).ppf(u).tolist()), d.text, SAMPLE)
                for d, u in zip(self.distributions, self.units.T, strict=True)]


def design(distributions: Sequence[Distribution], n: int, seed: int = 0, kind: str = "sobol") -> Design:
    """Return ``n`` samples: ``sobol`` (scrambled), ``lhs`` (Latin hypercube) or ``random`` (independent)."""
    from scipy.stats import qmc

    count = len(distributions)
    if kind == "random":
        units = np.random.default_rng(seed).random((n, count))
    else:
        maker = qmc.Sobol if kind == "sobol" else qmc.LatinHypercube
        with warnings.catch_warnings():
            # numbers that are not powers of 2 are less balanced, but not wrong
            warnings.simplefilter("ignore", UserWarning)
            units = maker(count, seed=seed).random(n)
    # neither 0 nor 1, where normal distributions have no value
    tiny = 2.0**-53
    return Design(tuple(distributions), kind, seed, np.clip(units, tiny, 1.0 - tiny))


def _frozen(distribution: Distribution) -> Any:
    from scipy import stats

    a, b = distribution.numbers
    if distribution.kind == "normal":
        return stats.norm(a, b)
    return stats.uniform(a, b - a) if distribution.kind == "uniform" else stats.lognorm(b, scale=np.exp(a))


# ---------------------------------------------------------------------------- statistics

def statistics(values: Sequence[float | None], samples: Design) -> dict[str, Any]:
    """Return mean, sd (n - 1), quantiles and shares of a value over the samples; None marks a value not computed.

    ``shares`` are first-order shares of the variance by path, ``share_errors`` their standard errors; None if there are
    too few samples, or if the value does not vary.
    """
    given = np.array([np.nan if v is None else v for v in values], float)
    known = np.isfinite(given)
    y = given[known]
    paths = [d.path for d in samples.distributions]
    out: dict[str, Any] = {"count": len(y), "mean": None, "sd": None, "quantiles": None, "shares": None,
                           "share_errors": None}
    if len(y):
        out["mean"] = float(y.mean())
        out["quantiles"] = {f"{q:g}": float(v) for q, v in zip(QUANTILES, np.quantile(y, QUANTILES), strict=True)}
    if len(y) > 1:
        out["sd"] = float(y.std(ddof=1))
        found = shares(y, samples, known)
        if found is not None:
            out["shares"], out["share_errors"] = (dict(zip(paths, v.tolist(), strict=True)) for v in found)
    return out


def shares(y: Array, samples: Design, known: Array) -> tuple[Array, Array] | None:
    """Return first-order shares (paths,) of the variance of y, and their standard errors (paths,).

    The value is fitted by a sum of functions of one parameter each, in polynomials that are orthonormal under its
    distribution (Hermite, Legendre): the squares of the coefficients are the variances of E[y | parameter] (Sudret,
    Reliability Engineering & System Safety 93, 2008), less the contribution of noise. Interactions remain in the
    residual and count as noise. Errors come from bootstrap resamples. None if samples are too few or y is constant.
    """
    count = len(samples.distributions)
    degree = min(DEGREE, (len(y) // SAMPLES_PER_TERM - 1) // count)
    if degree < 1 or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return None
    basis = np.hstack([_polynomials(d, u[known], degree)
                       for d, u in zip(samples.distributions, samples.units.T, strict=True)])
    basis = np.column_stack([np.ones(len(y)), basis])
    rng = np.random.default_rng(SEED)
    z = (y - y.mean()) / y.std()
    found = [_fitted(basis, z, weights, count) for weights in
             (np.ones(len(y)), *rng.multinomial(len(y), np.full(len(y), 1.0 / len(y)), RESAMPLES).astype(float))]
    return found[0], np.std(found[1:], axis=0, ddof=1)


def _polynomials(distribution: Distribution, u: Array, degree: int) -> Array:
    """Return the polynomials of degree 1 to ``degree`` (n, degree), orthonormal under a distribution."""
    from scipy import special

    x = 2.0 * u - 1.0 if distribution.kind == "uniform" else special.ndtri(u)
    if distribution.kind == "uniform":
        return np.stack([np.sqrt(2 * k + 1) * special.eval_legendre(k, x) for k in range(1, degree + 1)], axis=1)
    return np.stack([special.eval_hermitenorm(k, x) / np.sqrt(special.factorial(k)) for k in range(1, degree + 1)],
                    axis=1)


def _fitted(basis: Array, y: Array, weights: Array, count: int) -> Array:
    """Return the shares (count,) of a fit with weights (n,) that sum to n."""
    n, terms = basis.shape
    gram = np.linalg.pinv((basis.T * weights) @ basis, hermitian=True)
    coefficients = gram @ (basis.T @ (weights * y))
    noise = float(weights @ (y - basis @ coefficients) ** 2) / (n - terms)
    squares = (coefficients**2 - noise * np.diag(gram))[1:].reshape(count, -1).sum(axis=1)
    return np.clip(squares, 0.0, None) / (np.clip(squares, 0.0, None).sum() + noise)
