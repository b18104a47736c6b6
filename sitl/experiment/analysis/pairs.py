"""Rows that met the same seeds, compared run by run. Needs SciPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sitl.experiment.analysis.trends import LEVEL, Difference, holm, paired_above
from sitl.experiment.campaign.plan import Experiment, Record, Row, canonical
from sitl.experiment.campaign.wording import words
from sitl.experiment.model.settings import value_of

Numbers = npt.NDArray[np.float64]

MEASURES: Final = {
    "goals_found_percent": "goals, points",
    "goal_rate_area_percent": "goals over time, points",
    "pose_age_mean_s": "pose age, s",
    "map_age_mean_s": "map age, s",
    "wait_mean_s": "wait, s",
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """A row against the first row that met the same seeds.

    Attributes:
        row, base: their labels.
        runs: how many pairs.
        differences: per measure: the row's less the base's.
        p: per measure, two-sided, corrected by Holm for the number of rows that are compared.
    """

    row: str
    base: str
    runs: int
    differences: dict[str, Difference]
    p: dict[str, float]


def compared(experiment: Experiment, records: Sequence[Record]) -> list[Comparison]:
    """Every row against the first one with the same seeds; then all that differ alike together."""
    runs: dict[str, dict[int, Any]] = {}
    for record in records:
        runs.setdefault(record["row"], {})[record["number"]] = record["measures"]
    bases: dict[int, Row] = {}
    alone: list[_Pairs] = []
    for row in experiment.rows:
        base = bases.setdefault(experiment.seed(row, 0), row)
        both = sorted(runs.get(row.label, {}).keys() & runs.get(base.label, {}).keys())
        if base is not row and len(both) > 1:
            change = canonical(
                [[value_of(each.settings, k) for k in experiment.paired] for each in (row, base)]
            )
            values = {
                measure: [_values(runs[each.label], both, measure) for each in (row, base)]
                for measure in MEASURES
            }
            alone.append(_Pairs(row.label, base.label, change, values))
    changes: dict[str, list[_Pairs]] = {}
    for pairs in alone:
        changes.setdefault(pairs.change, []).append(pairs)
    together = [_joined(experiment, own) for own in changes.values() if len(own) > 1]
    return [*_tested(alone), *_tested(together)]


@dataclass(frozen=True, slots=True)
class _Pairs:
    row: str
    base: str
    change: str
    values: dict[str, list[Numbers]]


def _joined(experiment: Experiment, own: Sequence[_Pairs]) -> _Pairs:
    """All pairs that differ alike, in whatever they agree."""
    rows = {row.label: row for row in experiment.rows}
    keys = [key for key in experiment.varied if key in experiment.paired]
    names = [words(rows[label].settings, keys) for label in (own[0].row, own[0].base)]
    values = {
        measure: [np.concatenate([pairs.values[measure][side] for pairs in own]) for side in (0, 1)]
        for measure in MEASURES
    }
    return _Pairs(f"{names[0]}, all", f"{names[1]}, all", own[0].change, values)


def _tested(found: Sequence[_Pairs]) -> list[Comparison]:
    """Paired t-tests, corrected for their number."""
    differences = [
        {measure: paired_above(*pairs.values[measure]) for measure in MEASURES} for pairs in found
    ]
    corrected = {
        measure: holm([2 * min(d[measure].p_greater, d[measure].p_less) for d in differences])
        for measure in MEASURES
    }
    return [
        Comparison(
            pairs.row,
            pairs.base,
            len(next(iter(pairs.values.values()))[0]),
            own,
            {measure: corrected[measure][index] for measure in MEASURES},
        )
        for index, (pairs, own) in enumerate(zip(found, differences, strict=True))
    ]


def as_markdown(comparisons: Sequence[Comparison]) -> str:
    """The comparisons for a document; what is significant is bold."""
    if not comparisons:
        return "No row has two runs with the seeds of another one."
    heads = ["row", "against", "pairs", *MEASURES.values()]
    text = ["| " + " | ".join(heads) + " |", "|---|---|---:|" + "---:|" * len(MEASURES)]
    for one in comparisons:
        cells = [one.row, one.base, str(one.runs)]
        for measure, difference in one.differences.items():
            shown = f"{difference.value:+.2f} [{difference.low:+.2f}, {difference.high:+.2f}]"
            cells.append(f"**{shown}**" if one.p[measure] < LEVEL else shown)
        text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text)


def _values(runs: dict[int, Any], numbers: Sequence[int], measure: str) -> Numbers:
    values = [runs[number][measure] for number in numbers]
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
