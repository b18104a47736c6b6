"""Documents name the place of every value and report every problem at once."""

import enum
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, Field

from mocha_link.team.document import MAX_BYTES, Document, DocumentError, Problem

PATH = Path("fleet.yaml")

WITHOUT_QUOTES = "2:13: 'altitude_m' must be a number, found text '60'; "
WITHOUT_QUOTES += "write the value without quotes [wrong-type]"
UNKNOWN_KEY = (
    "4:1: unknown key 'speed'; use one of altitude_m, by_name, kind, name, other, points"
    " [unknown-key]"
)
TEXT = """\
name: survey
altitude_m: 60
kind: slow
points:
  - {east_m: 1, north_m: 2}
  - east_m: 3
    north_m: 4.5
"""


class Kind(enum.Enum):
    SLOW = "slow"
    FAST = "fast"


class Point(BaseModel):
    east_m: float
    north_m: float


class Survey(BaseModel):
    name: str
    altitude_m: float = Field(gt=0, description="metres above home")
    kind: Kind = Kind.SLOW
    points: tuple[Point, ...] = ()
    by_name: dict[str, Point] = {}
    other: Point | None = None


def problems_of(text: str, model: type[BaseModel] | None = None) -> list[str]:
    def read() -> None:
        document = Document.from_text(text, PATH)
        if model:
            document.parse(model)

    with pytest.raises(DocumentError) as caught:
        read()
    assert str(caught.value) == "\n".join(map(str, caught.value.problems))
    return [str(problem).removeprefix("fleet.yaml:") for problem in caught.value.problems]


def test_of_each_kind_the_first_problems_are_reported_and_the_others_counted():
    text = "".join(f"key_{n}: 1\n" for n in range(50))
    with pytest.raises(DocumentError) as caught:
        Document.from_text(f"name: a\n{text}altitude_m: -1", PATH).parse(Survey)
    lines = [(problem.line, problem.code) for problem in caught.value.problems]
    assert lines == [
        *((line, "unknown-key") for line in range(2, 22)),
        (21, "more"),
        (52, "out-of-range"),
    ]
    assert "30 more problems of the kind 'unknown-key'" in str(caught.value)


def test_values_and_places():
    document = Document.from_text(TEXT, PATH)
    assert document.data["points"] == [{"east_m": 1, "north_m": 2}, {"east_m": 3, "north_m": 4.5}]
    assert document.place() == (1, 1)
    assert document.place("altitude_m") == (2, 13)
    assert document.place("points", 0, "north_m") == (5, 26)
    assert document.place("points", 1, "north_m") == (7, 14)
    assert document.place_of_key("points", 1, "north_m") == (7, 5)
    assert document.place("points", 1, "up_m") == document.place("points", 1) == (6, 5)
    assert document.place("points", 9) == document.place("points")
    problem = document.problem(["kind"], "bad; fix", "too-bad")
    assert problem == Problem(PATH, 3, 7, "bad; fix", "too-bad")
    assert problem.keys == ("kind",)
    assert str(problem) == "fleet.yaml:3:7: bad; fix [too-bad]"
    assert problem.as_json() == {
        "path": "fleet.yaml",
        "line": 3,
        "column": 7,
        "code": "too-bad",
        "message": "bad; fix",
    }
    assert document.node("kind").value == "slow"


def test_load_reads_a_file(tmp_path):
    path = tmp_path / "fleet.yaml"
    path.write_text("\ufeff" + TEXT, encoding="utf-8")
    document = Document.load(path)
    assert document.path == path
    assert Document.load(str(path)).path == path
    assert document.data["name"] == "survey"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"),
        ("on", "on"),
        ("1e3", 1000.0),
        ("010", 10),
        ("0x10", 16),
        ("12:30", "12:30"),
        ("2026-01-01", "2026-01-01"),
        ("127.0.0.1", "127.0.0.1"),
        ("TRUE", True),
        ("~", None),
        ("", None),
        ("'5'", "5"),
        ("-.5", -0.5),
    ],
)
def test_scalars_follow_yaml_1_2(text, value):
    assert Document.from_text(f"key: {text}", PATH).data == {"key": value}


def test_every_problem_is_reported_in_file_order():
    text = (
        'name: 7\naltitude_m: "60"\nkind: sloow\nspeed: 3\n'
        "points:\n  - {east_m: 1, nort_m: 2}\n  - 5\nby_name: {a: {east_m: 1}}\n"
    )
    assert problems_of(text, Survey) == [
        "1:7: 'name' must be text, found 7; put it in quotes [wrong-type]",
        WITHOUT_QUOTES,
        "3:7: 'kind' cannot be text 'sloow'; did you mean 'slow'? [unknown-word]",
        UNKNOWN_KEY,
        "6:5: missing key 'north_m'; add it [missing-key]",
        "6:17: unknown key 'nort_m'; did you mean 'north_m'? [unknown-key]",
        "7:5: 'points[1]' must be a mapping (key: value), found 5; correct it [wrong-type]",
        "8:14: missing key 'north_m'; add it [missing-key]",
    ]


