"""Texts are edited at their values: what was asked for changes, and nothing else."""

import copy
import json
import re
from itertools import count
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from air_router.files.json_document import json_from_text
from air_router.files.text.nodes import SourceError
from air_router.files.text.rendering import Digits, like, word
from air_router.files.text.source import Splice, TextSource, spliced
from mocha_link.team.document import Document

PATH = Path("mission.yaml")
NEW = (Digits("1.2345678"), Digits("-2.5000000"))
NEW_ITEM = [1.2345678, -2.5]


class Writer:
    """Writes plain values as YAML, each time in another of the ways that people write it."""

    def __init__(self, draw):
        self.choose = lambda *ways: draw(st.sampled_from(ways))
        self.numbers = count(1)

    def text(self, data):
        lines = [*self.remarks(""), *self.block(data, ""), *self.remarks("")]
        newline = self.choose("\n", "\n", "\r\n")
        return newline.join(lines) + self.choose(newline, newline, "")

    def remark(self):
        return self.choose("", "", f"  # remark {next(self.numbers)} °é😀")

    def remarks(self, indent):
        return self.choose([], [], [""], [f"{indent}# remark {next(self.numbers)} ü"])

    def block(self, value, indent):
        if isinstance(value, dict):
            return [line for item in value.items() for line in self.entry(*item, indent)]
        return [line for item in value for line in self.item(item, indent)]

    def entry(self, key, value, indent):
        yield from self.remarks(indent)
        if not isinstance(value, list | dict) or not value or self.choose(True, False, False):
            first, *more = self.flow(value, indent)
            yield f"{indent}{key}: {first}"
            yield from more
        else:
            yield f"{indent}{key}:{self.remark()}"
            deeper = self.choose("  ", "    ", "" if isinstance(value, list) else "  ")
            yield from self.block(value, indent + deeper)

    def item(self, value, indent):
        yield from self.remarks(indent)
        if not isinstance(value, list | dict) or not value or self.choose(True, True, False):
            first, *more = self.flow(value, indent)
            yield f"{indent}- {first}"
            yield from more
            return
        deeper = indent + "  "
        lines = self.block(value, deeper)
        if lines[0].strip() and not lines[0].lstrip().startswith("#"):
            lines[0] = f"{indent}- {lines[0].removeprefix(deeper)}"
        else:
            lines.insert(0, f"{indent}-")
        yield from lines

    def flow(self, value, indent):
        """Lines; the first one has no indent."""
        if isinstance(value, list) and len(value) > 1 and self.choose(True, False, False):
            deeper = indent + "    "
            yield "["
            for index, item in enumerate(value):
                comma = "," if index + 1 < len(value) else self.choose("", ",")
                yield f"{deeper}{self.line(item)}{comma}{self.remark()}"
            yield f"{indent}  ]{self.remark()}"
        else:
            yield self.line(value) + self.remark()

    def line(self, value):
        comma = self.choose(", ", ",  ", " , ")
        if isinstance(value, list):
            return "[" + comma.join(map(self.line, value)) + "]"
        if isinstance(value, dict):
            inside = (f"{key}: {self.line(item)}" for key, item in value.items())
            return "{" + comma.join(inside) + "}"
        return "null" if value is None else str(value)


numbers = st.decimals(-89, 89, places=7).map(float)
pairs = st.tuples(numbers, numbers).map(list)
spots = pairs | st.fixed_dictionaries({"position": pairs, "altitude_m": st.integers(1, 99)})
rings = st.lists(pairs, min_size=3, max_size=5)
zones = rings | st.fixed_dictionaries({"name": st.just("hall"), "polygon": rings})
missions = st.fixed_dictionaries(
    {
        "home": pairs,
        "waypoints": st.lists(spots, min_size=1, max_size=4),
        "fence": rings | st.none(),
        "no_fly_zones": st.lists(zones, max_size=3),
        "altitude_m": st.integers(1, 100),
    }
)


@st.composite
def texts(draw):
    data = draw(missions)
    return data, Writer(draw).text(data)


