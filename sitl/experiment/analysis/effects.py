"""The runs of an experiment as samples of effects. Needs SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from air_router.errors import UsageError
from sitl.experiment.analysis.statistics import Effect, Numbers, contrast
from sitl.experiment.campaign.plan import Experiment, Record, Row

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
            ratio: means are those of logarithms.
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
                with np.errstate(divide="ignore"):
                    sample = sample + weight * (np.log(values) if ratio else values)
            samples.append(sample)
        return contrast(samples)
