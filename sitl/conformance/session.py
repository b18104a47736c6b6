"""One conversation under way: what was said and heard, on the vehicle's own clock."""

import math
import struct
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from sitl.conformance.line import Line, Link
from sitl.mavlink.codec import Frame, Sender, addressed
from sitl.px4sim.state import FlightMode, Notice, Severity

GROUND_STATION: Final = (6, 255, 190)  # MAV_TYPE, system id, component id
COMPANION: Final = (18, 1, 191)
_AUTOPILOT: Final = 1
_BEAT_S: Final = 0.5
_POSITION: Final = struct.Struct("<Iffffff")
_METRES_PER_DEGREE: Final = math.radians(6371000.0)
_COUNTED_ONLY: Final = frozenset(
    {
        *("ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "HIGHRES_IMU", "ODOMETRY"),
        *("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "VFR_HUD", "ALTITUDE", "TIMESYNC"),
        *("SERVO_OUTPUT_RAW", "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT"),
        *("GPS_RAW_INT", "SYS_STATUS", "VIBRATION", "SCALED_PRESSURE", "ESTIMATOR_STATUS"),
    }
)


class DepartureError(Exception):
    """The vehicle did something else than the conversation says; the message tells both."""


@dataclass(frozen=True)
class Heard:
    """One message that came in.

    Attributes:
        at_s: Vehicle's time.
        link: On which link.
        frame: The message.
    """

    at_s: float
    link: Link
    frame: Frame

    @cached_property
    def fields(self) -> dict[str, Any]:
        """The message's fields."""
        return self.frame.fields()


@dataclass(frozen=True, slots=True)
class PositionEstimate:
    """A position estimate: seconds, metres north, east and up of where the vehicle was started."""

    at_s: float
    north_m: float
    east_m: float
    up_m: float

    def __str__(self) -> str:
        return f"({self.north_m:.1f}, {self.east_m:.1f}, {self.up_m:.1f})"


@dataclass(slots=True)
class Stream:
    """Something said again and again: a pilot's sticks."""

    name: str
    fields: dict[str, Any]
    interval_s: float
    due_s: float = -math.inf


class Session:
    """A conversation with the vehicle at the other end of a line.

    Args:
        line: The vehicle.

    Attributes:
        beats: Whose heartbeats are sent on which link: MAV_TYPE, system id, component id.
        streams: What is sent all the time besides.
        notes: What was seen, for the report.
        track: Every position heard.
        counts: How many messages came in, by link and name.
        vehicle_id: The vehicle's system id, as it was heard.
    """

    def __init__(self, line: Line) -> None:
        self.line = line
        self.beats: dict[Link, tuple[int, int, int]] = {
            Link.API: GROUND_STATION,
            Link.GROUND: GROUND_STATION,
        }
        self.streams: list[Stream] = []
        self.notes: list[str] = []
        self.track: list[PositionEstimate] = []
        self.counts: Counter[tuple[Link, str]] = Counter()
        self.vehicle_id = 1
        self._heard: defaultdict[tuple[Link, str], list[Heard]] = defaultdict(list)
        self._newest: dict[tuple[Link, str], Heard] = {}  # through all exchanges
        self._speakers: dict[tuple[int, int], Sender] = {}  # by sender: sequences go on
        self._beat_s = -math.inf  # vehicle's time of our last HEARTBEATs

    @property
    def now_s(self) -> float:
        """The vehicle's time."""
        return self.line.now_s

    # Saying

    def mark(self) -> None:
        """A new exchange begins: `since` looks no further back than here."""
        self._heard.clear()

    def say(self, name: str, link: Link = Link.API, **fields: Any) -> None:
        """Send one message; where it has a target that is not given, the vehicle is it."""
        _, *sender = self.beats.get(link, GROUND_STATION)
        speaker = self._speakers.setdefault((sender[0], sender[1]), Sender(*sender))
        self.line.send(link, speaker.pack_values(name, addressed(name, self.vehicle_id, fields)))

    # Hearing

    def run(self, seconds: float, until: Callable[[], bool] | None = None) -> bool:
        """Let the vehicle's time pass; whether `until` became true."""
        while not self.now_s:  # the vehicle's clock was not heard yet
            self._listen()
        end_s = self.now_s + seconds
        while True:
            if until is not None and until():
                return True
            if self.now_s >= end_s:
                return until is None
            self._speak_on()
            self._listen()

    def since(self, name: str, link: Link = Link.API) -> list[Heard]:
        """The messages of a name since the present exchange began."""
        return list(self._heard[link, name])

    def newest(self, name: str, link: Link = Link.API) -> dict[str, Any] | None:
        """The fields of the newest message of a name; None if there was none."""
        heard = self._newest.get((link, name))
        return None if heard is None else heard.fields

    def texts(self, link: Link = Link.API) -> list[str]:
        """The STATUSTEXTs since the exchange began, put together from their pieces."""
        texts: dict[int, str] = {}
        for heard in self.since("STATUSTEXT", link):
            number, text = heard.fields["id"], heard.fields["text"]
            texts[number] = texts.get(number, "") + text
        return [text.rstrip("\t") for text in texts.values()]

    @property
    def position(self) -> PositionEstimate:
        """Where the vehicle says it is."""
        if not self.track:
            self.run(5.0, lambda: bool(self.track))
        if not self.track:
            raise DepartureError("expected LOCAL_POSITION_NED, heard none")
        return self.track[-1]

    def degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Latitude and longitude of a place in local metres."""
        latitude, longitude, _ = self._home()
        scale = _METRES_PER_DEGREE * math.cos(math.radians(latitude))
        return latitude + north_m / _METRES_PER_DEGREE, longitude + east_m / scale

    @property
    def ground_amsl_m(self) -> float:
        """The altitude of home, as it is known now."""
        return self._home()[2]

    def _home(self) -> tuple[float, float, float]:
        self.run(5.0, lambda: self.newest("HOME_POSITION") is not None)
        home = self.newest("HOME_POSITION")
        if home is None:
            raise DepartureError("expected HOME_POSITION, heard none in 5 s")
        latitude, longitude = home["latitude"] * 1e-7, home["longitude"] * 1e-7
        scale = _METRES_PER_DEGREE * math.cos(math.radians(latitude))
        return (
            latitude - home["x"] / _METRES_PER_DEGREE,
            longitude - home["y"] / scale,
            home["altitude"] / 1e3,
        )

    def _listen(self) -> None:
        for link, frame in self.line.listen():
            self._hear(link, frame)

    def _speak_on(self) -> None:
        now_s = self.now_s
        if now_s - self._beat_s >= _BEAT_S:
            self._beat_s = now_s
            for link, (kind, *_) in self.beats.items():
                if link in self.line.links:
                    self.say("HEARTBEAT", link, type=kind, autopilot=8, mavlink_version=3)
        for stream in self.streams:
            if now_s >= stream.due_s:
                late = now_s - stream.due_s > stream.interval_s
                stream.due_s = (
                    now_s + stream.interval_s if late else stream.due_s + stream.interval_s
                )
                self.say(stream.name, **stream.fields)

    def _hear(self, link: Link, frame: Frame) -> None:
        if frame.component_id != _AUTOPILOT and frame.name != "STATUSTEXT":
            return  # passed on from the other link
        if frame.name == "HEARTBEAT":
            self.vehicle_id = frame.system_id
        self.counts[link, frame.name] += 1
        heard = Heard(self.now_s, link, frame)
        self._newest[link, frame.name] = heard
        if frame.name == "LOCAL_POSITION_NED" and link is Link.API:
            padded = frame.payload.ljust(_POSITION.size, b"\0")
            _, north, east, down, *_rest = _POSITION.unpack(padded[: _POSITION.size])
            self.track.append(PositionEstimate(self.now_s, north, east, -down))
        if frame.name not in _COUNTED_ONLY:
            self._heard[link, frame.name].append(heard)


def mode_name(custom_mode: int) -> str:
    """The name of PX4's mode in a HEARTBEAT.custom_mode."""
    for mode in FlightMode:
        if mode.custom_mode == custom_mode:
            return mode.name
    return f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"


def event_id(name: str) -> int:
    """The number by which EVENT names one of PX4's events, such as `commander_armed_by`."""
    return Notice(Severity.INFO, event=name).event_id
