"""The programs of a rehearsed flight as processes: the companion, vehicles, robots."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import pty
import random
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import yaml

from air_router.mission import load_mission
from air_router.sim import Child, free_port
from mocha_link import Team
from sitl.process import ending_with_us
from sitl.rehearsal import ANOTHER, Fault, MissionFile, hurried, with_terms
from sitl.rehearsal.judge import AnnouncedLine
from sitl.rehearsal.programs.relay import LossyRelay
from sitl.rehearsal.programs.scenes import WireScene
from sitl.team import derive_team

EPOCH: Final = 1_800_000_000
"""Unix seconds at the beginning of the vehicle's time."""

OURS: Final = (sys.executable, "-m", "air_router.cli.cli")
"""How the `air-router` of this installation begins."""

_FROM_HOME_M, _ZONE_M = 25.0, 6.0
_SECOND_PORT, _PORTS = 30_000, 10
_TIMERS: Final = {"init_s": 12, "explore_s": 10, "search_s": 6, "communicate_s": 20}


class Companion:
    """`air-router fly` as a process that is typed to, and whose lines are followed.

    Args:
        program: What is judged: `OURS`, or how another `air-router` begins.
        arguments: Of `air-router fly`.
        folder: To run in.
        now_s: Simulated time.

    Attributes:
        process: It.
        lines: What it printed.
        outcome: Of its last JSON line, once it is closed; empty: there was none.
    """

    def __init__(
        self,
        program: Sequence[str],
        arguments: Sequence[str],
        folder: Path,
        now_s: Callable[[], float],
    ) -> None:
        with contextlib.ExitStack() as undo:
            self._report = undo.enter_context(tempfile.TemporaryFile())  # until it is closed
            keyboard, terminal = pty.openpty()
            self._keyboard = undo.enter_context(io.FileIO(keyboard, "wb"))
            with io.FileIO(terminal, "rb") as theirs:
                self.process = subprocess.Popen(  # noqa: S603 - our own program
                    ending_with_us(*program, "fly", *arguments, "--json"),
                    cwd=folder,
                    stdin=theirs,
                    stdout=self._report,
                    stderr=subprocess.PIPE,
                )
            undo.pop_all()
        self.lines: list[AnnouncedLine] = []
        self.outcome = ""
        self._now_s = now_s
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None  # noqa: S101 - a pipe was requested
        with self.process.stderr as printed:
            for line in printed:
                text = line.decode(errors="replace").rstrip()
                self.lines.append(AnnouncedLine(self._now_s(), text))

    @property
    def last(self) -> str:
        """The last change of its state that it announced."""
        changes = [line.text for line in self.lines if " -> " in line.text and " s  " in line.text]
        return changes[-1] if changes else ""

    @property
    def ended(self) -> bool:
        """Whether the process is gone."""
        return self.process.poll() is not None

    def type(self, text: str) -> None:
        """As an operator at its terminal."""
        self._keyboard.write(f"{text}\n".encode())

    def signal(self, number: int) -> None:
        """Send it a signal, if it runs."""
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)

    def close(self) -> None:
        """End it as a power failure does, and read what it has printed."""
        self.process.kill()
        self.process.wait()
        self._reader.join(2.0)
        if not self._report.closed:
            with self._report as report:
                report.seek(0)
                self.outcome = str(_last_object(report).get("outcome", ""))
        self._keyboard.close()  # once: by then its number may be that of another flight's socket


def _last_object(lines: Iterable[bytes]) -> dict[str, Any]:
    """The last line that is a JSON object: others may be printed after it; {} if there is none."""
    last: dict[str, Any] = {}
    for line in lines:
        with contextlib.suppress(ValueError):
            found = json.loads(line)
            last = found if isinstance(found, dict) else last
    return last


class ProcessPause:
    """Lets a PX4 stand still, which follows no pace: all of its processes are stopped.

    Args:
        group: Their process group.
    """

    def __init__(self, group: int) -> None:
        self._group = group
        self._held = self._released = False  # stopped now; free for good
        self._lock = threading.Lock()  # main and relay threads

    def hold(self, waits: bool) -> None:
        """Stop it, or let it go on; any thread may."""
        with self._lock, contextlib.suppress(ProcessLookupError):
            waits = waits and not self._released
            if waits is not self._held:
                self._held = waits
                os.killpg(self._group, signal.SIGSTOP if waits else signal.SIGCONT)

    def release(self) -> None:
        """Let it go on for good."""
        self._released = True  # first: the relay's thread may be about to hold it
        self.hold(waits=False)


def port_of(url: str) -> int:
    """The port of an address."""
    return int(url.rpartition(":")[2])


def hurry(
    path: Path, folder: Path, scene: WireScene, keys: Mapping[str, Any] = MappingProxyType({})
) -> MissionFile:
    """A copy of the mission in a hurry, low, with a team of its own, in a folder.

    `keys` are other keys of the mission file.
    """
    derive_team(Team.load(path.parent / "team.yaml"), folder)
    team = str(folder / "team.yaml")
    document = {**hurried(path), "team": team, "altitude_m": 20, "timers": _TIMERS, **keys}
    draw, uav = scene.fault.value.document, None
    if draw is None:
        # As many corners as PX4 stores, one drawn circle included.
        document = with_terms(document, hours=False)
    else:
        document = draw(document, folder, scene.chance("document"))
    if scene.fault is Fault.SECOND_UAV:
        uav = ANOTHER
        _give_ports(folder, scene.seed)
    return MissionFile(folder / "mission.yaml", document, uav=uav, masts=False)


