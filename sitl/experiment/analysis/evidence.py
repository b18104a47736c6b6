"""Runs as samples that a test can take: numbers of whole runs, chosen by settings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sitl.experiment.campaign.plan import Record
from sitl.experiment.model.settings import value_of

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
