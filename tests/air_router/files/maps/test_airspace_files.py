"""OpenAir, KMZ, GPX, and altitude limits as openAIP and the FAA write them."""

import io
import itertools
import math
import time
import zipfile
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.maps.limits import limit_in_text
from air_router.files.maps.map_area import MapCircle
from air_router.files.maps.openair import OPENAIR
from air_router.files.maps.zone_files import read_zones
from air_router.files.maps.zone_reading import ZoneReading
from air_router.files.xml_document import kml_in, kmz_of
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference
from geo.frame import ARC_ERROR_M, Geodetic, arc_around, polar
from mocha_link.team.document import DocumentError

FILES = Path(__file__).parents[3] / "data" / "files"
PATH = Path("airspace.txt")
GROUND, AMSL = Reference.GROUND, Reference.AMSL
UNCLEAR = "unclear-altitude"


def openair(raw):
    return ZoneReading(OPENAIR.read(raw, PATH), PATH)


def codes(problems):
    return [problem.code for problem in problems]


def test_openair():
    reading = read_zones(FILES / "airspace.txt")
    assert reading.problems == []
    sandbox, toy, mast, moon = reading.zones
    assert [zone.name for zone in reading.zones] == ["Sandbox", "CTR Toy", "Mast", "Half moon"]
    assert sandbox.terms.altitudes == Altitudes(None, AltitudeLimit(pytest.approx(457.2), GROUND))
    assert sandbox.shape.ring == (
        pytest.approx((47.001, 8.001)),
        pytest.approx((47.003, 8.001)),
        pytest.approx((47.003, 8.003)),
    )
    assert mast.shape == MapCircle(
        Geodetic(pytest.approx(-46.98333333), pytest.approx(-8.1666667)), 926
    )
    assert mast.terms.altitudes.lower == AltitudeLimit(pytest.approx(304.8), GROUND)
    assert mast.terms.altitudes.upper == AltitudeLimit(pytest.approx(1066.8), AMSL)
    assert toy.terms.altitudes is None  # its ceiling is a flight level: without end
    assert [(note.line, note.column, note.code) for note in reading.notes] == [(15, 4, UNCLEAR)]
    # Counterclockwise from east to north; clockwise from south to north, by west.
    assert max(place.longitude_deg for place in toy.shape.ring) > 8.02
    assert min(place.longitude_deg for place in toy.shape.ring) == pytest.approx(8, abs=1e-6)
    assert min(place.longitude_deg for place in moon.shape.ring) < 7.98
    assert max(place.longitude_deg for place in moon.shape.ring) == pytest.approx(8, abs=1e-6)
    assert (moon.problem("", "").line, moon.problem("", "").column) == (28, 1)


SQUARE = "DP 47N 8E\nDP 47N 9E\nDP 48N 9E\n"


@pytest.mark.parametrize(
    ("limits", "upper_m", "codes"),
    [
        ("AH 300ft AGL\nAH 100ft AGL", None, [UNCLEAR]),
        ("AH 100ft AGL\nAH 100ft AGL", pytest.approx(30.48), []),
    ],
)
def test_an_airspace_with_two_ceilings_has_none(tmp_path, limits, upper_m, codes):
    (tmp_path / "a.air").write_text(f"AC R\nAN hall\nAL GND\n{limits}\n{SQUARE}")
    reading = read_zones(tmp_path / "a.air")
    (zone,) = reading.zones
    given = zone.terms.altitudes
    assert (given and given.upper.metres) == upper_m
    assert ([note.code for note in reading.notes], reading.problems) == (codes, [])


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_line_breaks_of_any_system_end_a_line(tmp_path, newline):
    text = f"* by hand\nTO cliff\nDP 47N 8E\nAC R\nAL GND\nAH UNL\n{SQUARE}"
    (tmp_path / "a.air").write_bytes(text.replace("\n", newline).encode())
    reading = read_zones(tmp_path / "a.air")
    assert (len(reading.zones), reading.problems) == (1, [])
    assert [note.line for note in reading.notes] == [2]


