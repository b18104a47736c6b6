"""No-fly zones from OpenAir, the text format of soaring: airspaces of points, arcs and circles.

Every airspace is a no-fly zone, whatever its class, unless the operator allows its class, type or
name. It ends where the next one begins.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from air_router.files import AltitudeLimit, Altitudes, PlacedSource, ZoneTerms
from air_router.files.maps.limits import UNCLEAR, limit_in_text
from air_router.files.maps.map_area import MapCircle, MapOutline
from air_router.files.maps.zone_format import (
    MAX_RADIUS_M,
    Shapes,
    ZoneFeature,
    ZoneFeatures,
)
from geo.frame import Geodetic, arc_around, polar
from mocha_link.team import line_column

_NAUTICAL_MILE_M: Final = 1852.0
_PART = r"(\d{1,2}(?:\.\d{0,60})?)"
_ANGLE = rf"(\d{{1,3}}(?:\.\d{{0,60}})?)(?::{_PART})?(?::{_PART})?\s*"
_PLACE = re.compile(rf"{_ANGLE}([NS])[\s,]*{_ANGLE}([EW])", re.IGNORECASE)
_NUMBER = re.compile(r"\d{1,6}(?:\.\d{0,60})?")
_COMMAND = re.compile(r"\s*([A-Za-z]{1,2})!?(?:\s+(\S.*))?")
_COMMENT = re.compile(r"[*;].*")
_NAME = re.compile(r"\s*AN\s", re.IGNORECASE)
_ATTRIBUTES: Final = frozenset({"AN", "AY", "AL", "AH"})
_TERRAIN: Final = frozenset({"TO", "TC"})
_HOURS: Final = frozenset({"AA", "AP", "AW", "TW"})
"""When an airspace applies, in several dialects."""

Place = tuple[int, int]
"""Line and column in the file."""


class OpenAirFormat:
    """OpenAir."""

    name: Final = "OpenAir"
    suffixes: Final = (".txt", ".air", ".openair")

    def recognises(self, head: bytes) -> bool:
        """Whether an airspace begins in it."""
        return _begins_airspace(head.decode("latin1"))

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The airspaces; many such files are in Latin-1, whose letters stand in names only."""
        features = _features(content, PlacedSource(path))
        keys = "class, type or name"
        return ZoneFeatures(features, self.name, keys, keys)


OPENAIR: Final = OpenAirFormat()


def _begins_airspace(text: str) -> bool:
    return re.search(r"^[ \t]*AC[ \t]", text, re.MULTILINE) is not None


def _features(raw: bytes, source: PlacedSource) -> Iterator[ZoneFeature]:
    file = ZoneFeature(source)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text = raw.decode("latin1")
        message = "not UTF-8 text: read as Latin-1; check the names"
        file.note(line_column(raw[: error.start]), message, "not-utf8")
    text = re.sub(r"\r\n?", "\n", text)
    if not _begins_airspace(text):
        message = "no airspace begins in it (no line 'AC'); choose another file"
        file.report((), message, "unknown-format")
        yield file
        return
    yield from _Reader(file).features(text.split("\n"))


