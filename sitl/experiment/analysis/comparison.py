"""Rows that met the same seeds, compared run by run. Needs SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from sitl.experiment.analysis.statistics import Effect, Numbers, contrast
from sitl.experiment.campaign.plan import Experiment, Record, Row, canonical
from sitl.experiment.campaign.rows import words
from sitl.experiment.settings import value_of

MEASURES: Final = {
    "goals_found_percent": "goals, points",
    "goal_rate_area_percent": "goals over time, points",
    "pose_age_mean_s": "pose age, s",
    "pose_age_peak_s": "pose peak, s",
    "map_age_mean_s": "map age, s",
    "map_age_peak_s": "map peak, s",
    "claims_age_mean_s": "claims age, s",
    "wait_mean_s": "wait, s",
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A row against the first row that met the same seeds.

    Attributes:
        row, base: their labels.
        change: what is other in the row.
        runs: how many pairs.
        differences: per measure: the row's less the base's, by pair.
    """

    row: str
    base: str
    change: str
    runs: int
    differences: dict[str, list[Numbers]]

    def effect(self, measure: str) -> Effect:
        """The mean difference; of several rows with as many pairs, the mean of theirs."""
        own = self.differences[measure]
        return contrast([sample / len(own) for sample in own])


def compared(experiment: Experiment, records: Sequence[Record]) -> list[Comparison]:
    """Every row against the first one with the same seeds; then all that differ alike together."""
    runs: dict[str, dict[int, Any]] = {}
    for record in records:
        runs.setdefault(record["row"], {})[record["number"]] = record["measures"]
    bases: dict[int, Row] = {}
    alone: list[Comparison] = []
    for row in experiment.rows:
        base = bases.setdefault(experiment.seed(row, 0), row)
        both = sorted(runs.get(row.label, {}).keys() & runs.get(base.label, {}).keys())
        if base is not row and len(both) > 1:
            change = canonical(
                [[value_of(each.settings, k) for k in experiment.paired] for each in (row, base)]
            )
            differences = {
                measure: [
                    _values(runs[row.label], both, measure)
                    - _values(runs[base.label], both, measure)
                ]
                for measure in MEASURES
            }
            alone.append(Comparison(row.label, base.label, change, len(both), differences))
    changes: dict[str, list[Comparison]] = {}
    for one in alone:
        changes.setdefault(one.change, []).append(one)
    return [*alone, *(_joined(experiment, own) for own in changes.values() if len(own) > 1)]


def _joined(experiment: Experiment, own: Sequence[Comparison]) -> Comparison:
    """All that differ alike, in whatever they agree."""
    rows = {row.label: row for row in experiment.rows}
    keys = [key for key in experiment.varied if key in experiment.paired]
    names = [words(rows[label].settings, keys) for label in (own[0].row, own[0].base)]
    differences = {
        measure: [sample for one in own for sample in one.differences[measure]]
        for measure in MEASURES
    }
    runs = sum(one.runs for one in own)
    return Comparison(f"{names[0]}, all", f"{names[1]}, all", own[0].change, runs, differences)


def as_rows(comparisons: Sequence[Comparison]) -> list[list[str]]:
    """The comparisons as they are read: the heads, then the cells of each.

    A difference with its interval, which holds together with those of the other rows, and how large
    one is that so many pairs tell from 0.
    """
    rows = [["row", "against", "pairs", *MEASURES.values()]]
    for one in comparisons:
        cells = [one.row, one.base, str(one.runs)]
        for measure in MEASURES:
            effect, tests = one.effect(measure), len(comparisons)
            value, low, high = effect.interval(tests)
            told = f"{value:+.1f} [{low:+.1f}, {high:+.1f}]; detectable: "
            known = not math.isnan(value)
            cells.append(f"{told}{effect.detectable(tests):.1f}" if known else "unknown")
        rows.append(cells)
    return rows


def _values(runs: dict[int, Any], numbers: Sequence[int], measure: str) -> Numbers:
    values = [runs[number][measure] for number in numbers]
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
