"""Texts are edited where their data change: what was requested is there, and nothing else."""

import copy
import json
import re
from itertools import count
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from air_router.files.digits import Digits, degrees, like
from air_router.files.json_document import json_from_text, value_at
from air_router.files.text_edit import SourceError, rewritten
from mocha_link.team.document import Document
from tests.air_router.files.values import values_in

PATH = Path("mission.yaml")
NEW = [degrees(1.2345678), degrees(-2.5)]


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


def loaded(text):
    return Document.from_text(text, PATH)


def remarks_of(text):
    return re.findall(r"# remark \d+", text)


def changed(data, pick, way):
    """Other data: a number replaced, an item inserted or removed, a key added."""
    data = copy.deepcopy(data)
    if way == "number":
        keys = pick.choice(
            [keys for keys, value in values_in(data) if isinstance(value, float | int)]
        )
        value_at(data, keys[:-1])[keys[-1]] = Digits(5.25, 7)
    elif way == "key":
        data["rally_points"] = [NEW]
    else:
        lists = [value for _, value in values_in(data) if isinstance(value, list)]
        lists = [v for v in lists if not (v and isinstance(v[0], float | int))]
        values = pick.choice([v for v in lists if v or way == "insert"])
        if way == "insert":
            values.insert(pick.randint(0, len(values)), NEW)
        else:
            del values[pick.randrange(len(values))]
    return data


WAYS = st.sampled_from(["number", "insert", "remove", "key"])


@settings(max_examples=60)
@given(way=WAYS, data=missions, draw=st.data(), pick=st.randoms(use_true_random=False))
def test_yaml_has_the_requested_data_and_keeps_its_comments(way, data, draw, pick):
    text = Writer(draw.draw).text(data)
    new = changed(data, pick, way)
    after = rewritten(text, loaded(text), new)
    assert loaded(after).data == new
    assert after.count("\r") == (after.count("\n") if "\r" in text else 0)
    if way == "remove":
        kept = set(remarks_of(after))
        assert remarks_of(after) == [remark for remark in remarks_of(text) if remark in kept]
    else:
        assert remarks_of(after) == remarks_of(text)
    if way == "number":
        assert len(after.splitlines()) == len(text.splitlines())
        lines = zip(after.splitlines(), text.splitlines(), strict=True)
        assert sum(a != b for a, b in lines) <= 1
    if way == "insert":
        back = rewritten(after, loaded(after), data)
        assert loaded(back).data == data


@given(
    way=WAYS,
    data=missions,
    indent=st.sampled_from([None, 2, 4, "\t"]),
    newline=st.sampled_from(["\n", "\r\n"]),
    pick=st.randoms(use_true_random=False),
)
def test_json_stays_json_and_as_it_is_laid_out(way, data, indent, newline, pick):
    text = json.dumps(data, indent=indent).replace("\n", newline)
    new = changed(data, pick, way)
    after = rewritten(text, json_from_text(text, PATH), new)
    assert json.loads(after) == new
    assert rewritten(after, json_from_text(after, PATH), data) == text


@pytest.mark.parametrize(
    ("old", "value", "decimals", "new"),
    [
        ("39.9422294", 39.95, 7, "39.9500000"),
        ("39.94", 39.9512345, 7, "39.9512345"),
        ("39", 40.0, 7, "40"),
        ("39.0", 40.0, 7, "40.0"),
        ("39.942229400001", 39.5, 7, "39.5000000"),
        ("0.1", -0.0, 2, "0.0"),
        ("5", 7.256, 2, "7.26"),
        ("1e2", 99.0, 2, "99"),
    ],
)
def test_numbers_look_like_those_they_replace(old, value, decimals, new):
    assert like(old, Digits(value, decimals)) == new


