"""The status of the flight at one moment, for pages, terminal, programs and records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from air_router.controller.model import (
    Goal,
    MissionWaits,
    PlanOwner,
    StandingAlarm,
    State,
    ZoneChange,
)
from air_router.routing import Leg
from air_router.vehicle import Telemetry
from geo.frame import Point
from mocha_link.links import LinkMetrics


@dataclass(frozen=True, slots=True)
class TargetStatus:
    """The last data of a robot that may be sought.

    Attributes:
        position: Its newest pose, meters east/north; None: no pose was received.
        age_s: Age of that pose; None: no pose was received.
    """

    position: Point | None = None
    age_s: float | None = None


@dataclass(frozen=True, slots=True)
class AirspaceStatus:
    """The zones and fences in force.

    Attributes:
        revision: Counts the changes of zones and fences, from 1 on.
        zones: How many no-fly zones apply at the flight's altitudes and hours.
        change: Stage of a change of zones; None: there is none.
    """

    revision: int
    zones: int
    change: ZoneChange | None = None


@dataclass(frozen=True, slots=True)
class FlightStatus:
    """An immutable status of the flight. Positions are meters east/north.

    The status line, pages, programs, ROS 2 and records read only this of the controller.

    Attributes:
        time_s: Time of the status, on the vehicle's clock.
        state: State of the mission.
        robot: The robot that is sought or hovered over; None: none.
        targets: The robots that may be sought, by name.
        left_s: Seconds until the state's timer expires; None: it does not run.
        goal: The vehicle's goal; None: none.
        legs: Remaining legs of the route, the current one first.
        points_left: Number of requested points not reached yet.
        waypoints_left: Number of waypoints not explored yet.
        no_way_home: Zones block every way home.
        interlocks: The rows of `INTERLOCKS` that are raised; the first decides.
        waiting: The interlock that blocks the mission, with the reason and since when; None: none.
        refusals: Why requests would be refused now, by verb.
        alarms: Alarms that last, by subject.
        need_home: Charge needed to fly home, 0 to 1; None: unknown, or coming home already.
        in_charge: This program commands the vehicle in the air.
        plan_owner: Whose the plan on board is.
        airspace: The zones and fences in force.
        silent_s: Time without any message from the vehicle; 0: the link is up.
        missing_inputs: The inputs that have stopped, as text.
        telemetry: The vehicle's last telemetry, with the age of each part in `ages`; None: nothing
            was received yet.
        links: The node's last metrics of the link to each peer.
    """

    time_s: float
    state: State
    robot: str | None
    targets: Mapping[str, TargetStatus]
    left_s: float | None
    goal: Goal | None
    legs: tuple[Leg, ...]
    points_left: int
    waypoints_left: int
    no_way_home: bool
    interlocks: tuple[str, ...]
    waiting: MissionWaits | None
    refusals: Mapping[str, str]
    alarms: Mapping[str, StandingAlarm]
    need_home: float | None
    in_charge: bool
    plan_owner: PlanOwner
    airspace: AirspaceStatus
    silent_s: float
    missing_inputs: tuple[str, ...]
    telemetry: Telemetry | None
    links: Mapping[str, LinkMetrics] = field(default_factory=dict)

    @property
    def waiting_s(self) -> float:
        """How long the mission has been blocked without a break; 0: it is not."""
        return 0.0 if self.waiting is None else max(self.time_s - self.waiting.since_s, 0.0)
