"""Serves the live page of a flight: browsers receive the scene and the map, and send requests."""

import asyncio
import base64
import json
import math
import time
from collections.abc import AsyncIterator, Callable, Collection, Iterator
from contextlib import asynccontextmanager
from typing import Any, Final

import numpy as np

from air_router.control import (
    COSTLY_AT_ONCE,
    COSTLY_PER_S,
    TOO_MANY,
    Budget,
    RequestHandler,
    command_request_of,
)
from air_router.controller import FlightStatus
from air_router.controller.model import Action, Event
from air_router.gossip import Interactions, Mapper
from air_router.live.scene import LiveScene, scenery
from air_router.routing import Router
from air_router.web import HERE, SHOWN_AT, Browsers, PageOutbox, Say, Site, Web, as_json, degrees
from geo.frame import LocalFrame, Point
from geo.grid import Cells
from mocha_link.errors import Guard, RequestError
from mocha_link.links import Direction, SyncEnded

TICK_S: Final = 0.1
SLOW_TICKS: Final = 5
"""The map is sent once per this many ticks."""

REQUESTS_PER_S, REQUESTS_AT_ONCE = 20.0, 40.0

READ_EVERY_S: Final = 0.05
"""Interval at which a page's requests are read: a flood of requests waits at its sender."""

_HISTORIES: Final = {"rows": "rows", "track": "points", "log": "lines"}
"""The growing lists of the scene, and the message keys of their parts."""

_MOST_CELLS: Final = 600_000
"""Most cells that a page draws; of a larger map only every second (third, ...) row and column is
shown."""

Steer = Callable[[dict[str, Any]], dict[str, Any]]
"""Handles a page's request to a recorded flight; raises RequestError."""

Status = Callable[[], FlightStatus]


class MapFeed:
    """Sends the map that the UAV paints to pages; read-only."""

    def __init__(self, mapper: Mapper, frame: LocalFrame, interactions: Interactions) -> None:
        self._mapper, self._frame, self._interactions = mapper, frame, interactions
        # only every n-th cell is shown
        self._step = max(1, math.ceil(math.sqrt(mapper.grid.cells.size / _MOST_CELLS)))
        self._sent: Cells = np.zeros_like(self._shown())  # last state sent to the pages
        self._sent_cells = -1  # known cells in `_sent`
        self._held: dict[str, int] = {}  # known cells of the map that each peer has

    def event(self, event: Event) -> None:
        """Note which map a robot has fetched: the one at the start of its sync."""
        match event:
            case SyncEnded(peer=peer, direction=Direction.OUT):
                began_s = self._interactions.syncs[-1].from_s
                self._held[peer] = self._mapper.published_before(began_s)

    def share(self, robot: str) -> float | None:
        """The share of the currently known cells that a robot holds; None: none."""
        held, known = self._held.get(robot), self._mapper.known_cells
        return None if not held or not known else round(min(held / known, 1.0), 3)

    def whole(self) -> dict[str, Any]:
        """The map's position, and all cells sent to the pages."""
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

    def update(self) -> dict[str, Any] | None:
        """The part of the map that has changed since the last call; None: none."""
        if self._mapper.known_cells == self._sent_cells:
            return None
        self._sent_cells = self._mapper.known_cells
        changed = np.nonzero(self._shown() != self._sent)
        self._sent = self._shown().copy()
        return self._piece(changed)

    def _shown(self) -> Cells:
        return self._mapper.grid.cells[:: self._step, :: self._step]

    def _piece(self, where: tuple[Any, ...]) -> dict[str, Any] | None:
        """The rectangle around some cells: first row (from the south), column, and the cells."""
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


