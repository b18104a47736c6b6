"""Missions for several UAVs: layers, homes, and what is wrong with them."""

import itertools
import json
import math
import textwrap
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.errors import UsageError
from air_router.files.missions.mission_write import mission_text
from air_router.mission.flight_plan import FlightPlan, fence_plan
from air_router.mission.loading import load_flown, load_mission, read_placed, validate
from air_router.preflight.card import CheckVerdict
from air_router.preflight.preflight import altitude, place
from air_router.preflight.preflight_parameters import parameters
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from air_router.vehicle.vehicle import FlightMode, Telemetry, VehicleInfo
from geo.frame import Point
from mocha_link.team.document import DocumentError

DATA = Path(__file__).parents[2] / "data"
PAIR = (DATA / "files" / "pair.yaml").read_text(encoding="utf-8")


def write(folder, text=PAIR, *changes):
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = folder / "mission.yaml"
    path.write_text(textwrap.dedent(text))
    return path


def problems(folder, *changes):
    with pytest.raises(DocumentError) as caught:
        load_mission(write(folder, PAIR, *changes))
    return [(p.code, p.line, p.message) for p in caught.value.problems]


def test_each_uav_has_its_own_mission(tmp_path):
    path = write(tmp_path)
    titan, atlas = (load_mission(path, uav=name) for name in ("titan", "atlas"))
    assert (titan.uav, titan.home, titan.altitude_above_home_m) == ("titan", (0, 0), 60)
    assert (atlas.uav, atlas.home, atlas.altitude_above_home_m) == ("atlas", (-40, 0), 48)
    assert (titan.explore, atlas.explore) == (True, False)
    assert load_mission(path).uav == "atlas", "the first one of the file"
    assert {w.altitude_above_home_m for w in atlas.waypoints} == {48}
    assert [layer.uav for layer in titan.layers] == ["atlas", "titan"]
    assert titan.layers == atlas.layers
    items = FlightPlan.of(atlas).items
    assert {item.z_m for item in items if item.z_m} == {48}


def test_zones_with_altitudes_follow_the_layer(tmp_path):
    path = write(tmp_path)
    titan, atlas = (load_mission(path, uav=name) for name in ("titan", "atlas"))
    assert {zone.name for zone in titan.airspace.zones} == {"hall"}
    assert {zone.name for zone in atlas.airspace.zones} == {"hall", "crane", "home of titan"}
    assert not atlas.airspace.leg_clear(Point(30, -25), Point(70, -25))
    assert titan.airspace.leg_clear(Point(30, -25), Point(70, -25))


def test_the_lower_one_keeps_away_from_where_the_higher_one_climbs(tmp_path):
    path = write(tmp_path)
    titan, atlas = (load_mission(path, uav=name) for name in ("titan", "atlas"))
    assert titan.climb_corridors == ()
    (corridor,) = atlas.climb_corridors
    assert corridor not in atlas.zones, (
        "no part of the file, of pictures of the ground, of buildings"
    )
    assert not atlas.airspace.point_clear(Point(0, 14.9))
    assert atlas.airspace.point_clear(Point(0, 15.1))
    route = Router(WaypointGraph(atlas)).route(atlas.home, Point(40, 0))
    track = [atlas.home, *(leg.to for leg in route.legs)]
    ends = itertools.pairwise(track)
    assert min(_distance_m(a, b, titan.home) for a, b in ends) >= 15
    assert len(fence_plan(atlas).items) > len(fence_plan(titan).items), "PX4 keeps away as well"


def test_zones_that_change_in_flight_leave_the_columns_where_they_are(tmp_path):
    atlas = load_mission(write(tmp_path), uav="atlas")
    changed = atlas.with_areas(atlas.fences, ())
    assert {zone.name for zone in changed.airspace.zones} == {"home of titan"}
    assert not changed.planning_airspace.point_clear(Point(0, 16))


def _distance_m(a, b, place):
    steps = (i / 100 for i in range(101))
    return min(
        math.dist(place, (a[0] + (b[0] - a[0]) * s, a[1] + (b[1] - a[1]) * s)) for s in steps
    )


def test_rally_points_are_for_one_uav_only(tmp_path):
    mission = load_mission(write(tmp_path))
    assert mission.rally_points == ()
    assert "rally-points-shared" in {note.code for note in mission.notes}
    alone = load_mission(write(tmp_path, PAIR, ("  titan:\n", "")))
    assert alone.rally_points == ((-50, 50),)


