"""The table of an experiment: means with 95 % intervals, the paper's beside them. Needs SciPy.

The paper is F. Cladera et al., "Enabling Large-scale Heterogeneous Collaboration with Opportunistic
Communications", ICRA 2024; plans/paper.csv has what its table I reports of simulated teams.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from sitl.experiment import Experiment, Record, Row, flat, value_of, value_text
from sitl.experiment.analysis.statistics import (
    Interval,
    Numbers,
    Runs,
    explained,
    interval,
    ratio,
    spread,
)

_HEADS: Final = {"radius_m": "radius m", "uavs": "UAVs", "ugvs": "UGVs"}
"""What the paper's table varies."""

_PLACES: Final = {"starts", "goals"}
"""Where robots start and vehicles stand: the paper's text leaves it open."""

_WIDTH: Final = 160
"""Letters in a line of a terminal that is opened wide."""

_MOST_SETTINGS: Final = 3
"""Where rows differ in more settings than that, their labels have more."""

_CAPTION: Final = (
    "Means over all runs of a row; waits and times over all messages and all goals of its runs.\n"
    "In brackets: 95 % confidence interval (expanded percentile bootstrap over whole runs)."
)


class PaperRow(NamedTuple):
    """One line of the paper's table."""

    radius_m: float
    uavs: float
    ugvs: float
    goals_percent: float
    mean_time_min: float
    wait_mean_s: float
    wait_sd_s: float


with Path(__file__).parents[1].joinpath("plans", "paper.csv").open(encoding="utf-8") as _file:
    PAPER_TABLE: Final = tuple(PaperRow(*map(float, row)) for row in list(csv.reader(_file))[1:])


def paper_row(settings: Mapping[str, Any]) -> PaperRow | None:
    """The line of the paper's table for a team, if it has one."""
    team = tuple(value_of(settings, key) for key in _HEADS)
    return next((row for row in PAPER_TABLE if row[:3] == team), None)


class Column(NamedTuple):
    """A number of a row, made of a measure of its runs (docs/evidence/experiments.md).

    Attributes:
        key: its name for programs.
        head: its name in tables.
        digits: decimals in tables.
        measure: of each run.
        per: a measure by which each run counts as much; None: all count alike.
        sd: a measure, the standard deviation about `measure`: that is what the column is about.
        paper: the paper's value in `PaperRow`.
    """

    key: str
    head: str
    digits: int
    measure: str
    per: str | None = None
    sd: str | None = None
    paper: str | None = None

    def estimate(self, runs: Sequence[Mapping[str, Any]]) -> Interval:
        """The number of some runs, by their measures."""
        if any(self.measure not in run for run in runs):
            return _NONE  # some are of an earlier version
        runs = [run for run in runs if self.per or run[self.measure] is not None]
        values = np.array([run[self.measure] or 0.0 for run in runs], dtype=np.float64)
        if self.per is None:
            return interval(values)
        counts = np.array([run[self.per] for run in runs], dtype=np.float64)
        if self.sd is None:
            return interval(values * counts, counts, statistic=ratio)
        spreads = np.array([run[self.sd] or 0.0 for run in runs], dtype=np.float64)
        squares = (spreads**2 + values**2) * counts
        return interval(values * counts, counts, squares, statistic=spread)


COLUMNS: Final = (
    Column("goals_percent", "goals %", 1, "goals_found_percent", paper="goals_percent"),
    Column("goal_area_percent", "goals over time %", 1, "goal_rate_area_percent"),
    Column(
        *("time_min", "time min", 1, "time_to_goal_mean_min", "goals_found"), paper="mean_time_min"
    ),
    Column("wait_mean_s", "wait s", 2, "wait_mean_s", "waits", paper="wait_mean_s"),
    Column("wait_sd_s", "wait SD s", 2, "wait_mean_s", "waits", "wait_sd_s", paper="wait_sd_s"),
    Column("data_wait_s", "data wait s", 2, "data_wait_mean_s", "data_waits"),
    Column("header_wait_s", "header wait s", 2, "header_wait_mean_s", "header_waits"),
    Column("complete", "complete exchanges", 0, "exchanges_complete"),
    Column("broken", "broken exchanges", 0, "exchanges_broken"),
    Column("pose_age_s", "pose age s", 0, "pose_age_mean_s"),
    Column("pose_peak_s", "pose peak s", 0, "pose_age_peak_s"),
    Column("map_age_s", "map age s", 0, "map_age_mean_s"),
    Column("map_peak_s", "map peak s", 0, "map_age_peak_s"),
    Column("claims_age_s", "claims age s", 0, "claims_age_mean_s"),
    Column("claims_peak_s", "claims peak s", 0, "claims_age_peak_s"),
    Column("sent_mb", "sent MB", 2, "sent_MB"),
    Column("bound_gap", "goals over time below the bound, points", 1, "goal_bound_gap_percent"),
    Column("service_age_s", "service age s", 0, "service_age_mean_s"),
)
_OF_ORACLE: Final = Column("of_oracle", "% of the oracle's service", 0, "service_age_mean_s")
"""The oracle's age as a share of a row's, from runs of the same seeds."""

