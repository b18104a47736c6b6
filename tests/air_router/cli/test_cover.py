"""`air-router cover`: from files to waypoints that a mission flies."""

import json
import re
from pathlib import Path

import pytest
import yaml

from air_router.cli.cli import main
from air_router.mission.loading import load_mission
from geo.frame import Point

ROOT = Path(__file__).parents[3]
URBAN = ROOT / "missions" / "urban" / "mission.yaml"
PLAN = ROOT / "tests" / "data" / "pennovation.plan"
WIDE = ("--camera", "60x45deg")
FIELD = [[-75.2020, 39.9400], [-75.1990, 39.9400], [-75.1990, 39.9420], [-75.2020, 39.9420]]


def run(capsys, *arguments):
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def facts(capsys, *arguments):
    code, out, err = run(capsys, "cover", *arguments, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


def geojson(folder, ring=FIELD, name="field", **properties):
    path = folder / f"{name}.geojson"
    shape = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    path.write_text(json.dumps({"type": "Feature", "properties": properties, "geometry": shape}))
    return path


def test_a_mission_s_own_fence(capsys):
    code, out, err = run(capsys, "cover", URBAN, *WIDE)
    assert (code, err) == (0, "")
    assert re.match(r"# (99\.\d\d|100\.00) % of 68,942 m2 covered, by \d+ rows at", out)
    places = yaml.safe_load(out)["waypoints"]
    mission = load_mission(URBAN)
    assert 20 < len(places) < 60
    for place in places:
        assert mission.planning_airspace.point_clear(Point(*place))


def test_numbers_for_scripts(capsys):
    found = facts(capsys, URBAN, *WIDE, "--angle", "90")
    assert found["covered_percent"] > 99.5
    assert found["angle_deg"] == 90.0
    assert found["footprint_m"] == [69.28, 49.71]
    assert found["row_spacing_m"] == pytest.approx(69.28 * 0.4, abs=0.01)
    assert found["picture_every_m"] == pytest.approx(49.71 * 0.3, abs=0.01)
    assert found["rows_length_m"] < found["length_m"]
    assert found["flight_time_s"] > found["length_m"] / 5
    mission = load_mission(URBAN)
    track = [mission.frame.to_local(*place.values()) for place in found["track"]]
    assert mission.airspace.track_distance_m(track)[0] >= 6.5 - 1e-6
    assert set(found) >= {"area_m2", "target_m2", "rows", "missed", "waypoints", "pictures"}


def test_the_mission_with_other_waypoints_keeps_its_comments(capsys, tmp_path):
    folder = tmp_path / "town"
    folder.mkdir()
    for name in ("mission.yaml", "team.yaml", "world.yaml"):
        (folder / name).write_text((URBAN.parent / name).read_text())
    target = folder / "lawn.yaml"
    code, out, err = run(capsys, "cover", folder / "mission.yaml", *WIDE, "--out", target)
    assert (code, err) == (0, "")
    assert "covered, by" in out
    before, after = URBAN.read_text(), target.read_text()
    for comment in re.findall(r"#.*", before.replace("  # 1\n", "").split("waypoints:")[0]):
        assert comment in after
    assert before.split("fence:")[1] == after.split("fence:")[1]
    mission = load_mission(target)
    assert mission.waypoints
    assert mission.name == "Urban"
    assert run(capsys, "check", target)[0] == 0
    code, _, err = run(capsys, "cover", URBAN, *WIDE, "--out", target)
    assert code == 2
    assert "write into" in err or "there" in err


def test_of_several_uavs_each_flies_the_rows_in_its_own_layer(capsys, tmp_path):
    text = (ROOT / "missions" / "pair" / "mission.yaml").read_text(encoding="utf-8")
    source, target = tmp_path / "mission.yaml", tmp_path / "rows.yaml"
    source.write_text(re.sub(r"^(team|world): .*\n", "", text, flags=re.MULTILINE))
    code, _, err = run(capsys, "cover", source, *WIDE, "--out", target)
    assert (code, err) == (0, "")
    for uav, altitude_m in (("titan", 60), ("atlas", 48)):
        mission = load_mission(target, uav=uav)
        assert {w.altitude_above_home_m for w in mission.waypoints} == {altitude_m}
    code, _, err = run(capsys, "cover", source, *WIDE, "--altitude", 40)
    assert (code, err.partition(":")[0]) == (2, "--altitude is that of a UAV's layer")


def test_a_mission_in_one_line_is_written_anew(capsys, tmp_path):
    path, target = tmp_path / "mission.yaml", tmp_path / "lawn.yaml"
    fence = [[39.94, -75.2], [39.94, -75.198], [39.942, -75.198], [39.942, -75.2]]
    data = {"home": [39.941, -75.199], "altitude_m": 30, "waypoints": [], "no_fly_zones": []}
    path.write_text(json.dumps(data | {"fence": fence}))
    assert run(capsys, "cover", path, *WIDE, "--out", target)[0] == 0
    assert len(load_mission(target).waypoints) > 4


def test_an_area_of_its_own_in_a_mission_s_airspace(capsys, tmp_path):
    mission = load_mission(PLAN)
    corners = [
        mission.frame.to_geodetic(Point(e, n))
        for e, n in ((-30, 20), (30, 20), (30, 40), (-30, 50))
    ]
    area = geojson(tmp_path, [[c.longitude_deg, c.latitude_deg] for c in corners])
    found = facts(capsys, area, "--mission", PLAN, *WIDE, "--altitude", "20")
    assert found["covered_percent"] > 99
    assert found["area_m2"] == pytest.approx(1_500, rel=0.01)
    assert found["from_home"] is True
    code, out, _ = run(capsys, "cover", area, "--mission", PLAN, *WIDE, "--altitude", "20")
    assert code == 0
    assert "altitude_m: 20" in out


def test_an_area_alone(capsys, tmp_path):
    area = geojson(tmp_path)
    options = (area, "--camera", "sony-rx100m2", "--altitude", "80")
    found = facts(capsys, *options)
    assert found["covered_percent"] == 100.0
    assert found["from_home"] is False
    assert found["pixel_m"] == pytest.approx(0.0186, abs=1e-4)
    code, _, err = run(capsys, "cover", *options, "--out", tmp_path / "m.yaml")
    assert code == 2
    assert "give --home" in err
    target = tmp_path / "m.yaml"
    home = ("--home", "39.9398,-75.2000", "--out", target)
    assert run(capsys, "cover", *options, *home)[0] == 0
    mission = load_mission(target)
    assert len(mission.waypoints) == 2 * found["rows"]
    assert mission.altitude_above_home_m == 80.0


def test_zones_of_files_and_the_area_as_a_fence(capsys, tmp_path):
    hole = [[-75.2010, 39.9408], [-75.2004, 39.9408], [-75.2004, 39.9412], [-75.2010, 39.9412]]
    whole, holed = geojson(tmp_path), geojson(tmp_path, hole, "pond")
    options = ("--camera", "60x45deg", "--altitude", "30")
    with_zone = facts(capsys, whole, *options, "--zones", holed, "--clearance", "10")
    free = facts(capsys, whole, *options)
    assert with_zone["target_m2"] < free["target_m2"] - 2000
    inside = facts(capsys, whole, *options, "--inside")
    assert inside["rows_length_m"] < free["rows_length_m"]
    assert inside["covered_percent"] > 99.9


def test_a_mission_that_could_not_be_flown_is_not_written(capsys, tmp_path):
    area, target = geojson(tmp_path), tmp_path / "m.yaml"
    ring = [[-75.2010, 39.9408], [-75.2004, 39.9408], [-75.2004, 39.9412]]
    zones = geojson(tmp_path, ring, "pond", upper_m=100, reference="amsl")
    options = (area, *WIDE, "--altitude", "30", "--zones", zones, "--out", target)
    code, _, err = run(capsys, "cover", *options, "--home", "39.9398,-75.2000")
    assert code == 3
    assert "[home-altitude-unknown]" in err
    assert not target.exists()


@pytest.mark.parametrize(
    "text",
    [
        "polygon: [[39.94, -75.202], [39.94, -75.199], [39.942, -75.199]]\n",
        "- [39.94, -75.202]\n- [39.94, -75.199]\n- [39.942, -75.199]\n",
        "circle: {centre: [39.94, -75.2], radius_m: 80}\n",
    ],
)
def test_areas_in_yaml(capsys, tmp_path, text):
    path = tmp_path / "area.yaml"
    path.write_text(text)
    assert facts(capsys, path, *WIDE, "--altitude", "20")["covered_percent"] > 99.9


def test_pictures(capsys, tmp_path):
    target = tmp_path / "cover.png"
    options = ("--altitude", "30", "--png", target)
    assert run(capsys, "cover", geojson(tmp_path), *WIDE, *options)[0] == 0
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("{area}", "--camera", "box"), "no camera 'box'"),
        (("{area}", *WIDE), "--altitude M"),
        (("{area}", *WIDE, "--altitude", "30", "--overlap", "0.7"), "write percent, 70"),
        (("{area}", *WIDE, "--altitude", "30", "--sidelap", "99"), "0 to 95"),
        (("{area}", *WIDE, "--altitude", "-3"), "more than 0"),
        (("{area}", *WIDE, "--altitude", "30", "--angle", "north"), "not an angle"),
        (("{area}", *WIDE, "--altitude", "30", "--home", "here"), "LATITUDE,LONGITUDE"),
        (("{area}", *WIDE, "--altitude", "30", "--home", "91,0"), "--home"),
        (("{area}", *WIDE, "--altitude", "30", "--home", "0,0"), "km from home; correct one"),
        (("{area}", *WIDE, "--altitude", "30", "--home", "-75.2,39.94"), "km from home; correct"),
        (("{area}", *WIDE, "--altitude", "30", "--out", "survey.plan"), "ends with .yaml"),
        (("{area}", *WIDE, "--mission", str(PLAN), "--home", "1,2"), "is set by the mission"),
        (("{nothing}", *WIDE), "has no fence"),
    ],
)
def test_wrong_usage_is_reported(capsys, tmp_path, arguments, message):
    nothing = tmp_path / "open.yaml"
    nothing.write_text(
        "home: [39.9412, -75.1992]\naltitude_m: 30\nfence: null\nno_fly_zones: []\nwaypoints: []\n"
    )
    names = {"area": geojson(tmp_path), "nothing": nothing}
    code, out, err = run(capsys, "cover", *(a.format(**names) for a in arguments))
    assert (code, out) == (2, "")
    assert message in err


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.geojson", '{"type": "FeatureCollection", "features": []}', "no polygon"),
        ("a.yaml", "polygon: [[1, 2], [3, 4]]\n", "[zone-"),
        ("a.yaml", "polygon: [[0, 0], [0.001, 0.001], [0, 0.001], [0.001, 0]]\n", "crosses"),
        ("a.yaml", "polygon: [[0, 0], [95, 0], [0, 1]]\n", "[not-on-earth]"),
        ("a.yaml", "polygone: [[0, 0], [1, 0], [0, 1]]\n", "polygon"),
        ("a.yaml", "[", "[not-yaml]"),
        ("none.kml", None, "[unreadable]"),
    ],
)
def test_files_that_are_no_area(capsys, tmp_path, name, text, message):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    code, out, err = run(capsys, "cover", path, *WIDE, "--altitude", "30")
    assert (code, out) == (3, "")
    assert message in err
    assert err.startswith(f"{path}:")


def test_an_area_that_cannot_be_covered(capsys, tmp_path):
    mission = load_mission(PLAN)
    inside = mission.zones[0].polygon.buffer(-2).exterior.coords[:-1]
    corners = [mission.frame.to_geodetic(Point(*corner)) for corner in inside]
    area = geojson(tmp_path, [[c.longitude_deg, c.latitude_deg] for c in corners])
    code, out, err = run(capsys, "cover", area, "--mission", PLAN, *WIDE)
    assert (code, out) == (1, "")
    assert "no ground outside of no-fly zones" in err
