"""What a flight costs: from a link's update to the command on the wire, and processor time.

Latency: the real flight shell with MAVSDK flies the simulated PX4 through a relay of UDP datagrams
that notes when a command passes. Pose updates put a robot that is sought at another place, again
and again; the time runs from that update, delivered as the gossip node does, to the command's
datagram.

Processor time: `air-router sim` at real time with three robots; the flight runs in its own process.
"""

import asyncio
import dataclasses
import io
import os
import re
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from air_router.controller.model import RobotPose, State
from air_router.flight import Flight, StatusLine
from air_router.gossip import Mapper
from air_router.mission import Mission, load_mission
from air_router.record import Recorder
from air_router.vehicle import VehicleClock
from air_router.vehicle.px4 import Px4Vehicle
from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError, median_ms
from geo.frame import Point

MISSION: Final = Path(__file__).parents[2] / "missions" / "pennovation" / "mission.yaml"
COMMANDS: Final = frozenset({41, 75, 76})  # MISSION_SET_CURRENT, COMMAND_INT, COMMAND_LONG
SPEED: Final = 4
PAUSE_S: Final = 1.5
SAMPLES: Final = 40
WATCHED_S: Final = 60.0


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Median and 95th percentile from update to command; the share of a core at real time."""
    measured_ms = sorted(1e3 * each for each in latencies_s(5 if conditions.quick else SAMPLES))
    if not measured_ms:
        raise UnmeasuredError("no command followed in time")
    p95_ms = measured_ms[int(len(measured_ms) * 0.95)]
    anchors = {"a datagram through the relay": _relayed_ms()}
    p50_ms = statistics.median(measured_ms)
    yield Figure("from update to command, p50", p50_ms, "ms", anchors=anchors)
    yield Figure("from update to command, p95", p95_ms, "ms", anchors=anchors)
    share = processor_share(5.0 if conditions.quick else WATCHED_S)
    yield Figure("a flight with three robots", 100 * share, "% of a core")


class Relay:
    """Passes datagrams between companion and vehicle, and remembers when commands passed."""

    def __init__(self) -> None:
        self._inside = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._outside = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for end in (self._inside, self._outside):
            end.bind(("127.0.0.1", 0))
        self.vehicle_port = self._inside.getsockname()[1]
        self.companion_port = _free_port()
        self.passed_s: list[float] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        vehicle: Any = None
        while not self._stop.is_set():
            for end in select.select([self._inside, self._outside], [], [], 0.2)[0]:
                data, sender = end.recvfrom(4096)
                if end is self._inside:
                    vehicle = sender
                    self._outside.sendto(data, ("127.0.0.1", self.companion_port))
                    continue
                if int.from_bytes(data[7:10], "little") in COMMANDS:
                    self.passed_s.append(time.perf_counter())
                if vehicle is not None:
                    self._inside.sendto(data, vehicle)

    def close(self) -> None:
        """Stop passing."""
        self._stop.set()
        self._thread.join()
        self._inside.close()
        self._outside.close()


class Updates:
    """In the gossip node's place: the benchmark delivers what it receives."""

    def __init__(self) -> None:
        self.deliver: Callable[[Any], None] = lambda _event: None

    def start(self, deliver: Callable[[Any], None]) -> None:
        """The flight listens."""
        self.deliver = deliver

    def links(self) -> dict[str, Any]:
        """No peer is near."""
        return {}

    def publish_telemetry(self, _telemetry: object) -> None:
        """No peer listens."""

    def publish_map(self, _time_s: float) -> None:
        """No peer listens."""

    def exchange(self) -> None:
        """No peer is near."""

    def held(self) -> dict[str, Any]:
        """No peer holds anything."""
        return {}

    def publish_sought(self, _robot: str | None, _time_s: float) -> None:
        """No peer listens."""

    def publish_ack(self, _answer: object) -> None:
        """No peer listens."""

    def newest_stamps(self) -> dict[str, float]:
        """Nothing was received."""
        return {}

    def close(self) -> None:
        """Nothing to close."""


