"""Rows of the paper's table predicted by a calibration that has not seen them. Needs SciPy.

A prediction's rows are rows of the paper's table with the settings of a draw of the calibration.
The runs of a draw make one table, as the paper's runs do; intervals are those of one more such
table (Student's t). Beside them stand guesses that know no robots, from the rows that the
calibration has seen: the formula with one constant, and a regression on radius, UAVs and UGVs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from sitl.experiment.analysis.calibration import (
    PAPER_COLUMNS,
    columns_of,
    explained,
    logs,
    paper_row,
    pooled,
)
from sitl.experiment.analysis.statistics import Effect, Numbers
from sitl.experiment.analysis.tables import PAPER_TABLE, PaperRow
from sitl.experiment.plan import Record, said
from sitl.experiment.settings import value_of

GOALS_R2: Final = 0.5
"""What is asked of goals; of waits, that they are explained better than by the formula."""

LEAST_COVERED: Final = 10
"""So many of twelve 95 % intervals have to hold the paper's number; of right ones, 98 % do."""

_HEADS: Final = ("radius m", "UAVs", "UGVs", "column", "paper", "predicted", "low", "high")


class Prediction:
    """What the runs of a prediction say of rows of the paper's table.

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
            own = runs.setdefault(paper_row(record), {}).setdefault(draw, [])
            own.append(columns_of(record, [wait]))
        self.rows = [row for row in PAPER_TABLE if row in runs]
        seen = [row for row in PAPER_TABLE if row not in runs]
        self.paper, known = logs([r[3:] for r in self.rows]), logs([r[3:] for r in seen])
        drawn = np.array([[pooled(np.array(d)) for d in runs[row].values()] for row in self.rows])
        count = drawn.shape[1]
        self.guess = drawn.mean(axis=1)
        error = drawn.std(axis=1, ddof=1) * (1 + 1 / count) ** 0.5
        self.reach = error * Effect(0.0, 1.0, count - 1.0).interval().high
        self.formula = _shape(self.rows) + (known - _shape(seen)).mean(axis=0)
        self.regression = _terms(self.rows) @ np.linalg.lstsq(_terms(seen), known)[0]

    def told(self) -> str:
        """How well each column is predicted."""
        text = [
            f"| column |{' R² | formula | regression |' * 2} in the interval | its reach | asked |",
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
            asked = f"held by {LEAST_COVERED}: {_yes(held >= LEAST_COVERED)}"
            if not n:
                asked += f"; R² above {GOALS_R2:g}: {_yes(fitted[0] > GOALS_R2)}"
            elif "wait" in column.key:
                asked += f"; R² above the formula's: {_yes(fitted[0] > fitted[1])}"
            cells = [f"{value:.2f}" for value in (*fitted, *plain)]
            cells += [f"{held} of {len(self.rows)}"]
            cells += [f"{reach:.0f} points" if not n else f"a factor of {np.exp(reach):.1f}", asked]
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
                lines.append([*map(said, row[:3]), column.head, *numbers])
        return lines


def _plain(fitted: Numbers) -> Numbers:
    """Columns as the paper has them."""
    return np.concatenate([fitted[:, :1], np.exp(fitted[:, 1:])], axis=1)


def _shape(rows: Sequence[PaperRow]) -> Numbers:
    """The formula without its constants: waits go by (UAVs + UGVs)² times the radius."""
    waits = [np.log((row.uavs + row.ugvs) ** 2 * row.radius_m) for row in rows]
    return np.stack([np.zeros(len(rows)), np.zeros(len(rows)), waits, waits], axis=1)


def _terms(rows: Sequence[PaperRow]) -> Numbers:
    return np.array([[1, np.log(row.radius_m), row.uavs, np.log(row.ugvs)] for row in rows])


def _yes(answer: bool) -> str:
    return "yes" if answer else "no"
