"""QGroundControl plans: what is read, and what is refused with its place in the file."""

import contextlib
import copy
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.errors import exit_code
from air_router.files.json_document import json_from_text, load_json, value_at
from air_router.files.missions.placed_form import place
from air_router.files.missions.qgc_read import read_plan
from air_router.mission.loading import load_mission, validate
from mocha_link.team.document import DocumentError
from tests.air_router.files.values import values_in

DATA = Path(__file__).parents[3] / "data"
MISSIONS = Path(__file__).parents[4] / "missions"


def waypoint(lat, lon, *, altitude=30, frame=3, command=16):
    return {
        "type": "SimpleItem",
        "command": command,
        "frame": frame,
        "params": [0, 0, 0, None, lat, lon, altitude],
    }


def plan():
    return json.loads((DATA / "files" / "small.plan").read_text(encoding="utf-8"))


def write(folder, data, indent=4):
    path = folder / "town.plan"
    path.write_text(data if isinstance(data, str) else json.dumps(data, indent=indent))
    return path


def problems(folder, data):
    with pytest.raises(DocumentError) as caught:
        load_mission(write(folder, data))
    assert exit_code(caught.value) == 3
    return [str(p).removeprefix(f"{folder}/town.plan:") for p in caught.value.problems]


def test_the_real_plan():
    mission = load_mission(DATA / "pennovation.plan")
    assert mission.name == "pennovation"
    assert len(mission.waypoints) == 39
    assert (len(mission.fences[0].ring), len(mission.zones), len(mission.rally_points)) == (
        16,
        8,
        5,
    )
    assert [len(zone.shape.ring) for zone in mission.zones] == [11, 6, 5, 7, 4, 6, 4, 4]
    assert mission.altitude_above_home_m == 40
    assert mission.speed_m_s == 3.5
    assert mission.home_altitude_amsl_m == pytest.approx(6.742, abs=1e-3)
    assert (mission.team, mission.world) == (None, None)
    same = load_mission(MISSIONS / "pennovation" / "mission.yaml")
    for mine, theirs in zip(same.waypoints, mission.waypoints, strict=True):
        assert mine.position == pytest.approx(tuple(theirs.position), abs=0.02)
        assert mine.altitude_above_home_m == theirs.altitude_above_home_m
    for mine, theirs in zip(same.zones, mission.zones, strict=True):
        for a, b in zip(mine.shape.ring, theirs.shape.ring, strict=True):
            assert a == pytest.approx(tuple(b), abs=0.02)


@pytest.mark.parametrize("indent", [None, 1, "\t"])
def test_a_plan_with_all_that_is_read(tmp_path, indent):
    mission = load_mission(write(tmp_path, plan(), indent))
    assert mission.altitude_above_home_m == 20  # the take-off's
    assert [w.altitude_above_home_m for w in mission.waypoints] == [30, 40]
    assert mission.waypoints[0].position == pytest.approx((0, 55.6), abs=0.1)
    assert mission.speed_m_s == 5
    assert mission.airspace.point_clear(mission.home)
    assert mission.airspace.distance_m(mission.home) == pytest.approx(26.9, abs=0.1)
    assert mission.airspace.nearest(mission.waypoints[0].position)[1] == "zone 1"
    assert len(mission.rally_points) == 1


def test_team_and_world_beside_the_plan_are_used(tmp_path):
    team = (MISSIONS / "pennovation" / "team.yaml").read_text()
    (tmp_path / "team.yaml").write_text(team)
    (tmp_path / "world.yaml").write_text("{}")
    mission = load_mission(write(tmp_path, plan()))
    assert mission.team == tmp_path / "team.yaml"
    assert mission.world == tmp_path / "world.yaml"
    assert mission.uav == "titan"


