"""Zones from GeoJSON, KML, ED-269 and ED-318: what they become, alone and in a mission."""

import json
import math
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from implicitdict import ImplicitDict
from uas_standards import eurocae_ed318
from uas_standards.eurocae_ed269 import ED269Schema

from air_router.files.findings import Findings
from air_router.files.maps.geozone_hours import validity_of
from air_router.files.maps.map_area import MapCircle, MapOutline, unique_names
from air_router.files.maps.zone_files import read_zones
from air_router.files.missions.mission_file import read_mission
from air_router.files.missions.placed_form import MissionPoint, PlacedForm, Placer
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference
from air_router.mission.loading import load_mission
from geo.frame import Geodetic, LocalFrame, Point
from geo.validity import Hours
from mocha_link.team.document import Document, DocumentError

FILES = Path(__file__).parents[3] / "data" / "files"
GROUND, AMSL = Reference.GROUND, Reference.AMSL
MISSION = """\
home: {position: [47.0, 8.0], altitude_amsl_m: 450}
altitude_m: 60
waypoints: [[47.0005, 8.0], [47.0036, 8.0015]]
fence: [[46.998, 7.9965], [47.006, 7.9965], [47.006, 8.007], [46.998, 8.007]]
no_fly_zones: []
"""


def read(name, **options):
    reading = read_zones(FILES / name, **options)
    assert reading.problems == []
    return reading


def codes(reading):
    return [note.code for note in reading.notes]


def place_of(zone):
    here = zone.problem("", "")
    return here.line, here.column


def test_geojson():
    reading = read("zones.geojson")
    yard, mast, first, second = reading.zones
    assert [zone.name for zone in reading.zones] == ["yard", "mast", "7, part 1", "7, part 2"]
    assert (len(yard.shape.ring), len(yard.shape.holes), yard.terms.clearance_m) == (4, 1, 8)
    assert yard.shape.ring[1] == Geodetic(47.0010, 8.0030)
    assert mast.shape == MapCircle(Geodetic(47.0, 8.0040), 25)
    assert mast.terms.altitudes == Altitudes(upper=AltitudeLimit(60, GROUND))
    assert str(mast.terms.validity) == "from 2026-11-01 00:00, mon fri 06:00-18:00 UTC"
    assert {type(zone.shape) for zone in (first, second)} == {MapOutline}
    assert codes(reading) == ["no-area", "not-a-zone"]


def test_kml():
    reading = read("zones.kml")
    yard, first, second, mast = reading.zones
    assert (len(yard.shape.ring), len(yard.shape.holes), yard.terms.clearance_m) == (4, 1, 8)
    assert (yard.terms.altitudes, place_of(yard)) == (None, (9, 9))
    assert (
        first.terms.altitudes
        == second.terms.altitudes
        == Altitudes(upper=AltitudeLimit(20, GROUND))
    )
    assert mast.name == "zones 3"
    assert mast.shape == MapCircle(Geodetic(47.0, 8.0040), 25)
    assert codes(reading) == ["no-area", "not-a-zone"]


def test_ed269():
    reading = read("geozones_ed269.json")
    low, high, school = reading.zones
    assert low.name == "XXA001 Heliport, volume 1"
    assert low.shape == MapCircle(Geodetic(47.0, 8.0040), 250)
    assert low.terms.altitudes == Altitudes(AltitudeLimit(0, GROUND), AltitudeLimit(120, GROUND))
    assert low.terms.validity is None
    assert high.terms.altitudes.lower.metres == pytest.approx(457.2)
    assert high.terms.altitudes.upper == AltitudeLimit(pytest.approx(762.0), AMSL)
    assert school.terms.altitudes is None  # up to 0 m above ground: as good as no limit
    assert str(school.terms.validity) == (
        "from 2026-01-05 00:00 until 2026-12-18 22:59, mon sun 23:30-16:59 UTC"
    )
    assert codes(reading) == ["no-height", "no-restriction"]


