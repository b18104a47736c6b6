"""What PX4's streams report together: their ages, frozen ones, and no vehicle that never was."""

import asyncio

import pytest

from air_router.vehicle.px4 import px4_requests
from air_router.vehicle.px4.limits import POSITIONS_AGREEING, POSITIONS_QUIET_S
from air_router.vehicle.px4.mavlink_values import MavCmd
from air_router.vehicle.px4.px4_streams import Continuity, ReportedPosition, Streams, flight_mode
from air_router.vehicle.vehicle import FlightMode, LinkSilent, Telemetry
from geo.frame import Point
from tests.air_router.vehicle.px4.conftest import Px4

LAND, HOLD, MISSION, RETURN = 0x06040000, 0x03040000, 0x04040000, 0x05040000
CRITICAL, TERMINATED = 5, 8
ON_GROUND, LANDING = 1, 4


@pytest.fixture
def landing(px4):
    px4.mode = px4.intended = LAND
    px4.run(2.0)
    return px4


STREAMS = {
    "GLOBAL_POSITION_INT": "position_s",
    "SYS_STATUS": "battery_s",
    "GPS_RAW_INT": "fix_s",
    "EXTENDED_SYS_STATE": "landed_s",
    "MISSION_CURRENT": "item_s",
    "HEARTBEAT": "armed_s",
}


@pytest.mark.parametrize(("name", "age"), STREAMS.items())
def test_a_stream_that_ends_alone_ages_and_telemetry_goes_on_all_the_same(px4, name, age):
    px4.off.add(name)
    reported = len(px4.events)
    px4.run(20.0)
    assert getattr(px4.last.ages, age) == pytest.approx(20.0, abs=1.1)
    others = set(STREAMS.values()) - {age}
    assert all(getattr(px4.last.ages, other) <= 1.0 for other in others)
    assert len(px4.events) - reported >= 30
    px4.off.clear()
    px4.run(2.0)
    assert getattr(px4.last.ages, age) <= 1.0


def test_the_mode_is_known_while_either_message_reports_it(px4):
    px4.off.add("HEARTBEAT")
    px4.run(20.0)
    assert px4.last.ages.mode_s <= 2.0
    px4.off.add("CURRENT_MODE")
    px4.run(20.0)
    assert px4.last.ages.mode_s == pytest.approx(20.0, abs=2.1)


def test_a_silence_of_all_ages_nothing(px4):
    px4.wall_s += 40.0
    px4.boot_s += 40.0
    px4.run(0.1)
    ages = px4.last.ages
    assert max(ages.position_s, ages.battery_s, ages.mode_s, ages.landed_s) <= 2.0


def stands_still(px4, seconds, kept_s):
    """This program does so; the socket keeps the first of what the vehicle sends meanwhile."""
    woken_s, boot_s, mode = px4.wall_s + seconds, px4.boot_s + seconds, px4.mode
    px4.events.clear()
    px4.wall_s, px4.mode = woken_s, MISSION
    px4.run(kept_s, rate=1e3)
    px4.wall_s, px4.boot_s, px4.mode = woken_s, boot_s, mode


@pytest.mark.parametrize(("seconds", "kept_s", "silent"), [(2.0, 1.0, 2), (12.0, 5.0, 12)])
def test_what_a_socket_kept_while_this_program_stood_still_is_not_new(px4, seconds, kept_s, silent):
    before = px4.last
    px4.mode = HOLD  # a pilot chooses it when the socket is full
    stands_still(px4, seconds, kept_s)
    assert not [event for event in px4.events if isinstance(event, Telemetry)]
    assert px4.telemetry.time_s == before.time_s
    px4.run(2.0)
    assert px4.last.mode is FlightMode.HOLD
    reported = [event for event in px4.events if isinstance(event, LinkSilent)]
    assert px4.events[0] is reported[0]
    assert [round(event.silent_s) for event in reported] == [silent]


@pytest.mark.parametrize("every_s", [1.4, 2.0, 4.0])
def test_a_link_that_passes_all_at_once_now_and_then_is_received(px4, every_s):
    for _ in range(5):
        px4.wall_s += every_s
        px4.run(every_s, rate=1e3)
        assert px4.boot_s - px4.telemetry.time_s < 0.15


def test_a_link_that_is_slower_from_now_on_is_received_at_once(px4):
    px4.wall_s += 1.8  # every message takes so much longer
    px4.mode = HOLD
    px4.run(0.2)
    assert px4.boot_s - px4.telemetry.time_s < 0.15
    px4.sends("HEARTBEAT")
    assert px4.telemetry.mode is FlightMode.HOLD


