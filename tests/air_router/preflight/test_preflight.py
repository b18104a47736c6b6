import asyncio
import dataclasses
import math
from types import SimpleNamespace
from typing import get_args

import pytest

from air_router.cli.preflight import _plan
from air_router.errors import NotConfirmedError, PlanRefusedError
from air_router.files.mission_form import Accepted
from air_router.preflight import preflight
from air_router.preflight.card import BAD, GOOD, LOOK, Card, Check, PreflightRefusedError
from air_router.preflight.preflight import CLIMB_M_S
from air_router.preflight.preflight_parameters import names, parameters, straight_return
from air_router.preflight.preflight_survey import PreflightSurvey
from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import LANDING_MARGIN
from air_router.routing.return_planner import ReturnPlanner
from air_router.routing.router import Router
from air_router.vehicle.airframe import Airframe
from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.px4.px4_events import WORDS
from air_router.vehicle.vehicle import FlightMode, GpsFix, Inspection, Telemetry, VehicleInfo
from geo.airspace.zone import Band, Circle, Zone
from geo.frame import Point
from mocha_link.team.document import Problem

WANTED = {
    "GF_ACTION": 2,
    "GF_SOURCE": 0,
    "NAV_ACC_RAD": 2.0,
    "MPC_ACC_HOR": 3.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_XY_VEL_MAX": 12.0,
    "COM_RC_OVERRIDE": 1,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "COM_OBC_LOSS_T": 5.0,
    "COM_LOW_BAT_ACT": 3,
    "BAT_CRIT_THR": 0.07,
    "COM_DISARM_PRFLT": 10.0,
    "RTL_RETURN_ALT": 60.0,
    "RTL_DESCEND_ALT": 10.0,
    "RTL_TYPE": 0,
    "COM_RC_IN_MODE": 1,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
}
"""Of a PX4 1.17, and before."""

SINCE_1_18 = {"MAN_OVERRIDE_SPD": 1.0, "COM_GNSSLOSS_ACT": 0, "COM_FLTMODE_BOOT": 4}
GONE_IN_1_18 = ("COM_RC_OVERRIDE", "COM_OBC_LOSS_T")
WANTED_1_18 = {k: v for k, v in WANTED.items() if k not in GONE_IN_1_18} | SINCE_1_18
OLD, NEW, NEXT = (1, 17), (1, 18), (1, 19)
NAMES = names(OLD)


HOME = Point(0.0, 0.0)


def info(version="1.17.0", home=HOME, kind=2):
    return VehicleInfo(1, "PX4", version, home, 6.7, airframe=Airframe(kind))


def telemetry(**changes):
    values = {"time_s": 1.0, "position": Point(0.0, 0.0), "altitude_m": 0.0} | changes
    return Telemetry(**{"mode": FlightMode.HOLD} | values)


@pytest.fixture(scope="session")
def router(pennovation):
    return Router(WaypointGraph(pennovation))


NOW_S = 1.8e9
OFF = Inspection(unix_s=NOW_S + 60.0)
FAR_OFF = Inspection(unix_s=NOW_S + 3600.0)
LINES = {
    GOOD: [
        *(preflight.vehicle(info(f"1.{minor}.2")) for minor in (15, 16, 17, 18)),
        *(preflight.vehicle(info(kind=kind)) for kind in (13, 14, 15)),
        preflight.gps(GpsFix(3, 14, 0.8), 1.0),
        preflight.clock(Inspection(unix_s=NOW_S + 1.0), NOW_S),
        preflight.disk(10**10),
        preflight.peers({"io": True, "europa": True}),
    ],
    LOOK: [
        *(preflight.vehicle(info(version)) for version in ("1.19.0", "of unknown version")),
        preflight.gps(None, 1.0),
        *(preflight.gps(GpsFix(*fix), 1.0) for fix in ((3, 8, 1.0), (3, 14, 5.0), (6, None, 0.8))),
        *(preflight.clock(found, NOW_S) for found in (OFF, FAR_OFF, Inspection())),
        preflight.clock(OFF, NOW_S, hours=True),
        *map(preflight.disk, (None, 2 * 10**8)),
        preflight.peers({}),
    ],
    BAD: [
        preflight.vehicle(info("1.14.3")),
        *(preflight.vehicle(info(kind=kind)) for kind in (1, 4, 10, 22)),
        *(preflight.gps(GpsFix(*fix), 1.0) for fix in ((1, 0), (2, 5), (3, 5))),
        preflight.clock(Inspection(), 1000.0),
        preflight.clock(FAR_OFF, NOW_S, hours=True),  # zones apply at certain hours
        preflight.disk(10**6),
    ],
}


