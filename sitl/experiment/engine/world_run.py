"""A mission in its own world, flown by what experiments are made of.

The world is `sitl.world`'s: robots on patrol, radios, camera. `air-router sim` flies the same
mission, world and seed with a simulated autopilot, MAVLink, sockets and clocks; `sitl experiment
fidelity` compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from air_router.controller.controller import Controller
from air_router.controller.model.flight_setup import FlightSetup
from air_router.errors import UsageError
from air_router.files.settings import SeekPolicy
from air_router.gossip.gossip import MAP_INTERVAL_S
from air_router.mission.flight_plan import FlightPlan
from air_router.mission.loading import load_mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Router
from mocha_link.team.team import Team
from sitl.experiment.engine.channel import Change, Link, Load, Places
from sitl.experiment.engine.channel_sim import ChannelSim
from sitl.experiment.engine.exchange import AirtimeStats
from sitl.experiment.events import EventLog, EventQueue
from sitl.experiment.robots.node import Node
from sitl.experiment.robots.uav import MapPainter, Uav
from sitl.experiment.settings import RunSettings
from sitl.team.roles import make_world, roles_of
from sitl.world.world import STEP_S, Step, Truth
from sitl.world.world_file import load_world

BATTERY_MIN: Final = 25.0
"""What `sitl vehicle` flies with, unless it is told otherwise."""

_NOWHERE: Final = np.zeros((0, 3))  # the world knows where robots are
_ROUND_TRIP_S: Final = 0.01
_LANDED_S: Final = 300.0  # after the mission's duration at the latest


class _WorldSim(ChannelSim):
    """Has the world's radios carry what nodes say, and tell them whom they hear."""

    step = Step()  # the world's newest

    def report(self) -> None:
        for heard in self.step.readings:
            node = self._nodes[self._numbers[heard.robot]]
            node.gossip.heard(heard.peer, heard.rssi_dbm, node.now)

    def tell_contact(self, a: int, b: int, began_s: float, *, up: bool) -> None:
        """The readings tell."""

    def changes(self) -> list[Change]:
        """Links that the world has cut or restored, by the robots' numbers."""
        numbers = self._numbers
        ends = [(numbers[link.a], numbers[link.b], link.up) for link in self.step.links]
        return [Change(min(a, b), max(a, b), up) for a, b, up in ends]


class _WorldChannel:
    """No transmission disturbs another, and bytes cost nothing."""

    patience_s = math.inf
    pull_every_s: float | None = None
    frame_by_frame = True
    sim: _WorldSim  # that sends over it

    def look(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        return self.sim.changes()

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002
        return load.round_trips * _ROUND_TRIP_S

    def turn(self, link: Link, ready_s: float) -> tuple[float, ...]:
        return (ready_s, *link)

    def pick(self, waiting: Iterable[Link], busy: Sequence[Link]) -> int | None:  # noqa: ARG002
        return 0


class WorldRun:
    """A mission in its own world, in simulated time.

    Args:
        path: The mission's file; it names team and world.
        seed: Of the world.
        queue: Tells the time.
        log: Takes what the controller is told, and what it asks for.
        policy: Whom it seeks, whatever the mission says.

    Attributes:
        uav: Flies it.
        nodes: Of all robots, by name.

    Raises:
        AirRouterError: the files are not what they should be.
    """

    def __init__(
        self, path: Path, seed: int, queue: EventQueue, log: EventLog, policy: SeekPolicy
    ) -> None:
        mission = replace(load_mission(path), seek_policy=policy)
        if mission.team is None:
            raise UsageError(f"{path} names no team; add 'team: team.yaml' to it")
        team = Team.load(mission.team)
        roles = roles_of(mission, team)
        plan = load_world(mission.world, mission, roles.ground, seed)
        self._queue = queue
        self._ends_s = (mission.duration_s or 3600.0) + _LANDED_S
        self._world = make_world(mission, team, roles, plan)
        settings = RunSettings(
            town=path,
            airframe="px4",
            battery=BATTERY_MIN,
            map_interval_s=MAP_INTERVAL_S - STEP_S / 2,  # looked at every step
        )
        flight_plan, router = FlightPlan.of(mission), Router(WaypointGraph(mission))
        setup = FlightSetup(mission, mission.seek or roles.ground, name=roles.vehicles[0])
        self.uav = uav = Uav(
            *(roles.vehicles[0], mission, flight_plan, settings, queue, log),
            Controller(setup, router, flight_plan),
            MapPainter(mission.frame.origin, self._world.settings.raster, plan.camera),
            plan.picture_interval_s,
        )
        flies = {"publish": uav.say, "hear": uav.hear}
        drives: dict[str, Any] = {"publish": list, "hear": lambda _event: None}
        self.nodes = {
            name: Node(number, name, team, queue, triggered=True, **(drives if number else flies))
            for number, name in enumerate((roles.vehicles[0], *roles.ground))
        }
        uav.node = self.nodes[uav.name]
        channel = _WorldChannel()
        nodes = list(self.nodes.values())
        channel.sim = self._sim = _WorldSim(queue, channel, nodes, AirtimeStats(lambda _row: None))

    def finish(self) -> list[int]:
        """Fly until it has landed; the bytes that arrived on each of the UAV's links, by end."""
        queue, uav = self._queue, self.uav
        queue.every(STEP_S, self._tick)
        while queue.now_s < self._ends_s and not uav.flyer.landed:
            queue.run(queue.now_s + 1.0)
        links = [(name, node.gossip.links(node.now)) for name, node in self.nodes.items()]
        ends = [(name, peer, link.bytes_in) for name, of in links for peer, link in of.items()]
        return [size for name, peer, size in ends if uav.name in {name, peer}]

    def _tick(self) -> None:
        uav, now = self.uav, self.uav.node.now
        uav.tick()
        place, height_m = uav.flyer.position, uav.flyer.altitude_m
        truth = Truth(now.steady_s, now.unix_s, place, height_m, uav.heading_deg)
        self._sim.step = step = self._world.step({uav.name: truth})
        for said in step.publications:
            self.nodes[said.robot].publish(said.topic, said.data)
        for topic, data in uav.map_due():
            uav.node.publish(topic, data)
        uav.node.refresh()
        self._sim.settle()
        self._sim.look(_NOWHERE)