def put(data, *keys):
    *path, last, value = keys
    for key in path:
        data = data[key]
    if value is None:
        del data[last]
    else:
        data[last] = value


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (("fileType", "Mission"), '2:17: not a QGroundControl plan: "fileType" is not "Plan"'),
        (("version", 2), "3:16: the plan has version 2, read is 1"),
        (("mission", "version", 1), "5:20: 'mission' has version 1, read is 2"),
        (("mission", None), "1:1: missing section 'mission'"),
        (("geoFence", []), "71:17: missing section 'geoFence'"),
        (("rallyPoints", 3), "missing section 'rallyPoints'"),
        (("mission", "plannedHomePosition", None), "4:16: missing key 'plannedHomePosition'"),
        (("mission", "plannedHomePosition", 0, 95), "6:32: home: latitude 95.0 is not within"),
        (
            ("mission", "plannedHomePosition", 0, "x"),
            "'plannedHomePosition[0]' must be a number, found",
        ),
        (("mission", "hoverSpeed", 0), "11:23: the speed must be 1 to 50"),
        (("mission", "items", 1, "command", 94), "29:28: command 94 is not read yet"),
        (("mission", "items", 1, "command", 31002), "29:28: command 31002 is not read yet"),
        (("mission", "items", 1, "command", "x"), "29:28: an item's command must be a whole"),
        (("mission", "items", 0, "command", 20), "15:28: the plan returns or lands before this"),
        (
            ("mission", "items", 1, "frame", 10),
            "30:26: an altitude above the terrain, whose height here",
        ),
        (("mission", "items", 1, "frame", 2), "30:26: altitude frame 2 is not read"),
        (("mission", "plannedHomePosition", 2, None), "an altitude above the sea, and home has"),
        (("mission", "items", 1, "params", 6, 0), "38:21: the altitude is 0 m above home"),
        (("mission", "items", 1, "params", 6, 2e4), "must be more than 0 and at most 10000 m"),
        (("mission", "items", 1, "params", 5, "?"), "37:21: 'params[5]' must be a number, found"),
        (("mission", "items", 1, "params", 4, 97), "36:21: waypoint 1: latitude 97.0 is not"),
        (("mission", "items", 1, "type", "Item"), "28:25: an item must be a SimpleItem or a"),
        (("mission", "items", 1, 7), "an item must be a SimpleItem or a ComplexItem, found 7"),
        (("mission", "hoverSpeed", 51), "11:23: the speed must be 1 to 50"),
        (("mission", "items", None), "4:16: 'items' must be a list, found nothing"),
        (("geoFence", "polygons", None), "'polygons' must be a list, found nothing"),
        (("geoFence", "polygons", 0, "inclusion", None), "'inclusion' must be true (a fence)"),
        (("geoFence", "polygons", 0, "version", 7), "'polygons[0]' has version 7, read is 1"),
        (("geoFence", "polygons", 0, "polygon", 0, [47]), "'polygon[0][1]' must be a number"),
        (("geoFence", "circles", 0, "circle", "radius", -1), "the fence cannot be an area"),
        (("geoFence", "circles", 0, "circle", "radius", 1e20), "radius of 1e+20 m, at most 1e+06"),
        (("geoFence", "circles", 0, "circle", "radius", 9e4), "the fence reaches 90 km from home"),
        (("mission", "plannedHomePosition", 2, 1e300), "home is 1e+300 m above the sea; it must"),
        (("geoFence", "circles", 1, "circle", "radius", None), "'radius' must be a number"),
        (("geoFence", "circles", 1, "circle", "radius", 70), "home lies inside no-fly zone"),
        (("rallyPoints", "points", 0, [47.0, 9]), "rally point 1 is 76 km from home"),
        (("rallyPoints", "points", 0, [47.00025, 8.00024]), "rally point 1 lies inside"),
    ],
)
def test_what_is_not_understood_is_refused_with_its_place(tmp_path, keys, expected):
    data = plan()
    put(data, *keys)
    found = problems(tmp_path, data)
    assert any(expected in problem for problem in found), found


def speed(speed_m_s, kind=1):
    return {"type": "SimpleItem", "command": 178, "frame": 2, "params": [kind, speed_m_s, -1]}