@pytest.mark.parametrize(
    ("verdict", "line"),
    [(verdict, line) for verdict, lines in LINES.items() for line in lines],
    ids=str,
)
def test_how_a_line_of_the_card_stands(verdict, line):
    assert line.verdict is verdict


def test_peers_that_do_not_answer_are_named():
    away = preflight.peers({"io": True, "europa": False})
    assert (away.verdict, away.found) == (LOOK, "europa: no node answers now")


def test_a_vehicle_that_flies_or_is_armed_is_left_alone():
    assert preflight.standing(telemetry()).verdict is GOOD
    flying = preflight.standing(telemetry(in_air=True, armed=True))
    assert (flying.verdict, "flying" in flying.found) == (BAD, True)
    assert "armed" in preflight.standing(telemetry(armed=True)).found


def test_another_type_of_vehicle_is_not_queried_and_the_card_has_what_to_do(pennovation, router):
    survey = PreflightSurvey(pennovation, router)
    card = asyncio.run(survey.card(None, info(kind=1), telemetry()))  # there is no vehicle to query
    (line,) = card.bad
    assert (
        "fixed wing, PX4 1.17.0, system 1: the vehicle is a fixed wing (MAV_TYPE 1)" in line.found
    )
    assert "connect a multicopter" in line.advice


def test_the_place(pennovation, router):
    def check(position=None, home=None):
        at = telemetry(position=position or pennovation.home)
        return preflight.place(pennovation, router, info(home=home or pennovation.home), at)

    assert check().verdict is GOOD
    away = Point(pennovation.home.east_m + 40.0, pennovation.home.north_m)
    assert "40 m from the mission's home" in check(position=away).found
    outside = check(home=Point(5000.0, 0.0))
    assert outside.verdict is BAD
    assert "outside the fence" in outside.found
    beside = Point(pennovation.home.east_m + 25.0, pennovation.home.north_m)
    assert "home is 25 m from the mission's" in check(home=beside).found
    nowhere = preflight.place(
        pennovation, router, info(home=None), telemetry(position=pennovation.home)
    )
    assert nowhere.verdict is LOOK


def test_it_may_not_stand_below_a_zone_that_ends_below_the_altitudes_of_the_mission(pennovation):
    here = Point(pennovation.home.east_m + 15.0, pennovation.home.north_m)
    shed = Zone("shed", Circle(here, 6.0), band=Band(-math.inf, 12.0))
    mission = pennovation.with_areas(pennovation.fences, (*pennovation.zones, shed))
    router = Router(WaypointGraph(mission))
    for position, verdict in ((mission.home, GOOD), (here, BAD)):
        at = telemetry(position=position)
        assert preflight.place(mission, router, info(home=mission.home), at).verdict is verdict


def test_a_home_that_is_not_as_high_as_the_vehicle_stands(pennovation):
    at = telemetry(position=pennovation.home, home_moved=HomeMove(0.0, 0.0, -25.0))
    (check,) = preflight.altitude(pennovation, info(home=pennovation.home), at)
    assert check.verdict is BAD
    assert "home is 25 m below where it stands" in check.found


@pytest.mark.parametrize(
    ("wind_m_s", "verdict", "found"),
    [
        (None, LOOK, "does not report"),
        ((3.0, -4.0), GOOD, "5 m/s from north-west"),
        ((-9.0, 0.0), LOOK, "9 m/s from east"),
    ],
)
def test_the_wind(wind_m_s, verdict, found):
    check = preflight.wind(wind_m_s, 5.0)
    assert (check.verdict, found in check.found) == (verdict, True)
    assert (verdict is GOOD) or "5 m/s are planned for" in check.advice


def test_an_accuracy_that_the_mission_is_not_planned_for_is_on_the_card():
    check = preflight.gps(GpsFix(3, 14, 1.4), 1.0)
    assert check.verdict is LOOK
    assert "planner.position_accuracy_m" in check.advice
    assert preflight.gps(GpsFix(3, 14, 1.4), 1.5).verdict is GOOD


def test_what_is_good_on_the_ground_reaches_the_farthest_waypoint_in_flight(pennovation, router):
    return_planner = ReturnPlanner(router)
    _, way = return_planner.worst_waypoint
    out_s = pennovation.altitude_above_home_m / CLIMB_M_S + return_planner.pace.time_s(way)
    for reserve in (0.0, 0.25):
        turning = max(reserve, return_planner.pace.home_s(way) / 1500 + LANDING_MARGIN)
        for spare, verdict in ((0.001, GOOD), (-0.001, BAD)):
            charge = turning + out_s / 1500 + spare
            wanted = {"endurance_s": 1500.0, "duration_s": None, "battery_reserve": reserve}
            mission = dataclasses.replace(pennovation, **wanted)
            assert preflight.battery(mission, router, charge, 15.8).verdict is verdict