class _Reader:
    def __init__(self, file: ZoneFeature) -> None:
        self._feature = file  # the one that is read
        self._centre: Geodetic | None = None  # of arcs and circles, set by V X=
        self._zone: _Airspace | None = None  # the one whose lines are read
        self._terrain = False  # whether those of terrain are

    def features(self, lines: Sequence[str]) -> Iterator[ZoneFeature]:
        """The file as a whole, then its airspaces."""
        begins = [n for n, line in enumerate(lines) if _begins(line)]
        self._lines(lines, range(begins[0]))
        yield self._feature
        for begin, end in pairwise((*begins, len(lines))):
            self._feature = ZoneFeature(self._feature.source)
            self._lines(lines, range(begin, end))
            self._close()
            yield self._feature

    def _lines(self, lines: Sequence[str], numbers: range) -> None:
        for number in numbers:
            line = lines[number]
            bare = line.partition("*")[0] if _NAME.match(line) else _COMMENT.sub("", line)
            self._line(bare.rstrip(), number + 1)

    def _line(self, line: str, number: int) -> None:
        """Read a line without its comment and the blanks at its end."""
        if not line:
            return
        match = _COMMAND.fullmatch(line)
        if match is None:
            self._no_command(line, number)
            return
        command, value = match[1].upper(), match[2] or ""
        at = (number, match.start(2 if value else 1) + 1)
        zone = self._zone
        if command == "AC":
            self._terrain = False
            self._zone = _Airspace((number, match.start(1) + 1), value.upper())
        elif command in _TERRAIN:
            self._terrain = True
            self._feature.note(at, "terrain is no airspace: left out", "not-a-zone")
        elif command in _ATTRIBUTES and zone is not None:
            zone.set(command, value, at)
        elif command in _HOURS and zone is not None and value.upper() != "NONE":
            zone.hours = zone.hours or at
        elif command[0] in "DV":
            self._geometry(command, value, at)
        elif command[0] not in "AST":  # frequencies, labels, pens: not where the zone is
            self._no_command(line, number)

    def _no_command(self, line: str, number: int) -> None:
        """A line of an unknown kind: wrong, if it may define where the airspace lies."""
        message = f"'{line.strip()[:40]}' is no OpenAir command"
        if _PLACE.search(line) or line.lstrip()[:1].upper() in ("D", "V"):
            self._wrong((number, 1), message)
        else:
            self._feature.note((number, 1), f"{message}: left out", "wrong-form")

    def _close(self) -> None:
        zone, self._zone = self._zone, None
        if zone is None:
            return
        feature, values = self._feature, {key: value for key, (value, _) in zone.values.items()}
        feature.name = values.get("AN", "")[:80] or f"{feature.source.path.stem} {zone.place[0]}"
        feature.kinds = (zone.kind, values.get("AY", ""))
        feature.allowed_as = (*feature.kinds, feature.name)
        if zone.broken:
            feature.saw([*zone.corners, *(circle.centre for circle in zone.circles)])
        elif not zone.corners and not zone.circles:
            if zone.values:  # else it only has the colours of its class
                feature.note(zone.place, f"'{feature.name}' has no border: left out", "no-area")
        else:
            self._add(zone)

    def _add(self, zone: _Airspace) -> None:
        alone = len(set(zone.corners)) == 1
        circles = [*zone.circles, *(zone.turns if alone else ())]
        shapes: Shapes = [(zone.place, circle) for circle in circles]
        ring = (
            self._feature.ring(zone.corners, zone.place)
            if zone.corners and not (alone and zone.turns)
            else None
        )
        shapes += [(zone.place, MapOutline(ring))] if ring else []
        if zone.hours is not None:
            message = "when it applies is not read: always"
            self._feature.note(zone.hours, message, "unclear-time")
        lower, upper = self._limit(zone, "AL"), self._limit(zone, "AH")
        altitudes = Altitudes(lower, upper) if lower or upper else None
        self._feature.add(shapes, ZoneTerms(altitudes=altitudes))

    def _limit(self, zone: _Airspace, command: str) -> AltitudeLimit | None:
        text, at = zone.values.get(command, ("", zone.place))
        what = "ceiling (AH)" if command == "AH" else "floor (AL)"
        if command in zone.contradicted:
            self._feature.note(at, f"an airspace with more than one {what}: without limit", UNCLEAR)
            return None
        if not text:
            self._feature.note(at, f"an airspace without a {what}: without limit", UNCLEAR)
            return None
        try:
            return limit_in_text(text, upper=command == "AH")
        except ValueError as error:
            self._feature.note(at, f"its {what}: {error}", UNCLEAR)
            return None

    def _geometry(self, command: str, value: str, at: Place) -> None:
        zone = self._zone
        if command == "V":
            self._variable(value, at)
        elif self._terrain:
            return
        elif zone is None:
            self._wrong(at, f"'{command}' stands before the first airspace: begin it with AC")
        elif command == "DP":
            zone.corners += self._places(value, 1, at) or []
        elif command in ("DA", "DB", "DC"):
            self._round(zone, command, value, at)
        else:
            self._wrong(at, f"'{command}' is not read: draw the airspace with DP, DA, DB or DC")

    def _round(self, zone: _Airspace, command: str, value: str, at: Place) -> None:
        """A circle or an arc around the centre: an arc's ends are directions, or places.

        Places that are given stay as they are: computed anew they would lie a hair beside the
        corner that the line before or behind the arc gives once more.
        """
        ends = self._places(value, 2, at) if command == "DB" else []
        numbers = [] if command == "DB" else self._numbers(value, 3 if command == "DA" else 1, at)
        centre = self._centre
        if ends is None or numbers is None:
            return
        if centre is None:
            self._wrong(at, "no centre: a line 'V X=' with a place has to stand before it")
        elif command == "DC":
            zone.circles.append(MapCircle(centre, numbers[0]))
        elif command == "DA":
            arc = [(direction_deg, numbers[0]) for direction_deg in numbers[1:]]
            zone.corners += arc_around(centre, arc[0], arc[1], clockwise=zone.clockwise)
        else:
            arc = [polar(centre, place) for place in ends]
            if ends[0] == ends[1]:  # a whole turn if there is nothing else, else rounding
                zone.turns.append(MapCircle(centre, arc[0][1]))
                zone.corners.append(ends[0])
                return
            between = arc_around(centre, arc[0], arc[1], clockwise=zone.clockwise)[1:-1]
            zone.corners += [ends[0], *between, ends[1]]

    def _variable(self, value: str, at: Place) -> None:
        name, _, text = (part.strip() for part in value.partition("="))
        if name.upper() == "X":
            places = self._places(text, 1, at)
            self._centre = places[0] if places else None
        elif name.upper() == "D" and text in ("+", "-"):
            if self._zone is not None:
                self._zone.clockwise = text == "+"
        elif name.upper() not in ("Z", "W", "T"):  # zoom; widths of parts that are not read
            self._wrong(at, f"'V {value[:20]}' is none of V X=, V D=+ and V D=-")

    def _places(self, text: str, count: int, at: Place) -> list[Geodetic] | None:
        found = list(_PLACE.finditer(text))
        rest = _PLACE.sub("", text).strip(" ,\t")
        if len(found) != count or rest:
            what = "a place" if count == 1 else f"{count} places"
            self._wrong(at, f"'{text[:60]}' is not {what} like 47:10:30 N 008:25:00 E")
            return None
        places = [_place(match) for match in found]
        for place in places:
            if place is None:
                self._wrong(at, f"there is no place '{text[:60]}'", "not-on-earth")
        known = [place for place in places if place is not None]
        return known if len(known) == count else None

    def _numbers(self, text: str, count: int, at: Place) -> list[float] | None:
        """The radius, given in nautical miles, in metres; for an arc its two directions as well."""
        parts = re.split(r"[\s,]+", text)
        if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
            what = "a radius in nautical miles" if count == 1 else "radius, first, last direction"
            self._wrong(at, f"'{text[:40]}' is not {what}")
            return None
        radius, *directions_deg = map(float, parts)
        if not 0 < radius * _NAUTICAL_MILE_M <= MAX_RADIUS_M:
            self._wrong(at, f"a radius of {radius:g} nautical miles", "out-of-range")
            return None
        return [radius * _NAUTICAL_MILE_M, *directions_deg]

    def _wrong(self, at: Place, message: str, code: str = "wrong-form") -> None:
        if self._zone is not None:
            self._zone.broken = True
            self._feature.saw([] if self._centre is None else [self._centre])
        self._feature.report(at, f"{message}; correct it", code)


