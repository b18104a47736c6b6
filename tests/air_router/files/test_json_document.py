"""JSON with places: what the standard library reads, and where each value and each fault stands."""

import json
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.json_document import (
    MAX_BYTES,
    MAX_DEPTH,
    json_from_text,
    json_text,
    load_json,
)
from mocha_link.team.document import DocumentError
from tests.air_router.files.values import values_in

PATH = Path("town.plan")
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text('ab\t"é', max_size=3), inner)
    ),
    max_leaves=12,
)


@given(data=VALUES, indent=st.sampled_from([None, 0, 3, "\t"]), ascii_only=st.booleans())
def test_every_value_is_found_where_it_stands(data, indent, ascii_only):
    text = json.dumps(data, indent=indent, ensure_ascii=ascii_only)
    document = json_from_text(text, PATH)
    assert document.data == data
    lines = text.split("\n")
    for keys, value in values_in(data):
        line, column = document.place(*keys)
        found, _ = json.JSONDecoder().raw_decode("\n".join(lines[line - 1 :]), column - 1)
        assert found == value
        if keys and isinstance(keys[-1], str):
            line, column = document.place_of_key(*keys)
            rest = "\n".join(lines[line - 1 :])
            assert json.JSONDecoder().raw_decode(rest, column - 1)[0] == keys[-1]


@given(data=VALUES)
def test_what_is_written_is_read_again(data):
    assert json_from_text(json_text(data), PATH).data == data
    if isinstance(data, dict):
        assert list(json_from_text(json_text(data), PATH).data) == list(data)


@given(text=st.text('[]{}",:\\ue0123456789.-+tnf \n', max_size=40) | st.text(max_size=20))
def test_what_the_standard_library_refuses_is_refused(text):
    try:
        theirs = json.loads(text, parse_constant=lambda _: 1 / 0)
    except (ValueError, ZeroDivisionError, RecursionError):
        with pytest.raises(DocumentError) as caught:
            json_from_text(text, PATH)
        (problem,) = caught.value.problems
        assert problem.code
        assert 1 <= problem.line <= text.count("\n") + 1
        assert problem.column >= 1
        return
    try:
        ours = json_from_text(text, PATH).data
    except DocumentError as error:  # stricter: repeated keys, numbers that no map has
        found = error.problems[0].code
    else:
        found = "" if ours == theirs else "differs"
    assert found in ("", "repeated-key", "out-of-range", "not-json")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "1:1: the file is empty; save the file again"),
        ('{"a" 1}', "1:6: a colon is missing behind the key"),
        ("{a: 1}", "1:2: the key 'a' has to be in double quotes"),
        ("[1\n 2]", "2:2: a comma is missing before this"),
        ("[1] 2", "1:5: the file goes on behind its last bracket"),
        ('{"a": 1,\n "b": {"a": 1},\n "a": 3}', "3:2: key 'a' is already on line 1; remove one"),
        ("[NaN]", "1:2: not valid JSON: NaN is no number"),
        ("[-Infinity]", "1:2: not valid JSON: -Infinity is no number"),
        ("[1e999]", "1:2: the number 1e999... is none that a map can have"),
        (f"[{'9' * 5000}]", "1:2: the number 99999999999999999999... is none"),
        ('["\\ud800"]', "1:2: half a character (a lone surrogate) in text; remove it"),
        ('["a\\x"]', "1:4: a backslash begins an escape in JSON"),
        ("[" * 100_000, "1:61: nested more than 60 deep"),
        ('{"a":' * 5000, "1:301: nested more than 60 deep"),
    ],
)
def test_faults_have_a_place_and_a_code(text, expected):
    with pytest.raises(DocumentError) as caught:
        json_from_text(text, PATH)
    assert str(caught.value).startswith(f"{PATH}:{expected}")
    assert str(caught.value).endswith("]")


def test_brackets_in_text_are_no_depth():
    text = json.dumps(["[" * 500])
    assert json_from_text(text, PATH).data == ["[" * 500]
    assert json_from_text("[" * MAX_DEPTH + "]" * MAX_DEPTH, PATH).data


def test_absent_values_point_to_their_parent():
    document = json_from_text('{"a": {\n  "b": [1, 2]}}', PATH)
    assert document.place("a", "c") == (1, 7)
    assert document.place("a", "b", 7) == (2, 8)
    assert document.place("a", "b", 1, "x") == (2, 12)
    assert document.place_of_key("a", "b") == (2, 3)


def test_a_large_file_is_read_in_a_moment(tmp_path):
    path = tmp_path / "large.json"
    rows = [[i / 7, i / 11] for i in range(26_000)]
    path.write_text(json.dumps({"rows": rows}))
    started = time.process_time()
    document = load_json(path)
    assert document.place("rows", 25_999, 1)[0] == 1
    assert time.process_time() - started < 1.5  # a YAML parser takes a quarter of a minute
    path.write_bytes(b" " * (MAX_BYTES + 1))
    with pytest.raises(DocumentError, match=r"larger than 4194304 bytes.*\[too-large\]"):
        load_json(path)


def test_a_byte_order_mark_and_tabs_are_no_trouble(tmp_path):
    path = tmp_path / "marked.json"
    path.write_bytes(b'\xef\xbb\xbf{\t"a"\t:\t1}')
    assert load_json(path).data == {"a": 1}
    path.write_bytes(b'{"a": 1,\n "b\xe4": 2}')
    with pytest.raises(DocumentError, match=r":2:4: not UTF-8 text"):
        load_json(path)
