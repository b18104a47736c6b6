"""One conversation under way: lines to a vehicle, messages sent and received, on its own clock."""

import contextlib
import math
import select
import socket
import time
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Final, NamedTuple

from air_router.vehicle.px4 import Version
from sitl.mavlink import Frame, MavlinkVehicle, Sender, VehicleSettings, addressed, frames
from sitl.process import PortInUseError
from sitl.px4sim import MapProjection

GROUND_STATION: Final = (6, 255, 190)  # MAV_TYPE, system id, component id
COMPANION: Final = (18, 1, 191)
_AUTOPILOT: Final = 1
_BEAT_S: Final = 0.5
_STICKS_S: Final = 0.05
_COUNTED_ONLY: Final = frozenset(
    {
        *("ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "HIGHRES_IMU", "ODOMETRY"),
        *("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "VFR_HUD", "ALTITUDE", "TIMESYNC"),
        *("SERVO_OUTPUT_RAW", "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT"),
        *("GPS_RAW_INT", "SYS_STATUS", "VIBRATION", "SCALED_PRESSURE", "ESTIMATOR_STATUS"),
    }
)


class LinkKind(Enum):
    """Which of PX4's links."""

    API = "API"
    GROUND = "GCS"


class SilentVehicleError(Exception):
    """The vehicle was silent for too long; the message has the port."""


class DepartureError(Exception):
    """The vehicle departed from the conversation; the message has both."""


class ReceivedMessage(NamedTuple):
    """One message that came in, when by the vehicle's time, and on which link."""

    at_s: float
    link: LinkKind
    name: str
    fields: dict[str, Any]


class PositionEstimate(NamedTuple):
    """A position estimate: seconds, metres north, east and up of where the vehicle was started."""

    at_s: float
    north_m: float
    east_m: float
    up_m: float

    def __str__(self) -> str:
        return f"({self.north_m:.1f}, {self.east_m:.1f}, {self.up_m:.1f})"

    @property
    def level_m(self) -> tuple[float, float]:
        """North and east."""
        return self.north_m, self.east_m


class LocalLine:
    """To a simulated vehicle of our own in this process.

    It is as fast as it can be computed, and the same every time.

    Args:
        settings: What vehicle.

    Attributes:
        vehicle: It.
        links: The links that there are.
        time_scale: Simulated seconds in which a reply comes that takes a second: it takes none.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        self.time_scale = 1.0
        self.vehicle = MavlinkVehicle(settings)
        self._ends = {LinkKind.API: self.vehicle.onboard}  # those that are open
        if settings.ground_link:
            self._ends[LinkKind.GROUND] = self.vehicle.ground
        self.links = frozenset(self._ends)

    @property
    def now_s(self) -> float:
        """The vehicle's simulated time."""
        return self.vehicle.autopilot.time_s

    def send(self, link: LinkKind, frame: bytes) -> None:
        """Send a frame."""
        self.vehicle.receive(self._ends[link], frame)

    def listen(self) -> list[tuple[LinkKind, Frame]]:
        """Let one step of the simulation pass; returns the frames received in it."""
        self.vehicle.step()
        self.vehicle.truth.take_frames()
        return [
            (link, frame)
            for link, end in self._ends.items()
            for data in end.take_frames()
            for frame in frames(data)
            if frame.name
        ]

    def close(self) -> None:
        """There is nothing to let go of."""


_LARGEST: Final = 65535
_BUFFER: Final = 4 << 20  # 900 parameters come at once
_MOST_AT_ONCE: Final = 50
_SILENCE_S: Final = 8.0  # a PX4 sends its first message about a second after its start
_CLOCKS: Final = frozenset({"ATTITUDE", "LOCAL_POSITION_NED"})  # time_boot_ms comes first in both


class UdpLine:
    """Over UDP, to a PX4 or a vehicle of ours that sends to ports of this machine.

    Args:
        ports: Where the vehicle sends each link to.
        system_id: The vehicle's. Others may send to the same port: all PX4s of a machine do to that
            of the ground station. None: whatever comes is taken for it.
        time_scale: Simulated seconds of a second of the wall's clock, by which replies come.

    Attributes:
        links: The links that there are.
        time_scale: The same.
        now_s: The vehicle's simulated time on its API link; 0: not received yet.

    Raises:
        PortInUseError: a port is taken.
    """

    def __init__(
        self, ports: Mapping[LinkKind, int], system_id: int | None = None, time_scale: float = 1.0
    ) -> None:
        self._system_id, self.time_scale = system_id, time_scale
        self.links = frozenset(ports)
        self.now_s = 0.0
        self._sockets: dict[LinkKind, socket.socket] = {}  # empty once it is closed
        self._partners: dict[LinkKind, tuple[str, int]] = {}  # whence it sent last
        self._received_s = time.monotonic()  # wall clock
        try:
            for link, port in ports.items():
                end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._sockets[link] = end
                end.setblocking(False)
                end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
                end.bind(("127.0.0.1", port))
        except OSError as error:
            self.close()
            raise PortInUseError(
                f"cannot listen on UDP port {port}, where the vehicle sends its {link.value} link: "
                f"{error.strerror}; end the ground station or the other `sitl conform` that has it"
            ) from None

    def send(self, link: LinkKind, frame: bytes) -> None:
        """Send a frame; lost while the vehicle has not sent anything on that link."""
        partner = self._partners.get(link)
        if partner is not None:
            self._sockets[link].sendto(frame, partner)

    def listen(self) -> list[tuple[LinkKind, Frame]]:
        """Wait for a datagram, not longer than 20 ms; returns the frames received.

        Raises:
            SilentVehicleError: the vehicle has fallen silent.
        """
        received: list[tuple[LinkKind, Frame]] = []
        ready = select.select(list(self._sockets.values()), [], [], 0.02)[0]
        for link, end in self._sockets.items():
            if end in ready:
                received += [(link, frame) for frame in self._receive(link, end)]
        if time.monotonic() - self._received_s > _SILENCE_S:
            ports = ", ".join(str(end.getsockname()[1]) for end in self._sockets.values())
            raise SilentVehicleError(f"no vehicle sends to UDP port {ports} of this machine")
        return received

    def _receive(self, link: LinkKind, end: socket.socket) -> list[Frame]:
        received: list[Frame] = []
        with contextlib.suppress(BlockingIOError):
            for _ in range(_MOST_AT_ONCE):
                datagram, sender = end.recvfrom(_LARGEST)
                incoming = [frame for frame in frames(datagram) if frame.name]
                if any(self._is_anothers(frame) for frame in incoming):
                    continue
                self._partners[link] = sender
                self._received_s = time.monotonic()
                received += incoming
        for frame in received:
            if frame.name in _CLOCKS and link is LinkKind.API:
                self.now_s = int.from_bytes(frame.payload[:4], "little") / 1e3
        return received

    def _is_anothers(self, frame: Frame) -> bool:
        """Whether it is of the autopilot of another vehicle."""
        ours = self._system_id in {None, frame.system_id}
        return frame.component_id == _AUTOPILOT and not ours

    def close(self) -> None:
        """Let go of it."""
        for end in self._sockets.values():
            end.close()
        self._sockets.clear()


Line = LocalLine | UdpLine
"""A vehicle at the other end."""


class Session:
    """A conversation with the vehicle at the other end of a line.

    Args:
        line: The vehicle.
        version: Of its PX4.

    Attributes:
        version: The same.
        beats: Whose heartbeats are sent on which link: MAV_TYPE, system id, component id.
        sticks: Fields of MANUAL_CONTROL, sent all the time besides; None: there are no sticks.
        notes: Observations, for the report.
        track: Every position received.
        counts: How many messages came in, by link and name.
        vehicle_id: The vehicle's system id, as received.
    """

    def __init__(self, line: Line, version: Version) -> None:
        self.line, self.version = line, version
        self.beats = dict.fromkeys(LinkKind, GROUND_STATION)
        self.sticks: dict[str, Any] | None = None
        self.notes: list[str] = []
        self.track: list[PositionEstimate] = []
        self.counts: Counter[tuple[LinkKind, str]] = Counter()
        self.vehicle_id = 1
        self._received: list[ReceivedMessage] = []  # since the present exchange began
        self._newest: dict[tuple[LinkKind, str], Frame] = {}  # through all exchanges
        self._senders: dict[tuple[int, int], Sender] = {}  # by sender: sequences go on
        self._beat_s = self._sticks_s = -math.inf  # vehicle's time of the last we sent, and are due

    @property
    def now_s(self) -> float:
        """The vehicle's time."""
        return self.line.now_s

    # Sending

    def mark(self) -> None:
        """A new exchange begins: `since` returns no earlier messages."""
        self._received.clear()

    def send(self, name: str, link: LinkKind = LinkKind.API, **fields: Any) -> None:
        """Send one message; where it has a target that is not given, the vehicle is it."""
        _, *sender = self.beats.get(link, GROUND_STATION)
        source = self._senders.setdefault((sender[0], sender[1]), Sender(*sender))
        self.line.send(link, source.pack_values(name, addressed(name, self.vehicle_id, fields)))

    # Receiving

    def run(self, seconds: float, until: Callable[[], bool] | None = None) -> bool:
        """Let the vehicle's time pass; whether `until` became true."""
        while not self.now_s:  # the vehicle's clock was not received yet
            self._listen()
        end_s = self.now_s + seconds
        while True:
            if until is not None and until():
                return True
            if self.now_s >= end_s:
                return until is None
            self._send_due()
            self._listen()

    def run_to_reply(self, seconds: float, until: Callable[[], bool]) -> bool:
        """The same for a reply, which takes its time by the wall's clock.

        A PX4 that is simulated faster than that replies no sooner.
        """
        return self.run(seconds * self.line.time_scale, until)

    def since(self, *names: str, link: LinkKind = LinkKind.API) -> list[ReceivedMessage]:
        """The messages of these names since the present exchange began."""
        return [
            received
            for received in self._received
            if received.link is link and received.name in names
        ]

    def newest(self, name: str, link: LinkKind = LinkKind.API) -> dict[str, Any] | None:
        """The fields of the newest message of a name; None if there was none."""
        frame = self._newest.get((link, name))
        return None if frame is None else frame.fields()

    def texts(self, link: LinkKind = LinkKind.API) -> list[str]:
        """The STATUSTEXTs since the exchange began, put together from their pieces."""
        texts: dict[int, str] = {}
        for received in self.since("STATUSTEXT", link=link):
            number, text = received.fields["id"], received.fields["text"]
            texts[number] = texts.get(number, "") + text
        return [text.rstrip("\t") for text in texts.values()]

    @property
    def position(self) -> PositionEstimate:
        """The position that the vehicle reports."""
        if not self.run(5.0, lambda: bool(self.track)):
            raise DepartureError("expected LOCAL_POSITION_NED, received none")
        return self.track[-1]

    def degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Latitude and longitude of a place in local metres."""
        home = self._home()
        around_home = MapProjection(home["latitude"] * 1e-7, home["longitude"] * 1e-7)
        return around_home.to_global(north_m - home["x"], east_m - home["y"])

    @property
    def ground_amsl_m(self) -> float:
        """The altitude of home, as known now."""
        return float(self._home()["altitude"]) / 1e3

    def _home(self) -> dict[str, Any]:
        self.run(5.0, lambda: self.newest("HOME_POSITION") is not None)
        home = self.newest("HOME_POSITION")
        if home is None:
            raise DepartureError("expected HOME_POSITION, received none in 5 s")
        return home

    def _listen(self) -> None:
        for link, frame in self.line.listen():
            self._receive(link, frame)

    def _send_due(self) -> None:
        now_s = self.now_s
        if now_s - self._beat_s >= _BEAT_S:
            self._beat_s = now_s
            for link, (kind, *_) in self.beats.items():
                if link in self.line.links:
                    self.send("HEARTBEAT", link, type=kind, autopilot=8, mavlink_version=3)
        if self.sticks is not None and now_s >= self._sticks_s:
            late = now_s - self._sticks_s > _STICKS_S
            self._sticks_s = (now_s if late else self._sticks_s) + _STICKS_S
            self.send("MANUAL_CONTROL", **self.sticks)

    def _receive(self, link: LinkKind, frame: Frame) -> None:
        if frame.component_id != _AUTOPILOT and frame.name != "STATUSTEXT":
            return  # passed on from the other link
        if frame.name == "HEARTBEAT":
            self.vehicle_id = frame.system_id
        self.counts[link, frame.name] += 1
        self._newest[link, frame.name] = frame
        if frame.name == "LOCAL_POSITION_NED" and link is LinkKind.API:
            fields = frame.fields()
            self.track.append(PositionEstimate(self.now_s, fields["x"], fields["y"], -fields["z"]))
        if frame.name not in _COUNTED_ONLY:
            self._received.append(ReceivedMessage(self.now_s, link, frame.name, frame.fields()))