_NONE: Final = Interval(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Line:
    """One row of an experiment, summed up over its runs.

    Attributes:
        label: the row's.
        settings: its settings, flat.
        runs: how many runs.
        values: by the columns' keys.
        speed_up: simulated seconds per second of one process.
        paper: the paper's row, where it has one for this team.
    """

    label: str
    settings: dict[str, Any]
    runs: int
    values: dict[str, Interval]
    speed_up: float
    paper: PaperRow | None


def lines(experiment: Experiment, records: Sequence[Record]) -> list[Line]:
    """The rows of an experiment that have runs."""
    found, samples = [], Runs(experiment, records)
    oracles = {
        experiment.seed(row, 0): row
        for row in experiment.rows
        if row.settings.get("policy") == "oracle"
    }
    for row in experiment.rows:
        own = [record["measures"] for record in records if record["row"] == row.label]
        if not own:
            continue
        values = {column.key: column.estimate(own) for column in COLUMNS}
        if oracle := oracles.get(experiment.seed(row, 0)):
            numbers = samples.numbers(oracle, row)
            ages_s = (samples.values(each, _OF_ORACLE.measure, numbers) for each in (oracle, row))
            shares = interval(*ages_s, statistic=ratio)
            values[_OF_ORACLE.key] = Interval(*(100 * share for share in shares))
        wall_s = sum(run["wall_s"] for run in own)
        simulated_s = sum((run["speed_up"] or 0.0) * run["wall_s"] for run in own)
        settings = flat(row.settings)
        speed_up = simulated_s / max(wall_s, 1e-9)
        found.append(Line(row.label, settings, len(own), values, speed_up, paper_row(settings)))
    return found


def of_the_paper(experiment: Experiment) -> bool:
    """Whether the rows are those of the paper's table: what it varies, and no more."""
    return set(experiment.varied) == _HEADS.keys()


def beside_the_paper(experiment: Experiment) -> bool:
    """Whether rows are the paper's table, or some of its teams in several readings of places."""
    varied = set(experiment.varied)
    if varied.isdisjoint(_PLACES):
        return of_the_paper(experiment)
    ours = varied - _PLACES
    return ours <= _HEADS.keys() and all(paper_row(row.settings) for row in experiment.rows)


def readings(experiment: Experiment) -> dict[str, list[Row]]:
    """The paper's teams by reading, where several are compared; each reading has the same teams."""
    keys = [key for key in experiment.varied if key in _PLACES]
    found: dict[str, list[Row]] = {}
    if keys and beside_the_paper(experiment):
        for row in experiment.rows:
            name = ", ".join(f"{key}: {value_of(row.settings, key)}" for key in keys)
            found.setdefault(name, []).append(row)
    return found


def as_rows(experiment: Experiment, found: Sequence[Line]) -> list[list[str]]:
    """The table as it is read: the heads, then the cells of each row."""
    columns: dict[str, list[str]] = {}
    for key in dict.fromkeys(key for line in found for key in line.settings):
        cells = [value_text(value_of(line.settings, key)) for line in found]
        if len(set(cells)) > 1:
            columns[_HEADS.get(key, key.replace("_", " "))] = cells
    if not columns or len(columns) > _MOST_SETTINGS:
        columns = {"row": [line.label for line in found]}
    columns["runs"] = [str(line.runs) for line in found]
    for column in (*COLUMNS, _OF_ORACLE):
        estimates = [line.values.get(column.key, _NONE) for line in found]
        if not all(math.isnan(estimate.value) for estimate in estimates):
            columns[column.head] = [_shown(estimate, column.digits) for estimate in estimates]
            if column.paper and beside_the_paper(experiment):
                theirs = [line.paper and getattr(line.paper, column.paper) for line in found]
                columns[f"paper: {column.head}"] = [
                    "" if number is None else f"{number:.{column.digits}f}" for number in theirs
                ]
    columns["x real time"] = [f"{line.speed_up:,.0f}" for line in found]
    return [[*columns], *map(list, zip(*columns.values(), strict=True))]


def as_text(experiment: Experiment, found: Sequence[Line], seeds: str) -> str:
    """The table for a terminal, in parts that fit into it; `seeds` names the runs' seeds."""
    rows = as_rows(experiment, found)
    names, columns = rows[0].index("runs") + 1, zip(*rows, strict=True)
    padded = [[cell.rjust(max(map(len, column))) for cell in column] for column in columns]
    parts = [padded[:names]]
    for column in padded[names:]:
        if sum(len(other[0]) + 2 for other in parts[-1]) + len(column[0]) > _WIDTH:
            parts.append(padded[:names])
        parts[-1] = [*parts[-1], column]
    text = ["\n".join("  ".join(row) for row in zip(*part, strict=True)) for part in parts]
    return "\n\n".join([experiment.title, *text, f"From {seeds}.\n{_CAPTION}"])


def as_plain(found: Sequence[Line]) -> list[dict[str, Any]]:
    """The table for other programs."""
    return [
        {
            "row": line.label,
            "runs": line.runs,
            **{key: estimate._asdict() for key, estimate in line.values.items()},
            "speed_up": line.speed_up,
            "paper": line.paper._asdict() if line.paper else None,
        }
        for line in found
    ]


def nearness(ours: Sequence[Line]) -> str:
    """How near the whole table comes to the paper's, for a document; empty if rows are missing.

    Beside it the `formula` with its constant fitted to the paper's numbers.
    """
    if len(ours) < len(PAPER_TABLE):
        return ""
    text = [
        "| column | ours / paper (range) | within x2 | R² | paper in interval | formula: x2 | R² |",
        "|---|" + "---:|" * 6,
    ]
    for column in (column for column in COLUMNS if column.paper):
        paper = np.array([getattr(line.paper, column.paper or "") for line in ours])
        shape = np.array([formula(column, line.paper) for line in ours if line.paper])
        value, low, high = np.array([line.values[column.key] for line in ours]).T
        factors = value / paper
        cells = [
            column.head,
            _range(factors),
            *_fit(value, paper),
            f"{np.count_nonzero((low <= paper) & (paper <= high))} of {len(ours)}",
            *_fit(shape * _geometric(paper / shape), paper),
        ]
        text.append(f"| {' | '.join(cells)} |")
    return "\n".join(text)


def readings_text(experiment: Experiment, records: Sequence[Record]) -> str:
    """How near each reading comes to the paper, for a document; empty: only one was made.

    Teams are independent, so the mean over them has Welch's interval.
    """
    runs, by_label = Runs(experiment, records), {}
    for line in lines(experiment, records):
        by_label[line.label] = line
    columns = [column for column in COLUMNS if column.paper]
    goals, *others = columns
    heads = "".join(f" {column.head}, ours / paper (range) |" for column in others)
    text = [
        "| reading | goals %, mean over teams | paper | ours / paper (range) | paper in interval |"
        + heads,
        "|---|" + "---:|" * (4 + len(others)),
    ]
    for name, rows in readings(experiment).items():
        own = [by_label[row.label] for row in rows if row.label in by_label]
        if len(own) < len(rows):
            return ""
        mean = runs.effect([(1 / len(rows), row) for row in rows], goals.measure).interval()
        paper = {c: np.array([getattr(line.paper, c.paper or "") for line in own]) for c in columns}
        factors = {
            c: np.array([line.values[c.key].value for line in own]) / paper[c] for c in columns
        }
        _, low, high = np.array([line.values[goals.key] for line in own]).T
        held = np.count_nonzero((low <= paper[goals]) & (paper[goals] <= high))
        cells = [name, _shown(mean, 1), f"{paper[goals].mean():.1f}", _range(factors[goals])]
        cells += [f"{held} of {len(own)}", *(_range(factors[column]) for column in others)]
        text.append(f"| {' | '.join(cells)} |")
    return "\n".join(text) if len(text) > 2 else ""


def _range(factors: Numbers) -> str:
    return f"{_geometric(factors):.2f} ({factors.min():.2f} to {factors.max():.2f})"


def formula(column: Column, row: PaperRow) -> float:
    """A guess but for one constant: waits go by (UAVs + UGVs)² times the radius, all else not."""
    return (row.uavs + row.ugvs) ** 2 * row.radius_m if "wait" in column.key else 1.0


def _geometric(values: Numbers) -> float:
    return math.exp(np.log(values).mean())


def _fit(guess: Numbers, truth: Numbers) -> tuple[str, str]:
    """How many are within a factor of two, and R²."""
    near = np.count_nonzero(np.abs(np.log2(guess / truth)) <= 1)
    return f"{near} of {len(truth)}", f"{explained(guess, truth):.2f}"


def _shown(estimate: Interval, digits: int) -> str:
    if math.isnan(estimate.value):
        return "none"
    value, low, high = (f"{number:.{digits}f}" for number in estimate)
    return value if math.isnan(estimate.low) else f"{value} [{low}, {high}]"
