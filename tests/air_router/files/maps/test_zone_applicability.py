"""Which zones apply to a mission: by altitude and time, at home, in cruise, and below it."""

from datetime import UTC, datetime, timedelta

import pytest

from air_router.cli.cli import main
from air_router.controller.model.mission_context import MissionContext
from air_router.controller.model.states import State
from air_router.controller.model.task import Goal, Progress
from air_router.controller.motion.command_gate import CommandGate
from air_router.controller.motion.navigator import Navigator
from air_router.errors import ExitCode
from air_router.mission.loading import load_mission
from air_router.mission.mission import COMING_HOME, LAUNCH_WAIT, FlightWindow
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.airspace.zone import Band
from geo.frame import Point
from mocha_link.team.document import DocumentError
from tests.air_router.conftest import PretendFlight

BASE = """\
coordinates: local
frame: {origin: [38.5, -98.5]}
home: {position: [0, 0], altitude_amsl_m: 400}
altitude_m: 40
waypoints: [[100, 0], {position: [100, 100], altitude_m: 60}]
fence: null
"""
START = datetime(2026, 11, 20, 9, tzinfo=UTC)  # a Friday


def load(folder, rest, *, start=START, base=BASE):
    path = folder / "mission.yaml"
    path.write_text(base + rest)
    return load_mission(path, start=start)


def problems(folder, rest, **options):
    with pytest.raises(DocumentError) as caught:
        load(folder, rest, **options)
    return [each for each in caught.value.problems if each.code != "unusual-value"]


def zone(at, more):
    return f"no_fly_zones: [{{name: z, circle: {{centre: {at}, radius_m: 20}}, {more}}}]\n"


def applied(mission):
    """Whether the only zone counts in cruise, and from the ground up."""
    return bool(mission.airspace.zones), bool(mission.climb_airspace.zones)


@pytest.mark.parametrize(
    ("altitude", "expected"),
    [
        ("{}", (True, True)),
        ("{lower_m: 0, upper_m: 120}", (True, True)),
        ("{lower_m: 65.1}", (False, False)),  # flown: 40 to 60 m, and 5 m of margin
        ("{lower_m: 65}", (True, True)),
        ("{upper_m: 35}", (True, True)),
        ("{upper_m: 34.9}", (False, True)),
        ("{upper_m: 434.9, reference: amsl}", (False, True)),
        ("{lower_m: 465, reference: amsl}", (True, True)),
        ("{lower_m: 466, reference: amsl}", (False, False)),
        ("{upper_m: 15, reference: ground}", (True, True)),  # the ground may be 20 m higher there
        ("{upper_m: 14.9, reference: ground}", (False, True)),
        ("{lower_m: 85, reference: ground}", (True, True)),  # or 20 m lower
        ("{lower_m: 85.1, reference: ground}", (False, False)),
        ("{lower_m: 10, upper_m: 434, upper_reference: amsl}", (False, True)),
        ("{lower_m: 466, lower_reference: amsl, upper_m: 500}", (False, False)),
    ],
)
def test_zones_count_by_their_altitudes(tmp_path, altitude, expected):
    mission = load(tmp_path, zone([50, 200], f"altitude: {altitude}"))
    assert applied(mission) == expected
    assert len(mission.zones) == 1
    assert mission.cruise == Band(35, 65)
    assert [(idle.zone.name, idle.below) for idle in mission.idle_zones] == (
        [] if expected[0] else [("z", expected[1])]
    )
    for idle in mission.idle_zones:
        assert "above home, the mission flies at 35 to 65 m" in idle.reason


@pytest.mark.parametrize(
    ("active", "hours", "expected"),
    [
        ('[{from: "2026-11-20T10:00:00Z"}]', 0.5, True),  # coming home takes ten minutes
        ('[{from: "2026-11-20T11:00:00Z"}]', 0.9, True),  # and the start may be an hour late
        ('[{from: "2026-11-20T11:00:00Z"}]', 0.1, False),
        ('[{from: "2026-11-20T11:00:00+02:00"}]', 0.1, True),
        ('[{until: "2026-11-20T09:00:00Z"}]', 1, True),
        ('[{until: "2026-11-20T08:59:59Z"}]', None, False),
        ('[{from: "2040-01-01T00:00:00Z"}]', None, True),  # without a duration it flies for ever
        ('[{days: [fri], between: ["12:00", "13:00"]}]', 1, False),
        ('[{days: [friday], between: ["10:30", "13:00"]}]', 1, True),
        ('[{between: ["22:00", "09:00"]}]', 1, True),
        ("[{days: [Mon, TUESDAY]}]", 1, False),
        ('[{days: [sat]}, {between: ["00:00", "24:00"]}]', 1, True),
    ],
)
def test_zones_count_by_time(tmp_path, active, hours, expected):
    load(tmp_path, zone([50, 200], f"active: {active}"))
    duration_s = None if hours is None else hours * 3600.0
    mission = load_mission(tmp_path / "mission.yaml", start=START, duration_s=duration_s)
    assert applied(mission) == (expected, expected)
    if not expected:
        (idle,) = mission.idle_zones
        assert idle.reason.startswith("applies ")
        assert "the flight is from 2026-11-20 09:00" in idle.reason
        assert not idle.below


