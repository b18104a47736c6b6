"""Repeats a planned run with real nodes, in real time."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.contention.planned import Measures, Planned, Publication
from benchmarks.contention.relay import ChannelRelay
from mocha_link.team import Team
from sitl.experiment.engine import AirtimeStats, PaperChannel, Transmission, airtime_measures
from sitl.team import derive_team, relayed_pairs

ROOT = Path(__file__).parents[2]
READY_S = 120.0
"""So long a node may take to start on a busy machine."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """What came of a run.

    Attributes:
        measures: Of the channel, as of the experiment.
        transmissions: In the order of their ends.
        late_s: How late the latest of the run's events was: more than a latency, and the machine
            was too busy.
    """

    measures: Measures
    transmissions: tuple[Transmission, ...]
    late_s: float


class _Robots:
    """The nodes' processes, and which of them pull from whom."""

    def __init__(self, relay: ChannelRelay, airtime: AirtimeStats) -> None:
        self._relay = relay
        self._airtime = airtime
        self._processes: dict[str, asyncio.subprocess.Process] = {}
        self._pulling: set[tuple[str, str]] = set()
        self._again: set[tuple[str, str]] = set()  # when contact begins anew meanwhile
        self._readers: list[asyncio.Task[None]] = []  # end with an error when a node ends

    @property
    def pulling(self) -> int:
        """How many pulls are under way."""
        return len(self._pulling)

    async def start(self, team: Team, more: Iterable[str]) -> None:
        """Start all nodes; they are ready when this returns."""
        for name in team.robots:
            self._processes[name] = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "benchmarks.contention.node", str(team.path), name, *more),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                cwd=ROOT,
            )
        for process in self._processes.values():
            async with asyncio.timeout(READY_S):
                await _line_of(process)
        self._readers = [
            asyncio.create_task(self._listen(name, process))
            for name, process in self._processes.items()
        ]

    def check(self) -> None:
        """Raises RuntimeError: a node has ended, which is a fault of the run."""
        for reader in self._readers:
            if reader.done():
                reader.result()

    async def end(self) -> None:
        """End all nodes."""
        for reader in self._readers:
            reader.cancel()
        for process in self._processes.values():
            with contextlib.suppress(ProcessLookupError):  # it has ended
                process.kill()
            await process.wait()

    def send(self, robot: str, *what: object) -> None:
        """Send a line to a robot's node."""
        stdin = self._processes[robot].stdin
        if stdin is None:
            raise AssertionError("its stdin is a pipe")
        stdin.write(json.dumps(what).encode() + b"\n")

    def meet(self, a: str, b: str) -> None:
        """Both pull, or do so again when they are through."""
        for pull in ((a, b), (b, a)):
            if pull in self._pulling:
                self._again.add(pull)
            else:
                self._pull(*pull)

    def _pull(self, robot: str, peer: str) -> None:
        self._pulling.add((robot, peer))
        self.send(robot, "pull", peer)

    async def _listen(self, robot: str, process: asyncio.subprocess.Process) -> None:
        while True:
            _, peer, complete = await _line_of(process)
            pull = robot, peer
            self._airtime.complete += complete
            self._airtime.broken += not complete
            self._pulling.discard(pull)
            if pull in self._again and self._relay.in_contact(*pull):
                self._pull(*pull)
            self._again.discard(pull)


async def replay(
    plan: Planned, *, start: asyncio.Barrier | None = None, timeout_s: float | None = None
) -> Replayed:
    """Repeat a run; it takes as long as the run.

    Args:
        start: Runs side by side begin together, once the nodes of all are ready; None: it is alone.
        timeout_s: Of the nodes' pulls, as robots have it; None: as in the experiment a pull that
            waits for its turn is not given up.
    """
    airtime = AirtimeStats(lambda _sent: None)
    numbers = {name: number for number, name in enumerate(sorted(plan.team.robots))}
    channel = PaperChannel(plan.settings.paper, plan.settings.radius_m, len(numbers), plan.seed)
    with tempfile.TemporaryDirectory() as folder:
        team = derive_team(plan.team, Path(folder))
        async with ChannelRelay(relayed_pairs(team), numbers, channel, airtime) as relay:
            robots = _Robots(relay, airtime)
            try:
                await robots.start(team, [] if timeout_s is None else [str(timeout_s)])
                if start is not None:
                    await start.wait()
                late_s = await _perform(plan, relay, robots)
            finally:
                await robots.end()
    duration_s = plan.settings.duration_s
    measures = airtime_measures(airtime, robots.pulling, duration_s)
    return Replayed(measures, tuple(airtime.transmissions), late_s)


async def _perform(plan: Planned, relay: ChannelRelay, robots: _Robots) -> float:
    """Have everything happen when it is due; how late the latest was."""
    late_s = 0.0
    relay.start_clock()
    for event in plan.events:
        await asyncio.sleep(max(event.at_s - relay.now_s, 0.0))
        late_s = max(late_s, relay.now_s - event.at_s)
        robots.check()
        if isinstance(event, Publication):
            robots.send(event.robot, "publish", event.topic, event.data.hex())
            continue
        relay.set_contact(event.a, event.b, up=event.up)
        if event.up:
            robots.meet(event.a, event.b)
    await asyncio.sleep(max(plan.settings.duration_s - relay.now_s, 0.0))
    robots.check()
    return late_s


async def _line_of(process: asyncio.subprocess.Process) -> Any:
    """The next line of a node. Raises RuntimeError at its end."""
    if process.stdout is None:
        raise AssertionError("its stdout is a pipe")
    if not (line := await process.stdout.readline()):
        raise RuntimeError("a node has ended")
    return json.loads(line)
