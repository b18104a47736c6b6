"""A text that is no YAML, or YAML by accident, is explained plainly, with what to do."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, Field

from mocha_link.team.document import Document, DocumentError
from mocha_link.team.problem import text_in
from mocha_link.team.value_mistakes import decimal_degrees

GOOD = """\
name: field
home: [47.397, 8.545]
altitude_m: 30
waypoints:
  - [47.398, 8.545]
  - [47.399, 8.546]
fence: null
timers:
  init_s: 180
  explore_s: 120
team: team.yaml
"""


class Timers(BaseModel):
    init_s: float = 0.0
    explore_s: float = 0.0


class Fence(BaseModel):
    radius_m: float


class Plan(BaseModel):
    name: str
    home: list[float] = Field(min_length=2, max_length=2)
    altitude_m: float
    waypoints: list[list[float]]
    fence: Fence | None
    timers: Timers
    team: str


def problems(text):
    """The problems of a text, as line:column: message."""
    with pytest.raises(DocumentError) as caught:
        Document.from_text(text, Path("plan.yaml")).parse(Plan)
    return [f"{p.line}:{p.column}: {p.message}" for p in caught.value.problems]


def test_the_text_itself_is_in_order():
    assert Document.from_text(GOOD, Path("plan.yaml")).parse(Plan).timers.explore_s == 120


TAB = "a tab indents this line; replace it with blanks"
SAME_COLUMN = "begin all entries of one list or mapping in the same column"
QUOTED = "has to be in quotes"
COLON = "a colon is missing behind"
BLANK = "a blank is missing behind the colon; write"

NO_YAML = [  # what is changed into what, at the mark (§) is the place, the message
    ("  explore_s", "§\texplore_s", TAB),
    ("  - [47.399", "§\t- [47.399", TAB),
    ("  - [47.399", "  -§\t[47.399", TAB),
    ("  explore_s", " §explore_s", f"begins in column 2, the one above in column 3; {SAME_COLUMN}"),
    ("  explore_s", "    §explore_s", "begins in column 5, the one above in column 3"),
    ("altitude_m", "  §altitude_m", "begins in column 3, the one above in column 1"),
    ("  - [47.399", "   §- [47.399", SAME_COLUMN),
    ("  - [47.399", " §- [47.399", SAME_COLUMN),
    ("altitude_m: 30", "§altitude_m 30", f"{COLON} 'altitude_m'"),
    ("init_s: 180", "§init_s 180", f"{COLON} 'init_s'"),
    ("timers:", "§timers", f"{COLON} 'timers'"),
    ("waypoints:", "§waypoints", f"{COLON} 'waypoints'"),
    ("team: team.yaml", "§team team.yaml", f"{COLON} 'team'"),
    ("altitude_m: 30", "§altitude_m:30", f"{BLANK} 'altitude_m: 30'"),
    ("name: field", "§name:field", f"{BLANK} 'name: field'"),
    ("init_s: 180", "§init_s:180", f"{BLANK} 'init_s: 180'"),
    ("team: team", "§team:team", f"{BLANK} 'team: team.yaml'"),
    ("  - [47.399", "  §-[47.399", "a blank is missing behind the dash"),
    ("altitude_m: 30", "§altitude_m = 30", "write a colon and a blank instead of '='"),
    ("altitude_m: 30", "§altitude_m\uff1a 30", "is a look-alike; type ': ' anew"),
    ("altitude_m: 30", "§altitude_m:\u00a030", "is a look-alike; type ': ' anew"),
    ("name: field", "name: field§: north", "a second colon on one line; put the text in quotes"),
    ("name: field", 'name: §"field', "a quote opens here and is not closed"),
    ("team: team.yaml", 'team: §"team.yaml', "a quote opens here and is not closed"),
    ("name: field", "name: §'field", "a quote opens here and is not closed"),
    ("name: field", "name: 'Peter'§s field'", "text follows a closing quote"),
    ("name: field", 'name: "field" §two', "text follows a closing quote"),
    ("[47.397, 8.545]", '["52°28\'25"§N", 8.545]', "write decimal degrees, like 52.4736"),
    ("[47.397, 8.545]", "§[47.397, 8.545", "'[' opens here and is not closed; add ']'"),
    ("[47.399, 8.546]", "§[47.399, 8.546", "'[' opens here and is not closed; add ']'"),
    ("[47.397, 8.545]", "[47.397, 8.545]§]", "']' closes a bracket that is not open"),
    ("[47.397, 8.545]", "[47.397, 8.545§}", "'[' is closed by '}'; close it with ']'"),
    ("name: field", "name: §%field", f"text that begins with '%' {QUOTED}"),
    ("name: field", "name: §@field", f"text that begins with '@' {QUOTED}"),
    ("name: field", "name: §`field`", f"text that begins with '`' {QUOTED}"),
    ("name: field", "name: §*field", f"text that begins with '*' {QUOTED}"),
    ("name: field", "name: |§field", QUOTED),
    ("[47.397, 8.545]", "§,[47.397, 8.545]", "a value is missing before ','"),
    ("  - [47.398, 8.545]", "  - [47.398]§, 8.545]", "this follows a value that is complete"),
    (
        "  - [47.399, 8.546]",
        "§[47.399, 8.546]",
        "no key and no entry of a list; write 'key: value'",
    ),
    ("fence: null", "§// no fence\nfence: null", "a comment begins with '#', not with '//'"),
    ("team: team.yaml", 'team: "C:\\U§sers\\team.yaml"', "write paths with '/', or use single"),
    ("altitude_m: 30", "altitude_m: §- 30", "a list with dashes begins on the line below its key"),
    ("name: field", "§```yaml\nname: field", "a line of Markdown; remove it"),
    ("altitude_m: 30", "§<<<<<<< HEAD\naltitude_m: 30\n=======", "a merge that is not done"),
    ("team: team.yaml", "team: team.yaml\n§---\nteam: x", "a second document begins here ('---')"),
]


@pytest.mark.parametrize(("before", "after", "message"), NO_YAML)
def test_what_is_no_yaml_is_explained_at_its_place(before, after, message):
    begin, _, end = GOOD.replace(before, after, 1).partition("§")
    (problem,) = problems(begin + end)
    line, column = begin.count("\n") + 1, len(begin.rpartition("\n")[2]) + 1
    assert problem.startswith(f"{line}:{column}: ")
    assert message in problem


def test_a_quote_that_another_one_closes_is_found_where_it_opens():
    text = GOOD.replace("name: field", 'name: "field').replace("team.yaml", '"team.yaml"')
    assert problems(text) == ["1:7: a quote opens here and closes on line 11 only; close it"]


@pytest.mark.parametrize("breaks", ["\r\n", "\r", "\u2028"])
def test_lines_are_counted_whatever_breaks_them(breaks):
    text = GOOD.replace("altitude_m: 30", "altitude_m 30").replace("\n", breaks)
    assert problems(text)[0].startswith(f"3:1: {COLON} 'altitude_m'")


def test_a_long_file_is_explained_too():
    text = GOOD.replace("  explore_s", "\texplore_s") + "#" * 60_000
    assert problems(text)[0].startswith(f"10:1: {TAB}")


POINT = "decimals stand behind a point:"
BY_ACCIDENT = [
    ("[47.397, 8.545]", "§[47,397, 8,545]", f"found 4; {POINT} [47.397, 8.545]"),
    ("[47.397, 8.545]", "§[-47,397, 8,045]", f"found 4; {POINT} [-47.397, 8.045]"),
    ("[47.397, 8.545]", "§[47,397, 8.545]", f"found 3; {POINT} [47.397, 8.545]"),
    ("[47.397, 8.545]", "§[47.397, 8,545]", f"found 3; {POINT} [47.397, 8.545]"),
    ("[47.397, 8.545]", "§[47,397; 8,545]", f"found 3; {POINT} [47.397, 8.545]"),
    ("[47.397, 8.545]", "§[47.397, 8.545, 30]", "an altitude (30?) has a key of its own"),
    ("altitude_m: 30", "altitude_m: §30,5", f"found text '30,5'; {POINT} 30.5"),
    ("altitude_m: 30", "altitude_m: §1.000,5", "write it without thousands separators"),
    (
        "altitude_m: 30",
        "altitude_m: §30 m",
        "write it without a unit, in the one of the key's name: 30",
    ),
    ("altitude_m: 30", "altitude_m: §30#m", "a comment needs a blank before its '#': 30 #..."),
    ("altitude_m: 30", "altitude_m: §“30”", "only looks like the right one; type it anew: 30"),
    ("8.545]\nalt", "§\u22128.545]\nalt", "only looks like the right one; type it anew: -8.545"),
    ("altitude_m: 30", "altitude_m: §30\u200b", "type it anew: 30"),
    ("[47.397, 8.545]", "[§47.397; 8.545]", "a comma between the two numbers: [47.397, 8.545]"),
    ("[47.397, 8.545]", "[§47.397 8.545]", "a comma between the two numbers: [47.397, 8.545]"),
    ("[47.397, 8.545]", "§47.397, 8.545", "put the pair in brackets: [47.397, 8.545]"),
    ("[47.397, 8.545]", "§(47.397, 8.545)", "put the pair in brackets: [47.397, 8.545]"),
    ("[47.397, 8.545]", "§47,397 8,545", "put the pair in brackets: [47.397, 8.545]"),
    ("[47.397", "[§52°28'25\"N", "found text '52°28'25\"N'; write decimal degrees: 52.4736111"),
    ("[47.397", "[§N52 28 25", "write decimal degrees: 52.4736111"),
    ("[47.397, 8.545]", "§52°28'25\"N 13°24'06\"E", "write decimal degrees in brackets"),
    ("  init_s: 180\n  explore_s: 120", "  §init_s:180", "write a blank behind the colon: 'init_s"),
    ("fence: null", "fence: §none", "write null if there is none"),
    ("fence: null", "fence: §null // none", "a comment begins with '#', not with '//'"),
    ("  explore_s", "§\u00a0\u00a0explore_s", "type it anew: 'explore_s', behind plain blanks"),
    ("team: t", "§\ufeffteam: t", "hidden or look-alike characters"),
    (":\n  init_s: 180\n  explore_s: 120", ": {init_s: 180,§5}", "a number is no key"),
    (":\n  init_s: 180\n  explore_s: 120", ": {§init_s:180}", "write a blank behind the colon"),
    ("altitude_m: 30", "altitude_m: 30\n§altitude_m: 40", "is already on line 3; remove one"),
]


@pytest.mark.parametrize(("before", "after", "message"), BY_ACCIDENT)
def test_what_is_yaml_by_accident_is_explained(before, after, message):
    begin, _, end = GOOD.replace(before, after, 1).partition("§")
    line, column = begin.count("\n") + 1, len(begin.rpartition("\n")[2]) + 1
    found = [each for each in problems(begin + end) if each.startswith(f"{line}:{column}: ")]
    assert len(found) == 1
    assert message in found[0]


DEGREES = [
    ("52°28'25\"N", "52.4736111"),
    ("52° 28' 25\"", "52.4736111"),
    ("N52 28 25", "52.4736111"),
    ("52 28.417 N", "52.4736167"),
    ("13°24′06″W", "-13.4016667"),  # noqa: RUF001 - as maps write minutes
    ("S33 51.5", "-33.8583333"),
    ("-33°30'", "-33.5"),
    ("52.4736°", "52.4736"),
    ("52.4736N", "52.4736"),
    ("N52W", None),
    ("52 28", None),
    ("52", None),
    ("swift", None),
]


@pytest.mark.parametrize(("text", "wanted"), DEGREES)
def test_degrees_with_minutes_are_reckoned_in_decimals(text, wanted):
    assert decimal_degrees(text) == wanted


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_named(code):
    with pytest.raises(DocumentError) as caught:
        text_in(GOOD.encode(code), Path("plan.yaml"))
    assert "plan.yaml:1:1: UTF-16 text, as Windows programs write 'Unicode'" in str(caught.value)


def test_a_byte_order_mark_is_read_over():
    assert text_in(b"\xef\xbb\xbf" + GOOD.encode(), Path("plan.yaml")) == GOOD


PIECES = st.sampled_from(
    [*"\t \n:-[]{}\"'#,|>*!%@`?=\\\r\x85\u2028", ": ", "- ", "&a", "? ", "---\n", "...\n", "//"]
)


@given(st.lists(st.tuples(st.integers(0, len(GOOD)), PIECES), min_size=1, max_size=4))
def test_whatever_is_typed_somewhere_the_parser_is_never_quoted(typed):
    text = GOOD
    for at, piece in typed:
        text = text[:at] + piece + text[at:]
    try:
        Document.from_text(text, Path("plan.yaml"))
    except DocumentError as error:
        lines = re.split(r"\r\n|[\r\n\x85\u2028\u2029]", text)
        for problem in error.problems:
            assert not re.search("while (scanning|parsing)|<block|token|scalar", problem.message)
            assert ";" in problem.message or QUOTED in problem.message
            assert 1 <= problem.line <= len(lines)
            assert 1 <= problem.column <= len(lines[problem.line - 1]) + 1
