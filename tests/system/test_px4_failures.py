"""Satellites and sticks that fail in the air, on real PX4s: who flies then, what is announced.

PX4 has MAV_CMD_INJECT_FAILURE (SYS_FAILURE_EN, which its start script for simulation sets); the
satellites of its built-in simulator obey it from 1.18 on. Before that a parameter takes them away.
"""

import contextlib
import json
import socket
import struct
import threading
import time
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import common as mavlink

from tests.system.real_px4 import PLACES, found, named_by, started

pytestmark = [pytest.mark.parametrize("place", PLACES), pytest.mark.timeout(600)]

GROUND_STATION = 255, 190
TURN_S, BEAT_S, ANSWER_S = 0.02, 0.2, 5.0
AUTO, RETURN, LAND = 4, 5, 6  # main mode, and two of its sub-modes
FAILSAFE = 5  # HEARTBEAT.system_status: CRITICAL
INJECT_FAILURE, GPS, OFF = 420, 4, 1


class Shown(NamedTuple):
    """A change of what the vehicle reports of itself: main mode, sub-mode, armed, system status."""

    main: int
    sub: int
    armed: bool
    status: int


class Station:
    """A ground station of its own on PX4's link for one: heartbeats, and sticks while they are on.

    Attributes:
        sticks: Whether MANUAL_CONTROL is sent, all centred.
        shown: What the HEARTBEATs reported, each change once.
        texts: The STATUSTEXTs.
        answers: Results of commands, by command.
    """

    def __init__(self, system):
        self.sticks = False
        self.shown, self.texts, self.answers = [], [], {}
        self._system, self._to = system, ("127.0.0.1", 18570 + system - 1)
        self._link = mavlink.MAVLink(None, *GROUND_STATION)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(TURN_S)
        self._stop = threading.Event()
        self._received = threading.Condition()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def command(self, number, *params):
        """Send COMMAND_LONG."""
        values = *params, *(0.0,) * (7 - len(params))
        self._send(self._link.command_long_encode(self._system, 1, number, 0, *values))

    def set(self, name, value):
        """Set a parameter that is a whole number."""
        real = struct.unpack("<f", struct.pack("<i", value))[0]
        self._send(self._link.param_set_encode(self._system, 1, name.encode(), real, 6))

    def wait_until(self, condition, limit_s):
        """Whether something that was received made `condition` true in time."""
        with self._received:
            return self._received.wait_for(condition, limit_s)

    def _send(self, message):
        self._socket.sendto(message.pack(self._link), self._to)

    def _run(self):
        beat_s = -BEAT_S
        while not self._stop.is_set():
            if time.monotonic() - beat_s >= BEAT_S:
                beat_s = time.monotonic()
                self._send(self._link.heartbeat_encode(6, 8, 0, 0, 4))
            if self.sticks:
                self._send(self._link.manual_control_encode(self._system, 0, 0, 500, 0, 0))
            with contextlib.suppress(TimeoutError):
                for message in self._parser.parse_buffer(self._socket.recv(65536)) or ():
                    if message.get_srcComponent() == 1:
                        with self._received:
                            self._receive(message)
                            self._received.notify_all()

    def _receive(self, message):
        match message.get_type():
            case "HEARTBEAT":
                mode = message.custom_mode
                armed = bool(message.base_mode & 128)
                now = Shown(mode >> 16 & 255, mode >> 24, armed, message.system_status)
                if now not in self.shown[-1:]:
                    self.shown.append(now)
            case "STATUSTEXT":
                self.texts.append(message.text)
            case "COMMAND_ACK":
                self.answers[message.command] = message.result


@contextlib.contextmanager
def on_the_way(command, folder, mission, place, *, sticks=False):
    """A flight that has begun its mission, and a station beside it."""
    found(place)
    arguments = "px4", mission, "--speed=3", "--param=NAV_RCL_ACT=2", *named_by(place)
    with (
        started(folder, *arguments) as ready,
        contextlib.closing(Station(ready["system_id"])) as station,
    ):
        station.sticks = sticks
        assert station.wait_until(lambda: station.shown, ANSWER_S)
        link = f"--connect={ready['mavlink']}", f"--sysid={ready['system_id']}"
        flight = command(
            *("air-router", "fly", mission, *link, "--arm", "--yes", "--duration=150"),
            *("--json", "--no-record"),
        )
        flight.wait_for("READY -> INIT")
        yield flight, station


def test_a_lost_fix_is_landed_by_px4_and_left_to_it(place, command, short_mission, tmp_path):
    with on_the_way(command, tmp_path, short_mission, place) as (flight, station):
        station.command(INJECT_FAILURE, GPS, OFF)
        if not station.wait_until(lambda: INJECT_FAILURE in station.answers, ANSWER_S):
            station.set("SIM_GPS_USED", 0)
        code, out = flight.finish()
    report = json.loads(out)
    assert (code, report["outcome"]) == (1, "failsafe"), flight.printed
    assert "WARNING: GPS has lost its fix: holding" in flight.printed
    assert "ALARM: hands off: an autopilot failsafe chose Land mode" in flight.printed
    assert "ALARM: the vehicle's position is not known: GPS has no fix" in flight.printed
    assert "breach of" not in flight.printed  # by a position that drifts
    assert "home was moved" not in flight.printed  # PX4 may set it anew as it lands
    flown = [one for one in station.shown if one.armed]
    assert flown[-1][:2] == (AUTO, LAND), station.shown  # no order of ours came after it
    assert flown[-1].status == FAILSAFE


def test_lost_sticks_return_it_and_it_is_left_to_px4(place, command, short_mission, tmp_path):
    with on_the_way(command, tmp_path, short_mission, place, sticks=True) as (flight, station):
        station.sticks = False
        code, out = flight.finish()
    report = json.loads(out)
    assert (code, report["outcome"]) == (1, "failsafe"), flight.printed
    assert "ALARM: hands off: an autopilot failsafe chose Hold mode" in flight.printed
    assert "ALARM: an autopilot failsafe changed from Hold to Return mode" in flight.printed
    flown = [one for one in station.shown if one.armed]
    assert flown[-1][:2] == (AUTO, RETURN), station.shown  # no order of ours came after it
    assert flown[-1].status == FAILSAFE
