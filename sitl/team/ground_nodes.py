"""The gossip nodes of the simulated ground robots: their radios' readings, and what each holds."""

from __future__ import annotations

import contextlib
import json
import logging
import queue
import socket
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Final
from urllib.parse import urlsplit

from geo.grid import GridError, SemanticGrid
from mocha_link.clock import Clock
from mocha_link.links.metrics import LinkEvent, LinkMetrics, MessageStored
from mocha_link.node.lifetime import Closeable
from mocha_link.node.node import Message, Node
from mocha_link.team.team import Team
from sitl.world.world import Publication, Reading


class RadioReadings(Closeable):
    """Sends readings to each robot's `radio` endpoint; robots without one get none."""

    def __init__(self, team: Team) -> None:
        self._endpoints = {  # host and port, by robot
            robot.name: _endpoint(robot.radio)
            for robot in team.robots.values()
            if robot.radio is not None
        }
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # sends only
        self._socket.setblocking(False)

    def tell(self, readings: Iterable[Reading]) -> None:
        """Send readings; one that has no listener is lost, as on any radio."""
        for reading in readings:
            endpoint = self._endpoints.get(reading.robot)
            if endpoint is None:
                continue
            data = json.dumps({"peer": reading.peer, "rssi_dbm": reading.rssi_dbm}).encode()
            with contextlib.suppress(OSError):
                self._socket.sendto(data, endpoint)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()


def _endpoint(url: str) -> tuple[str, int]:
    parts = urlsplit(url)  # the team file has checked its form
    return parts.hostname or "", parts.port or 0


_log = logging.getLogger(__name__)

MAP_TYPE: Final = "grid/SemanticMap"
MAP_HISTORY_LIMIT: Final = 100_000


@dataclass(frozen=True, slots=True)
class HeldMap:
    """The newest map that a robot holds: who made it, when, and how much of it is known."""

    maker: str
    stamp_s: float
    grid: SemanticGrid
    known_cells: int


@dataclass(slots=True)
class MapKeeper:
    """Takes the maps that reach a robot.

    Attributes:
        newest: The map in use.
        history: (Unix seconds of the simulation, known cells) at every map that came.
        refused: Maps that could not be read.
    """

    newest: HeldMap | None = None
    history: list[tuple[float, int]] = field(default_factory=list)
    refused: int = 0

    def take(self, message: Message, now_s: float) -> None:
        """Use a map message from now on; one that makes no sense is counted and left alone."""
        try:
            grid = SemanticGrid.decode(message.data)
        except GridError as error:
            self.refused += 1
            _log.warning("a map of %s makes no sense: %s", message.robot, error)
            return
        known_cells = grid.known_cells
        self.newest = HeldMap(message.robot, message.stamp_s, grid, known_cells)
        if len(self.history) < MAP_HISTORY_LIMIT:
            self.history.append((now_s, known_cells))


class GroundNodes(Closeable):
    """One gossip node per ground robot, each with its own sockets and thread.

    Args:
        team: Who listens where.
        names: The ground robots.
        clock: The simulation's clock, which the nodes stamp with.

    Raises:
        mocha_link.errors.MochaLinkError: a node cannot listen.
    """

    def __init__(self, team: Team, names: Iterable[str], clock: Clock) -> None:
        self._team = team
        self._arrivals: queue.SimpleQueue[tuple[str, MessageStored]] = queue.SimpleQueue()  # maps
        self._unsubscribe: list[Callable[[], object]] = []  # from each node
        self.keepers = {name: MapKeeper() for name in names}  # the maps that reach each robot
        self.nodes: dict[str, Node] = {}
        try:
            for name in self.keepers:
                node = self.nodes[name] = Node(team, name, clock=clock)
                self._unsubscribe.append(node.subscribe(partial(self._note, name)))
                node.start()
        except BaseException:
            self.close()
            raise

    def publish(self, publications: Iterable[Publication]) -> None:
        """Let robots say something."""
        for said in publications:
            self.nodes[said.robot].publish(said.topic, said.data)

    def take_maps(self) -> None:
        """Let each robot look at the maps that have arrived since the last call."""
        while True:
            try:
                name, event = self._arrivals.get_nowait()
            except queue.Empty:
                return
            message = self.nodes[name].latest(event.robot, event.topic)
            if message is not None:
                self.keepers[name].take(message, event.at_s)

    def messages(self) -> Mapping[str, list[Message]]:
        """What each robot holds."""
        return {name: node.messages() for name, node in self.nodes.items()}

    def links(self) -> Mapping[str, Mapping[str, LinkMetrics]]:
        """The links of each robot, by peer."""
        return {name: node.links() for name, node in self.nodes.items()}

    def close(self) -> None:
        """Stop all nodes, at the same time."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        if self.nodes:
            with ThreadPoolExecutor(len(self.nodes)) as pool:
                list(pool.map(lambda node: node.close(), self.nodes.values()))

    def _note(self, name: str, event: LinkEvent) -> None:
        """On the node's thread, so quick: maps are looked at later."""
        if not isinstance(event, MessageStored) or event.robot == name:
            return
        if self._team.topic(event.robot, event.topic).type == MAP_TYPE:
            self._arrivals.put((name, event))
