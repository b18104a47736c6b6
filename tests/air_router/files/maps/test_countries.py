"""Files as authorities publish them for whole countries: none is refused for what is far or odd."""

import io
import json
import math
import zipfile
from pathlib import Path
from typing import NamedTuple

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod
from shapely import LineString

from air_router.files.findings import Findings
from air_router.files.json_document import json_from_text
from air_router.files.maps.map_area import MapCircle
from air_router.files.maps.zone_files import read_zones
from air_router.files.missions.mission_file import read_mission
from air_router.files.missions.placed_form import MissionPoint, PlacedForm
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Area, Reference
from geo.frame import Geodetic, LocalFrame, Point
from mocha_link.team.document import Document, DocumentError
from mocha_link.team.problem import Problem

DATA = Path(__file__).parents[3] / "data" / "countries"
GEOD = Geod(ellps="WGS84")
ED_R4 = "openair_edr4_false_selfcross.txt"


RING = "<LinearRing><coordinates>8,47 8.1,47 8.1,47.1</coordinates></LinearRing>"
AREA = f"<Polygon><outerBoundaryIs>{RING}</outerBoundaryIs></Polygon>"
LINE = "<LineString><coordinates>8,47 9,47</coordinates></LineString>"
POINT = "<Point><coordinates>8,47</coordinates></Point>"


class Read(NamedTuple):
    """The zones of a file near a mission, and what was found in it."""

    frame: LocalFrame
    zones: list[Area]
    problems: list[Problem]
    notes: list[Problem]


def zones_at(home, path, reach_m=300.0, **options):
    document = Document.from_text("no_fly_files: []", Path("mission.yaml"))
    findings, frame = Findings(document), LocalFrame(home)
    spots = [MissionPoint(name, Point(at, at), ()) for name, at in (("home", 0), ("1", reach_m))]
    placed = PlacedForm(read_mission(document)[0], frame, spots[0], (spots[1],))
    zones = placed.with_zones_of(path, ("no_fly_files", 0), findings, **options).zones
    return Read(frame, zones, findings.problems, findings.notes)


def codes(problems):
    return [problem.code for problem in problems]


