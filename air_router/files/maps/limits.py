"""What files say of a zone's altitudes, and beside that of its clearance and hours.

Map programs have properties with the names of the mission file. Aviation writes limits in feet and
flight levels, above the sea or the ground below: OpenAir as text, openAIP and the FAA as properties
of GeoJSON. What is not certain makes a zone taller, never lower, and is told.
"""

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from pydantic import ValidationError

from air_router.files.json_document import NUMBER
from air_router.files.maps.zone_reading import MAX_ALTITUDE_M, ZoneReading
from air_router.files.mission_document import Keys
from air_router.files.zone_terms import AltitudeLimit, Altitudes, Reference, TermsForm, ZoneTerms
from mocha_link.team.error_text import code_of, error_text

UNCLEAR: Final = "unclear-altitude"

METRES_PER_UNIT: Final = {"M": 1.0, "FT": 0.3048}
"""As ED-269 and ED-318 write units; FL, hundreds of feet at standard pressure, is one apart."""

_LEVEL = "FL"
_UNITS: Final = {  # numbers: openAIP's
    **dict.fromkeys(("M", "METER", "METERS", "METRE", "METRES", "0"), "M"),
    **dict.fromkeys(("FT", "F", "FEET", "FOOT", "1"), "FT"),
    **dict.fromkeys(("FL", "6"), _LEVEL),
}
_DATUMS: Final = {
    **dict.fromkeys(("GND", "AGL", "ASFC", "SFC", "GROUND", "SURFACE", "0"), Reference.GROUND),
    **dict.fromkeys(("MSL", "AMSL", "ALT", "1"), Reference.AMSL),
    **dict.fromkeys(("STD", "2"), None),
}
_TEXT = re.compile(
    r"(?P<level>FL)?\s*(?P<value>-?[0-9]{1,9}(\.[0-9]{1,9})?)\s*"
    r"(?:(?P<unit>FT|FEET|F|M)(?=\s|$|A|MSL|GND|SFC|STD))?\s*(?P<datum>[A-Z]+)?"
)
_LONGEST_TEXT: Final = 40
_GROUND_WORDS: Final = frozenset({"GND", "SFC", "GROUND", "SURFACE", "0"})
_ENDLESS: Final = ("UNL", "UNLD", "UNLTD", "UNLIM", "UNLIMITED")

_COLDEST, _LOWEST_M = 0.9, 600.0
"""A flight level lies no lower than this part of its height, less what low pressure takes."""

_NAMES: Final = ("upperLimit", "upperCeiling"), ("lowerLimit", "lowerCeiling")
_MAY_BE_LIMIT = re.compile(
    r"upper|lower|ceiling|floor|altitude|height|(max|min)_?alt", re.IGNORECASE
)
_FAA_PARTS: Final = ("VAL", "UOM", "CODE", "DESC")
_NO_VALUE: Final = -9990.0
"""The FAA writes -9998 where there is none."""


def terms_of(
    properties: Mapping[str, Any], reading: ZoneReading, place: Callable[[str], Keys]
) -> ZoneTerms:
    """The terms in the properties of a zone.

    Args:
        properties: Of one zone.
        reading: Takes problems and notes.
        place: Where a property stands, by its name.
    """

    def note(name: str, message: str, code: str) -> None:
        reading.note(place(name), message, code)

    given = {name: value for name, value in properties.items() if value is not None}
    for side in ("lower", "upper"):
        if side in given:
            given.setdefault(f"{side}_m", given[side])
    if isinstance(given.get("active"), dict):
        given["active"] = [given["active"]]
    known = {name: given[name] for name in TermsForm.model_fields if name in given}
    try:
        terms = TermsForm.model_validate_json(json.dumps(known), strict=True).terms()
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            name, *inner = detail["loc"]
            keys = (*place(str(name)), *inner)
            reading.report(keys, error_text(detail, TermsForm), code_of(detail))
        return ZoneTerms()
    if not any(name.startswith(("lower", "upper")) for name in known):
        return replace(terms, altitudes=limits_in_properties(properties, note))
    return terms


