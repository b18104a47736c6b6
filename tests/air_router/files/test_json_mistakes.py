"""A text that is no JSON is explained in plain text, at its place."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.json_document import json_from_text
from air_router.files.maps.json_zones import JSON
from air_router.files.maps.zone_reading import ZoneReading
from mocha_link.team.document import DocumentError

PATH = Path("zones.geojson")
GOOD = """\
{"type": "FeatureCollection",
 "features": [{"type": "Feature",
  "properties": {"name": "x", "high": true},
  "geometry": {"type": "Polygon", "coordinates": [[[8.5,47.3],[8.6,47.3],[8.6,47.4]]]}}]
}
"""
FEATURE = '{"type": "Feature"}'


def fault(text):
    with pytest.raises(DocumentError) as caught:
        json_from_text(text, PATH)
    (problem,) = caught.value.problems
    return problem


NO_JSON = [  # what is changed into what, at the mark (§) is the place, the message
    ("47.4]]]}}]", "47.4]]]}}§,]", "a comma before ']'; remove it"),
    ("true}", "true§, }", "a comma before '}'; remove it"),
    ("47.4]]]", "47.4§,\n ]]]", "a comma before ']'; remove it"),
    (' "features"', ' §// mine\n "features"', "JSON has no comments; remove it"),
    ('"x"', '§/* one */ "x"', "JSON has no comments; remove it"),
    ('{"type": "FeatureC', '§# mine\n{"type": "FeatureC', "JSON has no comments; remove it"),
    ("]\n}\n", "]\n}\n§// end\n", "JSON has no comments; remove it"),
    ('"x"', "§'x'", "text stands in double quotes in JSON"),
    ('"x"', "§“x”", "a quote of a word processor"),
    ('"name"', "§name", "the key 'name' has to be in double quotes"),
    ("true", "§True", "'True' is not valid in JSON; write true"),
    ("true", "§None", "'None' is not valid in JSON; write null"),
    ('ction",\n', 'ction"\n', ""),
    ('"name": "x",', '"name": "x"', ""),
    ("],[8.6,47.4", "] §[8.6,47.4", "a comma is missing before this; add it"),
    ('"name": "x"', '"name" §"x"', "a colon is missing behind the key; add it"),
    ("]]]}}]", "]]§}}]", "'}' closes another bracket than the one that is open"),
    ('"x"', '"x§\n', "close the quote"),
    ('"x"', '"C:§\\x"', "a backslash begins an escape in JSON"),
    ("]\n}\n", "]\n}\n§}\n", "goes on behind its last bracket; remove the rest"),
    ('{"type": "FeatureC', '§var zones = {"type": "FeatureC', "text before the first bracket"),
    ("[8.5", "[§08.5", "a number begins with 0; remove it, or write a point"),
    ("[8.5", "[§+8.5", "does not begin with '+'"),
    ("[8.5", "[§.5", "does not begin with '.'"),
    ("[8.5", "[8§°30'E", "write decimal degrees"),
    ("[8.5,47", "[8.5§;47", "JSON separates entries with commas"),
    ('{"name"', '{§\u00a0"name"', "a character that is not seen"),
    ("[8.5", "[§,8.5", "a value is missing here"),
    ('{"name"', '{§,"name"', "a key in double quotes is missing here"),
    ("[8.5", "[§NaN", "NaN is no number; correct it"),
]


@pytest.mark.parametrize(("before", "after", "message"), [row for row in NO_JSON if row[2]])
def test_what_is_no_json_is_explained_at_its_place(before, after, message):
    begin, _, end = GOOD.replace(before, after, 1).partition("§")
    problem = fault(begin + end)
    place = (begin.count("\n") + 1, len(begin.rpartition("\n")[2]) + 1)
    assert (problem.line, problem.column) == place
    assert message in problem.message


WHOLE = [
    ("", "1:1: the file is empty"),
    (" \n", "1:1: the file is empty"),
    (GOOD[:109], "the file ends too early, as if cut off; copy the whole file again"),
    (GOOD[:20], "1:10: a quote opens here and is not closed"),
    (f"{FEATURE}\n{FEATURE}\n", "2:1: a second object begins here; put both into one Feature"),
    ("<!DOCTYPE html>", "1:1: this is a web page, no JSON; download the file again"),
]


@pytest.mark.parametrize(("text", "message"), WHOLE)
def test_a_file_that_is_none_is_explained(text, message):
    problem = fault(text)
    assert message in f"{problem.line}:{problem.column}: {problem.message}"


def test_decimal_commas_are_no_other_place():
    places = "[[[8,5,47,3],[8,6,47,3],[8,6,47,4]]]"
    text = GOOD.replace("[[[8.5,47.3],[8.6,47.3],[8.6,47.4]]]", places)
    reading = ZoneReading(JSON.read(text.encode(), PATH), PATH)
    assert not reading.zones
    first = str(reading.problems[0])
    assert "four whole numbers; decimals stand behind a point: [8.5, 47.3]" in first


@pytest.mark.parametrize("behind", [[412.5, 0], [0, 0], [-3, 7.5]])
def test_a_place_with_a_height_and_a_measure_is_a_place(behind):
    text = GOOD.replace("[8.5,47.3]", json.dumps([8, 47, *behind]))
    reading = ZoneReading(JSON.read(text.encode(), PATH), PATH)
    assert (len(reading.zones), reading.problems) == (1, [])


PIECES = st.sampled_from([*"\t\n:-[]{}\"'#,/*\\=;.0Nt°“"])


@given(st.lists(st.tuples(st.integers(0, len(GOOD)), PIECES), min_size=1, max_size=3))
def test_whatever_is_typed_somewhere_the_library_is_never_quoted(typed):
    text = GOOD
    for at, piece in typed:
        text = text[:at] + piece + text[at:]
    try:
        json_from_text(text, PATH)
    except DocumentError as error:
        for problem in error.problems:
            assert "Expecting" not in problem.message
            assert "Invalid" not in problem.message
            assert 1 <= problem.line <= len(text.split("\n"))
            assert 1 <= problem.column <= len(text.split("\n")[problem.line - 1]) + 1
