"""The altitude limits of zones in files, and beside them clearances and hours.

Map programs have properties with the names of the mission file. Aviation writes limits in feet and
flight levels, above the sea or the ground below: OpenAir as text, openAIP and the FAA as properties
of GeoJSON. Anything uncertain makes a zone taller, never lower, and is noted.
"""

import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final

from pydantic import ValidationError

from air_router.files import (
    NUMBER,
    AltitudeLimit,
    Altitudes,
    Keys,
    Reference,
    TermsForm,
    ZoneTerms,
    is_number,
    value_at,
)
from air_router.files.maps.property_names import (
    DATUMS,
    ENDLESS,
    GROUND_NAMES,
    LEVEL,
    LIMIT_NAMES,
    METRES_PER_UNIT,
    OF_DIALECTS,
    OF_LIMITS,
    PARTS,
    SIDES,
    UNITS,
    VALUES,
)
from air_router.files.maps.zone_format import MAX_ALTITUDE_M, ZoneFeature
from mocha_link.team import code_of, text_of_error

UNCLEAR: Final = "unclear-altitude"

_TEXT = re.compile(
    r"(?P<level>FL)?\s*(?P<value>-?[0-9]{1,9}(\.[0-9]{1,9})?)\s*"
    r"(?:(?P<unit>FT|FEET|F|M)(?=\s|$|A|MSL|GND|SFC|STD))?\s*(?P<datum>[A-Z]+)?"
)
_LONGEST_TEXT: Final = 40
_COLDEST, _LOWEST_M = 0.9, 600.0
"""A flight level lies no lower than this part of its height, less what low pressure takes."""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_POINTS: Final = " .,;\u00b7"  # behind limits in text
_DEEPEST: Final = 6
_SAME_M: Final = 0.01
_NO_VALUE: Final = -9990.0
"""The FAA writes -9998 where there is none."""

Note = Callable[[Keys, str, str], None]
"""Takes the keys of a property, the message, and the code."""


def terms_of(
    properties: Mapping[str, Any], feature: ZoneFeature, place: Callable[[Keys], Keys]
) -> ZoneTerms:
    """The terms in the properties of a zone.

    Args:
        properties: Of one zone.
        feature: Takes problems and notes.
        place: Where a property stands, by the way to it.
    """

    def note(keys: Keys, message: str, code: str) -> None:
        feature.note(place(keys), message, code)

    given = {name: value for name, value in properties.items() if value is not None}
    read: set[Keys] = set()
    if _in_metres(given):
        read = {(side,) for side in SIDES if f"{side}_m" not in given}
        given = {f"{side}_m": given[side] for side in SIDES if side in given} | given
    if isinstance(given.get("active"), dict):
        given["active"] = [given["active"]]
    known = {name: given[name] for name in TermsForm.model_fields if name in given}
    try:
        terms = TermsForm.model_validate_json(json.dumps(known), strict=True).terms()
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            name, *inner = detail["loc"]
            keys = (*place((str(name),)), *inner)
            feature.report(keys, text_of_error(detail, TermsForm), code_of(detail))
        return ZoneTerms()
    if not any(name.startswith(SIDES) for name in known):
        return replace(terms, altitudes=limits_in_properties(properties, note))
    note_unread(properties, read | {(name,) for name in known}, note, terms.altitudes)
    return terms


def _in_metres(given: Mapping[str, Any]) -> bool:
    """Whether `lower` and `upper` are our own: metres, with none of another dialect's names."""
    others = {_bare(name) for name in given if name not in TermsForm.model_fields}
    return others.isdisjoint(OF_DIALECTS) and all(
        is_number(given[side]) for side in SIDES if side in given
    )


def limit_in_text(
    text: str, *, upper: bool, unit: str = "FT", datum: str = "MSL"
) -> AltitudeLimit | None:
    """A limit like `3500ft MSL`, `FL95`, `1000 AGL`, `SFC` or `UNL`; None: without limit.

    Unit and datum are those of a text without them: as OpenAir has it, or "" for none.

    Raises:
        ValueError: the message has what is uncertain, and how the zone is read.
    """
    level = text.strip().upper()
    if level in ENDLESS or level in GROUND_NAMES:
        return _limit(0.0, "FT", "GND", upper=upper) if level in GROUND_NAMES else None
    match = _TEXT.fullmatch(level) if len(level) <= _LONGEST_TEXT else None
    if match is None:
        raise ValueError(f"{text[:40]!r} is no altitude: read as without limit")
    if match["level"]:
        return _limit(float(match["value"]), LEVEL, "STD", upper=upper)
    return _limit(
        float(match["value"]), match["unit"] or unit, match["datum"] or datum, upper=upper
    )


def limits_in_properties(properties: Mapping[str, Any], note: Note) -> Altitudes | None:
    """The limits in properties of openAIP, the FAA or of geozones; None: there are none.

    They may stand in an object of the properties, as Spain's do, or several times, as Estonia's.
    What may be a limit and is not understood is noted.
    """
    read: set[Keys] = set()
    answer: Altitudes | None = None
    for number, way in enumerate(_ways_to_limits(properties)):
        notes: list[tuple[Keys, str, str]] = []
        altitudes, ways = _of_layer(value_at(properties, way), way, lambda *n: notes.append(n))  # noqa: B023
        if number == 0:
            answer, read = altitudes, read | ways
            for each in notes:
                note(*each)
        elif not notes and altitudes == answer:  # the same once more
            read |= ways
    if properties.get("CEILING") is not None:
        read.add(("CEILING",))
        message = (
            f"'CEILING' {properties['CEILING']!s:.20}: up to there the FAA may authorise a flight; "
            "read as from the ground up. With an authorisation, give the zone 'lower_m'"
        )
        note(("CEILING",), message, UNCLEAR)
    note_unread(properties, read, note, answer)
    return answer