def written(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def km2(shape):
    return shape.polygon.area / 1e6


def geodesic_km2(places):
    latitudes, longitudes = zip(*places, strict=True)
    return abs(GEOD.polygon_area_perimeter(longitudes, latitudes)[0]) / 1e6


# Arcs keep the ends that are given, and no verdict depends on where home is


def ed_r4_km2():
    """Its area by hand: corners, and an arc to the left around its centre from the first one."""
    centre, start = (13 + 7 / 60 + 46 / 3600, 52 + 24 / 60 + 38 / 3600), (13.1375, 52 + 1360 / 3600)
    end, last = (13 + 662 / 3600, 52 + 1473 / 3600), (13 + 507 / 3600, 52 + 1388 / 3600)
    begin, _, radius_m = GEOD.inv(*centre, *start)
    until = GEOD.inv(*centre, *end)[0] % 360
    turn, end_m = (until - begin) % 360, GEOD.inv(*centre, *end)[2]  # its ends are not as far
    shares = [k / 500 for k in range(500)]
    arc = [
        GEOD.fwd(*centre, begin + share * turn, radius_m + share * (end_m - radius_m))[:2]
        for share in shares
    ]
    return abs(GEOD.polygon_area_perimeter(*zip(*arc, end, last, strict=True))[0]) / 1e6


@given(
    st.floats(0, 30_000), st.floats(0, 360), st.sampled_from([None, (52.41, 13.13), (52.39, 13.14)])
)
def test_a_border_with_arcs_is_sound_from_every_home(far_m, direction_deg, place):
    lon, lat, _ = GEOD.fwd(13.13, 52.4, direction_deg, far_m)
    read = zones_at(Geodetic(*(place or (lat, lon))), DATA / ED_R4)
    assert (read.problems, codes(read.notes)) == ([], [])
    (zone,) = read.zones
    assert km2(zone.shape) == pytest.approx(ed_r4_km2(), rel=2e-3)  # chords; the frame


corner = st.tuples(st.integers(0, 5), st.integers(0, 5)).map(
    lambda pair: [8 + 0.002 * pair[0], 47 + 0.002 * pair[1]]
)
home = st.tuples(st.floats(46.9, 47.1), st.floats(7.9, 8.1)).map(lambda place: Geodetic(*place))


@given(st.lists(corner, min_size=1, max_size=8), home, home)
def test_no_verdict_depends_on_where_home_is(tmp_path_factory, ring, one, other):
    feature = {"type": "Polygon", "coordinates": [ring]}
    path = written(tmp_path_factory.mktemp("rings"), "z.geojson", json.dumps(feature))
    here, there = zones_at(one, path), zones_at(other, path)
    assert here.problems == there.problems == []
    assert codes(here.notes) == codes(there.notes)
    areas = [sum(km2(zone.shape) for zone in read.zones) for read in (here, there)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-3)


def test_an_arc_that_misses_its_point_is_read_as_all_that_it_may_mean():
    read = zones_at(Geodetic(48.7, 9.3), DATA / "openair_arc_18m_off.txt")
    assert read.problems == []
    frame = read.frame
    whole = shapely.union_all([zone.shape.polygon for zone in read.zones])
    for place in ((48.8, 9.3), (48 + 38 / 60 + 54 / 3600, 9 + 37 / 60 + 28 / 3600)):
        assert whole.distance(shapely.Point(frame.to_local(*place))) < 1e-3
    given = [
        (48.648333, 9.624444),
        (48.648333, 9.623611),
        (48.896389, 9.486944),
        (48.819444, 8.797500),
    ]
    first, second, end, last = (shapely.Point(frame.to_local(*place)) for place in given)
    assert max(whole.distance(place) for place in (first, end, last)) < 1e-1
    assert whole.distance(LineString([first, second])) < 1e-1
    assert whole.area / 1e6 == pytest.approx(813.4, abs=2)  # by hand, with geodesic sides
    assert codes(read.notes) == ["zone-repaired"]


def test_an_arc_that_ends_where_it_begins_is_a_circle_only_if_it_is_alone(tmp_path):
    arc = ["V X=47N 8E", "DB 47:06:00 N 8:00:00 E, 47:06:00 N 8:00:00 E"]
    (round_zone,) = read_zones(written(tmp_path, "a.txt", openair(*arc))).zones
    far_m = GEOD.inv(8, 47, 8, 47.1)[2]
    assert round_zone.shape == MapCircle(Geodetic(47, 8), pytest.approx(far_m))
    (zone,) = read_zones(written(tmp_path, "b.txt", openair(*SQUARE, *arc))).zones
    assert zone.shape.ring[3:] == (pytest.approx((47.1, 8)),)


# Tokens


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("openair_seconds60.txt", (47 + 23 / 60, 7 + 39 / 60 + 30 / 3600)),
        ("openair_dot_without_decimals.txt", (60 + 28 / 60 + 9.2 / 3600, -135.5095833)),
    ],
)
def test_odd_numbers_of_openair(name, corner):
    reading = read_zones(DATA / name)
    assert (reading.problems, reading.notes) == ([], [])
    assert reading.zones[0].shape.ring[0] == pytest.approx(corner, abs=1e-7)


def test_the_arc_of_a_place_without_decimals_goes_around_it():
    (zone,) = read_zones(DATA / "openair_dot_without_decimals.txt").zones
    centre = (-(135 + 8 / 60 + 21.5 / 3600), 60 + 37 / 60 + 7 / 3600)
    radii = [GEOD.inv(*centre, lon, lat)[2] for lat, lon in zone.shape.ring[1:-1]]
    assert min(radii) == pytest.approx(max(radii), rel=0.01)


def test_colours_of_a_class_are_no_airspace():
    reading = read_zones(DATA / "openair_class_style_only.txt")
    assert [zone.name for zone in reading.zones] == ["far away"]
    assert (reading.problems, reading.notes) == ([], [])
    assert reading.zones[0].shape.radius_m == 2 * 1852


SQUARE = ["DP 47:00:00 N 8:00:00 E", "DP 47:00:00 N 8:01:00 E", "DP 47:01:00 N 8:01:00 E"]


def openair(*lines, limits="AL GND\nAH 100ft AGL"):
    return "AC R\nAN hall\n" + limits + "\n" + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "lines",
    [
        ["; by hand", "DP 47:00:00 N 8:00:00 E ; follows the river", *SQUARE[1:]],
        ["DP 47.00000000000000000001 N 8.000000000000000000000 E", *SQUARE[1:]],
        ["DP 46:59:60.00 N 7:59:60 E", *SQUARE[1:]],
        ["DP 46:60:00. N 8:00:00.E", *SQUARE[1:]],
        ["AF 123.45", "AX 1200", "SP 0,2,127,0,127", "a stray remark", *SQUARE],
        ["V X=47N 8E", *SQUARE, "AZ 1"],
    ],
)
def test_tokens_that_openair_files_have_are_read(tmp_path, lines):
    reading = read_zones(written(tmp_path, "a.txt", openair(*lines)))
    (zone,) = reading.zones
    assert reading.problems == []
    assert zone.shape.ring[0] == pytest.approx((47, 8), abs=1e-12)
    assert set(codes(reading.notes)) <= {"wrong-form"}
    assert zone.terms.altitudes == Altitudes(
        None, AltitudeLimit(pytest.approx(30.48), Reference.GROUND)
    )


