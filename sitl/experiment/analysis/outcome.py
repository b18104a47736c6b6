"""What seek policies are worth to the mission, with scenarios as the sample. Needs SciPy.

Each seed number is a scenario, drawn from the space that the experiment declares, and every row
meets it once. So rows are compared scenario by scenario, and an interval is one over scenarios: it
holds for the declared distribution, not for a few chosen towns. The noise of a single run is part
of it. Only scenarios count that every row has met.

Differences are paired; their intervals are Student's t, which the mean of so many differences
follows closely whatever their distribution (and which needs no resampling). Beside it stands the
expanded percentile bootstrap over scenarios, which takes no distribution for granted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sitl.experiment import Experiment, Record, Row, flat, value_of, value_text
from sitl.experiment.analysis.statistics import Effect, Interval, Numbers, Runs, contrast, interval
from sitl.experiment.analysis.statistics import power as power_of

PRIMARY: Final = "goal_value_percent"
"""What the declared test is about."""


class Outcome(NamedTuple):
    """A number that policies are compared by.

    Attributes:
        measure: its column.
        head: its name in tables, with its unit.
        digits: decimals in tables.
        factor: rows are compared by factors, else by differences.
    """

    measure: str
    head: str
    digits: int
    factor: bool = False


OUTCOMES: Final = (
    Outcome(PRIMARY, "goal value, % of the bound", 1),
    Outcome("goals_found_percent", "goals found, %", 0),
    Outcome("map_area_percent", "area explored, % over time", 1),
    Outcome("service_value_percent", "value of data, %", 1),
    Outcome("service_age_mean_s", "service age, s", 0, factor=True),
)
"""The primary outcome first."""

MOST_LEVELS: Final = 3
"""A setting that draws more values than that is cut at its median."""


Marks = npt.NDArray[np.bool_]
"""Some of the scenarios."""


class Scenarios:
    """The scenarios that every row of an experiment has met.

    Args:
        experiment: Its first row is what the others are compared with.
        records: Runs of one phase.

    Attributes:
        numbers: The seed numbers of the scenarios.
        rows: Those of the experiment that have runs.
    """

    def __init__(self, experiment: Experiment, records: Sequence[Record]) -> None:
        met = {record["row"] for record in records}
        self.rows = [row for row in experiment.rows if row.label in met]
        self._runs = Runs(experiment, records)
        self.numbers = self._runs.numbers(*self.rows) if self.rows else []
        self._settings: dict[int, Mapping[str, Any]] = {
            record["number"]: flat(record["settings"]) for record in records
        }

    @property
    def base(self) -> Row:
        """What the others are compared with."""
        return self.rows[0]

    def values(self, row: Row, measure: str) -> Numbers:
        """A measure of a row in every scenario."""
        return self._runs.values(row, measure, self.numbers)

    def apart(self, row: Row, outcome: Outcome) -> Numbers:
        """By how much a row differs from the first in every scenario; of factors, logarithms."""
        own, base = (self.values(each, outcome.measure) for each in (row, self.base))
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Numbers = np.log(own / base) if outcome.factor else own - base
        return found

    def effect(self, row: Row, outcome: Outcome, which: Marks | None = None) -> Effect:
        """The same on average, over all scenarios or those that are marked."""
        apart = self.apart(row, outcome)
        return contrast([apart if which is None else apart[which]])

    def levels(self, key: str) -> dict[str, Marks]:
        """The scenarios by a setting that is drawn: marks for each value, or for each half."""
        drawn = [value_of(self._settings[number], key) for number in self.numbers]
        texts = list(dict.fromkeys(map(value_text, drawn)))
        if len(texts) <= MOST_LEVELS or not all(isinstance(v, int | float) for v in drawn):
            marks = {text: np.array([value_text(v) == text for v in drawn]) for text in texts}
            return {text: marks[text] for text in sorted(marks)}
        values = np.array(drawn, dtype=np.float64)
        middle = float(np.median(values))
        low = values < middle
        return {f"below {middle:.3g}": low, f"{middle:.3g} or more": ~low}


def is_of_scenarios(experiment: Experiment) -> bool:
    """Whether every seed number is a scenario that all rows meet."""
    seeds = {experiment.seed(row, 0) for row in experiment.rows}
    return bool(experiment.space) and len(seeds) == 1 < len(experiment.rows)


def standings(found: Scenarios) -> list[list[str]]:
    """The heads, and a row's means with 95 % intervals and differences from the first row."""
    tests = len(found.rows) - 1
    heads = ["policy", "scenarios"]
    for outcome in OUTCOMES:
        heads += [outcome.head, "times" if outcome.factor else "apart"]
    primary = OUTCOMES[0]
    heads += ["apart, bootstrap", f"apart, all {tests} together", "detectable", "better in"]
    lines = [heads]
    for row in found.rows:
        cells = [row.label, str(len(found.numbers))]
        for outcome in OUTCOMES:
            cells.append(_text(interval(found.values(row, outcome.measure)), outcome.digits))
            effect = found.effect(row, outcome)
            cells.append("" if row is found.base else difference_text(effect.interval(), outcome))
        if row is not found.base:
            apart = found.apart(row, primary)
            effect = found.effect(row, primary)
            cells += [
                difference_text(interval(apart), primary),
                difference_text(effect.interval(tests), primary),
                f"{effect.detectable():.2f}",
                f"{np.count_nonzero(apart > 0)} of {np.count_nonzero(apart != 0)}",
            ]
        lines.append([*cells, *[""] * (len(heads) - len(cells))])
    return lines


