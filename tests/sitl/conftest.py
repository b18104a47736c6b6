import math
import struct
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import development as mavlink

from sitl.mavlink.mavlink_vehicle import MavlinkVehicle, VehicleSettings
from sitl.mavlink.telemetry import ONBOARD_RATES_HZ
from sitl.px4sim.state.notice import Notice, Severity
from sitl.px4sim.state.situation import Place

HOME = Place(47.397742, 8.545594, 489.4)
STEP_S = 0.04  # half as many as the process does
SLOWER_HZ = {name: min(rate_hz, 10.0) for name, rate_hz in ONBOARD_RATES_HZ.items()}
GROUND_STATION = (255, 190)
NAMES = {number: message.msgname for number, message in mavlink.mavlink_map.items()} | {
    410: "EVENT",
    411: "CURRENT_EVENT_SEQUENCE",
}


class Event(NamedTuple):
    name: str
    id: int
    levels: int
    arguments: bytes


class EventSequence(NamedTuple):
    name: str
    sequence: int
    flags: int


class MissionCurrent(NamedTuple):
    seq: int
    total: int
    state: int
    mode: int
    mission_id: int
    fence_id: int
    rally_id: int


class Heard(NamedTuple):
    """A frame, decoded on request: a vehicle says hundreds in a simulated second."""

    at_s: float
    number: int
    frame: bytes

    @property
    def name(self):
        return NAMES[self.number]

    @property
    def message(self):
        return decode(self.number, self.frame)


class Ear:
    """Reads what a link sends; the fast streams are left out."""

    FAST = frozenset({30, 31, 32, 33, 74, 105, 111, 141, 24})

    def __init__(self):
        self._heard = []
        self._newest = {}  # not forgotten by clear()

    def listen(self, frames, now_s):
        for frame in frames:
            number = int.from_bytes(frame[7:10], "little")
            if number not in self.FAST and frame[5:7] == b"\x01\x01":
                heard = Heard(now_s, number, frame)
                if heard.name not in self._newest:
                    assert heard.message is not None  # of every kind one is read at once
                self._heard.append(heard)
                self._newest[heard.name] = heard

    @property
    def heard(self):
        """What was heard, each with its simulated time."""
        return [(each.at_s, each.message) for each in self._heard]

    def names(self):
        return [each.name for each in self._heard]

    def all(self, name):
        return [each.message for each in self._heard if each.name == name]

    def last(self, name):
        return self._newest[name].message

    def texts(self):
        """STATUSTEXTs, put together from their chunks, without the tab that names an event twin."""
        texts = {}
        for message in self.all("STATUSTEXT"):
            texts[message.id] = texts.get(message.id, "") + message.text
        return [text.rstrip("\t") for text in texts.values()]

    def events(self):
        return {message.id for message in self.all("EVENT")}

    def said(self, event):
        return Notice(Severity.INFO, event=event).event_id in self.events()

    def clear(self):
        self._heard.clear()


def decode(number, frame):
    payload = frame[10:-2]
    if number == 410:
        fields = struct.unpack("<IIHBBB40s", payload.ljust(53, b"\0"))
        return Event("EVENT", fields[0], fields[5], fields[6])
    if number == 411:
        return EventSequence(
            "CURRENT_EVENT_SEQUENCE", *struct.unpack("<HB", payload.ljust(3, b"\0"))
        )
    if number == 42:
        return MissionCurrent(*struct.unpack("<HHBBIII", payload.ljust(18, b"\0")))
    return mavlink.MAVLink(None).decode(bytearray(frame))


