import pytest

from air_router.controller.monitor.flight_phase import Launch
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point


def seen(*, armed=False, in_air=False, mode=FlightMode.HOLD, time_s=1.0, altitude_m=0.0):
    return Telemetry(time_s, Point(0.0, 0.0), altitude_m, armed=armed, in_air=in_air, mode=mode)


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
    assert launch.over(seen())
    assert launch.over(seen(in_air=True))  # disarmed is on the ground, whatever another stream says


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


def test_armed_and_disarmed_it_begins_anew_but_not_after_a_flight(launch):
    launch.note(seen(armed=True, mode=FlightMode.MISSION))
    assert launch.again()
    assert not launch.handed_over
    assert not launch.over(seen())
    launch.note(seen(armed=True, in_air=True))
    assert not launch.again()


def test_a_climb_that_does_not_go_on(launch):
    def climbing(time_s, altitude_m):
        telemetry = seen(
            armed=True, in_air=True, mode=FlightMode.MISSION, time_s=time_s, altitude_m=altitude_m
        )
        launch.note(telemetry)
        return launch.stuck(telemetry)

    assert not climbing(1.0, 1.0)
    assert not climbing(15.0, 8.0)
    assert not climbing(34.9, 8.4)
    assert climbing(35.0, 8.4)
    assert not climbing(36.0, 9.0)


def test_somebody_else_s_climb_is_not_watched(launch):
    launch.note(seen(armed=True, in_air=True))
    assert not launch.stuck(seen(armed=True, in_air=True, time_s=1.0))
    assert not launch.stuck(seen(armed=True, in_air=True, time_s=99.0))
