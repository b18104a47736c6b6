"""Between a conversation and a vehicle: two MAVLink links and the vehicle's own time.

The vehicle is our own in this process, as fast as it can be computed and the same every time; or a
PX4, or ours as a process, over UDP.
"""

import contextlib
import select
import socket
import time
from collections.abc import Mapping
from enum import Enum
from typing import Final, Protocol

from sitl.mavlink.codec import Frame, frames
from sitl.mavlink.vehicle import MavlinkVehicle, VehicleSettings
from sitl.process.udp_link import PortInUseError


class Link(Enum):
    """Which of PX4's links."""

    API = "API"
    GROUND = "GCS"


class SilentVehicleError(Exception):
    """Nothing was heard of the vehicle for too long; the message says where."""


class Line(Protocol):
    """A vehicle at the other end."""

    links: frozenset[Link]
    """The links that there are."""

    @property
    def now_s(self) -> float:
        """The vehicle's simulated time."""

    def send(self, link: Link, frame: bytes) -> None:
        """Say something."""

    def listen(self) -> list[tuple[Link, Frame]]:
        """Let a little of the vehicle's time pass; what was heard in it.

        Raises:
            SilentVehicleError: the vehicle says nothing any more.
        """

    def close(self) -> None:
        """Let go of it."""


class LocalLine:
    """A `Line` to a simulated vehicle of our own.

    Args:
        settings: What vehicle.
    """

    def __init__(self, settings: VehicleSettings) -> None:
        self.vehicle = MavlinkVehicle(settings)
        self._ends = {Link.API: self.vehicle.onboard}  # those that are open
        if settings.ground_link:
            self._ends[Link.GROUND] = self.vehicle.ground
        self.links = frozenset(self._ends)

    @property
    def now_s(self) -> float:
        """See `Line`."""
        return self.vehicle.autopilot.time_s

    def send(self, link: Link, frame: bytes) -> None:
        """See `Line`."""
        self.vehicle.receive(self._ends[link], frame)

    def listen(self) -> list[tuple[Link, Frame]]:
        """See `Line`: one step of the simulation."""
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
        """See `Line`."""


_LARGEST: Final = 65535
_BUFFER: Final = 4 << 20  # 900 parameters come at once
_MOST_AT_ONCE: Final = 50
_SILENCE_S: Final = 8.0  # a PX4 that is started says its first word after about a second
_CLOCKS: Final = frozenset({"ATTITUDE", "LOCAL_POSITION_NED"})  # time_boot_ms comes first in both


class UdpLine:
    """A `Line` over UDP, to a vehicle that sends to ports of this machine.

    Its simulated time is read from the ATTITUDE messages of the API link.

    Args:
        ports: Where the vehicle sends each link to.

    Raises:
        PortInUseError: a port is taken.
    """

    def __init__(self, ports: Mapping[Link, int]) -> None:
        self.links = frozenset(ports)
        self.now_s = 0.0  # 0: not heard yet
        self._sockets: dict[Link, socket.socket] = {}  # empty once it is closed
        self._partners: dict[Link, tuple[str, int]] = {}  # whence it sent last
        self._heard_s = time.monotonic()  # wall clock
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

    def send(self, link: Link, frame: bytes) -> None:
        """See `Line`; lost while the vehicle has not said anything on that link."""
        partner = self._partners.get(link)
        if partner is not None:
            self._sockets[link].sendto(frame, partner)

    def listen(self) -> list[tuple[Link, Frame]]:
        """See `Line`: waits for a datagram, not longer than 20 ms."""
        heard: list[tuple[Link, Frame]] = []
        ready = select.select(list(self._sockets.values()), [], [], 0.02)[0]
        for link, end in self._sockets.items():
            if end not in ready:
                continue
            heard += [(link, frame) for frame in self._receive(link, end)]
        if time.monotonic() - self._heard_s > _SILENCE_S:
            ports = ", ".join(str(end.getsockname()[1]) for end in self._sockets.values())
            raise SilentVehicleError(f"no vehicle sends to UDP port {ports} of this machine")
        return heard

    def _receive(self, link: Link, end: socket.socket) -> list[Frame]:
        heard: list[Frame] = []
        with contextlib.suppress(BlockingIOError):
            for _ in range(_MOST_AT_ONCE):
                datagram, self._partners[link] = end.recvfrom(_LARGEST)
                self._heard_s = time.monotonic()
                heard += (frame for frame in frames(datagram) if frame.name)
        for frame in heard:
            if frame.name in _CLOCKS and link is Link.API:
                self.now_s = int.from_bytes(frame.payload[:4], "little") / 1e3
        return heard

    def close(self) -> None:
        """See `Line`."""
        for end in self._sockets.values():
            end.close()
        self._sockets.clear()