@st.composite
def plans(draw):
    data = draw(missions)
    indent = draw(st.sampled_from([None, 2, 4, "\t"]))
    return data, json.dumps(data, indent=indent)


def loaded(text):
    return Document.from_text(text, PATH)


def source_of(text):
    return TextSource.of_yaml(text, PATH)


def remarks_of(text):
    return re.findall(r"# remark \d+", text)


def lists_in(data, keys=()):
    """The key paths of all lists that hold lists or mappings."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from lists_in(value, (*keys, key))
    elif isinstance(data, list) and not (data and isinstance(data[0], float)):
        yield keys
        for index, value in enumerate(data):
            yield from lists_in(value, (*keys, index))


def numbers_in(data, keys=()):
    if isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from numbers_in(value, (*keys, key))
    elif isinstance(data, float | int):
        yield keys


def at(data, keys):
    for key in keys:
        data = data[key]
    return data


@given(written=texts(), pick=st.randoms(use_true_random=False))
def test_a_number_is_replaced_and_all_else_is_as_it_was(written, pick):
    data, text = written
    keys = pick.choice(list(numbers_in(data)))
    (splice,) = source_of(text).number(keys, 5.25, 7) or [None]
    after = spliced(text, [splice])
    assert loaded(text).data == data
    expected = copy.deepcopy(data)
    at(expected, keys[:-1])[keys[-1]] = 5.25
    assert loaded(after).data == expected
    assert float(splice.text) == 5.25
    assert text.startswith(after[: splice.start])
    assert text.endswith(after[splice.start + len(splice.text) :])


@given(written=texts(), pick=st.randoms(use_true_random=False))
def test_an_item_is_inserted_and_every_remark_stays_in_order(written, pick):
    data, text = written
    keys = pick.choice(list(lists_in(data)))
    index = pick.randint(0, len(at(data, keys)))
    after = spliced(text, source_of(text).insert(keys, index, list(NEW)))
    expected = copy.deepcopy(data)
    at(expected, keys).insert(index, NEW_ITEM)
    assert loaded(after).data == expected
    assert remarks_of(after) == remarks_of(text)
    assert after.count("\r") == (after.count("\n") if "\r" in text else 0)


@given(written=texts(), pick=st.randoms(use_true_random=False))
def test_an_item_is_removed_and_remarks_outside_of_it_stay(written, pick):
    data, text = written
    keys = pick.choice([keys for keys in lists_in(data) if at(data, keys)])
    index = pick.randrange(len(at(data, keys)))
    source = source_of(text)
    splices = source.remove((*keys, index))
    after = spliced(text, splices)
    expected = copy.deepcopy(data)
    del at(expected, keys)[index]
    assert loaded(after).data == expected
    gone = "".join(text[splice.start : splice.end] for splice in splices)
    start, end = source.nodes.span(source.nodes.get((*keys, index)))
    assert remarks_of(after) == [r for r in remarks_of(text) if r not in remarks_of(gone)]
    most = len(text[start:end].split()) + 10  # and a dash, a comma, a remark before and behind
    assert len(gone.split()) <= most


@given(written=texts(), pick=st.randoms(use_true_random=False))
def test_inserting_and_removing_again_changes_no_value(written, pick):
    data, text = written
    keys = pick.choice(list(lists_in(data)))
    index = pick.randint(0, len(at(data, keys)))
    more = spliced(text, source_of(text).insert(keys, index, list(NEW)))
    back = spliced(more, source_of(more).remove((*keys, index)))
    assert loaded(back).data == data
    if index and "[" not in text:
        assert back == text


@given(written=texts())
def test_a_key_is_added_behind_the_others(written):
    data, text = written
    after = spliced(text, source_of(text).add_key((), "rally_points", [list(NEW)]))
    assert loaded(after).data == {**data, "rally_points": [NEW_ITEM]}
    assert remarks_of(after) == remarks_of(text)


@given(written=plans(), pick=st.randoms(use_true_random=False))
def test_json_stays_json(written, pick):
    data, text = written
    source = TextSource(text, json_from_text(text, PATH).node(), json=True)
    keys = pick.choice(list(lists_in(data)))
    index = pick.randint(0, len(at(data, keys)))
    after = spliced(text, source.insert(keys, index, list(NEW)))
    expected = copy.deepcopy(data)
    at(expected, keys).insert(index, NEW_ITEM)
    assert json.loads(after) == expected
    again = TextSource(after, json_from_text(after, PATH).node(), json=True)
    assert json.loads(spliced(after, again.remove((*keys, index)))) == data
    number = pick.choice(list(numbers_in(data)))
    at(data, number[:-1])[number[-1]] = 5.25
    assert json.loads(spliced(text, source.number(number, 5.25, 7))) == data


@pytest.mark.parametrize(
    ("old", "value", "decimals", "new"),
    [
        ("39.9422294", 39.94222943, 7, None),
        ("39.94222940000123", 39.9422294, 7, None),
        ("39.9422294", 39.95, 7, "39.9500000"),
        ("39.94", 39.9512345, 7, "39.9512345"),
        ("39", 40.0, 7, "40"),
        ("39.0", 40.0, 7, "40.0"),
        ("39.942229400001", 39.5, 7, "39.5000000"),
        ("0.1", -0.0, 2, "0.0"),
        ("5", 7.256, 2, "7.26"),
        ("1e2", 99.0, 2, "99"),
        ("0x10", 3.0, 2, "3"),
    ],
)
def test_numbers_look_like_those_they_replace(old, value, decimals, new):
    assert like(old, value, decimals) == new


@given(st.text(min_size=1, max_size=20))
def test_words_are_read_back_as_they_are(text):
    if any(0xD800 <= ord(letter) <= 0xDFFF for letter in text):
        return
    for shown in (f"name: {word(text)}  # remark", f"[{{name: {word(text)}}}]"):
        data = loaded(shown).data
        assert (data if isinstance(data, dict) else data[0]) == {"name": text}


def test_words_need_no_quotes_where_they_are_plain():
    assert word("hall 3") == "hall 3"
    assert word("no") == "no"
    assert word("true") == '"true"'
    assert word("a: b") == '"a: b"'


def test_pieces_do_not_overlap():
    assert spliced("abcdef", [Splice(4, 5, ""), Splice(1, 1, "X")]) == "aXbcdf"
    with pytest.raises(ValueError, match="overlap"):
        spliced("abc", [Splice(0, 2, ""), Splice(1, 3, "")])


def test_what_is_used_twice_is_left_alone():
    text = "home: &here [1.0, 2.0]\nwaypoints:\n  - *here\n  - [3.0, 4.0]\n"
    source = source_of(text)
    with pytest.raises(SourceError, match="alias"):
        source.number(("home", 0), 5.0, 7)
    with pytest.raises(SourceError, match="alias"):
        source.remove(("waypoints", 1))
    assert spliced(text, source.number(("waypoints", 1, 0), 5.0, 7)).endswith("[5.0, 4.0]\n")


def test_an_empty_list_and_null_are_filled_in_lines_and_remarks_stay():
    text = "fence: null  # none yet\nno_fly_zones: []  # none\nmore: {zones: []}\n"
    source = source_of(text)
    pieces = [*source.fill(("fence",), [list(NEW)] * 3), *source.insert(("no_fly_zones",), 0, NEW)]
    pieces += source.insert(("more", "zones"), 0, list(NEW))
    assert spliced(text, pieces) == (
        "fence:  # none yet\n"
        "  - [1.2345678, -2.5000000]\n  - [1.2345678, -2.5000000]\n  - [1.2345678, -2.5000000]\n"
        "no_fly_zones:  # none\n  - [1.2345678, -2.5000000]\n"
        "more: {zones: [[1.2345678, -2.5000000]]}\n"
    )


def test_the_last_item_leaves_an_empty_list():
    text = "zones:  # one\n  - name: a  # its name\n    ring: [1]\n# end\n"
    after = spliced(text, source_of(text).remove(("zones", 0)))
    assert after == "zones: []  # one\n# end\n"
