"""What map programs are shown of a mission or of a file of zones: everything in degrees."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from air_router.files import Area
from air_router.files.maps.map_area import (
    MapArea,
    MapCircle,
    MapOutline,
    MapRing,
    unique_names,
)
from air_router.files.maps.zone_reading import ZoneReading
from geo.airspace import Circle, Ring
from geo.frame import Geodetic, LocalFrame, Point, step_at_m, stepped
from mocha_link.team import Problem

_ON_LINE_DEG = 2e-9
_LONG = 1.1  # of that step: longer than any side that was straight on the map


@dataclass(frozen=True, slots=True)
class MapPoint:
    """A named place, and how high above home the vehicle is there."""

    name: str
    place: Geodetic
    altitude_above_home_m: float | None = None  # None: the mission's


@dataclass(slots=True)
class FeatureSet:
    """Everything that can be drawn. Altitudes are metres above home.

    Attributes:
        name: of the mission or the file.
        home_altitude_amsl_m: None if it is not known.
        fences: what the vehicle stays inside of.
        zones: what it stays outside of.
        spots: home, waypoints and rally points in order, each with its kind.
    """

    name: str
    home_altitude_amsl_m: float | None = None
    fences: list[MapArea] = field(default_factory=list)
    zones: list[MapArea] = field(default_factory=list)
    spots: list[tuple[str, MapPoint]] = field(default_factory=list)

    def areas(self) -> Iterator[tuple[str, MapArea]]:
        """Fences and zones, each with its kind."""
        yield from (("fence", area) for area in self.fences)
        yield from (("zone", area) for area in self.zones)


def feature_set_of_zones(
    readings: Iterable[ZoneReading], name: str
) -> tuple[FeatureSet, list[Problem]]:
    """The feature set of files of zones, and notes on zones that had to be repaired for it."""
    sound = [zone.sound() for reading in readings for zone in reading.zones]
    zones = [zone for areas, _ in sound for zone in areas]
    names = unique_names(zone.name for zone in zones)
    named = [replace(zone, name=name) for zone, name in zip(zones, names, strict=True)]
    return FeatureSet(name, zones=named), [note for _, note in sound if note is not None]


def corners_of(ring: Ring, frame: LocalFrame) -> MapRing:
    """A ring's corners in degrees, without those that lie on a straight line of the map.

    Long sides have such corners, because what is straight on the map is bent on the ground. Those
    that have none are straight on the ground, as in a mission in metres: they get some.
    """
    places = _on_map(ring, frame)
    kept: list[int] = []
    for index, place in enumerate(places):
        before = places[kept[-1] if kept else -1]
        if not _between(before, place, places[(index + 1) % len(places)]):
            kept.append(index)
    if len(kept) < 3:
        return places
    corners: list[Point] = []
    for index, after in zip(kept, (*kept[1:], kept[0]), strict=True):
        farthest_deg = max(places[index].latitude_deg, places[after].latitude_deg, key=abs)
        alone = (index + 1) % len(ring) == after
        step_m = _LONG * step_at_m(farthest_deg) if alone else math.inf
        corners += stepped(ring[index], ring[after], step_m)
    return _on_map(corners, frame)


def _on_map(ring: Sequence[Point], frame: LocalFrame) -> MapRing:
    return tuple(Geodetic(*place) for place in frame.to_geodetic_many(list(ring)).tolist())


def counterclockwise(ring: MapRing) -> MapRing:
    """The ring in the order that KML wants around an area; the same the other way for holes."""
    twice = 0.0
    for start, end in zip(ring, (*ring[1:], ring[0]), strict=True):
        lon_deg = (end.longitude_deg - start.longitude_deg + 180) % 360 - 180
        twice += lon_deg * (start.latitude_deg + end.latitude_deg)
    return ring if twice <= 0 else ring[::-1]


def _between(before: Geodetic, place: Geodetic, after: Geodetic) -> bool:
    """Whether a place lies on the straight line in degrees between two others."""
    (lat, lon), (to_lat, to_lon) = (
        (
            other.latitude_deg - before.latitude_deg,
            (other.longitude_deg - before.longitude_deg + 180) % 360 - 180,
        )
        for other in (place, after)
    )
    length = math.hypot(to_lat, to_lon)
    if length == 0:
        return False
    along, across = (lat * to_lat + lon * to_lon), (lat * to_lon - lon * to_lat)
    return 0 < along < length**2 and abs(across) < _ON_LINE_DEG * length


def map_area_of(area: Area, frame: LocalFrame) -> MapArea:
    """A fence or a zone in degrees."""
    if isinstance(area.shape, Circle):
        centre = frame.to_geodetic(area.shape.centre)
        return MapArea(area.name, MapCircle(centre, area.shape.radius_m), area.terms)
    ring, *holes = (corners_of(ring, frame) for ring in (area.shape.ring, *area.shape.holes))
    return MapArea(area.name, MapOutline(ring, tuple(holes)), area.terms)
