"""GeoJSON and KML that we write: by their rules, and the zones come back as they were."""

import json
import math
import xml.etree.ElementTree as ET
from datetime import UTC, time
from pathlib import Path

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from air_router.files.maps.feature_set import (
    FeatureSet,
    MapPoint,
    corners_of,
)
from air_router.files.maps.geojson import geojson_of, geojson_text
from air_router.files.maps.json_zones import JSON
from air_router.files.maps.kml import KML as KML_FORMAT
from air_router.files.maps.kml import kml_text
from air_router.files.maps.map_area import MapArea, MapCircle, MapOutline
from air_router.files.maps.zone_files import read_zones
from air_router.files.maps.zone_reading import ZoneReading
from air_router.files.missions.mission_write import feature_set_of
from air_router.files.missions.placed_form import local_ring
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference, ZoneTerms
from air_router.mission.loading import read_placed
from geo.airspace.zone import Outline
from geo.frame import FrameError, Geodetic, LocalFrame, Point, circle_around, dense_ring
from geo.validity import Hours, Period, Validity

PATH = Path("x.zones")
TOWN = Path(__file__).parents[3] / "data" / "files" / "town.yaml"
KML = "{http://www.opengis.net/kml/2.2}"


def from_geojson(features):
    reading = ZoneReading(JSON.read(geojson_text(features).encode(), PATH), PATH)
    assert reading.problems == []
    return reading.zones


def from_kml(features):
    reading = ZoneReading(KML_FORMAT.read(kml_text(features).encode(), PATH), PATH)
    assert reading.problems == []
    return reading.zones


def ring_of(east_deg, north_deg, radius_deg, corners, turn=0.0):
    return tuple(
        Geodetic(
            north_deg + radius_deg * math.sin(turn + k * math.tau / corners),
            east_deg + radius_deg * math.cos(turn + k * math.tau / corners),
        )
        for k in range(corners)
    )


moments = st.datetimes(timezones=st.just(UTC))
clock = st.times().map(lambda found: time(found.hour, found.minute))
hours = st.builds(Hours, st.frozensets(st.integers(0, 6), min_size=1), clock, clock).filter(
    lambda h: h.end != time(23, 59)  # read as midnight
)
periods = st.builds(
    lambda a, b, daily: Period(*sorted((a, b)), tuple(daily)),
    moments,
    moments,
    st.lists(hours, max_size=2),
)  # fmt: skip
limits = st.none() | st.builds(
    AltitudeLimit,
    st.floats(-400, 9000).map(lambda x: round(x, 3)),
    st.sampled_from(list(Reference)),
)
names = st.text(max_size=12).filter(str.strip).map(str.strip)
places = st.builds(Geodetic, st.floats(-80, 80), st.floats(-175, 175)).map(
    lambda g: Geodetic(round(g.latitude_deg, 6), round(g.longitude_deg, 6))
)


@st.composite
def areas(draw):
    centre = draw(places)
    if draw(st.booleans()):
        shape = MapCircle(centre, round(draw(st.floats(0.5, 30_000)), 2))
    else:
        at = centre.longitude_deg, centre.latitude_deg
        radius = draw(st.floats(0.001, 1))
        holes = (ring_of(*at, radius / 3, 5),) if draw(st.booleans()) else ()
        shape = MapOutline(
            ring_of(*at, radius, draw(st.integers(3, 9)), draw(st.floats(0, 6))), holes
        )
    low, high = draw(limits), draw(limits)
    return MapArea(
        draw(names),
        shape,
        ZoneTerms(
            draw(st.none() | st.floats(0, 900)),
            Altitudes(low, high) if low or high else None,
            draw(st.none() | st.lists(periods, min_size=1, max_size=2).map(tuple).map(Validity)),
        ),
    )