@given(st.text(min_size=1, max_size=20))
def test_texts_are_read_back_as_they_are(text):
    if any(0xD800 <= ord(letter) <= 0xDFFF for letter in text):
        return
    for before in (
        "name: old  # remark\n",
        "name: 'old'\n",
        "[{name: old}]\n",
        "n:\n  - name: old\n",
    ):
        document = loaded(before)
        data = json.loads(json.dumps(document.data).replace('"old"', json.dumps(text)))
        after = rewritten(before, document, data)
        assert loaded(after).data == data
        assert remarks_of(after) == remarks_of(before)


def test_what_is_used_twice_is_left_alone():
    text = "home: &here [1.0, 2.0]\nwaypoints:\n  - *here\n  - [3.0, 4.0]\n"
    document = loaded(text)
    home, waypoints = document.data["home"], document.data["waypoints"]
    for wrong in ({"home": [5.0, 2.0]}, {"waypoints": [home]}):
        with pytest.raises(SourceError, match="alias"):
            rewritten(text, document, {**document.data, **wrong})
    moved = {**document.data, "waypoints": [waypoints[0], [5.0, 4.0]]}
    assert rewritten(text, document, moved).endswith("[5.0, 4.0]\n")


@pytest.mark.parametrize(
    ("text", "change", "after"),
    [
        ("f: null  # none yet\n", {"f": [NEW] * 2}, "f:  # none yet\n  - P\n  - P\n"),
        ("z: []  # none\nb: 1\n", {"z": [NEW], "b": 1}, "z:  # none\n  - P\nb: 1\n"),
        ("m: {z: []}\n", {"m": {"z": [NEW]}}, "m: {z: [P]}\n"),
        ("z:  # one\n  - n: a  # its\n    r: [1]\n# end\n", {"z": []}, "z: []  # one\n# end\n"),
        ("s: new\n", {"s": {"policy": "new", "r": [1]}}, "s: {policy: new, r: [1]}\n"),
        ("a:  # x\n  b: 1  # y\n", {"a": {"c": [NEW]}}, "a:  # x\n  c:\n    - P  # y\n"),
        (
            "w:\n  - [1, 2]  # 1\n",
            {"w": [{"position": [1, 2], "h": 3}]},
            "w:\n  - {position: [1, 2], h: 3}  # 1\n",
        ),
        ("t: {s: 1, u: 2}  # all\n", {"t": {"s": 1}}, "t: {s: 1}  # all\n"),
        ("z: [  # none\n  ]\n", {"z": [{"n": 1}]}, "z: [{n: 1}  # none\n  ]\n"),
        ("n: >-  # long\n  a\n  b\nm: 1\n", {"n": "c", "m": 1}, "n: c  # long\nm: 1\n"),
        ("n: |-  \n  a\nm: 1\n", {"n": "c", "m": 1}, "n: c\nm: 1\n"),
        ("w:\r\n- a\n# one\r\n- b\n", {"w": ["b"]}, "w:\r\n# one\r\n- b\n"),
    ],
)
def test_each_way_of_writing_has_a_place_for_the_change(text, change, after):
    expected = after.replace("P", "[1.2345678, -2.5000000]")
    assert rewritten(text, loaded(text), change) == expected


