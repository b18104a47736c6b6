"""Tests that the claims need. Samples are numbers of whole runs. Needs SciPy.

Runs of different rows are independent; runs of the same seed in rows that differ in a paired
setting only are pairs. p-values of tests that ask the same are corrected for their number by Holm's
method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

Numbers = npt.NDArray[np.float64]

LEVEL: Final = 0.05


class Trend(NamedTuple):
    """Whether something grows with something else.

    Attributes:
        tau: Kendall's tau-b, -1 to 1, over all strata.
        p: one-sided, that it grows.
    """

    tau: float
    p: float


class Difference(NamedTuple):
    """By how much one sample lies above another, with a 95 % interval and one-sided p-values."""

    value: float
    low: float
    high: float
    p_greater: float
    p_less: float


def growing(strata: Sequence[Sequence[tuple[float, Numbers]]]) -> Trend:
    """Kendall's test, within strata: whether values grow with what is before them.

    Args:
        strata: each a list of (level, the runs' values at it). Values of different strata are never
            compared.
    """
    score = pairs = variance = 0.0
    for stratum in strata:
        levels = np.concatenate([np.full(len(values), level) for level, values in stratum])
        values = np.concatenate([values for _, values in stratum])
        known = np.isfinite(values)
        levels, values = levels[known], values[known]
        count = len(values)
        if count < 3:
            continue
        above = np.sign(np.subtract.outer(levels, levels))
        greater = np.sign(np.subtract.outer(values, values))
        score += float((above * greater).sum()) / 2
        pairs += math.sqrt(float((above**2).sum()) * float((greater**2).sum())) / 2
        variance += _kendall_variance(levels, values)
    if not variance or not pairs:
        return Trend(math.nan, math.nan)
    return Trend(score / pairs, float(stats.norm.sf(score / math.sqrt(variance))))


def _kendall_variance(x: Numbers, y: Numbers) -> float:
    """The variance of Kendall's score under independence, with ties (M. Kendall, 1970)."""
    n = len(x)
    t, u = (np.unique(values, return_counts=True)[1].astype(np.float64) for values in (x, y))
    v0 = n * (n - 1) * (2 * n + 5)
    vt, vu = (float((c * (c - 1) * (2 * c + 5)).sum()) for c in (t, u))
    t1, u1 = (float((c * (c - 1)).sum()) for c in (t, u))
    t2, u2 = (float((c * (c - 1) * (c - 2)).sum()) for c in (t, u))
    result = (v0 - vt - vu) / 18 + t1 * u1 / (2 * n * (n - 1))
    return result + t2 * u2 / (9 * n * (n - 1) * (n - 2))


def above(a: Numbers, b: Numbers) -> Difference:
    """Mean of `a` minus mean of `b`, independent samples: Welch's t."""
    a, b = a[np.isfinite(a)], b[np.isfinite(b)]
    if len(a) < 2 or len(b) < 2:
        return Difference(math.nan, math.nan, math.nan, math.nan, math.nan)
    return pooled_above([(a, b)])


def pooled_above(strata: Sequence[tuple[Numbers, Numbers]]) -> Difference:
    """The mean over strata of the difference of means, each with its own variances (Welch)."""
    values, variances, parts = [], [], []
    for pair in strata:
        a, b = (sample[np.isfinite(sample)] for sample in pair)
        if len(a) < 2 or len(b) < 2:
            continue
        values.append(float(a.mean() - b.mean()))
        own = [float(s.var(ddof=1)) / len(s) for s in (a, b)]
        variances.append(sum(own))
        parts += [(v, len(s) - 1) for v, s in zip(own, (a, b), strict=True)]
    if not values:
        return Difference(math.nan, math.nan, math.nan, math.nan, math.nan)
    value, error = sum(values) / len(values), math.sqrt(sum(variances)) / len(values)
    lower = sum(v**2 / n for v, n in parts)
    freedom = sum(v for v, _ in parts) ** 2 / lower if lower else 1.0
    return _difference(value, error, freedom)


def paired_above(a: Numbers, b: Numbers) -> Difference:
    """Mean of `a` minus `b`, run by run: the paired t-test."""
    both = np.isfinite(a) & np.isfinite(b)
    differences = a[both] - b[both]
    if len(differences) < 2:
        return Difference(math.nan, math.nan, math.nan, math.nan, math.nan)
    error = float(differences.std(ddof=1)) / math.sqrt(len(differences))
    return _difference(float(differences.mean()), error, len(differences) - 1)


def _difference(value: float, error: float, freedom: float) -> Difference:
    if not error:
        p = 0.5 if not value else 0.0
        return Difference(value, value, value, p if value >= 0 else 1.0, p if value <= 0 else 1.0)
    reach = float(stats.t.ppf(0.975, freedom)) * error
    p = float(stats.t.sf(value / error, freedom))
    return Difference(value, value - reach, value + reach, p, 1 - p)


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values corrected for their number (S. Holm, 1979); nan stays nan and does not count."""
    known = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    corrected, largest = list(p_values), 0.0
    for place, (p, index) in enumerate(known):
        largest = max(largest, min(1.0, p * (len(known) - place)))
        corrected[index] = largest
    return corrected


def fewer(ours: tuple[int, int], theirs: tuple[int, int]) -> float:
    """One-sided p that the share of (successes, failures) is less in ours: Fisher's exact test."""
    return float(stats.fisher_exact([ours, theirs], alternative="less").pvalue)


def share_interval(successes: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson)."""
    found = stats.binomtest(successes, count).proportion_ci(method="wilson")
    return float(found.low), float(found.high)