def test_the_window_of_a_flight():
    now = START
    assert FlightWindow.of(now, None, None) == FlightWindow(now, None, None)
    late = now + LAUNCH_WAIT
    ends = late + timedelta(seconds=600) + COMING_HOME
    assert FlightWindow.of(now, None, 600) == FlightWindow(now, ends, late)
    assert str(FlightWindow.of(now, None, 600)) == "2026-11-20 09:00 to 2026-11-20 10:20 UTC"
    far = FlightWindow.of(now, None, 600, way_home_s=900)
    assert far.end == late + timedelta(seconds=600 + 900)
    assert str(FlightWindow.of(START, None, None)) == "2026-11-20 09:00 on UTC"


def test_by_day_it_is_refused_and_by_night_it_flies(tmp_path, capsys):
    path = tmp_path / "mission.yaml"
    path.write_text(
        BASE + zone([100, 0], 'active: [{between: ["07:00", "18:00"]}]') + "duration_s: 600\n"
    )
    command = ["plan", str(path), "--from", "0", "--to", "1", "--at"]
    assert main([*command, "2026-11-20T12:00:00Z"]) == ExitCode.INVALID_FILE
    assert "[waypoint-in-zone]" in capsys.readouterr().err
    assert main([*command, "2026-11-20T20:00:00Z"]) == ExitCode.DONE
    assert main([*command, "2026-11-20T20:00:00-08:00"]) == ExitCode.DONE
    capsys.readouterr()
    for wrong in ("noon", "2026-11-20T20:00:00", "20:00"):
        assert main([*command, wrong]) == ExitCode.USAGE
        assert "is not a time with its time zone" in capsys.readouterr().err
    for wrong in ("9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z"):
        assert main([*command, wrong]) == ExitCode.USAGE
        assert "is not in the years 1970 to 9000" in capsys.readouterr().err
    assert main(["fly", str(path), "--duration", "1e12"]) == ExitCode.USAGE
    assert "at most 1e9" in capsys.readouterr().err


def test_home_and_rally_points_keep_what_counts_from_the_ground_up(tmp_path):
    for place, rest, code in (
        ("home", zone([0, 10], "altitude: {upper_m: 10}"), "home-in-zone"),
        ("home", zone([0, 25], "altitude: {upper_m: 10}"), "home-too-near"),
        (
            "rally",
            "rally_points: [[300, 0]]\n" + zone([300, 9], "altitude: {upper_m: 10}"),
            "rally-point-in-zone",
        ),
    ):
        assert [problem.code for problem in problems(tmp_path, rest)] == [code], place
    over = load(tmp_path, zone([100, 0], "altitude: {upper_m: 10}"))  # a waypoint above the zone
    assert over.planning_airspace.point_clear(Point(100, 0))
    assert load(tmp_path, zone([0, 0], "altitude: {lower_m: 90}")).airspace.zones == ()


def test_altitudes_above_the_sea_need_home_s(tmp_path):
    base = BASE.replace("{position: [0, 0], altitude_amsl_m: 400}", "[0, 0]")
    above_the_sea = zone([50, 200], "altitude: {lower_m: 500, reference: amsl}")
    (problem,) = problems(tmp_path, above_the_sea, base=base)
    assert problem.code == "home-altitude-unknown"
    assert (problem.line, problem.column) == (7, 16)
    assert "add 'altitude_amsl_m' to home" in problem.message


def test_a_zone_has_its_own_clearance(tmp_path):
    near = zone([100, 40], "clearance_m: 18.4")
    assert load(tmp_path, near).planning_airspace.distances_m == (19.9,)
    (problem,) = problems(tmp_path, zone([100, 40], "clearance_m: 18.6"))
    assert problem.code == "waypoint-too-near"
    assert problem.message == (
        "waypoint 1 is 20.0 m from no-fly zone 'z', it needs 20.1 m (clearance 18.6 m + tracking "
        "margin 1.5 m); move it by 0.10 m or lower its clearance_m"
    )


def test_the_airspace_at_an_altitude(tmp_path):
    mission = load(tmp_path, zone([50, 200], "altitude: {upper_m: 10}"))
    assert mission.airspace_at(35) is mission.airspace
    assert mission.airspace_at(9.9) is mission.climb_airspace
    assert mission.airspace_at(34.9).zones == mission.airspace.zones  # it is below


def telemetry(altitude_m):
    return Telemetry(
        time_s=10.0,
        position=Point(50.0, 0.0),
        altitude_m=altitude_m,
        velocity_m_s=(0.0, 0.0),
        armed=True,
        in_air=True,
        mode=FlightMode.HOLD,
        failsafe=False,
        battery=1.0,
    )


