"""What the paper leaves open, fitted to some rows of its table; others predicted. Needs SciPy.

Every run of a calibration draws its settings from a declared space. A regression on them and on the
team stands in for the simulation, for as many tables as approximate Bayesian computation by
rejection takes: settings are drawn from the space, the regression makes a table of three runs per
row of them, with the residuals of runs as its noise, and the settings whose tables come nearest to
the paper's are kept (M. Blum, O. Francois, "Non-linear regression models for Approximate Bayesian
Computation", Statistics and Computing 20, 2010; R. Wilkinson, "Approximate Bayesian computation
gives exact results under the assumption of model error", 2013). Some of these are then run.

A prediction's rows are rows of the paper's table that the calibration has not seen, with the
settings of one of its draws. The runs of a draw make one table, as the paper's runs do; intervals
are those of one more such table (Student's t). Beside them stand guesses that know no robots, from
the rows that were seen: the formula with one constant, and a regression on radius, UAVs and UGVs.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, get_args

import numpy as np

from air_router.errors import UsageError
from sitl.experiment import (
    Between,
    Experiment,
    MessageWait,
    Record,
    draw,
    flat,
    value_of,
    value_text,
)
from sitl.experiment.analysis.statistics import Effect, Numbers, explained
from sitl.experiment.analysis.tables import COLUMNS, PAPER_TABLE, PaperRow, formula, paper_row

RUNS: Final = 3
"""The paper's percentages are those of so many runs of a row, mostly."""

DRAWS: Final = 10
"""Of the settings that are kept so many are run, to predict other rows."""

PAPER_COLUMNS: Final = tuple(column for column in COLUMNS if column.paper)
"""Goals, time, mean wait, SD of waits; all but the first are fitted as logarithms."""

_SEED: Final = 20261126
_DRAWN: Final = 100_000
_KEPT: Final = 200
_PENALTIES: Final = 10.0 ** np.arange(-2, 4)
_LEAST_S: Final = 1e-3
"""Shorter waits count as this: their logarithms would rule all else."""

_WAITS: Final = get_args(MessageWait)

GOALS_R2: Final = 0.5
"""What goals have to reach; for waits, that they are explained better than by the formula."""

LEAST_COVERED: Final = 10
"""So many of twelve 95 % intervals have to hold the paper's number; of right ones, 98 % do."""

_HEADS: Final = ("radius m", "UAVs", "UGVs", "column", "paper", "predicted", "low", "high")


def _row_of(record: Record) -> PaperRow:
    """The row of the paper's table that a run is of."""
    row = paper_row(record["settings"])
    if row is None:
        raise UsageError(f"the paper's table has no row for '{record['row']}'")
    return row


def logs(columns: Any) -> Numbers:
    """Columns of the paper's table as they are fitted; the last axis is theirs."""
    fitted = np.array(columns, np.float64)
    fitted[..., 1:] = np.log(np.maximum(fitted[..., 1:], _LEAST_S))
    return fitted


def pooled(runs: Numbers) -> Numbers:
    """The columns of some runs together, as `logs` has them; the last axis but one is the runs'.

    Runs count alike, and standard deviations as variances. A run that found no goal has no time.
    """
    powers = (1, 1, 2)
    means = np.log(np.nanmean(np.exp(runs[..., 1:] * powers), axis=-2)) / powers
    return np.concatenate([runs[..., :1].mean(axis=-2), means], axis=-1)


def columns_of(record: Record, waits: Iterable[str]) -> Numbers:
    """Goals and time of a run, then mean and SD of each of these waits, as `logs` has them."""
    keys = ["goals_found_percent", "time_to_goal_mean_min"]
    keys += [f"{wait}_{what}_s" for wait in waits for what in ("mean", "sd")]
    found = [record["measures"][key] for key in keys]
    return logs([math.nan if value is None else value for value in found])