class _Airspace:
    """The values of an airspace's lines so far."""

    def __init__(self, place: Place, kind: str) -> None:
        self.place, self.kind = place, kind  # line and column; class
        self.values: dict[str, tuple[str, Place]] = {}  # value and place, by command
        self.contradicted: set[str] = set()  # commands that were given twice, and differ
        self.corners: list[Geodetic] = []  # of its outline so far
        self.circles: list[MapCircle] = []  # each an area of its own
        self.turns: list[MapCircle] = []  # of arcs that end where they begin
        self.hours: Place | None = None  # where its hours stand
        self.clockwise = True  # direction of the next arc
        self.broken = False  # a line of it could not be read

    def set(self, command: str, value: str, at: Place) -> None:
        if self.values.get(command, (value, at))[0] != value:
            self.contradicted.add(command)
        self.values[command] = (value, at)


def _begins(line: str) -> bool:
    """Whether an airspace or terrain begins in a line."""
    return line.split(None, 1)[:1] != [] and line.split(None, 1)[0].upper() in {"AC", *_TERRAIN}


def _place(match: re.Match[str]) -> Geodetic | None:
    parts = match.groups()
    latitude_deg, longitude_deg = (
        sum(float(part or 0) / 60**power for power, part in enumerate(angle))
        for angle in (parts[:3], parts[4:7])
    )
    minutes = [float(part) for part in (*parts[1:3], *parts[5:7]) if part]
    if latitude_deg > 90 or longitude_deg > 180 or any(part > 60 for part in minutes):
        return None
    return Geodetic(
        math.copysign(latitude_deg, -1 if parts[3].upper() == "S" else 1),
        math.copysign(longitude_deg, -1 if parts[7].upper() == "W" else 1),
    )