class LivePage:
    """One flight on a page, for any number of browsers.

    Attributes:
        steer: Handles the page's requests to a recorded flight; None: a live flight.
        record: The plots of a whole recorded flight.

    Args:
        status: Returns the flight's status.
        router: Gives the router among the zones in force.
        command_service: Carries out the page's requests.
        mapper: The map that the UAV paints; read-only.
        web: Where the page is served.
        name: The UAV's name, if its mission has none.
    """

    def __init__(  # noqa: PLR0913 - a page has many sources
        self,
        status: Status,
        router: Callable[[], Router],
        command_service: RequestHandler,
        *,
        mapper: Mapper,
        web: Web = HERE,
        name: str = "UAV",
    ) -> None:
        self._status, self._router = status, router
        self._name = router().graph.mission.uav or name  # the UAV's, in the team
        self._commands = command_service
        self._web = web
        self._sent: dict[str, str] = {}  # newest text of each kind
        self._ticks = 0  # refreshes
        self._harmless = Guard("the page could not be updated")
        self._begin(mapper)
        self.steer: Steer | None = None
        self.record: dict[str, Any] = {}
        self._requests = Budget(REQUESTS_PER_S, REQUESTS_AT_ONCE, time.monotonic)  # of all browsers
        self._costly = Budget(COSTLY_PER_S, COSTLY_AT_ONCE, time.monotonic)  # of requests that plan
        # all browsers
        self._browsers = Browsers(self._receive, self._welcome, pause_s=READ_EVERY_S)
        self._site = Site(web, "air_router.live", "live")
        self._site.add_socket("/socket", self._browsers.converse)
        self._site.add_values("/flights", self._flights)

    def _begin(self, mapper: Mapper) -> None:
        mission = self._router().graph.mission
        self.scene = LiveScene(mission, self._status, self._router, self._name)
        self._map_feed = MapFeed(mapper, mission.frame, self.scene.interactions)
        self._draw_scenery()
        self._sent_counts = dict.fromkeys(_HISTORIES, 0)  # entries sent to the pages, by list

    def restart(self, mapper: Mapper) -> None:
        """Show the flight from the beginning again."""
        self._sent.clear()
        self._begin(mapper)
        for kind, text in self._greeting():
            self._browsers.broadcast(kind, text)

    def step(self, event: Event, actions: Collection[Action], now_s: float) -> None:
        """Take in what happened, and what was decided on it."""
        with self._harmless:
            self.scene.step(event, actions, now_s)
            self._map_feed.event(event)

    @asynccontextmanager
    async def serving(self, say: Say) -> AsyncIterator[str]:
        """Serve while in the context; gives the page's address, and prints it.

        Raises:
            ServeError: the address is taken, or none of this machine's.
        """
        async with self._site.serving() as address:
            say(f"{SHOWN_AT}{address}")
            ticking = asyncio.create_task(self._run())
            try:
                yield address
            finally:
                ticking.cancel()
                await asyncio.gather(ticking, return_exceptions=True)
                with self._harmless:
                    self._tick()  # the outcome
                await asyncio.sleep(TICK_S)

    async def _run(self) -> None:
        while True:
            with self._harmless:
                self._tick()
            await asyncio.sleep(TICK_S)

    def _tick(self) -> None:
        """Send changes to all pages."""
        scene, status = self.scene, self._status()
        self._ticks += 1
        if status.airspace.revision != self._revision:
            self._draw_scenery()
            self._browsers.broadcast("scenery", self._scenery)
        self.publish("vehicle", scene.vehicle(status))
        self.publish("robots", {"robots": scene.robots()})
        self.publish("alarms", {"alarms": scene.open_alarms(status)})
        if self._ticks % SLOW_TICKS == 1:
            piece = self._map_feed.update()
            if piece is not None:
                self._browsers.broadcast(
                    f"piece {self._ticks}", as_json({"type": "piece", **piece})
                )
        links = scene.link_lines(status)
        for link in links:
            link["map_share"] = self._map_feed.share(link["peer"])
        self.publish("links", {"links": links})
        for kind, start in self._sent_counts.items():
            count = scene.histories[kind].count
            if count > start and not (kind == "rows" and self.record):
                self._sent_counts[kind] = count
                self._browsers.broadcast(f"{kind} {start}", self._since(kind, start))

    def publish(self, kind: str, values: dict[str, Any]) -> None:
        """Send a message to all pages, unless it is unchanged."""
        text = as_json({"type": kind, **values})
        if self._sent.get(kind) != text:
            self._sent[kind] = text
            self._browsers.broadcast(kind, text)

    def _draw_scenery(self) -> None:
        """Draw the scenery again after zones have changed."""
        self._revision = self._status().airspace.revision
        router = self._router()
        self._scenery = as_json({"type": "scenery", **scenery(router.graph.mission, router)})

    def _since(self, kind: str, start: int = 0) -> str:
        """The entries of a list from number `start` on."""
        items = self.scene.histories[kind].since(start)
        message: dict[str, Any] = {"type": kind, _HISTORIES[kind]: items}
        if kind == "track":
            message["from"] = start
        elif kind == "log":
            message["now_s"] = self.scene.now_s
        return as_json(message)

    def _flights(self) -> dict[str, Any]:
        """The flights of this page: only its own; see JointPage."""
        return {"flights": [{"name": self._name, "socket": "/socket"}]}

    def _greeting(self) -> Iterator[tuple[str, str]]:
        """All messages for a newly connected page."""
        yield "welcome", as_json({"type": "welcome", "backdrop": self._web.backdrop})
        yield "scenery", self._scenery
        yield "map", as_json({"type": "map", **self._map_feed.whole()})
        yield "track", self._since("track")
        yield "log", self._since("log")
        yield "rows", as_json(self.record) if self.record else self._since("rows")
        yield from self._sent.items()

    def _welcome(self, outbox: PageOutbox) -> None:
        for kind, text in self._greeting():
            outbox.post(kind, text)

    def _receive(self, outbox: PageOutbox, text: str) -> None:
        # A fault in a decision ends the flight, as with any other source of requests.
        asyncio.get_running_loop().call_soon(self._respond, outbox, text)

    def _respond(self, outbox: PageOutbox, text: str) -> None:
        answer = self._answer(text)
        outbox.post(f"answer {answer['id']}", json.dumps(answer, separators=(",", ":")))

    def _answer(self, text: str) -> dict[str, Any]:
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            return {"type": "refused", "id": None, "kind": "request", "why": "not a request"}
        number = values.get("id") if isinstance(values, dict) else None
        number = number if isinstance(number, int) else None
        try:
            if self.steer is not None and isinstance(values, dict) and "ask" in values:
                return {"type": "done", "id": number, **self.steer(values)}
            command = command_request_of(values)
            if not (self._requests.spend() and self._costly.affords(command)):
                return {"type": "refused", "id": number, "kind": "busy", "why": TOO_MANY}
            return {"type": "done", **self._commands.execute(command, "the page"), "id": number}
        except RequestError as error:
            return {"type": "refused", "id": number, "kind": "request", "why": str(error)}