def limit_in_text(
    text: str, *, upper: bool, unit: str = "FT", datum: str = "MSL"
) -> AltitudeLimit | None:
    """A limit like `3500ft MSL`, `FL95`, `1000 AGL`, `SFC` or `UNL`; None: without limit.

    Unit and datum are those of a text that does not say them: as OpenAir has it, or "" for none.

    Raises:
        ValueError: what is not certain, and how the zone is read therefore.
    """
    words = text.strip().upper()
    if words in _ENDLESS or words in _GROUND_WORDS:
        return _limit(0.0, "FT", "GND", upper=upper) if words in _GROUND_WORDS else None
    match = _TEXT.fullmatch(words) if len(words) <= _LONGEST_TEXT else None
    if match is None:
        raise ValueError(f"{text[:40]!r} is no altitude: read as without limit")
    if match["level"]:
        return _limit(float(match["value"]), _LEVEL, "STD", upper=upper)
    return _limit(
        float(match["value"]), match["unit"] or unit, match["datum"] or datum, upper=upper
    )


def limits_in_properties(
    properties: Mapping[str, Any], note: Callable[[str, str, str], None]
) -> Altitudes | None:
    """The limits in properties of openAIP or the FAA; None: there are none.

    What may be a limit and is not understood is noted: name of the property, message, code.
    """
    read: set[str] = set()
    found: list[AltitudeLimit | None] = []
    for names, side in zip(_NAMES, ("UPPER", "LOWER"), strict=True):
        name = next((name for name in names if properties.get(name) is not None), f"{side}_VAL")
        read |= {*names, *(f"{side}_{part}" for part in _FAA_PARTS)}
        try:
            found.append(_of_properties(properties, name, side))
        except ValueError as error:
            note(name, f"'{name}': {error}", UNCLEAR)
            found.append(None)
    if properties.get("CEILING") is not None:
        read.add("CEILING")
        message = (
            f"'CEILING' {properties['CEILING']!s:.20}: up to there the FAA may authorise a flight; "
            "read as from the ground up. With an authorisation, give the zone 'lower_m'"
        )
        note("CEILING", message, UNCLEAR)
    for name in properties.keys() - read:
        if _MAY_BE_LIMIT.search(name) and properties[name] not in (None, ""):
            message = (
                f"'{name}' may be an altitude limit and is not read: write 'lower_m' or 'upper_m'"
            )
            note(name, message, UNCLEAR)
    upper, lower = found
    return Altitudes(lower, upper) if lower or upper else None


def _of_properties(properties: Mapping[str, Any], name: str, side: str) -> AltitudeLimit | None:
    value = properties.get(name)
    if isinstance(value, dict):
        parts = [value.get(part) for part in ("value", "unit", "referenceDatum")]
    elif name == f"{side}_VAL":
        parts = [properties.get(f"{side}_{part}") for part in ("VAL", "UOM", "CODE")]
        if str(properties.get(f"{side}_DESC")).upper() in _ENDLESS:
            return None
    else:
        return limit_in_text(str(value), upper=side == "UPPER", unit="", datum="")
    if parts[0] is None:
        return None
    number = float(parts[0]) if NUMBER.fullmatch(str(parts[0])) else math.nan
    if number <= _NO_VALUE:
        return None
    return _limit(number, str(parts[1]), str(parts[2]), upper=side == "UPPER")


def _limit(value: float, unit: str, datum: str, *, upper: bool) -> AltitudeLimit | None:
    known, reference = _UNITS.get(unit.upper()), _DATUMS.get(datum.upper(), Reference.HOME)
    if not math.isfinite(value) or known is None or reference is Reference.HOME:
        words = " ".join(filter(None, (f"{value:g}", unit[:10], datum[:10])))
        raise ValueError(f"{words} is no altitude: read as without limit")
    metres = value * (100 * METRES_PER_UNIT["FT"] if known == _LEVEL else METRES_PER_UNIT[known])
    level = known == _LEVEL or reference is None
    if level and upper:
        raise ValueError("a flight level depends on the day's pressure: read as without end")
    if level or reference is None:
        metres, reference = metres * _COLDEST - _LOWEST_M, Reference.AMSL
    if (not upper and metres <= 0) or abs(metres) > MAX_ALTITUDE_M:
        return None  # from the ground up, or beyond all flight
    if upper and reference is Reference.GROUND and metres <= 0:
        raise ValueError("it ends at the ground: read as without end")
    return AltitudeLimit(metres, reference)
