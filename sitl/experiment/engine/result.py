"""What one simulated run has shown. Data only, small enough to be sent between machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from geo.frame import Point

TRANSMISSION: Final = np.dtype(
    [
        ("ready_s", "f8"),  # when it could have begun, had the channel been free
        ("start_s", "f8"),
        ("end_s", "f8"),
        ("asking", "i2"),  # index in `robots` of who pulls
        ("answering", "i2"),  # of whom it is pulled from
        ("stage", "u1"),  # index in STAGES
        ("messages", "i4"),  # robots' messages in it
        ("bytes", "i8"),  # request and replies; of an interrupted one as far as it came
        ("complete", "?"),
    ]
)
"""One row per transmission. What was interrupted and sent again later has a row for each try, all
with the same `ready_s`."""

STAGES: Final = ("header", "data", "end")

CONTACT: Final = np.dtype([("began_s", "f8"), ("ended_s", "f8"), ("a", "i2"), ("b", "i2")])
"""One row per contact; one that lasts ends with the run."""


class GoalVisit(NamedTuple):
    """A goal that a robot reached for the first time, seconds from the start."""

    goal: str
    time_s: float
    robot: str


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """One run.

    Attributes:
        seed: What it was run with.
        robots: Names, sorted; arrays below have them in this order.
        kinds: What each is: "uav", "ugv" or "base".
        travelled_m: How far each has come.
        goals_total: How many goals the town has.
        goal_places: Id and place of each, in metres east and north.
        goals: Those that were reached, in order of time.
        transmissions: TRANSMISSION rows in order of their end.
        contacts: CONTACT rows in order of their beginning.
        exchanges_complete: Pulls that came to their end.
        exchanges_broken: Pulls that lost contact before their end and were given up.
        exchanges_open: Pulls that were still under way, or waiting, when the run ended.
        sample_times_s: When the following were sampled.
        positions_m: (samples, robots, 2): east, north.
        pose_age_s: (samples, robots, robots): at [i, a, b] the age of the newest pose of b that a
            has, inf while it has none; 0 of itself.
        map_age_s: (samples, robots): the age of the newest map of any UAV that a robot has, inf
            while it has none; 0 for UAVs.
        known_share: (samples,): share of the town's ground that the first UAV's map shows.
        states: (UAV, time, state) for every change of a UAV's mission.
        decisions: How many actions the controllers asked for.
        digest: SHA-256 of the event log, in hex: equal digests are equal runs.
        log: The event log, one JSON object per line; empty unless the settings keep it.
        wall_s: What the run took.
        cpu_s: Processor time of it.
    """

    seed: int
    robots: tuple[str, ...]
    kinds: tuple[str, ...]
    travelled_m: tuple[float, ...]
    goals_total: int
    goal_places: tuple[tuple[str, Point], ...]
    goals: tuple[GoalVisit, ...]
    transmissions: npt.NDArray[np.void]
    contacts: npt.NDArray[np.void]
    exchanges_complete: int
    exchanges_broken: int
    exchanges_open: int
    sample_times_s: npt.NDArray[np.float64]
    positions_m: npt.NDArray[np.float32]
    pose_age_s: npt.NDArray[np.float32]
    map_age_s: npt.NDArray[np.float32]
    known_share: npt.NDArray[np.float32]
    states: tuple[tuple[str, float, str], ...]
    decisions: int
    digest: str
    log: tuple[str, ...]
    wall_s: float
    cpu_s: float

    @property
    def waits_s(self) -> npt.NDArray[np.float64]:
        """The paper's message wait: how long each message that got through waited for the channel.

        From the moment when it was its turn in its own exchange to the beginning of the
        transmission that brought it over. Time out of contact counts where exchanges are held.
        Requests and ends of exchanges are messages too; of several that crossed together each
        has waited.
        """
        rows = self.transmissions[self.transmissions["complete"]]
        waits: npt.NDArray[np.float64] = rows["start_s"] - rows["ready_s"]
        return np.repeat(waits, np.maximum(rows["messages"], 1))

    @property
    def goals_share(self) -> float:
        """Share of the goals that were reached."""
        return len(self.goals) / self.goals_total if self.goals_total else 0.0

    @property
    def mean_time_to_goal_s(self) -> float | None:
        """Mean time at which the goals that were reached were reached; None without any."""
        if not self.goals:
            return None
        return sum(visit.time_s for visit in self.goals) / len(self.goals)

    def bytes_per_bin(self, bin_s: float, duration_s: float) -> npt.NDArray[np.float64]:
        """Bytes that arrived in each `bin_s` of the run: bandwidth over time."""
        edges = np.arange(0.0, duration_s + bin_s, bin_s)
        rows = self.transmissions[self.transmissions["complete"]]
        counts, _ = np.histogram(rows["end_s"], bins=edges, weights=rows["bytes"])
        return counts
