"""The simulated world around a flight: vehicles, robots and radios, each a process of its own.

Only MAVLink, sockets and files lie between them and the flight, as it would be outside.
"""

import contextlib
import json
import logging
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from air_router.errors import AirRouterError, ExitCode, NoVehicleError
from air_router.mission import Layer
from air_router.record import no_folder
from air_router.sim.ports import free_port, is_free
from air_router.vehicle import PaceSource
from air_router.vehicle.px4 import NEWEST, Version, name_of
from mocha_link.lifetime import Closeable
from mocha_link.path_safety import new_file

_log = logging.getLogger(__name__)

_PX4_INSTANCES = 10
_PX4_PORT = 14_580  # of the first instance; the next ones follow

_LOST = {"team": "no robot, radio or camera is simulated any more, and the vehicle flies on"}

READY_S = 90.0  # a busy machine compiles and imports for a minute
STOP_S = 10.0


@dataclass(frozen=True, slots=True)
class SimOptions:
    """How the world is simulated.

    Attributes:
        speed: Times real time.
        seed: Of everything random in it.
        px4: Fly a real PX4: where it is, empty where `sitl px4` finds it; None: our own.
        rovers: Robots that the user's programs play, and where the node of each is served.
        px4_version: Of PX4, as which our own vehicle behaves.
    """

    speed: float = 1.0
    seed: int = 1
    px4: str | None = None
    rovers: tuple[tuple[str, str], ...] = ()
    px4_version: Version = NEWEST


@dataclass(frozen=True, slots=True)
class SimVehicle:
    """Where a flight finds one vehicle of a simulation.

    Attributes:
        uav: The vehicle's name in the team; empty where the mission is for one only.
        url: Of its MAVLink.
        system_id: Its own.
        camera: Where its camera's patches come from.
    """

    uav: str
    url: str
    system_id: int
    camera: str = ""


class WorldIncompleteError(AirRouterError):
    """A process of the simulated world lacks a package; its message has how to install it."""

    exit_code = ExitCode.MISSING_EXTRA


