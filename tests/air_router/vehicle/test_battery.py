"""What a battery reports, and what of it is believed."""

import pytest

from air_router.controller.model.states import State
from air_router.vehicle.battery import BatteryWatch
from air_router.vehicle.instructions import WATCH_BATTERY
from air_router.vehicle.limits import CHARGE_BELIEVED_S, CHARGE_JUMP, VOLTAGE_DROP
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point


def believed(watch, time_s, charge, voltage_v=15.8):
    return watch.take(Telemetry(time_s, Point(0.0, 0.0), 40.0, battery=charge, voltage_v=voltage_v))


def test_a_charge_that_falls_as_batteries_do_is_believed_at_once():
    watch = BatteryWatch()
    assert [believed(watch, t, 0.9 - t / 100) for t in range(60)] == [
        0.9 - t / 100 for t in range(60)
    ]


@pytest.mark.parametrize("charge", [0.0, 0.2, 1.0])
def test_one_that_jumps_is_believed_once_it_has_lasted_for_some_seconds(charge):
    watch = BatteryWatch()
    assert believed(watch, 0.0, 0.6) == 0.6
    assert believed(watch, 1.0, charge) == 0.6
    assert believed(watch, 1.0 + CHARGE_BELIEVED_S - 0.1, charge) == 0.6
    assert believed(watch, 1.0 + CHARGE_BELIEVED_S, charge) == charge


def test_one_that_jumps_for_a_moment_again_and_again_is_not():
    watch = BatteryWatch()
    for t in range(100):
        assert believed(watch, float(t), 0.0 if t % 4 else 0.6) == 0.6 or t == 0
        believed(watch, t + 0.5, 0.6)


def test_one_that_jumps_about_does_not_count_until_it_stays():
    watch = BatteryWatch()
    believed(watch, 0.0, 0.6)
    assert {believed(watch, 1.0 + t, (0.0, 0.3)[t % 2]) for t in range(10)} == {0.6}


def test_one_that_jumps_with_its_voltage_is_believed_at_once():
    watch = BatteryWatch()
    believed(watch, 0.0, 0.6)
    assert believed(watch, 1.0, 0.1, voltage_v=14.9) == 0.1


def test_what_is_allowed_at_most_is_believed_at_once():
    watch = BatteryWatch()
    believed(watch, 0.0, 2 * CHARGE_JUMP)
    assert believed(watch, 1.0, CHARGE_JUMP) == CHARGE_JUMP
    watch = BatteryWatch()
    believed(watch, 0.0, 0.6, voltage_v=16.0)
    assert believed(watch, 1.0, 0.1, voltage_v=16.0 * (1.0 - VOLTAGE_DROP)) == 0.1


def test_one_that_is_unknown_is_not_known_from_before():
    watch = BatteryWatch()
    believed(watch, 0.0, 0.6)
    assert believed(watch, 1.0, None) is None
    assert believed(watch, 2.0, 0.3) == 0.3


def test_one_message_ends_no_mission_and_a_low_battery_does(away):
    flight = away(duration_s=None)
    flight.voltage_v = 15.8  # does not fall with the reported charge
    flight.fly_for(5.0)
    flight.battery = 0.0
    flight.fly_for(1.0)
    flight.battery = 0.8
    flight.fly_for(10.0)
    assert flight.controller.state is not State.HOME
    doubt = next(a for a in flight.announcements if "charge jumped" in a.text)
    assert doubt.instruction == WATCH_BATTERY
    flight.battery = 0.0
    flight.fly_for(CHARGE_BELIEVED_S - 0.5)
    assert flight.controller.state is not State.HOME
    flight.fly_for(1.0)
    assert flight.controller.state is State.HOME
    assert "coming home: battery at 0%" in flight.announced
