"""Rows that met the same seeds, and both simulations, compared run by run. Needs SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from sitl.experiment.analysis.statistics import Interval, Runs, Weights
from sitl.experiment.plan import Experiment, Record, Row, canonical, rows_with, words
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
    "service_age_mean_s": "service age, s",
}

WITHIN: Final = 0.1
"""Means that differ by no more than this share of the processes' count as the same."""

FLIGHT_MEASURES: Final = {
    "searches": "searches",
    "found": "robots found by them",
    "uav_contacts": "contacts",
    "uav_contact_s": "time in contact, s",
    "syncs": "syncs, both directions",
    "arrived_kB": "kilobytes, both directions",
    "found_after_mean_s": "wait for a robot that is found, s",
    "comm_mean_s": "time in COMM, s",
    "mission_s": "time until it comes home, s",
    "pose_age_mean_s": "age of poses at the UAV, s",
    "given_age_mean_s": "age of what robots were given, s",
}


class Comparison(NamedTuple):
    """A row against the first row that met the same seeds; or several alike, together.

    Attributes:
        row, base: what they are called.
        pairs: how many pairs of runs.
        weights: the contrast.
    """

    row: str
    base: str
    pairs: int
    weights: Weights


def compared(runs: Runs) -> list[Comparison]:
    """Every row against the first one with the same seeds; then all that differ alike together."""
    experiment = runs.experiment
    bases: dict[int, Row] = {}
    alike: dict[str, list[tuple[Row, Row]]] = {}
    found = []
    for row in experiment.rows:
        base = bases.setdefault(experiment.seed(row, 0), row)
        pairs = len(runs.numbers(row, base))
        if base is not row and pairs > 1:
            found.append(Comparison(row.label, base.label, pairs, [(1.0, row), (-1.0, base)]))
            change = [[value_of(own.settings, k) for k in experiment.paired] for own in (row, base)]
            alike.setdefault(canonical(change), []).append((row, base))
    keys = [key for key in experiment.varied if key in experiment.paired]
    for both in alike.values():
        if len(both) > 1:
            names = [f"{words(own.settings, keys)}, all" for own in both[0]]
            weights = [
                (sign / len(both), own)
                for pair in both
                for sign, own in zip((1, -1), pair, strict=True)
            ]
            pairs = sum(len(runs.numbers(*pair)) for pair in both)
            found.append(Comparison(names[0], names[1], pairs, weights))
    return found


def as_rows(runs: Runs, comparisons: Sequence[Comparison]) -> list[list[str]]:
    """The comparisons as they are read: the heads, then the cells of each.

    A difference with its interval, which holds together with those of the other rows, and how large
    one is that so many pairs tell from 0.
    """
    measures = {key: told for key, told in MEASURES.items() if runs.has(key)}
    rows = [["row", "against", "pairs", *measures.values()]]
    for one in comparisons:
        cells = [one.row, one.base, str(one.pairs)]
        for measure in measures:
            effect, tests = runs.effect(one.weights, measure), len(comparisons)
            value, low, high = effect.interval(tests)
            told = f"{value:+.1f} [{low:+.1f}, {high:+.1f}]; detectable: "
            known = not math.isnan(value)
            cells.append(f"{told}{effect.detectable(tests):.1f}" if known else "unknown")
        rows.append(cells)
    return rows


class Likeness(NamedTuple):
    """A measure in both simulations: means of logarithms, and how many times the second it is."""

    name: str
    here: float
    processes: float
    ratio: Interval

    @property
    def within(self) -> Literal["yes", "no", "open"]:
        """Whether it is `WITHIN`; "open": the interval is neither within nor outside."""
        _, low, high = self.ratio
        if low >= 1 - WITHIN and high <= 1 + WITHIN:
            return "yes"
        return "no" if low > 1 + WITHIN or high < 1 - WITHIN else "open"


def likeness(experiment: Experiment, records: Sequence[Record]) -> list[Likeness]:
    """Whether experiments come to what processes do: missions flown in both; none if none were.

    Flights of one seed meet the same patrols and fading, so they are compared in pairs.
    """
    runs = Runs(experiment, records)
    here, there = (
        [row for row in rows_with(experiment.rows, {"world": world}) if runs.numbers(row)]
        for world in ("mission", "processes")
    )
    if not here or not there:
        return []

    def factor(key: str, weights: Weights) -> Interval:
        found = runs.effect(weights, key, ratio=True).interval()
        return Interval(*map(math.exp, found))

    ours, theirs = ([(1 / len(rows), row) for row in rows] for rows in (here, there))
    return [
        Likeness(
            name,
            factor(key, ours).value,
            factor(key, theirs).value,
            factor(key, [*ours, *((-weight, row) for weight, row in theirs)]),
        )
        for key, name in FLIGHT_MEASURES.items()
    ]


def likeness_table(found: Sequence[Likeness]) -> str:
    """Both simulations side by side, for a document; empty if they were not compared."""
    if not found:
        return ""
    lines = ["| per mission, geometric means | experiments | processes | ratio | within 10 % |"]
    lines += ["|---|---:|---:|---:|---|"]
    for one in found:
        ratio, low, high = one.ratio
        lines.append(
            f"| {one.name} | {one.here:.1f} | {one.processes:.1f} | {ratio:.2f} ({low:.2f} to "
            f"{high:.2f}) | {one.within} |"
        )
    return "\n".join(lines)
