"""Zones that are drawn while a pretended vehicle flies, and what its flight makes of them."""

import math

from air_router.controller.model.actions import HoldHere, RenewPlan
from air_router.controller.model.events import AirspaceChanged, PlanRenewed
from air_router.controller.model.requests import GoOn
from air_router.vehicle.vehicle import FlightMode
from geo.airspace.airspace import Airspace
from geo.airspace.zone import Zone
from geo.frame import Point

SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def box(centre, half_m=12.0, name="new"):
    east_m, north_m = centre
    return Zone(name, tuple(Point(east_m + half_m * e, north_m + half_m * n) for e, n in SQUARE))


def change(flight, *zones, fences=None):
    mission = flight.mission
    fences = mission.fences if fences is None else fences
    flight.give(AirspaceChanged(fences, (*mission.zones, *zones)))


def boarding(flight):
    return sum(isinstance(action, RenewPlan) for action in flight.actions)


def moves(flight, since):
    return [m for m in flight.motions[since:] if not isinstance(m, HoldHere)]


def ahead(flight, metres):
    speed = math.hypot(*flight.velocity)
    return tuple(
        p + metres * v / speed for p, v in zip(flight.position, flight.velocity, strict=True)
    )


def cruising(pretend, **changes):
    flight = pretend(**{"duration_s": 200.0, **changes})
    flight.take_off()
    flight.fly_until(lambda: math.dist(flight.position, flight.mission.home) > 40.0)
    return flight


def clear_of(flight, zone, since=0):
    return Airspace(None, [zone], 5.0).track_distance_m(flight.track[since:])[0]


def climbing(pretend):
    """A vehicle that climbs to the mission's altitude where a pilot has left it."""
    flight = cruising(pretend)
    flight.pilot_chooses(FlightMode.POSITION)
    flight.altitude_m = 8.0
    flight.pilot_chooses(FlightMode.HOLD)
    flight.fly_for(3.0)
    flight.operator_requests(GoOn())
    flight.fly_for(2.0)
    assert "climbing from 8 to 40 m first" in flight.announced
    return flight


def goes_on_board(flight, limit_s=60.0, why_not=None, *, times=1):
    flight.fly_until(lambda: boarding(flight) == times, limit_s)
    flight.give(PlanRenewed(why_not))
