"""The flight at one moment, as pages, the terminal, programs and records show it."""

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
    """What is known of a robot that may be sought.

    Attributes:
        position: Of its newest pose, metres east/north; None: no pose was received.
        age_s: The age of that pose; None: no pose was received.
    """

    position: Point | None = None
    age_s: float | None = None


@dataclass(frozen=True, slots=True)
class AirspaceStatus:
    """The zones and fences in force.

    Attributes:
        revision: Counts the changes of zones and fences, from 1 on.
        zones: How many no-fly zones apply at the flight's altitudes and hours.
        change: How far a change of zones is; None: none is under way.
    """

    revision: int
    zones: int
    change: ZoneChange | None = None


@dataclass(frozen=True, slots=True)
class FlightStatus:
    """A picture of the flight: nothing in it changes any more. Positions are metres east/north.

    The terminal line, pages, programs, ROS 2 and records read this, and nothing else of the
    controller.

    Attributes:
        time_s: When it was made, on the vehicle's clock.
        state: What the mission is doing.
        robot: Who is sought or hovered over; None: no robot is.
        targets: The robots that may be sought, by name.
        left_s: Seconds until the state's timer ends; None: it does not run.
        goal: Where the vehicle is sent; None: nowhere.
        legs: What is left of the way there, the leg under way first.
        points_left: Requested points that are still to be flown to.
        waypoints_left: Waypoints that are still to be explored.
        no_way_home: Zones leave no way home.
        interlocks: The rows of `INTERLOCKS` that are raised; the first decides.
        waiting: The verdict on the motion that the mission wants: the row that keeps it back, the
            reason and since when; None: nothing keeps it back.
        refusals: Why requests would be refused now, by their verbs.
        alarms: What the pilot has to act on, by what each is about, until it is over.
        need_home: The charge that flying home takes, 0 to 1; None: not known, or it flies there.
        in_charge: The vehicle flies by our commands.
        plan_owner: Whose the plan on board is.
        airspace: The zones and fences in force.
        silent_s: For how long nothing was received from the vehicle; 0: the link is up.
        missing_inputs: The inputs of the flight that have stopped, in words.
        telemetry: What the vehicle reported last, with the age of each part in `ages`; None:
            nothing was received yet.
        links: Metrics of the link to each peer, as the node measured them last.
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
        """For how long the mission has been kept waiting without a break; 0: it is not."""
        return 0.0 if self.waiting is None else max(self.time_s - self.waiting.since_s, 0.0)
