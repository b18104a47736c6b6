"""Where a vehicle flew, how far, and how near it came to what it was to keep away from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from air_router.controller.model.actions import Action, RenewPlan, StateChanged
from air_router.controller.model.events import AirspaceChanged, Event, PlanRenewed
from air_router.controller.model.states import State
from air_router.mission.mission import Mission
from air_router.vehicle.vehicle import Telemetry
from geo.airspace.airspace import Airspace
from geo.frame import Point

CHANGES_TRACK: Final = (RenewPlan, StateChanged)
"""The actions that `FlownTrack.action` knows."""

TRACK_STEP_M: Final = 0.05
"""Positions closer than this to the last one add nothing to a track but noise."""


@dataclass(slots=True)
class FlownTrack:
    """Takes in what the controller heard and decided, live or out of a record.

    Attributes:
        mission: With the zones and fences that it has by now.
        points: Where the vehicle was in the air.
        distance_m: Along them.
        armed_s: When it was first seen armed, on its clock; None if it was not.
        ours: It is flown by us, not by a pilot.
    """

    mission: Mission
    points: list[Point] = field(default_factory=list)
    distance_m: float = 0.0
    armed_s: float | None = None
    ours: bool = True
    _now_s: float = 0.0  # vehicle's clock
    _changed: Mission | None = None  # mission whose zones are not in force yet
    _boarding: bool = False  # until the plan is renewed the controller refuses other zones
    _parts: list[tuple[Airspace, list[Point]]] = field(default_factory=list)  # of each airspace

    def __post_init__(self) -> None:
        self._begin_part()

    def event(self, event: Event, now_s: float) -> None:
        """Take in what happened."""
        self._now_s = max(self._now_s, now_s)
        match event:
            case Telemetry(armed=True):
                self._fly(event)
            case AirspaceChanged(fences=fences, zones=zones) if not self._boarding:
                self._changed = self.mission.with_areas(fences, zones)
            case PlanRenewed():
                self._boarding = False
                if self._changed is not None:  # from here on; before it is left
                    self.mission, self._changed = self._changed, None
                    self._begin_part()

    def action(self, action: Action) -> None:
        """Take in what was decided."""
        if isinstance(action, RenewPlan):
            self._boarding = True
        elif isinstance(action, StateChanged):
            before, self.ours = self.ours, action.target is not State.PASSIVE
            if self.ours and not before:
                self._begin_part()

    @property
    def duration_s(self) -> float:
        """Seconds on the vehicle's clock since it was first seen armed."""
        return 0.0 if self.armed_s is None else self._now_s - self.armed_s

    def closest_approach(self) -> tuple[float, str] | None:
        """Closest distance of the flown track to any zone or fence border, and to which.

        While it was ours: what others fly is theirs. None without a track, and for a mission
        without zones and fence.
        """
        closest = [airspace.track_distance_m(part) for airspace, part in self._parts if part]
        closest_m, what = min(closest, default=(0.0, ""))
        return (closest_m, what) if what else None

    def _begin_part(self) -> None:
        self._parts.append((self.mission.airspace, []))

    def _fly(self, telemetry: Telemetry) -> None:
        place = telemetry.position
        if self.armed_s is None:
            self.armed_s = self._now_s
        if not telemetry.in_air or not all(map(math.isfinite, place)):
            return
        step_m = math.dist(self.points[-1], place) if self.points else 0.0
        if self.points and step_m < TRACK_STEP_M:
            return
        self.distance_m += step_m
        self.points.append(place)
        if self.ours:
            self._parts[-1][1].append(place)