def test_ed318():
    reading = read("geozones_ed318.json")
    heliport, low, high, owls = reading.zones
    assert heliport.name == "XXA001 Heliport"
    assert heliport.terms.altitudes.upper == AltitudeLimit(pytest.approx(121.92), GROUND)
    assert low.terms.altitudes == Altitudes(
        lower=AltitudeLimit(0, GROUND)
    )  # above the ellipsoid: no limit
    assert high.terms.altitudes == Altitudes(AltitudeLimit(450, AMSL), AltitudeLimit(600, AMSL))
    assert high.terms.validity.active_between(
        *(datetime(2026, 11, 3, h, tzinfo=UTC) for h in (8, 9))
    )
    assert not high.terms.validity.active_between(
        *(datetime(2026, 11, 6, h, tzinfo=UTC) for h in (8, 9))
    )
    assert owls.terms.validity is None  # from sunset to sunrise: read as always
    assert codes(reading) == ["no-reference", "unclear-time", "no-restriction"]


def test_our_samples_follow_the_standards():
    document = json.loads((FILES / "geozones_ed269.json").read_text())
    assert len(ED269Schema.from_dict(document).features) == 3
    document = json.loads((FILES / "geozones_ed318.json").read_text())
    for feature in document["features"]:  # piecewise: as a whole it takes points only
        ImplicitDict.parse(feature["properties"], eurocae_ed318.UASZone)
        geometry = feature["geometry"]
        for each in geometry.get("geometries", [geometry]):
            ImplicitDict.parse(each, getattr(eurocae_ed318, each["type"]))


@pytest.mark.parametrize(
    ("allow", "names"),
    [
        (
            ["conditional"],
            ["XXA001 Heliport", "XXA002 School, volume 1", "XXA002 School, volume 2"],
        ),
        (["REQ_AUTHORISATION", "XXA001"], ["XXA003 Owls"]),
        (["REQ_AUTHORIZATION"], ["XXA001 Heliport", "XXA003 Owls"]),
        (["PROHIBITED", "REQ_AUTHORISATION", "CONDITIONAL"], []),
    ],
)
def test_what_the_operator_may_do_is_left_out(allow, names):
    reading = read("geozones_ed318.json", allow=allow)
    assert [zone.name for zone in reading.zones] == names
    assert codes(reading)[-1] == "zone-allowed"


def test_what_is_allowed_in_vain_is_noted():
    reading = read("geozones_ed269.json", allow=["CONDITONAL", "xxa002"])
    assert [zone.name[:6] for zone in reading.zones] == ["XXA001", "XXA001"]
    assert codes(reading) == ["no-restriction", "zone-allowed", "allow-unused"]
    assert "'CONDITONAL'" in reading.notes[-1].message


@pytest.mark.parametrize("name", ["zones.geojson", "zones.kml", "walk.gpx"])
def test_what_cannot_be_allowed_is_noted(name):
    reading = read_zones(FILES / name, allow=["yard"])
    assert len(reading.zones) == len(read_zones(FILES / name).zones)
    (note,) = (note for note in reading.notes if note.code == "allow-unused")
    assert "'yard'" in note.message


def test_a_mission_allows_zones(tmp_path):
    entry = f"{{file: '{FILES}/geozones_ed318.json', allow: [PROHIBITED, XXA002, CONDITIONAL]}}"
    found = load_mission(mission(tmp_path, f"no_fly_files: [{entry}]\n"))
    assert found.zones == ()
    assert [note.code for note in found.notes] == ["no-restriction", "zone-allowed"]


def ed269(limits=None, **zone):
    projection = {"type": "Circle", "center": [8.0, 47.0], "radius": 50}
    volume = {"uomDimensions": "M", "horizontalProjection": projection, **(limits or {})}
    return {"identifier": "X1", "restriction": "PROHIBITED", "geometry": [volume], **zone}


def read_written(folder, document):
    path = folder / "z.json"
    path.write_text(json.dumps(document))
    return read_zones(path)


