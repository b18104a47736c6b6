"""A companion that stands still while the pilot chooses a mode, and an order of ours falls due.

The companion is stopped (SIGSTOP) for 0.2 to 2 s, again and again in one flight at real time. No
choice that the vehicle took may be ended by us, and each has to be announced. It flies a real PX4
where the environment variable PX4_SITL names one, and the simulated autopilot's process.

`STANDSTILLS=30` sets how many; `-s` prints the table of them.
"""

import contextlib
import json
import math
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.sim.ports import free_port
from geo.frame import Point
from mocha_link import Team
from sitl.process.px4_install import NoPx4Error, find_px4
from sitl.px4sim.state import FlightMode
from sitl.rehearsal.fakes.stations import Station
from sitl.rehearsal.mission_file import MissionFile, hurried
from sitl.rehearsal.programs.processes import OURS, Companion
from sitl.team.derived_team import derive_team
from tests.system.conftest import PENNOVATION, environment

COUNT = int(os.environ.get("STANDSTILLS", "0"))
BOTH = {"simulated": COUNT or 3, "px4": COUNT or 30}
"""How often it stands still, by what is flown: three are enough for every day."""

LIMIT_S = 120.0  # against hangs only
WATCHED_S, ANNOUNCED_S = 3.0, 2.0
BEAT_S = 0.05
CHOICES = (FlightMode.AUTO_LAND, FlightMode.AUTO_RTL, FlightMode.AUTO_LOITER, FlightMode.POSCTL)
DUE = ("hold", "home", "goto", "reload", "fix")
LIFTED_M, LEVEL_M, ALTITUDE_M = 15.0, 18.5, 20.0
NOWHERE = 2**31 - 1