def test_when_an_airspace_applies_is_noted_once_and_read_as_always(tmp_path):
    times = [
        "AP 01.01.2022.00:00L-01.01.2022.23:59L",
        "AP! 2.2.2022",
        "AW MON.16:45L",
        "TW FRI.08:00L",
    ]
    reading = read_zones(written(tmp_path, "a.txt", openair(*times, *SQUARE)))
    assert (len(reading.zones), reading.problems) == (1, [])
    assert codes(reading.notes) == ["unclear-time"]


def test_an_airspace_without_a_border_is_noted(tmp_path):
    reading = read_zones(written(tmp_path, "a.txt", openair() + openair(*SQUARE)))
    assert (len(reading.zones), reading.problems, codes(reading.notes)) == (1, [], ["no-area"])


def test_a_cable_between_two_masts_is_a_zone(tmp_path):
    read = zones_at(Geodetic(47, 8), written(tmp_path, "a.txt", openair(*SQUARE[:2])))
    (zone,) = read.zones
    assert (read.problems, codes(read.notes)) == ([], ["zone-repaired"])
    ends = [read.frame.to_local(47, lon) for lon in (8, 8 + 1 / 60)]
    assert zone.shape.polygon.covers(LineString(ends))
    assert 0.9 < zone.shape.polygon.area / math.dist(*ends) < 1.1


def test_a_border_of_21_251_corners_is_read(tmp_path):
    turns = [k * math.tau / 21_251 for k in range(21_251)]
    ring = [[8 + 0.1 * math.cos(turn), 47 + 0.1 * math.sin(turn)] for turn in turns]
    path = written(tmp_path, "z.json", json.dumps({"type": "Polygon", "coordinates": [ring]}))
    read = zones_at(Geodetic(47.11, 8), path)
    assert (len(read.zones), read.problems) == (1, [])
    assert km2(read.zones[0].shape) == pytest.approx(
        geodesic_km2([(lat, lon) for lon, lat in ring]), rel=1e-4
    )


# What is drawn wrong, and what cannot be read


def test_a_bow_tie_keeps_the_vehicle_out_of_both_of_its_halves(tmp_path):
    ring = [[8.0, 47.001], [8.001, 47.002], [8.001, 47.001], [8.0, 47.002]]
    path = written(tmp_path, "bow.json", json.dumps({"type": "Polygon", "coordinates": [ring]}))
    read = zones_at(Geodetic(47, 8), path)
    assert [zone.name for zone in read.zones] == ["bow 1, part 1", "bow 1, part 2"]
    (note,) = read.notes
    assert (read.problems, note.code, note.line) == ([], "zone-repaired", 1)
    assert "crosses or touches itself" in note.message
    for lon in (8.0001, 8.0009):
        place = shapely.Point(read.frame.to_local(47.0015, lon))
        assert any(zone.shape.polygon.covers(place) for zone in read.zones)


