"""What a flight does after the companion stalled."""

import dataclasses

import pytest

from air_router.controller.lag_monitor import LagMonitor
from air_router.controller.limits import LAG_RECENT_S
from air_router.controller.model.actions import HoldHere
from air_router.controller.model.events import CompanionLagged
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.requests import ComeHome
from air_router.controller.model.states import State
from air_router.controller.safety_monitor import Response
from air_router.vehicle.instructions import FREE_PROCESSOR, Severity
from air_router.vehicle.vehicle import Ages, FlightMode, Telemetry
from geo.frame import Point


def lag_warnings(flight):
    return [a for a in flight.announcements if "the companion stalled" in a.text]


def test_a_short_lag_is_announced_and_flown_on(away):
    flight = away(duration_s=None)
    commanded = len(flight.motions)
    flight.give(CompanionLagged(0.8))
    flight.fly_for(1.0)
    (warning,) = lag_warnings(flight)
    assert (warning.severity, warning.instruction) == (Severity.WARNING, FREE_PROCESSOR)
    assert not any(isinstance(motion, HoldHere) for motion in flight.motions[commanded:])


def test_one_of_two_seconds_is_held_for_and_gone_on_after(away):
    flight = away(duration_s=None)
    flight.give(CompanionLagged(2.0))
    flight.fly_for(0.5)
    assert isinstance(flight.motions[-1], HoldHere)
    assert len(lag_warnings(flight)) == 1
    flight.fly_for(10.0)
    assert not isinstance(flight.motions[-1], HoldHere)


def test_short_lags_that_add_up_are_announced_and_flown_on(away):
    """Each is shorter than a stall that the vehicle holds for: it was monitored in between."""
    flight = away(duration_s=None)
    commanded = len(flight.motions)
    for _ in range(3):
        flight.give(CompanionLagged(3.0, within_s=10.0))
        flight.fly_for(8.0)
    text = "the companion lacked the processor for 3.0 s of the last 10 s"
    assert [text in each.text for each in flight.announcements].count(True) == 3
    assert not lag_warnings(flight)
    assert not any(isinstance(motion, HoldHere) for motion in flight.motions[commanded:])
    assert flight.controller.state is not State.HOME


def test_a_program_that_stands_still_again_and_again_comes_home(away):
    flight = away(duration_s=None)
    for _ in range(3):
        flight.give(CompanionLagged(2.5))
        flight.fly_for(8.0)
    assert flight.controller.state is State.HOME


def test_what_a_pilot_chose_meanwhile_is_not_ended(away):
    flight = away(duration_s=None)
    flight.mode, flight.target = FlightMode.RETURN, None
    commanded = len(flight.motions)
    flight.give(CompanionLagged(3.0))
    flight.fly_for(10.0)
    assert flight.controller.state is State.PASSIVE
    assert len(flight.motions) == commanded


def test_a_landing_is_not_held(away):
    flight = away(duration_s=None)
    flight.operator_requests(ComeHome())
    flight.fly_until(lambda: flight.controller.state is State.LAND, 600.0)
    flight.give(CompanionLagged(5.0))
    flight.lands()
    assert not any(isinstance(motion, HoldHere) for motion in flight.motions[-1:])


def telemetry(time_s, position):
    return Telemetry(time_s, position, 40.0, armed=True, in_air=True)


@pytest.mark.parametrize(("to_m", "near"), [(20.0, False), (300.0, True)])
def test_a_way_that_was_not_looked_at_is_looked_back_on(pennovation, to_m, near):
    """Straight from where it was to where it is; both ends may keep the clearance."""
    home = pennovation.home
    context = MissionContext(pennovation, None)
    monitor = LagMonitor(context)
    context.telemetry = before = telemetry(10.0, home)
    monitor.note(before)
    monitor.lagged(CompanionLagged(1.0))
    place = Point(home.east_m + to_m, home.north_m)
    after = telemetry(12.0, place)
    monitor.note(after)
    found = monitor.update(after)
    assert [deviation.response for deviation in found] == ([Response.ANNOUNCE] if near else [])
    assert all("meanwhile it may have been too near to" in each.words for each in found)
    assert monitor.update(after) == ()  # once


def test_what_waits_in_its_own_sockets_is_not_announced_as_missing(away):
    flight, missing = away(duration_s=None), "battery not received"
    true = flight.telemetry
    flight.give(CompanionLagged(0.6))
    flight.telemetry = lambda: dataclasses.replace(true(), ages=Ages(battery_s=6.0))
    flight.fly_for(1.0)
    flight.telemetry = true
    flight.fly_for(1.0)
    assert not any("battery" in text for text in flight.announced)
    flight.fly_for(LAG_RECENT_S)
    flight.telemetry = lambda: dataclasses.replace(true(), ages=Ages(battery_s=6.0))
    flight.fly_for(1.0)
    assert any(text.startswith(missing) for text in flight.announced)
