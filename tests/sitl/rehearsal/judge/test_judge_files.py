"""The judge's own readers of map files and hours, and its rules of files that change in flight."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from sitl.rehearsal.judge.evidence import EvidenceError, SceneEvent, SceneEventKind
from sitl.rehearsal.judge.hours import meets
from sitl.rehearsal.judge.map_reader import zones_of_map
from sitl.rehearsal.judge.mission_reader import read_mission
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import TEXT
from tests.sitl.rehearsal.judge.test_judge_inputs import flight

RING = "[[[-75.2, 39.94], [-75.199, 39.94], [-75.199, 39.941], [-75.2, 39.94]]]"
POLYGON = f'{{"type": "Polygon", "coordinates": {RING}}}'
OPENAIP = (
    ('{{"type": "Feature", "properties": {{"name": "a", {}}}, "geometry": ' + POLYGON + "}}")
    .replace("{{", "{")
    .replace("}}", "}")
)
ED269 = """{"features": [{"identifier": "A", "name": "a", "restriction": "PROHIBITED",
 "applicability": [{"permanent": "YES"}], "geometry": [{"uomDimensions": "%s", "lowerLimit": 100,
 "lowerVerticalReference": "AMSL", "upperLimit": 200, "upperVerticalReference": "AGL",
 "horizontalProjection": {"type": "Circle", "center": [-75.2, 39.94], "radius": 30}}]}]}"""
KML = """<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>a</name><Polygon>
<extrude>%s</extrude><altitudeMode>absolute</altitudeMode><outerBoundaryIs><LinearRing><coordinates>
-75.2,39.94,80 -75.199,39.94,90 -75.199,39.941,80 -75.2,39.94,80</coordinates></LinearRing>
</outerBoundaryIs></Polygon></Placemark></Document></kml>"""
OPENAIR = "AC R\nAN a\nAL {}\nAH {}\nV X=39:56:30 N 075:12:00 W\nDC 0.5\n"


def zone(name, text):
    ((_, found),) = zones_of_map(Path(name), text)
    return found


@pytest.mark.parametrize(
    ("name", "text", "lower", "upper"),
    [
        (
            "a.geojson",
            OPENAIP.replace("{}", '"lowerLimit": {"value": 100, "unit": 1, "referenceDatum": 1}'),
            (30.48, "amsl"),
            None,
        ),
        (
            "a.geojson",
            OPENAIP.replace("{}", '"UPPER_VAL": 100, "UPPER_UOM": "FT", "UPPER_CODE": "SFC"'),
            None,
            (30.48, "ground"),
        ),
        (
            "a.geojson",
            OPENAIP.replace("{}", '"upperLimit": {"value": 95, "unit": 6, "referenceDatum": 2}'),
            None,
            None,
        ),
        ("a.json", ED269 % "FT", (30.48, "amsl"), (60.96, "ground")),
        ("a.json", ED269 % "M", (100.0, "amsl"), (200.0, "ground")),
        ("a.txt", OPENAIR.format("FL50", "3500 MSL"), (771.6, "amsl"), (1066.8, "amsl")),
        ("a.txt", OPENAIR.format("SFC", "100m AGL"), None, (100.0, "ground")),
        ("a.kml", KML % 1, None, (90.0, "amsl")),
        ("a.kml", KML % 0, None, None),
    ],
)
def test_limits_of_map_files_are_metres(name, text, lower, upper):
    if "SFC" in text and name.endswith("txt"):
        text = text.replace("AL SFC", "AL 0 AGL")
    altitude = zone(name, text)["altitude"]
    for end, limit in (("lower", lower), ("upper", upper)):
        reference = altitude.get(f"{end}_reference", altitude.get("reference"))
        found = altitude.get(f"{end}_m")
        if limit is None:
            assert found is None
        else:
            assert found == pytest.approx(limit[0])
            assert reference == limit[1]


def test_places_of_map_files():
    circle = zone("a.txt", OPENAIR.format("0ft MSL", "9000ft MSL"))["circle"]
    assert circle["centre"] == pytest.approx([39.941666667, -75.2])
    assert circle["radius_m"] == 926.0
    assert zone("a.json", ED269 % "M")["circle"] == {"centre": [39.94, -75.2], "radius_m": 30}
    assert zone("a.kml", KML % 0)["polygon"][1] == [39.94, -75.199]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.gpx", ""),
        ("a.txt", "AC R\nDB 1,2\n"),
        ("a.txt", OPENAIR.format("high", "9000ft")),
        ("a.json", (ED269 % "FT").replace("YES", "NO")),
        ("a.geojson", '{"features": [{"extendedProperties": {}}]}'),
    ],
)
def test_what_the_judge_cannot_read_it_refuses(name, text):
    with pytest.raises(EvidenceError):
        list(zones_of_map(Path(name), text))


MONDAY = datetime(2026, 9, 21, 14, 13, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("period", "applies"),
    [
        ({"between": ["14:00", "16:00"]}, True),
        ({"between": ["14:20", "16:00"]}, False),
        ({"between": ["22:00", "14:14"]}, True),
        ({"between": ["22:00", "14:10"]}, False),
        ({"days": ["sun"], "between": ["22:00", "15:00"]}, True),
        ({"days": ["monday"], "between": ["22:00", "15:00"]}, False),
        ({"days": ["tuesday"]}, False),
        ({"from": "2026-09-21T16:00:00+02:00"}, True),
        ({"from": "2026-09-21T16:00:00-02:00"}, False),
        ({"until": "2026-09-21T16:00:00+02:00"}, False),
        ({"until": "2026-09-21T10:30:00-04:00", "days": ["mon"]}, True),
        ({"between": ["14:00", "24:00"]}, True),
    ],
)
def test_hours_are_utc(period, applies):
    assert meets(period, MONDAY, MONDAY + 300.0) == applies


@pytest.mark.parametrize(
    ("hours", "zones"), [("14:00", 3), ("15:00", 3), ("16:30", 2)]
)  # it may begin up to an hour later
def test_zones_count_in_their_hours(hours, zones):
    text = f'{TEXT}  - {{circle: {{centre: [75, 0], radius_m: 9}}, active: [{{between: ["{hours}", '
    mission = read_mission(Path(), text + '"18:00"]}]}\n', flown=(MONDAY, MONDAY + 300.0))
    assert len(mission.zones) == zones
    assert [bool(zone.periods) for zone in mission.zones[2:]] == [hours != "14:00"] * (zones - 2)


ELSEWHERE = "  - {name: new, polygon: [[300, 55], [303, 55], [303, 80], [300, 80]]}\n"
AT_HOME = "  - {name: new, polygon: [[-5, -5], [5, -5], [5, 5], [-5, 5]]}\n"
MANY = "".join(
    f"  - {{name: n{n}, polygon: [[300, {n * 9}], [303, {n * 9}], [303, {n * 9 + 4}]]}}\n"
    for n in range(20)
)


def left(text, announced="not reloaded: mission.yaml: something"):
    happenings = (SceneEvent(74.0, SceneEventKind.FILE_LEFT, (70.0, text)),)
    verdict = judge(flight(announced=[(72.0, announced)], happenings=happenings))
    return " | ".join(str(violation) for violation in verdict.violations)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        (TEXT + ELSEWHERE, True),
        (TEXT.replace("[200, 200]", "[210, 210]"), True),
        (TEXT + AT_HOME, False),
        (TEXT + MANY, False),
        (TEXT, False),
        ((TEXT + ELSEWHERE).replace("speed_m_s: 5", "speed_m_s: 6"), False),
    ],
)
def test_a_good_file_is_taken_whatever_is_announced(text, wrong):
    assert ("nothing is wrong" in left(text)) == wrong


@pytest.mark.parametrize(
    ("announced", "expected"),
    [
        ("not reloaded: speed changed as well", ""),
        ("not reloaded: its fences and no-fly zones are as they were", "speed_m_s changed as well"),
        ("EXPL -> SEARCH", "refused without a reason"),
    ],
)
def test_what_else_has_changed_is_announced(announced, expected):
    found = left(TEXT.replace("speed_m_s: 5", "speed_m_s: 6"), announced)
    assert expected in found
    assert bool(found) == bool(expected) or "SEARCH" in announced


@pytest.mark.parametrize(
    ("text", "wrong"),
    [(TEXT + ELSEWHERE, False), ((TEXT + ELSEWHERE).replace("speed_m_s: 5", "speed_m_s: 6"), True)],
)
def test_no_file_is_flown_by_in_which_more_than_areas_changed(text, wrong):
    happenings = (SceneEvent(74.0, SceneEventKind.MISSION_FILE, text),)
    verdict = judge(flight(happenings=happenings))
    assert any("changed as well" in str(v) for v in verdict.violations) == wrong