class Pilot:
    """A ground station with a transmitter, on a link of its own; it receives every change of mode.

    Args:
        bound: Its port.
        to: Where the vehicle listens; None: where it sends from.
        vehicle: Its system id.
    """

    def __init__(self, bound, to, vehicle):
        self._socket, self._to, self._vehicle = bound, to, (vehicle, 1)
        self._socket.settimeout(BEAT_S)
        self._lock = threading.Lock()
        self.station = Station(255, self._send, vehicle)
        self.modes = []  # (when, custom mode), as received
        self.place, self.height_m, self.home_amsl_m = None, 0.0, 0.0
        self.armed = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()

    @property
    def mode(self):
        return self.modes[-1][1] if self.modes else None

    def climb(self):
        """To the mission's altitude, where it hovers."""
        here = {"x": NOWHERE, "y": NOWHERE, "z": self.home_amsl_m + ALTITUDE_M}
        self.station.send("COMMAND_INT", command=192, param1=-1.0, param2=1.0, **here)

    def _send(self, sender, name, fields):
        with self._lock:
            if self._to is not None:
                self._socket.sendto(sender.pack_values(name, fields), self._to)

    def _run(self):
        """A HEARTBEAT is requested with every turn: modes show up to a second later otherwise."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        beats_s = 0.0
        while not self._stop.is_set():
            if time.monotonic() >= beats_s:
                beats_s = time.monotonic() + BEAT_S
                self.station.send("HEARTBEAT", type=6, autopilot=8, system_status=4)
                self.station.sticks()
                self.station.command(512, 0.0)
            with contextlib.suppress(TimeoutError, ConnectionError):
                datagram, source = self._socket.recvfrom(65535)
                self._to = self._to or source
                for message in parser.parse_buffer(datagram) or ():
                    self._take(message)

    def _take(self, message):
        if (message.get_srcSystem(), message.get_srcComponent()) != self._vehicle:
            return
        match message.get_type():
            case "HEARTBEAT":
                self.modes.append((time.monotonic(), message.custom_mode))
                self.armed = bool(message.base_mode & 128)
            case "GLOBAL_POSITION_INT":
                self.place = (message.lat / 1e7, message.lon / 1e7)
                self.height_m = message.relative_alt / 1e3
                self.home_amsl_m = (message.alt - message.relative_alt) / 1e3


def wait(condition, what, limit_s=LIMIT_S):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"{what} was waited for in vain"
        time.sleep(BEAT_S / 2)


@dataclass
class Trial:
    """One standstill, and what became of the choice in it."""

    due: str
    mode: FlightMode
    stall_s: float
    taken: bool = False  # the vehicle took the choice while the companion stood still
    ended: str = ""  # by which mode; empty: it stood
    announced_s: float = math.inf  # after it went on

    def __str__(self):
        end = "not taken" if not self.taken else f"ended: {self.ended}" if self.ended else "stood"
        return (
            f"{self.due:7} {self.mode.name:12} {self.stall_s:4.2f} s  {end:12} "
            f"announced after {self.announced_s:4.2f} s"
        )


class Flight:
    """A companion that flies, its pilot, its operator, and its mission file."""

    def __init__(self, companion, pilot, file, dice):
        self.companion, self.pilot, self.file, self.dice = companion, pilot, file, dice
        self.trials = []

    @property
    def ours(self):
        return "-> PASSIVE" not in self.companion.last

    def begin(self):
        wait(
            lambda: self.pilot.height_m > LIFTED_M and "-> INIT" in self.companion.last, "take-off"
        )

    def stand_still(self, due, mode):
        self.take_up()
        pilot, dice = self.pilot, self.dice
        if mode.custom_mode == pilot.mode:
            mode = FlightMode.AUTO_RTL  # to choose what is flown changes nothing
        trial = Trial(due, mode, dice.uniform(0.2, 2.0))
        self.trials.append(trial)
        lines = len(self.companion.lines)
        self.companion.signal(signal.SIGSTOP)
        from_s = time.monotonic()
        self.fall_due(due)
        time.sleep(dice.uniform(0.0, max(0.0, trial.stall_s - 0.15)))
        pilot.station.choose(mode)
        wait(lambda: time.monotonic() >= from_s + trial.stall_s, "the end of the standstill")
        before = len(pilot.modes)
        trial.taken = pilot.mode == mode.custom_mode
        self.companion.signal(signal.SIGCONT)
        on_s = time.monotonic()
        while time.monotonic() < on_s + WATCHED_S:
            time.sleep(BEAT_S)
            if math.isinf(trial.announced_s) and any(
                "hands off" in line.text for line in self.companion.lines[lines:]
            ):
                trial.announced_s = time.monotonic() - on_s
        others = {m for _, m in pilot.modes[before:]} - {mode.custom_mode}
        trial.ended = ", ".join(f"{other:#x}" for other in others)
        if due == "fix":
            pilot.station.set_parameter("SIM_GPS_USED", 10)

    def fall_due(self, due):
        match due:
            case "hold" | "home":
                self.companion.type(due)
            case "goto":
                self.companion.type(f"goto {self.in_sight()}")
            case "reload":
                self.draw()
                self.companion.type("reload")
            case "fix":
                self.pilot.station.set_parameter("SIM_GPS_USED", 0)

    def in_sight(self):
        space = self.file.space
        here = tuple(map(float, space.mission.frame.metres(*self.pilot.place)))
        place = space.in_sight(here, self.dice) or here
        latitude_deg, longitude_deg = space.mission.frame.degrees(*place)
        return f"{latitude_deg:.7f},{longitude_deg:.7f}"

    def draw(self):
        """A zone where it is about to fly: near it, on one side or the other."""
        here = self.file.mission.frame.to_local(*self.pilot.place)
        angle_rad = self.dice.uniform(0.0, 2 * math.pi)
        there = Point(here[0] + 22 * math.sin(angle_rad), here[1] + 22 * math.cos(angle_rad))
        self.file.circle(there, 5.0)

    def take_up(self):
        """The pilot lets it hold, and the operator has it go on, as often as that takes."""
        if not self.ours:
            self.pilot.station.choose(FlightMode.AUTO_LOITER)
            wait(lambda: self.pilot.mode == FlightMode.AUTO_LOITER.custom_mode, "Hold mode")
            if self.pilot.height_m < LEVEL_M:  # it was landing
                self.pilot.climb()
                wait(lambda: self.pilot.height_m >= LEVEL_M, "the climb")
            self.file.undo()  # what was drawn is taken out again
            self.companion.type("reload")

            def resumed():
                self.companion.type("resume")
                with contextlib.suppress(AssertionError):
                    wait(lambda: self.ours, "the resumed flight", 3.0)
                return self.ours

            wait(resumed, "the resumed flight")
        mission = FlightMode.AUTO_MISSION.custom_mode
        with contextlib.suppress(AssertionError):  # else it hovers, and is sent to a point
            wait(lambda: self.pilot.mode == mission, "Mission mode", 8.0)
        time.sleep(self.dice.uniform(0.3, 1.5))


@pytest.fixture(params=BOTH)
def flown(request, tmp_path):
    """The flight of a companion, and how often it is to stand still."""
    if request.param == "px4":
        try:
            find_px4()
        except NoPx4Error as error:
            pytest.skip(str(error).splitlines()[0])
    derive_team(Team.load(PENNOVATION.parent / "team.yaml"), tmp_path)
    document = {**hurried(PENNOVATION), "team": "team.yaml", "altitude_m": ALTITUDE_M}
    document |= {"timers": {"init_s": 3000}, "duration_s": 3000, "endurance_s": 4000}
    file = MissionFile(tmp_path / "mission.yaml", document, masts=False)
    with contextlib.ExitStack() as stack:
        bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        bound.bind(("127.0.0.1", 0))
        api, parameters = free_port(), ("RTL_RETURN_ALT=20", "SIM_BAT_DRAIN=3600")
        arguments = [request.param.replace("simulated", "vehicle"), str(file.path)]
        arguments += [f"--param={each}" for each in parameters]
        if request.param == "simulated":
            arguments += [
                f"--gcs-to=127.0.0.1:{bound.getsockname()[1]}",
                f"--api-to=127.0.0.1:{api}",
            ]
        process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", "sitl", *arguments],
                stdout=subprocess.PIPE,
                stderr=stack.enter_context((tmp_path / "vehicle.log").open("wb")),
                cwd=tmp_path,
                env=environment(),
            )
        )
        stack.callback(process.terminate)
        ready = json.loads(process.stdout.readline())
        to = None
        if request.param == "px4":
            api = int(ready["mavlink"].rpartition(":")[2])
            to = ("127.0.0.1", 18570 + ready["system_id"] - 1)
        pilot = stack.enter_context(contextlib.closing(Pilot(bound, to, ready["system_id"])))
        arguments = [str(file.path), f"--connect=udpin://127.0.0.1:{api}", f"--log-dir={tmp_path}"]
        arguments += [f"--sysid={ready['system_id']}", "--arm", "--yes"]
        companion = Companion(OURS, arguments, tmp_path, time.monotonic)
        stack.callback(companion.close)
        stack.callback(companion.signal, signal.SIGCONT)
        yield Flight(companion, pilot, file, random.Random(36)), BOTH[request.param]


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process as Linux does")
@pytest.mark.timeout(1500)
def test_no_choice_in_a_standstill_is_ended_and_each_is_announced(flown):
    flight, count = flown
    try:
        flight.begin()
        for number in range(count):
            flight.stand_still(DUE[number % len(DUE)], CHOICES[number // 2 % len(CHOICES)])
    finally:
        print(*flight.trials, sep="\n")  # noqa: T201 - the figures, with -s
        print(*(line.text for line in flight.companion.lines[-30:]), sep="\n")  # noqa: T201
    taken = [trial for trial in flight.trials if trial.taken]
    assert [trial for trial in taken if trial.ended] == []
    assert [trial for trial in taken if trial.announced_s > ANNOUNCED_S] == []
    assert len(taken) >= 0.8 * count
