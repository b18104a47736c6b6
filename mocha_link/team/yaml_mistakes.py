"""The mistake in a text that is not YAML, in a sentence for its author.

A YAML parser reports its expectation, often lines below the mistake. Here the lines around that
place are compared with the mistakes that people make.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import yaml

from mocha_link.team.yaml_nodes import LARGE, Loader

_LINE_BREAK = re.compile("\r\n|[\r\n\x85\u2028\u2029]")  # as YAML counts lines
_TAB = re.compile(r"^( *(?:- *)*)\t")
_MERGE = re.compile(r"^(<{7}|={7}|>{7})( |$)")
_MARKDOWN = re.compile(r"^\s*(`{3}|~{3})")
_SLASHES = re.compile(r"^\s*//")
_NO_BLANK = re.compile(r"^\s*(?:- +)?(?P<key>[A-Za-z_][\w-]*):(?P<value>[^\s:/].*)$")
_NO_DASH_BLANK = re.compile(r"^\s*-[^\s-]")
_EQUALS = re.compile(r"^\s*(?:- +)?(?P<key>[A-Za-z_][\w-]*)\s*=")
_OTHER_COLON = re.compile(r"^\s*(?P<key>[A-Za-z_][\w-]*)\s*[：﹕∶]|^\s*[A-Za-z_][\w-]*:\u00a0")  # noqa: RUF001 - characters that look alike
_NO_COLON = re.compile(r"^\s*(?:- +)?(?P<key>[A-Za-z_][\w-]*)(?:\s|$)(?!.*: )")

_QUOTES: Final = "\"'"
_PAIRS: Final = {"[": "]", "{": "}"}

Place = tuple[int, int]
"""Line and column, from 1."""


@dataclass(frozen=True, slots=True)
class _Text:
    """A text that is not YAML, and where the parser noticed.

    Attributes:
        text: All of it.
        lines: Its lines.
        problem: What the parser expected.
        line, column: Where it noticed, from 0.
        begun: Line and column, from 0, of what it was reading then.
    """

    text: str
    lines: list[str]
    problem: str
    context: str
    line: int
    column: int
    begun: tuple[int, int] | None

    def before(self, line: int) -> Iterator[int]:
        """The lines with content above a line, upwards."""
        for number in range(min(line, len(self.lines)) - 1, -1, -1):
            if self.lines[number].strip() and not self.lines[number].lstrip().startswith("#"):
                yield number

    def indent(self, line: int) -> int:
        """How many blanks a line begins with."""
        return len(self.lines[line]) - len(self.lines[line].lstrip(" "))


Advice = tuple[str, Place]


def explained(error: yaml.MarkedYAMLError, text: str) -> Advice:
    """What is wrong and what to do, and where."""
    mark = error.problem_mark or error.context_mark
    lines = _LINE_BREAK.split(text)
    last = len(lines) - 1
    begun = error.context_mark
    found = _Text(
        text,
        lines,
        error.problem or "",
        error.context or "",
        min(mark.line, last) if mark else 0,
        mark.column if mark else 0,
        None if begun is None else (min(begun.line, last), begun.column),
    )
    for check in _CHECKS:
        advice = check(found)
        if advice is not None:
            return advice
    message = (
        "cannot be read from here on; look for a missing colon, quote or bracket on this line and "
        "the one above, and indent both alike"
    )
    return message, (found.line + 1, found.column + 1)


def _tab(found: _Text) -> Advice | None:
    above = found.before(found.line)
    tabs = "\\t" in found.problem or "tab" in found.problem
    for number in (found.line, *(above if tabs else _first(above))):
        match = _TAB.match(found.lines[number])
        if match:
            message = "a tab indents this line; replace it with blanks (YAML counts blanks only)"
            return message, (number + 1, len(match[1]) + 1)
    return None


def _foreign_line(found: _Text) -> Advice | None:
    """A line of another language, on the line that cannot be read or right above it."""
    near = [
        found.line,
        *([found.begun[0]] if found.begun else []),
        *_first(found.before(found.line)),
    ]
    for number in near:
        for pattern, message in (
            (_MERGE, "a mark of a merge that is not done; keep one side, remove the marks"),
            (_MARKDOWN, "a line of Markdown; remove it"),
            (_SLASHES, "a comment begins with '#', not with '//'"),
        ):
            if pattern.match(found.lines[number]):
                return message, (number + 1, found.indent(number) + 1)
    return None


def _quote(found: _Text) -> Advice | None:
    if "quoted scalar" in found.context and found.begun is not None:
        place = (found.begun[0] + 1, found.begun[1] + 1)
        if "escape" in found.problem:
            message = (
                "in double quotes a backslash begins a special character; write paths with '/', or "
                "use single quotes"
            )
            return message, (found.line + 1, found.column + 1)
        return "a quote opens here and is not closed; close it on its line", place
    before = found.lines[found.line][: found.column].rstrip()
    if "scalar>" not in found.problem or before[-1:] not in (*_QUOTES,):
        return None
    start = _last_quoted(found)
    if start is not None and start[0] < found.line:
        message = f"a quote opens here and closes on line {found.line + 1} only; close it"
        return message, (start[0] + 1, start[1] + 1)
    message = (
        "text follows a closing quote; put all of it in quotes (the other kind, if it contains "
        "this one)"
    )
    if "°" in found.lines[found.line]:
        message = "degrees, minutes and seconds are not read; write decimal degrees, like 52.4736"
    return message, (found.line + 1, found.column + 1)


def _last_quoted(found: _Text) -> tuple[int, int] | None:
    """Where the last text in quotes before the place begins, from 0."""
    last = None
    for token in _tokens(found):
        if isinstance(token, yaml.ScalarToken) and token.style in {*_QUOTES}:
            last = (token.start_mark.line, token.start_mark.column)
    return last


def _tokens(found: _Text) -> Iterator[yaml.Token]:
    """The tokens before the place where the parser noticed; none of a text that takes seconds."""
    if len(found.text) > LARGE:
        return
    with contextlib.suppress(yaml.YAMLError):
        for token in yaml.scan(found.text, Loader=Loader):
            if (token.start_mark.line, token.start_mark.column) >= (found.line, found.column):
                break
            yield token


def _bracket(found: _Text) -> Advice | None:
    shown = re.search(r"(?:found|got) '([\]}])'", found.problem)
    here = (found.line + 1, found.column + 1)
    if "flow" not in found.context and "flow" not in found.problem:
        if shown is None:
            return None
        return f"'{shown[1]}' closes a bracket that is not open; remove it, or open one", here
    opened = found.begun or (found.line, found.column)
    bracket = found.lines[opened[0]][opened[1] : opened[1] + 1]
    if bracket not in _PAIRS:
        bracket, opened = _last_open(found)
    close = _PAIRS[bracket]
    if shown is not None:
        return f"'{bracket}' is closed by '{shown[1]}'; close it with '{close}'", here
    if opened[0] == found.line and "scalar" in found.problem:
        return "a comma is missing between two values; add it", here
    return f"'{bracket}' opens here and is not closed; add '{close}'", (
        opened[0] + 1,
        opened[1] + 1,
    )


def _last_open(found: _Text) -> tuple[str, tuple[int, int]]:
    """The innermost bracket that is open at the place, and its line and column, from 0."""
    opened: list[tuple[str, tuple[int, int]]] = []
    for token in _tokens(found):
        start = token.start_mark
        if isinstance(token, yaml.FlowSequenceStartToken | yaml.FlowMappingStartToken):
            bracket = "[" if isinstance(token, yaml.FlowSequenceStartToken) else "{"
            opened.append((bracket, (start.line, start.column)))
        elif isinstance(token, yaml.FlowSequenceEndToken | yaml.FlowMappingEndToken) and opened:
            opened.pop()
    return opened[-1] if opened else ("[", (found.line, found.column))


def _colon(found: _Text) -> Advice | None:
    """A key whose colon, or the blank behind it, is missing: on this line or above."""
    if "simple key" in found.context and found.begun is not None:
        number = found.begun[0]
        message = "no key and no entry of a list; write 'key: value', or '- ' before an entry"
        place = (number + 1, found.indent(number) + 1)
        return _key_line(found, number) or _anywhere_above(found) or (message, place)
    if "mapping values" in found.problem:
        head = found.lines[found.line][: found.column]
        if re.search(r":(\s|$)", head):
            message = "a second colon on one line; put the text in quotes, or begin a new line"
            return message, (found.line + 1, found.column + 1)
        return _anywhere_above(found)
    return None


def _anywhere_above(found: _Text) -> Advice | None:
    """The line above may lack its colon; only that one, the others have been read."""
    return next((a for n in _first(found.before(found.line)) if (a := _key_line(found, n))), None)


def _key_line(found: _Text, number: int) -> Advice | None:
    line = found.lines[number]
    place = (number + 1, found.indent(number) + 1)
    if match := _NO_BLANK.match(line):
        message = (
            f"a blank is missing behind the colon; write '{match['key']}: {_shown(match['value'])}'"
        )
        return message, place
    if match := _OTHER_COLON.match(line):
        return "the colon here, or the blank behind it, is a look-alike; type ': ' anew", place
    if match := _EQUALS.match(line):
        return f"write a colon and a blank instead of '=': '{match['key']}: ...'", place
    if _NO_DASH_BLANK.match(line):
        return "a blank is missing behind the dash; write '- ' before each entry of a list", place
    if match := _NO_COLON.match(line):
        return f"a colon is missing behind '{match['key']}'; write '{match['key']}: ...'", place
    return None


def _indentation(found: _Text) -> Advice | None:
    moved = "block mapping start" in found.problem or "block sequence start" in found.problem
    entry = "'-'" in found.problem or "block entry" in found.problem
    if not (moved or entry or "mapping values" in found.problem):
        return None
    above = next(found.before(found.line), None)
    if above is None:
        return None
    here, there = found.indent(found.line), found.indent(above)
    message = (
        f"this line begins in column {here + 1}, the one above in column {there + 1}; begin all "
        "entries of one list or mapping in the same column"
    )
    return message, (found.line + 1, here + 1)


_IN_QUOTES: Final = "text that begins with '{}' has to be in quotes"
_OTHERS: Final = (
    ("cannot start any token", _IN_QUOTES),
    ("block scalar", "text that begins with '|' or '>' has to be in quotes"),
    ("alias", _IN_QUOTES),
    ("anchor", _IN_QUOTES),
    ("tag", _IN_QUOTES),
    ("sequence entries", "a list with dashes begins on the line below its key; move it there"),
    ("single document", "a second document begins here ('---'); a file has one: remove the line"),
    ("mapping keys", "a question mark begins a key in YAML; put the text in quotes"),
    ("node content", "a value is missing before '{}'; add it, or put all in quotes"),
    (
        "<block end>",
        "this follows a value that is complete; put all in quotes, or begin a new line",
    ),
    ("directive", "this line is no part of a document; remove it, or put its text in quotes"),
    ("document start", "this line is no part of a document; remove it, or put its text in quotes"),
)
"""Parts of a parser's text, and our advice; {} is the character at the place."""


def _other(found: _Text) -> Advice | None:
    character = found.lines[found.line][found.column : found.column + 1] or " "
    reported = f"{found.context} {found.problem}"
    message = next((advice_text for part, advice_text in _OTHERS if part in reported), None)
    if message is None:
        return None
    return message.format(character), (found.line + 1, found.column + 1)


_CHECKS: Final[tuple[Callable[[_Text], Advice | None], ...]] = (
    _tab,
    _foreign_line,
    _quote,
    _bracket,
    _colon,
    _indentation,
    _other,
)
"""The first that recognises the text explains it."""


def _first(lines: Iterator[int]) -> list[int]:
    return [number for _, number in zip(range(1), lines, strict=False)]


def _shown(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."
