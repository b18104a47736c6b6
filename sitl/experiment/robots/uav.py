"""A UAV of a run: the mission controller of `air_router`, and a vehicle, map and node for it.

It does what `air_router.flight` does around the same controller: events in, actions out, motions
sent a moment later and looked at again before they leave.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from air_router.controller import Controller
from air_router.controller.model import (
    Action,
    CommandConfirmed,
    CommandFailed,
    Event,
    Motion,
    PublishMap,
    RobotPath,
    RobotPose,
    Seeking,
    StateChanged,
)
from air_router.controller.targets import LinkSample
from air_router.gossip import TeamMessageDecoder
from air_router.messages import MAP_TOPIC, POSE_TOPIC, SEEK_TOPIC, PoseMessage, SeekMessage
from air_router.mission import FlightPlan, Mission
from geo.frame import Geodetic, Point
from geo.grid import SemanticGrid
from mocha_link.links import LinkEvent, MessageStored
from sitl.experiment import EventLog, EventQueue, RunSettings
from sitl.experiment.robots.flyer import AirframeFlyer, Flyer
from sitl.experiment.robots.node import EPOCH_S, Node
from sitl.world.explorers import degrees
from sitl.world.towns import Camera, Raster


class MapPainter:
    """The map that a UAV paints, as `air_router.gossip.mapper.Mapper` does from patches.

    Args:
        origin: Of the map's frame.
        raster: What there is to see.
        camera: What the UAV sees of it.

    Attributes:
        camera: As given.
        grid: The map, over the raster's bounds at its resolution.
        known_cells: How many of its cells are known.
    """

    def __init__(self, origin: Geodetic, raster: Raster, camera: Camera) -> None:
        self._raster = raster  # the truth
        self.camera = camera
        self._last: tuple[Point, float, float] | None = None  # seen from
        self._published = 0  # how many cells the last published map knew
        self.known_cells = 0
        self.grid = SemanticGrid(
            *(origin, raster.resolution_m, raster.west_m, raster.south_m),
            np.zeros_like(raster.cells),
        )

    @property
    def known_share(self) -> float:
        """How much of it is known, 0..1."""
        return self.known_cells / self.grid.cells.size

    def paint(self, position: Point, height_m: float, heading_deg: float) -> None:
        """Take a picture from above; its upper edge points along the heading."""
        seen_from = position, height_m, heading_deg
        patch = None if seen_from == self._last else self.camera.picture(self._raster, *seen_from)
        if patch is not None:
            self._last = seen_from
            self.known_cells += self.grid.paint(patch)

    def publish(self) -> bytes | None:
        """The map for the gossip node, or None when nothing was painted since the last call."""
        if self.known_cells == self._published:
            return None
        self._published = self.known_cells
        return self.grid.encode()


COMMAND_S: Final = 0.05
"""From a decision to the vehicle following it."""

CAMERA: Final = Camera(fov_across_deg=60.0, fov_along_deg=45.0, interval_s=2.0)
"""As in the world of missions/urban: from 60 m it sees 69 m by 50 m."""

SEEK_AGAIN_S: Final = 30.0


class Uav:
    """One UAV.

    Attributes:
        node: Its gossip node; set once it is made.
        painter: The map that it publishes.
        controller: Its mission controller, from `controllers_of`.
        states: (time, state) of every change of it.
    """

    node: Node

    def __init__(  # noqa: PLR0913, PLR0917 - what a flight is put together from
        self,
        name: str,
        mission: Mission,
        plan: FlightPlan,
        settings: RunSettings,
        queue: EventQueue,
        log: EventLog,
        controller: Controller,
        painter: MapPainter,
    ) -> None:
        self.name = name
        kind = Flyer if settings.airframe == "plain" else AirframeFlyer
        self.flyer = kind(plan, mission, settings)
        self.painter = painter
        self.controller = controller
        self.states: list[tuple[float, str]] = []
        self._frame = mission.frame  # of degrees that it publishes
        self._queue = queue
        self._log = log
        self._reader = TeamMessageDecoder(mission.frame)
        self._waiting: Motion | None = None  # decided, not sent to the vehicle yet
        self._map_every_s = settings.map_interval_s  # least time between maps for peers
        self._map_at_s = self._picture_at_s = self._seek_at_s = -math.inf  # of the last ones
        self._seen = False  # robots are, by an oracle
        self._sought: str | None = None  # as published last; None: it seeks none

    @property
    def heading_deg(self) -> float:
        """Where it flew to last, in whole degrees clockwise from north."""
        east, north = self.flyer.direction
        return float(round(math.degrees(math.atan2(east, north))) % 360)

    @property
    def flies(self) -> bool:
        """Whether it is so high that it sees and is received from above."""
        return self.flyer.altitude_m >= self.painter.camera.min_height_m and not self.flyer.landed

    @property
    def links(self) -> Sequence[LinkSample]:
        """The links that its controller has measured."""
        return self.controller.links

    def tick(self) -> None:
        """Fly on, and pass telemetry to the controller."""
        now_s = self._queue.now_s
        self.flyer.fly(now_s)
        if now_s - self._picture_at_s >= self.painter.camera.interval_s:
            self._picture_at_s = now_s
            self.painter.paint(self.flyer.position, self.flyer.altitude_m, self.heading_deg)
        self._handle(self.flyer.telemetry())

    def receive(self, event: LinkEvent) -> None:
        """Something has happened on the links."""
        if isinstance(event, MessageStored) and event.robot == self.name:
            return  # the controller knows its own messages
        self._handle(event)
        if not isinstance(event, MessageStored):
            return
        decoded = self._reader.event_of(
            event.robot,
            event.topic,
            self.node.data_of(event),
            peer=event.peer,
            unix_s=self.node.now.unix_s,
        )
        if isinstance(decoded, RobotPose) and self._seen and decoded.peer == decoded.robot:
            # Stamped now: a message older than the sighting would not count.
            self.see(decoded.robot, decoded.position, decoded.peer)
        elif decoded is not None:
            self._handle(_rounded(decoded))

    def see(self, robot: str, position: Point, peer: str = "oracle") -> None:
        """An oracle (or `peer`, the robot itself) publishes a position; so the robot is found."""
        self._seen = True
        self._handle(RobotPose(robot, _millimetres(position), EPOCH_S + self._queue.now_s, peer))

    def outbox(self) -> list[tuple[str, bytes]]:
        """Its messages for a peer that requests them now."""
        now_s = self._queue.now_s
        where = degrees(self._frame, self.flyer.position)
        pose = PoseMessage(stamp_s=EPOCH_S + now_s, **where, heading_deg=self.heading_deg)
        messages = [(POSE_TOPIC, pose.encode()), *self.map_due()]
        if now_s - self._seek_at_s >= SEEK_AGAIN_S and math.isfinite(self._seek_at_s):
            messages.append(self._seek_message())
        return messages

    def map_due(self) -> list[tuple[str, bytes]]:
        """Its map, if it is time for one and it has grown."""
        due = self._queue.now_s - self._map_at_s >= self._map_every_s
        return self._map() if due else []

    def _handle(self, event: Event) -> None:
        self._log.event(self.name, event)
        for action in self.controller.handle(event, self._queue.now_s):
            self._log.action(self.name, action)
            self._act(action)

    def _act(self, action: Action) -> None:
        if isinstance(action, Motion):
            if self._waiting is None:
                self._queue.after(COMMAND_S, self._send)
            self._waiting = action
        elif isinstance(action, PublishMap):
            for topic, data in self._map():
                self.node.publish(topic, data)
            self.node.exchange(self._sought)
        elif isinstance(action, Seeking):
            self._sought = action.robot
            self.node.publish(*self._seek_message())
        elif isinstance(action, StateChanged):
            self.states.append((self._queue.now_s, action.target.name))
        # all else is text for a pilot, who is not simulated

    def _send(self) -> None:
        """Send the newest motion, if it is still the right one from where the vehicle is."""
        motion, self._waiting = self._waiting, None
        if motion is None:
            raise AssertionError("a motion was waiting")
        now_s = self._queue.now_s
        objection = self.controller.objection(motion, now_s)
        if objection is not None:
            self._handle(CommandFailed(motion, objection, sent=False))
            return
        self.flyer.fly(now_s)
        self.flyer.command(motion)
        self._handle(CommandConfirmed(motion))

    def _map(self) -> list[tuple[str, bytes]]:
        self._map_at_s = self._queue.now_s
        grown = self.painter.publish()
        return [] if grown is None else [(MAP_TOPIC, grown)]

    def _seek_message(self) -> tuple[str, bytes]:
        self._seek_at_s = self._queue.now_s
        message = SeekMessage(stamp_s=EPOCH_S + self._queue.now_s, robot=self._sought)
        return SEEK_TOPIC, message.encode()


def _rounded(decoded: Event) -> Event:
    """The same to a millimetre: projections differ in their last digits from machine to machine."""
    if isinstance(decoded, RobotPose):
        return replace(decoded, position=_millimetres(decoded.position))
    if isinstance(decoded, RobotPath):
        return replace(decoded, points=tuple(map(_millimetres, decoded.points)))
    return decoded


def _millimetres(place: Point) -> Point:
    return Point(round(place.east_m, 3), round(place.north_m, 3))
