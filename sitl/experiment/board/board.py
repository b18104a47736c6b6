"""Standings: what a policy came to on the test set, compared with round robin by scenario."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import fmean, stdev
from typing import Final

from air_router.errors import AirRouterError, ExitCode
from air_router.files import write_whole
from sitl.experiment import Record
from sitl.experiment.analysis import student_t

BASELINE: Final = "round_robin"
"""What others are compared with."""

AGE: Final = "service_age_mean_s"
GOALS: Final = "goal_rate_area_percent"
MAP: Final = "map_known_percent"


class BoardError(AirRouterError):
    """A file of standings cannot be read."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class Standing:
    """A line of the leaderboard; all values are text, as the file has them.

    Attributes:
        policy: Its name.
        test_set: Which test set, and its fingerprint.
        goals_percent: Mean share of the goals over time, of all scenarios.
        goals_gain_points: What round robin's is less, with the 95 % interval over scenarios.
        age_s: Mean service age.
        age_ratio: The factor by which it is round robin's (geometric mean), with its interval.
        map_percent: Mean share of the town on the first UAV's map at the end.
        failed: In how many scenarios the policy failed.
        digest: Of all its runs: the same digest is the same result.
        program, commit, constraints: What made the runs.
    """

    policy: str
    test_set: str
    goals_percent: str
    goals_gain_points: str
    age_s: str
    age_ratio: str
    map_percent: str
    failed: str
    digest: str
    program: str
    commit: str
    constraints: str


def standing(
    policy: str, test_set: str, records: Sequence[Record], baseline: Sequence[Record]
) -> Standing:
    """What a policy came to.

    Args:
        policy: Its name.
        test_set: Which test set, and its fingerprint.
        records: Its runs, one for each scenario.
        baseline: Those of `BASELINE`, of the same scenarios in the same order.
    """
    own, others = (_columns(each) for each in (records, baseline))
    gains = [a - b for a, b in zip(own[GOALS], others[GOALS], strict=True)]
    ratios = [math.log(a / b) for a, b in zip(own[AGE], others[AGE], strict=True)]
    digest = hashlib.sha256("".join(record["digest"] for record in records).encode())
    compared = policy != BASELINE
    mean, low, high = _interval(ratios)
    return Standing(
        policy=policy,
        test_set=test_set,
        goals_percent=f"{fmean(own[GOALS]):.1f}",
        goals_gain_points="{:+.1f} [{:+.1f}, {:+.1f}]".format(*_interval(gains)) * compared,
        age_s=f"{fmean(own[AGE]):.0f}",
        age_ratio=f"{math.exp(mean):.2f} [{math.exp(low):.2f}, {math.exp(high):.2f}]" * compared,
        map_percent=f"{fmean(own[MAP]):.1f}",
        failed=str(sum(bool(record["faults"]) for record in records)),
        digest=digest.hexdigest()[:12],
        program=_all(record["program"] for record in records),
        commit=_all(record["commit"] for record in records),
        constraints=_all(record["dependencies"]["constraints"] for record in records),
    )


def _columns(records: Sequence[Record]) -> Mapping[str, list[float]]:
    return {key: [record["measures"][key] for record in records] for key in (AGE, GOALS, MAP)}


def _interval(values: Sequence[float]) -> tuple[float, float, float]:
    """The mean with its 95 % interval: scenarios are the sample."""
    mean, count = fmean(values), len(values)
    half = student_t(0.975, count - 1) * stdev(values) / math.sqrt(count) if count > 1 else math.inf
    return mean, mean - half, mean + half


def _all(values: object) -> str:
    return " ".join(sorted(set(values)))  # type: ignore[call-overload]


def read_board(path: Path) -> list[Standing]:
    """The standings of a file; none if it is not there. Raises BoardError."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    names = {each.name for each in fields(Standing)}
    if rows and rows[0].keys() != names:
        raise BoardError(f"{path} has no standings; give another file, or remove it")
    return [Standing(**row) for row in rows]


def write_board(path: Path, standings: Sequence[Standing]) -> None:
    """Write a file of standings, test set by test set."""
    text = io.StringIO()
    rows = sorted(standings, key=lambda own: (own.test_set, *_rank(own)))
    writer = csv.DictWriter(text, [each.name for each in fields(Standing)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(map(asdict, rows))
    write_whole(path, text.getvalue(), replace=True)


_SHOWN: Final = {
    "policy": "policy",
    "goals_percent": "goals over time %",
    "goals_gain_points": "points more than round robin",
    "age_s": "service age s",
    "age_ratio": "of round robin's",
    "map_percent": "map %",
    "failed": "failed in",
}


def _rank(own: Standing) -> tuple[float, float, str]:
    """What the mission is for comes first: more goals sooner, then younger data."""
    return -float(own.goals_percent), float(own.age_s), own.policy


def table_text(standings: Sequence[Standing]) -> str:
    """The leaderboard for a terminal."""
    cells = [list(_SHOWN.values())]
    for own in sorted(standings, key=_rank):
        values = asdict(own)
        cells.append([values[key] for key in _SHOWN])
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in cells
    ]
    return "\n".join(line.rstrip() for line in lines)
