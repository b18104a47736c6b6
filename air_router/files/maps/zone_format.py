"""The contract of a zone format: what reads a file of zones, and the features that it finds in it.

Ours are entry points of the group `air_router.zone_formats`, as those of other packages are; what
these need is public in `air_router.zone_formats`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

import numpy as np

from air_router.files import NO_TERMS, DocumentSource, Keys, ZoneTerms
from air_router.files.maps.map_area import (
    MapArea,
    MapCircle,
    MapOutline,
    MapRing,
    Places,
    numbered,
)
from geo.frame import Geodetic
from mocha_link.sanitize import sanitize

MAX_RADIUS_M: Final = 1_000_000.0
MAX_ALTITUDE_M: Final = 100_000.0
MAX_CORNERS: Final = 200_000
"""Of one ring: a river that is a country's border has tens of thousands."""

_LONGEST_NAME: Final = 80
_POLE_DEG, _HALF_TURN_DEG = 90.0, 180.0

Shapes = list[tuple[Keys, MapOutline | MapCircle]]
"""The shapes of one zone, and where each stands in its file."""

Finding = tuple[Keys, str, str]
"""A problem or a note: its place, the message, the code."""


@dataclass(slots=True)
class ZoneFeature:
    """One airspace, feature or placemark of a file: its zones, and its problems.

    A feature without zones may stand for the file as a whole, and only carry problems or notes.
    Places in the file are (line, column), counted from 1; () is the file as a whole. Where the
    source is a JSON document they are the keys of a value.

    Attributes:
        source: The file, which locates its parts.
        name: What the file calls it.
        kinds: Names of its kind, by which `skip` leaves it out, as its name does.
        allowed_as: Names by which `allow` leaves it out: its restriction, class, identifier.
        whole_file: Its problems are the file's: wherever it lies, the file is refused for them.
        zones: Its zones, named.
        problems: What keeps it from being read.
        notes: What the operator should know.
        lines: Where something is drawn that has no area, and what to do if nothing else is there.
        extents: Places that are known of it, besides its zones.
    """

    source: DocumentSource
    name: str = ""
    kinds: Sequence[str] = ()
    allowed_as: Sequence[str] = ()
    whole_file: bool = False
    zones: list[MapArea] = field(default_factory=list)
    problems: list[Finding] = field(default_factory=list)
    notes: list[Finding] = field(default_factory=list)
    lines: list[tuple[Keys, str]] = field(default_factory=list)
    extents: list[Places] = field(default_factory=list)

    def add(self, shapes: Shapes, terms: ZoneTerms = NO_TERMS, name: str | None = None) -> None:
        """Add a zone; one of several shapes becomes as many, with a number behind the name.

        Args:
            shapes: Each with its place in the file.
            terms: How far, how high and when it is kept away from.
            name: Of this part, if it has one of its own.
        """
        full = sanitize(self.name if name is None else name)
        names = [full] if len(shapes) == 1 else numbered(full, len(shapes))
        for part, (place, shape) in zip(names, shapes, strict=True):
            self.zones.append(MapArea(part, shape, terms, self.source, place))

    def report(self, place: Keys, message: str, code: str) -> None:
        """Note a problem: the mission is refused if the feature is near it, or lies nowhere."""
        self.problems.append((place, message, code))

    def note(self, place: Keys, message: str, code: str) -> None:
        """Note what the operator should know."""
        self.notes.append((place, message, code))

    def saw(self, places: Sequence[Geodetic]) -> None:
        """Places of an area that could not be read as a whole: there it is."""
        if places:
            self.extents.append(np.array(places))

    def without_area(self, place: Keys, message: str, advice: str = "") -> None:
        """Note a shape that has no area, a point or a line.

        Args:
            place: Where it stands.
            message: What it is.
            advice: What to do where nothing in the file has an area; "": that is no problem.
        """
        if advice:
            self.lines.append((place, advice))
        self.note(place, f"{message}: left out", "no-area")

    def report_place(
        self, place: Keys, message: str, longitude_deg: float, latitude_deg: float
    ) -> None:
        """Note a place that is not on Earth, or would be with its numbers exchanged."""
        swapped = abs(longitude_deg) <= _POLE_DEG and abs(latitude_deg) <= _HALF_TURN_DEG
        advice = "exchange them (longitude comes first)" if swapped else "correct it"
        self.report(place, f"{message}; {advice}", "not-on-earth")

    def ring(self, places: list[Geodetic], place: Keys) -> MapRing | None:
        """Corners as a ring; None, with a problem or a note, if they are none or too many."""
        if len(places) > 1 and places[0] == places[-1]:
            places = places[:-1]
        places = _without_map_edge(places)
        if not places:
            self.note(place, "a border without corners: left out", "no-area")
            return None
        if len(places) > MAX_CORNERS:
            message = (
                f"a ring of {len(places)} corners, at most {MAX_CORNERS} are read; simplify it"
            )
            self.saw(places)
            self.report(place, message, "too-large")
            return None
        return tuple(places)


@dataclass(frozen=True, slots=True)
class ZoneFeatures:
    """What a format has read of a file.

    Attributes:
        features: In the file's order; may be read while it is iterated.
        kind: The kind of the file, as text: "KML".
        allow: The property with which values of `allow` are compared; "": its zones have no kind.
        skip: The property with which values of `skip` are compared.
    """

    features: Iterable[ZoneFeature]
    kind: str
    allow: str = ""
    skip: str = "name or kind"


@runtime_checkable
class ZoneFormat(Protocol):
    """A format of files of zones."""

    @property
    def name(self) -> str:
        """As messages call it: "KML"."""

    @property
    def suffixes(self) -> Sequence[str]:
        """How names of its files end, with the dot, in small letters."""

    def recognises(self, head: bytes) -> bool:
        """Whether a file that begins so is one.

        Args:
            head: The first 64 KiB, without a byte order mark and the blanks at its begin.
        """

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The features of a file.

        Args:
            content: The whole file.
            path: Names it in messages.

        Raises:
            DocumentError: it is none of this format after all; anything else that is wrong is a
                problem of a feature.
        """


def short_name(name: str, path: Path, number: int) -> str:
    """The name of a feature, or else that of its file with the feature's number."""
    return name[:_LONGEST_NAME] or f"{path.stem} {number}"


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