@pytest.mark.parametrize(
    ("charge", "times_s", "verdict"),
    [
        (None, (1500.0, None), LOOK),
        (0.9, (None, None), LOOK),
        (0.4, (None, None), BAD),
        (1.0, (1500.0, None), GOOD),
        (1.0, (1500.0, 600.0), GOOD),
        (1.0, (1500.0, 1400.0), LOOK),
        (0.3, (1500.0, None), BAD),
        (0.1, (1500.0, None), BAD),
    ],
)
def test_the_charge_against_the_mission(pennovation, router, charge, times_s, verdict):
    times = dict(zip(("endurance_s", "duration_s"), times_s, strict=True))
    found = preflight.battery(dataclasses.replace(pennovation, **times), router, charge, 15.8)
    assert (found.verdict, bool(found.advice)) == (verdict, verdict is not GOOD)


def test_health_has_the_reason():
    check = preflight.health(Inspection(healthy=False, problems=("no fix", "no compass")))
    assert check.verdict is BAD
    assert check.advice == "no fix; no compass"
    silent = preflight.health(Inspection(healthy=False))
    assert "ground station" in silent.advice
    assert preflight.health(Inspection(warnings=("low",))).verdict is LOOK
    assert preflight.health(Inspection()).verdict is GOOD


def test_the_altitude_that_zones_were_reckoned_with(pennovation):
    def verdicts(home_amsl_m, zones):
        mission = dataclasses.replace(pennovation, home_altitude_amsl_m=home_amsl_m, zones=zones)
        return [check.verdict for check in preflight.altitude(mission, info(), telemetry())]

    banded = (Zone("z", Circle(HOME, 5.0), band=Band(lower_m=100.0)),)
    assert verdicts(None, banded) == []
    assert verdicts(500.0, pennovation.zones) == []
    assert verdicts(6.0, banded) == [GOOD]
    assert verdicts(20.0, banded) == [LOOK]
    assert verdicts(60.0, banded) == [BAD]


def test_parameters_as_wanted(pennovation):
    assert set(WANTED) == set(NAMES)
    (check,) = parameters(pennovation, WANTED, version=OLD)
    assert (check.verdict, check.found) == (GOOD, f"{len(NAMES)} of {len(NAMES)} are as wanted")


@pytest.mark.parametrize(
    ("name", "value", "verdict"),
    [
        ("GF_ACTION", 0, BAD),
        ("GF_ACTION", 3, BAD),
        ("GF_ACTION", 4, BAD),
        ("GF_ACTION", 99, BAD),
        ("GF_MAX_HOR_DIST", 100.0, BAD),
        ("GF_MAX_HOR_DIST", 190.0, LOOK),
        ("GF_MAX_VER_DIST", 30.0, BAD),
        ("COM_RC_IN_MODE", 4, BAD),
        ("RTL_TYPE", 2, BAD),
        ("RTL_DESCEND_ALT", 80.0, BAD),
        ("NAV_ACC_RAD", 30.0, LOOK),
        ("MPC_ACC_HOR", 1.0, BAD),
        ("MPC_JERK_AUTO", 2.0, LOOK),
        ("MPC_XY_VEL_MAX", 1.0, LOOK),
        ("COM_RC_OVERRIDE", 2, BAD),
        ("NAV_DLL_ACT", 2, LOOK),
        ("NAV_DLL_ACT", 5, BAD),
        ("BAT_CRIT_THR", 0.3, BAD),
        ("COM_DISARM_PRFLT", -1.0, LOOK),
        ("RTL_RETURN_ALT", 5.0, BAD),
    ],
)
def test_a_parameter_that_is_not_as_wanted_is_shown_with_what_it_should_be_and_why(
    pennovation, name, value, verdict
):
    mission = dataclasses.replace(pennovation, accepts=())
    first, last = parameters(mission, WANTED | {name: value}, version=OLD)
    assert (first.name, first.verdict) == (name, verdict)
    assert first.advice.startswith("set it to ")
    assert last.found == f"{len(NAMES) - 1} of {len(NAMES)} are as wanted"


def test_parameters_that_are_not_reported(pennovation):
    first, last = parameters(pennovation, WANTED | {"GF_ACTION": None}, version=OLD)
    assert (first.verdict, first.found) == (LOOK, "not reported: GF_ACTION")
    assert last.found == f"{len(NAMES) - 1} of {len(NAMES)} are as wanted"


