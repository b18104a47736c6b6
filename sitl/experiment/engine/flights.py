"""A mission in its own world, flown by what experiments are made of, or by `air-router sim`.

The world is `sitl.world`'s: robots that patrol or explore, radios, camera. `air-router sim` flies
the same mission, world and seed with an autopilot, simulated or a real PX4, MAVLink, sockets and
clocks.
The UAV controller's events and decisions are counted by the same code on both sides (`meter`);
`sitl experiment fidelity` and `autopilot` compare the two.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from air_router.controller import LAG_HOLD_S, Controller
from air_router.controller.model import Announce, FlightSetup
from air_router.errors import AirRouterError, UsageError
from air_router.gossip import MAP_INTERVAL_S
from air_router.mission import FlightPlan, load_mission
from air_router.record import Log
from air_router.routing import Router, WaypointGraph
from mocha_link.links import LinkEvent, MessageStored
from mocha_link.team import Team
from sitl.experiment import EventLog, EventQueue, RunSettings
from sitl.experiment.engine.channel import Change, Channel, Link, Load, Places
from sitl.experiment.engine.channel_sim import ChannelSim
from sitl.experiment.engine.exchange import AirtimeStats
from sitl.experiment.engine.meter import Goals, Measures, Meter
from sitl.experiment.robots import MapPainter, Node, Uav
from sitl.px4sim import BATTERY_MINUTES
from sitl.team import make_world, roles_of
from sitl.world import STEP_S, Step, Truth, load_world

SPEED: Final = 10.0
PX4_SPEED: Final = 5.0
"""Times real time, of the simulation in processes, and of one with a real PX4."""

_NOWHERE: Final = np.zeros((0, 3))  # the world knows where robots are
_ROUND_TRIP_S: Final = 0.01
_LANDED_S: Final = 300.0  # after the mission's duration at the latest


class _WorldSim(ChannelSim):
    """Has the world's radios carry the nodes' messages, and report contacts to the nodes."""

    step = Step()  # the world's newest

    def report(self) -> None:
        for reading in self.step.readings:
            node = self._nodes[self._numbers[reading.robot]]
            node.gossip.signal_received(reading.peer, reading.rssi_dbm, node.now)

    def report_contact(self, a: int, b: int, began_s: float, *, up: bool) -> None:
        """Does nothing: the readings report contacts."""

    def changes(self) -> list[Change]:
        """Links that the world has cut or restored, by the robots' numbers."""
        numbers = self._numbers
        ends = [(numbers[link.a], numbers[link.b], link.up) for link in self.step.links]
        return [Change(min(a, b), max(a, b), up) for a, b, up in ends]


class _WorldChannel(Channel):
    """No transmission disturbs another, and bytes cost nothing."""

    patience_s = math.inf
    sim: _WorldSim  # that sends over it

    def update(self, now_s: float, places: Places) -> list[Change]:  # noqa: ARG002 - a port's
        return self.sim.changes()

    def duration_s(self, link: Link, load: Load, now_s: float) -> float:  # noqa: ARG002
        return load.round_trips * _ROUND_TRIP_S


class WorldRun:
    """A mission in its own world, in simulated time.

    Args:
        path: The mission's file; it names team and world.
        seed: Of the world.
        queue: The clock.
        log: Takes the controller's events and actions.
        policy: Whom it seeks, instead of the mission's policy.

    Attributes:
        uav: Flies it.
        nodes: Of all robots, by name.

    Raises:
        AirRouterError: the files are not what they should be.
    """

    def __init__(
        self, path: Path, seed: int, queue: EventQueue, log: EventLog, policy: str
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
            battery=BATTERY_MINUTES,
            map_interval_s=MAP_INTERVAL_S - STEP_S / 2,  # checked at every step
        )
        flight_plan, router = FlightPlan.of(mission), Router(WaypointGraph(mission))
        setup = FlightSetup(mission, mission.seek or roles.ground, name=roles.vehicles[0])
        painter = MapPainter(mission.frame.origin, self._world.raster, plan.camera)
        self.uav = uav = Uav(
            *(roles.vehicles[0], mission, flight_plan, settings, queue, log),
            Controller(setup, router, flight_plan, ground=painter.grid),
            painter,
        )
        uav.node = Node(
            0, uav.name, team, queue, triggered=True, publish=uav.outbox, receive=uav.receive
        )
        self.nodes = {uav.name: uav.node}
        for number, name in enumerate(roles.ground, start=1):  # the world publishes for them
            receive = partial(self._receive, name)
            self.nodes[name] = Node(number, name, team, queue, triggered=True, receive=receive)
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

    @property
    def goals(self) -> Goals:
        """What exploring robots have found."""
        return Goals(self._world.goals_total, [visit.time_s for visit in self._world.goals])

    @property
    def policy_faults(self) -> dict[str, str]:
        """What went wrong in policies of exploring robots, by robot."""
        return self._world.policy_faults

    def _receive(self, name: str, event: LinkEvent) -> None:
        """Something has happened on a ground robot's links."""
        if isinstance(event, MessageStored) and event.robot != name:
            data = self.nodes[name].data_of(event)
            self._world.receive(name, event.robot, event.topic, data)

    def _tick(self) -> None:
        uav, now = self.uav, self.uav.node.now
        uav.tick()
        place, height_m = uav.flyer.position, uav.flyer.altitude_m
        truth = Truth(now.steady_s, now.unix_s, place, height_m, uav.heading_deg)
        self._sim.step = step = self._world.step({uav.name: truth})
        for publication in step.publications:
            self.nodes[publication.robot].publish(publication.topic, publication.data)
        for topic, data in uav.map_due():
            uav.node.publish(topic, data)
        uav.node.refresh()
        self._sim.settle()
        self._sim.update(_NOWHERE)