def test_the_slowest_speed_is_flown(tmp_path):
    data = plan()
    data["mission"]["items"][:0] = [speed(3), speed(3), speed(-1)]
    mission = load_mission(write(tmp_path, data))
    assert (mission.speed_m_s, mission.notes) == (3, ())
    data["mission"]["items"].insert(3, speed(2.5))
    mission = load_mission(write(tmp_path, data))
    assert mission.speed_m_s == 2.5
    assert notes(mission) == ["speeds-differ"]
    data["mission"]["items"][3] = speed(2.5, kind=0)
    assert "of type 0; write a ground speed" in problems(tmp_path, data)[0]


def notes(mission):
    return [note.code for note in mission.notes]


def test_what_other_programs_leave_out_is_noted(tmp_path):
    data = plan()
    del data["rallyPoints"], data["geoFence"]
    mission = load_mission(write(tmp_path, data))
    assert (mission.fences, mission.zones, mission.rally_points) == ((), (), ())
    assert notes(mission) == ["no-section", "no-section"]
    assert "no section 'geoFence': there is no fence" in mission.notes[0].message


@pytest.mark.parametrize("version", [None, 1])
def test_a_fence_that_qgroundcontrol_drops_silently_is_read_and_noted(tmp_path, version):
    data = plan()
    put(data, "geoFence", "version", version)
    del data["geoFence"]["polygons"]
    mission = load_mission(write(tmp_path, data))
    assert (len(mission.fences), len(mission.zones)) == (1, 1)
    assert notes(mission) == ["plan-version"]
    assert "QGroundControl itself silently drops the whole section" in mission.notes[0].message
    data["geoFence"]["polygon"] = [{"lat": 47.0, "lon": 8.0}]
    assert "drew it years ago is not read" in problems(tmp_path, data)[0]


def test_several_inclusions_are_all_kept_to(tmp_path):
    data = plan()
    box = [[46.998, 7.998], [46.998, 8.002], [47.0008, 8.002], [47.0008, 7.998]]
    data["geoFence"]["polygons"].append({"version": 1, "inclusion": True, "polygon": box})
    data["geoFence"]["breachReturn"] = [47.0, 8.0, 50]
    mission = load_mission(write(tmp_path, data))
    assert len(mission.fences) == 2
    assert len(mission.zones) == 2
    assert notes(mission) == ["not-flown"]
    data["mission"]["items"][1]["params"][4] = 47.0009
    assert any("outside of the fence" in problem for problem in problems(tmp_path, data))


@pytest.mark.parametrize("command", [17, 18, 19, 31, 82])
def test_splines_and_loiters_are_flown_as_waypoints(tmp_path, command):
    data = plan()
    data["mission"]["items"][1]["command"] = command
    mission = load_mission(write(tmp_path, data))
    assert len(mission.waypoints) == 2
    assert notes(mission) == ["flown-as-waypoint"]
    assert str(mission.notes[0]).startswith(f"{tmp_path}/town.plan:29:28: waypoint 1 is command")


def test_cameras_and_jumps_stay_in_the_file(tmp_path):
    data = plan()
    for command in (206, 177, 206, 93, 2000, 4501):
        item = {"type": "SimpleItem", "command": command, "frame": 2, "params": [1] * 7}
        data["mission"]["items"].insert(2, item)
    mission = load_mission(write(tmp_path, data))
    assert len(mission.waypoints) == 2
    assert [note.message.split(" stays")[0] for note in mission.notes] == [
        "command 4501", "command 2000", "command 93", "command 206 (2 times)", "command 177"
    ]  # fmt: skip


@pytest.mark.parametrize("command", [21, 85])
def test_a_landing_elsewhere_is_noted(tmp_path, command):
    data = plan()
    data["mission"]["items"][3] = waypoint(47.0003, 8.0006, altitude=0, command=command)
    mission = load_mission(write(tmp_path, data))
    assert notes(mission) == ["lands-at-home"]
    assert f"command {command} lands 57 m from home; a mission" in mission.notes[0].message
    data["mission"]["items"][3]["params"][4:6] = [0, 0]
    assert "lands wherever it is by then" in load_mission(write(tmp_path, data)).notes[0].message
    data["mission"]["items"][3]["params"][4:6] = [47.00001, 8.00002]
    assert notes(load_mission(write(tmp_path, data))) == []


