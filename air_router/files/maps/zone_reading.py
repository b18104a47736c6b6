"""What files of zones have in common: their zones, what is wrong with each, and what is noted."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from air_router.files import DocumentSource, Keys, ZoneTerms
from air_router.files.maps.map_area import (
    MapArea,
    MapCircle,
    MapOutline,
    MapRing,
    Places,
    numbered,
)
from air_router.words import counted
from geo.frame import Geodetic
from mocha_link.sanitize import sanitize
from mocha_link.team import Problem, ProblemList

MAX_RADIUS_M: Final = 1_000_000.0
MAX_ALTITUDE_M: Final = 100_000.0
MAX_CORNERS: Final = 200_000
"""Of one ring: a river that is a country's border has tens of thousands."""

UNREAD: Final = "zone-unread"
"""The code of the note about a zone far from the mission that could not be read."""

_POLE_DEG, _HALF_TURN_DEG = 90.0, 180.0

Shapes = list[tuple[Keys, MapOutline | MapCircle]]
"""The shapes of one zone, and where each stands in its file."""

ZONE_KIND = "zone"
"""What files that we write call a zone among waypoints and fences."""


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
class _Findings:
    """What was found out about one airspace, feature or placemark; or, without places, the file."""

    problems: list[tuple[Keys, str, str]] = field(default_factory=list)  # keys, message, code
    notes: list[tuple[Keys, str, str]] = field(default_factory=list)  # the same
    places: list[Places] = field(default_factory=list)  # what is known of where it lies

    @property
    def extent(self) -> Places | None:
        """Two opposite corners of a box around it; None: nothing says where it lies.

        Where a part of it could not be read the box is three times as large.
        """
        if not self.places:
            return None
        places = np.vstack(self.places)
        low, high = places.min(axis=0), places.max(axis=0)
        more = high - low if self.problems else 0.0
        return np.array([low - more, high + more])


class ZoneReading:
    """What has been read from a file so far.

    Attributes:
        source: The file.
        kind: Its format, in words.
        zones: Its zones.
        choice: Which of its zones the operator leaves out.
    """

    def __init__(
        self, source: DocumentSource, kind: str, choice: "ZoneChoice | None" = None
    ) -> None:
        self.source, self.kind = source, kind
        self.zones: list[MapArea] = []
        self.choice = choice or ZoneChoice()
        self._findings = [_Findings()]  # in the file's order; the last one is being added to
        self._others = 0  # areas that are no zones
        self._lines: list[Keys] = []  # where things are drawn that have no area
        self._areas = 0  # zones, and those left out by the operator

    @property
    def problems(self) -> list[Problem]:
        """What is wrong with it: the first of each kind, and how many more there are."""
        return self.findings()[0]

    @property
    def notes(self) -> list[Problem]:
        """What was left out or read with caution, though nothing is wrong with it."""
        return self.findings()[1]

    def findings(
        self, near: Callable[[Places], bool] = lambda _extent: True
    ) -> tuple[list[Problem], list[Problem]]:
        """Problems and notes, as they matter where a mission is flown.

        A zone that cannot be read is a problem where it may be near, or where nothing says where it
        lies, and a note elsewhere. Notes about zones that are read are for near ones.

        Args:
            near: Whether the mission may reach a box, given by latitudes and longitudes in it.
        """
        problems, notes = ProblemList(), ProblemList()
        for found in self._findings:
            if not found.problems and not found.notes:
                continue
            extent = found.extent
            is_near = extent is None or near(extent)
            for keys, message, code in found.problems:
                if is_near:
                    problems.add(self.path, code, partial(self.source.problem, keys, message, code))
                else:
                    words = f"a zone far from the mission cannot be read: {message}"
                    notes.add(self.path, UNREAD, partial(self.source.problem, keys, words, UNREAD))
            for keys, message, code in found.notes if is_near else ():
                notes.add(self.path, code, partial(self.source.problem, keys, message, code))
        return list(problems), list(notes)

    @property
    def unread(self) -> list[Problem]:
        """What is wrong with single zones: without these the rest of the file can be used."""
        listed = ProblemList()
        for found in self._findings:
            for keys, message, code in found.problems if found.places else ():
                listed.add(self.path, code, partial(self.source.problem, keys, message, code))
        return list(listed)

    @property
    def path(self) -> Path:
        """The file."""
        return self.source.path

    @contextmanager
    def area(self) -> Iterator[None]:
        """While one airspace, feature or placemark is read: what is found out is about it."""
        found, before = _Findings(), len(self.zones)
        self._findings.append(found)
        try:
            yield
        finally:
            if found.problems or found.notes:
                found.places += [zone.extent() for zone in self.zones[before:]]
                self._findings.append(_Findings())
            else:
                self._findings.pop()

    def saw(self, places: Sequence[Geodetic]) -> None:
        """Places of an area that could not be read as a whole: there it is."""
        if places:
            self._findings[-1].places.append(np.array(places))

    def skips(self, name: str, *kinds: str) -> bool:
        """Whether the operator leaves out the area that is read, by its name or kind."""
        skipped = self.choice.skip.takes(name, *kinds, name)
        if skipped:
            self.forget()
        return skipped

    def forget(self) -> None:
        """Drop what was found out about the area that is read: it is left out."""
        self._areas += 1
        self._findings[-1].problems.clear()
        self._findings[-1].notes.clear()

    def report(self, keys: Keys, message: str, code: str) -> None:
        """Note a problem."""
        self._findings[-1].problems.append((keys, message, code))

    def note(self, keys: Keys, message: str, code: str) -> None:
        """Note what the operator should know."""
        self._findings[-1].notes.append((keys, message, code))

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

    def without_area(self, keys: Keys, message: str) -> None:
        """Note what is drawn and has no area: a point, a line."""
        self._lines.append(keys)
        self.note(keys, f"{message}: left out", "no-area")

    def refuse_without_areas(self, advice: str) -> None:
        """Report a file in which there are points and lines, and nothing has an area."""
        if self._lines and not self._areas and not any(f.problems for f in self._findings):
            self.report(self._lines[0], f"nothing in it has an area; {advice}", "no-area")

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
        """Corners as a ring; None, with a problem or a note, if they are none or too many."""
        if len(places) > 1 and places[0] == places[-1]:
            places = places[:-1]
        places = _without_map_edge(places)
        if not places:
            self.note(keys, "a border without corners: left out", "no-area")
            return None
        if len(places) > MAX_CORNERS:
            message = (
                f"a ring of {len(places)} corners, at most {MAX_CORNERS} are read; simplify it"
            )
            self.saw(places)
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
        self._areas += len(shapes)
        name = sanitize(name)
        names = [name] if len(shapes) == 1 else numbered(name, len(shapes))
        for part, (keys, shape) in zip(names, shapes, strict=True):
            self.zones.append(MapArea(part, shape, terms, self.source, keys))