class Calibration:
    """What the runs of a calibration show of their settings.

    Attributes:
        kept: The settings whose tables come nearest to the paper's, in the order of drawing.
        tables: What the regression makes of them: (kept, rows, columns), as `logs` has them.
        share: By column, of waits as they are counted by default: the share of the variance within
            rows that the regression explains of runs that it was not fitted to.
    """

    def __init__(self, experiment: Experiment, records: Sequence[Record]) -> None:
        self._space = experiment.space
        found = np.array([columns_of(record, _WAITS) for record in records])
        known = np.isfinite(found).all(axis=1)
        teams = [_row_of(record) for record in records]
        self._rows = [row for row in PAPER_TABLE if row in teams]
        self._paper = logs([row[3:] for row in self._rows])
        place = np.array([self._rows.index(team) for team in teams])[known]
        inputs = self._inputs([flat(record["settings"]) for record in records])[known]
        self._fit(place, inputs, found[known])
        self._reject()

    @property
    def draws(self) -> list[dict[str, Any]]:
        """The settings that are run to predict."""
        return self.kept[:: _KEPT // DRAWS]

    def _inputs(self, settings: Sequence[Mapping[str, Any]]) -> Numbers:
        """Settings as numbers from -1 to 1; of a list each but the first has one of its own.

        Those between two numbers come first. How waits are counted is known of every run.
        """
        even, others = [], []
        for key, prior in self._space.items():
            values = [own[key] for own in settings]
            if isinstance(prior, Between):
                ends = np.array([prior.low, prior.high, *values])
                ends = np.log(ends) if prior.log else ends
                even.append(2 * (ends[2:] - ends[0]) / (ends[1] - ends[0]) - 1)
            elif key != "message_wait":
                others += [[1.0 if v == own else -1.0 for v in values] for own in prior[1:]]
        self._even = len(even)
        return np.array([*even, *others]).T

    def _terms(self, inputs: Numbers, row: PaperRow) -> Numbers:
        """What the regression is linear in, beside the row itself."""
        even = inputs[:, : self._even]
        a, b = np.triu_indices(self._even)
        team = math.log2(row.radius_m / 12) / 1.3, 2 * row.uavs - 3, math.log2(row.ugvs / 5.5)
        return np.hstack([inputs, even[:, a] * even[:, b], *(part * inputs for part in team)])

    def _fit(self, place: Any, inputs: Numbers, found: Numbers) -> None:
        """Ridge regression within rows; penalties are those that are best for runs left out."""
        terms = np.vstack(
            [self._terms(inputs[[n]], self._rows[row]) for n, row in enumerate(place)]
        )
        of_row = place == np.arange(len(self._rows))[:, None]
        counts = of_row.sum(axis=1, keepdims=True)
        self._centres, self._means = of_row @ terms / counts, of_row @ found / counts
        truth = found - self._means[place]
        left, sizes, right = np.linalg.svd(terms - self._centres[place], full_matrices=False)
        lost = np.full((len(_PENALTIES), found.shape[1]), math.inf)
        self._slopes, residuals = np.zeros((terms.shape[1], found.shape[1])), np.zeros_like(found)
        for n, penalty in enumerate(_PENALTIES):
            shrunk = sizes**2 / (sizes**2 + penalty)
            leverage = (left**2 @ shrunk)[:, None] + 1 / counts[place]
            apart = (truth - left * shrunk @ (left.T @ truth)) / (1 - leverage)
            lost[n] = (apart**2).mean(axis=0) / truth.var(axis=0)
            best = lost[n] == lost.min(axis=0)
            slopes = right.T * (sizes / (sizes**2 + penalty)) @ (left.T @ truth)
            self._slopes[:, best], residuals[:, best] = slopes[:, best], apart[:, best]
        self._residuals = [residuals[own] for own in of_row]
        self.share = 1 - lost.min(axis=0)[: len(PAPER_COLUMNS)]

    def _reject(self) -> None:
        chance, generator = random.Random(_SEED), np.random.default_rng(_SEED)  # noqa: S311
        drawn = [
            {key: draw(prior, chance) for key, prior in self._space.items()} for _ in range(_DRAWN)
        ]
        inputs = self._inputs(drawn)
        waits = np.array([_WAITS.index(own["message_wait"]) for own in drawn])
        columns = np.stack([0 * waits, 0 * waits + 1, 2 * waits + 2, 2 * waits + 3], axis=1)
        tables = []
        for n, row in enumerate(self._rows):
            means = self._means[n] + (self._terms(inputs, row) - self._centres[n]) @ self._slopes
            noise = self._residuals[n]
            runs = means[:, None] + noise[generator.integers(len(noise), size=(_DRAWN, RUNS))]
            runs = np.take_along_axis(runs, columns[:, None], axis=2)
            runs[..., 0] = runs[..., 0].clip(0, 100)
            tables.append(pooled(runs))
        every = np.stack(tables, axis=1)
        away = ((every - self._paper) / self._paper.std(axis=0)) ** 2
        nearest = np.sort(np.argsort(away.sum(axis=(1, 2)))[:_KEPT])
        self.kept, self.tables = [drawn[n] for n in nearest], every[nearest]

    def text(self) -> str:
        """What is known of each setting before and after, and how good the fit is."""
        text = ["| setting | declared | after the fit |", "|---|---|---|"]
        for key, prior in self._space.items():
            values = [own[key] for own in self.kept]
            if isinstance(prior, Between):
                low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
                before = f"{prior.low:g} to {prior.high:g}{', as logarithm' if prior.log else ''}"
                after = f"{middle:.2f} [{low:.2f}, {high:.2f}]"
            else:
                names = [value_text(own) or "none" for own in prior]
                shares = [100 * values.count(own) / len(values) for own in prior]
                before = ", ".join(names)
                after = ", ".join(f"{n} {s:.0f} %" for n, s in zip(names, shares, strict=True))
            text.append(f"| `{key}` | {before} | {after} |")
        text += ["", "| column | regression explains of runs | R² of the fit |", "|---|---:|---:|"]
        fitted = self.tables.mean(axis=0)
        for column, share, own, paper in zip(
            PAPER_COLUMNS, self.share, fitted.T, self._paper.T, strict=True
        ):
            text.append(f"| {column.head} | {share:.2f} | {explained(own, paper):.2f} |")
        return "\n".join(text)

    def settings(self) -> list[list[str]]:
        """The settings that are run to predict, for a file: the heads, then a line for each."""
        return [
            [*self._space],
            *([value_text(value) for value in own.values()] for own in self.draws),
        ]


class Prediction:
    """What the runs of a prediction show of rows of the paper's table.

    Attributes:
        rows: The rows that are predicted.
        paper, guess, formula, regression: (rows, columns), as `logs` has them.
        reach: How far the intervals go to either side of the guess.
    """

    def __init__(self, records: Sequence[Record]) -> None:
        runs: dict[PaperRow, dict[str, list[Numbers]]] = {}  # by row, and by draw
        for record in records:
            wait = value_of(record["settings"], "message_wait")
            draw = record["row"].partition(",")[0]
            own = runs.setdefault(_row_of(record), {}).setdefault(draw, [])
            own.append(columns_of(record, [wait]))
        self.rows = [row for row in PAPER_TABLE if row in runs]
        seen = [row for row in PAPER_TABLE if row not in runs]
        self.paper, known = logs([r[3:] for r in self.rows]), logs([r[3:] for r in seen])
        drawn = np.array([[pooled(np.array(d)) for d in runs[row].values()] for row in self.rows])
        count = drawn.shape[1]
        self.guess = drawn.mean(axis=1)
        error = drawn.std(axis=1, ddof=1) * (1 + 1 / count) ** 0.5
        self.reach = error * Effect(0.0, 1.0, count - 1.0).interval().high
        self.formula = _shapes(self.rows) + (known - _shapes(seen)).mean(axis=0)
        self.regression = _terms(self.rows) @ np.linalg.lstsq(_terms(seen), known)[0]

    def text(self) -> str:
        """How well each column is predicted."""
        forms = " R² | formula | regression |" * 2
        text = [
            f"| column |{forms} in the interval | its reach | required |",
            f"|---|{'---:|' * 8}---|",
        ]
        every = self.paper, self.guess, self.formula, self.regression
        paper, *guesses = map(_plain, every)
        for n, column in enumerate(PAPER_COLUMNS):
            fitted = [
                explained(guess[:, n], self.paper[:, n])
                for guess in (self.guess, self.formula, self.regression)
            ]
            plain = [explained(guess[:, n], paper[:, n]) for guess in guesses]
            away = np.abs(self.paper - self.guess)[:, n]
            held = int(np.count_nonzero(away <= self.reach[:, n]))
            reach = float(np.median(self.reach[:, n]))
            goal = f"held by {LEAST_COVERED}: {_yes(held >= LEAST_COVERED)}"
            if not n:
                goal += f"; R² above {GOALS_R2:g}: {_yes(fitted[0] > GOALS_R2)}"
            elif "wait" in column.key:
                goal += f"; R² above the formula's: {_yes(fitted[0] > fitted[1])}"
            cells = [f"{value:.2f}" for value in (*fitted, *plain)]
            cells += [f"{held} of {len(self.rows)}"]
            cells += [
                f"{reach:.0f} points" if not n else f"a factor of {np.exp(reach):.1f}",
                goal,
            ]
            text.append(f"| {column.head} | {' | '.join(cells)} |")
        return "\n".join(text)

    def cells(self) -> list[list[str]]:
        """Every number that is predicted, for a file: the heads, then a line for each."""
        kinds = (self.guess, self.guess - self.reach, self.guess + self.reach)
        values = [_plain(v) for v in (self.paper, *kinds, self.formula, self.regression)]
        lines = [[*_HEADS, "formula", "regression"]]
        for place, row in enumerate(self.rows):
            for n, column in enumerate(PAPER_COLUMNS):
                numbers = [f"{value[place, n]:.{column.digits}f}" for value in values]
                lines.append([*map(value_text, row[:3]), column.head, *numbers])
        return lines


def _plain(fitted: Numbers) -> Numbers:
    """Columns as the paper has them."""
    return np.concatenate([fitted[:, :1], np.exp(fitted[:, 1:])], axis=1)


def _shapes(rows: Sequence[PaperRow]) -> Numbers:
    """The formula of each column without its constant."""
    return np.log([[formula(column, row) for column in PAPER_COLUMNS] for row in rows])


def _terms(rows: Sequence[PaperRow]) -> Numbers:
    return np.array([[1, np.log(row.radius_m), row.uavs, np.log(row.ugvs)] for row in rows])


def _yes(answer: bool) -> str:
    return "yes" if answer else "no"