def test_altitudes_above_terrain_count_from_the_sea(tmp_path):
    data = plan()
    data["mission"]["items"][1] |= {"frame": 10, "AMSLAltAboveTerrain": 533.5}
    mission = load_mission(write(tmp_path, data))
    assert mission.waypoints[0].altitude_above_home_m == 33.5


def test_a_waypoint_that_lies_on_another_is_visited_once(tmp_path):
    data = plan()
    data["mission"]["items"].insert(3, waypoint(47.0005, 8.0))
    mission = load_mission(write(tmp_path, data))
    assert len(mission.waypoints) == 2
    assert notes(mission) == ["waypoint-twice"]
    assert "lies on waypoint 1: visited once" in mission.notes[0].message


def test_surveys_are_flown_by_their_embedded_items():
    form, findings = read_plan(load_json(DATA / "files" / "survey.plan"))
    placed = place(form, findings)
    assert findings.problems == []
    assert len(placed.waypoints) == 11
    inner = ("mission", "items", 2, "TransectStyleComplexItem", "Items", 0, "params", 4)
    assert placed.waypoints[1].keys == inner
    assert [note.code for note in findings.notes] == [
        "flown-as-waypoint", "survey-waypoints", "survey-waypoints", "not-flown", "not-flown",
        "not-flown", "not-flown", "not-flown", "not-flown",
    ]  # fmt: skip
    assert len(placed.fences) == 3
    assert [zone.name for zone in placed.zones] == ["zone 1", "zone 2"]
    mission = load_mission(DATA / "files" / "survey.plan")
    assert len(mission.waypoints) == 11


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, 2]", '1:1: not a QGroundControl plan: "fileType" is not "Plan"'),
        ('{"fileType": "Plan"}', "1:1: missing section 'mission'"),
        ('{"fileType": "Plan", "x": NaN}', "1:27: not valid JSON: NaN is no number"),
    ],
)
def test_what_is_no_plan_at_all(tmp_path, text, expected):
    assert any(problem.startswith(expected) for problem in problems(tmp_path, text))


SURVEY = json.loads((DATA / "files" / "survey.plan").read_text(encoding="utf-8"))
PLACES = [keys for keys, _ in values_in(SURVEY) if keys]
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=3),
    st.sampled_from([[], {}, [[]], [1e300, -1e300], 10**40, 16, 22, 178, "SimpleItem"]),
)


@given(changes=st.lists(st.tuples(st.sampled_from(PLACES), JUNK), min_size=1, max_size=3))
def test_no_plan_crashes_the_reader(changes):
    data = copy.deepcopy(SURVEY)
    for keys, junk in changes:
        with contextlib.suppress(TypeError, LookupError):  # an earlier change took it away
            value_at(data, keys[:-1])[keys[-1]] = junk
    form, findings = read_plan(json_from_text(json.dumps(data), Path("any.plan")))
    validate(place(form, findings), findings)
    for problem in (*findings.problems, *findings.notes):
        assert problem.code
        assert problem.line == 1


def test_zones_are_numbered_as_they_stand_in_the_plan():
    document = load_json(DATA / "files" / "survey.plan")
    fence = document.data["geoFence"]
    zones = [
        each for kind in ("polygons", "circles") for each in fence[kind] if not each["inclusion"]
    ]
    shape = zones[0].get("circle") or zones[0]
    broken = {"radius": -1.0} if "circle" in zones[0] else {"polygon": shape["polygon"][:2]}
    shape.update(broken)
    form, findings = read_plan(document)
    placed = place(form, findings)
    assert "'zone 1'" in findings.problems[0].message
    assert [zone.name for zone in placed.zones] == ["zone 2"]
