"""Intervals of what runs amount to, and effects with what they could have shown. Needs SciPy.

Samples are numbers of whole runs. Runs of different rows are independent; runs of the same seed in
rows that differ in a paired setting only are pairs, and enter by their differences.

Intervals of a row: expanded percentile bootstrap over whole runs. With few runs the bootstrap is
too sure of itself, so the percentiles lie farther out, by sqrt(n / (n - 1)) and by Student's t in
place of the normal distribution (T. Hesterberg, "What Teachers Should Know About the Bootstrap",
The American Statistician 69, 2015, section 4). Effects: Student's t and Welch.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from air_router.errors import UsageError
from mocha_link.errors import needs_extra
from sitl.experiment import Experiment, Record, Row

Numbers = npt.NDArray[np.float64]

LEVEL: Final = 0.05
POWER: Final = 0.8

_RESAMPLES: Final = 10_000
_SEED: Final = 20240513
"""The resampling has its own seed, so that the same runs give the same interval."""


class Interval(NamedTuple):
    """An estimate with the bounds of its 95 % confidence interval; nan where there is none."""

    value: float
    low: float
    high: float


def _mean(values: Numbers, axis: int = -1) -> Any:
    return values.mean(axis=axis)


def _stats() -> Any:
    """SciPy's statistics, whose import takes as long as all other imports of an experiment."""
    with needs_extra("an experiment", "experiments", "air-router"):
        from scipy import stats  # noqa: PLC0415 - what takes its time
    return stats