class Child:
    """A process of the simulated world: reports on stdout when it is ready, ends on SIGTERM.

    Attributes:
        ended: Its last message, if it sends one at its end.
    """

    def __init__(self, name: str, arguments: list[str], log: Path) -> None:
        self.ended: dict[str, Any] = {}
        self._name = name
        self._log = log
        self._stopping = False  # SIGTERM was sent
        try:
            stderr = new_file(log)
        except OSError as error:
            raise no_folder(error) from None
        with stderr:
            self._process = subprocess.Popen(  # noqa: S603 - our own program and arguments
                # The world ends with the flight, also if that is killed.
                [
                    *(sys.executable, "-m", "sitl.process.end_with_parent", str(os.getpid())),
                    *(sys.executable, "-m", "sitl", *arguments),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                # Ctrl-C is for the flight: the world has to last until the vehicle holds.
                start_new_session=True,
            )

    def ready(self) -> dict[str, Any]:
        """Its message when it is ready.

        Raises:
            NoVehicleError: it ended or stayed silent instead.
            WorldIncompleteError: it lacks a package.
        """
        stdout = self._process.stdout
        assert stdout is not None  # noqa: S101 - it was requested
        deadline_s = time.monotonic() + READY_S
        line = b""
        while not line.endswith(b"\n"):
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not select.select([stdout], [], [], left_s)[0]:
                raise NoVehicleError(f"sitl {self._name}: not ready within {READY_S:.0f} s")
            byte = os.read(stdout.fileno(), 1)
            if not byte:
                code = self._process.wait()
                output = self._log.read_text(errors="replace").strip() or "nothing"
                if code == ExitCode.MISSING_EXTRA:
                    raise WorldIncompleteError(output)
                raise NoVehicleError(
                    f"sitl {self._name} ended with code {code}; its output: {output}"
                )
            line += byte
        ready: dict[str, Any] = json.loads(line)
        threading.Thread(target=self._watch, name=f"sitl {self._name}", daemon=True).start()
        return ready

    def _watch(self) -> None:
        """Say once that it has ended by itself, or was killed: the flight does not know why."""
        code = self._process.wait()
        if self._stopping:
            return
        how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        lost = _LOST.get(self._name.partition("-")[0], "the simulated vehicle has ended")
        _log.warning(
            "sitl %s %s: %s; type 'home' or press Ctrl-C, then start the simulation anew (its log: "
            "%s)",
            *(self._name, how, lost, self._log),
        )

    def stop(self) -> None:
        """End it and wait until it has ended, with its last message in `ended`."""
        self._stopping = True
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            _log.warning("sitl %s did not end within %.0f s and was killed", self._name, STOP_S)
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            with contextlib.suppress(ValueError):
                self.ended = json.loads(self._process.stdout.read() or b"{}")
            self._process.stdout.close()


class SimWorld(Closeable):
    """The simulated vehicles and the team as child processes.

    Args:
        mission: The mission's file.
        options: How it is simulated.
        folder: For logs, and the team file.
        layers: The UAVs of a mission for several; empty if it is for one.

    Attributes:
        seats: The vehicles, in the order of `layers`.
        team: The team file with the ports of this simulation.
        pace: Where flights report how far they are, so that the world's clock waits for them; None
            with a real PX4, which waits for no companion.

    Raises:
        NoVehicleError: a part of it did not start.
    """

    def __init__(
        self, mission: Path, options: SimOptions, folder: Path, layers: Sequence[Layer] = ()
    ) -> None:
        self._mission = mission
        self._options = options
        self._folder = folder
        # one without a name flies a mission for one
        self._uavs = tuple(layer.uav for layer in layers) or ("",)
        self._altitudes_m = {layer.uav: layer.altitude_m for layer in layers}  # of cruise
        self._report = folder / "world.json"  # what the world writes at its end
        self._children: list[Child] = []  # in the order of their start
        self._clock: Child | None = None  # the first vehicle, which sets the pace
        self.pace: PaceSource | None = None
        try:
            seats, ready = self._with_ours() if options.px4 is None else self._with_px4(options.px4)
        except BaseException:
            self.stop()
            raise
        for robot, endpoint in options.rovers:
            sys.stderr.write(f"{robot} waits for your program at {endpoint}\n")
        self.team = Path(ready["team"])
        places = ready["vehicles"]
        self.seats = tuple(
            SimVehicle(seat.uav, seat.url, seat.system_id, _camera(places, seat.uav))
            for seat in seats
        )

    def _with_ours(self) -> tuple[list[SimVehicle], dict[str, Any]]:
        """Our own vehicles and a team around them; all know when time began."""
        epoch = ["--epoch", str(int(time.time()))]
        ports = [(free_port(), free_port()) for _ in self._uavs]
        truths = [f"udp://127.0.0.1:{truth}" for _, truth in ports]
        pace_port = free_port(socket.SOCK_STREAM)
        self.pace = PaceSource("127.0.0.1", pace_port, self._options.speed)
        follow = ["--pace-from", str(self.pace)]
        # The first vehicle's clock is the world's: it waits for team, flights and other vehicles.
        lead = ["--pace", f"127.0.0.1:{pace_port}", "--pace-for", str(2 * len(self._uavs))]
        team = self._start_team(truths, [*epoch, *follow])
        seats: list[SimVehicle] = []
        vehicles: list[Child] = []
        for number, (uav, (api, truth)) in enumerate(zip(self._uavs, ports, strict=True)):
            to = ["--api-to", f"127.0.0.1:{api}", "--truth-to", f"127.0.0.1:{truth}"]
            more = ["--no-gcs", "--seed", str(self._options.seed + number), *epoch]
            more += ["--px4-version", name_of(self._options.px4_version)]
            more += follow if vehicles else lead
            vehicles.append(self._start_vehicle("vehicle", uav, number, [*to, *more]))
            seats.append(SimVehicle(uav, f"udpin://127.0.0.1:{api}", number + 1))
        ready = team.ready()
        for vehicle in vehicles:
            vehicle.ready()
        self._clock = vehicles[0]
        return seats, ready

    def _with_px4(self, place: str) -> tuple[list[SimVehicle], dict[str, Any]]:
        """Real PX4s, which choose their ports and their time, and a team that follows them."""
        where = ["--px4", place] if place else []
        vehicles = []
        for number, uav in zip(_free_instances(len(self._uavs)), self._uavs, strict=True):
            files = ["--log-dir", str(self._folder / _named("px4", uav))]
            vehicles.append(self._start_vehicle("px4", uav, number, [*where, *files]))
        reports = [vehicle.ready() for vehicle in vehicles]
        seats = [
            SimVehicle(uav, str(ready["mavlink"]), int(ready["system_id"]))
            for uav, ready in zip(self._uavs, reports, strict=True)
        ]
        return seats, self._start_team([str(ready["truth"]) for ready in reports], []).ready()

    def _start_vehicle(self, command: str, uav: str, number: int, arguments: list[str]) -> Child:
        common = [command, str(self._mission), "--speed", str(self._options.speed)]
        which = []
        if uav:
            # A return by the autopilot stays in the layer, as pre-flight wants it.
            altitude = f"RTL_RETURN_ALT={self._altitudes_m[uav]:g}"
            which = ["--uav", uav, "--instance", str(number), "--param", altitude]
        return self._start(_named(command, uav), [*common, *which, *arguments])

    def _start_team(self, truths: Sequence[str], arguments: list[str]) -> Child:
        places = []
        for uav, truth in zip(self._uavs, truths, strict=True):
            name = f"{uav}=" if uav else ""
            places += ["--truth", f"{name}{truth}"]
            places += ["--camera", f"{name}tcp://127.0.0.1:{free_port(socket.SOCK_STREAM)}"]
        for name, endpoint in self._options.rovers:
            places += ["--rover", f"{name}={endpoint}"]
        files = ["--free-ports", str(self._folder), "--report", str(self._report)]
        seed = ["--seed", str(self._options.seed)]
        return self._start("team", ["team", str(self._mission), *places, *files, *seed, *arguments])

    def _start(self, name: str, arguments: list[str]) -> Child:
        child = Child(name, arguments, self._folder / f"{name}.log")
        self._children.append(child)
        return child

    def stop(self) -> dict[str, Any]:
        """End the world; returns what it knows of the robots, which no flight can see."""
        for child in self._children:
            child.stop()
        self._children = []
        report: dict[str, Any] = {}
        try:
            report = json.loads(self._report.read_text())
        except (OSError, ValueError) as error:
            _log.debug("no report of the world: %s", error)
        team = report.pop("pace", {})
        ended = {} if self._clock is None else self._clock.ended
        pace = ended.get("pace", {"requested": self._options.speed, "kept": team.get("kept")})
        return {**report, "pace": {**pace, "longest_step_s": team.get("longest_step_s")}}

    def close(self) -> None:
        """End the world, whatever it knows."""
        self.stop()


def _free_instances(count: int) -> list[int]:
    """PX4 instances that seem to be free: they are started at once, and must not choose the same.

    Raises:
        NoVehicleError: there are not so many.
    """
    free = [
        number
        for number in range(_PX4_INSTANCES)
        if is_free(socket.SOCK_DGRAM, "127.0.0.1", _PX4_PORT + number)
    ]
    if len(free) < count:
        raise NoVehicleError(f"{count} PX4s are to start, and ports are free for {len(free)} only")
    return free[:count]


def _named(what: str, uav: str) -> str:
    return f"{what}-{uav}" if uav else what


def _camera(places: dict[str, dict[str, str]], uav: str) -> str:
    return places[uav]["camera"] if uav else next(iter(places.values()))["camera"]
