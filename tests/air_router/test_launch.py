import pytest

from air_router.launch import Launch
from air_router.vehicle import FlightMode, Telemetry
from geo.frame import Point


def seen(*, armed=False, in_air=False, mode=FlightMode.HOLD):
    return Telemetry(1.0, Point(0.0, 0.0), 0.0, armed=armed, in_air=in_air, mode=mode)


@pytest.fixture
def launch():
    return Launch()


def test_armed_in_mission_mode_hands_the_flight_over_once(launch):
    assert not launch.note(seen(mode=FlightMode.MISSION))
    assert not launch.note(seen(armed=True))
    assert launch.note(seen(armed=True, mode=FlightMode.MISSION))
    assert not launch.note(seen(armed=True, mode=FlightMode.MISSION))
    assert launch.handed_over


def test_it_is_over_when_down_and_disarmed_after_having_been_armed(launch):
    launch.note(seen())
    assert not launch.over(seen())
    launch.note(seen(armed=True, in_air=True))
    assert not launch.over(seen(armed=True))
    assert not launch.over(seen(in_air=True))
    assert launch.over(seen())


def test_how_it_ended(launch):
    launch.stayed_why = "the operator's word"
    assert launch.ending(landed_by_us=False) == "the operator's word, before take-off"
    launch.note(seen(armed=True, in_air=True))
    assert launch.ending(landed_by_us=False) == "landed, but not by our command"
    assert launch.ending(landed_by_us=True) == "landed at home"


def test_time_in_the_air(launch):
    assert launch.since_s(50.0) == 0.0
    launch.airborne_s = 20.0
    assert launch.since_s(50.0) == 30.0