def test_openair_in_latin_1_is_read_and_that_is_noted():
    text = (FILES / "airspace.txt").read_text("utf-8").replace("Sandbox", "K\xf6ln \x85")
    reading = openair(text.encode("latin-1"))
    assert [zone.name for zone in reading.zones][:2] == ["K\xf6ln", "CTR Toy"]
    place = (reading.notes[0].line, reading.notes[0].column)
    assert (*place, reading.notes[0].code) == (4, 5, "not-utf8")
    assert (codes(reading.problems), codes(reading.notes[1:])) == ([], [UNCLEAR])


def test_airspaces_that_the_operator_may_fly_in():
    reading = read_zones(FILES / "airspace.txt", allow=["e", "Sandbox", "TMA"])
    assert [zone.name for zone in reading.zones] == ["CTR Toy", "Mast"]
    assert codes(reading.notes) == [UNCLEAR, "zone-allowed", "allow-unused"]


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("SFC", None, "ends at the ground"),
        ("0", None, "ends at the ground"),
        ("0 ft AGL", None, "ends at the ground"),
        ("1000ft AGL", (304.8, GROUND), (304.8, GROUND)),
        ("300 m ASFC", (300, GROUND), (300, GROUND)),
        ("3500", (1066.8, AMSL), (1066.8, AMSL)),
        ("3500 MSL", (1066.8, AMSL), (1066.8, AMSL)),
        ("1500m", (1500, AMSL), (1500, AMSL)),
        ("1500MMSL", (1500, AMSL), (1500, AMSL)),
        ("FL 65", (1183.08, AMSL), "flight level"),
        ("fl195", (4749.24, AMSL), "flight level"),
        ("5000FT STD", (771.6, AMSL), "flight level"),
        ("FL10", None, "flight level"),  # may lie below the sea on a day of low pressure
        ("UNL", None, None),
        ("Ask on 122.8", "no altitude", "no altitude"),
        ("1000 furlongs", "no altitude", "no altitude"),
        ("999999999", None, None),
        ("-200", None, (-60.96, AMSL)),
    ],
)
def test_altitudes_as_texts(text, lower, upper):
    for wanted, is_upper in ((lower, False), (upper, True)):
        if isinstance(wanted, str):
            with pytest.raises(ValueError, match=wanted):
                limit_in_text(text, upper=is_upper)
            continue
        found = limit_in_text(text, upper=is_upper)
        assert found == (wanted and AltitudeLimit(pytest.approx(wanted[0]), wanted[1]))


def test_limits_of_openaip_and_the_faa():
    reading = read_zones(FILES / "airspace.geojson")
    assert reading.problems == []
    numbers, texts, faa, facility_map, other = reading.zones
    assert numbers.terms.altitudes == Altitudes(
        AltitudeLimit(300, GROUND), AltitudeLimit(pytest.approx(1066.8), AMSL)
    )
    assert faa.name == "FAA class airspace"
    assert faa.terms.altitudes == Altitudes(
        AltitudeLimit(pytest.approx(365.76), GROUND), AltitudeLimit(pytest.approx(1219.2), AMSL)
    )
    assert [zone.terms.altitudes for zone in (texts, facility_map, other)] == [None] * 3
    names = [note.message.partition(" ")[0] for note in reading.notes if note.code == UNCLEAR]
    assert names == ["'upperCeiling':", "'CEILING'", "'max_alt_ft'"]


