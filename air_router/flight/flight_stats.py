"""What a flight achieved, added up from the same events that the controller saw."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.actions import Action, RenewPlan, StateChanged
from air_router.controller.model.events import AirspaceChanged, Event, PlanRenewed
from air_router.controller.model.states import State
from air_router.gossip.mapper import Mapper
from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import Telemetry
from geo.airspace.airspace import Airspace
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted, SyncTimedOut

TRACK_STEP_M: Final = 0.05
"""Positions closer than this to the last one add nothing to a track but noise."""


@dataclass(slots=True)
class RobotStats:
    """What passed between the UAV and one robot.

    Attributes:
        found: How often a search for it ended with its being heard.
        syncs_in: Completed pulls of ours from it; `bytes_in` their payload.
        syncs_out: Completed pulls of its from us; `bytes_out` their payload.
        map_share: Share (0..1) of the cells painted before the last completed contact that the
            map version it pulled then has; None without a contact.
    """

    found: int = 0
    syncs_in: int = 0
    syncs_out: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    newest_stamp_s: float | None = None
    map_share: float | None = None
    pull_began_s: float | None = None


@dataclass(slots=True)
class FlightStats:
    """Adds a flight up; `report` makes the object that `--json` prints."""

    mission: Mission
    mapper: Mapper
    robots: dict[str, RobotStats]
    states: list[State] = field(default_factory=list)
    track: list[Point] = field(default_factory=list)
    meetings: list[tuple[str, Point]] = field(default_factory=list)
    distance_m: float = 0.0
    started: int = 0
    completed: int = 0
    partial: int = 0
    timed_out: int = 0
    _changed: Airspace | None = None
    _boarding: bool = False  # until the plan is renewed the controller refuses other zones
    _renewed: list[tuple[int, Airspace]] = field(default_factory=list)
    _ours_until: int | None = None
    _began_s: float | None = None
    _now_s: float = 0.0

    def event(self, event: Event, now_s: float) -> None:
        """Take in what happened."""
        self._now_s = max(self._now_s, now_s)
        match event:
            case Telemetry(armed=True):
                self._fly(event)
            case SyncStarted(peer=peer, direction=direction):
                self.started += 1
                if direction is Direction.OUT and peer in self.robots:
                    self.robots[peer].pull_began_s = self._now_s
            case SyncEnded(complete=complete):
                self.completed += complete
                self.partial += not complete
                self._synced(event)
            case SyncTimedOut():
                self.timed_out += 1
            case AirspaceChanged(fences=fences, zones=zones) if not self._boarding:
                self._changed = self.mission.with_areas(fences, zones).airspace
            case PlanRenewed():
                self._boarding = False
                if self._changed is not None:  # from here on; before it is left
                    self._renewed.append((len(self.track), self._changed))
                    self._changed = None

    def action(self, action: Action) -> None:
        """Take in what was decided."""
        if isinstance(action, RenewPlan):
            self._boarding = True
        if isinstance(action, StateChanged):
            if action.target not in self.states:
                self.states.append(action.target)
            if action.target is State.PASSIVE:
                self._ours_until = len(self.track)
            if action.target is State.COMM and action.robot in self.robots:
                self.robots[action.robot].found += 1
                if self.track:
                    self.meetings.append((action.robot, self.track[-1]))

    @property
    def duration_s(self) -> float:
        """Seconds on the vehicle's clock since it was first seen armed."""
        return self._now_s - self._began_s if self._began_s is not None else 0.0

    def closest_approach(self) -> tuple[float, str] | None:
        """Closest distance of the flown track to any zone or fence border, and to which.

        Up to a takeover: what others fly then is theirs. None without a track, and for a mission
        without zones and fence.
        """
        ours = self.track[: self._ours_until]
        begins = [0, *(begin for begin, _ in self._renewed)]
        airspaces = [self.mission.airspace, *(airspace for _, airspace in self._renewed)]
        closest = [
            airspace.track_distance_m(ours[begin:end])
            for begin, end, airspace in zip(begins, [*begins[1:], None], airspaces, strict=True)
            if ours[begin:end]
        ]
        closest_m, what = min(closest, default=(0.0, ""))
        return (closest_m, what) if what else None

    def report(self, outcome: str, unix_s: float) -> dict[str, object]:
        """The flight as one plain object; ages are against `unix_s`, the vehicle's time."""
        closest = self.closest_approach()
        return {
            "outcome": outcome,
            "states_visited": [state.name for state in self.states],
            "duration_s": round(self.duration_s, 1),
            "distance_m": round(self.distance_m, 1),
            "clearance_m": self.mission.planner.clearance_m,
            "closest_approach_m": None if closest is None else round(closest[0], 2),
            "closest_approach_to": None if closest is None else closest[1],
            "robots": {
                name: {
                    "found": robot.found,
                    "syncs_in": robot.syncs_in,
                    "syncs_out": robot.syncs_out,
                    "bytes_in": robot.bytes_in,
                    "bytes_out": robot.bytes_out,
                    "newest_age_s": _rounded(_age_s(robot.newest_stamp_s, unix_s), 1),
                    "map_share": _rounded(robot.map_share, 3),
                }
                for name, robot in self.robots.items()
            },
            "interactions": {
                "started": self.started,
                "completed": self.completed,
                "partial": self.partial,
                "timed_out": self.timed_out,
            },
        }

    def _fly(self, telemetry: Telemetry) -> None:
        if self._began_s is None:
            self._began_s = self._now_s
        if not telemetry.in_air:
            return
        if not self.track:
            self.track.append(telemetry.position)
            return
        step_m = math.dist(self.track[-1], telemetry.position)
        if step_m >= TRACK_STEP_M:
            self.distance_m += step_m
            self.track.append(telemetry.position)

    def _synced(self, event: SyncEnded) -> None:
        robot = self.robots.get(event.peer)
        if robot is None:
            return
        if event.direction is Direction.IN:
            robot.syncs_in += 1
            robot.bytes_in += event.bytes
            return
        robot.syncs_out += 1
        robot.bytes_out += event.bytes
        if self.mapper.known_cells and robot.pull_began_s is not None:
            held = self.mapper.published_before(robot.pull_began_s)
            robot.map_share = held / self.mapper.known_cells


def _age_s(stamp_s: float | None, unix_s: float) -> float | None:
    return None if stamp_s is None else max(0.0, unix_s - stamp_s)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
