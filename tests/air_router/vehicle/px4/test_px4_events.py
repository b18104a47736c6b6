import re
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.vehicle.px4.px4_events import (
    ARMING_SUMMARY,
    HEALTH_SUMMARY,
    WORDS,
    ArmingReports,
    Px4Event,
    event_id,
)

MISSION_MODE, MANUAL_MODE = 1 << 3, 1 << 0


def event(name, layout="", *values, level=3):
    return Px4Event(event_id(name), level, struct.pack("<" + layout, *values))


def check(name, *, modes=0xFFFFFFFF, level=3, layout="", values=()):
    return event(name, "IB" + layout, modes, 1, *values, level=level)


def reported(*findings):
    reports = ArmingReports()
    summary = event(ARMING_SUMMARY, "BIIII", 0, 0, 0, 0, 0, level=7)
    for each in (summary, *findings, event(HEALTH_SUMMARY, "BIII", 0, 0, 0, 0, level=7)):
        reports.take(each)
    return reports


def test_numbers_are_those_on_the_wire():
    # As recorded from a PX4 1.17: commander_armed_by.
    assert event_id("commander_armed_by") == 26266355


@pytest.mark.parametrize(
    ("event_", "words"),
    [
        (event("navigator_mis_geofence_violation", "h", 5), "plan item 5 lies in a no-fly zone"),
        (event("navigator_mis_unsup_cmd", "HH", 3, 99), "plan item 3 is a command .* know: 99"),
        (event("commander_failsafe_enter_hold", "IBHB", 0, 6, 5, 2), "station lost, Return in 5 s"),
        (event("commander_modeswitch_not_avail", "IB", 0, 7), "Offboard mode is not available"),
        (check("check_mag_consistency", layout="h", values=(40,)), "differ by 40 degrees"),
        (check("check_system_usb_connected"), "unplug it"),
        (Px4Event(0x01ABCDEF, 3), "0x01abcdef"),
    ],
)
def test_in_plain_words(event_, words):
    assert re.search(words, event_.text), event_.text


def test_fields_of_the_message():
    fields = {"id": event_id("check_battery_low"), "log_levels": 0x34, "arguments": [1, 2, 255]}
    read = Px4Event.of(fields)
    assert (read.name, read.level, read.arguments) == ("check_battery_low", 4, b"\x01\x02\xff")


@given(
    st.sampled_from(sorted(WORDS)), st.integers(0, 7), st.binary(max_size=40), st.integers(0, 2**32)
)
def test_every_event_has_words_whatever_its_arguments(name, level, arguments, number):
    assert Px4Event(event_id(name), level, arguments).text
    assert Px4Event(number, level, arguments).text
    reports = ArmingReports()
    reports.take(Px4Event(event_id(ARMING_SUMMARY), 7, arguments))
    reports.take(Px4Event(event_id(name), level, arguments))
    reports.take(Px4Event(event_id(HEALTH_SUMMARY), 7, arguments))


def test_a_report_is_what_stands_between_two_summaries():
    report = reported(
        check("check_estimator_gps_num_sats_too_low"),
        check("check_estimator_gps_num_sats_too_low"),
        check("check_battery_low", level=4),
        check("check_modes_manual_control", modes=MANUAL_MODE),
        event("commander_gcs_lost", level=4),
    )
    assert [p.partition(";")[0] for p in report.problems] == ["too few GPS satellites"]
    assert report.words.startswith(" (too few GPS satellites")
    assert [w.partition(";")[0] for w in report.warnings] == ["the battery is low"]


def test_a_healthy_vehicle():
    report = reported()
    assert (report.problems, report.warnings, report.words) == ((), (), "")


@pytest.mark.parametrize(("modes", "runs"), [(0x7F3BB8, True), (0x7F3BB0, False)])
def test_the_summary_has_whether_mission_mode_can_run(modes, runs):
    reports = ArmingReports()
    assert reports.mission_can_run is None
    # As recorded from a PX4 1.16.2 with and without a mission on board.
    reports.take(event(ARMING_SUMMARY, "BIIII", 0, 1 << 27, 1 << 15, modes, modes, level=7))
    assert reports.mission_can_run is None  # its report is not complete
    reports.take(event(HEALTH_SUMMARY, "BIII", 0, 0, 0, 0, level=7))
    assert reports.mission_can_run is runs


def test_a_summary_without_modes_decides_nothing_about_them():
    reports = ArmingReports()
    reports.take(event(ARMING_SUMMARY, "BII", 0, 0, 0, level=7))
    reports.take(event(HEALTH_SUMMARY, "BIII", 0, 0, 0, 0, level=7))
    assert (reports.count, reports.mission_can_run) == (1, None)


def test_half_a_report_is_none():
    reports = ArmingReports()
    reports.take(check("check_battery_low"))
    reports.take(event(HEALTH_SUMMARY, "BIII", 0, 0, 0, 0, level=7))
    assert (reports.problems, reports.count) == ((), 0)
