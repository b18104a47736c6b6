"""What a flight of a mission in its own world came to, as its UAV's controller saw it.

All is counted from the moment when it begins INIT to its decision to come home.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from air_router.controller.model import (
    Action,
    CompanionLagged,
    Event,
    RobotPose,
    State,
    StateChanged,
)
from mocha_link.links import ContactBegan, ContactEnded, Direction, SyncEnded, SyncStarted
from sitl.experiment import EventLog, EventQueue
from sitl.experiment.engine.ages import mean_age_s


class Goals(NamedTuple):
    """The goals of exploring robots: how many, and the Unix seconds at which each was found."""

    total: int = 0
    found_s: Sequence[float] = ()


NO_GOALS: Final = Goals()

Measures = dict[str, float | None]


class Meter(EventLog):
    """Counts a controller's events and decisions, as they happen or from a flight's record.

    Attributes:
        longest_lag_s: The longest reported lag of the flight program since INIT began: one stall,
            or the sum of short lags; 0: none.
    """

    def __init__(self, queue: EventQueue) -> None:
        super().__init__(queue)
        self.longest_lag_s = 0.0
        self._counts = dict.fromkeys(("searches", "found", "uav_contacts", "syncs"), 0)
        self._contact_s = 0.0
        self._since: dict[State, float] = {}  # when each state was entered last
        self._waits_s: list[float] = []  # of searches that ended in COMM
        self._comms_s: list[float] = []  # of visits
        self._unix_less_s = 0.0  # Unix time of the node, less the flight's
        self._updates: dict[tuple[str, str], list[tuple[float, float]]] = {}  # when, of when

    def event(self, uav: str, event: Event) -> None:
        """A controller receives an event."""
        super().event(uav, event)
        self.take(self._queue.now_s, event)

    def action(self, uav: str, action: Action) -> None:
        """A controller decides on an action."""
        super().action(uav, action)
        self.take(self._queue.now_s, action)

    def take(self, now_s: float, what: Event | Action) -> None:
        """Count what happened or was decided at a time."""
        counts = self._counts
        match what:
            case ContactBegan():
                counts["uav_contacts"] += 1
            case ContactEnded(duration_s=duration_s):
                self._contact_s += duration_s
            case SyncStarted(at_s=at_s):
                self._unix_less_s = at_s - now_s
            case SyncEnded(peer=peer, direction=direction, complete=complete):
                counts["syncs"] += 1
                if complete and direction is Direction.OUT:
                    self._updates.setdefault(("given", peer), []).append((now_s, now_s))
            case RobotPose(robot=robot, stamp_s=stamp_s):
                poses = self._updates.setdefault(("pose", robot), [])
                true_s = stamp_s - self._unix_less_s
                if not poses or true_s > poses[-1][1]:
                    poses.append((now_s, true_s))
            case CompanionLagged(lag_s=lag_s) if State.INIT in self._since:
                self.longest_lag_s = max(self.longest_lag_s, lag_s)
            case StateChanged(source=source, target=target):
                self._changed(now_s, source, target)

    def _changed(self, now_s: float, source: State, target: State) -> None:
        if source is State.COMM:
            self._comms_s.append(now_s - self._since[source])
        if target is State.COMM:
            self._counts["found"] += 1
            self._waits_s.append(now_s - self._since[State.SEARCH])
        self._counts["searches"] += target is State.SEARCH
        self._since[target] = now_s

    def measures(
        self, robots: Collection[str], arrived_bytes: Iterable[int], goals: Goals = NO_GOALS
    ) -> Measures:
        """What it came to, by columns.

        Args:
            robots: On the ground.
            arrived_bytes: Of each of the UAV's links.
            goals: Of exploring robots; without any there are no columns of goals.
        """
        home_s = self._since[State.HOME]
        ages_s = {
            what: float(np.mean([self._age_s(what, robot) for robot in robots]))
            for what in ("pose", "given")
        }
        return {
            **self._counts,
            "uav_contact_s": self._contact_s,
            "arrived_kB": sum(arrived_bytes) / 1e3,
            "found_after_mean_s": float(np.mean(self._waits_s)) if self._waits_s else None,
            "comm_mean_s": float(np.mean(self._comms_s)) if self._comms_s else None,
            "mission_s": home_s - self._since[State.INIT],
            **self._of(goals, home_s),
            "pose_age_mean_s": ages_s["pose"],
            "given_age_mean_s": ages_s["given"],
            "exchange_age_mean_s": (ages_s["pose"] + ages_s["given"]) / 2,
        }

    def _of(self, goals: Goals, home_s: float) -> Measures:
        if not goals.total:
            return {}
        found = sum(found_s - self._unix_less_s < home_s for found_s in goals.found_s)
        return {"goals_total": goals.total, "goals_found": found}

    def _age_s(self, what: str, robot: str) -> float:
        began_s, home_s = self._since[State.INIT], self._since[State.HOME]
        updates = [entry for entry in self._updates.get((what, robot), ()) if entry[0] < home_s]
        held = np.array([(began_s, began_s), *updates]) - began_s
        held[:, 0] = np.maximum(held[:, 0], 0.0)  # what came on the ground is held from the start
        return mean_age_s(held, home_s - began_s)
