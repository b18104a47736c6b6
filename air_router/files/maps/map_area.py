"""An area on the map: outlines and circles in degrees, made sound, and placed in local frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from air_router.files import NO_TERMS, DocumentSource, Keys, ZoneTerms
from geo.airspace import Circle, Outline, Ring, Shape, ZoneError, repaired
from geo.frame import FrameError, Geodetic, LocalFrame, local_ring
from mocha_link.team import Problem

REPAIRED: Final = "zone-repaired"
"""The code of the note about a zone whose border was no sound one."""

_DEGREE_M: Final = 111_000.0
_POLE_DEG: Final = 90.0
_LEAST_DEG2: Final = 1e-12  # a hundredth of a square metre
_FRAME_STEP_DEG: Final = 10.0

Places = NDArray[np.float64]
"""Rows of latitude and longitude in degrees."""

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
            return self._shape(frame)
        except (ZoneError, FrameError) as error:
            code = error.code if isinstance(error, ZoneError) else "not-on-earth"
            message = f"{what}'{self.name}' cannot be an area: {error}; draw it again"
            return self.problem(message, code)

    def sound(self) -> tuple[list[MapArea], Problem | None]:
        """The areas that its border encloses, and a note if it had to be repaired for that.

        It is judged on the map, where its sides are straight, or in a frame of its own, so that the
        verdict is the same for every mission.
        """
        if self._sound_on_map():
            return [self], None
        frame = self.own_frame()
        try:
            self._shape(frame)
        except ZoneError as error:
            outlines = self._repaired(frame)
            message = (
                f"no-fly zone '{self.name}': {error}; read as all that its border encloses, "
                f"{sum(outline.polygon.area for outline in outlines) / 1e6:.3g} km2"
            )
            shapes = [_on_map(outline, frame) for outline in outlines]
            return self.parts(shapes), self.problem(message, REPAIRED)
        except FrameError:
            pass  # too large for its own frame; the mission's frame reports that, if it is near
        return [self], None

    def placed_areas(self, frame: LocalFrame) -> list[tuple[MapArea, Shape]] | Problem:
        """A sound area in a mission's frame.

        One that is valid in its own frame may touch itself by a hair in another: rounding is
        repaired silently.
        """
        try:
            return [(self, self._shape(frame))]
        except ZoneError:
            outlines = self._repaired(frame)
            parts = self.parts([_on_map(outline, frame) for outline in outlines])
            return list(zip(parts, outlines, strict=True))
        except FrameError as error:
            message = f"no-fly zone '{self.name}' cannot be an area: {error}; draw it again"
            return self.problem(message, "not-on-earth")

    def parts(self, shapes: Sequence[MapOutline | MapCircle]) -> list[MapArea]:
        """The area with other shapes, numbered if there are several."""
        names = [self.name] if len(shapes) == 1 else numbered(self.name, len(shapes))
        return [
            replace(self, name=name, shape=shape) for name, shape in zip(names, shapes, strict=True)
        ]

    def extent(self) -> Places:
        """Latitudes and longitudes around which a box contains it."""
        if not isinstance(self.shape, MapCircle):
            return np.array(self.shape.ring)
        half_deg = 1.01 * self.shape.radius_m / _DEGREE_M
        widest_deg = min(abs(self.shape.centre.latitude_deg) + half_deg, 89.9)
        half_lon_deg = min(half_deg / math.cos(math.radians(widest_deg)), 89.0)
        half = np.array([half_deg, half_lon_deg])
        return np.array([self.shape.centre - half, self.shape.centre + half])

    def own_frame(self) -> LocalFrame:
        """One of a few frames all over the Earth: making one takes longer than reading a zone."""
        shape = self.shape
        place = shape.centre if isinstance(shape, MapCircle) else shape.ring[0]
        return LocalFrame(
            Geodetic(*(_FRAME_STEP_DEG * round(part / _FRAME_STEP_DEG) for part in place))
        )

    def _sound_on_map(self) -> bool:
        """Whether it is an area in degrees; also false if that is undecidable, as around a pole."""
        if isinstance(self.shape, MapCircle):
            return False
        rings, west_deg = [], self.shape.ring[0].longitude_deg
        for ring in (self.shape.ring, *self.shape.holes):
            places = np.array(ring)[:, ::-1]
            jumps = np.round(np.diff(places[:, 0], append=places[0, 0]) / 360.0)
            if jumps.any() or len(places) < 3 or abs(places[:, 1]).max() >= _POLE_DEG:
                return False
            places[:, 0] -= 360.0 * np.round((places[0, 0] - west_deg) / 360.0)
            rings.append(places)
        polygon = Polygon(rings[0], rings[1:])
        return bool(polygon.is_valid and polygon.area > _LEAST_DEG2)

    def _shape(self, frame: LocalFrame) -> Shape:
        if isinstance(self.shape, MapCircle):
            return Circle(frame.to_local(*self.shape.centre), self.shape.radius_m)
        ring, *holes = self._rings(frame)
        return Outline(ring, tuple(holes))

    def _rings(self, frame: LocalFrame) -> list[Ring]:
        if isinstance(self.shape, MapCircle):
            return []
        return [local_ring(ring, frame) for ring in (self.shape.ring, *self.shape.holes)]

    def _repaired(self, frame: LocalFrame) -> list[Outline]:
        ring, *holes = self._rings(frame)
        return repaired(ring, holes)


def numbered(name: str, count: int) -> list[str]:
    """The names of a zone's parts."""
    return [f"{name}, part {number}" for number in range(1, count + 1)]


def _on_map(outline: Outline, frame: LocalFrame) -> MapOutline:
    ring, *holes = (
        tuple(Geodetic(*place) for place in frame.to_geodetic_many(list(ring)).tolist())
        for ring in (outline.ring, *outline.holes)
    )
    return MapOutline(ring, tuple(holes))


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