def test_layers_and_homes_that_are_too_close(tmp_path):
    found = problems(tmp_path, ("48", "51"), ("[-40, 0]", "[-18, 0]"))
    assert {(code, line) for code, line, _ in found} == {
        ("homes-too-close", 18),
        ("layers-too-close", 18),
    }
    text = " ".join(message for _, _, message in found)
    assert "'titan' flies 9 m from the layer of 'atlas', 10 m are to lie between two" in text
    assert "the homes of 'atlas' and 'titan' are 18.0 m apart, it takes 20 m" in text


def test_layers_and_homes_may_be_as_close_as_they_have_to_be_apart(tmp_path):
    path = write(tmp_path, PAIR, ("48", "50"), ("[-40, 0]", "[-20, 0]"))
    atlas, titan = load_mission(path).layers
    assert titan.altitude_m - atlas.altitude_m == 10
    assert math.dist(titan.home, atlas.home) == 20


def test_the_separation_is_a_key(tmp_path):
    path = write(tmp_path, PAIR + "planner: {vertical_separation_m: 5}\n", ("48", "54"))
    assert load_mission(path).layers[0].altitude_m == 54


def test_layers_count_from_the_sea_where_the_grounds_at_the_homes_differ(tmp_path):
    higher = ("home: [-40, 0]", "home: {position: [-40, 0], altitude_amsl_m: 559}")
    (found,) = problems(tmp_path, higher)
    assert found[0] == "layers-too-close"
    assert "flies 3 m from the layer" in found[2]


def test_what_is_wrong_for_one_is_reported_of_that_one(tmp_path):
    (found,) = problems(tmp_path, ("[80, -30]", "[45, -20]"))
    assert found[0] == "waypoint-in-zone"
    assert found[2].endswith("(for atlas)")
    (found,) = problems(tmp_path, ("[80, -30]", "[40, 20]"))
    assert "(for" not in found[2]
    (found,) = problems(tmp_path, ("[0, 60]", "[0, 12]"))
    assert (found[0], "home of titan" in found[2]) == ("waypoint-too-near", True)


@pytest.mark.parametrize("altitude_m", [40, 60, 48])
def test_a_waypoint_with_an_altitude_of_its_own_leaves_the_layers(tmp_path, altitude_m):
    own = f"- {{position: [80, 60], altitude_m: {altitude_m}}}"
    (found, *_) = problems(tmp_path, ("- [80, 60]", own))
    assert found[:2] == ("altitude-in-layers", 8)
    other = ("altitude_m: 60", f"altitude_m: 60\naltitudes_m: {sorted((60, altitude_m))}")
    assert problems(tmp_path, other)[0][:2] == ("altitude-in-layers", 6)


def test_uav_and_uavs_contradict_each_other(tmp_path):
    found = problems(tmp_path, ("uavs:", "uav: titan\nuavs:"))
    assert "one-uav-key" in {code for code, _, _ in found}


def test_a_name_that_is_not_flown_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"is flown by atlas and titan, not by 'io'"):
        load_mission(write(tmp_path), uav="io")
    with pytest.raises(UsageError, match=r"choose one: --uav atlas or --uav titan"):
        load_flown(write(tmp_path), None)
    assert load_flown(write(tmp_path), "atlas").uav == "atlas"


TEAM = """\
robots:
  atlas: {kind: aerial_robot, address: 127.0.1.1, base_port: 25100, clients: [io]}
  titan: {kind: aerial_robot, address: 127.0.1.2, base_port: 25200, clients: [io]}
  io: {kind: ground_robot, address: 127.0.1.3, base_port: 25300, clients: [atlas, titan]}
kinds:
  aerial_robot: {topics: [{name: /pose, type: json/Pose}]}
  ground_robot: {topics: [{name: /pose, type: json/Pose}]}
"""


def test_a_team_in_which_they_do_not_receive_each_other_is_noted(tmp_path):
    (tmp_path / "team.yaml").write_text(TEAM)
    mission = load_mission(write(tmp_path, PAIR + "team: team.yaml\n"))
    codes = [note.code for note in mission.notes]
    assert (codes.count("uavs-not-linked"), codes.count("no-seek-topic")) == (2, 2)
    (tmp_path / "team.yaml").write_text(
        TEAM.replace("[io]", "[atlas, titan, io]", 1)
        .replace("clients: [atlas, titan, io]", "clients: [titan, io]")
        .replace("base_port: 25200, clients: [io]", "base_port: 25200, clients: [atlas, io]")
        .replace(
            "aerial_robot: {topics: [", "aerial_robot: {topics: [{name: /seek, type: json/Seek}, "
        )
    )
    mission = load_mission(tmp_path / "mission.yaml")
    assert not {"uavs-not-linked", "no-seek-topic"} & {note.code for note in mission.notes}
    found = problems(tmp_path, ("  titan:\n", "  tital:\nteam: team.yaml\n"))
    assert found == [
        ("unknown-robot", 18, "the team has no robot 'tital'; did you mean 'titan'? (for tital)")
    ]


