"""Statistics of a flight, from the same events that the controller received."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Final

from air_router.controller.model import (
    Action,
    AirspaceChanged,
    ControlHolder,
    Event,
    Finish,
    MissionWaits,
    PlanRenewed,
    RenewPlan,
    State,
    StateChanged,
)
from air_router.errors import ExitCode
from air_router.flight.limits import CHANGES_KEPT, OFF_GROUND_M, TRACK_STEP_M, WAY_STEP_M
from air_router.gossip import Interactions, Mapper
from air_router.mission import Mission
from air_router.vehicle import REBOOT_S, Telemetry
from geo.airspace import Airspace
from geo.frame import Point
from mocha_link.links import Direction, LinkEvent, SyncEnded

_GOES_ON: Final = MissionWaits(None)


@dataclass(slots=True)
class FlightStats:
    """Collects the statistics of a flight; `report` makes the object that `--json` prints.

    Attributes:
        changes: The latest changes of state, more than occur between two polls of a program, also
            in a fast simulation. `changed` counts all.
    """

    flown: FlownTrack  # the track, its length and distances
    mapper: Mapper  # the map of this UAV
    found: dict[str, int]  # searches that found the robot, by robot
    map_shares: dict[str, float] = field(default_factory=dict)  # at the last meeting, 0 to 1
    interactions: Interactions = field(default_factory=Interactions)
    states: list[State] = field(default_factory=list)  # in the order of their first time
    # robot, and the vehicle's position
    meetings: list[tuple[str, Point]] = field(default_factory=list)
    changes: deque[StateChanged] = field(default_factory=partial(deque, maxlen=CHANGES_KEPT))
    changed: int = 0
    # seconds of each wait that is over, by the blocking row
    _waited_s: dict[str, list[float]] = field(default_factory=dict)
    _waits: MissionWaits = _GOES_ON  # the wait in progress, if any
    _highest_m: float = 0.0  # above home
    _now_s: float = 0.0  # vehicle's clock

    @classmethod
    def of(cls, mission: Mission, mapper: Mapper, robots: Iterable[str]) -> FlightStats:
        """Start the statistics of a flight; syncs with other robots count only as interactions."""
        return cls(FlownTrack(mission), mapper, dict.fromkeys(robots, 0))

    def step(self, event: Event, actions: Iterable[Action], now_s: float) -> None:
        """Take in what happened, and what was decided on it."""
        self.flown.event(event, now_s)
        self._now_s = self.flown.now_s
        if isinstance(event, LinkEvent):
            self.interactions.take(self._now_s, event)
        match event:
            case SyncEnded(peer=peer, direction=Direction.OUT) if self.mapper.known_cells:
                held = self.mapper.published_before(self.interactions.syncs[-1].from_s)
                self.map_shares[peer] = held / self.mapper.known_cells
            case Telemetry(altitude_m=altitude_m):
                self._highest_m = max(self._highest_m, altitude_m)
        for action in actions:
            self.flown.action(action)
            if isinstance(action, StateChanged):
                self._state_changed(action)
            elif isinstance(action, MissionWaits):
                self._waits_for(action)

    def report(
        self, outcome: str, unix_s: float, stamps_s: Mapping[str, float] = MappingProxyType({})
    ) -> dict[str, object]:
        """The flight as one plain object.

        Args:
            outcome: How it ended.
            unix_s: The vehicle's time.
            stamps_s: By robot, the stamp of its newest message that we hold.
        """
        return {
            "outcome": outcome,
            "states_visited": [state.name for state in self.states],
            **self.flown.totals(self.flown.closest_approach()),
            "robots": {
                name: {
                    "found": found,
                    **self.interactions.totals(name),
                    "newest_age_s": _rounded(_age_s(stamps_s.get(name), unix_s), 1),
                    "map_share": _rounded(self.map_shares.get(name), 3),
                }
                for name, found in self.found.items()
            },
            "interactions": self.interactions.counts(),
            "waits": {
                row: {"times": len(spans), "total_s": round(sum(spans), 1)}
                for row, spans in self._all_waits_s().items()
            },
        }

    @property
    def flew(self) -> bool:
        """Whether the vehicle left the ground by more than the noise of its estimate."""
        return self._highest_m > OFF_GROUND_M

    def _waits_for(self, change: MissionWaits) -> None:
        """Note another blocking row of `INTERLOCKS`, or that the mission resumes."""
        self._waited_s = self._all_waits_s()
        self._waits = change

    def _all_waits_s(self) -> dict[str, list[float]]:
        """Seconds of each wait, by the blocking row; the last one lasts until now."""
        row = self._waits.interlock
        if row is None:
            return self._waited_s
        spans = [*self._waited_s.get(row, ()), self._now_s - self._waits.since_s]
        return {**self._waited_s, row: spans}

    def _state_changed(self, change: StateChanged) -> None:
        self.changes.append(change)
        self.changed += 1
        if change.target not in self.states:
            self.states.append(change.target)
        if change.target is State.COMM and change.robot in self.found:
            self.found[change.robot] += 1
            if self.flown.points:
                self.meetings.append((change.robot, self.flown.points[-1]))


def _age_s(stamp_s: float | None, unix_s: float) -> float | None:
    return None if stamp_s is None else max(0.0, unix_s - stamp_s)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


# The result of a flight, for the program that started it.


@dataclass(frozen=True, slots=True)
class FlightResult:
    """How a flight ended.

    Attributes:
        report: What `--json` prints.
        track: The flown track, in the mission's meters.
        meetings: The robots it found, and its positions then.
    """

    outcome: str  # as text
    exit_code: ExitCode
    report: dict[str, object]
    track: tuple[Point, ...]
    meetings: tuple[tuple[str, Point], ...] = ()


def ending_of(finish: Finish, aborted_why: str | None = None) -> tuple[str, ExitCode]:
    """The outcome as text, and the exit code, of a flight that the controller has finished.

    Args:
        finish: The controller's last action.
        aborted_why: Why the mission ended before take-off; None: it flew.
    """
    match finish:
        case Finish(landed_by_us=True) if aborted_why is not None:
            return f"ended: {aborted_why}", ExitCode.ENDED_OTHERWISE
        case Finish(landed_by_us=True):
            return "done", ExitCode.DONE
        case Finish(refused=True):
            return f"refused: {finish.why}", ExitCode.REFUSED
        case Finish(taken_by=ControlHolder.PILOT):
            return "pilot", ExitCode.PILOT_TOOK_OVER
        case Finish(taken_by=ControlHolder.FAILSAFE):
            return "failsafe", ExitCode.ENDED_OTHERWISE
        case _:
            return f"ended: {finish.why}", ExitCode.ENDED_OTHERWISE


# The flown track, its length, and its distance to zones and fences.


@dataclass(slots=True)
class FlownTrack:
    """Follows the controller's events and actions, live or from a record.

    Attributes:
        mission: The mission with the current zones and fences.
        points: The vehicle's positions in the air.
        distance_m: Their length, without the drift of a hovering vehicle.
        armed_s: When it was first armed, on its clock; None: never.
        ours: This program commands it, not a pilot.
        now_s: The newest time received, on its clock.
    """

    mission: Mission
    points: list[Point] = field(default_factory=list)
    distance_m: float = 0.0
    _counted: Point | None = None  # up to which point the distance counts
    armed_s: float | None = None
    ours: bool = True
    now_s: float = 0.0
    _changed: Mission | None = None  # the mission with zones not in force yet
    _uploading: bool = False  # the controller refuses other zones until the plan is renewed
    _parts: list[tuple[Airspace, list[Point]]] = field(default_factory=list)  # points by airspace

    def __post_init__(self) -> None:
        self._begin_part()

    def event(self, event: Event, now_s: float) -> None:
        """Handle an event."""
        if self.armed_s is None and now_s < self.now_s - REBOOT_S:
            self.now_s = now_s  # a vehicle may reboot before take-off
        self.now_s = max(self.now_s, now_s)
        match event:
            case Telemetry(armed=True):
                self._fly(event)
            case AirspaceChanged(fences=fences, zones=zones) if not self._uploading:
                self._changed = self.mission.with_areas(fences, zones)
            case PlanRenewed():
                self._uploading = False
                if self._changed is not None:  # from here on; before it is left
                    self.mission, self._changed = self._changed, None
                    self._begin_part()

    def action(self, action: Action) -> None:
        """Handle an action."""
        if isinstance(action, RenewPlan):
            self._uploading = True
        elif isinstance(action, StateChanged):
            before, self.ours = self.ours, action.target is not State.PASSIVE
            if self.ours and not before:
                self._begin_part()

    @property
    def duration_s(self) -> float:
        """Seconds on the vehicle's clock since it was first seen armed."""
        return 0.0 if self.armed_s is None else self.now_s - self.armed_s

    def closest_approach(self) -> tuple[float, str] | None:
        """The closest distance of the flown track to a zone or fence, and its name.

        Only while this program commanded the vehicle. None without a track, or without zones and
        fence.
        """
        closest = [airspace.track_distance_m(part) for airspace, part in self._parts if part]
        closest_m, what = min(closest, default=(0.0, ""))
        return (closest_m, what) if what else None

    def totals(self, closest: tuple[float, str] | None) -> dict[str, object]:
        """The totals as plain data; `closest`: the result of `closest_approach`."""
        closest_m, closest_to = closest or (None, None)
        return {
            "duration_s": round(self.duration_s, 1),
            "distance_m": round(self.distance_m, 1),
            "clearance_m": self.mission.planner.clearance_m,
            "closest_approach_m": _rounded(closest_m, 2),
            "closest_approach_to": closest_to,
        }

    def _begin_part(self) -> None:
        self._parts.append((self.mission.airspace, []))

    def _fly(self, telemetry: Telemetry) -> None:
        place = telemetry.position
        if self.armed_s is None:
            self.armed_s = self.now_s
        if not telemetry.in_air or not all(map(math.isfinite, place)):
            return
        step_m = math.dist(self.points[-1], place) if self.points else 0.0
        if self.points and step_m < TRACK_STEP_M:
            return
        self.points.append(place)
        way_m = math.dist(self._counted or place, place)
        if self._counted is None or way_m >= WAY_STEP_M:
            self.distance_m += way_m
            self._counted = place
        if self.ours:
            self._parts[-1][1].append(place)
