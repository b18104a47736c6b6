"""Rows that met the same seeds, and both simulations, compared run by run. Needs SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from sitl.experiment.analysis.statistics import Interval, Runs, Weights
from sitl.experiment.plan import Row, canonical, rows_with, words
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

    def compare(row: str, base: str, both: Sequence[tuple[Row, Row]]) -> None:
        pairs = sum(len(runs.numbers(*pair)) for pair in both)
        share = 1 / len(both)
        weights = [entry for one, other in both for entry in ((share, one), (-share, other))]
        found.append(Comparison(row, base, pairs, weights))

    for row in experiment.rows:
        base = bases.setdefault(experiment.seed(row, 0), row)
        if base is not row and len(runs.numbers(row, base)) > 1:
            compare(row.label, base.label, [(row, base)])
            change = [[value_of(own.settings, k) for k in experiment.paired] for own in (row, base)]
            alike.setdefault(canonical(change), []).append((row, base))
    keys = [key for key in experiment.varied if key in experiment.paired]
    for both in alike.values():
        if len(both) > 1:
            name, base_name = (f"{words(own.settings, keys)}, all" for own in both[0])
            compare(name, base_name, both)
    return found


def as_rows(runs: Runs) -> list[list[str]]:
    """The comparisons as they are read: the heads, then the cells of each.

    A difference with its interval, which holds together with those of the other rows, and how large
    one is that so many pairs tell from 0.
    """
    comparisons = compared(runs)
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


def within(ratio: Interval) -> Literal["yes", "no", "open"]:
    """Whether a ratio is `WITHIN` of 1; "open": its interval is neither within nor outside."""
    _, low, high = ratio
    if low >= 1 - WITHIN and high <= 1 + WITHIN:
        return "yes"
    return "no" if low > 1 + WITHIN or high < 1 - WITHIN else "open"


def likeness(runs: Runs) -> str:
    """Whether experiments come to what processes do: both side by side, for a document.

    Flights of one seed meet the same patrols and fading, so they are compared in pairs. Empty where
    no missions were flown in both.
    """
    here, there = (
        [row for row in rows_with(runs.experiment.rows, {"world": world}) if runs.numbers(row)]
        for world in ("mission", "processes")
    )
    if not here or not there:
        return ""

    def factor(key: str, weights: Weights) -> Interval:
        found = runs.effect(weights, key, ratio=True).interval()
        return Interval(*map(math.exp, found))

    ours, theirs = ([(1 / len(rows), row) for row in rows] for rows in (here, there))
    apart = [*ours, *((-weight, row) for weight, row in theirs)]
    lines = ["| per mission, geometric means | experiments | processes | ratio | within 10 % |"]
    lines += ["|---|---:|---:|---:|---|"]
    for key, name in FLIGHT_MEASURES.items():
        means = " | ".join(f"{factor(key, weights).value:.1f}" for weights in (ours, theirs))
        ratio = factor(key, apart)
        value, low, high = (f"{number:.2f}" for number in ratio)
        lines.append(f"| {name} | {means} | {value} ({low} to {high}) | {within(ratio)} |")
    return "\n".join(lines)
