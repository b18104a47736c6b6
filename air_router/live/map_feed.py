"""The map that the UAV paints, as pages receive it: what is new, and who holds how much."""

import base64
import math
from typing import Any, Final

import numpy as np

from air_router.controller.model.events import Event
from air_router.gossip.mapper import Mapper
from air_router.web.outlines import degrees
from geo.frame import LocalFrame, Point
from geo.grid import Cells
from mocha_link.links.metrics import Direction, SyncEnded, SyncStarted

_MOST_CELLS: Final = 600_000
"""A page draws no more; of a larger map every second, third ... row and column is shown."""


class MapFeed:
    """Reads the map; paints nothing."""

    def __init__(self, mapper: Mapper, frame: LocalFrame) -> None:
        self._mapper = mapper
        self._frame = frame
        # only each so many'th cell is shown
        self._step = max(1, math.ceil(math.sqrt(mapper.grid.cells.size / _MOST_CELLS)))
        self._sent: Cells = np.zeros_like(self._shown())  # as the pages have it
        self._sent_cells = -1  # number of known cells in `_sent`
        self._began_s: dict[str, float] = {}  # when each peer's pull began
        self._held: dict[str, int] = {}  # cells known in the map that each peer has

    def event(self, event: Event, now_s: float) -> None:
        """Take in what robots have fetched: a map that was there when they began."""
        match event:
            case SyncStarted(peer=peer, direction=Direction.OUT):
                self._began_s[peer] = now_s
            case SyncEnded(peer=peer, direction=Direction.OUT) if peer in self._began_s:
                self._held[peer] = self._mapper.published_before(self._began_s[peer])

    def share(self, robot: str) -> float | None:
        """The share of the cells known now that a robot holds; None if it has fetched none."""
        held, known = self._held.get(robot), self._mapper.known_cells
        return None if not held or not known else round(min(held / known, 1.0), 3)

    def whole(self) -> dict[str, Any]:
        """Where the map lies, and all of it that pages received."""
        grid = self._mapper.grid
        rows, columns = self._sent.shape
        size_m = self._step * grid.resolution_m
        south_west = Point(grid.west_m, grid.south_m)
        north_east = Point(grid.west_m + columns * size_m, grid.south_m + rows * size_m)
        return {
            "bounds": [degrees(self._frame, south_west), degrees(self._frame, north_east)],
            "rows": rows,
            "columns": columns,
            "piece": self._piece(np.nonzero(self._sent)),
        }

    def news(self) -> dict[str, Any] | None:
        """The piece of the map that has changed since this was asked last; None: nothing."""
        if self._mapper.known_cells == self._sent_cells:
            return None
        self._sent_cells = self._mapper.known_cells
        shown = self._shown()
        changed = np.nonzero(shown != self._sent)
        if not len(changed[0]):
            return None
        self._sent = shown.copy()
        return self._piece(changed)

    def _shown(self) -> Cells:
        return self._mapper.grid.cells[:: self._step, :: self._step]

    def _piece(self, where: tuple[Any, ...]) -> dict[str, Any] | None:
        """The rectangle around some cells: first row (from the south) and column, and the cells."""
        rows, columns = where
        if not len(rows):
            return None
        south, north = int(rows.min()), int(rows.max()) + 1
        west, east = int(columns.min()), int(columns.max()) + 1
        cells = np.ascontiguousarray(self._sent[south:north, west:east])
        return {
            "row": south,
            "column": west,
            "rows": north - south,
            "columns": east - west,
            "cells": base64.b64encode(cells.tobytes()).decode("ascii"),
        }
