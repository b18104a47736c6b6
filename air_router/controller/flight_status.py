"""The flight at one moment, as pages, the terminal, programs and records show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from air_router.controller.model import Goal, StandingAlarm, State
from air_router.routing import Leg
from air_router.vehicle import Telemetry
from geo.frame import Point


@dataclass(frozen=True, slots=True)
class Waiting:
    """What keeps the mission from what it wants now.

    Attributes:
        interlock: The row of `INTERLOCKS` that decides.
        why: What stands against the motion, in words, as precisely as is known.
        for_s: For how long, without a break.
    """

    interlock: str
    why: str
    for_s: float


@dataclass(frozen=True, slots=True)
class FlightStatus:
    """A picture of the flight: nothing in it changes any more. Positions are metres east/north.

    Attributes:
        state: What the mission is doing.
        robot: Who is sought or hovered over; None: no robot is.
        robots: Where the robots that may be sought were last; None: not known.
        left_s: Seconds until the state's timer ends; None: it does not run.
        goal: Where the vehicle is sent; None: nowhere.
        legs: What is left of the way there, the leg under way first.
        points_left: Requested points that are still to be flown to.
        waypoints_left: Waypoints that are still to be explored.
        no_way_home: Zones leave no way home.
        waiting: What keeps the mission from what it wants; None: nothing does.
        alarms: What the pilot has to act on, by what each is about, until it is over.
        need_home: The charge that flying home takes, 0 to 1; None: not known, or it flies there.
        in_charge: The vehicle flies by our commands.
        telemetry: What the vehicle reported last; None: nothing was received yet.
    """

    state: State
    robot: str | None
    robots: Mapping[str, Point | None]
    left_s: float | None
    goal: Goal | None
    legs: tuple[Leg, ...]
    points_left: int
    waypoints_left: int
    no_way_home: bool
    waiting: Waiting | None
    alarms: Mapping[str, StandingAlarm]
    need_home: float | None
    in_charge: bool
    telemetry: Telemetry | None