def test_a_vehicle_that_sends_and_answers_no_request_is_not_ready(pennovation):
    """A wire to its RX that is not there, or a signing key that we have not."""
    (only,) = parameters(pennovation, {}, version=None)
    assert (only.verdict, only.found) == (BAD, "PX4 answers no request")
    assert "--signing-key" in only.advice
    *_, last = parameters(pennovation, WANTED, version=None)
    assert last.verdict is GOOD


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("fence_action", {"GF_ACTION": 3}),
        ("sticks_do_not_override", {"COM_RC_OVERRIDE": 0, "COM_RC_IN_MODE": 4}),
        ("rtl_altitude", {"RTL_RETURN_ALT": 5.0, "RTL_DESCEND_ALT": 80.0}),
        ("rtl_type", {"RTL_TYPE": 4}),
    ],
)
def test_what_a_mission_file_accepts_by_name_does_not_stop_it(pennovation, name, values):
    for accepts, verdict in (((), BAD), ((name,), LOOK)):
        mission = dataclasses.replace(pennovation, accepts=accepts)
        *lines, _ = parameters(mission, WANTED | values, version=OLD)
        assert [(line.name, line.verdict) for line in lines] == [(v, verdict) for v in values]
        advised = [f"accepts: [{name}]" in line.advice for line in lines]
        assert advised == [not accepts] * len(values)


def test_no_mission_file_accepts_a_fence_that_does_nothing(pennovation):
    mission = dataclasses.replace(pennovation, accepts=get_args(Accepted))
    assert parameters(mission, WANTED | {"GF_ACTION": 0}, version=OLD)[0].verdict is BAD


def test_a_time_that_the_simulation_s_speed_multiplied_is_as_wanted(pennovation, router):
    values = WANTED | {"COM_OBC_LOSS_T": 25.0}
    lines = parameters(pennovation, values, version=OLD)
    assert [c.name for c in lines] == ["COM_OBC_LOSS_T", "parameters"]

    async def inspect(_):
        return Inspection(parameters=values)

    async def measured_rate():
        return 5.0

    clock, vehicle = SimpleNamespace(measured_rate=measured_rate), SimpleNamespace(inspect=inspect)
    survey = PreflightSurvey(pennovation, router, clock=clock)
    in_the_air = asyncio.run(survey.card_in_the_air(vehicle, info()))
    assert "COM_OBC_LOSS_T" not in {check.name for check in in_the_air.checks}
    lines = parameters(pennovation, values, version=OLD, rate=4.8)
    assert [c.name for c in lines] == ["parameters"]


def test_px4_1_18_is_not_queried_for_what_it_has_no_more_and_the_card_has_what_is_instead(
    pennovation,
):
    assert set(names(NEW)) == set(WANTED_1_18)
    (line,) = parameters(pennovation, WANTED_1_18, version=NEW)
    assert line.verdict is GOOD
    assert f"{len(WANTED_1_18)} of {len(WANTED_1_18)} are as wanted; PX4 1.18 has no" in line.found
    assert "COM_RC_OVERRIDE (MAN_OVERRIDE_SPD instead)" in line.found
    assert "COM_OBC_LOSS_T (5 s in any case)" in line.found


@pytest.mark.parametrize(
    ("version", "name", "value", "verdict"),
    [
        (NEW, "MAN_OVERRIDE_SPD", -1.0, BAD),
        (NEW, "NAV_RCL_ACT", 5, BAD),
        (OLD, "NAV_RCL_ACT", 7, LOOK),
        (NEW, "COM_GNSSLOSS_ACT", 3, BAD),
        (NEW, "COM_GNSSLOSS_ACT", 1, LOOK),
        (NEW, "COM_FLTMODE_BOOT", 3, LOOK),
        (NEW, "RTL_TYPE", 5, BAD),
    ],
)
def test_what_a_version_changed_about_a_parameter(pennovation, version, name, value, verdict):
    mission = dataclasses.replace(pennovation, accepts=())
    wanted = WANTED_1_18 if version == NEW else WANTED
    first, _ = parameters(mission, wanted | {name: value}, version=version)
    assert (first.name, first.verdict) == (name, verdict)


def test_hold_without_failsafe_is_new_in_1_18_and_sticks_may_be_left_off_by_name(pennovation):
    mission = dataclasses.replace(pennovation, accepts=("sticks_do_not_override",))
    values = WANTED_1_18 | {"NAV_RCL_ACT": 7, "MAN_OVERRIDE_SPD": -1.0}
    first, _ = parameters(mission, values, version=NEW)
    assert (first.name, first.verdict) == ("MAN_OVERRIDE_SPD", LOOK)


