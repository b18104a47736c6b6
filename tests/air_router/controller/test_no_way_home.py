"""Zones that are drawn between the vehicle and its home."""

import math

from air_router.controller.model.actions import (
    Announce,
)
from air_router.controller.model.airspace_in_force import ZoneChange
from air_router.controller.model.events import PlanRenewed
from air_router.controller.model.requests import GoOn, HoldNow, SeekNow
from air_router.controller.model.states import State
from air_router.vehicle.instructions import FLY_OUT_OR_RELOAD, Severity
from geo.airspace.zone import Band, Circle, Outline, Zone
from geo.frame import Point
from tests.air_router.controller.drawing import boarding, box, change, clear_of, cruising, moves

LOW = Zone("low", Circle(Point(200.0, 200.0), 5.0), band=Band(0.0, 20.0))


def walls(centre):
    """Four zones around a place, as an operator would draw them one after the other."""
    east_m, north_m = centre
    sides = {"north": (0, 35), "south": (0, -35), "east": (35, 0), "west": (-35, 0)}
    for name, (east, north) in sides.items():
        yield box((east_m + east, north_m + north), half_m=19.0, name=name)


def enclosed(pretend, **changes):
    flight = cruising(pretend, **{"duration_s": None, **changes})
    flight.give(HoldNow())
    flight.fly_until(lambda: math.hypot(*flight.velocity) < 0.01, 10.0)
    drawn = []
    for zone in walls(flight.position):
        drawn.append(zone)
        change(flight, *drawn)
        flight.fly_until(
            lambda: flight.controller.context.airspace.change is ZoneChange.UPLOADING, 10.0
        )
        flight.give(PlanRenewed())
        flight.step()
        if flight.controller.states.reachability.no_way_home:  # the mission's zones are walls too
            return flight, drawn
    raise AssertionError(drawn)


def announced_no_way_home(flight):
    return [text for text in flight.announced if text.startswith("no way home")]


def test_without_a_way_home_by_several_reloads_that_is_announced_at_once_and_now_and_then(pretend):
    flight, drawn = enclosed(pretend)
    (text,) = announced_no_way_home(flight)
    assert f"'{drawn[-1].name}'" in text
    assert Announce(text, Severity.WARNING, FLY_OUT_OR_RELOAD) in flight.announcements
    flight.fly_until(lambda: len(announced_no_way_home(flight)) == 3, 70.0)
    assert flight.controller.state is State.HOLD


def test_without_a_way_home_at_its_reserve_it_hovers_and_announces_what_will_happen(pretend):
    flight, _ = enclosed(pretend)
    commanded = len(flight.motions)
    flight.battery = flight.mission.battery_reserve
    flight.step()
    assert flight.controller.state is State.HOME
    flight.step()
    assert "it should come home and cannot" in announced_no_way_home(flight)[-1]
    assert "PX4's battery failsafe" in announced_no_way_home(flight)[-1]
    flight.fly_for(60.0)
    assert moves(flight, commanded) == []
    assert len(announced_no_way_home(flight)) == 3  # every half minute, and once for its reserve
    flight.failsafe = True  # the autopilot acts: it is left to it
    flight.step()
    assert flight.controller.state is State.PASSIVE


def test_without_a_way_home_it_comes_home_once_a_zone_is_taken_away(pretend):
    flight, (*rest, _) = enclosed(pretend)
    flight.battery, before = flight.mission.battery_reserve, boarding(flight)
    flight.step()
    change(flight, *rest)
    since = len(flight.track)
    flight.step()
    assert flight.announced.count("a clear way leads home again") == 1
    assert not flight.controller.states.reachability.no_way_home
    flight.fly_until(lambda: boarding(flight) == before + 1, 10.0)
    flight.give(PlanRenewed())
    flight.lands(600.0)
    assert min(clear_of(flight, zone, since) for zone in rest) >= 5.0


def test_without_a_way_home_it_goes_on_with_what_it_can_do_inside(pretend):
    flight, drawn = enclosed(pretend)
    flight.give(GoOn())
    since = len(flight.track)
    flight.fly_for(120.0)
    assert announced_no_way_home(flight)
    assert min(clear_of(flight, zone, since) for zone in drawn) >= 5.0


def test_a_way_that_is_not_there_is_announced_once(airborne):
    flight = airborne(duration_s=600.0)
    flight.operator_requests(SeekNow("io", by="operator"))
    flight.fly_until(lambda: flight.now_s > 110.0)
    outer, inner = (box(flight.position, half_m).shape.ring for half_m in (60.0, 30.0))
    change(flight, Zone("ring", Outline(outer, (inner,))))
    flight.fly_until(lambda: boarding(flight) == 1, 20.0)
    before = len(flight.announced)
    flight.give(PlanRenewed())
    assert sum("no way to io" in text for text in flight.announced[before:]) == 1
