"""The parts of a mission's data that can be edited; the same for YAML and for QGroundControl plans.

They are read leniently from the bare data, before anything is validated: a zone that crosses
itself, or a waypoint on another continent, can still be seen and dragged back.
"""

import copy
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from air_router.errors import AirRouterError
from air_router.files import Digits, Keys, degrees, is_number, metres, value_at
from geo.frame import FrameError, Geodetic, LocalFrame, Point

Pair = tuple[float, float]
"""As the file has it: degrees (latitude first), or metres east and north."""


class EditError(AirRouterError):
    """An edit that cannot be applied to the mission; the message has the reason."""


@dataclass(frozen=True, slots=True)
class Handle:
    """A pair of numbers that can be moved.

    Attributes:
        keys: Its name: where the list of both stands, or the first of them in a longer list.
        pair: Both (latitude first, or metres east).
        entry: The entry that is removed with it; None if it cannot be removed.
    """

    keys: Keys
    pair: Pair
    entry: Keys | None = None


@dataclass(frozen=True, slots=True)
class CircleHandle:
    """A circle: its centre, and where its radius stands."""

    centre: Handle  # moves the circle
    radius_keys: Keys
    radius_m: float


@dataclass(frozen=True, slots=True)
class Ring:
    """A ring of corners, of an area or of a hole in it."""

    keys: Keys
    corners: tuple[Handle, ...]


@dataclass(frozen=True, slots=True)
class Region:
    """A fence or a no-fly zone. `entry` is removed with it; None if that must not be."""

    keys: Keys
    name: str  # shown on the page
    is_fence: bool
    rings: tuple[Ring, ...] = ()  # the outline, then its holes
    circle: CircleHandle | None = None
    entry: Keys | None = None

    @property
    def handles(self) -> list[Handle]:
        """Its corners, or its centre."""
        corners = [corner for ring in self.rings for corner in ring.corners]
        return [*corners, self.circle.centre] if self.circle else corners


def as_pair(value: Any) -> Pair | None:
    """The first two numbers of a list; None if it has none."""
    if not isinstance(value, list) or len(value) < 2:
        return None
    first, second = as_number(value[0]), as_number(value[1])
    return None if first is None or second is None else (first, second)


def as_number(value: Any) -> float | None:
    """A finite number; None if it is something else."""
    return float(value) if is_number(value) and abs(value) <= sys.float_info.max else None


def handle_of(value: Any, keys: Keys, entry: Keys | None = None) -> Handle | None:
    """A handle of a list that begins with a pair."""
    pair = as_pair(value)
    return Handle(keys, pair, entry) if pair else None


def ring_of(value: Any, keys: Keys) -> Ring | None:
    """The corners of a list of pairs; None if it is none."""
    if not isinstance(value, list):
        return None
    names = [(*keys, index) for index in range(len(value))]
    corners = map(handle_of, value, names, names)
    known = tuple(corner for corner in corners if corner)
    return Ring(keys, known) if len(known) == len(value) else None


def circle_of(value: Any, keys: Keys, *, centre: str, radius: str) -> CircleHandle | None:
    """A circle, its parts under these names."""
    if not isinstance(value, dict):
        return None
    handle = handle_of(value.get(centre), (*keys, centre))
    radius_m = as_number(value.get(radius))
    if handle is None or radius_m is None:
        return None
    return CircleHandle(handle, (*keys, radius), radius_m)


def entries_of(data: Any, keys: Keys) -> Iterator[tuple[Keys, Any]]:
    """The items of a list in a plan, with their keys; none where there is no list."""
    value = value_at(data, keys)
    for index, item in enumerate(value if isinstance(value, list) else []):
        yield (*keys, index), item


