"""The semantic map that the UAV paints in flight and publishes to every peer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import zmq
import zmq.asyncio

from air_router.errors import RefusedError
from air_router.gossip.limits import MARGIN_M, RESOLUTION_M
from air_router.mission import Mission
from geo.frame import Point
from geo.grid import MAX_CELLS, GridError, GridPatch, SemanticGrid

_DRAWN_IN: Final = 0.99


@dataclass(frozen=True, slots=True)
class MapVersion:
    """The painted part of the map at a time on the vehicle's clock."""

    time_s: float
    known_cells: int  # painted by then


class Mapper:
    """Assembles camera patches into one grid, with its history."""

    def __init__(self, mission: Mission) -> None:
        places = [mission.home, *(waypoint.position for waypoint in mission.waypoints)]
        places += [corner for fence in mission.fences for corner in fence.corners]
        south_west = Point(
            min(p.east_m for p in places) - MARGIN_M, min(p.north_m for p in places) - MARGIN_M
        )
        north_east = Point(
            max(p.east_m for p in places) + MARGIN_M, max(p.north_m for p in places) + MARGIN_M
        )
        # the area where the mission may fly; if it is too large, the part around home
        corners = _around(mission.home, south_west, north_east)
        self.grid = SemanticGrid.blank(mission.frame.origin, RESOLUTION_M, *corners)
        self.known_cells = 0  # painted at least once
        self.refused = 0  # unreadable patches
        self.published: list[MapVersion] = []  # each published version, in order

    def paint(self, patch: bytes) -> bool:
        """Add a patch from the camera; False (and counted) if it is unreadable."""
        try:
            self.known_cells += self.grid.paint(GridPatch.decode(patch))
        except GridError:
            self.refused += 1
            return False
        return True

    def publish(self, time_s: float) -> bytes | None:
        """The map to publish; None if nothing was painted since the last version."""
        if self.published and self.published[-1].known_cells == self.known_cells:
            return None
        self.published.append(MapVersion(time_s, self.known_cells))
        return self.grid.encode()

    def published_before(self, time_s: float) -> int:
        """Known cells of the newest version published at or before a time."""
        return next((v.known_cells for v in reversed(self.published) if v.time_s <= time_s), 0)


def _around(home: Point, south_west: Point, north_east: Point) -> tuple[Point, Point]:
    """The rectangle, shrunk toward home until it fits a grid."""

    def cells() -> float:
        sides_m = (b - a for a, b in zip(south_west, north_east, strict=True))
        return math.prod(side_m / RESOLUTION_M + 2.0 for side_m in sides_m)

    def nearer(corner: Point) -> Point:
        return Point(*(h + _DRAWN_IN * (c - h) for h, c in zip(home, corner, strict=True)))

    while cells() > MAX_CELLS:
        south_west, north_east = nearer(south_west), nearer(north_east)
    return south_west, north_east


async def receive_patches(endpoint: str, take: Callable[[bytes], object]) -> None:
    """Pass every patch of a camera (ZeroMQ PUB at `endpoint`) to `take`, until canceled.

    Raises:
        RefusedError: ZeroMQ cannot connect to such an endpoint.
    """
    context = zmq.asyncio.Context()
    socket = context.socket(zmq.SUB)
    socket.linger = 0
    socket.subscribe(b"")
    try:
        try:
            socket.connect(endpoint)
        except zmq.ZMQError as error:
            raise RefusedError(
                f"{endpoint}: not a camera's endpoint ({error}); write tcp://HOST:PORT"
            ) from None
        while True:
            frames = await socket.recv_multipart()
            take(frames[-1])
    finally:
        socket.close()
        context.term()