def test_a_vehicle_whose_time_does_not_come_is_received_half_a_second_after_a_pause(px4):
    px4.off |= {"GLOBAL_POSITION_INT", "POSITION_TARGET_GLOBAL_INT", "SYSTEM_TIME"}
    px4.wall_s += 10.0
    px4.mode = HOLD
    px4.run(0.4)
    assert px4.telemetry.mode is FlightMode.MISSION
    px4.run(1.5)
    assert px4.telemetry.mode is FlightMode.HOLD


def test_ages_are_of_the_vehicle_s_time_also_when_that_runs_fast(px4):
    px4.off.add("SYS_STATUS")
    px4.run(60.0, rate=10.0)  # two windows alike give the rate
    assert px4.last.ages.battery_s == pytest.approx(60.0, rel=0.2)


def test_a_position_whose_time_stands_is_no_position_and_time_goes_on(px4):
    frozen = px4._fields("GLOBAL_POSITION_INT")
    px4.off |= {"GLOBAL_POSITION_INT", "SYSTEM_TIME", "POSITION_TARGET_GLOBAL_INT"}
    before_s = px4.clock.boot_s()
    for _ in range(100):
        px4.run(0.1)
        px4.sends("GLOBAL_POSITION_INT", **frozen)
    assert px4.last.ages.position_s == pytest.approx(10.0, abs=0.6)
    assert px4.clock.boot_s() - before_s == pytest.approx(10.0, abs=0.5)


def test_a_position_that_stays_where_it_is_while_it_reports_a_speed_is_no_position(px4):
    px4.speed_m_s = 3.5
    px4.run(1.0)
    assert px4.last.ages.position_s <= 0.1
    place = {name: px4._fields("GLOBAL_POSITION_INT")[name] for name in ("lat", "lon")}
    px4.off.add("GLOBAL_POSITION_INT")
    for _ in range(30):
        px4.run(0.1)
        px4.sends("GLOBAL_POSITION_INT", **place)
    assert px4.last.ages.position_s == pytest.approx(3.0, abs=0.6)
    px4.speed_m_s = 0.0
    px4.sends("GLOBAL_POSITION_INT", **place)
    px4.boot_s += 0.1
    px4.sends("GLOBAL_POSITION_INT", **place)  # it hovers: that may well be the same place
    assert px4.last.ages.position_s == 0.0


def test_a_late_position_is_not_taken_for_where_it_is_now(px4):
    px4.speed_m_s = 3.5
    late = px4._fields("GLOBAL_POSITION_INT")
    px4.run(0.5)
    now = px4.last
    px4.sends("GLOBAL_POSITION_INT", **late)
    assert px4.telemetry.snapshot().position == now.position


def test_gps_that_repeats_its_time_does_not_count(px4):
    stamp = px4._fields("GPS_RAW_INT")["time_usec"]
    px4.off.add("GPS_RAW_INT")
    for _ in range(10):
        px4.run(1.0)
        px4.sends("GPS_RAW_INT", time_usec=stamp)
    assert px4.last.ages.fix_s == pytest.approx(10.0, abs=1.1)


def test_a_charge_that_was_known_and_is_not_reported_any_more_ages(px4):
    px4.battery = -1
    px4.run(6.0)
    assert px4.last.battery == 0.9
    assert px4.last.ages.battery_s == pytest.approx(6.0, abs=0.5)
    px4.battery = 80
    px4.run(1.0)
    assert (px4.last.battery, px4.last.ages.battery_s < 1.0) == (0.8, True)


def test_a_vehicle_that_never_knows_its_charge_is_flown_without(pennovation, monkeypatch):
    px4 = Px4(pennovation, monkeypatch, battery=-1)
    px4.run(40.0)
    assert (px4.last.battery, px4.last.ages.battery_s < 1.0) == (None, True)


def test_heights_count_from_the_home_that_an_earlier_companion_took_off_from(px4):
    px4.telemetry.count_heights_from(6.7 - 15.0)  # home was moved up by 15 m since
    assert (px4.last.altitude_m, px4.last.home_moved.up_m) == pytest.approx((55.0, 15.0))
    px4.run(1.0)
    assert px4.last.altitude_m == pytest.approx(55.0)
    px4.telemetry.count_heights_from(6.7 - 2.0)  # as PX4 corrects it
    assert (px4.last.altitude_m, px4.last.home_moved) == (40.0, None)


def test_one_that_lands_is_never_shown_flying_in_the_mode_from_before(px4):
    px4.mode = px4.intended = LAND
    px4.landed, px4.height_m = LANDING, 0.3
    px4.run(2.0)
    assert px4.last.mode is FlightMode.LAND
    reported = len(px4.events)
    # It touches down and disarms; the messages that report it come one after the other.
    px4.landed, px4.armed, px4.status = ON_GROUND, False, 3
    px4.mode = px4.intended = MISSION
    px4.off |= {"HEARTBEAT", "EXTENDED_SYS_STATE"}
    px4.sends("CURRENT_MODE")
    px4.run(0.9)
    px4.sends("HEARTBEAT")
    px4.run(0.5)
    px4.sends("EXTENDED_SYS_STATE")
    px4.run(0.2)
    for event in px4.events[reported:]:
        assert not (event.armed and event.in_air and event.mode is FlightMode.MISSION)
    assert (px4.last.armed, px4.last.in_air, px4.last.mode) == (False, False, FlightMode.MISSION)


