"""A mission in its own world, flown by the experiments' simulation or by `air-router sim`.

What the UAV's controller heard and decided is counted by the same code on both sides, from the
moment when it begins INIT to its decision to come home.
"""

from __future__ import annotations

import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from air_router.controller.model.actions import Action, StateChanged
from air_router.controller.model.events import Event, RobotPose
from air_router.controller.model.states import State
from air_router.errors import AirRouterError
from air_router.files.settings import SeekPolicy
from air_router.record.log import Log
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    SyncEnded,
    SyncStarted,
)
from sitl.experiment.engine.ages import mean_age_s
from sitl.experiment.engine.world_run import WorldRun
from sitl.experiment.events import EventLog, EventQueue

SPEED: Final = 10.0
"""Times real time, of the simulation in processes."""

Measures = dict[str, float | None]


class Flown(NamedTuple):
    """What a flight came to, and what tells it from another one."""

    measures: Measures
    digest: str


class Meter(EventLog):
    """Counts what a controller hears and decides, as it happens or from a flight's record."""

    def __init__(self, queue: EventQueue) -> None:
        super().__init__(queue)
        self._counts = dict.fromkeys(("searches", "found", "uav_contacts", "syncs"), 0)
        self._contact_s = 0.0
        self._since: dict[State, float] = {}  # when each state was entered last
        self._waits_s: list[float] = []  # of searches that ended in COMM
        self._comms_s: list[float] = []  # of visits
        self._unix_less_s = 0.0  # Unix time of the node, less the flight's
        self._news: dict[tuple[str, str], list[tuple[float, float]]] = {}  # when, of when

    def event(self, uav: str, event: Event) -> None:
        """A controller is told."""
        super().event(uav, event)
        self.take(self._queue.now_s, event)

    def action(self, uav: str, action: Action) -> None:
        """A controller asks for something."""
        super().action(uav, action)
        self.take(self._queue.now_s, action)

    def take(self, now_s: float, what: Event | Action) -> None:
        """Count what happened or was decided at a time."""
        counts = self._counts
        match what:
            case ContactBegan():
                counts["uav_contacts"] += 1
            case ContactEnded(duration_s=duration_s):
                self._contact_s += duration_s
            case SyncStarted(at_s=at_s):
                self._unix_less_s = at_s - now_s
            case SyncEnded(peer=peer, direction=direction, complete=complete):
                counts["syncs"] += 1
                if complete and direction is Direction.OUT:
                    self._news.setdefault(("given", peer), []).append((now_s, now_s))
            case RobotPose(robot=robot, stamp_s=stamp_s):
                poses = self._news.setdefault(("pose", robot), [])
                true_s = stamp_s - self._unix_less_s
                if not poses or true_s > poses[-1][1]:
                    poses.append((now_s, true_s))
            case StateChanged(source=source, target=target):
                self._changed(now_s, source, target)

    def _changed(self, now_s: float, source: State, target: State) -> None:
        if source is State.COMM:
            self._comms_s.append(now_s - self._since[source])
        if target is State.COMM:
            self._counts["found"] += 1
            self._waits_s.append(now_s - self._since[State.SEARCH])
        self._counts["searches"] += target is State.SEARCH
        self._since[target] = now_s

    def measures(self, robots: Collection[str], arrived_bytes: Iterable[int]) -> Measures:
        """What it came to, by columns; of the ground robots, and the bytes of the UAV's links."""
        ages_s = {
            what: float(np.mean([self._age_s(what, robot) for robot in robots]))
            for what in ("pose", "given")
        }
        return {
            **self._counts,
            "uav_contact_s": self._contact_s,
            "arrived_kB": sum(arrived_bytes) / 1e3,
            "found_after_mean_s": float(np.mean(self._waits_s)) if self._waits_s else None,
            "comm_mean_s": float(np.mean(self._comms_s)) if self._comms_s else None,
            "mission_s": self._since[State.HOME] - self._since[State.INIT],
            "pose_age_mean_s": ages_s["pose"],
            "given_age_mean_s": ages_s["given"],
            "exchange_age_mean_s": (ages_s["pose"] + ages_s["given"]) / 2,
        }

    def _age_s(self, what: str, robot: str) -> float:
        began_s, home_s = self._since[State.INIT], self._since[State.HOME]
        news = [entry for entry in self._news.get((what, robot), ()) if entry[0] < home_s]
        held = np.array([(began_s, began_s), *news]) - began_s
        held[:, 0] = np.maximum(held[:, 0], 0.0)  # what came on the ground is held from the start
        return mean_age_s(held, home_s - began_s)


def flown_here(mission: Path, seed: int, policy: SeekPolicy) -> Flown:
    """A mission by the experiments' simulation."""
    queue = EventQueue()
    meter = Meter(queue)
    began_s, began_cpu_s = time.monotonic(), time.process_time()
    run = WorldRun(mission, seed, queue, meter, policy)
    arrived_bytes = run.finish()
    cpu_s = time.process_time() - began_cpu_s
    measures = meter.measures(run.nodes.keys() - {run.uav.name}, arrived_bytes)
    return Flown(measures | _cost(time.monotonic() - began_s, cpu_s, queue.now_s), meter.digest)


def flown_in_processes(mission: Path, seed: int, policy: SeekPolicy) -> Flown:
    """The same mission by `air-router sim`; the digest is of its record.

    Raises:
        AirRouterError: it could not be flown.
    """
    command = [sys.executable, "-m", "air_router", "sim", str(mission), "--json"]
    command += ["--speed", f"{SPEED:g}", "--seed", str(seed), "--seek", policy]
    began_s, began_cpu_s = time.monotonic(), _children_cpu_s()
    with tempfile.TemporaryDirectory() as folder:
        command += ["--log-dir", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
        if done.returncode:
            raise AirRouterError(f"air-router sim, seed {seed}: {done.stderr.strip()[-500:]}")
        wall_s, cpu_s = time.monotonic() - began_s, _children_cpu_s() - began_cpu_s
        report = json.loads(done.stdout)
        return _recorded(Path(report["record"]), report, wall_s, cpu_s)


def _recorded(record: Path, report: dict[str, Any], wall_s: float, cpu_s: float) -> Flown:
    meter, arrived_bytes, now_s = Meter(EventQueue()), dict[str, int](), 0.0
    for entry in Log(record):
        now_s = entry.t
        if entry.kind in {"event", "action"}:
            meter.take(now_s, entry.value)
        elif entry.kind == "link":
            arrived_bytes[entry.value.peer] = entry.value.bytes_in
    robots = report["world"]["robots"]
    syncs = [each for robot in robots.values() for each in robot["syncs"].items()]
    there = [link["bytes_in"] for peer, link in syncs if peer not in robots]
    measures = meter.measures(robots.keys(), [*arrived_bytes.values(), *there])
    digest = hashlib.sha256(record.read_bytes()).hexdigest()
    return Flown(measures | _cost(wall_s, cpu_s, now_s), digest)


def _cost(wall_s: float, cpu_s: float, simulated_s: float) -> Measures:
    return {"wall_s": wall_s, "cpu_s": cpu_s, "speed_up": simulated_s / wall_s}


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
