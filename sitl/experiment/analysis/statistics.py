"""Runs as samples, intervals of what they amount to, and the tests that the claims need.

Samples are numbers of whole runs. Runs of different rows are independent; runs of the same seed in
rows that differ in a paired setting only are pairs. p-values of tests that ask the same are
corrected for their number by Holm's method. Needs SciPy.

Intervals: expanded percentile bootstrap: 10,000 times as many runs as there are, drawn with
replacement; the interval is between two percentiles of what they amount to. With few runs the
bootstrap is too sure of itself, so the percentiles lie farther out, by sqrt(n / (n - 1)) and by
Student's t in place of the normal distribution (T. Hesterberg, "What Teachers Should Know About the
Bootstrap", The American Statistician 69, 2015, section 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

from sitl.experiment.campaign.plan import Record
from sitl.experiment.settings import value_of

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Evidence:
    """The finished runs of an experiment."""

    records: Sequence[Record]

    def values(self, measure: str, **settings: Any) -> Numbers:
        """A measure of the runs with these settings, by seed number; nan where a run has none."""
        chosen = sorted(self.of(**settings), key=lambda record: record["number"])
        found = [record["measures"][measure] for record in chosen]
        return np.array([np.nan if v is None else v for v in found], dtype=np.float64)

    def pairs(self, measure: str, setting: str, values: Sequence[Any], **others: Any) -> Numbers:
        """(runs, values): a measure where a setting has each of some values, seed by seed.

        Of seeds that have a run with all of the values.
        """
        found = [
            {r["number"]: r["measures"][measure] for r in self.of(**{**others, setting: value})}
            for value in values
        ]
        both = sorted(set.intersection(*map(set, found)))
        rows = [[np.nan if own[n] is None else own[n] for own in found] for n in both]
        return np.array(rows, dtype=np.float64).reshape(len(both), len(values))

    def levels(self, setting: str, **settings: Any) -> list[Any]:
        """The values of a setting, sorted."""
        return sorted({value_of(record["settings"], setting) for record in self.of(**settings)})

    def of(self, **settings: Any) -> list[Record]:
        """The runs with these settings."""
        return [
            record
            for record in self.records
            if all(value_of(record["settings"], key) == value for key, value in settings.items())
        ]

    def combinations(self, keys: Iterable[str]) -> list[dict[str, Any]]:
        """All combinations of settings that have runs."""
        keys = list(keys)
        found = {tuple(value_of(r["settings"], k) for k in keys) for r in self.records}
        return [dict(zip(keys, values, strict=True)) for values in sorted(found)]

    def strata(
        self, measure: str, over: str, within: Sequence[str], **settings: Any
    ) -> list[list[tuple[float, Numbers]]]:
        """For `trends.growing`: values per level of `over`, for each combination of `within`."""
        chosen = Evidence(self.of(**settings))
        return [
            [
                (float(level), chosen.values(measure, **{**combination, over: level}))
                for level in chosen.levels(over, **combination)
            ]
            for combination in chosen.combinations(within)
        ]


RESAMPLES: Final = 10_000
_AT_ONCE: Final = 5_000_000
"""So many runs are drawn at a time: of thousands of runs all resamples do not fit into memory."""

_SEED: Final = 20240513
"""The resampling has its own seed, so that the same runs give the same interval."""


class Interval(NamedTuple):
    """An estimate with the bounds of its 95 % confidence interval; nan where there is none."""

    value: float
    low: float
    high: float


def interval(values: Numbers, statistic: Callable[[Numbers], Numbers] | None = None) -> Interval:
    """The interval of a statistic over runs.

    Args:
        values: (runs,) or (runs, columns).
        statistic: makes of (resamples, runs, columns) or (resamples, runs) one number per
            resample; default: the mean.
    """
    statistic = statistic or _mean
    runs = len(values)
    if not runs:
        return Interval(math.nan, math.nan, math.nan)
    value = float(statistic(values[None])[0])
    if runs == 1 or math.isnan(value):
        return Interval(value, math.nan, math.nan)
    chance = np.random.default_rng(_SEED)
    step = max(1, _AT_ONCE // runs)
    sizes = [min(step, RESAMPLES - done) for done in range(0, RESAMPLES, step)]
    drawn = np.concatenate(
        [statistic(values[chance.integers(0, runs, (size, runs))]) for size in sizes]
    )
    tail = NormalDist().cdf(-math.sqrt(runs / (runs - 1)) * float(stats.t.ppf(0.975, runs - 1)))
    low, high = np.nanquantile(drawn, (tail, 1 - tail))
    return Interval(value, float(low), float(high))


def ratio(rows: Numbers) -> Numbers:
    """The statistic sum / count of rows (sum, count): a mean over all that the runs counted."""
    total = rows.sum(axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        result: Numbers = total[..., 0] / total[..., 1]
    return result


def spread(rows: Numbers) -> Numbers:
    """The statistic SD of rows (sum, count, sum of squares)."""
    total = rows.sum(axis=-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total[..., 0] / total[..., 1]
        result: Numbers = np.sqrt(np.maximum(total[..., 2] / total[..., 1] - mean**2, 0.0))
    return result


def _mean(values: Numbers) -> Numbers:
    result: Numbers = values.mean(axis=-1)
    return result


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
