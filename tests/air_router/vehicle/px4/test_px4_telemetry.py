"""What is reported of a PX4: each message as telemetry or an event, and heights that stay."""

import pytest

from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.px4.px4_events import event_id
from air_router.vehicle.vehicle import FlightMode, ItemReached, PlanReplaced, WrongVehicle

HOLD, MISSION, POSITION = 0x03040000, 0x04040000, 0x00030000
HOME_AMSL_M = 6.7  # where the pretended vehicle took off
GPS = {"fix_type": 3, "satellites_visible": 12, "alt": 530_500}


def at(px4, above_home_m=40.0, *, home_m=HOME_AMSL_M, **changes):
    """Its telemetry at a height above a home that is so high above the sea."""
    px4.boot_s += 0.1
    heights = {"alt": home_m + above_home_m, "relative_alt": above_home_m}
    heights = {name: round(height_m * 1000) for name, height_m in heights.items()}
    px4.sends("GLOBAL_POSITION_INT", **heights, **changes)
    return px4.last


def test_a_position_becomes_telemetry(px4, pennovation):
    px4.east_m -= 0.2
    reported = at(px4, vx=100, vy=-200, hdg=65535)
    assert reported.position == pytest.approx((pennovation.home.east_m - 0.2, 0.0), abs=0.02)
    assert reported.velocity_m_s == (-2.0, 1.0)  # east, north
    assert reported.time_s == pytest.approx(px4.boot_s)
    assert (reported.altitude_m, reported.altitude_amsl_m, reported.heading_deg) == (
        40.0,
        46.7,
        None,
    )
    assert (reported.armed, reported.mode) == (True, FlightMode.MISSION)


def test_a_mode_is_reported_the_moment_that_it_changes(px4):
    px4.events.clear()
    for mode in (MISSION, MISSION, HOLD, POSITION):
        px4.sends("HEARTBEAT", custom_mode=mode)
    px4.sends("CURRENT_MODE", custom_mode=MISSION, intended_custom_mode=MISSION)
    modes = [event.mode for event in px4.events]
    assert modes == [FlightMode.HOLD, FlightMode.POSITION, FlightMode.MISSION]


def test_a_position_that_is_none_is_left_out(px4):
    reported = px4.last
    at(px4, lat=2_000_000_000)
    assert px4.telemetry.snapshot().position == reported.position


def moves_home(px4, east_m):
    home = px4.mission.home
    place = home._replace(east_m=home.east_m + east_m)
    latitude_deg, longitude_deg = px4.mission.frame.to_geodetic(place)
    degrees = {"latitude": round(latitude_deg * 1e7), "longitude": round(longitude_deg * 1e7)}
    px4.sends("HOME_POSITION", **degrees, altitude=round(HOME_AMSL_M * 1000))


def test_heights_count_from_the_home_of_the_take_off(px4):
    reported = at(px4, 65.0, home_m=HOME_AMSL_M - 25.0)  # another station has moved home 25 m down
    assert reported.altitude_m == pytest.approx(40.0)
    assert reported.home_moved == pytest.approx(HomeMove(0.0, 0.0, -25.0))
    reported = at(
        px4, 40.0, home_m=HOME_AMSL_M - 25.0
    )  # it sinks: PX4 keeps 40 m above the home of now
    assert reported.altitude_m == pytest.approx(15.0)
    reported = at(px4, 40.0)
    assert (reported.altitude_m, reported.home_moved) == (40.0, None)


def test_the_height_of_a_target_counts_from_the_home_of_the_take_off_too(px4):
    at(px4, 65.0, home_m=HOME_AMSL_M - 25.0)
    px4.sends("POSITION_TARGET_GLOBAL_INT", alt=HOME_AMSL_M + 48.0)
    assert px4.telemetry.snapshot().target_altitude_m == pytest.approx(48.0)
    px4.sends("POSITION_TARGET_GLOBAL_INT", alt=None)  # MAVSDK's form of NaN
    assert px4.telemetry.snapshot().target_altitude_m is None


def test_a_home_moved_aside_is_reported(px4):
    moves_home(px4, 0.0)
    at(px4)
    moves_home(px4, 60.0)
    reported = at(px4)
    assert reported.home_moved == pytest.approx(HomeMove(60.0, 0.0, 0.0), abs=0.1)
    assert reported.altitude_m == 40.0


def test_px4_corrects_its_home_by_itself_and_nothing_is_reported(px4):
    for off_m in (-1.1, 1.2, -2.3, 2.3):  # as measured on PX4 1.17, up to 2.3 m
        reported = at(px4, home_m=HOME_AMSL_M + off_m)
        assert (reported.altitude_m, reported.home_moved) == (40.0, None)


def test_before_take_off_home_is_where_the_autopilot_has_it_and_near_the_vehicle(px4):
    for _ in range(2):  # so high, one alone may be another vehicle's
        px4.sends("HEARTBEAT", base_mode=0)
    px4.sends("EXTENDED_SYS_STATE", landed_state=1)
    for above_home_m, home_m, moved in ((0.3, 488.7, None), (0.0, 492.0, None), (25.0, 467.0, -25)):
        reported = at(px4, above_home_m, home_m=home_m).home_moved
        assert (None if reported is None else round(reported.up_m)) == moved


