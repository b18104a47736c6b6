"""Rehearsed flights of the real thing: `air-router fly`, MAVSDK and UDP against `sitl vehicle`.

A relay between the two loses packets and falls silent; pilot and power failure are played from
here. The judge is the same as for flights in one process.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from pymavlink.dialects.v20 import common as mavlink

from air_router.mission import load_mission
from geo.frame import Point
from mocha_link import Team
from sitl.free_ports import derive_team
from sitl.rehearsal.faults import Fault, Scene
from sitl.rehearsal.judge import End, Judge, Verdict
from sitl.rehearsal.lossy_relay import LossyRelay, wait_until
from sitl.rehearsal.stage import hurried

if TYPE_CHECKING:
    from air_router.mission import Mission

SPEED: Final = 10
DURATION_S: Final = 60
FLIGHT_S: Final = 120.0
"""Wall clock, for a flight that takes fifteen seconds on an idle machine."""

FLIGHTS: Final = {
    Fault.NONE: 2,
    Fault.GUSTS: 5,
    Fault.LOSS_1: 4,
    Fault.LOSS_5: 5,
    Fault.LOSS_20: 6,
    Fault.SILENCE: 6,
    Fault.PILOT: 4,
    Fault.RESTART: 5,
    Fault.KILL: 2,
    Fault.BATTERY: 3,
}
_ALLOWED: Final = {
    Fault.PILOT: frozenset({End.PILOT}),
    Fault.KILL: frozenset({End.HOVERS}),
    Fault.LOSS_20: frozenset({End.STAYED}),  # over such a link a plan may not get on board
}
_HOLD, _RETURN = 0x03040000, 0x05040000
_AIRBORNE: Final = "READY -> INIT"
_HURRIED: Final = (
    ("init_s: 180", "init_s: 20"),
    ("explore_s: 120", "explore_s: 15"),
    ("search_s: 45", "search_s: 8"),
    ("speed_m_s: 3.5", "speed_m_s: 5"),
)


def scenes_over_mavlink() -> list[Scene]:
    """Which flights."""
    return [Scene(fault, seed) for fault, number in FLIGHTS.items() for seed in range(number)]


class Companion:
    """`air-router fly` as a process whose words are followed."""

    def __init__(self, arguments: list[str], folder: Path) -> None:
        command = [sys.executable, "-m", "air_router.cli", "fly", *arguments]
        self.process = subprocess.Popen(  # noqa: S603 - our own program
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        self.said = ""
        assert self.process.stderr is not None  # noqa: S101 - it was asked for
        self._reader = threading.Thread(target=self._read, args=(self.process.stderr,), daemon=True)
        self._reader.start()

    def _read(self, stream: IO[bytes]) -> None:
        for line in stream:
            self.said += line.decode(errors="replace")

    @property
    def ended(self) -> bool:
        """Whether the process is gone."""
        return self.process.poll() is not None

    def kill(self) -> None:
        """As a power failure does."""
        self.process.kill()
        self.process.wait()


class RealFlight:
    """One flight of a scene."""

    def __init__(self, scene: Scene, path: Path) -> None:
        self.scene = scene
        self._path = path
        self._pilot = False
        self._done = threading.Event()

    def fly(self) -> Verdict:
        """From starting the programs to the end."""
        with tempfile.TemporaryDirectory() as folder:
            mission_path = _hurry(self._path, Path(folder))
            mission = hurried(load_mission(mission_path))
            port = _free_port()
            with LossyRelay(port, self.scene.loss, self.scene.seed) as relay:
                vehicle = self._vehicle(mission_path, relay)
                try:
                    return self._flown(mission, mission_path, relay, port)
                finally:
                    vehicle.terminate()
                    vehicle.wait()

    def _flown(self, mission: Mission, path: Path, relay: LossyRelay, port: int) -> Verdict:
        judge = Judge(mission)
        watching = threading.Thread(target=self._watch, args=(judge, mission, relay))
        watching.start()
        arguments = [str(path), f"--connect=udpin://127.0.0.1:{port}", f"--duration={DURATION_S}"]
        companion = Companion([*arguments, "--arm", "--yes"], path.parent)
        try:
            if wait_until(lambda: _AIRBORNE in companion.said or companion.ended, FLIGHT_S):
                companion = self._misfortune(companion, arguments, relay)
            gone = self.scene.fault in {Fault.KILL, Fault.PILOT}
            wait_until(lambda: companion.ended or not relay.armed, 8.0 if gone else FLIGHT_S)
            wait_until(lambda: companion.ended, 5.0)
            end = self._end(mission, relay) if judge.ours_s > 0 else End.STAYED
        finally:
            if not companion.ended:
                companion.kill()
            self._done.set()
            watching.join()
        allowed = {End.LANDED, End.FAILSAFE} | _ALLOWED.get(self.scene.fault, frozenset())
        return Verdict(
            scene=f"{self.scene} over MAVLink",
            fault=self.scene.fault.name,
            end=end,
            deepest_m=judge.deepest_m,
            flown_s=judge.ours_s,
            expected=end in allowed,
            why=companion.said[-300:],
        )

    def _vehicle(self, path: Path, relay: LossyRelay) -> subprocess.Popen[bytes]:
        more = []
        if self.scene.fault is Fault.GUSTS:
            dice = self.scene.chance("wind")
            mean_m_s = dice.uniform(3.0, 7.0)
            more = [f"--wind={mean_m_s},{dice.uniform(0, 360)},{(10 - mean_m_s) / 2}"]
        if self.scene.fault is Fault.BATTERY:
            more = [f"--battery-minutes={self.scene.chance('battery').uniform(1.2, 3.0)}"]
        vehicle = subprocess.Popen(  # noqa: S603 - our own program
            [
                *(sys.executable, "-m", "sitl", "vehicle", str(path), f"--speed={SPEED}"),
                *(f"--seed={self.scene.seed}", "--no-gcs", *more),
                f"--api-to=127.0.0.1:{relay.api_port}",
                f"--truth-to=127.0.0.1:{relay.truth_port}",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert vehicle.stdout is not None  # noqa: S101 - it was asked for
        vehicle.stdout.readline()
        return vehicle

    def _misfortune(
        self, companion: Companion, arguments: list[str], relay: LossyRelay
    ) -> Companion:
        dice = self.scene.chance("when")
        wait_until(lambda: False, dice.uniform(0.5, 6.0))
        match self.scene.fault:
            case Fault.SILENCE:
                relay.silent = True
                wait_until(lambda: False, dice.choice((0.5, 2.0, 5.0)))
                relay.silent = False
            case Fault.PILOT:
                self._pilot = True
                relay.inject(_mode_command(dice.choice((_HOLD, _RETURN))))
            case Fault.RESTART:
                companion.kill()
                wait_until(lambda: False, dice.uniform(0.2, 3.0))
                return Companion([*arguments, "--resume"], Path(arguments[0]).parent)
            case Fault.KILL:
                companion.kill()
        return companion

    def _watch(self, judge: Judge, mission: Mission, relay: LossyRelay) -> None:
        ground_m = mission.home_altitude_amsl_m or 0.0
        while not self._done.wait(0.005):
            truth = relay.truth
            if truth is not None and truth[2] > ground_m + 1.0:
                place: Point = mission.frame.to_local(*truth[:2])
                ours = not (self._pilot or relay.failsafe)
                judge.see(place, 0.005 * SPEED, ours=ours)

    def _end(self, mission: Mission, relay: LossyRelay) -> End:
        if relay.failsafe:
            return End.FAILSAFE
        if self._pilot:
            return End.PILOT
        assert relay.truth is not None  # noqa: S101 - it comes from the start
        east_m, north_m = mission.frame.to_local(*relay.truth[:2])
        home_m = ((east_m - mission.home[0]) ** 2 + (north_m - mission.home[1]) ** 2) ** 0.5
        if not relay.armed and home_m < 3.0:
            return End.LANDED
        return End.HOVERS if self.scene.fault is Fault.KILL else End.NOT


def _hurry(path: Path, folder: Path) -> Path:
    text = path.read_text(encoding="utf-8")
    for slow, fast in _HURRIED:
        text = text.replace(slow, fast)
    shutil.copy(path.parent / "world.yaml", folder)
    derive_team(Team.load(path.parent / "team.yaml"), folder)
    hurried_path = folder / "mission.yaml"
    hurried_path.write_text(text, encoding="utf-8")
    return hurried_path


def _mode_command(custom_mode: int) -> bytes:
    """DO_SET_MODE from a ground station."""
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    main, sub = (custom_mode >> 16) & 0xFF, custom_mode >> 24
    frame = sender.command_long_encode(1, 1, 176, 0, 1, main, sub, 0, 0, 0, 0).pack(sender)
    return bytes(frame)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