VERTEX = "0 0 3 5002 4 0 0 0"
BROKEN = openair("DP 47:00:00 N 8:00:00 E", "DP 47:00:00 N eight", "DP 47:00:30 N 8:00:30 E")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.txt", BROKEN),
        ("b.txt", openair("V X=47N 8E", "DC many")),
        (
            "a.geojson",
            json.dumps({"type": "FeatureCollection", "features": [
                {"type": "Feature", "properties": {},
                 "geometry": {"type": "Polygon", "coordinates": [
                     [[8, 47], [8.01, "x"], [8, 47.01]]]}}
            ]}),
        ),
        (
            "a.json",
            json.dumps([{"identifier": "X", "restriction": "PROHIBITED", "geometry": [
                {"uomDimensions": "M", "horizontalProjection":
                 {"type": "Circle", "center": [8, 47], "radius": -1}}]}]),
        ),
        (
            "a.kml",
            f"<kml><Placemark>{AREA.replace('8.1,47.1', 'x,y')}</Placemark></kml>",
        ),
        ("a.waypoints", f"QGC WPL 110\n{VERTEX} 47 8 0 1\n{VERTEX} 47.1 8 0 1\n"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_an_error_only_where_it_may_matter(tmp_path, name, text):
    path = written(tmp_path, name, text)
    near, far = zones_at(Geodetic(47.1, 8.1), path), zones_at(Geodetic(49, 8), path)
    assert (len(near.problems), near.zones) == (1, ())
    assert far.problems == []
    (note,) = (note for note in far.notes if note.code == "zone-unread")
    (problem,) = near.problems
    assert (note.path, note.line, note.column) == (path, problem.line, problem.column)
    assert problem.message in note.message


def test_what_has_no_place_that_can_be_read_is_an_error_everywhere(tmp_path):
    path = written(tmp_path, "a.txt", openair("DP here", "DP there", "DP nowhere"))
    assert codes(zones_at(Geodetic(49, 8), path).problems) == ["wrong-form"] * 3


def test_one_odd_airspace_leaves_the_others_as_they_are(tmp_path):
    far = openair("DP 12:00:00 N 8:00:00 E", "DP 12:00:00 N 8:10:00 E", "DX 1")
    read = zones_at(Geodetic(47, 8), written(tmp_path, "a.txt", far + openair(*SQUARE)))
    assert ([zone.name for zone in read.zones], read.problems) == (["hall"], [])


def test_notes_on_airspaces_far_away_do_not_hide_those_nearby(tmp_path):
    limits = "AL GND\nAH FL 95"
    far = [
        openair(f"DP {lat}:00:00 N 8:00:00 E", f"DP {lat}:10:00 N 8:00:00 E", limits=limits)
        for lat in range(10, 40)
    ]
    text = "".join(far) + openair(*SQUARE, limits=limits)
    read = zones_at(Geodetic(47, 8), written(tmp_path, "a.txt", text))
    (note,) = (note for note in read.notes if note.code == "unclear-altitude")
    assert note.line == text.count("\n") - 3


# Geozones in other words


def test_limits_and_names_as_spain_nests_them():
    reading = read_zones(DATA / "nested_uaszone_limits.geojson")
    (zone,) = reading.zones
    assert (reading.kind, reading.problems, reading.notes) == ("ED-318", [], [])
    assert zone.name == "TEST45 Test aerodrome"
    ground = Reference.GROUND
    assert zone.terms.altitudes == Altitudes(AltitudeLimit(45, ground), AltitudeLimit(900, ground))
    allowed = read_zones(DATA / "nested_uaszone_limits.geojson", allow=["REQ_AUTHORISATION"])
    assert (allowed.zones, codes(allowed.notes)) == ([], ["zone-allowed"])


POLYGON = {"type": "Polygon", "coordinates": [[[8, 47], [8.1, 47], [8.1, 47.1], [8, 47]]]}
FLAT = {"identifier": "X", "restriction": "PROHIBITED"}
LAYER = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "M"}
TO_120 = Altitudes(None, AltitudeLimit(120, Reference.GROUND))


@pytest.mark.parametrize(
    ("properties", "altitudes", "noted"),
    [
        ({**FLAT, **LAYER}, TO_120, []),
        (
            {
                **FLAT,
                "upper": "120",
                "upperRef": "AGL",
                "lower": "0",
                "lowerRef": "AGL",
                "uom": "M",
            },
            TO_120,
            [],
        ),
        (
            {**FLAT, "upperLimit": 120, "upperVerticalReference": "AGL", "uomDimensions": "M"},
            TO_120,
            [],
        ),
        ({**FLAT, "upperLimit": 120, "upperReference": "AGL", "unit": "M"}, TO_120, []),
        ({"name": "tower", "upper": "394 FT AGL \u00b7", "lower": "SFC"}, "about", []),
        ({**FLAT, "verticalLayer": LAYER, "upper": "120 m AGL", "upperMeters": 120}, TO_120, []),
        ({**FLAT, "verticalLayer": LAYER, "maxHeight": 400}, TO_120, ["maxHeight"]),
        ({**FLAT, "verticalLayer": LAYER, "info": {"ceiling": "FL 95"}}, TO_120, ["ceiling"]),
        ({**FLAT, "limits": [0, 300]}, None, ["limits"]),
        ({"name": "x", "lower_m": 3, "lower": 4, "height_ft": 400}, 3, ["lower", "height_ft"]),
        ({"name": "x", "UPPER": "2000", "LOWER": "GND"}, None, ["UPPER"]),
        (
            {"name": "x", "followers": 7, "flowerbed": 3, "permanent": True, "height": False},
            None,
            [],
        ),
    ],
)
def test_every_property_that_may_be_a_limit_is_read_or_noted(
    tmp_path, properties, altitudes, noted
):
    feature = {"type": "Feature", "properties": properties, "geometry": POLYGON}
    collection = {"type": "FeatureCollection", "features": [feature]}
    reading = read_zones(written(tmp_path, "z.geojson", json.dumps(collection)))
    (zone,) = reading.zones
    if altitudes == "about":
        assert zone.terms.altitudes.upper.metres == pytest.approx(120, abs=0.1)
    elif altitudes == 3:
        assert zone.terms.altitudes == Altitudes(AltitudeLimit(3))
    else:
        assert zone.terms.altitudes in (
            altitudes, altitudes and Altitudes(AltitudeLimit(0, Reference.GROUND), altitudes.upper)
        )  # fmt: skip
    assert reading.problems == []
    assert {note.message.split("'")[1] for note in reading.notes} == set(noted)