def test_what_is_written_back_is_the_same_mission(tmp_path):
    placed, findings = read_placed(write(tmp_path))
    text = mission_text(placed, tmp_path)
    again = tmp_path / "again.yaml"
    again.write_text(text)
    for name in ("titan", "atlas"):
        one, two = (load_mission(path, uav=name) for path in (tmp_path / "mission.yaml", again))
        assert two.home == pytest.approx(one.home, abs=1e-3)
        assert two.altitude_above_home_m == one.altitude_above_home_m
        assert (two.explore, two.uav) == (one.explore, one.uav)
        assert len(two.layers) == 2
    validate(placed, findings)
    assert mission_text(placed, tmp_path) == text, "judging leaves the file's own text alone"


def test_a_return_of_the_autopilot_stays_below_the_layer_above(tmp_path):
    path = write(tmp_path)
    titan, atlas = (load_mission(path, uav=name) for name in ("titan", "atlas"))
    assert (atlas.ceiling_m, titan.ceiling_m) == (50, math.inf)
    verdicts = {
        (mission.uav, value): {
            check.verdict
            for check in parameters(mission, {"RTL_RETURN_ALT": value})
            if check.name == "RTL_RETURN_ALT"
        }
        for mission in (titan, atlas)
        for value in (30.0, 48.0, 50.5, 90.0)
    }
    assert verdicts["atlas", 48.0] == set()
    assert verdicts["atlas", 30.0] == {CheckVerdict.BAD}  # the mission file does not accept it
    assert verdicts["atlas", 50.5] == {CheckVerdict.BAD}
    assert verdicts["titan", 90.0] == set()


def test_a_vehicle_that_stands_beside_its_home_does_not_take_off(tmp_path):
    mission = load_mission(write(tmp_path), uav="titan")
    router = Router(WaypointGraph(mission))
    info = VehicleInfo(1, "PX4", "1.17.0", mission.home, 6.7)

    def verdict(away_m):
        telemetry = Telemetry(1.0, Point(away_m, 0.0), 0.0, mode=FlightMode.HOLD)
        return place(mission, router, info, telemetry).verdict

    assert [verdict(away_m) for away_m in (0.0, 4.9, 5.1)] == [
        CheckVerdict.GOOD,
        CheckVerdict.GOOD,
        CheckVerdict.BAD,
    ]


def test_a_plan_is_for_one_uav_whichever_that_is(tmp_path):
    mission = load_flown(DATA / "pennovation.plan", "atlas")
    assert (mission.uav, mission.layers, mission.ceiling_m) == ("atlas", (), math.inf)
    (tmp_path / "team.yaml").write_text(TEAM)
    one = PAIR.partition("uavs:")[0] + "team: team.yaml\n"
    assert load_flown(write(tmp_path, one), "atlas").uav == "atlas"
    with pytest.raises(DocumentError, match=r"no robot 'europe'.* \[unknown-robot\]"):
        load_flown(tmp_path / "mission.yaml", "europe")


def test_check_prints_who_flies_where(tmp_path, capsys):
    path = str(write(tmp_path))
    assert main(["check", path]) == 0
    printed = capsys.readouterr().out
    assert "atlas: 48 m above its home, only searches (its mission is shown here)" in printed
    assert "titan: 60 m above its home, explores and searches\n" in printed
    assert main(["check", path, "--uav", "titan", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["cruise_m"] == [55.0, 65.0]
    assert facts["layers"][0] == {"uav": "atlas", "altitude_m": 48.0, "explore": False}


def test_layers_rest_on_the_heights_of_the_homes(tmp_path):
    mission = load_mission(write(tmp_path), uav="titan")
    lone = load_mission(write(tmp_path, PAIR.partition("uavs:")[0], ("{upper_m: 50}", "null")))

    def verdicts(mission, home_amsl_m):
        info = VehicleInfo(1, "PX4", "1.17.0", mission.home, home_amsl_m)
        telemetry = Telemetry(0.0, mission.home, 0.0)
        return [check.verdict for check in altitude(mission, info, telemetry)]

    assert [verdicts(mission, m) for m in (552.0, 565.0, 620.0)] == [
        [CheckVerdict.GOOD],
        [CheckVerdict.LOOK],
        [CheckVerdict.BAD],
    ]
    assert verdicts(lone, 620.0) == []
