"""`air-router sim`: starts the simulated world and flies in it, as it would fly outside.

The vehicle and the robots are processes of their own; only MAVLink, sockets and files lie
between them and the flight.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import logging
import math
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from air_router.command_line import add_start
from air_router.errors import NoVehicleError
from air_router.fly import FlyOptions, add_flight_arguments, finish, fly
from air_router.mission import load_mission

_log = logging.getLogger(__name__)

READY_S = 60.0
STOP_S = 10.0


@dataclass(frozen=True, slots=True)
class SimOptions:
    """How the world is simulated.

    Attributes:
        speed: Times real time.
        seed: Of everything random in it.
        px4: Fly a real PX4: where it is, empty where `sitl px4` finds it; None: our own.
    """

    speed: float = 1.0
    seed: int = 1
    px4: str | None = None


class Child:
    """A process of the simulated world: says on stdout when it is ready, ends on SIGTERM."""

    def __init__(self, name: str, arguments: list[str], log: Path) -> None:
        self._name = name
        self._log = log
        with log.open("wb") as stderr:
            self._process = subprocess.Popen(  # noqa: S603 - our own program and arguments
                # The world ends with the flight, also if that is killed.
                [
                    *(sys.executable, "-m", "sitl.end_with_parent", str(os.getpid())),
                    *(sys.executable, "-m", "sitl", *arguments),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                # Ctrl-C is for the flight: the world has to last until the vehicle holds.
                start_new_session=True,
            )

    def ready(self) -> dict[str, Any]:
        """What it says when it is ready.

        Raises:
            NoVehicleError: it ended or stayed silent instead.
        """
        stdout = self._process.stdout
        assert stdout is not None  # noqa: S101 - it was asked for
        deadline_s = time.monotonic() + READY_S
        line = b""
        while not line.endswith(b"\n"):
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not select.select([stdout], [], [], left_s)[0]:
                raise NoVehicleError(f"sitl {self._name}: not ready within {READY_S:.0f} s")
            byte = os.read(stdout.fileno(), 1)
            if not byte:
                code = self._process.wait()
                said = self._log.read_text(errors="replace").strip() or "nothing"
                raise NoVehicleError(f"sitl {self._name} ended with code {code}; it said: {said}")
            line += byte
        ready: dict[str, Any] = json.loads(line)
        return ready

    def stop(self) -> None:
        """End it and wait until it has ended."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            _log.warning("sitl %s did not end within %.0f s and was killed", self._name, STOP_S)
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


class World:
    """The simulated vehicle and team as child processes.

    Attributes:
        url: Where the flight finds the vehicle.
        system_id: The vehicle's.
        team: The team file with the ports of this simulation.
        camera: Where the camera's patches come from.
    """

    def __init__(self, mission: Path, options: SimOptions, folder: Path) -> None:
        self._mission = mission
        self._options = options
        self._folder = folder
        self._report = folder / "world.json"
        self._children: list[Child] = []
        self.url, self.system_id = "", 1
        try:
            ready = self._with_ours() if options.px4 is None else self._with_px4(options.px4)
        except BaseException:
            self.stop()
            raise
        self.team = Path(ready["team"])
        self.camera = str(ready["camera"])

    def _with_ours(self) -> dict[str, Any]:
        """Our own vehicle and a team around it; both know when time began."""
        api_port, truth_port, _ = _free_ports()
        epoch = ["--epoch", str(int(time.time()))]
        self.url = f"udpin://127.0.0.1:{api_port}"
        team = self._start_team(f"udp://127.0.0.1:{truth_port}", epoch)
        ports = ["--api-to", f"127.0.0.1:{api_port}", "--truth-to", f"127.0.0.1:{truth_port}"]
        vehicle = self._start_vehicle(
            "vehicle", [*ports, "--no-gcs", "--seed", str(self._options.seed), *epoch]
        )
        ready = team.ready()
        vehicle.ready()
        return ready

    def _with_px4(self, place: str) -> dict[str, Any]:
        """A real PX4, which chooses its ports and its time, and a team that follows it."""
        where = ["--px4", place] if place else []
        files = ["--log-dir", str(self._folder / "px4")]
        vehicle = self._start_vehicle("px4", [*where, *files]).ready()
        self.url, self.system_id = str(vehicle["mavlink"]), int(vehicle["system_id"])
        return self._start_team(str(vehicle["truth"]), []).ready()

    def _start_vehicle(self, command: str, arguments: list[str]) -> Child:
        common = [command, str(self._mission), "--speed", str(self._options.speed)]
        return self._start(command, [*common, *arguments])

    def _start_team(self, truth: str, arguments: list[str]) -> Child:
        _, _, camera_port = _free_ports()
        places = ["--truth", truth, "--camera", f"tcp://127.0.0.1:{camera_port}"]
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
        try:
            report: dict[str, Any] = json.loads(self._report.read_text())
        except (OSError, ValueError) as error:
            _log.debug("no report of the world: %s", error)
            return {}
        return report

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self.stop()


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `sim` to the command line."""
    parser = commands.add_parser(
        "sim",
        help="fly a mission in a simulated world",
        description="Start a simulated PX4, ground robots and radios, and fly a mission there.",
        epilog="example: air-router sim missions/pennovation/mission.yaml --speed 10",
    )
    add_flight_arguments(parser)
    add_start(parser)
    parser.add_argument(
        "--speed", type=_speed, default=1.0, metavar="X", help="times real time (default 1)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all that is random")
    parser.add_argument(
        "--px4",
        nargs="?",
        const="",
        metavar="PATH",
        help="fly a real PX4 instead of our own: found as `sitl px4` finds it, or there",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly in a world of its own, and report on stdout."""
    mission = load_mission(arguments.mission, start=arguments.at, duration_s=arguments.duration)
    # The simulated vehicle's clock is today's, whenever the flight is meant to be.
    mission = dataclasses.replace(
        mission, window=dataclasses.replace(mission.window, latest_start=None)
    )
    with _folder(arguments.log_dir) as folder:
        options = SimOptions(arguments.speed, arguments.seed, arguments.px4)
        with World(arguments.mission, options, folder) as world:
            result = fly(
                mission,
                FlyOptions(
                    url=world.url,
                    system_id=world.system_id,
                    team=world.team,
                    camera=world.camera,
                    metrics=arguments.metrics,
                    duration_s=arguments.duration,
                    arm=True,
                    log_dir=arguments.log_dir,
                ),
            )
            result.report["world"] = world.stop()
    return finish(mission, result, arguments)


def _free_ports() -> tuple[int, int, int]:
    """Ports that are free now: two UDP, one TCP."""
    with contextlib.ExitStack() as stack:
        ports = []
        for kind in (socket.SOCK_DGRAM, socket.SOCK_DGRAM, socket.SOCK_STREAM):
            probe = stack.enter_context(socket.socket(socket.AF_INET, kind))
            probe.bind(("127.0.0.1", 0))
            ports.append(probe.getsockname()[1])
    return ports[0], ports[1], ports[2]


@contextlib.contextmanager
def _folder(log_dir: Path | None) -> Iterator[Path]:
    if log_dir is not None:
        log_dir.mkdir(parents=True, exist_ok=True)
        yield log_dir
        return
    with tempfile.TemporaryDirectory(prefix="air-router-") as folder:
        yield Path(folder)


def _speed(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.1 <= value <= 100:
        raise argparse.ArgumentTypeError(f"{text} is not a speed between 0.1 and 100")
    return value