def test_a_map_program_that_fills_in_its_columns_makes_no_zone_another_kind(tmp_path):
    path = tmp_path / "merged.geojson"
    square = {"type": "Polygon", "coordinates": [[[8, 47], [8.1, 47], [8.1, 47.1], [8, 47]]]}
    features = [
        {"type": "Feature", "properties": {"name": name, "kind": kind}, "geometry": square}
        for name, kind in (("drawn", None), ("typed", ""), ("ours", "zone"), ("way", "waypoint"))
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    reading = read_zones(path)
    assert [zone.name for zone in reading.zones] == ["drawn", "typed", "ours"]
    assert codes(reading) == ["not-a-zone"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("x.geojson", '{"type": "MultiPolygon", "coordinates": []}'),
        ("x.geojson", '{"type": "GeometryCollection", "geometries": []}'),
        ("x.json", json.dumps([{"identifier": "X", "restriction": "PROHIBITED", "geometry": []}])),
        ("x.kml", "<kml><Placemark><MultiGeometry/></Placemark></kml>"),
    ],
)
def test_a_zone_without_any_piece_is_not_left_out_silently(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert codes(read_zones(tmp_path / name)) == ["no-area"]


def test_a_placemark_may_have_a_circle_and_polygons(tmp_path):
    ring = "<LinearRing><coordinates>8,47,9 9,47,9 9,48,9</coordinates></LinearRing>"
    polygon = (
        "<Polygon><extrude>1</extrude><altitudeMode>relativeToGround</altitudeMode>"
        f"<outerBoundaryIs>{ring}</outerBoundaryIs></Polygon>"
    )
    data = '<ExtendedData><Data name="radius_m"><value>20</value></Data></ExtendedData>'
    point = "<Point><coordinates>8,47</coordinates></Point>"
    (tmp_path / "x.kml").write_text(f"<kml><Placemark>{data}{point}{polygon}</Placemark></kml>")
    reading = read_zones(tmp_path / "x.kml")
    assert (reading.problems, reading.notes) == ([], [])
    assert [type(zone.shape) for zone in reading.zones] == [MapCircle, MapOutline]
    assert {zone.terms.altitudes for zone in reading.zones} == {None}  # the circle has no limit


@pytest.mark.parametrize("floor", [None, "AGL", "AMSL"])
def test_a_ceiling_at_the_ground_is_none_whatever_the_floor_counts_from(tmp_path, floor):
    limits = {"upperLimit": 0, "upperVerticalReference": "AGL", "uomDimensions": "M"}
    if floor is not None:
        limits |= {"lowerLimit": 0, "lowerVerticalReference": floor}
    reading = read_written(tmp_path, [ed269(limits)])
    altitudes = reading.zones[0].terms.altitudes
    assert altitudes is None or altitudes.upper is None
    assert codes(reading) == ["no-height"]


@pytest.mark.parametrize("floor_m", [120, 150])
def test_a_ceiling_at_or_below_the_floor_is_none_and_the_lower_of_the_two_the_floor(
    tmp_path, floor_m
):
    limits = {"lowerLimit": floor_m, "upperLimit": 120, "uomDimensions": "M"}
    limits |= dict.fromkeys(("lowerVerticalReference", "upperVerticalReference"), "AGL")
    reading = read_written(tmp_path, [ed269(limits)])
    assert reading.zones[0].terms.altitudes == Altitudes(AltitudeLimit(120, GROUND))
    assert codes(reading) == ["no-height"]


def test_ed269_that_calls_itself_a_feature_collection(tmp_path):
    reading = read_written(tmp_path, {"type": "FeatureCollection", "features": [ed269()]})
    assert (reading.kind, len(reading.zones)) == ("ED-269", 1)


def test_ed269_as_it_was_written_years_ago(tmp_path):
    daily = {"day": [], "startTime": None, "endTime": None}
    period = {"permanent": "NO", "startDateTime": None, "endDateTime": None}
    limits = {"uomDimensions": "FT", "lowerLimit": "100", "upperLimit": None}
    limits |= dict.fromkeys(("lowerVerticalReference", "upperVerticalReference"), "AGL")
    zones = [
        ed269(limits, applicability=[{**period, "dailyPeriod": [daily]}]),
        ed269(applicability=[{**period, "dailyPeriod": [{**daily, "day": ["MON"]}]}]),
        ed269(
            applicability=[
                {"startDateTime": "2026-07-22T07:00:00Z", "endDateTime": "9999-12-31T23:59:59Z"}
            ]
        ),
    ]
    reading = read_written(tmp_path, {"formatVersion": "1.0.0", "UASZoneList": zones})
    assert reading.problems == reading.notes == []
    every, mondays, for_good = reading.zones
    assert str(for_good.terms.validity) == "from 2026-07-22 07:00 until 9999-12-31 23:59 UTC"
    assert every.terms.altitudes == Altitudes(lower=AltitudeLimit(pytest.approx(30.48), GROUND))
    assert every.terms.validity.active_between(*[datetime(2026, 11, 20, 12, tzinfo=UTC)] * 2)
    assert not mondays.terms.validity.active_between(*[datetime(2026, 11, 20, 12, tzinfo=UTC)] * 2)


def test_a_layer_counts_metres_unless_it_has_another_unit(tmp_path):
    document = json.loads((FILES / "geozones_ed318.json").read_text())
    del document["features"][0]["geometry"]["layer"]["uom"]
    document["features"][1]["geometry"]["geometries"][1]["layer"]["upper"] = 999_999
    first, _, third, *_ = read_written(tmp_path, document).zones
    assert first.terms.altitudes.upper == AltitudeLimit(400, GROUND)
    assert third.terms.altitudes.upper is None  # beyond all flight


def test_geozones_in_doubt_are_the_larger_zone(tmp_path):
    start, over = "2026-07-22T07:00:00Z", "2020-01-01T00:00:00Z"
    times = (
        [{"startDateTime": start, "endDateTime": "2026-07-22T06:50:00Z"}],
        [{"startDateTime": start.removesuffix("Z")}],
        [{"startDateTime": start, "schedule": [7]}],
        [{"permanent": "YES", "endDateTime": over}],
        [{"endDateTime": over}, {}],
    )
    zones = [ed269(restriction="MAYBE"), *(ed269(applicability=each) for each in times)]
    reading = read_written(tmp_path, zones)
    assert [zone.terms.validity for zone in reading.zones[:3]] == [None] * 3
    assert str(reading.zones[3].terms.validity) == "from 2026-07-22 07:00 UTC"
    assert [zone.terms.validity for zone in reading.zones[4:]] == [None] * 2
    assert codes(reading) == ["unknown-restriction", *["unclear-time"] * 3]


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        ("08:00Z", "18:00Z", "mon 08:00-18:00"),
        ("08:00:00.00Z", "18:00:01Z", "mon 08:00-18:01"),
        ("00:00Z", "23:59Z", "mon 00:00-00:00"),
        ("00:00", "24:00", "mon 00:00-00:00"),
        ("01:00+02:00", "10:00+0200", "sun 23:00-08:00"),
        ("20:00-05:00", "23:00-05:00", "tue 01:00-04:00"),
        ("00:00+02:00", "23:59+02:00", "sun 22:00-22:00"),
        ("22:00Z", "06:00Z", "mon 22:00-06:00"),
    ],
)
def test_hours_in_utc(start, end, expected):
    days, start_s, end_s = expected.replace("-", " ").split()
    number = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"].index(days)
    schedule = [{"day": ["MON"], "startTime": start, "endTime": end}]
    validity = validity_of([{"schedule": schedule}], lambda *_: pytest.fail("a doubt"))
    assert validity.periods[0].daily[0] == Hours(
        frozenset({number}), *(time_of(text) for text in (start_s, end_s))
    )