def _give_ports(folder: Path, seed: int) -> None:
    """The second UAV gets ports that no flight beside this one has."""
    path = folder / "team.yaml"
    team = yaml.safe_load(path.read_text(encoding="utf-8"))
    team["robots"][ANOTHER]["base_port"] = _SECOND_PORT + _PORTS * seed
    path.write_text(yaml.safe_dump(team), encoding="utf-8")


def draw_zone(file: MissionFile, rng: random.Random) -> None:
    """Draw a zone around a waypoint that is not near to home."""
    places = [waypoint.position for waypoint in file.mission.waypoints]
    far = [place for place in places if math.dist(place, file.mission.home) > _FROM_HOME_M]
    file.circle(rng.choice(far), _ZONE_M)


@dataclass(eq=False)
class Programs:
    """The vehicles and robots of one flight.

    Attributes:
        scene: What goes wrong.
        mission: The file that they start with.
        speed: Times real time.
        px4: Where a real PX4 is; None: `sitl vehicle`.
        relay: Between them and the companion; set before any but a PX4 is started.
    """

    scene: WireScene
    mission: Path
    speed: float
    px4: str | None
    relay: LossyRelay = field(init=False)

    def __post_init__(self) -> None:
        self._vehicles: list[Child] = []  # those that run, the first and one on the same radio
        self._started = 0  # programs so far
        self._brakes: list[ProcessPause] = []  # of all PX4s

    def start_vehicle(self) -> None:
        """Start `sitl vehicle`."""
        more = []
        if self.scene.fault is Fault.GUSTS:
            rng = self.scene.chance("wind")
            mean_m_s = rng.uniform(3.0, 7.0)
            more = [f"--wind={mean_m_s},{rng.uniform(0, 360)},{(10 - mean_m_s) / 2}"]
        self._start_ours(
            *(f"--seed={self.scene.seed}", f"--epoch={EPOCH}", *self._as_another(), *more),
            f"--truth-to=127.0.0.1:{self.relay.truth_port}",
        )

    def _as_another(self) -> list[str]:
        """At the second UAV's home, returning in its layer, where the scene flies that one."""
        if self.scene.fault is not Fault.SECOND_UAV:
            return []
        altitude_m = load_mission(self.mission, uav=ANOTHER).altitude_above_home_m
        return [f"--uav={ANOTHER}", f"--param=RTL_RETURN_ALT={altitude_m:g}"]

    def _start_ours(self, *more: str) -> None:
        self._start(
            *("vehicle", "--no-gcs", f"--api-to=127.0.0.1:{self.relay.api_port}"),
            *(f"--pace-from={self.pace_source}", *more),
        )

    def start_px4(self) -> tuple[int, int]:
        """Start a real PX4; where it sends its API link and its truth.

        It is instance 0: relay, stations and judge know the vehicle as system 1. While another PX4
        of this machine is that, it ends with an error.
        """
        ready = self._start_px4("--instance=0", *self._as_another())
        return port_of(ready["mavlink"]), port_of(ready["truth"])

    def _start_px4(self, *more: str) -> dict[str, Any]:
        ready = self._start("px4", f"--px4={self.px4}", *more)
        self._brakes.append(ProcessPause(ready["process_id"]))
        return ready

    def _start(self, command: str, *options: str) -> dict[str, Any]:
        """Start a vehicle; what it prints when it is ready."""
        self._vehicles.append(self._child(command, f"--speed={self.speed:g}", *options))
        return self._vehicles[-1].ready()

    def start_again(self) -> None:
        """The vehicle that has ended is started anew on the same link."""
        if self.px4 is None:
            self.start_vehicle()
        else:
            self.relay.while_closed(self.start_px4)

    def start_second_vehicle(self) -> None:
        """Start another one, whose messages come over the same radio."""
        if self.px4 is None:
            self._start_ours("--instance=1", f"--truth-to=127.0.0.1:{free_port()}")
        else:
            self.relay.listen(port_of(self._start_px4()["mavlink"]))

    @property
    def pace_source(self) -> str:
        """Where they report how far they are, as does the companion."""
        return f"127.0.0.1:{self.relay.pace_port}"

    def hold(self, waits: bool) -> None:
        """Let PX4s stand still, or go on."""
        for brake in tuple(self._brakes):
            brake.hold(waits)

    def end_vehicles(self) -> None:
        """End them, and wait until they have ended."""
        for brake in self._brakes:
            brake.release()
        for vehicle in self._vehicles:
            vehicle.stop()
        self._brakes.clear()
        self._vehicles.clear()

    @contextlib.contextmanager
    def team(self, folder: Path) -> Iterator[str]:
        """The ground robots, for scenes in COMM; the option by which a companion knows them."""
        robots = self._child(
            *("team", "--truth=udp://127.0.0.1:0", f"--epoch={EPOCH}"),
            *(f"--free-ports={folder / 'team'}", f"--camera=ipc://{folder / 'camera'}"),
            f"--pace-from={self.pace_source}",
        )
        try:
            ready = robots.ready()
            self.relay.copy_truth_to = port_of(ready["truth"])
            yield f"--team={ready['team']}"
        finally:
            robots.stop()

    def _child(self, command: str, *options: str) -> Child:
        """A command of `sitl` about the mission, started."""
        self._started += 1
        log = self.mission.parent / f"{command}-{self._started}.log"
        return Child(command, [command, str(self.mission), *options], log)