class Rig:
    """A vehicle in this process, with partners on both links; simulated time only."""

    def __init__(self, speed=1.0, seed=1, **parameters):
        parameters = {"SIM_BAT_DRAIN": 3600.0, "SIM_BAT_MIN_PCT": 0.0} | parameters
        self.vehicle = MavlinkVehicle(
            VehicleSettings(
                HOME,
                seed=seed,
                speed=speed,
                parameters=parameters,
                step_s=STEP_S,
                onboard_rates_hz=SLOWER_HZ,
            )
        )
        self.autopilot = self.vehicle.autopilot
        self.onboard, self.ground = Ear(), Ear()
        self.heartbeats = True
        self._beat_s = 0.0

    @property
    def now_s(self):
        return self.autopilot.time_s

    @property
    def mode(self):
        return self.autopilot.mode.name

    def run(self, seconds=1000.0, until=None):
        """Let time pass; returns whether `until` became true."""
        for _ in range(round(seconds / STEP_S)):
            if self.heartbeats and self.now_s >= self._beat_s:
                self._beat_s = self.now_s + 1.0
                self.send("heartbeat", 6, 8, 0, 0, 0, link="ground")
            self.vehicle.step()
            self._hear()
            if until is not None and until():
                return True
        return until is None

    def send(self, name, *fields, link="onboard", source=GROUND_STATION):
        sender = mavlink.MAVLink(None, *source)
        frame = getattr(sender, f"{name}_encode")(*fields).pack(sender)
        self.receive(frame, link)

    def receive(self, datagram, link="onboard"):
        self.vehicle.receive(getattr(self.vehicle, link), bytes(datagram))
        self._hear()

    def command(self, number, *params, target=(1, 1), source=GROUND_STATION):
        """A COMMAND_LONG; returns the results that come within 0.2 s."""
        self.onboard.clear()
        params = (*params, *(math.nan,) * (7 - len(params)))
        self.send("command_long", *target, number, 0, *params, source=source)
        self.run(0.2)
        return [ack.result for ack in self.onboard.all("COMMAND_ACK")]

    def reposition(self, north_m, east_m, altitude_m, *, frame=5, flags=1):
        latitude, longitude = self.degrees(north_m, east_m)
        self.onboard.clear()
        x, y = round(latitude * 1e7), round(longitude * 1e7)
        params = (-1, flags, 0, math.nan)
        self.send("command_int", 1, 1, frame, 192, 0, 0, *params, x, y, altitude_m)
        self.run(0.2)
        return [ack.result for ack in self.onboard.all("COMMAND_ACK")]

    def degrees(self, north_m, east_m):
        return self.autopilot.situation.projection.to_global(north_m, east_m)

    def item(self, sequence, north_m, east_m, up_m, command=16, **changes):
        latitude, longitude = self.degrees(north_m, east_m)
        fields = {
            "frame": 6,
            "current": 0,
            "go_on": 1,
            "params": (0, 0, 0, math.nan),
            "x": round(latitude * 1e7),
            "y": round(longitude * 1e7),
            "type": 0,
        } | changes
        return (
            *(1, 1, sequence, fields["frame"], command, fields["current"], fields["go_on"]),
            *(*fields["params"], fields["x"], fields["y"], up_m, fields["type"]),
        )

    def fence(self, corners, command=5002, count=None):
        params = (len(corners) if count is None else count, 0, 0, 0)
        return [
            self.item(number, *corner, 0, command, frame=0, params=params, type=1)
            for number, corner in enumerate(corners)
        ]

    def upload(self, items, mission_type=0, link="onboard"):
        """Upload as a client does; returns (message, sequence or result) of each answer."""
        ear = getattr(self, link)
        ear.clear()
        self.send("mission_count", 1, 1, len(items), mission_type, link=link)
        answers = []
        for _ in range(len(items) + 1):
            if not ear.names():
                break
            name = ear.names()[-1]
            message = ear.last(name)
            ear.clear()
            if name == "MISSION_ACK":
                answers.append(("ACK", message.type))
                break
            answers.append((name, message.seq))
            self.send("mission_item_int", *items[message.seq], link=link)
        return answers

    def ready(self):
        """Wait until it can be armed."""
        assert self.run(10, lambda: self.autopilot.can_arm)

    def fly(self, altitude_m=15.0):
        """Arm, take off and hover."""
        self.ready()
        assert self.command(400, 1) == [0]
        target = HOME.altitude_m + altitude_m
        assert self.command(22, math.nan, 0, 0, math.nan, math.nan, math.nan, target) == [0]
        assert self.run(60, lambda: self.mode == "AUTO_LOITER" and not self.landed)
        self.run(3)

    @property
    def landed(self):
        return self.autopilot.situation.landed

    def position(self):
        """The truth: north, east, up in metres."""
        airframe = self.autopilot.airframe
        return airframe.north_m, airframe.east_m, airframe.up_m

    def away_m(self, north_m, east_m):
        return math.dist(self.position()[:2], (north_m, east_m))

    def _hear(self):
        for link, ear in ((self.vehicle.onboard, self.onboard), (self.vehicle.ground, self.ground)):
            ear.listen(link.take_frames(), self.now_s)
        self.vehicle.truth.take_frames()


@pytest.fixture
def rig():
    return Rig()


@pytest.fixture
def make_rig():
    return Rig
