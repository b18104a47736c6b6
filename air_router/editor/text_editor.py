"""Edits of a mission, as changes of its file's text; the same for YAML and for plans."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from air_router.editor import edits
from air_router.editor.edits import Edit, EditError
from air_router.editor.features import Features, Handle, Pair, Region, Ring
from air_router.files.mission_document import Keys
from air_router.files.text.rendering import (
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    Digits,
    degrees,
    metres,
)
from air_router.files.text.source import Splice, TextSource
from geo.frame import FrameError, Geodetic, LocalFrame, Point

_LEAST_CORNERS = 3


class TextEditor(ABC):
    """A mission's text, what can be moved in it, and how edits change it.

    Attributes:
        settable: whether settings and names are possible in this kind of file.
    """

    settable: ClassVar[bool]

    def __init__(self, source: TextSource, features: Features) -> None:
        self.source = source
        self.features = features
        self._handles = {handle.keys: handle for handle in features.handles()}  # by their keys
        self._regions = {region.keys: region for region in features.regions}  # by their keys
        # by their keys
        self._rings = {ring.keys: ring for region in features.regions for ring in region.rings}

    def splices(self, edit: Edit) -> list[Splice]:
        """The pieces of the text that an edit changes: what the method of its name (`do`) says.

        Raises:
            EditError: the mission has no such part, or would not survive.
            SourceError: the text is written in a way that cannot be edited here.
        """
        change: Callable[[Edit], list[Splice]] = getattr(self, edit.do)
        return change(edit)

    @abstractmethod
    def add_area(self, edit: edits.AddArea) -> list[Splice]:
        """Add a zone or a fence."""

    # Places

    @property
    def decimals(self) -> int:
        """How fine the file's pairs are."""
        return METRE_DECIMALS if self.features.in_metres else DEGREE_DECIMALS

    def pair(self, place: Pair) -> Pair:
        """Latitude and longitude as the file's pair."""
        return self._frame().to_local(*place) if self.features.in_metres else place

    def digits(self, place: Pair) -> list[Digits]:
        """Latitude and longitude as the file would write them."""
        return [
            (metres if self.features.in_metres else degrees)(value) for value in self.pair(place)
        ]

    def geodetic(self, pair: Pair) -> Pair | None:
        """The file's pair as latitude and longitude; None if it is not on Earth."""
        try:
            if self.features.in_metres:
                return self._frame().to_geodetic(Point(*pair))
        except (EditError, FrameError):
            return None
        return pair if abs(pair[0]) <= 90 and abs(pair[1]) <= 180 else None

    def _frame(self) -> LocalFrame:
        if self.features.origin is None:
            raise EditError("the mission's frame is not known; write frame.origin first")
        try:
            return LocalFrame(Geodetic(*self.features.origin))
        except FrameError as error:
            raise EditError(f"frame.origin: {error}; correct it first") from None

    # Edits that are the same in every file

    def move(self, edit: edits.Move) -> list[Splice]:
        """Write another pair."""
        return self._moved(self._handle(edit.keys), self.pair(edit.to))

    def _moved(self, handle: Handle, pair: Pair) -> list[Splice]:
        return [
            *self.source.number(handle.first, pair[0], self.decimals),
            *self.source.number(handle.second, pair[1], self.decimals),
        ]

    def shift(self, edit: edits.Shift) -> list[Splice]:
        """Write all pairs of an area anew; it keeps its size in metres."""
        region = self._region(edit.keys)
        handles = [corner for ring in region.rings for corner in ring.corners]
        handles += [region.circle.centre] if region.circle else []
        try:
            frame = LocalFrame(Geodetic(*edit.to))
            start = frame.to_local(*edit.origin)
            splices = []
            for handle in handles:
                here = self.geodetic(handle.pair)
                if here is None:
                    raise EditError(f"{region.name} has a corner that is not on Earth")
                point = frame.to_local(*here)
                east_m, north_m = point.east_m - start.east_m, point.north_m - start.north_m
                there = frame.to_geodetic(Point(east_m, north_m))
                splices += self._moved(handle, self.pair(there))
        except FrameError as error:
            raise EditError(f"{region.name} cannot be moved there: {error}") from None
        return splices

    def resize(self, edit: edits.Resize) -> list[Splice]:
        """Write another radius."""
        region = self._region(edit.keys)
        if region.circle is None:
            raise EditError(f"{region.name} is no circle")
        decimals = 1 if edit.radius_m >= 1 else METRE_DECIMALS
        return self.source.number(region.circle.radius_keys, edit.radius_m, decimals)

    def add_corner(self, edit: edits.AddCorner) -> list[Splice]:
        """Insert a corner into a ring."""
        ring = self._ring(edit.keys)
        if edit.index > len(ring.corners):
            raise EditError(f"the ring has only {len(ring.corners)} corners")
        return self.source.insert(ring.keys, edit.index, self.digits(edit.at))

    def remove(self, edit: edits.Remove) -> list[Splice]:
        """Take a place, a corner or an area out."""
        keys = edit.keys
        if keys in self._regions:
            region = self._regions[keys]
            if region.entry is None:
                return self.fence_removed(region)
            return self.source.remove(region.entry)
        handle = self._handle(keys)
        if handle.entry is None:
            raise EditError("this cannot be removed; move it instead")
        ring = self._rings.get(keys[:-1])
        if ring and len(ring.corners) <= _LEAST_CORNERS:
            raise EditError("an area needs three corners; remove the whole area instead")
        if len(self.features.waypoints) == 1 and handle is self.features.waypoints[0]:
            raise EditError("a mission needs a waypoint; move it instead")
        return self.source.remove(handle.entry)

    def fence_removed(self, region: Region) -> list[Splice]:
        """Remove a fence that is no entry of a list."""
        raise EditError(f"the {region.name} is removed by hand: write 'fence: null'")

    def _handle(self, keys: Keys) -> Handle:
        if keys not in self._handles:
            raise EditError("the mission has no such place any more")
        return self._handles[keys]

    def _region(self, keys: Keys) -> Region:
        if keys not in self._regions:
            raise EditError("the mission has no such area any more")
        return self._regions[keys]

    def _ring(self, keys: Keys) -> Ring:
        if keys not in self._rings:
            raise EditError("the mission has no such border any more")
        return self._rings[keys]

    def unused_name(self) -> str:
        """A name for a new zone."""
        names = {region.name for region in self.features.regions}
        number = sum(not region.is_fence for region in self.features.regions) + 1
        while f"zone {number}" in names:
            number += 1
        return f"zone {number}"