def assert_same(areas, zones):
    assert len(areas) == len(zones)
    for area, zone in zip(areas, zones, strict=True):
        assert zone.terms.clearance_m == area.terms.clearance_m
        assert zone.terms.altitudes == area.terms.altitudes
        assert_same_times(area.terms.validity, zone.terms.validity)
        if isinstance(area.shape, MapCircle) and isinstance(zone.shape, MapOutline):
            ring = circle_around(area.shape.centre, area.shape.radius_m)
            border = as_polygon(zone.shape).boundary
            assert border.hausdorff_distance(as_polygon(MapOutline(ring)).boundary) < 1e-8
        elif isinstance(area.shape, MapCircle):
            assert zone.shape.centre == pytest.approx(area.shape.centre, abs=2e-9)
            assert zone.shape.radius_m == area.shape.radius_m
        else:
            border = as_polygon(zone.shape).boundary
            assert border.hausdorff_distance(as_polygon(area.shape).boundary) < 1e-8


def assert_same_times(before, after):
    """One entry of a file has hours of one kind, so a period of two kinds becomes two."""
    if before is None:
        assert after is None
        return
    split = [
        Period(period.start, period.end, (daily,) if daily else ())
        for period in before.periods
        for daily in period.daily or (None,)
    ]
    assert list(after.periods) == split


def as_polygon(outline):
    rings = [[(c.longitude_deg, c.latitude_deg) for c in ring] for ring in (outline.ring, *outline.holes)]  # fmt: skip  # noqa: E501
    return shapely.Polygon(rings[0], rings[1:])


@given(zones=st.lists(areas(), max_size=3))
def test_zones_come_back_from_geojson(zones):
    features = FeatureSet("any", zones=zones)
    check_rfc(geojson_of(features))
    assert_same(zones, from_geojson(features))


@given(zones=st.lists(areas(), max_size=3))
def test_zones_come_back_from_kml(zones):
    features = FeatureSet("any", home_altitude_amsl_m=100.0, zones=zones)
    assert_same(zones, from_kml(features))


def check_rfc(collection):
    assert collection["type"] == "FeatureCollection"
    for feature in collection["features"]:
        geometry = feature["geometry"]
        polygons = {"Polygon": [geometry["coordinates"]], "MultiPolygon": geometry["coordinates"]}
        for polygon in polygons.get(geometry["type"], []):
            for index, ring in enumerate(polygon):
                assert ring[0] == ring[-1]
                assert shapely.LinearRing(ring).is_ccw == (index == 0)  # the right-hand rule
        flat = shapely.get_coordinates(shapely.from_geojson(json.dumps(geometry)))
        assert (abs(flat) <= (180, 90)).all()


def ring_at(*pairs):
    return MapOutline(tuple(Geodetic(lat, lon) for lat, lon in pairs))


ACROSS = ring_at((-17, 179.9), (-17, -179.8), (-16.9, -179.8), (-16.9, 179.9))


@pytest.mark.parametrize(
    ("outline", "pieces", "area"),
    [
        (ACROSS, 2, 0.03),
        (ring_at(*reversed([(c[0], c[1]) for c in ACROSS.ring])), 2, 0.03),
        (ring_at((-17, -180), (-17, -179.8), (-16.9, -179.8), (-16.9, -180)), 1, 0.02),
        (ring_at((-17, 180), (-17, -179.8), (-16.9, -179.8), (-16.9, 180)), 1, 0.02),
        (ring_at((80, 0), (80, 90), (80, 180), (80, -90)), 1, 3600),
    ],
)
def test_shapes_are_cut_at_the_antimeridian(outline, pieces, area):
    collection = geojson_of(FeatureSet("any", zones=[MapArea("x", outline)]))
    check_rfc(collection)
    found = shapely.from_geojson(json.dumps(collection["features"][0]["geometry"]))
    assert found.area == pytest.approx(area)
    assert found.is_valid
    assert len(getattr(found, "geoms", [found])) == pieces


@pytest.mark.parametrize("pole_deg", [90, -90])
def test_a_zone_around_a_pole_comes_back(pole_deg, tmp_path):
    lat_deg = 0.9 * pole_deg
    ring = tuple(Geodetic(lat_deg, lon_deg) for lon_deg in (-150.0, -30.0, 80.0, 170.0))
    path = tmp_path / "cap.geojson"
    path.write_text(geojson_text(FeatureSet("any", zones=[MapArea("cap", MapOutline(ring))])))
    frame = LocalFrame(Geodetic(float(pole_deg), 0.0))
    reading = read_zones(path)
    assert reading.problems == []
    (zone,) = reading.zones
    shape, drawn = zone.placed(frame), Outline(local_ring(ring, frame))
    assert shape.polygon.area == pytest.approx(drawn.polygon.area, rel=1e-4)
    assert shape.polygon.contains(shapely.Point(0, 0))


