"""Mistakes that people make in the field: each gets one message with what to do.

A mistake that is refused is printed on stderr, one that is only noted among what `check` prints.
"""

import re
import shutil
from pathlib import Path

import pytest

from air_router.cli.cli import main
from air_router.mission.loading import load_mission
from mocha_link.team.document import DocumentError
from sitl.world.world_file import load_world

ROOT = Path(__file__).parents[3]
MISSION = """\
home: [39.9421523, -75.1997644]
altitude_m: 30
waypoints:
  - [39.9422294, -75.2001338]
  - [39.9426945, -75.1999767]
fence: null
no_fly_zones: []
"""
HOME = "[39.9421523, -75.1997644]"
FIRST = "[39.9422294, -75.2001338]"
WAYPOINTS = "  - [39.9422294, -75.2001338]\n  - [39.9426945, -75.1999767]"
ZONE = "no_fly_zones: [{name: mast, circle: {centre: [39.945, -75.2], radius_m: 20}"
AREA = "[[-75.2011,39.9426],[-75.2010,39.9426],[-75.2010,39.9427]]"
COMMAS = "[[-75,2011,39,9426],[-75,2010,39,9426],[-75,2010,39,9427]]"
TURNED = "[[39.9426,-75.2011],[39.9426,-75.2010],[39.9427,-75.2010]]"


def geojson(ring):
    polygon = f'{{"type": "Polygon", "coordinates": [{ring}]}}'
    return f'{{"type": "Feature", "properties": {{"name": "x"}}, "geometry": {polygon}}}'


def kml(places):
    ring = f"<LinearRing><coordinates>{places}</coordinates></LinearRing>"
    polygon = f"<Polygon><outerBoundaryIs>{ring}</outerBoundaryIs></Polygon>"
    return f"<kml><Placemark><name>x</name>{polygon}</Placemark></kml>"


FILES = {
    "zones.geojson": geojson(AREA),
    "commas.geojson": geojson(COMMAS),
    "turned.geojson": geojson(TURNED),
    "comment.geojson": f"// exported\n{geojson(AREA)}",
    "trailing.geojson": geojson(AREA).replace("]]]}", "],]]}"),
    "commas.kml": kml("8,5,47,3 8,6,47,3 8,6,47,4"),
    "commas.gpx": '<gpx><wpt lat="47,3" lon="8,5"/></gpx>',
    "mission.yaml.txt": MISSION,
    "table.csv": "lat,lon\n47.3,8.5\n",
    "book.xlsx": "PK\x03\x04",
    "zones.shp": "\0\0'\n",
    "twins.yaml": (ROOT / "missions" / "pennovation" / "team.yaml").read_text(encoding="utf-8"),
}
FILES["twins.yaml"] = re.sub(r"\bio\b", "Europa", FILES["twins.yaml"])