@pytest.mark.parametrize(
    ("altitude", "within", "beside", "why"),
    [
        ("upper_m: 10", 12.0, 36.0, "lower than the mission flies, where z is in the way; climb"),
        ("lower_m: 80", 100.0, 64.0, "higher than the mission flies, where z is in the way; desce"),
    ],
)
def test_no_leg_crosses_a_zone_at_whose_altitude_it_is_not_flown(
    tmp_path, altitude, within, beside, why
):
    mission = load(tmp_path, zone([50, 40], f"altitude: {{{altitude}}}"))
    context = MissionContext(mission, PretendFlight(mission).router)
    navigator = Navigator(context, CommandGate(context, None))
    beyond, context.telemetry = Goal(Point(50.0, 90.0)), telemetry(beside)
    assert navigator.plan_to(beyond) is not None
    assert context.task.way.progress is Progress.FLYING
    context.telemetry = telemetry(within)
    planned = navigator.plan_to(beyond)
    assert context.interlocks.climb_required == (
        within < beside
    )  # low, it climbs before it flies on
    if context.interlocks.climb_required:
        return
    assert planned is None
    assert context.task.way.progress is Progress.NO_ROUTE
    reason = f"the vehicle is {within:.0f} m above home, {why}"
    assert context.task.way.refusal.reason.startswith(reason)
    assert context.task.way.refusal.blockers == ("z",)
    assert navigator.plan_to(Goal(Point(90.0, 0.0))) is not None


@pytest.mark.parametrize(("altitude", "within_m"), [("upper_m: 10", 8.0), ("lower_m: 80", 90.0)])
def test_in_a_zone_is_a_breach_only_at_its_altitude(tmp_path, altitude, within_m):
    mission = load(tmp_path, zone([50, 40], f"altitude: {{{altitude}}}"))
    flight = PretendFlight(mission, seek=())
    flight.take_off()
    flight.fly_to_state(State.INIT)
    flight.position, flight.velocity = Point(50.0, 40.0), (0.0, 0.0)
    flight.step()
    assert not any("breach" in text for text in flight.announced)
    flight.altitude_m = within_m
    flight.position, flight.velocity = Point(52.0, 40.0), (0.0, 0.0)
    flight.step()
    assert any("breach of z" in text for text in flight.announced)


def test_a_start_is_late_only_where_zones_come_and_go(tmp_path):
    text = zone([50, 200], "active: [{days: [sun]}]") + "duration_s: 600\n"
    assert load(tmp_path, text).latest_start == START + LAUNCH_WAIT
    text = zone([50, 200], "crosses_fence: true") + "duration_s: 600\n"
    assert load(tmp_path, text).latest_start is None
    assert load(tmp_path, zone([50, 200], "active: [{days: [sun]}]")).latest_start is None


CONTRADICTING = (
    "altitude: {lower_m: 0, lower_reference: ground, upper_m: 100, upper_reference: amsl}"
)


def test_limits_that_exclude_each_other_here_make_the_larger_zone(tmp_path):
    mission = load(tmp_path, zone([50, 50], CONTRADICTING))
    assert applied(mission) == (True, True)
    (note,) = mission.notes
    assert note.code == "altitudes-contradict"
    assert note.message == (
        "no-fly zone 'z' reaches from 0 m above ground up to 100 m above the sea, and home is "
        "400 m above the sea: its limits exclude each other here; read as at every altitude"
    )


@pytest.mark.parametrize(
    "limits", ["100, upper_m: 0, reference: amsl", "60, upper_m: 50, reference: ground"]
)
def test_limits_of_one_reference_that_exclude_each_other_are_wrong(tmp_path, limits):
    inverted = f"altitude: {{lower_m: {limits}}}"
    (problem,) = problems(tmp_path, zone([50, 50], inverted))
    assert problem.code == "zone-altitudes-inverted"


def test_limits_of_two_references_that_agree_are_kept(tmp_path):
    agreeing = CONTRADICTING.replace("100", "500")
    mission = load(tmp_path, zone([50, 50], agreeing))
    assert mission.zones[0].band == Band(-20, 100)
    assert mission.notes == ()


def test_corners_on_a_line_in_degrees_are_a_zone_that_is_kept_away_from(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(
        "home: [46.52, 6.56]\naltitude_m: 40\nwaypoints: [[46.5205, 6.561]]\nfence: null\n"
        "no_fly_zones: [[[46.521, 6.565], [46.522, 6.566], [46.523, 6.567]]]\n"
    )
    mission = load_mission(path)
    on_the_line = mission.frame.to_local(46.5215, 6.5655)
    assert not mission.airspace.point_clear(on_the_line)
    assert abs(mission.airspace.distance_m(on_the_line)) < 0.01
