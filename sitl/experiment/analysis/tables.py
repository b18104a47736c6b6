"""The table of an experiment, and rows that met the same seeds compared run by run.

Means with 95 % confidence intervals, the paper's beside them. Needs SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sitl.experiment.analysis.paper import PaperRow, paper_row
from sitl.experiment.analysis.statistics import (
    LEVEL,
    Difference,
    Interval,
    holm,
    interval,
    paired_above,
    ratio,
    spread,
)
from sitl.experiment.campaign.plan import Experiment, Record, Row, canonical
from sitl.experiment.campaign.results import flat
from sitl.experiment.campaign.rows import words
from sitl.experiment.settings import value_of

_HEADS: Final = {
    "radius_m": "radius m",
    "uavs": "UAVs",
    "ugvs": "UGVs",
}
_MOST_SETTINGS: Final = 3
"""Where rows differ in more settings than that, their labels say more."""

CAPTION: Final = (
    "Means over all runs of a row; waits and times over all messages and all goals of its runs.\n"
    "In brackets: 95 % confidence interval (expanded percentile bootstrap over whole runs)."
)


@dataclass(frozen=True, slots=True)
class Line:
    """One row of an experiment, summed up over its runs.

    Attributes:
        label: the row's.
        settings: its settings, flat.
        runs: how many runs.
        goals_percent: of the goals that were reached.
        time_min: to the goals that were reached.
        wait_mean_s, wait_sd_s: of the messages.
        pose_age_s, map_age_s: age of information, see docs/experiments.md.
        sent_mb: what arrived, in all.
        speed_up: simulated seconds per second of one process.
        paper: the paper's row, where it has one for this team.
    """

    label: str
    settings: dict[str, Any]
    runs: int
    goals_percent: Interval
    time_min: Interval
    wait_mean_s: Interval
    wait_sd_s: Interval
    pose_age_s: Interval
    map_age_s: Interval
    sent_mb: Interval
    speed_up: float
    paper: PaperRow | None


def lines(experiment: Experiment, records: Sequence[Record]) -> list[Line]:
    """The rows of an experiment that have runs."""
    found = []
    for row in experiment.rows:
        own = [record for record in records if record["row"] == row.label]
        if own:
            found.append(_line(row.label, flat(row.settings), [r["measures"] for r in own]))
    return found


def _line(label: str, settings: dict[str, Any], runs: list[dict[str, Any]]) -> Line:
    time_min = [
        [(run["time_to_goal_mean_min"] or 0.0) * run["goals_found"], run["goals_found"]]
        for run in runs
    ]
    waits = [
        [
            (run["wait_mean_s"] or 0.0) * run["waits"],
            run["waits"],
            ((run["wait_sd_s"] or 0.0) ** 2 + (run["wait_mean_s"] or 0.0) ** 2) * run["waits"],
        ]
        for run in runs
    ]
    simulated_s = sum((run["speed_up"] or 0.0) * run["wall_s"] for run in runs)
    return Line(
        label=label,
        settings=settings,
        runs=len(runs),
        goals_percent=interval(_column(runs, "goals_found_percent")),
        time_min=interval(np.array(time_min, dtype=np.float64), ratio),
        wait_mean_s=interval(np.array(waits, dtype=np.float64), ratio),
        wait_sd_s=interval(np.array(waits, dtype=np.float64), spread),
        pose_age_s=interval(_column(runs, "pose_age_mean_s")),
        map_age_s=interval(_column(runs, "map_age_mean_s")),
        sent_mb=interval(_column(runs, "sent_MB")),
        speed_up=simulated_s / max(sum(run["wall_s"] for run in runs), 1e-9),
        paper=paper_row(*(value_of(settings, key) for key in ("radius_m", "uavs", "ugvs"))),
    )


def _column(runs: Sequence[dict[str, Any]], name: str) -> Any:
    values = [run[name] for run in runs if run[name] is not None]
    return np.array(values, dtype=np.float64)


def of_the_paper(experiment: Experiment) -> bool:
    """Whether the rows are those of the paper's table: what it varies, and no more."""
    return set(experiment.varied) == {"radius_m", "uavs", "ugvs"}


_Cell = Callable[[Line], str]


def _columns(experiment: Experiment, found: Sequence[Line]) -> dict[str, _Cell]:
    paper = of_the_paper(experiment)
    keys = list(dict.fromkeys(key for line in found for key in line.settings))
    differing = [k for k in keys if len({_plain(k, line) for line in found}) > 1]
    columns: dict[str, _Cell] = {
        _HEADS.get(key, key.replace("_", " ")): partial(_plain, key) for key in differing
    }
    if not columns or len(columns) > _MOST_SETTINGS:
        columns = {"row": lambda line: line.label}
    columns["runs"] = lambda line: str(line.runs)
    columns["goals %"] = lambda line: _shown(line.goals_percent, 1)
    if paper:
        columns["paper %"] = lambda line: f"{line.paper.goals_percent:.1f}" if line.paper else ""
    columns["time min"] = lambda line: _shown(line.time_min, 1)
    if paper:
        columns["paper min"] = lambda line: f"{line.paper.mean_time_min:.1f}" if line.paper else ""
    columns["wait s"] = lambda line: _shown(line.wait_mean_s, 2)
    if paper:
        columns["paper s"] = lambda line: f"{line.paper.wait_mean_s:.2f}" if line.paper else ""
    columns["wait SD s"] = lambda line: _shown(line.wait_sd_s, 2)
    if paper:
        columns["paper SD s"] = lambda line: f"{line.paper.wait_sd_s:.2f}" if line.paper else ""
    else:
        columns["pose age s"] = lambda line: _shown(line.pose_age_s, 0)
        columns["map age s"] = lambda line: _shown(line.map_age_s, 0)
    columns["x real time"] = lambda line: f"{line.speed_up:,.0f}"
    return columns


def as_rows(experiment: Experiment, found: Sequence[Line]) -> list[list[str]]:
    """The table as it is read: the heads, then the cells of each row."""
    columns = _columns(experiment, found)
    return [[*columns], *([cell(line) for cell in columns.values()] for line in found)]


def as_text(experiment: Experiment, found: Sequence[Line], seeds: str) -> str:
    """The table for a terminal; `seeds` says which it is made of."""
    rows = as_rows(experiment, found)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    text = ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([experiment.title, "", *text, "", f"From {seeds}.", CAPTION])


def as_markdown(experiment: Experiment, found: Sequence[Line]) -> str:
    """The table for a document."""
    heads, *rows = ("| " + " | ".join(row) + " |" for row in as_rows(experiment, found))
    return "\n".join([heads, "|" + "---:|" * heads.count(" | ") + "---:|", *rows])


def as_plain(found: Sequence[Line]) -> list[dict[str, Any]]:
    """The table for other programs."""
    names = (
        "goals_percent",
        "time_min",
        "wait_mean_s",
        "wait_sd_s",
        "pose_age_s",
        "map_age_s",
        "sent_mb",
    )
    return [
        {
            "row": line.label,
            "runs": line.runs,
            **{name: getattr(line, name)._asdict() for name in names},
            "speed_up": line.speed_up,
            "paper": line.paper._asdict() if line.paper else None,
        }
        for line in found
    ]


def _plain(key: str, line: Line) -> str:
    value = value_of(line.settings, key)
    if value is None:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _shown(estimate: Interval, digits: int) -> str:
    if math.isnan(estimate.value):
        return "none"
    text = f"{estimate.value:.{digits}f}"
    if math.isnan(estimate.low):
        return text
    return f"{text} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"


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


def pairs_as_markdown(comparisons: Sequence[Comparison]) -> str:
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
