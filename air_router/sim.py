"""`air-router sim`: starts the simulated world and flies in it, as it would fly outside.

The vehicle and the robots are processes of their own; only MAVLink, sockets and files lie
between them and the flight.
"""

from __future__ import annotations

import argparse
import contextlib
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

from air_router.errors import NoVehicleError
from air_router.fly import FlyOptions, add_flight_arguments, finish, fly
from air_router.mission import load_mission

_log = logging.getLogger(__name__)

READY_S = 30.0
STOP_S = 10.0


@dataclass(frozen=True, slots=True)
class SimOptions:
    """How the world is simulated: times real time, and the seed of everything random in it."""

    speed: float = 1.0
    seed: int = 1


class Child:
    """A process of the simulated world: says on stdout when it is ready, ends on SIGTERM."""

    def __init__(self, name: str, arguments: list[str], log: Path) -> None:
        self._name = name
        self._log = log
        with log.open("wb") as stderr:
            self._process = subprocess.Popen(  # noqa: S603 - our own program and arguments
                [sys.executable, "-m", "sitl", *arguments],
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
        team: The team file with the ports of this simulation.
        camera: Where the camera's patches come from.
    """

    def __init__(self, mission: Path, options: SimOptions, folder: Path) -> None:
        self._folder = folder
        self._report = folder / "world.json"
        api_port, truth_port, camera_port = _free_ports()
        epoch_s = str(int(time.time()))
        common = ["--seed", str(options.seed), "--epoch", epoch_s]
        self._children: list[Child] = []
        self.url = f"udpin://127.0.0.1:{api_port}"
        try:
            team = self._start(
                "team",
                [
                    "team",
                    str(mission),
                    "--truth",
                    f"udp://127.0.0.1:{truth_port}",
                    "--camera",
                    f"tcp://127.0.0.1:{camera_port}",
                    "--free-ports",
                    str(folder),
                    "--report",
                    str(self._report),
                    *common,
                ],
            )
            vehicle = self._start(
                "vehicle",
                [
                    "vehicle",
                    str(mission),
                    "--speed",
                    str(options.speed),
                    "--api-to",
                    f"127.0.0.1:{api_port}",
                    "--truth-to",
                    f"127.0.0.1:{truth_port}",
                    "--no-gcs",
                    *common,
                ],
            )
            ready = team.ready()
            vehicle.ready()
        except BaseException:
            self.stop()
            raise
        self.team = Path(ready["team"])
        self.camera = str(ready["camera"])

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
    parser.add_argument(
        "--speed", type=_speed, default=1.0, metavar="X", help="times real time (default 1)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all that is random")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly in a world of its own, and report on stdout."""
    mission = load_mission(arguments.mission)
    with _folder(arguments.log_dir) as folder:
        options = SimOptions(speed=arguments.speed, seed=arguments.seed)
        with World(arguments.mission, options, folder) as world:
            result = fly(
                mission,
                FlyOptions(
                    url=world.url,
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