PLACES = [  # what is changed into what; the exit code; the message
    ("home:", "coordinates: local\nframe: {origin: [39.9, -75.2]}\nhome:", 3, "for degrees leave"),
    (FIRST, "[50, 20]", 3, "pairs in metres need 'coordinates: local'"),
    (FIRST, "[-75.2001338, 39.9422294]", 3, "latitude comes first: [39.9422294, -75.2001338]"),
    (FIRST, "[39.9422294, 75.2001338]", 3, "the sign of its longitude is wrong (west is negative)"),
    (FIRST, "[-39.9422294, -75.2001338]", 3, "the sign of its latitude is wrong (south is neg"),
    (FIRST, HOME.replace("644", "644, 30"), 3, "an altitude (30?) has a key of its own"),
    (FIRST, "{lat: 39.94, lon: -75.2}", 3, "a place is one key: 'position: [latitude, longitude]'"),
    (WAYPOINTS, "  [39.9422294, -75.2001338]", 3, "a place is a pair in brackets of its own"),
    (WAYPOINTS, "  a: [39.9422294, -75.2]", 3, "begin each entry with '- ', without a name"),
    (FIRST, HOME + "\n  - " + HOME, 3, "waypoint 2 lies on waypoint 1; remove one of them"),
    ("null", "[[[39.9, -75.3], [40, -75.3], [40, -75.1]]]", 3, "there are brackets too many"),
    ("null", "[[-75.3, 39.9], [-75.3, 40], [-75.1, 40]]", 3, "latitude comes first: [39.9, -75.3]"),
    ("[]", "[{name: a, circle: [39.9, -75.2, 20]}]", 3, "write {centre: ..., radius_m: ...}"),
    ("[]", "[{name: a, circle: {center: [39.9, -75.2]}}]", 3, "'center'; did you mean 'centre'?"),
]
SETTINGS = [
    ("fence: null", "fence:", 0, "'fence' is empty, which is read as none; write 'fence: null'"),
    ("null", "null\nteam:", 0, "'team' is empty, which is read as none"),
    ("null", "none", 3, "write null if there is none"),
    ("altitude_m: 30", "altitude_m: 100ft", 3, "in the one of the key's name: 30.5"),
    ("null", "null\nspeed_m_s: 18 km/h", 3, "in the one of the key's name: 5"),
    ("null", "null\nbattery_reserve: 25%", 3, "in the one of the key's name: 0.25"),
    ("null", "null\nduration_s: 25 min", 3, "in the one of the key's name: 1500"),
    ("null", "null\nduration_s: 25:00", 3, "write seconds: 1500"),
    ("null", "null\ntimers: {init_s: -180}", 3, "'timers.init_s' must be greater than 0.0"),
    ("null", "null\nduration_s: 3600\nendurance_s: 1200", 0, "the battery ends the mission first"),
    ("null", "null\nteam: team.yaml\nduration_s: 150", 0, "no robot is ever sought: the first"),
    ("null", "null\naltitudes_m: [50, 80]", 0, "cannot be sent back to it; widen them"),
    (f"{HOME}\naltitude_m: 30", f"{{position: {HOME}, altitude_amsl_m: 1609}}\naltitude_m: 1640", 0,
     "given in metres above the sea? then write 31"),
    ("null", "null\nteam: team.yaml\nseek: io", 3, "robots stand in brackets: seek: [io]"),
    ("null", "null\nteam: team.yaml\nseek: [Io]", 3, "no robot 'Io'; did you mean 'io'?"),
    ("null", "null\nteam: team.yaml\nuav: Titan", 3, "no robot 'Titan'; did you mean 'titan'?"),
    ("null", "null\nteam: twins.yaml\nseek: [europa]", 0, "'Europa' of the team differ in case"),
    ("no_fly_zones: []", f"{ZONE}, crosses_fence: yes}}]", 3, "found text 'yes'; write true"),
    ("no_fly_zones: []", f"{ZONE}, altitude: {{upper_m: unlimited}}}}]", 3, "leave the key out"),
    ("no_fly_zones: []", f"{ZONE}, altitude: {{reference: MSL}}}}]", 3, "did you mean 'amsl'?"),
    ("no_fly_zones: []", f"{ZONE}, active: [{{days: sat}}]}}]", 3, "stands in brackets: [sat]"),
    ("no_fly_zones: []", f"{ZONE}, active: [{{from: 21.11.2026}}]}}]", 3, "2026-11-20T08:00:00Z"),
]  # fmt: skip
PATHS = [
    ("team: “team.yaml”", "it has quotes or blanks of a word processor; write 'team.yaml'"),
    ("team: .\\team.yaml", "write '/' between folders, not '\\': ./team.yaml"),
    ('team: ".\\team.yaml"', "in double quotes a backslash begins a special character"),
    ("team: C:\\me\\team.yaml", "drive letters are those of Windows"),
    ("team: Team.yaml", "did you mean 'team.yaml'?"),
    ("team: team.yml", "did you mean 'team.yaml'?"),
    ("team: mission.yaml", "mission.yaml is a mission file; name the team's file"),
    ("team: world.yaml", "world.yaml is a world file; name the team's file"),
    ("no_fly_files: zones.geojson", "a list stands in brackets: [zones.geojson]"),
    ("no_fly_files: [~/zones.geojson]", "'~' is not read; write the whole path"),
    ('no_fly_files: ["*.geojson"]', "patterns are not read; name each file"),
    ('no_fly_files: ["https://a.org/z.kml"]', "pages of the Web are not read; download it"),
    ("no_fly_files: [mission.yaml]", "`air-router convert` writes the zones of a mission as Geo"),
    ("no_fly_files: [zones.shp]", "a shapefile: `ogr2ogr zones.geojson zones.shp`"),
    ("no_fly_files: [commas.geojson]", "decimals stand behind a point: [-75.2011, 39.9426]"),
    ("no_fly_files: [turned.geojson]", "put the longitude first in this file"),
    ("no_fly_files: [comment.geojson]", "JSON has no comments; remove it"),
    ("no_fly_files: [trailing.geojson]", "a comma before ']'; remove it"),
    ("no_fly_files: [commas.kml]", "decimals stand behind a point: 8.5,47.3"),
]
OTHER_KEYS = [
    ("fence: null", "fence: zones.geojson", 3, "by another key: no_fly_files: [zones.geojson]"),
    ("no_fly_zones: []", "no_fly_zones: zones.kml", 3, "by another key: no_fly_files: [zones.kml]"),
]
COMMANDS = [
    ("check .", 3, "name the file in it: mission.yaml"),
    ("check mission.yml", 3, "did you mean 'mission.yaml'?"),
    ("check mission.yaml.txt", 3, "a mission whose name ends with .txt; rename it to mission.yaml"),
    ("check world.yaml", 3, "this is a world file: name the mission"),
    ("check book.xlsx", 3, "a ZIP archive (such as a spreadsheet), no text"),
    ("check table.csv", 3, "a mission is a mapping of keys and values"),
    ("check zones.geojson", 3, "name it under no_fly_files in one"),
    ("edit zones.geojson --no-open --port 0", 3, "name it under no_fly_files in one"),
    ("sim mission.yaml --duration 10min", 2, "in the one of the key's name: 600"),
    ("plan mission.yaml --from home --to 1", 2, "neither a waypoint's number nor LATITUDE,LONGI"),
    ("plan mission.yaml --from 39,9421,-75,1997 --to 1", 2, "; write 39.9421,-75.1997"),
    ("plan mission.yaml --from 39°56'31\"N,75°12'W --to 1", 2, "decimal degrees: 39.9419444,-75.2"),
    ("convert commas.gpx way.yaml --altitude 30", 3, "decimals stand behind a point: 47.3"),
    ("new yard --home 47,3977,8,5456", 2, "; write 47.3977,8.5456"),
    ("new yard --home 47.3977;8.5456", 2, "; write 47.3977,8.5456"),
    ("new yard --home 47.3977 8.5456", 2, "with a comma and no blank"),
    ("new yard --home 0,0", 0, "latitude 0, longitude 0 is in the Atlantic; enter the place"),
    ("new yard --home 47.39,8.54 --robots rover,ros2", 2, "is a message format; write rover="),
    ("new yard --home 47.39,8.54 --robots Rover,rover", 2, "'rover' is named twice (whatever its"),
    ("new yard --home 47.39,8.54 --altitude 30m", 2, "in the one of the key's name: 30"),
]  # fmt: skip


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Runs a command in a folder with a mission; its exit code, and all that it prints."""
    for name in ("mission.yaml", "team.yaml", "world.yaml"):
        shutil.copy(ROOT / "missions" / "pennovation" / name, tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)

    def run(line):
        try:
            code = main(line.split())
        except SystemExit as end:
            code = end.code
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return code, out + err

    return run


CHANGES = [*PLACES, *SETTINGS, *OTHER_KEYS, *(("null", f"null\n{new}", 3, w) for new, w in PATHS)]


@pytest.mark.parametrize(
    ("before", "after", "wanted", "message"), CHANGES, ids=[row[3][:40] for row in CHANGES]
)
def test_a_mistake_in_a_mission_is_answered(printed, before, after, wanted, message):
    assert before in MISSION
    Path("field.yaml").write_text(MISSION.replace(before, after, 1), encoding="utf-8")
    code, text = printed("check field.yaml")
    assert (code, message in text) == (wanted, True), text


@pytest.mark.parametrize(("line", "wanted", "message"), COMMANDS, ids=[row[0] for row in COMMANDS])
def test_a_mistake_on_the_command_line_is_answered(printed, line, wanted, message):
    code, text = printed(line)
    assert (code, message in text) == (wanted, True), text


@pytest.mark.parametrize("name", ["team", "mission"])
def test_a_file_of_another_kind_is_no_world(name):
    folder = ROOT / "missions" / "pennovation"
    with pytest.raises(DocumentError) as caught:
        load_world(folder / f"{name}.yaml", load_mission(folder / "mission.yaml"), ["io"], 1)
    (problem,) = caught.value.problems
    assert f"this is a {name} file; a mission's 'world' names the file" in problem.message


def test_a_ring_may_repeat_its_first_corner(printed):
    fence = "fence: [[39.9, -75.3], [40, -75.3], [40, -75.1], [39.9, -75.1], [39.9, -75.3]]"
    Path("field.yaml").write_text(MISSION.replace("fence: null", fence), encoding="utf-8")
    assert printed("check field.yaml")[0] == 0


def test_what_is_too_near_for_a_speed_in_other_units_names_the_unit(printed):
    """The margin of 40 m/s makes every place too near; the speed is why."""
    text = (ROOT / "missions" / "pennovation" / "mission.yaml").read_text(encoding="utf-8")
    Path("field.yaml").write_text(text.replace("speed_m_s: 3.5", "speed_m_s: 40"), encoding="utf-8")
    code, message = printed("check field.yaml")
    assert code == 3
    assert "waypoint-too-near" in message
    assert "given in km/h? then write 11.1" in message