class Parts(ABC):
    """A mission's data and what of them can be edited; a kind of file has its own layout of them.

    Attributes:
        settable: Whether settings and names are possible in this kind of file.
        data: The file's values; they are changed in place.
        home, waypoints, rally_points, regions: What of them can be moved.
        rings: All borders of regions by their keys.
        in_metres: Pairs are metres, else degrees.
        origin: That of metres, in degrees.
    """

    settable: ClassVar[bool]

    def __init__(self, data: Any) -> None:
        self.data = data
        self.home: Handle | None = None  # None: the file has none that can be read
        self.waypoints: list[Handle] = []  # in the operator's order
        self.rally_points: list[Handle] = []
        self.regions: list[Region] = []  # fences first, then zones
        self.in_metres = False
        self.origin: Pair | None = None
        self._find()
        self._regions = {region.keys: region for region in self.regions}
        self.rings = {ring.keys: ring for r in self._regions.values() for ring in r.rings}

    def copied(self) -> Self:
        """The same parts of data that an edit may change: these here stay as they are."""
        copied = copy.copy(self)
        copied.data = copy.copy(self.data)  # of its values, `at` copies the changed ones
        return copied

    @abstractmethod
    def _find(self) -> None:
        """Find what can be moved in such a file."""

    def handles(self) -> Iterator[Handle]:
        """All that can be moved."""
        yield from [self.home] if self.home else []
        yield from self.waypoints
        yield from self.rally_points
        for region in self.regions:
            yield from region.handles

    # Places

    def geodetic(self, pair: Pair) -> Pair | None:
        """A pair of the file as latitude and longitude; None if it is not on Earth."""
        try:
            if self.in_metres:
                return self._frame().to_geodetic(Point(*pair))
        except (EditError, FrameError):
            return None
        return pair if abs(pair[0]) <= 90 and abs(pair[1]) <= 180 else None

    def digits(self, place: Pair) -> list[Digits]:
        """Latitude and longitude as the file would write them."""
        if self.in_metres:
            return [metres(value) for value in self._frame().to_local(*place)]
        return [degrees(value) for value in place]

    def _frame(self) -> LocalFrame:
        if self.origin is None:
            raise EditError("the mission's frame is not known; write frame.origin first")
        try:
            return LocalFrame(Geodetic(*self.origin))
        except FrameError as error:
            raise EditError(f"frame.origin: {error}; correct it first") from None

    # What each kind of file writes in its own way

    @abstractmethod
    def insert_waypoint(self, index: int, place: Pair) -> None:
        """Insert a waypoint with so many before it. Raises EditError: there are fewer."""

    @abstractmethod
    def add_rally_point(self, place: Pair) -> None:
        """Add a rally point behind the last one."""

    @abstractmethod
    def add_area(self, corners: Sequence[Pair], radius_m: float | None, *, fence: bool) -> None:
        """Add a zone or a fence, with a radius a circle around the only corner."""

    @abstractmethod
    def redraw(self, region: Region, corners: Sequence[Pair]) -> None:
        """Give an area another outline, in the place of a circle too."""

    @abstractmethod
    def set_altitude(self, waypoint: Handle, altitude_m: float | None) -> None:
        """Give a waypoint an altitude of its own; None: the mission's."""

    # Parts of the data

    def at(self, keys: Sequence[str | int]) -> Any:
        """The value at a path, to be changed: it and all on the way there are this one's own.

        The path may name the long form of what has the short one.
        """
        value = self.data
        for key in keys:
            if isinstance(value, list) and isinstance(key, str):
                continue
            if isinstance(value[key], list | dict):
                value[key] = copy.copy(value[key])
            value = value[key]
        return value

    def long_form(self, keys: Keys, key: str) -> dict[str, Any]:
        """An entry as a mapping; one in short form becomes one, with its value under a key."""
        parent, index = self.at(keys[:-1]), keys[-1]
        if not isinstance(parent[index], dict):
            parent[index] = {key: parent[index]}
        entry: dict[str, Any] = self.at(keys)
        return entry

    def take_out(self, keys: Keys) -> None:
        """Remove an item of a list, or a key."""
        del self.at(keys[:-1])[keys[-1]]

    def move(self, handle: Handle, place: Pair) -> None:
        """Write another pair in the place of a handle's."""
        numbers, first = self.at(handle.keys), 0
        if not isinstance(numbers, list):
            numbers, first = self.at(handle.keys[:-1]), int(handle.keys[-1])
        for index, digits in enumerate(self.digits(place), start=first):
            self.put(numbers, index, digits)

    def put(self, values: Any, key: str | int, digits: Digits) -> None:
        """Write a number, unless the one that stands there is the same, as fine as this one is."""
        old = as_number(values[key])
        if old is None or abs(old - digits) >= 0.5 * 10.0**-digits.decimals:
            values[key] = digits

    def handle(self, keys: Keys) -> Handle:
        """The part at these keys. Raises EditError: there is none."""
        handle = next((each for each in self.handles() if each.keys == keys), None)
        if handle is None:
            raise EditError("the mission has no such place any more")
        return handle

    def region(self, keys: Keys) -> Region:
        """The area that is called so. Raises EditError: there is none."""
        if keys not in self._regions:
            raise EditError("the mission has no such area any more")
        return self._regions[keys]
