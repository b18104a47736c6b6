"""What zones in files have in common: where they lie in degrees, their terms and their place."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from air_router.files.mission_document import DocumentSource, Keys, local_ring
from air_router.files.zone_terms import NO_TERMS, ZoneTerms
from air_router.words import counted
from geo.airspace.zone import Circle, Outline, Shape, ZoneError
from geo.frame import FrameError, Geodetic, LocalFrame
from mocha_link.sanitize import sanitize
from mocha_link.team.problem import Problem, ProblemList

MAX_RADIUS_M = 1_000_000.0
MAX_ALTITUDE_M = 100_000.0
MAX_CORNERS = 20_000

_POLE_DEG, _HALF_TURN_DEG = 90.0, 180.0

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


Shapes = list[tuple[Keys, MapOutline | MapCircle]]
"""The shapes of one zone, and where each stands in its file."""

ZONE_KIND = "zone"
"""What files that we write call a zone among waypoints and fences."""


def place_of(latitude_deg: float, longitude_deg: float) -> Geodetic | None:
    """A place on the map; None: there is none such."""
    if abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180:
        return Geodetic(float(latitude_deg), float(longitude_deg))
    return None


def outline_of_rings(rings: Sequence[MapRing | None]) -> MapOutline | None:
    """The outline of a ring and those of its holes; None: one of them could not be read."""
    read = [ring for ring in rings if ring is not None]
    return MapOutline(read[0], tuple(read[1:])) if read and len(read) == len(rings) else None


@dataclass(frozen=True, slots=True)
class MapArea:
    """A fence or a zone on the map, wherever it came from.

    Attributes:
        name: What people or its file call it.
        shape: Where it is, in degrees.
        terms: How far, how high and when it is kept away from.
        source: The file that it was read from; None: it was not.
        keys: Where it stands in that file.
    """

    name: str
    shape: MapOutline | MapCircle
    terms: ZoneTerms = NO_TERMS
    source: DocumentSource | None = None
    keys: Keys = ()

    def problem(self, message: str, code: str) -> Problem:
        """A problem with this area, at its place in its file."""
        if self.source is None:
            return Problem(Path(), 1, 1, message, code)
        return self.source.problem(self.keys, message, code)

    def placed(self, frame: LocalFrame, what: str = "no-fly zone ") -> Shape | Problem:
        """Its shape in a local frame, or why it has none there."""
        try:
            if isinstance(self.shape, MapCircle):
                return Circle(frame.to_local(*self.shape.centre), self.shape.radius_m)
            rings = (self.shape.ring, *self.shape.holes)
            ring, *holes = (local_ring(ring, frame) for ring in rings)
            return Outline(ring, tuple(holes))
        except (ZoneError, FrameError) as error:
            code = error.code if isinstance(error, ZoneError) else "not-on-earth"
            message = f"{what}'{self.name}' cannot be an area: {error}; draw it again"
            return self.problem(message, code)


def unique_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """The names, with a number behind those that are taken: two zones are never called the same."""
    used, answer = set(taken), []
    for name in names:
        unique, number = name, 1
        while unique in used:
            number += 1
            unique = f"{name} ({number})"
        used.add(unique)
        answer.append(unique)
    return answer


def _without_map_edge(places: list[Geodetic]) -> list[Geodetic]:
    """A ring around a pole without the way up one edge of the map, over the pole, and down again.

    GeoJSON leads it so. On the ground both edges are one line.
    """
    poles = [place for place in places if abs(place.latitude_deg) == _POLE_DEG]
    edges = {place.longitude_deg for place in poles}
    if not edges >= {-_HALF_TURN_DEG, _HALF_TURN_DEG} or len({p.latitude_deg for p in poles}) > 1:
        return places
    kept = [place for place in places if place not in poles]
    nexts = [*kept[1:], *kept[:1]]
    return [here for here, there in zip(kept, nexts, strict=True) if not _same(here, there)]


def _same(one: Geodetic, other: Geodetic) -> bool:
    """Whether two places are one, on both edges of the map."""
    edges = {one.longitude_deg, other.longitude_deg}
    return edges == {-_HALF_TURN_DEG, _HALF_TURN_DEG} and one.latitude_deg == other.latitude_deg


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
    zones: list[MapArea] = field(default_factory=list)
    _others: int = 0  # areas that are no zones
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

    def takes(self, properties: Mapping[str, Any]) -> bool:
        """Whether these are the properties of a zone; what is something else is counted."""
        kind = properties.get("kind") or ZONE_KIND  # map programs fill columns with null
        is_zone: bool = kind == ZONE_KIND
        self._others += not is_zone
        return is_zone

    def tell_others(self, what: str, where: str) -> None:
        """Note how many were none: features or placemarks, by their property or their data."""
        if self._others:
            message = f"{self._others} {what} are no zones, by their {where} 'kind': left out"
            self.note((), message, "not-a-zone")

    def name_of(self, name: str, number: int) -> str:
        """The name of a zone, or else that of the file with the zone's number in it."""
        return name[:80] or f"{self.path.stem} {number}"

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
        places = _without_map_edge(places)
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
            self.zones.append(MapArea(numbered, shape, terms, self.source, keys))


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
