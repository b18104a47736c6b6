"""`sitl experiment fidelity`: the experiments' simulation beside the simulation in processes.

The same missions through both; what the controllers saw and decided is counted in the same way.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from air_router.cli.command_line import print_json
from air_router.controller.model.actions import Action, StateChanged
from air_router.controller.model.events import Event
from air_router.controller.model.states import State
from air_router.errors import AirRouterError, ExitCode
from air_router.record.log import Log
from mocha_link.errors import needs_extra
from mocha_link.links.metrics import ContactBegan, ContactEnded, SyncEnded
from sitl.experiment.campaign.shipped import mission_file
from sitl.experiment.engine.world_run import WorldRun
from sitl.experiment.events import EventLog, EventQueue

with needs_extra("an experiment", "experiments", "air-router"):
    from scipy import stats

SEEDS: Final = 10
"""Missions, unless `--seeds` says otherwise."""

SPEED: Final = 10.0
"""Times real time, of the simulation in processes."""

WITHIN: Final = 0.1
"""Means that differ by no more than this share of the processes' count as the same."""


def run(arguments: argparse.Namespace) -> int:
    """Fly the paper's town with several seeds through both, and print the table.

    What the processes have flown stays in the folder, and is not flown again.
    """
    folder = arguments.out or Path("experiments") / "fidelity"
    mission = mission_file("urban", Path(), Path()) or Path()
    des, sim = list[Flown](), list[Flown]()
    for seed in range(1, (arguments.seeds or SEEDS) + 1):
        sys.stderr.write(f"seed {seed}\n")
        sim.append(flown_in_processes(mission, seed, folder))
        des.append(flown_here(mission, seed))
    rows = compared(des, sim)
    if arguments.json:
        print_json(rows)
    else:
        sys.stdout.write(table(rows) + "\n")
    return ExitCode.DONE


@dataclass(slots=True)
class Flown:
    """What one mission came to, as the UAV saw it; times in simulated seconds.

    Attributes:
        searches: How often it set out for a robot.
        found: How often it then met the robot.
        contacts: How often its radio began to hear a robot well enough.
        contact_s: How long altogether.
        syncs: Pulls that came to their end, in both directions.
        kilobytes: What arrived of robots at the UAV, and of the UAV at robots.
        wait_s: From setting out to meeting, mean.
        comm_s: In COMM, mean of all visits.
        mission_s: From the beginning of INIT to the decision to come home.
    """

    searches: float = 0
    found: float = 0
    contacts: float = 0
    contact_s: float = 0.0
    syncs: float = 0
    kilobytes: float = 0.0
    wait_s: float = math.nan
    comm_s: float = math.nan
    mission_s: float = math.nan


class Meter(EventLog):
    """Counts what a controller hears and decides, as it happens or from a flight's record."""

    def __init__(self, queue: EventQueue) -> None:
        super().__init__(queue, keep=False)
        self._flown = Flown()
        self._since: dict[State, float] = {}  # when each state was entered last
        self._waits_s: list[float] = []  # of searches that ended in COMM
        self._comms_s: list[float] = []  # of visits

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
        flown, since = self._flown, self._since
        match what:
            case ContactBegan():
                flown.contacts += 1
            case ContactEnded(duration_s=duration_s):
                flown.contact_s += duration_s
            case SyncEnded():
                flown.syncs += 1
            case StateChanged(source=source, target=target):
                if source is State.COMM:
                    self._comms_s.append(now_s - since[source])
                if target is State.COMM:
                    flown.found += 1
                    self._waits_s.append(now_s - since[State.SEARCH])
                flown.searches += target is State.SEARCH
                if target is State.HOME:
                    flown.mission_s = now_s - since[State.INIT]
                since[target] = now_s

    def flown(self, arrived_bytes: Iterable[int]) -> Flown:
        """What it came to, with the bytes that arrived on each of the UAV's links."""
        flown = self._flown
        flown.kilobytes = sum(arrived_bytes) / 1e3
        flown.wait_s = float(np.mean(self._waits_s)) if self._waits_s else math.nan
        flown.comm_s = float(np.mean(self._comms_s)) if self._comms_s else math.nan
        return flown


def flown_here(path: Path, seed: int) -> Flown:
    """A mission by the experiments' simulation."""
    queue = EventQueue()
    meter = Meter(queue)
    return meter.flown(WorldRun(path, seed, queue, meter).finish())


def flown_in_processes(path: Path, seed: int, folder: Path) -> Flown:
    """The same mission by `air-router sim`, unless it has been flown into the folder already.

    Raises:
        AirRouterError: it could not be flown.
    """
    folder = folder / f"seed-{seed}"
    counts = folder / "counts.json"
    if counts.exists():
        return Flown(**json.loads(counts.read_text(encoding="utf-8")))
    command = [sys.executable, "-m", "air_router", "sim", str(path), "--json"]
    command += ["--speed", f"{SPEED:g}", "--seed", str(seed), "--log-dir", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    if done.returncode:
        raise AirRouterError(f"air-router sim, seed {seed}: {done.stderr.strip()[-500:]}")
    report = json.loads(done.stdout)
    meter, arrived_bytes = Meter(EventQueue()), dict[str, int]()
    for entry in Log(Path(report["record"])):
        if entry.kind in {"event", "action"}:
            meter.take(entry.t, entry.value)
        elif entry.kind == "link":
            arrived_bytes[entry.value.peer] = entry.value.bytes_in
    robots = report["world"]["robots"]
    syncs = [each for robot in robots.values() for each in robot["syncs"].items()]
    there = [link["bytes_in"] for peer, link in syncs if peer not in robots]
    flown = meter.flown([*arrived_bytes.values(), *there])
    counts.write_text(json.dumps(asdict(flown)), encoding="utf-8")
    return flown


def compared(des: Sequence[Flown], sim: Sequence[Flown]) -> list[dict[str, Any]]:
    """Means of both by name, their ratio with its 95 % interval, and whether it is `WITHIN`.

    Flights of one seed meet the same fading, so they are compared in pairs; the interval is
    Student's. `within` is "open" where the interval is neither within nor outside.
    """
    rows = []
    for name in (each.name for each in fields(Flown)):
        both = zip(des, sim, strict=True)
        pairs = np.array([(getattr(a, name), getattr(b, name)) for a, b in both])
        pairs = pairs[~np.isnan(pairs).any(axis=1)]
        means = pairs.mean(axis=0)
        ratio, apart = float(means[0] / means[1]), np.diff(pairs / means, axis=1)
        error = float(apart.std(ddof=1)) / math.sqrt(len(pairs))
        reach = math.exp(error * float(stats.t.ppf(0.975, len(pairs) - 1)))
        low, high = ratio / reach, ratio * reach
        outside = low > 1 + WITHIN or high < 1 - WITHIN
        inside = low >= 1 - WITHIN and high <= 1 + WITHIN
        within = "yes" if inside else "no" if outside else "open"
        row = {"name": name, "des": float(means[0]), "sim": float(means[1])}
        rows.append({**row, "ratio": ratio, "low": low, "high": high, "within": within})
    return rows


def table(rows: Iterable[dict[str, Any]]) -> str:
    """What `compared` found, as Markdown."""
    lines = ["| | experiments | processes | ratio | within 10 % |", "|---|---:|---:|---:|---|"]
    row = "| `{name}` | {des:.1f} | {sim:.1f} | {ratio:.2f} ({low:.2f} to {high:.2f}) | {within} |"
    return "\n".join([*lines, *(row.format(**each) for each in rows)])
