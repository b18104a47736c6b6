import pytest

from air_router.controller.monitor.flight_phase import FlightPhase
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point


def seen(*, armed=False, in_air=False, mode=FlightMode.HOLD, time_s=1.0, altitude_m=0.0):
    return Telemetry(time_s, Point(0.0, 0.0), altitude_m, armed=armed, in_air=in_air, mode=mode)


@pytest.fixture
def flight_phase():
    return FlightPhase()


def test_armed_in_mission_mode_hands_the_flight_over_once(flight_phase):
    assert not flight_phase.note(seen(mode=FlightMode.MISSION))
    assert not flight_phase.note(seen(armed=True))
    assert flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert not flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert flight_phase.handed_over


def test_it_is_over_when_down_and_disarmed_after_having_been_armed(flight_phase):
    flight_phase.note(seen())
    assert not flight_phase.over(seen())
    flight_phase.note(seen(armed=True, in_air=True))
    assert not flight_phase.over(seen(armed=True))
    assert flight_phase.over(seen())
    # Disarmed is on the ground, whatever another stream says.
    assert flight_phase.over(seen(in_air=True))


def test_how_it_ended(flight_phase):
    flight_phase.stayed_why = "the operator's request"
    assert flight_phase.ending(landed_by_us=False) == "the operator's request, before take-off"
    flight_phase.note(seen(armed=True, in_air=True))
    assert flight_phase.ending(landed_by_us=False) == "landed, but not by our command"
    assert flight_phase.ending(landed_by_us=True) == "landed at home"


def test_armed_and_disarmed_it_begins_anew_but_not_after_a_flight(flight_phase):
    flight_phase.note(seen(armed=True, mode=FlightMode.MISSION))
    assert flight_phase.again()
    assert not flight_phase.handed_over
    assert not flight_phase.over(seen())
    flight_phase.note(seen(armed=True, in_air=True))
    assert not flight_phase.again()


def test_a_climb_that_does_not_go_on(flight_phase):
    def climbing(time_s, altitude_m):
        telemetry = seen(
            armed=True, in_air=True, mode=FlightMode.MISSION, time_s=time_s, altitude_m=altitude_m
        )
        flight_phase.note(telemetry)
        return flight_phase.stuck(telemetry)

    assert not climbing(1.0, 1.0)
    assert not climbing(15.0, 8.0)
    assert not climbing(34.9, 8.4)
    assert climbing(35.0, 8.4)
    assert not climbing(36.0, 9.0)


def test_a_pilot_s_climb_is_not_watched(flight_phase):
    flight_phase.note(seen(armed=True, in_air=True))
    assert not flight_phase.stuck(seen(armed=True, in_air=True, time_s=1.0))
    assert not flight_phase.stuck(seen(armed=True, in_air=True, time_s=99.0))