def test_a_newer_version_is_flown_with_a_look_at_what_was_not_verified_and_what_it_lacks(
    pennovation,
):
    line = preflight.vehicle(info("1.19.0"))
    assert (line.verdict, "mission_state" in line.advice) == (LOOK, True)
    values = WANTED_1_18 | {"GF_SOURCE": None}
    first, last = parameters(pennovation, values, version=NEXT, absent={"GF_SOURCE"})
    assert (first.verdict, first.found) == (LOOK, "PX4 1.19 has none: GF_SOURCE")
    assert "not reported" not in last.found


def test_a_vehicle_that_does_not_report_its_version_is_checked_for_all(pennovation):
    *lines, last = parameters(pennovation, WANTED | SINCE_1_18 | {"NAV_RCL_ACT": 5})
    assert [(line.name, line.verdict) for line in lines] == [("NAV_RCL_ACT", BAD)]
    assert last.found.startswith(f"{len(WANTED | SINCE_1_18) - 1} of")


def test_the_autopilot_s_own_return_knows_no_zones(pennovation):
    check = straight_return(pennovation)
    assert check.verdict is LOOK
    assert straight_return(dataclasses.replace(pennovation, accepts=())).verdict is BAD
    assert any(zone.name in check.found for zone in pennovation.zones)
    alone = dataclasses.replace(pennovation, waypoints=())
    assert straight_return(alone).verdict is GOOD


CARD = Card(
    (
        Check("GPS", GOOD, "fix"),
        Check("disk", LOOK, "no log", "keep one"),
        Check("health", BAD, "not ready", "no compass"),
    )
)


def test_the_card_on_paper_and_for_scripts():
    assert not CARD.ready
    assert CARD.lines() == [
        "ok    GPS     fix",
        "look  disk    no log\n              -> keep one",
        "stop  health  not ready\n              -> no compass",
    ]
    assert CARD.lines(all_of_them=False)[0].startswith("look")
    assert "\x1b[31mstop\x1b[0m" in CARD.lines(coloured=True)[2]
    assert CARD.as_json()["checks"][1] == {
        "name": "disk",
        "verdict": "look",
        "found": "no log",
        "advice": "keep one",
    }
    assert str(PreflightRefusedError(CARD)) == (
        "not ready to fly:\n  health: not ready; no compass"
    )


def test_what_is_not_flown_as_written_is_on_the_card(pennovation):
    assert preflight.notes(pennovation) == []
    note = Problem(pennovation.path, 7, 3, "item 4 is a spline; it is flown straight", "spline")
    long = Problem(pennovation.path, 9, 1, "the fence has 65 points", "fence-points")
    mission = dataclasses.replace(pennovation, notes=(note, long))
    check, refused = preflight.notes(mission)
    assert (check.verdict, check.found) == (LOOK, note.message)
    assert check.advice == "see mission.yaml:7"
    assert refused.verdict is BAD


@pytest.mark.parametrize(
    ("error", "found"),
    [
        (PlanRefusedError("8 items"), "another one is on board: 8 items"),
        (NotConfirmedError("no answer"), "not known: no answer"),
    ],
)
def test_a_plan_that_cannot_be_read_is_not_reported_as_another(error, found):
    async def recognise(_plan):
        raise error

    look = _plan(SimpleNamespace(recognise=recognise), None, upload=False)
    assert (check := asyncio.run(look)).found == found
    assert check.verdict is LOOK


def test_a_summary_counts_what_passed_what_warns_and_what_stops():
    assert CARD.summary == "1 of 3 checks passed; 1 warning, 1 to be fixed before the flight"
    assert Card(CARD.checks[:2]).summary == "1 of 2 checks passed; 1 warning"
    assert Card(CARD.checks[:1]).summary == "1 of 1 checks passed"


def test_what_a_simulation_cannot_have_is_not_judged(pennovation, router):
    warning = WORDS["check_modes_manual_control"]

    async def inspect(_):
        return Inspection(healthy=True, warnings=(warning, "low voltage"))

    def lines(*, simulated):
        vehicle = SimpleNamespace(inspect=inspect)
        survey = PreflightSurvey(pennovation, router, simulated=simulated)
        there = telemetry(position=pennovation.home)
        card = asyncio.run(survey.card(vehicle, info(home=pennovation.home), there))
        return {check.name: check for check in card.checks}

    real, simulated = lines(simulated=False), lines(simulated=True)
    assert real.keys() - simulated.keys() == {"wind", "clock"}
    assert warning in real["health"].advice
    assert simulated["health"].advice == "low voltage"