@pytest.mark.parametrize(
    ("text", "change", "after"),
    [
        ("a: 39.9500\nb: 1\n", {"b": 2}, "a: 39.9500\nb: 2\n"),
        (
            "a: +5\nb: ~\nc: TRUE\nd: 0x1F\ne: 1\n",
            {"e": 2},
            "a: +5\nb: ~\nc: TRUE\nd: 0x1F\ne: 2\n",
        ),
        ("a:   1   # wide\nb:  2\n", {"a": 3}, "a:   3   # wide\nb:  2\n"),
        ("a: 1\t# tab\nb: 2\n", {"b": 3}, "a: 1\t# tab\nb: 3\n"),
        ("a: 'it''s'\nb: \"x\\u00e9\"\n", {"a": "you"}, "a: 'you'\nb: \"x\\u00e9\"\n"),
        ("a: 1\r\nb: [1, 2]\r\n", {"c": [[3]]}, "a: 1\r\nb: [1, 2]\r\n\r\nc:\r\n  - [3]\r\n"),
        ("a: 1\nb:\n  - [1, 2]", {"b": [[1, 2], [3]]}, "a: 1\nb:\n  - [1, 2]\n  - [3]"),
        ("a: 1\nb:\n  - [1]\n  - [2]", {"b": [[1]]}, "a: 1\nb:\n  - [1]"),
        ("---\na: 1\n...\n", {"a": 2}, "---\na: 2\n...\n"),
        ("b: [ 1,2 ,3 ]\n", {"b": [1, 2, 4]}, "b: [ 1,2 ,4 ]\n"),
        ("b: [\n  [1, 2],\n  [3, 4]  # x\n]\n", {"b": [[1, 2]]}, "b: [\n  [1, 2],\n]\n"),
        (
            "b: [\n  [1, 2],\n  [3, 4]  # x\n]\n",
            {"b": [[1, 2], [3, 4], [5]]},
            "b: [\n  [1, 2],\n  [3, 4],  # x\n  [5]\n]\n",
        ),
        (
            "w:\n  - [1.50, 2.0]  # 1\n  - [3, 4]  # 2\n",
            {"w": [[3, 4], [1.5, 2.0]]},
            "w:\n  - [3, 4]  # 1\n  - [1.5, 2.0]  # 2\n",
        ),
        (
            "z:\n  - a: 1\n# of the next\nn: 1\n",
            {"z": [{"a": 1}, {"a": 2, "b": [[1]]}]},
            "z:\n  - a: 1\n  - a: 2\n    b:\n      - [1]\n# of the next\nn: 1\n",
        ),
        (f"a: [{'1.25, ' * 5000}1]\nb: 1\n", {"b": 2}, f"a: [{'1.25, ' * 5000}1]\nb: 2\n"),
        ("p: {c: 1}  # all\n", {"p": {}}, "p: {}  # all\n"),
        ("p:  # all\n  # one\n  c: 1  # its\n", {"p": {}}, "p: {}  # all\n  # one\n"),
    ],
)
def test_whatever_a_change_is_not_about_stays_as_it_is_written(text, change, after):
    document = loaded(text)
    assert rewritten(text, document, {**document.data, **change}) == after


def test_entries_change_places_as_they_are_written():
    text = "w:\n  - [1.50, 2.0]  # 1\n  - {at: [3, 4.0]}  # 2\n"
    document = loaded(text)
    turned = {"w": document.data["w"][::-1]}
    assert rewritten(text, document, turned) == (
        "w:\n  - {at: [3, 4.0]}  # 1\n  - [1.50, 2.0]  # 2\n"
    )


@pytest.mark.parametrize(
    ("text", "change", "why"),
    [
        ("w: &all\n  - [1]\n", {"w": [[1], [2]]}, "'w' has an anchor"),
        ("w: [[1],\n  # two\n  [2]]\n", {"w": []}, "comments stand in what changes on line 1"),
        (
            "w:\n  - - 1\n    # two\n    - 2\n",
            {"w": [[2]]},
            "comments stand in what changes on line 2",
        ),
    ],
)
def test_what_cannot_be_changed_is_refused_with_one_sentence(text, change, why):
    with pytest.raises(SourceError, match=why):
        rewritten(text, loaded(text), change)


SHIPPED = sorted((Path(__file__).parents[3] / "missions").glob("*/*.yaml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_in_every_shipped_file_a_value_changes_in_its_place(path):
    text = path.read_text(encoding="utf-8")
    document = Document.from_text(text, path)
    numbers = [keys for keys, value in values_in(document.data) if type(value) in (int, float)]
    for keys in numbers[:: max(len(numbers) // 10, 1)]:
        data = copy.deepcopy(document.data)
        value_at(data, keys[:-1])[keys[-1]] = Digits(-7.25, 2)
        after = rewritten(text, document, data)
        line = document.place(*keys)[0] - 1
        old, new = text.splitlines(keepends=True), after.splitlines(keepends=True)
        assert old[:line] + old[line + 1 :] == new[:line] + new[line + 1 :]
        assert loaded(after).data == data