def test_a_system_time_that_comes_late_is_no_reboot(px4):
    px4.sends("SYSTEM_TIME", time_unix_usec=1_700_000_000_000_000)
    before_s, unix_s = px4.clock.boot_s(), px4.clock.now_s()
    late_ms = round((px4.boot_s - 1.5) * 1e3)
    px4.sends("SYSTEM_TIME", time_boot_ms=late_ms, time_unix_usec=1_600_000_000_000_000)
    assert (px4.clock.boot_s(), px4.clock.now_s()) == (before_s, unix_s)


def test_a_repeated_report_of_an_item_is_one_event(px4):
    for seq in (3, 3, 3, 4, 4):
        px4.sends("MISSION_ITEM_REACHED", seq=seq)
    assert [e.item for e in px4.events if isinstance(e, ItemReached)] == [3, 4]


def has(px4, plan, fence=7, rally=3):
    px4.sends("MISSION_CURRENT", mission_id=plan, fence_id=fence, rally_points_id=rally)
    return [event for event in px4.events if isinstance(event, PlanReplaced)]


def test_another_plan_is_reported_each_time_and_only_when_guarded(px4):
    assert not has(px4, 1) + has(px4, 2)
    px4.telemetry.guard_plan(None)
    assert [len(has(px4, plan)) for plan in (2, 2, 3, 4)] == [0, 0, 1, 2]


def test_a_fence_that_came_after_ours_was_read_and_before_anything_was_reported_is_another(px4):
    has(px4, 1, fence=7)
    read = px4.telemetry.plan.ids
    px4.telemetry.guard_plan(read)
    (event,) = has(px4, 1, fence=8)
    assert event.only_fence


@pytest.mark.parametrize(
    ("ids", "only_fence"),
    [((1, 8), True), ((2, 7), False), ((2, 8), False), ((1, 7, 4), False), ((1, 8, 4), False)],
)
def test_another_fence_is_distinguished_from_another_mission_and_other_rally_points(
    px4, ids, only_fence
):
    px4.telemetry.guard_plan(None)
    has(px4, 1)
    (event,) = has(px4, *ids)
    assert event.only_fence is only_fence


def test_why_a_plan_is_refused_is_kept_until_something_else_is_requested(px4):
    telemetry = px4.telemetry
    event = {"log_levels": 0x33, "arguments": [3, 0, *[0] * 38]}
    px4.sends("EVENT", id=event_id("navigator_mis_geofence_violation"), **event)
    px4.sends("EVENT", id=event_id("check_battery_low"), **event)
    assert telemetry.refusals == [
        "plan item 3 lies in a no-fly zone, outside the fence, or beyond GF_MAX_HOR/VER_DIST"
    ]
    assert "plan item 3" in telemetry.texts()
    assert "battery" not in telemetry.texts()
    telemetry.forget_texts()
    assert (telemetry.refusals, telemetry.texts()) == ([], "")


def test_a_lost_fix_and_the_target_show_in_telemetry(px4, pennovation):
    px4.sends("POSITION_TARGET_GLOBAL_INT")
    reported = at(px4)
    assert (reported.fix, reported.target) == (True, pytest.approx(pennovation.home, abs=0.1))
    px4.sends("POSITION_TARGET_GLOBAL_INT", lat_int=0, lon_int=0)  # and not 5,000 km away
    assert at(px4).target is None
    px4.sends("GPS_RAW_INT", fix_type=1)
    assert not at(px4).fix
    px4.sends("HEARTBEAT", custom_mode=HOLD)
    assert px4.last.target is None  # it was the other mode's


def test_the_wind_that_px4_estimates_is_reported(px4):
    assert at(px4).wind_m_s is None
    px4.sends("WIND_COV", wind_x=-3.0, wind_y=4.0)  # MAVLink: x north, y east
    assert at(px4).wind_m_s == (4.0, -3.0)
    px4.sends("WIND_COV", wind_x=None, wind_y=None)
    assert at(px4).wind_m_s is None


def test_the_receiver_s_altitude_counts_while_it_is_new(px4):
    px4.boot_s += 0.1
    px4.sends("GPS_RAW_INT", **GPS, time_usec=round(px4.boot_s * 1e6))
    assert at(px4).gps_amsl_m == 530.5
    px4.boot_s += 1.3
    assert at(px4).gps_amsl_m == 530.5
    px4.boot_s += 0.1
    assert at(px4).gps_amsl_m is None
    px4.sends("GPS_RAW_INT", **GPS | {"fix_type": 1}, time_usec=round(px4.boot_s * 1e6))
    assert at(px4).gps_amsl_m is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"kind": 1}, "fixed wing"), ({"vtol": 4}, "VTOL"), ({"autopilot": 3}, "ArduPilot, not PX4")],
)
def test_another_vehicle_on_the_link_is_reported_once_and_when_it_is_gone(px4, changes, reason):
    def reported():
        return [event.why_not for event in px4.events if isinstance(event, WrongVehicle)]

    for name, value in changes.items():
        setattr(px4, name, value)
    px4.run(1.5)
    assert reported() == []  # one HEARTBEAT may be a stray frame
    px4.run(20.0)
    (why,) = reported()
    assert reason in why
    px4.kind, px4.vtol, px4.autopilot = 2, 0, 12
    px4.run(8.0)
    assert reported() == [why]
    px4.run(4.0)
    assert reported() == [why, None]