def test_a_hole_across_the_antimeridian():
    hole = tuple(Geodetic(lat, lon) for lat, lon in [(-16.97, -179.9), (-16.93, -179.9), (-16.95, 179.97)])  # fmt: skip  # noqa: E501
    outline = MapOutline(ACROSS.ring, (hole,))
    features = FeatureSet("any", zones=[MapArea("x", outline)])
    collection = geojson_of(features)
    check_rfc(collection)
    found = shapely.from_geojson(json.dumps(collection["features"][0]["geometry"]))
    assert found.area == pytest.approx(0.03 - 0.04 * 0.13 / 2)
    assert [zone.name for zone in from_geojson(features)] == ["x, part 1", "x, part 2"]


def test_a_whole_mission_in_geojson():
    placed, _ = read_placed(TOWN)
    features = feature_set_of(placed)
    collection = geojson_of(features)
    check_rfc(collection)
    kinds = [feature["properties"]["kind"] for feature in collection["features"]]
    assert {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)} == {
        "fence": 2, "zone": 3, "home": 1, "waypoint": 3, "rally_point": 1
    }  # fmt: skip
    assert_same(features.zones, from_geojson(features))
    spots = [f for f in collection["features"] if f["properties"]["kind"] == "waypoint"]
    assert spots[1]["geometry"]["coordinates"] == [8.0015, 47.0036]
    assert spots[1]["properties"]["altitude_above_home_m"] == 55


def test_a_whole_mission_in_kml():
    placed, _ = read_placed(TOWN)
    features = feature_set_of(placed)
    root = ET.fromstring(kml_text(features))  # noqa: S314 - our own text
    marks = {mark.findtext(f"{KML}name"): mark for mark in root.iter(f"{KML}Placemark")}
    mast = marks['mast & "wires" <1>'].find(f"{KML}Polygon")
    assert (mast.findtext(f"{KML}extrude"), mast.findtext(f"{KML}altitudeMode")) == (
        "1",
        "absolute",
    )
    words = mast.find(f".//{KML}coordinates").text.split()
    assert {word.split(",")[2] for word in words} == {"530"}
    school = marks["school"].find(f"{KML}Polygon")
    assert school.find(f".//{KML}coordinates").text.split()[0].endswith(",540.5")  # 90 m above home
    yard = marks["yard"].find(f"{KML}Polygon")
    assert yard.find(f"{KML}extrude") is None
    assert yard.find(f"{KML}innerBoundaryIs") is not None
    assert marks["2"].find(f".//{KML}coordinates").text == "8.0015,47.0036,505.5"
    assert_same(features.zones, from_kml(features))


def test_elements_of_kml_stand_in_the_order_of_its_schema():
    order = [
        ["kml"], ["Document"], ["Folder"], ["name"], ["Style"], ["Placemark"],
        ["styleUrl"], ["ExtendedData"], ["Polygon", "Point"],
        ["extrude"], ["altitudeMode"], ["outerBoundaryIs"], ["innerBoundaryIs"],
        ["LinearRing"], ["coordinates"],
    ]  # fmt: skip
    rank = {name: index for index, names in enumerate(order) for name in names}
    root = ET.fromstring(kml_text(feature_set_of(read_placed(TOWN)[0])))  # noqa: S314 - our own text
    for element in root.iter():
        found = [rank.get(child.tag.removeprefix(KML), -1) for child in element]
        if element.tag.removeprefix(KML) in ("Placemark", "Polygon", "Point"):
            assert found == sorted(found)
            assert -1 not in found


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("outline", [ACROSS, MapOutline(ring_of(8, 47, 0.1, 5))])
def test_rings_in_kml_run_counterclockwise(outline, turned):
    ring = outline.ring[::-1] if turned else outline.ring
    (zone,) = from_kml(FeatureSet("any", zones=[MapArea("x", MapOutline(ring, (ring,)))]))
    for found in (zone.shape.ring, *zone.shape.holes):
        unwrapped = [(c.longitude_deg % 360, c.latitude_deg) for c in found]
        assert shapely.LinearRing(unwrapped).is_ccw


