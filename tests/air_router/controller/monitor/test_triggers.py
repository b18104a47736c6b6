import dataclasses

import pytest

from air_router.controller.monitor.flight_phase import SilenceReminder, TakeOff, take_off
from air_router.controller.states.return_state import reason_to_return
from air_router.vehicle.vehicle import FlightMode, Telemetry


@pytest.fixture
def above_home(pennovation):
    return Telemetry(
        time_s=1.0,
        position=pennovation.home,
        altitude_m=pennovation.altitude_above_home_m,
        armed=True,
        in_air=True,
        mode=FlightMode.MISSION,
        battery=0.9,
    )


@pytest.mark.parametrize(
    ("change", "away_m", "stage"),
    [
        ({}, 0.0, TakeOff.COMPLETE),
        ({}, 100.0, TakeOff.COMPLETE),  # high: every leg from there is checked
        ({"altitude_m": 5.0}, 0.0, TakeOff.TO_COME),
        ({"altitude_m": 5.0}, 15.0, TakeOff.TO_COME),
        ({"altitude_m": 5.0}, 25.0, TakeOff.MISPLACED),
        ({"altitude_m": 5.0, "mode": FlightMode.OTHER}, 25.0, TakeOff.TO_COME),
        ({"mode": FlightMode.OTHER}, 0.0, TakeOff.TO_COME),
        ({"in_air": False}, 0.0, TakeOff.TO_COME),
    ],
)
def test_where_the_take_off_stands(pennovation, above_home, change, away_m, stage):
    place = above_home.position._replace(east_m=above_home.position.east_m + away_m)
    telemetry = dataclasses.replace(above_home, position=place, **change)
    assert take_off(pennovation, telemetry) is stage


def test_a_low_mission_still_climbs(pennovation, above_home):
    low = dataclasses.replace(pennovation, altitude_above_home_m=2.0)
    climbing = dataclasses.replace(above_home, altitude_m=0.2)
    assert take_off(low, climbing) is TakeOff.TO_COME
    assert take_off(low, dataclasses.replace(climbing, altitude_m=1.5)) is TakeOff.COMPLETE


def test_battery_and_duration_bring_it_home(pennovation, above_home):
    mission = dataclasses.replace(pennovation, duration_s=60.0)
    assert reason_to_return(mission, above_home, 59.9) is None
    assert reason_to_return(mission, above_home, 60.0) == "60 s of mission are over"
    weak = dataclasses.replace(above_home, battery=mission.battery_reserve)
    assert reason_to_return(mission, weak, 0.0).startswith("battery at")
    unknown = dataclasses.replace(above_home, battery=None)
    assert reason_to_return(mission, unknown, 0.0) is None


def test_a_silence_is_told_at_once_and_then_now_and_then():
    silence = SilenceReminder()
    told = [s for s in range(3, 26) if silence.news(float(s)) is not None]
    assert told == [3, 13, 23]
    assert silence.news(3.0) is not None
