"""95 % confidence intervals of what is averaged over runs, by resampling whole runs.

Expanded percentile bootstrap: 10,000 times as many runs as there are, drawn with replacement; the
interval is between two percentiles of what they amount to. With few runs the bootstrap is too
sure of itself, so the percentiles lie farther out, by sqrt(n / (n - 1)) and by Student's t in place
of the normal distribution (T. Hesterberg, "What Teachers Should Know About the Bootstrap",
The American Statistician 69, 2015, section 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

Numbers = npt.NDArray[np.float64]

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
    tail = NormalDist().cdf(-math.sqrt(runs / (runs - 1)) * student_t(runs - 1))
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


def student_t(freedom: int) -> float:
    """Student's t at 97.5 %, to 1 % (Cornish and Fisher's expansion; exact for 1 and 2)."""
    if freedom == 1:
        return math.tan(math.pi * 0.475)
    if freedom == 2:
        return 0.95 * math.sqrt(2 / (1 - 0.95**2))
    z, v = NormalDist().inv_cdf(0.975), freedom
    return (
        z
        + (z**3 + z) / (4 * v)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * v**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * v**3)
    )


def _mean(values: Numbers) -> Numbers:
    result: Numbers = values.mean(axis=-1)
    return result