def test_a_landing_that_disarms_is_no_failsafe_though_another_mode_is_intended(landing):
    landing.off.add("HEARTBEAT")
    landing.intended = MISSION
    landing.sends("CURRENT_MODE")
    landing.run(0.9)
    assert not landing.last.failsafe
    landing.armed, landing.status, landing.mode = False, 3, MISSION
    landing.sends("HEARTBEAT")
    landing.run(3.0)
    assert not any(event.failsafe for event in landing.events if isinstance(event, Telemetry))


def test_a_failsafe_that_keeps_a_landing_up_shows_also_without_a_heartbeat(landing):
    landing.off.add("HEARTBEAT")
    landing.intended = MISSION
    landing.sends("CURRENT_MODE")
    landing.run(2.0)
    assert landing.last.failsafe


@pytest.mark.parametrize(("off", "seconds"), [(set(), 1.1), ({"HEARTBEAT"}, 2.0)])
def test_a_pilot_who_takes_over_a_landing_shows_also_without_a_heartbeat(landing, off, seconds):
    landing.off |= off
    landing.mode = landing.intended = HOLD
    landing.sends("CURRENT_MODE")
    landing.run(seconds)
    assert (landing.last.mode, landing.last.armed) == (FlightMode.HOLD, True)


def test_disarmed_in_the_air_it_has_not_landed_before_the_heartbeat_reports_it(px4):
    px4.mode = px4.intended = LAND
    px4.height_m = 28.0
    px4.run(2.0)
    px4.off.add("HEARTBEAT")
    px4.landed, px4.climb_m_s = ON_GROUND, -6.0  # as PX4 reports 0.6 s after it was disarmed
    px4.run(0.5)
    px4.sends("EXTENDED_SYS_STATE")
    assert px4.last.in_air
    px4.armed, px4.status = False, 3
    px4.sends("HEARTBEAT")
    px4.sends("HEARTBEAT")  # so high, one alone may be another vehicle's
    px4.run(0.1)
    assert (px4.last.armed, px4.last.in_air) == (False, True)
    px4.run(1.0)
    px4.sends("EXTENDED_SYS_STATE")
    px4.run(1.0)
    assert px4.last.altitude_m == pytest.approx(px4.height_m, abs=1.0)  # reported all the way down
    assert px4.height_m > 5.0


def test_a_landed_state_that_never_left_the_ground_does_not_keep_the_vehicle_there(px4):
    px4.landed, px4.height_m = ON_GROUND, 0.0
    px4.run(2.0)
    assert not px4.last.in_air
    px4.climb_m_s = 1.5
    px4.run(10.0)
    assert px4.last.in_air


def test_the_target_of_the_mode_before_is_not_the_target_of_this_one(px4):
    px4.run(0.5)
    old = px4._fields("POSITION_TARGET_GLOBAL_INT")
    px4.off.add("POSITION_TARGET_GLOBAL_INT")
    px4.run(0.4)
    px4.mode = px4.intended = HOLD
    px4.sends("HEARTBEAT")
    px4.sends("POSITION_TARGET_GLOBAL_INT", **old)
    px4.run(0.1)
    assert px4.last.target is None
    px4.off.clear()
    px4.run(1.0)
    assert px4.last.target is not None


def test_a_failsafe_is_reported_as_one_whichever_message_comes_first(px4):
    px4.mode, px4.status = HOLD, CRITICAL  # the mode that was intended is still Mission
    px4.sends("CURRENT_MODE")
    assert (px4.last.mode, px4.last.failsafe) == (FlightMode.HOLD, True)


def test_a_pilot_s_choice_is_none(px4):
    px4.mode = px4.intended = HOLD
    px4.sends("CURRENT_MODE")
    assert (px4.last.mode, px4.last.failsafe) == (FlightMode.HOLD, False)
    px4.mode = px4.intended = RETURN
    px4.sends("HEARTBEAT")  # before CURRENT_MODE, whose intention is older
    px4.run(3.0)
    assert (px4.last.mode, px4.last.failsafe) == (FlightMode.RETURN, False)


def test_a_flight_termination_shows(px4):
    px4.status = TERMINATED
    px4.run(2.0)
    assert px4.last.terminated