@pytest.mark.parametrize(
    ("properties", "altitudes", "names"),
    [
        ('"UPPER_VAL": "-9998", "UPPER_UOM": null, "LOWER_VAL": -9998', None, []),
        ('"UPPER_DESC": "UNLTD", "UPPER_VAL": 99999, "UPPER_CODE": "MSL"', None, []),
        ('"UPPER_VAL": 400, "UPPER_UOM": "FT"', None, ["UPPER_VAL"]),
        ('"upperLimit": {"value": "high", "unit": 1}', None, ["upperLimit"]),
        ('"upperLimit": {"value": 1e400}', None, None),
        ('"upperLimit": "2000ft AGL"', Altitudes(None, AltitudeLimit(609.6, GROUND)), []),
        ('"upperLimit": 120, "lowerLimit": "100 AGL"', None, ["upperLimit", "lowerLimit"]),
        ('"upperLimit": "400 ft", "lowerLimit": "0"', None, ["upperLimit"]),
        ('"upper_m": 50, "upperLimit": "SFC"', Altitudes(None, AltitudeLimit(50)), ["upperLimit"]),
    ],
)
def test_limits_that_are_none_or_unclear(tmp_path, properties, altitudes, names):
    path = tmp_path / "a.geojson"
    point = '"geometry": {"type": "Point", "coordinates": [8, 47]}'
    path.write_text(
        f'{{"type": "Feature", "properties": {{"radius_m": 5, {properties}}}, {point}}}'
    )
    if names is None:
        with pytest.raises(DocumentError, match="out-of-range"):
            read_zones(path)
        return
    reading = read_zones(path)
    assert [zone.terms.altitudes for zone in reading.zones] == [altitudes]
    assert [note.message.split("'")[1] for note in reading.notes] == names


def test_a_kmz_is_the_kml_in_it(tmp_path):
    kml = (FILES / "zones.kml").read_text(encoding="utf-8")
    path = tmp_path / "zones.kmz"
    path.write_bytes(kmz_of(kml))
    mine, theirs = read_zones(path), read_zones(FILES / "zones.kml")
    assert [(zone.name, zone.shape) for zone in mine.zones] == [
        (zone.name, zone.shape) for zone in theirs.zones
    ]


def test_other_kml_files_in_a_kmz_are_noted(tmp_path):
    kml = (FILES / "zones.kml").read_text(encoding="utf-8")
    path = tmp_path / "zones.kmz"
    path.write_bytes(zipped(more_kml="<kml/>", doc_kml=kml, readme_txt="x"))
    reading = read_zones(path)
    assert len(reading.zones) == len(read_zones(FILES / "zones.kml").zones)
    assert any("left out: more.kml" in note.message for note in reading.notes)


def zipped(method=zipfile.ZIP_DEFLATED, **files):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name, text in files.items():
            archive.writestr(name.replace("_", "."), text)
    return packed.getvalue()


@pytest.mark.parametrize(
    ("raw", "code", "message"),
    [
        (lambda: b"PK", "unknown-format", "no whole zip"),
        (lambda: zipped(readme_txt="x"), "unknown-format", "no KML"),
        (lambda: zipped(doc_kml="<kml>" + " " * 33 * 1024 * 1024), "too-large", "unpacks to more"),
        (
            lambda: zipped(doc_kml="<kml>").replace(b"\x08\x00", b"\x63\x00"),
            "unknown-format",
            "unzip it",
        ),
        (lambda: zipped(doc_kml="<kml>" * 9)[:-30], "unknown-format", "no whole zip"),
        (lambda: zipped(a_kml="<kml><kml>", doc_kml="<kml>\n <"), "not-xml", "unclosed token"),
    ],
    ids=["begin", "no KML", "bomb", "method", "cut", "XML"],
)
def test_a_malformed_kmz(tmp_path, raw, code, message):
    path = tmp_path / "a.kmz"
    path.write_bytes(raw())
    with pytest.raises(DocumentError) as caught:
        read_zones(path)
    (problem,) = caught.value.problems
    assert (problem.code, message in problem.message) == (code, True), str(problem)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_a_damaged_kmz_is_reported_wherever_the_damage_is(method):
    whole = zipped(method, döc_kml="<kml>" * 9)
    for index, byte in itertools.product(range(len(whole)), (0, 1, 0x80, 0xFF)):
        damaged = bytearray(whole)
        damaged[index] = byte
        with suppress(DocumentError):
            kml_in(bytes(damaged), Path("a.kmz"), 1000)


