"""Explains why a text is not JSON, to the person who wrote or exported it."""

import re
import unicodedata
from collections.abc import Callable
from json import JSONDecodeError
from typing import Final

_AGAIN: Final = "save the file again with the program that made it"
_COMMENT = re.compile(r"//|/\*|#")
_WORDS: Final = {
    "True": "true",
    "False": "false",
    "None": "null",
    "undefined": "null",
    "NULL": "null",
    "Null": "null",
    "TRUE": "true",
    "FALSE": "false",
}
_MESSAGES: Final = {
    "Expecting value": "a value is missing here: a number, text in double quotes, true or null",
    "property name": "a key in double quotes is missing here",
    "',' delimiter": "a comma is missing before this; add it",
    "':' delimiter": "a colon is missing behind the key; add it",
    "Extra data": "the file goes on behind its last bracket; remove the rest",
    "escape": "a backslash begins an escape in JSON; write \\\\, or / in paths",
}
"""Parts of the standard library's messages, and their meanings."""

_WORD = re.compile(r"[A-Za-z_$][\w$]*")
_CURLY: Final = "“”„‘’«»"  # noqa: RUF001 - quotes of word processors
_NEXT = re.compile(r"[ \t\r\n]*")
_MARKUP = re.compile(r"\s*<(!doctype html|html|\?xml)", re.IGNORECASE)


def json_mistake(error: JSONDecodeError) -> tuple[int, str]:
    """At which character a text is wrong, and what: the first of the mistakes that fits."""
    text, at = error.doc, error.pos
    if not text.strip():
        return 0, f"the file is empty; {_AGAIN}"
    if match := _MARKUP.match(text):
        kind = "a web page" if "html" in match[1].lower() else "XML"
        return match.end() - len(match[1]) - 1, f"this is {kind}, no JSON; download the file again"
    for search in _SEARCHES:
        found = search(error, text, at)
        if found is not None:
            return found
    return at, f"cannot be read as JSON from here on; {_AGAIN}"


def _cut_off(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    if text[at:].strip() and not error.msg.startswith("Unterminated"):
        return None
    if error.msg.startswith("Unterminated"):
        return at, "a quote opens here and is not closed; close it, or copy the whole file again"
    return at, f"the file ends too early, as if cut off; copy the whole file again, or {_AGAIN}"


def _comment(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    del error
    if _COMMENT.match(text, begin):
        return begin, "JSON has no comments; remove it"
    return None


def _trailing_comma(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    before = len(text[:at].rstrip()) - 1
    after = text[_behind_blanks(text, at) :][:1]
    if "trailing comma" in error.msg:  # as Python 3.13 and later report it
        before = at
        after = text[_behind_blanks(text, at + 1) :][:1]
    if text[before : before + 1] == "," and after in {"]", "}"}:
        return before, f"a comma before '{after}'; remove it (JSON has none behind the last entry)"
    return None


def _hidden(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    del error
    if unicodedata.category(text[begin : begin + 1] or "x") in {"Zs", "Cf", "Cc", "Zl", "Zp"}:
        return begin, "a character that is not seen (as web pages have them); remove it"
    return None


def _quotes(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    del error
    character = text[begin : begin + 1]
    if character == "'":
        return begin, "text stands in double quotes in JSON, not in single ones; replace them"
    if character in _CURLY:
        return begin, "a quote of a word processor; replace all of them with straight ones"
    return None


def _word(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    match = _WORD.match(text, begin)
    if match is None:
        return None
    if match[0] in _WORDS:
        return begin, f"'{match[0]}' is not valid in JSON; write {_WORDS[match[0]]}"
    if "property name" in error.msg:
        return begin, f"the key '{match[0][:40]}' has to be in double quotes"
    if begin == 0:
        return begin, "text before the first bracket; remove it"
    return None


def _number(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    rest = text[begin : begin + 1]
    if rest in {"+", "."} and error.msg.startswith("Expecting value"):
        return begin, f"a number of JSON does not begin with '{rest}'; write it like 0.5 or 8.5"
    if rest.isdigit() and text[begin - 1 : begin] == "0" and begin == at:
        return (
            begin - 1,
            "a number begins with 0; remove it, or write a point if the comma before is one",
        )
    if rest in {"°", "º"}:
        return begin, "degrees, minutes and seconds are not read; write decimal degrees, like 8.5"
    if rest == ";":
        return begin, "JSON separates entries with commas; replace the semicolon"
    return None


def _delimiter(error: JSONDecodeError, text: str, at: int) -> tuple[int, str] | None:
    begin = _behind_blanks(text, at)
    character = text[begin : begin + 1]
    if "',' delimiter" in error.msg and character in {"]", "}"}:
        return begin, f"'{character}' closes another bracket than the one that is open"
    if "Extra data" in error.msg and character == "{":
        return begin, "a second object begins here; put both into one FeatureCollection"
    if "control character" in error.msg:
        return at, "a line break or tab within quotes; close the quote, or write \\n or \\t"
    found = ((begin, text) for part, text in _MESSAGES.items() if part in error.msg)
    return next(found, None)


_SEARCHES: Final[tuple[Callable[[JSONDecodeError, str, int], tuple[int, str] | None], ...]] = (
    _trailing_comma,
    _comment,
    _cut_off,
    _hidden,
    _quotes,
    _word,
    _number,
    _delimiter,
)


def _behind_blanks(text: str, at: int) -> int:
    match = _NEXT.match(text, at)
    return match.end() if match else at