def _of_layer(
    layer: Mapping[str, Any], way: Keys, note: Note
) -> tuple[Altitudes | None, set[Keys]]:
    """The limits in an object, and the keys of all values that give them."""
    names = {_bare(name): name for name in list(layer)[::-1]}
    read: set[Keys] = set()
    found: list[AltitudeLimit | None] = []
    for side in SIDES:
        given = (names[side + end] for end in VALUES if _given(layer, names, side + end))
        name, description = next(given, None), names.get(f"{side}desc")
        parts = [next((names[key] for key in keys if key in names), None) for keys in PARTS[side]]
        read |= {(*way, part) for part in (name, description, *parts) if part is not None}
        unit, datum = (None if part is None else layer[part] for part in parts)
        endless = description is not None and str(layer[description]).upper() in ENDLESS
        try:
            value = None if name is None or endless else layer[name]
            found.append(_of_value(value, unit, datum, side))
        except ValueError as error:
            note((*way, str(name)), f"'{name}': {error}", UNCLEAR)
            found.append(None)
    upper, lower = found
    return Altitudes(lower, upper) if lower or upper else None, read


def note_unread(
    properties: Any, read: Collection[Keys], note: Note, known: Altitudes | None = None
) -> None:
    """Note all that may be a limit and was not read, wherever it stands in the properties.

    Args:
        properties: Of a zone.
        read: The ways to what was.
        note: Takes the notes.
        known: The zone's limits: the same values in metres need no note.
    """
    limits = (known.lower, known.upper) if known is not None else ()
    metres = [0.0 if limit is None else limit.metres for limit in limits]
    for way, name, value in _leaves(properties, ()):
        if way in read or not may_be_limit(name):
            continue
        if is_number(value) and any(abs(value - each) < _SAME_M for each in metres):
            continue
        message = f"'{name}' may be an altitude limit and is not read: write 'lower_m' or 'upper_m'"
        note(way, message, UNCLEAR)


def _leaves(properties: Any, way: Keys) -> Iterator[tuple[Keys, str, Any]]:
    """All that stands in properties, with the way to it and the name of it or of its list."""
    items = properties.items() if isinstance(properties, dict) else enumerate(properties)
    for key, value in items:
        if isinstance(value, dict | list):
            if value and len(way) < _DEEPEST:
                yield from _leaves(value, (*way, key))
        elif value is not None and value != "" and not isinstance(value, bool):
            named = (
                key
                if isinstance(key, str)
                else next((k for k in reversed(way) if isinstance(k, str)), "")
            )
            yield (*way, key), str(named), value


@lru_cache(maxsize=4096)
def may_be_limit(name: str) -> bool:
    """Whether a property's name may mean an altitude limit."""
    return not LIMIT_NAMES.isdisjoint(part.lower() for part in _WORD.findall(name))


@lru_cache(maxsize=4096)
def _bare(name: str) -> str:
    """A name without what dialects write in different ways."""
    return name.replace("_", "").lower()


def _given(layer: Mapping[str, Any], names: Mapping[str, str], key: str) -> bool:
    return key in names and layer[names[key]] not in (None, "")


def _ways_to_limits(properties: Mapping[str, Any]) -> list[Keys]:
    """The ways to objects among a zone's properties that have limits, the nearest first."""
    ways: list[Keys] = [()]
    found = []
    for way in ways:
        layer = value_at(properties, way)
        if not OF_LIMITS.isdisjoint(map(_bare, layer)):
            found.append(way)
        if len(way) < _DEEPEST:
            ways += [(*way, name) for name, inner in layer.items() if isinstance(inner, dict)]
    return found


def _of_value(value: Any, unit: Any, datum: Any, side: str) -> AltitudeLimit | None:
    """A limit given as number or text with the unit and reference beside it, or as an object."""
    if isinstance(value, dict):
        value, unit, datum = (value.get(part) for part in ("value", "unit", "referenceDatum"))
    if value is None:
        return None
    units, datums = ("" if each is None else str(each).strip() for each in (unit, datum))
    if isinstance(value, str) and not NUMBER.fullmatch(value.strip()):
        return limit_in_text(value.strip(_POINTS), upper=side == "upper", unit=units, datum=datums)
    if not (units or datums) and str(value).strip() in GROUND_NAMES:
        return _limit(0.0, "FT", "GND", upper=side == "upper")
    number = float(value) if NUMBER.fullmatch(str(value).strip()) else math.nan
    if number <= _NO_VALUE:
        return None
    return _limit(number, units, datums, upper=side == "upper")


def _limit(value: float, unit: str, datum: str, *, upper: bool) -> AltitudeLimit | None:
    known, reference = UNITS.get(unit.upper()), DATUMS.get(datum.upper(), Reference.HOME)
    if not math.isfinite(value) or known is None or reference is Reference.HOME:
        text = " ".join(filter(None, (f"{value:g}", unit[:10], datum[:10])))
        raise ValueError(f"{text} is no altitude: read as without limit")
    metres = value * (100 * METRES_PER_UNIT["FT"] if known == LEVEL else METRES_PER_UNIT[known])
    level = known == LEVEL or reference is None
    if level and upper:
        raise ValueError("a flight level depends on the day's pressure: read as without end")
    if level or reference is None:
        metres, reference = metres * _COLDEST - _LOWEST_M, Reference.AMSL
    if (not upper and metres <= 0) or abs(metres) > MAX_ALTITUDE_M:
        return None  # from the ground up, or beyond all flight
    if upper and reference is Reference.GROUND and metres <= 0:
        raise ValueError("it ends at the ground: read as without end")
    return AltitudeLimit(metres, reference)
