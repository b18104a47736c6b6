"""What zones in files have in common: where they lie in degrees, how tall, when, and their place.

Formats differ in their words; readers of JSON formats share how positions and rings are checked.
"""

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeGuard

from air_router.counted import counted
from air_router.files.altitudes import Altitudes
from air_router.files.json_document import JsonDocument, value_at
from air_router.files.mission_document import DocumentSource, Keys
from geo.frame import Geodetic
from geo.validity import Validity
from mocha_link.sanitize import sanitize
from mocha_link.team.problem import Problem, ProblemList

MAX_RADIUS_M = 1_000_000.0
MAX_ALTITUDE_M = 100_000.0
MAX_CORNERS = 20_000

_NUMBER = re.compile(r"-?[0-9]{1,9}(\.[0-9]{1,9})?")

MapRing = tuple[Geodetic, ...]
"""The corners of an outline in degrees; the last one joins the first."""


@dataclass(frozen=True, slots=True)
class MapOutline:
    """An area on the map with holes in it."""

    ring: MapRing
    holes: tuple[MapRing, ...] = ()


@dataclass(frozen=True, slots=True)
class MapCircle:
    """A circle on the map."""

    centre: Geodetic
    radius_m: float


@dataclass(frozen=True, slots=True)
class ZoneTerms:
    """How far, how high and when a zone is to be kept away from."""

    clearance_m: float | None = None  # None: the mission's
    altitudes: Altitudes | None = None
    validity: Validity | None = None


@dataclass(frozen=True, slots=True)
class FileZone:
    """A no-fly zone as a file has it.

    Attributes:
        name: What the file calls it.
        shape: Where it is, in degrees.
        source: The file.
        keys: Where the zone stands in it.
        clearance_m: What to keep away from it; None: what the mission keeps from all.
        altitudes: Where it applies; None: at every altitude.
        validity: When it applies; None: always.
    """

    name: str
    shape: MapOutline | MapCircle
    source: DocumentSource
    keys: Keys
    clearance_m: float | None = None
    altitudes: Altitudes | None = None
    validity: Validity | None = None

    @property
    def place(self) -> tuple[int, int]:
        """Line and column of the zone in its file."""
        here = self.source.problem(self.keys, "", "")
        return here.line, here.column


@dataclass(slots=True)
class ZoneReading:
    """What has been read from a file so far.

    Attributes:
        source: The file.
        kind: Its format, in words.
        zones: Its zones.
    """

    source: DocumentSource
    kind: str
    zones: list[FileZone] = field(default_factory=list)
    _problems: ProblemList = field(default_factory=ProblemList)  # the first of each kind
    _notes: ProblemList = field(default_factory=ProblemList)  # the first of each kind

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with it: the first of each kind, and how many more there are."""
        return list(self._problems)

    @property
    def notes(self) -> list[Problem]:
        """What was left out or read with caution, though nothing is wrong with it."""
        return list(self._notes)

    @property
    def path(self) -> Path:
        """The file."""
        return self.source.path

    def report(self, keys: Keys, message: str, code: str) -> None:
        """Note a problem."""
        self._problems.add(self.path, code, lambda: self.source.problem(keys, message, code))

    def note(self, keys: Keys, message: str, code: str) -> None:
        """Note what the operator should know."""
        self._notes.add(self.path, code, lambda: self.source.problem(keys, message, code))

    def report_place(
        self, keys: Keys, message: str, longitude_deg: float, latitude_deg: float
    ) -> None:
        """Note a place that is not on Earth, or would be with its numbers exchanged."""
        swapped = abs(longitude_deg) <= 90 and abs(latitude_deg) <= 180
        advice = "exchange them (longitude comes first)" if swapped else "correct it"
        self.report(keys, f"{message}; {advice}", "not-on-earth")

    def ring(self, places: list[Geodetic], keys: Keys) -> MapRing | None:
        """Corners as a ring; None, with a problem noted, if they are too few or too many."""
        if len(places) > 1 and places[0] == places[-1]:
            places = places[:-1]
        different = len(set(places))
        if different < 3:
            message = f"a ring has {different} different corners, an area needs 3; draw it again"
            self.report(keys, message, "zone-too-few-corners")
            return None
        if len(places) > MAX_CORNERS:
            message = (
                f"a ring of {len(places)} corners, at most {MAX_CORNERS} are read; simplify it"
            )
            self.report(keys, message, "too-large")
            return None
        return tuple(places)

    def add(
        self,
        name: str,
        shapes: Sequence[tuple[Keys, MapOutline | MapCircle]],
        terms: ZoneTerms,
    ) -> None:
        """Add a zone; one of several shapes becomes as many, with a number behind the name."""
        name = sanitize(name)
        for number, (keys, shape) in enumerate(shapes, start=1):
            numbered = name if len(shapes) == 1 else f"{name}, part {number}"
            kept = terms.clearance_m, terms.altitudes, terms.validity
            self.zones.append(FileZone(numbered, shape, self.source, keys, *kept))


class AllowedZones:
    """The kinds and names of zones that the operator may fly in, and which zones these are."""

    def __init__(self, words: Collection[str]) -> None:
        self._words = {_british(word): word for word in words}  # as the operator wrote them
        self._used: set[str] = set()  # those that a zone is of
        self._zones: list[str] = []  # names of those left out

    def takes(self, zone: str, *words: str) -> bool:
        """Whether one of these words, which say what a zone is, is among those allowed."""
        matches = set(map(_british, words)) & self._words.keys()
        if matches:
            self._used |= matches
            self._zones.append(zone)
        return bool(matches)

    def tell(self, reading: ZoneReading, kinds: str) -> None:
        """Note which zones were left out, and which words are none of the file's `kinds`."""
        if zones := self._zones:
            shown = ", ".join(zones[:10]) + (" ..." if len(zones) > 10 else "")
            message = f"{counted(len(zones), 'zones')} that you allow: left out ({shown})"
            reading.note((), message, "zone-allowed")
        for unused in sorted(self._words.keys() - self._used):
            message = f"no zone is of {kinds} '{self._words[unused][:40]}'"
            reading.note((), message, "allow-unused")


