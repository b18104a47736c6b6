"""Clocks that wrap are no restart, and two of them on one link are two vehicles."""

import pytest

from air_router.vehicle.instructions import SEPARATE_TWINS
from air_router.vehicle.px4.boot_clock import BootClock, TwinWatch
from air_router.vehicle.px4.limits import TWIN_CLEARED_MESSAGES
from air_router.vehicle.px4.mavlink_values import BOOT_CLOCK_MS
from air_router.vehicle.vehicle import FlightMode, Telemetry, WrongVehicle

HOLD = 0x03040000


def test_a_clock_that_wraps_goes_on():
    clock, last_ms = BootClock(), BOOT_CLOCK_MS - 150
    assert [
        clock.whole_ms(ms % BOOT_CLOCK_MS) for ms in range(last_ms, last_ms + 1000, 100)
    ] == list(range(last_ms, last_ms + 1000, 100))
    assert clock.whole_ms(BOOT_CLOCK_MS - 50) == BOOT_CLOCK_MS - 50  # late, of before
    assert clock.whole_ms(900) == BOOT_CLOCK_MS + 900


@pytest.mark.parametrize("before_ms", [500_000, BOOT_CLOCK_MS // 2, BOOT_CLOCK_MS - 200_000])
def test_one_that_begins_anew_far_from_its_end_has_restarted(before_ms):
    clock = BootClock()
    clock.whole_ms(before_ms)
    assert clock.whole_ms(2_000) == 2_000


def test_a_flight_over_the_wrap_is_one_flight(px4):
    px4.boot_s = BOOT_CLOCK_MS / 1e3 - 3.0
    px4.clock.received(px4.boot_s)
    px4.run(2.0)
    fields, wrapped = px4._fields, []

    def wraps(name):
        sent = fields(name)
        if "time_boot_ms" in sent:
            wrapped.append(sent["time_boot_ms"] >= BOOT_CLOCK_MS)
            sent["time_boot_ms"] %= BOOT_CLOCK_MS
        return sent

    px4._fields = wraps
    px4.speed_m_s = 5.0
    px4.run(4.0)
    assert wrapped.count(True) > 10
    times_s = [event.time_s for event in px4.events if isinstance(event, Telemetry)][-60:]
    assert times_s == sorted(times_s)
    assert px4.last.time_s == pytest.approx(px4.boot_s)
    assert px4.clock.boot_s() == pytest.approx(px4.boot_s, abs=0.2)
    assert px4.last.ages.position_s <= 0.2


def test_late_streams_and_what_a_socket_kept_are_one_vehicle():
    watch, arrived_s = TwinWatch(), 100.0
    for step in range(200):  # every message twice: of now, and 8 s late
        arrived_s += 0.05
        for boot_s in (arrived_s, arrived_s - 8.0):
            assert not watch.take(boot_s, arrived_s, 1.0), step
    for boot_s in range(110, 130):  # it stood still for 20 s
        assert not watch.take(boot_s, 140.0, 1.0)
    assert watch.apart_s is None


def test_two_clocks_that_take_turns_are_two_vehicles_until_one_is_gone():
    watch, changes = TwinWatch(), []
    for step in range(60):
        arrived_s = 100.0 + step * 0.1
        boot_s = arrived_s + (600.0 if step % 10 == 5 else 0.0)
        changes.append(watch.take(boot_s, arrived_s, 1.0))
    assert changes.count(True) == 1
    assert watch.apart_s == pytest.approx(600.0, abs=0.5)
    over = [
        watch.take(106.0 + s * 0.1, 106.0 + s * 0.1, 1.0) for s in range(TWIN_CLEARED_MESSAGES + 1)
    ]
    assert over.count(True) == 1
    assert watch.apart_s is None


def test_a_vehicle_that_restarts_is_one():
    watch = TwinWatch()
    for step in range(100):
        boot_s = 500.0 + step * 0.1 if step < 50 else 2.0 + (step - 50) * 0.1
        assert not watch.take(boot_s, 100.0 + step * 0.1, 1.0)


class Twin:
    """A second autopilot with the same system id: on the ground, disarmed, in Hold."""

    def __init__(self, px4):
        self._px4 = px4

    def run(self, seconds):
        for step in range(round(seconds)):
            self._px4.sends("HEARTBEAT", base_mode=0, custom_mode=HOLD, system_status=3)
            for _ in range(2):
                ground = {"relative_alt": 0, "alt": 6_700, "time_boot_ms": 900_000 + step * 1000}
                self._px4.sends("GLOBAL_POSITION_INT", **ground)
                self._px4.run(0.5)


def test_two_autopilots_with_one_system_id_are_reported_as_that_and_not_as_a_crash(px4):
    px4.events.clear()
    Twin(px4).run(10.0)
    wrong = [event for event in px4.events if isinstance(event, WrongVehicle)]
    assert [event.twins for event in wrong] == [True]
    assert "two autopilots answer with the same system id" in wrong[0].why_not
    reported = [event for event in px4.events if isinstance(event, Telemetry)]
    assert all(event.armed for event in reported)  # never "disarmed in the air"
    assert {event.mode for event in reported} == {FlightMode.MISSION}


def test_one_that_was_killed_reports_that_in_every_heartbeat(px4):
    px4.armed = False
    px4.run(2.5)
    assert not px4.last.armed


def test_two_serial_numbers_are_two_autopilots(px4):
    version = {"flight_sw_version": 0x011100FF}
    px4.sends("AUTOPILOT_VERSION", **version, uid=7)
    px4.sends("AUTOPILOT_VERSION", **version, uid=7)
    px4.sends("AUTOPILOT_VERSION", **version, uid=0)  # unknown
    assert not any(isinstance(event, WrongVehicle) for event in px4.events)
    px4.sends("AUTOPILOT_VERSION", **version, uid=8)
    (wrong,) = [event for event in px4.events if isinstance(event, WrongVehicle)]
    assert wrong.twins
    late = []
    px4.telemetry.subscribe(late.append)
    assert late == [wrong]


def test_the_flight_lets_go_of_both(away):
    flight = away(duration_s=None)
    commanded = len(flight.motions)
    flight.give(WrongVehicle(flight.now_s, "two autopilots answer", twins=True))
    alarm, hands_off = flight.announcements[-2:]
    assert (alarm.text, alarm.instruction) == ("two autopilots answer", SEPARATE_TWINS)
    assert hands_off.instruction == SEPARATE_TWINS
    flight.fly_for(10.0)
    assert len(flight.motions) == commanded