class LeftOut:
    """Kinds and names of zones that the operator leaves out, and which zones these are.

    Args:
        words: The kinds and names, as the operator wrote them.
        why: What a note says of those zones.
        code: The code of that note.
        unused: The code of the note about words that are of no zone.
    """

    def __init__(self, words: Collection[str], why: str, code: str, unused: str) -> None:
        self._words = {_comparable(word): word for word in words}  # as the operator wrote them
        self._why, self._code, self._unused = why, code, unused  # for the notes
        self._used: set[str] = set()  # those that a zone is of
        self._zones: list[str] = []  # names of those left out

    def takes(self, zone: str, *words: str) -> bool:
        """Whether one of these words, which say what a zone is, is among them."""
        if not self._words:
            return False
        matches = set(map(_comparable, words)) & self._words.keys()
        if matches:
            self._used |= matches
            self._zones.append(zone)
        return bool(matches)

    def tell(self, reading: ZoneReading, kinds: str) -> None:
        """Note which zones were left out, and which words are none of the file's `kinds`."""
        if zones := self._zones:
            shown = ", ".join(zones[:10]) + (" ..." if len(zones) > 10 else "")
            message = f"{counted(len(zones), 'zones')} that you {self._why}: left out ({shown})"
            reading.note((), message, self._code)
        for unused in sorted(self._words.keys() - self._used):
            message = f"no zone is of {kinds} '{self._words[unused][:40]}'"
            reading.note((), message, self._unused)


class ZoneChoice:
    """Which zones of a file the operator leaves out.

    Attributes:
        allow: Those that the operator may fly in.
        skip: Those that are no zones for this mission: another mission's area, a plan of the site.
    """

    def __init__(self, allow: Collection[str] = (), skip: Collection[str] = ()) -> None:
        self.allow = LeftOut(allow, "allow", "zone-allowed", "allow-unused")
        self.skip = LeftOut(skip, "skip", "zone-skipped", "skip-unused")

    def tell(self, reading: ZoneReading, allowed: str, skipped: str = "name or kind") -> None:
        """Note what was left out, and words that fit nothing; what they are compared with."""
        self.allow.tell(reading, allowed)
        self.skip.tell(reading, skipped)


def _comparable(word: str) -> str:
    """Without capitals; ED-269 writes AUTHORISATION, ED-318 AUTHORIZATION."""
    return word.strip().upper().replace("AUTHORIZATION", "AUTHORISATION")
