"""Whether experiments come to what the simulation in processes does. Needs SciPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from sitl.experiment.analysis.effects import Runs, Weights
from sitl.experiment.analysis.statistics import Interval
from sitl.experiment.campaign.plan import Experiment, Record
from sitl.experiment.campaign.rows import rows_with

WITHIN: Final = 0.1
"""Means that differ by no more than this share of the processes' count as the same."""

_COLUMNS: Final = {
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
    """The measures of missions flown in both; none where there are not any.

    Flights of one seed meet the same patrols and fading, so they are compared in pairs.
    """
    runs = Runs(experiment, records)
    here, there = (
        [row for row in rows_with(experiment.rows, {"world": world}) if runs.numbers(row)]
        for world in ("mission", "processes")
    )
    if not here or not there:
        return []

    def compared(key: str, weights: Weights) -> Interval:
        found = runs.effect(weights, key, ratio=True).interval()
        return Interval(*map(math.exp, found))

    ours, theirs = ([(1 / len(rows), row) for row in rows] for rows in (here, there))
    return [
        Likeness(
            name,
            compared(key, ours).value,
            compared(key, theirs).value,
            compared(key, [*ours, *((-weight, row) for weight, row in theirs)]),
        )
        for key, name in _COLUMNS.items()
    ]


def as_markdown(found: Sequence[Likeness]) -> str:
    """The comparison for a document; empty if there is none."""
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