def _british(word: str) -> str:
    """ED-269 writes AUTHORISATION, ED-318 AUTHORIZATION."""
    return word.upper().replace("AUTHORIZATION", "AUTHORISATION")


class JsonReader:
    """Reads values of a JSON document, noting what is wrong with them."""

    def __init__(self, document: JsonDocument, kind: str) -> None:
        self.document = document
        self.reading = ZoneReading(document, kind)

    def at(self, *keys: str | int) -> Any:
        """The value at a key path, None if there is none."""
        return value_at(self.document.data, keys)

    def entries(self, keys: Keys, what: str) -> list[Any]:
        """A list; empty, with a problem noted, if it is something else."""
        value = self.at(*keys)
        if isinstance(value, list):
            return value
        self.wrong(keys, f"{what} must be a list")
        return []

    def number(
        self, keys: Keys, what: str, lowest: float, highest: float, *, in_text: bool = False
    ) -> float | None:
        """A number in a range; None, with a problem noted, if it is something else.

        With `in_text` it may stand in quotes.
        """
        value = self.at(*keys)
        if in_text and isinstance(value, str) and _NUMBER.fullmatch(value):
            value = float(value)
        if not is_number(value):
            self.wrong(keys, f"{what} must be a number")
            return None
        if not lowest <= value <= highest:
            message = f"{what} must be from {lowest:g} to {highest:g}, found {value:.10g}"
            self.reading.report(keys, f"{message}; correct it", "out-of-range")
            return None
        return float(value)

    def choice(self, keys: Keys, what: str, choices: Mapping[str, Any]) -> Any:
        """What one of these words (in capitals or not) stands for; None, with a problem noted."""
        value = self.at(*keys)
        if isinstance(value, str) and value.upper() in choices:
            return choices[value.upper()]
        self.wrong(keys, f"{what} must be one of {', '.join(choices)}")
        return None

    def position(self, keys: Keys) -> Geodetic | None:
        """A place given as [longitude, latitude], perhaps with an altitude behind."""
        value = self.at(*keys)
        place = _place(value)
        if place is not None:
            return place
        if not isinstance(value, list) or len(value) < 2:
            self.wrong(keys, "a place must be [longitude, latitude]")
            return None
        if not (is_number(value[0]) and is_number(value[1])):
            self.wrong(keys, "a place must be two numbers, [longitude, latitude]")
            return None
        message = f"there is no longitude {value[0]:.10g}, latitude {value[1]:.10g}"
        self.reading.report_place(keys, message, float(value[0]), float(value[1]))
        return None

    def outline(self, keys: Keys) -> MapOutline | None:
        """A polygon's rings, the first around it, the others around its holes."""
        rings = [
            self._ring((*keys, index))
            for index in range(len(self.entries(keys, "a polygon's coordinates")))
        ]
        if not rings and self.at(*keys) == []:
            self.reading.report(
                keys, "a polygon without a ring; draw it again", "zone-too-few-corners"
            )
        first, *holes = rings or [None]
        read = tuple(hole for hole in holes if hole is not None)
        return MapOutline(first, read) if first and len(read) == len(holes) else None

    def circle(self, keys: Keys, radius_keys: Keys) -> MapCircle | None:
        """A place and a radius in metres."""
        centre = self.position(keys)
        radius_m = self.number(radius_keys, "the radius in metres", 0.001, MAX_RADIUS_M)
        return None if centre is None or radius_m is None else MapCircle(centre, radius_m)

    def wrong(self, keys: Keys, message: str) -> None:
        """Report about a value of the wrong kind, or its absence."""
        value = self.at(*keys)
        found = "nothing" if value is None else json.dumps(value, ensure_ascii=False)[:40]
        code = "missing-key" if value is None else "wrong-type"
        self.reading.report(keys, f"{message}, found {found}; correct it", code)

    def _ring(self, keys: Keys) -> MapRing | None:
        values = self.entries(keys, "a polygon's ring")
        ring = [place for place in map(_place, values) if place is not None]
        if len(ring) < len(values) or not isinstance(self.at(*keys), list):
            for index in range(len(values)):  # again, to tell what is wrong
                self.position((*keys, index))
            return None
        return self.reading.ring(ring, keys)


def _place(value: Any) -> Geodetic | None:
    """[longitude, latitude] as a place; None if it is none."""
    if not isinstance(value, list) or len(value) < 2:
        return None
    longitude_deg, latitude_deg = value[0], value[1]
    if not (is_number(longitude_deg) and is_number(latitude_deg)):
        return None
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        return None
    return Geodetic(float(latitude_deg), float(longitude_deg))


def is_number(value: Any) -> TypeGuard[float]:
    """Whether JSON has a number here; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def utc(text: Any) -> datetime:
    """A moment with its time zone, as UTC.

    Raises:
        ValueError: it is none, or has no time zone.
    """
    if not isinstance(text, str) or len(text) > 40:
        raise ValueError("it is no date and time")
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"'{text}' is no date and time like 2026-11-20T08:00:00Z") from None
    if moment.tzinfo is None:
        raise ValueError(f"'{text}' has no time zone; add Z for UTC")
    try:
        return moment.astimezone(UTC)
    except OverflowError:
        raise ValueError(f"'{text}' is out of all calendars") from None