def time_of(text):
    return datetime.strptime(text, "%H:%M").replace(tzinfo=UTC).time()


def mission(folder, extra, text=MISSION):
    path = folder / "mission.yaml"
    path.write_text(text + extra)
    return path


def test_zones_of_files_take_part_in_a_mission(tmp_path):
    extra = f"no_fly_files: ['{FILES}/zones.geojson', '{FILES}/zones.kml']\n"
    path = mission(tmp_path, extra)
    found = load_mission(path, start=datetime(2026, 11, 20, 12, tzinfo=UTC))  # a Friday
    names = [zone.name for zone in found.zones]
    assert names == [
        "yard", "mast", "7, part 1", "7, part 2",
        "yard (2)", "hall, part 1", "hall, part 2", "zones 3",
    ]  # fmt: skip
    assert found.zones[0].clearance_m == 8
    assert not found.airspace.point_clear(found.frame.to_local(47.0012, 8.0012))
    assert found.airspace.point_clear(found.frame.to_local(47.0020, 8.0020))  # the hole
    assert "hall, part 1" not in [zone.name for zone in found.airspace.zones]  # 20 m high


def test_a_problem_with_a_zone_stands_in_its_own_file(tmp_path):
    path = mission(tmp_path, f"no_fly_files: ['{FILES}/zones.geojson']\n",
                   MISSION.replace("[47.0036, 8.0015]", "[47.0012, 8.0012]"))  # fmt: skip
    with pytest.raises(DocumentError) as caught:
        load_mission(path)
    (problem,) = caught.value.problems
    assert (problem.path, problem.code) == (path, "waypoint-in-zone")