def test_blank_lines_without_end_are_no_airspace(tmp_path):
    path = tmp_path / "blank.txt"
    path.write_text("\n" * 1_000_000)
    started = time.process_time()
    assert codes(read_zones(path).problems) == ["unknown-format"]
    assert time.process_time() - started < 1


def test_a_track_around_an_area_is_a_zone():
    reading = read_zones(FILES / "walk.gpx")
    (barn,) = reading.zones
    assert (barn.name, len(barn.shape.ring)) == ("around the barn", 5)
    assert codes(reading.notes) == ["not-a-zone"]


def test_a_circle_lies_within_its_arc():
    for radius_m in (1.0, 300.0, 20_000.0):
        ring = arc_around(Geodetic(47, 8), (30, radius_m), (30, radius_m), clockwise=True)
        step_deg = 360 / (len(ring) - 1)
        assert radius_m * (1 - math.cos(math.radians(step_deg / 2))) <= ARC_ERROR_M
        for place in ring:
            assert polar(Geodetic(47, 8), place)[1] == pytest.approx(radius_m, abs=1e-6)


@given(
    st.integers(-89, 89).map(float),
    st.tuples(st.floats(0, 359, width=32), st.floats(0, 359, width=32)),
    st.floats(10, 50_000),
    st.booleans(),
)
def test_an_arc_turns_the_requested_way(latitude_deg, ends, radius_m, clockwise):
    centre, (start, end) = Geodetic(latitude_deg, 8.0), ends
    ring = arc_around(centre, (start, radius_m), (end, radius_m), clockwise=clockwise)
    azimuths = [polar(centre, place)[0] for place in ring]
    turned = sum((b - a + 180) % 360 - 180 for a, b in pairwise(azimuths))
    wanted = (end - start) % 360 if clockwise else -((start - end) % 360)
    assert turned == pytest.approx(wanted or (360 if clockwise else -360), abs=1e-3)


LINES = st.lists(
    st.sampled_from(
        ["AC R", "AC", "AN x", "AL SFC", "AH FL65", "AH 9e9 MSL", "V X=47:00:00 N 008:00:00 E",
         "V D=-", "V D=2", "V Q", "DP 47:00:00 N 008:00:00 E", "DP 48:00.5N 8:0W",
         "DP 47.5 S 9.5 E", "DP 99:99:99 N 1 E", "DA 5,0,90", "DA nan,inf,1",
         "DB 47:1:0 N 8:0:0 E,47:2:0 N 8:0:0 E", "DC 5", "DC -1", "DC 1e5", "DC 999999",
         "DY 1 N 1 E", "TO sea", "AA 2026", "SP 1", "?", "*", "\x00"]
    )
    | st.text(max_size=8),
    max_size=14,
)  # fmt: skip


@given(LINES)
def test_no_openair_crashes_its_reader(lines):
    text = "AC Q\n" + "\n".join(lines)
    reading = openair(text.encode())
    for problem in (*reading.problems, *reading.notes):
        assert problem.code
        assert 1 <= problem.line <= len(text.splitlines()) + 1
    for zone in reading.zones:
        areas, note = zone.sound()
        assert areas
        assert note is None or note.code == "zone-repaired"
        for area in areas:
            assert isinstance(area.shape, MapCircle) or len(area.shape.ring) >= 3


def test_long_lines_end_soon():
    blanks = " " * 300_000
    lines = ["AC R", f"AN a{blanks}b", f"AL 1{blanks}!", f"DP 1N{blanks}x", f"DP 1{blanks}N 2E"]
    reading = openair("\n".join(lines).encode())
    assert codes(reading.problems) == ["wrong-form"]