def strata(found: Scenarios, keys: Sequence[str]) -> list[list[str]]:
    """The heads, and every row's difference in the primary outcome by each setting that is drawn.

    Nothing here was declared: it is to find questions, not to answer them.
    """
    lines = [["setting", "value", "scenarios", *(row.label for row in found.rows[1:])]]
    for key in keys:
        for level, marks in found.levels(key).items():
            effects = [found.effect(row, OUTCOMES[0], marks) for row in found.rows[1:]]
            cells = [difference_text(effect.interval(), OUTCOMES[0]) for effect in effects]
            lines.append([key, level, str(int(marks.sum())), *cells])
    return lines


def outcome_text(found: Scenarios, relevant: float) -> str:
    """The table for a document, and what so many scenarios could show.

    Args:
        found: The scenarios.
        relevant: The smallest difference of the primary outcome that counts, in points.
    """
    shown = [OUTCOMES[0], *OUTCOMES[2:]]
    heads = "".join(
        f" {'x' if outcome.factor else '±'} {outcome.head.partition(',')[0]} |" for outcome in shown
    )
    text = [
        f"| policy | {OUTCOMES[0].head} | {OUTCOMES[1].head} |{heads} power for {relevant:g} |",
        "|---|---:|---:|" + "---:|" * len(shown) + "---:|",
    ]
    for row in found.rows:
        means = [_text(interval(found.values(row, outcome.measure)), 1) for outcome in OUTCOMES[:2]]
        cells = ["" for _ in shown]
        power = ""
        if row is not found.base:
            cells = [difference_text(found.effect(row, each).interval(), each) for each in shown]
            power = f"{power_of(found.effect(row, OUTCOMES[0]), relevant):.2f}"
        text.append(f"| {' | '.join([row.label, *means, *cells, power])} |")
    return "\n".join(text)


def difference_text(found: Interval, outcome: Outcome) -> str:
    """A difference with its interval: points with a sign, or a factor."""
    if math.isnan(found.value):
        return "unknown"
    if outcome.factor:
        value, low, high = (f"{math.exp(number):.2f}" for number in found)
    else:
        value, low, high = (f"{number:+.1f}" for number in found)
    return f"{value} [{low}, {high}]"


def _text(found: Interval, digits: int) -> str:
    value, low, high = (f"{number:.{digits}f}" for number in found)
    return value if math.isnan(found.low) else f"{value} [{low}, {high}]"