@pytest.mark.parametrize(
    ("text", "problem", "code"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", "2:4: '[' opens here and is not closed", "not-yaml"),
        ("a: 1\na: 2\n", "2:1: key 'a' is already on line 1; remove one", "repeated-key"),
        ("a: !!python/object:os.system {}", "1:4: YAML tag", "yaml-feature"),
        ("a: !thing x", "1:4: YAML tag !thing is not read; remove it", "wrong-value"),
        ("? [a]\n: 1", "1:3: a key must be a word", "wrong-type"),
        ("a: &x {b: 1}\nc: {<<: *x}", "2:5: merge keys (<<) are not read", "yaml-feature"),
        ('a: "\\ud800"', "1:4: half a character (a lone surrogate) in text", "wrong-value"),
        ('"\\udfff": 1', "1:1: half a character (a lone surrogate) in text", "wrong-value"),
        ("a: .inf", "1:4: '.inf' is not a finite float value", "wrong-value"),
        ("a: 1e999", "1:4: '1e999' is not a finite float value", "wrong-value"),
        ("a: " + "9" * 5000, "1:4: ", "wrong-value"),
        ("a: 0x" + "f" * 5000, "1:4: ", "wrong-value"),
        ("? 0x" + "f" * 5000 + "\n: 1", "1:3: ", "wrong-value"),
        ("a: 1\nb: \x07", "2:4: control character", "not-yaml"),
        ("a: &x [*x]", "1:4: an alias inside its own anchor; remove it", "yaml-feature"),
        ("a: 1\n---\nb: 2", "2:1: a second document begins here", "not-yaml"),
        ("a: *missing", "1:4: text that begins with '*'", "not-yaml"),
        ("[" * 5000, "1:61: nested more than 60 deep; flatten it", "too-deep"),
        ("[" * 61 + "]" * 61, "1:61: nested more than 60 deep; flatten it", "too-deep"),
        ("[" * 60 + "x" + "]" * 59, "1:", "not-yaml"),
    ],
)
def test_broken_documents_name_the_place(text, problem, code):
    (found,) = problems_of(text)
    assert found.startswith(problem)
    assert found.endswith(f" [{code}]")


def test_text_may_lie_in_the_deepest_list_there_may_be():
    data = Document.from_text("[" * 60 + "x" + "]" * 60, Path("deep.yaml")).data
    for _ in range(60):
        (data,) = data
    assert data == "x"


def test_aliases_cannot_blow_up():
    text = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for name, before in zip("bcdefgh", "abcdefg", strict=True):
        text += f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    (found,) = problems_of(text)
    assert "more than 200000 values" in found


def test_unreadable_files(tmp_path):
    missing = tmp_path / "missing.yaml"
    with pytest.raises(DocumentError, match=r"missing.yaml:1:1: cannot read the file: No such"):
        Document.load(missing)
    with pytest.raises(DocumentError, match="cannot read the file: Is a directory"):
        Document.load(tmp_path)
    large = tmp_path / "large.yaml"
    large.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(DocumentError, match="larger than"):
        Document.load(large)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes("a: 1\nb: é\n".encode("latin-1"))
    with pytest.raises(DocumentError, match=r"latin.yaml:2:4: not UTF-8 text"):
        Document.load(latin)


@given(st.one_of(st.text(max_size=80), st.text(alphabet="a:[]{}&*-,<'\"\n 1.!|>?#%", max_size=60)))
def test_any_text_is_a_document_or_a_document_error(text):
    problems: tuple[Problem, ...] = ()
    try:
        Document.from_text(text, PATH).parse(Survey)
    except DocumentError as error:
        problems = error.problems
    assert all(problem.line >= 1 and problem.column >= 1 for problem in problems)


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML is installed without libyaml")
@pytest.mark.parametrize(
    "text", ['a: é # ü\r\nb: [1, "ö"]\r\n', "x:\n-\n  - 2\ny: |\n  z\nw:\n", TEXT]
)
def test_both_loaders_see_the_same_at_the_same_places(text, monkeypatch):
    quick = Document.from_text(text, PATH)
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    slow = Document.from_text(text, PATH)
    assert quick.data == slow.data
    assert list(places(quick.node())) == list(places(slow.node()))


def places(node: yaml.Node) -> Iterator[tuple[int, int, int, str]]:
    yield node.start_mark.line, node.start_mark.column, node.start_mark.index, node.tag
    for child in node.value if isinstance(node, yaml.CollectionNode) else ():
        for inner in child if isinstance(child, tuple) else (child,):
            yield from places(inner)


def test_a_problem_is_one_printable_line():
    problem = Problem(Path("a.yaml"), 1, 2, "no robot 'x\x1b[2J\ud800\n'", "unknown-robot")
    assert str(problem) == "a.yaml:1:2: no robot 'x?[2J? ' [unknown-robot]"