@pytest.mark.parametrize(
    "document",
    [
        [{**FLAT, "topHeight": 300, "geometry": [
            {"uomDimensions": "M", "horizontalProjection": POLYGON}]}],
        [{**FLAT, "geometry": [
            {"uomDimensions": "M", "topHeight": 300, "horizontalProjection": POLYGON}]}],
        {"type": "Feature", "properties": {"variant": "COMMON", "type": "PROHIBITED"},
         "geometry": {**POLYGON, "layer": {"topHeight": 300}}},
    ],
)  # fmt: skip
def test_limits_of_geozones_that_are_not_understood_are_noted(tmp_path, document):
    reading = read_zones(written(tmp_path, "z.json", json.dumps(document)))
    assert (len(reading.zones), reading.problems) == (1, [])
    assert [note.message.split("'")[1] for note in reading.notes] == ["topHeight"]


def test_geozones_of_ed269_written_as_geojson_are_known_by_their_restriction(tmp_path):
    features = [
        {"type": "Feature", "geometry": POLYGON,
         "properties": {"identifier": name, "type": "COMMON", "restriction": restriction}}
        for name, restriction in zip(
            "ABC", ("PROHIBITED", "NO_RESTRICTION", "CONDITIONAL"), strict=True
        )
    ]  # fmt: skip
    path = written(
        tmp_path, "z.geojson", json.dumps({"type": "FeatureCollection", "features": features})
    )
    reading = read_zones(path, allow=["CONDITIONAL"])
    assert [zone.name for zone in reading.zones] == ["A"]
    assert codes(reading.notes) == ["no-restriction", "zone-allowed"]


# Formats by content


@pytest.mark.parametrize("suffix", [".waypoints", ".txt", ".fen", ".json"])
def test_fences_of_ardupilot_are_known_by_their_content(tmp_path, suffix):
    path = tmp_path / f"fence{suffix}"
    path.write_bytes((DATA / "mp_fence.waypoints").read_bytes())
    reading = read_zones(path)
    (zone,) = reading.zones
    assert zone.shape == MapCircle(Geodetic(-35.3635, 149.166), 50)
    assert (reading.problems, codes(reading.notes)) == ([], ["not-a-zone", "not-a-zone"])


@pytest.mark.parametrize(
    ("name", "source"),
    [("zones.txt", "zones.kml"), ("zones.dat", "walk.gpx"), ("x.kml", "zones.geojson"),
     ("x.zip", "zones.kml"), ("geozones", "geozones_ed269.json"), ("x.json", "airspace.txt")],
)  # fmt: skip
def test_a_file_with_the_wrong_ending_is_read_as_what_it_is(tmp_path, name, source):
    original = DATA.parent / "files" / source
    raw = original.read_bytes()
    if name == "x.zip":
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("doc.kml", raw)
        raw = packed.getvalue()
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + raw if name == "zones.txt" else raw)
    assert [zone.shape for zone in read_zones(tmp_path / name).zones] == [
        zone.shape for zone in read_zones(original).zones
    ]


def test_an_old_fence_is_no_zone(tmp_path):
    path = written(
        tmp_path, "a.fen", "#saved by hand\n-35 149\n-35.1 149\n-35.1 149.1\n-35 149.1\n-35.1 149\n"
    )
    reading = read_zones(path)
    assert (reading.zones, reading.problems, codes(reading.notes)) == ([], [], ["not-a-zone"])


# KML