def test_a_stream_that_was_turned_off_is_requested_again(px4, monkeypatch):
    requested = []

    async def note(_telemetry, *request):
        requested.append(request)

    monkeypatch.setattr(px4_requests, "_request", note)
    px4.run(5.0)
    asyncio.run(px4_requests.request_again(px4.telemetry))
    assert requested == []
    px4.off |= {"GLOBAL_POSITION_INT", "SYS_STATUS"}
    px4.run(5.0)
    asyncio.run(px4_requests.request_again(px4.telemetry))
    # At our rate; and at the autopilot's own.
    assert requested == [
        (MavCmd.SET_MESSAGE_INTERVAL, 33, 1e5),
        (MavCmd.SET_MESSAGE_INTERVAL, 1, 0.0),
    ]


@pytest.mark.parametrize(("most_s", "stale"), [(0.2, False), (10.0, True)])
def test_where_the_simulation_waits_for_a_busy_companion_nothing_ages_meanwhile(most_s, stale):
    streams = Streams()
    streams.message(10.0, 10.0, most_s)
    streams.is_new("HEARTBEAT", {}, armed=True)
    for number in range(1, 11):  # late by our clock: the vehicle's goes ten times as fast, or waits
        streams.message(10.0 + 0.1 * number, 10.0, most_s)
    assert (streams.ages().mode_s >= 3.0) == stale


# HEARTBEAT.custom_mode as captured from PX4 1.17: main mode in byte 2, sub mode in byte 3.
CAPTURED = {
    0x03040000: FlightMode.HOLD,
    0x04040000: FlightMode.MISSION,
    0x02040000: FlightMode.TAKEOFF,
    0x05040000: FlightMode.RETURN,
    0x06040000: FlightMode.LAND,
    0x00030000: FlightMode.POSITION,
    0x01030000: FlightMode.OTHER,  # Orbit
    0x00020000: FlightMode.ALTITUDE,
    0x00060000: FlightMode.OTHER,  # Offboard
    0x08040000: FlightMode.OTHER,  # Follow me
    0: FlightMode.OTHER,
}


@pytest.mark.parametrize(("custom_mode", "mode"), list(CAPTURED.items()))
def test_custom_modes(custom_mode, mode):
    assert flight_mode(custom_mode) is mode


HERE, AWAY = Point(10.0, 0.0), Point(900.0, 0.0)


class Positions:
    """Positions at 10 Hz, as a vehicle sends them, and others between them."""

    def __init__(self, rate=1.0):
        self.continuity, self.rate = Continuity(), rate
        self.now_s, self.boot_s = 0.0, 500.0

    def goes_on(self, count=1, step_s=0.1):
        believed = []
        for _ in range(count):
            self.now_s += step_s / self.rate
            self.boot_s += step_s
            believed.append(self.reports(self.boot_s, HERE))
        return believed

    def reports(self, boot_s, position):
        return self.continuity.believes(ReportedPosition(boot_s, position), self.now_s, self.rate)


def test_a_message_of_another_boot_or_place_is_not_believed_nor_a_burst_of_them():
    positions = Positions()
    assert all(positions.goes_on(20))
    for boot_s, position in (
        (3.0, HERE),
        (positions.boot_s + 99.0, HERE),
        (positions.boot_s, AWAY),
    ):
        assert not any(positions.reports(boot_s, position) for _ in range(50))
        assert all(positions.goes_on(20))


def test_a_vehicle_that_restarted_is_believed_once_the_old_one_is_not_received_any_more():
    positions = Positions()
    positions.goes_on(20)
    positions.boot_s = 2.0
    believed = positions.goes_on(20)
    assert believed == sorted(believed)
    assert believed.count(False) == max(POSITIONS_AGREEING, round(POSITIONS_QUIET_S * 10)) - 1
    positions.boot_s -= 0.5  # messages may overtake each other
    assert all(positions.goes_on(5))


def test_a_link_that_was_lost_and_an_estimate_that_jumped_for_good_are_believed_soon():
    positions = Positions()
    positions.goes_on(20)
    positions.now_s, positions.boot_s = positions.now_s + 30.0, positions.boot_s + 30.0
    assert positions.goes_on(POSITIONS_AGREEING) == [False] * (POSITIONS_AGREEING - 1) + [True]
    places = [positions.reports(positions.boot_s, AWAY)]
    for _ in range(9):
        positions.now_s, positions.boot_s = positions.now_s + 0.1, positions.boot_s + 0.1
        places.append(positions.reports(positions.boot_s, AWAY))
    assert places[:POSITIONS_AGREEING] == [False] * POSITIONS_AGREEING
    assert places[-1]


def test_a_fast_simulation_that_stood_still_goes_on():
    positions = Positions(rate=20.0)
    assert all(positions.goes_on(20) + positions.goes_on(5, step_s=30.0))