def latencies_s(samples: int) -> list[float]:
    """Seconds from update to command, wall clock."""
    mission = load_mission(MISSION)
    timers = dataclasses.replace(mission.timers, init_s=2.0, search_s=3600.0)
    mission = dataclasses.replace(mission, timers=timers, duration_s=None)
    relay = Relay()
    vehicle = subprocess.Popen(  # noqa: S603 - our own program
        [
            *(
                sys.executable,
                "-m",
                "sitl",
                "vehicle",
                str(MISSION),
                f"--speed={SPEED}",
                "--no-gcs",
            ),
            f"--api-to=127.0.0.1:{relay.vehicle_port}",
            f"--truth-to=127.0.0.1:{_free_port()}",
        ],
        stdout=subprocess.PIPE,
    )
    try:
        assert vehicle.stdout is not None  # noqa: S101 - it is a pipe
        vehicle.stdout.readline()
        return asyncio.run(_measure(mission, relay, samples))
    finally:
        vehicle.terminate()
        vehicle.wait()
        relay.close()


async def _measure(mission: Mission, relay: Relay, samples: int) -> list[float]:
    clock, updates = VehicleClock(), Updates()
    mapper = Mapper(mission)
    with Recorder(None, str(MISSION)) as recorder:
        flight = Flight(
            mission,
            Px4Vehicle(mission, f"udpin://127.0.0.1:{relay.companion_port}", clock),
            clock=clock,
            gossip=updates,  # type: ignore[arg-type]  # as much of it as a flight calls
            mapper=mapper,
            seek=("io",),
            recorder=recorder,
            status=StatusLine(io.StringIO()),
            arm=True,
        )
        flying = asyncio.ensure_future(flight.run())
        measured: list[float] = []
        places = [w.position for w in mission.waypoints[:12]]
        try:
            while flight.controller.state is not State.SEARCH:
                await asyncio.sleep(0.1)
                if flying.done():
                    flying.result()
            for sample in range(samples):
                await asyncio.sleep(PAUSE_S)
                place = places[sample * 5 % len(places)]
                latency_s = await _update_to_command(updates, relay, place, sample)
                if latency_s is not None:
                    measured.append(latency_s)
        finally:
            flight._on_interrupt()  # noqa: SLF001 - as Ctrl-C does
            await asyncio.gather(flying, return_exceptions=True)
    return measured


async def _update_to_command(
    updates: Updates, relay: Relay, place: Point, sample: int
) -> float | None:
    before = len(relay.passed_s)
    began_s = time.perf_counter()
    updates.deliver(RobotPose("io", place, time.time() + sample, "callisto"))
    while len(relay.passed_s) == before and time.perf_counter() < began_s + PAUSE_S:  # noqa: ASYNC110 - a thread counts
        await asyncio.sleep(0.002)
    return relay.passed_s[before] - began_s if len(relay.passed_s) > before else None


def _relayed_ms() -> float:
    """From one end of the relay to the other, the median."""
    relay = Relay()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion,
    ):
        companion.bind(("127.0.0.1", relay.companion_port))
        try:

            def relayed() -> None:
                vehicle.sendto(bytes(40), ("127.0.0.1", relay.vehicle_port))
                companion.recv(4096)

            return median_ms(relayed, 100)
        finally:
            relay.close()


def processor_share(over_s: float) -> float:
    """Share of one core that the flight takes at real time, with three robots."""
    with tempfile.TemporaryDirectory() as folder:
        simulated = subprocess.Popen(  # noqa: S603 - our own program
            [*(sys.executable, "-m", "air_router.cli.cli", "sim", str(MISSION), "--speed=1")],
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            cwd=folder,
        )
        try:
            assert simulated.stderr is not None  # noqa: S101 - it is a pipe
            printed = b""
            while b"READY -> INIT" not in printed:
                chunk = os.read(simulated.stderr.fileno(), 65536)
                if not chunk:
                    raise RuntimeError(f"the simulation ended: {printed.decode()}")
                printed += chunk
            drain = threading.Thread(target=simulated.stderr.read, daemon=True)
            drain.start()
            before_s = _processor_s(simulated.pid)
            time.sleep(over_s)
            return (_processor_s(simulated.pid) - before_s) / over_s
        finally:
            simulated.terminate()
            simulated.wait(30)


def _processor_s(pid: int) -> float:
    fields = re.sub(r".*\) ", "", Path(f"/proc/{pid}/stat").read_text(encoding="ascii")).split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
