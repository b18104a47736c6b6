"""What is wrong with a file of zones is told with its place, a code, and what to do."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.errors import MissionFileError
from air_router.files.zones.zone_files import read_zones
from air_router.mission.loading import load_mission
from mocha_link.team.document import DocumentError

MISSION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"
SQUARE = "[[[8,47],[8.1,47],[8.1,47.1],[8,47]]]"
POLYGON = f'{{"type": "Polygon", "coordinates": {SQUARE}}}'


def feature(geometry=POLYGON, properties="{}"):
    return f'{{"type": "Feature", "properties": {properties}, "geometry": {geometry}}}'


def features(*entries):
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(entries) + "\n]}"


def polygon(coordinates):
    return feature(f'{{"type": "Polygon", "coordinates": {coordinates}}}')


def ed269(volume="", projection=None, **zone):
    projection = projection or f'{{"type": "Polygon", "coordinates": {SQUARE}}}'
    volume = volume or '"uomDimensions": "M"'
    extra = "".join(f'"{key}": {value}, ' for key, value in zone.items())
    return (
        '{"features": [{"identifier": "X1", "restriction": "PROHIBITED",\n'
        f"{extra}"
        f'"geometry": [{{{volume},\n"horizontalProjection": {projection}}}]}}]}}'
    )


def ed318(geometry, **properties):
    extra = "".join(f', "{key}": {value}' for key, value in properties.items())
    return features(
        feature(
            geometry, f'{{"identifier": "X1", "type": "PROHIBITED", "variant": "COMMON"{extra}}}'
        )
    )


def kml(*placemarks):
    return (
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        + "\n".join(placemarks)
        + ("\n</Document></kml>")
    )


def placemark(coordinates="8,47 8.1,47 8.1,47.1", data="", boundary="outerBoundaryIs"):
    return (
        f"<Placemark><name>hall</name>{data}<Polygon><{boundary}><LinearRing>"
        f"<coordinates>{coordinates}</coordinates></LinearRing></{boundary}></Polygon></Placemark>"
    )


def data(name, value):
    return f'<ExtendedData><Data name="{name}"><value>{value}</value></Data></ExtendedData>'


def openair(*lines):
    return "AC R\nAN hall\n" + "\n".join(lines)


def gpx(*attributes):
    points = "\n".join(f"<trkpt {each}/>" for each in attributes)
    return f"<gpx><trk>\n<name>hall</name><trkseg>{points}</trkseg></trk></gpx>"


BOMB = (
    '<!DOCTYPE kml [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">'
    '<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>\n<kml>&c;</kml>'
)
OUTSIDE = '<!DOCTYPE kml [<!ENTITY x SYSTEM "file:///etc/passwd">]><kml><name>&x;</name></kml>'

MALFORMED = [
    # GeoJSON
    ("a.geojson", "{", "", "not-json", "Expecting property name enclosed in double quotes"),
    (
        "a.geojson",
        '{"type": "Feature", "type": 1}',
        '"type": 1}',
        "repeated-key",
        "already on line 1",
    ),
    ("a.geojson", "3", "3", "unknown-format", "none of GeoJSON, KML, GPX"),
    ("a.geojson", '{"fileType": "Plan"}', '{"fileType": "', "unknown-format", "is a mission"),
    ("a.geojson", '{"type": "Topology"}', '"Topology"}', "wrong-type", 'found "Topology"'),
    (
        "a.geojson",
        '{"type": "FeatureCollection"}',
        '{"type": "Feat',
        "missing-key",
        "features must be a list",
    ),
    ("a.geojson", features("7"), "7", "missing-key", "has the type Feature"),
    (
        "a.geojson",
        features('{"type": "Polygon"}'),
        '"Polygon"}',
        "wrong-type",
        "has the type Feature",
    ),
    (
        "a.geojson",
        features(feature(properties="[1]")),
        '[1], "geometry',
        "wrong-type",
        "must be an object",
    ),
    ("a.geojson", features(feature("7")), "7}", "missing-key", "Polygon, MultiPolygon or Point"),
    (
        "a.geojson",
        features(feature('{"type": "Circle"}')),
        '"Circle"}}',
        "wrong-type",
        'found "Circle"',
    ),
    (
        "a.geojson",
        '{"type": "LineString", "coordinates": [[8,47],[8,48]]}',
        '"LineString", ',
        "no-area",
        "a LineString has no area",
    ),
    (
        "a.geojson",
        features(feature('{"type": "Point", "coordinates": [8, 47]}')),
        '{"type": "Poin',
        "no-area",
        "add the property radius_m",
    ),
    (
        "a.geojson",
        features(feature('{"type": "Point", "coordinates": [8, 47]}', '{"radius_m": -4}')),
        '-4}, "geometry',
        "out-of-range",
        "found -4",
    ),
    (
        "a.geojson",
        features(feature('{"type": "Point", "coordinates": [8, 47]}', '{"radius_m": "4"}')),
        '"4"}, "geometr',
        "wrong-type",
        'found "4"',
    ),
    ("a.geojson", polygon("7"), "7}}", "wrong-type", "coordinates must be a list, found 7"),
    ("a.geojson", polygon("[]"), "[]}}", "zone-too-few-corners", "without a ring"),
    (
        "a.geojson",
        polygon("[[[8,47],\n7]]"),
        "7]]}}",
        "wrong-type",
        "must be [longitude, latitude]",
    ),
    ("a.geojson", polygon('[[[8,47],\n["8",47]]]'), '["8",47]]]}}', "wrong-type", "two numbers"),
    (
        "a.geojson",
        polygon("[[[8,47],[8.1,47],[8,47]]]"),
        "[[8,47],[8.1,4",
        "zone-too-few-corners",
        "2 different corners",
    ),
    (
        "a.geojson",
        polygon("[[[8,47],[8.1,47],\n[-120.5,200]]]"),
        "[-120.5,200]]]",
        "not-on-earth",
        "no longitude -120.5, latitude 200; correct it",
    ),
    (
        "a.geojson",
        polygon("[[[47,-122],[47,-121],[46,-122]]]"),
        "[47,-122],[47,",
        "not-on-earth",
        "exchange them (longitude comes first)",
    ),
    (
        "a.geojson",
        polygon("[[[8,47],[8.1,47],[8.1,47.1]],\n[[8,47],[8,47]]]"),
        "[[8,47],[8,47]",
        "zone-too-few-corners",
        "1 different corners",
    ),
    (
        "a.geojson",
        features(feature(properties='{"clearance_m": "5"}')),
        '"5"}, "geometr',
        "wrong-type",
        "'clearance_m' must be a number",
    ),
    (
        "a.geojson",
        features(feature(properties='{"clearance_m": -5}')),
        '-5}, "geometry',
        "out-of-range",
        "from 0 to 1000, found -5",
    ),
    (
        "a.geojson",
        features(feature(properties='{"upper_m": 9e9}')),
        '9e9}, "geometr',
        "out-of-range",
        "upper_m",
    ),
    (
        "a.geojson",
        features(feature(properties='{"upper_m": 9, "reference": "FL"}')),
        '"FL"}, "geomet',
        "unknown-word",
        "one of home, amsl, ground",
    ),
    (
        "a.geojson",
        features(feature(properties='{"active": "always"}')),
        '"always"}, "ge',
        "wrong-type",
        "list of {from, until, days, between}",
    ),
    (
        "a.geojson",
        features(feature(properties='{"active": [{"from": "2026-11-20"}]}')),
        '[{"from": "202',
        "not-a-time",
        "has no time zone; add Z",
    ),
    (
        "a.geojson",
        features(feature(properties='{"active": [{"days": ["noday"]}]}')),
        '[{"days": ["no',
        "not-a-time",
        "'noday' is no day",
    ),
    (
        "a.geojson",
        features(feature(properties='{"active": [{"between": ["8", "9"]}]}')),
        '[{"between": [',
        "not-a-time",
        "'8' is no time of day",
    ),
    (
        "a.geojson",
        '{"crs": {"properties": {"name": "EPSG:3857"}},"type": "Feature"}',
        '{"properties":',
        "other-coordinates",
        "not in WGS-84",
    ),
    # ED-269
    ("z.json", '{"features": 7}', '{"features": 7', "unknown-format", "none of"),
    (
        "z.json",
        '{"features": [7]}',
        "7]}",
        "wrong-type",
        "what a zone says of itself must be an object",
    ),
    (
        "z.json",
        '{"features": [{"restriction": "PROHIBITED"}]}',
        '{"restriction"',
        "missing-key",
        "geometry must be a list, found nothing",
    ),
    ("z.json", ed269('"uomDimensions": "YD"'), '"YD",', "wrong-type", "one of M, FT"),
    (
        "z.json",
        ed269('"uomDimensions": "M", "upperLimit": "FL9", "upperVerticalReference": "AGL"'),
        '"FL9", "upperV',
        "wrong-type",
        "an altitude must be a number",
    ),
    (
        "z.json",
        ed269('"uomDimensions": "M", "upperLimit": 9, "upperVerticalReference": "FL"'),
        '"FL",',
        "wrong-type",
        "one of AGL, AMSL, WGS84",
    ),
    (
        "z.json",
        ed269(projection='{"type": "Square"}'),
        '"Square"}}]}]}',
        "wrong-type",
        "Circle or a Polygon",
    ),
    (
        "z.json",
        ed269(projection='{"type": "Circle", "center": [8, 47]}'),
        '{"type": "Circ',
        "missing-key",
        "the radius in metres must be a number, found nothing",
    ),
    (
        "z.json",
        ed269(projection='{"type": "Circle", "center": [47, 100], "radius": 5}'),
        '[47, 100], "ra',
        "not-on-earth",
        "exchange them",
    ),
    # ED-318
    (
        "z.json",
        ed318('{"type": "Point", "coordinates": [8, 47], "layer": {"uom": "m"}}'),
        '{"type": "Poin',
        "missing-key",
        "the radius in metres",
    ),
    (
        "z.json",
        ed318(POLYGON[:-1] + ', "layer": {"upper": 3, "uom": "yd", "upperReference": "AGL"}}'),
        '"yd"',
        "wrong-type",
        "the unit must be one of M, FT",
    ),
    (
        "z.json",
        features(
            feature(properties="null"),
            feature(properties='{"variant": "COMMON", "zoneAuthority": []}'),
        ),
        'null, "geometr',
        "missing-key",
        "what a zone says of itself must be an object",
    ),
    # KML
    ("a.kml", "", "", "not-xml", "no element found"),
    ("a.kml", "<kml><Document>\n</kml>", "kml>", "not-xml", "mismatched tag"),
    ("a.kml", "<kml>\n <name>&amp</name></kml>", "</name></kml>", "not-xml", "not well-formed"),
    (
        "a.kml",
        '<?xml version="1.0" encoding="klingon"?><kml/>',
        "<?xml version=",
        "not-utf8",
        "encoding",
    ),
    ("a.kml", "<gpx></gpx>", "<gpx></gpx>", "not-kml", "the outermost element is <gpx>"),
    ("a.kml", BOMB, '[<!ENTITY a "h', "xml-doctype", "is not read; remove it"),
    ("a.kml", OUTSIDE, "[<!ENTITY x SY", "xml-doctype", "is not read; remove it"),
    (
        "a.kml",
        kml(placemark("8,47 8.1,47")),
        "<coordinates>8",
        "zone-too-few-corners",
        "2 different corners",
    ),
    ("a.kml", kml(placemark("")), "<coordinates><", "zone-too-few-corners", "no coordinates"),
    (
        "a.kml",
        kml(placemark("8;47")),
        "<coordinates>8",
        "wrong-type",
        "'8;47' is not longitude,latitude",
    ),
    (
        "a.kml",
        kml(placemark("47,122 47,123 46,122")),
        "<coordinates>4",
        "not-on-earth",
        "exchange them",
    ),
    (
        "a.kml",
        kml(placemark(boundary="innerBoundaryIs")),
        "<Polygon><inne",
        "missing-key",
        "found 0",
    ),
    (
        "a.kml",
        kml("<Placemark><Point><coordinates>8,47</coordinates></Point></Placemark>"),
        "<Point><coordi",
        "no-area",
        "give a point the data 'radius_m'",
    ),
    (
        "a.kml",
        kml("<Placemark><LineString/></Placemark>"),
        "<LineString/><",
        "no-area",
        "draw a polygon",
    ),
    (
        "a.kml",
        kml(placemark(data=data("upper_m", "high"))),
        '<Data name="up',
        "wrong-type",
        "'upper_m' must",
    ),
    (
        "a.kml",
        kml(placemark(data=data("radius_m", "-1"))),
        "<Placemark><na",
        "out-of-range",
        "'radius_m'",
    ),
    ("a.kml", "<kml>" + "<Folder>" * 100, "<Folder><Folde", "too-deep", "nested more than 60 deep"),
    # OpenAir
    ("a.txt", "hello", "hello", "unknown-format", "no airspace begins in it"),
    ("a.air", openair("DP 47:00:00 N"), "47:00:00 N", "wrong-form", "is not a place like"),
    ("a.air", openair("DP 47:60:00 N 8:00:00 E"), "47:60", "not-on-earth", "no place '47:60"),
    ("a.air", openair("DP 91:00:00 N 8:00:00 E"), "91", "not-on-earth", "no place '91"),
    ("a.air", openair("DC 5"), "5", "wrong-form", "no centre"),
    ("a.air", openair("V X=1N 1E", "DC nan"), "nan", "wrong-form", "not a radius in nautical"),
    ("a.air", openair("V X=1N 1E", "DC 0"), "0", "out-of-range", "a radius of 0 nautical"),
    ("a.air", openair("V X=1N 1E", "DA 5,90"), "5,90", "wrong-form", "first, last direction"),
    ("a.air", openair("V X=1N 1E", "DB 1N 2E"), "1N 2E", "wrong-form", "is not 2 places"),
    ("a.air", openair("V D=left"), "D=left", "wrong-form", "none of V X="),
    ("a.air", openair("DY 1N 1E"), "1N 1E", "wrong-form", "'DY' is not read"),
    ("a.air", openair("XX y"), "y", "wrong-form", "'XX' is no OpenAir command"),
    ("a.air", openair("DP 1N 1E", "DP 1N 2E"), "AC R", "zone-too-few-corners", "2 different"),
    # GPX
    ("a.gpx", "<kml/>", "<kml/>", "unknown-format", "not <gpx>"),
    ("a.gpx", BOMB, "[<!ENTITY", "xml-doctype", "a document type"),
    ("a.gpx", gpx('lat="47"'), "<trkpt", "wrong-type", "<trkpt> needs 'lat' and 'lon'"),
    ("a.gpx", gpx('lat="nan" lon="8"'), "<trkpt", "not-on-earth", "there is no place nan"),
    ("a.gpx", gpx('lat="8" lon="1e999"'), "<trkpt", "not-on-earth", "no place 8, 1e999"),
    (
        "a.gpx",
        gpx('lat="8" lon="47"', 'lat="8" lon="48"', 'lat="9" lon="48"'),
        "<trkseg>",
        "no-area",
        "from where it begins",
    ),
]


def problems(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    try:
        return read_zones(path).problems
    except DocumentError as error:
        return error.problems


@pytest.mark.parametrize("row", MALFORMED, ids=[row[4][:30] for row in MALFORMED])
def test_a_malformed_file_gets_its_own_error(tmp_path, row):
    name, text, at_place, code, words = row
    first = problems(tmp_path, name, text)[0]
    assert (first.code, words in first.message) == (code, True), str(first)
    rest = text.split("\n")[first.line - 1][first.column - 1 :]
    assert rest.startswith(at_place), str(first)
    assert bool(rest) == bool(at_place)
    assert first.path == tmp_path / name


def test_all_problems_of_a_file_at_once(tmp_path):
    text = features(*(polygon(f"[[[8,47],[{i}00,47],[8,48]]]") for i in range(2, 7)))
    assert [problem.line for problem in problems(tmp_path, "a.geojson", text)] == [2, 3, 4, 5, 6]


def test_a_file_of_thousands_of_problems_prints_a_screen_of_them(tmp_path):
    text = features(*(polygon("[[[8,47],[8,48]]]") for _ in range(1_000)))
    found = problems(tmp_path, "a.geojson", text)
    assert len(found) == 21
    assert "980 more problems of the kind 'zone-too-few-corners'" in str(found[-1])


@pytest.mark.parametrize("number", ["1e308", "9" * 400])
def test_a_corner_far_from_the_earth_is_told_as_such(tmp_path, number):
    text = MISSION.read_text(encoding="utf-8").replace("39.9419367", number)
    text = text.replace("team: team.yaml", "")
    path = tmp_path / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MissionFileError, match=r"zone 1', corner 1: latitude .*\[not-on-earth\]"):
        load_mission(path)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(DocumentError, match=r"cannot read the file.*\[unreadable\]"):
        read_zones(tmp_path / "nowhere.geojson")
    found = problems(tmp_path, "a.geojson", b'{"type": "Fe\xe4ture"}')
    assert str(found[0]).endswith(
        "a.geojson:1:13: not UTF-8 text; save the file as UTF-8 [not-utf8]"
    )


HOSTILE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["type", "features", "geometry", "properties", "coordinates", "radius", "layer",
                 "identifier", "restriction", "applicability", "schedule", "horizontalProjection",
                 "uomDimensions", "active", "extent", "crs", "geometries", "center", "variant"]
            ),
            inner | st.sampled_from(["Feature", "FeatureCollection", "Polygon", "Point", "Circle"]),
            max_size=4,
        )
    ),
    max_leaves=20,
)  # fmt: skip


@given(content=HOSTILE)
def test_no_json_crashes_a_reader(tmp_path_factory, content):
    folder = tmp_path_factory.mktemp("hostile")
    for problem in problems(folder, "a.json", json.dumps(content)):
        assert problem.code
        assert problem.line == 1


@given(
    parts=st.lists(
        st.sampled_from(
            ["<kml>", "</kml>", "<Placemark>", "</Placemark>", "<Polygon>", "</Polygon>", "8,47 ",
             "<outerBoundaryIs>", "<LinearRing>", "<coordinates>", "</coordinates>", "&#0;", "\x00",
             "<ExtendedData>", "<Data>", "<!-- -->", "<![CDATA[x]]>", "<?xml?>", "<Folder/>", "<!"]
        )
        | st.text(max_size=3),
        max_size=12,
    )
)  # fmt: skip
def test_no_xml_crashes_a_reader(tmp_path_factory, parts):
    folder = tmp_path_factory.mktemp("hostile")
    text = "<kml>" + "".join(parts)
    for problem in problems(folder, "a.kml", text.encode("utf-8", "replace")):
        assert problem.code


def test_large_files_end_soon(tmp_path, monkeypatch):
    monkeypatch.setattr("air_router.files.xml_document.MAX_ELEMENTS", 50_000)
    wide = kml(*["<Placemark/>"] * 60_000)
    found = problems(tmp_path, "a.kml", wide)
    assert found[0].code == "too-large"
    path = tmp_path / "b.kml"
    with path.open("wb") as file:
        file.truncate(33 * 1024 * 1024)
    with pytest.raises(DocumentError, match="larger than"):
        read_zones(path)