def ratio(sums: Numbers, counts: Numbers, axis: int = -1) -> Any:
    """A mean over all that the runs counted, from their sums and counts."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return sums.sum(axis=axis) / counts.sum(axis=axis)


def spread(sums: Numbers, counts: Numbers, squares: Numbers, axis: int = -1) -> Any:
    """The standard deviation of all that the runs counted."""
    mean, square = ratio(sums, counts, axis), ratio(squares, counts, axis)
    return np.sqrt(np.maximum(square - mean**2, 0.0))


def interval(*columns: Numbers, statistic: Callable[..., Any] = _mean) -> Interval:
    """The interval of a statistic of columns that have an entry for each run."""
    runs = len(columns[0])
    value = float(statistic(*columns)) if runs else math.nan
    if runs < 2 or math.isnan(value):
        return Interval(value, math.nan, math.nan)
    stats = _stats()
    tail = NormalDist().cdf(-math.sqrt(runs / (runs - 1)) * float(stats.t.ppf(0.975, runs - 1)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)  # no goals in what was drawn
        drawn = stats.bootstrap(
            columns,
            statistic,
            n_resamples=_RESAMPLES,
            batch=500,  # at once: of thousands of runs all resamples do not fit into memory
            paired=True,
            vectorized=True,
            method="percentile",
            rng=np.random.default_rng(_SEED),
        ).bootstrap_distribution
    return Interval(value, *map(float, np.nanquantile(drawn, (tail, 1 - tail))))


def explained(guess: Numbers, truth: Numbers) -> float:
    """R²: the share of the variance of the truth that a guess explains."""
    return 1 - float(((guess - truth) ** 2).sum() / ((truth - truth.mean()) ** 2).sum())


class Effect(NamedTuple):
    """By how much runs differ: the estimate, its standard error and degrees of freedom."""

    value: float
    error: float
    freedom: float

    def interval(self, tests: int = 1) -> Interval:
        """95 % interval; together with those of so many `tests` (Bonferroni)."""
        reach = float(_stats().t.isf(LEVEL / 2 / tests, self.freedom)) * self.error
        return Interval(self.value, self.value - reach, self.value + reach)

    def detectable(self, tests: int = 1) -> float:
        """How far from a bound an effect lies that is distinguished from it with a power of 0.8."""
        quantiles = _stats().t.isf([LEVEL / 2 / tests, 1 - POWER], self.freedom)
        return float(quantiles.sum()) * self.error


def power(effect: Effect, apart: float) -> float:
    """The chance that a 95 % interval excludes 0 where the truth is so far `apart` from it."""
    stats = _stats()
    if not effect.error > 0:
        return math.nan
    reach = float(stats.t.isf(LEVEL / 2, effect.freedom))
    above, below = (
        stats.nct.sf([reach], effect.freedom, apart / effect.error),
        stats.nct.cdf([-reach], effect.freedom, apart / effect.error),
    )
    return float(above[0] + below[0])


UNKNOWN: Final = Effect(math.nan, math.nan, math.nan)


def contrast(samples: Sequence[Numbers]) -> Effect:
    """The sum of the means of independent samples, each with its own variance (Welch)."""
    known = [sample[np.isfinite(sample)] for sample in samples]
    if not known or min(map(len, known)) < 2:
        return UNKNOWN
    variances = np.array([sample.var(ddof=1) / len(sample) for sample in known])
    lower = sum(v**2 / (len(sample) - 1) for v, sample in zip(variances, known, strict=True))
    freedom = float(variances.sum() ** 2 / lower) if lower else float(len(known[0]) - 1)
    return Effect(float(sum(map(np.mean, known))), math.sqrt(variances.sum()), freedom)


def share_above(
    successes: Numbers, failures: Numbers, reference: tuple[int, int]
) -> tuple[Effect, float]:
    """Percentage points by which a share lies above a reference's, and the design effect.

    What happens in one run is alike, so runs and not cases are drawn: the variance is that of a
    ratio over runs. The design effect is how often it is that of as many independent cases; the
    reference (successes, failures), of which no parts are known, is taken to have it too.
    """
    counts, runs = successes + failures, len(successes)
    total = counts.sum()
    if runs < 2 or not total:
        return UNKNOWN, math.nan
    share = successes.sum() / total
    variance = ((successes - share * counts) ** 2).sum() * runs / (runs - 1) / total**2
    independent = share * (1 - share) / total
    design = float(variance / independent) if independent else 1.0
    theirs, of = reference[0] / sum(reference), sum(reference)
    error = math.sqrt(variance + max(design, 1.0) * theirs * (1 - theirs) / of)
    return Effect(100 * float(share - theirs), 100 * error, runs - 1.0), design


Weights = Sequence[tuple[float, Row]]
"""A contrast: rows, and how often the mean of each counts."""


class Runs:
    """The measures of an experiment's runs, by row and by seed number."""

    def __init__(self, experiment: Experiment, records: Sequence[Record]) -> None:
        self.experiment = experiment  # whose rows they are of
        self._measures: dict[str, dict[int, dict[str, float | None]]] = {}  # by label and number
        for record in records:
            self._measures.setdefault(record["row"], {})[record["number"]] = record["measures"]

    def numbers(self, *rows: Row) -> list[int]:
        """The seed numbers with which each of some rows has a run."""
        return sorted(set.intersection(*(set(self._measures.get(row.label, ())) for row in rows)))

    def has(self, measure: str) -> bool:
        """Whether every run has a measure: those of earlier versions have fewer."""
        return all(measure in run for own in self._measures.values() for run in own.values())

    def values(self, row: Row, measure: str, numbers: Sequence[int]) -> Numbers:
        """A measure of a row's runs; nan where a run has none. Raises UsageError."""
        own = self._measures.get(row.label, {})
        try:
            found = [own[number][measure] for number in numbers]
        except KeyError:
            raise UsageError(f"a claim is about '{measure}'; no run has this measure") from None
        return np.array([math.nan if value is None else value for value in found])

    def effect(self, weights: Weights, measure: str, *, ratio: bool = False) -> Effect:
        """A contrast: rows with the same seeds are paired, others independent.

        Args:
            weights: rows, and how often each counts.
            measure: of which.
            ratio: means are those of logarithms; runs in which one of the rows measured 0 have
                none, and are left out.
        """
        groups: dict[int, list[tuple[float, Row]]] = {}
        for weight, row in weights:
            groups.setdefault(self.experiment.seed(row, 0), []).append((weight, row))
        samples = []
        for group in groups.values():
            numbers = self.numbers(*(row for _, row in group))
            sample: Numbers = np.zeros(len(numbers))
            for weight, row in group:
                values = self.values(row, measure, numbers)
                with np.errstate(divide="ignore", invalid="ignore"):  # 0 in one row, or in both
                    sample = sample + weight * (np.log(values) if ratio else values)
            samples.append(sample)
        return contrast(samples)


def student_t(share: float, freedom: int) -> float:
    """The quantile of Student's t distribution."""
    return float(_stats().t.ppf(share, freedom))