class Flown(NamedTuple):
    """What a flight came to.

    Attributes:
        measures: By columns.
        digest: Of its log, or of its record.
        faults: What went wrong in policies of other packages, by whose policy it was.
    """

    measures: Measures
    digest: str
    faults: Mapping[str, str] = MappingProxyType({})


def flown_here(mission: Path, seed: int, policy: str) -> Flown:
    """A mission by the experiments' simulation."""
    began, queue = os.times(), EventQueue()
    meter = Meter(queue)
    run = WorldRun(mission, seed, queue, meter, policy)
    arrived_bytes = run.finish()
    measures = meter.measures(run.nodes.keys() - {run.uav.name}, arrived_bytes, run.goals)
    faults = _faults(run.uav.name, run.uav.controller.seek_fault, run.policy_faults)
    return Flown(measures | _cost(began, os.times(), queue.now_s), meter.digest, faults)


def flown_in_processes(mission: Path, seed: int, policy: str, *, px4: bool = False) -> Flown:
    """The same mission by `air-router sim`; the digest is of its record.

    Args:
        mission: The mission's file.
        seed: Of the world.
        policy: Whom it seeks.
        px4: A real PX4 flies, which is found as `sitl px4` finds it without an option.

    Raises:
        AirRouterError: it could not be flown, or a busy machine stalled the flight program so long
            that the vehicle held or came home.
    """
    command = [sys.executable, "-m", "air_router", "sim", str(mission), "--json"]
    command += ["--seed", str(seed), "--seek", policy]
    command += ["--speed", f"{PX4_SPEED:g}", "--px4"] if px4 else ["--speed", f"{SPEED:g}"]
    began = os.times()
    with tempfile.TemporaryDirectory() as folder:
        command += ["--log-dir", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
        if done.returncode:
            raise AirRouterError(f"air-router sim, seed {seed}: {done.stderr.strip()[-500:]}")
        ended, report = os.times(), json.loads(done.stdout)
        record = Path(report["record"])
        measures, simulated_s, fault = _recorded(record, report["world"])
        digest = hashlib.sha256(record.read_bytes()).hexdigest()
    robots = {
        name: robot["policy_fault"]
        for name, robot in report["world"]["robots"].items()
        if robot["policy_fault"] is not None
    }
    faults = _faults("uav", fault, robots)
    return Flown(measures | _cost(began, ended, simulated_s), digest, faults)


def _recorded(record: Path, world: Mapping[str, Any]) -> tuple[Measures, float, str | None]:
    """What a record and the world's report came to, how long it took, and its policy's fault.

    Raises:
        AirRouterError: the flight program lagged so much that the result depends on the machine.
    """
    meter, arrived_bytes, now_s = Meter(EventQueue()), dict[str, int](), 0.0
    fault: str | None = None
    for entry in Log(record):
        now_s = entry.t
        if entry.kind in {"event", "action"}:
            meter.take(now_s, entry.value)
            if isinstance(entry.value, Announce) and fault is None:
                fault = fault_in(entry.value.text)
        elif entry.kind == "link":
            arrived_bytes[entry.value.peer] = entry.value.bytes_in
    # After one stall this long the vehicle held. Short lags whose sum was reported did not stop it,
    # but its node and the world shared that processor, and exchanged less.
    if meter.longest_lag_s >= LAG_HOLD_S:
        raise AirRouterError(
            f"the flight program stalled for {meter.longest_lag_s:.1f} s, at once or within "
            "seconds, so its result depends on this machine; make fewer runs at once (--jobs 1), "
            "or free the machine's processors"
        )
    robots, goals = world["robots"], world["goals"]
    syncs = [each for robot in robots.values() for each in robot["syncs"].items()]
    there = [link["bytes_in"] for peer, link in syncs if peer not in robots]
    found = Goals(goals["total"], [each["at_s"] for each in goals["found"]])
    measures = meter.measures(robots.keys(), [*arrived_bytes.values(), *there], found)
    return measures, now_s, fault


def _faults(uav: str, fault: str | None, robots: Mapping[str, str]) -> dict[str, str]:
    return dict(robots) if fault is None else {uav: fault, **robots}


def fault_in(announcement: str) -> str | None:
    """What an announcement states of a policy that failed (`GuardedPolicy`); None: nothing."""
    found = re.search(r"seek policy '.*?' failed \((.*)\), in turn", announcement)
    return None if found is None else found[1]


def _cost(began: os.times_result, ended: os.times_result, simulated_s: float) -> Measures:
    """Of this process and of those that it has waited for meanwhile."""
    wall_s = ended.elapsed - began.elapsed
    cpu_s = sum(ended[:4]) - sum(began[:4])
    return {"wall_s": wall_s, "cpu_s": cpu_s, "speed_up": simulated_s / wall_s}