class Near:
    """A mission with a home and a waypoint, and what is found in a file of zones."""

    def __init__(self, home):
        document = Document.from_text("no_fly_files: []", Path("mission.yaml"))
        self.findings = Findings(document)
        self.frame = LocalFrame(home)
        self.placed = PlacedForm(
            read_mission(document)[0],
            self.frame,
            MissionPoint("home", Point(0, 0), ()),
            (MissionPoint("waypoint 1", Point(300, 200), ()),),
        )

    def add(self, path, allow=()):
        keys = ("no_fly_files", 0)
        self.zones = self.placed.with_zones_of(path, keys, self.findings, allow=allow).zones

    @property
    def problems(self):
        return self.findings.problems

    @property
    def notes(self):
        return self.findings.notes


def square(longitude_deg, latitude_deg, half_m=50):
    half_lat = half_m / 111_200
    half_lon = half_lat / math.cos(math.radians(latitude_deg))
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    ring = [[longitude_deg + x * half_lon, latitude_deg + y * half_lat] for x, y in signs]
    wrapped = [[(x + 180) % 360 - 180, y] for x, y in ring]
    return {"type": "Polygon", "coordinates": [wrapped]}


def add(folder, near, *geometries, allow=()):
    features = [
        {"type": "Feature", "properties": {"name": f"z{i}", **properties}, "geometry": geometry}
        for i, (geometry, properties) in enumerate(
            entry if isinstance(entry, tuple) else (entry, {}) for entry in geometries
        )
    ]
    path = folder / "z.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    near.add(path, allow)
    return [area.name for area in near.zones]


def test_far_zones_are_left_out(tmp_path):
    near = Near(Geodetic(47.0, 8.0))
    names = add(
        tmp_path,
        near,
        square(8.0, 47.1),  # 11 km: within reach without a fence
        square(8.0, 48.0),  # 111 km
        square(-172.0, -47.0),  # the other side of the Earth
        square(8.0, 47.0, half_m=400_000),  # around everything
        ({"type": "Point", "coordinates": [8.0, 48.0]}, {"radius_m": 90_000}),
    )
    assert names == ["z0", "z3", "z4"]
    assert [note.code for note in near.notes] == ["zones-far"]
    assert "3 of 5 zones are within 50 km" in near.notes[0].message
    assert near.problems == []


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg"),
    [(47.0, 8.0), (0.0, 0.0), (-17.0, 179.9999), (-17.0, -179.9999), (89.9, 20.0), (-70.0, 179.0)],
)
def test_zones_are_near_wherever_the_mission_is(tmp_path, latitude_deg, longitude_deg):
    near = Near(Geodetic(latitude_deg, longitude_deg))
    assert add(tmp_path, near, square(longitude_deg + 0.0005, latitude_deg)) == ["z0"]
    assert near.zones[0].shape.polygon.area == pytest.approx(10_000, rel=0.02)
    assert (near.problems, near.notes) == ([], [])


def rectangle(west_deg, south_deg, east_deg, north_deg):
    corners = [(west_deg, south_deg), (east_deg, south_deg), (east_deg, north_deg)]
    corners.append((west_deg, north_deg))
    return {"type": "Polygon", "coordinates": [[[*corner] for corner in corners]]}


@pytest.mark.parametrize(
    ("west_deg", "north_deg"), [(-180, 80), (-180, 48), (-179, 80), (-120, 80), (-90, 80)]
)
def test_a_zone_around_half_the_earth_is_not_left_out_as_far(tmp_path, west_deg, north_deg):
    near = Near(Geodetic(47.0, 8.0))
    add(tmp_path, near, rectangle(west_deg, 40 if north_deg < 50 else 0, -west_deg, north_deg))
    (problem,) = near.problems
    assert problem.code == "too-wide"
    assert "'z0'" in problem.message


def test_a_zone_of_a_file_may_be_called_fence(tmp_path):
    near = Near(Geodetic(47.0, 8.0))
    names = add(tmp_path, near, (square(8.0, 47.001), {"name": "fence"}))
    assert names == ["fence (2)"]