def test_what_xml_cannot_contain_is_replaced():
    features = FeatureSet("a\x00b", spots=[("home", MapPoint("\ufffe", Geodetic(1, 2)))])
    assert "<name>a?b</name>" in kml_text(features)
    assert from_kml(features) == []


@given(centre=places, radius_m=st.floats(0.5, 50_000), segments=st.integers(12, 90))
def test_drawn_circles_lie_around_the_circle(centre, radius_m, segments):
    ring = circle_around(centre, radius_m, segments)
    geod = Geod(ellps="WGS84")
    for start, end in zip(ring, ring[1:] + ring[:1], strict=True):
        middle = geod.npts(start.longitude_deg, start.latitude_deg, end.longitude_deg, end.latitude_deg, 1)[0]  # fmt: skip  # noqa: E501
        distances = [
            geod.inv(centre.longitude_deg, centre.latitude_deg, *place)[2]
            for place in (middle, (start.longitude_deg, start.latitude_deg))
        ]
        assert radius_m * (1 - 1e-5) - 1e-6 <= distances[0] <= distances[1]
        assert distances[1] <= radius_m / math.cos(math.pi / segments) + 1e-6


@pytest.mark.parametrize(("latitude_deg", "radius_m"), [(0, 9e5), (47, 2e5), (-69, 5e4), (89, 5e3)])
def test_large_circles_are_covered_by_their_polygons_in_kml(latitude_deg, radius_m):
    """Sides of 20 km that are straight in degrees were up to 8 m within the circle."""
    centre = Geodetic(latitude_deg, 8.0)
    ring = dense_ring(circle_around(centre, radius_m))
    geod = Geod(ellps="WGS84")
    away_m = [geod.inv(8.0, latitude_deg, *place[::-1])[2] for place in ring]
    assert radius_m - 0.06 < min(away_m)
    assert max(away_m) < 1.0013 * radius_m


@pytest.mark.parametrize("latitude_deg", [0.0, 47.0, -69.0, 89.8])
def test_long_sides_of_a_mission_in_metres_stay_where_they_are(latitude_deg):
    frame = LocalFrame(Geodetic(latitude_deg, 179.99))
    ring = tuple(Point(*corner) for corner in [(-9e3, 0), (9e3, 100), (9e3, 7e3), (-9e3, 7e3)])
    back = local_ring(corners_of(ring, frame), frame)
    assert shapely.Polygon(back).boundary.hausdorff_distance(shapely.Polygon(ring).boundary) < 0.1


@pytest.mark.parametrize("corner", [(1e308, 0.0), (-1e308, 1e308), (0.5, -1e308)])
def test_corners_beyond_all_numbers_are_reported_as_no_place_on_earth(corner):
    ring = (Geodetic(0.0, 0.0), Geodetic(*corner), Geodetic(-corner[0], -corner[1]))
    with pytest.raises(FrameError, match=r"is not within -(90\.\.90|180\.\.180) degrees"):
        local_ring(ring, LocalFrame(Geodetic(0.0, 0.0)))


@settings(max_examples=10)
@given(
    latitude_deg=st.floats(-75, 75),
    longitude_deg=st.floats(-180, 180),
    size_deg=st.floats(0.001, 0.2),
    corners=st.integers(3, 8),
)
def test_corners_on_long_sides_are_not_written(latitude_deg, longitude_deg, size_deg, corners):
    ring = tuple(
        Geodetic(place.latitude_deg, (place.longitude_deg + 180) % 360 - 180)
        for place in ring_of(longitude_deg, latitude_deg, size_deg, corners, 0.3)
    )
    frame = LocalFrame(Geodetic(latitude_deg, longitude_deg))
    dense = [Point(*p) for p in frame.to_local_many(*zip(*dense_ring(ring), strict=True)).tolist()]
    found = corners_of(tuple(dense), frame)
    assert len(found) == corners
    for mine, theirs in zip(found, ring, strict=True):
        assert mine.latitude_deg == pytest.approx(theirs.latitude_deg, abs=1e-8)
        turned = (mine.longitude_deg - theirs.longitude_deg + 180) % 360 - 180
        assert turned == pytest.approx(0, abs=1e-8)
