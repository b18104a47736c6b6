"""What is wrong with a file of zones is reported with its place, a code, and what to do."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.maps.zone_files import read_zones
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

TWICE = "</LinearRing><LinearRing><coordinates>8,47 9,47 9,48</coordinates></LinearRing>"
POINT = '{"type": "Point", "coordinates": [8, 47]}'


def zone(properties):
    return features(feature(properties=properties))


def circle(properties):
    return features(feature(POINT, properties))


def at(place, text):
    """The text with a mark before the first such place in it."""
    assert place in text
    return text.replace(place, f"§{place}", 1)


MALFORMED = {
    "a.geojson": [
        ("{§", "not-json", "the file ends too early"),
        ('{"type": "Feature", §"type": 1}', "repeated-key", "already on line 1"),
        ("§3", "unknown-format", "none of GeoJSON, KML, GPX"),
        ('§{"fileType": "Plan"}', "unknown-format", "is a mission"),
        ('{"type": §"Topology"}', "wrong-type", 'found "Topology"'),
        ('§{"type": "FeatureCollection"}', "missing-key", "features must be a list"),
        (features("§7"), "missing-key", "has the type Feature"),
        (features('{"type": §"Polygon"}'), "wrong-type", "has the type Feature"),
        (zone("§[1]"), "wrong-type", "must be an object"),
        (features(feature("§7")), "missing-key", "Polygon, MultiPolygon or Point"),
        (features(feature('{"type": §"Circle"}')), "wrong-type", 'found "Circle"'),
        (features(feature('{"type": §["Polygon"]}')), "wrong-type", 'found ["Polygon"]'),
        ('{"type": §"LineString", "coordinates": []}', "no-area", "nothing in it has an area"),
        (features(feature(f"§{POINT}")), "no-area", "the property radius_m"),
        (circle('{"radius_m": §-4}'), "out-of-range", "found -4"),
        (circle('{"radius_m": §"4"}'), "wrong-type", 'found "4"'),
        (polygon("§7"), "wrong-type", "coordinates must be a list, found 7"),
        (polygon("§[]"), "zone-too-few-corners", "without a ring"),
        (polygon("[[[8,47],\n§7]]"), "wrong-type", "must be [longitude, latitude]"),
        (polygon('[[[8,47],\n§["8",47]]]'), "wrong-type", "two numbers"),
        (polygon("[[[8,47],\n§[-120.5,200]]]"), "not-on-earth", "latitude 200; correct it"),
        (polygon("[[§[47,-122],[47,-121]]]"), "not-on-earth", "exchange them (longitude comes"),
        (zone('{"clearance_m": §"5"}'), "wrong-type", "'clearance_m' must be a number"),
        (zone('{"clearance_m": §-5}'), "out-of-range", "at least 0.0, found -5"),
        (zone('{"upper_m": §9e9}'), "out-of-range", "upper_m"),
        (
            zone('{"upper_m": 9, "reference": §"FL"}'),
            "unknown-word",
            "one of amsl, ground",
        ),
        (zone('{"active": §"always"}'), "wrong-type", "'active' must be a list"),
        (
            zone('{"active": [{"from": §"2026-11-20"}]}'),
            "not-a-time",
            "not a time with its",
        ),
        (zone('{"active": [{"days": [§"noday"]}]}'), "not-a-day", "not a day of the week"),
        (zone('{"active": [{"between": [§"8", "9"]}]}'), "not-a-time", "not a time of day"),
        (
            '{"crs": §{"type": "EPSG", "properties": {"code": 25832}}, "type": "Feature"}',
            "other-coordinates",
            "25832",
        ),
        (
            '{"crs": §{"properties": {"name": "EPSG:3857"}},"type": "Feature"}',
            "other-coordinates",
            "not in WGS-84",
        ),
    ],
    "ed269.json": [
        ('§{"features": 7}', "unknown-format", "none of"),
        ('{"features": [§7]}', "wrong-type", "the properties of a zone must be an object"),
        ('{"features": [§{"restriction": "CONDITIONAL"}]}', "missing-key", "found nothing"),
        (ed269('"uomDimensions": §"YD"'), "wrong-type", "one of M, FT"),
        (
            ed269('"uomDimensions": "M", "upperLimit": §"FL9", "upperVerticalReference": "AGL"'),
            "wrong-type",
            "an altitude must be a number",
        ),
        (
            ed269('"uomDimensions": "M", "upperLimit": 9, "upperVerticalReference": §"FL"'),
            "wrong-type",
            "one of AGL, AMSL, WGS84",
        ),
        (ed269(projection='{"type": §"Square"}'), "wrong-type", "Circle or a Polygon"),
        (
            ed269(projection='§{"type": "Circle", "center": [8, 47]}'),
            "missing-key",
            "the radius in metres must be a number, found nothing",
        ),
        (
            ed269(projection='{"type": "Circle", "center": §[47, 100], "radius": 5}'),
            "not-on-earth",
            "exchange them",
        ),
    ],
    "ed318.json": [
        (ed318(f'§{POINT[:-1]}, "layer": {{"uom": "m"}}}}'), "missing-key", "the radius in metres"),
        (
            ed318(POLYGON[:-1] + ', "layer": {"upper": 3, "uom": §"yd", "upperReference": "AGL"}}'),
            "wrong-type",
            "the unit must be one of M, FT",
        ),
        (
            features(feature(properties="§null"), feature(properties='{"variant": "COMMON"}')),
            "missing-key",
            "the properties of a zone must be an object",
        ),
    ],
    "a.kml": [
        ("§", "not-xml", "no element found"),
        ("<kml><Document>\n</§kml>", "not-xml", "mismatched tag"),
        ("<kml>\n <name>&amp§</name></kml>", "not-xml", "not well-formed"),
        ('§<?xml version="1.0" encoding="klingon"?><kml/>', "not-utf8", "encoding"),
        ("§<svg></svg>", "not-kml", "the outermost element is <svg>"),
        (at("[<!ENTITY a", BOMB), "xml-doctype", "is not read; remove it"),
        (at("[<!ENTITY x", OUTSIDE), "xml-doctype", "is not read; remove it"),
        (
            at("<coordinates>", kml(placemark("8;47"))),
            "wrong-type",
            "'8;47' is not longitude,latitude",
        ),
        (at("<coordinates>", kml(placemark("47,122"))), "not-on-earth", "exchange them"),
        (
            at("<Polygon>", kml(placemark(boundary="innerBoundaryIs"))),
            "missing-key",
            "found 0",
        ),
        (
            kml("<Placemark>§<Point><coordinates>8,47</coordinates></Point></Placemark>"),
            "no-area",
            "give a point the data 'radius_m'",
        ),
        (kml("<Placemark>§<LineString/></Placemark>"), "no-area", "draw a polygon"),
        (kml(f"§<Container>{placemark()}</Container>"), "not-kml", "<Container> is not read"),
        (
            kml(at("<placemark>", placemark().replace("Placemark", "placemark"))),
            "not-kml",
            "Folder",
        ),
        (f"<kml>§<Update><Create>{placemark()}</Create></Update></kml>", "not-kml", "<Update>"),
        (kml("<Placemark>§<Solid><Polygon/></Solid></Placemark>"), "not-kml", "<Solid> is not"),
        (
            at("<outerBoundaryIs>", kml(placemark().replace("</LinearRing>", TWICE))),
            "missing-key",
            "one ring of coordinates, found 2",
        ),
        (
            at("<Data", kml(placemark(data=data("upper_m", "high")))),
            "wrong-type",
            "'upper_m' must",
        ),
        (
            at("<Placemark>", kml(placemark(data=data("radius_m", "-1")))),
            "out-of-range",
            "'radius_m'",
        ),
        (f"<kml>{'<Folder>' * 59}§{'<Folder>' * 41}", "too-deep", "nested more than 60 deep"),
    ],
    "a.air": [
        (openair("DP §47:00:00 N"), "wrong-form", "is not a place like"),
        (openair("DP §47:61:00 N 8:00:00 E"), "not-on-earth", "no place '47:61"),
        (openair("DP §91:00:00 N 8:00:00 E"), "not-on-earth", "no place '91"),
        (openair("DC §5"), "wrong-form", "no centre"),
        (openair("V X=1N 1E", "DC §nan"), "wrong-form", "not a radius in nautical"),
        (openair("V X=1N 1E", "DC §0"), "out-of-range", "a radius of 0 nautical"),
        (openair("V X=1N 1E", "DA §5,90"), "wrong-form", "first, last direction"),
        (openair("V X=1N 1E", "DB §1N 2E"), "wrong-form", "is not 2 places"),
        (openair("V §D=left"), "wrong-form", "none of V X="),
        (openair("DY §1N 1E"), "wrong-form", "'DY' is not read"),
        (openair("§XX 1N 1E"), "wrong-form", "'XX 1N 1E' is no OpenAir command"),
        (f"DP §1N 1E\n{openair('V X=1N 1E', 'DC 5')}", "wrong-form", "before the first airspace"),
    ],
    "a.txt": [("§hello", "unknown-format", "no airspace begins in it")],
    "a.gpx": [
        (at("[<!ENTITY", BOMB), "xml-doctype", "a document type"),
        (at("<trkpt", gpx('lat="47"')), "wrong-type", "<trkpt> needs 'lat' and 'lon'"),
        (at("<trkpt", gpx('lat="nan" lon="8"')), "not-on-earth", "there is no place nan"),
        (at("<trkpt", gpx('lat="8" lon="1e999"')), "not-on-earth", "no place 8, 1e999"),
        (
            at("<trkseg>", gpx('lat="8" lon="47"', 'lat="8" lon="48"', 'lat="9" lon="48"')),
            "no-area",
            "from where it begins",
        ),
    ],
}
"""By the file's name: a text with a mark (§) where the problem is, its code, the message."""

ROWS = [(name, *row) for name, rows in MALFORMED.items() for row in rows]


def problems(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    try:
        return read_zones(path).problems
    except DocumentError as error:
        return error.problems


@pytest.mark.parametrize(("name", "marked", "code", "message"), ROWS)
def test_a_malformed_file_gets_its_own_error(tmp_path, name, marked, code, message):
    before, mark, after = marked.partition("§")
    assert mark
    first = problems(tmp_path, name, before + after)[0]
    assert (first.code, message in first.message) == (code, True), str(first)
    place = (before.count("\n") + 1, len(before.rpartition("\n")[2]) + 1)
    assert (first.line, first.column) == place, str(first)
    assert first.path == tmp_path / name


def test_all_problems_of_a_file_at_once(tmp_path):
    text = features(*(polygon(f"[[[8,47],[{i}00,47],[8,48]]]") for i in range(2, 7)))
    assert [problem.line for problem in problems(tmp_path, "a.geojson", text)] == [2, 3, 4, 5, 6]


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