def test_a_zone_across_the_antimeridian_is_far_from_other_places(tmp_path):
    near = Near(Geodetic(47.0, 8.0))
    across = rectangle(170, -20, -170, -10)  # far, whichever way its sides lead
    add(tmp_path, near, across, square(8.0, 47.001))
    assert (near.problems, [note.code for note in near.notes]) == ([], ["zones-far"])
    near = Near(Geodetic(-15.0, 160.0))  # of the same latitude
    assert add(tmp_path, near, across, square(160.0, -15.001)) == ["z1"]
    assert (near.problems, [note.code for note in near.notes]) == ([], ["zones-far"])
    near = Near(Geodetic(-15.0, 175.0))
    assert add(tmp_path, near, across) == ["z0"]
    assert near.problems == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("x.geojson", '{"type": "FeatureCollection", "features": []}'),
        ("x.kml", "<kml><Document/></kml>"),
        ("x.gpx", "<gpx/>"),
    ],
)
def test_a_file_without_zones_is_reported(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    near = Near(Geodetic(47.0, 8.0))
    near.add(tmp_path / name)
    assert [(note.code, note.message) for note in near.notes] == [
        ("no-zones", f"{name}: there are no zones in it")
    ]


def test_exchanged_coordinates_are_noticed(tmp_path):
    near = Near(Geodetic(47.0, 8.0))
    assert add(tmp_path, near, square(47.0, 8.0), square(47.001, 8.0)) == []
    (problem,) = near.problems
    assert problem.code == "coordinates-exchanged"
    assert (problem.path.name, problem.line) == ("z.geojson", 1)
    near = Near(Geodetic(47.0, 8.0))  # polygons in order, circles not
    circle = ({"type": "Point", "coordinates": [47.0, 8.0]}, {"radius_m": 30})
    assert add(tmp_path, near, square(8.0, 47.001), circle) == []
    assert [problem.code for problem in near.problems] == ["coordinates-exchanged"]
    near = Near(Geodetic(10.0, 10.1))  # on the diagonal a far zone is just far
    assert add(tmp_path, near, square(10.1, 10.0), square(10.0, 10.1)) == ["z0", "z1"]
    assert near.problems == []


def test_long_sides_are_straight_on_the_map(tmp_path):
    near = Near(Geodetic(60.0, 8.0))
    ring = [[7.9, 60.01], [8.1, 60.01], [8.1, 60.02], [7.9, 60.02], [7.9, 60.01]]
    add(tmp_path, near, {"type": "Polygon", "coordinates": [ring]})
    polygon = near.zones[0].shape.polygon
    for share in (0.13, 0.25, 0.5, 0.77):
        place = near.frame.to_local(60.01, 7.9 + share * 0.2)
        assert polygon.exterior.distance(shapely_point(place)) < 0.06  # not 4 m


def shapely_point(place):
    from shapely import Point as ShapelyPoint  # noqa: PLC0415 - the name is taken here

    return ShapelyPoint(place)


def test_rings_and_zones_without_end_are_bounded(tmp_path):
    def star(corners):
        turns = [k * math.tau / corners for k in range(corners)]
        reach = [0.01 + 0.3 * (k % 2) for k in range(corners)]
        ring = [
            [8 + r * math.cos(a), 47 + r * math.sin(a)] for r, a in zip(reach, turns, strict=True)
        ]
        return {"type": "Polygon", "coordinates": [ring]}

    near = Near(Geodetic(47.0, 8.0))
    started = time.process_time()
    assert add(tmp_path, near, star(1000)) == ["z0"]
    placer = Placer(near.frame, near.findings)
    in_mission = [pair[::-1] for pair in star(1000)["coordinates"][0]]
    for outline in (near.zones[0].shape, placer.polygon("a star", in_mission, ())):
        assert 1_000 < len(outline.ring) < 25_000
    assert time.process_time() - started < 4
    near = Near(Geodetic(47.0, 8.0))
    assert add(tmp_path, near, star(200_001)) == []
    assert [problem.code for problem in near.problems] == ["too-large"]
    triangles = [[[[8 + i / 1e5, 47], [8 + i / 1e5, 47.001], [8, 47.002]]] for i in range(1, 3002)]
    near = Near(Geodetic(47.0, 8.0))
    assert add(tmp_path, near, {"type": "MultiPolygon", "coordinates": triangles}) == []
    assert "3001 zones near the mission" in near.problems[0].message


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_kml_in_other_encodings(tmp_path, encoding):
    text = (FILES / "zones.kml").read_text().replace("UTF-8", encoding).replace("yard", "Höfe")
    path = tmp_path / "zones.kml"
    path.write_bytes(text.encode(encoding))
    assert read_zones(path).zones[0].name == "Höfe"


@given(st.lists(st.sampled_from(["a", "b", "a (2)"])), st.sets(st.sampled_from(["a", "a (2)"])))
def test_names_are_unique(names, taken):
    unique = unique_names(names, taken)
    assert len(set(unique)) == len(names)
    assert not taken & set(unique)
