"""Values that a person reads otherwise than YAML: decimal commas, degrees with minutes, units.

Each function gives an advice, or "" where nothing is recognised.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Final

_NUMBER: Final = r"[-+]?\d+(?:\.\d*)?"
_COMMA = re.compile(r"([-+]?\d+),(\d+)")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}([.' ])\d{3}(\1\d{3})*(,\d+)?")
_UNIT = re.compile(rf"({_NUMBER})\s*([A-Za-zµ°%'′][\w/²%]*)")  # noqa: RUF001 - feet
_CLOCK = re.compile(r"(\d{1,3}):([0-5]\d)")
_COMMENT = re.compile(rf"({_NUMBER})#.*")
_TWO = re.compile(rf"\(?({_NUMBER})\s*[;, ]\s*({_NUMBER})\)?")
_TWO_COMMAS = re.compile(r"([-+]?\d+),(\d+)\s*[;, ]\s*([-+]?\d+),(\d+)")
_MARK = r"\s*[°º:d\s]\s*"  # between degrees and minutes
_DMS = re.compile(
    r"(?P<first>[NSEWOnsewo]?)\s*(?P<sign>[-+]?)(?P<degrees>\d{1,3}(?:\.\d+)?)"
    rf"(?:{_MARK}(?P<minutes>\d{{1,2}}(?:\.\d+)?)(?:\s*['′’:m\s]\s*(?P<seconds>\d{{1,2}}(?:\.\d+)?))?)?"  # noqa: RUF001 - marks of minutes
    r"\s*[°º'′’\"″”s]*\s*(?P<last>[NSEWOnsewo]?)"  # noqa: RUF001 - marks of seconds
)
_ALIKE: Final = {"−": "-", "–": "-", "—": "-", "‐": "-", "‑": "-", "٫": ".", "․": "."}  # noqa: RUF001 - characters that look alike
_QUOTES: Final = "“”„‟‘’‚«»"  # noqa: RUF001
_IN_OURS: Final = {
    **dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6),
    **dict.fromkeys(("kt", "kts", "kn", "knots"), 0.514444),
    **dict.fromkeys(("ft", "feet", "foot", "'", "′"), 0.3048),  # noqa: RUF001 - feet
    **dict.fromkeys(("min", "mins", "minutes", "minute"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3_600.0),
    "mph": 0.44704,
    "km": 1_000.0,
    "cm": 0.01,
    "ms": 0.001,
    "%": 0.01,
}
"""What units of people are in those of our keys: metres, seconds, metres per second, shares."""

_SHORT: Final = 60  # letters of a text that an advice repeats
_TRUE: Final = {"yes", "y", "on", "ja", "oui", "si"}
_FALSE: Final = {"no", "n", "off", "nein", "non"}
_ENDLESS: Final = {"unlimited", "unl", "inf", "infinite", "infinity", "max"}
_NOTHING: Final = {"none", "nil", "n/a", "na", "no", "off", "-", "nothing"}


def number_advice(text: str) -> str:
    """What to write instead of a text that was to be a number."""
    return next(_number_advice(text, plain(text)), "")


def _number_advice(text: str, bare: str) -> Iterator[str]:
    if _number(bare) and bare != text:
        yield f"it has a character that only looks like the right one; type it anew: {bare}"
    if match := _COMMA.fullmatch(bare):
        yield f"decimals stand behind a point: {match[1]}.{match[2]}"
    if _THOUSANDS.fullmatch(bare):
        yield "write it without thousands separators, and decimals behind a point"
    if (degrees := decimal_degrees(bare)) is not None:
        yield f"write decimal degrees: {degrees}"
    if pair := pair_in(bare):
        yield f"write a comma between the two numbers: {pair}"
    if match := _COMMENT.fullmatch(bare):
        yield f"a comment needs a blank before its '#': {match[1]} #..."
    if match := _CLOCK.fullmatch(bare):
        yield f"write seconds: {60 * int(match[1]) + int(match[2])}"
    if bare.lower() in _ENDLESS:
        yield "leave the key out where there is no limit"
    if match := _UNIT.fullmatch(bare):
        value = float(match[1]) * _IN_OURS.get(match[2].lower(), 1.0)
        yield f"write it without a unit, in the one of the key's name: {float(f'{value:.3g}'):g}"


def mapping_advice(text: str) -> str:
    """What to write instead of a text that was to be a mapping, a place or a list."""
    return next(_mapping_advice(plain(text)), "")


def _mapping_advice(bare: str) -> Iterator[str]:
    if bare.lower() in _NOTHING:
        yield "write null if there is none"
    if "//" in bare:
        yield "a comment begins with '#', not with '//'"
    if pair := pair_in(bare):
        yield f"put the pair in brackets: {pair}"
    if "°" in bare or re.search(r"\d\s*[NSEW]\b|\b[NSEW]\s*\d", bare):
        yield "write decimal degrees in brackets, like [52.4736, 13.4017]"
    if match := re.match(r"([A-Za-z_]\w*):(\S.*)", bare):
        yield f"write a blank behind the colon: '{match[1]}: {match[2]}'"
    if re.match(r"-\S", bare):
        yield "write a blank behind each dash: '- ' begins an entry of a list"


def bool_advice(text: str) -> str:
    """What to write instead of a text that was to be true or false."""
    entry = plain(text).lower()
    return "write true" if entry in _TRUE else "write false" if entry in _FALSE else ""


def list_advice(text: str) -> str:
    """What to write instead of a text that was to be a list."""
    known = mapping_advice(text)
    return known or f"a list stands in brackets: [{text}]" if len(text) <= _SHORT else known


def key_advice(key: str) -> str:
    """What is wrong with an unknown key."""
    bare = plain(key)
    if bare != key:
        hidden = "it has hidden or look-alike characters (as web pages and word processors write)"
        return f"{hidden}; type it anew: '{bare}', behind plain blanks"
    if match := re.fullmatch(r"([A-Za-z_]\w*):(\S+)", key):
        return f"write a blank behind the colon: '{match[1]}: {match[2]}'"
    if _number(key):
        return "a number is no key; a pair stands in brackets, [1.5, 2], decimals behind a point"
    return ""


def pair_advice(entries: Sequence[str]) -> str:
    """Advice for a pair of numbers that was written with more entries."""
    joined = ",".join(entry.strip() for entry in entries)
    if match := _TWO_COMMAS.fullmatch(joined):
        return f"decimals stand behind a point: [{match[1]}.{match[2]}, {match[3]}.{match[4]}]"
    if len(entries) == 3:
        first, second, third = entries
        if _whole(first) and _digits(second) and not _whole(third) and _number(third):
            return f"decimals stand behind a point: [{first}.{second}, {third}]"
        if not _whole(first) and _number(first) and _whole(second) and _digits(third):
            return f"decimals stand behind a point: [{first}, {second}.{third}]"
        if all(map(_number, entries)):
            return f"a place is two numbers: an altitude ({third}?) has a key of its own"
    return ""


def plain(text: str) -> str:
    """A text with plain characters for similar ones, and without invisible ones."""
    kept = "".join(
        " " if unicodedata.category(each) == "Zs" else _ALIKE.get(each, each)
        for each in text
        if unicodedata.category(each) != "Cf"
    )
    return kept.strip(_QUOTES).strip()


def decimal_degrees(text: str) -> str | None:
    """What degrees with minutes, seconds or a hemisphere are in decimals; None if it is none."""
    match = _DMS.fullmatch(text.strip())
    if match is None:
        return None
    hemisphere = (match["first"] or match["last"]).upper()
    marked = re.search(r"[°º'′’\"″”]", text) is not None  # noqa: RUF001 - marks of minutes
    if match["first"] and match["last"]:
        return None
    if not (hemisphere or marked or match["seconds"]):
        return None
    degrees = float(match["degrees"])
    degrees += float(match["minutes"] or 0) / 60 + float(match["seconds"] or 0) / 3_600
    negative = match["sign"] == "-" or hemisphere in {"S", "W"}
    return f"{-degrees if negative else degrees:.7f}".rstrip("0").rstrip(".")


def pair_in(text: str) -> str:
    """Two numbers in a text, as a pair in brackets."""
    if match := _TWO_COMMAS.fullmatch(text):
        return f"[{match[1]}.{match[2]}, {match[3]}.{match[4]}]"
    match = _TWO.fullmatch(text)
    return "" if match is None else f"[{match[1]}, {match[2]}]"


def _number(text: str) -> bool:
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)", text) is not None


def _whole(text: str) -> bool:
    return re.fullmatch(r"[-+]?\d+", text) is not None


def _digits(text: str) -> bool:
    return re.fullmatch(r"\d+", text) is not None