def test_blanks_after_commas_are_read_as_google_earth_does():
    reading = read_zones(DATA / "kml_blanks_after_commas.kml")
    (zone,) = reading.zones
    assert (reading.problems, reading.notes) == ([], [])
    assert zone.shape.ring == (
        (34.74294, -86.59971), (34.71793, -86.60211), (34.71486, -86.56463)
    )  # fmt: skip
    assert zone.terms.altitudes == Altitudes(upper=AltitudeLimit(100, Reference.GROUND))


def kml(*placemarks, around=""):
    marks = "".join(f"<Placemark><name>{n}</name>{g}</Placemark>" for n, g in placemarks)
    return f"<kml><Document><Folder>{around}{marks}</Folder></Document></kml>"


def test_points_and_lines_beside_polygons_are_noted(tmp_path):
    text = kml(("gate", POINT), ("hall", AREA), ("way", LINE))
    reading = read_zones(written(tmp_path, "a.kml", text))
    assert [zone.name for zone in reading.zones] == ["hall"]
    assert (reading.problems, codes(reading.notes)) == ([], ["no-area", "no-area"])


def test_a_file_of_lines_only_is_an_error(tmp_path):
    reading = read_zones(written(tmp_path, "a.kml", kml(("way", LINE), ("gate", POINT))))
    assert (codes(reading.problems), reading.zones) == (["no-area"], [])


DJI = '<wpml:templateType xmlns:wpml="http://www.dji.com/wpmz/1.0.2">mapping2d</wpml:templateType>'


def test_the_area_of_a_dji_mission_is_noted_and_can_be_skipped(tmp_path):
    path = written(tmp_path, "template.kml", kml(("", AREA), around=DJI))
    reading = read_zones(path)
    assert (len(reading.zones), codes(reading.notes)) == (1, ["mission-area"])
    assert "skip 'mapping2d'" in reading.notes[0].message
    skipped = read_zones(path, skip=["mapping2d"])
    assert (skipped.zones, skipped.problems) == ([], [])
    assert codes(skipped.notes) == ["zone-skipped"]


@pytest.mark.parametrize("skip", [["hall"], ["HALL", "nothing"]])
@pytest.mark.parametrize("name", ["a.kml", "a.geojson", "a.txt", "a.json"])
def test_zones_of_every_format_can_be_skipped_by_name(tmp_path, name, skip):
    feature = {"type": "Feature", "properties": {"name": "hall"}, "geometry": POLYGON}
    text = {
        "a.kml": kml(("hall", AREA), ("yard", AREA)),
        "a.geojson": json.dumps({"type": "FeatureCollection", "features": [
            feature, {**feature, "properties": {"name": "yard"}}]}),
        "a.txt": openair(*SQUARE) + openair(*SQUARE).replace("hall", "yard"),
        "a.json": json.dumps([
            {"identifier": n, "restriction": "PROHIBITED", "geometry": [
                {"uomDimensions": "M", "horizontalProjection": POLYGON}]}
            for n in ("hall", "yard")]),
    }[name]  # fmt: skip
    reading = read_zones(written(tmp_path, name, text), skip=skip)
    assert [zone.name for zone in reading.zones] == ["yard"]
    assert codes(reading.notes) == ["zone-skipped", "skip-unused"][: len(skip)]


def test_a_zone_that_cannot_be_read_can_be_skipped(tmp_path):
    read = zones_at(Geodetic(47, 8), written(tmp_path, "a.txt", BROKEN), skip=["hall"])
    assert (read.problems, codes(read.notes)) == ([], ["zone-skipped"])


# JSON


@pytest.mark.parametrize(
    "text", ['{"id": "b1e400", "x": "9e999", "y": "a\\ud83d\\ude00b"}', "[1.5e99, 0.1e-400, 2E+0]"]
)
def test_text_that_only_looks_like_a_number_is_none(text):
    assert json_from_text(text, Path("a.json")).data == json.loads(text)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[1e400]", "out-of-range"),
        ("1E+400", "out-of-range"),
        ('{"a":-12.5e999}', "out-of-range"),
        (f"[{'1' * 320}]", "out-of-range"),
        (f"[{'1' * 260}e60]", "out-of-range"),
        ('["\\ud83d"]', "not-json"),
        ('["\\ude00\\ud83d"]', "not-json"),
    ],
)
def test_numbers_and_characters_that_are_none_are_refused(text, code):
    with pytest.raises(DocumentError) as caught:
        json_from_text(text, Path("a.json"))
    assert codes(caught.value.problems) == [code]
